"""Scenes in space: what is said of broken ones, loads and springs, starts and dead centres."""

import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from kaneflex import SceneError, load, read_scene, simulate
from kaneflex.cli import main
from kaneflex.generated import spinning_top

PENDULUM = """
schema = 1
gravity = [0, 0, "-9.81 m/s^2"]
[bodies.bar]
length = "1 m"
mass = "1 kg"
inertia = [0.001, 0.08, 0.08]
[joints]
hinge = {revolute = ["ground", "bar.start"], axis = [0, 1, 0]}
[drives]
hinge = {free = true}
[sensors]
angle = {position = "hinge", component = "angle"}
[solve]
preset = "rigid"
duration = "1 s"
"""


def scene_of(tmp_path, *changes):
    text = PENDULUM
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / "scene.toml"
    path.write_text(text)
    return read_scene(path)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('[0, 0, "-9.81 m/s^2"]', "[0, -9.81]", r"gravity.*two components, where joints.hinge.axis has three"),
        (", axis = [0, 1, 0]", "", r"joints.hinge: in space a revolute joint turns about an axis"),
        ("inertia = [0.001, 0.08, 0.08]", "inertia = 0.08", r"bodies.bar.inertia = 0.08.*three principal moments"),
        ("[0.001, 0.08, 0.08]", "[0.5, 0.08, 0.08]", r"bodies.bar.inertia.*no body has the principal moments"),
        ("[0.001, 0.08, 0.08]", "[1, 2]", r"bodies.bar.inertia.*not the inertia of a body in space"),
        ("[drives]\nhinge = {free = true}\n", "", r"drives: 1 freedom of the mechanism that nothing drives: of hinge"),
        ('"rigid"', '"coupled"', r"solve.preset = 'coupled': only planar scenes have this preset so far"),
        ('component = "angle"', 'component = "z"', r"sensors.angle.component = 'z'.*not that joint's coordinate"),
        ("{revolute", "{universal", r"joints.hinge.*has none"),
        ('revolute = ["ground", "bar.start"], axis = [0, 1, 0]',
         'universal = ["ground", "bar.start"], axes = [[0, 1, 0], [0, 1, 1]]',
         r"joints.hinge.axes.*not at right angles"),
        ("[sensors]", '[loads]\npush = {force_on = "bar.end", direction = [1, 0, 0], law = "abs(hinge)"}\n[sensors]',
         r"loads.push.law.*the slope of abs\(hinge\) jumps"),
        ("[solve]", '[contacts]\nstop = {between = ["ground", "bar.end"], kind = "point-line"}\n[solve]', r"contacts"),
        ("[joints]", '[bodies.loose]\nmass = 1\n[joints]', r"bodies.loose: nothing holds it, nor says where it is"),
        ("[joints]", "[joints]\nother = {revolute = ['ground', 'bar.start'], axis = [1, 0, 0]}",
         r"drives.hinge = 'free': joints and drives leave the mechanism no freedom"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(tmp_path, old, new, said):
    with pytest.raises(SceneError, match=said):
        load(scene_of(tmp_path, (old, new)))


def test_the_spin_of_a_rod_between_balls_is_named(tmp_path):
    """Neither ball holds it; with a universal joint for one of them nothing is open."""
    balls = read_scene("spatial-slider-crank").raw["joints"]["cross"]
    text = 'schema = 1\nlike = "spatial-slider-crank"\n[joints]\ncross = {universal = "none", axes = "none", '
    path = tmp_path / "balls.toml"
    path.write_text(text + f"spherical = {balls['universal']}}}\n")
    with pytest.raises(SceneError, match=r"1 freedom of the mechanism that nothing drives: of (ball|cross)"):
        load(read_scene(path))


def test_drives_that_a_loop_holds_are_named(tmp_path):
    path = tmp_path / "held.toml"
    path.write_text(
        'schema = 1\nlike = "spatial-slider-crank"\n[drives]\n'
        'shaft = {speed = 1, free = "none", initial_speed = "none"}\nguide = {speed = 1}\n'
    )
    with pytest.raises(SceneError, match=r"drives\.(shaft|guide).*the loops and the other drives say already"):
        load(read_scene(path))


def test_a_torsional_spring_swings_as_it_must(tmp_path):
    """J phi'' + c phi' + k phi = 0 about the axis: (k/J - (c/2J)^2)^(1/2), decay c/2J."""
    J, k, c = 0.08 + 0.25, 40.0, 0.6
    scene = scene_of(
        tmp_path, ('[0, 0, "-9.81 m/s^2"]', "[0, 0, 0]"), ("{free = true}", '{free = true, angle = "20 deg"}'),
        ("[sensors]", f'[springs]\ncoil = {{torsional_at = "hinge", stiffness = {k}, damping = {c}}}\n[sensors]\n'
         'torque = {spring_torque = "coil"}'),
    )  # fmt: skip
    solution = simulate(load(scene))
    t, decay = solution.times, c / (2 * J)
    omega = math.sqrt(k / J - decay**2)
    exact = math.radians(20) * np.exp(-decay * t) * (np.cos(omega * t) + decay / omega * np.sin(omega * t))
    assert solution["angle"].values == pytest.approx(exact, abs=1e-8)
    rate = np.gradient(exact, t, edge_order=2)
    assert solution["torque"].values == pytest.approx(k * exact + c * rate, abs=2e-4)
    assert solution.model.energy.drift < 1e-7


def test_a_force_and_a_spring_between_points_do_their_work(tmp_path):
    scene = scene_of(
        tmp_path,
        ("[sensors]", '[ground]\nhook = [1, 0.5, 0]\n[loads]\npush = {force_on = "bar.end", direction = [0, 0, 1], '
         'axes = "body", law = "3 + 2 * sin(5 * t) * hinge"}\n[springs]\npull = {between = ["ground.hook", "bar.end"], '
         'stiffness = 30, damping = 0.4, length = 0.3}\n[sensors]\ntension = {spring_force = "pull"}'),
    )  # fmt: skip
    solution = simulate(load(scene))
    gap = solution.motion.place("bar", (1.0, 0.0, 0.0)) - np.array([[1.0], [0.5], [0.0]])
    length = np.linalg.norm(gap, axis=0)
    rate = np.gradient(length, solution.times, edge_order=2)
    assert solution["tension"].values == pytest.approx(30 * (length - 0.3) + 0.4 * rate, abs=1e-3)
    energy = solution.model.energy
    assert energy.drift < 1e-8 and np.ptp(energy.supplied) > 0.1 and np.ptp(energy.dissipated) > 0.005


def test_a_drive_asks_for_the_moment_that_the_weight_takes(tmp_path):
    """A bar that turns steadily about a level axis: m g l/2 cos(phi); the force at its pivot m (g + a)."""
    scene = scene_of(
        tmp_path, ("{free = true}", '{speed = "60 rpm"}'),
        ("[sensors]", '[sensors]\nmotor = {drive_torque = "hinge"}\npivot = {joint_force = "hinge", component = "z"}'),
    )  # fmt: skip
    solution = simulate(load(scene))
    phi = 2 * math.pi * solution.times
    # about +y the bar's end goes down: z = -sin(phi)
    assert solution["motor"].values == pytest.approx(-9.81 * 0.5 * np.cos(phi), abs=1e-9)
    lift = 0.5 * (2 * math.pi) ** 2 * np.sin(phi)
    assert solution["pivot"].values == pytest.approx(9.81 + lift, abs=1e-9)


def test_a_slider_passes_its_dead_centres_in_free_motion(tmp_path):
    """Where crank and rod are in line the slider's speed says nothing of the crank's: other speeds are chosen there."""
    path = tmp_path / "crank.toml"
    path.write_text("""
schema = 1
gravity = [0, 0, 0]
[bodies]
crank = {length = "100 mm", mass = "0.2 kg", inertia = [1e-5, 2e-4, 2e-4], rotation = {axis = [0, 0, 1], angle = 0.9}}
rod = {length = "250 mm", mass = "0.3 kg", inertia = [1e-5, 2e-3, 2e-3], rotation = {axis = [0, 0, 1], angle = -0.3}}
slider = {mass = "1 kg"}
[joints]
shaft = {revolute = ["ground", "crank.start"], axis = [0, 0, 1]}
pin = {revolute = ["crank.end", "rod.start"], axis = [0, 0, 1]}
wrist = {revolute = ["rod.end", "slider.start"], axis = [0, 0, 1]}
guide = {prismatic = ["ground", "slider.start"], direction = [1, 0, 0]}
[drives]
guide = {free = true, position = "300 mm", initial_speed = "3 m/s"}
[sensors]
turn = {position = "shaft", component = "angle"}
[solve]
duration = "1 s"
""")
    solution = simulate(load(read_scene(path)))
    assert abs(solution["turn"].values[-1]) > 4 * math.pi  # it goes around, past eight dead centres and more
    kinetic = solution.model.energy.kinetic
    assert np.ptp(kinetic) < 1e-6 * kinetic[0]


def test_pictures_and_pages_of_a_scene_in_space(tmp_path):
    runner = CliRunner()
    done = runner.invoke(main, ["show", "bricard", "-o", str(tmp_path / "bricard.png")])
    assert done.exit_code == 0, done.output
    assert "of which 1 follow from the others" in done.output and (tmp_path / "bricard.png").stat().st_size > 10_000
    done = runner.invoke(main, ["run", "spinning-top", "-o", str(tmp_path / "top"), "--set", "solve.duration=0.2 s"])
    assert done.exit_code == 0, done.output
    assert {path.name for path in (tmp_path / "top").iterdir()} >= {"motion.png", "sensors.png", "animation.gif"}
    done = runner.invoke(main, ["show", "bricard", "--at", "first=10deg", "-o", str(tmp_path / "no.png")])
    assert done.exit_code == 2 and "drawn as it starts" in done.output
    done = runner.invoke(main, ["modes", "bricard"])
    assert done.exit_code == 2 and "nothing is elastic" in done.output
    done = runner.invoke(main, ["derive", "spinning-top", "-o", str(tmp_path / "top.py")])
    assert done.exit_code == 0 and (tmp_path / "top.py").read_bytes() == Path(spinning_top.__file__).read_bytes()
    for refused in (["equations", "bricard", "--latex"], ["compare", "bricard", "--with", "exudyn"],
                    ["derive", "bricard", "--coupled", "-o", str(tmp_path / "no.py")]):  # fmt: skip
        done = runner.invoke(main, refused)
        assert done.exit_code == 2 and "only planar scenes so far" in done.output, refused
