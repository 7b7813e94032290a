"""What all drivers of peers share: jobs as lines of JSON in, answers as lines of JSON out.

A driver is run by the interpreter that has the peer's package, so this needs nothing but numpy. `DRIVER --check OPTIONS` says the version,
or fails. Without arguments a driver takes a line with the scene (`scene_job` says what is in it) and answers `{"ready": true}`, then lines
`{"spp": 4, "seed": 1, "out": "picture.npy"}`, and answers `{"seconds": 1.5}` with the picture written: (height, width, 3), linear, row 0
at the top. What cannot be done is answered by `{"error": "why"}`.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable

import numpy as np

# Samples per pixel and seed in, picture and CPU seconds of the rendering out.
Render = Callable[[int, int], "tuple[np.ndarray, float]"]
# What each line of an answer begins with.
ANSWER = "answer: "


class CannotError(Exception):
    """What a peer or its driver cannot do, in words for the user."""


def threads() -> int:
    """Return how many threads a peer is to take: those that this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def serve(check: Callable[[dict], str], load: Callable[[dict], Render]) -> None:
    """Answer jobs until there are no more."""
    # Peers print what they like, from C as well: that goes to stderr, and what they said when they were imported begins otherwise.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)

    def answer(**what: object) -> None:
        answers.write(f"{ANSWER}{json.dumps(what)}\n")
        answers.flush()

    if sys.argv[1:2] == ["--check"]:
        answer(version=check(json.loads(sys.argv[2])))
    else:
        render = None
        for line in sys.stdin:
            job = json.loads(line)
            try:
                if render is None:
                    render = load(job)
                    answer(ready=True)
                    continue
                picture, seconds = render(job["spp"], job["seed"])
                np.save(job["out"], picture[..., :3].astype(np.float32))
                answer(seconds=seconds)
            except CannotError as why:
                answer(error=str(why))
    # LuxCore's own end of a process may crash.
    os._exit(0)
