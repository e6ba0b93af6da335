"""Loops that no dyad closes: Newton's method from seeds, the assembly that a scene names, and where it locks."""

import sys
from functools import cache

import numpy as np
import pytest
from machines import machine
from newton_euler import imbalance, motion_of, widest_gap
from runs import solved

import kaneflex
from kaneflex import SceneError, read_scene, scene_of, with_settings
from kaneflex.derive.equations import closure
from kaneflex.mechanism import closure_continuation, position_analysis
from kaneflex.mechanism.closure_continuation import follow, seed_loops
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.planar import GROUND
from kaneflex.mechanism.position_analysis import place as place_bodies
from kaneflex.mechanism.rigid_motion import RigidKinematics
from kaneflex.multibody.model.module_loading import bind_parameters, generate_text, import_file
from kaneflex.scene.structure import structure_hash

HEAD = machine(
    gravity=[1.0, -9.81], ground=dict(left=["150 mm", "-40 mm"], right=["350 mm", 0]),
    bodies=dict(crank='length = "30 mm", mass = "0.1 kg"',
                rod='length = "200 mm", mass = "0.2 kg", centre = ["80 mm", "5 mm"], inertia = "1e-3 kg m^2"',
                left_rocker='length = "140 mm", mass = "0.05 kg"'),
)
PLATE = """
[bodies.platform]
length = "120 mm"
mass = "0.3 kg"
centre = ["60 mm", "20 mm"]
points = {knee = ["60 mm", "70 mm"]}
"""
JOINTS = """
[joints]
main = {revolute = ["ground", "crank.start"]}
pin = {revolute = ["crank.end", "rod.start"]}
head = {revolute = ["rod.end", "platform.knee"]}
left = {revolute = ["ground.left", "left_rocker.start"]}
left_knee = {revolute = ["left_rocker.end", "platform.start"]}
"""
DRIVE = """
[drives]
main = {speed = "120 rpm", cycle = "360 deg"}
[loads]
push = {force_on = "platform.end", direction = [0.6, 0.8], law = "30 * sin(main) + main_speed"}
[solve]
preset = "rigid"
"""
ROCKER = "[bodies.right_rocker]\nlength = '160 mm'\nmass = '0.1 kg'\n"
RIGHT = """
right = {revolute = ["ground.right", "right_rocker.start"]}
right_knee = {revolute = ["right_rocker.end", "platform.end"], near = {platform = "16 deg"}}
"""
# On a line that the right rocker's end nearly follows.
MOVED = HEAD.replace('right = ["350 mm", 0]', 'right = ["258 mm", "-131 mm"]')
SLIDER = "[bodies.slider]\nmass = '0.2 kg'\ninertia = '1e-4 kg m^2'\n"
SLIDE = """
shoe = {revolute = ["slider", "platform.end"]}
slot = {prismatic = ["ground.right", "slider"], direction = [0.8, -0.6], near = {platform = "16 deg"}}
"""
# The shoe is reached through the platform; written the other way round, the slide is an unknown of its own.
FROM_SLIDER = """
[joints]
main = {revolute = ["ground", "crank.start"]}
slot = {prismatic = ["ground.right", "slider"], direction = [0.8, -0.6]}
shoe = {revolute = ["slider", "platform.end"]}
pin = {revolute = ["crank.end", "rod.start"]}
head = {revolute = ["rod.end", "platform.knee"]}
left = {revolute = ["ground.left", "left_rocker.start"]}
left_knee = {revolute = ["left_rocker.end", "platform.start"], near = {platform = "16 deg"}}
"""
MECHANISMS = {
    "from the slider": MOVED + PLATE + SLIDER + FROM_SLIDER + DRIVE,
    "a slider": MOVED + PLATE + SLIDER + JOINTS + SLIDE + DRIVE,
    "three rockers": HEAD + PLATE + ROCKER + JOINTS + RIGHT + DRIVE,
}


@cache
def motion(name) -> RigidKinematics:
    return kaneflex.load(scene_of(MECHANISMS[name])).motion


@pytest.mark.exhaustive(share=4)
@pytest.mark.parametrize("name", MECHANISMS)
def test_it_closes_and_balances(name):
    scene = scene_of(MECHANISMS[name])
    rigid = motion_of(scene)
    assert widest_gap(scene, rigid) < 1e-12 * 0.35
    assert imbalance(scene, rigid) < 1e-10


