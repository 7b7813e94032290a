"""What can go wrong. Files that cannot be opened raise `OSError`, such as `FileNotFoundError`."""

from collections.abc import Iterable
from typing import NamedTuple


class Fault(NamedTuple):
    """One fault of a scene."""

    file: str
    """The file; for a scene from a dictionary the path of keys, such as `dict["floor"]["bsdf"]`."""
    line: int | None
    """Line, from 1; None where it is not known."""
    column: int | None
    """Column in characters, from 1; None where it is not known."""
    severity: str
    """`error` or `warning`."""
    message: str
    """What is wrong, in one sentence."""


class Error(Exception):
    """Any error of the renderer."""


class SceneError(Error, ValueError):
    """A scene has faults. The message holds all of them with their places, one to a line."""

    faults: list[Fault]
    """Every fault that was found."""

    def __init__(self, message: str, faults: Iterable[tuple[str, int | None, int | None, str, str]] = ()) -> None:
        super().__init__(message)
        self.faults = [Fault(*fault) for fault in faults]

    def __reduce__(self) -> tuple[type["SceneError"], tuple[str, list[Fault]]]:
        # So that worker processes can hand it over with its faults.
        return type(self), (str(self), self.faults)


class UnsupportedError(Error, ValueError):
    """A file is of a kind that is not read or written."""


class SettingError(Error, ValueError):
    """A setting has a value that does not fit."""


class ImageError(Error, ValueError):
    """A picture is damaged, too large, or not of the shape that is needed."""
