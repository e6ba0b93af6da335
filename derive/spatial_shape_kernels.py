"""The module of bodies in space that deform: loops over their shapes, printed once for any number of them.

Kane's equations of a body with two shapes (:mod:`kaneflex.derive.spatial_shapes`) have all that there is for more: what
stands before moments of the first shape alone is summed over all shapes, what stands before those of both over all
pairs. Nothing is printed that is not proved (:mod:`kaneflex.derive.spatial_shape_proof`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from itertools import combinations_with_replacement
from textwrap import indent, wrap

import sympy as sm

from kaneflex.derive import module_text
from kaneflex.derive.loops import added, code
from kaneflex.derive.names import Names
from kaneflex.derive.printers import numba_printer as emit
from kaneflex.derive.spatial_shape_proof import prove
from kaneflex.derive.spatial_shapes import (
    ACCEL,
    EPSILON,
    MOTION,
    PAIR,
    SINGLE,
    XYZ,
    coordinates,
    pair,
    shaped_equations,
    single,
)  # fmt: skip

STRIDE = len(PAIR) + 2
"""Numbers of a pair: its moments, stiffness and damping."""
_FORCES = ("f_x", "f_y", "f_z", "m_x", "m_y", "m_z")
_OF = {"single": (0,), "pair": (0, 1)}


@cache
def spatial_shapes_text() -> str:
    """Text of ``generated/spatial_shapes.py``.

    Raises
    ------
    NotKane
        If a kernel differs from the derived equations.
    """
    kernels = kernels_text()
    prove(kernels)
    section, raw = _section()
    before, after = emit.operations([(section, raw)])["section"]
    counted = f"Operations of section, written out -> with shared subexpressions: {before} -> {after}."
    about = [*wrap(_ABOUT.strip(), 118), counted, "", module_text.UNCHECKED]
    tables = [
        module_text.literal("SINGLE", SINGLE, "p: the numbers of shape j begin at o + 12 j"),
        module_text.literal(
            "PAIR", (*PAIR, "stiffness", "damping"), f"those of j and l at o + 12 n + {STRIDE} (n j + l)"
        ),
    ]
    printed = [kernels, *emit.print_kernels([section], Names({}))]
    return module_text.module("Bodies in space that deform", about, tables, printed)


def kernels_text() -> str:
    """Text of the kernels that loop over shapes, which has not been proved."""
    return "\n\n".join([_demand(), _inertia()])


def _reads() -> dict[sm.Symbol, sm.Symbol]:
    """Moments of the first shape, and of it with the second, as they are read in the loops."""
    found = {single(name, 0): sm.Symbol(f"p[{emit.offset('j1', k)}]") for k, name in enumerate(SINGLE)}
    return found | {pair(name, 0, 1): sm.Symbol(f"p[{emit.offset('jl', k)}]") for k, name in enumerate(PAIR)}


def _coefficients(expression: sm.Expr, kind: str) -> dict[sm.Symbol, sm.Expr]:
    """Coefficients of the moments of one shape or of a pair, for loops over all of them.

    A product of both coordinates belongs to the pair in whose order the first one's is of lower rank; of equal ones
    either order has a half.
    """
    of = [single(name, 0) for name in SINGLE] if kind == "single" else [pair(name, 0, 1) for name in PAIR]
    found, first, second = {}, coordinates(0), coordinates(1)
    for moment in of:
        whole = expression.coeff(moment)
        if kind == "pair" and whole.has(*first):
            terms = sm.Poly(whole, *first, *second).terms()
            whole = sm.S.Zero
            for powers, coefficient in terms:
                j, l = powers[:3].index(1), powers[3:].index(1)
                if j <= l:
                    whole += coefficient * first[j] * second[l] / (2 if j == l else 1)
        if whole != 0:
            found[moment] = whole
    return found


class _Motion:
    """Factors of the motion that the loops take as they are, named before they begin."""

    def __init__(self) -> None:
        self.names: dict[sm.Expr, sm.Symbol] = {}

    def summed(self, coefficients: dict[sm.Symbol, sm.Expr], unknowns: Sequence[sm.Symbol]) -> sm.Expr:
        """The sum of moments times their coefficients, with the factors' names."""
        total = sm.S.Zero
        for moment, coefficient in coefficients.items():
            inner = sm.S.Zero
            for powers, factor in sm.Poly(coefficient, *unknowns).terms():
                product = sm.Mul(*(u**power for u, power in zip(unknowns, powers, strict=True)))
                inner += product * self._named(factor)
            total += _reads()[moment] * inner
        return total

    def _named(self, factor: sm.Expr) -> sm.Expr:
        number, rest = factor.expand().as_content_primitive()
        if rest.could_extract_minus_sign():
            number, rest = -number, -rest
        if not rest.is_Add:
            return number * rest
        if rest not in self.names:
            self.names[rest] = sm.Symbol(f"c{len(self.names)}")
        return number * self.names[rest]

    def lines(self) -> list[str]:
        return [f"{symbol} = {code(factor)}" for factor, symbol in self.names.items()]


