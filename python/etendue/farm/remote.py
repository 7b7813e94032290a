"""A farm elsewhere, by the REST API of its console: what `etendue farm --url` works on.

It has those methods of `service.Farm` that the command line calls, with the same answers and the same refusals.
"""

from __future__ import annotations

import http.client
import json
import ssl
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any, cast
from urllib.parse import quote, urlencode, urlsplit

from pydantic import TypeAdapter, ValidationError

from etendue.farm import errors, packages
from etendue.farm.accounts import Actor
from etendue.farm.config import Limits
from etendue.farm.errors import FarmError, InvalidError
from etendue.farm.jobs import JobFilter
from etendue.farm.spec import JobSpec
from etendue.farm.states import Role
from etendue.farm.views import CostRow, EventView, FarmStatus, FrameView, JobDetail, JobView, NodeView, Output, PackageView, Page, UserView

TIMEOUT_SECS = 60.0
UPLOAD_SECS = 900.0
"""Reading a large scene for its loss report takes a while."""
MAX_ANSWER = 256 << 20
"""Most bytes of an answer that is no file."""
_KINDS: dict[str, type[FarmError]] = {
    kind.code: kind
    for kind in (
        errors.InvalidError,
        errors.NotFoundError,
        errors.ForbiddenError,
        errors.ConflictError,
        errors.TooLargeError,
        errors.QuotaError,
        errors.PackageError,
    )
}


class UnreachableError(FarmError):
    """The console does not answer, or not as one."""

    code = "unreachable"
    status = 502
    exit_code = 4


class UnauthorizedError(FarmError):
    """The console does not know the token."""

    code = "unauthorized"
    status = 401
    exit_code = 5


class _Api:
    """Requests to one console. Redirects are not followed: the token is for this address alone."""

    def __init__(self, url: str, token: str) -> None:
        parts = urlsplit(url)
        try:
            port = parts.port
        except ValueError as e:
            raise InvalidError(f"{url!r} is no address of a console: {e}") from e
        if parts.scheme not in ("http", "https") or not parts.hostname or parts.query or parts.fragment or parts.username:
            raise InvalidError(f"{url!r} is no address of a console; write https://farm.example.org")
        if not token or not token.isascii() or not token.isprintable() or " " in token:
            raise InvalidError("a console elsewhere needs an API token: in $ETENDUE_FARM_TOKEN, or in a file named by --token-file")
        self.where = f"{parts.scheme}://{parts.netloc}"
        self._secure, self._host, self._port = parts.scheme == "https", parts.hostname, port
        self._prefix = parts.path.rstrip("/") + "/api/v1"
        self._token = token

    def open(
        self,
        method: str,
        path: str,
        query: Mapping[str, object] | None = None,
        *,
        content: object = None,
        file: IO[bytes] | None = None,
        secs: float = TIMEOUT_SECS,
    ) -> http.client.HTTPResponse:
        """Send a request and return the answer, unless it is a refusal."""
        pairs = [(k, v) for k, values in (query or {}).items() for v in (values if isinstance(values, list) else [values])]
        text = urlencode([(k, str(v).lower() if isinstance(v, bool) else str(v)) for k, v in pairs if v is not None])
        target = self._prefix + path + (f"?{text}" if text else "")
        headers = {"Authorization": f"Bearer {self._token}", "Accept": "application/json, */*"}
        body: bytes | IO[bytes] | None = None
        if file is not None:
            file.seek(0, 2)
            headers |= {"Content-Type": "application/octet-stream", "Content-Length": str(file.tell())}
            file.seek(0)
            body = file
        elif content is not None:
            headers["Content-Type"] = "application/json"
            body = json.dumps(content).encode()
        if self._secure:
            context = ssl.create_default_context()
            made: http.client.HTTPConnection = http.client.HTTPSConnection(self._host, self._port, timeout=secs, context=context)
        else:
            made = http.client.HTTPConnection(self._host, self._port, timeout=secs)
        try:
            made.request(method, target, body, headers)
            answer = made.getresponse()
        except (OSError, http.client.HTTPException) as e:
            made.close()
            raise UnreachableError(f"the console at {self.where} does not answer: {e}") from e
        if answer.status >= 300:
            with answer:
                raise self._refusal(answer)
        return answer

    def _refusal(self, answer: http.client.HTTPResponse) -> FarmError:
        try:
            error = json.loads(answer.read(1 << 20))["error"]
            code, message = str(error["code"]), str(error["message"])
        except (OSError, ValueError, KeyError, TypeError, http.client.HTTPException):
            return UnreachableError(f"{self.where} answers {answer.status}, not as a console of Etendue does")
        if answer.status == 401:
            return UnauthorizedError(message)
        return _KINDS.get(code, FarmError)(message)

    def get(self, kind: object, path: str, query: Mapping[str, object] | None = None) -> Any:  # noqa: ANN401 - as `kind` says
        """Return an answer of a kind."""
        return self.ask(kind, "GET", path, query)

    def ask(self, kind: object, method: str, path: str, query: Mapping[str, object] | None = None, **more: Any) -> Any:  # noqa: ANN401
        """Send a request and return its answer, of a kind."""
        answer = self.open(method, path, query, **more)
        try:
            with answer:
                data = answer.read(MAX_ANSWER)
            return TypeAdapter(cast(Any, kind)).validate_json(data) if kind is not None else None
        except (OSError, ValidationError, http.client.HTTPException) as e:
            raise UnreachableError(f"{self.where} has given an answer that is none of this version's console: {type(e).__name__}") from e


