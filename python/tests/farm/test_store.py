"""Stores and databases: folders, a real S3 server, SQLite, a real PostgreSQL."""

import os
import pwd
import shutil
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import inspect

from etendue.farm.config import FarmConfig
from etendue.farm.database import Database
from etendue.farm.errors import ForbiddenError, InvalidError
from etendue.farm.models import Base
from etendue.farm.service import Farm
from etendue.farm.store import Store

from .conftest import BALLS, Runner, digest, packed, single_machine


def check_store(store: Store, tmp_path: Path) -> None:
    store.write("jobs/1/a.film", b"one")
    store.write("jobs/1/a.film", b"two")
    (tmp_path / "local").write_bytes(b"three")
    store.write_file("jobs/1/b/c.film", tmp_path / "local")
    assert store.read("jobs/1/a.film") == b"two"
    assert store.size("jobs/1/b/c.film") == 5
    with store.open("jobs/1/b/c.film") as data:
        assert data.read(2) == b"th"
    store.fetch("jobs/1/b/c.film", tmp_path / "fetched")
    assert (tmp_path / "fetched").read_bytes() == b"three"
    assert store.names("jobs") == ["jobs/1/a.film", "jobs/1/b/c.film"]
    assert store.exists("jobs/1/a.film")
    store.delete("jobs/1/a.film", "jobs/1/none.film")
    assert not store.exists("jobs/1/a.film")
    with pytest.raises(FileNotFoundError):
        store.read("jobs/1/a.film")
    store.delete_folder("jobs/1")
    store.delete_folder("jobs/1")
    assert store.names("jobs") == []
    for name in ("../a", "/etc/passwd", "a/../../b", "a//b", "", "a\\b", "a/./b"):
        with pytest.raises(ValueError, match="no name of a file"):
            store.read(name)


def test_a_folder_is_a_store(tmp_path: Path) -> None:
    store = Store(f"file://{tmp_path}/store")
    check_store(store, tmp_path)
    # A write that fails leaves nothing behind.
    with pytest.raises(TypeError):
        store.write("x/y", "no bytes")  # type: ignore[arg-type]
    assert store.names("x") == []


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


@pytest.fixture
def s3(monkeypatch: pytest.MonkeyPatch) -> Iterator[FarmConfig]:
    """A bucket on a local S3 server."""
    server = pytest.importorskip("moto.server", reason="the S3 server for tests is not installed")
    pytest.importorskip("s3fs", reason="s3fs is not installed")
    for key in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.setenv(key, "testing")
    monkeypatch.setenv("AWS_DEFAULT_REGION", "us-east-1")
    made = server.ThreadedMotoServer(ip_address="127.0.0.1", port=free_port(), verbose=False)
    made.start()
    url = f"http://127.0.0.1:{made._port}"
    import boto3

    boto3.client("s3", endpoint_url=url).create_bucket(Bucket="farm")
    yield FarmConfig(store="s3://farm/here", store_options={"endpoint_url": url, "use_listings_cache": False}, unit_secs=(0.05, 0.1))
    made.stop()


@pytest.mark.filterwarnings("ignore")
def test_object_storage_is_a_store_and_a_job_runs_on_it(s3: FarmConfig, tmp_path: Path) -> None:
    check_store(Store(s3.store, s3.store_options), tmp_path)
    farm = Farm.open(tmp_path / "farm", s3)
    actor = farm.accounts.local()
    package = farm.upload(actor, packed(balls_xml=BALLS), "scene.zip")
    job = farm.jobs.submit(actor, {"package": package.id, "settings": {"spp": 8}, "unit_secs": 0.05})
    runner = Runner(farm, tmp_path / "cache")
    job = runner.finish(job)
    runner.scheduler.close()
    assert job.state == "done", job.error
    _, data = farm.pictures.open_output(actor, job.id, "balls.exr")
    with data:
        assert digest(data.read()) == digest(single_machine(tmp_path, BALLS, "balls.xml", spp=8))
    farm.close()


@pytest.fixture
def postgresql(tmp_path: Path) -> Iterator[str]:
    """A PostgreSQL of Debian's package, in a folder of the test."""
    found = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb")) if Path("/usr/lib/postgresql").is_dir() else []
    named = shutil.which("initdb")
    programs = found[-1].parent if found else Path(named).resolve().parent if named else None
    if programs is None:
        pytest.skip("PostgreSQL is not installed (Debian: apt-get install postgresql): its tests are left out")
    pytest.importorskip("psycopg", reason="psycopg is not installed")
    # The server refuses to run as root.
    user: dict[str, str] = {}
    with tempfile.TemporaryDirectory(prefix="etendue-pg-") as folder:
        if os.geteuid() == 0:
            try:
                pwd.getpwnam("postgres")
            except KeyError:
                pytest.skip("PostgreSQL cannot run as root and there is no user `postgres`: its tests are left out")
            shutil.chown(folder, "postgres")
            user = {"user": "postgres"}
        data, port = f"{folder}/data", free_port()
        flags = ["-D", data, "-A", "trust", "-U", "etendue", "--no-sync"]
        subprocess.run([programs / "initdb", *flags], check=True, capture_output=True, cwd=folder, **user)  # type: ignore[call-overload]
        options = f"-p {port} -k {folder} -c listen_addresses=127.0.0.1 -c fsync=off"
        log = f"{folder}/log"
        start = [programs / "pg_ctl", "-D", data, "-o", options, "-l", log, "-w", "start"]
        subprocess.run(start, check=True, capture_output=True, cwd=folder, **user)  # type: ignore[call-overload]
        try:
            yield f"postgresql+psycopg://etendue@127.0.0.1:{port}/postgres"
        finally:
            stop = [programs / "pg_ctl", "-D", data, "-m", "immediate", "stop"]
            subprocess.run(stop, check=False, capture_output=True, cwd=folder, **user)  # type: ignore[call-overload]


