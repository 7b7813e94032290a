"""What the scheduler sends to workers, and what comes back. Plain data: it goes through Ray."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from etendue.farm.planning import Rect
from etendue.farm.spec import Setting


@dataclass(frozen=True)
class SceneOrder:
    """A frame's scene with its settings: what a worker prepares once and keeps for the next unit."""

    package: str
    scene: str
    settings: tuple[tuple[str, Setting | None], ...]
    crop: Rect | None
    aovs: tuple[str, ...]
    defines: tuple[tuple[str, Setting], ...]
    variant: str | None
    gltf_scene: str | None
    gltf_animation: str | None
    clock: float
    number: int
    final: int
    fixed_spp: bool
    command: str = "render"
    bake: tuple[tuple[str, object], ...] = ()
    """How to bake: `BakeSpec.preparation`."""


@dataclass(frozen=True)
class ProbeOrder:
    """Find out what a frame costs, and make its first preview."""

    key: str
    """Names the task among all of the farm."""
    scene: SceneOrder
    preview: str
    """Name in the store for the preview."""


@dataclass(frozen=True)
class RenderOrder:
    """Render a unit."""

    key: str
    scene: SceneOrder
    rect: Rect
    begin: int
    end: int
    film: str
    """Name in the store for the film."""


@dataclass(frozen=True)
class MergeOrder:
    """Merge films, or the parts of a bake or photon map, into a larger one."""

    key: str
    films: tuple[str, ...]
    film: str
    memory_mib: int
    """Of a photon map: what it may take in use; where it has more, it is thinned."""


@dataclass(frozen=True)
class FinishOrder:
    """Merge a frame's last films into the whole one; where the samples suffice, make the pictures."""

    key: str
    films: tuple[str, ...]
    film: str
    preview: str
    outputs: tuple[tuple[str, str, str], ...]
    """(format, name for the user, name in the store) of each picture."""
    exposure: float
    tonemap: str
    is_last: bool
    """Whether no more samples will come."""
    variance: bool
    """Whether pictures have the variance as a layer."""
    samples: bool
    """Whether pictures have the number of samples as a layer."""
    noise: float | None
    """Relative error at which no more samples are needed."""
    memory_mib: int
    scene: SceneOrder | None = None
    """Of a bake: what its files are made of beside the light."""
    delivery: tuple[tuple[str, object], ...] = ()
    """Of a bake: the rest of its `BakeSpec`."""


Order = ProbeOrder | RenderOrder | MergeOrder | FinishOrder


@dataclass(frozen=True)
class Probed:
    """What a probe has found."""

    width: int
    height: int
    crop: Rect
    spp: int
    is_adaptive: bool
    is_whole: bool
    secs_per_sample: float
    """Core-seconds for a sample of one pixel."""
    load_secs: float
    picture: NDArray[np.float16] | None = None
    """The picture that the probe has made of the crop, small: shown where no unit is done yet."""


@dataclass(frozen=True)
class Rendered:
    """What became of a unit."""

    bytes: int
    work: int
    tile: tuple[int, int, int, NDArray[np.float16]] | None
    """First column, first row and step of a small picture of the unit, and its pixels: for the preview."""


@dataclass(frozen=True)
class Merged:
    """What became of a merge."""

    bytes: int


@dataclass(frozen=True)
class Finished:
    """What became of a frame."""

    bytes: int
    spp: int
    relative_error: float | None
    is_done: bool
    """Whether the pictures were made; else more samples are needed."""
    outputs: tuple[dict[str, str | int], ...] = ()
    notes: str = ""
    """Sentences for the log."""


@dataclass(frozen=True)
class Done:
    """A task's end on a worker."""

    key: str
    result: Probed | Rendered | Merged | Finished | None
    """None where it was cancelled, or has failed."""
    secs: float = 0.0
    core_secs: float = 0.0
    error: str | None = None
    is_final: bool = False
    """Whether another attempt would fail in the same way: a fault of the scene or of the settings."""
    log: str = ""


@dataclass(frozen=True)
class WorkerStats:
    """How a worker's machine is."""

    load: float = 0.0
    memory_bytes: int = 0
    memory_used_bytes: int = 0


@dataclass(frozen=True)
class WorkerSetup:
    """What a worker needs to know."""

    threads: int
    cache: str
    """Folder for unpacked packages; empty: the user's."""
    store_url: str
    store_options: dict[str, str | bool | int] = field(default_factory=dict)
    limits: dict[str, float] = field(default_factory=dict)
