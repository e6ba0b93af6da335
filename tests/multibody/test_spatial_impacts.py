"""Newton's law of impact in space: planar scenes lifted and turned, impulses by an independent solver, closed forms."""

import math

import numpy as np
import pytest
import test_rigid_contacts
import test_rigid_friction
from lifting import lifted
from parity import random_turn
from runs import solved
from scipy.integrate import solve_ivp
from test_impacts_turned import TURNED, Units, ran
from test_spatial_clearances import BLOCK, ROTOR
from test_spatial_contacts import BALL_CRANK

from kaneflex import load, scene_of, simulate

G = 9.81
LAW = '{law = "newton", restitution = 0.6}'
RUBS = f"{LAW}, friction = {{mu = 0.1}}"
BOWL = """
schema = 1
description = "A ball slides in a bowl, or moves on a turntable"
gravity = [0, 0, -9.81]
bodies.ball = {mass = 2, inertia = [5e-3, 5e-3, 5e-3], free = {at = AT, velocity = VELOCITY}}
sensors.push = {contact_force = "c"}
sensors.x = {velocity = "ball", component = "x", axes = "global"}
sensors.y = {velocity = "ball", component = "y", axes = "global"}
solve = {preset = "coupled", duration = "0.3 s", steps = 100, tolerance = 1e-10}
"""
TURNTABLE = """
bodies.table = {mass = 1, inertia = [1, 1, 1]}
joints.axle = {revolute = ["ground.origin", "table"], axis = [0, 0, 1]}
drives.axle = {speed = "4 rad/s"}
contacts.c = {point_on_plane = ["ball", "table"], normal = [0, 0, 1], radius = RADIUS, contact = {law = "newton", restitution = 0}, friction = {mu = MU}}
"""  # noqa: E501


@pytest.mark.parametrize("name", ["DISC", "BLOCK", "BOX", "RIGID_ROD", "BALL", "BAR", "PLAY"])
def test_rigid_sides_in_space_meet_as_in_the_plane(name):
    """The same impacts at the same times, with the same impulses and losses; frictions lose the same energy."""
    text = getattr(test_rigid_friction, name, None) or getattr(test_rigid_contacts, name)
    flat = scene_of(text)
    plane, space = solved(flat), solved(scene_of(lifted(flat, random_turn(name)) | {"solve": flat.raw["solve"]}))
    assert len(space.impacts) == len(plane.impacts) > 0
    for one, other in zip(space.impacts, plane.impacts, strict=True):
        assert (one.contact, one.begin) == (other.contact, pytest.approx(other.begin, abs=1e-8))
        assert one.lost == pytest.approx(other.lost, rel=1e-5, abs=1e-9)
    assert plane.impacts[0].impulse == pytest.approx(space.impacts[0].impulse, rel=1e-7)
    lost = (each.trajectory.frictions.lost[-1].sum() for each in (plane, space))
    assert next(lost) == pytest.approx(next(lost), rel=1e-5)
    assert space.trajectory.energy.drift < 1e-5


def impulses(feet, inertia, v, w, mu, e):
    """Velocity and angular velocity after a body of mass 1 lands on all feet, normals along z, by Uzawa's method for
    cones of friction (De Saxce & Feng 1998, Math. Comput. Modelling 28, 225)."""
    rows = [np.hstack([np.eye(3), np.cross(np.eye(3), r).T]) for r in np.array(feet)]
    J, inverse = np.vstack(rows), np.diag([1.0, 1.0, 1.0, *(1.0 / inertia)])
    W, before = J @ inverse @ J.T, J @ np.append(v, w)
    target = before.copy()
    target[2::3] += e * before[2::3]
    p, step = np.zeros(len(J)), 0.9 / np.linalg.eigvalsh(W).max()
    for _ in range(100_000):
        old, u = p.copy(), (W @ p + target).reshape(-1, 3)
        u[:, 2] += mu * np.hypot(u[:, 0], u[:, 1])
        for one, aim in zip(p.reshape(-1, 3), p.reshape(-1, 3) - step * u, strict=True):
            size = math.hypot(aim[0], aim[1])
            if size > mu * aim[2]:  # onto the cone, or its tip
                normal = max((aim[2] + mu * size) / (1.0 + mu**2), 0.0)
                aim[:] = *(mu * normal / size * aim[:2]), normal
            one[:] = aim
        if abs(p - old).max() < 1e-16:
            break
    return np.append(v, w) + inverse @ J.T @ p


