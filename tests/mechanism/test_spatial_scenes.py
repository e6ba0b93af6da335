"""Scenes in space: what is said of broken ones, loads and springs, starts and dead centres."""

import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from command_line import unrendered
from machines import changed, machine
from runs import solved

from kaneflex import SceneError, draw_all, load, read_scene, scene_of, with_settings
from kaneflex.cli import main
from kaneflex.generated import spinning_top_laws
from kaneflex.report.checked import description
from kaneflex.response.time_statistics import between_steps
from kaneflex.solve.loading import integrated
from kaneflex.solve.repeated_motion import harmonics_of

PENDULUM = machine(
    gravity=[0, 0, "-9.81 m/s^2"], bodies=dict(bar='length = "1 m", mass = "1 kg", inertia = [0.001, 0.08, 0.08]'),
    joints=dict(hinge="revolute ground bar.start, axis = [0, 1, 0]"), drives=dict(hinge="free = true"),
    sensors=dict(angle="position hinge angle"), solve=dict(preset="rigid", duration="1 s"),
)


def pendulum(*changes, text=PENDULUM):
    return scene_of(changed(text, *changes))


@pytest.mark.parametrize(("old", "new", "said"), [
    ('[0, 0, "-9.81 m/s^2"]', "[0, -9.81]", r"joints.hinge.axis.*three components, where gravity has two"),
    (", axis = [0, 1, 0]", "", r"joints.hinge: in space a revolute joint needs an axis"),
    ("inertia = [0.001, 0.08, 0.08]", "inertia = 0.08", r"bodies.bar.inertia = 0.08.*three principal moments"),
    ("[0.001, 0.08, 0.08]", "[0.5, 0.08, 0.08]", r"bodies.bar.inertia.*no body has the principal moments"),
    ("[0.001, 0.08, 0.08]", "[1, 2]", r"bodies.bar.inertia.*not the inertia of a body in space"),
    ("drives.hinge = {free = true}\n", "", r"drives: 1 degree of freedom has no drive, at hinge"),
    ('"rigid"', '"paper"', r"solve.preset = 'paper': only planar scenes have this preset so far"),
    ('component = "angle"', 'component = "z"', r"sensors.angle.component = 'z'.*not a coordinate of this joint"),
    ("", 'sensors.motor = {drive_torque = "hinge"}',
     r"sensors.motor.drive_torque = 'hinge': a free joint has no drive force: drives.hinge is free"),
    ("{revolute", "{universal", r"joints.hinge.axis = .*has no axis"),
    ("hinge", "in", r"joints.in: a keyword of Python, which generated modules can't use. Choose another name"),
    ('revolute = ["ground", "bar.start"], axis = [0, 1, 0]',
     'universal = ["ground", "bar.start"], axes = [[0, 1, 0], [0, 1, 1]]',
     r"joints.hinge.axes.*not at right angles"),
    ('revolute = ["ground", "bar.start"], axis = [0, 1, 0]',
     'universal = ["ground", "bar.start"], axes = [[0, 1, 0], [0, 0, 1]]',
     r"sensors.angle.position = 'hinge': a universal joint has no single coordinate to measure"),
    ('{position = "hinge", component = "angle"}', '{velocity = "hinge", component = "angle_y"}',
     r"sensors.angle.component = 'angle_y'.*not a coordinate of this joint"),
    ("", 'contacts.stop = {between = ["ground", "bar.end"], kind = "point-line"}', r"contacts"),
    ('angle = {position = "hinge", component = "angle"}', 'gauge = {strain = "bar.end", fibre = "5 mm"}',
     r"sensors.gauge.fibre = '5 mm'.*Give both, like"),
    ("", "bodies.loose.mass = 1", r"bodies.loose: no joint without clearance connects it to the ground"),
    ("joints.hinge", "joints.other = {revolute = ['ground', 'bar.start'], axis = [1, 0, 0]}\njoints.hinge",
     r"drives.hinge = 'free': joints and drives leave the mechanism no degree of freedom"),
    # no steps lead over a pole: each is shorter than the one before
    ("{free = true}", '{law = "tan(20 * t)"}', r"drives\.hinge\.law = 'tan.*: it grows without bound at t = 0\.39"),
    ("length", "rotation = {axis = [0, 0, 1]}, length",  # it turned nothing, silently
     r"^bodies\.bar\.rotation\.angle: the axis has no angle\. Give it, like angle = '90 deg'\.$"),
])  # fmt: skip
def test_what_is_wrong_is_named(old, new, said):
    with pytest.raises(SceneError, match=said):
        load(pendulum((old, new)))


