"""From the rigid equations to the program of the ``motion`` kernel.

Positions in closed form, then velocities, accelerations and reactions, each by solving the constraint equations
block by block. What comes out are the motion's scalars: those of every elastic link in its own axes
(omega, epsilon, a - g, P_0), the rigid coordinates of every body, every joint reaction and every drive's torque.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import sympy as sm

from kaneflex.derive.elements.parameters import BODY_SCALARS
from kaneflex.derive.equations.closure import UnsupportedLoop, place_bodies
from kaneflex.derive.equations.law_expression import FUNCTIONS, law_expression
from kaneflex.derive.equations.linear import StructurallySingular, solve_blocks
from kaneflex.derive.equations.links import frame_scalars, jump_scalars, link_scalars
from kaneflex.derive.equations.mechanism import SymbolicMechanism
from kaneflex.derive.equations.newton import Loop
from kaneflex.derive.equations.rigid import Drive, Rates, Solved, balance
from kaneflex.derive.equations.springs import spring_scalars
from kaneflex.derive.ir.functions import T, table, table_curvature, table_rate
from kaneflex.derive.ir.names import Names
from kaneflex.derive.ir.program import Program, Scalar, Steps
from kaneflex.mechanism.parts import Load, Mechanism
from kaneflex.mechanism.planar import GROUND, Pose
from kaneflex.support.contract import COURSES
from kaneflex.support.errors import SceneError


@dataclass(frozen=True)
class Motion:
    """The rigid motion as assignments, and the scalars that the elastic stage and the sensors read."""

    steps: tuple[tuple[sm.Symbol, sm.Expr], ...]
    links: dict[str, tuple[Scalar, ...]]
    scalars: tuple[Scalar, ...]
    loops: tuple[Loop, ...] = ()

    @property
    def stored(self) -> tuple[Scalar, ...]:
        """Outputs of the kernel, slot by slot: each link's block first, then every other varying scalar."""
        blocks = [scalar for block in self.links.values() for scalar in block]
        return (*blocks, *(scalar for scalar in self.scalars if not scalar.value.is_number))

    def program(self, parameters: tuple[sm.Symbol, ...]) -> Program:
        """Each link's block first, then every other scalar that is not a constant."""
        outputs = tuple((f"s[{k}]", scalar.value) for k, scalar in enumerate(self.stored))
        return Program("motion", (T, *parameters), self.steps, outputs)


def derive_motion(mechanism: SymbolicMechanism) -> Motion:
    """Solve the rigid mechanism for its motion under its drives.

    The drives' coordinates are free in Kane's equations; their courses are substituted here: a constant speed removes
    every angular acceleration that comes from a drive alone.
    """
    if mechanism.frame:
        return _still(mechanism)
    steps = Steps(symbol for symbol, _ in mechanism.parameters.values())
    solved = _solve(mechanism, drive_courses(mechanism, list(mechanism.drives), steps), steps)
    scalars = []
    for name, drive in solved.drives.items():
        unit = "m" if mechanism.joints[name].slides else "rad"
        scalars.append(Scalar(f"{name}.angle", unit, "coordinate of the drive", drive.angle))
    for name in mechanism.bodies:
        scalars += _body_scalars(name, solved.rates.poses[name], solved.rates.value[name])
    for constraint in solved.rates.constraints:
        value = solved.reactions[constraint.multiplier]
        scalars.append(Scalar(constraint.name, constraint.unit, constraint.meaning, value))
    scalars += [*_load_scalars(mechanism, solved.loads), *solved.springs]
    for name, margin in solved.closure.margins.items():
        scalars.append(Scalar(f"{name}.closure", "1", "margin of the loop: it can't close below zero", margin))
    for name, gap in solved.closure.gaps.items():
        scalars.append(Scalar(f"{name}.gap", "m", "what Newton's method leaves of the loop's gaps", gap))
    elastic = [name for name, body in mechanism.bodies.items() if body.elastic]
    links = {name: link_scalars(mechanism, name, solved, steps) for name in elastic}
    for name in links:
        scalars += jump_scalars(mechanism, name, solved, steps)
    return Motion(tuple(steps.assignments), links, tuple(scalars), solved.closure.loops)