def stool(count, case, units, order, slides=False):
    """Solution of a stool of random size and speed that lands on its feet, its velocities after it, and a problem of
    :func:`impulses`. If it ``slides``, it stays on them for 10 ms under a slanting weight."""
    chosen = np.random.default_rng(case)
    mu, e = chosen.choice([0.1, 0.4, 1.0]), 0.0 if slides else chosen.choice([0.3, 0.8])
    angles = 0.3 + 2.0 * np.pi * np.arange(count) / count
    feet = np.column_stack([np.cos(angles), np.sin(angles), -0.5 * np.ones(count)])
    feet[:, :2] *= chosen.uniform(0.6, 1.2, (count, 2))
    inertia = chosen.uniform(0.5, 0.9, 3)
    v = np.append(chosen.normal(size=2) * chosen.choice([0.1, 1.0, 3.0]), -2.0)
    spin = chosen.normal() * chosen.choice([0.1, 1.0, 4.0])
    body = {
        "mass": units.mass, "inertia": (inertia * units.mass * units.length**2).tolist(),
        "points": {f"f{k}": (units.length * foot).tolist() for k, foot in enumerate(feet)},
        "rotation": {"x": units.direction(1, 0, 0), "y": units.direction(0, 1, 0)},
        "free": {"at": units.of(0, 0, 0.5 + 2e-6), "velocity": units.of(*v, per=1),
                 "angular_velocity": (np.array(units.direction(0, 0, spin)) / units.time).tolist()},
    }  # fmt: skip
    law = {"contact": {"law": "newton", "restitution": float(e)}, "friction": {"mu": float(mu)}}
    contacts = {f"c{k}": {"point_on_plane": [f"stool.f{k}", "ground"], "normal": units.direction(0, 0, 1), **law}
                for k in order}  # fmt: skip
    weight = (*chosen.normal(size=2) * chosen.choice([0.1, 1.0, 6.0]), -9.81) if slides else (0, 0, 0)
    found = ran(units, {"stool": body}, contacts, weight, 1e-2 if slides else 1.001e-6)
    last = found.trajectory.v[-1]
    after = np.append(units.back([last[:3]], per=1)[0], units.turn.T @ last[3:] * units.time)
    return found, after, (feet, inertia, v, [0, 0, spin], mu, e)


@TURNED
@pytest.mark.exhaustive(share=5)
@pytest.mark.parametrize("count", [3, 4])
def test_a_stool_that_lands_on_its_feet_slips_and_sticks_as_its_impulses_allow(count, case):
    """Each foot slips in its own direction, or sticks. Impulses of four feet are not unique."""
    found, after, problem = stool(count, case, Units(case, in_space=True), range(count))
    energy, (*_, spin, _, e) = found.trajectory.energy, problem
    assert after[2] >= 2.0 * e * (1.0 - 1e-9) and abs(energy.gap).max() < 1e-9 * energy.kinetic[0]
    if count == 3:
        turned = 1e-6 * spin[2]  # until it lands
        assert after == pytest.approx(impulses(*problem), abs=2e-8 + 10.0 * abs(turned))


@TURNED
@pytest.mark.exhaustive(share=10)
@pytest.mark.parametrize("count", [4, 6])
@pytest.mark.parametrize("slides", [False, True], ids=["impact", "sliding"])
def test_speeds_on_redundant_feet_do_not_depend_on_their_order(slides, count, case):
    """After an impact, and where contacts at rest share the force."""
    order = np.random.default_rng(case).permutation(count)
    _, one, _ = stool(count, case, Units(case, in_space=True), range(count), slides)
    _, other, _ = stool(count, case, Units(case + 7777, in_space=True), order, slides)
    assert one == pytest.approx(other, abs=1e-6)


def test_a_table_that_slides_shares_its_weight_among_four_legs():
    """The front legs bear W (1 + mu h/a)/4 each, with the height h of the centre and the length 2 a of the table."""
    law = '{law = "newton", restitution = 0}, friction = {mu = 0.2}'
    legs = [(0.5, 0.3), (0.5, -0.3), (-0.5, 0.3), (-0.5, -0.3)]
    text = '''
schema = 1
description = "A table slides on four legs"
gravity = [0, 0, -9.81]
bodies.table = {mass = 4, inertia = [0.5, 0.7, 0.9], free = {at = [0, 0, 0.6], velocity = [1, 0, 0]}, points = {POINTS}}
sensors.speed = {velocity = "table", component = "x", axes = "global"}
solve = {preset = "coupled", duration = "0.3 s", steps = 10}
'''.replace("POINTS", ", ".join(f"f{k} = [{x}, {y}, -0.6]" for k, (x, y) in enumerate(legs)))
    for k in range(4):
        text += f"""
contacts.c{k} = {{point_on_plane = ["table.f{k}", "ground"], normal = [0, 0, 1], contact = {law}}}
sensors.push_{k} = {{contact_force = "c{k}"}}"""
    found = solved(scene_of(text))
    assert found["speed"].values == pytest.approx(1.0 - 0.2 * G * found.times, abs=1e-9)
    for k, (x, _) in enumerate(legs):
        assert found[f"push_{k}"].values[1:] == pytest.approx(G * (1.0 + 0.2 * 0.6 / x), rel=1e-7)


@pytest.mark.parametrize("case", [2, 18])
def test_impulses_of_four_feet_are_shared_alike_whatever_slips(case):
    """A compliance of each foot's own response, which jumps with the modes, would leave no consistent choice here."""
    test_a_stool_that_lands_on_its_feet_slips_and_sticks_as_its_impulses_allow(4, case)


