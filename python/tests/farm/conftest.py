"""Small scenes and farms whose workers are threads of the test."""

import hashlib
import io
import time
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytest.importorskip("sqlalchemy", reason="the farm's packages are not installed: pip install 'etendue[farm]'")

import etendue
from etendue import _etendue
from etendue.farm.accounts import Actor
from etendue.farm.backend import LocalBackend
from etendue.farm.config import FarmConfig, Limits
from etendue.farm.scheduler import Scheduler
from etendue.farm.service import Farm
from etendue.farm.views import JobDetail

BALLS = """<scene version="3.0.0">
<sensor type="perspective"><film type="hdrfilm"><integer name="width" value="96"/><integer name="height" value="64"/></film></sensor>
<emitter type="constant"/>
<shape type="sphere"><point name="center" x="0" y="0" z="4"/></shape>
<shape type="sphere"><point name="center" x="1" y="0" z="3"/></shape>
</scene>"""

SPIN = """camera { location <0, 1, -5> look_at 0 } light_source { <5, 9, -9> rgb 1 }
sphere { <clock, 0, 0>, 1 pigment { rgb <1, frame_number / 10, 0.2> } } plane { y, -1 pigment { checker rgb 1 rgb 0.2 } }
"""


def packed(**files: str | bytes) -> io.BytesIO:
    """Return a zip of files; `__` in a name stands for a slash and the last `_` for the dot."""
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        for name, content in files.items():
            archive.writestr(".".join(name.replace("__", "/").rsplit("_", 1)), content)
    data.seek(0)
    return data


def digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


@pytest.fixture
def farm(tmp_path: Path) -> Iterator[Farm]:
    """A farm with short units."""
    made = Farm.open(tmp_path / "farm", FarmConfig(unit_secs=(0.02, 0.05), limits=Limits(check_secs=120), private_webhooks=True))
    yield made
    made.close()


@pytest.fixture
def actor(farm: Farm) -> Actor:
    return farm.accounts.local()


class Runner:
    """Drives a scheduler by hand."""

    def __init__(self, farm: Farm, cache: Path, nodes: tuple[str, ...] = ("a", "b")) -> None:
        self.farm, self.cache = farm, cache
        self.backend = LocalBackend(farm.store, nodes, cores=1)
        self.scheduler = Scheduler(farm, self.backend, cache=str(cache))

    def until(self, check: Callable[[], bool], secs: float = 120.0) -> None:
        """Run until something holds."""
        end = time.monotonic() + secs
        while not check():
            assert time.monotonic() < end, "the farm takes too long"
            self.scheduler.step(0.02)

    def finish(self, job: JobDetail, *states: str) -> JobDetail:
        """Run until a job ends."""
        actor = self.farm.accounts.local()
        wanted = states or ("done", "failed", "cancelled")
        self.until(lambda: self.farm.jobs.get(actor, job.id).state in wanted)
        return self.farm.jobs.get(actor, job.id)


@pytest.fixture
def runner(farm: Farm, tmp_path: Path) -> Iterator[Runner]:
    made = Runner(farm, tmp_path / "cache")
    yield made
    made.scheduler.close()


def single_machine(folder: Path, scene: str, name: str, *, spp: int | None, clock: float = 0.0, number: int = 0, final: int = 0) -> bytes:
    """Return the EXR file that `etendue render` writes, by way of one film of the whole picture."""
    path = folder / name
    path.write_text(scene)
    read = _etendue.load(path, [], {}, None, None, None, clock, (number, final, (None, None)))
    parts = read.prepare({"spp": spp}, None, 1, [], True)
    film = parts.render(parts.crop, 0, parts.spp)
    assert film is not None
    target = folder / "single.exr"
    _etendue.film_picture([film], target, "standard", 0.0, False, False)
    return target.read_bytes()


__all__ = ["BALLS", "SPIN", "Runner", "digest", "etendue", "packed", "single_machine"]
