"""Which unit comes next: priorities, shares of users, and workers that keep their scenes."""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass, field
from itertools import islice

from etendue.farm.spec import JobSpec

LOOK_AHEAD = 256
"""Units of a job that are looked at for a worker."""


@dataclass(frozen=True)
class Waiting:
    """A unit that may begin."""

    unit: int
    frame: int
    kind: str


@dataclass
class ActiveJob:
    """A job whose units may begin."""

    id: int
    owner: int
    share: float
    priority: int
    spec: JobSpec
    package: str
    scene: str
    name: str
    version: int = -1
    """Of the row in the database, when it was last looked at."""
    waiting: deque[Waiting] = field(default_factory=deque)
    is_exhausted: bool = False
    """Whether the database has no more waiting units."""


def order_jobs(jobs: list[ActiveJob], running: Counter[int]) -> list[ActiveJob]:
    """Return jobs in the order in which they get the next worker.

    Higher priorities first; among equals the user who has the fewest running cores for their share; then the older job.

    Args:
        jobs: Jobs with waiting units.
        running: Running cores of each user.
    """
    return sorted(jobs, key=lambda job: (-job.priority, running[job.owner] / job.share, job.id))


def pick(waiting: deque[Waiting], last_frame: int | None, busy_frames: Counter[int]) -> Waiting:
    """Take the unit of a job that suits a worker best.

    That is one of the frame whose scene it has, else of a frame on which nobody works, else the first.

    Args:
        waiting: The job's units in their order, at least one; the one that is returned is taken out.
        last_frame: The frame that the worker did last.
        busy_frames: Number of workers on each frame.
    """
    best = 0
    if waiting[0].kind == "render":
        ahead = list(islice(waiting, LOOK_AHEAD))
        own = next((i for i, unit in enumerate(ahead) if unit.frame == last_frame), None)
        free = next((i for i, unit in enumerate(ahead) if not busy_frames[unit.frame]), None)
        best = own if own is not None else free if free is not None else 0
    unit = waiting[best]
    del waiting[best]
    return unit
