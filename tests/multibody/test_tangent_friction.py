"""Friction in the tangent plane of contacts in space: planar scenes lifted and turned, closed forms and quadrature."""

import math

import numpy as np
import pytest
from machines import changed, machine
from parity import planar
from runs import alike, solved
from scipy.integrate import solve_ivp
from test_spatial_contacts import BALL_CRANK, LOOSE, both, estimated

from kaneflex import scene_of, with_settings
from kaneflex.multibody.model.layout import STICKING
from kaneflex.response.dalembert import Balance
from kaneflex.response.section_forces import LinkForces

RUBBED = LOOSE.replace("restitution = 0.9}}", 'restitution = 0.9}, friction = {mu = 0.1}, radius = "10 mm"}')
BOUNCING = machine(
    description="A disc that spins and bounces", gravity=[0, -9.81],
    bodies=dict(ball="mass = 2, inertia = 0.002, free = {at = [0, 0.15], velocity = [1, 0], angular_speed = 30}"),
    contacts=dict(floor='point_on_line = ["ball", "ground"], normal = [0, 1], radius = "50 mm", '
                        'contact = {stiffness = "1e6 N/m^1.5", restitution = 0.5}, friction = {mu = 0.2}'),
    sensors=dict(push="contact_force floor"),
    solve=dict(preset="coupled", duration="1.2 s", steps=300, tolerance=1e-10),
)
THROWN = """
schema = 1
description = "A puck thrown over a plane"
gravity = [0, 0, -9.81]
contacts.floor.point_on_plane = ["puck", "ground"]
contacts.floor.normal = NORMAL
contacts.floor.radius = RADIUS
contacts.floor.contact = {law = "kelvin-voigt", stiffness = "1e5 N/m", exponent = 1, damping = "800 N s/m"}
contacts.floor.friction = {mu = MU}
sensors.drag = {friction_force = "floor"}
solve = {preset = "coupled", duration = "1.5 s", steps = 150, tolerance = 1e-10}
bodies.puck = {mass = 2, inertia = [J, J, J], free = {at = [0, 0, RADIUS], velocity = VELOCITY}}
sensors.x = {KIND = "puck", component = "x", axes = "global"}
sensors.y = {KIND = "puck", component = "y", axes = "global"}
sensors.z = {KIND = "puck", component = "z", axes = "global"}
"""


def thrown(**given):
    text = THROWN
    for key, value in given.items():
        text = text.replace(key, str(value))
    return solved(scene_of(text))


@pytest.mark.exhaustive(share=7)
@pytest.mark.parametrize("turn", "abcdefghijklmnopqrst")
@pytest.mark.parametrize(("text", "sensors"), [(RUBBED, ("slide", "torque", "push")), (BOUNCING, ("push",))])
def test_contacts_rub_as_in_the_plane(text, sensors, turn):
    """With the same sticking and slipping, whichever way the plane is turned."""
    plane, space = both(scene_of(text), turn)
    assert len(space.impacts) == len(plane.impacts) > 2
    for one, other in zip(space.impacts, plane.impacts, strict=True):
        assert one.begin == pytest.approx(other.begin, abs=1e-8)
        assert (one.peak, one.lost) == (pytest.approx(other.peak, rel=2e-6), pytest.approx(other.lost, abs=1e-7))
    for sensor in sensors:
        assert abs(space[sensor].values - plane[sensor].values).max() <= estimated(plane, space, sensor)
    one, other = (each.trajectory.frictions for each in (plane, space))
    assert (one.mode == other.mode).all()
    assert other.force == pytest.approx(abs(one.force), abs=1e-6 * other.force.max())
    assert other.lost == pytest.approx(one.lost, abs=1e-6 * one.lost.max())
    assert space.trajectory.energy.drift < 1e-8


def test_a_sphere_slips_then_rolls():
    """It keeps 5/7 of its speed, whatever the normal force, and loses the rest of its energy."""
    found = thrown(NORMAL="[0, 0, 1]", RADIUS=0.05, MU=0.2, J=0.002, VELOCITY="[3, 0.4, 0]", KIND="velocity")
    rubs, speed = found.trajectory.frictions, math.hypot(3.0, 0.4)
    rolls = found.times > 2 / 7 * speed / (0.2 * 9.81) + 1e-3
    assert found["x"].values[rolls] == pytest.approx(15 / 7, rel=1e-8)
    assert found["y"].values[rolls] == pytest.approx(2 / 7, rel=1e-8)
    assert rubs.speed[rolls] == pytest.approx(0.0, abs=1e-12) and found["drag"].values[rolls] == pytest.approx(0.0)
    assert rubs.lost[-1] == pytest.approx(2 / 7 * speed**2, rel=1e-8)
    assert found.trajectory.energy.drift < 1e-10