@pytest.mark.exhaustive(share=4)
@pytest.mark.parametrize("name", MECHANISMS)
def test_rates_are_those_of_the_positions(name):
    """Against central differences of fourth order in time."""
    t, h = np.linspace(0.0, 0.5, 50), 1e-4
    middle = motion(name).at(t)
    for body in ("rod", "platform", "left_rocker"):
        for value, rate in (("x", "v_x"), ("y", "v_y"), ("v_x", "a_x"), ("v_y", "a_y"), ("omega", "epsilon")):
            names = f"{body}.{value}"
            one, two = (motion(name).at(t + k * h)[names] - motion(name).at(t - k * h)[names] for k in (1, 2))
            found = (8 * one - two) / (12 * h)
            exact = middle[f"{body}.{rate}"]
            assert abs(found - exact).max() < 1e-7 * max(1.0, abs(exact).max()), (body, rate)


def test_a_four_bar_by_newton_is_the_one_in_closed_form(tmp_path, monkeypatch):
    scene = with_settings(read_scene("four-bar"), ["solve.preset=rigid"])
    exact = kaneflex.load(scene).motion
    monkeypatch.setattr(closure, "_place_dyad", lambda *_: False)
    structure = structure_hash(scene)
    (tmp_path / "newton.py").write_text(generate_text(scene))
    module = import_file(tmp_path / "newton.py", structure)
    monkeypatch.delitem(sys.modules, module.__name__)
    assert [closing for closing, *_ in module.LOOPS] == ["rocker"]
    p = bind_parameters(scene, module)
    newton = RigidKinematics(module, seed_loops(mechanism_of(scene), module, p, scene.period))
    times = np.random.default_rng(1).uniform(0.0, 3 * scene.period, 200)
    here, there = newton.at(times), exact.at(times)
    for name in exact.column:
        if not name.endswith(".closure"):
            assert abs(here[name] - there[name]).max() <= 1e-11 * max(1e-3, abs(there[name]).max()), name


def test_two_drives():
    """A second crank moves the left rocker's foot: the seeds are then tabulated against time."""
    text = MECHANISMS["three rockers"].replace('"ground.left", "left', '"shaker.end", "left')
    shake = "[bodies.shaker]\nlength = '10 mm'\n[joints]\nshake = {revolute = ['ground.left', 'shaker.start']}"
    text = text.replace("[joints]", shake)
    text = text.replace("[drives]", "[drives]\nshake = {speed = '240 rpm', cycle = '720 deg'}")
    scene = scene_of(text)
    rigid = kaneflex.load(scene).motion.at(np.linspace(0.0, scene.period, 300))
    assert widest_gap(scene, rigid) < 1e-12 * 0.35
    assert imbalance(scene, rigid) < 1e-10


def test_it_turns_by_itself_and_keeps_its_energy():
    text = MECHANISMS["three rockers"].split("[drives]")[0].replace("[1.0, -9.81]", "[0, 0]")
    text += "[drives]\nmain = {free = true, initial_speed = '60 rpm'}\n[solve]\npreset = 'rigid'\nduration = '1 s'\n"
    scene = scene_of(text)
    rigid = solved(scene).model.motion.at(np.linspace(0.0, 1.0, 150))
    energy = 0.0
    for name, body in scene.bodies.items():
        c, s, w = (rigid[f"{name}.{key}"] for key in ("c", "s", "omega"))
        x, y = c * body.centre[0] - s * body.centre[1], s * body.centre[0] + c * body.centre[1]
        v_x, v_y = rigid[f"{name}.v_x"] - w * y, rigid[f"{name}.v_y"] + w * x
        energy = energy + 0.5 * body.mass * (v_x**2 + v_y**2) + 0.5 * body.inertia * w**2
    assert np.ptp(rigid["crank.omega"]) > 0.05
    assert np.ptp(energy) < 1e-7 * energy[0]
    assert widest_gap(scene, rigid) < 1e-12 * 0.35


def test_the_shipped_one_under_every_preset_agrees():
    """Its links are stiff: the coupled equations, which close the loops by multipliers, give the same motion."""
    found = {}
    for preset in ("rigid", "quasistatic", "stiffened", "coupled"):
        scene = with_settings(read_scene("six-bar"), [f"solve.preset={preset}"])
        found[preset] = solved(scene).series
    sensors = {"platform_angle": 1e-4, "rocker_angle": 1e-4, "crank_torque": 2e-3, "rod_force": 2e-3}
    for name, tolerance in sensors.items():
        there = found["rigid"][name].values
        for preset, series in found.items():
            assert abs(series[name].values - there).max() < tolerance * abs(there).max(), (preset, name)
    for preset in ("quasistatic", "coupled"):
        gap = found[preset]["rod_bow"].values - found["stiffened"]["rod_bow"].values
        assert abs(gap).max() < 5e-3 * abs(found["stiffened"]["rod_bow"].values).max()


