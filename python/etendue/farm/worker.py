"""What runs on the nodes: takes orders one at a time, reads and writes the store, keeps prepared scenes. Knows nothing of Ray.

A scene reads files from its package and nothing else, writes none, and its text output is dropped: see `docs/guide/farm.md`.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Protocol, cast

import numpy as np
from numpy.typing import NDArray

import etendue
from etendue import _etendue
from etendue.farm import pictures
from etendue.farm.config import Limits
from etendue.farm.errors import FarmError
from etendue.farm.orders import (
    Done,
    Finished,
    FinishOrder,
    Merged,
    MergeOrder,
    Order,
    Probed,
    ProbeOrder,
    Rendered,
    RenderOrder,
    SceneOrder,
    WorkerSetup,
    WorkerStats,
)
from etendue.farm.packages import cached_package
from etendue.farm.planning import Rect, area

PROBE_EDGE = 128
"""Longest edge of the picture that a probe renders."""
PROBE_SECS = 1.0
"""A probe takes more samples until it has taken this long."""
PREVIEW_EDGE = 512
"""Longest edge of previews."""
PROBE_PLACES, PROBE_POINTS = 16, 64
"""A probe of a bake takes so many points at so many places."""
KEPT_SCENES = 2
"""Prepared scenes that a worker keeps."""


class Files(Protocol):
    """What a worker needs of the store; `store.Store` is one, and `ray_backend` has one that goes through the head."""

    def read(self, name: str) -> bytes: ...  # noqa: D102
    def write(self, name: str, data: bytes) -> None: ...  # noqa: D102
    def fetch(self, name: str, target: Path) -> None: ...  # noqa: D102


class Cancelled(Exception):  # noqa: N818 - not an error
    """The task was told to stop."""


class Prepared:
    """A scene as a worker keeps it."""

    def __init__(self, order: SceneOrder, folder: Path, threads: int) -> None:
        started = time.perf_counter()
        settings = dict(order.settings)
        size = tuple(_whole(settings.get(key)) for key in ("width", "height"))
        defines = {key: str(value).lower() if isinstance(value, bool) else str(value) for key, value in order.defines}
        moment = (order.number, order.final, (size[0], size[1]))
        # As without `--clock`, where nothing asks for a moment.
        clock = order.clock if order.number or order.clock else None
        given = (order.variant, order.gltf_scene, order.gltf_animation, clock)
        self.scene = _etendue.load(folder / order.scene, [], defines, *given, moment)
        self.parts: _etendue.Parts
        if order.command == "bake":
            self.parts = self.scene.prepare_bake(settings, threads, dict(order.bake))
        elif order.command == "photons":
            self.parts = self.scene.prepare_photons(settings, threads)
        else:
            self.parts = self.scene.prepare(settings, order.crop, threads, list(order.aovs), order.fixed_spp)
        self.secs = time.perf_counter() - started


def _whole(value: object) -> int | None:
    return value if isinstance(value, int) and not isinstance(value, bool) else None


class Worker:
    """Takes one order at a time; `cancel` may be called from another thread meanwhile."""

    def __init__(self, setup: WorkerSetup, files: Files) -> None:
        self._threads = setup.threads
        self._files = files
        self._cache = Path(setup.cache) if setup.cache else Path.home() / ".cache" / "etendue" / "packages"
        self._limits = Limits.model_validate(setup.limits)
        self._scenes: OrderedDict[SceneOrder, Prepared] = OrderedDict()
        self._cancelled: set[str] = set()
        self._lock = threading.Lock()

    def cancel(self, key: str) -> None:
        """Stop a task soon, or leave it out where it has not begun."""
        with self._lock:
            # Bounded, whatever keys come.
            if len(self._cancelled) > 10_000:
                self._cancelled.clear()
            self._cancelled.add(key)

    def _is_cancelled(self, key: str) -> bool:
        with self._lock:
            return key in self._cancelled

    def stats(self) -> WorkerStats:
        """Return how the machine is; zeros where the system does not tell."""
        try:
            load = os.getloadavg()[0]
            lines = dict(line.split(":", 1) for line in Path("/proc/meminfo").read_text().splitlines())
            kib = {key: int(value.split()[0]) for key, value in lines.items() if key in ("MemTotal", "MemAvailable")}
            total, free = kib["MemTotal"] * 1024, kib["MemAvailable"] * 1024
            return WorkerStats(load, total, total - free)
        except (OSError, KeyError, ValueError, AttributeError):
            return WorkerStats()

    def run(self, order: Order) -> Done:
        """Do what an order says. Failures are told, not raised."""
        started, cpu = time.perf_counter(), time.process_time()
        result: Probed | Rendered | Merged | Finished | None = None
        error, is_final, log = None, False, ""
        try:
            if self._is_cancelled(order.key):
                raise Cancelled
            if isinstance(order, ProbeOrder):
                result, log = self._probe(order)
            elif isinstance(order, RenderOrder):
                result, log = self._render(order)
            elif isinstance(order, MergeOrder):
                result = self._merge(order)
            else:
                result = self._finish(order)
        except Cancelled:
            pass
        except (etendue.SceneError, etendue.SettingError, etendue.UnsupportedError, FarmError, TypeError) as e:
            # The package's folder on this machine is nobody's business.
            error, is_final = str(e).replace(str(self._cache.resolve()) + "/", ""), True
        except Exception as e:  # whatever it is, the unit has failed and the worker goes on
            error = f"{type(e).__name__}: {e}"
        secs, core_secs = time.perf_counter() - started, time.process_time() - cpu
        return Done(order.key, result, secs, core_secs, error, is_final, log)

    def _scene(self, order: SceneOrder) -> Prepared:
        if order in self._scenes:
            self._scenes.move_to_end(order)
            return self._scenes[order]
        while len(self._scenes) >= KEPT_SCENES:
            self._scenes.popitem(last=False)
        name = f"packages/{order.package}.zip"
        folder = cached_package(order.package, lambda path: self._files.fetch(name, path), self._cache, self._limits)
        prepared = Prepared(order, folder, self._threads)
        parts = prepared.parts
        if parts.width * parts.height > self._limits.pixels:
            raise etendue.SettingError(f"a picture of the farm has at most {self._limits.pixels} pixels")
        if order.fixed_spp and order.command != "photons" and parts.spp > self._limits.spp:
            raise etendue.SettingError(f"a picture of the farm has at most {self._limits.spp} samples per pixel")
        self._scenes[order] = prepared
        return prepared

    def _part(self, prepared: Prepared, key: str, rect: Rect, begin: int, end: int) -> bytes:
        try:
            film = prepared.parts.render(rect, begin, end, self._stopper(key))
        except Exception:
            # A session that has failed is not used again.
            self._scenes.clear()
            raise
        if film is None:
            raise Cancelled
        return film

    def _stopper(self, key: str) -> Callable[[], bool]:
        return lambda: self._is_cancelled(key)

    def _probe(self, order: ProbeOrder) -> tuple[Probed, str]:
        prepared = self._scene(order.scene)
        parts = prepared.parts
        picture, secs_per_sample = self._probe_picture(order, prepared)
        if order.scene.command != "render":
            secs_per_sample = self._probe_part(order, parts)
        probed = Probed(
            width=parts.width,
            height=parts.height,
            crop=parts.crop,
            spp=parts.spp,
            is_adaptive=parts.is_adaptive,
            is_whole=parts.splats or parts.has_costly_passes,
            secs_per_sample=secs_per_sample,
            load_secs=prepared.secs,
            picture=np.clip(picture, -6e4, 6e4).astype(np.float16) if order.scene.command == "render" else None,
        )
        losses = [f"{loss.file}:{loss.line or 0}: {loss.feature}: {loss.effect}" for loss in etendue.Scene(prepared.scene).losses[:50]]
        return probed, "\n".join([*parts.warnings[:50], *losses])

    def _probe_picture(self, order: ProbeOrder, prepared: Prepared) -> tuple[NDArray[np.float32], float]:
        """Make the frame's first preview; return the small picture that it is made of, and the core-seconds of a sample of a pixel."""
        settings = dict(order.scene.settings)
        parts = prepared.parts
        if order.scene.command == "render":
            (x0, y0, x1, y1), full, most = parts.crop, (parts.width, parts.height), parts.spp
        else:
            # What is baked or traced has no picture: the scene is shown as its camera sees it.
            settings = {"seed": settings.get("seed", 0)}
            view = prepared.scene.prepare({**settings, "width": PROBE_EDGE}, None, self._threads, [], True)
            (x0, y0, x1, y1), full, most = view.crop, (view.width, view.height), view.spp
        scale = min(PROBE_EDGE / max(x1 - x0, y1 - y0), 1.0)
        width, height = (max(round(n * scale), 1) for n in full)
        small = tuple(min(max(round(v * scale), 0), m) for v, m in zip((x0, y0, x1, y1), (width, height) * 2, strict=True))
        crop = (min(small[0], width - 1), min(small[1], height - 1), max(small[2], small[0] + 1), max(small[3], small[1] + 1))
        settings = {**settings, "width": width, "height": height}
        probe = prepared.scene.prepare(settings, list(crop), self._threads, [], order.scene.fixed_spp)
        films: list[bytes] = []
        secs, begin = 0.0, 0
        step = probe.spp if probe.is_adaptive else 1
        while begin < most and begin < 64 and secs < PROBE_SECS:
            started, cpu = time.perf_counter(), time.process_time()
            film = probe.render(crop, begin, min(begin + step, most), self._stopper(order.key))
            if film is None:
                raise Cancelled
            films.append(film)
            # Time of processors, not of the clock, as others may work on this machine; and of the last samples, as what comes once,
            # before the first one, is not a sample's cost.
            last_secs = time.process_time() - cpu
            last_work = area(crop) * (min(begin + step, most) - begin)
            secs += time.perf_counter() - started
            begin += step
            step = min(2 * step, 16)
        picture = _etendue.film_layers(films, False, False)["rgb"]
        target = min(PREVIEW_EDGE / max(x1 - x0, y1 - y0), 1.0)
        shape = (max(round((y1 - y0) * target), 1), max(round((x1 - x0) * target), 1))
        if order.scene.command != "render":
            shape = picture.shape[:2]
        self._files.write(order.preview, pictures.png(pictures.display(_resize(picture, shape), "rgb")))
        return picture, max(last_secs, 1e-6) / last_work

    def _probe_part(self, order: ProbeOrder, parts: _etendue.Parts) -> float:
        """Return the core-seconds of a sample of a point of a bake, or of a photon: of a few of them from all over."""
        edge = -(-parts.width // PROBE_PLACES)
        rects = [(x, 0, min(x + PROBE_POINTS, parts.width), 1) for x in range(0, parts.width, edge)]
        count, secs = 1, 0.0
        while True:
            cpu = time.process_time()
            for rect in rects:
                if parts.render(rect, 0, count, self._stopper(order.key)) is None:
                    raise Cancelled
            last_secs = time.process_time() - cpu
            secs += last_secs
            if secs >= PROBE_SECS or count == parts.spp:
                return max(last_secs, 1e-6) / (sum(map(area, rects)) * count)
            count = min(4 * count, parts.spp)

    def _render(self, order: RenderOrder) -> tuple[Rendered, str]:
        prepared = self._scene(order.scene)
        film = self._part(prepared, order.key, order.rect, order.begin, order.end)
        self._files.write(order.film, film)
        work = area(order.rect) * (order.end - order.begin)
        x0, y0, x1, y1 = prepared.parts.crop
        warnings = "\n".join(prepared.parts.warnings[:50])
        if order.scene.command != "render":
            return Rendered(len(film), work, None), warnings
        step = max(-(-max(x1 - x0, y1 - y0) // PREVIEW_EDGE), 1)
        rect = order.rect
        columns, rows, tile = _small_tile(_etendue.film_layers([film], False, False)["rgb"], rect[0] - x0, rect[1] - y0, step)
        return Rendered(len(film), work, (columns, rows, step, tile)), warnings

    def _merge(self, order: MergeOrder) -> Merged:
        film = _etendue.part_merge([self._files.read(name) for name in order.films], order.memory_mib)
        self._files.write(order.film, film)
        return Merged(len(film))

    def _finish(self, order: FinishOrder) -> Finished:
        films = [self._files.read(name) for name in order.films]
        film = films[0] if len(films) == 1 else _etendue.part_merge(films, order.memory_mib)
        del films
        if order.scene is not None:
            return self._finish_bake(order, order.scene, film)
        if [kind for kind, _, _ in order.outputs] == ["photons"]:
            return self._finish_photons(order, film)
        info = _etendue.film_info([film])
        error = info["relative_error"]
        self._files.write(order.film, film)
        picture = pictures.shrink(_etendue.film_layers([film], False, False)["rgb"], PREVIEW_EDGE)
        self._files.write(order.preview, pictures.png(pictures.display(picture, "rgb", order.exposure, order.tonemap)))
        is_done = order.is_last or (order.noise is not None and error is not None and error <= order.noise)
        outputs: list[dict[str, str | int]] = []
        for kind, name, path in order.outputs if is_done else ():
            data = film if kind == "film" else _picture(film, kind, order)
            outputs.append(self._output(kind, name, path, data))
        return Finished(len(film), info["spp"], error, is_done, tuple(outputs))

    def _output(self, kind: str, name: str, path: str, data: bytes) -> dict[str, str | int]:
        self._files.write(path, data)
        return {"name": name, "format": kind, "path": path, "bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}

    def _finish_bake(self, order: FinishOrder, scene: SceneOrder, part: bytes) -> Finished:
        """Make the baked scene, and what goes beside it."""
        prepared = self._scene(scene)
        assert isinstance(prepared.parts, _etendue.PreparedBake)
        given = dict(order.delivery)
        _, name, path = order.outputs[0]
        with tempfile.TemporaryDirectory(prefix="etendue-bake-") as folder:
            paths, notes, error, atlas = prepared.parts.finish(
                part,
                Path(folder) / name,
                display=str(given["display"]),
                probes=cast("tuple[int, int, int] | None", given["probes"]),
                maps=bool(given["exr"]),
                directional=bool(given["directional"]),
                denoise=bool(given["denoise"]),
            )
            folder_name = path.rpartition("/")[0]
            outputs = [self._output(p.suffix[1:], p.name, f"{folder_name}/{p.name}", p.read_bytes()) for p in map(Path, paths)]
        self._files.write(order.film, part)
        if atlas is not None:
            # Irradiance as a white surface sends it back.
            picture = pictures.shrink(atlas, PREVIEW_EDGE) / np.float32(np.pi)
            self._files.write(order.preview, pictures.png(pictures.display(picture, "rgb")))
        return Finished(len(part), prepared.parts.spp, error, True, tuple(outputs), "; ".join(notes))

    def _finish_photons(self, order: FinishOrder, part: bytes) -> Finished:
        """The map is what was ordered: it is kept once."""
        _, name, _ = order.outputs[0]
        photons = sum(end - begin for *_, begin, end in _etendue.part_info(part)["held"])
        return Finished(len(part), photons, None, True, (self._output("photons", name, order.film, part),))


def _picture(film: bytes, kind: str, order: FinishOrder) -> bytes:
    with tempfile.TemporaryDirectory(prefix="etendue-picture-") as folder:
        path = Path(folder) / f"picture.{kind}"
        _etendue.film_picture([film], path, order.tonemap, order.exposure, order.variance, order.samples)
        return path.read_bytes()


def _resize(picture: NDArray[np.float32], shape: tuple[int, int]) -> NDArray[np.float32]:
    """Return a picture of another size by repeating or leaving out pixels: previews need no more."""
    rows = np.arange(shape[0]) * picture.shape[0] // shape[0]
    columns = np.arange(shape[1]) * picture.shape[1] // shape[1]
    resized: NDArray[np.float32] = picture[rows][:, columns]
    return resized


def _small_tile(picture: NDArray[np.float32], x: int, y: int, step: int) -> tuple[int, int, NDArray[np.float16]]:
    """Return a tile's means over the blocks of `step`² pixels of the whole picture, and the first block's column and row."""
    height, width, _ = picture.shape
    xs, ys = (np.arange(x, x + width) // step, np.arange(y, y + height) // step)
    first_x, first_y = (np.flatnonzero(np.diff(v, prepend=-1)) for v in (xs, ys))
    sums = np.add.reduceat(np.add.reduceat(picture, first_y, axis=0), first_x, axis=1)
    counts = np.diff(first_y, append=height)[:, None, None] * np.diff(first_x, append=width)[None, :, None]
    # Half floats end at 65504; previews of the sun need no more.
    return int(xs[0]), int(ys[0]), np.clip(sums / counts, -6e4, 6e4).astype(np.float16)
