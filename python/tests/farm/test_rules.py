"""Rules that are functions of numbers: units, merges, rounds, shares; and the simulation that rests on them."""

import random
from collections import Counter, deque

import pytest

from etendue.farm import planning, webhook
from etendue.farm.errors import FarmError
from etendue.farm.policy import ActiveJob, Waiting, order_jobs, pick
from etendue.farm.simulation import Costs, Loss, simulate
from etendue.farm.spec import JobSpec, parse_frames


def test_units_cover_every_sample_once() -> None:
    rng = random.Random(7)
    for _ in range(300):
        x0, y0 = rng.randrange(50), rng.randrange(50)
        crop = (x0, y0, x0 + rng.randrange(1, 300), y0 + rng.randrange(1, 200))
        begin = rng.randrange(100)
        end = begin + rng.randrange(1, 40)
        whole, every = rng.random() < 0.2, rng.random() < 0.2
        secs, target, tail = rng.expovariate(0.01), rng.uniform(0.5, 60), rng.randrange(4)
        parts = planning.split_frame(crop, begin, end, secs, target, whole=whole, all_samples=every, tail=tail)
        assert sum(part.work for part in parts) == planning.area(crop) * (end - begin)
        seen: Counter[tuple[int, int, int]] = Counter()
        for part in parts:
            assert part.begin < part.end
            assert planning.area(part.rect) > 0
            # The corners stand for the rest: tiles of one grid do not overlap where theirs do not.
            seen[part.rect[0], part.rect[1], part.begin] += 1
            assert not whole or part.rect == crop
            assert not every or (part.begin, part.end) == (begin, end)
        assert set(seen.values()) == {1}


def test_units_have_the_length_that_was_asked_for() -> None:
    parts = planning.split_frame((0, 0, 1920, 1080), 0, 64, 600.0, 30.0, whole=False, all_samples=False)
    secs = [600.0 * part.work / (1920 * 1080 * 64) for part in parts]
    assert len(parts) == pytest.approx(20, abs=4)
    assert 10 < min(secs) <= max(secs) < 60
    assert all(part.rect[0] % planning.TILE == 0 for part in parts)
    # Small pictures of many samples are cut into ranges.
    parts = planning.split_frame((0, 0, 32, 32), 0, 4096, 600.0, 30.0, whole=False, all_samples=False)
    assert len(parts) == 20
    assert planning.unit_secs(1e6, 100, 10, 60) == 60
    assert planning.unit_secs(400, 10, 10, 60) == 10


def test_no_worker_waits_long_at_the_end_of_a_job() -> None:
    """Units take half to one and a half of what the probe has found; each worker takes the next one when it has nothing."""
    rng = random.Random(3)
    for workers in (2, 3, 16):
        late = {0: 0.0, workers: 0.0}
        for _ in range(100):
            total = 10.0 * workers * rng.uniform(4, 8)
            for tail in late:
                parts = planning.split_frame((0, 0, 640, 480), 0, 256, total, 10.0, whole=False, all_samples=False, tail=tail)
                free = [0.0] * workers
                for part in parts:
                    at = free.index(min(free))
                    free[at] += total * part.work / (640 * 480 * 256) * rng.uniform(0.5, 1.5)
                late[tail] += (max(free) - sum(free) / workers) / 100
        assert late[workers] < 0.35 * late[0]
        assert late[workers] < 2.0


def test_the_tree_of_merges_takes_every_film_once() -> None:
    for units in [*range(1, 70), 511, 512, 513, 4097]:
        for fan_in in (2, 8):
            films = {(0, slot) for slot in range(units)}
            steps = 0
            while True:
                ready = None
                for level, slot in sorted(films):
                    merge = planning.merge_of(level, slot, units, fan_in)
                    if merge is not None:
                        ready = merge
                        break
                if ready is None:
                    break
                group = {(ready.level, slot) for slot in range(ready.first, ready.last)}
                assert group <= films
                assert 1 <= len(group) <= fan_in
                films = (films - group) | {(ready.level + 1, ready.slot)}
                steps += 1
            level, count = planning.tops(units, fan_in)
            assert films == {(level, slot) for slot in range(count)}
            assert count <= fan_in


