"""Measurements of the farm: what a unit costs the head, long queues, the overhead, and the trial of 48 frames on 4 nodes.

    python bench/farm.py costs       for the simulation: head per unit, merging, sizes of films
    python bench/farm.py queue       submit, list and cancel with 100,000 units
    python bench/farm.py overhead    wall time against the sum of the units on 2 workers
    python bench/farm.py trial       48 frames, 4 nodes of a Ray cluster, one process and one node killed, the service restarted

Each prints JSON with the machine. `--farm FOLDER` keeps the farm for a look; otherwise it is deleted.
"""

import argparse
import hashlib
import io
import json
import os
import platform
import shutil
import signal
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("RAY_raylet_start_wait_time_s", "180")

import ray
from sqlalchemy import func, insert, select

import etendue
from etendue import _etendue
from etendue.farm import runner
from etendue.farm.backend import Ended, NodeInfo
from etendue.farm.config import FarmConfig
from etendue.farm.models import Event, Frame, Job, Unit
from etendue.farm.orders import Done, Finished, FinishOrder, Merged, MergeOrder, Probed, ProbeOrder, Rendered
from etendue.farm.scheduler import Scheduler
from etendue.farm.service import Farm

SCENE = """camera {{ location <0, 1.5, -6> look_at <0, 0.4, 0> }}
light_source {{ <5, 9, -9> rgb 1 area_light <2, 0, 0>, <0, 2, 0>, 4, 4 adaptive 0 }}
plane {{ y, -1 pigment {{ checker rgb 1 rgb 0.2 }} finish {{ reflection 0.2 }} }}
#declare I = 0;
#while (I < 12)
  sphere {{ <sin(I + clock * 6) * 2, -0.6 + mod(I, 3) * 0.5, cos(I + clock * 6) * 2>, 0.4
    pigment {{ rgb <mod(I, 4) / 3, 0.5, mod(I, 5) / 4> }} finish {{ reflection 0.3 }} }}
  #declare I = I + 1;
#end
""".replace("{{", "{").replace("}}", "}")


def machine():
    model = next((line.split(":")[1].strip() for line in Path("/proc/cpuinfo").read_text().splitlines() if "model name" in line), "")
    return {"cores": os.cpu_count(), "model": model, "system": platform.platform(), "load": os.getloadavg()[0]}


class Timer:
    def __enter__(self):
        self.wall, self.cpu = time.perf_counter(), time.process_time()
        return self

    def __exit__(self, *_):
        self.wall, self.cpu = time.perf_counter() - self.wall, time.process_time() - self.cpu

    def result(self):
        return {"wall_secs": round(self.wall, 4), "cpu_secs": round(self.cpu, 4)}


class Instant:
    """A backend whose tasks end at once: what is left is the head's own time."""

    def __init__(self, workers):
        self.count, self.ended = workers, []

    def nodes(self):
        return [NodeInfo(f"n{i}", f"n{i}", "127.0.0.1", 1) for i in range(self.count)]

    def start(self, node, setup):
        return f"w-{node.id}"

    def submit(self, worker, order):
        if isinstance(order, ProbeOrder):
            result = Probed(1920, 1080, (0, 0, 1920, 1080), 64, False, False, 3e-6, 1.0)
        elif isinstance(order, MergeOrder):
            result = Merged(1000)
        elif isinstance(order, FinishOrder):
            result = Finished(1000, 64, 0.01, True, ())
        else:
            result = Rendered(1000, 1, None)
        self.ended.append(Ended(worker, order.key, Done(order.key, result, 1.0, 1.0)))

    def poll(self, secs):
        ended, self.ended = self.ended, []
        return ended

    def cancel(self, worker, key):
        pass

    def stop(self, worker):
        pass

    def stats(self, worker):
        return None

    def want(self, cores):
        pass

    def close(self):
        pass


def upload(farm, actor, scene=SCENE):
    return farm.upload(actor, io.BytesIO(scene.encode()), "spin.pov")


