"""Proof that the printed kernels of a body are Kane's equations: their loops run over symbols, and nothing is left.

The text itself is executed with symbols in its arrays, for small numbers of shapes, and compared with Kane's equations
of a body with as many (:mod:`kaneflex.derive.bodies.plane_equations`). Sums over equal indices are no different for
more shapes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from types import SimpleNamespace

import sympy as sm
from sympy.physics.mechanics import dynamicsymbols

from kaneflex.derive.bodies.kane import coordinates
from kaneflex.derive.bodies.kinds import PLANE, POINT, Kinds, reading_order
from kaneflex.derive.bodies.plane_equations import (
    ACROSS,
    ALONG,
    AT,
    EPSILON,
    OMEGA,
    RIGID,
    by_name,
    place,
    planar_equations,
)

PROVED = ((0, 0), (1, 0), (0, 1), (1, 2), (2, 2))
"""Numbers of axial and transverse shapes for which the kernels are proved: every sum runs over none, one and two."""

C, S, PHI = sm.symbols("c s phi")
TIME = dynamicsymbols._t


class NotKane(AssertionError):
    """A kernel computes something else than the derived equations."""


def prove(text: str) -> None:
    """Raise NotKane if a kernel of this text differs from the derived equations."""
    for counts in PROVED:
        demand_equal(comparisons(text, *counts), counts, _plain)


Comparisons = Iterable[tuple[str, list[sm.Expr], list[sm.Expr]]]
"""Every kernel with what it computes and what Kane's equations say, entry by entry."""


def demand_equal(
    compared: Comparisons, shapes: int | tuple[int, int], plain: Callable[[sm.Expr], sm.Expr] = sm.expand
) -> None:
    """Raise NotKane where the two differ, ``plain``: in expressions that are zero by their look if at all."""
    for name, found, expected in compared:
        for k, (one, other) in enumerate(zip(found, expected, strict=True)):
            left = plain(one - other)
            if left != 0:
                raise NotKane(f"{name} of a body with {shapes} shapes: entry {k} is off by {left}")


def functions(text: str) -> dict[str, Callable]:
    """Functions of a text as plain Python, for any type with addition and multiplication."""
    names = {"njit": lambda **options: lambda kernel: kernel, "IN_ORDER": {}, "WITHIN": {}}
    exec(compile(text, "kernels", "exec"), names)
    return names


def comparisons(text: str, axial: int, transverse: int) -> Comparisons:
    """Comparisons of a body, then of its points."""
    kernels = SimpleNamespace(**functions(text))
    yield from _of_body(kernels, axial, transverse)
    yield from _of_point(kernels, axial, transverse)


def _numbers(first: Iterable[sm.Expr], axial: int, transverse: int, kinds: Kinds, of: str) -> list[sm.Expr]:
    """Numbers of a body or of a point in the moments' symbols."""
    shapes = reading_order("u" * axial + "v" * transverse, kinds)
    return [*first, axial, axial + transverse, *(by_name(value, axial, of) for value in shapes)]


def _of_body(kernels: SimpleNamespace, axial: int, transverse: int):
    shapes = axial + transverse
    n, own = 3 + shapes, planar_equations(axial, transverse)
    p = _numbers(RIGID, axial, transverse, PLANE, "mass")
    stiffness = sm.diag(*(sm.Symbol(f"stiffness_{k}") for k in range(shapes)))
    damping = sm.Matrix(shapes, shapes, lambda j, k: sm.Symbol(f"damping_{min(j, k)}_{max(j, k)}"))
    q, v, a = (list(of) for of in zip(*map(coordinates, range(shapes)), strict=True)) if shapes else ([], [], [])
    modal, rates = sm.Matrix(shapes, 1, q), sm.Matrix(shapes, 1, v)
    inside = sm.Matrix([0, 0, 0, *(stiffness * modal + damping * rates)])
    turn = sm.eye(n)
    turn[:2, :2] = sm.Matrix([[C, -S], [S, C]])
    x, y, v_x, v_y = sm.symbols("x y v_x v_y")

    M = own.jacobian([ALONG, ACROSS, EPSILON, *a])
    out = [sm.S.Zero] * (9 + 3 * shapes + shapes**2)
    kernels.inertia(p, 0, q, 0, C, S, out, 0, 9, 9 + 3 * shapes)
    whole = turn * M * turn.T
    yield "inertia", out, [*whole[:3, :3], *whole[3:, :3], *whole[3:, 3:]]

    out = [sm.S.Zero] * n
    kernels.inverse(p, 0, q, v, a, 0, C, S, OMEGA, x, y, EPSILON, out, 0)
    yield "inverse", out, list(turn * own.xreplace({ALONG: C * x + S * y, ACROSS: C * y - S * x}) + inside)

    out = [sm.S.Zero] * 3
    centre = kernels.energy(p, 0, q, v, 0, C, S, v_x, v_y, OMEGA, out)
    u = turn.T * sm.Matrix([v_x, v_y, OMEGA, *v])
    strain, lost = (modal.T * stiffness * modal / 2, rates.T * damping * rates) if shapes else ([0], [0])
    yield "energy", out, [(u.T * M * u)[0] / 2, strain[0], lost[0]]
    yield "centre", list(centre), list(turn[:2, :2] * sm.Matrix([M[1, 2], -M[0, 2]]))


def _of_point(kernels: SimpleNamespace, axial: int, transverse: int):
    p = _numbers(AT, axial, transverse, POINT, "")
    b, a = ([dynamicsymbols(f"{name}_{k}") for k in range(count)] for name, count in (("b", axial), ("a", transverse)))
    modal = [*b, *a]
    q, v, a2 = ([sm.Symbol(f"{name}_{k}") for k in range(len(modal))] for name in ("q", "v", "accel"))
    plain = {c: symbol for c, symbol in zip(modal, q, strict=True)}
    rates = {c.diff(TIME, k): symbol for k, of in ((1, v), (2, a2)) for c, symbol in zip(modal, of, strict=True)}
    inside = place(b, a)

    out = [sm.S.Zero] * 9
    kernels.deform(p, 0, q, v, a2, 0, out, 0)
    motion = [x.diff(TIME, order) if order else x for order in range(3) for x in inside]
    yield "deform", out, [x.subs(rates).subs(plain) if x else sm.S.Zero for x in map(sm.sympify, motion)]

    x, y, share = sm.symbols("x y share")
    xi, eta, turn = (sm.sympify(entry).xreplace(plain) for entry in inside)
    c, s = sm.cos(PHI), sm.sin(PHI)
    twist = sm.Matrix([share * x + c * xi - s * eta, share * y + s * xi + c * eta, PHI + turn])
    W = twist.jacobian([x, y, PHI, *q])
    out = [sm.S.Zero] * 3 * len(modal)
    kernels.twists(p, 0, q, 0, C, S, out, 0)
    yield "twists", out, list(W[:, 3:].T)

    force = sm.Matrix(sm.symbols("f_x f_y torque"))
    out = [sm.S.Zero] * W.cols
    kernels.push(p, 0, q, 0, C, S, *force, out, 0)
    yield "push", out, list(W.T * force)


def _plain(expression: sm.Expr) -> sm.Expr:
    """Expanded, with one sine at most in every product."""
    named = sm.sympify(expression).xreplace({sm.cos(PHI): C, sm.sin(PHI): S})
    return named.expand().xreplace({S**2: 1 - C**2}).expand()
