"""The coupled equations: joint motion and deformation of all bodies together, as programs.

    M(q) q'' = f(t, q, q') + G^T lambda,    g(t, q) = 0,    G q'' + gamma(t, q, q') = 0

q holds every body's x, y, phi and its modal coordinates (see :mod:`kaneflex.derive.flexible`); joints and prescribed
drives are the constraints g, whose multipliers are the joint reactions and the drives' torques. Every body is free in
q, so a body's equations are Kane's of that body alone and no expression grows with the length of the chain.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import sympy as sm

from kaneflex.derive.constraints import Constraint, drive_constraint, joint_constraints
from kaneflex.derive.flexible import flexible_body
from kaneflex.derive.laws import law_expression
from kaneflex.derive.lookups import T, table
from kaneflex.derive.mechanism import Parameters, SymbolicMechanism
from kaneflex.derive.motion import drive_courses, law_names
from kaneflex.derive.places import CoupledBody, Places
from kaneflex.derive.program import Program
from kaneflex.derive.steps import Steps
from kaneflex.mechanism import springs
from kaneflex.mechanism.joints import coordinate as joint_coordinate
from kaneflex.mechanism.parts import Joint, Load, Spring
from kaneflex.mechanism.planar import Pose, dot, minus

Shapes = Mapping[str, tuple[int, ...]]
"""Elastic link -> numbers of its axial and transverse modal coordinates, and 1 where its start moves in its frame."""


@dataclass(frozen=True)
class CoupledEquations:
    """Everything that the kernels of a coupled module are printed from.

    Attributes
    ----------
    bodies : tuple of CoupledBody
    rows : tuple of Constraint
        Joints first, then prescribed drives.
    loads : tuple of (name, Expr)
        Every load with its power.
    springs : (Expr, Expr)
        What all springs store, and the power that their dampers dissipate.
    steps : tuple
        What is assigned before all else: the drives' courses and the loads that depend on time alone.
    parameters : dict
        Path -> (symbol, unit), only those that the equations use.
    """

    mechanism: SymbolicMechanism
    bodies: tuple[CoupledBody, ...]
    rows: tuple[Constraint, ...]
    forcing: tuple[sm.Expr, ...]
    loads: tuple[tuple[str, sm.Expr], ...]
    springs: tuple[sm.Expr, sm.Expr]
    steps: tuple[tuple[sm.Symbol, sm.Expr], ...]
    parameters: dict[str, tuple[sm.Symbol, str]]

    @property
    def q(self) -> tuple[sm.Symbol, ...]:
        return tuple(symbol for body in self.bodies for symbol in body.q)

    @property
    def v(self) -> tuple[sm.Symbol, ...]:
        return tuple(symbol for body in self.bodies for symbol in body.v)

    @property
    def inputs(self) -> tuple[sm.Symbol, ...]:
        """What every kernel reads: the time, q, v and the parameters."""
        return (T, *self.q, *self.v, *(symbol for symbol, _ in self.parameters.values()))


def derive_coupled(mechanism: SymbolicMechanism, shapes: Shapes, rotary: Iterable[str] = ()) -> CoupledEquations:
    """The coupled equations of a mechanism.

    Parameters
    ----------
    shapes : mapping
        Elastic link -> its numbers of axial and of transverse modal coordinates.
    rotary : iterable of str
        Links whose sections have rotary inertia (Rayleigh, Timoshenko), or that carry a lumped one.
    """
    number = Parameters(dict(mechanism.parameters))
    rotary = set(rotary)
    bodies = {
        name: _body(name, shapes.get(name, (0, 0)), name in rotary, mechanism, number) for name in mechanism.bodies
    }
    places = Places(bodies, number)
    steps = Steps(symbol for symbol, _ in number.entries.values())
    prescribed = [name for name, drive in mechanism.drives.items() if drive.kind != "free"]
    courses = drive_courses(mechanism, prescribed, steps)
    rows = [row for joint in mechanism.joints.values() for row in joint_constraints(joint, *_sections(joint, places))]
    for name in prescribed:
        joint, course = mechanism.joints[name], courses[name]
        sections = _sections(joint, places)
        rows.append(drive_constraint(joint, *sections, course.angle, course.speed, course.acceleration))
    q = [symbol for body in bodies.values() for symbol in body.q]
    v = [symbol for body in bodies.values() for symbol in body.v]
    rate = dict(zip(q, v, strict=True))
    total = [entry for body in bodies.values() for entry in body.forcing]
    powers = []
    for name, load in mechanism.loads.items():
        size = _magnitude(mechanism, load, courses, places, rate, steps)
        work = _work(mechanism, load, places)
        powers.append((name, size * sum(component * _rate(path, rate) for component, path in work)))
        for k, symbol in enumerate(q):
            total[k] += size * sum(component * path.diff(symbol) for component, path in work)
    springs = [_spring(mechanism, spring, places, rate) for spring in mechanism.springs.values()]
    for k, symbol in enumerate(q):
        for potential, drag, path in springs:
            total[k] -= potential.diff(symbol) + drag * path.diff(symbol)
    stored = sum((potential for potential, _, _ in springs), sm.S.Zero)
    lost = sum((drag * _rate(path, rate) for _, drag, path in springs), sm.S.Zero)
    used = _used(bodies, rows, [*total, stored, lost], powers, steps)
    parameters = {path: entry for path, entry in number.entries.items() if entry[0] in used}
    return CoupledEquations(
        mechanism,
        tuple(bodies.values()),
        tuple(rows),
        tuple(total),
        tuple(powers),
        (stored, lost),
        tuple(steps.assignments),
        parameters,
    )


def _spring(mechanism, spring: Spring, places: Places, rate) -> tuple[sm.Expr, sm.Expr, sm.Expr]:
    """Potential of a spring, the force of its damper, and the path along which the damper acts: its length or angle.

    1/2 k (L - L_0)^2 and c L'; without free length and damper 1/2 k d . d, which is regular where the points meet.
    """
    if spring.joint is not None:
        path = joint_coordinate(mechanism.joints[spring.joint], *_sections(spring, places))
    else:
        gap = minus(places.place(spring.second), places.place(spring.first))
        path = sm.sqrt(dot(gap, gap))
        if not springs.is_directed(spring):
            return springs.potential(spring, path), sm.S.Zero, sm.S.Zero
    return springs.potential(spring, path), springs.drag(spring, _rate(path, rate)), path


def _used(bodies, rows, total, powers, steps) -> set[sm.Symbol]:
    expressions = [*total, *(row.residual for row in rows), *(row.rate for row in rows)]
    expressions += [row.acceleration for row in rows] + [power for _, power in powers]
    expressions += [expression for _, expression in steps.assignments]
    for body in bodies.values():
        expressions += [*body.mass, body.weight, body.strain, body.dissipated]
    return set().union(*(expression.free_symbols for expression in expressions))


def _rate(expression: sm.Expr, rate: Mapping[sm.Symbol, sm.Symbol]) -> sm.Expr:
    """d/dt of an expression in q."""
    free = sorted(expression.free_symbols & set(rate), key=str)
    return sum((expression.diff(symbol) * rate[symbol] for symbol in free), sm.S.Zero)


_UNITS = {"mass": "kg", "inertia": "kg m^2"}
_LENGTH_UNITS = ("", " m", " m^2", " m^3", " m^4")


def _moment_unit(of: str, factors: tuple[str, ...]) -> str:
    """Shapes have no unit (their coordinates are lengths), so X counts 1, s and w 0, H -1, psi -1 in metres."""
    power = sum({"X": 1, "Y": 1, "H": -1, "p": -1}.get(factor[0], 0) for factor in factors) + 2 * (of == "inertia")
    return "kg" + {0: "", 1: " m"}.get(power, f" m^{power}")


def _body(
    name: str, shapes: tuple[int, ...], rotary: bool, mechanism: SymbolicMechanism, number: Parameters
) -> CoupledBody:
    """Kane's equations of a body in symbols of its own, with the stiffness and damping of its modal coordinates."""
    axial, transverse, *moves = shapes
    free = flexible_body(axial, transverse, rotary or not axial + transverse)
    own = {symbol: sm.Symbol(f"{name}_{symbol}") for symbol in (*free.q, *free.v)}
    own |= {
        moment.symbol: number(f"bodies.{name}.{moment.name}", _moment_unit(moment.of, moment.factors))
        for moment in free.moments
    }
    own |= dict(zip(free.gravity, mechanism.gravity, strict=True))
    q, v = (tuple(own[symbol] for symbol in symbols) for symbols in (free.q, free.v))
    forcing = free.forcing.xreplace(own)
    strain, dissipated = sm.S.Zero, sm.S.Zero
    for k, symbol in enumerate(q[3:]):
        strain += number(f"bodies.{name}.stiffness_{k}", "N/m") * symbol**2 / 2
        for j in range(axial + transverse):
            if (j < axial) == (k < axial):
                damping = number(f"bodies.{name}.damping_{min(j, k)}_{max(j, k)}", "N s/m")
                dissipated += damping * v[3 + j] * v[3 + k]
    elastic = sm.Matrix([strain.diff(symbol) for symbol in q]) + sm.Matrix(
        [dissipated.diff(symbol) / 2 for symbol in v]
    )
    return CoupledBody(
        name,
        axial,
        transverse,
        bool(moves),
        q,
        v,
        free.mass.xreplace(own),
        forcing - elastic,
        free.weight.xreplace(own),
        strain,
        dissipated,
    )


