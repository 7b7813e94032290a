"""The tables of a farm's database: SQLite by default, PostgreSQL by URL. `migrations/` makes them.

Times are seconds since 1970 in UTC. States are the texts of `states`. Rows of films and units are what a restart needs: a unit that is
`done` has its film in the store, or in a film that has been merged from it.
"""

from __future__ import annotations

import time
from typing import Any

from sqlalchemy import JSON, BigInteger, Boolean, Float, ForeignKey, Index, Integer, MetaData, String, Text, UniqueConstraint
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column

from etendue.farm.states import FrameState, JobState, NodeState, Role, UnitState

# Row numbers that SQLite counts by itself are plain integers there.
BigId = BigInteger().with_variant(Integer, "sqlite")


class Base(DeclarativeBase):
    """All tables."""

    # Constraints have names, so that migrations can drop them.
    metadata = MetaData(
        naming_convention={
            "ix": "ix_%(column_0_label)s",
            "uq": "uq_%(table_name)s_%(column_0_N_name)s",
            "fk": "fk_%(table_name)s_%(column_0_name)s_%(referred_table_name)s",
            "pk": "pk_%(table_name)s",
        }
    )
    type_annotation_map = {dict[str, Any]: JSON(none_as_null=True), list[Any]: JSON(none_as_null=True)}  # noqa: RUF012 - as SQLAlchemy declares it


class User(Base):
    """Someone who may use the farm."""

    __tablename__ = "users"

    id: Mapped[int] = mapped_column(primary_key=True)
    name: Mapped[str] = mapped_column(String(64), unique=True)
    role: Mapped[str] = mapped_column(String(16), default=Role.ARTIST.value)
    password_hash: Mapped[str | None] = mapped_column(String(256))
    """scrypt with its parameters and salt, see `accounts`; None: no sign-in by password."""
    share: Mapped[float] = mapped_column(Float, default=1.0)
    """Weight among users whose jobs have the same priority."""
    max_jobs: Mapped[int | None] = mapped_column(Integer)
    """Most jobs that have not ended; None: no limit."""
    max_bytes: Mapped[int | None] = mapped_column(BigInteger)
    """Most bytes of packages; None: no limit."""
    max_core_secs: Mapped[float | None] = mapped_column(Float)
    """Most core-seconds in all; None: no limit."""
    is_active: Mapped[bool] = mapped_column(Boolean, default=True)
    created_at: Mapped[float] = mapped_column(Float, default=time.time)


class Token(Base):
    """A key for the API. The text itself is shown once and not kept."""

    __tablename__ = "tokens"

    id: Mapped[int] = mapped_column(primary_key=True)
    user_id: Mapped[int] = mapped_column(ForeignKey("users.id", ondelete="CASCADE"), index=True)
    name: Mapped[str] = mapped_column(String(64))
    hash: Mapped[str] = mapped_column(String(64), unique=True)
    """SHA-256 of the token, which has 256 random bits of its own."""
    created_at: Mapped[float] = mapped_column(Float, default=time.time)
    expires_at: Mapped[float | None] = mapped_column(Float)
    used_at: Mapped[float | None] = mapped_column(Float)


class WebSession(Base):
    """A browser that is signed in."""

    __tablename__ = "web_sessions"

    hash: Mapped[str] = mapped_column(String(64), primary_key=True)
    """SHA-256 of the cookie."""
    user_id: Mapped[int] = mapped_column(ForeignKey("users.id", ondelete="CASCADE"), index=True)
    csrf: Mapped[str] = mapped_column(String(64))
    created_at: Mapped[float] = mapped_column(Float, default=time.time)
    expires_at: Mapped[float] = mapped_column(Float)


class Package(Base):
    """A scene with all its files, named by their content."""

    __tablename__ = "packages"

    id: Mapped[str] = mapped_column(String(64), primary_key=True)
    """SHA-256 of the list of files and their hashes, in hexadecimal."""
    scene: Mapped[str] = mapped_column(String(1024))
    """The scene file that jobs take unless they name another."""
    bytes: Mapped[int] = mapped_column(BigInteger)
    """Bytes of all files, unpacked."""
    packed_bytes: Mapped[int] = mapped_column(BigInteger)
    files: Mapped[list[Any]]
    """[path, bytes, SHA-256] of each."""
    info: Mapped[dict[str, Any]]
    """What is in the scene, and `losses` and `warnings` of reading it."""
    created_at: Mapped[float] = mapped_column(Float, default=time.time)


