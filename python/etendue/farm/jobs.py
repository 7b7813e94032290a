"""Orders: submitting, listing and steering jobs. The REST API and the command line call the same functions, which check all rights."""

from __future__ import annotations

import posixpath
import time
from collections.abc import Mapping, Sequence
from typing import Any, cast

from pydantic import BaseModel, ConfigDict, ValidationError
from sqlalchemy import Select, Table, bindparam, func, insert, literal_column, or_, select, update
from sqlalchemy.orm import Session

from etendue.farm import planning
from etendue.farm.accounts import Actor
from etendue.farm.config import FarmConfig
from etendue.farm.database import Database
from etendue.farm.errors import ConflictError, ForbiddenError, InvalidError, NotFoundError, QuotaError
from etendue.farm.events import audit
from etendue.farm.models import Event, Film, Frame, Job, JobNeed, Package, PackageUser, Unit, User
from etendue.farm.spec import JobSpec
from etendue.farm.states import JOB_ENDED, FrameState, JobState, Role, UnitState
from etendue.farm.store import Store
from etendue.farm.views import EventView, FrameView, JobDetail, JobView, Output, Page, UnitView

MAX_LIMIT = 1000
"""Most rows of a page."""
_ORDERS = {
    "created": Job.created_at,
    "name": Job.name,
    "state": Job.state,
    "priority": Job.priority,
    "progress": Job.progress,
    "started": Job.started_at,
    "finished": Job.finished_at,
    "cost": Job.cost,
    "frames": Job.frames_total,
    "owner": User.name,
    "id": Job.id,
}
_ENDED = [state.value for state in JOB_ENDED]


class JobFilter(BaseModel):
    """Which jobs a list has. Everything that is given must hold."""

    model_config = ConfigDict(extra="forbid")

    states: list[JobState] | None = None
    owner: str | None = None
    text: str | None = None
    """Part of the name or scene, in small or capital letters."""
    package: str | None = None
    created_after: float | None = None
    created_before: float | None = None
    order: str = "-created"
    """`created`, `name`, `state`, `priority`, `progress`, `started`, `finished`, `cost`, `frames`, `owner`, `id`; with `-` downwards."""


