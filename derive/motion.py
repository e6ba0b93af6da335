"""From the rigid equations to the program of the ``motion`` kernel.

Positions in closed form, then velocities, accelerations and reactions, each by solving the constraint equations
block by block. What comes out are the motion's scalars: those of every elastic link in its own axes
(omega, epsilon, a - g, P_0), the rigid coordinates of every body, every joint reaction and every drive's torque.
"""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sm

from kaneflex.contract import LINK_SCALARS
from kaneflex.derive.closure import Pose, place_bodies
from kaneflex.derive.laws import law_expression
from kaneflex.derive.linear import solve_blocks
from kaneflex.derive.mechanism import Mechanism
from kaneflex.derive.program import Program
from kaneflex.derive.rigid import TIME, RigidEquations, rigid_equations
from kaneflex.derive.steps import Steps

table = sm.Function("table")
"""Stands for the periodic cubic table of a load: table(x, start of its block in the parameters)."""

T = sm.Symbol("t")


@dataclass(frozen=True)
class Scalar:
    """One scalar of the motion: name, unit, meaning, and its expression (a number where the scene fixes it)."""

    name: str
    unit: str
    meaning: str
    value: sm.Expr


@dataclass(frozen=True)
class Motion:
    """The rigid motion as assignments, and the scalars that the elastic stage and the sensors read."""

    steps: tuple[tuple[sm.Symbol, sm.Expr], ...]
    links: dict[str, tuple[Scalar, ...]]
    scalars: tuple[Scalar, ...]

    def program(self, parameters: tuple[sm.Symbol, ...]) -> Program:
        """Each link's block first, then every other scalar that is not a constant."""
        stored = [scalar for block in self.links.values() for scalar in block]
        stored += [scalar for scalar in self.scalars if not scalar.value.is_number]
        outputs = tuple((f"s[{k}]", scalar.value) for k, scalar in enumerate(stored))
        return Program("motion", (T, *parameters), self.steps, outputs)


def derive_motion(mechanism: Mechanism) -> Motion:
    """Solve the rigid mechanism for its motion at constant drive speeds.

    The drives' coordinates are free in Kane's equations; their constant speed is substituted here, which removes
    every angular acceleration that comes from a drive alone.
    """
    equations = rigid_equations(mechanism)
    steps = Steps(symbol for symbol, _ in mechanism.parameters.values())
    drives = _drives(mechanism, steps)
    closure = place_bodies(mechanism, {name: drive.angle for name, drive in drives.items()}, steps)
    rates = _Rates(mechanism, equations, drives, closure.poses, steps)
    loads = _loads(mechanism, drives, steps)
    reactions = _reactions(equations, rates, loads, steps)
    scalars = []
    for name, drive in drives.items():
        angular = mechanism.joints[name].kind == "revolute"
        scalars.append(Scalar(f"{name}.angle", "rad" if angular else "m", "coordinate of the drive", drive.angle))
    for name in mechanism.bodies:
        scalars += rates.scalars(name)
    for constraint in equations.constraints:
        value = reactions[constraint.multiplier]
        scalars.append(Scalar(constraint.name, constraint.unit, constraint.meaning, value))
    for name, value in loads.items():
        scalars.append(Scalar(name, "N", "magnitude of the load", value))
    for name, margin in closure.margins.items():
        scalars.append(Scalar(f"{name}.closure", "1", "margin of the loop: it can't close below zero", margin))
    links = {
        name: _link_scalars(mechanism, name, rates, reactions, loads, steps)
        for name, body in mechanism.bodies.items()
        if body.elastic
    }
    return Motion(tuple(steps.assignments), links, tuple(scalars))


@dataclass(frozen=True)
class _Drive:
    angle: sm.Expr
    speed: sm.Expr


def _drives(mechanism: Mechanism, steps: Steps) -> dict[str, _Drive]:
    drives = {}
    for name in mechanism.drives:
        start, speed = mechanism.symbol(f"{name}.angle"), mechanism.symbol(f"{name}.speed")
        drives[name] = _Drive(steps.assign(sm.Symbol(f"{name}_coordinate"), start + speed * T), speed)
    return drives


