"""`etendue farm --url`: the command line against a console, with a token."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from etendue.console import serve
from etendue.console.settings import ConsoleSettings
from etendue.farm import cli
from etendue.farm.errors import ForbiddenError, InvalidError, NotFoundError
from etendue.farm.remote import RemoteFarm, UnauthorizedError, UnreachableError
from etendue.farm.service import Farm

from .conftest import BALLS, Background, Runner, actor


@pytest.fixture
def site(farm: Farm, runner: Runner) -> Iterator[str]:
    background = Background(runner)
    with serve.running(farm, ConsoleSettings(poll_secs=0.2), port=0) as address:
        yield address
    background.stop()


@pytest.fixture
def command(site: str, farm: Farm, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.setenv("ETENDUE_FARM_URL", site)
    monkeypatch.setenv("ETENDUE_FARM_TOKEN", farm.accounts.create_token(actor(farm, "ada"), "test"))

    def run(*argv: str) -> tuple[int, object]:
        capsys.readouterr()
        code = cli.main([*argv, "--json"])
        out = capsys.readouterr().out
        return code, json.loads(out) if out.strip() else None

    return run


def test_a_picture_comes_from_a_farm_elsewhere(command, farm: Farm, tmp_path: Path) -> None:
    scene = tmp_path / "balls.xml"
    scene.write_text(BALLS)
    target = tmp_path / "balls.exr"
    code, job = command("submit", str(scene), "--spp", "4", "-o", str(target), "--wait", "-q")
    assert (code, job["state"], job["owner"]) == (0, "done", "ada")
    held = farm.pictures.outputs(actor(farm, "ada"), job["id"])[0]
    _, data = farm.pictures.open_output(actor(farm, "ada"), job["id"], held.name)
    with data:
        assert target.read_bytes() == data.read()
    number = str(job["id"])
    assert command("wait", number)[0] == 0
    assert command("fetch", number, "-o", str(tmp_path / "here"))[0] == 0
    assert (tmp_path / "here" / held.name).read_bytes() == target.read_bytes()
    assert command("status")[1]["items"][0]["id"] == job["id"]
    assert command("status", number)[1]["frames"][0]["state"] == "done"
    assert command("nodes")[0] == 0
    assert command("cost")[1][0]["key"]
    assert any(line["kind"] == "job-submitted" for line in command("log", number)[1]["items"])
    assert command("pause", number)[0] == 6
    assert command("delete", number) == (0, {"deleted": job["id"]})
    assert command("status", number)[0] == 6


def test_jobs_are_steered_from_elsewhere(command, tmp_path: Path) -> None:
    scene = tmp_path / "balls.xml"
    scene.write_text(BALLS)
    code, job = command("submit", str(scene), "--spp", "60000")
    assert code == 0
    number = str(job["id"])
    assert command("pause", number)[1]["state"] == "paused"
    assert command("wait", number, "--timeout", "0.1")[0] == cli.EXIT_TIMEOUT
    assert command("resume", number)[0] == 0
    assert command("priority", number, "7")[1]["priority"] == 7
    assert command("cancel", number)[1]["state"] == "cancelled"
    assert command("wait", number)[0] == cli.EXIT_CANCELLED
    assert command("retry", number)[0] == 0
    assert command("cancel", number)[0] == 0


def test_refusals_are_those_of_the_console(site: str, farm: Farm, command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UnauthorizedError):
        RemoteFarm(site, "etf_" + "x" * 43).accounts.local()
    eve = RemoteFarm(site, farm.accounts.create_token(actor(farm, "eve"), "test"))
    me = eve.accounts.local()
    assert me.name == "eve"
    scene = tmp_path / "balls.xml"
    scene.write_text(BALLS)
    _, job = command("submit", str(scene), "--spp", "60000")
    with pytest.raises(NotFoundError):
        eve.jobs.get(me, job["id"])
    with pytest.raises(ForbiddenError):
        eve.accounts.users(me)
    with pytest.raises(InvalidError):
        eve.accounts.create_token(me, "not mine", days=None, user="ada")
    assert command("cancel", str(job["id"]))[0] == 0
    for url in ("ftp://farm", "farm.example.org", "http://ada:pw@farm", "http://farm:port"):
        with pytest.raises(InvalidError):
            RemoteFarm(url, "etf_x")
    for token in ("", "etf_x\r\nHost: evil", "ü"):
        with pytest.raises(InvalidError):
            RemoteFarm(site, token)
    with pytest.raises(UnreachableError):
        RemoteFarm("http://127.0.0.1:9", "etf_x").accounts.local()
    monkeypatch.setenv("ETENDUE_FARM_URL", "http://127.0.0.1:9")
    assert command("status")[0] == 4


def test_a_console_does_not_choose_where_files_go(site: str, farm: Farm, monkeypatch: pytest.MonkeyPatch) -> None:
    ada = RemoteFarm(site, farm.accounts.create_token(actor(farm, "ada"), "test"))
    output = {"name": "../../.bashrc", "frame": 0, "format": "exr", "bytes": 1, "sha256": "0" * 64}
    monkeypatch.setattr(type(farm.pictures), "outputs", lambda *_: [output])
    with pytest.raises(UnreachableError, match="no name of a picture"):
        ada.pictures.outputs(ada.accounts.local(), 1)
