"""Bodies without mass or inertia under preset coupled: what hangs on them moves them, or the error names them."""

import numpy as np
import pytest

import kaneflex
from kaneflex.integrate.outcome import Outcome
from kaneflex.scene import read_scene
from kaneflex.support.errors import SceneError

FOUR_BAR = """
schema = 1
gravity = [0, "-9.81 m/s^2"]
ground = {P = ["0.28 m", 0]}
[bodies]
crank = {length = "0.1 m", mass = "0.2 kg"}
coupler = {length = "0.3 m", beam = {material = "steel", section = {rectangle = ["4 mm", "20 mm"]}}}
rocker = {length = "0.25 m"}
[joints]
A = {revolute = ["ground", "crank.start"]}
B = {revolute = ["crank.end", "coupler.start"]}
D = {revolute = ["ground.P", "rocker.start"]}
C = {revolute = ["coupler.end", "rocker.end"], branch = "+"}
[drives]
A = {free = true, angle = 1.0}
[sensors]
psi = {position = "D", component = "angle"}
[solve]
preset = "coupled"
duration = "0.02 s"
steps = 50
"""
PUCK = """
schema = 1
[bodies]
puck = {mass = "1 kg", free = {velocity = [1, 0]}}
[solve]
preset = "coupled"
duration = "1 s"
"""


def load(tmp_path, text):
    file = tmp_path / "scene.toml"
    file.write_text(text)
    return kaneflex.load(read_scene(file))


@pytest.mark.parametrize("drive", ["{free = true, angle = 1.0}", '{law = "1 + 0.3 * sin(20 * t)"}'])
def test_a_massless_rocker_moves_as_one_of_next_to_no_mass(tmp_path, drive):
    text, found = FOUR_BAR.replace("{free = true, angle = 1.0}", drive), []
    for rocker in ('{length = "0.25 m"}', '{length = "0.25 m", mass = "1e-7 kg"}'):
        solution = kaneflex.simulate(load(tmp_path, text.replace('{length = "0.25 m"}', rocker)))
        assert solution.outcome is Outcome.COMPLETED, solution.message
        found.append(solution.series["psi"].values)
        assert np.isfinite(solution.stresses["coupler"].mises).all()
    assert found[0] == pytest.approx(found[1], abs=1e-7)


def test_two_massless_cranks_are_named(tmp_path):
    text = FOUR_BAR.replace(', mass = "0.2 kg"', "")
    with pytest.raises(SceneError, match=r"bodies\.rocker\.mass = 0: rocker moves at D, .* Give it one"):
        load(tmp_path, text)


def test_a_free_body_without_inertia_is_named(tmp_path):
    with pytest.raises(SceneError, match=r"bodies\.puck\.inertia = 0: puck turns freely, .* Give it one"):
        load(tmp_path, PUCK)
    light = PUCK.replace('"1 kg"', '"1 kg", inertia = "1e-9 kg m^2"')
    load(tmp_path, light.replace("velocity", "at = [1000, 1000], velocity"))
