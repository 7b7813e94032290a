"""Every method on one scene: `etendue study` from Python."""

import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from etendue._errors import Error
from etendue._etendue import cli_main


def study(
    scene: str | os.PathLike[str],
    folder: str | os.PathLike[str],
    *,
    methods: Iterable[str] = (),
    reference: str | os.PathLike[str] | None = None,
    time: float | None = None,
    quiet: bool = True,
    **settings: object,
) -> dict[str, Any]:
    """Render a scene by every method and write a report with errors over time (HTML, SVG, PNG, CSV, JSON).

    Args:
        scene: Scene file.
        folder: Where the report goes; made if it is missing.
        methods: Names of integrators; all if empty.
        reference: A picture that counts as true; made by path tracing if not given.
        time: Seconds for each method; 10 if neither this nor `spp` is given.
        quiet: Print nothing.
        **settings: Settings of `etendue render`, such as `spp`, `width` or `seed`, and `reference_spp`,
            `reference_method`, `threads`.

    Returns:
        What `study.json` holds: for each method its points (samples, seconds, relMSE), final figures, efficiency and notes.

    Raises:
        Error: No method could render the scene, or an argument does not fit. The reason is on standard error.
    """
    args = ["etendue", "study", os.fspath(scene), "--output", os.fspath(folder)]
    if names := ",".join(methods):
        args += ["--methods", names]
    if reference is not None:
        args += ["--reference", os.fspath(reference)]
    if time is not None:
        args += ["--time", f"{time}s"]
    if quiet:
        args.append("--quiet")
    args += [f"--{name.replace('_', '-')}={_text(value)}" for name, value in settings.items() if value is not None]
    if code := cli_main(args):
        raise Error(f"the study of {os.fspath(scene)} failed with exit code {code}")
    report: dict[str, Any] = json.loads((Path(folder) / "study.json").read_text(encoding="utf-8"))
    return report


def _text(value: object) -> str:
    """Say a value as the command line does."""
    return str(value).lower() if isinstance(value, bool) else str(value)
