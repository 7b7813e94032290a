"""What strangers, other users, other sites and hostile files try: each is refused with a sentence and logged."""

import logging
import zipfile
from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from etendue.console.app import create_app
from etendue.console.settings import ConsoleSettings
from etendue.farm.models import Event
from etendue.farm.service import Farm
from etendue.farm.states import Role

from .conftest import BALLS, BASE, LIMIT, PASSWORD, Browser, actor, packed

Make = Callable[[str], Browser]


def logged(farm: Farm, text: str) -> list[Event]:
    """Return the lines of the farm's log that have a text."""
    with farm.database.read() as session:
        return [event for event in session.query(Event) if text in event.message]


def sentence(response) -> str:
    """Return what a refusal tells."""
    body = response.json()
    assert set(body) == {"error"}
    assert set(body["error"]) == {"code", "message"}
    assert len(body["error"]["message"]) > 8
    return str(body["error"]["message"])


def test_nothing_is_told_to_strangers(anyone: TestClient) -> None:
    paths = anyone.get("/api/openapi.json").json()["paths"]
    assert len(paths) > 25
    for path, methods in paths.items():
        concrete = path.format(job_id=1, frame=0, layer="rgb", name="a", action="cancel", unit=1, token_id=1, package_id="0" * 64)
        for method in methods:
            response = anyone.request(method, concrete, content=b"{}", params={"filename": "a.zip"})
            if path == "/api/v1/session" and method == "get":
                assert response.json() is None
            elif path == "/api/v1/session" and method == "post":
                assert response.status_code == 422
            else:
                assert response.status_code == 401, (method, path, response.text)
                assert "sign in" in sentence(response)


@pytest.mark.parametrize("token", ["etf_" + "x" * 43, "", "Bearer", "x" * 5000, "etf_\x7f", "' OR 1=1 --"])
def test_foreign_tokens(anyone: TestClient, farm: Farm, token: str) -> None:
    response = anyone.get("/api/v1/jobs", headers={"authorization": f"Bearer {token}"})
    assert response.status_code == 401
    assert "token" in sentence(response)
    assert response.headers["www-authenticate"] == "Bearer"
    lines = logged(farm, "this token is not known")
    assert len(lines) == 1
    assert lines[0].level == "audit"
    assert len(token) < 8 or token not in lines[0].message


def test_guessing_tokens_gets_slow(anyone: TestClient, farm: Farm) -> None:
    answers = [anyone.get("/api/v1/jobs", headers={"authorization": f"Bearer etf_{i}"}).status_code for i in range(14)]
    assert answers[:10] == [401] * 10
    assert answers[-1] == 429
    # Those with a session are not shut out by it.
    good = farm.accounts.create_token(actor(farm, "ada"), "t")
    assert anyone.get("/api/v1/jobs", headers={"authorization": f"Bearer {good}"}).status_code == 429


def test_tokens_of_others_end_with_them(anyone: TestClient, farm: Farm, browser: Make) -> None:
    token = farm.accounts.create_token(actor(farm, "ada"), "laptop")
    headers = {"authorization": f"Bearer {token}"}
    assert anyone.get("/api/v1/me", headers=headers).json()["name"] == "ada"
    # Another user cannot revoke it, and is not told that it is there.
    number = farm.accounts.tokens(actor(farm, "ada"))[0].id
    assert browser("eve")("DELETE", f"/tokens/{number}").status_code == 404
    assert browser("root")("PATCH", "/users/ada", json={"is_active": False}).status_code == 200
    assert anyone.get("/api/v1/me", headers=headers).status_code == 401