PLANAR = (
    PENDULUM.replace('[0, 0, "-9.81 m/s^2"]', '[0, "-9.81 m/s^2"]')
    .replace(", axis = [0, 1, 0]", "")
    .replace("[0.001, 0.08, 0.08]", "0.08")
)


@pytest.mark.parametrize(("old", "new", "said"), [
    ("mass", "rotation = {axis = [0, 1], angle = 1}, mass", r"bar.rotation.*joints give the angles"),
    ('"bar.start"]', '"bar.start"], axis = [0, 1]', r"hinge.axis.*planar joints turn about the plane's normal"),
    ("free = true", "free = true, angular_velocity = [1, 2]", r"drives.hinge.angular_velocity"),
    ('angle = {position = "hinge", component = "angle"}', 'gauge = {strain = "bar.end", fibre = ["5 mm", 0]}',
     r"sensors.gauge.fibre.*a planar beam bends in one plane"),
    ("free = true", "free = true, initial_speeds = [1, 2]", r"initial_speeds.*: a planar joint has one speed"),
    ('component = "angle"', 'component = "z"', r"component = 'z': a planar scene .*Write x, y or angle, or"),
    ("bodies.bar", "bodies.rod = {length = 1, "
     "beam = {material = 'steel', A = 1e-4, I_y = 1e-9, I_z = 1e-9, J = 2e-9}}\nbodies.bar",
     r"^bodies.rod.beam.J = 2e-09: planar beams don't twist. Give I, or give vectors three components"),
])  # fmt: skip
def test_what_only_a_scene_in_space_has_is_refused_in_the_plane(old, new, said):
    with pytest.raises(SceneError, match=said):
        load(pendulum((old, new), text=PLANAR))


def test_a_rotation_by_no_angle_is_one():
    scene = pendulum(("length", "rotation = {axis = [0, 0, 1], angle = 0}, length"))
    assert (scene.bodies["bar"].rotation.matrix == np.eye(3)).all()


def test_a_freedom_that_moves_nothing_heavy_is_named():
    """A thin bar on a ball, whose inertia about itself is left out, resists no spin."""
    scene = pendulum(
        (", inertia = [0.001, 0.08, 0.08]", ""), ("{revolute", "{spherical"), (", axis = [0, 1, 0]", ""),
        ('angle = {position = "hinge", component = "angle"}', 'tip = {position = "bar.end", component = "z"}'),
    )  # fmt: skip
    with pytest.raises(SceneError, match=r"drives.hinge: .*singular: hinge.omega_x carries no inertia"):
        load(scene)


def test_a_mass_beside_a_ball_resists_no_spin_about_its_arm():
    """30 degrees off the x axis of the body, about which most of that spin is."""
    text = machine(bodies=dict(arm="points.tip = [0.866, 0.5, 0]"), masses=dict(tip='at = "arm.tip", mass = 1'),
                   joints=dict(hinge="spherical ground arm"), drives=dict(hinge="free = true"),
                   solve=dict(preset="rigid", duration=1))  # fmt: skip
    with pytest.raises(SceneError, match=r"drives.hinge: .*singular: hinge.omega_x carries no inertia"):
        load(scene_of(text))


def test_a_spring_pulls_points_that_meet_if_it_needs_no_direction():
    spring = 'springs.coil = {between = ["ground", "bar.start"], stiffness = 10}'
    alone, pulled = (solved(pendulum(*more))["angle"].values for more in ((), [("", spring)]))
    assert pulled == pytest.approx(alone, abs=1e-9)
    damped = spring.replace("10}", "10, damping = 1}")
    with pytest.raises(SceneError, match=r"springs.coil.between.*joint hinge keeps its points together"):
        pendulum(("", damped))
    seat = "ground.seat = [0, 0, 0]\n" + damped.replace('"ground"', '"ground.seat"')
    with pytest.raises(SceneError, match=r"springs.coil.between.*its points coincide"):
        load(pendulum(("", seat)))


