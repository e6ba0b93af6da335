"""What `check` and `show` say of joints and drives: freedoms left, held twice, dead centres, ranges and closures."""

import math
from functools import cache

import numpy as np
import pytest
from command_line import cli
from machines import changed, four_bar, machine
from runs import solved

from kaneflex import SceneError, load, read_scene, scene_of, with_settings
from kaneflex.fem.freedom import count_freedom, mobility_by_rank
from kaneflex.mechanism.closure import courses_of, reach_lines
from kaneflex.mechanism.closure_continuation import followed
from kaneflex.mechanism.dead_centres import closings
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.position_analysis import place, with_branches
from kaneflex.multibody.model import module_loading
from kaneflex.report.checked import description, notes

THREE_CRANKS = machine(
    ground=dict(b=["200 mm", 0], c=["400 mm", 0]),
    bodies=dict(crank='length = "50 mm", mass = "0.1 kg"', second='length = "50 mm", mass = "0.1 kg"',
                third='length = "50 mm", mass = "0.1 kg"', bar='length = "400 mm", mass = "0.3 kg"'),
    joints=dict(main="revolute ground crank.start", near_pin="revolute crank.end bar.start",
                middle_pin="revolute bar.mid second.end", middle="revolute ground.b second.start",
                far_pin="revolute bar.end third.end", far="revolute ground.c third.start"),
    drives=dict(main='speed = "60 rpm", cycle = "360 deg"'),
)
TWO_GUIDES = machine(
    bodies=dict(cart='length = "400 mm", mass = "1 kg"'),
    joints=dict(left="prismatic ground cart.start, direction = [1, 0]",
                right="prismatic ground cart.end, direction = [1, 0]"),
    drives=dict(left='speed = "1 m/s"'), solve='duration = "1 s"',
)
HANGING = machine(
    bodies=dict(crank='length = "50 mm", mass = "0.1 kg"', tail='length = "50 mm", mass = "0.1 kg"'),
    joints=dict(main="revolute ground crank.start", swing="revolute crank.end tail.start"),
    drives=dict(main='speed = "60 rpm", cycle = "360 deg"'),
)
CARRIED_RHOMBUS = machine(
    bodies=dict(arm='length = "300 mm", beam = {material = "steel", A = "100 mm^2", I = "2000 mm^4"}',
                a='length = "200 mm", mass = "1 kg"', b='length = "200 mm", mass = "1 kg"',
                c='length = "200 mm", mass = "1 kg"', d='length = "200 mm", mass = "1 kg"'),
    joints=dict(main="revolute ground arm.start", grip="weld arm.end a.start", ab="revolute a.end b.start",
                opening="revolute a.start d.start", dc="revolute d.end c.start", bc="revolute b.end c.end"),
    drives=dict(main='law = "0.6 + 0.1 * sin(2 * t)"', opening='law = "1.0 + 0.1 * sin(2 * t)"'),
    solve='duration = "1 s"',
)


@pytest.fixture
def nothing_is_derived(monkeypatch):
    def derive(*_):
        raise AssertionError("derived")

    monkeypatch.setattr(module_loading, "generate_text", derive)


def refused(text: str) -> str:
    with pytest.raises(SceneError) as error:
        load(scene_of(text))
    return str(error.value)


@pytest.mark.parametrize(("scene", "drive", "said"), [
    ("four-bar", 'rocker = {speed = "10 rpm"}', "drives.rocker: a constraint too many (redundant"),
    ("engine", 'bore = {speed = "1 m/s"}', "drives.bore: a constraint too many (redundant"),
    ("engine", 'wrist = {law = "0.1 * sin(t)"}', "(redundant with other joints and drives): wrist by its drive;"),
])  # fmt: skip
def test_two_drives_on_one_freedom(nothing_is_derived, scene, drive, said):
    start = 'solve = {start = "zero", duration = "0.1 s"}'
    assert said in refused(f'schema = 1\nlike = "{scene}"\ndrives.{drive}\n{start}\n')


