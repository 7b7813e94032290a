"""Films of animations: finished frames as H.264 in an MP4 file, by PyAV (which brings FFmpeg's libraries)."""

from __future__ import annotations

import threading
from fractions import Fraction
from pathlib import Path

import numpy as np

import etendue
from etendue.farm.accounts import Actor
from etendue.farm.errors import ConflictError, FarmError, InvalidError, NotFoundError
from etendue.farm.service import Farm
from etendue.farm.states import FrameState

MAX_FRAMES = 20_000
"""Most frames of a film."""

# One film at a time: encoding takes all cores.
_ENCODING = threading.Lock()


class NoEncoderError(FarmError):
    """PyAV is not installed."""

    code = "no-encoder"
    status = 501


def write(farm: Farm, actor: Actor, job_id: int, target: Path, *, fps: float, exposure: float, tonemap: str, size: int) -> None:
    """Write the finished frames of a job as a film.

    Args:
        farm: The farm.
        actor: Who asks.
        job_id: The job.
        target: The file, ending in `.mp4`.
        fps: Frames a second.
        exposure: In stops.
        tonemap: `standard`, `filmic`, `aces`, `agx`.
        size: Longest edge in pixels; frames that are larger are shrunk.

    Raises:
        NotFoundError: The job has no finished frame, or there is no such job for the user.
        ConflictError: Another film is being made.
        InvalidError: The film would be too long.
        NoEncoderError: PyAV is not installed.
    """
    try:
        import av
    except ImportError:
        raise NoEncoderError('films need the Python package `av`, which is not installed: pip install "etendue[console]"') from None
    numbers: list[int] = []
    while True:
        page = farm.jobs.frames(actor, job_id, states=[FrameState.DONE], offset=len(numbers), limit=1000)
        numbers += [frame.number for frame in page.items]
        if page.total > MAX_FRAMES:
            raise InvalidError(f"a film has at most {MAX_FRAMES} frames")
        if not page.items or len(numbers) >= page.total:
            break
    if not numbers:
        raise NotFoundError(f"job {job_id} has no finished frame yet")
    if not _ENCODING.acquire(timeout=60):
        raise ConflictError("another film is being made; try again soon")
    try:
        with av.open(str(target), "w", options={"movflags": "faststart"}) as container:
            stream = container.add_stream("libx264", rate=Fraction(fps).limit_denominator(1001))
            stream.pix_fmt = "yuv420p"
            stream.options = {"crf": "18", "preset": "medium"}
            for index, number in enumerate(numbers):
                _, _, linear = farm.pictures.layer(actor, job_id, number, "rgb", size=size)
                shown = etendue.tonemap(np.nan_to_num(linear, nan=0.0), tonemap, exposure=exposure)
                pixels = _even((np.clip(shown, 0, 1) * 255 + 0.5).astype(np.uint8))
                if index == 0:
                    stream.height, stream.width = pixels.shape[:2]
                frame = av.VideoFrame.from_ndarray(pixels, format="rgb24")
                container.mux(stream.encode(frame))
            container.mux(stream.encode(None))
    finally:
        _ENCODING.release()


def _even(pixels: np.ndarray) -> np.ndarray:
    """Repeat the last row and column where their number is odd: colors are kept for blocks of 2 × 2 pixels."""
    height, width = pixels.shape[:2]
    return np.pad(pixels, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
