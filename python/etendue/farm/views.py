"""What the service tells: plain values for the REST API, the console and the command line."""

from __future__ import annotations

from typing import Any, Generic, TypeVar

from pydantic import BaseModel, ConfigDict

Item = TypeVar("Item")


class View(BaseModel):
    """Made from a row of the database or from keywords."""

    model_config = ConfigDict(from_attributes=True)


class Page(View, Generic[Item]):
    """Some of a list."""

    items: list[Item]
    total: int
    """Number of all that fit the filter."""
    offset: int
    limit: int


class JobView(View):
    """A job in a list. Fields as in `models.Job`."""

    id: int
    name: str
    owner: str
    kind: str
    package_id: str
    scene: str
    state: str
    priority: int
    is_shared: bool
    error: str | None
    frames_total: int
    frames_done: int
    frames_failed: int
    units_total: int
    units_done: int
    units_failed: int
    progress: float
    core_secs: float
    cost: float
    estimated_core_secs: float | None
    estimated_cost: float | None
    estimated_end_at: float | None = None
    """When it will end, if it goes on as it does; None where that is not known."""
    created_at: float
    started_at: float | None
    finished_at: float | None
    version: int


class JobDetail(JobView):
    """A job with its order."""

    spec: dict[str, Any]
    needs: list[int]
    actions: list[str]
    """What the user may do to it now: `cancel`, `pause`, `resume`, `approve`, `priority`, `retry`, `delete`."""


class Output(View):
    """A finished file of a frame."""

    name: str
    frame: int
    format: str
    bytes: int
    sha256: str


class FrameView(View):
    """A frame. Fields as in `models.Frame`."""

    number: int
    clock: float
    state: str
    error: str | None
    width: int | None
    height: int | None
    spp_target: int | None
    spp_done: int
    relative_error: float | None
    units_total: int
    units_done: int
    core_secs: float
    preview_version: int
    """0: there is no preview yet."""
    started_at: float | None
    finished_at: float | None
    outputs: list[Output]


class UnitView(View):
    """A unit. Fields as in `models.Unit`."""

    id: int
    job_id: int
    frame: int
    kind: str
    rect: tuple[int, int, int, int]
    begin: int
    end: int
    state: str
    attempts: int
    losses: int
    node: str | None
    estimated_secs: float | None
    secs: float | None
    core_secs: float | None
    started_at: float | None
    finished_at: float | None
    error: str | None
    log: str | None


class NodeView(View):
    """A node. Fields as in `models.Node`."""

    id: str
    name: str
    address: str
    state: str
    cores: float
    memory_bytes: int
    memory_used_bytes: int
    load: float
    workers: int
    running: int
    units_done: int
    core_secs: float
    price: float
    first_seen_at: float
    seen_at: float


class EventView(View):
    """A line of the log."""

    id: int
    at: float
    level: str
    kind: str
    user: str | None
    job_id: int | None
    frame: int | None
    unit_id: int | None
    node: str | None
    message: str


class PackageView(View):
    """A package. `info` has what `etendue.Scene.info` tells, with `losses` and `warnings`: lists of [file, line, column, …]."""

    id: str
    name: str
    scene: str
    bytes: int
    packed_bytes: int
    files: list[tuple[str, int, str]]
    info: dict[str, Any]
    created_at: float


class UserView(View):
    """A user. Fields as in `models.User`; no hash."""

    id: int
    name: str
    role: str
    share: float
    max_jobs: int | None
    max_bytes: int | None
    max_core_secs: float | None
    is_active: bool
    created_at: float


class TokenView(View):
    """A token without its text."""

    id: int
    name: str
    created_at: float
    expires_at: float | None
    used_at: float | None


class CostRow(View):
    """What was spent on something."""

    key: str
    """Name of the user, job or node, or the day as YYYY-MM-DD."""
    jobs: int
    units: int
    core_secs: float
    cost: float


class FarmStatus(View):
    """The farm at a glance."""

    is_up: bool
    """Whether a scheduler is at work."""
    nodes_alive: int
    cores: float
    jobs: dict[str, int]
    """Number of jobs in each state."""
    units_queued: int
    units_running: int
    currency: str
    version: str


class Picture(View):
    """A picture as a browser takes it."""

    data: bytes
    media_type: str
    version: int
    """Grows as the picture gets better: a client that has it need not ask again."""
