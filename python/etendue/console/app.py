"""The console of a farm: REST API, event stream and pages, over a farm's services.

```python
import uvicorn
from etendue.console.app import create_app
from etendue.farm.service import Farm

uvicorn.run(create_app(Farm.open()), host="127.0.0.1", port=8640)
```
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import FileResponse, JSONResponse, RedirectResponse, Response
from fastapi.routing import APIRoute
from fastapi.staticfiles import StaticFiles
from starlette.exceptions import HTTPException
from starlette.middleware.trustedhost import TrustedHostMiddleware

import etendue
from etendue.console import auth
from etendue.console.auth import Console, TooOftenError, address_of, console_of
from etendue.console.limits import BodyLimit
from etendue.console.routes import events, farm, jobs, pictures, session
from etendue.console.security import SecurityHeaders
from etendue.console.settings import ConsoleSettings
from etendue.farm.errors import FarmError, NotFoundError
from etendue.farm.service import Farm

logger = logging.getLogger("etendue.console")

STATIC = Path(__file__).parent / "static"
API = "/api/v1"
PAGES = ("/", "/sign-in", "/submit", "/jobs/{job}", "/nodes", "/cost", "/log", "/account", "/users")
"""Addresses that people see; the page's own script shows what belongs there."""

_WORDS = {400: "invalid", 401: "unauthorized", 403: "forbidden", 404: "not-found", 405: "not-allowed", 413: "too-large", 415: "invalid"}
_LOGGED = frozenset({401, 403, 413, 422, 429})


def create_app(service: Farm, settings: ConsoleSettings | None = None) -> FastAPI:
    """Make the web application of a farm.

    Args:
        service: The farm.
        settings: How the console is set up; None: for a farm on one's own machine.
    """
    settings = settings or ConsoleSettings()
    app = FastAPI(
        title="Etendue farm",
        version=etendue.__version__,
        summary="Jobs of a render farm: uploading scenes, submitting, watching, steering and downloading.",
        description="Send a token as `Authorization: Bearer etf_…`. Refusals are `{error: {code, message}}`.",
        # The interactive pages load scripts from elsewhere.
        docs_url=None,
        redoc_url=None,
        openapi_url="/api/openapi.json",
        generate_unique_id_function=_operation_id,
    )
    app.state.console = Console(service, settings)
    app.state.pulse = events.Pulse(service, settings.poll_secs)
    for routes in (session, jobs, pictures, farm, events):
        app.include_router(routes.router, prefix=API)
    _add_pages(app)
    _add_refusals(app)
    _describe_security(app)
    # The last one added is the outermost.
    upload_limit = service.config.limits.upload_bytes
    app.add_middleware(BodyLimit, limit=settings.max_body, upload_limit=upload_limit, upload_path=f"{API}/packages")
    app.add_middleware(TrustedHostMiddleware, allowed_hosts=settings.hosts, www_redirect=False)
    app.add_middleware(SecurityHeaders, is_https=settings.is_https)
    return app


def _operation_id(route: APIRoute) -> str:
    return route.name


def _add_pages(app: FastAPI) -> None:
    app.mount("/static", StaticFiles(directory=STATIC), name="static")

    async def page() -> FileResponse:
        return FileResponse(STATIC / "console.html")

    for path in PAGES:
        app.add_api_route(path, page, methods=["GET"], include_in_schema=False)

    @app.get("/enter", include_in_schema=False)
    def enter(request: Request, key: str = "") -> Response:
        found = auth.enter(request, key)
        # The key leaves the address, which browsers keep.
        response = RedirectResponse("/", status_code=303)
        session.start(request, response, found)
        return response

    @app.get("/health", include_in_schema=False)
    def health(request: Request) -> dict[str, str]:
        with console_of(request).farm.database.read() as database:
            database.connection()
        return {"status": "ok"}


def _refuse(
    request: Request, status: int, code: str, message: str, headers: dict[str, str] | None = None, *, is_foreign: bool = False
) -> JSONResponse:
    if status in _LOGGED or is_foreign:
        user = getattr(request.state, "user", None)
        # Neither query nor headers: they may hold secrets.
        where = f"{request.method} {request.url.path[:200]!a}"
        key = f"user {user}" if user is not None else f"address {address_of(request)}"
        logger.warning("refused %s from %s: %s", where, address_of(request), message)
        console_of(request).note_refusal("refused", f"{where} from {address_of(request)} was refused: {message}", user=user, key=key)
    return JSONResponse({"error": {"code": code, "message": message}}, status, headers=headers)


def _add_refusals(app: FastAPI) -> None:
    @app.exception_handler(FarmError)
    def refuse(request: Request, error: FarmError) -> JSONResponse:
        headers = {"WWW-Authenticate": "Bearer"} if error.status == 401 else {}
        if isinstance(error, TooOftenError):
            headers["Retry-After"] = str(max(1, round(error.wait_secs)))
        is_foreign = isinstance(error, NotFoundError) and error.is_foreign
        return _refuse(request, error.status, error.code, str(error), headers, is_foreign=is_foreign)

    @app.exception_handler(RequestValidationError)
    def refuse_invalid(request: Request, error: RequestValidationError) -> JSONResponse:
        return _refuse(request, 422, "invalid", _faults(error.errors()))

    @app.exception_handler(HTTPException)
    def refuse_http(request: Request, error: HTTPException) -> JSONResponse:
        code = _WORDS.get(error.status_code, "failed")
        return _refuse(request, error.status_code, code, str(error.detail), dict(error.headers or {}))

    @app.exception_handler(Exception)
    def fail(request: Request, error: Exception) -> JSONResponse:
        logger.exception("%s %s failed", request.method, request.url.path, exc_info=error)
        return JSONResponse({"error": {"code": "failed", "message": "the console has failed here; its log says more"}}, 500)


def _faults(errors: Sequence[Any]) -> str:
    """Return the faults of a request, one to a line, without the values: they may be secrets."""
    lines = []
    for fault in errors[:20]:
        place = ".".join(str(part) for part in fault["loc"] if part not in ("body", "query", "path", "header"))
        message = str(fault["msg"]).removeprefix("Value error, ")
        lines.append(f"{place[:100]}: {message}" if place else message)
    return "\n".join(lines)


def _describe_security(app: FastAPI) -> None:
    """Say in the OpenAPI description that all but signing in needs a token."""
    plain = app.openapi

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            schema = plain()
            schema.setdefault("components", {})["securitySchemes"] = {"token": {"type": "http", "scheme": "bearer"}}
            schema["security"] = [{"token": []}]
            for path, methods in schema["paths"].items():
                if path == f"{API}/session":
                    for method in ("get", "post"):
                        methods[method]["security"] = []
            app.openapi_schema = schema
        return app.openapi_schema

    app.openapi = openapi  # type: ignore[method-assign]
