"""Structures in given poses under preset coupled: the same as with the angles of their welds."""

import numpy as np
import pytest
from runs import solved

from kaneflex import SceneError, load, scene_of

L_FRAME = """
schema = 1
bodies.post = {length = "1 m", %sbeam = {material = "steel", A = "400 mm^2", I = "13333 mm^4"}}
bodies.bar = {length = "0.5 m", %sbeam = {material = "steel", A = "400 mm^2", I = "13333 mm^4"}}
joints.foot = {weld = ["ground", "post.start"]%s}
joints.corner = {weld = ["post.end", "bar.start"]%s}
loads.push = {force_on = "bar.end", direction = [0.6, -0.8], value = %s}
sensors.x = {displacement = "bar.end", axes = "global", component = "x"}
sensors.y = {displacement = "bar.end", axes = "global", component = "y"}
sensors.place = {position = "bar.end", component = "y"}
solve = {preset = "coupled", start = "quasistatic", duration = "10 ms", steps = 20, errors = "none"}
"""
POSED = 'pose = {angle = "90 deg"}, ', 'pose = {at = [0, "1 m"]}, ', "", ""
TURNED = "", "", ', relative_angle = "90 deg"', ', relative_angle = "-90 deg"'


def test_poses_turn_the_welds():
    posed, turned = (solved(scene_of(L_FRAME % (*kind, 300))) for kind in (POSED, TURNED))
    for name in ("x", "y", "place"):
        assert posed.series[name].values == pytest.approx(turned.series[name].values, rel=1e-12, abs=1e-15)


def test_a_small_load_bends_them_as_the_closed_form_says():
    """A force F at the bar's end of a post and a bar of lengths h and b, by the integrals of moments (Castigliano)."""
    F, h, b, EI, EA = 0.01, 1.0, 0.5, 210e9 * 13333e-12, 210e9 * 400e-6
    X, Y = 0.6 * F, -0.8 * F
    # bending moments: Y (b - s) along the bar, Y b - X (h - z) along the post
    x = (X * h**3 / 3 - Y * b * h**2 / 2) / EI + X * b / EA
    y = (Y * (b**3 / 3 + b**2 * h) - X * b * h**2 / 2) / EI + Y * h / EA
    found = solved(scene_of(L_FRAME % (*POSED, F)), "solve.tolerance=1e-12")
    assert found.series["x"].values == pytest.approx(np.full(21, x), rel=1e-4)
    assert found.series["y"].values == pytest.approx(np.full(21, y), rel=1e-4)
    assert found.series["place"].values == pytest.approx(np.full(21, 1.0 + y), rel=1e-9)


def test_a_pose_that_no_weld_agrees_with_is_named():
    poses = POSED[0], 'pose = {at = [0, "1.1 m"]}, ', "", ""
    with pytest.raises(SceneError, match=r"bodies.bar.pose.at = \[0.0, 1.1\]: the welds put its start at \[.*, 1 m\]"):
        load(scene_of(L_FRAME % (*poses, 300)))


def test_what_no_weld_holds_is_refused():
    scene = scene_of(L_FRAME.replace("foot = {weld", "foot = {revolute") % (*POSED, 300))
    with pytest.raises(SceneError, match="supports poses only if all joints are welds"):
        load(scene)


@pytest.mark.parametrize("angle", [-90, 40, 90])
def test_weight_is_not_half_of_the_geometric_stiffness(angle):
    """Tip deflections F L^3 / (3 E I) and M L^2 / (2 E I) of a slender cantilever under its weight and a payload's.

    The axial force at its start is not known beforehand; of its growth along the beam alone a hanging one got softer.
    """
    length, EI = 2.0, 420.0
    scene = scene_of(f"""
schema = 1
gravity = [0, -9.81]
bodies.bar = {{length = 2, pose = {{angle = "{angle} deg"}}, beam = {{E = 2.1e11, rho = 7850, A = 1e-4, I = 2e-9}}}}
bodies.payload = {{length = 0.3, mass = 0.1, pose = {{at = AT, angle = "{angle} deg"}}}}
joints.clamp = {{weld = ["ground", "bar.start"]}}
joints.flange = {{weld = ["bar.end", "payload.start"]}}
loads.push = {{force_on = "bar.end", axes = "body", direction = [0, 1], value = 0.001}}
sensors.tip = {{displacement = "bar.end", component = "y"}}
solve = {{preset = "quasistatic", duration = 1, steps = 2, errors = "none"}}
""".replace("AT", str((length * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])).tolist())))
    across = -9.81 * np.cos(np.radians(angle))
    weight = across * (7850 * 1e-4 * length**4 / 8 + 0.1 * (length**3 / 3 + 0.15 * length**2 / 2)) / EI
    assert solved(scene).series["tip"].values == pytest.approx(weight + 0.001 * length**3 / 3 / EI, rel=1e-8)
