"""Sweeps point by point, in chunks and in several processes: the same dataset bit for bit."""

import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace

import numpy as np
import pytest
import xarray
from command_line import cli
from studies import dataset, plan_of, swept_in

from kaneflex import in_processes, sweep
from kaneflex.report.summary import sensor_summaries
from kaneflex.solve import variants
from kaneflex.solve.loading import load
from kaneflex.solve.simulation import solve
from kaneflex.study import workers
from kaneflex.study.plan import Plan
from kaneflex.study.records import Record, solve_points
from kaneflex.study.workers import DIED, Lost, Processes, Queue, first_of_each_kind, in_chunks

STUDY = """
scene = "engine"
settings = ["solve.steps=36", "solve.modes=2"]

[parameters]
"solve.preset" = ["rigid", "stiffened"]
"drives.main.speed" = {from = "1000 rpm", to = "6000 rpm", count = 10}
"""


@pytest.fixture(scope="module")
def swept(tmp_path_factory) -> tuple[Plan, xarray.Dataset]:
    return swept_in(tmp_path_factory.mktemp("sweep"), STUDY)


def test_the_first_of_each_kind_may_have_equations_of_its_own(swept):
    plan, _ = swept
    assert first_of_each_kind(plan, range(20)) == [0, 10]
    assert first_of_each_kind(plan, range(3, 20)) == [3, 10]


def test_two_processes_give_the_dataset_of_one_bit_for_bit(tmp_path, swept):
    _, whole = swept
    (tmp_path / "study.toml").write_text(STUDY)
    result = cli("sweep", tmp_path / "study.toml", "--no-plots", "-o", tmp_path / "out", "--workers", 2)
    assert result.exit_code == 0, result.output
    assert dataset(tmp_path / "out").identical(whole)


def killing(kill: Callable[[int], None]) -> type[Processes]:
    """A pool that calls `kill` with the number of answers so far before it gives the next."""

    class Killing(Processes):
        answers = 0

        def answer(self, future):
            kill(self)
            found = super().answer(future)
            self.answers += 1
            return found

    return Killing


def test_a_killed_process_loses_no_point(tmp_path, swept, monkeypatch):
    plan, whole = swept
    killed = []

    def kill(pool):
        if pool.answers >= 2 and not killed:
            killed.append(next(iter(pool._executor._processes)))
            os.kill(killed[0], signal.SIGKILL)

    monkeypatch.setattr(workers, "Processes", killing(kill))
    finished = sweep(plan, tmp_path / "out", in_processes(2))
    assert killed and finished.failures == {}
    assert dataset(tmp_path / "out").identical(whole)


def test_a_chunk_lasts_a_second_and_the_last_ones_are_shared():
    queue = Queue(range(1000))
    assert queue.take(2) == (0,)
    queue.lasted(1, 0.02)
    assert queue.take(2) == tuple(range(1, 51))
    queue.lasted(50, 1e-3)
    assert len(queue.take(2)) == 949 // 4
    queue.lasted(1, 30.0)
    assert len(queue.take(2)) == 1


def test_workers_of_a_sweep_that_is_killed_end_with_it(tmp_path):
    (tmp_path / "study.toml").write_text(STUDY.replace("count = 10", "count = 2000"))
    command = [sys.executable, "-m", "kaneflex", "sweep", "study.toml", "-o", "out", "--workers", "1"]
    journal = tmp_path / "out" / "journal.jsonl"
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as process:
        while process.poll() is None and not (journal.exists() and journal.read_bytes().count(b"\n") > 5):
            time.sleep(0.05)
        process.kill()
        # a worker that lived on would hold the pipe open
        process.communicate(timeout=30)
    assert journal.read_bytes().count(b"\n") > 5


class Deadly:
    """A pool whose workers all die whenever one of them solves `point`."""

    workers = 2

    def __init__(self, point: int) -> None:
        self.point, self.under_way, self.dead, self.solved = point, {}, False, Counter()

    def submit(self, points):
        future = Future()
        future.set_result(None)
        self.dead = self.point in points or (self.dead and bool(self.under_way))
        self.under_way[future] = tuple(points)
        return future

    def answer(self, future):
        chunk = self.under_way.pop(future)
        if self.dead:
            raise Lost
        self.solved.update(chunk)
        return [Record(point, "completed") for point in chunk], 0.25 * len(chunk)

    def close(self):
        pass


