"""The rigid stage: Kane's equations of the mechanism with every drive coordinate free.

Each body has three absolute coordinates: x, y of its start, angle phi; each joint of the scene is a holonomic
constraint. Absolute coordinates keep every expression as short as its own body, whatever the length of the chain; the
multipliers of the constraints are the joint reactions, and the multiplier of a drive is its torque (inverse dynamics).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import sympy as sm
from sympy.physics.mechanics import KanesMethod, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

from kaneflex.derive.equations.linear import solve_blocks
from kaneflex.derive.equations.newton import Loop
from kaneflex.derive.ir.program import Scalar, Steps
from kaneflex.mechanism.force_parts import Spring
from kaneflex.mechanism.joints import coordinate, drive_reaction, reactions, residuals
from kaneflex.mechanism.parts import Joint, Mechanism
from kaneflex.mechanism.planar import GROUND, BodyPoint, Pose, Vector, carried_acceleration, minus, pose_at

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


@dataclass(frozen=True)
class RigidEquations:
    """Kane's equations fr + fr* = 0 of the free bodies, and the constraints between them.

    Attributes
    ----------
    coordinates : dict
        Body -> its pose by absolute coordinates x, y, phi, functions of time; the ground's are zero.
    speeds : dict
        Body -> generalised speeds (v_x, v_y, omega), functions of time.
    balance : tuple of (name, Expr)
        fr + fr*, one per speed, in terms of speeds and their derivatives.
    constraints : tuple of Constraint
        Joints first, then drives.
    drive_coordinate : dict
        Drive -> its coordinate as a function of time.
    magnitude : dict
        Load -> symbol of its magnitude [N]; likewise the components of springs' forces and their torques.
    """

    coordinates: dict[str, Pose]
    speeds: dict[str, tuple[sm.Expr, sm.Expr, sm.Expr]]
    balance: tuple[tuple[str, sm.Expr], ...]
    constraints: tuple[Constraint, ...]
    drive_coordinate: dict[str, sm.Expr]
    magnitude: dict[str, sm.Symbol]


def rigid_equations(mechanism: Mechanism) -> RigidEquations:
    """Kane's equations of free bodies (Kane & Levinson 1985, ch. 6), beside constraints of joints and drives."""
    ground, origin = ReferenceFrame(GROUND), Point("origin")
    origin.set_vel(ground, 0)
    free = _Free(ground)
    coordinates, speeds = {GROUND: pose_at(sm.S.Zero, sm.S.Zero, sm.S.Zero, sm.cos, sm.sin)}, {}
    kinematics: list[sm.Expr] = []
    for name, body in mechanism.bodies.items():
        places = dynamicsymbols(f"x_{name} y_{name} phi_{name}")
        rates = dynamicsymbols(f"v_x_{name} v_y_{name} omega_{name}")
        kinematics += [rate - place.diff(TIME) for place, rate in zip(places, rates, strict=True)]
        coordinates[name], speeds[name] = pose_at(*places, sm.cos, sm.sin), tuple(rates)
        frame, start = ReferenceFrame(name), Point(f"{name}_start")
        frame.orient_axis(ground, ground.z, places[2])
        frame.set_ang_vel(ground, rates[2] * ground.z)
        start.set_pos(origin, places[0] * ground.x + places[1] * ground.y)
        start.set_vel(ground, rates[0] * ground.x + rates[1] * ground.y)
        free.points[name] = frame, start
        free.add(name, BodyPoint(name, "centre", body.centre), body.mass, body.inertia)
    for mass in mechanism.masses.values():
        free.add(mass.name, mass.point, mass.mass, mass.inertia)
    constraints, drive_coordinate = _constraints(mechanism, coordinates)
    g_x, g_y = mechanism.gravity
    free.loads += [(body.masscenter, body.mass * (g_x * ground.x + g_y * ground.y)) for body in free.bodies]
    magnitude = {}
    for name, load in mechanism.loads.items():
        magnitude[name] = sm.Symbol(name)
        if load.joint is not None:
            free.turn(mechanism.joints[load.joint], magnitude[name])
            continue
        for at, share in load.pushes:
            frame, point = free.point(at, f"{name}_{at.name}")
            axes = ground if load.axes == "global" else frame
            along = load.direction[0] * axes.x + load.direction[1] * axes.y
            free.loads.append((point, magnitude[name] * share * along))
    for spring in mechanism.springs.values():
        magnitude |= _add_spring(free, mechanism, spring)
    # Every coordinate free: the constraints enter by their multipliers, not by dependent speeds.
    places = [place for name in speeds for place in (coordinates[name].x, coordinates[name].y, coordinates[name].phi)]
    kane = KanesMethod(ground, q_ind=places, u_ind=[u for of in speeds.values() for u in of], kd_eqs=kinematics)
    fr, fr_star = kane.kanes_equations(free.bodies, free.loads)
    total = {speed: fr[k] + fr_star[k] for k, speed in enumerate(kane.u)}
    balance = tuple(
        (f"{name}.{row}", total[speed])
        for name, triple in speeds.items()
        for row, speed in zip(("force_x", "force_y", "moment"), triple, strict=True)
    )
    return RigidEquations(coordinates, speeds, balance, constraints, drive_coordinate, magnitude)