def _solve(mechanism: SymbolicMechanism, drives: dict[str, Drive], steps: Steps) -> Solved:
    angles = {name: drive.angle for name, drive in drives.items()}
    with _naming(mechanism.names):
        closure = place_bodies(mechanism, angles, steps)
        rates = Rates(mechanism, drives, closure.poses, steps)
        loads = _loads(mechanism, drives, steps)
        springs = spring_scalars(mechanism, angles, rates.poses, rates.value, steps)
        pushes = loads | {scalar.name: scalar.value for scalar in springs}
        reactions = _reactions(mechanism, rates, pushes, steps)
    return Solved(drives, rates, loads, springs, reactions, closure)


@contextmanager
def _naming(names: Names) -> Iterator[None]:
    """Say what can't be solved in the scene's names."""
    try:
        yield
    except StructurallySingular as error:
        raise StructurallySingular(names.apply(error.spare_equations), names.apply(error.open_unknowns)) from error
    except UnsupportedLoop as error:
        raise UnsupportedLoop(names.text(str(error))) from error


def _still(mechanism: SymbolicMechanism) -> Motion:
    """A structure that doesn't move: given poses, no rates, and no rigid reactions (they may be indeterminate)."""
    steps = Steps(symbol for symbol, _ in mechanism.parameters.values())
    scalars = _load_scalars(mechanism, _loads(mechanism, {}, steps))
    links = {}
    poses = {GROUND: Pose(sm.S.Zero, sm.S.Zero, sm.S.One, sm.S.Zero)}
    rest = dict.fromkeys(("v_x", "v_y", "omega", "a_x", "a_y", "epsilon"), sm.S.Zero)
    for name, body in mechanism.bodies.items():
        x, y, angle = body.pose
        c, s = (steps.assign(f"{f}_{name}", g(angle)) for f, g in (("c", sm.cos), ("s", sm.sin)))
        poses[name] = pose = Pose(x, y, c, s)
        scalars += _body_scalars(name, pose, rest)
        if body.elastic:
            g_x, g_y = mechanism.gravity
            links[name] = frame_scalars(name, {"a_x": -c * g_x - s * g_y, "a_y": s * g_x - c * g_y}, steps)
    scalars += spring_scalars(mechanism, {}, poses, dict.fromkeys(mechanism.bodies, rest), steps)
    return Motion(tuple(steps.assignments), links, tuple(scalars))


def _load_scalars(mechanism: Mechanism, loads: dict[str, sm.Expr]) -> list[Scalar]:
    unit = {name: load.unit for name, load in mechanism.loads.items()}
    return [Scalar(name, unit[name], "magnitude of the load", value) for name, value in loads.items()]


def drive_courses(mechanism: SymbolicMechanism, names: Sequence[str], steps: Steps) -> dict[str, Drive]:
    """Assign coordinate, speed and acceleration of prescribed drives as functions of time."""
    assigned = {}
    for name in names:
        course = zip(("coordinate", "rate", "acceleration"), _course(mechanism, name, steps), strict=True)
        assigned[name] = Drive(*(steps.assign(f"{name}_{what}", value) for what, value in course))
    return assigned


def _course(mechanism: SymbolicMechanism, name: str, steps: Steps) -> tuple[sm.Expr, sm.Expr, sm.Expr]:
    """theta(t), theta'(t), theta''(t) of a drive."""
    drive = mechanism.drives[name]
    if drive.kind == "law":
        angle = law_expression(drive.law, {"t": T}, mechanism.names.text(f"drives.{name}.law"))
        return angle, angle.diff(T), angle.diff(T, 2)
    if drive.kind == "free":
        starts = [mechanism.symbol(f"drives.{name}.{course}") for course in COURSES]
        return tuple(table(T, start) for start in starts)
    if drive.kind == "table":
        start = mechanism.symbol(f"drives.{name}.table")
        return table(T, start), table_rate(T, start), table_curvature(T, start)
    start = mechanism.symbol(f"drives.{name}.{mechanism.joints[name].start_name}")
    speed = mechanism.symbol(f"drives.{name}.speed")
    if drive.kind == "constant speed":
        return start + speed * T, speed, sm.S.Zero
    # The smooth spin-up of Kane, Ryan & Banerjee (1987): theta'' = (speed / end) (1 - cos(2 pi t / end)) until ``end``.
    end = mechanism.symbol(f"drives.{name}.spin_up")
    tau = steps.assign(f"tau_{name}", sm.Min(T, end))
    turn = steps.assign(f"turn_{name}", 2 * sm.pi * tau / end)
    rise = tau**2 / 2 + (end / (2 * sm.pi)) ** 2 * (sm.cos(turn) - 1)
    return (
        start + speed / end * rise + speed * (T - tau),
        speed / end * (tau - end / (2 * sm.pi) * sm.sin(turn)),
        speed / end * (1 - sm.cos(turn)),
    )


