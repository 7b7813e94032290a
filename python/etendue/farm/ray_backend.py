"""Workers as actors of a Ray cluster: one for each node (or several), bound to it, so that a package and a prepared scene stay there.

Where the store is a folder that a node cannot see, its files go through an actor on the head.
"""

from __future__ import annotations

import contextlib
import os
import time
import uuid
from pathlib import Path
from typing import Any

from etendue.farm.backend import Ended, NodeInfo
from etendue.farm.errors import FarmError
from etendue.farm.orders import Done, Order, WorkerSetup, WorkerStats
from etendue.farm.store import Store

# Nothing is told to anyone about the use of this program.
os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
# Ray must not hide accelerators from, or change the behavior for, workers that ask for none.
os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
# A busy machine may need longer than Ray's 30 seconds.
os.environ.setdefault("RAY_raylet_start_wait_time_s", "180")

import ray
from ray.exceptions import RayError
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

PROBE_NAME = "visible"
"""File of the store by which a node finds out whether it sees it."""
PRICE_RESOURCE = "etendue_price_micro"
"""Resource of a node: the price of a core and hour in millionths, for nodes of several prices."""


class StoreServer:
    """The store for nodes that do not see it. An actor on the head."""

    def __init__(self, url: str, options: dict[str, Any]) -> None:
        self._store = Store(url, options)

    def read(self, name: str) -> bytes:
        """Return a file."""
        return self._store.read(name)

    def write(self, name: str, data: bytes) -> None:
        """Write a file."""
        self._store.write(name, data)


class RelayFiles:
    """The store through the head."""

    def __init__(self, server: Any) -> None:  # noqa: ANN401 - a handle of StoreServer
        self._server = server

    def read(self, name: str) -> bytes:
        """Return a file."""
        data: bytes = ray.get(self._server.read.remote(name))
        return data

    def write(self, name: str, data: bytes) -> None:
        """Write a file."""
        ray.get(self._server.write.remote(name, data))

    def fetch(self, name: str, target: Path) -> None:
        """Copy a file to a local path."""
        target.write_bytes(self.read(name))


class RayWorker:
    """A `Worker` in a process of its own. Orders one at a time; the group `control` beside them."""

    def __init__(self, setup: WorkerSetup, server: Any, token: str) -> None:  # noqa: ANN401 - a handle of StoreServer
        # For what runs outside of the renderer's own pool; before its first use.
        os.environ["RAYON_NUM_THREADS"] = str(setup.threads)
        from etendue.farm.worker import Worker

        files: Store | RelayFiles = RelayFiles(server)
        with contextlib.suppress(OSError, ValueError, ImportError):
            store = Store(setup.store_url, setup.store_options)
            # A folder of the same name on another machine is not the store.
            if store.read(f"{PROBE_NAME}/{token}") == token.encode():
                files = store
        self._worker = Worker(setup, files)

    def run(self, order: Order) -> Done:
        """Do what an order says."""
        return self._worker.run(order)

    def cancel(self, key: str) -> None:
        """Stop a task soon."""
        self._worker.cancel(key)

    def stats(self) -> WorkerStats:
        """Return how the machine is."""
        return self._worker.stats()


