"""Where a farm keeps what: a folder with `farm.json`, or a database and a store by URL."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from etendue.farm.errors import InvalidError


class Limits(BaseModel):
    """What is too much."""

    model_config = ConfigDict(extra="forbid")

    package_bytes: Annotated[int, Field(gt=0)] = 8 << 30
    """Of all files of a package, unpacked."""
    upload_bytes: Annotated[int, Field(gt=0)] = 4 << 30
    """Of an upload as it comes."""
    package_files: Annotated[int, Field(gt=0)] = 20_000
    expansion: Annotated[float, Field(gt=1)] = 200.0
    """How many times its size a package may grow when it is unpacked; small ones may grow to 64 MiB anyway."""
    pixels: Annotated[int, Field(gt=0)] = 1 << 28
    spp: Annotated[int, Field(gt=0)] = 1 << 22
    unit_secs: Annotated[float, Field(gt=0)] = 3600.0
    """A unit that takes longer has failed."""
    check_secs: Annotated[float, Field(gt=0)] = 60.0
    """Reading an uploaded scene for its loss report takes at most this."""


class FarmConfig(BaseModel):
    """How a farm is set up; `farm.json` holds what differs from the defaults."""

    model_config = ConfigDict(extra="forbid")

    database: str = ""
    """SQLAlchemy's URL, such as `postgresql+psycopg://user@host/etendue`; empty: `farm.db` in the folder."""
    store: str = ""
    """fsspec's URL of a folder for packages, films and pictures, such as `s3://bucket/farm`; empty: `store` in the folder."""
    store_options: dict[str, str | bool | int] = Field(default_factory=dict)
    """fsspec's options, such as `endpoint_url`. Keys and passwords belong into the environment, not here."""
    address: str = ""
    """Ray's address of a cluster that exists, such as `auto` or `ray://head:10001`; empty: a local one is started."""
    unit_secs: tuple[float, float] = (10.0, 60.0)
    """Shortest and longest time that a unit should take on one worker."""
    merge_fan_in: Annotated[int, Field(ge=2, le=64)] = 8
    """Films that are merged at once."""
    workers_per_node: Annotated[int, Field(ge=1, le=256)] = 1
    """Each has its share of the node's cores, and its own copy of the scene."""
    straggler_factor: Annotated[float, Field(gt=1)] = 3.0
    """A unit that runs so many times longer than expected is begun again elsewhere when a worker is idle."""
    price: Annotated[float, Field(ge=0)] = 0.0
    """Of a core and hour on nodes without a price of their own."""
    currency: str = "USD"
    private_webhooks: bool = False
    """Whether jobs may notify addresses of private networks."""
    limits: Limits = Field(default_factory=Limits)

    @classmethod
    def load(cls, root: Path) -> FarmConfig:
        """Read `farm.json` in a folder; the defaults where there is none.

        Raises:
            InvalidError: It has a fault.
        """
        path = root / "farm.json"
        try:
            text = path.read_text("utf-8")
        except FileNotFoundError:
            return cls()
        try:
            return cls.model_validate(json.loads(text))
        except (ValueError, ValidationError) as e:
            raise InvalidError(f"{path}: {e}") from e

    def database_url(self, root: Path) -> str:
        """Return the database's URL."""
        return self.database or f"sqlite:///{root.resolve() / 'farm.db'}"

    def store_url(self, root: Path) -> str:
        """Return the store's URL."""
        return self.store or f"file://{(root / 'store').resolve()}"


def default_root() -> Path:
    """Return the farm's folder: `$ETENDUE_FARM`, else `etendue/farm` in the user's folder for data."""
    named = os.environ.get("ETENDUE_FARM")
    if named:
        return Path(named)
    data = os.environ.get("XDG_DATA_HOME")
    return (Path(data) if data else Path.home() / ".local" / "share") / "etendue" / "farm"
