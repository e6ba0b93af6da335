"""Proof that the printed loops over the shapes of a body in space are Kane's equations: run over symbols, nothing is
left between them and what KanesMethod derives of a body with as many shapes."""

from __future__ import annotations

from itertools import product

import sympy as sm

from kaneflex.derive.body_proof import Comparisons, demand_equal, functions
from kaneflex.derive.spatial_shapes import (
    ACCEL,
    EPSILON,
    MOTION,
    PAIR,
    SINGLE,
    coordinates,
    pair,
    shaped_equations,
    single,
)  # fmt: skip

PROVED = (1, 2)
"""Numbers of shapes for which the kernels are proved: sums over equal indices, and over different ones."""


def prove(text: str) -> None:
    """Raise NotKane if a kernel of this text differs from the derived equations."""
    for count in PROVED:
        demand_equal(comparisons(text, count), count)


def comparisons(text: str, count: int) -> Comparisons:
    """Both kernels of a body with so many shapes."""
    kernels, equations = functions(text), shaped_equations(count)
    p, K, C = _block(count)
    q, v, b = (list(of) for of in zip(*map(coordinates, range(count)), strict=True))
    out, rows = [sm.S.Zero] * 6, [sm.S.Zero] * count
    kernels["shaped_demand"](p, 0, count, list(MOTION), 0, q, 0, v, 0, b, out, 0, rows, 0)
    inside = K * sm.Matrix(q) + C * sm.Matrix(v)
    inside += sm.Matrix([sum(_cubic(j, l, k) * q[l] * q[k] for l in range(count) for k in range(count))
                         for j in range(count)])  # fmt: skip
    yield "shaped_demand", [*out, *rows], [*equations[:6], *(equations[6:, :] + inside)]

    out = [sm.S.Zero] * (6 + count) ** 2
    kernels["shaped_inertia"](p, 0, count, q, 0, out, 0)
    M = equations.jacobian([*ACCEL, *EPSILON, *b])
    yield "shaped_inertia", out[: 36 + 6 * count + count**2], [*M[:6, :6], *M[:6, 6:], *M[6:, 6:]]


def _block(count: int) -> tuple[list[sm.Expr], sm.Matrix, sm.Matrix]:
    """Numbers of a body by the symbols of its moments, with its stiffness and damping."""
    K, C = (sm.Matrix(count, count, lambda j, l, name=name: sm.Symbol(f"{name}_{j}_{l}")) for name in "KC")
    found = [single(name, j) for j in range(count) for name in SINGLE]
    for j in range(count):
        for l in range(count):
            found += [pair(name, j, l) for name in PAIR]
            found += [K[j, l], C[j, l]]
    found.append(count**3)
    for shapes in product(range(count), repeat=3):
        found += [*shapes, _cubic(*shapes)]
    return found, K, C


def _cubic(*shapes: int) -> sm.Symbol:
    """A third derivative of the strain energy, halved."""
    return sm.Symbol("S_{}_{}_{}".format(*sorted(shapes)))
