"""Writing to the farm's log."""

from __future__ import annotations

from sqlalchemy.orm import Session

from etendue.farm.models import Event

MAX_MESSAGE = 4000
"""Longest message, in characters; more is cut off."""


def log(
    session: Session,
    kind: str,
    message: str,
    *,
    level: str = "info",
    user: int | None = None,
    job: int | None = None,
    frame: int | None = None,
    unit: int | None = None,
    node: str | None = None,
) -> None:
    """Add an event to the transaction. Control characters are shown as escapes, so that one message stays one line."""
    clean = "".join(c if c.isprintable() or c == "\n" else repr(c)[1:-1] for c in message[:MAX_MESSAGE])
    session.add(Event(kind=kind, message=clean, level=level, user_id=user, job_id=job, frame=frame, unit_id=unit, node=node))


def audit(session: Session, user: int | None, kind: str, message: str, *, job: int | None = None) -> None:
    """Add an event about what a person did, or what was refused."""
    log(session, kind, message, level="audit", user=user, job=job)
