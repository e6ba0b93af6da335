"""Points of a sweep: the records of each alone, whatever the chunks, and those that fail among them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kaneflex.report.summary import sensor_summaries
from kaneflex.solve import variants
from kaneflex.solve.loading import load
from kaneflex.solve.simulation import solve
from kaneflex.study.plan import Plan, make_plan
from kaneflex.study.records import Record, solve_points

STUDY = """
scene = "engine"
settings = ["solve.steps=120", "solve.modes=2"]
series = true

[parameters]
"solve.preset" = ["stiffened", "quasistatic"]
"rod.length" = ["137 mm", "30 mm"]
"drives.main.speed" = {from = "2000 rpm", to = "5000 rpm", count = 5}
"""
"""Twenty points, of which five are integrated; with a rod of 30 mm the linkage can't close."""


def plan_of(folder: Path, text: str) -> Plan:
    (folder / "study.toml").write_text(text)
    return make_plan(folder / "study.toml")


@pytest.fixture(scope="module")
def solved(tmp_path_factory) -> tuple[Plan, list[Record]]:
    plan = plan_of(tmp_path_factory.mktemp("sweep"), STUDY)
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


def test_many_speeds_are_read_as_runs_are_and_alike_in_any_chunk(tmp_path):
    plan = plan_of(tmp_path, SPEEDS)
    assert plan.alike
    records = list(solve_points(plan, [0, 11, 21]))
    for record in records:
        solution = solve(load(plan.at(record.point)))
        assert list(record.series) == list(solution.series)
        for name, series in solution.series.items():
            size = abs(series.values).max()
            assert record.labels[name] == (series.unit, series.meaning)
            np.testing.assert_allclose(record.series[name], series.values, rtol=0, atol=1e-10 * size, err_msg=name)
    assert_same_bits(list(solve_points(plan_of(tmp_path, SPEEDS), [11])), dict(zip([0, 11, 21], records, strict=True)))


def test_points_that_differ_by_more_than_speeds_are_not_alike(tmp_path):
    ratios = '"damping.rayleigh.ratio" = [0.01, 0.02]\n'
    assert not plan_of(tmp_path, SPEEDS.replace("count = 22", "count = 19")).alike
    assert not plan_of(tmp_path, SPEEDS + ratios).alike  # which vary faster
    assert plan_of(tmp_path, SPEEDS.replace('"main.speed"', ratios + '"main.speed"')).alike


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