def _loads(mechanism: Mechanism, drives: dict[str, _Drive], steps: Steps) -> dict[str, sm.Expr]:
    magnitude = {}
    for name, load in mechanism.loads.items():
        if load.kind == "constant":
            value = mechanism.symbol(f"{name}.value")
        elif load.kind == "table":
            x = drives[load.against].angle if load.against in drives else T
            value = table(x - mechanism.symbol(f"{name}.offset"), mechanism.symbol(f"{name}.table"))
        else:
            names = {"t": T, **{d: drive.angle for d, drive in drives.items()}}
            names |= {f"{d}_speed": drive.speed for d, drive in drives.items()}
            value = law_expression(load.law, names)
        magnitude[name] = steps.assign(sm.Symbol(name), value)
    return magnitude


class _Rates:
    """Velocities and accelerations of all bodies, and the substitution that brings equations to these symbols."""

    def __init__(self, mechanism, equations: RigidEquations, drives, poses: dict[str, Pose], steps: Steps):
        self.poses = poses
        self.to_symbols: dict[sm.Expr, sm.Expr] = {}
        unknown_v, unknown_a = [], []
        rate: dict[sm.Expr, sm.Symbol] = {}
        for name in mechanism.bodies:
            at, pose = equations.coordinates[name], poses[name]
            self.to_symbols |= {sm.cos(at.phi): pose.c, sm.sin(at.phi): pose.s, at.x: pose.x, at.y: pose.y}
            for coordinate, letter in ((at.x, "x"), (at.y, "y"), (at.phi, "phi")):
                v, a = sm.Symbol(f"v_{letter}_{name}"), sm.Symbol(f"a_{letter}_{name}")
                if letter == "phi":
                    v, a = sm.Symbol(f"omega_{name}"), sm.Symbol(f"epsilon_{name}")
                rate |= {coordinate.diff(TIME): v, coordinate.diff(TIME, 2): a}
                unknown_v.append(v)
                unknown_a.append(a)
        for name, coordinate in equations.drive_coordinate.items():
            rate |= {coordinate.diff(TIME): drives[name].speed, coordinate.diff(TIME, 2): sm.S.Zero}
        # Velocity level, J v = -dg/dt; acceleration level, J a = -dJ/dt v; both by the constraint's total derivative.
        first = [
            (c.name, c.residual.diff(TIME).xreplace(rate).xreplace(self.to_symbols)) for c in equations.constraints
        ]
        self.velocity = solve_blocks(first, unknown_v, steps)
        second = [
            (
                c.name,
                c.residual.diff(TIME, 2).xreplace(rate).xreplace(self.to_symbols).xreplace(self.velocity),
            )
            for c in equations.constraints
        ]
        self.acceleration = solve_blocks(second, unknown_a, steps)
        self.value: dict[str, dict[str, sm.Expr]] = {}
        for name in mechanism.bodies:
            v_x, v_y, omega = (self.velocity[sm.Symbol(f"{u}_{name}")] for u in ("v_x", "v_y", "omega"))
            a_x, a_y, epsilon = (self.acceleration[sm.Symbol(f"{u}_{name}")] for u in ("a_x", "a_y", "epsilon"))
            for speed, velocity, acceleration in zip(
                equations.speeds[name], (v_x, v_y, omega), (a_x, a_y, epsilon), strict=True
            ):
                self.to_symbols |= {speed.diff(TIME): acceleration, speed: velocity}
            self.value[name] = dict(v_x=v_x, v_y=v_y, omega=omega, a_x=a_x, a_y=a_y, epsilon=epsilon)

    def scalars(self, body: str) -> list[Scalar]:
        pose, value = self.poses[body], self.value[body]
        return [
            Scalar(f"{body}.x", "m", "global x of the body's start", pose.x),
            Scalar(f"{body}.y", "m", "global y of the body's start", pose.y),
            Scalar(f"{body}.c", "1", "cosine of the body's angle", pose.c),
            Scalar(f"{body}.s", "1", "sine of the body's angle", pose.s),
            Scalar(f"{body}.v_x", "m/s", "velocity of the body's start, global x", value["v_x"]),
            Scalar(f"{body}.v_y", "m/s", "velocity of the body's start, global y", value["v_y"]),
            Scalar(f"{body}.omega", "rad/s", "angular velocity of the body", value["omega"]),
            Scalar(f"{body}.a_x", "m/s^2", "acceleration of the body's start, global x", value["a_x"]),
            Scalar(f"{body}.a_y", "m/s^2", "acceleration of the body's start, global y", value["a_y"]),
            Scalar(f"{body}.epsilon", "rad/s^2", "angular acceleration of the body", value["epsilon"]),
        ]