def _loads(mechanism: SymbolicMechanism, drives: dict[str, Drive], steps: Steps) -> dict[str, sm.Expr]:
    states = {name: (drive.angle, drive.speed) for name, drive in drives.items()}
    magnitude = {}
    for name, load in mechanism.loads.items():
        if load.kind == "law":
            check_known(load.law, mechanism, mechanism.names.text(f"loads.{name}.law"))
        elif load.kind == "table":
            check_known(mechanism.names.text(load.against), mechanism, mechanism.names.text(f"loads.{name}.against"))
        magnitude[name] = steps.assign(name, load_size(mechanism, load, states))
    return magnitude


def load_size(
    mechanism: SymbolicMechanism, load: Load, states: Mapping[str, tuple[sm.Expr, sm.Expr]], functions=FUNCTIONS
) -> sm.Expr:
    """Size of a load, by coordinates and speeds of joints; ``functions``: those of its law."""
    path = f"loads.{load.name}"
    if load.kind == "constant":
        return mechanism.symbol(f"{path}.value")
    if load.kind == "table":
        x = T if load.against == "t" else states[load.against.removesuffix("_speed")][load.against.endswith("_speed")]
        return table(x - mechanism.symbol(f"{path}.offset"), mechanism.symbol(f"{path}.table"))
    return law_expression(load.law, law_names(mechanism, states), mechanism.names.text(f"{path}.law"), functions)


def law_names(mechanism: SymbolicMechanism, courses: Mapping[str, tuple[sm.Expr, sm.Expr]]) -> dict[str, sm.Expr]:
    """Names available to a load's law: t, and coordinates and speeds of joints by the names of the scene."""
    names = {"t": T}
    for number, (coordinate, speed) in courses.items():
        drive = mechanism.names.of[number]
        names |= {drive: coordinate, f"{drive}_speed": speed}
    return names


def check_known(law: str, mechanism: SymbolicMechanism, key: str) -> None:
    """Raise SceneError for a law in a coordinate that no drive prescribes: the rigid motion is not solved for it."""
    for joint in map(mechanism.names.of.__getitem__, mechanism.observed):
        if re.search(rf"\b{joint}(_speed)?\b", law):
            reason = f"it knows {joint}, and only preset coupled knows coordinates of joints without a drive"
            raise SceneError(key, law, reason, "Use preset coupled, or write the law in a joint that has a drive")


def _body_scalars(body: str, pose: Pose, value: dict[str, sm.Expr]) -> list[Scalar]:
    """The rigid coordinates of a body and their rates."""
    values = {"x": pose.x, "y": pose.y, "c": pose.c, "s": pose.s, **value}
    return [Scalar(f"{body}.{name}", unit, meaning, values[name]) for name, (unit, meaning) in BODY_SCALARS.items()]


def _reactions(
    mechanism: Mechanism, rates: Rates, pushes: dict[str, sm.Expr], steps: Steps
) -> dict[sm.Symbol, sm.Expr]:
    """Joint reactions and drive torques: fr + fr* + J^T lambda = 0, one row per free coordinate of a body."""
    rows = []
    for name, total in balance(mechanism, rates, pushes).items():
        pose = rates.coordinates[name]
        for row, place, own in zip(("force_x", "force_y", "moment"), (pose.x, pose.y, pose.phi), total, strict=True):
            held = sum(c.multiplier * c.residual.diff(place) for c in rates.constraints)
            rows.append((f"{name}.{row}", own + sm.sympify(held).xreplace(rates.to_symbols)))
    return solve_blocks(rows, [constraint.multiplier for constraint in rates.constraints], steps)
