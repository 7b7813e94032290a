"""Renders with Mitsuba 3. Run by an interpreter that has the package mitsuba; see serve.py.

Options: `variant`, and `method`: an integrator, if not the scene's own.
"""

from __future__ import annotations

import time

import mitsuba as mi
import numpy as np
from serve import CannotError, serve, threads

# Memory of the variants for vectors grows with the samples of a call.
PART = 64


def check(options: dict) -> str:
    """Return the version; fails where the variant does not run."""
    mi.set_variant(options["variant"])
    np.array(mi.render(mi.load_dict(mi.cornell_box()), spp=1))
    return mi.__version__


def load(job: dict):
    """Return what renders the scene."""
    if not job["source"].endswith(".xml"):
        raise CannotError("does not read glTF")
    import drjit as dr

    mi.set_variant(job["variant"])
    # With one thread Mitsuba 3.9 waits for ever for an environment map.
    dr.set_thread_count(max(2, threads()))
    scene = mi.load_file(job["source"])
    settings = {"max_depth": job["max_depth"], "rr_depth": 5}
    how = mi.load_dict({"type": job["method"], **settings}) if job.get("method") else scene.integrator()

    def render(spp: int, seed: int) -> tuple[np.ndarray, float]:
        start = time.process_time()
        total = 0.0
        for at in range(0, spp, PART):
            n = min(PART, spp - at)
            total = total + n * np.array(mi.render(scene, integrator=how, spp=n, seed=10_000 * seed + at), np.float64)[..., :3]
        return total / spp, time.process_time() - start

    # Compiles.
    render(1, 0)
    return render


if __name__ == "__main__":
    serve(check, load)