FOUR_BAR = """
schema = 1
gravity = [0, 0, "-9.81 m/s^2"]
ground.far = [1, 0, 0]
bodies.crank = {length = "0.3 m", mass = "1 kg", inertia = [0.1, 0.1, 0.1], rotation = {axis = [0, 1, 0], angle = -1}}
bodies.rod = {length = "1 m", mass = "1 kg", inertia = [0.1, 0.1, 0.1]}
bodies.rocker = {length = "0.5 m", mass = "1 kg", inertia = [0.1, 0.1, 0.1], rotation = {axis = [0, 1, 0], angle = -1}}
joints.shaft = {revolute = ["ground", "crank.start"], axis = [0, 1, 0]}
joints.knee = {revolute = ["crank.end", "rod.start"], axis = [0, 1, 0]}
joints.wrist = {revolute = ["rod.end", "rocker.end"], axis = [0, 1, 0]}
joints.foot = {revolute = ["ground.far", "rocker.start"], axis = [0, 1, 0]}
drives.shaft = {free = true, initial_speed = "5 rad/s"}
sensors.turn = {position = "shaft", component = "angle"}
solve.duration = "0.4 s"
"""


def test_a_law_knows_speeds_that_depend_on_others():
    """A torque -k phi - c phi' at a joint whose speed the loop ties is a spring with its damper."""
    found = [solved(scene_of(FOUR_BAR + said)) for said in (
        'loads.coil = {torque_at = "foot", law = "-4 * foot - 0.7 * foot_speed"}',
        'springs.coil = {torsional_at = "foot", stiffness = 4, damping = 0.7}')]  # fmt: skip
    law, spring = (solution["turn"].values for solution in found)
    assert law == pytest.approx(spring, abs=1e-8)
    assert found[1].energy.dissipated[-1] > 0.1


def test_a_coordinate_too_many_in_a_loop_is_named():
    loop = "knee", "wrist", "foot"
    asked = (f'springs.coil_{name} = {{torsional_at = "{name}", stiffness = 1}}\n' for name in loop)
    with pytest.raises(SceneError, match=r"joints\..*use the coordinates of all joints of its loop"):
        load(scene_of(FOUR_BAR + "".join(asked)))


RATES = {"position": "", "velocity": "_rate", "acceleration": "_accel"}


def rates_of(names, component="angle"):
    """Sensors of joints' coordinates and of their rates."""
    return "".join(f'sensors.{name}{tail} = {{{kind} = "{name}", component = "{component}"}}\n'
                   for name in names for kind, tail in RATES.items())  # fmt: skip


@pytest.mark.exhaustive
@pytest.mark.parametrize("last", ["knee", "wrist", "foot"])
def test_all_joints_of_a_loop_are_read(last):
    """Whichever closes it: angles around the loop add up, turns and all, and rates are those of what is read."""
    text = FOUR_BAR.replace("5 rad/s", "15 rad/s").replace('"0.4 s"', '"2 s"')
    line = next(line for line in text.splitlines(True) if line.startswith(f"joints.{last}"))
    solution = solved(scene_of(text.replace(line, "") + line + rates_of(("knee", "wrist", "foot"))))
    assert list(solution.model.module.system.layout.cuts) == [last]
    found = {name: solution[name].values for name in solution.series}
    assert found["turn"][-1] > 30.0 and found["knee"][-1] < -30.0
    assert found["turn"] + found["knee"] + found["wrist"] == pytest.approx(found["foot"], abs=1e-9)
    h = solution.model.step
    for name in ("knee", "wrist", "foot"):
        for tail, after in (("", "_rate"), ("_rate", "_accel")):
            rate = np.gradient(found[name + tail], h)[1:-1]
            assert rate == pytest.approx(found[name + after][1:-1], abs=3e-3 * abs(found[name + after]).max())
    alone = solution.model.motion.at(solution.times[-1])
    assert alone[f"{last}.angle"][0] == pytest.approx(found[last][-1], abs=1e-9)


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("kind", ["revolute", "prismatic", "cylindrical"])
@pytest.mark.parametrize("turned", [False, True])
def test_a_joint_that_closes_a_loop_is_read_as_the_one_beside_it(kind, turned):
    """The same joint twice: one in the tree, one a cut."""
    sides = '["carrier.away", "block.corner"]' if not turned else '["block.corner", "carrier.away"]'
    axis = "direction" if kind == "prismatic" else "axis"
    drive = {"revolute": 'law = "12 * (t - sin(2 * pi * t) / (2 * pi))"', "prismatic": 'law = "0.1 * sin(5 * t)"',
             "cylindrical": 'free = true, initial_speeds = ["0.3 m/s", "20 rad/s"]'}[kind]  # fmt: skip
    joint = f"{kind} = {sides}, {axis} = [1, 2, 2]"
    components = {"revolute": ["angle"], "prismatic": ["x"], "cylindrical": ["x", "angle"]}[kind]
    sensors = "".join(rates_of(("first", "second"), c).replace(" = {", f"_{c} = {{") for c in components)
    solution = solved(scene_of(machine(
        gravity=[0, 0, -9.81],
        bodies=dict(
            carrier="mass = 1, inertia = [1, 1, 1], points.away = [0.3, -0.2, 0.1], "
                    "rotation = {axis = [1, 0, 1], angle = 1}",
            block="mass = 1, inertia = [1, 1.2, 0.9], points.corner = [0.1, 0.2, 0.3], "
                  "rotation = {axis = [1, 1, 0.5], angle = 0.7}"),
        joints=dict(base="revolute ground carrier, axis = [0, 1, 0]", first=joint, second=joint),
        drives=dict(base='law = "sin(3 * t)"', first=drive), solve=dict(duration=1),
    ) + sensors))  # fmt: skip
    assert list(solution.model.module.system.layout.cuts) == ["second"]
    for name in (name for name in solution.series if name.startswith("first")):
        wanted = solution[name].values
        assert solution["second" + name[5:]].values == pytest.approx(wanted, abs=1e-8 * abs(wanted).max())
    t = solution.times
    if kind == "revolute":
        assert solution["second_angle"].values == pytest.approx(12 * (t - np.sin(2 * np.pi * t) / (2 * np.pi)))
        # at rest at both ends, and almost two turns further
        assert load(solution.model.scene).motion.at(1.0)["second.angle"][0] == pytest.approx(12.0)
    elif kind == "prismatic":
        assert solution["second_accel_x"].values == pytest.approx(-2.5 * np.sin(5 * t), abs=1e-10)
    else:
        assert solution["second_angle"].values[-1] > 10.0 and solution["second_rate_x"].values[0] == pytest.approx(0.3)


