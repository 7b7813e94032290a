"""Tells other programs that a job has ended: a POST with JSON to the address that the user gave.

The address is the user's and the farm's network is not: addresses of the machine itself and of private networks are refused unless the farm
allows them, the name is looked up once and that address is used, and redirects are not followed.
"""

from __future__ import annotations

import http.client
import ipaddress
import json
import socket
import ssl
from typing import Any
from urllib.parse import urlsplit

from etendue.farm.errors import FarmError

TIMEOUT_SECS = 10.0


def post(url: str, content: dict[str, Any], *, allow_private: bool) -> int:
    """Send a POST and return the status of the answer.

    Raises:
        FarmError: The address is refused, or does not answer.
    """
    parts = urlsplit(url)
    host, is_tls = parts.hostname or "", parts.scheme == "https"
    port = parts.port or (443 if is_tls else 80)
    try:
        address = _address(host, port, allow_private)
        connection: http.client.HTTPConnection = _Pinned(host, port, address, is_tls)
        body = json.dumps(content).encode()
        path = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
        try:
            connection.request("POST", path, body, {"Content-Type": "application/json", "User-Agent": "etendue-farm"})
            return connection.getresponse().status
        finally:
            connection.close()
    except (OSError, http.client.HTTPException, ValueError) as e:
        raise FarmError(f"the address {host} does not answer: {e}") from e


def _address(host: str, port: int, allow_private: bool) -> str:
    found = {str(info[4][0]) for info in socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)}
    if not allow_private and not all(ipaddress.ip_address(a.partition("%")[0]).is_global for a in found):
        raise FarmError(f"the address {host} is not a public one")
    return sorted(found)[0]


class _Pinned(http.client.HTTPConnection):
    """A connection to an address that has been looked up, under the host's name."""

    def __init__(self, host: str, port: int, address: str, is_tls: bool) -> None:
        super().__init__(host, port, timeout=TIMEOUT_SECS)
        self._pinned = address
        self._is_tls = is_tls

    def connect(self) -> None:
        """Connect to the pinned address."""
        self.sock = socket.create_connection((self._pinned, self.port), TIMEOUT_SECS)
        if self._is_tls:
            self.sock = ssl.create_default_context().wrap_socket(self.sock, server_hostname=self.host)
