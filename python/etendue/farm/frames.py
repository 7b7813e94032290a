"""How a frame comes to its picture: probe → units → merges → finish, and another round of samples where noise, time or cost decide.

Each function changes rows within the scheduler's transaction and returns the merges that have become possible.
"""

from __future__ import annotations

import posixpath
import re
import time

from sqlalchemy import func, insert, select
from sqlalchemy.orm import Session

import etendue
from etendue.farm import planning
from etendue.farm.config import FarmConfig
from etendue.farm.events import log
from etendue.farm.models import Film, Frame, Job, Unit
from etendue.farm.orders import (
    Done,
    Finished,
    FinishOrder,
    Merged,
    MergeOrder,
    Order,
    Probed,
    ProbeOrder,
    Rendered,
    RenderOrder,
    SceneOrder,
)
from etendue.farm.policy import ActiveJob
from etendue.farm.spec import JobSpec
from etendue.farm.states import FrameState, UnitKind, UnitState
from etendue.farm.store import Store

Orders = list[MergeOrder | FinishOrder]
DEFAULT_MEMORY_MIB = next(int(p.default) for p in etendue.parameters() if p.name == "photon_memory")
"""Of a photon map, where the order does not say."""
LOAD_FACTOR = 4.0
"""A unit takes at least so many times longer than loading the scene."""


