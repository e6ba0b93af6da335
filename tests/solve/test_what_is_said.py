"""What runs and `check` say of torque-free bodies, stored steps, freedoms and the time that they took."""

import time

import pytest
from runs import solved

from kaneflex import SceneError, load, read_scene, scene_of, with_settings
from kaneflex.multibody.time import spatial_forward
from kaneflex.report import checked
from kaneflex.report.summary import summarise
from kaneflex.solve.simulation import solve

TORQUE_FREE = """
schema = 1
bodies.top = {mass = 1, inertia = [1, 2, 3], free = {at = [0, 0, 0], angular_velocity = [0.01, 2, 0]}}
sensors.x = {position = "top", component = "x"}
solve = {preset = "coupled", duration = "10 s", steps = 50, errors = "none"}
"""
SPACE = "spatial-slider-crank-elastic"


def test_a_torque_free_body_loses_no_energy():
    """Only the tolerance changes its energy; an integration that is wrong by more is still warned of."""
    found = solved(scene_of(TORQUE_FREE))
    assert found.energy.drift < 1e-5 and not [text for text in found.warnings if "energy balance" in text]
    rough = solved(scene_of(TORQUE_FREE), "solve.tolerance=1e-2")
    assert [text for text in rough.warnings if "energy balance" in text]


def test_forward_is_an_idle_setting_of_coupled_bodies_in_space():
    settings = ["solve.preset=coupled", "solve.start=zero", "solve.duration=1 ms", "solve.steps=2"]
    for scene in (scene_of(TORQUE_FREE), read_scene(SPACE)):
        idle = load(with_settings(scene, [*settings, "solve.forward.tolerance=1e-4"]))
        assert [text for text in idle.warnings if text.startswith("solve.forward has no effect")]


def test_a_method_of_free_joints_in_space_is_refused():
    """Loads, drives and start decide; there is one method."""
    said = r"solve.forward.method = 'RK45': free joints in space are integrated by radau. Leave it out"
    with pytest.raises(SceneError, match=said):
        load(with_settings(read_scene("spinning-top"), ["solve.forward.method=RK45"]))


def test_steps_that_are_not_stored_are_said():
    scene = with_settings(read_scene("engine"), ["solve.steps=1000000"])
    assert "solve.steps = 1000000: one instant is stored every 25 steps, 40001 in all" in checked.warnings(load(scene))
    assert not [text for text in load(read_scene("engine")).warnings if "stored" in text]


@pytest.mark.parametrize("settings", [(), ("solve.preset=coupled",), ("solve.preset=rigid",)])
def test_check_warns_of_what_is_between_two_steps_as_a_run_does(settings):
    model = load(with_settings(read_scene("engine"), ["solve.steps=1", *settings]))
    found = checked.warnings(model)
    assert any("turns by 720 deg in a step" in text for text in found)
    assert set(found) >= {text for text in solve(model).warnings if "between two steps" in text or "in a step" in text}


COUNT = "degrees of freedom"


def test_shapes_are_no_freedoms_of_joints():
    settings = ["solve.start=zero", "solve.duration=1 ms", "solve.steps=2"]
    freedoms = [
        checked.description(load(with_settings(read_scene(SPACE), [*settings, f"solve.preset={preset}"])))[COUNT]
        for preset in ("coupled", "stiffened")
    ]
    assert freedoms[0] == freedoms[1] and "4 at shaft, guide, cross" in freedoms[0]["joints"]


def test_an_integration_counts_as_solving(monkeypatch):
    go = spatial_forward.SpatialRun.go

    def slow(run, *given):
        time.sleep(0.3)
        go(run, *given)

    monkeypatch.setattr(spatial_forward.SpatialRun, "go", slow)
    began = time.perf_counter()
    timing = summarise(solved(scene_of(TORQUE_FREE))).timing
    spent = time.perf_counter() - began
    assert timing.integrate_s >= 0.3 and timing.set_up_s <= spent - 0.3
