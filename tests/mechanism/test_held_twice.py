"""Joints that hold something twice: the motion is that without them, what they share is no number."""

from contextlib import nullcontext

import numpy as np
import pytest
from machines import machine
from runs import solved
from test_mobility import CARRIED_RHOMBUS, TAIL, THREE_CRANKS, TWO_GUIDES

import kaneflex
from kaneflex import SceneError, scene_of
from kaneflex.integrate.system import Outcome
from kaneflex.solve.variants import Variants

COUPLED = '\nsolve = {preset = "coupled", duration = "0.5 s", steps = 100}\n'
FREE = ("main = {speed = \"60 rpm\", cycle = \"360 deg\"}", 'main = {free = true, angle = "60 deg"}')
ROCKED = FREE[0], 'main = {law = "1 + 0.3 * sin(6 * t)"}'
WEIGHT = '\ngravity = [0, "-9.81 m/s^2"]\n'
SENSORS = '\nsensors.x = {position = "bar.end", component = "x"}\nsensors.y = {position = "bar.end", component = "y"}\n'


def swung(text):
    solution = solved(scene_of(text))
    assert solution.outcome is Outcome.COMPLETED, solution.message
    return solution


def test_a_third_parallel_crank_falls_with_the_others():
    """One degree of freedom, by hand: I phi'' = -g (3 m/2 + M) l cos phi; it passes the change point at 0 deg."""
    text = THREE_CRANKS.replace(*FREE).replace("schema = 1", "schema = 1" + WEIGHT) + SENSORS + COUPLED
    solution = swung(text)
    from scipy.integrate import solve_ivp

    m, M, l, g = 0.1, 0.3, 0.05, 9.81
    inertia = 3 * m * l**2 / 3 + M * l**2
    found = solve_ivp(
        lambda t, x: [x[1], -g * (1.5 * m + M) * l * np.cos(x[0]) / inertia], (0.0, 0.5), [np.radians(60.0), 0.0],
        "DOP853", solution.times, rtol=1e-10, atol=1e-10,
    )  # fmt: skip
    assert solution.series["x"].values == pytest.approx(0.4 + l * np.cos(found.y[0]), abs=2e-6)
    energy = solution.trajectory.energy
    total = energy.kinetic + energy.strain + energy.weight
    assert abs(total - total[0]).max() < 1e-7 * energy.kinetic.max()


def test_what_three_cranks_share_is_no_number():
    """Three cranks bear the bar as two would."""
    text = THREE_CRANKS.replace(*ROCKED) + COUPLED
    model = kaneflex.load(scene_of(text))
    assert set(model.coupled.undetermined) >= {"far_pin.force_x", "far_pin.force_y", "middle_pin.force_y"}
    sensor = '\nsensors.bearing = {joint_force = "far", component = "y", axes = "global"}\n'
    with pytest.raises(SceneError, match=r"sensors.bearing.*far_pin.*statically indeterminate.*give .* a beam"):
        kaneflex.load(scene_of(text + sensor))


def test_presets_that_need_one_joint_each_refuse_it_after_a_coupled_point():
    variants = Variants(scene_of(THREE_CRANKS.replace(*ROCKED) + COUPLED))
    variants.load(["solve.steps=50"])
    with pytest.raises(SceneError, match=r"redundant|too many"):
        variants.load(["solve.preset=rigid"])


def test_the_drive_of_three_cranks_is_determined():
    """One degree of freedom: torque = I phi'' + g (3 m/2 + M) l cos phi."""
    text = THREE_CRANKS.replace(*ROCKED).replace("schema = 1", "schema = 1" + WEIGHT) + COUPLED
    solution = swung(text + '\nsensors.torque = {drive_torque = "main"}\n')
    phi, inertia = 1.0 + 0.3 * np.sin(6.0 * solution.times), 0.1 * 0.05**2 + 0.3 * 0.05**2
    expected = 9.81 * 0.05 * (1.5 * 0.1 + 0.3) * np.cos(phi) - 10.8 * inertia * np.sin(6.0 * solution.times)
    assert solution.series["torque"].values == pytest.approx(expected, abs=1e-9)


def test_two_guides_in_line_hold_a_cart():
    text = TWO_GUIDES.replace("left = {speed = \"1 m/s\"}", "left = {law = \"0.1 * sin(10 * t)\"}")
    text += 'solve.preset = "coupled"\nsolve.steps = 100\n'
    solution = swung(text + 'sensors.force = {drive_force = "left"}\n')
    assert solution.series["force"].values == pytest.approx(-10.0 * np.sin(10.0 * solution.times), abs=1e-9)
    assert {"left.normal", "left.moment", "right.normal", "right.moment"} == set(solution.model.coupled.undetermined)