def test_jobs_of_others(farm: Farm, browser: Make) -> None:
    ada, eve, root = browser("ada"), browser("eve"), browser("root")
    job = ada.submit(name="secret")
    number = job["id"]
    for method, path in [
        ("GET", ""),
        ("DELETE", ""),
        ("GET", "/frames"),
        ("GET", "/units"),
        ("GET", "/preview"),
        ("GET", "/frames/0/preview"),
        ("GET", "/frames/0/layers"),
        ("GET", "/frames/0/layers/rgb"),
        ("GET", "/frames/0/picture"),
        ("GET", "/outputs"),
        ("GET", "/outputs.zip"),
        ("GET", "/outputs/a.exr"),
        ("GET", "/movie.mp4"),
        ("POST", "/cancel"),
        ("POST", "/pause"),
        ("POST", "/retry"),
        ("POST", "/frames/0/retry"),
        ("POST", "/units/1/retry"),
    ]:
        response = eve(method, f"/jobs/{number}{path}")
        assert response.status_code == 404, (method, path, response.text)
        # It says the same as for a job that is not there at all.
        assert sentence(response) == sentence(eve(method, f"/jobs/99{path}")).replace("99", str(number))
    assert eve("PUT", f"/jobs/{number}/priority", json={"priority": 3}).status_code == 404
    assert eve.get("/log", params={"job": number}).status_code == 404
    assert eve.get("/events", params={"job": number}).status_code == 404
    # The log says who has tried, and nothing of jobs that are not there.
    lines = logged(farm, f"there is no job {number}")
    assert lines
    assert all(line.level == "audit" and line.user_id == actor(farm, "eve").id for line in lines)
    assert not logged(farm, "there is no job 99")
    assert eve.post("/jobs/batch", json={"action": "cancel", "jobs": [number]}).json()["refused"][0]["code"] == "not-found"
    assert eve.get("/jobs").json()["total"] == 0
    assert eve.get("/jobs", params={"owner": "ada", "q": "secret"}).json()["total"] == 0
    # Whoever knows the name of a package does not have it.
    package = str(job["package_id"])
    assert eve.get(f"/packages/{package}").status_code == 404
    assert eve.post("/jobs", json={"package": package}).status_code == 404
    assert farm.jobs.get(actor(farm, "ada"), int(str(number))).state == "queued"
    assert root.get(f"/jobs/{number}").status_code == 200

    shared = ada.submit(name="open", shared=True)["id"]
    assert eve.get(f"/jobs/{shared}").json()["actions"] == []
    refused = eve.post(f"/jobs/{shared}/cancel")
    assert refused.status_code == 403
    assert "belongs to someone else" in sentence(refused)
    assert logged(farm, "belongs to someone else")


def test_viewers_and_artists_stay_in_their_roles(farm: Farm, browser: Make) -> None:
    viewer, artist = browser("max"), browser("eve")
    assert viewer.upload(packed(scene_xml=BALLS).read()).status_code == 403
    assert viewer.post("/jobs", json={"package": "0" * 64}).status_code == 403
    for who in (viewer, artist):
        assert who.get("/users").status_code == 403
        assert who.post("/users", json={"name": "imp", "password": PASSWORD, "role": "admin"}).status_code == 403
        assert who("PATCH", f"/users/{who.name}", json={"role": "admin"}).status_code == 403
    assert "role" in sentence(viewer.get("/users"))
    assert {u.name: u.role for u in farm.accounts.users(actor(farm, "root"))}["eve"] == Role.ARTIST
    assert logged(farm, "this needs the role")


def test_requests_of_other_sites(farm: Farm, browser: Make) -> None:
    ada = browser("ada")
    number = ada.submit()["id"]
    path = f"/api/v1/jobs/{number}/cancel"
    for headers in [
        {},
        {"x-csrf-token": ""},
        {"x-csrf-token": "x" * 43},
        {"x-csrf-token": browser("eve").csrf},
        {"x-csrf-token": ada.csrf, "origin": "https://evil.example"},
        {"x-csrf-token": ada.csrf, "origin": "null"},
        {"x-csrf-token": ada.csrf, "sec-fetch-site": "cross-site"},
        {"x-csrf-token": ada.csrf, "sec-fetch-site": "same-site"},
    ]:
        response = ada.client.post(path, headers=headers)
        assert response.status_code == 403, headers
        assert "did not come from a page of the console" in sentence(response)
    assert logged(farm, "did not come from a page")
    # A form of another site that signs its victim in as someone else.
    stolen = {"name": "eve", "password": PASSWORD}
    assert ada.client.post("/api/v1/session", json=stolen, headers={"origin": "https://evil.example"}).status_code == 403
    assert ada.client.post("/api/v1/session", data=stolen).status_code == 422
    assert ada.client.post(path, headers={"x-csrf-token": ada.csrf, "origin": BASE}).status_code == 200


def test_other_host_names(anyone: TestClient) -> None:
    for host in ("evil.example", "localhost.evil.example", "evil.example:8640"):
        assert anyone.get("/api/v1/session", headers={"host": host}).status_code == 400
    assert anyone.get("/api/v1/session", headers={"host": "localhost:1234"}).status_code == 200


def test_scripts_in_names_stay_text(farm: Farm, browser: Make) -> None:
    ada = browser("ada")
    bad = "<script>alert(1)</script><img src=x onerror=alert(1)>"
    number = ada.submit(name=bad)["id"]
    answer = ada.get(f"/jobs/{number}")
    assert answer.json()["name"] == bad
    assert answer.headers["content-type"] == "application/json"
    assert answer.headers["x-content-type-options"] == "nosniff"
    page = ada.client.get(f"/jobs/{number}")
    assert "alert" not in page.text
    policy = page.headers["content-security-policy"]
    assert "script-src 'self';" in policy
    assert "unsafe" not in policy
    assert "frame-ancestors 'none'" in policy
    assert page.headers["x-frame-options"] == "DENY"
    assert ada.post("/jobs", json={"package": "0" * 64, "name": "a\x00b"}).status_code == 422
    assert ada.post("/jobs", content=b'{"package": "' + b"0" * 64 + b'", "name": "\\ud800"}').status_code == 422


