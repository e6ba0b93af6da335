"""Impacts and jams of bodies that are turned by any angle and given in any units: rounding never decides them.

Every case is turned by a random rotation, and its lengths, masses and times are multiplied by random factors.
"""

import math
import random

import numpy as np
import pytest
from parity import random_turn
from scipy.integrate import solve_ivp

from kaneflex import load, scene_of
from kaneflex.integrate.system import Outcome
from kaneflex.solve.simulation import solve

TURNED = pytest.mark.parametrize("case", range(200))
SPACE = pytest.mark.parametrize("in_space", [False, True], ids=["plane", "space"])
LEFT = pytest.mark.exhaustive(share=50)


class Units:
    """A rotation, in the plane or in space, and factors of length, mass and time."""

    def __init__(self, case, in_space=False):
        chosen = random.Random(case)
        self.angle = chosen.uniform(-math.pi, math.pi)
        c, s = math.cos(self.angle), math.sin(self.angle)
        self.turn = random_turn(f"case {case}") if in_space else np.array([[c, -s], [s, c]])
        self.plane = "point_on_plane" if in_space else "point_on_line"
        self.length, self.mass, self.time = (10.0 ** chosen.uniform(-3, 3) for _ in range(3))

    def of(self, *vector, per=0):
        """A vector of length over a power of time, turned and in these units, as text."""
        return (self.length / self.time**per * np.array(self.direction(*vector))).tolist()

    def direction(self, *vector):
        """A vector, turned; numbers left out are zero."""
        given = [*vector, 0.0][: len(self.turn)] if len(vector) < len(self.turn) else vector
        return (self.turn @ np.array(given, float)).tolist()

    def back(self, vectors, per=0):
        """Vectors (n, 2 or 3) in SI and in the original axes."""
        return np.array(vectors) @ self.turn * self.time**per / self.length


def ran(units, bodies, contacts, gravity, duration, outcome=Outcome.COMPLETED, **settings):
    """Solution of bodies that touch, after a duration in the original units."""
    raw = {
        "schema": 1, "description": "bodies that touch", "gravity": units.of(*gravity, per=2), "bodies": bodies,
        "contacts": contacts, "sensors": {"push": {"contact_force": next(iter(contacts))}},
        "solve": {"preset": "coupled", "duration": duration * units.time, "steps": 50, "errors": "none"} | settings,
    }  # fmt: skip
    found = solve(load(scene_of(raw)))
    assert found.outcome is outcome, found.trajectory.message
    return found


def speeds(found, units, names, axes="xy"):
    """Velocities of bodies' centres at the end, (n, 2 or 3)."""
    columns = [name for name, _ in found.model.coupled_system.layout.coordinates]
    last = found.trajectory.v[-1]
    return units.back([[last[columns.index(f"{name}.{axis}")] for axis in axes] for name in names], per=1)


@TURNED
@pytest.mark.exhaustive(share=10)
@SPACE
def test_a_rod_slides_or_jams_by_its_friction_alone(in_space, case):
    """A rod that slides on its end has a force if 1 + 3 c (c - mu s) > 0, or without weight none (Painleve 1895)."""
    units, chosen = Units(case, in_space), np.random.default_rng(case)
    angle, mu, way = chosen.uniform(0.3, 1.4), float(chosen.uniform(0.1, 4.0)), int(chosen.choice([-1, 1]))
    c, s, inertia = math.cos(angle), math.sin(angle), units.mass * units.length**2 / 12
    start = {"at": units.of(0, 0), "velocity": units.of(-2 * way, 0, per=1)}
    rod = {"length": units.length, "mass": units.mass, "centre": [units.length / 2, 0.0], "inertia": inertia}
    if in_space:
        rod |= {"inertia": [1e-3 * inertia, inertia, inertia], "centre": [units.length / 2, 0.0, 0.0],
                "rotation": {"x": units.direction(c, s), "y": units.direction(-s, c)}}  # fmt: skip
    else:
        start["angle"] = angle + units.angle
    floor = {units.plane: ["rod", "ground"], "normal": units.direction(0, 1), "friction": {"mu": mu},
             "contact": {"law": "newton", "restitution": 0.5}}  # fmt: skip
    resists = 1 + 3 * c * (c - way * mu * s)
    named = Outcome.COMPLETED if resists > 0 else Outcome.PARADOX
    found = ran(units, {"rod": rod | {"free": start}}, {"floor": floor}, (0, -9.81), 1e-6, named)
    if resists > 0:
        force = found["push"].values[0] * units.time**2 / (units.mass * units.length)
        assert force == pytest.approx(9.81 / resists, rel=1e-8)


@TURNED
@LEFT
@SPACE
@pytest.mark.parametrize("e", [1.0, 0.4])
def test_a_chain_of_equal_discs_that_touch_shares_an_impact(e, in_space, case):
    """Moreau 1988: the first contact opens with e times its speed, the others, at rest before, stay closed."""
    units = Units(case, in_space)
    bodies, contacts = {}, {}
    inertia = units.mass * units.length**2 / 2
    for k in range(4):
        moves = {"velocity": units.of(1, 0, per=1)} if k == 0 else {}
        bodies[f"b{k}"] = {"mass": units.mass, "inertia": 3 * [inertia] if in_space else inertia,
                           "free": {"at": units.of(2.0 * k - 0.1 * (k == 0), 0), **moves}}  # fmt: skip
    for k in range(3):
        contacts[f"c{k}"] = {"circle_on_circle": [f"b{k}", f"b{k + 1}"], "radii": 2 * [units.length],
                             "contact": {"law": "newton", "restitution": e}}  # fmt: skip
    found = ran(units, bodies, contacts, (0, 0), 0.2)
    W = 2.0 * np.eye(3) - np.eye(3, k=1) - np.eye(3, k=-1)
    impulses = np.linalg.solve(W, [1.0 + e, 0.0, 0.0])
    expected = np.array([1.0, 0.0, 0.0, 0.0]) + np.append(0.0, impulses) - np.append(impulses, 0.0)
    after = speeds(found, units, bodies, "xyz" if in_space else "xy")
    assert after == pytest.approx(np.column_stack([expected, np.zeros((4, 1 + in_space))]), abs=1e-9)