def test_redundant_joints(nothing_is_derived):
    """A third crank of equal length would let the bar move, but not hold it any better: by count it locks."""
    redundant = "(redundant with other joints and drives):"
    assert f"a constraint too many {redundant} far across y;" in refused(THREE_CRANKS)
    assert f"2 constraints too many {redundant} right across its guide and in rot" in refused(TWO_GUIDES)


def test_what_nothing_drives(nothing_is_derived):
    assert "nothing determines the motion of tail;" in refused(HANGING)


def test_rigid_bodies_that_elastic_ones_can_not_carry_name_the_preset_that_can(nothing_is_derived):
    said = refused(CARRIED_RHOMBUS)
    assert "connect it to rigid bodies that move apart as links deform" in said and "Use preset coupled" in said


TWO_AT_A_POINT = machine(
    bodies=dict(arm='length = "300 mm", beam = {material = "steel", section = {circle = "10 mm"}}',
                a='length = "200 mm", mass = "1 kg"', b='length = "200 mm", mass = "1 kg"'),
    joints=dict(main="revolute ground arm.start", first="revolute arm.end a.start", second="revolute arm.end b.start"),
    drives=dict(main='law = "0.6 + 0.1 * sin(2 * t)"', first='law = "0"', second='law = "1"'),
    solve=dict(duration="1 s", steps=20),
)


def test_two_rigid_bodies_at_one_point_of_a_link():
    """Joined to the link, or the second one to the first at the same point: the motion is the same."""
    apart = scene_of(TWO_AT_A_POINT)
    joined = scene_of(TWO_AT_A_POINT.replace('["arm.end", "b.start"]', '["a.start", "b.start"]'))
    one, other = solved(apart), solved(joined)
    for at in ((0.0, 0.0), (0.2, 0.0)):
        moved = one.motion.displacement("a", at)[0]
        assert abs(moved).max() > 1e-6
        assert other.motion.displacement("a", at)[0] == pytest.approx(moved, abs=1e-9 * abs(moved).max())


HUB = machine(
    gravity=[0, -9.81],
    bodies=dict(arm='length = 1, beam = {material = "steel", A = 1e-4, I = 1e-9, elements = 2}',
                hub="mass = 1, inertia = 0.01"),
    joints=dict(pivot="revolute ground arm.start", fix="weld arm.start hub"),
    drives=dict(pivot='speed = "10 rad/s", cycle = "360 deg"'), sensors=dict(base="displacement arm.start y"),
    solve=dict(preset="linear", start="zero", duration=0.1, steps=10),
)


def test_a_rigid_body_on_a_pivoted_end_of_a_link_stays_there():
    found = solved(scene_of(HUB))
    assert not [name for name in found.model.coordinates if name.startswith("hub")]
    assert not found["base"].values.any()


TAIL = machine(
    like="six-bar", bodies=dict(tail='length = "50 mm", mass = "0.1 kg"'),
    joints=dict(hook="revolute ground tail.start"), drives=dict(hook="free = true"),
    solve=dict(start="zero", duration="0.05 s"),
)


def test_a_free_drive_beside_another_one_in_a_larger_loop(nothing_is_derived):
    said = refused(TAIL)
    assert "drives.hook" in said and "a free drive must be the only drive" in said and "of more than two bodies" in said


BOOM = machine(
    gravity=[0, "-9.81 m/s^2"], ground=dict(foot=["400 mm", 0]),
    bodies=dict(boom='length = "1 m", points = {lug = ["500 mm", 0]}', tube="", stem="",
                jib='length = "1 m", beam = {E = "2e14 Pa", rho = 7850, A = "400 mm^2", I = "13333 mm^4"}'),
    joints=dict(heel="revolute ground boom.start", eye="revolute ground.foot tube",
                stroke="prismatic tube stem, direction = [1, 0]",
                lug='revolute stem boom.lug, near = {boom = "35 deg"}', root="weld boom.end jib.start"),
    drives=dict(stroke='speed = 0, position = "300 mm"'),
    sensors=dict(push="drive_force stroke", root_moment="joint_force root angle", heel_x="joint_force heel x"),
    solve=dict(preset="quasistatic", duration="1 s", steps=2),
)


