"""The `etendue` command, also as `python -m etendue`."""

import importlib
import sys

from etendue._etendue import cli_main

PYTHON_COMMANDS = {"farm": "etendue.farm.cli", "view": "etendue.console.view"}
"""Commands that are written in Python, with the modules whose `main(argv)` runs them; all others are the renderer's own."""


def main() -> None:
    """Run the command line and exit with its code."""
    module = PYTHON_COMMANDS.get(sys.argv[1]) if len(sys.argv) > 1 else None
    if module is not None:
        sys.exit(importlib.import_module(module).main(sys.argv[2:]))
    sys.exit(cli_main(["etendue", *sys.argv[1:]]))


if __name__ == "__main__":
    main()
