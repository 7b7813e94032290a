"""What the farm refuses, each with a sentence for people and a word for programs."""

from __future__ import annotations

from etendue._errors import Error


class FarmError(Error):
    """Any refusal of the farm. `status` is what the REST API answers, `exit_code` what the command line exits with."""

    code = "failed"
    status = 500
    exit_code = 1


class InvalidError(FarmError):
    """What was asked for does not make sense."""

    code = "invalid"
    status = 422
    exit_code = 2


class NotFoundError(FarmError):
    """There is no such thing, or not for this user: strangers are not told which."""

    code = "not-found"
    status = 404
    exit_code = 6

    def __init__(self, message: str, *, is_foreign: bool = False) -> None:
        super().__init__(message)
        self.is_foreign = is_foreign
        """Whether it is there and belongs to someone else: for the log alone."""


class ForbiddenError(FarmError):
    """The user's role does not allow it."""

    code = "forbidden"
    status = 403
    exit_code = 5


class ConflictError(FarmError):
    """It does not go with the present state, such as pausing a job that has ended."""

    code = "conflict"
    status = 409
    exit_code = 6


class TooLargeError(FarmError):
    """An upload is over a limit."""

    code = "too-large"
    status = 413
    exit_code = 3


class QuotaError(FarmError):
    """The user's quota is used up."""

    code = "quota"
    status = 429
    exit_code = 5


class PackageError(FarmError):
    """A package is damaged, or an attack."""

    code = "package"
    status = 422
    exit_code = 3
