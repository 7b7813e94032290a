"""Previews and finished files of frames."""

from __future__ import annotations

import struct
import tempfile
import threading
import zlib
from collections import OrderedDict
from typing import IO

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import select

import etendue
from etendue import _etendue
from etendue.farm.accounts import Actor
from etendue.farm.database import Database
from etendue.farm.errors import InvalidError, NotFoundError
from etendue.farm.jobs import Jobs
from etendue.farm.models import Film, Frame
from etendue.farm.store import Store
from etendue.farm.views import Output, Picture

Array = NDArray[np.float32]
MAX_PREVIEW_EDGE = 4096
"""Longest edge of a preview, in pixels."""


class Pictures:
    """The pictures of a farm."""

    def __init__(self, database: Database, store: Store, jobs: Jobs) -> None:
        self._database = database
        self._store = store
        self._jobs = jobs
        self._lock = threading.Lock()
        self._developed: OrderedDict[tuple[int, int], dict[str, Array]] = OrderedDict()

    def preview(self, actor: Actor, job_id: int, frame: int) -> Picture:
        """Return the newest small picture of a frame, a PNG. Quick.

        Raises:
            NotFoundError: There is none yet.
        """
        with self._database.read() as session:
            _, row = self._jobs.visible_frame(session, actor, job_id, frame)
            name, version = row.preview, row.preview_version
        if name is None:
            raise NotFoundError(f"frame {frame} of job {job_id} has no preview yet")
        try:
            return Picture(data=self._store.read(name), media_type="image/png", version=version)
        except FileNotFoundError:
            raise NotFoundError(f"frame {frame} of job {job_id} has no preview any more") from None

    def job_preview(self, actor: Actor, job_id: int) -> Picture | None:
        """Return the newest small picture of a job's first frame that has one; None before there is any."""
        self._jobs.get(actor, job_id)
        with self._database.read() as session:
            first = select(Frame.number).where(Frame.job_id == job_id, Frame.preview.is_not(None)).order_by(Frame.number).limit(1)
            number = session.scalar(first)
        return None if number is None else self.preview(actor, job_id, number)

    def layers(self, actor: Actor, job_id: int, frame: int) -> list[str]:
        """Return the names of the layers that `develop` can show of a frame; empty before its first unit is done."""
        _, layers = self._films(actor, job_id, frame)
        return list(layers)

    def develop(
        self,
        actor: Actor,
        job_id: int,
        frame: int,
        *,
        layer: str = "rgb",
        exposure: float = 0.0,
        tonemap: str = "standard",
        size: int | None = None,
    ) -> Picture:
        """Return a frame as it is now, from the films of the units that are done, as a PNG: for a viewer with exposure and layers.

        Args:
            actor: Who asks.
            job_id: The job.
            frame: The frame's number.
            layer: One of `layers`.
            exposure: In stops.
            tonemap: `standard`, `filmic`, `aces`, `agx`.
            size: Longest edge in pixels; None: 1:1, up to `MAX_PREVIEW_EDGE`.

        Raises:
            NotFoundError: No unit is done yet, or there is no such layer.
            InvalidError: A value does not fit.
        """
        if not -64 <= exposure <= 64:
            raise InvalidError("the exposure is -64 to 64 stops")
        version, _, numbers = self.layer(actor, job_id, frame, layer, size=size)
        try:
            data = display(numbers, layer, exposure, tonemap)
        except etendue.SettingError as e:
            raise InvalidError(str(e)) from e
        return Picture(data=png(data), media_type="image/png", version=version)

    def layer(self, actor: Actor, job_id: int, frame: int, layer: str = "rgb", *, size: int | None = None) -> tuple[int, list[str], Array]:
        """Return a layer of a frame as it is now: its version, the names of all layers, and the numbers.

        Args:
            actor: Who asks.
            job_id: The job.
            frame: The frame's number.
            layer: One of the names.
            size: Longest edge in pixels; None: 1:1, up to `MAX_PREVIEW_EDGE`.

        Raises:
            NotFoundError: No unit is done yet, or there is no such layer.
            InvalidError: The size does not fit.
        """
        edge = MAX_PREVIEW_EDGE if size is None else size
        if not 1 <= edge <= MAX_PREVIEW_EDGE:
            raise InvalidError(f"the size of a preview is 1 to {MAX_PREVIEW_EDGE} pixels")
        version, layers = self._films(actor, job_id, frame)
        if not layers:
            raise NotFoundError(f"no unit of frame {frame} of job {job_id} is done yet")
        if layer not in layers:
            raise NotFoundError(f"there is no layer `{layer[:40]}`; there are {', '.join(layers)}")
        return version, list(layers), shrink(layers[layer], edge)

    def _films(self, actor: Actor, job_id: int, frame: int) -> tuple[int, dict[str, Array]]:
        with self._database.read() as session:
            job, row = self._jobs.visible_frame(session, actor, job_id, frame)
            films = list(session.scalars(select(Film).where(Film.frame_id == row.id).order_by(Film.id)))
            # Bakes and photon maps have parts that are no films, and show their preview.
            paths = [] if job.kind in ("bake", "photons") else film_paths(row, films)
            key, preview = (row.id, row.preview_version), row.preview
        with self._lock:
            if key in self._developed:
                self._developed.move_to_end(key)
                return key[1], self._developed[key]
        try:
            layers = _etendue.film_layers([self._store.read(path) for path in paths], True, True, True) if paths else {}
            if preview is not None and (not layers or not layers["samples"].all()):
                layers = _with_preview(layers, self._store.read(preview))
        except FileNotFoundError:
            # Merged while we looked: the next call finds the sum.
            raise NotFoundError(f"the films of frame {frame} are being merged; ask again") from None
        with self._lock:
            self._developed[key] = layers
            while len(self._developed) > 4:
                self._developed.popitem(last=False)
        return key[1], layers

    def outputs(self, actor: Actor, job_id: int) -> list[Output]:
        """Return the finished files of a job, by frame."""
        self._jobs.get(actor, job_id)
        with self._database.read() as session:
            rows = session.scalars(select(Frame).where(Frame.job_id == job_id, Frame.outputs.is_not(None)).order_by(Frame.number))
            keys = ("name", "format", "bytes", "sha256")
            return [Output(frame=row.number, **{key: o[key] for key in keys}) for row in rows for o in row.outputs or []]

    def open_output(self, actor: Actor, job_id: int, name: str) -> tuple[Output, IO[bytes]]:
        """Open a finished file, to stream it.

        Raises:
            NotFoundError: There is no such file.
        """
        self._jobs.get(actor, job_id)
        with self._database.read() as session:
            for row in session.scalars(select(Frame).where(Frame.job_id == job_id, Frame.outputs.is_not(None))):
                for output in row.outputs or []:
                    if output["name"] == name:
                        keys = ("name", "format", "bytes", "sha256")
                        found = Output(frame=row.number, **{key: output[key] for key in keys})
                        return found, self._store.open(output["path"])
        raise NotFoundError(f"job {job_id} has no file `{name[:200]}`")