@TURNED
@LEFT
def test_a_block_that_lands_on_three_feet_at_once_rebounds_without_turning(case):
    units = Units(case)
    feet = {f"f{k}": [x * units.length, -0.5 * units.length] for k, x in enumerate((-1.0, 0.3, 1.0))}
    free = {"at": units.of(0, 1.5), "angle": units.angle}
    block = {"mass": units.mass, "inertia": units.mass * units.length**2, "points": feet, "free": free}
    law = {"law": "newton", "restitution": 0.5}
    contacts = {f"on_{foot}": {"point_on_line": [f"block.{foot}", "ground"], "normal": units.direction(0, 1),
                               "contact": law} for foot in feet}  # fmt: skip
    fall = math.sqrt(2 * 1.0 / 9.81)
    found = ran(units, {"block": block}, contacts, (0, -9.81), 1.2 * fall)
    after = speeds(found, units, ["block"])
    assert after == pytest.approx(np.array([[0.0, 9.81 * fall * (0.5 - 0.2)]]), abs=1e-8)
    assert abs(found.trajectory.v[-1][2]) * units.time < 1e-8


def hertz(units, K):
    """Hertz's law with K [N/m^1.5] in these units."""
    scaled = K * units.mass / units.time**2 / math.sqrt(units.length)
    return {"law": "hertz", "stiffness": scaled, "exponent": 1.5}


def ball(units, at, velocity=(0, 0, 0)):
    """Ball of mass 1 and radius 0.5."""
    inertia = 3 * [0.1 * units.mass * units.length**2]
    free = {"at": units.of(*at), "velocity": units.of(*velocity, per=1)}
    return {"mass": units.mass, "inertia": inertia, "free": free}


@TURNED
@LEFT
def test_a_chain_of_balls_passes_an_impact_on_as_its_springs_do(case):
    """Four balls in space that touch; independent integration of the chain."""
    units, K = Units(case, in_space=True), 1e4

    def rates(_, y):
        force = K * np.maximum(y[:3] - y[1:4], 0.0) ** 1.5  # displacements from where they touch
        return [*y[4:], *(np.append(0.0, force) - np.append(force, 0.0))]

    expected = solve_ivp(rates, (0.0, 1.0), [-0.05, 0, 0, 0, 1, 0, 0, 0], "DOP853", rtol=1e-12, atol=1e-13).y[4:, -1]
    bodies = {f"b{k}": ball(units, (k - 0.05 * (k == 0), 0, 0), ((k == 0) * 1.0, 0, 0)) for k in range(4)}
    contacts = {f"c{k}": {"circle_on_circle": [f"b{k}", f"b{k + 1}"], "radii": 2 * [0.5 * units.length],
                          "contact": hertz(units, K)} for k in range(3)}  # fmt: skip
    found = ran(units, bodies, contacts, (0, 0, 0), 1.0, tolerance=1e-10)
    assert found.model.coupled_system.mechanism.size == pytest.approx(3.05 * units.length)  # from the first to the last
    after = speeds(found, units, bodies, "xyz")
    assert after == pytest.approx(np.column_stack([expected, np.zeros((4, 2))]), abs=1e-7)


@TURNED
@LEFT
def test_a_ball_that_hits_three_balls_at_once_moves_on_along_its_line(case):
    """The three stand in a triangle, and part with equal speeds: those of one equation by symmetry."""
    units, K = Units(case, in_space=True), 1e4
    away = 0.5 / math.cos(math.pi / 6)  # of their centres from the line
    height = math.sqrt(1 - away**2)

    def rates(_, y):
        x, r, z = y[:3]  # of the first ball along the line; of the others across and along it
        gap = math.hypot(r, x - z)
        force = K * max(1.0 - gap, 0.0) ** 1.5 / gap
        return [*y[3:], 3 * force * (x - z), force * r, -force * (x - z)]

    y = solve_ivp(rates, (0.0, 1.0), [height + 0.05, away, 0, -1, 0, 0], "DOP853", rtol=1e-12, atol=1e-13).y[3:, -1]
    places = [(0, 0, height + 0.05)]
    places += [(away * math.cos(a), away * math.sin(a), 0) for a in (0.3 + 2 * math.pi * k / 3 for k in range(3))]
    bodies = {f"b{k}": ball(units, at, (0, 0, -1.0 * (k == 0))) for k, at in enumerate(places)}
    contacts = {f"c{k}": {"circle_on_circle": ["b0", f"b{k}"], "radii": 2 * [0.5 * units.length],
                          "contact": hertz(units, K)} for k in (1, 2, 3)}  # fmt: skip
    found = ran(units, bodies, contacts, (0, 0, 0), 1.0, tolerance=1e-10)
    after = speeds(found, units, bodies, "xyz")
    assert after[0] == pytest.approx([0.0, 0.0, y[0]], abs=1e-7)
    outwards = np.array(places)[1:, :2] / away
    assert after[1:] == pytest.approx(np.column_stack([y[1] * outwards, np.full(3, y[2])]), abs=1e-7)