class PackageUser(Base):
    """Who has uploaded a package and so may use it. Others who know its name may not."""

    __tablename__ = "package_users"

    package_id: Mapped[str] = mapped_column(ForeignKey("packages.id", ondelete="CASCADE"), primary_key=True)
    user_id: Mapped[int] = mapped_column(ForeignKey("users.id", ondelete="CASCADE"), primary_key=True, index=True)
    name: Mapped[str] = mapped_column(String(256))
    created_at: Mapped[float] = mapped_column(Float, default=time.time)


class Job(Base):
    """One order: a still or the frames of an animation."""

    __tablename__ = "jobs"
    __table_args__ = (Index("ix_jobs_state_priority", "state", "priority"), Index("ix_jobs_owner_state", "owner_id", "state"))

    id: Mapped[int] = mapped_column(primary_key=True)
    owner_id: Mapped[int] = mapped_column(ForeignKey("users.id"))
    name: Mapped[str] = mapped_column(String(256), index=True)
    kind: Mapped[str] = mapped_column(String(16), default="still")
    """`still` or `animation`."""
    package_id: Mapped[str] = mapped_column(ForeignKey("packages.id"))
    scene: Mapped[str] = mapped_column(String(1024))
    spec: Mapped[dict[str, Any]]
    """The order as it came: a `JobSpec`."""
    state: Mapped[str] = mapped_column(String(16), default=JobState.QUEUED.value)
    priority: Mapped[int] = mapped_column(Integer, default=0)
    is_shared: Mapped[bool] = mapped_column(Boolean, default=False)
    """Whether everyone may look at it."""
    error: Mapped[str | None] = mapped_column(Text)
    frames_total: Mapped[int] = mapped_column(Integer, default=0)
    frames_done: Mapped[int] = mapped_column(Integer, default=0)
    frames_failed: Mapped[int] = mapped_column(Integer, default=0)
    units_total: Mapped[int] = mapped_column(Integer, default=0)
    units_done: Mapped[int] = mapped_column(Integer, default=0)
    units_failed: Mapped[int] = mapped_column(Integer, default=0)
    progress: Mapped[float] = mapped_column(Float, default=0.0)
    """Share of the work that is done, 0 to 1."""
    core_secs: Mapped[float] = mapped_column(Float, default=0.0)
    cost: Mapped[float] = mapped_column(Float, default=0.0)
    """In the farm's currency, by the price of each node's cores."""
    estimated_core_secs: Mapped[float | None] = mapped_column(Float)
    """Of the whole job, from its probes; None until the first has ended."""
    estimated_cost: Mapped[float | None] = mapped_column(Float)
    created_at: Mapped[float] = mapped_column(Float, default=time.time, index=True)
    started_at: Mapped[float | None] = mapped_column(Float)
    finished_at: Mapped[float | None] = mapped_column(Float)
    version: Mapped[int] = mapped_column(Integer, default=0)
    """Grows with each change that a viewer would show."""


class JobNeed(Base):
    """A job that another one waits for."""

    __tablename__ = "job_needs"

    job_id: Mapped[int] = mapped_column(ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True)
    needs_id: Mapped[int] = mapped_column(ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True, index=True)