def test_a_point_that_kills_its_workers_is_given_up_and_its_neighbours_are_not(swept, monkeypatch):
    plan, _ = swept
    monkeypatch.setattr(workers, "solve_points", lambda plan, points: [Record(point, "completed") for point in points])
    pool = Deadly(7)
    found = {record.point: record for record in in_chunks(plan, range(20), lambda plan: pool)}
    assert sorted(found) == list(range(20))
    assert [(point, record.reason) for point, record in found.items() if record.outcome == "failed"] == [(7, DIED)]
    assert set(pool.solved.values()) == {1} and len(pool.solved) == 17


POINTS = """
scene = "engine"
settings = ["solve.steps=120", "solve.modes=2"]
series = true

[parameters]
"solve.preset" = ["stiffened", "quasistatic"]
"rod.length" = ["137 mm", "30 mm"]
"drives.main.speed" = {from = "2000 rpm", to = "5000 rpm", count = 5}
"""
"""Twenty points, of which five are integrated; with a rod of 30 mm the linkage can't close."""


@pytest.fixture(scope="module")
def solved(tmp_path_factory) -> tuple[Plan, list[Record]]:
    plan = plan_of(tmp_path_factory.mktemp("sweep"), POINTS)
    return plan, list(solve_points(plan, range(20)))


def test_every_point_is_that_of_a_run_by_itself(solved):
    plan, records = solved
    assert [record.outcome for record in records] == (["completed"] * 5 + ["refused"] * 5) * 2
    assert [record.point for record in records] == list(range(20))
    for record in (record for record in records if record.outcome == "completed"):
        solution = solve(load(plan.at(record.point)))
        for name, entry in sensor_summaries(solution).items():
            size = max(abs(entry.min), abs(entry.max))
            expected = [entry.min, entry.max, entry.rms, entry.mean]
            np.testing.assert_allclose(record.statistics[name], expected, rtol=0, atol=1e-9 * size, err_msg=name)


def assert_same_bits(records: list[Record], whole: list[Record]) -> None:
    for record in records:
        expected = whole[record.point]
        assert (record.outcome, record.reason) == (expected.outcome, expected.reason)
        assert record.statistics == expected.statistics and record.labels == expected.labels
        for name, values in expected.series.items():
            assert np.array_equal(record.series[name], values)


@pytest.mark.parametrize("size", [1, 3, 8])
def test_chunks_of_any_size_give_the_same_bits(solved, size):
    plan, whole = solved
    for first in range(0, 20, size):
        assert_same_bits(list(solve_points(plan, range(20)[first : first + size])), whole)


SPEEDS = """
scene = "four-bar"
settings = ["solve.steps=90"]
series = true

[parameters]
"main.speed" = {from = "200 rpm", to = "400 rpm", count = 22}
"""


def test_a_point_that_leaves_double_precision_is_refused_with_its_reason(tmp_path, monkeypatch):
    plan = plan_of(tmp_path, SPEEDS)
    own = variants.solve

    def lost(model):
        run = own(model)
        return replace(run, trajectory=replace(run.trajectory, z=run.trajectory.z * np.inf))

    monkeypatch.setattr(variants, "solve", lost)
    with np.errstate(invalid="ignore"):
        record = next(solve_points(plan, [3]))
    assert record.outcome == "refused" and "no finite value at t = 0 s" in record.reason


def test_an_unstable_point_is_recorded_with_its_reason_and_disturbs_no_other(tmp_path):
    text = 'scene = "mathieu"\nsettings = ["solve.start=periodic", "solve.steps=90"]\n'
    plan = plan_of(tmp_path, text + '[parameters]\n"drives.clock.speed" = ["3 rad/s", "2 rad/s", "5 rad/s"]\n')
    records = list(solve_points(plan, range(3)))
    for record in records:
        alone = solve(load(plan.at(record.point))).trajectory
        assert record.outcome == alone.outcome.name.lower()
        assert record.reason == ("" if record.outcome == "completed" else alone.message)
    assert [record.outcome for record in records] == ["completed", "unstable", "completed"]
