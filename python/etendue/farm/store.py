"""Files of a farm: packages, films, previews and outputs, in a folder or in object storage (fsspec).

Names are relative, with slashes: `packages/HASH.zip`, `jobs/JOB/films/…`, `jobs/JOB/previews/…`, `jobs/JOB/outputs/…`. A file appears
whole or not at all.
"""

from __future__ import annotations

import shutil
import uuid
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any, cast

import fsspec


class Store:
    """A folder by URL. Cheap to make; workers make their own from `url` and `options`."""

    def __init__(self, url: str, options: Mapping[str, Any] | None = None) -> None:
        self.url = url.rstrip("/")
        self.options = dict(options or {})
        filesystem, root = fsspec.core.url_to_fs(self.url, **self.options)
        self._fs = filesystem
        self._root = str(root).rstrip("/")
        self.is_local = "file" in _protocols(filesystem)
        """Whether it is a folder of this machine (or one that it mounts)."""

    def _path(self, name: str) -> str:
        parts = name.split("/")
        if not name or name.startswith("/") or "\\" in name or any(part in ("", ".", "..") for part in parts):
            raise ValueError(f"`{name}` is no name of a file in the store")
        return f"{self._root}/{name}"

    def write(self, name: str, data: bytes) -> None:
        """Write a file; one of the same name is replaced at once."""
        path = self._path(name)
        if not self.is_local:
            # Objects appear when they are complete.
            self._fs.pipe_file(path, data)
            return
        target = Path(path)
        target.parent.mkdir(parents=True, exist_ok=True)
        part = target.with_name(f".{target.name}.{uuid.uuid4().hex}")
        try:
            with part.open("wb") as out:
                out.write(data)
            part.replace(target)
        finally:
            part.unlink(missing_ok=True)

    def write_file(self, name: str, source: Path) -> None:
        """Copy a local file into the store, without holding it in memory."""
        path = self._path(name)
        if not self.is_local:
            self._fs.put_file(str(source), path)
            return
        target = Path(path)
        target.parent.mkdir(parents=True, exist_ok=True)
        part = target.with_name(f".{target.name}.{uuid.uuid4().hex}")
        try:
            shutil.copyfile(source, part)
            part.replace(target)
        finally:
            part.unlink(missing_ok=True)

    def read(self, name: str) -> bytes:
        """Return a file's bytes.

        Raises:
            FileNotFoundError: There is none.
        """
        return cast(bytes, self._fs.cat_file(self._path(name)))

    def open(self, name: str) -> IO[bytes]:
        """Open a file for reading, to stream it.

        Raises:
            FileNotFoundError: There is none.
        """
        return cast(IO[bytes], self._fs.open(self._path(name), "rb"))

    def fetch(self, name: str, target: Path) -> None:
        """Copy a file out of the store to a local path, which appears whole."""
        part = target.with_name(f".{target.name}.{uuid.uuid4().hex}")
        try:
            self._fs.get_file(self._path(name), str(part))
            part.replace(target)
        finally:
            part.unlink(missing_ok=True)

    def exists(self, name: str) -> bool:
        """Return whether there is such a file."""
        return bool(self._fs.exists(self._path(name)))

    def size(self, name: str) -> int:
        """Return a file's size in bytes."""
        return int(self._fs.size(self._path(name)))

    def delete(self, *names: str) -> None:
        """Delete files; those that are not there do not matter."""
        for name in names:
            try:
                self._fs.rm_file(self._path(name))
            except FileNotFoundError:
                continue

    def delete_folder(self, name: str) -> None:
        """Delete a folder with all that is in it; one that is not there does not matter."""
        try:
            self._fs.rm(self._path(name), recursive=True)
        except FileNotFoundError:
            return

    def names(self, folder: str) -> list[str]:
        """Return the names of all files below a folder, in order."""
        try:
            found = self._fs.find(self._path(folder))
        except FileNotFoundError:
            return []
        prefix = self._fs._strip_protocol(self._root).rstrip("/") + "/"
        return sorted(str(path).removeprefix(prefix) for path in found)


def _protocols(filesystem: Any) -> tuple[str, ...]:  # noqa: ANN401 - fsspec has no types
    protocol = filesystem.protocol
    return (protocol,) if isinstance(protocol, str) else tuple(protocol)
