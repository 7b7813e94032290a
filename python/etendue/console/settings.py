"""How the console is set up."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field


class ConsoleSettings(BaseModel):
    """How the console is set up. The defaults are for a farm on one's own machine."""

    model_config = ConfigDict(extra="forbid")

    hosts: list[str] = Field(default_factory=lambda: ["localhost", "127.0.0.1", "[::1]"])
    """Host names, without port, under which browsers may reach the console; `*` for any. Others are refused, so that no page of
    another site can reach a console on this machine (DNS rebinding)."""
    is_https: bool = False
    """Whether a proxy in front of the console speaks TLS: cookies are then sent by HTTPS alone."""
    local_key: str | None = None
    """A secret that signs a browser in as the user `local`: for the address that `etendue farm up` prints. None: no such way in."""
    requests_per_sec: float = Field(default=50.0, gt=0)
    """Requests that a user, or an address without one, may make in the long run."""
    burst: float = Field(default=300.0, ge=1)
    """Requests that they may make at once."""
    sign_ins: float = Field(default=10.0, ge=1)
    """Failed sign-ins of an address or for a name within 15 minutes, before more are refused."""
    uploads_per_min: float = Field(default=30.0, gt=0)
    """Uploads of a user."""
    max_streams: int = Field(default=20, ge=1)
    """Open event streams of a user."""
    max_body: int = Field(default=1 << 20, ge=1024)
    """Most bytes of a request that is no upload."""
    poll_secs: float = Field(default=1.0, gt=0)
    """How often the database is asked for news."""