class Jobs:
    """The jobs of a farm."""

    def __init__(self, database: Database, store: Store, config: FarmConfig) -> None:
        self._database = database
        self._store = store
        self._config = config

    # ---- ordering ----

    def submit(self, actor: Actor, spec: JobSpec | dict[str, Any]) -> JobDetail:
        """Take an order. Its units are made when the scheduler knows what a frame costs, so this is quick for any job.

        Raises:
            ForbiddenError: The user may only look.
            InvalidError: The order has a fault.
            NotFoundError: There is no such package, for this user.
            QuotaError: The user has too many jobs, or has used up their core-seconds.
        """
        actor.need(Role.ARTIST)
        spec = check_spec(spec)
        numbers, first = spec.numbers(), spec.first_numbers()
        self._check_size(spec)
        with self._database.begin() as session:
            package = session.get(Package, spec.package)
            mine = session.get(PackageUser, (spec.package, actor.id))
            if package is None or (mine is None and not actor.can(Role.ADMIN)):
                raise NotFoundError("there is no such package of yours; upload it first")
            scene = spec.scene or package.scene
            if scene not in {row[0] for row in package.files}:
                raise InvalidError(f"the package has no file `{scene[:200]}`")
            self._check_quota(session, actor)
            needs = self._check_needs(session, actor, spec.needs)
            stem = posixpath.splitext(posixpath.basename(scene))[0]
            job = Job(
                owner_id=actor.id,
                name=spec.name or stem,
                kind=spec.command if spec.command != "render" else "still" if spec.frames is None else "animation",
                package_id=package.id,
                scene=scene,
                spec=spec.model_dump(mode="json"),
                state=(JobState.WAITING if needs else JobState.QUEUED).value,
                priority=spec.priority,
                is_shared=spec.shared,
                frames_total=len(numbers),
                # One probe for each frame.
                units_total=len(numbers),
            )
            session.add(job)
            session.flush()
            session.add_all(JobNeed(job_id=job.id, needs_id=need) for need in needs)
            self._add_frames(session, job, spec, numbers, first)
            pictures = f"{len(numbers)} {'run' if spec.runs else 'frame'}(s)"
            audit(session, actor.id, "job-submitted", f"{actor.name} submitted `{job.name}`: {pictures} of {scene}", job=job.id)
            return self._detail(session, actor, job, actor.name)

    def _add_frames(self, session: Session, job: Job, spec: JobSpec, numbers: Sequence[int], first: frozenset[int]) -> None:
        # Frames in bulk, as an animation may have a hundred thousand of them: what all have in common stands in the statement, and only
        # the rest is handed over row by row. Their units come later.
        counts = {"spp_done": 0, "spp_planned": 0, "preview_version": 0, "units_total": 0, "units_done": 0, "core_secs": 0.0, "round": 0}
        same = {"has_probe": False, "is_adaptive": False, "is_whole": False, **counts}
        # Numbers and flags of our own, never text from outside.
        common = {key: literal_column(str(value).lower(), Frame.__table__.c[key].type) for key, value in same.items()}
        common["job_id"] = literal_column(str(int(job.id)))
        own: dict[str, Any] = {key: bindparam(key) for key in ("number", "clock", "rank", "state")}
        queued, waiting = FrameState.QUEUED.value, FrameState.HELD.value
        rows = []
        for n, clock in zip(numbers, spec.clock_of(numbers), strict=True):
            is_first = n in first
            state = waiting if spec.approval and not is_first else queued
            rows.append((n, clock, planning.probe_rank(n, is_first), state))
        connection = session.connection()
        # To the driver itself: SQLAlchemy's way with parameters takes thrice as long as the database.
        statement = insert(cast(Table, Frame.__table__)).values({**common, **own}).compile(dialect=connection.dialect)
        if statement.positional:
            places = [list(own).index(name) for name in statement.positiontup or ()]
            connection.exec_driver_sql(str(statement), [tuple(row[i] for i in places) for row in rows])
        else:
            connection.exec_driver_sql(str(statement), [dict(zip(own, row, strict=True)) for row in rows])

    def _check_size(self, spec: JobSpec) -> None:
        for settings in [spec.settings, *({**spec.settings, **run} for run in spec.runs)]:
            self._check_settings(settings)

    def _check_settings(self, settings: Mapping[str, object]) -> None:
        limits = self._config.limits
        width, height = (settings.get(key) for key in ("width", "height"))
        for edge in (width, height):
            if edge is not None and not (isinstance(edge, int) and 0 < edge <= 1 << 20):
                raise InvalidError("`width` and `height` are whole numbers of pixels")
        if isinstance(width, int) and isinstance(height, int) and width * height > limits.pixels:
            raise InvalidError(f"a picture has at most {limits.pixels} pixels")
        spp = settings.get("spp")
        if spp is not None and not (isinstance(spp, int) and not isinstance(spp, bool) and 0 < spp <= limits.spp):
            raise InvalidError(f"`spp` is a whole number from 1 to {limits.spp}")
        photons = settings.get("photons")
        if photons is not None and not (isinstance(photons, int) and not isinstance(photons, bool) and 0 < photons < 1 << 31):
            raise InvalidError(f"`photons` is a whole number from 1 to {(1 << 31) - 1}")

    def _check_quota(self, session: Session, actor: Actor) -> None:
        user = session.get_one(User, actor.id)
        if user.max_jobs is not None:
            active = select(func.count()).select_from(Job).where(Job.owner_id == user.id, Job.state.not_in(_ENDED))
            if (session.scalar(active) or 0) >= user.max_jobs:
                raise QuotaError(f"you may have {user.max_jobs} jobs at a time")
        if user.max_core_secs is not None:
            used = session.scalar(select(func.sum(Job.core_secs)).where(Job.owner_id == user.id)) or 0.0
            if used >= user.max_core_secs:
                raise QuotaError(f"you have used up your {user.max_core_secs / 3600:.1f} core-hours")

    def _check_needs(self, session: Session, actor: Actor, needs: Sequence[int]) -> list[int]:
        """Return the needed jobs that are not done."""
        open_needs = []
        for need in dict.fromkeys(needs):
            job = session.get(Job, need)
            if job is None or not self._sees(actor, job):
                raise NotFoundError(f"there is no job {need} to wait for")
            if job.state in (JobState.FAILED, JobState.CANCELLED):
                raise ConflictError(f"job {need} is {job.state}; a job that needs it would never begin")
            if job.state != JobState.DONE:
                open_needs.append(need)
        return open_needs

    # ---- looking ----

    def find(self, actor: Actor, filter: JobFilter | None = None, *, offset: int = 0, limit: int = 100) -> Page[JobView]:  # noqa: A002
        """Return some of the jobs that the user may see, newest first unless the filter says otherwise."""
        filter = filter or JobFilter()  # noqa: A001 - the word for it
        offset, limit = check_page(offset, limit)
        query = self._filtered(actor, filter)
        name = filter.order.removeprefix("-")
        if name not in _ORDERS:
            raise InvalidError(f"jobs cannot be ordered by `{name[:40]}`; there are {', '.join(_ORDERS)}")
        column = _ORDERS[name]
        down = filter.order.startswith("-")
        with self._database.read() as session:
            total = session.scalar(select(func.count()).select_from(query.order_by(None).with_only_columns(Job.id).subquery())) or 0
            order = column.desc().nulls_last() if down else column.asc().nulls_last()
            rows = session.execute(query.order_by(order, Job.id.desc() if down else Job.id).offset(offset).limit(limit)).all()
            items = [_view(job, owner) for job, owner in rows]
        return Page(items=items, total=total, offset=offset, limit=limit)

    def _filtered(self, actor: Actor, filter: JobFilter) -> Select[Job, str]:  # noqa: A002
        query = select(Job, User.name).join(User, Job.owner_id == User.id)
        if not actor.can(Role.ADMIN):
            query = query.where(or_(Job.owner_id == actor.id, Job.is_shared))
        if filter.states is not None:
            query = query.where(Job.state.in_([JobState(state).value for state in filter.states]))
        if filter.owner:
            query = query.where(User.name == filter.owner)
        if filter.text:
            # `%` and `_` in what a user types are themselves.
            query = query.where(or_(Job.name.icontains(filter.text, autoescape=True), Job.scene.icontains(filter.text, autoescape=True)))
        if filter.package:
            query = query.where(Job.package_id == filter.package)
        if filter.created_after is not None:
            query = query.where(Job.created_at >= filter.created_after)
        if filter.created_before is not None:
            query = query.where(Job.created_at < filter.created_before)
        return query

    def get(self, actor: Actor, job_id: int) -> JobDetail:
        """Return a job.

        Raises:
            NotFoundError: There is none that the user may see.
        """
        with self._database.read() as session:
            job = self._visible(session, actor, job_id)
            return self._detail(session, actor, job, session.get_one(User, job.owner_id).name)

    def frames(
        self, actor: Actor, job_id: int, *, states: Sequence[FrameState] | None = None, offset: int = 0, limit: int = 100
    ) -> Page[FrameView]:
        """Return some of a job's frames, by their numbers."""
        offset, limit = check_page(offset, limit)
        with self._database.read() as session:
            job = self._visible(session, actor, job_id)
            query = select(Frame).where(Frame.job_id == job.id)
            if states is not None:
                query = query.where(Frame.state.in_([FrameState(state).value for state in states]))
            total = session.scalar(select(func.count()).select_from(query.subquery())) or 0
            rows = session.scalars(query.order_by(Frame.number).offset(offset).limit(limit))
            return Page(items=[frame_view(row) for row in rows], total=total, offset=offset, limit=limit)

    def units(
        self,
        actor: Actor,
        job_id: int,
        *,
        frame: int | None = None,
        states: Sequence[UnitState] | None = None,
        offset: int = 0,
        limit: int = 100,
    ) -> Page[UnitView]:
        """Return some of a job's units, in the order in which they are begun. Units of a cancelled job show as cancelled."""
        offset, limit = check_page(offset, limit)
        with self._database.read() as session:
            job = self._visible(session, actor, job_id)
            query = select(Unit).where(Unit.job_id == job.id)
            if frame is not None:
                query = query.where(Unit.frame_id == self._frame(session, job, frame).id)
            if states is not None:
                wanted = {UnitState(state).value for state in states}
                # What has not begun in a cancelled job is cancelled, whatever its row says.
                if job.state == JobState.CANCELLED and UnitState.CANCELLED.value in wanted:
                    wanted |= {UnitState.QUEUED.value}
                query = query.where(Unit.state.in_(wanted))
            total = session.scalar(select(func.count()).select_from(query.with_only_columns(Unit.id).subquery())) or 0
            rows = list(session.scalars(query.order_by(Unit.rank, Unit.id).offset(offset).limit(limit)))
            found = select(Frame.id, Frame.number).where(Frame.id.in_({row.frame_id for row in rows}))
            numbers = {row[0]: row[1] for row in session.execute(found)}
            items = [unit_view(row, numbers[row.frame_id], job.state) for row in rows]
        return Page(items=items, total=total, offset=offset, limit=limit)

    def log(
        self,
        actor: Actor,
        *,
        job: int | None = None,
        unit: int | None = None,
        node: str | None = None,
        levels: Sequence[str] | None = None,
        after: int = 0,
        offset: int = 0,
        limit: int = 100,
    ) -> Page[EventView]:
        """Return lines of the log, newest first: of a job that the user may see, or else the user's own; administrators see all.

        Args:
            actor: Who asks.
            job: Only of this job.
            unit: Only of this unit.
            node: Only of this node.
            levels: Only `info`, `warning`, `error`, `audit`.
            after: Only lines with a larger id, for a page that follows the log.
            offset: Lines to leave out.
            limit: Most lines.
        """
        offset, limit = check_page(offset, limit)
        query = select(Event, User.name).outerjoin(User, Event.user_id == User.id).where(Event.id > after)
        with self._database.read() as session:
            if job is not None:
                query = query.where(Event.job_id == self._visible(session, actor, job).id)
            elif not actor.can(Role.ADMIN):
                query = query.where(Event.user_id == actor.id)
            if unit is not None:
                query = query.where(Event.unit_id == unit)
            if node is not None:
                query = query.where(Event.node == node)
            if levels is not None:
                query = query.where(Event.level.in_(list(levels)))
            total = session.scalar(select(func.count()).select_from(query.with_only_columns(Event.id).subquery())) or 0
            rows = session.execute(query.order_by(Event.id.desc()).offset(offset).limit(limit)).all()
            keys = ("id", "at", "level", "kind", "job_id", "frame", "unit_id", "node", "message")
            items = [EventView(user=name, **{key: getattr(event, key) for key in keys}) for event, name in rows]
        return Page(items=items, total=total, offset=offset, limit=limit)

    # ---- steering ----

    def cancel(self, actor: Actor, job_id: int) -> JobDetail:
        """End a job: what runs is stopped, what is done stays."""
        with self._database.begin() as session:
            job = self._changeable(session, actor, job_id)
            if job.state in _ENDED:
                raise ConflictError(f"job {job_id} is {job.state} already")
            self._set(job, JobState.CANCELLED)
            job.finished_at = time.time()
            open_states = [s.value for s in (FrameState.HELD, FrameState.QUEUED, FrameState.RUNNING)]
            session.execute(
                update(Frame).where(Frame.job_id == job.id, Frame.state.in_(open_states)).values(state=FrameState.CANCELLED.value)
            )
            audit(session, actor.id, "job-cancelled", f"{actor.name} cancelled `{job.name}`", job=job.id)
            return self._detail(session, actor, job)

    def pause(self, actor: Actor, job_id: int) -> JobDetail:
        """Begin no more units of a job. Units that run come to their end."""
        with self._database.begin() as session:
            job = self._changeable(session, actor, job_id)
            if job.state not in (JobState.QUEUED, JobState.RUNNING):
                raise ConflictError(f"job {job_id} is {job.state}; only queued and running jobs can be paused")
            self._set(job, JobState.PAUSED)
            audit(session, actor.id, "job-paused", f"{actor.name} paused `{job.name}`", job=job.id)
            return self._detail(session, actor, job)

    def resume(self, actor: Actor, job_id: int) -> JobDetail:
        """Go on with a paused job."""
        with self._database.begin() as session:
            job = self._changeable(session, actor, job_id)
            if job.state != JobState.PAUSED:
                raise ConflictError(f"job {job_id} is {job.state}, not paused")
            self._set(job, JobState.QUEUED if job.started_at is None else JobState.RUNNING)
            audit(session, actor.id, "job-resumed", f"{actor.name} resumed `{job.name}`", job=job.id)
            return self._detail(session, actor, job)

    def approve(self, actor: Actor, job_id: int) -> JobDetail:
        """Let the frames go that wait for approval; also before the first ones are done."""
        with self._database.begin() as session:
            job = self._changeable(session, actor, job_id)
            held = update(Frame).where(Frame.job_id == job.id, Frame.state == FrameState.HELD.value)
            freed = session.execute(held.values(state=FrameState.QUEUED.value))
            if job.state in _ENDED or not rows_changed(freed):
                raise ConflictError(f"job {job_id} has no frames that wait for approval")
            if job.state == JobState.APPROVAL:
                self._set(job, JobState.RUNNING)
            job.version += 1
            audit(session, actor.id, "job-approved", f"{actor.name} approved `{job.name}`", job=job.id)
            return self._detail(session, actor, job)

    def set_priority(self, actor: Actor, job_id: int, priority: int) -> JobDetail:
        """Change a job's priority, −100 to 100. Only administrators go above 50."""
        if not -100 <= priority <= 100:
            raise InvalidError("a priority is a whole number from -100 to 100")
        with self._database.begin() as session:
            job = self._changeable(session, actor, job_id)
            if priority > 50 and not actor.can(Role.ADMIN):
                raise ForbiddenError("priorities above 50 are for administrators")
            job.priority = priority
            job.version += 1
            audit(session, actor.id, "job-priority", f"{actor.name} gave `{job.name}` the priority {priority}", job=job.id)
            return self._detail(session, actor, job)

    def retry(self, actor: Actor, job_id: int, *, frame: int | None = None, unit: int | None = None) -> JobDetail:
        """Try again what has failed or was cancelled: of the whole job, of a frame, or one unit. What is done is not done again.

        Raises:
            ConflictError: Nothing has failed.
        """
        with self._database.begin() as session:
            job = self._changeable(session, actor, job_id)
            failed = [UnitState.FAILED.value, UnitState.CANCELLED.value]
            units = update(Unit).where(Unit.job_id == job.id, Unit.state.in_(failed))
            frames = update(Frame).where(Frame.job_id == job.id, Frame.state.in_([FrameState.FAILED.value, FrameState.CANCELLED.value]))
            if unit is not None:
                row = session.get(Unit, unit)
                if row is None or row.job_id != job.id:
                    raise NotFoundError(f"job {job_id} has no unit {unit}")
                units = units.where(Unit.id == unit)
                frames = frames.where(Frame.id == row.frame_id)
            elif frame is not None:
                which = self._frame(session, job, frame)
                units = units.where(Unit.frame_id == which.id)
                frames = frames.where(Frame.id == which.id)
            again = rows_changed(session.execute(units.values(state=UnitState.QUEUED.value, attempts=0, losses=0, error=None)))
            # What is still under way in those frames starts to count anew as well: its last try may fail for the reason that is gone.
            retried = select(Frame.id).where(Frame.job_id == job.id, Frame.state.in_([FrameState.FAILED.value, FrameState.CANCELLED.value]))
            live = update(Unit).where(Unit.job_id == job.id, Unit.frame_id.in_(retried)).execution_options(synchronize_session=False)
            session.execute(live.where(Unit.state == UnitState.RUNNING.value, Unit.attempts > 1).values(attempts=1))
            session.execute(live.where(Unit.state == UnitState.QUEUED.value).values(attempts=0, losses=0))
            freed = rows_changed(session.execute(frames.values(state=FrameState.QUEUED.value, error=None)))
            if not again and not freed:
                raise ConflictError("nothing here has failed or was cancelled")
            count = select(func.count()).select_from(Unit).where(Unit.job_id == job.id, Unit.state == UnitState.FAILED.value)
            job.units_failed = session.scalar(count) or 0
            count = select(func.count()).select_from(Frame).where(Frame.job_id == job.id, Frame.state == FrameState.FAILED.value)
            job.frames_failed = session.scalar(count) or 0
            if job.state in _ENDED:
                self._set(job, JobState.QUEUED if job.started_at is None else JobState.RUNNING)
                job.finished_at = None
            job.error = None
            job.version += 1
            audit(session, actor.id, "job-retried", f"{actor.name} retried what had failed of `{job.name}`", job=job.id)
            return self._detail(session, actor, job)

    def delete(self, actor: Actor, job_id: int) -> None:
        """Delete a job that has ended, with its films and pictures."""
        with self._database.begin() as session:
            job = self._changeable(session, actor, job_id)
            if job.state not in _ENDED:
                raise ConflictError(f"job {job_id} is {job.state}; cancel it first")
            audit(session, actor.id, "job-deleted", f"{actor.name} deleted `{job.name}` (job {job.id})")
            ids = select(Frame.id).where(Frame.job_id == job.id)
            session.query(Film).where(Film.frame_id.in_(ids)).delete(synchronize_session=False)
            session.query(Unit).where(Unit.job_id == job.id).delete(synchronize_session=False)
            session.query(Frame).where(Frame.job_id == job.id).delete(synchronize_session=False)
            session.query(Event).where(Event.job_id == job.id).delete(synchronize_session=False)
            session.query(JobNeed).where(or_(JobNeed.job_id == job.id, JobNeed.needs_id == job.id)).delete(synchronize_session=False)
            session.delete(job)
        self._store.delete_folder(f"jobs/{job_id}")

    # ---- rights ----

    def _sees(self, actor: Actor, job: Job) -> bool:
        return job.owner_id == actor.id or job.is_shared or actor.can(Role.ADMIN)

    def _visible(self, session: Session, actor: Actor, job_id: int) -> Job:
        job = session.get(Job, job_id) if 0 < job_id < 1 << 31 else None
        if job is None or not self._sees(actor, job):
            raise NotFoundError(f"there is no job {job_id}", is_foreign=job is not None)
        return job

    def _changeable(self, session: Session, actor: Actor, job_id: int) -> Job:
        # The scheduler counts in the same row: it is locked until the transaction ends.
        if 0 < job_id < 1 << 31:
            session.execute(select(Job.id).where(Job.id == job_id).with_for_update())
        job = self._visible(session, actor, job_id)
        actor.need(Role.ARTIST)
        if job.owner_id != actor.id and not actor.can(Role.ADMIN):
            raise ForbiddenError(f"job {job_id} belongs to someone else")
        return job

    def visible_frame(self, session: Session, actor: Actor, job_id: int, number: int) -> tuple[Job, Frame]:
        """Return a job and one of its frames, for a user who may see them.

        Raises:
            NotFoundError: There is no such job or frame.
        """
        job = self._visible(session, actor, job_id)
        return job, self._frame(session, job, number)

    def _frame(self, session: Session, job: Job, number: int) -> Frame:
        small = 0 <= number < 1 << 31
        frame = session.scalar(select(Frame).where(Frame.job_id == job.id, Frame.number == number)) if small else None
        if frame is None:
            raise NotFoundError(f"job {job.id} has no frame {number}")
        return frame

    def _set(self, job: Job, state: JobState) -> None:
        job.state = state.value
        job.version += 1

    def _detail(self, session: Session, actor: Actor, job: Job, owner: str | None = None) -> JobDetail:
        session.flush()
        owner = owner or session.get_one(User, job.owner_id).name
        needs = list(session.scalars(select(JobNeed.needs_id).where(JobNeed.job_id == job.id)))
        may = actor.can(Role.ARTIST) and (job.owner_id == actor.id or actor.can(Role.ADMIN))
        return JobDetail(**_view(job, owner).model_dump(), spec=job.spec, needs=needs, actions=_actions(job) if may else [])


