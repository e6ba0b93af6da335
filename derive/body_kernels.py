"""Texts of the kernels of a body: their inputs and outputs around the loops of its equations."""

from __future__ import annotations

from itertools import pairwise

import sympy as sm

from kaneflex.derive.body_equations import (
    ACROSS,
    ALONG,
    EPSILON,
    MOTION,
    OMEGA,
    BodyEquations,
    body_equations,
    place,
)  # fmt: skip
from kaneflex.derive.loops import COORDINATES, Loops, added, code
from kaneflex.support.contract import BODY_BLOCK, POINT_BLOCK

B, A = COORDINATES["s"], COORDINATES["w"]
C, S, TURN = sm.symbols("c s turn")
_OUT = {"s": "3 + j", "w": "3 + axial + j"}
"""Row of the j-th shape of a kind."""
_BEFORE_ROW = ("", "n + ", "2 * n + ")
_COLUMN = {"s": "3 + l", "w": "3 + axial + l"}


def kernels() -> list[str]:
    """Text of every kernel."""
    return [_deform(), _push(), _jacobian(), _inverse(), _inertia(), _energy()]


def _place() -> list[sm.Expr]:
    """xi, eta and the rotation of a point with one shape of each kind, in the body's axes."""
    return list(place([B[0]], [A[0]]))


def _rate(expression: sm.Expr) -> sm.Expr:
    """d/dt: every coordinate's derivative is the next of its symbols."""
    return sum((expression.diff(x) * rate for of in (B, A) for x, rate in pairwise(of)), sm.S.Zero)


def _added(loops: Loops, expressions: dict[str, sm.Expr]) -> dict[str, list[str]]:
    """A statement for each shape that adds its equation to its row."""
    return {axis: added(f"out[k + {_OUT[axis]}]", loops.row(axis, row)) for axis, row in expressions.items()}


def _filled(template: str, lines: list[str], **expressions: sm.Expr) -> str:
    """The text of a kernel around its loops, with what is computed of their sums."""
    texts = {name: code(expression) for name, expression in expressions.items()}
    return template.format(loops="\n    ".join(lines), **texts)


def _deform() -> str:
    loops, motions = Loops(POINT_BLOCK), [_place()]
    motions += [[_rate(x) for x in motions[0]]]
    motions += [[_rate(x) for x in motions[1]]]
    names = [f"{name}{order or ''}" for order in range(3) for name in ("x", "y", "turn")]
    for name, expression in zip(names, (x for motion in motions for x in motion), strict=True):
        loops.total(name, expression)
    return _filled(DEFORM, loops.text())


def _push() -> str:
    xi, eta, turn = _place()
    loops = Loops(POINT_BLOCK, (ALONG, ACROSS, TURN))
    power = ALONG * xi + ACROSS * eta + TURN * turn
    rows = _added(loops, {axis: power.diff(x) for axis, (x, *_) in COORDINATES.items()})
    loops.total("xi", xi)
    loops.total("eta", eta)
    return _filled(PUSH, loops.text(rows), moment=loops.scalar(ACROSS * xi - ALONG * eta))


def _jacobian() -> str:
    xi, eta, turn = _place()
    loops = Loops(POINT_BLOCK, (C, S))
    twist = (C * xi - S * eta, S * xi + C * eta, turn)
    rows = {
        axis: [
            f"out[k + {at}{_OUT[axis]}] = {code(loops.row(axis, component.diff(x)))}"
            for at, component in zip(_BEFORE_ROW, twist, strict=True)
        ]
        for axis, (x, *_) in COORDINATES.items()
    }
    loops.total("xi", xi)
    loops.total("eta", eta)
    return _filled(JACOBIAN, loops.text(rows), x=loops.scalar(-twist[1].expand()), y=loops.scalar(twist[0].expand()))


def _first_moments(loops: Loops, equations: BodyEquations, *wanted: str) -> None:
    """Name sums after where they stand in the force: e, first moment of mass, its rates; the second moment."""
    f_x, f_y, turn = (sm.Poly(entry, *MOTION) for entry in equations.forces[:3])
    sums = {
        "e_x": f_y.coeff_monomial(EPSILON),
        "e_y": -f_x.coeff_monomial(EPSILON),
        "e_x1": f_y.coeff_monomial(OMEGA) / 2,
        "e_y1": -f_x.coeff_monomial(OMEGA) / 2,
        "e_x2": f_x.coeff_monomial(1),
        "e_y2": f_y.coeff_monomial(1),
        "second": turn.coeff_monomial(EPSILON),
        "rate": turn.coeff_monomial(OMEGA),
        "turned": turn.coeff_monomial(1),
    }
    for name in wanted or sums:
        loops.total(name, sums[name].expand())


def _inverse() -> str:
    equations = body_equations()
    f_x, f_y, turn, f_b, f_a = equations.forces
    loops = Loops(BODY_BLOCK, MOTION)
    rows = _added(loops, {"s": f_b, "w": f_a})
    _first_moments(loops, equations)
    force = {"f_x": loops.scalar(f_x), "f_y": loops.scalar(f_y), "moment": loops.scalar(turn)}
    return _filled(INVERSE, loops.text(rows), **force)