class RemoteJobs:
    """As `jobs.Jobs`. The actor is whom the token belongs to, whatever is given."""

    def __init__(self, api: _Api) -> None:
        self._api = api

    def submit(self, _actor: Actor, spec: JobSpec) -> JobDetail:  # noqa: D102
        return cast(JobDetail, self._api.ask(JobDetail, "POST", "/jobs", content=spec.model_dump(mode="json")))

    def find(self, _actor: Actor, filter: JobFilter, *, offset: int = 0, limit: int = 100) -> Page[JobView]:  # noqa: A002, D102
        states = None if filter.states is None else [state.value for state in filter.states]
        query = {"state": states, "owner": filter.owner, "q": filter.text, "offset": offset, "limit": limit}
        return cast(Page[JobView], self._api.get(Page[JobView], "/jobs", query))

    def get(self, _actor: Actor, job_id: int) -> JobDetail:  # noqa: D102
        return cast(JobDetail, self._api.get(JobDetail, f"/jobs/{job_id}"))

    def frames(self, _actor: Actor, job_id: int, *, offset: int = 0, limit: int = 100) -> Page[FrameView]:  # noqa: D102
        return cast(Page[FrameView], self._api.get(Page[FrameView], f"/jobs/{job_id}/frames", {"offset": offset, "limit": limit}))

    def log(self, _actor: Actor, *, job: int | None = None, limit: int = 100) -> Page[EventView]:  # noqa: D102
        return cast(Page[EventView], self._api.get(Page[EventView], "/log", {"job": job, "limit": limit}))

    def _act(self, job_id: int, what: str) -> JobDetail:
        return cast(JobDetail, self._api.ask(JobDetail, "POST", f"/jobs/{job_id}/{what}"))

    def cancel(self, _actor: Actor, job_id: int) -> JobDetail:  # noqa: D102
        return self._act(job_id, "cancel")

    def pause(self, _actor: Actor, job_id: int) -> JobDetail:  # noqa: D102
        return self._act(job_id, "pause")

    def resume(self, _actor: Actor, job_id: int) -> JobDetail:  # noqa: D102
        return self._act(job_id, "resume")

    def approve(self, _actor: Actor, job_id: int) -> JobDetail:  # noqa: D102
        return self._act(job_id, "approve")

    def retry(self, _actor: Actor, job_id: int, *, frame: int | None = None, unit: int | None = None) -> JobDetail:  # noqa: D102
        if unit is not None:
            return self._act(job_id, f"units/{unit}/retry")
        return self._act(job_id, "retry" if frame is None else f"frames/{frame}/retry")

    def set_priority(self, _actor: Actor, job_id: int, priority: int) -> JobDetail:  # noqa: D102
        return cast(JobDetail, self._api.ask(JobDetail, "PUT", f"/jobs/{job_id}/priority", content={"priority": priority}))

    def delete(self, _actor: Actor, job_id: int) -> None:  # noqa: D102
        self._api.ask(None, "DELETE", f"/jobs/{job_id}")