def check_spec(spec: JobSpec | dict[str, Any]) -> JobSpec:
    """Return an order that has been checked.

    Raises:
        InvalidError: It has faults; all of them, one to a line.
    """
    if isinstance(spec, JobSpec):
        return spec
    try:
        return JobSpec.model_validate(spec)
    except ValidationError as e:
        lines = (f"{'.'.join(str(p) for p in fault['loc']) or 'job'}: {fault['msg'].removeprefix('Value error, ')}" for fault in e.errors())
        raise InvalidError("\n".join(lines)) from e


def check_page(offset: int, limit: int) -> tuple[int, int]:
    """Return offset and limit of a page within what is possible."""
    if offset < 0 or offset > 1 << 40 or limit < 0:
        raise InvalidError("`offset` and `limit` are 0 or more")
    return offset, min(limit, MAX_LIMIT)


def rows_changed(result: Any) -> int:  # noqa: ANN401 - a CursorResult, which Session.execute types as Result
    """Return how many rows an update has changed."""
    return int(result.rowcount)


def frame_view(row: Frame) -> FrameView:
    """Return a frame as it is told."""
    keys = (key for key in FrameView.model_fields if key != "outputs")
    outputs = [Output(frame=row.number, **{k: o[k] for k in ("name", "format", "bytes", "sha256")}) for o in row.outputs or []]
    return FrameView(outputs=outputs, **{key: getattr(row, key) for key in keys})


