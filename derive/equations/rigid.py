"""The rigid stage: Kane's equations of free bodies, and constraints of joints and drives, of which none is substituted.

Each body has three absolute coordinates: x, y of its start, angle phi; each joint of the scene is a holonomic
constraint. Absolute coordinates keep every expression as short as its own body, whatever the length of the chain; the
multipliers of the constraints are the joint reactions, and the multiplier of a drive is its torque (inverse dynamics).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import sympy as sm
from sympy.physics.mechanics import dynamicsymbols

from kaneflex.derive.bodies.kane import ACCEL, EPSILON, OMEGA, planar_body_equations
from kaneflex.derive.equations.closure import Closure
from kaneflex.derive.equations.linear import solve_blocks
from kaneflex.derive.ir.program import Scalar, Steps
from kaneflex.mechanism.joints import coordinate, drive_reaction, reactions, residuals
from kaneflex.mechanism.parts import Body, Joint, Mass, Mechanism
from kaneflex.mechanism.planar import GROUND, BodyPoint, Pose, Vector, carried_acceleration, cross, minus, pose_at

TIME = dynamicsymbols._t


@dataclass(frozen=True)
class Constraint:
    """Scalar equation residual(q, t) = 0 of a joint or a drive; its multiplier is a reaction with unit and meaning.

    A positive multiplier acts on the second body.
    """

    name: str
    unit: str
    meaning: str
    residual: sm.Expr

    @property
    def multiplier(self) -> sm.Symbol:
        return multiplier(self.name)


def multiplier(name: str) -> sm.Symbol:
    """Symbol of a reaction "<joint>.<row>"."""
    return sm.Symbol(name.replace(".", "_"))


def _constraints(
    mechanism: Mechanism, coordinates: Mapping[str, Pose], drive_coordinate: Mapping[str, sm.Expr]
) -> list[Constraint]:
    """Constraints of the joints, then of the drives, whose coordinates are functions of time."""

    def sections(joint: Joint) -> list[Pose]:
        return [coordinates[side.body].section(side.at) for side in joint.sides]

    found = [
        Constraint(*reaction, residual)
        for joint in mechanism.joints.values()
        for reaction, residual in zip(reactions(joint), residuals(joint, *sections(joint)), strict=True)
    ]
    for name, angle in drive_coordinate.items():
        joint = mechanism.joints[name]
        found.append(Constraint(*drive_reaction(joint), coordinate(joint, *sections(joint)) - angle))
    return found


@dataclass(frozen=True)
class Drive:
    """Coordinate of a drive with its first and second time derivative."""

    angle: sm.Expr
    speed: sm.Expr
    acceleration: sm.Expr


_SPEEDS, _ACCELERATIONS = ("v_x", "v_y", "omega"), ("a_x", "a_y", "epsilon")


class Rates:
    """Velocities and accelerations of all bodies, and the substitution that brings equations to these symbols.

    Attributes
    ----------
    poses, coordinates : dict
        Body -> its pose in symbols, and by absolute coordinates x, y, phi, functions of time.
    constraints : list of Constraint
        Joints first, then drives.
    value : dict
        Body -> its velocities and accelerations by their letters.
    """

    def __init__(self, mechanism: Mechanism, drives: Mapping[str, Drive], poses: dict[str, Pose], steps: Steps):
        self.poses = poses
        self.coordinates = {GROUND: pose_at(sm.S.Zero, sm.S.Zero, sm.S.Zero, sm.cos, sm.sin)}
        for name in mechanism.bodies:
            self.coordinates[name] = pose_at(*dynamicsymbols(f"x_{name} y_{name} phi_{name}"), sm.cos, sm.sin)
        drive_coordinate = {name: dynamicsymbols(f"drive_{name}") for name in mechanism.drives}
        self.constraints = _constraints(mechanism, self.coordinates, drive_coordinate)
        self.to_symbols: dict[sm.Expr, sm.Expr] = {}
        rate: dict[sm.Expr, sm.Expr] = {}
        for name in mechanism.bodies:
            at, pose = self.coordinates[name], poses[name]
            self.to_symbols |= {at.c: pose.c, at.s: pose.s, at.x: pose.x, at.y: pose.y}
            for order, letters in enumerate((_SPEEDS, _ACCELERATIONS), start=1):
                rates = (place.diff(TIME, order) for place in (at.x, at.y, at.phi))
                rate |= zip(rates, _of_body(name, letters), strict=True)
        for name, angle in drive_coordinate.items():
            rate |= {angle.diff(TIME): drives[name].speed, angle.diff(TIME, 2): drives[name].acceleration}

        def solved(order: int, letters: Sequence[str], known: dict[sm.Symbol, sm.Expr]) -> dict[sm.Symbol, sm.Expr]:
            """Velocities by J v = -dg/dt, accelerations by J a = -dJ/dt v, of total derivatives of constraints g."""
            rows = [
                (c.name, c.residual.diff(TIME, order).xreplace(rate).xreplace(self.to_symbols).xreplace(known))
                for c in self.constraints
            ]
            return solve_blocks(rows, [u for name in mechanism.bodies for u in _of_body(name, letters)], steps)

        velocity = solved(1, _SPEEDS, {})
        found = velocity | solved(2, _ACCELERATIONS, velocity)
        self.value: dict[str, dict[str, sm.Expr]] = {}
        for name in mechanism.bodies:
            letters = (*_SPEEDS, *_ACCELERATIONS)
            self.value[name] = {u: found[of] for u, of in zip(letters, _of_body(name, letters), strict=True)}

    def specific_force(self, body: str, point: BodyPoint, gravity: Vector) -> Vector:
        """a - g of a body-fixed point, global: a_O + epsilon S R r - omega^2 R r - g."""
        value = self.value[body]
        x, y = carried_acceleration(self.poses[body].turn(point.at), value["omega"], value["epsilon"])
        return minus((value["a_x"] + x, value["a_y"] + y), gravity)


def balance(mechanism: Mechanism, rates: Rates, pushes: Mapping[str, sm.Expr]) -> dict[str, sm.Matrix]:
    """fr + fr* of every free body: force, global x and y, and moment about its start, without joints (Kane & Levinson
    1985, ch. 6). ``pushes``: magnitudes of loads, components and torques of springs.
    """
    total = {name: sm.zeros(3, 1) for name in mechanism.bodies}

    def push(at: BodyPoint, force: Sequence[sm.Expr], in_body: bool = False) -> None:
        if at.body != GROUND:
            pose = rates.poses[at.body]
            moment = cross(at.at if in_body else pose.turn(at.at), force)
            total[at.body] += sm.Matrix([*(pose.turn(force) if in_body else force), moment])

    def turn(joint: str, torque: sm.Expr) -> None:
        for side, sign in zip(mechanism.joints[joint].sides, (-1, 1), strict=True):
            if side.body != GROUND:
                total[side.body][2] += sign * torque

    weights = [(BodyPoint(name, "centre", body.centre), body) for name, body in mechanism.bodies.items()]
    for at, of in (*weights, *((mass.point, mass) for mass in mechanism.masses.values())):
        total[at.body] -= _inertia(rates, at, of, mechanism.gravity)
    for name, load in mechanism.loads.items():
        for at, share in load.pushes:
            push(at, [pushes[name] * share * part for part in load.direction], load.in_body)
        if load.joint is not None:
            turn(load.joint, pushes[name])
    for name, spring in mechanism.springs.items():
        if spring.joint is not None:
            turn(spring.joint, -pushes[f"{name}.torque"])  # a positive torque turns back
        for end, sign in zip(spring.ends, (-1, 1), strict=False):  # a torsional spring has no ends
            push(end, [sign * pushes[f"{name}.force_{axis}"] for axis in "xy"])
    return total


def _inertia(rates: Rates, at: BodyPoint, of: Body | Mass, gravity: Vector) -> sm.Matrix:
    """-fr* of a mass with its centre at a point of a body, less its weight: force, global, and moment about the start.

    These are Kane's equations of a body in space, in the plane. Their moment is the same in all axes about z.
    """
    value, pose, equations = rates.value[at.body], rates.poses[at.body], planar_body_equations()
    a = minus((value["a_x"], value["a_y"]), gravity)
    symbols = (*sm.symbols("mass J_z"), OMEGA[2], EPSILON[2], *sm.symbols("centre_x centre_y"), *ACCEL[:2])
    own = of.mass, of.inertia, value["omega"], value["epsilon"]
    in_global = dict(zip(symbols, (*own, *pose.turn(at.at), *a), strict=True))
    in_body = dict(zip(symbols, (*own, *at.at, *Pose(0, 0, pose.c, -pose.s).turn(a)), strict=True))
    return sm.Matrix([*equations[:2, :].xreplace(in_global), equations[2].xreplace(in_body)])


def _of_body(name: str, letters: Sequence[str]) -> list[sm.Symbol]:
    return [sm.Symbol(f"{letter}_{name}") for letter in letters]


@dataclass(frozen=True)
class Solved:
    """The rigid motion in symbols: drives, rates, loads, springs, reactions by multiplier, the loops' closure."""

    drives: dict[str, Drive]
    rates: Rates
    loads: dict[str, sm.Expr]
    springs: list[Scalar]
    reactions: dict[sm.Symbol, sm.Expr]
    closure: Closure
