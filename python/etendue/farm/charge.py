"""Who is in charge of a farm: one scheduler at a time, which says so in the database every few seconds."""

from __future__ import annotations

import os
import socket
import time
import uuid

from sqlalchemy.orm import Session

from etendue.farm.errors import ConflictError
from etendue.farm.models import Setting

KEY = "scheduler"
"""The setting in which the scheduler tells that it is at work."""
VALID_SECS = 15.0
"""A scheduler that has not told so for this time is gone."""


class Charge:
    """One scheduler's claim to a farm. Each function changes the setting within the caller's transaction."""

    def __init__(self) -> None:
        self._token = uuid.uuid4().hex

    def take(self, session: Session) -> str:
        """Take the farm, and return who has done so.

        Raises:
            ConflictError: Another scheduler has it.
        """
        row = session.get(Setting, KEY)
        if row is not None and is_held(session) and _may_run(row.value):
            raise ConflictError(f"a scheduler of this farm is at work already (process {row.value.get('pid')} on {row.value.get('host')})")
        value = {"token": self._token, "at": time.time(), "pid": os.getpid(), "host": socket.gethostname()}
        if row is None:
            session.add(Setting(key=KEY, value=value))
        else:
            row.value = value
        return f"process {value['pid']} on {value['host']}"

    def renew(self, session: Session) -> bool:
        """Say that this scheduler is at work. False where another has taken the farm, as after a long sleep of this machine."""
        row = session.get(Setting, KEY)
        if row is None or row.value.get("token") != self._token:
            return False
        row.value = {**row.value, "at": time.time()}
        return True

    def release(self, session: Session) -> None:
        """Give the farm up, where it is this scheduler's."""
        row = session.get(Setting, KEY)
        if row is not None and row.value.get("token") == self._token:
            session.delete(row)


def is_held(session: Session) -> bool:
    """Return whether a scheduler has told lately that it is at work."""
    row = session.get(Setting, KEY)
    return row is not None and bool(row.value) and time.time() - float(row.value.get("at", 0.0)) < VALID_SECS


def _may_run(value: dict[str, object]) -> bool:
    """Return whether the process that a scheduler's row names may still run."""
    if value.get("host") != socket.gethostname():
        return True
    try:
        os.kill(int(str(value.get("pid"))), 0)
    except (ProcessLookupError, ValueError):
        return False
    except PermissionError:
        return True
    return True
