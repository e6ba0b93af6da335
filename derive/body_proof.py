"""Proof that the printed kernels of a body are Kane's equations: their loops run over symbols, and nothing is left.

The text itself is executed with symbols in its arrays, for small numbers of shapes, and compared with what KanesMethod
derives of a body with as many (:mod:`kaneflex.derive.flexible`). Sums over equal indices are no different for more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from types import SimpleNamespace

import sympy as sm
from sympy.physics.mechanics import dynamicsymbols

from kaneflex.derive.flexible import Slice, flexible_body
from kaneflex.derive.loops import block_symbols
from kaneflex.derive.rigid import TIME
from kaneflex.support.contract import BODY_BLOCK, POINT_BLOCK, Slot

PROVED = ((0, 0), (1, 0), (0, 1), (1, 2), (2, 2))
"""Numbers of axial and transverse shapes for which the kernels are proved: every sum runs over none, one and two."""

C, S, PHI = sm.symbols("c s phi")


class NotKane(AssertionError):
    """A kernel computes something else than the derived equations."""


def prove(text: str) -> None:
    """Raise NotKane if a kernel of this text, a function ``kernels``, differs from the derived equations."""
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
    names = {"njit": lambda **options: lambda kernel: kernel, "cache": lambda kernels: kernels}
    names |= {"OPTIONS": {}, "IN_ORDER": {}, "SimpleNamespace": SimpleNamespace}
    exec(compile(text, "kernels", "exec"), names)
    return names


def interpreted(text: str, axial: int, transverse: int) -> SimpleNamespace:
    """The kernels of bodies with so many shapes."""
    return functions(text)["kernels"](axial, transverse)


def comparisons(text: str, axial: int, transverse: int) -> Comparisons:
    """Comparisons of a body, then of its points."""
    yield from _of_body(interpreted(text, axial, transverse), axial, transverse)
    yield from _of_point(interpreted(text, axial, transverse), axial, transverse)


def _of_body(kernels: SimpleNamespace, axial: int, transverse: int):
    body = flexible_body(axial, transverse, True)
    n, shapes = len(body.q), axial + transverse
    known = {moment.name for moment in body.moments}
    p = _block(BODY_BLOCK, axial, transverse, known | {f"stiffness_{k}" for k in range(shapes)} | _damping(shapes))
    stiffness = sm.diag(*(sm.Symbol(f"stiffness_{k}") for k in range(shapes)))
    damping = sm.Matrix(shapes, shapes, lambda j, k: sm.Symbol(f"damping_{min(j, k)}_{max(j, k)}"))
    modal, rates = sm.Matrix(body.q[3:]), sm.Matrix(body.v[3:])
    u, rate = sm.Matrix(body.v), sm.Matrix(sm.symbols(f"accel_:{n}"))
    g_x, g_y = body.gravity
    q, v, a = list(modal), list(rates), list(rate[3:])

    M = body.mass
    out = [sm.S.Zero] * n**2
    kernels.inertia(p, 0, q, 0, C, S, out, 0)
    yield "inertia", out, list(M)

    out = [sm.S.Zero] * n
    kernels.inverse(p, 0, q, v, a, 0, C, S, u[2], rate[0] - g_x, rate[1] - g_y, rate[2], out, 0)
    inside = [0, 0, 0, *(stiffness * modal + damping * rates)]
    yield "inverse", out, list(M * rate - body.forcing + sm.Matrix(inside))

    out = [sm.S.Zero] * 3
    place = kernels.energy(p, 0, q, v, 0, C, S, *u[:3], out)
    strain, lost = (modal.T * stiffness * modal / 2, rates.T * damping * rates) if shapes else ([0], [0])
    yield "energy", out, [(u.T * M * u)[0] / 2, strain[0], lost[0]]
    weight = -sum(g * (body.moments[0].symbol * r + of) for g, r, of in zip(body.gravity, body.q, place, strict=False))
    yield "weight", [weight], [body.weight]


def _of_point(kernels: SimpleNamespace, axial: int, transverse: int):
    slice_ = Slice(axial, transverse, rotary=True)
    p = _block(POINT_BLOCK, axial, transverse, {str(symbol) for symbol in slice_.functions} | {"share"})
    b, a = ([dynamicsymbols(f"{name}_{k}") for k in range(count)] for name, count in (("b", axial), ("a", transverse)))
    modal = [*b, *a]
    q, v, a2 = ([sm.Symbol(f"{name}_{k}") for k in range(len(modal))] for name in ("q", "v", "accel"))
    plain = {c: symbol for c, symbol in zip(modal, q, strict=True)}
    rates = {c.diff(TIME, k): symbol for k, of in ((1, v), (2, a2)) for c, symbol in zip(modal, of, strict=True)}
    inside = slice_.place(b, a)

    out = [sm.S.Zero] * 9
    kernels.deform(p, 0, q, v, a2, 0, out, 0)
    motion = [x.diff(TIME, order) if order else x for order in range(3) for x in inside]
    yield "deform", out, [x.subs(rates).subs(plain) if x else sm.S.Zero for x in map(sm.sympify, motion)]

    x, y, share = sm.symbols("x y share")
    xi, eta, turn = (sm.sympify(entry).xreplace(plain) for entry in inside)
    c, s = sm.cos(PHI), sm.sin(PHI)
    twist = sm.Matrix([share * x + c * xi - s * eta, share * y + s * xi + c * eta, PHI + turn])
    W = twist.jacobian([x, y, PHI, *q])
    out = [sm.S.Zero] * len(W)
    kernels.jacobian(p, 0, q, 0, C, S, out, 0)
    yield "jacobian", out, list(W)

    force = sm.Matrix(sm.symbols("f_x f_y torque"))
    out = [sm.S.Zero] * W.cols
    kernels.push(p, 0, q, 0, C, S, *force, out, 0)
    yield "push", out, list(W.T * force)


def _damping(shapes: int) -> set[str]:
    return {f"damping_{j}_{k}" for k in range(shapes) for j in range(k + 1)}


def _block(block: Iterable[Slot], axial: int, transverse: int, known: set[str]) -> list[sm.Expr]:
    """A block of symbols called as the moments are; what a body does not have is zero."""
    found = [expression for expression, *_ in block_symbols(block, axial, transverse)]
    unknown = {symbol: sm.S.Zero for x in found for symbol in x.free_symbols if symbol.name not in known}
    return [expression.xreplace(unknown) for expression in found]


def _plain(expression: sm.Expr) -> sm.Expr:
    """Expanded, with one sine at most in every product."""
    named = sm.sympify(expression).xreplace({sm.cos(PHI): C, sm.sin(PHI): S})
    return named.expand().xreplace({S**2: 1 - C**2}).expand()
