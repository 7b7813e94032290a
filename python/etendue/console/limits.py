"""Limits on what comes in: how much at a time, and how often. Counted in this process."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable

from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

MOST_KEYS = 10_000
"""Users and addresses that are remembered; the longest unheard of are forgotten."""


class Bucket:
    """A rate limit for each key: so many at once, and so many a second in the long run (token bucket)."""

    def __init__(self, per_sec: float, burst: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._per_sec = per_sec
        self._burst = burst
        self._clock = clock
        self._left: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def wait_secs(self, key: str) -> float:
        """Return how long a key has to wait for its next turn; 0 for not at all. Takes nothing."""
        left = self._now(key)
        return 0.0 if left >= 1 else (1 - left) / self._per_sec

    def take(self, key: str) -> float:
        """Take one; return 0, or how long the key has to wait."""
        left = self._now(key)
        if left < 1:
            return (1 - left) / self._per_sec
        self._left[key] = (left - 1, self._clock())
        self._left.move_to_end(key)
        while len(self._left) > MOST_KEYS:
            self._left.popitem(last=False)
        return 0.0

    def _now(self, key: str) -> float:
        left, at = self._left.get(key, (self._burst, self._clock()))
        return min(self._burst, left + (self._clock() - at) * self._per_sec)


class BodyLimit:
    """ASGI middleware that refuses bodies over a limit, by what their header says and by what really comes.

    The refusal is raised where the body is read, so that it is answered and logged like any other.
    """

    def __init__(self, app: ASGIApp, *, limit: int, upload_limit: int, upload_path: str) -> None:
        self._app = app
        self._limit = limit
        self._upload_limit = upload_limit
        self._upload_path = upload_path

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        is_upload = scope["path"] == self._upload_path and scope["method"] == "POST"
        limit = self._upload_limit if is_upload else self._limit
        came = 0
        lengths = [value for name, value in scope["headers"] if name == b"content-length"]
        is_told_too_large = any(not value.isdigit() or int(value) > limit for value in lengths)

        async def counted() -> Message:
            nonlocal came
            if is_told_too_large or came > limit:
                raise HTTPException(413, f"a request here has at most {limit} bytes")
            message = await receive()
            if message["type"] == "http.request":
                came += len(message.get("body", b""))
                if came > limit:
                    raise HTTPException(413, f"a request here has at most {limit} bytes")
            return message

        await self._app(scope, counted, send)
