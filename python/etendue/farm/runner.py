"""Starting a farm's scheduler: for `etendue farm up`, and for a single job where no farm is running."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from etendue.farm.backend import Backend
from etendue.farm.errors import FarmError
from etendue.farm.scheduler import Scheduler
from etendue.farm.service import Farm


def ray_backend(farm: Farm, address: str | None = None, cores: int | None = None) -> Backend:
    """Return a Ray cluster as the farm's workers: one that is started on this machine, or the one at `address`.

    Raises:
        FarmError: Ray is not installed, or does not start.
    """
    try:
        from etendue.farm.ray_backend import RayBackend
    except ModuleNotFoundError as e:
        if e.name is not None and e.name.split(".")[0] == "ray":
            raise FarmError('the farm needs Ray: pip install "etendue[farm]"') from e
        raise
    return RayBackend(farm.store, farm.config.address if address is None else address, cores)


@contextmanager
def running(farm: Farm, backend: Backend, *, cache: str = "") -> Iterator[Scheduler]:
    """Run a scheduler in a thread while the block lasts.

    Raises:
        ConflictError: Another scheduler is at work.
        FarmError: The scheduler has ended with an error meanwhile.
    """
    try:
        scheduler = Scheduler(farm, backend, cache=cache)
    except FarmError:
        backend.close()
        raise
    failures: list[BaseException] = []

    def work() -> None:
        try:
            scheduler.run()
        except BaseException as e:  # told to the caller below
            failures.append(e)

    thread = threading.Thread(target=work, name="etendue-scheduler", daemon=True)
    thread.start()
    scheduler.thread = thread
    try:
        yield scheduler
    finally:
        scheduler.stop()
        thread.join()
    if failures:
        raise FarmError(f"the scheduler has failed: {failures[0]}") from failures[0]
