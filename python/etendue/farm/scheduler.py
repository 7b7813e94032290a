"""The scheduler: gives units to workers, merges films, ends frames and jobs. One at a time for a farm.

All that matters is in the database before the next step: a unit is `done` in the same transaction that adds its film, a merge replaces its
inputs in one, so a scheduler that is killed at any point goes on where it was. What is in memory (queues, previews, who does what) is made
anew.
"""

from __future__ import annotations

import threading
import time
from collections import Counter
from dataclasses import dataclass, field

from sqlalchemy import insert, select, update
from sqlalchemy.orm import Session

from etendue import ImageError, _etendue
from etendue.farm import planning
from etendue.farm.backend import Backend, Ended, NodeInfo
from etendue.farm.charge import Charge
from etendue.farm.endings import Endings
from etendue.farm.events import log
from etendue.farm.frames import Frames
from etendue.farm.models import Frame, Job, JobNeed, Node, Unit, User
from etendue.farm.orders import (
    Done,
    Finished,
    FinishOrder,
    Merged,
    MergeOrder,
    Order,
    Probed,
    Rendered,
    WorkerSetup,
)
from etendue.farm.policy import ActiveJob, Waiting, order_jobs, pick
from etendue.farm.preview import Previews
from etendue.farm.service import Farm
from etendue.farm.spec import JobSpec
from etendue.farm.states import FrameState, JobState, NodeState, UnitKind, UnitState

SYNC_SECS = 0.25
"""How often the database is asked for new jobs and orders."""
NODES_SECS = 1.0
HEARTBEAT_SECS = 3.0
MAX_LOSSES = 8
"""A unit that was lost with so many workers is what kills them."""
FETCH = 512
"""Units of a job that are read at once."""


@dataclass
class Task:
    """What a worker is doing."""

    order: Order
    job: int
    frame: int
    number: int
    unit: int | None
    estimated_secs: float
    started: float = field(default_factory=time.monotonic)
    timed_out: bool = False
    is_copy: bool = False
    """Whether it does what another one does as well."""


@dataclass
class WorkerState:
    """A worker."""

    name: str
    node: str
    threads: int
    task: Task | None = None
    last_frame: int | None = None


