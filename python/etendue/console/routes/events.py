"""News for open pages as server-sent events: what has changed, not how, so that pages ask for what they show."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import APIRouter, Query, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import StreamingResponse
from sqlalchemy import func, select

from etendue.console.auth import Console, TooOftenError, Who, console_of
from etendue.console.routes.parameters import refusals
from etendue.farm.accounts import Actor
from etendue.farm.errors import FarmError
from etendue.farm.models import Job, Node
from etendue.farm.service import Farm

router = APIRouter(tags=["events"])

SIGN_OF_LIFE_SECS = 15.0


class Pulse:
    """Asks the database now and then whether anything has changed: once for all open pages."""

    def __init__(self, farm: Farm, poll_secs: float) -> None:
        self._farm = farm
        self._poll_secs = poll_secs
        self._jobs: tuple[object, ...] = ()
        self._at = float("-inf")
        self._lock = asyncio.Lock()

    async def jobs(self) -> tuple[object, ...]:
        """Return something that differs whenever a job has changed."""
        async with self._lock:
            now = asyncio.get_running_loop().time()
            if now - self._at >= self._poll_secs * 0.9:
                self._jobs = await run_in_threadpool(self._ask)
                self._at = now
        return self._jobs

    def _ask(self) -> tuple[object, ...]:
        with self._farm.database.read() as session:
            jobs = session.execute(select(func.count(Job.id), func.max(Job.id), func.sum(Job.version), func.sum(Job.progress))).one()
            nodes = session.execute(
                select(Node.state, func.count(), func.sum(Node.running)).group_by(Node.state).order_by(Node.state)
            ).all()
        return (*jobs, *(tuple(row) for row in nodes))


@router.get(
    "/events",
    response_class=StreamingResponse,
    responses={**refusals(404), 200: {"content": {"text/event-stream": {}}, "description": "Events `jobs` and `job`."}},
)
async def events(request: Request, who: Who, job: Annotated[int | None, Query(ge=1, le=(1 << 31) - 1)] = None) -> StreamingResponse:
    """Follow the farm: an event `jobs` whenever the list of jobs has changed, or `job` with the job whenever that one has."""
    console = console_of(request)
    if job is not None:
        await run_in_threadpool(console.farm.jobs.get, who, job)
    if console.streams.get(who.id, 0) >= console.settings.max_streams:
        raise TooOftenError(f"you have {console.settings.max_streams} pages open that follow the farm; close some", 10)
    source = _stream(request, console, who, job)
    return StreamingResponse(source, media_type="text/event-stream", headers={"Cache-Control": "no-store", "X-Accel-Buffering": "no"})


async def _stream(request: Request, console: Console, who: Actor, job: int | None) -> AsyncIterator[str]:
    pulse: Pulse = request.app.state.pulse
    loop = asyncio.get_running_loop()
    console.streams[who.id] = console.streams.get(who.id, 0) + 1
    try:
        yield "retry: 2000\n\n"
        last: object = None
        alive_at = loop.time()
        while not await request.is_disconnected():
            if job is None:
                news = await pulse.jobs()
                text = "event: jobs\ndata: {}\n\n"
            else:
                found = await run_in_threadpool(console.farm.jobs.get, who, job)
                news = (found.version, found.state, found.progress, found.units_done, found.priority)
                text = f"event: job\ndata: {found.model_dump_json()}\n\n"
            if news != last:
                last = news
                alive_at = loop.time()
                yield text
            elif loop.time() - alive_at > SIGN_OF_LIFE_SECS:
                alive_at = loop.time()
                # Who has been signed out or shut out hears no more.
                if not await run_in_threadpool(_is_welcome, console, request, who):
                    return
                yield ": still here\n\n"
            await asyncio.sleep(console.settings.poll_secs)
    except FarmError as e:
        yield f"event: gone\ndata: {json.dumps({'message': str(e)})}\n\n"
    finally:
        console.streams[who.id] -= 1


def _is_welcome(console: Console, request: Request, who: Actor) -> bool:
    authorization = request.headers.get("authorization")
    if authorization is not None:
        found = console.farm.accounts.by_token(authorization.partition(" ")[2].strip())
    else:
        session = console.farm.accounts.by_cookie(request.cookies.get(console.cookie, ""))
        found = session.actor if session else None
    return found is not None and found.id == who.id
