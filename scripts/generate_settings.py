"""Write python/etendue/_settings.py, the typed keywords of `Scene.render`, from the renderer's own declaration.

Needs the installed package. Run it after a change of crates/scene/src/settings.rs; python/tests check that it was run.
"""

import sys
from pathlib import Path

import etendue

TYPES = {"integer": "int", "number": "float", "switch": "bool"}
TARGET = Path(__file__).parent.parent / "python" / "etendue" / "_settings.py"


def text() -> str:
    """Return the content of the file."""
    lines = [
        '"""Typed keywords of `Scene.render`. Made by scripts/generate_settings.py; do not edit."""',
        "",
        "from typing import TypedDict",
        "",
        "",
        "class RenderSettings(TypedDict, total=False):",
        '    """How to render a scene. None leaves the choice to the scene file, then to the renderer."""',
        "",
    ]
    for parameter in etendue.parameters():
        lines.append(f"    {parameter.name}: {TYPES.get(parameter.kind, 'str')} | None")
        lines.append(f'    """{parameter.doc}"""')
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    TARGET.write_text(text(), encoding="utf-8")
    sys.stdout.write(f"{TARGET} is written.\n")
