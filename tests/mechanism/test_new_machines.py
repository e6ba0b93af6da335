"""Machines as a new user writes them: their numbers in closed form, and what is said where something doesn't go."""

import math
import re

import numpy as np
import pytest
from command_line import cli, unrendered
from machines import machine
from runs import solved

from kaneflex import SceneError, scene_of
from kaneflex.mechanism.closure_continuation import followed
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.position_analysis import place
from kaneflex.report.presentation import parts, printed

PEAUCELLIER = machine(
    description="Peaucellier's straight-line linkage", ground=dict(fix=[0, 0], centre=["100 mm", 0]),
    bodies=dict(crank='length = "100 mm", mass = "0.1 kg"',
                arm_up='length = "300 mm", beam = {material = "steel", section = {rectangle = ["8 mm", "4 mm"]}}',
                arm_down='length = "300 mm", mass = "0.1 kg"', near_up='length = "120 mm", mass = "0.05 kg"',
                near_down='length = "120 mm", mass = "0.05 kg"', far_up='length = "120 mm", mass = "0.05 kg"',
                far_down='length = "120 mm", mass = "0.05 kg"'),
    joints=dict(main="revolute ground.centre crank.start", fix_up="revolute ground.fix arm_up.start",
                fix_down="revolute ground.fix arm_down.start", in_up="revolute crank.end near_up.start",
                up='revolute near_up.end arm_up.end, branch = "-"', in_down="revolute crank.end near_down.start",
                down='revolute near_down.end arm_down.end, branch = "+"', far_u="revolute near_up.end far_up.start",
                far_d="revolute arm_down.end far_down.start", pen='revolute far_up.end far_down.end, branch = "+"'),
    drives=dict(main='law = "0.5*sin(2*pi*t)", period = "1 s"'),
    sensors=dict(x="position far_up.end x", y="position far_up.end y"), solve='preset = "PRESET"',
)

WIPER = machine(
    description="A windscreen wiper that rubs", ground=dict(pivot=["240 mm", 0]),
    bodies=dict(crank='length = "35 mm", mass = "0.1 kg"', link='length = "235 mm", mass = "0.15 kg"',
                rocker='length = "60 mm", mass = "0.1 kg"',
                arm='length = "550 mm", beam = {material = "steel", section = {rectangle = ["12 mm", "6 mm"]}}'),
    joints=dict(motor="revolute ground crank.start", pin="revolute crank.end link.start",
                spindle="revolute ground.pivot rocker.start", ball='revolute link.end rocker.end, branch = "+"',
                hub='weld rocker.start arm.start, relative_angle = "30 deg"'),
    drives=dict(motor='speed = "60 rpm", cycle = "360 deg"'),
    sensors=dict(wipe="position spindle angle", torque="drive_torque motor", link="joint_force ball x"),
    solve=dict(preset="coupled", steps=120),
)

BOOM = """
schema = 1
ground = {base = ["600 mm", "-400 mm"]}
bodies.boom = {length = "2.5 m", mass = "500 kg"}
bodies.barrel = {length = "1.5 m", mass = "120 kg"}
bodies.rod = {length = "1.4 m", mass = "60 kg"}
joints.foot = {revolute = ["ground", "boom.start"]}
joints.base = {revolute = ["ground.base", "barrel.start"]}
joints.cylinder = {prismatic = ["barrel.start", "rod.start"], direction = [1, 0]}
joints.eye = {revolute = ["rod.end", "boom.end"], WAY}
drives.cylinder = {law = "0.6 + 0.6*step(t, 0, 0, 3, 1)"}
sensors.stroke = {position = "cylinder", component = "x"}
solve = {preset = "rigid", duration = "5 s"}
"""


def test_peaucelliers_pen_draws_a_straight_line_though_an_arm_of_it_is_a_beam():
    """At (L^2 - l^2) / (2 r). No elastic stage can follow it: the rigid run says so in place of its errors."""
    solution = solved(scene_of(PEAUCELLIER.replace("PRESET", "rigid")))
    assert solution["x"].values == pytest.approx((0.3**2 - 0.12**2) / 0.2, abs=1e-12)
    assert np.ptp(solution["y"].values) > 0.15
    errors, why = solution.errors
    assert not errors and "far_u and pen connect it to rigid bodies that move apart as links deform" in why
    assert "Use preset" not in why


