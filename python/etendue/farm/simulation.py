"""A discrete-event simulation of farms that are larger than any at hand: docs/farm/scaling.md has its results.

It shares the farm's own rules (`planning`: sizes of units, the tree of merges) and takes measured costs: of a unit at the head, of a merge,
of a film's bytes. Nodes fail and come back, spot nodes are taken away with what they do, and the head handles one event after the other,
as the scheduler's thread does.

`python -m etendue.farm.simulation` prints the table.
"""

from __future__ import annotations

import argparse
import heapq
import json
import random
import sys
from collections import deque
from dataclasses import asdict, dataclass, field
from pathlib import Path

from etendue.farm import planning


@dataclass(frozen=True)
class Costs:
    """What things cost, in seconds and bytes; measured by `bench/farm.py costs`."""

    unit_secs: float = 30.0
    """Mean time of a unit on a node."""
    unit_spread: float = 0.25
    """Standard deviation of the logarithm of a unit's time."""
    start_secs: float = 3.0
    """From the file to the first sample, once for each frame and node."""
    head_begin_secs: float = 0.0015
    """Of the head, to begin a unit."""
    head_end_secs: float = 0.003
    """Of the head, to take a unit's result."""
    film_bytes: float = 8e6
    """Of a unit's film, as it is stored."""
    merge_bytes_per_sec: float = 60e6
    """What a node merges in a second, reading and writing the store."""
    package_bytes: float = 500e6
    """Of a scene, sent once to each node."""
    node_bytes_per_sec: float = 300e6
    """Between a node and the store."""


@dataclass(frozen=True)
class Loss:
    """How nodes are lost."""

    mean_secs: float = 90 * 86400.0
    """Mean time between failures of a node."""
    repair_secs: float = 1800.0
    """Until it is back."""
    spot_share: float = 0.0
    """Share of the nodes that may be taken away by their owner."""
    spot_mean_secs: float = 4 * 3600.0
    """Mean time until such a node is taken away."""
    spot_return_secs: float = 600.0
    """Until another one stands in its place."""


@dataclass
class Result:
    """What a simulated job has come to."""

    nodes: int
    units: int
    wall_secs: float = 0.0
    utilization: float = 0.0
    """Share of the nodes' time that went into units that count, from the first to the last."""
    steady_utilization: float = 0.0
    """The same until the queue ran empty: without the tail of the job."""
    lost_units: int = 0
    lost_share: float = 0.0
    """Share of the nodes' time that was lost with nodes."""
    merges: int = 0
    merge_share: float = 0.0
    """Share of the nodes' time that went into merges."""
    store_bytes_per_sec: float = 0.0
    """Mean traffic of the store: films written and read, packages."""
    head_load: float = 0.0
    """Share of the time in which the head was at work, until the queue ran empty."""
    head_wait_secs: float = 0.0
    """Mean time that a result waited for the head."""
    events: int = 0


@dataclass
class _Farm:
    nodes: int
    frames: int
    units_per_frame: int
    costs: Costs
    loss: Loss
    random: random.Random
    fan_in: int = 8
    now: float = 0.0
    heap: list[tuple[float, int, str, int, int]] = field(default_factory=list)
    count: int = 0

    def at(self, when: float, kind: str, node: int, epoch: int) -> None:
        self.count += 1
        heapq.heappush(self.heap, (when, self.count, kind, node, epoch))


def simulate(nodes: int, frames: int, units_per_frame: int, costs: Costs, loss: Loss, seed: int = 1, fan_in: int = 8) -> Result:
    """Simulate one animation on a farm and return what it comes to.

    Args:
        nodes: Workers, one for each node.
        frames: Pictures.
        units_per_frame: Units of each.
        costs: What things cost.
        loss: How nodes are lost.
        seed: Of the random numbers: the same seed gives the same result.
        fan_in: Films that are merged at once.
    """
    farm = _Farm(nodes, frames, units_per_frame, costs, loss, random.Random(seed), fan_in)
    return _run(farm)


