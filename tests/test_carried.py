"""Rigid bodies that elastic links carry, against the same bodies as links a thousand times as stiff."""

import numpy as np
import pytest

from kaneflex.building import reference_modes
from kaneflex.loading import load
from kaneflex.scene import read_scene, with_settings
from kaneflex.simulation import simulate

SCENE = """
schema = 1
like = "four-bar"

[bodies]
crank = {beam = "none", mass = "31.58 g"}
follower = FOLLOWER

[damping]
rayleigh = {ratio = 0.05, at = ["46 Hz", "75 Hz"]}

[drives]
main = {speed = "200 rpm"}

[sensors]
crank_tip = "none"
follower_mid = "none"
joint_x = {joint_force = "second", component = "x"}
joint_y = {joint_force = "second", component = "y"}
pivot_x = {joint_force = "rocker", component = "x"}
pivot_y = {joint_force = "rocker", component = "y"}
end_x = {position = "follower.end", component = "x"}

[solve]
steps = 360
"""
RIGID = '{beam = "none", mass = "29.83931 g"}'
STIFF = '{beam = {E = "71e12 Pa", elements = 2}}'


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("carried")
    found = {}
    for name, follower in (("rigid", RIGID), ("stiff", STIFF)):
        (folder / f"{name}.toml").write_text(SCENE.replace("FOLLOWER", follower))
        found[name] = read_scene(folder / f"{name}.toml")
    return found


def test_a_hinged_body_has_one_coordinate(scenes):
    coordinates = load(scenes["rigid"]).coordinates
    assert [name for name in coordinates if name.startswith("follower")] == ["follower.turn"]


def test_frequencies(scenes):
    rigid, stiff = (reference_modes(load(scenes[name]), 3)[0] for name in ("rigid", "stiff"))
    assert rigid == pytest.approx(stiff, rel=1e-5)


@pytest.mark.parametrize("terms", ["{}", "{geometric = false}", "{spin = false, euler = false}"])
def test_motion(scenes, terms):
    series = {
        name: simulate(load(with_settings(scene, [f"solve.terms={terms}"]))).series for name, scene in scenes.items()
    }
    for sensor, tolerance in (("coupler_mid", 1e-5), ("crank_torque", 1e-4), ("coupler_force", 1e-4), ("end_x", 1e-6)):
        rigid, stiff = (series[name][sensor].values for name in ("rigid", "stiff"))
        assert rigid == pytest.approx(stiff, abs=tolerance * np.abs(stiff).max()), sensor


def test_joint_forces_at_rest_of_the_vibrations(scenes):
    series = {
        name: simulate(load(with_settings(scene, ["solve.preset=quasistatic"]))).series for name, scene in scenes.items()
    }
    for sensor in ("joint_x", "joint_y", "pivot_x", "pivot_y"):
        rigid, stiff = (series[name][sensor].values for name in ("rigid", "stiff"))
        assert rigid == pytest.approx(stiff, abs=1e-4 * np.abs(stiff).max()), sensor
