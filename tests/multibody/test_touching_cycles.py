"""Motions that repeat where bodies hit each other, or rub: against closed forms of a block that rubs and of a ball."""

import math

import numpy as np
import pytest
from machines import machine

import kaneflex
from kaneflex.integrate.system import Outcome
from kaneflex.solve.simulation import solve
from kaneflex.support.errors import SceneError

PUSH, STIFFNESS = 10.0, 100.0
RUBBING = """
joints.rail = {{prismatic = ["ground", "block"], direction = [1, 0], friction = {{preload = "{friction} N"{law}}}}}
drives.rail = {{free = true}}
springs.spring = {{between = ["ground", "block"], stiffness = "100 N/m", length = 0}}
loads.push = {{force_on = "block", direction = [1, 0], law = "10 * cos(shaft)"}}
"""


def solved(omega, gravity, axis, more):
    text = machine(
        gravity=[0, gravity], bodies=dict(rotor='length = "0.1 m", mass = "1 kg"', block='mass = "1 kg"'),
        joints=dict(shaft="revolute ground rotor"), drives=dict(shaft=f'speed = "{omega} rad/s", cycle = "360 deg"'),
        sensors=dict(x=f"position block {axis}"), solve=dict(preset="coupled", start="periodic", steps=720),
    )
    return solve(kaneflex.load(kaneflex.scene_of(text + more)))


def rubbing(omega, friction, law=""):
    return solved(omega, gravity=0, axis="x", more=RUBBING.format(friction=friction, law=law))


@pytest.mark.parametrize(("ratio", "friction"), [(0.6, 4.0), (0.8, 1.0), (1.25, 1.0), (1.6, 4.0)])
def test_a_block_on_a_spring_that_rubs(ratio, friction):
    """Its largest way by Den Hartog (1931), 1e-5 of it; and how a disturbance shrinks with every turn of its way.

    Between two stands the motion keeps areas of (x, v); where it turns round v scales by the accelerations after and
    before it (Leine and Nijmeijer 2004, saltation). So the product of the multipliers is that of these.
    """
    solution = rubbing(10.0 * ratio, friction)
    V = 1.0 / (1.0 - ratio**2)
    U = math.sin(math.pi / ratio) / (ratio * (1.0 + math.cos(math.pi / ratio)))
    way = PUSH / STIFFNESS * math.sqrt(V**2 - (friction / PUSH * U) ** 2)
    x, times = solution.series["x"].values, solution.times
    assert solution.outcome is Outcome.COMPLETED and solution.trajectory.message == "completed"
    assert x.max() == pytest.approx(way, rel=2e-5) and x.min() == pytest.approx(-way, rel=2e-5)
    driven = PUSH * np.cos(10.0 * ratio * times[x.argmax()]) - STIFFNESS * way
    expected = ((driven + friction) / (driven - friction)) ** 2  # twice a cycle
    assert np.prod(solution.trajectory.floquet).real == pytest.approx(expected, rel=2e-2)
    assert abs(solution.trajectory.floquet).max() < 1.0


def test_a_freedom_that_does_nothing_has_multipliers_too():
    """A wheel at rest on a spring and a damper: exp(-c T / 2 I) is the modulus of both of its multipliers."""
    solution = solved(12.5, gravity=0, axis="x", more=RUBBING.format(friction=1.0, law="") + """
bodies.still = {inertia = 1}
joints.pin = {revolute = ["ground", "still"]}
drives.pin = {free = true}
springs.coil = {torsional_at = "pin", stiffness = 400, damping = 2}
""")
    multipliers = solution.trajectory.floquet
    assert len(multipliers) == 4
    modulus = math.exp(-2 * math.pi / 12.5)
    assert (abs(abs(multipliers) - modulus) < 1e-3 * modulus).sum() == 2


BALL = """
bodies.table = {length = "10 mm", mass = "1 kg"}
joints.guide = {prismatic = ["ground", "block"], direction = [0, 1]}
joints.bed = {prismatic = ["ground", "table"], direction = [0, 1]}
contacts.hit.point_on_line = ["block", "table"]
contacts.hit.normal = [0, 1]
"""


OMEGA, E, G = 40.0, 0.6, 9.81
PERIOD = 2 * math.pi / OMEGA
THROWN = 0.5 * G * PERIOD
TABLE = THROWN * (1 - E) / (1 + E)
"""Speeds of a ball that is thrown once a cycle, and of the table as it hits (Holmes 1982)."""


def ball(phase, share):
    """The table goes at 1.25 TABLE at most; the ball begins at a share of where it is on its cycle."""
    size, left = 1.25 * TABLE / OMEGA, PERIOD - phase / OMEGA
    place = size * math.sin(phase) + THROWN * left - 0.5 * G * left**2
    return solved(OMEGA, gravity=-9.81, axis="y", more=BALL + f"""
drives.bed = {{law = "{size} * sin({OMEGA} * t)"}}
drives.guide = {{free = true, position = "{share * place} m", initial_speed = "{THROWN - G * left} m/s"}}
contacts.hit.contact = {{law = "newton", restitution = {E}}}
""")


def test_a_ball_on_a_table_that_shakes():
    """It is found where the table goes on rising, but ever slower. Each impact shrinks areas of (x, v) by e^2, which is
    the product of the multipliers."""
    phase = math.acos(1 / 1.25)
    solution = ball(phase, 1.02)
    (impact,) = solution.impacts
    assert solution.trajectory.message == "completed"
    assert impact.begin == pytest.approx(phase / OMEGA, rel=1e-4)
    assert impact.approach == pytest.approx(THROWN + TABLE, rel=1e-5)
    assert np.prod(solution.trajectory.floquet).real == pytest.approx(E**2, rel=1e-2)
    assert abs(solution.trajectory.floquet).max() < 1.0


def test_where_the_table_rises_ever_faster_disturbances_grow():
    solution = ball(2 * math.pi - math.acos(1 / 1.25), 1.0)
    assert solution.outcome is Outcome.UNSTABLE and "unstable" in solution.message
    assert np.prod(solution.trajectory.floquet).real == pytest.approx(E**2, rel=1e-2)
    assert solution.trajectory.floquet[0].real > 1.2


def test_a_contact_is_named_as_the_owner_of_its_bristles():
    more = """
drives.bed = {law = "1e-3 * sin(40 * t)"}
drives.guide = {free = true, position = "10 mm"}
contacts.hit.contact = {stiffness = 1e6, restitution = 0.5}
contacts.hit.friction = {law = "lugre", mu = 0.1, bristle_stiffness = "1e4 N/m"}
"""
    with pytest.raises(SceneError, match=r"with contacts\.hit\.friction a cycle would start without the bristle"):
        solved(OMEGA, gravity=-9.81, axis="y", more=BALL + more)


def test_bristles_are_not_carried_from_cycle_to_cycle():
    with pytest.raises(SceneError, match=r"with joints\.rail\.friction a cycle would start without the bristle states"):
        rubbing(8.0, 1.0, ', law = "lugre", bristle_stiffness = "1e4 N/m"')
