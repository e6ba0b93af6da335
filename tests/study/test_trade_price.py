"""What clearances change: statistics with them and without, against scenes that are written tight by hand."""

import csv
import json

import numpy as np
import pytest
from command_line import cli, refused
from machines import slider_crank
from runs import solved

from kaneflex import SceneError, read_scene, scene_of, with_settings
from kaneflex.study.trade.price import has_price, price, tightened

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
def priced():
    return price(with_settings(read_scene("slider-crank-clearance"), SHORT))


def test_what_is_compared_with_is_the_tight_mechanism(priced):
    """Written by hand: its statistics are those without the clearance."""
    solution = solved(scene_of(TIGHT))
    (found,) = priced.prices
    assert (found.part, set(found.gone)) == ("clearance of wrist", {"pin_force", "pin_x", "pin_y"})
    assert {change.sensor for change in found.changes} == set(solution.model.scene.sensors)
    for change in found.changes:
        values = solution.series[change.sensor].values
        mean = ((values[1:] ** 2 + values[:-1] ** 2) / 2).mean()
        assert change.peak[1] == pytest.approx(abs(values).max(), rel=1e-5), change.sensor
        assert change.rms[1] == pytest.approx(np.sqrt(mean), rel=1e-5), change.sensor


def test_what_is_compared_is_the_scene_as_it_is(priced):
    solution = solved(priced.scene)
    for change in priced.prices[0].changes:
        assert change.peak[0] == abs(solution.series[change.sensor].values).max()


def test_a_knock_matters_and_the_way_of_the_piston_does_not(priced):
    changes = {change.sensor: change for change in priced.prices[0].changes}
    assert changes["knock"].shares[0] > 1 and changes["knock"].matters(0.01)
    assert abs(changes["slide"].shares[0]) < 2e-3 and not changes["slide"].matters(0.01)
    assert changes["slide"].matters(1e-6)
    assert all(np.isfinite(change.doubt).all() for change in changes.values())


def test_a_smaller_clearance_changes_less():
    scene = with_settings(read_scene("slider-crank-clearance"), [*SHORT, "joints.wrist.clearance.radial=2 um"])
    (found,) = price(scene, sensors=["slide"]).prices
    assert abs(found.changes[0].shares[0]) < 2e-5


def test_backlash_is_compared_with_a_shaft_in_one_piece():
    """Without play both turn as one: w' = torque/(sum of inertias)."""
    scene = scene_of(COUPLED)
    settings, gone = tightened(scene, ["coupling"])
    assert gone == ("play",)
    solution = solved(scene, *settings)
    expected = 10 + 6 / 0.06 / 40 * (1 - np.cos(40 * solution.times))
    assert solution.series["speed"].values == pytest.approx(expected, rel=1e-7)
    (found,) = price(scene).prices
    assert found.changes[0].peak[1] == pytest.approx(expected.max(), rel=1e-7)
    assert found.changes[0].shares[0] != 0


def test_a_guide_made_tight_closes_as_it_stands():
    settings, gone = tightened(read_scene("engine-rig-clearance"), ["bore"])
    tight = with_settings(read_scene("engine-rig-clearance"), settings)
    assert list(tight.drives) == ["main"] and not tight.contacts and "piston_tilt" in gone


def test_the_command_writes_its_folder(tmp_path):
    folder = tmp_path / "out"
    arguments = [part for setting in SHORT for part in ("--set", setting)]
    result = cli("trade", "slider-crank-clearance", *arguments, "--sensors", "slide", "-o", folder)
    assert result.exit_code == 0, result.output
    assert {path.name for path in folder.iterdir()} == {"price.csv", "price.json", "price.png", "price.svg"}
    about = json.loads((folder / "price.json").read_text())
    (row,) = csv.DictReader((folder / "price.csv").open())
    (part,) = about["parts"]
    assert (row["part"], row["sensor"]) == ("clearance of wrist", "slide")
    assert float(row["rms_with"]) == part["sensors"][0]["rms_with"]
    assert "motions with impacts diverge" in result.stdout
    assert "drives.bore=none" in part["without"]
    (shown,) = (line.split() for line in result.stdout.splitlines() if line.split()[:2] == ["slide", "mm"])
    found, keys = part["sensors"][0], ("peak_without", "peak_with", "rms_without", "rms_with")
    assert [shown[k] for k in (2, 3, 8, 9)] == [f"{1e3 * found[key]:.4g}" for key in keys]
    shares = found["rms_change"], found["rms_doubt"] / found["rms_without"]
    assert [shown[k] for k in (10, 12)] == [f"{100 * share:.2g}" for share in shares]


def test_friction_is_compared_with_none():
    """Without friction the block on its belt hangs on its spring, at rest where it began."""
    scene = with_settings(read_scene("stick-slip"), ["solve.duration=1 s", "solve.steps=200"])
    (found,) = price(scene).prices
    assert (found.part, found.gone) == ("friction of rub", ("drag",))
    assert found.settings == ("joints.rub.friction=none", "sensors.drag=none")
    without = solved(scene, *found.settings)
    for change in found.changes:
        assert change.peak[1] == abs(without.series[change.sensor].values).max()
        assert change.peak[0] > 0 and change.matters(0.01)


def test_what_can_t_be_priced_is_refused(tmp_path):
    assert not has_price(read_scene("engine")) and has_price(read_scene("slider-crank-clearance"))
    result = cli("trade", "slider-crank-clearance", "--sensors", "slid", "-o", tmp_path / "out")
    refused(result, "no such sensor", "slide")
    scene = with_settings(read_scene("slider-crank-clearance"), [*SHORT, "solve.duration=1 ms", "solve.steps=10"])
    with pytest.raises(SceneError, match="no requested sensor exists without the "):
        price(scene, sensors=["pin_force"])
