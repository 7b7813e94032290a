"""Small pictures of frames that are being rendered, put together from the small tiles that units send."""

from __future__ import annotations

import time
from collections import OrderedDict

import numpy as np
from numpy.typing import NDArray

from etendue.farm import pictures
from etendue.farm.planning import Rect

KEPT = 256
"""Frames whose previews are kept in memory; older ones begin anew."""
EVERY_SECS = 1.0
"""A preview is written at most so often."""


class _Canvas:
    """Weighted sums of the samples of a small picture."""

    def __init__(self, crop: Rect, step: int) -> None:
        shape = (-(-(crop[3] - crop[1]) // step), -(-(crop[2] - crop[0]) // step))
        self.sums = np.zeros((*shape, 3), np.float64)
        self.weights = np.zeros((*shape, 1), np.float64)
        self.is_new = False
        self.written_at = 0.0


class Previews:
    """The previews of the frames in work. Not exact, and lost with the process: the films are what counts."""

    def __init__(self) -> None:
        self._canvases: OrderedDict[int, _Canvas] = OrderedDict()
        self._probes: OrderedDict[int, NDArray[np.float16]] = OrderedDict()

    def begin(self, frame: int, picture: NDArray[np.float16]) -> None:
        """Keep what a probe has seen, for the pixels that no unit has done yet."""
        self._probes[frame] = picture
        while len(self._probes) > KEPT:
            self._probes.popitem(last=False)

    def add(self, frame: int, crop: Rect, tile: tuple[int, int, int, NDArray[np.float16]], samples: int) -> None:
        """Add a unit's small tile to a frame."""
        x, y, step, pixels = tile
        canvas = self._canvases.get(frame)
        if canvas is None:
            canvas = self._canvases[frame] = _Canvas(crop, step)
            while len(self._canvases) > KEPT:
                self._canvases.popitem(last=False)
        self._canvases.move_to_end(frame)
        height, width, _ = pixels.shape
        sums = canvas.sums[y : y + height, x : x + width]
        if sums.shape != pixels.shape:
            return
        sums += pixels.astype(np.float64) * samples
        canvas.weights[y : y + height, x : x + width] += samples
        canvas.is_new = True

    def due(self) -> list[int]:
        """Return the frames whose preview has changed and was not written lately."""
        now = time.monotonic()
        return [frame for frame, canvas in self._canvases.items() if canvas.is_new and now - canvas.written_at >= EVERY_SECS]

    def png(self, frame: int) -> bytes:
        """Return a frame's preview."""
        canvas = self._canvases[frame]
        canvas.is_new = False
        canvas.written_at = time.monotonic()
        return pictures.png(pictures.display(self.pixels(frame), "rgb"))

    def pixels(self, frame: int) -> NDArray[np.float32]:
        """Return a frame as it is now, small; pixels without samples are those of the probe, or black where that is gone."""
        canvas = self._canvases[frame]
        picture: NDArray[np.float32] = (canvas.sums / np.maximum(canvas.weights, 1.0)).astype(np.float32)
        probe = self._probes.get(frame)
        if probe is not None:
            height, width, _ = picture.shape
            rows, columns = np.arange(height) * probe.shape[0] // height, np.arange(width) * probe.shape[1] // width
            picture = np.where(canvas.weights > 0, picture, probe[rows][:, columns].astype(np.float32))
        return picture

    def drop(self, frame: int) -> None:
        """Forget a frame."""
        self._canvases.pop(frame, None)
        self._probes.pop(frame, None)