@dataclass
class _Free:
    """Bodies and loads of Kane's equations; ``points``: axes and start of each body."""

    ground: ReferenceFrame
    points: dict[str, tuple[ReferenceFrame, Point]] = field(default_factory=dict)
    bodies: list[RigidBody] = field(default_factory=list)
    loads: list[tuple[Point | ReferenceFrame, object]] = field(default_factory=list)

    def point(self, at: BodyPoint, name: str) -> tuple[ReferenceFrame, Point]:
        """A point of a body with its velocity, and the body's axes."""
        frame, start = self.points[at.body]
        point = start.locatenew(name, at.at[0] * frame.x + at.at[1] * frame.y)
        point.v2pt_theory(start, self.ground, frame)
        return frame, point

    def add(self, name: str, at: BodyPoint, mass: sm.Expr, moment: sm.Expr) -> None:
        """A mass whose centre is a point of a body, with its moment of inertia about it."""
        frame, point = self.point(at, f"{name}_point")
        self.bodies.append(RigidBody(name, point, frame, mass, (inertia(frame, 0, 0, moment), point)))

    def turn(self, joint: Joint, torque: sm.Expr) -> None:
        """A torque on the second body of a joint, and its opposite on the first."""
        for side, sign in zip(joint.sides, (-1, 1), strict=True):
            if side.body != GROUND:
                self.loads.append((self.points[side.body][0], sign * torque * self.ground.z))


def _add_spring(free: _Free, mechanism: Mechanism, spring: Spring) -> dict[str, sm.Symbol]:
    """A spring's force on its second point and the opposite on the first, or its torque, by their symbols."""
    if spring.joint is not None:
        torque = sm.Symbol(f"{spring.name}.torque")
        free.turn(mechanism.joints[spring.joint], -torque)  # a positive torque turns back
        return {torque.name: torque}
    force = [sm.Symbol(f"{spring.name}.force_{axis}") for axis in "xy"]
    for side, sign in zip(spring.sides, (-1, 1), strict=True):
        if side.body != GROUND:
            _, point = free.point(side, f"{spring.name}_{side.body}")
            free.loads.append((point, sign * (force[0] * free.ground.x + force[1] * free.ground.y)))
    return {symbol.name: symbol for symbol in force}


def _constraints(
    mechanism: Mechanism, coordinates: dict[str, Pose]
) -> tuple[tuple[Constraint, ...], dict[str, sm.Expr]]:
    """Constraints of the joints, then of the drives, whose coordinates are functions of time."""

    def sections(joint: Joint) -> list[Pose]:
        return [coordinates[side.body].section(side.at) for side in joint.sides]

    found = [
        Constraint(*reaction, residual)
        for joint in mechanism.joints.values()
        for reaction, residual in zip(reactions(joint), residuals(joint, *sections(joint)), strict=True)
    ]
    drive_coordinate = {name: dynamicsymbols(f"drive_{name}") for name in mechanism.drives}
    for name, angle in drive_coordinate.items():
        joint = mechanism.joints[name]
        found.append(Constraint(*drive_reaction(joint), coordinate(joint, *sections(joint)) - angle))
    return tuple(found), drive_coordinate