class RemotePictures:
    """As `pictures.Pictures`."""

    def __init__(self, api: _Api) -> None:
        self._api = api

    def outputs(self, _actor: Actor, job_id: int) -> list[Output]:  # noqa: D102
        found = cast(list[Output], self._api.get(list[Output], f"/jobs/{job_id}/outputs"))
        for output in found:
            # The name becomes a file here: a console is not trusted with where.
            if not output.name or output.name in (".", "..") or any(c in "/\\:" or not c.isprintable() for c in output.name):
                raise UnreachableError(f"{self._api.where} names a file {output.name[:100]!a}, which is no name of a picture")
        return found

    def open_output(self, _actor: Actor, job_id: int, name: str) -> tuple[Output | None, IO[bytes]]:  # noqa: D102
        return None, cast(IO[bytes], self._api.open("GET", f"/jobs/{job_id}/outputs/{quote(name, safe='')}"))


class RemoteAccounts:
    """As `accounts.Accounts`, as far as the command line needs it."""

    def __init__(self, api: _Api) -> None:
        self._api = api

    def local(self) -> Actor:
        """Return whom the token belongs to."""
        me = cast(UserView, self._api.get(UserView, "/me"))
        return Actor(me.id, me.name, Role(me.role))

    def users(self, _actor: Actor) -> list[UserView]:  # noqa: D102
        return cast(list[UserView], self._api.get(list[UserView], "/users"))

    def create(self, _actor: Actor, name: str, *, password: str | None, role: Role) -> UserView:  # noqa: D102
        return cast(UserView, self._api.ask(UserView, "POST", "/users", content={"name": name, "password": password, "role": role.value}))

    def update(self, _actor: Actor, name: str, *, password: str | None) -> UserView:  # noqa: D102
        return cast(UserView, self._api.ask(UserView, "PATCH", f"/users/{quote(name, safe='')}", content={"password": password}))

    def create_token(self, actor: Actor, name: str, *, days: float | None, user: str | None = None) -> str:  # noqa: D102
        if user is not None and user != actor.name:
            raise InvalidError("by the API everyone makes tokens for oneself; those of others are made beside the farm's folder")
        answer = self._api.ask(dict[str, str], "POST", "/tokens", content={"name": name, "days": days})
        return cast(str, answer["token"])


class RemoteFarm:
    """A farm behind the address of its console.

    Args:
        url: The console's address, such as `https://farm.example.org`.
        token: An API token: `etendue farm user token NAME` beside the farm, or the console's page of the account.

    Raises:
        InvalidError: That is no address, or no token.
    """

    def __init__(self, url: str, token: str) -> None:
        self._api = _Api(url, token)
        self.jobs = RemoteJobs(self._api)
        self.pictures = RemotePictures(self._api)
        self.accounts = RemoteAccounts(self._api)

    def close(self) -> None:
        """Nothing is open."""

    def add_folder(self, _actor: Actor, folder: Path, paths: Sequence[str], scene: str) -> PackageView:
        """Send files of a local folder as a package."""
        # The console's limits are its own; these keep a mistake from filling the disk here.
        found = packages.manifest(folder, paths, Limits())
        with tempfile.TemporaryDirectory(prefix="etendue-upload-") as scratch:
            packed = Path(scratch) / "package.zip"
            packages.write_zip(folder, found.files, packed)
            name = f"{Path(scene).stem}.zip"
            with packed.open("rb") as data:
                query = {"filename": name, "scene": scene}
                sent = self._api.ask(PackageView, "POST", "/packages", query, file=data, secs=UPLOAD_SECS)
        return cast(PackageView, sent)

    def status(self, _actor: Actor) -> FarmStatus:
        """Return the farm at a glance."""
        return cast(FarmStatus, self._api.get(FarmStatus, "/status"))

    def nodes(self, _actor: Actor, *, alive: bool | None = None) -> list[NodeView]:
        """Return the nodes."""
        return cast(list[NodeView], self._api.get(list[NodeView], "/nodes", {"alive": alive}))

    def cost(self, _actor: Actor, *, by: str) -> list[CostRow]:
        """Return what was spent."""
        return cast(list[CostRow], self._api.get(list[CostRow], "/cost", {"by": by}))
