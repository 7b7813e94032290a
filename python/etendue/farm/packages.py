"""Scene packages: a scene with all its files, named by their content.

Uploads are hostile: names with `..`, absolute or of other systems, links, files that expand without end, thousands of files, two files of
one name. All of it is checked before a byte is written, and again while it is written, since a zip's directory may lie about sizes. What is
kept is a zip of our own making, so that workers unpack only those, with the same checks.
"""

from __future__ import annotations

import hashlib
import json
import os
import posixpath
import re
import shutil
import stat
import tempfile
import unicodedata
import zipfile
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, NamedTuple

from etendue.farm.config import Limits
from etendue.farm.errors import PackageError, TooLargeError

SCENES = (".xml", ".pov", ".pbrt", ".gltf", ".glb", ".obj", ".ply", ".stl")
"""Endings of scene files, the more telling first."""
CHUNK = 1 << 20
# Reserved on Windows, where a package may be unpacked by someone who fetches it.
_RESERVED = re.compile(r"(?i)(con|prn|aux|nul|com\d|lpt\d)(\..*)?")
_SMALL = 64 << 20


class PackedFile(NamedTuple):
    """A file of a package."""

    path: str
    """Relative, with slashes."""
    bytes: int
    sha256: str


class Manifest(NamedTuple):
    """What a package holds."""

    files: list[PackedFile]
    """In the order of their paths."""

    @property
    def id(self) -> str:
        """The package's name: SHA-256 of the paths, sizes and hashes of its files."""
        rows = [[f.path, f.bytes, f.sha256] for f in self.files]
        return hashlib.sha256(json.dumps(rows, separators=(",", ":"), ensure_ascii=True).encode()).hexdigest()

    @property
    def bytes(self) -> int:
        """Bytes of all files."""
        return sum(f.bytes for f in self.files)


def check_name(name: str) -> str:
    """Return a file's path within a package in its normal form.

    Raises:
        PackageError: It leads out of the package, or is no name on some system.
    """
    shown = ascii(name[:120])
    if not name or len(name.encode("utf-8", "surrogatepass")) > 1000:
        raise PackageError(f"the package has a file whose name is empty or too long: {shown}")
    if "\\" in name or ":" in name or name.startswith("/"):
        raise PackageError(f"the package has a file with an absolute path or backslashes: {shown}")
    if any(unicodedata.category(c) in ("Cc", "Cs", "Cf") for c in name):
        raise PackageError(f"the package has a file with control characters in its name: {shown}")
    parts = name.split("/")
    if any(part in ("", ".", "..") for part in parts):
        raise PackageError(f"the package has a file outside of it: {shown}")
    if len(parts) > 64 or any(len(part.encode()) > 255 or _RESERVED.fullmatch(part) or part[-1] in ". " for part in parts):
        raise PackageError(f"the package has a file with a name that is none on every system: {shown}")
    return unicodedata.normalize("NFC", name)


def unpack_zip(source: Path | IO[bytes], target: Path, limits: Limits) -> list[str]:
    """Unpack a zip into an empty folder and return the paths of its files.

    Raises:
        PackageError: It is damaged, or has a file that does not belong into a package.
        TooLargeError: It has too many or too large files.
    """
    try:
        with zipfile.ZipFile(source) as archive:
            entries = [entry for entry in archive.infolist() if not entry.is_dir()]
            _check_entries(entries, limits)
            left = limits.package_bytes
            paths = []
            for entry in entries:
                path = check_name(entry.filename)
                out_path = target.joinpath(*path.split("/"))
                out_path.parent.mkdir(parents=True, exist_ok=True)
                # Each file gets no more than its directory entry says, whatever its data expand to.
                with archive.open(entry) as data, out_path.open("xb") as out:
                    written = _copy(data, out, min(entry.file_size, left))
                if written != entry.file_size:
                    raise PackageError(f"the package lies about the size of {entry.filename[:120]!a}")
                left -= written
                paths.append(path)
            return paths
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, UnicodeDecodeError) as e:
        raise PackageError(f"the package is no zip file that can be read: {e}") from e
    except (FileExistsError, NotADirectoryError) as e:
        raise PackageError("the package has two files of one name") from e
    except (RuntimeError, ValueError) as e:
        # Encrypted entries, and headers that contradict themselves.
        raise PackageError(f"the package cannot be unpacked: {e}") from e
    except OSError as e:
        raise PackageError(f"the package cannot be unpacked: {e.strerror or e}") from e


def _check_entries(entries: list[zipfile.ZipInfo], limits: Limits) -> None:
    if not entries:
        raise PackageError("the package is empty")
    if len(entries) > limits.package_files:
        raise TooLargeError(f"the package has {len(entries)} files; at most {limits.package_files} are allowed")
    seen: set[str] = set()
    for entry in entries:
        path = check_name(entry.filename)
        mode = entry.external_attr >> 16
        if mode and stat.S_IFMT(mode) not in (0, stat.S_IFREG):
            raise PackageError(f"the package has a link or device: {entry.filename[:120]!a}")
        if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise PackageError("the package is compressed in a way that is not usual for zip files")
        if entry.flag_bits & 0x1:
            raise PackageError("the package is encrypted")
        # Systems that do not tell capital from small letters would mix these up.
        folded = path.casefold()
        if folded in seen:
            raise PackageError(f"the package has two files of one name: {entry.filename[:120]!a}")
        seen.add(folded)
    total, packed = sum(e.file_size for e in entries), sum(e.compress_size for e in entries)
    if total > limits.package_bytes:
        raise TooLargeError(f"the package has {total} bytes unpacked; at most {limits.package_bytes} are allowed")
    if total > max(_SMALL, limits.expansion * packed):
        raise PackageError(f"the package would grow from {packed} to {total} bytes, as zip bombs do")