def unit_view(row: Unit, number: int, job_state: str) -> UnitView:
    """Return a unit as it is told."""
    keys = (key for key in UnitView.model_fields if key not in ("frame", "rect", "state"))
    open_states = (UnitState.QUEUED.value, UnitState.RUNNING.value)
    state = UnitState.CANCELLED.value if job_state == JobState.CANCELLED and row.state in open_states else row.state
    rect = (row.x0, row.y0, row.x1, row.y1)
    return UnitView(frame=number, rect=rect, state=state, **{key: getattr(row, key) for key in keys})


def _actions(job: Job) -> list[str]:
    if job.state in _ENDED:
        return ["delete"] if job.state == JobState.DONE else ["retry", "delete"]
    actions = ["cancel", "priority"]
    if job.state in (JobState.QUEUED, JobState.RUNNING):
        actions.append("pause")
    if job.state == JobState.PAUSED:
        actions.append("resume")
    if job.state == JobState.APPROVAL:
        actions.append("approve")
    if job.units_failed or job.frames_failed:
        actions.append("retry")
    return actions


def _view(job: Job, owner: str) -> JobView:
    end = None
    if job.state == JobState.RUNNING and job.started_at is not None and job.progress > 0.02:
        end = job.started_at + (time.time() - job.started_at) / job.progress
    keys = (key for key in JobView.model_fields if key not in ("owner", "estimated_end_at"))
    return JobView(owner=owner, estimated_end_at=end, **{key: getattr(job, key) for key in keys})