_LOCAL = dict(zip((*coordinates(0), *coordinates(1)), sm.symbols("q_j v_j b_j q_l v_l b_l"), strict=True))


def _statements(values: dict[str, sm.Expr], prefix: str, store: Callable[[str, sm.Expr], list[str]]) -> list[str]:
    """Statements for expressions by their targets, with what they have in common."""
    given = {target: value.xreplace(_LOCAL) for target, value in values.items() if value != 0}
    shared, reduced = sm.cse(list(given.values()), symbols=sm.numbered_symbols(prefix), order="canonical")
    lines = [f"{symbol} = {code(value)}" for symbol, value in shared]
    return lines + [line for target, value in zip(given, reduced, strict=True) for line in store(target, value)]


def _demand() -> str:
    """Kernel of inertia forces beyond those of the rigid body."""
    equations, motion = shaped_equations(2), _Motion()
    unknowns = (*coordinates(0), *coordinates(1))
    loops = {}
    for kind in _OF:
        values = {name: motion.summed(_coefficients(equations[k], kind), unknowns) for k, name in enumerate(_FORCES)}
        values["row"] = motion.summed(_coefficients(equations[6], kind), unknowns)
        if kind == "pair":
            stiffness, damping = (sm.Symbol(f"p[{emit.offset('jl', len(PAIR) + k)}]") for k in range(2))
            values["row"] += stiffness * coordinates(1)[0] + damping * coordinates(1)[1]
        loops[kind] = _statements(values, "x" if kind == "single" else "y", added)
    reads = [", ".join(map(str, MOTION[n : n + 3])) + " = "
             + ", ".join(f"w[{emit.offset('k', n + i)}]" for i in range(3)) for n in (0, 3, 6)]  # fmt: skip
    return _DEMAND[1:].format(
        reads="\n    ".join(reads), motion=indent("\n".join(motion.lines()), " " * 4), stride=STRIDE,
        single=indent("\n".join(loops["single"]), " " * 8), pair=indent("\n".join(loops["pair"]), " " * 12),
    )  # fmt: skip


def _inertia() -> str:
    """The mass matrix beyond the rigid body's."""
    equations, motion = shaped_equations(2), _Motion()
    rates, own, other = (*ACCEL, *EPSILON), coordinates(0), coordinates(1)
    unknowns, texts = (own[0], other[0]), {}
    for kind in _OF:
        upper = combinations_with_replacement(range(6), 2)
        body = {f"out[{emit.offset('n', 6 * a + b)}]": equations[a].diff(rates[b]) for a, b in upper}
        values = {at: motion.summed(_coefficients(entry, kind), unknowns) for at, entry in body.items()}
        columns = {name: equations[6].diff(rate) for name, rate in zip(_FORCES, rates, strict=True)}
        values |= {name: motion.summed(_coefficients(entry, kind), unknowns) for name, entry in columns.items()}
        store = _assigned if kind == "single" else added
        lines = _statements(values, "x" if kind == "single" else "y", lambda at, value, of=store: (
            of(at, value) if at in _FORCES else added(at, value)
        ))  # fmt: skip
        texts[kind] = lines
    modal = motion.summed(_coefficients(equations[6].diff(other[2]), "pair"), unknowns)
    texts["pair"] += [f"out[modal + count * j + l] = {code(modal)}"]
    missing = [name for name in _FORCES if not any(line.startswith(f"{name} =") for line in texts["single"])]
    assert not motion.names and not missing
    return _INERTIA.format(
        stride=STRIDE, single=indent("\n".join(texts["single"]), " " * 8),
        pair=indent("\n".join(texts["pair"]), " " * 12),
        stores="\n".join(f"        out[n + 36 + {f'{k} * count + ' if k else ''}j] = {name}"
                         for k, name in enumerate(_FORCES)),
    )  # fmt: skip


def _assigned(target: str, value: sm.Expr) -> list[str]:
    return [f"{target} = {code(value)}"]