def _with_preview(layers: dict[str, Array], preview: bytes) -> dict[str, Array]:
    """Return layers whose picture is that of the small preview where there are no samples yet."""
    with tempfile.NamedTemporaryFile(suffix=".png") as file:
        file.write(preview)
        file.flush()
        small = _etendue.read_layers(file.name)["rgb"]
    if not layers:
        return {"rgb": small}
    picture, samples = layers["rgb"], layers["samples"]
    rows, columns = (np.arange(n) * m // n for n, m in zip(picture.shape[:2], small.shape[:2], strict=True))
    return {**layers, "rgb": np.where(samples > 0, picture, small[rows][:, columns, : picture.shape[2]])}


def film_paths(frame: Frame, films: list[Film]) -> list[str]:
    """Return the names in the store of the films whose sum is the frame so far."""
    return ([frame.film] if frame.film is not None else []) + [film.path for film in films]


def shrink(picture: Array, edge: int) -> Array:
    """Return a picture whose longer edge is at most `edge`: means of square blocks of pixels."""
    height, width, channels = picture.shape
    step = -(-max(height, width) // edge)
    if step <= 1:
        return picture
    rows, columns = -(-height // step), -(-width // step)
    padded = np.pad(picture, ((0, rows * step - height), (0, columns * step - width), (0, 0)), mode="edge")
    means: Array = padded.reshape(rows, step, columns, step, channels).mean(axis=(1, 3), dtype=np.float32)
    return means


def display(picture: Array, layer: str, exposure: float = 0.0, tonemap: str = "standard") -> NDArray[np.uint8]:
    """Return a layer as colors of a screen, of shape (height, width, 3)."""
    data = np.nan_to_num(picture, nan=0.0, posinf=0.0, neginf=0.0).astype(np.float32)
    if data.shape[2] == 1:
        data = np.repeat(data, 3, axis=2)
    elif data.shape[2] == 2:
        data = np.concatenate([data, np.zeros_like(data[:, :, :1])], axis=2)
    data = np.ascontiguousarray(data[:, :, :3])
    if layer == "normal":
        data = data * 0.5 + 0.5
    elif layer in ("depth", "samples", "position", "object", "material"):
        # Of no fixed range: the smallest value is black and the largest white.
        low, high = float(data.min()), float(data.max())
        data = (data - low) / (high - low) if high > low else np.zeros_like(data)
    shown = _etendue.tonemap(data, tonemap, exposure)
    return (np.clip(shown, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)


def png(pixels: NDArray[np.uint8]) -> bytes:
    """Return a PNG file of (height, width, 3) bytes."""
    height, width, _ = pixels.shape
    # Each row begins with its filter: 2 is the difference to the row above.
    above = np.concatenate([np.zeros_like(pixels[:1]), pixels[:-1]])
    rows = np.concatenate([np.full((height, 1), 2, np.uint8), (pixels - above).reshape(height, width * 3)], axis=1)
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + _chunk(b"IHDR", header) + _chunk(b"IDAT", zlib.compress(rows.tobytes(), 4)) + _chunk(b"IEND", b"")


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
