"""Who asks: by token or by cookie, with a defence against requests that other sites make in a user's name."""

from __future__ import annotations

import secrets
import time
from dataclasses import dataclass, field
from typing import Annotated
from urllib.parse import urlsplit

from fastapi import Depends, Request

from etendue.console.limits import Bucket
from etendue.console.settings import ConsoleSettings
from etendue.farm.accounts import Actor, SignedIn
from etendue.farm.errors import FarmError, ForbiddenError
from etendue.farm.events import audit
from etendue.farm.service import Farm

SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
CSRF_HEADER = "x-csrf-token"


class UnauthorizedError(FarmError):
    """Nobody is signed in, or the token is none of ours."""

    code = "unauthorized"
    status = 401
    exit_code = 5


class TooOftenError(FarmError):
    """A rate limit."""

    code = "too-often"
    status = 429
    exit_code = 5

    def __init__(self, message: str, wait_secs: float) -> None:
        super().__init__(message)
        self.wait_secs = wait_secs


@dataclass
class Console:
    """What all routes share; `request.app.state.console`."""

    farm: Farm
    settings: ConsoleSettings
    requests: Bucket = field(init=False)
    sign_ins: Bucket = field(init=False)
    uploads: Bucket = field(init=False)
    refusals: Bucket = field(init=False)
    streams: dict[int, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        s = self.settings
        self.requests = Bucket(s.requests_per_sec, s.burst)
        self.sign_ins = Bucket(s.sign_ins / 900, s.sign_ins)
        self.uploads = Bucket(s.uploads_per_min / 60, s.uploads_per_min)
        # A flood of refused requests must not fill the log.
        self.refusals = Bucket(0.5, 30)

    @property
    def cookie(self) -> str:
        """Name of the session's cookie. With `__Host-` browsers take it over HTTPS from this very host alone."""
        return "__Host-etendue" if self.settings.is_https else "etendue-session"

    def note_refusal(self, kind: str, message: str, *, user: int | None, key: str) -> None:
        """Write a refusal to the farm's log, unless there are floods of them."""
        if self.refusals.take(key) > 0:
            return
        with self.farm.database.begin() as session:
            audit(session, user, kind, message)


def console_of(request: Request) -> Console:
    """Return what all routes share."""
    console: Console = request.app.state.console
    return console


def address_of(request: Request) -> str:
    """Return where a request comes from."""
    return request.client.host if request.client else "unknown"


def session_of(request: Request) -> SignedIn | None:
    """Return the browser's session; None where it has none."""
    console = console_of(request)
    cookie = request.cookies.get(console.cookie)
    return console.farm.accounts.by_cookie(cookie) if cookie and len(cookie) < 200 else None


def is_own_origin(request: Request) -> bool:
    """Return whether a request comes from a page of ours, as far as the browser tells."""
    site = request.headers.get("sec-fetch-site")
    if site is not None and site not in ("same-origin", "none"):
        return False
    origin = request.headers.get("origin")
    return origin is None or urlsplit(origin).netloc == request.headers.get("host")


def actor(request: Request) -> Actor:
    """Return who asks: the user of the token in `Authorization: Bearer`, or of the browser's session.

    Raises:
        UnauthorizedError: Nobody that we know.
        ForbiddenError: A change by cookie without the session's own key, as another site would send it.
        TooOftenError: Too many requests.
    """
    console = console_of(request)
    address = address_of(request)
    authorization = request.headers.get("authorization")
    if authorization is not None:
        scheme, _, token = authorization.partition(" ")
        # Those who try tokens get slower.
        _hold(console.sign_ins.wait_secs(f"token {address}"))
        found = console.farm.accounts.by_token(token.strip()) if scheme.lower() == "bearer" and 0 < len(token) < 500 else None
        if found is None:
            console.sign_ins.take(f"token {address}")
            raise UnauthorizedError("this token is not known, has expired, or its user is not active")
    else:
        session = session_of(request)
        if session is None:
            raise UnauthorizedError("sign in first")
        found = session.actor
        if request.method not in SAFE_METHODS:
            given = request.headers.get(CSRF_HEADER, "")
            if not is_own_origin(request) or not secrets.compare_digest(given.encode(), session.csrf.encode()):
                request.state.user = found.id
                raise ForbiddenError("this request did not come from a page of the console: its key is missing or wrong")
    request.state.user = found.id
    _hold(console.requests.take(f"user {found.id}"))
    return found


def _hold(wait_secs: float) -> None:
    if wait_secs > 0:
        raise TooOftenError(f"too many requests; try again in {max(1, round(wait_secs))} s", wait_secs)


def sign_in(request: Request, name: str, password: str) -> SignedIn:
    """Open a browser session.

    Raises:
        UnauthorizedError: Name or password is wrong.
        TooOftenError: There were too many attempts, from this address or for this name.
    """
    console = console_of(request)
    keys = [f"address {address_of(request)}", f"name {name[:64].lower()}"]
    _hold(max(console.sign_ins.wait_secs(key) for key in keys))
    found = console.farm.accounts.sign_in(name, password)
    if found is None:
        for key in keys:
            console.sign_ins.take(key)
        raise UnauthorizedError("name or password is wrong")
    return found


def enter(request: Request, key: str) -> SignedIn:
    """Open a browser session of the user `local` by the key that `etendue farm up` prints.

    Raises:
        UnauthorizedError: It is not the key, or there is none.
    """
    console = console_of(request)
    _hold(console.sign_ins.wait_secs(f"key {address_of(request)}"))
    expected = console.settings.local_key
    if expected is None or not secrets.compare_digest(key.encode(), expected.encode()):
        console.sign_ins.take(f"key {address_of(request)}")
        raise UnauthorizedError("this is not the key of this console; open the address that `etendue farm up` has printed")
    return console.farm.accounts.open_session(console.farm.accounts.local())


def expires_in(session: SignedIn) -> int:
    """Return for how many seconds a session is valid."""
    return max(0, int(session.expires_at - time.time()))


Who = Annotated[Actor, Depends(actor)]
"""Parameter of a route: who asks."""


def farm(request: Request) -> Farm:
    """Return the farm."""
    return console_of(request).farm


TheFarm = Annotated[Farm, Depends(farm)]
"""Parameter of a route: the farm."""
