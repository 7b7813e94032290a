"""Which files of a folder belong to a scene: those that it has read, and those that its text files name.

A scene can make up names as it runs (POV-Ray: `concat("bump", str(frame_number, 0, 0), ".png")`); for those there is `include`.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from urllib.parse import unquote

from etendue.farm.errors import InvalidError

TEXTS = {".xml", ".pov", ".inc", ".mcr", ".ini", ".pbrt", ".gltf", ".obj", ".mtl", ".glb"}
"""Files that name others."""
MAX_TEXT = 256 << 20
"""Larger files are not searched for names."""
MAX_SEEN = 100_000
"""Most files of a folder that are looked at."""


def scene_files(scene: Path, read: Iterable[str], include: Sequence[str] = (), *, everything: bool = False) -> tuple[Path, list[str]]:
    """Return the folder of a package and the paths of its files within it.

    Args:
        scene: The scene file.
        read: Files that reading the scene has opened; those elsewhere, such as POV-Ray's own includes, are left out.
        include: Patterns, such as `textures/**/*.png`, of further files.
        everything: Take all files of the folder.

    Raises:
        InvalidError: A pattern has no files, or there are too many.
    """
    folder = scene.resolve().parent
    known = _files(folder)
    if everything:
        return folder, sorted(known)
    taken = {scene.name}
    for name in read:
        path = _inside(folder, folder / name)
        if path is not None and path in known:
            taken.add(path)
    for pattern in include:
        try:
            found = {p for match in folder.glob(pattern) if (p := _inside(folder, match)) in known and p is not None}
        except (ValueError, NotImplementedError) as e:
            raise InvalidError(f"`{pattern}` is no pattern of files: {e}") from e
        if not found:
            raise InvalidError(f"no file of {folder} fits `{pattern}`")
        taken |= found
    by_name: dict[str, list[str]] = {}
    for path in known:
        by_name.setdefault(path.rsplit("/", 1)[-1].lower(), []).append(path)
    todo, searched = sorted(taken), set(taken)
    while todo:
        path = todo.pop()
        for other in sorted(_named(folder / path, by_name) - searched):
            searched.add(other)
            taken.add(other)
            todo.append(other)
    return folder, sorted(taken)


def _files(folder: Path) -> set[str]:
    """Return the paths of all ordinary files, without those that are hidden or linked."""
    found: set[str] = set()
    for root, folders, files in os.walk(folder):
        folders[:] = sorted(d for d in folders if not d.startswith(".") and d != "__pycache__")
        for name in files:
            path = Path(root) / name
            if not name.startswith(".") and path.is_file() and not path.is_symlink():
                found.add(path.relative_to(folder).as_posix())
        if len(found) > MAX_SEEN:
            raise InvalidError(f"{folder} has more than {MAX_SEEN} files; put the scene into a folder of its own")
    return found


def _inside(folder: Path, path: Path) -> str | None:
    try:
        return path.resolve().relative_to(folder).as_posix()
    except ValueError:
        return None


def _named(file: Path, by_name: dict[str, list[str]]) -> set[str]:
    """Return the files whose names stand in a text file."""
    if file.suffix.lower() not in TEXTS or file.stat().st_size > MAX_TEXT:
        return set()
    text = file.read_bytes().decode("utf-8", "replace").lower()
    texts = (text, unquote(text)) if "%" in text else (text,)
    return {path for name, paths in by_name.items() if any(name in t for t in texts) for path in paths}
