"""Scenes: reading and rendering them."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from etendue import _etendue
from etendue._errors import Fault, SettingError

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from etendue._settings import RenderSettings

Array = NDArray[np.float32]
"""A picture: (height, width, channels)."""


class Loss(NamedTuple):
    """Something that a file holds and the renderer does not honor."""

    file: str
    """The file; for a scene from a dictionary the path of keys."""
    line: int | None
    """Line, from 1; None where it is not known."""
    column: int | None
    """Column in characters, from 1; None where it is not known."""
    feature: str
    """What it is, in the format's own words."""
    effect: str
    """What happens instead."""


class Parameter(NamedTuple):
    """A setting of `Scene.render`, as the renderer declares it."""

    name: str
    """The keyword."""
    kind: str
    """Its type in words."""
    unit: str
    """Its unit; empty for none."""
    default: str
    """Its default in words."""
    doc: str
    """What it does, in a sentence."""


class View(NamedTuple):
    """Where a camera stands."""

    world_from_camera: NDArray[np.float64]
    """Shape (4, 4): places the camera in the world. Its own space has +x right, +y up and looks along −z."""
    zoom: float
    """How many times larger things appear than with the file's angle of view."""


def parameters() -> list[Parameter]:
    """Return every setting that `Scene.render` takes beside its own keywords."""
    return [Parameter(*row) for row in _etendue.parameters()]


def integrators() -> list[str]:
    """Return the names that the setting `integrator` takes."""
    return list(_etendue.integrators())


class Scene:
    """A scene that has been read. Made by `load`, `load_string` and `load_dict`; it never changes."""

    __slots__ = ("_scene",)

    def __init__(self, scene: _etendue.Scene) -> None:
        self._scene = scene

    def __repr__(self) -> str:
        info = self.info()
        return f"<etendue.Scene {info['files'][0]!r}: {info['shapes']} shapes, {info['triangles']} triangles>"

    def info(self) -> dict[str, Any]:
        """Return what is in the scene.

        Returns:
            `format`, `files`; what the file says of the picture: `width`, `height`, `spp`, `integrator`, `max_depth`
            (None where it says nothing); lists of (name, kind): `cameras`, `lights`; numbers of `emissive_shapes`, `shapes`,
            `analytic_shapes`, `groups`, `instances`, `meshes`, `triangles`, `bsdfs`, `textures`, `images`, `media`.
        """
        return self._scene.info()

    @property
    def losses(self) -> list[Loss]:
        """What the file holds and the renderer does not honor."""
        return [Loss(*row) for row in self._scene.losses()]

    @property
    def warnings(self) -> list[Fault]:
        """What looks wrong in the file but does not prevent rendering."""
        return [Fault(*row) for row in self._scene.warnings()]

    def view(self, camera: str | None = None) -> View:
        """Return where the camera stands.

        Args:
            camera: Name or number of one of the file's cameras; the first where None.

        Raises:
            SceneError: There is no such camera.
        """
        rows, zoom = self._scene.view(camera)
        return View(np.array(rows, dtype=np.float64), zoom)

    def with_view(self, world_from_camera: ArrayLike, zoom: float = 1.0) -> Scene:
        """Return the same scene, seen from elsewhere.

        The new scene shares all it holds with this one; a rendering takes over what the one before it has compiled.

        Args:
            world_from_camera: Shape (4, 4): places the camera in the world. Its own space has +x right, +y up and looks
                along −z. For POV-Ray scenes, whose space is left-handed, so are the axes.
            zoom: How many times larger things appear than with the file's angle of view, above 0. Perspective and
                parallel projections heed it.

        Raises:
            SettingError: The matrix is flat or has infinite numbers, or the zoom is not above 0.
        """
        matrix = np.asarray(world_from_camera, dtype=np.float64)
        if matrix.shape != (4, 4):
            raise SettingError(f"`world_from_camera` has shape {matrix.shape}, not (4, 4)")
        return Scene(self._scene.with_view(matrix.tolist(), float(zoom)))

    @overload
    def render(
        self,
        *,
        aovs: None = None,
        crop: Sequence[int] | None = None,
        time: float | None = None,
        noise: float | None = None,
        threads: int = 0,
        progress: Callable[[_etendue.Status], object] | None = None,
        preview: Callable[[dict[str, Array], _etendue.Status], object] | None = None,
        **settings: Unpack[RenderSettings],
    ) -> Array: ...

    @overload
    def render(
        self,
        *,
        aovs: Sequence[str],
        crop: Sequence[int] | None = None,
        time: float | None = None,
        noise: float | None = None,
        threads: int = 0,
        progress: Callable[[_etendue.Status], object] | None = None,
        preview: Callable[[dict[str, Array], _etendue.Status], object] | None = None,
        **settings: Unpack[RenderSettings],
    ) -> dict[str, Array]: ...

    def render(
        self,
        *,
        aovs: Sequence[str] | None = None,
        crop: Sequence[int] | None = None,
        time: float | None = None,
        noise: float | None = None,
        threads: int = 0,
        progress: Callable[[_etendue.Status], object] | None = None,
        preview: Callable[[dict[str, Array], _etendue.Status], object] | None = None,
        **settings: Unpack[RenderSettings],
    ) -> Array | dict[str, Array]:
        """Render a picture. Other Python threads run meanwhile, and Ctrl-C raises KeyboardInterrupt.

        It stops at the number of samples, the time or the noise, whichever comes first. Where `time` or `noise` is
        given and `spp` is not, the samples do not matter.

        Args:
            aovs: Auxiliary outputs: `albedo`, `normal`, `depth`, `position`, `uv`, `object`, `material`,
                `variance` (of each pixel's mean), `samples` (their number), or `all`. An empty list gives the picture
                and its alpha.
            crop: Only these pixels: (x0, y0, x1, y1) from the upper left, the last excluded.
            time: Stop after this time in seconds.
            noise: Stop when the relative error, estimated from the variance, is at most this, such as 0.02.
            threads: Threads; 0 takes one for each core. The picture does not depend on it.
            progress: Called with a `Status` about 20 times a second, in the calling thread. Where it returns False, the
                rendering stops and what is done is returned. What it raises stops the rendering and is passed on.
            preview: Called with the layers as they are, by name, and a `Status`: after passes over the picture, as often as it
                comes to them, in the calling thread. What it raises stops the rendering and is passed on.
            **settings: Every setting of the renderer, such as `spp=64`, `integrator="path"`, `seed=1`,
                `width=640`, `max_depth=5`; `parameters()` lists them. None leaves the choice to the file, then to the renderer.

        Returns:
            Without `aovs` the picture: linear Rec. 709 values, `float32` of shape (height, width, 3).
            With `aovs` a dictionary of such arrays: `rgb`, `alpha`, with `light_groups=True` `light.NAME` for
            each named light, and each AOV under its name.

        Raises:
            SettingError: A setting does not fit.
            SceneError: The scene cannot be rendered, such as for an image that cannot be read.
            TypeError: There is no such keyword.
        """
        if isinstance(aovs, str):
            raise SettingError(f"`aovs` takes a list of names, such as [{aovs!r}]")
        if threads < 0:
            raise SettingError(f"`threads` takes 0 or more, not {threads}")
        if crop is not None and (len(crop) != 4 or any(edge < 0 for edge in crop)):
            raise SettingError(f"`crop` takes four whole numbers x0, y0, x1, y1, not {tuple(crop)}")
        layers = self._scene.render(
            settings,
            crop=None if crop is None else [int(edge) for edge in crop],
            time=time,
            noise=noise,
            threads=threads,
            aovs=list(aovs or ()),
            progress=progress,
            preview=preview,
        )
        return layers["rgb"] if aovs is None else layers