def test_sql_in_filters(farm: Farm, browser: Make) -> None:
    ada = browser("ada")
    ada.submit(name="ball")
    for text in ["' OR '1'='1", "'; DROP TABLE jobs; --", '" OR ""="', "%", "_", "\\", "%27%20OR%201=1", "a' UNION SELECT 1 --"]:
        check_filters(ada, text)
    # What is refused is logged, without what was sent.
    lines = logged(farm, "/api/v1/jobs' from testclient was refused")
    assert lines
    assert not any("DROP" in line.message for line in lines)


def check_filters(ada: Browser, text: str) -> None:
    assert ada.get("/jobs", params={"q": text}).json()["total"] == 0
    assert ada.get("/jobs", params={"owner": text}).json()["total"] == 0
    for key in ("order", "state", "down", "offset", "created_after", "package"):
        assert ada.get("/jobs", params={key: text}).status_code == 422, key
    assert ada.get("/log", params={"node": text}).json()["total"] == 0
    assert ada.client.get(f"/api/v1/jobs/{text}/frames").status_code in (404, 422)
    assert ada.get("/jobs", params={"q": "BALL"}).json()["total"] == 1


def zip_of(*entries: tuple[str, bytes], attributes: int = 0) -> bytes:
    data = BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in entries:
            entry = zipfile.ZipInfo(name)
            entry.external_attr = attributes << 16
            archive.writestr(entry, content, zipfile.ZIP_DEFLATED)
    return data.getvalue()


SCENE = BALLS.encode()


@pytest.mark.parametrize(
    ("data", "filename", "word"),
    [
        (zip_of(("scene.xml", SCENE), ("../../evil.sh", b"x")), "a.zip", "outside"),
        (zip_of(("scene.xml", SCENE), ("/etc/passwd", b"x")), "a.zip", "absolute"),
        (zip_of(("scene.xml", SCENE), ("C:\\evil", b"x")), "a.zip", "absolute"),
        (zip_of(("scene.xml", SCENE), attributes=0o120777), "a.zip", "link"),
        (zip_of(("scene.xml", SCENE), ("Scene.XML", SCENE)), "a.zip", "two files of one name"),
        (zip_of(("scene.xml", SCENE), ("zeros", bytes(200 << 20))), "a.zip", "bytes"),
        (b"PK\x03\x04" + b"x" * 200, "a.zip", "zip"),
        (zip_of(), "a.zip", "empty"),
        (zip_of(("readme.txt", b"x")), "a.zip", "no scene"),
        (SCENE, "../../evil.exe", "zip files or single scenes"),
        (SCENE[:200], "scene.xml", "scene.xml"),
        (b'<scene version="3.0.0"><shape type="obj"><string name="filename" value="/etc/passwd"/></shape></scene>', "scene.xml", "passwd"),
        (b'#version 3.7;\n#fopen F "/etc/passwd" read\n#read (F, A)\nsphere { 0, 1 }', "scene.pov", "passwd"),
        (b'#version 3.7;\n#include "../../../../etc/passwd"\nsphere { 0, 1 }', "scene.pov", "passwd"),
    ],
)
def test_hostile_uploads(farm: Farm, browser: Make, data: bytes, filename: str, word: str) -> None:
    response = browser("ada").upload(data, filename)
    assert response.status_code in (413, 422), response.text
    assert word in sentence(response)
    lines = [event for event in logged(farm, "was refused") if event.kind == "package-refused"]
    assert len(lines) == 1
    assert farm.packages(actor(farm, "ada")).total == 1
    assert len(list((farm.root / "store" / "packages").iterdir())) == 1


def test_scenes_write_no_files(browser: Make, tmp_path: Path) -> None:
    target = tmp_path / "evil.txt"
    answer = browser("ada").upload(f'#version 3.7; #fopen F "{target}" write\n#write (F, "x")\nsphere {{ 0, 1 }}'.encode(), "scene.pov")
    assert answer.status_code == 201
    assert "not written to disk" in answer.json()["info"]["losses"][0][4]
    assert not target.exists()


def test_oversize_bodies(farm: Farm, browser: Make) -> None:
    ada = browser("ada")
    refused = ada.upload(bytes(LIMIT + 1))
    assert refused.status_code == 413
    assert str(LIMIT) in sentence(refused)
    assert logged(farm, f"at most {LIMIT} bytes")

    def endless():
        for _ in range(64):
            yield bytes(1 << 16)

    # Without a length, and with one that lies.
    assert ada.post("/packages", params={"filename": "a.zip"}, content=endless()).status_code == 413
    assert ada.post("/jobs", content=b" " * ((1 << 20) + 1)).status_code == 413
    assert ada.post("/jobs", content=endless()).status_code == 413
    assert ada.client.post("/api/v1/session", content=endless()).status_code == 413
    assert ada.client.request("POST", "/api/v1/jobs", content=b"{}", headers={"content-length": "-5"}).status_code in (400, 413)