def test_a_sphere_rolls_in_a_circle_on_a_turntable():
    """At 2/7 of the table's speed, round a centre that its start gives: friction acts at the point of touch, so its
    moment of momentum about that point, K = J w + m R n x v, stays the same as it slips.
    """
    text = changed(
        THROWN, ('["puck", "ground"]', '["puck", "table"]'),
        ("VELOCITY}", "[0.2, 0, 0], angular_velocity = [0, 4, 0]}"),
        ("NORMAL", "[0, 0, 1]"), ("RADIUS", "0.05"), ("MU", "0.5"), ("J", "0.002"), ("KIND", "velocity"),
        ("", "bodies.table = {mass = 5, inertia = [0.1, 0.1, 0.2]}"),
        ("", 'joints.pivot = {revolute = ["ground", "table"], axis = [0, 0, 1]}\ndrives.pivot = {speed = "5 rad/s"}'),
        ("", 'sensors.place_x = {position = "puck", component = "x", axes = "global"}'),
        ("", 'sensors.place_y = {position = "puck", component = "y", axes = "global"}'),
        ("at = [0, 0,", "at = [0.3, 0,"),
    )  # fmt: skip
    found = solved(scene_of(text))
    u, v, x, y = (found[name].values for name in ("x", "y", "place_x", "place_y"))
    rolls = found.trajectory.frictions.mode[:, 0] == STICKING
    centre, rate = 0.05 * (0.002 * 4.0 + 2.0 * 0.05 * 0.2) / (0.002 * 5.0), 2 / 7 * 5.0
    assert not rolls[0] and rolls[10:].all()
    assert u[rolls] == pytest.approx(-rate * (y[rolls] - centre), abs=1e-8)
    assert v[rolls] == pytest.approx(rate * x[rolls], abs=1e-8)
    assert found.trajectory.energy.drift < 1e-9


@pytest.mark.parametrize("mu", [0.2, 0.6])
def test_a_body_thrown_sideways_on_a_tilted_plane(mu):
    """Its slip turns downhill; on the rougher plane it stops and sticks by its weight along the plane."""
    n = np.array([0.0, -0.28, 0.96])
    start = np.array([1.5, 0.4, 0.4 * 0.28 / 0.96])
    found = thrown(NORMAL=n.tolist(), RADIUS=0.0, MU=mu, J=1e9, VELOCITY=start.tolist(), KIND="position")

    def rates(_, state):
        rate = n @ state[3:]
        push = max(-1e5 * (n @ state[:3]) - 800.0 * rate, 0.0)
        slip = state[3:] - rate * n
        drag = -mu * push * slip / max(np.linalg.norm(slip), 1e-300)
        return [*state[3:], *(np.array([0.0, 0.0, -9.81]) + (push * n + drag) / 2.0)]

    moves = found.times if mu < 0.28 else found.times[:30]
    told = {"rtol": 1e-11, "atol": 1e-13, "t_eval": moves}
    exact = solve_ivp(rates, (0.0, moves[-1]), [0.0, 0.0, 0.0, *start], method="Radau", **told).y
    for k, axis in enumerate("xyz"):
        assert found[axis].values[: len(moves)] == pytest.approx(exact[k], abs=1e-8)
    if mu > 0.28:
        assert found["drag"].values[-1] == pytest.approx(2 * 9.81 * 0.28, rel=1e-9)
        assert found.trajectory.frictions.lost[-1] > found.trajectory.frictions.lost[29]
    assert found.trajectory.energy.drift < 1e-10


def test_a_loose_ball_that_rubs_loses_more():
    """Its slip turns within the tangent plane, and both rows close the energy balance."""
    law = '{materials = ["steel", "steel"], restitution = 0.6}'
    text = BALL_CRANK.replace("CONTACT", law)
    smooth, rough = solved(scene_of(text)), solved(scene_of(text.replace("0.6}}", "0.6}, friction = {mu = 0.15}}")))
    rubs = rough.trajectory.frictions
    assert (rubs.force <= 0.15 * rubs.pressed * (1 + 1e-9) + 1e-12).all()
    assert rubs.lost[-1, 0] > 0.0 and (np.diff(rubs.lost[:, 0]) > -1e-12).all()
    assert rough.trajectory.energy.drift < 1e-7
    assert smooth.outcome is rough.outcome


def test_friction_bends_an_elastic_bar_as_in_the_plane():
    """It acts at the sphere's surface; sensors leave axial vibration out, except while friction sticks."""
    given = "solve.duration=0.12 s", "solve.modes=2", "contacts.stop.friction={mu=0.3}"
    plane, space = both(with_settings(planar("bouncing-bar", "coupled"), given), "bar")
    one, other = (each.trajectory.frictions for each in (plane, space))
    assert (one.mode == other.mode).all() and len(space.impacts) == len(plane.impacts) > 3
    assert other.force == pytest.approx(abs(one.force), abs=1e-5 * other.force.max())
    alike(space, plane, 1e-6, ("angle", "root_force", "moment"))
    moving = plane.motion.moving
    balance = Balance(moving, "bar", lambda: LinkForces(moving.mechanism, moving).wrenches("bar"))
    moment = balance.section(0.25)[2]
    stuck = one.mode[:, 0] == STICKING
    assert stuck.sum() > 3
    assert plane["moment"].values[stuck] == pytest.approx(moment[stuck], abs=1e-9 * abs(moment).max())
    assert plane["moment"].values == pytest.approx(moment, abs=0.05 * abs(moment).max())
