"""Points of a sweep: the records of each alone, whatever the chunks, and those that fail among them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kaneflex.report.summary import sensor_summaries
from kaneflex.scene import read_scene
from kaneflex.solve.loading import load
from kaneflex.solve.simulation import simulate, solve
from kaneflex.solve.solution import read_together
from kaneflex.solve.variants import Variants
from kaneflex.study.plan import Plan, make_plan
from kaneflex.study.records import Record, solve_points
from kaneflex.support.errors import SceneError

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
        solution = simulate(load(plan.at(record.point)))
        for name, entry in sensor_summaries(solution).items():
            size = max(abs(entry.min), abs(entry.max))
            expected = [entry.min, entry.max, entry.rms, entry.mean]
            np.testing.assert_allclose(record.statistics[name], expected, rtol=0, atol=1e-9 * size, err_msg=name)


@pytest.mark.parametrize("size", [1, 3, 8])
def test_chunks_of_any_size_give_the_same_bits(solved, size):
    plan, whole = solved
    for first in range(0, 20, size):
        for record in solve_points(plan, range(20)[first : first + size]):
            expected = whole[record.point]
            assert (record.outcome, record.reason) == (expected.outcome, expected.reason)
            assert record.statistics == expected.statistics and record.labels == expected.labels
            for name, values in expected.series.items():
                assert np.array_equal(record.series[name], values)


def test_sensors_read_in_one_pass_are_those_of_each_run_and_one_without_a_value_harms_no_other():
    variants = Variants(read_scene("engine"))
    runs = [solve(variants.load([f"main.speed={rpm} rpm", "solve.steps=90"])) for rpm in (2000, 3000, 5000)]
    lost = replace(runs[1].trajectory, z=np.full_like(runs[1].trajectory.z, np.inf))
    broken = replace(runs[1], trajectory=lost)
    with np.errstate(invalid="ignore"):
        read_together(runs)
        read_together(both := [replace(runs[2]), broken])
        with pytest.raises(SceneError, match="no finite value at t = 0 s"):
            _ = broken.series
    for name, series in runs[2].series.items():
        assert np.array_equal(both[0].series[name].values, series.values), name
        alone = replace(runs[2]).series[name]
        assert (series.unit, series.meaning) == (alone.unit, alone.meaning)
        np.testing.assert_allclose(series.values, alone.values, rtol=0, atol=1e-14 * abs(alone.values).max())


def test_an_unstable_point_is_recorded_with_its_reason_and_disturbs_no_other(tmp_path):
    text = 'scene = "mathieu"\nsettings = ["solve.start=periodic", "solve.steps=90"]\n'
    plan = plan_of(tmp_path, text + '[parameters]\n"drives.clock.speed" = ["3 rad/s", "2 rad/s", "5 rad/s"]\n')
    records = list(solve_points(plan, range(3)))
    for record in records:
        alone = simulate(load(plan.at(record.point))).trajectory
        assert record.outcome == alone.outcome.name.lower()
        assert record.reason == ("" if record.outcome == "completed" else alone.message)
    assert [record.outcome for record in records] == ["completed", "unstable", "completed"]
