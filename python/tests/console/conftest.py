"""A farm with a few users, its console, and clients that are signed in."""

import shutil
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytest.importorskip("fastapi", reason="the console's packages are not installed")
pytest.importorskip("sqlalchemy", reason="the farm's packages are not installed")
pytest.importorskip("httpx2", reason="httpx2 is not installed")

from starlette.testclient import TestClient

from etendue.console.app import create_app
from etendue.console.settings import ConsoleSettings
from etendue.farm.accounts import Actor, actor_of
from etendue.farm.config import FarmConfig, Limits
from etendue.farm.errors import FarmError
from etendue.farm.models import User
from etendue.farm.service import Farm
from etendue.farm.states import Role
from etendue.farm.views import JobDetail
from tests.farm.conftest import BALLS, SPIN, Runner, packed

PASSWORD = "correct horse"
BASE = "http://localhost"
LIMIT = 1 << 20
"""Bytes of an upload."""


CONFIG = FarmConfig(
    unit_secs=(0.02, 0.05), limits=Limits(check_secs=120, upload_bytes=LIMIT, package_bytes=LIMIT), price=0.1, private_webhooks=True
)


@pytest.fixture(scope="session")
def template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a farm with users and a package of ada's, to be copied: making tables and reading scenes takes a while."""
    root = tmp_path_factory.mktemp("template") / "farm"
    made = Farm.open(root, CONFIG)
    local = made.accounts.local()
    for name, role in (("ada", Role.ARTIST), ("eve", Role.ARTIST), ("max", Role.VIEWER), ("root", Role.ADMIN)):
        made.accounts.create(local, name, role=role)
    made.upload(actor(made, "ada"), packed(scene_xml=BALLS), "scene.zip")
    made.close()
    return root


@pytest.fixture
def farm(tmp_path: Path, template: Path) -> Iterator[Farm]:
    """A farm with short units, the artists ada and eve, the viewer max, and the administrator root."""
    shutil.copytree(template, tmp_path / "farm")
    made = Farm.open(tmp_path / "farm", CONFIG)
    yield made
    made.close()


def actor(farm: Farm, name: str) -> Actor:
    with farm.database.read() as session:
        row = session.query(User).filter_by(name=name).one()
        return actor_of(row)


@pytest.fixture
def settings() -> ConsoleSettings:
    return ConsoleSettings(poll_secs=0.05, local_key="the-key")


class Browser:
    """A client with a session's cookie, which sends the key that the console's pages send."""

    def __init__(self, farm: Farm, client: TestClient, name: str) -> None:
        self.client = client
        self.name = name
        session = farm.accounts.open_session(actor(farm, name))
        self.csrf = session.csrf
        self.cookie = session.cookie
        client.cookies.set("etendue-session", session.cookie)

    def __call__(self, method: str, path: str, **kwargs: object) -> object:
        headers = {"x-csrf-token": self.csrf, **kwargs.pop("headers", {})}  # type: ignore[dict-item]
        return self.client.request(method, f"/api/v1{path}", headers=headers, **kwargs)  # type: ignore[arg-type]

    def get(self, path: str, **kwargs: object):
        return self("GET", path, **kwargs)

    def post(self, path: str, **kwargs: object):
        return self("POST", path, **kwargs)

    def upload(self, data: bytes, filename: str = "scene.zip"):
        return self.post("/packages", params={"filename": filename}, content=data)

    def submit(self, **spec: object) -> dict[str, object]:
        """Upload the two balls and order a picture of them."""
        uploaded = self.upload(packed(scene_xml=BALLS).read())
        assert uploaded.status_code == 201, uploaded.text
        made = self.post("/jobs", json={"package": uploaded.json()["id"], "settings": {"spp": 4}, **spec})
        assert made.status_code == 201, made.text
        return made.json()


@pytest.fixture
def app(farm: Farm, settings: ConsoleSettings):
    return create_app(farm, settings)


@pytest.fixture
def browser(farm: Farm, app) -> Iterator[Callable[[str], Browser]]:
    """Makes browsers that are signed in."""
    clients: list[TestClient] = []

    def make(name: str) -> Browser:
        client = TestClient(app, base_url=BASE, raise_server_exceptions=False)
        clients.append(client)
        return Browser(farm, client, name)

    yield make
    for client in clients:
        client.close()


@pytest.fixture
def anyone(app) -> Iterator[TestClient]:
    """A client that is not signed in."""
    with TestClient(app, base_url=BASE, raise_server_exceptions=False, follow_redirects=False) as client:
        yield client


@pytest.fixture
def runner(farm: Farm, tmp_path: Path) -> Iterator[Runner]:
    made = Runner(farm, tmp_path / "cache")
    yield made
    made.scheduler.close()


class Background:
    """Runs a farm's scheduler in a thread."""

    def __init__(self, runner: Runner) -> None:
        self._stop = threading.Event()
        self._runner = runner
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._stop.is_set():
            self._runner.scheduler.step(0.02)

    def stop(self) -> None:
        self._stop.set()
        self._thread.join()


def finish(runner: Runner, job: dict[str, object]) -> JobDetail:
    made = runner.farm.jobs.get(runner.farm.accounts.local(), int(str(job["id"])))
    return runner.finish(made)


__all__ = ["BALLS", "BASE", "LIMIT", "PASSWORD", "SPIN", "Background", "Browser", "FarmError", "Runner", "actor", "finish", "packed"]
