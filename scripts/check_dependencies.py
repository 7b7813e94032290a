"""Check what the crates depend on: the direction among our own, and the licenses of all others.

Directions are in ALLOWED below, licenses in deny.toml. Prints a sentence for each fault and exits with 1 if there is
any.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parent.parent

# cli, py → gpu → render → scene → procedural, never back. The Python package offers the same command, so py uses the library of cli.
ALLOWED: dict[str, set[str]] = {
    "etendue-procedural": set(),
    "etendue-scene": {"etendue-procedural"},
    "etendue-render": {"etendue-procedural", "etendue-scene"},
    "etendue-gpu": {"etendue-scene", "etendue-render"},
    "etendue-cli": {"etendue-scene", "etendue-render", "etendue-gpu"},
    "etendue-py": {"etendue-scene", "etendue-render", "etendue-gpu", "etendue-cli"},
}


def metadata() -> dict[str, Any]:
    """Return what cargo knows of the workspace and its dependencies."""
    command = ["cargo", "metadata", "--format-version", "1", "--locked"]
    result = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    data: dict[str, Any] = json.loads(result.stdout)
    return data


def direction_faults(data: dict[str, Any]) -> list[str]:
    """Return a sentence for each dependency among our crates that goes the wrong way."""
    members = set(data["workspace_members"])
    faults = []
    for package in data["packages"]:
        if package["id"] not in members:
            continue
        name = package["name"]
        if name not in ALLOWED:
            faults.append(f"The crate {name} has no place in scripts/check_dependencies.py; say there what it may depend on.")
            continue
        # Tests may use what they like outside of our crates, but the direction holds for them as well.
        for dependency in sorted({d["name"] for d in package["dependencies"]}):
            if dependency in ALLOWED and dependency != name and dependency not in ALLOWED[name]:
                faults.append(f"{name} must not depend on {dependency}: the direction is cli, py → gpu → render → scene → procedural.")
    return faults


def satisfied(expression: str, allowed: set[str]) -> bool:
    """Return whether a license expression (SPDX, or the old form with slashes) can be met by allowed licenses."""
    tokens = re.findall(r"\(|\)|[^\s()]+", expression.replace("/", " OR "))
    position = 0

    def peek() -> str:
        return tokens[position] if position < len(tokens) else ""

    def take() -> str:
        nonlocal position
        position += 1
        return tokens[position - 1]

    def either() -> bool:
        value = both()
        while peek() == "OR":
            take()
            value = both() or value
        return value

    def both() -> bool:
        value = one()
        while peek() == "AND":
            take()
            value = one() and value
        return value

    def one() -> bool:
        token = take()
        if token == "(":
            value = either()
            take()
            return value
        if peek() == "WITH":
            take()
            token = f"{token} WITH {take()}"
        return token in allowed

    return bool(tokens) and either() and position == len(tokens)


def license_faults(data: dict[str, Any], allowed: set[str]) -> list[str]:
    """Return a sentence for each package whose license is not allowed."""
    faults = []
    for package in data["packages"]:
        name = f"{package['name']} {package['version']}"
        text = package["license"]
        if not text:
            faults.append(f"The dependency {name} states no license.")
        elif not satisfied(text, allowed):
            faults.append(f"The dependency {name} has the license {text}, which deny.toml does not allow.")
    return faults


def main() -> int:
    """Print the faults and return the exit code."""
    allowed = set(tomllib.loads((ROOT / "deny.toml").read_text(encoding="utf-8"))["licenses"]["allow"])
    data = metadata()
    faults = direction_faults(data) + license_faults(data, allowed)
    for fault in faults:
        sys.stderr.write(f"{fault}\n")
    if not faults:
        sys.stdout.write(f"Dependencies are in order: {len(data['packages'])} packages.\n")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