@pytest.mark.parametrize("name", ["../../farm.db", "..%2f..%2ffarm.db", "%2e%2e/farm.json", "/etc/passwd", "....//x", "a\\..\\b"])
def test_paths_out_of_a_job(browser: Make, name: str) -> None:
    ada = browser("ada")
    number = ada.submit()["id"]
    response = ada.client.get(f"/api/v1/jobs/{number}/outputs/{name}")
    assert response.status_code in (404, 422)
    assert "SQLite" not in response.text
    assert ada.client.get(f"/static/{name}").status_code == 404


def test_guessing_passwords(farm: Farm, settings: ConsoleSettings) -> None:
    farm.accounts.update(actor(farm, "root"), "ada", password=PASSWORD)
    settings.sign_ins = 3
    with TestClient(create_app(farm, settings), base_url=BASE) as client:
        answers = [client.post("/api/v1/session", json={"name": "ada", "password": f"wrong {i}"}) for i in range(5)]
        assert [a.status_code for a in answers] == [401, 401, 401, 429, 429]
        assert int(answers[-1].headers["retry-after"]) > 0
        # Names that exist and those that do not look the same.
        assert sentence(answers[0]) == "name or password is wrong"
    with TestClient(create_app(farm, settings), base_url=BASE) as client:
        answer = client.post("/api/v1/session", json={"name": "nobody", "password": "wrong"})
        assert (answer.status_code, sentence(answer)) == (401, "name or password is wrong")
    assert len(logged(farm, "ada did not sign in")) == 3


def test_too_many_requests(farm: Farm) -> None:
    with TestClient(create_app(farm, ConsoleSettings(requests_per_sec=0.001, burst=5)), base_url=BASE) as client:
        ada = Browser(farm, client, "ada")
        assert [ada.get("/status").status_code for _ in range(6)] == [200] * 5 + [429]
        # Each user has a limit of their own.
        assert Browser(farm, client, "eve").get("/status").status_code == 200


def test_quotas(farm: Farm, browser: Make) -> None:
    root, ada = browser("root"), browser("ada")
    assert root("PATCH", "/users/ada", json={"max_jobs": 1, "max_bytes": 900}).json()["max_jobs"] == 1
    ada.submit()
    package = ada.get("/packages").json()["items"][0]["id"]
    refused = ada.post("/jobs", json={"package": package})
    assert (refused.status_code, refused.json()["error"]["code"]) == (429, "quota")
    refused = ada.upload(BALLS.encode() + b"<!-- " + b"x" * 900 + b" -->", "other.xml")
    assert (refused.status_code, refused.json()["error"]["code"]) == (429, "quota")
    assert root("PATCH", "/users/ada", json={"max_jobs": None}).json()["max_jobs"] is None
    assert ada.post("/jobs", json={"package": package}).status_code == 201


def test_secrets_are_in_no_log(farm: Farm, app, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.DEBUG)
    farm.accounts.update(actor(farm, "root"), "ada", password=PASSWORD)
    with TestClient(app, base_url=BASE) as client:
        session = client.post("/api/v1/session", json={"name": "ada", "password": PASSWORD}).json()
        cookie = client.cookies["etendue-session"]
        token = client.post("/api/v1/tokens", json={"name": "t"}, headers={"x-csrf-token": session["csrf"]}).json()["token"]
        client.post("/api/v1/session", json={"name": "ada", "password": PASSWORD + "!"})
        client.post("/api/v1/session", json={"name": PASSWORD, "password": 3})
        client.get("/api/v1/users", params={"token": token}, headers={"authorization": f"Bearer {token}"})
        client.get("/enter", params={"key": token})
        client.post("/api/v1/jobs", json={"package": token}, headers={"x-csrf-token": "wrong"})
    with farm.database.read() as database:
        events = "\n".join(event.message for event in database.query(Event))
        dump = "\n".join(str(row) for row in database.connection().exec_driver_sql("SELECT * FROM users, tokens, web_sessions"))
    own = "\n".join(record.getMessage() for record in caplog.records if record.name.startswith("etendue"))
    assert "was refused" in events
    for secret in (PASSWORD, cookie, token, session["csrf"]):
        assert secret not in own
        assert secret not in events
    # At rest there are hashes; the key against other sites is none of a user's secrets.
    for secret in (PASSWORD, cookie, token):
        assert secret not in dump
