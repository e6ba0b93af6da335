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