TURNED = (
    ('mass = "1 kg"', 'mass = "1 kg", rotation = {axis = [1, 2, 2], angle = 0.8}'),
    ('angle = {position = "hinge", component = "angle"}', 'tip = {position = "bar.end", component = "z"}'),
)


@pytest.mark.parametrize("turned", [False, True])
def test_a_universal_joint_starts_with_two_speeds(turned):
    """Its first axis is fixed in the first body and its second in the second one: at zero both stand as given."""
    axes = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    sides = '"bar.start", "ground"' if turned else '"ground", "bar.start"'
    scene = pendulum(
        *TURNED, ('revolute = ["ground", "bar.start"], axis = [0, 1, 0]',
                  f"universal = [{sides}], axes = {axes.tolist()}"),
        ("free = true", 'free = true, initial_speeds = ["2 rad/s", "-30 rpm"]'),
    )  # fmt: skip
    model = load(scene)
    assert "free, at 2 rad/s, -3.14159 rad/s" in description(model)["drives"].values()
    found = [model.motion.at(0.0)[f"bar.omega_{axis}"][0] for axis in "xyz"]
    stands = scene.bodies["bar"].rotation.matrix
    turning = 2.0 * axes[0] - math.pi * axes[1]
    assert found == pytest.approx(-stands @ turning if turned else turning, abs=1e-12)


@pytest.mark.parametrize("turned", [False, True])
def test_a_spherical_joint_starts_with_the_angular_velocity_of_its_second_body(turned):
    omega = np.array([1.0, -2.0, 3.0])
    sides = '"bar.start", "ground"' if turned else '"ground", "bar.start"'
    scene = pendulum(
        *TURNED, ('revolute = ["ground", "bar.start"], axis = [0, 1, 0]', f"spherical = [{sides}]"),
        ("free = true", f"free = true, angular_velocity = {omega.tolist()}"),
    )  # fmt: skip
    found = [load(scene).motion.at(0.0)[f"bar.omega_{axis}"][0] for axis in "xyz"]
    assert found == pytest.approx(-omega if turned else scene.bodies["bar"].rotation.matrix @ omega, abs=1e-12)