def load(
    path: str | os.PathLike[str],
    search_paths: Sequence[str | os.PathLike[str]] = (),
    defines: Mapping[str, object] | None = None,
    variant: str | None = None,
    *,
    scene: str | None = None,
    animation: str | None = None,
    clock: float | None = None,
) -> Scene:
    """Read a scene file: Mitsuba 3 and older (.xml), POV-Ray (.pov), pbrt-v4 (.pbrt), glTF (.gltf, .glb), .obj, .ply, .stl.

    Args:
        path: The file.
        search_paths: Folders beside the scene's own in which it may read files.
        defines: Values for `$key` in a Mitsuba file.
        variant: Material variant of a glTF file.
        scene: Scene of a glTF file, by name or number.
        animation: Animation of a glTF file, by name or number; None: the first.
        clock: Second of that animation, None: the pose without animation; or `clock` of a POV-Ray scene.

    Returns:
        The scene, with a camera and a light where the file has none.

    Raises:
        OSError: The file cannot be opened, such as FileNotFoundError.
        SceneError: The scene has faults; all of them with their places.
        UnsupportedError: The format is not read.
    """
    return Scene(_etendue.load(path, list(search_paths), _texts(defines), variant, scene, animation, clock, None))


def load_string(
    text: str,
    folder: str | os.PathLike[str] = ".",
    *,
    search_paths: Sequence[str | os.PathLike[str]] = (),
    defines: Mapping[str, object] | None = None,
) -> Scene:
    """Read a Mitsuba scene from its XML text.

    Args:
        text: The XML.
        folder: Where the names of other files start.
        search_paths: Further folders in which the scene may read files.
        defines: Values for `$key`.

    Raises:
        SceneError: The scene has faults; all of them with their places.
    """
    return Scene(_etendue.load_string(text, folder, list(search_paths), _texts(defines)))


def load_dict(
    description: Mapping[str, Any],
    folder: str | os.PathLike[str] = ".",
    *,
    search_paths: Sequence[str | os.PathLike[str]] = (),
) -> Scene:
    """Make a scene from a nested dictionary in the terms of Mitsuba's `load_dict`.

    Args:
        description: A dictionary of type `scene`. Its entries, and theirs, are dictionaries with a `type`. Colors are
            `{"type": "rgb", "value": [r, g, b]}`, references `{"type": "ref", "id": name}`; arrays of shape (3,) are
            vectors, (4, 4) or a `Transform` transforms, (height, width, channels) pictures.
        folder: Where the names of files start.
        search_paths: Further folders in which the scene may read files.

    Raises:
        SceneError: The scene has faults; all of them, with the keys that lead to them.
    """
    return Scene(_etendue.load_dict(dict(description), folder, list(search_paths)))


def _texts(defines: Mapping[str, object] | None) -> dict[str, str]:
    """Return the values as a Mitsuba file would write them."""
    texts = {key: str(value) for key, value in (defines or {}).items()}
    for key, value in (defines or {}).items():
        if isinstance(value, bool):
            texts[key] = "true" if value else "false"
    return texts
