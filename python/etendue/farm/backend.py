"""What runs workers: `ray_backend.RayBackend` on a cluster, `LocalBackend` as threads of this process."""

from __future__ import annotations

import queue
import socket
import threading
from dataclasses import dataclass
from typing import Protocol

from etendue.farm.orders import Done, Order, WorkerSetup, WorkerStats
from etendue.farm.worker import Files, Worker


@dataclass(frozen=True)
class NodeInfo:
    """A machine that is alive."""

    id: str
    name: str
    address: str
    cores: float
    price: float | None = None
    """Of a core and hour; None: the farm's."""


@dataclass(frozen=True)
class Ended:
    """The end of a task: what the worker says, or None where the worker was lost."""

    worker: str
    key: str
    done: Done | None
    reason: str = ""
    """Why the worker was lost."""


class Backend(Protocol):
    """Runs workers on nodes. Only the scheduler's thread calls it."""

    def nodes(self) -> list[NodeInfo]:
        """Return the nodes that are alive."""

    def start(self, node: NodeInfo, setup: WorkerSetup) -> str:
        """Start a worker and return its name, at once; the first task waits until it is there."""

    def submit(self, worker: str, order: Order) -> None:
        """Send an order to a worker that has none."""

    def poll(self, secs: float) -> list[Ended]:
        """Return the tasks that have ended; waits up to so long for the first."""

    def cancel(self, worker: str, key: str) -> None:
        """Ask a worker to stop a task. It still ends, without a result."""

    def stop(self, worker: str) -> None:
        """Stop a worker at once; its task is lost."""

    def stats(self, worker: str) -> WorkerStats | None:
        """Return how a worker's machine was lately; None where that is not known."""

    def want(self, cores: float) -> None:
        """Tell a cluster that can grow how many cores there is work for."""

    def close(self) -> None:
        """Stop all workers."""


class LocalBackend:
    """Workers as threads of this process: for tests, and where Ray is not there. Nodes can be taken away and added.

    Args:
        files: The store.
        nodes: Names of the nodes that it pretends to have.
        cores: Of each node.
    """

    def __init__(self, files: Files, nodes: tuple[str, ...] = ("local",), cores: int = 2) -> None:
        self._files = files
        self._cores = cores
        self._nodes = list(nodes)
        self._ended: queue.SimpleQueue[Ended] = queue.SimpleQueue()
        self._workers: dict[str, tuple[str, Worker, queue.SimpleQueue[Order | None]]] = {}
        self._busy: dict[str, str] = {}
        self._count = 0
        self.wanted = 0.0

    def nodes(self) -> list[NodeInfo]:  # noqa: D102 - of Backend, as those below
        return [NodeInfo(name, f"{socket.gethostname()}/{name}", "127.0.0.1", self._cores) for name in self._nodes]

    def add_node(self, name: str) -> None:
        """Add a node."""
        self._nodes.append(name)

    def lose_node(self, name: str) -> None:
        """Take a node away, with what it is doing."""
        self._nodes.remove(name)
        for worker in [key for key, (node, _, _) in self._workers.items() if node == name]:
            self.lose_worker(worker)

    def lose_worker(self, worker: str) -> None:
        """Let a worker die, with what it is doing."""
        _, thing, orders = self._workers.pop(worker)
        key = self._busy.pop(worker, None)
        orders.put(None)
        if key is not None:
            thing.cancel(key)
            self._ended.put(Ended(worker, key, None, "the worker has died"))

    def start(self, node: NodeInfo, setup: WorkerSetup) -> str:  # noqa: D102
        self._count += 1
        name = f"{node.id}-{self._count}"
        worker, orders = Worker(setup, self._files), queue.SimpleQueue[Order | None]()
        self._workers[name] = (node.id, worker, orders)
        threading.Thread(target=self._work, args=(name, worker, orders), name=name, daemon=True).start()
        return name

    def _work(self, name: str, worker: Worker, orders: queue.SimpleQueue[Order | None]) -> None:
        while (order := orders.get()) is not None:
            done = worker.run(order)
            # What a lost worker has still done must not count: its unit has been given to another.
            if name in self._workers:
                self._busy.pop(name, None)
                self._ended.put(Ended(name, order.key, done))

    def submit(self, worker: str, order: Order) -> None:  # noqa: D102
        if worker not in self._workers:
            # Lost while it had nothing to do: whoever gives it work learns of it now, as on a real cluster.
            self._ended.put(Ended(worker, order.key, None, "the worker has died"))
            return
        self._busy[worker] = order.key
        self._workers[worker][2].put(order)

    def poll(self, secs: float) -> list[Ended]:  # noqa: D102
        ended: list[Ended] = []
        try:
            ended.append(self._ended.get(timeout=secs))
            while True:
                ended.append(self._ended.get_nowait())
        except queue.Empty:
            return ended

    def cancel(self, worker: str, key: str) -> None:  # noqa: D102
        if worker in self._workers:
            self._workers[worker][1].cancel(key)

    def stop(self, worker: str) -> None:  # noqa: D102
        if worker in self._workers:
            self.lose_worker(worker)

    def stats(self, worker: str) -> WorkerStats | None:  # noqa: D102
        return self._workers[worker][1].stats() if worker in self._workers else None

    def want(self, cores: float) -> None:  # noqa: D102
        self.wanted = cores

    def close(self) -> None:  # noqa: D102
        for worker in list(self._workers):
            self.stop(worker)