@pytest.mark.parametrize(("joint", "given", "said"), [
    ("cylindrical", 'initial_speeds = ["2 rad/s", "1 rad/s"]', r"speeds.0.*the first speed .* is along its axis"),
    ("cylindrical", "initial_speed = 1", r"drives.hinge.initial_speed: this is a cylindrical joint. Give initial"),
    ("revolute", "initial_speeds = [1, 2]", r"drives.hinge.initial_speeds: this is a revolute joint. Give initial"),
    ("revolute", "angular_velocity = [1, 2, 3]", r"drives.hinge.angular_velocity: this is a revolute joint"),
    ("cylindrical", "initial_speeds = [1, 2, 3]", r"drives.hinge.initial_speeds.*not two speeds"),
])  # fmt: skip
def test_speeds_that_a_joint_does_not_have_are_named(joint, given, said):
    with pytest.raises(SceneError, match=said):
        load(pendulum(("{revolute", f"{{{joint}"), ("free = true", f"free = true, {given}")))


def test_a_start_where_the_loops_do_not_close_is_named():
    """The crank reaches its far dead centre before it reaches what is asked."""
    shaft = 'shaft = {free = true, initial_speed = "5 rad/s"}'
    text = FOUR_BAR.replace(shaft, "foot = {free = true, angle = 0.3}")
    with pytest.raises(SceneError, match=r"drives.foot.angle = 0.3.*the loops don't close at this position, but at"):
        load(scene_of(text + 'sensors.foot = {position = "foot", component = "angle"}'))


@pytest.mark.parametrize(("free", "cut"), [("", "ball"), ("ball", "cross"), ("ball cross", "guide")])
def test_every_body_is_in_balance_with_its_joints(free, cut):
    """Newton and Euler for each body, by hand: m a_centre and J e + w x J w are what joints and weight exert on it,
    whichever joint closes the loop; and each joint exerts the same then."""
    drives = "".join(f"drives.{name}.free = true\n" for name in free.split())
    model = integrated(load(scene_of(f'schema = 1\nlike = "spatial-slider-crank"\n{drives}solve.duration = 0.3')))
    assert list(model.module.system.layout.cuts) == [cut]
    times = np.linspace(0.01, 0.29, 5)
    rigid, scene = model.motion.at(times), model.scene
    mechanism = model.module.system.mechanism

    def vector(name):
        return np.array([rigid[f"{name}{axis}"] for axis in "xyz"])

    for name, body in mechanism.bodies.items():
        frame = rigid.frame(name)
        centre, w, e = frame.place(body.centre), vector(f"{name}.omega_"), vector(f"{name}.epsilon_")
        zero = np.zeros((3, times.size))
        a = frame.acceleration(np.tile(body.centre[:, None], times.size), zero, zero)
        force = body.mass * (a - np.array(scene.gravity)[:, None])
        xx, yy, zz, xy, yz, zx = body.inertia
        J = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
        own_w, own_e = frame.to_body(w), frame.to_body(e)
        moment = frame.to_global(J @ own_e + np.cross(own_w, J @ own_w, axis=0))
        for joint_name, joint in mechanism.joints.items():
            for side, sign in zip(joint.sides, (-1.0, 1.0), strict=True):
                if side.body == name:
                    push = sign * vector(f"{joint_name}.force_")
                    second = joint.sides[1]
                    at = rigid.frame(second.body).place(second.at)
                    force = force - push
                    moment = moment - sign * vector(f"{joint_name}.moment_") - np.cross(at - centre, push, axis=0)
        assert abs(force).max() < 1e-9 and abs(moment).max() < 1e-10
    plain = integrated(load(read_scene("spatial-slider-crank"))).motion.at(times)
    for joint in mechanism.joints:
        for part in ("force_x", "force_y", "force_z", "moment_x", "moment_y", "moment_z"):
            assert rigid[f"{joint}.{part}"] == pytest.approx(plain[f"{joint}.{part}"], abs=2e-5)


def test_the_spin_of_a_rod_between_balls_is_named():
    """Neither ball holds it; with a universal joint for one of them nothing is open."""
    balls = read_scene("spatial-slider-crank").raw["joints"]["cross"]
    text = 'schema = 1\nlike = "spatial-slider-crank"\njoints.cross = {universal = "none", axes = "none", '
    with pytest.raises(SceneError, match=r"1 degree of freedom has no drive, at (ball|cross)"):
        load(scene_of(text + f"spherical = {balls['universal']}}}"))


def test_drives_that_a_loop_holds_are_named():
    text = 'schema = 1\nlike = "spatial-slider-crank"\ndrives.guide.speed = 1\n'
    text += 'drives.shaft = {speed = 1, free = "none", initial_speed = "none"}'
    with pytest.raises(SceneError, match=r"drives\.(shaft|guide).*the loops and the other drives already determine"):
        load(scene_of(text))


