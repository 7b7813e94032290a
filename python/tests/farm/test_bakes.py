"""Bakes and photon maps as jobs: the files of a single machine, whatever the units."""

import subprocess
import sys
from pathlib import Path

import pytest
from sqlalchemy import select

from etendue import _etendue
from etendue.farm.accounts import Actor
from etendue.farm.models import Unit
from etendue.farm.service import Farm

from .conftest import Runner, packed

ROOM = """<scene version="3.0.0">
<sensor type="perspective"><film type="hdrfilm"><integer name="width" value="48"/><integer name="height" value="32"/></film></sensor>
<shape type="cube"><transform name="to_world"><scale value="3"/></transform><boolean name="flip_normals" value="true"/></shape>
<shape type="sphere"><point name="center" x="0.5" y="0" z="1.5"/><float name="radius" value="0.6"/></shape>
<shape type="sphere"><point name="center" x="-1" y="1.5" z="1.5"/><float name="radius" value="0.3"/>
<emitter type="area"><rgb name="radiance" value="9"/></emitter></shape>
</scene>"""


def etendue(*arguments: object) -> None:
    subprocess.run([Path(sys.executable).parent / "etendue", *map(str, arguments), "-q"], check=True, timeout=300)


def made(farm: Farm, actor: Actor, job: int) -> dict[str, bytes]:
    files = {}
    for output in farm.pictures.outputs(actor, job):
        _, data = farm.pictures.open_output(actor, job, output.name)
        with data:
            files[output.name] = data.read()
    return files


def run(farm: Farm, actor: Actor, runner: Runner, **order: object) -> int:
    package = farm.upload(actor, packed(room_xml=ROOM), "room.zip")
    job = runner.finish(farm.jobs.submit(actor, {"package": package.id, "unit_secs": 0.05, **order}))
    assert job.state == "done", job.error
    assert (job.kind, job.progress) == (order["command"], 1.0)
    with farm.database.read() as session:
        units = list(session.scalars(select(Unit).where(Unit.job_id == job.id, Unit.kind == "render")))
    assert len(units) >= 3
    # The console shows something from the start to the end.
    assert farm.pictures.preview(actor, job.id, 0).data.startswith(b"\x89PNG")
    assert farm.pictures.layers(actor, job.id, 0) == ["rgb"]
    return job.id


@pytest.mark.parametrize("method", ["path", "particles"])
def test_a_bake_has_the_bytes_of_etendue_bake(farm: Farm, actor: Actor, runner: Runner, tmp_path: Path, method: str) -> None:
    bake = {"method": method, "resolution": 96, "exr": True, "directional": True, "probes": (2, 1, 2), "display": "lightmap"}
    spp = 96 if method == "path" else 64
    job = run(farm, actor, runner, command="bake", bake=bake, settings={"spp": spp, "photons": 20_000})
    (tmp_path / "room.xml").write_text(ROOM)
    how = ("--method", method, "--resolution", 96, "--exr", "--directional", "--probes", "2,1,2", "--display", "lightmap")
    etendue("bake", tmp_path / "room.xml", "-o", tmp_path / "room.glb", "--spp", spp, "--photons", 20_000, *how)
    files = made(farm, actor, job)
    assert set(files) == {"room.glb", "room.0.exr", "room.probes.json"}
    for name, data in files.items():
        assert data == (tmp_path / name).read_bytes(), name


@pytest.mark.parametrize("memory", [1024, 1])
def test_a_photon_map_has_the_bytes_of_etendue_photons(farm: Farm, actor: Actor, runner: Runner, tmp_path: Path, memory: int) -> None:
    settings = {"photons": 500_000, "seed": 7, "max_depth": 6, "photon_memory": memory}
    job = run(farm, actor, runner, command="photons", settings=settings)
    (tmp_path / "room.xml").write_text(ROOM)
    how = ("--photons", 500_000, "--seed", 7, "--max-depth", 6, "--photon-memory", memory)
    etendue("photons", "trace", tmp_path / "room.xml", "-o", tmp_path / "room.photons", *how)
    files = made(farm, actor, job)
    assert files == {"room.photons": (tmp_path / "room.photons").read_bytes()}
    # With a budget of 1 MiB the map is a thinned one.
    assert (len(files["room.photons"]) < 2_000_000) == (memory == 1)


def test_parts_of_bakes_do_not_mix(tmp_path: Path) -> None:
    (tmp_path / "room.xml").write_text(ROOM)
    scene = _etendue.load(tmp_path / "room.xml", [], {}, None, None, None, None, None)
    bake = scene.prepare_bake({"spp": 2}, 1, {"resolution": 64})
    half = bake.width // 2
    first, second = (bake.render(rect, 0, 2) for rect in ((0, 0, half, 1), (half, 0, bake.width, 1)))
    assert first is not None
    assert second is not None
    assert _etendue.part_info(_etendue.part_merge([second, first], 64))["held"] == [(0, 0, bake.width, 1, 0, 2)]
    other = scene.prepare_bake({"spp": 2, "seed": 1}, 1, {"resolution": 64}).render((half, 0, bake.width, 1), 0, 2)
    assert other is not None
    with pytest.raises(Exception, match="different scenes, settings"):
        _etendue.part_merge([first, other], 64)
    with pytest.raises(Exception, match="points are missing"):
        _etendue.part_merge([first, first], 64)
    with pytest.raises(Exception, match="lacks points"):
        bake.finish(first, tmp_path / "a.glb", display="unlit", probes=None, maps=False, directional=False, denoise=False)
    with pytest.raises(Exception, match="damaged"):
        _etendue.part_merge([first[:-1], second], 64)
    assert not (tmp_path / "a.glb").exists()
    for rect, begin in (((0, 0, 0, 1), 0), ((0, 0, bake.width + 1, 1), 0), ((0, 0, 1, 1), 1)):
        with pytest.raises(Exception, match="a part of this bake"):
            bake.render(rect, begin, 2)
