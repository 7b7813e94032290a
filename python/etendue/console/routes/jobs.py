"""Jobs: submitting, listing, steering, and what they consist of."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Path, Query
from pydantic import Field

from etendue.console.auth import TheFarm, Who
from etendue.console.routes.parameters import PLAIN, FrameNumber, JobId, Limit, Offset, Time, refusals
from etendue.console.routes.session import Order
from etendue.farm.errors import FarmError
from etendue.farm.jobs import JobFilter
from etendue.farm.spec import JobSpec
from etendue.farm.states import FrameState, JobState, UnitState
from etendue.farm.views import EventView, FrameView, JobDetail, JobView, Page, UnitView

router = APIRouter(tags=["jobs"])

Plain = Annotated[str | None, Query(max_length=200, pattern=PLAIN)]
Action = Literal["cancel", "pause", "resume", "approve", "retry", "delete"]
Orders = Literal["created", "name", "state", "priority", "progress", "started", "finished", "cost", "frames", "owner", "id"]
Level = Literal["info", "warning", "error", "audit"]


class Priority(Order):
    """A new priority."""

    priority: Annotated[int, Field(ge=-100, le=100)]


class Batch(Order):
    """What to do with several jobs."""

    action: Action
    jobs: Annotated[list[Annotated[int, Field(ge=1, le=(1 << 31) - 1)]], Field(min_length=1, max_length=1000)]


class BatchFault(Order):
    """A job to which it could not be done."""

    job: int
    code: str
    message: str


class BatchResult(Order):
    """What came of it."""

    done: list[int]
    refused: list[BatchFault]


@router.get("/jobs", responses=refusals())
def jobs(
    who: Who,
    farm: TheFarm,
    state: Annotated[list[JobState] | None, Query(description="Only in these states.")] = None,
    owner: Plain = None,
    q: Annotated[str | None, Query(max_length=200, pattern=PLAIN, description="Part of name or scene.")] = None,
    package: Annotated[str | None, Query(pattern="^[0-9a-f]{64}$")] = None,
    created_after: Time = None,
    created_before: Time = None,
    order: Annotated[Orders, Query(description="What to sort by.")] = "created",
    down: Annotated[bool, Query(description="Largest or latest first.")] = True,
    offset: Offset = 0,
    limit: Limit = 100,
) -> Page[JobView]:
    """List jobs that the user may see."""
    wanted = JobFilter(
        states=state,
        owner=owner,
        text=q,
        package=package,
        created_after=created_after,
        created_before=created_before,
        order=f"-{order}" if down else order,
    )
    return farm.jobs.find(who, wanted, offset=offset, limit=limit)


@router.post("/jobs", status_code=201, responses=refusals(403, 404, 409))
def submit(who: Who, farm: TheFarm, spec: JobSpec) -> JobDetail:
    """Submit a job for an uploaded package."""
    return farm.jobs.submit(who, spec)


@router.post("/jobs/batch", responses=refusals(403))
def batch(who: Who, farm: TheFarm, given: Batch) -> BatchResult:
    """Do the same to several jobs; tells for each whether it could be done."""
    result = BatchResult(done=[], refused=[])
    for job in dict.fromkeys(given.jobs):
        try:
            _act(farm, who, job, given.action)
            result.done.append(job)
        except FarmError as e:
            result.refused.append(BatchFault(job=job, code=e.code, message=str(e)))
    return result


@router.get("/jobs/{job_id}", responses=refusals(404))
def job(who: Who, farm: TheFarm, job_id: JobId) -> JobDetail:
    """Show a job."""
    return farm.jobs.get(who, job_id)


@router.delete("/jobs/{job_id}", status_code=204, responses=refusals(403, 404, 409))
def delete(who: Who, farm: TheFarm, job_id: JobId) -> None:
    """Delete a job that has ended, with its pictures."""
    farm.jobs.delete(who, job_id)


@router.put("/jobs/{job_id}/priority", responses=refusals(403, 404, 409))
def set_priority(who: Who, farm: TheFarm, job_id: JobId, given: Priority) -> JobDetail:
    """Change a job's priority."""
    return farm.jobs.set_priority(who, job_id, given.priority)


@router.post("/jobs/{job_id}/frames/{frame}/retry", responses=refusals(403, 404, 409))
def retry_frame(who: Who, farm: TheFarm, job_id: JobId, frame: FrameNumber) -> JobDetail:
    """Try a frame again that has failed or was cancelled."""
    return farm.jobs.retry(who, job_id, frame=frame)


@router.post("/jobs/{job_id}/units/{unit}/retry", responses=refusals(403, 404, 409))
def retry_unit(who: Who, farm: TheFarm, job_id: JobId, unit: Annotated[int, Path(ge=1, le=(1 << 53))]) -> JobDetail:
    """Try a unit again that has failed or was cancelled."""
    return farm.jobs.retry(who, job_id, unit=unit)


@router.post("/jobs/{job_id}/{action}", responses=refusals(403, 404, 409))
def act(who: Who, farm: TheFarm, job_id: JobId, action: Literal["cancel", "pause", "resume", "approve", "retry"]) -> JobDetail:
    """Cancel, pause, resume, approve or retry a job."""
    found = _act(farm, who, job_id, action)
    assert found is not None
    return found


def _act(farm: TheFarm, who: Who, job_id: int, action: Action) -> JobDetail | None:
    match action:
        case "cancel":
            return farm.jobs.cancel(who, job_id)
        case "pause":
            return farm.jobs.pause(who, job_id)
        case "resume":
            return farm.jobs.resume(who, job_id)
        case "approve":
            return farm.jobs.approve(who, job_id)
        case "retry":
            return farm.jobs.retry(who, job_id)
        case "delete":
            farm.jobs.delete(who, job_id)
            return None


@router.get("/jobs/{job_id}/frames", responses=refusals(404))
def frames(
    who: Who,
    farm: TheFarm,
    job_id: JobId,
    state: Annotated[list[FrameState] | None, Query()] = None,
    offset: Offset = 0,
    limit: Limit = 100,
) -> Page[FrameView]:
    """List a job's frames."""
    return farm.jobs.frames(who, job_id, states=state, offset=offset, limit=limit)


@router.get("/jobs/{job_id}/units", responses=refusals(404))
def units(
    who: Who,
    farm: TheFarm,
    job_id: JobId,
    frame: Annotated[int | None, Query(ge=0, le=(1 << 31) - 1)] = None,
    state: Annotated[list[UnitState] | None, Query()] = None,
    offset: Offset = 0,
    limit: Limit = 100,
) -> Page[UnitView]:
    """List a job's units, with their errors and logs."""
    return farm.jobs.units(who, job_id, frame=frame, states=state, offset=offset, limit=limit)


@router.get("/log", responses=refusals(404))
def log(
    who: Who,
    farm: TheFarm,
    job: Annotated[int | None, Query(ge=1, le=(1 << 31) - 1)] = None,
    unit: Annotated[int | None, Query(ge=1, le=1 << 53)] = None,
    node: Annotated[str | None, Query(max_length=64, pattern=PLAIN)] = None,
    level: Annotated[list[Level] | None, Query()] = None,
    after: Annotated[int, Query(ge=0, le=1 << 53)] = 0,
    offset: Offset = 0,
    limit: Limit = 100,
) -> Page[EventView]:
    """Show the log, newest first: of a job, or one's own lines; administrators see all."""
    return farm.jobs.log(who, job=job, unit=unit, node=node, levels=level, after=after, offset=offset, limit=limit)