def costs(farm_folder, args):
    farm = Farm.open(farm_folder, FarmConfig(unit_secs=(1.0, 1.0)))
    actor = farm.accounts.local()
    job = farm.jobs.submit(actor, {"package": upload(farm, actor).id, "frames": f"1-{args.frames}"})
    scheduler = Scheduler(farm, Instant(args.workers))
    with Timer() as timer:
        while farm.jobs.get(actor, job.id).state != "done":
            scheduler.step(0.0)
    units = farm.jobs.get(actor, job.id).units_done
    scheduler.close()
    # Films of a real picture: bytes, and time to merge them.
    path = farm_folder / "room.xml"
    # Two balls that fill the picture and shadow each other: noise in every pixel.
    balls = "".join(f'<shape type="sphere"><point name="center" x="{x}" y="0" z="3"/></shape>' for x in (-0.6, 0.6))
    view = '<sensor type="perspective"><float name="fov" value="15"/></sensor><emitter type="constant"/>'
    path.write_text(f'<scene version="3.0.0">{view}{balls}</scene>')
    scene = _etendue.load(path, [], {}, None, None, None, None, (0, 0, (None, None)))
    parts = scene.prepare({"width": 960, "height": 540, "spp": 64, "integrator": "path"}, None, 1, [], True)
    tiles = [(x, y, x + 240, y + 135) for y in range(0, 540, 135) for x in range(0, 960, 240)][:8]
    films = [parts.render(tile, 0, 4) for tile in tiles]
    with Timer() as merging:
        merged = _etendue.part_merge(films, 64)
    return {
        "units": units,
        "head_secs_per_unit": timer.cpu / units,
        "head_wall_secs_per_unit": timer.wall / units,
        "film_bytes_per_pixel": sum(map(len, films)) / (8 * 240 * 135),
        # Reading and writing, as the simulation counts it.
        "merge_bytes_per_sec": (sum(map(len, films)) + len(merged)) / merging.cpu,
    }