def test_a_force_and_a_spring_between_points_do_their_work():
    solution = solved(scene_of(PENDULUM + """
ground.hook = [1, 0.5, 0]
loads.push = {force_on = "bar.end", direction = [0, 0, 1], axes = "body", law = "3 + 2 * sin(5 * t) * hinge"}
springs.pull = {between = ["ground.hook", "bar.end"], stiffness = 30, damping = 0.4, length = 0.3}
sensors.tension = {spring_force = "pull"}
"""))
    gap = solution.motion.place("bar", (1.0, 0.0, 0.0)) - np.array([[1.0], [0.5], [0.0]])
    length = np.linalg.norm(gap, axis=0)
    rate = np.gradient(length, solution.times, edge_order=2)
    assert solution["tension"].values == pytest.approx(30 * (length - 0.3) + 0.4 * rate, abs=1e-3)
    energy = solution.energy
    assert energy.drift < 1e-8 and np.ptp(energy.supplied) > 0.1 and np.ptp(energy.dissipated) > 0.005


def test_constant_loads_are_not_looked_at_between_steps(monkeypatch):
    def never(*arguments):
        raise AssertionError("looked between the steps")

    push = 'loads.push = {force_on = "bar.end", direction = [0, 0, 1], value = 3}'
    model = integrated(load(scene_of(PENDULUM + push)))
    monkeypatch.setattr("kaneflex.response.time_statistics._instants_of_rows", never)
    assert between_steps(model) == []


def test_loads_between_steps_are_those_of_the_motion():
    """On curves through the steps; one that comes and goes within a step is named."""
    loaded = PENDULUM + """
loads.push = {force_on = "bar.end", direction = [0, 0, 1], law = "LAW"}
loads.brake = {torque_at = "hinge", law = "-hinge_speed * cos(hinge)"}
"""
    model = integrated(load(scene_of(loaded.replace("LAW", "3 * sin(7 * t) + hinge**2"))))
    times = np.linspace(0.0, 1.0, 357)
    found = model.motion.acting(times, model.motion.at(model.step * np.arange(model.options.steps + 1)))
    wanted = model.motion.at(times)
    for name in ("push", "brake"):
        assert found[name] == pytest.approx(wanted[name], abs=1e-7 * abs(wanted[name]).max())
    assert between_steps(model) == []
    knock = integrated(load(scene_of(loaded.replace("LAW", "3 * exp(-((t - 0.50025) / 0.0001)**2)"))))
    assert any("loads.push is not resolved: within a step" in said for said in between_steps(knock))


def test_a_slider_passes_its_dead_centres_in_free_motion():
    """Where crank and rod are in line the slider's speed says nothing of the crank's: other speeds are chosen there."""
    solution = solved(scene_of(machine(
        gravity=[0, 0, 0],
        joints=dict(shaft="revolute ground crank.start, axis = [0, 0, 1]",
                    pin="revolute crank.end rod.start, axis = [0, 0, 1]",
                    wrist="revolute rod.end slider.start, axis = [0, 0, 1]",
                    guide="prismatic ground slider.start, direction = [1, 0, 0]"),
        drives=dict(guide='free = true, position = "300 mm", initial_speed = "3 m/s"'),
        sensors=dict(turn="position shaft angle"), solve='duration = "1 s"',
        bodies=dict(crank='length = "100 mm", mass = "0.2 kg", inertia = [1e-5, 2e-4, 2e-4], '
                          'rotation = {axis = [0, 0, 1], angle = 0.9}',
                    rod='length = "250 mm", mass = "0.3 kg", inertia = [1e-5, 2e-3, 2e-3], '
                        'rotation = {axis = [0, 0, 1], angle = -0.3}', slider='mass = "1 kg"'),
    )))
    assert abs(solution["turn"].values[-1]) > 4 * math.pi  # it goes around, past eight dead centres and more
    kinetic = solution.energy.kinetic
    assert np.ptp(kinetic) < 1e-6 * kinetic[0]