class RayBackend:
    """A Ray cluster, joined or started.

    Args:
        store: The farm's store.
        address: Of a cluster, such as `auto` or `ray://head:10001`; empty: one is started on this machine.
        cores: Of the cluster that is started; None: as the machine has.
    """

    def __init__(self, store: Store, address: str = "", cores: int | None = None) -> None:
        self._owned = not ray.is_initialized()
        if self._owned:
            options: dict[str, Any] = {"logging_level": "ERROR", "log_to_driver": False}
            if address:
                options["address"] = address
            else:
                # Unless told so, Ray would join whatever cluster the environment names.
                options |= {"address": "local", "num_cpus": cores, "include_dashboard": False}
            try:
                ray.init(**options)
            except (RayError, ConnectionError, RuntimeError, ValueError) as e:
                raise FarmError(f"Ray does not start: {e}") from e
        remote: Any = ray.remote  # typed for functions and simple actors only
        self._token = uuid.uuid4().hex
        store.write(f"{PROBE_NAME}/{self._token}", self._token.encode())
        self._store = store
        head = NodeAffinitySchedulingStrategy(ray.get_runtime_context().get_node_id(), soft=True)
        make = remote(num_cpus=0, max_restarts=-1, scheduling_strategy=head)(StoreServer)
        self._server = make.remote(store.url, store.options)
        self._worker_class = remote(concurrency_groups={"control": 2})(RayWorker)
        self._workers: dict[str, Any] = {}
        self._tasks: dict[Any, tuple[str, str]] = {}
        self._stats: dict[str, tuple[Any, WorkerStats | None]] = {}

    def nodes(self) -> list[NodeInfo]:  # noqa: D102 - of Backend, as those below
        found = []
        nodes: Any = ray.nodes  # without types
        for node in nodes():
            resources = node["Resources"]
            cores = float(resources.get("CPU", 0.0))
            if node["Alive"] and cores >= 1:
                price = resources.get(PRICE_RESOURCE)
                name = node.get("NodeName") or node["NodeManagerHostname"]
                found.append(NodeInfo(node["NodeID"], name, node["NodeManagerAddress"], cores, None if price is None else price / 1e6))
        return found

    def start(self, node: NodeInfo, setup: WorkerSetup) -> str:  # noqa: D102
        strategy = NodeAffinitySchedulingStrategy(node.id, soft=False)
        options = self._worker_class.options(num_cpus=setup.threads, scheduling_strategy=strategy, max_restarts=0, max_task_retries=0)
        name = uuid.uuid4().hex[:12]
        self._workers[name] = options.remote(setup, self._server, self._token)
        return name

    def submit(self, worker: str, order: Order) -> None:  # noqa: D102
        self._tasks[self._workers[worker].run.remote(order)] = (worker, order.key)

    def poll(self, secs: float) -> list[Ended]:  # noqa: D102
        if not self._tasks:
            time.sleep(secs)
            return []
        refs = list(self._tasks)
        ready, _ = ray.wait(refs, num_returns=1, timeout=secs)
        if ready:
            ready, _ = ray.wait(refs, num_returns=len(refs), timeout=0)
        ended = []
        for ref in ready:
            worker, key = self._tasks.pop(ref)
            try:
                ended.append(Ended(worker, key, ray.get(ref)))
            except RayError as e:
                self._workers.pop(worker, None)
                ended.append(Ended(worker, key, None, _first_line(e)))
        return ended

    def cancel(self, worker: str, key: str) -> None:  # noqa: D102
        if worker in self._workers:
            self._workers[worker].cancel.options(concurrency_group="control").remote(key)

    def stop(self, worker: str) -> None:  # noqa: D102
        handle = self._workers.pop(worker, None)
        if handle is not None:
            ray.kill(handle)

    def stats(self, worker: str) -> WorkerStats | None:  # noqa: D102
        ref, last = self._stats.get(worker, (None, None))
        if ref is not None:
            ready, _ = ray.wait([ref], timeout=0)
            if ready:
                with contextlib.suppress(RayError):
                    last = ray.get(ref)
                ref = None
        if ref is None and worker in self._workers:
            ref = self._workers[worker].stats.options(concurrency_group="control").remote()
        self._stats[worker] = (ref, last)
        return last

    def want(self, cores: float) -> None:  # noqa: D102
        # Only clusters with an autoscaler listen.
        with contextlib.suppress(Exception):
            from ray.autoscaler.sdk import request_resources

            request_resources(num_cpus=int(cores))

    def close(self) -> None:  # noqa: D102
        for worker in list(self._workers):
            with contextlib.suppress(RayError):
                self.stop(worker)
        with contextlib.suppress(RayError):
            ray.kill(self._server)
        self._store.delete(f"{PROBE_NAME}/{self._token}")
        if self._owned:
            ray.shutdown()


def _first_line(e: Exception) -> str:
    return f"{type(e).__name__}: {str(e).strip().splitlines()[0][:300]}" if str(e).strip() else type(e).__name__
