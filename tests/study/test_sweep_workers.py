"""Sweeps on several workers: the same dataset bit for bit, workers that are killed, and chunks of about a second."""

import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest
import xarray
from command_line import cli

from kaneflex import in_processes, sweep
from kaneflex.study import workers
from kaneflex.study.plan import Plan, make_plan
from kaneflex.study.records import Record
from kaneflex.study.workers import DIED, Lost, Processes, Queue, first_of_each_kind, in_chunks

STUDY = """
scene = "engine"
settings = ["solve.steps=36", "solve.modes=2"]

[parameters]
"solve.preset" = ["rigid", "stiffened"]
"drives.main.speed" = {from = "1000 rpm", to = "6000 rpm", count = 10}
"""


def dataset(folder: Path) -> xarray.Dataset:
    with xarray.open_dataset(folder / "sweep.nc", engine="scipy") as found:
        return found.load()


@pytest.fixture(scope="module")
def swept(tmp_path_factory) -> tuple[Plan, xarray.Dataset]:
    folder = tmp_path_factory.mktemp("sweep")
    (folder / "study.toml").write_text(STUDY)
    plan = make_plan(folder / "study.toml")
    sweep(plan, folder / "out")
    return plan, dataset(folder / "out")


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
    """A pool that calls `kill` with the number of answers so far before it waits for the next."""

    class Killing(Processes):
        answers = 0

        def finished(self):
            kill(self)
            for item in super().finished():
                self.answers += 1
                yield item

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
        self.point, self.under_way, self.solved = point, {}, Counter()

    def submit(self, points):
        self.under_way[tuple(points)] = points
        return tuple(points)

    def finished(self):
        if any(self.point in chunk for chunk in self.under_way):
            found = [(chunk, self.lost) for chunk in self.under_way]
        else:
            found = [(chunk, lambda chunk=chunk: self.answer(chunk)) for chunk in self.under_way]
        self.under_way = {}
        return found

    def lost(self):
        raise Lost

    def answer(self, chunk):
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
