"""The states of jobs, frames, units, films and nodes, and the roles of users.

All are text in the database. A job goes `queued` → `running` → `done`; `waiting` is for other jobs, `approval` for a person.
"""

from __future__ import annotations

from enum import Enum


class Text(str, Enum):
    """An enumeration whose members are, and print as, their text."""

    def __str__(self) -> str:
        return str(self.value)


class JobState(Text):
    """What a job is doing."""

    WAITING = "waiting"
    """Another job has to end first."""
    QUEUED = "queued"
    """No unit has begun."""
    RUNNING = "running"
    """Units are being done, or will be as soon as a node is free."""
    PAUSED = "paused"
    """Someone has paused it; units that run come to their end."""
    APPROVAL = "approval"
    """The first frames are done; the rest waits for `approve`."""
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


JOB_ENDED = (JobState.DONE, JobState.FAILED, JobState.CANCELLED)
"""States that a job leaves only by `retry`."""


class FrameState(Text):
    """What a frame is doing."""

    HELD = "held"
    """It waits for the approval of others."""
    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


class UnitKind(Text):
    """What a unit makes."""

    PROBE = "probe"
    """A small picture of the frame: what the frame costs, and its first preview. Not part of the film."""
    RENDER = "render"
    """A film: some pixels × some samples."""


class UnitState(Text):
    """What a unit is doing."""

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


class NodeState(Text):
    """Whether a node works."""

    ALIVE = "alive"
    DEAD = "dead"


class Role(Text):
    """What a user may do: each role may do what those before it may."""

    VIEWER = "viewer"
    """Sees all jobs of their own and those shared with everyone; changes nothing."""
    ARTIST = "artist"
    """Uploads, submits, and changes jobs of their own."""
    ADMIN = "admin"
    """Sees and changes everything, users as well."""