def test_pictures_and_pages_of_a_scene_in_space(tmp_path, monkeypatch):
    runner = CliRunner()
    done = runner.invoke(main, ["show", "bricard", "-o", str(tmp_path / "bricard.png")])
    assert done.exit_code == 0, done.output
    assert "sixth, 1 of them redundant" in done.output and (tmp_path / "bricard.png").stat().st_size > 10_000
    unrendered(monkeypatch)
    short = ["--set", "solve.duration=0.2 s", "--frames", "2"]
    done = runner.invoke(main, ["run", "spinning-top", "-o", str(tmp_path / "top"), "--plots", "all", *short])
    assert done.exit_code == 0, done.output
    assert {path.name for path in (tmp_path / "top").iterdir()} >= {"mechanism.png", "sensors.png", "animation.gif"}
    done = runner.invoke(main, ["show", "bricard", "--at", "first=10deg", "-o", str(tmp_path / "no.png")])
    assert done.exit_code == 2 and "drawn at its start" in done.output
    done = runner.invoke(main, ["modes", "bricard"])
    assert done.exit_code == 2 and "no body is elastic" in done.output
    done = runner.invoke(main, ["derive", "spinning-top", "-o", str(tmp_path / "top.py")])
    assert done.exit_code == 0 and (tmp_path / "top.py").read_bytes() == Path(spinning_top_laws.__file__).read_bytes()
    done = runner.invoke(main, ["equations", "bricard"])
    assert done.exit_code == 2 and "only planar scenes so far" in done.output


RAIL = machine(
    gravity=[0, -9.81, 0],
    bodies=dict(bar='length = 1, beam = {material = "steel", section = {rectangle = ["10 mm", "20 mm"]}}',
                block='mass = "1 kg", inertia = [0.01, 0.01, 0.01]'),
    joints=dict(hold="weld ground bar.start", slide='KIND = ["bar.start", "block"], WAY = [1, 0, 0]'),
    drives=dict(slide="free = true"), solve=dict(preset="coupled", duration="1 ms"),
)


@pytest.mark.parametrize(("kind", "way"), [("prismatic", "direction"), ("cylindrical", "axis")])
def test_no_body_slides_along_an_elastic_one_that_bends(kind, way):
    """A block 0.3 m from the clamp stayed on the clamp's tangent, where the bar sags by millimetres."""
    text = RAIL.replace("KIND", kind).replace("WAY", way)
    said = rf"joints\.slide\.{kind} = 'bar\.start': the body is elastic, but its sliding line would stay straight"
    with pytest.raises(SceneError, match=said):
        scene_of(text)
    assert scene_of(text.replace("coupled", "rigid")).joints["slide"].kind == kind


def cardan(*changes):
    sine, cosine = math.sin(math.radians(25)), math.cos(math.radians(25))
    text = machine(
        ground=dict(rear=[0.2 + cosine, sine, 0]),
        bodies=dict(input='length = "200 mm", mass = "2 kg"', output='length = "200 mm", mass = "2 kg"',
                    middle='length = "1 m", rotation = {axis = [0, 0, 1], angle = "25 deg"}, '
                           'beam = {material = "steel", section = {tube = ["60 mm", "2 mm"]}, elements = 2}'),
        joints=dict(front="revolute ground input, axis = [1, 0, 0]",
                    first=f"universal input.end middle.start, axes = [[0, 0, 1], [{-sine}, {cosine}, 0]]",
                    second="universal middle.end output.start, axes = [[0, 1, 0], [0, 0, 1]]",
                    shaft="cylindrical ground.rear output.start, axis = [1, 0, 0]"),
        drives=dict(front='speed = "6 rpm", cycle = "360 deg"'),
        loads=dict(brake='torque_at = "shaft", value = "-200 N m"'),
        sensors=dict(torque="drive_torque front", twist="torsional_moment middle.mid", bend="bending_moment middle z",
                     speed='velocity middle angle_x, axes = "body"', turned="position shaft angle"),
        solve=dict(start="periodic", steps=72),
    )  # fmt: skip
    return with_settings(scene_of(text), list(changes))


