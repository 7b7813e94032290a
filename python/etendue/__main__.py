"""The `etendue` command, also as `python -m etendue`."""

import sys

from etendue._etendue import cli_main


def main() -> None:
    """Run the command line and exit with its code."""
    sys.exit(cli_main(["etendue", *sys.argv[1:]]))


if __name__ == "__main__":
    main()