def _inertia() -> str:
    equations = body_equations()
    M = equations.mass
    loops = Loops(BODY_BLOCK, (C, S))

    def turned(column: int) -> tuple[sm.Expr, ...]:
        """A column of M with its force in global components."""
        along, across, moment = M[:3, column]
        return C * along - S * across, S * along + C * across, moment

    rows, stores = {"s": [], "w": []}, {"s": {}, "w": {}}
    for own, axis in enumerate("sw", start=3):
        for column, at, entry in zip(("", " + 1", " + 2"), _BEFORE_ROW, turned(own), strict=True):
            both = f"out[k + {at}{_OUT[axis]}] = out[k + n * ({_OUT[axis]}){column}]"
            rows[axis].append(f"{both} = {code(loops.row(axis, entry))}")
        for other_own, other in enumerate("sw", start=3):
            entry = loops.matrix(axis, other, M[own, other_own])
            stores[axis][other] = [f"out[k + n * ({_OUT[axis]}) + {_COLUMN[other]}] = {entry}"]
    _first_moments(loops, equations, "e_x", "e_y", "second")
    x, y, second = (loops.scalar(entry) for entry in turned(2))
    return _filled(INERTIA, loops.text(rows, stores), x=x, y=y, second=second)


def _energy() -> str:
    equations = body_equations()
    loops = Loops(BODY_BLOCK, MOTION)
    _first_moments(loops, equations, "e_x", "e_y", "e_x1", "e_y1", "second")
    kinetic = sm.Poly(equations.kinetic, *MOTION)
    loops.total("swept", kinetic.coeff_monomial(OMEGA))
    loops.total("shaken", kinetic.coeff_monomial(1))
    loops.total("strain", equations.strain)
    loops.total("lost", equations.lost)
    kinetic = "\n    ".join(added("out[0]", loops.scalar(equations.kinetic)))
    return ENERGY.format(loops="\n    ".join(loops.text()), kinetic=kinetic)


DEFORM = '''@njit(**OPTIONS)
def deform(p, o, q, v, a, i, out, k):
    """Store a point in the body's axes: its place, the rotation of its section, their rates and accelerations."""
    {loops}
    out[k], out[k + 1], out[k + 2] = x, y, turn
    out[k + 3], out[k + 4], out[k + 5] = x1, y1, turn1
    out[k + 6], out[k + 7], out[k + 8] = x2, y2, turn2
'''

PUSH = '''@njit(**OPTIONS)
def push(p, o, q, i, c, s, x, y, turn, out, k):
    """Add the generalised forces W^T F of a force (x, y, global) and a moment at a point."""
    along, across = c * x + s * y, c * y - s * x
    {loops}
    out[k] += p[o + SHARE] * x
    out[k + 1] += p[o + SHARE] * y
    out[k + 2] += {moment} + turn
'''

JACOBIAN = '''@njit(**OPTIONS)
def jacobian(p, o, q, i, c, s, out, k):
    """Store W (3, 3 + shapes) row by row: the twist of the section at a point per speed of frame and shapes."""
    n = 3 + shapes
    {loops}
    out[k], out[k + 1], out[k + 2] = p[o + SHARE], 0.0, {x}
    out[k + n], out[k + n + 1], out[k + n + 2] = 0.0, p[o + SHARE], {y}
    out[k + 2 * n], out[k + 2 * n + 1], out[k + 2 * n + 2] = 0.0, 0.0, 1.0
'''

INVERSE = '''@njit(**OPTIONS)
def inverse(p, o, q, v, a, i, c, s, omega, x, y, epsilon, out, k):
    """Add M u' - f, the generalised forces that a motion takes; x, y: acceleration of the start less gravity."""
    along, across = c * x + s * y, c * y - s * x
    {loops}
    f_x = {f_x}
    f_y = {f_y}
    out[k] += c * f_x - s * f_y
    out[k + 1] += s * f_x + c * f_y
    out[k + 2] += {moment}
'''

INERTIA = '''@njit(**OPTIONS)
def inertia(p, o, q, i, c, s, out, k):
    """Store the mass matrix (3 + shapes, 3 + shapes), row by row."""
    n = 3 + shapes
    {loops}
    out[k] = out[k + n + 1] = p[o + MASS]
    out[k + 1] = out[k + n] = 0.0
    out[k + 2] = out[k + 2 * n] = {x}
    out[k + n + 2] = out[k + 2 * n + 1] = {y}
    out[k + 2 * n + 2] = {second}
'''

ENERGY = '''@njit(**OPTIONS)
def energy(p, o, q, v, i, c, s, v_x, v_y, omega, out):
    """Add kinetic energy, strain energy [J], dissipated power [W]; return mass times its centre's place from r."""
    along, across = c * v_x + s * v_y, c * v_y - s * v_x
    {loops}
    {kinetic}
    out[1] += strain
    out[2] += lost
    return c * e_x - s * e_y, s * e_x + c * e_y
'''
