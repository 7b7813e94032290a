"""How a frame becomes units: sizes from the probe's cost, tiles and sample ranges, the tree of merges, rounds of samples.

Functions of numbers alone: the scheduler, the simulation and the tests share them.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

TILE = 32
"""Units begin at multiples of this: the renderer hands out tiles of this edge to its threads."""
ROUND = 16
"""Samples after which a renderer that stops by noise looks at the error; rounds end at multiples of it."""
MAX_UNITS = 1 << 16
"""Most units of a frame and round."""
TAIL = 8
"""Into how many each of the last units is cut, so that no worker waits long for another at a job's end."""
MAX_TAIL = 64
"""Most units that are cut so: short ones are work for the head."""

Rect = tuple[int, int, int, int]


class Part(NamedTuple):
    """Some samples of some pixels."""

    rect: Rect
    """x0, y0, x1, y1."""
    begin: int
    end: int

    @property
    def work(self) -> int:
        """Pixels × samples."""
        return area(self.rect) * (self.end - self.begin)


def area(rect: Rect) -> int:
    """Return the number of pixels."""
    return (rect[2] - rect[0]) * (rect[3] - rect[1])


def unit_secs(job_secs: float, slots: int, shortest: float, longest: float) -> float:
    """Return how long units of a job should take: so that each worker gets about four, within limits.

    Args:
        job_secs: Time of the rest of the job on one worker.
        slots: Workers.
        shortest: Below this, what a unit costs beside rendering weighs too much.
        longest: Above this, too much is lost with a worker, and the last units make all wait.
    """
    return min(max(job_secs / (4 * max(slots, 1)), shortest), longest)


def split_frame(
    crop: Rect, begin: int, end: int, secs: float, target_secs: float, *, whole: bool, all_samples: bool, tail: int = 0
) -> list[Part]:
    """Return the units of samples `begin..end` of a frame, in the order of their slots: those that are merged first are neighbors.

    Tiles come first, as films of different pixels are small; ranges of samples only where one tile is still too long. Units take different
    times, so some workers have nothing left while others do their last one: where a frame is a job's last, its last units are shorter.

    Args:
        crop: The pixels.
        begin: First sample.
        end: One past the last sample.
        secs: How long it takes on one worker.
        target_secs: How long a unit should take.
        whole: Parts must be the whole picture, as for methods whose samples give light to other pixels.
        all_samples: Parts must have all samples, as with adaptive antialiasing.
        tail: How many of the last units are cut into `TAIL`: the number of workers where the frame is a job's last, otherwise 0.
    """
    wanted = min(max(math.ceil(secs / target_secs - 1e-9), 1), MAX_UNITS) if target_secs > 0 else 1
    rects = [crop] if whole else _tiles(crop, wanted)
    ranges = 1 if all_samples else min(math.ceil(wanted / len(rects)), end - begin)
    # Rounded up in both steps: fewer ranges if that is still as near.
    edges = _edges(begin, end, ranges)
    parts = [Part(rect, a, b) for rect in rects for a, b in pairwise(edges)]
    first = max(len(parts) - min(tail, MAX_TAIL), 0)
    return parts[:first] + [short for part in parts[first:] for short in _cut(part, TAIL, whole=whole, all_samples=all_samples)]


def _cut(part: Part, pieces: int, *, whole: bool, all_samples: bool) -> list[Part]:
    """Return a part cut into about so many, or into fewer where its samples and pixels are few."""
    samples = part.end - part.begin
    if all_samples or (samples < pieces and not whole):
        rects = [part.rect] if whole else _tiles(part.rect, pieces)
        return [Part(rect, part.begin, part.end) for rect in rects]
    return [Part(part.rect, a, b) for a, b in pairwise(_edges(part.begin, part.end, min(pieces, samples)))]


def _edges(begin: int, end: int, count: int) -> list[int]:
    """Return the limits of so many ranges of about the same length."""
    return [begin + (end - begin) * i // count for i in range(count + 1)]


def _tiles(crop: Rect, wanted: int) -> list[Rect]:
    """Return about so many equal tiles, nearly square, cut at multiples of `TILE`, row by row."""
    x0, y0, x1, y1 = crop
    cells_x, cells_y = -(-(x1 - x0) // TILE), -(-(y1 - y0) // TILE)
    columns = min(max(round(math.sqrt(wanted * cells_x / cells_y)), 1), cells_x, wanted)
    rows = min(math.ceil(wanted / columns), cells_y)
    columns = min(math.ceil(wanted / rows), cells_x)
    xs = [min(x0 + cells_x * i // columns * TILE, x1) for i in range(columns + 1)]
    ys = [min(y0 + cells_y * i // rows * TILE, y1) for i in range(rows + 1)]
    return [(a, c, b, d) for c, d in pairwise(ys) for a, b in pairwise(xs)]


class Merge(NamedTuple):
    """A step of the tree: the films of `level` in places `first..last` become the one of `level + 1` in `slot`."""

    level: int
    slot: int
    first: int
    last: int


def tops(units: int, fan_in: int) -> tuple[int, int]:
    """Return the level at which a frame's films are few enough for the last step, and how many there are then."""
    level, count = 0, units
    while count > fan_in:
        level, count = level + 1, -(-count // fan_in)
    return level, count


def merge_of(level: int, slot: int, units: int, fan_in: int) -> Merge | None:
    """Return the merge that takes the film of a level and slot; None where that is the last step's."""
    top, _ = tops(units, fan_in)
    if level >= top:
        return None
    count = -(-units // fan_in**level)
    group = slot // fan_in
    return Merge(level, group, group * fan_in, min((group + 1) * fan_in, count))


def next_round(
    done: int, error: float | None, goal: float | None, most: int | None, secs_per_sample: float, slots: int, shortest: float
) -> int:
    """Return up to which sample the next round goes, where noise, time or cost decide.

    The error falls with the root of the number of samples, so the noise that is left tells how many are needed; a round is never more than
    thrice what there is, as early errors are uncertain.

    Args:
        done: Samples per pixel so far.
        error: Relative error so far; None where it is not known.
        goal: The error to come to; None where other rules decide.
        most: Samples at which to stop anyway.
        secs_per_sample: Time of one sample of all pixels on one worker.
        slots: Workers.
        shortest: Shortest time that a unit should take.
    """
    # Each worker should have a unit's work at least.
    step = max(math.ceil(shortest * slots / max(secs_per_sample, 1e-9)), 1)
    if done == 0:
        step = min(step, 4 * ROUND)
    elif goal is not None and error is not None and error > goal:
        step = max(math.ceil(done * ((error / goal) ** 2 - 1.0)), 1)
    step = min(step, 3 * done) if done else step
    end = -(-(done + step) // ROUND) * ROUND
    return end if most is None else min(end, most)


def rank(number: int, is_first: bool, slot: int) -> int:
    """Return the place of a unit among those of its job: frames that come first, then by number, then by slot."""
    return ((0 if is_first else 1) << 52) + (number << 20) + slot


def probe_rank(number: int, is_first: bool) -> int:
    """Return the rank of a frame's probe: those of all frames come before other units, those of the frames that come first in front."""
    return number - (1 << 41) if is_first else number - (1 << 40)