class Frames:
    """The rules of a farm's frames."""

    def __init__(self, config: FarmConfig, store: Store) -> None:
        self._config = config
        self._store = store
        self._specs: dict[int, JobSpec] = {}

    # ---- orders ----

    def film_name(self, unit: Unit, frame: Frame) -> str:
        """Return the name in the store of a unit's film: always the same, so that a film of a lost scheduler is found."""
        return f"jobs/{unit.job_id}/films/{frame.number}/unit-{unit.id}.film"

    def order(self, job: ActiveJob, frame: Frame, unit: Unit) -> Order:
        """Return what a worker is told for a unit."""
        scene = self._scene_order(job.spec, job.package, job.scene, frame)
        key = f"unit-{unit.id}-{unit.attempts}-{unit.losses}"
        if unit.kind == UnitKind.PROBE:
            return ProbeOrder(key, scene, _preview_name(frame))
        rect = (unit.x0, unit.y0, unit.x1, unit.y1)
        return RenderOrder(key, scene, rect, unit.begin, unit.end, self.film_name(unit, frame))

    def _scene_order(self, spec: JobSpec, package: str, scene: str, frame: Frame) -> SceneOrder:
        return SceneOrder(
            package=package,
            scene=scene,
            settings=tuple(sorted(spec.settings_of(frame.number).items())),
            crop=spec.crop,
            aovs=tuple(spec.aovs),
            defines=tuple(sorted(spec.defines.items())),
            variant=spec.variant,
            gltf_scene=spec.gltf_scene,
            gltf_animation=spec.gltf_animation,
            clock=frame.clock,
            # A study shows one moment in all of its runs.
            number=0 if spec.runs else frame.number,
            final=spec.final(),
            fixed_spp=not spec.stop.is_open,
            command="render" if spec.command == "study" else spec.command,
            bake=tuple(sorted(spec.bake.preparation().items())) if spec.command == "bake" else (),
        )

    def _spec(self, job: Job) -> JobSpec:
        if job.id not in self._specs:
            if len(self._specs) > 10_000:
                self._specs.clear()
            self._specs[job.id] = JobSpec.model_validate(job.spec)
        return self._specs[job.id]

    # ---- from the probe to units ----

    def probed(self, session: Session, job: Job, frame: Frame, unit: Unit, done: Done, slots: int, threads: int) -> None:
        """Take what a probe has found: makes the frame's first units."""
        result = done.result
        assert isinstance(result, Probed)
        spec = self._spec(job)
        _end_unit(unit, done)
        job.units_done += 1
        frame.width, frame.height, frame.crop = result.width, result.height, list(result.crop)
        frame.is_adaptive, frame.is_whole = result.is_adaptive, result.is_whole
        frame.secs_per_sample, frame.load_secs = result.secs_per_sample, result.load_secs
        frame.preview, frame.preview_version = _preview_name(frame), frame.preview_version + 1
        is_open = spec.stop.is_open
        frame.spp_target = None if is_open and spec.settings_of(frame.number).get("spp") is None else result.spp
        pixels = planning.area(result.crop)
        most = frame.spp_target
        if not is_open:
            frame.estimated_core_secs = result.secs_per_sample * pixels * result.spp
        session.flush()
        self._estimate(session, job)
        end = result.spp
        if is_open and not result.is_adaptive:
            shortest = self._config.unit_secs[0] if spec.unit_secs is None else spec.unit_secs
            end = planning.next_round(0, None, None, most, result.secs_per_sample * pixels / threads, slots, shortest)
        self._plan_round(session, job, frame, 0, end, slots, threads)

    def _estimate(self, session: Session, job: Job) -> None:
        """Estimate the job from the frames whose cost is known."""
        query = select(func.avg(Frame.estimated_core_secs)).where(Frame.job_id == job.id, Frame.estimated_core_secs.is_not(None))
        mean = session.scalar(query)
        if mean is not None:
            job.estimated_core_secs = float(mean) * job.frames_total
            job.estimated_cost = job.estimated_core_secs * self._config.price / 3600.0

    def _plan_round(self, session: Session, job: Job, frame: Frame, begin: int, end: int, slots: int, threads: int) -> None:
        """Make the units of samples `begin..end` of a frame."""
        spec = self._spec(job)
        crop = _crop(frame)
        rate = frame.secs_per_sample or 0.0
        secs = rate * planning.area(crop) * (end - begin) / threads
        rest = max((job.estimated_core_secs or 0.0) - job.core_secs, 0.0) / threads
        shortest, longest = self._config.unit_secs
        target = planning.unit_secs(max(rest, secs), slots, shortest, longest)
        target = spec.unit_secs or max(target, LOAD_FACTOR * (frame.load_secs or 0.0))
        # After the last frame nothing is left for a worker that has ended its part of it.
        tail = slots if frame.number == spec.last_number() else 0
        parts = planning.split_frame(crop, begin, end, secs, target, whole=frame.is_whole, all_samples=frame.is_adaptive, tail=tail)
        first = frame.number in spec.first_numbers()
        session.execute(
            insert(Unit),
            [
                {
                    "job_id": job.id,
                    "frame_id": frame.id,
                    "kind": UnitKind.RENDER.value,
                    "rank": planning.rank(frame.number, first, slot),
                    "round": frame.round,
                    "slot": slot,
                    "x0": part.rect[0],
                    "y0": part.rect[1],
                    "x1": part.rect[2],
                    "y1": part.rect[3],
                    "begin": part.begin,
                    "end": part.end,
                    "estimated_secs": rate * part.work / threads + (frame.load_secs or 0.0),
                }
                for slot, part in enumerate(parts)
            ],
        )
        frame.spp_planned = end
        frame.units_total += len(parts)
        job.units_total += len(parts)

    # ---- from units to the film ----

    def unit_done(self, session: Session, job: Job, frame: Frame, unit: Unit, done: Done, cost: float) -> Orders:
        """Take a unit's film."""
        result = done.result
        assert isinstance(result, Rendered)
        _end_unit(unit, done)
        path = self.film_name(unit, frame)
        session.add(Film(frame_id=frame.id, round=unit.round, level=0, slot=unit.slot, path=path, bytes=result.bytes))
        frame.units_done += 1
        job.units_done += 1
        job.progress = min(job.progress + self._share(job, frame, unit), 0.999)
        session.flush()
        return self._ready(session, job, frame, 0, unit.slot)

    def _share(self, job: Job, frame: Frame, unit: Unit) -> float:
        """Return a unit's share of the job; with an open number of samples it is not known, and frames count when they are done."""
        if frame.spp_target is None or self._spec(job).stop.is_open:
            return 0.0
        work = planning.area((unit.x0, unit.y0, unit.x1, unit.y1)) * (unit.end - unit.begin)
        return work / (planning.area(_crop(frame)) * frame.spp_target * max(job.frames_total, 1))

    def merged(self, session: Session, job: Job, frame: Frame, order: MergeOrder, result: Merged, garbage: list[str]) -> Orders:
        """Take the sum of some films, in place of them."""
        films = list(session.scalars(select(Film).where(Film.frame_id == frame.id, Film.path.in_(order.films))))
        if len(films) != len(order.films):
            # Another attempt was faster.
            return []
        level, slot = films[0].level + 1, films[0].slot // self._config.merge_fan_in
        garbage.extend(order.films)
        for film in films:
            session.delete(film)
        session.add(Film(frame_id=frame.id, round=films[0].round, level=level, slot=slot, path=order.film, bytes=result.bytes))
        session.flush()
        return self._ready(session, job, frame, level, slot)

    def all_ready(self, session: Session, job: Job, frame: Frame) -> Orders:
        """Return all merges of a frame that may begin, after a restart."""
        orders: dict[str, MergeOrder | FinishOrder] = {}
        rows = session.execute(select(Film.level, Film.slot).where(Film.frame_id == frame.id, Film.round == frame.round)).all()
        for level, slot in rows:
            for order in self._ready(session, job, frame, level, slot):
                orders[order.key] = order
        return list(orders.values())

    def _ready(self, session: Session, job: Job, frame: Frame, level: int, slot: int) -> Orders:
        """Return the merge that a new film was the last to be missing for."""
        fan_in = self._config.merge_fan_in
        mine = select(func.count()).select_from(Unit).where(Unit.frame_id == frame.id, Unit.kind == UnitKind.RENDER.value)
        units = session.scalar(mine.where(Unit.round == frame.round)) or 0
        films = select(Film).where(Film.frame_id == frame.id, Film.round == frame.round, Film.level == level).order_by(Film.slot)
        merge = planning.merge_of(level, slot, units, fan_in)
        if merge is None:
            _, count = planning.tops(units, fan_in)
            found = list(session.scalars(films))
            return [self._finish_order(job, frame, found)] if len(found) == count else []
        found = list(session.scalars(films.where(Film.slot >= merge.first, Film.slot < merge.last)))
        if len(found) < merge.last - merge.first:
            return []
        if len(found) == 1:
            # Alone in its group: it is its own sum.
            found[0].level, found[0].slot = level + 1, merge.slot
            session.flush()
            return self._ready(session, job, frame, level + 1, merge.slot)
        name = f"jobs/{job.id}/films/{frame.number}/sum-{frame.round}-{level + 1}-{merge.slot}.film"
        key = f"merge-{frame.id}-{frame.round}-{level + 1}-{merge.slot}"
        return [MergeOrder(key, tuple(f.path for f in found), name, _memory_mib(self._spec(job)))]

    def _finish_order(self, job: Job, frame: Frame, films: list[Film]) -> FinishOrder:
        spec = self._spec(job)
        before = (frame.film,) if frame.film is not None else ()
        stem = file_stem(job.name)
        number = "" if spec.frames is None and not spec.runs else f".{frame.number:04d}"
        outputs = []
        for kind in dict.fromkeys(spec.formats):
            name = f"{stem}{number}.{kind}"
            outputs.append((str(kind), name, f"jobs/{job.id}/outputs/{name}"))
        is_last = frame.spp_target is not None and frame.spp_planned >= frame.spp_target
        return FinishOrder(
            key=f"finish-{frame.id}-{frame.round}",
            films=(*before, *(f.path for f in films)),
            film=f"jobs/{job.id}/films/{frame.number}/total-{frame.round}.film",
            preview=_preview_name(frame),
            outputs=tuple(outputs),
            exposure=spec.exposure,
            tonemap=spec.tonemap,
            is_last=is_last or frame.is_adaptive or self._is_over(job),
            variance="variance" in spec.aovs or "all" in spec.aovs,
            samples="samples" in spec.aovs or "all" in spec.aovs,
            noise=spec.stop.noise,
            memory_mib=_memory_mib(spec),
            scene=self._scene_order(spec, job.package_id, job.scene, frame) if spec.command == "bake" else None,
            delivery=tuple(sorted(spec.bake.model_dump().items())) if spec.command == "bake" else (),
        )

    def _is_over(self, job: Job) -> bool:
        """Return whether time or cost are used up."""
        stop = self._spec(job).stop
        secs = time.time() - job.started_at if job.started_at is not None else 0.0
        return (
            (stop.secs is not None and secs >= stop.secs)
            or (stop.core_secs is not None and job.core_secs >= stop.core_secs)
            or (stop.cost is not None and job.cost >= stop.cost)
        )

    def finished(
        self, session: Session, job: Job, frame: Frame, order: FinishOrder, result: Finished, garbage: list[str], slots: int, threads: int
    ) -> Orders:
        """Take a frame's whole film: the frame is done, or gets another round of samples."""
        films = list(session.scalars(select(Film).where(Film.frame_id == frame.id, Film.round == frame.round)))
        garbage.extend(path for path in order.films if path != order.film)
        for film in films:
            session.delete(film)
        frame.film = order.film
        frame.spp_done, frame.relative_error = result.spp, result.relative_error
        frame.preview_version += 1
        if result.is_done:
            frame.state, frame.finished_at = FrameState.DONE.value, time.time()
            frame.outputs = [dict(output) for output in result.outputs]
            job.frames_done += 1
            if self._share_by_frame(job):
                job.progress = min(job.frames_done / max(job.frames_total, 1), 0.999)
            count = {"photons": "photons", "bake": "samples a point"}.get(self._spec(job).command, "spp")
            spp = f"{result.spp} {count}" + ("" if result.relative_error is None else f", relative error {result.relative_error:.4f}")
            notes = f"; {result.notes}" if result.notes else ""
            log(session, "frame-done", f"frame {frame.number} is done: {spp}{notes}", job=job.id, frame=frame.number)
            return []
        if self._is_over(job):
            # The limit was reached while it was merged: the same film, now with its pictures.
            frame.round += 1
            frame.spp_target = frame.spp_planned
            return [self._finish_order(job, frame, [])]
        stop = self._spec(job).stop
        shortest = self._config.unit_secs[0] if self._spec(job).unit_secs is None else self._spec(job).unit_secs or 0.0
        # What it has cost so far is known better than by the probe.
        pixels = planning.area(_crop(frame))
        if frame.core_secs > 0 and frame.spp_planned > 0:
            frame.secs_per_sample = frame.core_secs / (pixels * frame.spp_planned)
        per_sample = (frame.secs_per_sample or 0.0) * pixels / threads
        begin = frame.spp_planned
        end = planning.next_round(begin, result.relative_error, stop.noise, frame.spp_target, per_sample, slots, shortest)
        frame.round += 1
        self._plan_round(session, job, frame, begin, end, slots, threads)
        return []

    def _share_by_frame(self, job: Job) -> bool:
        return self._spec(job).stop.is_open


def _end_unit(unit: Unit, done: Done) -> None:
    unit.state, unit.finished_at = UnitState.DONE.value, time.time()
    unit.secs, unit.core_secs, unit.error, unit.log = done.secs, done.core_secs, None, done.log or None


def _memory_mib(spec: JobSpec) -> int:
    """Return what a photon map of the job may take."""
    given = spec.settings.get("photon_memory")
    return given if isinstance(given, int) else DEFAULT_MEMORY_MIB


def _crop(frame: Frame) -> planning.Rect:
    x0, y0, x1, y1 = frame.crop or (0, 0, 1, 1)
    return x0, y0, x1, y1


def _preview_name(frame: Frame) -> str:
    return f"jobs/{frame.job_id}/previews/{frame.number}.png"


def file_stem(name: str) -> str:
    """Return a text as a part of a file's name on any system."""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", posixpath.basename(name)).strip("-. ")[:100] or "picture"