def test_a_job_runs_on_postgresql(postgresql: str, tmp_path: Path) -> None:
    farm = Farm.open(tmp_path / "farm", FarmConfig(database=postgresql, unit_secs=(0.05, 0.1)))
    with farm.database.engine.connect() as connection:
        assert compare_metadata(MigrationContext.configure(connection), Base.metadata) == []
    actor = farm.accounts.local()
    package = farm.upload(actor, packed(balls_xml=BALLS), "scene.zip")
    order = {"package": package.id, "settings": {"spp": 8}, "unit_secs": 0.05, "name": "100%"}
    job = farm.jobs.submit(actor, order)
    runner = Runner(farm, tmp_path / "cache")
    job = runner.finish(job)
    assert job.state == "done", job.error
    from etendue.farm.jobs import JobFilter

    assert farm.jobs.find(actor, JobFilter(text="0%", order="-finished")).total == 1
    farm.jobs.cancel(actor, farm.jobs.submit(actor, order).id)
    farm.jobs.delete(actor, job.id)
    assert farm.cost(actor, by="user")[0].jobs == 1
    runner.scheduler.close()
    farm.close()


def test_migrations_make_the_tables_of_the_models(tmp_path: Path) -> None:
    database = Database(f"sqlite:///{tmp_path}/farm.db")
    with database.engine.connect() as connection:
        assert compare_metadata(MigrationContext.configure(connection), Base.metadata) == []
    # Opening it once more changes nothing.
    database.migrate()
    names = set(inspect(database.engine).get_table_names())
    assert names == {table.name for table in Base.metadata.sorted_tables} | {"alembic_version"}
    database.close()
    with pytest.raises(InvalidError, match="SQLite or PostgreSQL"):
        Database("mysql://localhost/x")


def test_passwords_tokens_and_browsers(farm: Farm) -> None:
    admin = farm.accounts.local()
    with pytest.raises(InvalidError):
        farm.accounts.create(admin, "ann", password="short")
    with pytest.raises(InvalidError):
        farm.accounts.create(admin, "<script>", password="long enough")
    farm.accounts.create(admin, "ann", password="long enough")
    assert farm.accounts.sign_in("ann", "wrong password") is None
    assert farm.accounts.sign_in("nobody", "long enough") is None
    signed = farm.accounts.sign_in("ann", "long enough")
    assert signed is not None
    found = farm.accounts.by_cookie(signed.cookie)
    assert found is not None
    assert (found.actor.name, found.csrf) == ("ann", signed.csrf)
    assert farm.accounts.by_cookie(signed.cookie + "x") is None
    with pytest.raises(ForbiddenError):
        farm.accounts.users(signed.actor)
    # A new password ends what was signed in with the old one.
    farm.accounts.update(signed.actor, "ann", password="even longer now")
    assert farm.accounts.by_cookie(signed.cookie) is None
    token = farm.accounts.create_token(admin, "ci", user="ann", days=1)
    actor = farm.accounts.by_token(token)
    assert actor is not None
    assert actor.name == "ann"
    assert farm.accounts.by_token("etf_" + "x" * 43) is None
    farm.accounts.revoke_token(actor, farm.accounts.tokens(actor)[0].id)
    assert farm.accounts.by_token(token) is None
    # Nothing secret is in the database or its log.
    raw = Path(farm.root / "farm.db").read_bytes() + b"".join(p.read_bytes() for p in farm.root.glob("farm.db-*"))
    for secret in (token, signed.cookie, "long enough", "even longer now"):
        assert secret.encode() not in raw


def test_the_lists_stay_quick(farm: Farm) -> None:
    from sqlalchemy import insert

    from etendue.farm.models import Job

    actor = farm.accounts.local()
    package = farm.upload(actor, packed(balls_xml=BALLS), "scene.zip")
    row = {"owner_id": actor.id, "package_id": package.id, "scene": "balls.xml", "spec": {}, "state": "done"}
    with farm.database.begin() as session:
        session.execute(insert(Job), [{**row, "name": f"job {i}"} for i in range(5000)])
    started = time.process_time()
    assert farm.jobs.find(actor, limit=100).total == 5000
    # Generous, as machines are busy; bench/farm.py has the figures.
    assert time.process_time() - started < 1.0
