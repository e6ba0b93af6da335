"""Joints stay closed when bent links are shorter than straight ones: places, speeds and accelerations of both sides."""

from dataclasses import replace

import numpy as np
import pytest
from runs import model, run, solved, waving

from kaneflex import read_scene, scene_of
from kaneflex.response import foreshortening
from kaneflex.response.deformation import deform
from kaneflex.response.sensors import sensor_values
from kaneflex.scene.sensors import Sensor

ONE_WAY = ("engine-elastic-crank", "four-bar", "pin-ended-cross", "quick-return", "six-bar", "two-link-arm", "v-engine")
"""Chains, loops of pins and of guides, guides on bodies that move, frames; in space see ``test_spatial_elastic``."""
COUPLED = ("elastic-double-pendulum", "four-bar-motor", "slider-crank-150")
CASES = [
    *((name, preset) for name in ONE_WAY for preset in ("quasistatic", "stiffened")),
    ("engine-elastic-crank", "linear"), *((name, "coupled") for name in COUPLED),
]


def motion_of(solution, address, kind):
    """x and y of a point's position, velocity or acceleration, global, (2, n_times)."""
    if address.body == "ground":
        at = solution.model.scene.point(address) if kind == "position" else (0.0, 0.0)
        return np.outer(at, np.ones(len(solution.times)))
    sensors = (Sensor.model_validate({kind: address, "axes": "global", "component": k}) for k in "xy")
    return np.array([sensor_values(solution.motion, sensor) for sensor in sensors])


@pytest.mark.exhaustive
@pytest.mark.parametrize(("name", "preset"), CASES)
def test_no_joint_opens(name, preset):
    """To rounding, though the deformation is of any size."""
    scene = read_scene(name)
    solution = run(name, f"solve.preset={preset}", "solve.start=zero", "solve.steps=12")
    for joint_name, joint in scene.joints.items():
        if joint.kind == "prismatic" and joint.addresses[0].body != "ground":
            continue
        for kind in ("position", "velocity", "acceleration"):
            first, second = (motion_of(solution, address, kind) for address in joint.addresses)
            size = max(abs(second).max(), 1e-3 * abs(first).max(), 1e-9)  # a pivot stands at 0 but for rounding
            gap = second - first
            if joint.kind == "prismatic":
                t = joint.direction
                gap = t[0] * gap[1] - t[1] * gap[0]
            assert abs(gap).max() <= 1e-7 * size, (joint_name, kind)


def test_the_slider_comes_nearer_by_the_shortening_of_its_rod(monkeypatch):
    """By s / cos phi, as the crank stands where its drive holds it: s^2 / (l cos phi) and less are left out."""
    given = model("engine", "solve.preset=stiffened")
    solution = waving(given, np.linspace(1e-3, 19e-3, 37), 1.6e-3)
    rod = deform(given, solution.rigid, solution.coordinates, "rod")
    slide = solution.coordinates[0][given.coordinates.index("piston.slide")]
    place = sensor_values(solution.motion, Sensor.model_validate({"displacement": "rod.end", "axes": "global"}))
    nearer = rod.foreshortening(rod.link.length)[0] / solution.rigid["rod.c"]
    assert abs(nearer).min() > 1e-4
    assert slide - place == pytest.approx(nearer, rel=1e-9)
    # The same where many instants are solved for a few at a time.
    monkeypatch.setattr(foreshortening, "_CHUNK", 5)
    few = sensor_values(replace(solution).motion, Sensor.model_validate({"displacement": "rod.end", "axes": "global"}))
    assert few == pytest.approx(place, rel=1e-12)


HELD_AT_ITS_END = """
schema = 1
bodies.bar = {pose = {at = [-1, 0]}, length = 1, beam = {E = 2e11, rho = 7800, A = 1e-4, I = 1e-10, elements = 8}}
joints.wall = {JOINT = ["ground", "bar.end"]}
loads.push = {force_on = "bar.start", direction = [0, 1], law = "2"}
solve = {preset = "quasistatic", duration = 1, steps = 4}
SPRING
"""


@pytest.mark.parametrize(
    ("joint", "spring", "give"),
    [("weld", "", 0.0), ("revolute", "springs.coil = {torsional_at = 'wall', stiffness = 50}", 1 / 50)],
)
def test_a_beam_held_at_its_end_stays_there(joint, spring, give):
    """It is the start that comes nearer: by 1/2 int v'^2 of v' = F (l^2 - x^2) / (2 E I) + F l / k, with l = 1 m."""
    solution = solved(scene_of(HELD_AT_ITS_END.replace("JOINT", joint).replace("SPRING", spring)))
    nearer = 2.0**2 / 2 * (2 / (15 * 20.0**2) + 2 * give / (3 * 20.0) + give**2)
    for point, expected in (("start", nearer), ("end", 0.0)):
        place = sensor_values(solution.motion, Sensor.model_validate({"displacement": f"bar.{point}"}))
        assert place == pytest.approx(expected, rel=1e-9, abs=1e-15)
