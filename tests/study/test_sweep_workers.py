"""Sweeps point by point, in chunks, on several workers and on a Dask cluster: the same dataset bit for bit."""

import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray
from command_line import cli, refused
from machines import pendulum
from studies import dataset, plan_of, swept_in

from kaneflex import SceneError, in_processes, sweep
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


SCENE = pendulum(
    'length = "100 mm", mass = "1 kg", centre = ["15 mm", "1 mm"]', 'speed = "6000 rpm", cycle = "720 deg"',
    "arm", "main",
    loads="""
push = {force_on = "arm.end", direction = [-1, 0], table = "weak.csv", against = "main", period = "720 deg"}""",
    sensors='torque = {drive_torque = "main"}\nbearing = {joint_force = "main", component = "x"}',
)
"""Of a structure that no shipped module serves."""
TABLES = """
scene = "own.toml"
settings = ["solve.preset=rigid", "solve.steps=36"]

[parameters]
"drives.main.speed" = {from = "1000 rpm", to = "6000 rpm", count = 30}
"loads.push.table" = ["weak.csv", "strong.csv"]
"""
PATIENCE = 60.0


@pytest.fixture(scope="module")
def plan(tmp_path_factory) -> Iterator[Plan]:
    folder = tmp_path_factory.mktemp("study")
    (folder / "own.toml").write_text(SCENE)
    for name, force in (("weak.csv", 1), ("strong.csv", 900)):
        rows = "".join(f"{angle},{force}\n" for angle in range(0, 721, 180))
        (folder / name).write_text("angle_deg,F_gas_N\n" + rows)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        yield plan_of(folder, TABLES)


def until(condition: Callable[[], object]) -> object:
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        found = condition()
        if found:
            return found
        time.sleep(0.05)
    raise TimeoutError


@pytest.fixture(scope="module")
def cluster(tmp_path_factory, peer) -> Iterator[tuple[str, list[subprocess.Popen], Path]]:
    """Address of a scheduler, its process and those of two workers, and the cache that these have for themselves."""
    peer("distributed")
    folder = tmp_path_factory.mktemp("cluster")
    file = folder / "scheduler.json"
    environment = os.environ | {"XDG_CACHE_HOME": str(folder / "cache"), "DASK_DISTRIBUTED__WORKER__DAEMON": "False"}

    def start(what: str, *arguments: str) -> subprocess.Popen:
        command = [sys.executable, "-m", f"distributed.cli.{what}", "--scheduler-file", str(file), *arguments]
        log = (folder / f"{what}.log").open("ab")
        return subprocess.Popen(command, env=environment, cwd=folder, stdout=log, stderr=log)

    processes = [start("dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")]
    try:
        until(file.exists)
        single = ("--no-nanny", "--nthreads", "1", "--no-dashboard", "--local-directory", str(folder))
        processes += [start("dask_worker", *single) for _ in range(2)]
        from distributed import Client

        with Client(scheduler_file=str(file), set_as_default=False) as client:
            client.wait_for_workers(2, timeout=PATIENCE)
            address = client.scheduler.address
        yield address, processes, folder / "cache"
    finally:
        for process in processes:
            process.kill()
            process.wait()


def test_a_killed_workers_chunks_are_solved_again_and_the_dataset_is_that_of_one_process(tmp_path, plan, cluster):
    from kaneflex.study.cluster import on_cluster

    address, (_, *workers), cache = cluster
    killed = []

    tables = [Path(name) for name in plan.files]

    def kill(progress):
        if progress.now == 1:  # the one that is solved here: workers have only what was sent to them
            for table in tables:
                table.rename(table.with_suffix(".away"))
        if progress.now >= 6 and not killed:
            workers[0].send_signal(signal.SIGKILL)
            killed.append(workers[0].wait())

    finished = sweep(plan, tmp_path / "there", on_cluster(address), kill)
    assert killed == [-signal.SIGKILL] and finished.failures == {} and finished.total == 60
    for table in tables:
        table.with_suffix(".away").rename(table)
    sweep(plan, tmp_path / "here")
    there, here = dataset(tmp_path / "there"), dataset(tmp_path / "here")
    for name in here.data_vars:
        assert (there[name].values == here[name].values).all(), name
    assert set(there.data_vars) == set(here.data_vars) and there["point"].values.tolist() == list(range(60))
    assert len(list(cache.rglob("format-*/*.py"))) == 1  # the module, by its hash
    assert {path.name for path in cache.rglob("files/*/*.csv")} >= {"weak.csv", "strong.csv"}


def test_a_worker_with_another_kaneflex_takes_no_part(tmp_path, plan, cluster, monkeypatch):
    from kaneflex.study import cluster as ours

    monkeypatch.setattr(workers, "_maker", lambda: "9.9 format-0")
    with pytest.raises(SceneError, match=r"it has kaneflex \d.*, not 9\.9 format-0.*Install the same kaneflex"):
        sweep(plan, tmp_path / "out", ours.on_cluster(cluster[0]))
    assert len((tmp_path / "out" / "journal.jsonl").read_text().splitlines()) == 1  # what was solved here is kept


def test_a_killed_scheduler_is_named_and_what_is_solved_is_kept(tmp_path, plan, cluster, monkeypatch):
    """The last test of the cluster."""
    from kaneflex.study import cluster as ours

    monkeypatch.setattr(ours, "_CONNECTING", 3.0)  # seconds for which Dask tries to find it again
    address, (scheduler, *_), _ = cluster

    def kill(progress):
        if progress.now >= 4 and scheduler.poll() is None:
            scheduler.kill()
            scheduler.wait()

    began = time.monotonic()
    with pytest.raises(SceneError, match=r"^--scheduler = .*: the connection .* is lost.*repeat the command"):
        sweep(plan, tmp_path / "out", ours.on_cluster(address), kill)
    assert time.monotonic() - began < PATIENCE
    assert len((tmp_path / "out" / "journal.jsonl").read_text().splitlines()) >= 4


def test_where_no_scheduler_answers(tmp_path, plan, peer, monkeypatch):
    peer("distributed")
    from kaneflex.study import cluster

    monkeypatch.setattr(cluster, "_CONNECTING", 0.2)
    (tmp_path / "study.toml").write_text('scene = "engine"\n[parameters]\n"rod.length" = ["137 mm"]\n')
    address = "tcp://127.0.0.1:1"
    refused(cli("sweep", tmp_path / "study.toml", "--scheduler", address), "--scheduler", "no scheduler answers")
    both = cli("sweep", tmp_path / "study.toml", "--scheduler", address, "--workers", 2)
    refused(both, "--workers = 2", "its own workers")


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
