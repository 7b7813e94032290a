"""Parameters that several routes take, and what they answer when they refuse."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import Path, Query
from pydantic import BaseModel, Field, StringConstraints

PLAIN = r"^[^\x00-\x1f\x7f]*$"
"""No control characters."""

JobId = Annotated[int, Path(ge=1, le=(1 << 31) - 1, description="Number of a job.")]
FrameNumber = Annotated[int, Path(ge=0, le=(1 << 31) - 1, description="Number of a frame; 0 for a still.")]
Offset = Annotated[int, Query(ge=0, le=1 << 31, description="Items to leave out.")]
Limit = Annotated[int, Query(ge=0, le=1000, description="Most items of the answer.")]
Time = Annotated[float | None, Query(ge=0, le=1e11, description="Seconds since 1970 in UTC.")]
Name = Annotated[str, StringConstraints(min_length=1, max_length=64, pattern=PLAIN)]
Password = Annotated[str, Field(min_length=1, max_length=1024)]


class ErrorBody(BaseModel):
    """What went wrong."""

    code: str
    """A word for programs, such as `not-found`."""
    message: str
    """A sentence for people."""


class Refusal(BaseModel):
    """The answer to a request that is refused."""

    error: ErrorBody


def refusals(*codes: int) -> dict[int | str, dict[str, Any]]:
    """Return descriptions of refusals for a route, beside those that all have."""
    words = {
        401: "Nobody is signed in, or the token is not known.",
        403: "The user's role does not allow it.",
        404: "There is no such thing, for this user.",
        409: "It does not go with the present state.",
        413: "It is too large.",
        422: "What was asked for does not make sense.",
        429: "Too often, or over a quota.",
    }
    return {code: {"model": Refusal, "description": words[code]} for code in sorted({401, 422, 429, *codes})}
