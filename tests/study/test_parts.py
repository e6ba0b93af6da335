"""`kaneflex terms` of clearances and friction: against the tight mechanism, and against none."""

import json

import numpy as np
import pytest
from command_line import cli, refused
from machines import slider_crank
from runs import solved

from kaneflex import read_scene, scene_of, terms, with_settings
from kaneflex.plots.studies import terms as figure
from kaneflex.study.trade.candidates import neutral
from kaneflex.study.trade.parts import parts, tightened

SHORT = ("solve.duration=6 ms", "solve.steps=600", "rod.beam.elements=2")
TIGHT = slider_crank(
    'length = "50 mm", mass = "0.3 kg", inertia = "100 kg mm^2"',
    'length = "120 mm", beam = {material = "steel", section = {rectangle = ["6 mm", "12 mm"]}, elements = 2}',
    'mass = "0.14 kg"', 'speed = "3000 rpm"',
    sensors="""
slide = {position = "bore", component = "x"}
knock = {acceleration = "piston", axes = "global"}
crank_torque = {drive_torque = "main"}
rod_moment = {bending_moment = "rod.mid"}""",
    solve={"preset": "coupled", "duration": "6 ms", "steps": 600},
)
COUPLED = """
schema = 1
bodies.motor = {mass = "4 kg", inertia = "0.01 kg m^2"}
bodies.mill = {mass = "9 kg", inertia = "0.05 kg m^2"}
joints.shaft = {revolute = ["ground", "motor"]}
joints.bearing = {revolute = ["ground", "mill"]}
joints.coupling.revolute = ["motor", "mill"]
joints.coupling.clearance = {angle = "0.25 deg", middle = "20 deg", contact = {stiffness = 2e6, restitution = 0.6}}
drives.shaft = {free = true, initial_speed = "10 rad/s"}
drives.bearing = {free = true, initial_speed = "10 rad/s", angle = "20 deg"}
loads.ripple = {torque_at = "shaft", law = "6 * sin(40 * t)"}
sensors.speed = {velocity = "mill", component = "angle"}
sensors.play = {position = "coupling", component = "angle"}
solve = {preset = "coupled", duration = "0.1 s", steps = 200}
"""


@pytest.fixture(scope="module")
def found():
    return terms(with_settings(read_scene("slider-crank-clearance"), SHORT))


def changes(found, group):
    (effect,) = (effect for effect in found.effects if effect.group.name == group)
    return {change.sensor: change for change in effect.differences}


def test_what_is_compared_with_is_the_tight_mechanism(found):
    """Written by hand: its peaks are those without the clearance."""
    solution, clearance = solved(scene_of(TIGHT)), changes(found, "clearance wrist")
    assert clearance.keys() == set(solution.model.scene.sensors) == set(found.sensors) - {"pin_force", "pin_x", "pin_y"}
    for name, change in clearance.items():
        assert change.peak == pytest.approx(abs(solution.series[name].values).max(), rel=1e-5), name


def test_what_is_compared_is_the_scene_as_it_is(found):
    solution = solved(found.scene)
    for name, change in changes(found, "clearance wrist").items():
        assert change.reference_peak == abs(solution.series[name].values).max()


def test_a_knock_matters_and_the_way_of_the_piston_does_not(found):
    clearance = changes(found, "clearance wrist")
    assert clearance["knock"].error > 0.5 and clearance["slide"].error < 2e-3
    assert [effect.needed for effect in found.effects if effect.group.name == "clearance wrist"] == [True]
    slide = terms(found.scene, sensors=["slide"])
    assert [effect.needed for effect in slide.effects if effect.group.name == "clearance wrist"] == [False]


def test_a_smaller_clearance_changes_less():
    scene = with_settings(read_scene("slider-crank-clearance"), [*SHORT, "joints.wrist.clearance.radial=2 um"])
    assert changes(terms(scene, sensors=["slide"]), "clearance wrist")["slide"].error < 2e-5


def test_backlash_is_compared_with_a_shaft_in_one_piece():
    """Without play both turn as one: w' = torque/(sum of inertias)."""
    scene = scene_of(COUPLED)
    settings = tightened(scene, ["coupling"])
    assert "sensors.play=none" in settings
    solution = solved(scene, *settings)
    expected = 10 + 6 / 0.06 / 40 * (1 - np.cos(40 * solution.times))
    assert solution.series["speed"].values == pytest.approx(expected, rel=1e-7)
    backlash = changes(terms(scene), "clearance coupling")
    assert backlash["speed"].peak == pytest.approx(expected.max(), rel=1e-7) and backlash["speed"].error > 0


def test_a_guide_made_tight_closes_as_it_stands():
    settings = tightened(read_scene("engine-rig-clearance"), ["bore"])
    tight = with_settings(read_scene("engine-rig-clearance"), settings)
    assert list(tight.drives) == ["main"] and not tight.contacts and "sensors.piston_tilt=none" in settings


def test_the_command_says_what_sensors_are_with_and_without(tmp_path):
    folder = tmp_path / "out"
    arguments = [part for setting in SHORT for part in ("--set", setting)]
    arguments += ["--sensors", "slide", "--no-plots"]
    result = cli("terms", "slider-crank-clearance", *arguments, "-o", folder)
    assert result.exit_code == 0, result.output
    (group,) = (e for e in json.loads((folder / "terms.json").read_text())["groups"] if e["group"] == "clearance wrist")
    slide = group["sensors"]["slide"]
    assert slide["with"] > 0.1 and slide["without"] == pytest.approx(slide["with"], rel=2e-3)
    assert not group["needed"] and group["change"] == slide["peak"]


def test_friction_is_compared_with_none():
    """Without friction the block on its belt hangs on its spring, at rest where it began."""
    scene = with_settings(read_scene("stick-slip"), ["solve.duration=1 s", "solve.steps=200"])
    removed, left_out = parts(neutral(scene))
    assert removed == {"friction rub": ("joints.rub.friction=none", "sensors.drag=none")} and not left_out
    without = solved(scene, *removed["friction rub"])
    found = terms(scene)
    (effect,) = found.effects
    assert len(figure(found).axes) == 1  # no operations are counted
    assert effect.needed and "drag" not in {change.sensor for change in effect.differences}
    for change in effect.differences:
        assert change.peak == abs(without.series[change.sensor].values).max() and change.error > 0


def test_what_has_no_sensor_left_is_named(tmp_path):
    assert parts(neutral(read_scene("engine"))) == ({}, {})
    result = cli("terms", "slider-crank-clearance", "--sensors", "slid", "-o", tmp_path / "out")
    refused(result, "no such sensor", "slide")
    scene = with_settings(read_scene("slider-crank-clearance"), [*SHORT, "solve.duration=1 ms", "solve.steps=10"])
    found = terms(scene, sensors=["pin_force"])
    assert "no requested sensor exists without it" in found.left_out["clearance wrist"]
