"""The farm's database: opening it and bringing its tables up to date."""

from __future__ import annotations

import sqlite3
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from alembic import command
from alembic.config import Config
from sqlalchemy import Connection, Engine, create_engine, event
from sqlalchemy.engine import make_url
from sqlalchemy.orm import Session, sessionmaker

from etendue.farm.errors import InvalidError

MIGRATIONS = Path(__file__).parent / "migrations"


class Database:
    """An engine and its sessions. `with database.begin() as session:` is a transaction."""

    def __init__(self, url: str, *, migrate: bool = True) -> None:
        parsed = make_url(url)
        if parsed.get_backend_name() not in ("sqlite", "postgresql"):
            raise InvalidError(f"the farm keeps its jobs in SQLite or PostgreSQL, not in `{parsed.get_backend_name()}`")
        self.url = url
        self.is_sqlite = parsed.get_backend_name() == "sqlite"
        if self.is_sqlite and parsed.database:
            Path(parsed.database).parent.mkdir(parents=True, exist_ok=True)
        options: dict[str, Any] = {"connect_args": {"timeout": 30}} if self.is_sqlite else {"pool_pre_ping": True, "pool_size": 10}
        self.engine = _engine(url, options)
        if self.is_sqlite:
            event.listen(self.engine, "connect", _prepare_sqlite)
            event.listen(self.engine, "begin", _begin_sqlite)
        self._sessions = sessionmaker(self.engine, expire_on_commit=False)
        self._readers = sessionmaker(self.engine.execution_options(reads_only=True), expire_on_commit=False)
        if migrate:
            self.migrate()

    def migrate(self, revision: str = "head") -> None:
        """Bring the tables to a revision; the newest is `head`."""
        config = Config()
        config.set_main_option("script_location", str(MIGRATIONS))
        with self.engine.begin() as connection:
            config.attributes["connection"] = connection
            command.upgrade(config, revision)

    def begin(self) -> AbstractContextManager[Session]:
        """Return a context manager that gives a session and commits, or rolls back on an exception."""
        return self._sessions.begin()

    def read(self) -> AbstractContextManager[Session]:
        """Return a context manager that gives a session for reading: it waits for no writer."""
        return self._readers.begin()

    def close(self) -> None:
        """Close all connections."""
        self.engine.dispose()


def _engine(url: str, options: dict[str, Any]) -> Engine:
    try:
        return create_engine(url, **options)
    except ModuleNotFoundError as e:
        raise InvalidError(f"the database needs the Python package `{e.name}`, which is not installed") from e


def _begin_sqlite(connection: Connection) -> None:
    # A transaction that reads first and writes then would fail where another one has written in between: writers wait at the start.
    reads_only = connection.get_execution_options().get("reads_only", False)
    connection.exec_driver_sql("BEGIN" if reads_only else "BEGIN IMMEDIATE")


def _prepare_sqlite(connection: sqlite3.Connection, _record: object) -> None:
    # Transactions begin where SQLAlchemy says, not where the driver guesses.
    connection.isolation_level = None
    cursor = connection.cursor()
    # Readers and the writer do not wait for each other, and a power cut loses at most the last transactions, never the file.
    cursor.execute("PRAGMA journal_mode=WAL")
    cursor.execute("PRAGMA synchronous=NORMAL")
    cursor.execute("PRAGMA foreign_keys=ON")
    cursor.close()