def test_show_does_not_advise_the_preset_that_is_taken(tmp_path, monkeypatch):
    unrendered(monkeypatch)
    path = tmp_path / "machine.toml"
    for preset, warns in (("coupled", False), ("stiffened", True)):
        path.write_text(PEAUCELLIER.replace("PRESET", preset))
        shown = cli("show", str(path), "-o", str(tmp_path / f"{preset}.png"))
        assert ("Use preset coupled" in shown.stderr) == warns, shown.stderr
    at_ends = [f"minimum at main = {sign}28.6479 deg" for sign in ("", "-")]  # which swings, and is never at 331 deg
    assert any(each in shown.stdout for each in at_ends)  # both ends are equal, but for rounding


def test_loads_by_laws_in_other_joints_are_in_what_the_rigid_mechanism_is_said_to_do():
    """Friction and a spring at the spindle, once by a law and once as a spring and damper of preset rigid.

    The wiper's sweep is between the crank's two dead centres, by the law of cosines.
    """
    law = 'loads.rub = {torque_at = "spindle", law = "-0.3*spindle_speed - 2*(spindle - 1)"}\n'
    spring = 'springs.rub = {torsional_at = "spindle", stiffness = 2, angle = 1, damping = 0.3}\n'
    told = solved(scene_of(WIPER + law))
    known = solved(scene_of(WIPER + spring), "solve.preset=rigid")
    for name in ("torque", "link"):
        right = known[name].values
        assert told[f"{name}_rigid"].values == pytest.approx(right, abs=1e-8 * abs(right).max()), name
    assert float(known["torque"][:-1].mean()) > 0.05  # the friction's work
    ends = [math.pi - math.acos((0.24**2 + 0.06**2 - s**2) / (2 * 0.24 * 0.06)) for s in (0.2, 0.27)]
    wipe = known["wipe"].values
    assert [wipe.max(), wipe.min()] == pytest.approx(ends, abs=1e-3)
    assert known["wipe"].long_name == "position of joint spindle, rotation"


def test_a_cylinder_that_dwells_is_followed():
    """At rest the tangent step is zero, and what Newton's method corrects is rounding, not a lock."""
    boom = scene_of(BOOM.replace("WAY", 'near = {boom = "6 deg"}'))
    courses = followed(mechanism_of(boom), place(mechanism_of(boom)))
    eye = 2.5 * np.exp(1j * courses["boom"][2])
    assert abs(eye - (0.6 - 0.4j))[[0, -1]] == pytest.approx([2.0, 2.6], abs=1e-9)
    assert "closes a loop, boom near 6 deg" in printed(boom, parts(boom))


def test_a_loop_of_three_bodies_asks_for_near_where_branch_was_given():
    said = "branch applies to loops of two bodies only. Choose one, like near = {boom = '6 deg'}:\n  boom 6"
    with pytest.raises(SceneError, match=re.escape(said)):
        place(mechanism_of(scene_of(BOOM.replace("WAY", 'branch = "+"'))))


def test_the_speed_of_a_joint_is_refused_by_the_name_that_was_written():
    text = BOOM.replace("WAY", 'near = {boom = "6 deg"}').replace('{position = "cylinder"', '{velocity = "cylinder"')
    said = (
        "sensors.stroke.velocity = 'cylinder': a joint has no velocity. Read the "
        "position of cylinder, or the velocity of a body's point."
    )
    with pytest.raises(SceneError, match=re.escape(said)):
        scene_of(text)


def test_a_point_of_the_users_where_a_joint_is_does_not_lie_there_by_chance():
    named = WIPER.replace('mass = "0.15 kg"', 'mass = "0.15 kg", points = {eye = ["235 mm", 0]}')
    machine = scene_of(named)
    from kaneflex.mechanism.closure import reach_lines

    of = mechanism_of(machine)
    assert "coincide" not in reach_lines(of, followed(of, place(of)))