def test_a_cylinder_raises_a_boom_with_an_elastic_jib():
    """Three rigid bodies that one drive places: a triangle of 400, 500 and 300 mm, and the jib's weight on the boom.

    cos phi = 0.8 at the heel, a right angle at the eye: the cylinder stands upright below the lug, with the weight
    m g at 1.5 m along the boom and its own lever of 0.4 m.
    """
    series = solved(scene_of(BOOM)).series
    weight = 7850 * 400e-6 * 9.81
    assert series["push"].values == pytest.approx(np.full(3, weight * 1.5 * 0.8 / 0.4), rel=1e-5)
    assert abs(series["root_moment"].values) == pytest.approx(np.full(3, weight * 0.5 * 0.8), rel=1e-5)
    assert abs(series["heel_x"].values).max() < 1e-5 * weight


LOOPS = ("engine-3", "four-bar", "quick-return", "six-bar", "slider-crank-150", "v-engine")
PARALLEL = changed(
    THREE_CRANKS, ('speed = "60 rpm", cycle = "360 deg"', 'law = "1.5 + 0.1 * sin(2 * t)"'),
    ("", 'solve = {preset = "coupled", duration = "1 s"}'),
)
OFFSET_SLIDE = machine(
    ground=dict(pivot=["-100 mm", 0]),
    bodies=dict(crank='length = "40 mm", mass = "1 kg"', block='mass = "0.2 kg", inertia = "5e-5 kg m^2"',
                lever='length = "300 mm", mass = "3 kg", points = {slot = [0, "30 mm"]}'),
    joints=dict(main="revolute ground crank.start", pin="revolute crank.end block",
                foot="revolute ground.pivot lever.start",
                slot='prismatic lever.slot block, direction = [1, 0], branch = "+"'),
    drives=dict(main='speed = "120 rpm", cycle = "360 deg"'), solve='preset = "rigid"',
)


@cache
def moved(name, *settings: str):
    """A scene with its branches, and where its bodies stand over the run, by numbers alone."""
    scene = with_branches(with_settings(read_scene(name), list(settings)))
    return scene, followed(mechanism_of(scene), place(mechanism_of(scene)))


def found(name, *settings: str):
    scene, courses = moved(name, *settings)
    return closings(mechanism_of(scene), courses)


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
    swings = "drives.main={law='-1.4 + 0.15*sin(50*pi*t)', speed='none', cycle='none'}"
    (wrist,) = found("engine", "rod.length=40.3 mm", swings, "solve.start=zero", "solve.duration=40 ms")
    assert float(wrist.position.removeprefix("main = ").removesuffix(" deg")) == pytest.approx(-88.8, abs=0.1)
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
    poses = place(mechanism_of(with_branches(scene))).poses
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
    assert "lowest mode         1.547e+04 Hz, 309 times the frequency of the cycle" in checked.stdout
    assert "Note: at main = " in checked.stderr and "Warning" not in checked.stderr  # harmonics need no steps
    stepped = cli("check", "engine", *settings, "--set", "solve.integrator=radau")
    assert "4.7 steps in a period of the lowest mode" in stepped.stderr
    shown = cli("show", "engine", "-o", tmp_path / "engine.png", *settings)
    assert "  transmission angle  wrist 7 to 90 deg" in shown.stdout and "Note: at main = " in shown.stderr
    assert "Note" not in cli("check", "engine").stderr


def test_strokes_and_ranges_are_those_of_the_closed_forms():
    """A crank slider moves by 2 r about its wrist's asin(r / l); the shaper's lever by 30 degrees to both sides."""
    scene = read_scene("engine")
    lines = reach_lines(mechanism_of(scene), followed(mechanism_of(scene), place(mechanism_of(scene))))
    assert lines["bore"] == f"97 to {97 + 80} mm, a stroke of 80 mm"
    swing = math.degrees(math.asin(40 / 137))
    assert lines["wrist"] == f"{-swing:.4g} to {swing:.4g} deg" and lines["main"] == "full turns"
    scene = read_scene("quick-return")
    lines = reach_lines(mechanism_of(scene), followed(mechanism_of(scene), place(mechanism_of(scene))))
    assert lines["foot"] == "60 to 120 deg" and lines["slot"] == "100 to 300 mm, a stroke of 200 mm"


