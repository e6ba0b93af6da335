"""Mechanisms in space built in Exudyn: Euler parameters, multipliers and geometrically exact beams, beside ours."""

import numpy as np
import pytest

from kaneflex import SceneError, compare, read_scene, scene_of, with_settings
from kaneflex.solve.curves import Resolution
from kaneflex_peers.buildable import check_buildable

TURNING = """
schema = 1
gravity = [0, 0, -9.81]
ground.hook = [0.3, 0.4, 0.9]
bodies.post.length = "0.5 m"
bodies.post.mass = "2 kg"
bodies.post.centre = [0.2, 0.05, 0]
bodies.post.inertia = [0.02, 0.08, 0.09, 0.002, 0.001, -0.001]
bodies.post.rotation = {x = [0, 0, 1]}
bodies.slide = {length = "0.4 m", mass = "1 kg", centre = [0.2, 0, 0], inertia = [0.005, 0.02, 0.02]}
bodies.paddle = {length = "0.3 m", mass = "0.5 kg", inertia = [0.003, 0.006, 0.005]}
joints.turn = {revolute = ["ground", "post.start"], axis = [0, 0, 1]}
joints.guide = {weld = ["post.end", "slide.start"]}
joints.hinge = {revolute = ["slide.end", "paddle.start"], axis = [0, 1, 1]}
drives.turn = {law = "3 * t + 0.5 * sin(4 * t)"}
drives.hinge = {free = true, angle = "20 deg", initial_speed = "2 rad/s"}
loads.wind = {force_on = "paddle.end", axes = "body", direction = [0, 1, 0], law = "1.5 + sin(6 * t) + 0.3 * hinge"}
loads.brake = {torque_at = "hinge", law = "-0.05 * hinge_speed + 0.02 * turn"}
springs.coil = {torsional_at = "hinge", stiffness = 3, damping = 0.02, angle = "5 deg"}
springs.rope = {between = ["ground.hook", "paddle.end"], stiffness = 20, damping = 0.5, length = "0.2 m"}
sensors.angle = {position = "hinge", component = "angle"}
sensors.turning_rate = {velocity = "hinge", component = "angle"}
sensors.turning_accel = {acceleration = "hinge", component = "angle"}
sensors.tip_x = {position = "paddle.end", component = "x"}
sensors.tip_v = {velocity = "paddle.end", component = "z", axes = "body"}
sensors.tip_a = {acceleration = "paddle.end", component = "y", reading = "accelerometer"}
sensors.turning = {velocity = "paddle", component = "angle_x"}
sensors.spin = {acceleration = "paddle", component = "angle_z"}
sensors.motor = {drive_torque = "turn"}
sensors.pin = {joint_force = "hinge", component = "x", axes = "body"}
sensors.base = {joint_force = "turn", component = "z", body = "ground"}
sensors.base_moment = {joint_force = "turn", component = "angle_x"}
sensors.tilting = {joint_force = "guide", component = "angle_y", axes = "body"}
sensors.hinge_moment = {joint_force = "hinge", component = "angle_z", body = "slide"}
sensors.pull = {spring_force = "rope"}
sensors.twist = {spring_torque = "coil"}
solve = {preset = "rigid", duration = "0.5 s"}
"""
SLIDING = """
schema = 1
gravity = [0, 0, -9.81]
bodies.carriage = {length = "0.4 m", mass = "2 kg", inertia = [0.02, 0.08, 0.09], rotation = {x = [0, 0, 1]}}
bodies.bead = {mass = "0.5 kg", inertia = [0.003, 0.004, 0.005]}
joints.rail = {prismatic = ["ground", "carriage.start"], direction = [1, 2, 2]}
joints.rod = {cylindrical = ["carriage.end", "bead"], axis = [1, 0, 1]}
drives.rail = {law = "0.1 + 0.05 * sin(6 * t)"}
drives.rod = {free = true}
loads.push = {force_on = "bead", direction = [1, 0, 0], law = "1 + 20 * rail - rail_speed"}
springs.rope = {between = ["carriage", "bead"], stiffness = 20, damping = 0.5, length = "0.2 m"}
sensors.out = {position = "rail", component = "x"}
sensors.along = {position = "rod", component = "x"}
sensors.along_rate = {velocity = "rod", component = "x"}
sensors.bead_x = {position = "bead", component = "x"}
sensors.bead_z = {position = "bead", component = "z"}
sensors.push = {drive_force = "rail"}
sensors.pin = {joint_force = "rod", component = "y"}
sensors.rail_moment = {joint_force = "rail", component = "angle_z", body = "ground"}
sensors.pull = {spring_force = "rope"}
solve = {preset = "rigid", duration = "0.5 s"}
"""


