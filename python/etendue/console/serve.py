"""Serving the console: a web server in a thread, beside a farm's scheduler or alone."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Iterator

import uvicorn

from etendue.console.app import create_app
from etendue.console.settings import ConsoleSettings
from etendue.farm.errors import FarmError
from etendue.farm.service import Farm

DEFAULT_PORT = 8640
START_SECS = 30.0


@contextlib.contextmanager
def running(farm: Farm, settings: ConsoleSettings, host: str = "127.0.0.1", port: int = DEFAULT_PORT, proxies: str = "") -> Iterator[str]:
    """Serve the console while the block lasts; gives its address.

    Args:
        farm: The farm.
        settings: How the console is set up.
        host: Address to listen at.
        port: Port; 0 takes a free one.
        proxies: Addresses of proxies whose word about the client's address is believed, with commas between; empty: none.

    Raises:
        FarmError: It cannot listen there.
    """
    listener = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_STREAM)
    with contextlib.closing(listener):
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((host, port))
            listener.listen(1024)
        except OSError as e:
            raise FarmError(f"the console cannot listen at {host}:{port}: {e.strerror or e}") from e
        config = uvicorn.Config(
            create_app(farm, settings),
            log_level="warning",
            # Addresses may hold keys.
            access_log=False,
            server_header=False,
            proxy_headers=bool(proxies),
            forwarded_allow_ips=proxies or None,
            # Open event streams must not hold up the end.
            timeout_graceful_shutdown=1,
            lifespan="off",
        )
        server = uvicorn.Server(config)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, name="etendue-console", daemon=True)
        thread.start()
        end = time.monotonic() + START_SECS
        while not server.started:
            if not thread.is_alive() or time.monotonic() > end:
                raise FarmError("the console has not started")
            time.sleep(0.01)
        shown = f"[{host}]" if ":" in host else host
        try:
            yield f"http://{shown}:{listener.getsockname()[1]}"
        finally:
            server.should_exit = True
            thread.join(timeout=10)