@dataclass(frozen=True)
class Drive:
    """Coordinate of a drive with its first and second time derivative."""

    angle: sm.Expr
    speed: sm.Expr
    acceleration: sm.Expr


_SPEEDS, _ACCELERATIONS = ("v_x", "v_y", "omega"), ("a_x", "a_y", "epsilon")


class Rates:
    """Velocities and accelerations of all bodies, and the substitution that brings equations to these symbols."""

    def __init__(self, mechanism, equations: RigidEquations, drives, poses: dict[str, Pose], steps: Steps):
        self.poses = poses
        self.to_symbols: dict[sm.Expr, sm.Expr] = {}
        rate: dict[sm.Expr, sm.Expr] = {}
        for name in mechanism.bodies:
            at, pose = equations.coordinates[name], poses[name]
            self.to_symbols |= {at.c: pose.c, at.s: pose.s, at.x: pose.x, at.y: pose.y}
            for order, letters in enumerate((_SPEEDS, _ACCELERATIONS), start=1):
                rates = (place.diff(TIME, order) for place in (at.x, at.y, at.phi))
                rate |= zip(rates, _of_body(name, letters), strict=True)
        for name, angle in equations.drive_coordinate.items():
            rate |= {angle.diff(TIME): drives[name].speed, angle.diff(TIME, 2): drives[name].acceleration}

        def solved(order: int, letters: Sequence[str], known: dict[sm.Symbol, sm.Expr]) -> dict[sm.Symbol, sm.Expr]:
            """Velocities by J v = -dg/dt, accelerations by J a = -dJ/dt v, of total derivatives of constraints g."""
            rows = [
                (c.name, c.residual.diff(TIME, order).xreplace(rate).xreplace(self.to_symbols).xreplace(known))
                for c in equations.constraints
            ]
            return solve_blocks(rows, [u for name in mechanism.bodies for u in _of_body(name, letters)], steps)

        velocity = solved(1, _SPEEDS, {})
        found = velocity | solved(2, _ACCELERATIONS, velocity)
        self.value: dict[str, dict[str, sm.Expr]] = {}
        for name in mechanism.bodies:
            letters = (*_SPEEDS, *_ACCELERATIONS)
            self.value[name] = value = {u: found[of] for u, of in zip(letters, _of_body(name, letters), strict=True)}
            for speed, v, a in zip(equations.speeds[name], _SPEEDS, _ACCELERATIONS, strict=True):
                self.to_symbols |= {speed.diff(TIME): value[a], speed: value[v]}

    def specific_force(self, body: str, point: BodyPoint, gravity: Vector) -> Vector:
        """a - g of a body-fixed point, global: a_O + epsilon S R r - omega^2 R r - g."""
        value = self.value[body]
        x, y = carried_acceleration(self.poses[body].turn(point.at), value["omega"], value["epsilon"])
        return minus((value["a_x"] + x, value["a_y"] + y), gravity)


def _of_body(name: str, letters: Sequence[str]) -> list[sm.Symbol]:
    return [sm.Symbol(f"{letter}_{name}") for letter in letters]


@dataclass(frozen=True)
class Solved:
    """The rigid motion in symbols: drives, rates, loads, springs, reactions by multiplier, the loops' margins."""

    drives: dict[str, Drive]
    rates: Rates
    loads: dict[str, sm.Expr]
    springs: list[Scalar]
    reactions: dict[sm.Symbol, sm.Expr]
    margins: dict[str, sm.Expr]
    gaps: dict[str, sm.Expr]
    loops: tuple[Loop, ...]
