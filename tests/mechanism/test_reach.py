"""`check` and `show` print the range of each joint and points that coincide; `near` chooses between two closures."""

import math

import numpy as np
import pytest
from command_line import cli
from machines import four_bar

from kaneflex import SceneError, load, read_scene, scene_of, with_settings
from kaneflex.mechanism.closure import courses_of, followed, reach_lines
from kaneflex.mechanism.position_analysis import place, with_branches


def test_strokes_and_ranges_are_those_of_the_closed_forms():
    """A crank slider moves by 2 r about its wrist's asin(r / l); the shaper's lever by 30 degrees to both sides."""
    scene = read_scene("engine")
    lines = reach_lines(scene, followed(scene, place(scene)))
    assert lines["bore"] == f"97 to {97 + 80} mm, a stroke of 80 mm"
    swing = math.degrees(math.asin(40 / 137))
    assert lines["wrist"] == f"{-swing:.4g} to {swing:.4g} deg" and lines["main"] == "full turns"
    scene = read_scene("quick-return")
    lines = reach_lines(scene, followed(scene, place(scene)))
    assert lines["foot"] == "60 to 120 deg" and lines["slot"] == "100 to 300 mm, a stroke of 200 mm"


@pytest.mark.parametrize("name", ["four-bar", "six-bar", "spin-up"])
def test_numbers_alone_find_what_the_kernels_find(name):
    scene, model = read_scene(name), load(read_scene(name))
    courses = courses_of(scene, model.motion.at(np.linspace(0.0, min(scene.horizon, 20.0), 721)))
    short = with_settings(scene, ["solve.duration=20 s"]) if name == "spin-up" else scene
    assert reach_lines(scene, courses) == reach_lines(scene, followed(short, place(scene)))


def test_the_command_line_prints_them(tmp_path):
    shown = cli("show", "engine", "-o", str(tmp_path / "engine.png"))
    assert "over the run" in shown.stdout and "a stroke of 80 mm" in shown.stdout
    assert "a stroke of 80 mm" in cli("check", "engine").stdout


FOLDED = four_bar(
    'length = "50 mm", mass = "1 kg"', 'length = "100 mm", mass = "1 kg"', 'length = "50 mm", mass = "1 kg"',
    'speed = "60 rpm", angle = "60 deg"', "right", more={"foot": "WAY"}, ground={"right": ["100 mm", 0]},
    solve={"preset": "rigid", "duration": "1 ms"},
)


def four_bar(way: str):
    return scene_of(FOLDED.replace("WAY", way))


def test_near_beside_branch_is_refused():
    """One of them was left out without a word."""
    with pytest.raises(SceneError, match=r"joints\.foot\.near.*branch chooses the closure already"):
        four_bar('near = {rocker = "70 deg"}, branch = "+"')


@pytest.mark.parametrize(("degrees", "branch"), [(50.0, "+"), (-70.0, "-")])
def test_near_chooses_between_the_two_places_of_a_dyad(degrees, branch):
    """A parallelogram's rocker is parallel to the crank, at 60 degrees; crossed it is not."""
    found = with_branches(four_bar(f'near = {{rocker = "{degrees:g} deg"}}'))
    assert found.joints["foot"].branch == branch
    angle = {way: math.degrees(place(four_bar(f'branch = "{way}"')).poses["rocker"][2]) for way in "+-"}
    assert math.remainder(angle["+"] - 60.0, 360.0) == pytest.approx(0.0, abs=1e-6)
    chosen = math.degrees(place(found).poses["rocker"][2])
    assert math.remainder(chosen - angle[branch], 360.0) == pytest.approx(0.0, abs=1e-6)


def test_a_place_between_both_is_refused_with_both():
    scene = four_bar('near = {rocker = "60 deg"}')
    rocker = [place(four_bar(f'branch = "{way}"')).poses["rocker"][2] for way in "+-"]
    between = math.degrees(sum(rocker) / 2)
    with pytest.raises(SceneError, match="the loop closes in 2 ways at the start"):
        with_branches(with_settings(scene, [f"joints.foot.near.rocker={between} deg"]))


def test_points_that_lie_on_each_other_are_named():
    """The crossed way of a rhombus lays the coupler on the crank: their far ends meet, and no joint says so."""
    text = FOLDED.replace("100 mm", "50 mm").replace("WAY", 'branch = "{way}"')
    for way, expected in (("+", None), ("-", "rocker.end")):
        scene = scene_of(text.replace("{way}", way))
        meeting = reach_lines(scene, followed(scene, place(scene))).get("coincide", "")
        assert (expected or "") in meeting and bool(meeting) == (expected is not None)