class Frame(Base):
    """A picture of a job."""

    __tablename__ = "frames"
    __table_args__ = (UniqueConstraint("job_id", "number"), Index("ix_frames_job_state", "job_id", "state"))

    id: Mapped[int] = mapped_column(primary_key=True)
    job_id: Mapped[int] = mapped_column(ForeignKey("jobs.id", ondelete="CASCADE"))
    number: Mapped[int] = mapped_column(Integer)
    """Number in the animation; 0 for a still."""
    clock: Mapped[float] = mapped_column(Float, default=0.0)
    """`clock` of a POV-Ray scene."""
    rank: Mapped[int] = mapped_column(BigInteger, default=0)
    """Frames of a job are probed in this order."""
    has_probe: Mapped[bool] = mapped_column(Boolean, default=False)
    """Whether its first unit, the probe, is there. The scheduler makes some at a time."""
    state: Mapped[str] = mapped_column(String(16), default=FrameState.QUEUED.value)
    error: Mapped[str | None] = mapped_column(Text)
    width: Mapped[int | None] = mapped_column(Integer)
    height: Mapped[int | None] = mapped_column(Integer)
    crop: Mapped[list[Any] | None]
    """x0, y0, x1, y1 of the pixels that are rendered."""
    spp_target: Mapped[int | None] = mapped_column(Integer)
    """Samples per pixel that are planned; None where noise, time or cost decides."""
    spp_done: Mapped[int] = mapped_column(Integer, default=0)
    """Samples per pixel that every pixel has."""
    is_adaptive: Mapped[bool] = mapped_column(Boolean, default=False)
    """Whether units must have all samples."""
    is_whole: Mapped[bool] = mapped_column(Boolean, default=False)
    """Whether units must be the whole picture."""
    round: Mapped[int] = mapped_column(Integer, default=0)
    """The round of samples that is in work."""
    spp_planned: Mapped[int] = mapped_column(Integer, default=0)
    """Samples per pixel for which there are units."""
    relative_error: Mapped[float | None] = mapped_column(Float)
    secs_per_sample: Mapped[float | None] = mapped_column(Float)
    """Core-seconds for a sample of one pixel, from the probe."""
    estimated_core_secs: Mapped[float | None] = mapped_column(Float)
    """Of the whole frame, from the probe."""
    load_secs: Mapped[float | None] = mapped_column(Float)
    """Seconds from the file to the first sample, from the probe."""
    units_total: Mapped[int] = mapped_column(Integer, default=0)
    units_done: Mapped[int] = mapped_column(Integer, default=0)
    core_secs: Mapped[float] = mapped_column(Float, default=0.0)
    preview: Mapped[str | None] = mapped_column(String(512))
    """Name in the store of the newest preview, a PNG."""
    preview_version: Mapped[int] = mapped_column(Integer, default=0)
    film: Mapped[str | None] = mapped_column(String(512))
    """Name in the store of the whole film, when the frame is done."""
    outputs: Mapped[list[Any] | None]
    """Pictures when the frame is done: objects of `name` (what a user sees), `path` (in the store), `bytes`, `sha256`."""
    started_at: Mapped[float | None] = mapped_column(Float)
    finished_at: Mapped[float | None] = mapped_column(Float)


class Film(Base):
    """A film in the store that is not yet merged into a larger one. Its frame is the sum of all of its films."""

    __tablename__ = "films"
    __table_args__ = (UniqueConstraint("frame_id", "round", "level", "slot"),)

    id: Mapped[int] = mapped_column(BigId, primary_key=True, autoincrement=True)
    frame_id: Mapped[int] = mapped_column(ForeignKey("frames.id", ondelete="CASCADE"))
    round: Mapped[int] = mapped_column(Integer)
    level: Mapped[int] = mapped_column(Integer)
    """0: of a unit; 1: the sum of up to `merge_fan_in` of those; and so on."""
    slot: Mapped[int] = mapped_column(Integer)
    """Place among the films of the level: those of level n + 1 are the places divided by `merge_fan_in`."""
    path: Mapped[str] = mapped_column(String(512))
    bytes: Mapped[int] = mapped_column(BigInteger, default=0)