def _copy(source: IO[bytes], out: IO[bytes], limit: int) -> int:
    """Copy up to `limit` bytes and one more that tells of a lie; return how many there were."""
    done = 0
    while True:
        data = source.read(min(CHUNK, limit + 1 - done))
        if not data:
            return done
        done += len(data)
        if done > limit:
            return done
        out.write(data)


def manifest(folder: Path, paths: Iterable[str], limits: Limits) -> Manifest:
    """Return what a package of some files of a folder holds.

    Raises:
        PackageError: A path leads out of the folder, or is no file.
        TooLargeError: There are too many or too large files.
    """
    files: list[PackedFile] = []
    total = 0
    for path in sorted(set(paths)):
        check_name(path)
        file = folder / path
        info = file.lstat()
        if not stat.S_ISREG(info.st_mode):
            raise PackageError(f"`{path}` is no ordinary file")
        total += info.st_size
        if len(files) >= limits.package_files:
            raise TooLargeError(f"the scene has more than {limits.package_files} files")
        if total > limits.package_bytes:
            raise TooLargeError(f"the scene's files have more than {limits.package_bytes} bytes")
        with file.open("rb") as data:
            files.append(PackedFile(path, info.st_size, hashlib.file_digest(data, "sha256").hexdigest() if _HAS_DIGEST else _sha256(data)))
    if not files:
        raise PackageError("the package is empty")
    return Manifest(files)


_HAS_DIGEST = hasattr(hashlib, "file_digest")  # Python 3.11


def _sha256(data: IO[bytes]) -> str:
    digest = hashlib.sha256()
    while chunk := data.read(CHUNK):
        digest.update(chunk)
    return digest.hexdigest()


def write_zip(folder: Path, files: Iterable[PackedFile], target: Path) -> None:
    """Write files of a folder to a zip. The same files give the same bytes."""
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED, compresslevel=3) as archive:
        for file in files:
            entry = zipfile.ZipInfo(file.path, (1980, 1, 1, 0, 0, 0))
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = (stat.S_IFREG | 0o644) << 16
            with (folder / file.path).open("rb") as data, archive.open(entry, "w", force_zip64=True) as out:
                shutil.copyfileobj(data, out, CHUNK)


def find_scene(paths: Iterable[str]) -> str:
    """Return the scene file among a package's: the one nearest to the root, of the most telling ending.

    Raises:
        PackageError: There is none, or there are several.
    """
    found = [(p.count("/"), SCENES.index(ending), p) for p in paths if (ending := posixpath.splitext(p)[1].lower()) in SCENES]
    if not found:
        raise PackageError(f"the package has no scene file ({', '.join(SCENES)})")
    best = min(found)
    same = sorted(p for depth, kind, p in found if (depth, kind) == best[:2])
    # `scene.pov` among others is what it says.
    named = [p for p in same if posixpath.splitext(posixpath.basename(p))[0].lower() in ("scene", "main")]
    if len(same) > 1 and len(named) != 1:
        raise PackageError(f"the package has several scene files: {', '.join(same[:8])}; name one")
    return named[0] if len(same) > 1 else same[0]


@contextmanager
def unpacked_upload(data: IO[bytes], filename: str, limits: Limits) -> Iterator[tuple[Path, Manifest]]:
    """Write an upload, a zip or a single scene file, to a temporary folder; gives that folder and what is in it."""
    with tempfile.TemporaryDirectory(prefix="etendue-upload-") as temporary:
        folder = Path(temporary) / "files"
        folder.mkdir()
        upload = Path(temporary) / "upload"
        with upload.open("wb") as out:
            if _copy(data, out, limits.upload_bytes) > limits.upload_bytes:
                raise TooLargeError(f"uploads have at most {limits.upload_bytes} bytes")
        if zipfile.is_zipfile(upload) and not filename.lower().endswith(SCENES):
            paths = unpack_zip(upload, folder, limits)
        else:
            name = check_name(posixpath.basename(filename.replace("\\", "/")))
            if not name.lower().endswith(SCENES):
                raise PackageError(f"uploads are zip files or single scenes ({', '.join(SCENES)})")
            upload.replace(folder / name)
            paths = [name]
        yield folder, manifest(folder, paths, limits)


def cached_package(package: str, fetch: Any, cache: Path, limits: Limits) -> Path:  # noqa: ANN401 - Callable[[Path], None]
    """Return the folder of an unpacked package on this machine; `fetch(path)` gets the zip where it is not there yet.

    Several workers of one machine may ask at once: one of them fetches. The content is checked against the name, so that nobody can put
    another scene in its place. Files and folders are read-only.
    """
    folder = cache / package
    if (folder / ".complete").exists():
        os.utime(folder / ".complete")
        return folder
    cache.mkdir(parents=True, exist_ok=True)
    with _locked(cache / f"{package}.lock"):
        if (folder / ".complete").exists():
            return folder
        shutil.rmtree(folder, ignore_errors=True)
        with tempfile.TemporaryDirectory(prefix=".fetch-", dir=cache) as temporary:
            packed, files = Path(temporary) / "package.zip", Path(temporary) / "files"
            files.mkdir()
            fetch(packed)
            paths = unpack_zip(packed, files, limits)
            found = manifest(files, paths, limits).id
            if found != package:
                raise PackageError(f"the package {package[:12]}… has arrived with another content")
            (files / ".complete").touch()
            files.rename(folder)
    return folder


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    try:
        import fcntl
    except ImportError:  # Windows: the worst is that two workers fetch the same
        yield
        return
    with path.open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