def test_rounds_grow_towards_the_noise() -> None:
    first = planning.next_round(0, None, 0.01, None, 0.001, 4, 10.0)
    assert first == 64
    # Four times the error: sixteen times the samples, but not more than thrice at once.
    assert planning.next_round(64, 0.04, 0.01, None, 1.0, 4, 10.0) == 256
    assert planning.next_round(64, 0.0105, 0.01, None, 1.0, 4, 10.0) == 80
    assert planning.next_round(64, 0.04, 0.01, 100, 1.0, 4, 10.0) == 100
    assert planning.next_round(64, None, 0.01, None, 1.0, 4, 1000.0) % 16 == 0


def test_lists_of_frames() -> None:
    assert parse_frames("1-10x3, 2,4-5") == (1, 2, 4, 5, 7, 10)
    for bad in ("", "a", "1-", "5-1", "1-2x0", "1-99999999", ",", "-3"):
        with pytest.raises(ValueError, match="frame"):
            parse_frames(bad)
    spec = JobSpec(package="0" * 64, frames="1-9", every_first=4, clocks=(0, 2))
    assert spec.first_numbers() == {1, 5, 9}
    assert [spec.clock(n) for n in (1, 5, 9)] == [0, 1, 2]


def job(number: int, owner: int, share: float = 1.0, priority: int = 0) -> ActiveJob:
    return ActiveJob(number, owner, share, priority, JobSpec(package="0" * 64), "", "", "")


def test_priorities_and_shares() -> None:
    jobs = [job(1, 1), job(2, 1), job(3, 2, share=3.0), job(4, 3, priority=5)]
    running: Counter[int] = Counter()
    got: Counter[int] = Counter()
    for _ in range(80):
        first = order_jobs(jobs, running)[0]
        assert first.id == 4
        running[first.owner] += 1
    jobs.pop()
    for _ in range(80):
        first = order_jobs(jobs, running)[0]
        running[first.owner] += 1
        got[first.owner] += 1
    # Three parts to one by their shares, and the older job first.
    assert got == {1: 20, 2: 60}
    assert order_jobs(jobs[:2], running)[0].id == 1


def test_workers_keep_their_scenes() -> None:
    waiting = deque(Waiting(unit, unit // 3, "render") for unit in range(9))
    assert pick(waiting, 1, Counter({0: 1, 1: 1})).frame == 1
    assert pick(waiting, None, Counter({0: 1, 1: 1})).frame == 2
    assert pick(waiting, None, Counter({0: 1, 1: 1, 2: 1})).frame == 0
    probes = deque([Waiting(1, 5, "probe"), Waiting(2, 0, "render")])
    assert pick(probes, 0, Counter()).kind == "probe"


def test_the_simulation_agrees_with_arithmetic() -> None:
    calm = Loss(mean_secs=1e12)
    costs = Costs(unit_spread=0.0, start_secs=0.0, package_bytes=0.0, film_bytes=0.0, head_begin_secs=0.0, head_end_secs=0.0)
    result = simulate(10, 10, 8, costs, calm)
    assert result.wall_secs == pytest.approx(8 * 30.0)
    assert result.utilization == pytest.approx(1.0)
    # A head that takes a second for each unit is what everyone waits for.
    slow = simulate(10, 10, 8, Costs(**{**costs.__dict__, "unit_secs": 1.0, "head_end_secs": 1.0}), calm)
    assert slow.wall_secs > 80.0
    assert slow.head_load > 0.9
    # Nodes that are there for 30 minutes and gone for 30: half of the time is lost, and all units are still done.
    half = simulate(20, 1500, 8, costs, Loss(mean_secs=1800, repair_secs=1800))
    assert half.utilization == pytest.approx(0.5, abs=0.08)
    assert half.lost_units > 0
    assert simulate(20, 20, 8, costs, Loss(mean_secs=1800)).wall_secs == simulate(20, 20, 8, costs, Loss(mean_secs=1800)).wall_secs


def test_notifications_do_not_go_to_private_networks() -> None:
    for url in ("http://127.0.0.1:1/", "http://localhost:1/", "http://169.254.169.254/latest", "http://[::1]:1/", "http://10.0.0.1/"):
        with pytest.raises(FarmError, match="not a public one"):
            webhook.post(url, {}, allow_private=False)
    with pytest.raises(FarmError, match="does not answer"):
        webhook.post("http://127.0.0.1:1/", {}, allow_private=True)