class Unit(Base):
    """What a worker does in one go: a frame × some pixels × some samples."""

    __tablename__ = "units"
    __table_args__ = (Index("ix_units_job_state", "job_id", "state", "rank"), Index("ix_units_frame", "frame_id", "state"))

    id: Mapped[int] = mapped_column(BigId, primary_key=True, autoincrement=True)
    job_id: Mapped[int] = mapped_column(ForeignKey("jobs.id", ondelete="CASCADE"))
    frame_id: Mapped[int] = mapped_column(ForeignKey("frames.id", ondelete="CASCADE"))
    kind: Mapped[str] = mapped_column(String(16))
    rank: Mapped[int] = mapped_column(BigInteger, default=0)
    """Units of a job are begun in this order."""
    round: Mapped[int] = mapped_column(Integer, default=0)
    slot: Mapped[int] = mapped_column(Integer, default=0)
    """Place of its film among those of level 0."""
    x0: Mapped[int] = mapped_column(Integer, default=0)
    y0: Mapped[int] = mapped_column(Integer, default=0)
    x1: Mapped[int] = mapped_column(Integer, default=0)
    y1: Mapped[int] = mapped_column(Integer, default=0)
    begin: Mapped[int] = mapped_column(Integer, default=0)
    end: Mapped[int] = mapped_column(Integer, default=0)
    state: Mapped[str] = mapped_column(String(16), default=UnitState.QUEUED.value)
    attempts: Mapped[int] = mapped_column(Integer, default=0)
    """How often it has been begun."""
    losses: Mapped[int] = mapped_column(Integer, default=0)
    """How often it was begun and lost with its worker or node."""
    estimated_secs: Mapped[float | None] = mapped_column(Float)
    node: Mapped[str | None] = mapped_column(String(64))
    started_at: Mapped[float | None] = mapped_column(Float)
    finished_at: Mapped[float | None] = mapped_column(Float)
    secs: Mapped[float | None] = mapped_column(Float)
    """Wall time of the attempt that counts."""
    core_secs: Mapped[float | None] = mapped_column(Float)
    error: Mapped[str | None] = mapped_column(Text)
    log: Mapped[str | None] = mapped_column(Text)
    """What the renderer said."""


class Node(Base):
    """A machine, or a part of one, that renders."""

    __tablename__ = "nodes"

    id: Mapped[str] = mapped_column(String(64), primary_key=True)
    """Ray's name for it."""
    name: Mapped[str] = mapped_column(String(256))
    address: Mapped[str] = mapped_column(String(64), default="")
    state: Mapped[str] = mapped_column(String(16), default=NodeState.ALIVE.value)
    cores: Mapped[float] = mapped_column(Float, default=0.0)
    memory_bytes: Mapped[int] = mapped_column(BigInteger, default=0)
    memory_used_bytes: Mapped[int] = mapped_column(BigInteger, default=0)
    load: Mapped[float] = mapped_column(Float, default=0.0)
    """Mean number of running threads of the machine in the last minute."""
    workers: Mapped[int] = mapped_column(Integer, default=0)
    running: Mapped[int] = mapped_column(Integer, default=0)
    """Units that it is doing."""
    units_done: Mapped[int] = mapped_column(Integer, default=0)
    core_secs: Mapped[float] = mapped_column(Float, default=0.0)
    price: Mapped[float] = mapped_column(Float, default=0.0)
    """Of a core and hour."""
    first_seen_at: Mapped[float] = mapped_column(Float, default=time.time)
    seen_at: Mapped[float] = mapped_column(Float, default=time.time)


class Event(Base):
    """What happened: the farm's log. Never holds passwords or tokens."""

    __tablename__ = "events"

    id: Mapped[int] = mapped_column(BigId, primary_key=True, autoincrement=True)
    at: Mapped[float] = mapped_column(Float, default=time.time, index=True)
    level: Mapped[str] = mapped_column(String(8), default="info")
    """`info`, `warning`, `error`, or `audit`: what people did and what was refused."""
    kind: Mapped[str] = mapped_column(String(32))
    """One word for programs, such as `job-submitted`, `unit-lost`, `package-refused`."""
    user_id: Mapped[int | None] = mapped_column(ForeignKey("users.id", ondelete="SET NULL"))
    job_id: Mapped[int | None] = mapped_column(ForeignKey("jobs.id", ondelete="CASCADE"), index=True)
    frame: Mapped[int | None] = mapped_column(Integer)
    unit_id: Mapped[int | None] = mapped_column(BigInteger)
    node: Mapped[str | None] = mapped_column(String(64), index=True)
    message: Mapped[str] = mapped_column(Text)


class Setting(Base):
    """A value that all processes of the farm share, such as which scheduler is at work."""

    __tablename__ = "settings"

    key: Mapped[str] = mapped_column(String(64), primary_key=True)
    value: Mapped[dict[str, Any]]
