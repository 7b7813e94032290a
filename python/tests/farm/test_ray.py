"""A Ray cluster of several simulated nodes on this machine: processes and nodes that are killed."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

os.environ.setdefault("RAY_raylet_start_wait_time_s", "180")
pytest.importorskip("ray", reason="Ray is not installed: pip install 'etendue[farm]'")

from sqlalchemy import select

from etendue.farm import runner as running
from etendue.farm.config import FarmConfig
from etendue.farm.models import Unit
from etendue.farm.service import Farm

from .conftest import BALLS, digest, packed, single_machine

# Ray's own processes and sockets are not closed when the interpreter looks.
pytestmark = [pytest.mark.filterwarnings("ignore::ResourceWarning"), pytest.mark.filterwarnings("ignore::DeprecationWarning")]
pytestmark += [
    pytest.mark.filterwarnings("ignore::FutureWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]


@pytest.fixture
def cluster() -> Iterator[object]:
    import ray
    from ray.cluster_utils import Cluster

    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
    yield made
    if ray.is_initialized():
        ray.shutdown()
    made.shutdown()


def wait(check: Callable[[], bool], secs: float = 240.0) -> None:
    end = time.monotonic() + secs
    while not check():
        assert time.monotonic() < end, "the farm takes too long"
        time.sleep(0.05)


def test_killed_processes_and_nodes_cost_only_their_units(cluster: object, tmp_path: Path) -> None:
    import psutil

    farm = Farm.open(tmp_path / "farm", FarmConfig(unit_secs=(0.3, 1.0)))
    actor = farm.accounts.local()
    nodes = [cluster.add_node(num_cpus=1) for _ in range(2)]  # type: ignore[attr-defined]
    package = farm.upload(actor, packed(balls_xml=BALLS), "scene.zip")
    job = farm.jobs.submit(actor, {"package": package.id, "settings": {"spp": 256}, "unit_secs": 0.5})
    backend = running.ray_backend(farm, cluster.address)  # type: ignore[attr-defined]

    def done() -> int:
        return farm.jobs.get(actor, job.id).units_done

    with running.running(farm, backend, cache=str(tmp_path / "cache")):
        wait(lambda: done() >= 2)
        assert len(farm.nodes(actor, alive=True)) == 2
        workers = [p for p in psutil.process_iter(["cmdline"]) if "RayWorker" in " ".join(p.info["cmdline"] or [])]
        mine = [p for p in workers if any(part.pid == os.getpid() for part in p.parents())]
        if mine:
            mine[0].send_signal(signal.SIGKILL)
        wait(lambda: done() >= 4)
        cluster.remove_node(nodes[1], allow_graceful=False)  # type: ignore[attr-defined]
        wait(lambda: farm.jobs.get(actor, job.id).state in ("done", "failed"))
    found = farm.jobs.get(actor, job.id)
    assert found.state == "done", found.error
    with farm.database.read() as session:
        units = list(session.scalars(select(Unit)))
    assert all(unit.attempts == 1 for unit in units)
    assert mine, "the test has found no worker to kill"
    assert sum(unit.losses for unit in units) <= 3
    _, data = farm.pictures.open_output(actor, job.id, "balls.exr")
    with data:
        assert digest(data.read()) == digest(single_machine(tmp_path, BALLS, "balls.xml", spp=256))
    farm.close()


def test_submit_without_a_farm_starts_one_and_stops_it(tmp_path: Path) -> None:
    scene = tmp_path / "balls.xml"
    scene.write_text(BALLS)
    etendue = Path(sys.executable).parent / "etendue"
    out = tmp_path / "out.exr"
    flags = ["--spp", "4", "-o", out, "--wait", "--cores", "1", "--farm", tmp_path / "farm"]
    result = subprocess.run([etendue, "farm", "submit", scene, *flags], capture_output=True, text=True, timeout=400, check=False)
    assert result.returncode == 0, result.stderr
    assert "no farm is running" in result.stderr
    assert digest(out.read_bytes()) == digest(single_machine(tmp_path, BALLS, "balls.xml", spp=4))
    farm = Farm.open(tmp_path / "farm")
    assert not farm.status(farm.accounts.local()).is_up
    farm.close()


def test_up_that_is_killed_goes_on(tmp_path: Path) -> None:
    farm = Farm.open(tmp_path / "farm", FarmConfig())
    (tmp_path / "farm" / "farm.json").write_text('{"unit_secs": [0.3, 1.0]}')
    actor = farm.accounts.local()
    package = farm.upload(actor, packed(balls_xml=BALLS), "scene.zip")
    job = farm.jobs.submit(actor, {"package": package.id, "settings": {"spp": 256}, "unit_secs": 0.5})
    command = [sys.executable, "-m", "etendue", "farm", "up", "--cores", "1", "--farm", tmp_path / "farm"]
    log = tmp_path / "up.log"
    for attempt in range(2):
        process = subprocess.Popen(command, stdout=log.open("ab"), stderr=subprocess.STDOUT, start_new_session=True)
        try:
            if attempt == 0:
                wait(lambda: farm.jobs.get(actor, job.id).units_done >= 3)
            else:
                wait(lambda: farm.jobs.get(actor, job.id).state in ("done", "failed"))
                process.send_signal(signal.SIGTERM)
                process.wait(120)
        finally:
            # With all that it has started.
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait(60)
    found = farm.jobs.get(actor, job.id)
    assert found.state == "done", found.error
    with farm.database.read() as session:
        units = list(session.scalars(select(Unit)))
    # One unit was in work when it was killed.
    assert sum(unit.attempts - 1 for unit in units) <= 1
    _, data = farm.pictures.open_output(actor, job.id, "balls.exr")
    with data:
        assert digest(data.read()) == digest(single_machine(tmp_path, BALLS, "balls.xml", spp=256))
    farm.close()


def test_a_store_that_a_node_does_not_see_goes_through_the_head(tmp_path: Path) -> None:
    from etendue.farm.ray_backend import PROBE_NAME, RelayFiles, StoreServer
    from etendue.farm.store import Store

    class Here:
        """An actor that is not one."""

        def __init__(self, server: StoreServer) -> None:
            self.read, self.write = self.Call(server.read), self.Call(server.write)

        class Call:
            def __init__(self, run: Callable[..., object]) -> None:
                self.remote = run

    import ray

    get, ray.get = ray.get, lambda value: value
    try:
        store = Store(f"file://{tmp_path}")
        files = RelayFiles(Here(StoreServer(store.url, {})))
        files.write(f"{PROBE_NAME}/a", b"1")
        assert store.read(f"{PROBE_NAME}/a") == files.read(f"{PROBE_NAME}/a") == b"1"
        files.fetch(f"{PROBE_NAME}/a", tmp_path / "copy")
        assert (tmp_path / "copy").read_bytes() == b"1"
    finally:
        ray.get = get
