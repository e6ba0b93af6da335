"""Sensors in one compiled pass read what their readers read, on shipped scenes of all one-way presets in the plane."""

import numpy as np
import pytest
from runs import SHORT

from kaneflex import Solution, load, read_scene, shipped_scenes, with_settings
from kaneflex.response.compiled_readings import CompiledReadings
from kaneflex.response.sensors import measure
from kaneflex.solve.simulation import solve
from kaneflex.solve.variants import has_compiled_readings

SCENES = [
    name for name in shipped_scenes()
    if not (scene := read_scene(name)).is_spatial and scene.solve.preset != "coupled" and not scene.is_frame
]  # fmt: skip
OTHERS = [("engine", "quasistatic"), ("engine", "rigid"), ("engine", "linear"), ("six-bar", "quasistatic")]


def solved(name: str, *settings: str) -> Solution:
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
    compiled = assert_read_alike(solved(name))
    assert not compiled.unread


@pytest.mark.parametrize("name, preset", OTHERS)
def test_of_other_presets_too(name, preset):
    assert_read_alike(solved(name, f"solve.preset={preset}"))


def test_few_modes_keep_the_static_share_of_the_others():
    assert_read_alike(solved("engine", "solve.modes=5"))


def test_what_is_not_finite_is_left_to_the_readers():
    solution = solved("engine")
    compiled, moved = CompiledReadings.of(solution.motion), solution.trajectory
    assert compiled.measure(solution.motion, (moved.z * np.inf, moved.v, moved.a)) is None


def test_equations_of_an_instant_differ_from_speed_to_speed():
    assert has_compiled_readings(load(read_scene("engine")))
    assert not has_compiled_readings(load(read_scene("engine-paper")))
