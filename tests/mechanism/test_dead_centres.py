"""`check` and `show` say how near loops come to dead centres, and how many freedoms the joints leave by rank."""

import math
from functools import cache

import pytest
from command_line import cli
from machines import changed
from test_mobility import THREE_CRANKS

from kaneflex import load, read_scene, with_settings
from kaneflex.fem.mobility import count_freedom, mobility_by_rank
from kaneflex.mechanism.closure import followed
from kaneflex.mechanism.dead_centres import closings
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.position_analysis import place, with_branches
from kaneflex.report.checked import description, notes

LOOPS = ("engine-3", "four-bar", "quick-return", "six-bar", "slider-crank-150", "v-engine")
PARALLEL = changed(
    THREE_CRANKS, ('speed = "60 rpm", cycle = "360 deg"', 'law = "1.5 + 0.1 * sin(2 * t)"'),
    ("", 'solve = {preset = "coupled", duration = "1 s"}'),
)
OFFSET_SLIDE = """
schema = 1
ground = {pivot = ["-100 mm", 0]}
bodies.crank = {length = "40 mm", mass = "1 kg"}
bodies.block = {mass = "0.2 kg", inertia = "5e-5 kg m^2"}
bodies.lever = {length = "300 mm", mass = "3 kg", points = {slot = [0, "30 mm"]}}
joints.main = {revolute = ["ground", "crank.start"]}
joints.pin = {revolute = ["crank.end", "block"]}
joints.foot = {revolute = ["ground.pivot", "lever.start"]}
joints.slot = {prismatic = ["lever.slot", "block"], direction = [1, 0], branch = "+"}
drives.main = {speed = "120 rpm", cycle = "360 deg"}
solve.preset = "rigid"
"""


@cache
def moved(name, *settings: str):
    """A scene with its branches, and where its bodies stand over the run, by numbers alone."""
    scene = with_branches(with_settings(read_scene(name), list(settings)))
    return scene, followed(scene, place(scene))


def found(name, *settings: str):
    return closings(*moved(name, *settings))


def test_transmission_angles_are_those_of_the_closed_forms(tmp_path):
    """Four-bar: cos mu = (b^2 + c^2 - d^2) / (2 b c) with d = ground -+ crank (Norton, Design of Machinery);
    slider-crank: cos mu = r / l at most; lever whose slide passes its pivot at a distance e: cos mu = e / d."""
    a, b, c, g = 108.0, 279.4, 270.5, 254.0
    (second,) = found("four-bar")
    angles = [math.acos((b * b + c * c - d * d) / (2 * b * c)) for d in (g - a, g + a)]
    assert [second.values.min(), second.values.max()] == pytest.approx(angles, abs=1e-9)
    assert second.position == "main = 0 deg" and not second.note

    (wrist,) = found("engine")
    assert wrist.values.min() == pytest.approx(math.acos(40 / 137), abs=1e-9)
    assert wrist.values.max() == pytest.approx(math.pi / 2, abs=1e-9)

    (tmp_path / "lever.toml").write_text(OFFSET_SLIDE)
    (slot,) = found(tmp_path / "lever.toml")
    assert slot.name == "slot" and slot.values.min() == pytest.approx(math.acos(30 / (100 - 40)), abs=1e-9)
    assert slot.position == "main = 180 deg"


def test_runs_of_many_turns_are_looked_at_over_one():
    """Samples over 1440 turns in equal steps would all find the crank where it starts."""
    (wrist,) = found("engine-rig", f"solve.duration={1440 * 60 / 42.36!r}")
    assert wrist.values.min() == pytest.approx(math.acos(40 / 137), abs=1e-9) and len(wrist.values) == 361


def test_angles_near_a_dead_centre_are_noted():
    (wrist,) = found("engine", "rod.length=40.3 mm")
    mu = math.acos(40 / 40.3)
    assert wrist.note.startswith(f"at {wrist.position} the transmission angle at wrist is {math.degrees(mu):.2g} deg")
    assert wrist.position in ("main = 90 deg", "main = 270 deg")
    assert f"reach {1 / math.sin(mu):.3g} times the transmitted force" in wrist.note
    (second,) = found("four-bar", "crank.length=30 mm", "ground.right=['100 mm', 0]",
                      "coupler.length=80 mm", "follower.length=50.3 mm")  # fmt: skip
    assert second.position == "main = 180 deg" and "at a dead centre" in second.note
    (second,) = found("four-bar", "crank.length=30 mm", "ground.right=['100 mm', 0]",
                      "coupler.length=80 mm", "follower.length=51 mm")  # fmt: skip
    assert not second.note  # 14.5 degrees


def test_larger_groups_are_noted_near_a_fold():
    """The six-bar can't turn around where its crank is some 49.3 mm long."""
    (group,) = found("six-bar", "crank.length=49 mm")
    assert not group.is_angle and "rod, platform, left_rocker, right_rocker is 0.06" in group.note


def test_loops_in_space_are_noted_near_a_dead_centre():
    """The rod meets the guide's normal where the pin is furthest from the guide, at sqrt(100^2 + 120^2) + 80 mm."""
    assert not [*notes(load(read_scene("spatial-slider-crank-elastic")))]
    model = load(with_settings(read_scene("spatial-slider-crank-elastic"), ["rod.length=237 mm"]))
    (note,) = notes(model)
    assert "the smallest singular value of ball is 0.07 of its largest value" in note and "near a dead centre" in note
    told = float(note.split("shaft = ")[1].split(" deg")[0])
    assert told == pytest.approx(math.degrees(math.atan2(-100, 120)) % 360, abs=1.0)
    assert description(model)["loops over the run"]["smallest singular value"].startswith("ball")


@pytest.mark.parametrize("name", LOOPS)
def test_shipped_loops_keep_clear(name):
    assert not [each.note for each in found(name) if each.note]


def test_rank_counts_what_gruebler_does_not(tmp_path):
    """Three parallel cranks of one length move, though the formula counts none."""
    (tmp_path / "parallel.toml").write_text(PARALLEL)
    scene = read_scene(tmp_path / "parallel.toml")
    mechanism = mechanism_of(scene)
    assert count_freedom(mechanism).mobility == 0
    poses = place(with_branches(scene)).poses
    assert mobility_by_rank(mechanism, {name: pose[:, None] for name, pose in poses.items()}) == 1
    for name in LOOPS:
        scene, courses = moved(name)
        mechanism = mechanism_of(scene)
        assert mobility_by_rank(mechanism, courses) == count_freedom(mechanism).mobility == 1
    shown = cli("show", tmp_path / "parallel.toml", "-o", tmp_path / "parallel.png").stdout
    assert "by rank" in shown and "1 redundant for these lengths" in shown


def test_the_command_line_prints_them(tmp_path):
    settings = ("--set", "rod.length=40.3 mm")
    checked = cli("check", "engine", *settings)
    assert "  transmission angle  wrist 7 to 90 deg, minimum at main = " in checked.stdout
    assert "lowest mode         1.547e+04 Hz, 4.66 steps in a period" in checked.stdout
    assert "Note: at main = " in checked.stderr and "Warning" not in checked.stderr  # harmonics need no steps
    stepped = cli("check", "engine", *settings, "--set", "solve.integrator=radau")
    assert "4.7 steps in a period of the lowest mode" in stepped.stderr
    shown = cli("show", "engine", "-o", tmp_path / "engine.png", *settings)
    assert "  transmission angle  wrist 7 to 90 deg" in shown.stdout and "Note: at main = " in shown.stderr
    assert "Note" not in cli("check", "engine").stderr