def test_a_ball_slides_in_a_bowl_as_by_quadrature():
    """At rest on the bowl, while its slip turns by more than a right angle; its friction is against the slip."""
    R, r, m, J, mu = 0.9, 0.1, 2.0, 5e-3, 0.1
    at, velocity, down = R * np.array([math.cos(0.5), 0.0, -math.sin(0.5)]), np.array([0.0, 1.0, 0.0]), [0.0, 0.0, -G]

    def rates(_, y):
        x, v, w = y.reshape(3, 3)
        inwards = -x / R
        N = m * (v @ v / R - inwards @ down)
        slip = v - np.cross(w, r * inwards)
        rub = -mu * N * slip / np.linalg.norm(slip)
        return np.concatenate([v, down + (N * inwards + rub) / m, np.cross(-r * inwards, rub) / J])

    y = solve_ivp(rates, (0.0, 0.3), [*at, *velocity, 0, 0, 0], "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    text = BOWL.replace("AT", str(at.tolist())).replace("VELOCITY", str(velocity.tolist()))
    model = load(scene_of(text + f"""
contacts.c = {{circle_in_circle = ["ball", "ground.origin"], radii = [0.1, 1], contact = {{law = "newton", restitution = 0}}, friction = {{mu = {mu}}}}}
"""))  # noqa: E501
    for _ in range(2):  # nothing of a run is left for the next
        found = simulate(model)
        assert found.trajectory.v[-1] == pytest.approx(y[3:], abs=1e-9)
    lost = 0.5 * m * (1.0 - y[3:6] @ y[3:6]) - 0.5 * J * y[6:] @ y[6:] + m * G * (at[2] - y[2])
    assert found.trajectory.frictions.lost[-1, 0] == pytest.approx(lost, rel=1e-9)


def on_turntable(at, velocity, mu, radius):
    text = (BOWL + TURNTABLE).replace("AT", f"[{at}, 0, {radius}]").replace("VELOCITY", str(velocity))
    found = solved(scene_of(text.replace("MU", str(mu)).replace("RADIUS", str(radius))))
    return found["x"].values, found["y"].values, found.times


def test_a_ball_rolls_on_a_turntable_in_a_circle():
    """Its velocity turns at Omega J/(J + m r^2) (Weckesser 1997, Am. J. Phys. 65, 736), after it has slipped."""
    x, y, times = on_turntable(0.5, [0.0, 0.2, 0.0], 2.0, 0.1)
    rolls = times > 0.03
    assert np.ptp(np.hypot(x, y)[rolls]) < 1e-8 < np.ptp(np.hypot(x, y))
    turned = np.unwrap(np.arctan2(y, x))[rolls]
    assert np.diff(turned) == pytest.approx(4.0 * 5e-3 / (5e-3 + 2.0 * 0.1**2) * np.diff(times[rolls]), rel=1e-7)


def test_a_small_disc_slides_on_a_turntable_as_by_quadrature():
    mu = 0.2

    def rates(_, y):
        slip = y[2:] - 4.0 * np.array([-y[1], y[0]])
        return np.append(y[2:], -mu * G * slip / np.hypot(*slip))

    expected = solve_ivp(rates, (0.0, 0.3), [0.5, 0.0, 0.3, 0.0], "DOP853", rtol=1e-12, atol=1e-13).y[2:, -1]
    x, y, _ = on_turntable(0.5, [0.3, 0.0, 0.0], mu, 0.0)
    assert [x[-1], y[-1]] == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize("law", [LAW, RUBS])
@pytest.mark.parametrize("kind", ["ball", "pin", "block"])
def test_loose_joints_with_rigid_sides_knock_and_lose_what_their_impacts_lose(kind, law):
    clearance = BLOCK.replace("NORMAL", "[0, 0, 1]")
    text = {
        "ball": BALL_CRANK.replace("contact = CONTACT", f"contact = {law}"),
        "pin": ROTOR.replace(ROTOR[ROTOR.index("contact = {") : ROTOR.index("}", ROTOR.index("contact = {")) + 1],
                             f"contact = {law}").replace("1e-10", "1e-11"),
        "block": f"""
schema = 1
description = "A block falls in its guide"
gravity = [0, 0, -9.81]
bodies.block = {{mass = 1, inertia = [1e-3, 1e-3, 1e-3], free = {{at = [0, 0, 0], velocity = [1, 0.1, 0.05]}}}}
joints.guide = {{prismatic = ["ground", "block"], direction = [1, 0, 0], clearance = {{{clearance}, contact = {law}}}}}
sensors.height = {{position = "guide", component = "z"}}
solve = {{preset = "coupled", duration = "0.1 s", steps = 300, tolerance = 1e-10}}
""",
    }[kind]  # fmt: skip
    model = load(scene_of(text))
    found, again = simulate(model), simulate(model)
    assert np.array_equal(found.trajectory.rows, again.trajectory.rows)  # nothing of a run is left for the next
    assert found.outcome.name == "COMPLETED" and len(found.impacts) > 10
    lost = sum(each.lost for each in found.impacts)
    assert found.trajectory.contacts.lost[-1].sum() == pytest.approx(lost, rel=1e-9)
    assert found.trajectory.energy.drift < {"ball": 1e-7, "pin": 3e-4, "block": 1e-12}[kind]