def test_cranks_that_do_not_fit_are_refused():
    text = THREE_CRANKS.replace('third = {length = "50 mm"', 'third = {length = "52 mm"') + COUPLED
    with pytest.raises(SceneError, match="far"):
        kaneflex.load(scene_of(text))


def test_a_rhombus_of_rigid_bars_on_an_elastic_arm():
    """Symmetric about its diagonal: what opens it does the work that its energies gain."""
    solution = swung(CARRIED_RHOMBUS + 'solve.preset = "coupled"\nsolve.steps = 200')
    energy = solution.trajectory.energy
    balance = energy.kinetic + energy.strain + energy.weight + energy.dissipated - energy.supplied
    assert abs(balance - balance[0]).max() < 1e-6 * abs(energy.kinetic).max()


CYLINDER = machine(
    gravity=[0, "-9.81 m/s^2"], ground=dict(foot=["0.5 m", "-0.5 m"]),
    bodies=dict(boom='length = "2 m", beam = {material = "steel", A = "1000 mm^2", I = "200000 mm^4"}, '
                     'points = {lug = ["1 m", 0]}', barrel='length = "0.5 m", mass = "2 kg"',
                rod='length = "0.5 m", mass = "1 kg"'),
    joints=dict(pivot="revolute ground boom.start", foot="revolute ground.foot barrel.start",
                cylinder="prismatic barrel rod.start, direction = [1, 0]",
                head='revolute rod.end boom.lug, near = {boom = "3 deg"}'),
    drives=dict(cylinder='law = "0.25 + 0.02 * sin(10 * t)"'),
    sensors=dict(tip="position boom.end y", push="drive_force cylinder"),
    solve=dict(preset="coupled", duration="0.3 s", steps=100),
)


@pytest.mark.parametrize("text", [
    CYLINDER, TAIL.replace("solve = {", 'solve = {preset = "coupled", '),
], ids=["a cylinder on an elastic boom", "a free joint beside a drive"])  # fmt: skip
def test_what_no_rigid_motion_leads_keeps_the_balance_of_energy(text):
    energy = swung(text).trajectory.energy
    balance = energy.kinetic + energy.strain + energy.weight + energy.dissipated - energy.supplied
    assert abs(balance - balance[0]).max() < 1e-7 * energy.kinetic.max()


SLED = machine(
    gravity=["-9.81 m/s^2", 0], ground=dict(h=[0, "0.2 m"]),
    bodies=dict(sled='mass = "1 kg", inertia = "0.01 kg m^2", points = {up = [0, "0.2 m"]}'),
    joints=dict(G="prismatic ground sled, direction = [1, 0]", H="prismatic ground.h sled.up, direction = [1, 0]"),
    drives=dict(G="free = true"), sensors=dict(s="position G"),
    solve=dict(preset="coupled", duration="0.5 s", steps=50),
)


@pytest.mark.parametrize("direction", [(1, 0), (1, 1), (0.3, -0.7), (-0.6, 0.8)])
def test_two_equal_guides_in_any_direction(direction):
    """Rounding must not have the second guide's row for one of its own."""
    solution = swung(SLED.replace("[1, 0]", str(list(direction))))
    along = -9.81 * direction[0] / np.hypot(*direction)
    assert solution.series["s"].values == pytest.approx(along * solution.times**2 / 2.0, abs=1e-9)


TWICE_GUIDED = machine(
    gravity=[0, "-9.81 m/s^2"], ground=dict(h=[0, "0.2 m"]),
    bodies=dict(crank='length = "0.1 m", mass = "0.5 kg"', rod='length = "0.3 m", mass = "0.4 kg"',
                slider='mass = "1 kg", inertia = "0.01 kg m^2", points = {up = [0, "0.2 m"]}'),
    joints=dict(A="revolute ground crank.start", B="revolute crank.end rod.start", C="revolute rod.end slider",
                G='prismatic ground slider, direction = [1, 0], branch = "+"',
                H="prismatic ground.h slider.up, direction = [1, 0]"),
    drives=dict(A='free = true, angle = 1.0, initial_speed = "2 rad/s"'), sensors=dict(phi="position A angle"),
    solve=dict(preset="coupled", duration="0.3 s", steps=50),
)


@pytest.mark.parametrize("branch", ["+", "-"])
def test_a_second_guide_on_a_slider_changes_nothing(branch):
    text = TWICE_GUIDED.replace('branch = "+"', f'branch = "{branch}"')
    single = text.replace('joints.H = {prismatic = ["ground.h", "slider.up"], direction = [1, 0]}\n', "")
    twice, once = (swung(each) for each in (text, single))
    assert twice.series["phi"].values == pytest.approx(once.series["phi"].values, abs=1e-7)


