"""Jobs from the order to the picture, on workers that are threads."""

import base64
import http.server
import json
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import func, select, update

from etendue import _etendue
from etendue.farm.accounts import Actor
from etendue.farm.errors import ConflictError, InvalidError, NotFoundError
from etendue.farm.jobs import JobFilter
from etendue.farm.models import Job, Unit
from etendue.farm.preview import Previews
from etendue.farm.scheduler import Scheduler
from etendue.farm.service import Farm
from etendue.farm.states import JobState, UnitState

from .conftest import BALLS, SPIN, Runner, digest, packed, single_machine

ROOT = Path(__file__).parent.parent.parent.parent


def submit(farm: Farm, actor: Actor, scene: str = BALLS, file: str = "balls_xml", **order: object) -> int:
    package = farm.upload(actor, packed(**{file: scene}), "scene.zip")
    return farm.jobs.submit(actor, {"package": package.id, "settings": {"spp": 8}, **order}).id


def picture(farm: Farm, actor: Actor, job: int, name: str) -> bytes:
    _, data = farm.pictures.open_output(actor, job, name)
    with data:
        return data.read()


def test_a_still_has_the_bytes_of_etendue_render(farm: Farm, actor: Actor, runner: Runner, tmp_path: Path) -> None:
    job = runner.finish(farm.jobs.get(actor, submit(farm, actor, unit_secs=0.05, settings={"spp": 24}, formats=["exr", "png"])))
    assert job.state == "done", job.error
    assert job.units_done == job.units_total >= 3
    scene = tmp_path / "balls.xml"
    scene.write_text(BALLS)
    command = [Path(sys.executable).parent / "etendue", "render", scene, "--spp", "24", "-q", "-o", tmp_path / "one.exr"]
    subprocess.run(command, check=True, timeout=300)
    assert picture(farm, actor, job.id, "balls.exr") == (tmp_path / "one.exr").read_bytes()
    frame = farm.jobs.frames(actor, job.id).items[0]
    assert frame.spp_done == 24
    assert {o.format: o.sha256 for o in frame.outputs}["exr"] == digest((tmp_path / "one.exr").read_bytes())
    # Only the whole film is left of all that were merged.
    assert [n for n in farm.store.names(f"jobs/{job.id}/films") if not n.endswith("total-0.film")] == []
    assert farm.pictures.preview(actor, job.id, 0).data.startswith(b"\x89PNG")
    assert farm.pictures.develop(actor, job.id, 0, exposure=1.0, size=40).data.startswith(b"\x89PNG")
    assert "rgb" in farm.pictures.layers(actor, job.id, 0)