@pytest.mark.parametrize("name", ["four-bar", "six-bar", "spin-up"])
def test_numbers_alone_find_what_the_kernels_find(name):
    scene, model = read_scene(name), load(read_scene(name))
    courses = courses_of(mechanism_of(scene), model.motion.at(np.linspace(0.0, min(scene.horizon, 20.0), 721)))
    short = with_settings(scene, ["solve.duration=20 s"]) if name == "spin-up" else scene
    mechanism = mechanism_of(scene)
    assert reach_lines(mechanism, courses) == reach_lines(mechanism, followed(mechanism_of(short), place(mechanism)))


def test_the_command_line_prints_the_range(tmp_path):
    shown = cli("show", "engine", "-o", str(tmp_path / "engine.png"))
    assert "over the run" in shown.stdout and "a stroke of 80 mm" in shown.stdout
    assert "a stroke of 80 mm" in cli("check", "engine").stdout


FOLDED = four_bar(
    'length = "50 mm", mass = "1 kg"', 'length = "100 mm", mass = "1 kg"', 'length = "50 mm", mass = "1 kg"',
    'speed = "60 rpm", angle = "60 deg"', "right", more={"foot": "WAY"}, ground={"right": ["100 mm", 0]},
    solve={"preset": "rigid", "duration": "1 ms"},
)


def nearest(way: str):
    return scene_of(FOLDED.replace("WAY", way))


def test_near_beside_branch_is_refused():
    """One of them was left out without a word."""
    with pytest.raises(SceneError, match=r"joints\.foot\.near.*branch chooses the closure already"):
        nearest('near = {rocker = "70 deg"}, branch = "+"')


@pytest.mark.parametrize(("degrees", "branch"), [(50.0, "+"), (-70.0, "-")])
def test_near_chooses_between_the_two_places_of_a_dyad(degrees, branch):
    """A parallelogram's rocker is parallel to the crank, at 60 degrees; crossed it is not."""
    found = with_branches(nearest(f'near = {{rocker = "{degrees:g} deg"}}'))
    assert found.joints["foot"].branch == branch
    angle = {way: math.degrees(place(mechanism_of(nearest(f'branch = "{way}"'))).poses["rocker"][2]) for way in "+-"}
    assert math.remainder(angle["+"] - 60.0, 360.0) == pytest.approx(0.0, abs=1e-6)
    chosen = math.degrees(place(mechanism_of(found)).poses["rocker"][2])
    assert math.remainder(chosen - angle[branch], 360.0) == pytest.approx(0.0, abs=1e-6)


def test_a_place_between_both_is_refused_with_both():
    scene = nearest('near = {rocker = "60 deg"}')
    rocker = [place(mechanism_of(nearest(f'branch = "{way}"'))).poses["rocker"][2] for way in "+-"]
    between = math.degrees(sum(rocker) / 2)
    with pytest.raises(SceneError, match="the loop closes in 2 ways at the start"):
        with_branches(with_settings(scene, [f"joints.foot.near.rocker={between} deg"]))


def test_points_that_lie_on_each_other_are_named():
    """The crossed way of a rhombus lays the coupler on the crank: their far ends meet, and no joint says so."""
    text = FOLDED.replace("100 mm", "50 mm").replace("WAY", 'branch = "{way}"')
    for way, expected in (("+", None), ("-", "rocker.end")):
        scene = scene_of(text.replace("{way}", way))
        mechanism = mechanism_of(scene)
        meeting = reach_lines(mechanism, followed(mechanism, place(mechanism))).get("coincide", "")
        assert (expected or "") in meeting and bool(meeting) == (expected is not None)