def _sections(held: Joint | Spring, places: Places) -> list[Pose]:
    """The two sections that a joint holds, or that a spring acts on."""
    return [places.section(side) for side in held.sides]


def _magnitude(mechanism, load: Load, courses, places: Places, rate, steps: Steps) -> sm.Expr:
    """Size of a load: assigned where it depends on time alone, an expression where a free joint's motion decides."""
    if load.kind == "constant":
        return mechanism.symbol(f"loads.{load.name}.value")

    def coordinate(name: str) -> tuple[sm.Expr, sm.Expr]:
        if name in courses:
            return courses[name].angle, courses[name].speed
        joint = mechanism.joints[name]
        angle = joint_coordinate(joint, *_sections(joint, places))
        return angle, _rate(angle, rate)

    if load.kind == "table":
        x = coordinate(load.against)[0] if load.against in mechanism.drives else T
        size = table(x - mechanism.symbol(f"loads.{load.name}.offset"), mechanism.symbol(f"loads.{load.name}.table"))
    else:
        names = law_names(mechanism, {name: coordinate(name) for name in mechanism.drives})
        size = law_expression(load.law, names, mechanism.names.text(f"loads.{load.name}.law"))
    if size.free_symbols & ({*rate} | {*rate.values()}):
        return size
    return steps.assign(sm.Symbol(f"size_{load.name}"), size)