def section_motion(theta: Sequence[sm.Expr], rate: Sequence[sm.Expr]) -> tuple[sm.Matrix, sm.Matrix, sm.Matrix]:
    """R, T and T' theta' of a section that bends the shortest way by theta_y and theta_z, then turns by theta_x.

    Either turn is Cayley's of its vector c, R = (1 - c~ / 2)^-1 (1 + c~ / 2), rational in it, whose angular velocity is
    (c' + c x c' / 2) / (1 + c.c / 4) (Bauchau, Flexible Multibody Dynamics, 2011, sec. 13.4); R has the section's axes
    in the body's, its angular velocity against it is T theta', there, too.
    """
    x, y, z = theta
    bending, twist = sm.Matrix([0, y, z]), sm.Matrix([x, 0, 0])
    tangent = _cayley(bending)[:, 0]
    T = sm.zeros(3, 3)
    T[:, 0] = tangent / (1 + x**2 / 4)
    for column, unit in ((1, sm.Matrix([0, 1, 0])), (2, sm.Matrix([0, 0, 1]))):
        T[:, column] = (unit + bending.cross(unit) / 2) / (1 + bending.dot(bending) / 4)
    velocity = T * sm.Matrix(rate)
    gamma = sum((velocity.diff(angle) * speed for angle, speed in zip(theta, rate, strict=True)), sm.zeros(3, 1))
    return _cayley(bending) * _cayley(twist), T, gamma


def _cayley(c: sm.Matrix) -> sm.Matrix:
    """Rotation matrix of a Rodrigues vector, c / 2 = tan(angle / 2) axis."""
    skew = sm.Matrix([[0, -c[2], c[1]], [c[2], 0, -c[0]], [-c[1], c[0], 0]])
    return sm.eye(3) + (skew + skew * skew / 2) / (1 + c.dot(c) / 4)


def _section() -> emit.Printed:
    """Kernel of a section's rotation and its rates."""
    theta, rate = (sm.symbols(f"{name}_x {name}_y {name}_z") for name in ("theta", "rate"))
    parts = section_motion(theta, rate)
    values = [value for part in parts for value in part]
    reads = emit.places((*theta, *rate), "w", "k")
    doc = (
        "Store R, T row by row and T' theta' of a section turned by theta_y and theta_z, then by theta_x about itself."
        "\n\nw[k]: theta, theta'. R: the section's axes in the body's; T theta': its angular velocity there."
    )
    return emit.kernel("section", ("w", "k", "out", "n"), reads, values, doc, out="n")


_ABOUT = f"""
A particle at r of the body stands in its axes at r + N_j q_j + 1/2 G_jk q_j q_k; sums over the mass are in SINGLE for
every shape, in PAIR for every two of them in either order. Behind the pairs are the third derivatives of the strain
energy that are not zero: how many, then of each its three shapes and its half. A section turns by angles that are
linear in q. Axes are called
{', '.join(XYZ)}; equations are Kane's, by SymPy's KanesMethod, less those of the rigid body
(kaneflex.generated.spatial), which a body of no shapes is.
"""
_DEMAND = '''
@njit(**OPTIONS)
def shaped_demand(p, o, count, w, k, q, i, u, s, du, out, n, h, r):
    """Add the force and the moment that a body's shapes ask for beyond those of the rigid body, and every shape's own.

    w[k]: omega, acceleration of the origin less gravity, epsilon, in the body's axes. Coordinates begin at q[i], their
    rates at u[s], accelerations at du[s]; the rows of the shapes at h[r].
    """
    {reads}
{motion}
    f_x = f_y = f_z = m_x = m_y = m_z = 0.0
    for j in range(count):
        j1, row = o + 12 * j, 0.0
        q_j, v_j, b_j = q[i + j], u[s + j], du[s + j]
{single}
        for l in range(count):
            jl = o + 12 * count + {stride} * (count * j + l)
            q_l, v_l, b_l = q[i + l], u[s + l], du[s + l]
{pair}
        h[r + j] += row
    third = o + 12 * count + {stride} * count * count
    for e in range(int(p[third])):
        at = third + 1 + 4 * e
        h[r + int(p[at])] += p[at + 3] * q[i + int(p[at + 1])] * q[i + int(p[at + 2])]
    out[n] += f_x
    out[n + 1] += f_y
    out[n + 2] += f_z
    out[n + 3] += m_x
    out[n + 4] += m_y
    out[n + 5] += m_z
'''
_INERTIA = '''@njit(**OPTIONS)
def shaped_inertia(p, o, count, q, i, out, n):
    """Add what shapes change of a body's mass matrix (6, 6) at out[n], which is symmetric; store behind it what couples
    them to it, (6, count), and their own, (count, count), all row by row."""
    modal = n + 36 + 6 * count
    for j in range(count):
        j1, q_j = o + 12 * j, q[i + j]
{single}
        for l in range(count):
            jl, q_l = o + 12 * count + {stride} * (count * j + l), q[i + l]
{pair}
{stores}
    for k in range(6):
        for l in range(k):
            out[n + 6 * k + l] = out[n + 6 * l + k]
'''