def moving_gltf() -> str:
    """A triangle that moves to the right within two seconds, before a camera."""
    numbers = [0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 2, 0, 0, 0, 1, 0, 0]
    data = base64.b64encode(struct.pack("<17f", *numbers)).decode()
    views = [{"buffer": 0, "byteOffset": at, "byteLength": size} for at, size in ((0, 36), (36, 8), (44, 24))]
    kinds = (("VEC3", 3), ("SCALAR", 2), ("VEC3", 2))
    accessors = [{"bufferView": i, "componentType": 5126, "type": kind, "count": n} for i, (kind, n) in enumerate(kinds)]
    channel = {"sampler": 0, "target": {"node": 0, "path": "translation"}}
    return json.dumps(
        {
            "asset": {"version": "2.0"},
            "scenes": [{"nodes": [0, 1]}],
            "nodes": [{"mesh": 0}, {"camera": 0, "translation": [0.5, 0.5, 3]}],
            "cameras": [{"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
            "animations": [{"name": "go", "samplers": [{"input": 1, "output": 2}], "channels": [channel]}],
            "accessors": accessors,
            "bufferViews": views,
            "buffers": [{"byteLength": 68, "uri": f"data:application/octet-stream;base64,{data}"}],
        }
    )


def test_frames_of_a_gltf_animation(farm: Farm, actor: Actor, runner: Runner, tmp_path: Path) -> None:
    file = tmp_path / "moving.gltf"
    file.write_text(moving_gltf())
    package = farm.upload(actor, packed(moving_gltf=file.read_bytes()), "moving.zip")
    order = {
        "package": package.id,
        "settings": {"integrator": "normals", "spp": 2, "width": 32, "height": 24},
        "frames": "1,3",
        "last_frame": 5,
        "clocks": (0, 2),
    }
    job = runner.finish(farm.jobs.submit(actor, {**order, "gltf_animation": "go"}))
    assert job.state == "done", job.error
    made = [picture(farm, actor, job.id, f"moving.{number:04}.exr") for number in (1, 3)]
    for data, clock in zip(made, ("0", "1"), strict=True):
        flags = [
            "--clock",
            clock,
            "--gltf-animation",
            "go",
            "--integrator",
            "normals",
            "--spp",
            "2",
            "--width",
            "32",
            "--height",
            "24",
            "-q",
        ]
        command = [Path(sys.executable).parent / "etendue", "render", file, *flags, "-o", tmp_path / "one.exr"]
        subprocess.run(command, check=True, timeout=300)
        assert data == (tmp_path / "one.exr").read_bytes()
    assert made[0] != made[1]
    bad = runner.finish(farm.jobs.submit(actor, {**order, "gltf_animation": "fly"}))
    assert "no animation `fly`" in (bad.error or "")


def test_an_animation_has_the_frames_of_a_single_machine(farm: Farm, actor: Actor, runner: Runner, tmp_path: Path) -> None:
    order = {"frames": "1-4", "settings": {"width": 48, "height": 32}, "name": "spin"}
    job = runner.finish(farm.jobs.get(actor, submit(farm, actor, SPIN, "spin_pov", **order)))
    assert (job.state, job.frames_done) == ("done", 4), job.error
    (tmp_path / "one").mkdir()
    for frame in farm.jobs.frames(actor, job.id).items:
        assert frame.clock == pytest.approx((frame.number - 1) / 3)
        path = tmp_path / "one" / "spin.pov"
        path.write_text(SPIN)
        out = tmp_path / "one" / f"{frame.number}.exr"
        flags = ["--clock", str(frame.clock), "--frame", str(frame.number), "--frames", "4", "--width", "48", "--height", "32"]
        command = [Path(sys.executable).parent / "etendue", "render", path, *flags, "-q", "-o", out]
        subprocess.run(command, check=True, timeout=300)
        assert picture(farm, actor, job.id, f"spin.{frame.number:04d}.exr") == out.read_bytes()


def test_a_lost_worker_and_a_lost_node_cost_only_their_units(farm: Farm, actor: Actor, runner: Runner, tmp_path: Path) -> None:
    job_id = submit(farm, actor, unit_secs=0.05, settings={"spp": 48})
    units = select(func.count()).select_from(Unit).where(Unit.kind == "render", Unit.state == UnitState.DONE.value)

    def done() -> int:
        with farm.database.read() as session:
            return session.scalar(units) or 0

    runner.until(lambda: done() >= 1)
    runner.until(lambda: bool(runner.backend._busy))
    runner.backend.lose_worker(next(iter(runner.backend._busy)))
    runner.until(lambda: done() >= 2)
    runner.backend.lose_node("b")
    job = runner.finish(farm.jobs.get(actor, job_id))
    assert job.state == "done", job.error
    with farm.database.read() as session:
        rows = list(session.scalars(select(Unit)))
    # Every unit was begun once more than it was lost, and not again.
    assert all(unit.attempts == 1 for unit in rows)
    assert 1 <= sum(unit.losses for unit in rows) <= 2
    assert digest(picture(farm, actor, job_id, "balls.exr")) == digest(single_machine(tmp_path, BALLS, "balls.xml", spp=48))


def test_a_scheduler_that_is_killed_loses_no_finished_unit(farm: Farm, actor: Actor, tmp_path: Path) -> None:
    first = Runner(farm, tmp_path / "cache")
    job_id = submit(farm, actor, unit_secs=0.05, settings={"spp": 48})
    count = select(func.count()).select_from(Unit).where(Unit.kind == "render", Unit.state == UnitState.DONE.value)

    def done() -> int:
        with farm.database.read() as session:
            return session.scalar(count) or 0

    first.until(lambda: done() >= 2)
    # As if the process was killed: nothing is given back, and results that come later are lost with it.
    first.scheduler._endings.close()
    with farm.database.begin() as session:
        session.execute(update(Unit).where(Unit.state == "running").values(attempts=7))
    before = done()
    first.backend.close()
    from etendue.farm import charge as module

    original, module._may_run = module._may_run, lambda _: False  # type: ignore[assignment]
    try:
        second = Runner(farm, tmp_path / "cache", ("c",))
    finally:
        module._may_run = original  # type: ignore[assignment]
    assert done() >= before
    job = second.finish(farm.jobs.get(actor, job_id))
    second.scheduler.close()
    assert job.state == "done", job.error
    with farm.database.read() as session:
        assert all(unit.attempts in (1, 7, 8) for unit in session.scalars(select(Unit)))
    assert digest(picture(farm, actor, job_id, "balls.exr")) == digest(single_machine(tmp_path, BALLS, "balls.xml", spp=48))


def test_a_second_scheduler_is_refused(farm: Farm, runner: Runner) -> None:
    with pytest.raises(ConflictError, match="at work already"):
        Scheduler(farm, runner.backend)


def test_cancel_pause_resume_and_retry(farm: Farm, actor: Actor, runner: Runner) -> None:
    job_id = submit(farm, actor, unit_secs=0.05, settings={"spp": 64})
    runner.until(lambda: farm.jobs.get(actor, job_id).units_done >= 2)
    assert farm.jobs.pause(actor, job_id).state == "paused"
    runner.until(lambda: not runner.backend._busy)
    stopped = farm.jobs.get(actor, job_id).units_done
    for _ in range(5):
        runner.scheduler.step(0.02)
    assert farm.jobs.get(actor, job_id).units_done <= stopped + 2
    farm.jobs.resume(actor, job_id)
    farm.jobs.cancel(actor, job_id)
    with pytest.raises(ConflictError):
        farm.jobs.pause(actor, job_id)
    runner.until(lambda: not runner.backend._busy)
    assert {u.state for u in farm.jobs.units(actor, job_id).items} <= {"done", "cancelled"}
    job = farm.jobs.retry(actor, job_id)
    assert job.state in ("queued", "running")
    assert runner.finish(job).state == "done"
    farm.jobs.delete(actor, job_id)
    assert farm.store.names(f"jobs/{job_id}") == []
    with pytest.raises(NotFoundError):
        farm.jobs.get(actor, job_id)


def test_bad_scenes_and_settings_fail_once_with_their_sentence(farm: Farm, actor: Actor, runner: Runner) -> None:
    bad = submit(farm, actor, settings={"spp": 4, "integrator": "paint"})
    worse = submit(farm, actor, crop=(0, 0, 5000, 5000))
    for job_id, text in ((bad, "paint"), (worse, "crop")):
        job = runner.finish(farm.jobs.get(actor, job_id))
        assert job.state == "failed"
        assert text in (job.error or "")
        assert [u.attempts for u in farm.jobs.units(actor, job_id).items] == [1]
        assert "error" in {e.level for e in farm.jobs.log(actor, job=job_id).items}


def test_a_unit_that_fails_is_tried_again_and_then_fails_its_frame(
    farm: Farm, actor: Actor, runner: Runner, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(self: object, order: object) -> None:
        raise OSError("no room on the disk")

    from etendue.farm.worker import Worker

    with monkeypatch.context() as patch:
        patch.setattr(Worker, "_render", broken)
        job = runner.finish(farm.jobs.get(actor, submit(farm, actor, max_attempts=2)))
    assert job.state == "failed"
    assert "no room on the disk" in (job.error or "")
    failed = [u for u in farm.jobs.units(actor, job.id).items if u.state == "failed"]
    assert failed
    assert failed[0].attempts == 2
    # Once the disk has room again:
    job = farm.jobs.retry(actor, job.id)
    assert runner.finish(job).state == "done"


def test_noise_stops_in_rounds_with_the_picture_of_so_many_samples(farm: Farm, actor: Actor, runner: Runner, tmp_path: Path) -> None:
    job = runner.finish(farm.jobs.get(actor, submit(farm, actor, settings={}, stop={"noise": 0.04})))
    assert job.state == "done", job.error
    frame = farm.jobs.frames(actor, job.id).items[0]
    assert frame.spp_done % 16 == 0
    assert frame.relative_error is not None
    assert frame.relative_error <= 0.04
    # The default sampler does not know how many samples there will be.
    expected = single_machine(tmp_path, BALLS, "balls.xml", spp=frame.spp_done)
    assert digest(picture(farm, actor, job.id, "balls.exr")) == digest(expected)


def test_every_second_frame_first_and_the_rest_after_approval(farm: Farm, actor: Actor, runner: Runner) -> None:
    order = {"frames": "1-4", "every_first": 2, "approval": True, "settings": {"width": 32, "height": 24}}
    job = runner.finish(farm.jobs.get(actor, submit(farm, actor, SPIN, "spin_pov", **order)), "approval")
    states = {f.number: f.state for f in farm.jobs.frames(actor, job.id).items}
    assert states == {1: "done", 2: "held", 3: "done", 4: "held"}
    assert runner.finish(farm.jobs.approve(actor, job.id)).state == "done"


def test_jobs_wait_for_what_they_need_and_tell_others(farm: Farm, actor: Actor, runner: Runner) -> None:
    heard: list[dict[str, object]] = []

    class Listener(http.server.BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            heard.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(204)
            self.end_headers()

        def log_message(self, *_: object) -> None:
            pass

    server = http.server.HTTPServer(("127.0.0.1", 0), Listener)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    first = submit(farm, actor, settings={"spp": 1}, priority=-5)
    second = submit(farm, actor, settings={"spp": 1}, needs=[first], priority=50, notify=f"http://127.0.0.1:{server.server_port}/done")
    assert farm.jobs.get(actor, second).state == "waiting"
    done = runner.finish(farm.jobs.get(actor, second))
    assert done.state == "done"
    runner.until(lambda: bool(heard))
    server.shutdown()
    server.server_close()
    assert (heard[0]["id"], heard[0]["state"]) == (second, "done")
    third = submit(farm, actor)
    farm.jobs.cancel(actor, third)
    with pytest.raises(ConflictError, match="would never begin"):
        submit(farm, actor, needs=[third])


def test_orders_are_checked_as_a_whole(farm: Farm, actor: Actor) -> None:
    package = farm.upload(actor, packed(balls_xml=BALLS), "scene.zip")
    with pytest.raises(InvalidError) as caught:
        farm.jobs.submit(actor, {"package": package.id, "settings": {"sp": 3}, "frames": "3-1", "priority": 1000, "notify": "file:///etc"})
    assert all(word in str(caught.value) for word in ("sp", "3-1", "priority", "notify"))
    for bad in (
        {"command": "bake", "frames": "1-3"},
        {"command": "bake", "formats": ["exr"]},
        {"command": "bake", "stop": {"noise": 0.1}},
        {"command": "photons", "crop": (0, 0, 4, 4)},
        {"command": "photons", "settings": {"photons": 1 << 40}},
        {"bake": {"resolution": 64}},
        {"formats": ["glb"]},
        {"frames": "1-999999999"},
        {"name": "a\x00b"},
        {"scene": "../../etc/passwd"},
        {"settings": {"width": 1 << 19, "height": 1 << 19}},
        {"approval": True},
        {"needs": [99]},
    ):
        with pytest.raises((InvalidError, NotFoundError)):
            farm.jobs.submit(actor, {"package": package.id, **bad})
    assert farm.jobs.find(actor).total == 0


def test_filters_are_words_and_not_sql(farm: Farm, actor: Actor) -> None:
    submit(farm, actor, name="100%_done'; drop table jobs; --")
    submit(farm, actor, name="other")
    for text, count in (("100%_", 1), ("%", 1), ("_", 1), ("'; drop", 1), ("OTHER", 1), ("' or 1=1 --", 0)):
        assert farm.jobs.find(actor, JobFilter(text=text)).total == count, text
    assert farm.jobs.find(actor, JobFilter(states=[JobState.QUEUED], order="name"), limit=1).items[0].name.startswith("100")
    with pytest.raises(InvalidError):
        farm.jobs.find(actor, JobFilter(order="name; drop table jobs"))
    with farm.database.read() as session:
        assert session.scalar(select(func.count()).select_from(Job)) == 2


def test_films_merge_to_the_whole_one() -> None:
    # What the scheduler rests on: parts of any kind are the bits of the whole.
    path = ROOT / "scenes"
    assert path.is_dir()
    with pytest.raises(Exception, match="no parts"):
        _etendue.part_merge([], 64)


def test_a_study_has_the_picture_of_each_run(farm: Farm, actor: Actor, runner: Runner, tmp_path: Path) -> None:
    runs = [{"integrator": "normals", "spp": 2}, {"integrator": "path", "spp": 3}, {"integrator": "path", "spp": 5, "width": 48}]
    job = runner.finish(farm.jobs.get(actor, submit(farm, actor, command="study", runs=runs, name="methods")))
    assert (job.state, job.kind, job.frames_done) == ("done", "study", 3), job.error
    scene = tmp_path / "balls.xml"
    scene.write_text(BALLS)
    frames = farm.jobs.frames(actor, job.id).items
    for frame, run in zip(frames, runs, strict=True):
        assert frame.spp_done == run["spp"]
        out = tmp_path / f"{frame.number}.exr"
        flags = [text for key, value in run.items() for text in (f"--{key}", str(value))]
        command = [Path(sys.executable).parent / "etendue", "render", scene, *flags, "-q", "-o", out]
        subprocess.run(command, check=True, timeout=300)
        assert picture(farm, actor, job.id, f"methods.{frame.number:04d}.exr") == out.read_bytes()
    for wrong in ({"runs": runs}, {"command": "study"}, {"command": "study", "runs": runs, "frames": "1-3"}):
        with pytest.raises(InvalidError):
            farm.jobs.submit(actor, {"package": job.package_id, **wrong})
    with pytest.raises(InvalidError, match="spp"):
        farm.jobs.submit(actor, {"package": job.package_id, "command": "study", "runs": [{"spp": 10**9}]})


def test_the_probe_is_seen_where_no_unit_is_done() -> None:
    previews = Previews()
    previews.begin(1, np.full((4, 8, 3), 0.25, np.float16))
    previews.add(1, (0, 0, 64, 32), (0, 0, 4, np.full((8, 4, 3), 1.0, np.float16)), 2)
    seen = previews.pixels(1)
    assert seen.shape == (8, 16, 3)
    assert (seen[:, :4] == 1.0).all()
    assert (seen[:, 4:] == 0.25).all()
    previews.drop(1)
    previews.add(1, (0, 0, 64, 32), (0, 0, 4, np.full((8, 4, 3), 1.0, np.float16)), 2)
    assert (previews.pixels(1)[:, 4:] == 0).all()


def test_a_hundred_thousand_frames_are_taken_at_once(farm: Farm, actor: Actor) -> None:
    package = farm.upload(actor, packed(spin_pov=SPIN), "spin.zip")
    started = time.process_time()
    order = {"package": package.id, "frames": "1-100000", "every_first": 10, "approval": True, "clocks": [0, 3]}
    job = farm.jobs.submit(actor, order)
    # Of the processor: what else the machine does is no fault of ours. About 0.4 s.
    assert time.process_time() - started < 1.5
    assert job.frames_total == 100_000
    last = farm.jobs.frames(actor, job.id, offset=99_999).items[0]
    assert (last.number, last.clock, last.state) == (100_000, 3.0, "held")
    assert farm.jobs.frames(actor, job.id, limit=1).items[0].state == "queued"