def _work(mechanism: SymbolicMechanism, load: Load, places: Places) -> list[tuple[sm.Expr, sm.Expr]]:
    """Pairs of a component of the unit load and the path along which it works."""
    if load.joint is not None:
        joint = mechanism.joints[load.joint]
        return [(sm.S.One, joint_coordinate(joint, *_sections(joint, places)))]
    at = load.point if load.spread is None else load.spread[0]
    direction = load.direction if load.axes == "global" else places.section(at).turn(load.direction)
    path = places.place(load.point) if load.spread is None else places.spread(load.name, at.body)
    return list(zip(direction, path, strict=True))


@dataclass(frozen=True)
class Residual:
    """R = (M a - f - G^T lambda, G a + gamma) with the symbols of a and lambda; M, G and gamma by themselves."""

    a: tuple[sm.Symbol, ...]
    multipliers: tuple[sm.Symbol, ...]
    entries: list[sm.Expr]
    mass: sm.Matrix
    jacobian: sm.Matrix
    gamma: list[sm.Expr]


def residual(equations: CoupledEquations) -> Residual:
    """What vanishes at every instant of a motion."""
    q, rows = equations.q, equations.rows
    n, rate = len(q), dict(zip(q, equations.v, strict=True))
    mass = sm.diag(*(body.mass for body in equations.bodies))
    jacobian = [[row.residual.diff(symbol) for symbol in q] for row in rows]
    gamma = [_rate(_rate(row.residual, rate), rate) + row.acceleration for row in rows]
    a = tuple(sm.Symbol(f"accel_{k}") for k in range(n))
    multipliers = tuple(sm.Symbol(f"multiplier_{k}") for k in range(len(rows)))
    balance = [
        sum((mass[k, j] * a[j] for j in range(n) if mass[k, j] != 0), sm.S.Zero)
        - equations.forcing[k]
        - sum((multipliers[i] * jacobian[i][k] for i in range(len(rows)) if jacobian[i][k] != 0), sm.S.Zero)
        for k in range(n)
    ]
    closing = [
        gamma[i] + sum((jacobian[i][j] * a[j] for j in range(n) if jacobian[i][j] != 0), sm.S.Zero)
        for i in range(len(rows))
    ]
    G = sm.Matrix(len(rows), n, lambda i, j: jacobian[i][j])
    return Residual(a, multipliers, [*balance, *closing], mass, G, gamma)


