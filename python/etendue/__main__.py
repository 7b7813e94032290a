"""The `etendue` command, also as `python -m etendue`."""

import importlib
import sys
from collections.abc import Callable

from etendue._etendue import cli_main

PYTHON_COMMANDS = {"farm": "etendue.farm.cli", "view": "etendue.console.view"}
"""Commands that are written in Python, with the modules whose `main(argv)` runs them; all others are the renderer's own."""


def _command(module: str) -> Callable[[list[str]], int]:
    """Return a command's function, or say what to install for it and exit."""
    try:
        command: Callable[[list[str]], int] = importlib.import_module(module).main
        return command
    except ModuleNotFoundError as e:
        if (e.name or "etendue").split(".")[0] == "etendue":
            raise
        extra = "farm" if sys.argv[1] == "farm" else "console"
        print(f'etendue {sys.argv[1]}: error: the Python package `{e.name}` is missing: pip install "etendue[{extra}]"', file=sys.stderr)
        sys.exit(2)


def main() -> None:
    """Run the command line and exit with its code."""
    module = PYTHON_COMMANDS.get(sys.argv[1]) if len(sys.argv) > 1 else None
    if module is not None:
        sys.exit(_command(module)(sys.argv[2:]))
    sys.exit(cli_main(["etendue", *sys.argv[1:]]))


if __name__ == "__main__":
    main()