def _run(farm: _Farm) -> Result:
    costs, loss, rng = farm.costs, farm.loss, farm.random
    total = farm.frames * farm.units_per_frame
    result = Result(farm.nodes, total)
    # (frame, level, slot); level -1 is a unit.
    queue: deque[tuple[int, int, int]] = deque((f, -1, u) for f in range(farm.frames) for u in range(farm.units_per_frame))
    merges: deque[tuple[int, int, int]] = deque()
    groups: dict[tuple[int, int, int], int] = {}
    frames_left = farm.frames
    task: list[tuple[int, int, int] | None] = [None] * farm.nodes
    begun, epoch, last_frame = [0.0] * farm.nodes, [0] * farm.nodes, [-1] * farm.nodes
    is_up, has_package = [True] * farm.nodes, [False] * farm.nodes
    idle = deque(range(farm.nodes))
    head_free = head_busy = head_waited = 0.0
    useful = lost = merging = traffic = 0.0
    empty_at: float | None = None
    useful_at_empty = head_at_empty = 0.0
    spots = int(farm.nodes * loss.spot_share)
    for node in range(farm.nodes):
        mean = loss.spot_mean_secs if node < spots else loss.mean_secs
        farm.at(rng.expovariate(1.0 / mean), "loss", node, 0)

    def head(secs: float) -> float:
        """The head does one thing after the other; returns when it has done this."""
        nonlocal head_free, head_busy, head_waited
        start = max(farm.now, head_free)
        head_waited += start - farm.now
        head_busy += secs
        head_free = start + secs
        return head_free

    def give(node: int) -> None:
        nonlocal traffic, empty_at, useful_at_empty, head_at_empty
        work = merges.popleft() if merges else queue.popleft() if queue else None
        if work is None:
            idle.append(node)
            return
        if not queue and empty_at is None:
            empty_at, useful_at_empty, head_at_empty = farm.now, useful, head_busy
        frame, level, _ = work
        start = head(costs.head_begin_secs)
        if level < 0:
            secs = costs.unit_secs * rng.lognormvariate(-(costs.unit_spread**2) / 2, costs.unit_spread)
            if not has_package[node]:
                has_package[node] = True
                secs += costs.package_bytes / costs.node_bytes_per_sec
                traffic += costs.package_bytes
            if last_frame[node] != frame:
                secs += costs.start_secs
                last_frame[node] = frame
            secs += costs.film_bytes / costs.node_bytes_per_sec
            traffic += costs.film_bytes
        else:
            # A film of the next level has the pixels of its group: as large as they are together, whatever the samples.
            size = costs.film_bytes * min(farm.fan_in ** (level + 1), farm.units_per_frame)
            secs = 2 * size / costs.merge_bytes_per_sec
            traffic += 2 * size
        task[node], begun[node] = work, start
        farm.at(start + secs, "done", node, epoch[node])

    for _ in range(farm.nodes):
        give(idle.popleft())
    while frames_left and farm.heap:
        farm.now, _, kind, node, when = heapq.heappop(farm.heap)
        result.events += 1
        if kind == "done":
            if when != epoch[node] or task[node] is None:
                continue
            work = task[node]
            assert work is not None
            taken = head(costs.head_end_secs)
            spent = farm.now - begun[node]
            task[node] = None
            frame, level, slot = work
            if level < 0:
                useful += spent
            else:
                merging += spent
                result.merges += 1
            key = _parent(farm, level, slot)
            if key is None:
                frames_left -= 1
            else:
                up_level, up_slot, members = key
                have = groups.get((frame, up_level, up_slot), 0) + 1
                groups[frame, up_level, up_slot] = have
                if have == members:
                    del groups[frame, up_level, up_slot]
                    merges.append((frame, up_level, up_slot))
            farm.at(taken, "free", node, epoch[node])
        elif kind == "free":
            if when == epoch[node] and is_up[node]:
                give(node)
                while merges and idle:
                    give(idle.popleft())
        elif kind == "loss" and is_up[node]:
            is_up[node] = False
            epoch[node] += 1
            has_package[node], last_frame[node] = False, -1
            lost_task = task[node]
            if lost_task is not None:
                lost += farm.now - begun[node]
                result.lost_units += 1
                task[node] = None
                (queue if lost_task[1] < 0 else merges).appendleft(lost_task)
                if idle:
                    give(idle.popleft())
            elif node in idle:
                idle.remove(node)
            back = loss.spot_return_secs if node < spots else loss.repair_secs
            farm.at(farm.now + back, "back", node, epoch[node])
        elif kind == "back":
            is_up[node] = True
            mean = loss.spot_mean_secs if node < spots else loss.mean_secs
            farm.at(farm.now + rng.expovariate(1.0 / mean), "loss", node, epoch[node])
            give(node)
    wall = farm.now
    steady = empty_at if empty_at else wall
    result.wall_secs = wall
    result.utilization = useful / (wall * farm.nodes)
    result.steady_utilization = min(useful_at_empty / (steady * farm.nodes), 1.0) if empty_at else result.utilization
    result.lost_share = lost / (wall * farm.nodes)
    result.merge_share = merging / (wall * farm.nodes)
    result.store_bytes_per_sec = traffic / wall
    result.head_load = (head_at_empty if empty_at else head_busy) / steady
    result.head_wait_secs = head_waited / max(2 * (total + result.merges), 1)
    return result


