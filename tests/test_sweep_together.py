"""Points of a sweep side by side: the records of each alone, whatever the chunks, and those that fail among them."""

from pathlib import Path

import numpy as np
import pytest

from kaneflex.report.summary import sensor_summaries
from kaneflex.scene import read_scene, with_settings
from kaneflex.solve.loading import load
from kaneflex.solve.simulation import simulate, simulate_together
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


def models(name: str, settings: list[str], values: dict[str, list[str]]):
    (path, texts), *_ = values.items()
    return [load(with_settings(read_scene(name), [*settings, f"{path}={text}"])) for text in texts]


BY_STEPS = ("solve.steps=90", "solve.integrator=radau")


@pytest.mark.parametrize(
    ("scene", "settings", "values"),
    [
        ("engine", [*BY_STEPS, "solve.preset=linear"], {"drives.main.speed": ["'1000 rpm'", "'6000 rpm'"]}),
        ("engine", ["solve.steps=90", "solve.modes=2"], {"solve.integrator": ["newmark", "generalised-alpha"]}),
        ("engine", [*BY_STEPS, "solve.modes=3"], {"rod.length": ["'120 mm'", "'180 mm'"]}),
        ("engine-transient", ["solve.steps=300"], {"rod.E": ["'100 GPa'", "'200 GPa'"]}),
        ("engine", [*BY_STEPS, "solve.modes=2"], {"solve.start": ["zero", "quasistatic", "periodic"]}),
    ],
    ids=["linear", "integrators", "lengths", "transient", "starts"],
)
def test_presets_methods_and_starts_give_what_simulate_does(scene, settings, values):
    found = models(scene, settings, values)
    together = simulate_together(found)
    assert None not in together
    for model, solution in zip(found, together, strict=True):
        alone = simulate(model)
        assert solution.trajectory.message == alone.trajectory.message
        np.testing.assert_array_equal(solution.times, alone.times)
        for got, wanted in zip(solution.coordinates, alone.coordinates, strict=True):
            np.testing.assert_allclose(got, wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())


def test_models_that_are_not_integrated_in_lanes_are_left_to_simulate():
    presets = models("engine", ["solve.steps=36"], {"solve.preset": ["rigid", "quasistatic", "paper", "coupled"]})
    assert simulate_together(presets) == [None] * 4
    assert simulate_together([]) == []


def test_an_unstable_point_is_recorded_with_its_reason_and_disturbs_no_other(tmp_path):
    text = 'scene = "mathieu"\nsettings = ["solve.start=periodic", "solve.steps=90"]\n'
    plan = plan_of(tmp_path, text + '[parameters]\n"drives.clock.speed" = ["3 rad/s", "2 rad/s", "5 rad/s"]\n')
    records = list(solve_points(plan, range(3)))
    for record in records:
        alone = simulate(load(plan.at(record.point))).trajectory
        assert record.outcome == alone.outcome.name.lower()
        assert record.reason == ("" if record.outcome == "completed" else alone.message)
    assert [record.outcome for record in records] == ["completed", "unstable", "completed"]


def test_what_breaks_the_lanes_is_left_to_each_point_by_itself(solved, monkeypatch):
    plan, whole = solved

    def broken(models):
        raise MemoryError

    monkeypatch.setattr("kaneflex.solve.variants.simulate_together", broken)
    for record in solve_points(plan, range(2)):
        for name, statistics in record.statistics.items():
            assert statistics == pytest.approx(whole[record.point].statistics[name], rel=1e-6, abs=1e-12)
