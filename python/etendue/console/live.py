"""A picture that renders while one looks at it: a thread that starts anew whenever camera or settings change."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import etendue

COARSEST = 8
"""Most pixels of the picture's edge that one pixel of a coarse picture stands for."""

COARSE_SECS = 0.12
"""How long a coarse picture should take, so that the scene follows the hand."""

WATCH_SECS = 0.5
"""How often the scene's files are looked at."""


@dataclass(frozen=True)
class Look:
    """What is to be rendered."""

    world_from_camera: NDArray[np.float64] | None = None
    """Where the camera stands; None for the file's own camera."""
    zoom: float = 1.0
    """As in `Scene.with_view`."""
    settings: Mapping[str, object] = field(default_factory=dict)
    """Keywords of `Scene.render`."""
    is_moving: bool = False
    """Someone is moving the camera: a coarse picture soon is worth more than a fine one later."""


@dataclass(frozen=True)
class Frame:
    """A picture as it is."""

    number: int
    """Counts pictures, from 1."""
    layers: Mapping[str, NDArray[np.float32]]
    """As `Scene.render(aovs=["all"])` returns them."""
    spp_done: int
    spp_target: int | None
    relative_error: float | None
    elapsed_secs: float
    scale: int
    """How many pixels of the wanted picture one of these stands for; 1 for all but coarse pictures."""
    is_done: bool
    """Nothing more is to come."""
    generation: int
    """Counts what was asked for, from 1."""

    def point(self, u: float, v: float) -> list[float] | None:
        """Return the point that is seen at `u`, `v` of the picture, each in [0, 1) from the upper left; None where nothing is."""
        position, depth = self.layers.get("position"), self.layers.get("depth")
        if position is None or depth is None or not (0 <= u < 1 and 0 <= v < 1):
            return None
        y, x = int(v * depth.shape[0]), int(u * depth.shape[1])
        if not (depth[y, x, 0] > 0 and np.isfinite(position[y, x]).all()):
            return None
        return [float(c) for c in position[y, x]]

    def pivot(self) -> list[float] | None:
        """Return the point that is seen in the middle of the picture; None where nothing is there."""
        position, depth = self.layers.get("position"), self.layers.get("depth")
        if position is None or depth is None:
            return None
        height, width = depth.shape[:2]
        size = max(1, min(height, width) // 8)
        rows = slice(max(0, height // 2 - size), height // 2 + size + 1)
        columns = slice(max(0, width // 2 - size), width // 2 + size + 1)
        depths, positions = depth[rows, columns, 0].ravel(), position[rows, columns].reshape(-1, 3)
        hit = np.isfinite(depths) & (depths > 0) & np.isfinite(positions).all(axis=1)
        if not hit.any():
            return None
        # A point that is there, at the middle of the distances: a mean would float between foreground and background.
        order = np.argsort(depths[hit], kind="stable")
        return [float(x) for x in positions[hit][order[len(order) // 2]]]


class Live:
    """Renders a scene in a thread of its own and keeps the newest picture.

    Args:
        load: Reads the scene; called again when one of its files changes.
        look: What to render first.
        changed: Called from the thread whenever there is a new picture, error or scene.
        scene: The scene, where it has been read already.
        watch: Whether to look at the scene's files for changes.
        threads: Threads of the renderer; 0 takes one for each core.
    """

    def __init__(
        self,
        load: Callable[[], etendue.Scene],
        look: Look,
        changed: Callable[[], None],
        *,
        scene: etendue.Scene | None = None,
        watch: bool = True,
        threads: int = 0,
    ) -> None:
        self._load = load
        self._look = look
        self._changed = changed
        self._watch = watch
        self._threads = threads
        self._condition = threading.Condition()
        self._generation = 1
        self._rendered = 0
        self._scene_number = 0
        self._is_paused = False
        self._is_closed = False
        self._frame: Frame | None = None
        self._frames = 0
        self._error: str | None = None
        self._load_error: str | None = None
        self._looked_at = 0.0
        self._divisor = 4
        self._stamps: dict[Path, tuple[int, int]] = {}
        self.scene = scene or load()
        self._scene_number = 1
        self._remember_files()
        self._thread = threading.Thread(target=self._run, name="etendue-view", daemon=True)

    def start(self) -> None:
        """Start rendering."""
        self._thread.start()

    def close(self) -> None:
        """Stop, and wait for the thread."""
        with self._condition:
            self._is_closed = True
            self._condition.notify_all()
        if self._thread.is_alive():
            self._thread.join(timeout=30)

    @property
    def look(self) -> Look:
        """What is being rendered."""
        return self._look

    @property
    def frame(self) -> Frame | None:
        """The newest picture; None before the first."""
        return self._frame

    @property
    def error(self) -> str | None:
        """What is wrong with the newest look or scene; None for nothing."""
        return self._load_error or self._error

    @property
    def scene_number(self) -> int:
        """How often the scene has been read."""
        return self._scene_number

    @property
    def is_paused(self) -> bool:
        """Whether rendering waits."""
        return self._is_paused

    def show(self, look: Look) -> None:
        """Render something else from now on."""
        with self._condition:
            self._look = look
            self._generation += 1
            self._condition.notify_all()

    def pause(self, is_paused: bool) -> None:
        """Keep the picture as it is, or start it again."""
        with self._condition:
            if is_paused != self._is_paused:
                self._is_paused = is_paused
                self._generation += 1
                self._condition.notify_all()
        self._changed()

    def _run(self) -> None:
        while True:
            with self._condition:
                while not self._is_closed and (self._rendered == self._generation or self._is_paused):
                    if not self._condition.wait(WATCH_SECS if self._watch else None) and self._files_changed():
                        break
                if self._is_closed:
                    return
                generation, look, is_paused = self._generation, self._look, self._is_paused
            if self._watch and self._files_changed():
                self._reload()
            if is_paused or self._rendered == generation:
                continue
            self._rendered = generation
            try:
                self._render(generation, look)
            except (etendue.Error, OSError, ValueError, TypeError) as e:
                self._report(str(e))

    def _reload(self) -> None:
        self._remember_files()
        try:
            self.scene = self._load()
        except (etendue.Error, OSError) as e:
            # The last scene that was right stays in view, and the fault is told until the file is right again.
            self._load_error = str(e)
            self._changed()
            return
        self._load_error = None
        self._remember_files()
        self._scene_number += 1
        self._rendered = 0
        self._report(None)

    def _report(self, error: str | None) -> None:
        self._error = error
        self._changed()

    def _remember_files(self) -> None:
        files = [Path(name) for name in self.scene.info()["files"]]
        self._stamps = {path: stamp for path in files if (stamp := _stamp(path)) is not None}

    def _files_changed(self) -> bool:
        return any(_stamp(path) not in (stamp, None) for path, stamp in self._stamps.items())

    def _is_outdated(self, generation: int) -> bool:
        return self._is_closed or generation != self._generation or self._must_reload()

    def _must_reload(self) -> bool:
        """Whether the scene's files have changed while it is rendered; looks at them now and then."""
        now = time.monotonic()
        if self._watch and now - self._looked_at >= WATCH_SECS:
            self._looked_at = now
            if self._files_changed():
                self._reload()
        return self._rendered == 0

    def _render(self, generation: int, look: Look) -> None:
        scene = self.scene
        if look.world_from_camera is not None:
            scene = scene.with_view(look.world_from_camera, look.zoom)
        settings: dict[str, Any] = {k: v for k, v in look.settings.items() if v is not None}
        width, height = picture_size(self.scene, settings)
        if look.is_moving or self._frame is None:
            start = time.monotonic()
            divisor = max(1, min(self._divisor, width // 16, height // 16))
            coarse = {**settings, "width": max(1, width // divisor), "height": max(1, height // divisor), "spp": 1}
            coarse.pop("antialias", None)
            layers = self._layers(scene, coarse, generation, None)
            if self._is_outdated(generation) and not look.is_moving:
                return
            self._publish(layers, None, generation, divisor, time.monotonic() - start)
            # The time goes with the number of pixels.
            wanted = divisor * math.sqrt((time.monotonic() - start) / COARSE_SECS)
            self._divisor = max(1, min(COARSEST, round(wanted)))
        if self._is_outdated(generation):
            return
        settings |= {"width": width, "height": height}
        last: list[etendue.Status] = []

        def preview(layers: dict[str, NDArray[np.float32]], status: etendue.Status) -> None:
            if not self._is_outdated(generation):
                self._publish(layers, status, generation, 1, status.elapsed_secs)

        layers = self._layers(scene, settings, generation, preview, last)
        if not self._is_outdated(generation):
            status = last[-1] if last else None
            self._publish(layers, status, generation, 1, status.elapsed_secs if status else 0.0, is_done=True)

    def _layers(
        self,
        scene: etendue.Scene,
        settings: Mapping[str, Any],
        generation: int,
        preview: Callable[[dict[str, NDArray[np.float32]], etendue.Status], None] | None,
        last: list[etendue.Status] | None = None,
    ) -> dict[str, NDArray[np.float32]]:
        def progress(status: etendue.Status) -> bool:
            if last is not None:
                last[:] = [status]
            # A coarse picture is soon done, and better than none.
            return not self._is_closed and (preview is None or not self._is_outdated(generation))

        return scene.render(aovs=["all"], threads=self._threads, progress=progress, preview=preview, **settings)

    def _publish(
        self,
        layers: Mapping[str, NDArray[np.float32]],
        status: etendue.Status | None,
        generation: int,
        scale: int,
        elapsed_secs: float,
        *,
        is_done: bool = False,
    ) -> None:
        self._frames += 1
        self._error = None
        self._frame = Frame(
            number=self._frames,
            layers=layers,
            spp_done=status.spp_done if status else 1,
            spp_target=status.spp_target if status else None,
            relative_error=status.relative_error if status else None,
            elapsed_secs=elapsed_secs,
            scale=scale,
            is_done=is_done,
            generation=generation,
        )
        self._changed()


def picture_size(scene: etendue.Scene, settings: Mapping[str, object]) -> tuple[int, int]:
    """Return width and height of the picture that `settings` ask for, in pixels."""
    info = scene.info()
    own = (int(info["width"] or 1280), int(info["height"] or 720))
    width, height = settings.get("width"), settings.get("height")
    if isinstance(width, int) and isinstance(height, int):
        return width, height
    if isinstance(width, int):
        return width, max(1, round(width * own[1] / own[0]))
    if isinstance(height, int):
        return max(1, round(height * own[0] / own[1])), height
    return own


def _stamp(path: Path) -> tuple[int, int] | None:
    with contextlib.suppress(OSError):
        stat = path.stat()
        return stat.st_mtime_ns, stat.st_size
    return None