def _parent(farm: _Farm, level: int, slot: int) -> tuple[int, int, int] | None:
    """Return level, slot and number of members of the merge that takes a film; None where the film is the frame's last."""
    top, count = planning.tops(farm.units_per_frame, farm.fan_in)
    if level >= top:
        return None
    merge = planning.merge_of(level + 1, slot, farm.units_per_frame, farm.fan_in)
    if merge is None:
        # The last step of a frame.
        return top, 0, count
    return level + 1, merge.slot, merge.last - merge.first


def main(argv: list[str] | None = None) -> int:
    """Print the results for some sizes of farms as a Markdown table, or as JSON."""
    parser = argparse.ArgumentParser(prog="python -m etendue.farm.simulation", description="Simulate large farms.")
    parser.add_argument("--nodes", default="100,1000,6700", help="sizes of farms [default: 100,1000,6700]")
    parser.add_argument("--hours", type=float, default=1.0, help="about how long the job takes on each [default: 1]")
    parser.add_argument("--units", type=int, default=16, help="units of a frame [default: 16]")
    parser.add_argument("--unit-secs", type=float, default=30.0, help="mean time of a unit [default: 30]")
    parser.add_argument("--costs", help="JSON file with measured costs (fields of `Costs`)")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args(argv)
    fields = json.loads(Path(args.costs).read_text("utf-8")) if args.costs else {}
    costs = Costs(**{**fields, "unit_secs": args.unit_secs})
    rows = []
    for nodes in (int(n) for n in args.nodes.split(",")):
        frames = max(round(nodes * args.hours * 3600 / args.unit_secs / args.units), 1)
        for name, loss in (
            ("own", Loss()),
            ("half spot", Loss(spot_share=0.5)),
            ("all spot, 1 h", Loss(spot_share=1.0, spot_mean_secs=3600)),
        ):
            rows.append({"loss": name, "frames": frames, **asdict(simulate(nodes, frames, args.units, costs, loss))})
    if args.json:
        print(json.dumps(rows, indent=1))
        return 0
    print("| nodes | losses | frames | units | wall | utilization | until the queue is empty | lost | merging | store | head | wait |")
    print("|---|---|---|---|---|---|---|---|---|---|---|---|")
    for r in rows:
        print(
            f"| {r['nodes']} | {r['loss']} | {r['frames']} | {r['units']} | {r['wall_secs']:.0f} s | {r['utilization']:.1%} | "
            f"{r['steady_utilization']:.1%} | {r['lost_share']:.2%} | {r['merge_share']:.2%} | {r['store_bytes_per_sec'] / 1e9:.2f} GB/s | "
            f"{r['head_load']:.0%} | {r['head_wait_secs'] * 1000:.0f} ms |"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
