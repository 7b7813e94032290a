"""Reads an uploaded scene for its loss report, in a process of its own: a hostile scene may take long, or all memory.

`python -m etendue.farm.check FILE` prints JSON.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from etendue.farm.config import Limits
from etendue.farm.errors import PackageError

MEMORY = 16 << 30
"""Most bytes of address space beside what the process has at its start."""


def check_scene(folder: Path, scene: str, limits: Limits) -> dict[str, Any]:
    """Return what is in a scene, with its `losses` and `warnings`: lists of [file, line, column, …].

    Raises:
        PackageError: It cannot be read; the message has all of its faults.
    """
    command = [sys.executable, "-m", "etendue.farm.check", scene]
    try:
        # The temporary folder's name has no place in messages to users, so the process works there.
        done = subprocess.run(command, cwd=folder, capture_output=True, timeout=limits.check_secs, check=False)
    except subprocess.TimeoutExpired:
        raise PackageError(f"reading `{scene}` takes longer than {limits.check_secs:g} s") from None
    try:
        answer = json.loads(done.stdout)
    except ValueError:
        raise PackageError(f"reading `{scene}` has failed (process ended with {done.returncode})") from None
    if "error" in answer:
        raise PackageError(answer["error"].replace(str(folder.resolve()) + "/", ""))
    return dict(answer)


def main() -> int:
    """Read the scene that the command line names."""
    import etendue
    from etendue import _etendue

    _limit_memory()
    try:
        raw = _etendue.load(sys.argv[1], [], {}, None, None, None, None, (0, 0, (None, None)))
        scene = etendue.Scene(raw)
        losses = [list(loss) for loss in scene.losses[:1000]]
        answer = {**scene.info(), "losses": losses, "warnings": [list(fault) for fault in scene.warnings[:1000]]}
    except (etendue.Error, OSError, ValueError) as e:
        answer = {"error": str(e)[:10_000] or type(e).__name__}
    sys.stdout.write(json.dumps(answer))
    return 0


def _limit_memory() -> None:
    try:
        import resource
    except ImportError:  # Windows
        return
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))


if __name__ == "__main__":
    sys.exit(main())