def queue(farm_folder, args):
    farm = Farm.open(farm_folder)
    actor = farm.accounts.local()
    package = upload(farm, actor)
    found = {}
    with Timer() as timer:
        job = farm.jobs.submit(actor, {"package": package.id, "frames": "1-1000"})
    found["submit 1,000 frames"] = timer.result()
    # Units as the scheduler makes them from the probes.
    with farm.database.begin() as session:
        ids = list(session.scalars(select(Frame.id).where(Frame.job_id == job.id)))
        row = {"job_id": job.id, "kind": "render", "x1": 64, "y1": 64, "end": 16}
        session.execute(
            insert(Unit), [{**row, "frame_id": f, "rank": f * 1000 + i, "slot": i} for f in ids for i in range(args.units // 1000)]
        )
        session.get(Job, job.id).units_total = args.units
        rows = [
            {"owner_id": actor.id, "package_id": package.id, "scene": "spin.pov", "spec": {}, "state": "done", "name": f"old {i}"}
            for i in range(5000)
        ]
        session.execute(insert(Job), rows)
    work = {
        "submit, 100,000 frames": lambda: farm.jobs.submit(actor, {"package": package.id, "frames": "1-100000"}),
        "submit, a still": lambda: farm.jobs.submit(actor, {"package": package.id}),
        "list of 5,000 jobs": lambda: farm.jobs.find(actor),
        "status": lambda: farm.status(actor),
        "units, first page": lambda: farm.jobs.units(actor, job.id),
        "units, last page": lambda: farm.jobs.units(actor, job.id, offset=args.units - 100),
        "pause": lambda: farm.jobs.pause(actor, job.id),
        "cancel": lambda: farm.jobs.cancel(actor, job.id),
        "retry": lambda: farm.jobs.retry(actor, job.id),
    }
    for name, run in work.items():
        with Timer() as timer:
            run()
        found[name] = timer.result()
    return {"units": args.units, **found}


def overhead(farm_folder, args):
    farm = Farm.open(farm_folder, FarmConfig(unit_secs=(args.unit_secs, args.unit_secs), workers_per_node=2))
    actor = farm.accounts.local()
    settings = {"width": 320, "height": 240, "spp": args.spp}
    job = farm.jobs.submit(actor, {"package": upload(farm, actor).id, "settings": settings, "unit_secs": args.unit_secs})
    backend = runner.ray_backend(farm, "", 2)
    with runner.running(farm, backend, cache=str(farm_folder / "cache")):
        while farm.jobs.get(actor, job.id).state not in ("done", "failed"):
            time.sleep(0.1)
    with farm.database.read() as session:
        units = list(session.scalars(select(Unit).where(Unit.kind == "render")))
        done = session.scalars(select(Frame)).one().finished_at
    begun = min(u.started_at for u in units)
    total, cores = sum(u.secs for u in units), sum(u.core_secs for u in units)
    last = sorted(u.finished_at for u in units)
    return {
        "state": farm.jobs.get(actor, job.id).state,
        "units": len(units),
        "mean_unit_secs": total / len(units),
        "core_secs": cores,
        "wall_secs": done - begun,
        "wall_until_last_unit_secs": last[-1] - begun,
        # With an odd number of units one worker has nothing to do at the end, whatever the overhead.
        "ratio": (done - begun) / (total / 2),
        "ratio_until_last_unit": (last[-1] - begun) / (total / 2),
    }


def trial(farm_folder, args):
    import psutil
    from ray.cluster_utils import Cluster

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
    nodes = [cluster.add_node(num_cpus=1) for _ in range(4)]
    farm = Farm.open(farm_folder, FarmConfig(unit_secs=(0.5, 2.0)))
    actor = farm.accounts.local()
    order = {
        "settings": {"width": args.width, "height": args.width * 3 // 4},
        "frames": f"1-{args.frames}",
        "name": "spin",
        "unit_secs": 0.5,
    }
    job = farm.jobs.submit(actor, {"package": upload(farm, actor).id, **order})
    steps = []

    def until(check):
        while not check():
            time.sleep(0.1)

    def frames_done():
        return farm.jobs.get(actor, job.id).frames_done

    started = time.time()
    backend = runner.ray_backend(farm, cluster.address)
    with runner.running(farm, backend, cache=str(farm_folder / "cache")):
        until(lambda: frames_done() >= args.frames // 6)
        workers = [p for p in psutil.process_iter(["cmdline"]) if "RayWorker" in " ".join(p.info["cmdline"] or [])]
        workers = [p for p in workers if any(q.pid == os.getpid() for q in p.parents())]
        workers[0].send_signal(signal.SIGKILL)
        steps.append({"killed a worker process after": frames_done()})
        until(lambda: frames_done() >= args.frames // 3)
        cluster.remove_node(nodes[1], allow_graceful=False)
        steps.append({"killed a node after": frames_done()})
        until(lambda: frames_done() >= args.frames // 2)
    steps.append({"stopped the service after": frames_done()})
    farm.close()
    farm = Farm.open(farm_folder, farm.config)
    backend = runner.ray_backend(farm, cluster.address)
    with runner.running(farm, backend, cache=str(farm_folder / "cache")):
        until(lambda: farm.jobs.get(actor, job.id).state in ("done", "failed"))
    wall = time.time() - started
    found = farm.jobs.get(actor, job.id)
    same = 0
    scene = farm_folder / "spin.pov"
    scene.write_text(SCENE)
    for frame in farm.jobs.frames(actor, job.id, limit=1000).items:
        read = _etendue.load(scene, [], {}, None, None, None, frame.clock, (frame.number, args.frames, (args.width, args.width * 3 // 4)))
        parts = read.prepare(order["settings"], None, 0, [], True)
        target = farm_folder / "single.exr"
        _etendue.film_picture([parts.render(parts.crop, 0, parts.spp)], target, "standard", 0.0, False, False)
        digest = hashlib.sha256(target.read_bytes()).hexdigest()
        same += [o.sha256 for o in frame.outputs] == [digest]
    with farm.database.read() as session:
        units = list(session.scalars(select(Unit)))
        events = dict(session.execute(select(Event.kind, func.count()).group_by(Event.kind)).all())
    return {
        "state": found.state,
        "frames": args.frames,
        "frames with the hash of a single machine": same,
        "wall_secs": wall,
        "units": len(units),
        "begun again after a failure": sum(u.attempts - 1 for u in units),
        "lost with a worker or node": sum(u.losses for u in units),
        "steps": steps,
        "events": events,
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["costs", "queue", "overhead", "trial"])
    parser.add_argument("--farm", type=Path)
    parser.add_argument("--frames", type=int, default=48)
    parser.add_argument("--units", type=int, default=100_000)
    parser.add_argument("--workers", type=int, default=100)
    parser.add_argument("--width", type=int, default=96)
    parser.add_argument("--spp", type=int, default=512)
    parser.add_argument("--unit-secs", type=float, default=10.0)
    args = parser.parse_args()
    folder = args.farm or Path(tempfile.mkdtemp(prefix="etendue-bench-"))
    try:
        found = {"costs": costs, "queue": queue, "overhead": overhead, "trial": trial}[args.what](folder, args)
    finally:
        if args.farm is None:
            shutil.rmtree(folder, ignore_errors=True)
    json.dump(
        {"what": args.what, "version": etendue.__version__, "ray": ray.__version__, "machine": machine(), **found}, sys.stdout, indent=1
    )
    print()


if __name__ == "__main__":
    main()