class Scheduler:
    """Runs a farm's jobs on a backend.

    Args:
        farm: The farm.
        backend: Where workers run.
        cache: Folder for unpacked packages on each machine; empty: the user's.

    Raises:
        ConflictError: Another scheduler is at work.
    """

    def __init__(self, farm: Farm, backend: Backend, *, cache: str = "") -> None:
        self._farm, self._backend, self._config = farm, backend, farm.config
        self._cache = cache
        self._database, self._store = farm.database, farm.store
        self._charge = Charge()
        self._frames = Frames(farm.config, farm.store)
        self._previews = Previews()
        self._jobs: dict[int, ActiveJob] = {}
        self._workers: dict[str, WorkerState] = {}
        self._nodes: dict[str, NodeInfo] = {}
        self._pending: list[Task] = []
        """Merges that may begin."""
        self._attempts: Counter[str] = Counter()
        self._next_sync = self._next_nodes = self._next_heartbeat = 0.0
        self._restart_at: dict[str, float] = {}
        self._stop = threading.Event()
        self._endings = Endings(farm.database, farm.config, self._stop)
        self.thread: threading.Thread | None = None
        """Where it runs, if someone has started it in a thread."""
        self._take_over()

    # ---- running ----

    def run(self) -> None:
        """Work until `stop`."""
        try:
            while not self._stop.is_set():
                self.step()
        finally:
            self.close()

    def stop(self) -> None:
        """Ask `run` to end. From any thread."""
        self._stop.set()

    def step(self, wait_secs: float = 0.1) -> None:
        """Do what can be done now, and wait up to so long for a task to end."""
        now = time.monotonic()
        if now >= self._next_heartbeat:
            self._next_heartbeat = now + HEARTBEAT_SECS
            self._heartbeat()
        if now >= self._next_nodes:
            self._next_nodes = now + NODES_SECS
            self._sync_nodes()
        if now >= self._next_sync:
            self._next_sync = now + SYNC_SECS
            self._sync_jobs()
            self._write_previews()
            self._watch_tasks()
        self._dispatch()
        ended = self._backend.poll(wait_secs)
        if ended:
            self._take(ended)

    def close(self) -> None:
        """Give up the farm: units in work go back to the queue."""
        self._endings.close()
        running = [w.task.unit for w in self._workers.values() if w.task is not None and w.task.unit is not None]
        with self._database.begin() as session:
            session.execute(update(Unit).where(Unit.id.in_(running), Unit.state == "running").values(state=UnitState.QUEUED.value))
            session.execute(update(Node).values(state=NodeState.DEAD.value, running=0, workers=0))
            self._charge.release(session)
        self._backend.close()

    # ---- who is in charge, and what the last one left ----

    def _take_over(self) -> None:
        with self._database.begin() as session:
            who = self._charge.take(session)
            session.execute(update(Node).values(state=NodeState.DEAD.value, running=0, workers=0))
            log(session, "farm-up", f"the scheduler has begun ({who})")
        self._recover()

    def _recover(self) -> None:
        """Take what was in work when the last scheduler ended: films that are complete count, the rest begins again."""
        with self._database.begin() as session:
            for unit, frame in session.execute(select(Unit, Frame).join(Frame).where(Unit.state == UnitState.RUNNING.value)).all():
                done = self._recovered(unit, frame)
                unit.state = UnitState.QUEUED.value
                if done is not None:
                    self._frames.unit_done(session, session.get_one(Job, unit.job_id), frame, unit, done, 0.0)
                    log(session, "unit-recovered", "its film was complete when the scheduler ended", job=unit.job_id, unit=unit.id)
            running = select(Frame, Job).join(Job).where(Frame.state == FrameState.RUNNING.value)
            for frame, job in session.execute(running).all():
                self._queue_merges(session, job, frame, *self._frames.all_ready(session, job, frame))

    def _recovered(self, unit: Unit, frame: Frame) -> Done | None:
        if unit.kind != UnitKind.RENDER:
            return None
        name = self._frames.film_name(unit, frame)
        try:
            film = self._store.read(name)
            info = _etendue.part_info(film)
        except (OSError, ImageError):
            return None
        if info["held"] != [(unit.x0, unit.y0, unit.x1, unit.y1, unit.begin, unit.end)]:
            return None
        secs = float(info["render_secs"])
        return Done("", Rendered(len(film), 0, None), secs, secs)

    def _heartbeat(self) -> None:
        with self._database.begin() as session:
            if not self._charge.renew(session):
                # Two schedulers would do everything twice.
                self._stop.set()

    # ---- nodes ----

    def _sync_nodes(self) -> None:
        alive = {node.id: node for node in self._backend.nodes()}
        now = time.time()
        with self._database.begin() as session:
            for gone in set(self._nodes) - set(alive):
                session.execute(update(Node).where(Node.id == gone).values(state=NodeState.DEAD.value, running=0, workers=0))
                log(session, "node-lost", f"the node {self._nodes[gone].name} is gone", level="warning", node=gone)
                for name in [w.name for w in self._workers.values() if w.node == gone and w.task is None]:
                    del self._workers[name]
            for node in alive.values():
                if node.id not in self._nodes:
                    log(session, "node-joined", f"the node {node.name} has joined with {node.cores:g} cores", node=node.id)
                self._start_workers(node)
                self._write_node(session, node, now)
        self._nodes = alive
        queued = sum(len(job.waiting) for job in self._jobs.values()) + len(self._pending)
        busy = sum(w.threads for w in self._workers.values() if w.task is not None)
        typical = max((w.threads for w in self._workers.values()), default=1)
        self._backend.want(min(busy + queued * typical, 1_000_000))

    def _start_workers(self, node: NodeInfo) -> None:
        if time.monotonic() < self._restart_at.get(node.id, 0.0):
            return
        per_node = min(self._config.workers_per_node, int(node.cores))
        threads = int(node.cores) // per_node
        limits = self._config.limits.model_dump()
        setup = WorkerSetup(threads, self._cache, self._store.url, dict(self._config.store_options), limits)
        for _ in range(per_node - sum(w.node == node.id for w in self._workers.values())):
            name = self._backend.start(node, setup)
            self._workers[name] = WorkerState(name, node.id, threads)

    def _write_node(self, session: Session, node: NodeInfo, now: float) -> None:
        row = session.get(Node, node.id)
        if row is None:
            row = Node(id=node.id, name=node.name, first_seen_at=now)
            session.add(row)
        row.name, row.address, row.state, row.cores, row.seen_at = node.name, node.address, NodeState.ALIVE.value, node.cores, now
        row.price = self._price(node.id, node)
        mine = [w for w in self._workers.values() if w.node == node.id]
        row.workers, row.running = len(mine), sum(w.task is not None for w in mine)
        stats = self._backend.stats(mine[0].name) if mine else None
        if stats is not None:
            row.load, row.memory_bytes, row.memory_used_bytes = stats.load, stats.memory_bytes, stats.memory_used_bytes

    def _price(self, node_id: str, node: NodeInfo | None = None) -> float:
        node = node or self._nodes.get(node_id)
        return self._config.price if node is None or node.price is None else node.price

    # ---- jobs ----

    def _sync_jobs(self) -> None:
        states = [JobState.QUEUED.value, JobState.RUNNING.value]
        query = select(Job.id, Job.priority, Job.version, Job.state, Job.started_at, Job.core_secs, Job.cost)
        with self._database.read() as session:
            rows = session.execute(query.where(Job.state.in_(states)).order_by(Job.id)).all()
            cancelled = self._stopped_jobs(session, {row.id for row in rows})
            for row in rows:
                job = self._jobs.get(row.id)
                if job is None:
                    job = self._jobs[row.id] = _active(session, session.get_one(Job, row.id))
                job.priority = row.priority
                if job.version != row.version:
                    job.version, job.is_exhausted = row.version, False
        for gone in set(self._jobs) - {row.id for row in rows}:
            del self._jobs[gone]
        for worker in self._workers.values():
            if worker.task is not None and worker.task.job in cancelled:
                self._backend.cancel(worker.name, worker.task.order.key)
        self._pending = [task for task in self._pending if task.job not in cancelled]
        self._start_dependents()

    def _stopped_jobs(self, session: Session, active: set[int]) -> set[int]:
        """Return the jobs that have ended or are gone but still have tasks."""
        mine = {w.task.job for w in self._workers.values() if w.task is not None} | {task.job for task in self._pending}
        asked = mine - active
        if not asked:
            return set()
        ended = [JobState.CANCELLED.value, JobState.FAILED.value]
        states = {row.id: row.state for row in session.execute(select(Job.id, Job.state).where(Job.id.in_(asked)))}
        return {job for job in asked if states.get(job, JobState.CANCELLED.value) in ended}

    def _start_dependents(self) -> None:
        with self._database.read() as session:
            waiting = list(session.scalars(select(Job.id).where(Job.state == JobState.WAITING.value)))
        if not waiting:
            return
        with self._database.begin() as session:
            for job_id in waiting:
                job = session.get_one(Job, job_id)
                needs = list(session.scalars(select(Job).join(JobNeed, JobNeed.needs_id == Job.id).where(JobNeed.job_id == job_id)))
                bad = [need.id for need in needs if need.state in (JobState.FAILED, JobState.CANCELLED)]
                if bad:
                    self._endings.end_job(session, job, JobState.FAILED, f"it needs job {bad[0]}, which has not come to its end")
                elif all(need.state == JobState.DONE for need in needs):
                    job.state = JobState.QUEUED.value
                    job.version += 1
                    log(session, "job-ready", "all jobs that it needs are done", job=job_id)

    def _fetch(self, job: ActiveJob) -> None:
        """Read the job's next units."""
        busy = {w.task.unit for w in self._workers.values() if w.task is not None} | {w.unit for w in job.waiting}
        open_frames = [FrameState.QUEUED.value, FrameState.RUNNING.value]
        query = select(Unit.id, Unit.frame_id, Unit.kind).join(Frame).where(Frame.state.in_(open_frames))
        query = query.where(Unit.job_id == job.id, Unit.state == UnitState.QUEUED.value).order_by(Unit.rank, Unit.id).limit(FETCH)
        self._make_probes(job)
        with self._database.read() as session:
            rows = session.execute(query).all()
        job.waiting.extend(Waiting(*row) for row in rows if row.id not in busy)
        job.is_exhausted = len(rows) < FETCH

    def _make_probes(self, job: ActiveJob) -> None:
        """Make the first units of the job's next frames."""
        query = select(Frame.id, Frame.rank).where(
            Frame.job_id == job.id, Frame.state == FrameState.QUEUED.value, Frame.has_probe.is_(False)
        )
        query = query.order_by(Frame.rank).limit(FETCH)
        with self._database.read() as session:
            if not session.execute(query.limit(1)).all():
                return
        with self._database.begin() as session:
            rows = session.execute(query).all()
            probe = {"job_id": job.id, "kind": UnitKind.PROBE.value}
            session.execute(insert(Unit), [{**probe, "frame_id": row.id, "rank": row.rank} for row in rows])
            session.execute(update(Frame).where(Frame.id.in_([row.id for row in rows])).values(has_probe=True))

    # ---- giving work ----

    def _dispatch(self) -> None:
        free = [w for w in self._workers.values() if w.task is None and w.node in self._nodes]
        given: list[tuple[WorkerState, Task]] = []
        while free and self._pending:
            given.append((free.pop(), self._pending.pop(0)))
        if free:
            given += self._give_units(free)
        for worker, task in given:
            worker.task = task
            worker.last_frame = task.frame if task.unit is not None else worker.last_frame
            task.started = time.monotonic()
            self._backend.submit(worker.name, task.order)

    def _give_units(self, free: list[WorkerState]) -> list[tuple[WorkerState, Task]]:
        running: Counter[int] = Counter()
        busy_frames: Counter[int] = Counter()
        for worker in self._workers.values():
            if worker.task is not None and worker.task.job in self._jobs:
                running[self._jobs[worker.task.job].owner] += worker.threads
                busy_frames[worker.task.frame] += 1
        chosen: list[tuple[WorkerState, ActiveJob, Waiting]] = []
        # Jobs that have nothing to give are asked once, not for each worker.
        candidates = [job for job in self._jobs.values() if job.waiting or not job.is_exhausted]
        while free and candidates:
            job = order_jobs(candidates, running)[0]
            if not job.waiting:
                self._fetch(job)
                if not job.waiting:
                    candidates.remove(job)
                    continue
            worker = next((w for w in free if w.last_frame == job.waiting[0].frame), free[0])
            free.remove(worker)
            unit = pick(job.waiting, worker.last_frame, busy_frames)
            running[job.owner] += worker.threads
            busy_frames[unit.frame] += 1
            chosen.append((worker, job, unit))
            if not job.waiting and job.is_exhausted:
                candidates.remove(job)
        return self._begin(chosen) if chosen else []

    def _begin(self, chosen: list[tuple[WorkerState, ActiveJob, Waiting]]) -> list[tuple[WorkerState, Task]]:
        given = []
        now = time.time()
        with self._database.begin() as session:
            for worker, active, waiting in chosen:
                unit, frame = session.get(Unit, waiting.unit), session.get(Frame, waiting.frame)
                job = session.get(Job, active.id)
                usable = (JobState.QUEUED, JobState.RUNNING)
                if unit is None or frame is None or job is None or unit.state != UnitState.QUEUED or job.state not in usable:
                    # Cancelled, paused or deleted a moment ago.
                    continue
                unit.state, unit.started_at, unit.node = UnitState.RUNNING.value, now, worker.node
                unit.attempts += 1
                if frame.state == FrameState.QUEUED:
                    frame.state, frame.started_at = FrameState.RUNNING.value, frame.started_at or now
                if job.state == JobState.QUEUED:
                    job.state, job.started_at = JobState.RUNNING.value, job.started_at or now
                    job.version += 1
                order = self._frames.order(active, frame, unit)
                given.append((worker, Task(order, job.id, frame.id, frame.number, unit.id, unit.estimated_secs or 0.0)))
        return given

    def _queue_merges(self, session: Session, job: Job, frame: Frame, *orders: MergeOrder | FinishOrder) -> None:
        known = {task.order.key for task in self._pending}
        known |= {w.task.order.key for w in self._workers.values() if w.task is not None}
        for order in orders:
            if order.key not in known:
                self._pending.append(Task(order, job.id, frame.id, frame.number, None, 0.0))

    def _watch_tasks(self) -> None:
        """Stop what takes too long; where workers have nothing to do, begin again what takes longer than expected."""
        now = time.monotonic()
        idle = [w for w in self._workers.values() if w.task is None and w.node in self._nodes]
        tasks = [w for w in self._workers.values() if w.task is not None]
        copies = Counter(w.task.unit for w in tasks if w.task is not None and w.task.unit is not None)
        for worker in tasks:
            task = worker.task
            if task is None:
                continue
            secs = now - task.started
            if secs > self._config.limits.unit_secs and not task.timed_out:
                task.timed_out = True
                self._backend.stop(worker.name)
            late = secs > self._config.straggler_factor * max(task.estimated_secs, self._config.unit_secs[0] / 2)
            if late and task.estimated_secs > 0 and task.unit is not None and copies[task.unit] == 1 and not self._pending:
                other = next((w for w in idle if w.node != worker.node), None)
                if other is None or any(job.waiting for job in self._jobs.values()):
                    continue
                idle.remove(other)
                copy = Task(task.order, task.job, task.frame, task.number, task.unit, task.estimated_secs, is_copy=True)
                other.task, other.last_frame = copy, task.frame
                self._backend.submit(other.name, copy.order)
                with self._database.begin() as session:
                    text = f"takes {secs:.0f} s instead of {task.estimated_secs:.0f}; begun again on another node"
                    log(session, "unit-straggles", text, level="warning", job=task.job, frame=task.number, unit=task.unit, node=other.node)

    # ---- taking results ----

    def _take(self, ended: list[Ended]) -> None:
        finished: list[tuple[WorkerState, Task, Ended]] = []
        for end in ended:
            worker = self._workers.get(end.worker)
            if worker is None or worker.task is None or worker.task.order.key != end.key:
                continue
            finished.append((worker, worker.task, end))
            worker.task = None
            if end.done is None:
                del self._workers[end.worker]
                # A worker that dies at once must not be started in a busy loop.
                self._restart_at[worker.node] = time.monotonic() + 1.0
        garbage: list[str] = []
        ready: list[tuple[Job, Frame, MergeOrder | FinishOrder]] = []
        with self._database.begin() as session:
            for worker, task, end in finished:
                self._take_one(session, worker, task, end, garbage, ready)
            for job, frame, order in ready:
                self._queue_merges(session, job, frame, order)
        # Only now is it certain that nobody needs them.
        self._store.delete(*garbage)

    def _take_one(
        self,
        session: Session,
        worker: WorkerState,
        task: Task,
        end: Ended,
        garbage: list[str],
        ready: list[tuple[Job, Frame, MergeOrder | FinishOrder]],
    ) -> None:
        job = session.get(Job, task.job, with_for_update=True)
        frame = session.get(Frame, task.frame)
        unit = session.get(Unit, task.unit) if task.unit is not None else None
        if job is None or frame is None or (task.unit is not None and unit is None):
            return
        done = end.done
        node = session.get(Node, worker.node)
        cost = 0.0
        if done is not None:
            cost = done.core_secs * self._price(worker.node) / 3600.0
            job.core_secs += done.core_secs
            frame.core_secs += done.core_secs
            job.cost += cost
            if node is not None:
                node.core_secs += done.core_secs
        if unit is not None and unit.state != UnitState.RUNNING:
            # A copy of it has ended before.
            return
        if done is None or done.result is None:
            self._take_failure(session, job, frame, unit, task, end, worker)
            return
        self._attempts.pop(done.key, None)
        orders: list[MergeOrder | FinishOrder] = []
        if isinstance(done.result, Probed) and unit is not None:
            slots = sum(w.node in self._nodes for w in self._workers.values())
            threads = worker.threads
            self._frames.probed(session, job, frame, unit, done, slots, threads)
            if done.result.picture is not None:
                self._previews.begin(frame.id, done.result.picture)
        elif isinstance(done.result, Rendered) and unit is not None:
            orders = self._frames.unit_done(session, job, frame, unit, done, cost)
            if done.result.tile is not None and frame.crop is not None:
                self._previews.add(frame.id, _rect(frame.crop), done.result.tile, unit.end - unit.begin)
            for other in self._workers.values():
                if other.task is not None and other.task.unit == unit.id:
                    self._backend.cancel(other.name, other.task.order.key)
        elif isinstance(done.result, Merged) and isinstance(task.order, MergeOrder):
            orders = self._frames.merged(session, job, frame, task.order, done.result, garbage)
        elif isinstance(done.result, Finished) and isinstance(task.order, FinishOrder):
            slots, threads = len(self._workers), worker.threads
            orders = self._frames.finished(session, job, frame, task.order, done.result, garbage, slots, threads)
            if done.result.is_done:
                self._previews.drop(frame.id)
        if node is not None and unit is not None:
            node.units_done += 1
        job.version += 1
        ready.extend((job, frame, order) for order in orders)
        self._endings.settle(session, job, frame)

    def _take_failure(
        self, session: Session, job: Job, frame: Frame, unit: Unit | None, task: Task, end: Ended, worker: WorkerState
    ) -> None:
        done = end.done
        if done is not None and done.error is None:
            # Cancelled: with its job, or because a copy was faster.
            if unit is not None and not self._has_copy(unit.id):
                unit.state = UnitState.QUEUED.value
            return
        if done is None and not task.timed_out:
            log(
                session,
                "unit-lost",
                f"lost with its worker: {end.reason}",
                level="warning",
                job=job.id,
                frame=frame.number,
                unit=task.unit,
                node=worker.node,
            )
            error = f"its worker was lost: {end.reason}"
        else:
            error = f"took longer than {self._config.limits.unit_secs:g} s" if done is None else done.error or "failed"
            log(session, "unit-failed", error, level="error", job=job.id, frame=frame.number, unit=task.unit, node=worker.node)
        if unit is None:
            self._attempts[task.order.key] += 1
            again = self._attempts[task.order.key] < MAX_LOSSES and not (done is not None and done.is_final)
            if again:
                self._pending.append(Task(task.order, task.job, task.frame, task.number, None, 0.0))
            else:
                self._endings.fail_frame(session, job, frame, f"its films could not be merged: {error}")
            return
        if self._has_copy(unit.id):
            return
        unit.error = error
        if done is None and not task.timed_out:
            unit.losses += 1
            unit.attempts -= 1
            again = unit.losses < MAX_LOSSES
        else:
            again = unit.attempts < int(job.spec.get("max_attempts", 3)) and not (done is not None and done.is_final)
        if again:
            unit.state = UnitState.QUEUED.value
            active = self._jobs.get(job.id)
            if active is not None:
                active.waiting.appendleft(Waiting(unit.id, frame.id, unit.kind))
            return
        unit.state, unit.finished_at = UnitState.FAILED.value, time.time()
        job.units_failed += 1
        self._endings.fail_frame(session, job, frame, error)

    def _has_copy(self, unit: int) -> bool:
        return any(w.task is not None and w.task.unit == unit for w in self._workers.values())

    def _write_previews(self) -> None:
        for frame_id in self._previews.due():
            data = self._previews.png(frame_id)
            with self._database.begin() as session:
                frame = session.get(Frame, frame_id)
                if frame is None or frame.state != FrameState.RUNNING or frame.preview is None:
                    self._previews.drop(frame_id)
                    continue
                self._store.write(frame.preview, data)
                frame.preview_version += 1
                job = session.get_one(Job, frame.job_id)
                job.version += 1


def _active(session: Session, job: Job) -> ActiveJob:
    share = session.get_one(User, job.owner_id).share
    spec = JobSpec.model_validate(job.spec)
    return ActiveJob(job.id, job.owner_id, share, job.priority, spec, job.package_id, job.scene, job.name)


def _rect(edges: list[int]) -> planning.Rect:
    x0, y0, x1, y1 = edges
    return x0, y0, x1, y1