def _reactions(
    equations: RigidEquations, rates: _Rates, loads: dict[str, sm.Expr], steps: Steps
) -> dict[sm.Symbol, sm.Expr]:
    """Joint reactions and drive torques: fr + fr* + J^T lambda = 0, one row per free coordinate of a body."""
    magnitude = {equations.magnitude[name]: value for name, value in loads.items()}
    rows = []
    row_names = iter(equations.balance)
    for name in equations.speeds:
        at = equations.coordinates[name]
        for coordinate in (at.x, at.y, at.phi):
            row, balance = next(row_names)
            pushed = sum(c.multiplier * c.residual.diff(coordinate) for c in equations.constraints)
            rows.append((row, (balance + pushed).xreplace(rates.to_symbols).xreplace(magnitude)))
    return solve_blocks(rows, [constraint.multiplier for constraint in equations.constraints], steps)


def _link_scalars(mechanism, name, rates: _Rates, reactions, loads, steps: Steps) -> tuple[Scalar, ...]:
    """The scalars of design formula M q'' + ... = sum s_k f_k, in the link's own axes.

    P(X) starts at P_0 = -(axial part of all forces that act on the link at its origin); its growth along the
    link follows from a_x - g_x and omega^2 and is in the element's geometric terms.
    """
    pose, value, gravity = rates.poses[name], rates.value[name], mechanism.gravity
    a, b = value["a_x"] - gravity[0], value["a_y"] - gravity[1]
    force = [sm.S.Zero, sm.S.Zero]
    for joint in mechanism.joints.values():
        for point, sign in ((joint.second, 1), (joint.first, -1)):
            if point.body == name and point.at == (0, 0):
                on_second = _joint_force(joint, rates, reactions)
                force = [force[k] + sign * on_second[k] for k in range(2)]
    for load_name, load in mechanism.loads.items():
        if load.point.body == name and load.point.at == (0, 0):
            direction = load.direction if load.axes == "global" else pose.turn(load.direction)
            force = [force[k] + loads[load_name] * direction[k] for k in range(2)]
    values = {
        "omega": value["omega"],
        "epsilon": value["epsilon"],
        "a_x": pose.c * a + pose.s * b,
        "a_y": -pose.s * a + pose.c * b,
        "P_0": -(pose.c * force[0] + pose.s * force[1]),
    }
    return tuple(
        Scalar(f"{name}.link.{key}", unit, meaning, steps.assign(sm.Symbol(f"{name}_link_{key}"), values[key]))
        for key, unit, meaning in LINK_SCALARS
    )


def _joint_force(joint, rates: _Rates, reactions) -> tuple[sm.Expr, sm.Expr]:
    """Global force on the second body of a joint."""

    def reaction(row: str) -> sm.Expr:
        return reactions[sm.Symbol(f"{joint.name}_{row}")]

    if joint.kind != "prismatic":
        return reaction("force_x"), reaction("force_y")
    pose = rates.poses[joint.first.body]
    t = pose.turn(joint.direction)
    normal = reaction("normal")
    along = reactions.get(sm.Symbol(f"{joint.name}_drive"), sm.S.Zero)
    return -t[1] * normal + t[0] * along, t[0] * normal + t[1] * along