def programs(equations: CoupledEquations) -> tuple[Program, ...]:
    """The kernels' programs: ``equations``, ``constraints``, ``stiffness`` and ``energy``."""
    q, v, rows, found = equations.q, equations.v, equations.rows, residual(equations)
    dynamic = _matrix("M", found.mass) + _vector("f", equations.forcing)

    holonomic = _vector("g", [row.residual for row in rows]) + _vector("g_t", [row.rate for row in rows])
    holonomic += _matrix("G", found.jacobian) + _vector("gamma", found.gamma)

    tangent = _matrix("K", _gradient(found.entries, q)) + _matrix("C", _gradient(found.entries, v))

    energies = [sum((body.weight for body in equations.bodies), sm.S.Zero)]
    energies += [sum((body.strain for body in equations.bodies), equations.springs[0])]
    energies += [sum((body.dissipated for body in equations.bodies), equations.springs[1])]
    energies += [power for _, power in equations.loads]

    def program(name: str, outputs, more: tuple[sm.Symbol, ...] = ()) -> Program:
        return Program(name, (*equations.inputs, *more), equations.steps, tuple(outputs))

    return (
        program("equations", dynamic),
        program("constraints", holonomic),
        program("tangent", tangent, (*found.a, *found.multipliers)),
        program("energy", _vector("out", energies)),
    )


def _gradient(expressions: list[sm.Expr], symbols: tuple[sm.Symbol, ...]) -> sm.Matrix:
    rows = []
    for expression in expressions:
        present = expression.free_symbols
        rows.append([expression.diff(symbol) if symbol in present else sm.S.Zero for symbol in symbols])
    return sm.Matrix(rows)


def _matrix(name: str, matrix: sm.Matrix) -> list[tuple[str, sm.Expr]]:
    return [
        (f"{name}[{i}, {j}]", matrix[i, j]) for i in range(matrix.rows) for j in range(matrix.cols) if matrix[i, j] != 0
    ]


def _vector(name: str, entries: Iterable[Any]) -> list[tuple[str, sm.Expr]]:
    return [(f"{name}[{k}]", sm.sympify(entry)) for k, entry in enumerate(entries)]