@pytest.mark.parametrize(("preset", "changes"), [
    ("rigid", ()), ("linear", ()), ("stiffened", ()),
    ("coupled", ("solve.start=quasistatic", "solve.duration=1 ms", "solve.steps=2")),
])  # fmt: skip
def test_a_brake_twists_and_bends_a_double_cardan_shaft(preset, changes):
    """omega_2 / omega_1 = cos(beta) / (1 - s^2), s = sin(beta) sin(phi), phi from where the input's fork stands across
    both shafts' plane; torques go the other way round (Seherr-Thoss, Schmelz & Aucktor 2006, 1.2). A cross passes on
    no moment about its pins: across the middle shaft acts its torque T times tan(alpha) = s / sqrt(1 - s^2), the same
    all along it. By Castigliano's theorem the brake's shaft lags by T^2 L / M (1 / GJ + tan^2(alpha) / EI).

    All ends of shafts stay where they are: their accelerations are rounding's.
    """
    solution = solved(cardan(f"solve.preset={preset}", *changes))
    brake, beta, phi = 200.0, math.radians(25), 2 * math.pi * 0.1 * solution.times
    s = math.sin(beta) * np.sin(phi)
    ratio, tangent, J = math.cos(beta) / (1 - s**2), s / np.sqrt(1 - s**2), math.pi / 32 * (0.06**4 - 0.056**4)
    values = {name: solution[name].values for name in solution.keys()}
    assert values["torque"] == pytest.approx(np.full_like(phi, brake), rel=2e-5)
    assert values["twist"] == pytest.approx(-brake / ratio, rel=2e-5)
    assert values["bend"] == pytest.approx(-brake / ratio * tangent, abs=2e-5 * brake)
    lag = np.angle(np.exp(1j * (phi - values["turned"])))
    if preset == "rigid":
        assert values["speed"] == pytest.approx(0.2 * math.pi * ratio, rel=1e-9) and abs(lag).max() < 1e-9
    else:
        assert lag == pytest.approx(brake / ratio**2 * (2.6 + 2.0 * tangent**2) / (210e9 * J), rel=1e-4)


def test_what_is_wrong_with_a_cardan_shaft_is_said():
    with pytest.raises(SceneError, match=r"'first': a universal joint turns about several axes. Name a revolute or"):
        cardan("loads.brake.torque_at=first")
    with pytest.raises(SceneError, match=r"start: a gap of [\d.e+]+ (mm|deg) remains"):
        load(cardan("ground.rear=[1, 2, 0]", "solve.preset=rigid"))


def test_c_takes_a_motion_whose_shafts_rest_but_for_rounding():
    model = load(cardan("solve.preset=linear"))
    harmonics = harmonics_of(model, range(len(model.module.SCALARS)), "C")
    names = [name for name, *_ in model.module.SCALARS]
    resting = [names[column] for column in harmonics.columns].index("output.link.a_x")
    assert abs(harmonics.numbers[:, resting]).max() < 1e-9


def test_an_unbalanced_disc_whirls_about_its_sag_and_is_drawn(tmp_path, monkeypatch):
    """Of a massless shaft clamped in both bearings, k = 192 EI / L^3 at its middle: it sags by M g / k, and whirls
    about that by m e Omega^2 / (k - M Omega^2), towards the unbalance (Jeffcott 1919)."""
    unrendered(monkeypatch)
    omega, m, e, M = 100 * math.pi, 0.01, 0.05, 5.0
    beam = 'E = "210 GPa", nu = 0.3, rho = 1e-3, section = {circle = "20 mm"}, elements = 2'
    solution = solved(scene_of(machine(
        gravity=[0, 0, "-9.81 m/s^2"], ground=dict(rear=[0.6, 0, 0]),
        bodies=dict(shaft=f"length = 0.6, beam = {{{beam}}}", unbalance=f"mass = {m}, points.hub = [0, {-e}, 0]"),
        masses=dict(disc=f'at = "shaft.mid", mass = {M}, inertia = [0.02, 0.01, 0.01]'),
        joints=dict(front="revolute ground shaft, axis = [1, 0, 0]",
                    rear="cylindrical ground.rear shaft.end, axis = [1, 0, 0]", hub="weld shaft.mid unbalance.hub"),
        drives=dict(front=f'speed = {omega}, cycle = "360 deg"'),
        sensors=dict(y="position shaft.mid y", z="position shaft.mid z"),
        solve=dict(preset="linear", start="periodic", steps=60),
    )))  # fmt: skip
    k = 192 * 210e9 * math.pi / 64 * 0.02**4 / 0.6**3
    sag, whirl = (M + m) * 9.81 / k, m * e * omega**2 / (k - (M + m) * omega**2)
    turned = omega * solution.times
    assert solution["y"].values == pytest.approx(whirl * np.cos(turned), abs=1e-5 * whirl)
    assert solution["z"].values == pytest.approx(whirl * np.sin(turned) - sag, abs=1e-5 * whirl)
    drawn = {picture.stem for picture in draw_all(solution, tmp_path, frames=2)}
    assert drawn >= {"mechanism", "modes", "stress", "animation"}
