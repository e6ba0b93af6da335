"""Sensors as sums of products and in one compiled pass: they read what is measured of a run by their readers."""

import math
from itertools import islice, pairwise

import numpy as np
import pytest
from runs import SHORT, run, shipped, solved

import kaneflex
from kaneflex import Solution, load, read_scene, with_settings
from kaneflex.response.compiled_readings import CompiledReadings
from kaneflex.response.polynomials import Readings, sensor_readings
from kaneflex.response.reactions import by_reflections
from kaneflex.response.sensors import measure
from kaneflex.solve.simulation import solve
from kaneflex.solve.variants import has_compiled_readings


def evaluated(readings: Readings, given: list[np.ndarray]) -> dict[str, np.ndarray]:
    """By sensor at all instants, (n_times,)."""
    values = [*given, np.ones_like(given[0])]
    terms = list(zip(readings.constants, *readings.pairs.T, strict=True))
    sums = iter([terms[begin:end] for begin, end in pairwise([0, *readings.ends.tolist()])])

    def of(own: list[tuple[float, int, int]]) -> np.ndarray:
        return sum((by * values[a] * values[b] for by, a, b in own), np.zeros_like(given[0]))

    for own, rows, n in readings.stages:
        for each in islice(sums, own):
            values.append(of(each))
        if n and not rows:
            x, y = (of(each) for each in islice(sums, 2))
            values += [np.hypot(x, y), np.arctan2(y, x)]
        elif n:
            A = np.array([of(each) for each in islice(sums, rows * n)]).reshape(rows, n, -1).transpose(2, 0, 1)
            b = np.array([of(each) for each in islice(sums, rows)]).T
            values += [*(np.linalg.solve(A, b[..., None])[..., 0] if rows == n else by_reflections(A, b)).T]
    assert len(values) == readings.count
    return dict(zip(readings.sensors, map(of, sums), strict=True))


# Rod forces of an elastic slider crank; three links and masses; a slot; loops that are closed by Newton's method.
@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["engine", "four-bar", "v-engine", "quick-return", "pulsating-strut", "six-bar"])
def test_what_sensors_read_is_traced(name):
    assert not left_out(run(name))


def test_a_body_that_turns_all_round_is_left_out_and_one_that_swings_past_pi_is_not():
    """The four-bar turned by 66 deg: its rocker swings about half a turn from the x axis."""
    tables = {
        "schema": 1, "like": "four-bar", "ground": {"right": ["103.3 mm", "232 mm"]},
        "drives": {"main": {"angle": "66 deg"}},
        "sensors": {"crank_angle": {"position": "crank.start", "component": "angle"}},
    }  # fmt: skip
    solution = solved(kaneflex.scene_of(tables))
    angle = abs(solution["rocker_angle"].values)
    assert angle.min() < math.pi < angle.max()
    assert left_out(solution) == {"crank_angle"}


def test_places_of_points_of_turned_bodies_are_traced():
    """Where a machine's tip goes is what other programs ask for; a coupler's point is no less a sum of products."""
    points = {
        f"{component}_{axes}": {"position": "coupler.mid", "component": component, "axes": axes}
        for component in ("x", "y") for axes in ("global", "body")
    }  # fmt: skip
    tables = {"schema": 1, "like": "four-bar", "sensors": points}
    assert not left_out(solved(kaneflex.scene_of(tables)))


def left_out(solution: kaneflex.Solution) -> set[str]:
    """Sensors that are no sums of products; that all others are what the run has is checked."""
    bound, found = solution.model, solution.trajectory
    readings = sensor_readings(bound)
    instants = np.linspace(0, len(found.times) - 1, 23).astype(int)
    moved = [column for part in (found.z, found.v, found.a) for column in part[instants].T]
    read = evaluated(readings, [*bound.motion.at(found.times[instants]).values.T, *moved])
    for sensor, values in read.items():
        series = solution[sensor].values
        np.testing.assert_allclose(values, series[instants], rtol=0.0, atol=1e-12 * abs(series).max(), err_msg=sensor)
    return {*bound.scene.sensors} - {*readings.sensors}


SCENES = [
    name for name, scene in shipped().items()
    if not scene.is_spatial and scene.solve.preset != "coupled" and not scene.is_frame
]  # fmt: skip
OTHERS = [("engine", "quasistatic"), ("engine", "rigid"), ("engine", "linear"), ("six-bar", "quasistatic")]


def coarsely(name: str, *settings: str) -> Solution:
    return solve(load(with_settings(read_scene(name), [*SHORT.get(name, ()), "solve.steps=90", *settings])))


def assert_read_alike(solution: Solution) -> CompiledReadings:
    compiled, moved = CompiledReadings.of(solution.motion), solution.trajectory
    found, expected = compiled.measure(solution.motion, (moved.z, moved.v, moved.a)), measure(solution.motion)
    assert list(found) == list(expected)
    largest: dict[str, float] = {}
    for series in expected.values():
        largest[series.unit] = max(largest.get(series.unit, 0.0), abs(series.values).max())
    for key, series in expected.items():
        assert (found[key].unit, found[key].meaning) == (series.unit, series.meaning)
        bound = max(1e-9 * abs(series.values).max(), 1e-12 * largest[series.unit])  # what is zero rounds otherwise
        np.testing.assert_allclose(found[key].values, series.values, rtol=0, atol=bound, err_msg=key)
    return compiled


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", SCENES)
def test_one_pass_reads_what_the_readers_read(name):
    compiled = assert_read_alike(coarsely(name))
    assert not compiled.unread


@pytest.mark.parametrize("name, preset", OTHERS)
def test_of_other_presets_too(name, preset):
    assert_read_alike(coarsely(name, f"solve.preset={preset}"))


def test_few_modes_keep_the_static_share_of_the_others():
    assert_read_alike(coarsely("engine", "solve.modes=5"))


def test_what_is_not_finite_is_left_to_the_readers():
    solution = coarsely("engine")
    compiled, moved = CompiledReadings.of(solution.motion), solution.trajectory
    assert compiled.measure(solution.motion, (moved.z * np.inf, moved.v, moved.a)) is None


def test_equations_of_an_instant_differ_from_speed_to_speed():
    assert has_compiled_readings(load(read_scene("engine")))
    assert not has_compiled_readings(load(read_scene("engine-paper")))