def shares(scene, steps):
    """Difference of each sensor as a share of Exudyn's peak: the largest of places and velocities, the root of the
    mean square of accelerations and forces, which swing there from step to step at first and after Newton's skips."""
    found = compare(scene, peer="exudyn", resolution=Resolution(None, steps)).curves
    ours, theirs = found["rigid"], found["exudyn"]
    shares = {}
    for name, values in theirs.values.items():
        apart = abs(np.interp(theirs.times, ours.times, ours.values[name]) - values)[len(theirs.times) // 10 :]
        moves = scene.sensors[name].kind in ("position", "velocity")
        shares[name] = (apart.max() if moves else np.sqrt((apart**2).mean())) / abs(values).max()
    return shares


@pytest.mark.exhaustive
@pytest.mark.parametrize(("name", "steps", "motion", "force"), [
    ("robot-arm", 2000, 1e-10, 2e-3), ("bricard", 8000, 1e-7, None), ("spatial-slider-crank", 8000, 3e-5, 2e-4),
    ("spinning-top", 8000, 2e-3, 5e-3),
])  # fmt: skip
def test_shipped_scenes(peer, name, steps, motion, force):
    """What is left is Exudyn's step error, which for the top falls to a sixteenth with a quarter of the step."""
    peer("exudyn")
    scene = read_scene(name)
    found = shares(scene, steps)
    assert set(found) == set(scene.sensors)
    for sensor, share in found.items():
        assert share < (motion if scene.sensors[sensor].kind in ("position", "velocity") else force), sensor


def test_drives_loads_and_springs(peer):
    """A driven post carries a paddle on a hinge with full inertias: loads that turn with bodies and know its motion,
    springs of both kinds, all motions, accelerations, forces and moments."""
    peer("exudyn")
    scene = with_settings(scene_of(TURNING), ["solve.duration=0.1 s"])
    found = shares(scene, 200)
    assert set(found) == set(scene.sensors)
    assert all(found[name] < 2e-5 for name in ("angle", "turning_rate", "tip_x", "tip_v", "pull", "twist"))
    assert all(share < 3e-3 for share in found.values())


def test_slides(peer):
    peer("exudyn")
    scene = scene_of(SLIDING)
    found = shares(scene, 1000)
    assert set(found) == set(scene.sensors)
    assert all(found[name] < 1e-5 for name in ("out", "along", "along_rate", "bead_x", "bead_z"))
    assert all(found[name] < 1e-5 for name in ("push", "pin", "rail_moment", "pull"))


def test_moments_of_all_kinds_of_joints(peer):
    """A universal joint, here askew, holds one turn, a guide all of them; the shaft's crank turns freely about its x
    axis alone."""
    peer("exudyn")
    asked = {"cross": "xyz", "guide": "xyz", "shaft": "yz"}
    sensors = [f'sensors.{joint}_{axis} = {{joint_force = "{joint}", component = "angle_{axis}"}}'
               for joint, axes in asked.items() for axis in axes]  # fmt: skip
    askew = "joints.cross = {axes = [[0, 2, -1], [1, 0, 0]]}"
    text = "\n".join(['schema = 1\nlike = "spatial-slider-crank"', askew, *sensors])
    found = shares(scene_of(text), 4000)
    assert {f"{joint}_{axis}" for joint, axes in asked.items() for axis in axes} < set(found)
    assert all(share < 2e-3 for share in found.values())


CARRIED = """
schema = 1
gravity = [0, 0, -9.81]
bodies.post = {length = "0.4 m", mass = "2 kg", inertia = [0.02, 0.08, 0.09], rotation = {x = [0, 0, 1]}}
bodies.bead = {mass = "0.5 kg", inertia = [0.003, 0.004, 0.005]}
joints.turn = {revolute = ["ground", "post.start"], axis = [0, 1, 1]}
joints.rail = {prismatic = ["post.end", "bead"], direction = [1, 2, 2]}
drives.turn = {free = true, initial_speed = "3 rad/s"}
drives.rail = {law = "0.1 + 0.05 * sin(6 * t)"}
sensors.out = {position = "rail", component = "x"}
sensors.angle = {position = "turn", component = "angle"}
sensors.bead_x = {position = "bead", component = "x"}
sensors.push = {drive_force = "rail"}
sensors.pin = {joint_force = "rail", component = "y"}
sensors.rail_moment = {joint_force = "rail", component = "angle_z"}
solve = {preset = "rigid", duration = "1 s"}
"""


@pytest.mark.exhaustive
def test_a_drive_along_a_guide_that_moves(peer, exhaustive):
    """What the drive exerts acts on the carrier where the bead is; the error falls with the step."""
    peer("exudyn")
    scene = scene_of(CARRIED)
    fine, coarse = shares(scene, 4000), shares(scene, 1000) if exhaustive else {}
    assert fine["out"] < 1e-9 and all(fine[name] < 2e-3 for name in scene.sensors)
    assert all(fine[name] < 2e-4 and 3 * fine[name] < coarse.get(name, 1.0) for name in ("angle", "bead_x"))


def elastic_shares(scene, elements, steps):
    """Largest difference of each sensor over one cycle as a share of Exudyn's peak."""
    found = compare(scene, peer="exudyn", resolution=Resolution(elements, steps))
    assert not found.curves["exudyn"].missing
    return {each.sensor: each.peak_difference / each.reference_peak for each in found.differences}


CANTILEVER = """
schema = 1
gravity = [0, 0, -9.81]
bodies.arm.length = "0.4 m"
bodies.arm.rotation = {x = [1, 2, 2], y = [2, 1, -2]}
bodies.arm.beam.E = "70 GPa"
bodies.arm.beam.nu = 0.33
bodies.arm.beam.rho = "2700 kg/m^3"
bodies.arm.beam.section = {rectangle = ["12 mm", "8 mm"]}
bodies.arm.beam.theory = "timoshenko"
bodies.arm.beam.elements = 4
bodies.fork.length = "0.2 m"
bodies.fork.mass = "0.3 kg"
bodies.fork.centre = [0.1, 0.02, 0]
bodies.fork.inertia = [1e-4, 1e-3, 1e-3]
bodies.fork.rotation = {x = [2, 1, -2], y = [-2, 2, -1]}
joints.turn = {revolute = ["ground", "arm.start"], axis = [0, 0, 1]}
joints.root = {weld = ["arm.end", "fork.start"]}
drives.turn = {speed = "60 rpm", cycle = "360 deg"}
loads.push = {force_on = "fork.end", direction = [0, 1, 1], value = "1 N"}
damping.rayleigh = {ratio = 0.2, at = ["15 Hz", "40 Hz"]}
sensors.lag = {displacement = "arm.end", component = "y"}
sensors.flap = {displacement = "arm.end", component = "z"}
sensors.tip = {displacement = "fork.end", component = "z"}
sensors.twist = {displacement = "arm.end", component = "angle_x"}
sensors.slope = {displacement = "arm.mid", component = "angle_y", relative_to = "chord"}
sensors.torsion = {torsional_moment = "arm.mid"}
sensors.shear = {shear_force = "arm.mid", component = "z"}
sensors.pull = {axial_force = "arm.start"}
sensors.bent = {bending_moment = "arm.start", component = "y"}
sensors.gauge = {strain = "arm.mid", fibre = ["4 mm", "-5 mm"]}
sensors.place = {position = "fork.end", component = "x"}
sensors.speed = {velocity = "arm.end", component = "z"}
sensors.accel = {acceleration = "arm.end", component = "x", axes = "body"}
sensors.moment = {joint_force = "root", component = "angle_x", axes = "body"}
sensors.motor = {drive_torque = "turn"}
solve = {preset = "stiffened", start = "periodic"}
"""


@pytest.mark.exhaustive(group="beams", share=4)
def test_sections_rotations_and_rates_of_an_elastic_arm(peer, exhaustive):
    """A heavy fork across the tip of an arm that turns bends it both ways and twists it. The moments that
    displaced forces have, which one-way coupling leaves out, fall with the displacements of an arm eight times stiffer.
    """
    peer("exudyn")
    stiff = elastic_shares(scene_of(CANTILEVER.replace("70 GPa", "560 GPa")), 8, 180)
    assert len(stiff) == 15 and all(share < (0.04 if name == "slope" else 0.02) for name, share in stiff.items())
    if exhaustive:
        soft = elastic_shares(scene_of(CANTILEVER), 8, 180)
        assert all(4 * stiff[each] < soft[each] < 0.06 for each in ("motor", "moment", "shear", "place"))


@pytest.mark.exhaustive(group="beams", share=4)
def test_an_elastic_rod_in_space(peer, exhaustive):
    """It bends both ways by some 3e-4 of its length; what is left in the displacements falls with the square of
    Exudyn's elements' size, and is none of the forces'."""
    peer("exudyn")
    scene = with_settings(read_scene("spatial-slider-crank-elastic"), ["drives.shaft.speed=300 rpm"])
    fine = elastic_shares(scene, 12, 180)
    assert set(fine) == set(scene.sensors)
    assert fine["slider_x"] < 1e-7 and fine["rod_force"] < 4e-3
    assert fine["side_force"] < 1e-3 and fine["crank_torque"] < 1e-3
    coarse = elastic_shares(scene, 6, 180) if exhaustive else {}
    for sensor in ("mid_y", "mid_z", "rod_moment"):
        assert fine[sensor] < 0.02 and fine[sensor] < 0.3 * coarse.get(sensor, 1.0), sensor


@pytest.mark.exhaustive(group="beams", share=4)
def test_links_that_bend_more_are_further_apart(peer, exhaustive):
    """The follower of the four-bar bends by 1 % of its length at 300 rpm and by 0.1 % at 100 rpm, where what is left in
    displacements is the size of Exudyn's elements."""
    peer("exudyn")
    scene = read_scene("four-bar-misaligned")
    slow = elastic_shares(with_settings(scene, ["drives.main.speed=100 rpm"]), 8, 180)
    assert slow["out_of_plane"] < 5e-5 and slow["follower_moment"] < 0.01 and slow["crank_torque"] < 5e-3
    assert slow["coupler_mid"] < 0.03 and slow["follower_mid"] < 0.03
    if exhaustive:
        fast = elastic_shares(scene, 8, 180)
        assert fast["coupler_mid"] < 0.05 and fast["follower_mid"] < 0.05
        assert all(2 * slow[each] < fast[each] for each in ("out_of_plane", "follower_moment", "crank_torque"))


@pytest.mark.exhaustive(group="beams", share=4)
def test_a_four_bar_that_bends_back_on_its_motion_is_that_of_exact_rods(peer, exhaustive):
    """From rest to 1 % of its links' lengths, undamped: what is left under preset coupled is the size of Exudyn's
    elements, squared. Its coupler hangs on a universal joint, its follower on a pin that is none of its axes."""
    peer("exudyn")
    settings = ["solve.preset=coupled", "solve.modes=5", "damping=none", "sensors.follower_moment=none"]
    settings += ["solve.start=zero", "solve.duration=9 ms", "solve.steps=36"]
    scene = with_settings(read_scene("four-bar-misaligned"), settings)
    fine, coarse = elastic_shares(scene, 16, 80), elastic_shares(scene, 8, 40) if exhaustive else {}
    for sensor in ("coupler_mid", "follower_mid"):
        assert fine[sensor] < 4e-3 and 3 * fine[sensor] < coarse.get(sensor, 1.0), sensor
    assert fine["out_of_plane"] < 3e-3


@pytest.mark.parametrize(("given", "instead", "names"), [
    ('rayleigh = {ratio = 0.2, at = ["15 Hz", "40 Hz"]}', "modal = {ratio = 0.02}", ["damping", "solve.start"]),
    ('cycle = "360 deg"}', 'cycle = "360 deg", rotation = "free"}', ["drives.turn.rotation"]),
])  # fmt: skip
def test_what_has_no_counterpart_in_space(given, instead, names):
    scene = scene_of(CANTILEVER.replace(given, instead))
    with pytest.raises(SceneError) as refused:
        check_buildable(scene)
    assert [problem.key for problem in refused.value.problems] == names
