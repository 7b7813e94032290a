# The compiled module (crates/py). Use the package `etendue`, which wraps it.

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

_Array = NDArray[np.float32]
_Layers = dict[str, _Array]

__version__: str

@final
class Status:
    """How far a rendering is."""

    @property
    def fraction(self) -> float:
        """Done share from 0 to 1."""
    @property
    def spp_done(self) -> int:
        """Samples per pixel that are complete everywhere."""
    @property
    def spp_target(self) -> int | None:
        """Samples per pixel that are planned; None where time or noise decides."""
    @property
    def elapsed_secs(self) -> float:
        """Seconds since the start."""
    @property
    def relative_error(self) -> float | None:
        """Estimated relative error; None until it is known."""

@final
class Scene:
    def info(self) -> dict[str, Any]: ...
    def losses(self) -> list[tuple[str, int | None, int | None, str, str]]: ...
    def warnings(self) -> list[tuple[str, int | None, int | None, str, str]]: ...
    def prepare(
        self, settings: Mapping[str, object], crop: Sequence[int] | None, threads: int, aovs: Sequence[str], fixed_spp: bool
    ) -> Prepared: ...
    def prepare_bake(self, settings: Mapping[str, object], threads: int, options: Mapping[str, object]) -> PreparedBake: ...
    def prepare_photons(self, settings: Mapping[str, object], threads: int) -> PreparedPhotons: ...
    def render(
        self,
        settings: Mapping[str, object],
        *,
        crop: Sequence[int] | None,
        time: float | None,
        noise: float | None,
        threads: int,
        aovs: Sequence[str],
        progress: Callable[[Status], object] | None,
        preview: Callable[[_Layers, Status], object] | None,
    ) -> _Layers: ...
    def view(self, camera: str | None) -> tuple[list[list[float]], float]: ...
    def with_view(self, world_from_camera: Sequence[Sequence[float]], zoom: float) -> Scene: ...

class Parts:
    """What is cut into parts for a farm's workers: rectangles of pixels with ranges of samples."""

    width: int
    height: int
    crop: tuple[int, int, int, int]
    spp: int
    is_adaptive: bool
    splats: bool
    has_costly_passes: bool
    warnings: list[str]
    def render(self, rect: Sequence[int], begin: int, end: int, should_stop: Callable[[], bool] | None = None) -> bytes | None: ...

@final
class Prepared(Parts):
    """A compiled scene with its settings, from which parts of the picture are rendered one after the other."""

    integrator: str
    scene_hash: str

@final
class PreparedBake(Parts):
    """A scene that is ready to be baked, of which some points are sampled at a time; points lie in one row of pixels."""

    def finish(
        self,
        part: bytes,
        path: str | os.PathLike[str],
        *,
        display: str,
        probes: Sequence[int] | None,
        maps: bool,
        directional: bool,
        denoise: bool,
    ) -> tuple[list[Path], list[str], float, _Array | None]: ...

@final
class PreparedPhotons(Parts):
    """A compiled scene whose photons are traced, some at a time: a picture of one pixel whose samples are photons."""

def part_merge(parts: Sequence[bytes], memory_mib: int) -> bytes: ...
def part_info(part: bytes) -> dict[str, Any]: ...
def film_info(films: Sequence[bytes]) -> dict[str, Any]: ...
def film_layers(films: Sequence[bytes], variance: bool, samples: bool, whole: bool = False) -> _Layers: ...
def film_picture(
    films: Sequence[bytes], path: str | os.PathLike[str], operator: str, exposure: float, variance: bool, samples: bool
) -> None: ...
def load(
    path: str | os.PathLike[str],
    search_paths: Sequence[str | os.PathLike[str]],
    defines: Mapping[str, str],
    variant: str | None,
    scene: str | None,
    animation: str | None,
    clock: float | None,
    moment: tuple[int, int, tuple[int | None, int | None]] | None,
) -> Scene: ...
def load_string(
    text: str,
    folder: str | os.PathLike[str],
    search_paths: Sequence[str | os.PathLike[str]],
    defines: Mapping[str, str],
) -> Scene: ...
def load_dict(
    description: dict[str, Any],
    folder: str | os.PathLike[str],
    search_paths: Sequence[str | os.PathLike[str]],
) -> Scene: ...
def parameters() -> list[tuple[str, str, str, str, str]]: ...
def integrators() -> list[str]: ...
def cli_main(argv: Sequence[str]) -> int: ...
def read_layers(path: str | os.PathLike[str]) -> _Layers: ...
def write_layers(path: str | os.PathLike[str], arrays: Sequence[tuple[str, _Array]], operator: str, exposure: float) -> None: ...
def tonemap(array: _Array, operator: str, exposure: float) -> _Array: ...
def compare(image: _Array, reference: _Array, hdr: bool) -> dict[str, float | None]: ...
def flip_map(image: _Array, reference: _Array, hdr: bool) -> _Array: ...