THREE_LEGS = machine(
    gravity=[0, "-9.81 m/s^2"], ground=dict(g2=["0.3 m", 0], g3=["0.15 m", "0.2 m"]),
    bodies=dict(plate='mass = "3 kg", inertia = "0.05 kg m^2", centre = ["0.15 m", "0.05 m"], '
                      'points = {p1 = [0, 0], p2 = ["0.3 m", 0], p3 = ["0.15 m", "0.2 m"]}',
                c1='length = "0.1 m", mass = "0.5 kg"', c2='like = "c1"', c3='like = "c1"'),
    joints=dict(g_1="revolute ground c1.start", g_2="revolute ground.g2 c2.start", g_3="revolute ground.g3 c3.start",
                p_1="revolute c1.end plate.p1", p_2="revolute c2.end plate.p2, near = {c2 = 1.0}",
                p_3="revolute c3.end plate.p3, near = {c3 = 1.0}"),
    drives=dict(g_1='free = true, angle = 1.0, initial_speed = "3 rad/s"'), sensors=dict(phi="position g_1 angle"),
    solve=dict(preset="coupled", duration="1 s", steps=200, tolerance=1e-9),
)


def test_rows_that_come_to_say_the_same_are_changed_for_others():
    """Two of the three cranks are in line with their plate at 0 deg, where the third one leads on."""
    from scipy.integrate import solve_ivp

    solution = swung(THREE_LEGS)
    m, M, l, g = 0.5, 3.0, 0.1, 9.81
    inertia = m * l**2 + M * l**2
    found = solve_ivp(
        lambda t, x: [x[1], -g * (1.5 * m + M) * l * np.cos(x[0]) / inertia], (0.0, 1.0), [1.0, 3.0], "DOP853",
        solution.times, rtol=1e-11, atol=1e-11,
    )  # fmt: skip
    assert found.y[0].max() > 1.0 and found.y[0].min() < -3.0
    assert solution.series["phi"].values == pytest.approx(found.y[0], abs=1e-6)


def test_driven_cranks_pass_their_change_points():
    """A row that is small all over must not be kept for one that is not."""
    free, driven = '{free = true, angle = 1.0, initial_speed = "3 rad/s"}', '{speed = "20 rad/s", angle = 1.0}'
    text = THREE_LEGS.replace(free, driven).replace('duration = "1 s", steps = 200', 'duration = "0.4 s", steps = 80')
    solution = swung(text + 'sensors.x = {position = "plate", component = "x"}')
    assert solution.series["x"].values == pytest.approx(0.1 * np.cos(1.0 + 20.0 * solution.times), abs=1e-9)


SPATIAL_CRANKS = """
schema = 1
description = "A bar on parallel cranks in space, the third one of another length"
gravity = [0, -9.81, 0]
solve = {{preset = "rigid", duration = "0.3 s", steps = 60}}
ground = {{b = ["100 mm", 0, 0], c = ["50 mm", {foot}, 0]}}
bodies.bar = {{length = "100 mm", mass = 0.1, inertia = [1e-5, 1e-5, 1e-5]}}
bodies.one = {{length = "50 mm", mass = 0.1, inertia = [1e-5, 1e-5, 1e-5], rotation = {upright}}}
bodies.two = {{length = "50 mm", mass = 0.1, inertia = [1e-5, 1e-5, 1e-5], rotation = {upright}}}
bodies.three = {{length = "{third}", mass = 0.1, inertia = [1e-5, 1e-5, 1e-5], rotation = {upright}}}
joints.a = {{revolute = ["ground", "one"], axis = [0, 0, 1]}}
joints.b = {{revolute = ["ground.b", "two"], axis = [0, 0, 1]}}
joints.c = {{revolute = ["ground.c", "three"], axis = [0, 0, 1]}}
joints.p = {{revolute = ["one.end", "bar"], axis = [0, 0, 1]}}
joints.q = {{revolute = ["two.end", "bar.end"], axis = [0, 0, 1]}}
joints.r = {{revolute = ["three.end", "bar.mid"], axis = [0, 0, 1]}}
drives.a = {{free = true, initial_speed = "1 rad/s"}}
sensors.x = {{position = "bar.mid", component = "x"}}
"""


@pytest.mark.parametrize("third, foot, stops", [("50 mm", 0, False), ("60 mm", '"-10 mm"', True)])
def test_a_run_in_space_stops_where_redundant_constraints_no_longer_agree(third, foot, stops):
    """A third crank fits everywhere if it is as long as the others, else only while all are parallel at the start."""
    upright = '{axis = [0, 0, 1], angle = "90 deg"}'
    scene = scene_of(SPATIAL_CRANKS.format(third=third, foot=foot, upright=upright))
    with pytest.raises(SceneError, match="a constraint of r is redundant, and violated") if stops else nullcontext():
        kaneflex.simulate(kaneflex.load(scene))