def test_show_places_the_same_assembly():
    scene = scene_of(MECHANISMS["three rockers"])
    rigid = motion("three rockers").at(0.0)
    at = place_bodies(mechanism_of(scene))
    for name in scene.bodies:
        for key in ("x", "y", "c", "s"):
            assert at[f"{name}.{key}"] == pytest.approx(rigid[f"{name}.{key}"], abs=1e-9)


@pytest.mark.parametrize(("change", "message"), [
    ((', near = {platform = "16 deg"}', ""),
     "joints.right_knee.near: the loop closes in 4 ways at the start, and branch applies to loops of two bodies "
     "only. Choose one, like near = {rod = '"),
    (('near = {platform = "16 deg"}', 'near = {crank = "16 deg"}'),
     "joints.right_knee.near.crank: it is not in the loop of right_knee, which moves rod, left_rocker, "
     "platform, right_rocker. Name one of these."),
    (('length = "30 mm"', 'length = "60 mm"'),
     "joints.left_knee: the loop cannot close beyond main = 102.111 deg: the linkage locks "
     "there, or would change its branch. Change the lengths, or limit the drive's range."),
    (('length = "200 mm", mass', 'length = "600 mm", mass'),
     "joints.right_knee.branch = '+': the loop cannot close at main = 0 deg: rod, left_rocker, platform, "
     "right_rocker. Change the lengths, or the positions of its drives."),
])  # fmt: skip
def test_what_it_refuses(change, message):
    with pytest.raises(SceneError) as error:
        kaneflex.load(scene_of(MECHANISMS["three rockers"].replace(*change)))
    assert message in str(error.value)


def test_damping_leads_most_starts_to_an_assembly():
    """Levenberg's term: without it, or with the other sign, fewer than 90 of 400 random starts close the loops."""
    scene = scene_of(MECHANISMS["three rockers"])
    group, joints = ("rod", "left_rocker", "platform", "right_rocker"), [*scene.joints][1:]
    constraints = position_analysis.Constraints(mechanism_of(scene), {"main": 0.0}, group, joints)
    known = {GROUND: np.zeros(3), "crank": place_bodies(mechanism_of(scene)).poses["crank"]}
    assert sum(1 for _ in position_analysis._assembled(constraints, known, 400)) > 250


def test_near_of_a_dyad_names_a_body_of_its_loop():
    text = 'schema = 1\nlike = "four-bar"\njoints.rocker = {branch = "none", near = {crank = "10 deg"}}'
    with pytest.raises(SceneError, match="it is not in the loop of rocker, which moves coupler, follower"):
        place_bodies(mechanism_of(scene_of(text)))


@pytest.mark.parametrize("turn", [2 * np.pi, -1.0])
@pytest.mark.parametrize("count", [3, 203])
def test_far_knots_are_those_that_small_steps_lead_to(turn, count):
    scene = scene_of(MECHANISMS["three rockers"])
    start, ends = place_bodies(mechanism_of(scene)), np.array([0.0, turn])

    def poses(n: int) -> np.ndarray:
        xs = start.drives["main"] + np.linspace(*ends, n)
        return np.array([*follow(mechanism_of(scene), start, xs[:, None]).values()])

    assert poses(count)[..., -1] == pytest.approx(poses(2001)[..., -1], abs=1e-12)


def test_poses_off_the_tangent_or_on_another_branch_are_not_taken(monkeypatch):
    """Newton's method from a far tangent may close the loop, but elsewhere."""
    scene = scene_of(MECHANISMS["three rockers"])
    start, xs = place_bodies(mechanism_of(scene)), np.linspace(0.0, 2 * np.pi, 181)[:, None]
    constraints = closure_continuation.Constraints(mechanism_of(scene), start.drives)
    here, at = np.concatenate([start.poses[name] for name in constraints.bodies]), np.array([*start.drives.values()])
    poses, good = closure_continuation._from_tangent(constraints, here, at, at + xs)
    right = np.concatenate([*follow(mechanism_of(scene), start, at + xs).values()]).T
    apart = abs(poses - right).max(axis=1)
    assert 5 < good.sum() < 20 and apart[good].max() < 1e-10
    assert (apart > 0.1).any()
    for limits in ("_BENT", "_FAR"):
        monkeypatch.setattr(closure_continuation, limits, 1e9)
    wrong = closure_continuation._from_tangent(constraints, here, at, at + xs)[1] & (apart > 0.1)
    assert wrong.any()
