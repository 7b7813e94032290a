"""The viewer of one scene: a page, a WebSocket with pictures that sharpen, and downloads.

It serves one user on this machine: it listens on a loopback address, answers only to its own host names, and lets in who
knows the random token of its address.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import secrets
import tempfile
from collections.abc import AsyncIterator, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from fastapi import FastAPI, HTTPException, Request, WebSocket, WebSocketDisconnect
from fastapi.responses import FileResponse, RedirectResponse, Response
from fastapi.staticfiles import StaticFiles
from starlette.background import BackgroundTask

import etendue
from etendue.console.live import Live, picture_size
from etendue.console.security import SecurityHeaders
from etendue.console.wire import encode_layer

STATIC = Path(__file__).parent / "static"
COOKIE = "etendue-view"
LARGEST_EDGE = 4096
"""Largest picture edge that a page may ask for, in pixels."""


class Viewers:
    """Who is to be told of new pictures."""

    def __init__(self) -> None:
        self._loop: asyncio.AbstractEventLoop | None = None
        self._events: set[asyncio.Event] = set()

    def attach(self, loop: asyncio.AbstractEventLoop) -> None:
        """Name the event loop of the server."""
        self._loop = loop

    def tell(self) -> None:
        """Wake all; from any thread."""
        if self._loop is not None:
            with contextlib.suppress(RuntimeError):
                self._loop.call_soon_threadsafe(self._wake)

    def _wake(self) -> None:
        for event in self._events:
            event.set()

    @contextlib.contextmanager
    def waiting(self) -> Iterator[asyncio.Event]:
        """Give an event that is set whenever there is something new."""
        event = asyncio.Event()
        self._events.add(event)
        try:
            yield event
        finally:
            self._events.discard(event)


def create_app(live: Live, viewers: Viewers, token: str, hosts: frozenset[str], title: str) -> FastAPI:
    """Make the web application.

    Args:
        live: What renders; not started yet. Its `changed` must be `viewers.tell`.
        viewers: Who is told.
        token: What the address of the page must hold as `token`.
        hosts: Values of the Host header that are answered, such as `127.0.0.1:8750`.
        title: What the page calls the scene.
    """

    @contextlib.asynccontextmanager
    async def lifespan(_app: FastAPI) -> AsyncIterator[None]:
        viewers.attach(asyncio.get_running_loop())
        live.start()
        yield
        await asyncio.to_thread(live.close)

    app = FastAPI(title="Etendue viewer", docs_url=None, redoc_url=None, openapi_url=None, lifespan=lifespan)
    app.add_middleware(SecurityHeaders)
    app.mount("/static", StaticFiles(directory=STATIC), name="static")

    def is_welcome(host: str | None, given: str | None) -> bool:
        return host in hosts and given is not None and secrets.compare_digest(given.encode(), token.encode())

    def check(request: Request) -> None:
        if not is_welcome(request.headers.get("host"), request.cookies.get(COOKIE)):
            raise HTTPException(403, "Open the address that `etendue view` has printed: it holds the key of this page.")

    @app.get("/", include_in_schema=False)
    async def page(request: Request, token: str | None = None) -> Response:
        if token is None:
            check(request)
            return FileResponse(STATIC / "viewer.html")
        if not is_welcome(request.headers.get("host"), token):
            raise HTTPException(403, "This is not the key of this page; open the address that `etendue view` has printed.")
        # The key goes from the address, which browsers keep in their history, to a cookie.
        response = RedirectResponse("/", status_code=303)
        response.set_cookie(COOKIE, token, httponly=True, samesite="strict")
        return response

    @app.get("/save/{name}.{kind}")
    async def save(request: Request, name: str, kind: str, tonemap: str = "standard", exposure: float = 0.0) -> Response:
        check(request)
        frame = live.frame
        if kind not in ("exr", "png", "jpg", "hdr") or not math.isfinite(exposure):
            raise HTTPException(422, "Pictures are saved as exr, png, jpg or hdr.")
        if frame is None:
            raise HTTPException(409, "There is no picture yet.")
        folder = tempfile.TemporaryDirectory()
        path = Path(folder.name) / f"picture.{kind}"
        layers = dict(frame.layers) if kind == "exr" else {"rgb": frame.layers["rgb"]}
        try:
            await asyncio.to_thread(etendue.write_image, path, layers, tonemap=tonemap, exposure=exposure)
        except etendue.SettingError as e:
            folder.cleanup()
            raise HTTPException(422, str(e)) from e
        headers = {"Content-Disposition": f"attachment; filename*=UTF-8''{quote(name)}.{kind}"}
        return FileResponse(path, headers=headers, background=BackgroundTask(folder.cleanup))

    @app.websocket("/live")
    async def pictures(socket: WebSocket) -> None:
        origin = socket.headers.get("origin", "")
        host = socket.headers.get("host")
        if not is_welcome(host, socket.cookies.get(COOKIE)) or origin != f"http://{host}":
            await socket.close(4403)
            return
        await socket.accept()
        page = _Page(socket, live, title)
        with viewers.waiting() as event, contextlib.suppress(WebSocketDisconnect, RuntimeError):
            await page.serve(event)

    return app


class _Page:
    """One open page."""

    def __init__(self, socket: WebSocket, live: Live, title: str) -> None:
        self._socket = socket
        self._live = live
        self._title = title
        self._layer = "rgb"
        self._sent: tuple[int, str] | None = None
        self._scene_number = 0
        self._said: str | None = None
        # One picture is on its way at a time: a slow browser gets fewer of them, never old ones.
        self._is_ready = True

    async def serve(self, event: asyncio.Event) -> None:
        """Send news and take orders until the page is closed."""
        orders = asyncio.create_task(self._take_orders(event))
        try:
            while not orders.done():
                event.clear()
                await self._send_news()
                waiter = asyncio.create_task(event.wait())
                await asyncio.wait({waiter, orders}, return_when=asyncio.FIRST_COMPLETED)
                waiter.cancel()
        finally:
            orders.cancel()
            with contextlib.suppress(asyncio.CancelledError, WebSocketDisconnect):
                await orders

    async def _send_news(self) -> None:
        if self._scene_number != self._live.scene_number:
            self._scene_number = self._live.scene_number
            await self._socket.send_json(self._about())
        error = self._live.error
        state = json.dumps({"type": "state", "error": error, "paused": self._live.is_paused})
        if state != self._said:
            self._said = state
            await self._socket.send_text(state)
        frame = self._live.frame
        if frame is None or not self._is_ready:
            return
        layer = self._layer if self._layer in frame.layers else "rgb"
        if self._sent == (frame.number, layer):
            return
        self._sent, self._is_ready = (frame.number, layer), False
        meta = {
            "number": frame.number,
            "spp": frame.spp_done,
            "target": frame.spp_target,
            "error": frame.relative_error,
            "seconds": round(frame.elapsed_secs, 3),
            "scale": frame.scale,
            "done": frame.is_done,
            "generation": frame.generation,
            "pivot": frame.pivot(),
            "layers": list(frame.layers),
        }
        await self._socket.send_bytes(await asyncio.to_thread(encode_layer, layer, frame.layers[layer], meta))

    def _about(self) -> dict[str, object]:
        scene, look = self._live.scene, self._live.look
        info = scene.info()
        view = scene.view()
        width, height = picture_size(scene, look.settings)
        return {
            "type": "scene",
            "title": self._title,
            "info": {**info, "files": [Path(f).name for f in info["files"]][:50]},
            "losses": [[Path(loss.file).name, loss.line, loss.feature, loss.effect] for loss in scene.losses][:200],
            "warnings": [[Path(fault.file).name, fault.line, fault.message] for fault in scene.warnings][:200],
            "integrators": etendue.integrators(),
            "settings": {k: v for k, v in look.settings.items() if v is not None},
            "width": width,
            "height": height,
            "matrix": view.world_from_camera.ravel().tolist(),
        }

    async def _take_orders(self, event: asyncio.Event) -> None:
        while True:
            text = await self._socket.receive_text()
            try:
                answer = self._obey(json.loads(text))
                if answer is not None:
                    await self._socket.send_json(answer)
            except (ValueError, TypeError, KeyError, etendue.Error) as e:
                await self._socket.send_json({"type": "refused", "message": str(e) or type(e).__name__})
            event.set()

    def _obey(self, order: dict[str, Any]) -> dict[str, object] | None:
        look = self._live.look
        match order["type"]:
            case "ready":
                self._is_ready = True
            case "layer":
                self._layer = str(order["layer"])
            case "pause":
                self._live.pause(bool(order["paused"]))
            case "camera":
                matrix = np.array(order["matrix"], dtype=np.float64).reshape(4, 4)
                zoom = float(order.get("zoom", 1.0))
                # Refused here rather than in the thread.
                self._live.scene.with_view(matrix, zoom)
                self._live.show(replace(look, world_from_camera=matrix, zoom=zoom, is_moving=bool(order.get("moving", False))))
            case "reset":
                self._live.show(replace(look, world_from_camera=None, zoom=1.0, is_moving=True))
            case "settings":
                self._live.show(replace(look, settings=_settings(look.settings, order["settings"]), is_moving=False))
            case "point":
                frame = self._live.frame
                return {"type": "point", "point": frame.point(float(order["u"]), float(order["v"])) if frame else None}
            case other:
                raise ValueError(f"no order {other!r}")
        return None


_WHOLE = {"width": (1, LARGEST_EDGE), "height": (1, LARGEST_EDGE), "spp": (1, 1 << 20), "max_depth": (0, 10_000), "seed": (0, 1 << 31)}
_NAMES = ("integrator", "sampler", "filter", "light_sampler", "camera")


def _settings(old: Mapping[str, object], given: dict[str, Any]) -> dict[str, object]:
    """Return the settings with what a page asks for; None takes one back."""
    settings = dict(old)
    for name, value in given.items():
        if value is None:
            settings.pop(name, None)
        elif name in _WHOLE:
            least, most = _WHOLE[name]
            if not isinstance(value, int) or not least <= value <= most:
                raise ValueError(f"`{name}` takes a whole number from {least} to {most}")
            settings[name] = value
        elif name in _NAMES:
            settings[name] = str(value)[:200]
        else:
            raise ValueError(f"no setting `{name}` here")
    return settings
