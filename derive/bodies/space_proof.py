"""Proof that the printed kernels of a body in space are Kane's equations.

Run over polynomials for every pair of kinds of shapes, they are compared with what KanesMethod derives of a body with
two shapes whose sums over the mass are those of these kinds. The displacement scale xi is a third one, whose coordinate
is the quadratic function that it is of the others: its equation counts in theirs by the partial velocities (Kane &
Levinson 1985, sec. 2.13 and 4.11). Only its sums over the mass with bending are not zero. Other terms of more than two
shapes are only those of the cubic strain energy.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from itertools import combinations_with_replacement, product

import sympy as sm
from sympy.polys.rings import PolyElement, PolyRing

from kaneflex.derive.bodies import kane
from kaneflex.derive.bodies.kane import MOTION, coordinates, pair, single
from kaneflex.derive.bodies.kinds import CUBIC, KINDS, SHORTENING, moment, of_shape, reading_order
from kaneflex.derive.bodies.proof import Comparisons, demand_equal, functions

PROVED = [(a, b) for a, b in combinations_with_replacement(KINDS, 2) if "g" not in (a, b) or a == b]
VELOCITY = sm.symbols("v_x v_y v_z")
_COORDINATES = tuple(zip(*map(coordinates, range(2)), strict=True))
"""Coordinates of two shapes, their rates and their accelerations."""
_ELASTIC = sm.symbols("K_0 K_1 C_00 C_01 C_11")
_MOMENTS = list(dict.fromkeys([
    *((single(name, j), name, j, j) for j in range(3) for name in kane.SINGLE),
    *((pair(name, j, k), name, j, k) for j, k in combinations_with_replacement(range(3), 2) for name in kane.PAIR),
]))  # fmt: skip
"""Moments of two shapes and of scale in Kane's equations, with their names and shapes."""


def prove(text: str) -> None:
    """Raise NotKane if a kernel of this text differs from the derived equations."""
    demand_equal(_cubic(text), CUBIC)
    for kinds in PROVED:
        demand_equal(comparisons(text, kinds), kinds, lambda difference: difference)


def comparisons(text: str, kinds: tuple[str, str]) -> Comparisons:
    """Every kernel of a body with one shape of each of these kinds."""
    kernels, fields = functions(text), list(reading_order(kinds))
    moments = {symbol: _of_scale(kinds, name, j) if k == 2 else moment(kinds, name, j, k)
               for symbol, name, j, k in _MOMENTS}  # fmt: skip
    known = (*MOTION, *VELOCITY, *(x for of in _COORDINATES for x in of), *_ELASTIC)
    free = set().union(*(value.free_symbols for value in (*moments.values(), *fields))) - {*known}
    ring = PolyRing([*known, *sorted(free, key=str)], sm.QQ, "lex")
    x = dict(zip(map(str, known), ring.gens, strict=False))
    motion, (q, v, b) = [x[str(s)] for s in MOTION], ([x[str(s)] for s in of] for of in _COORDINATES)
    slopes, of_scale = _scale(kinds, ring, q, v, b)
    of_all = [x for two, third in zip((q, v, b), of_scale, strict=True) for x in (*two, third)]
    found = _kane()(*motion, *of_all, *map(ring.from_expr, moments.values()))
    forces, *M = (_along(slopes, found[9 * k : 9 * k + 9]) for k in range(10))
    M = [*zip(*(_along(slopes, column) for column in zip(*M, strict=True)), strict=True)]
    K, C = [x["K_0"], x["K_1"]], [[x["C_00"], x["C_01"]], [x["C_01"], x["C_11"]]]
    if kinds[0] != kinds[1]:
        C[0][1] = C[1][0] = 0
    p = [*(kinds.count(kind) for kind in KINDS[:-1]), *map(ring.from_expr, fields), 0]

    out, rows, room = [ring.zero] * 6, [ring.zero] * 2, [ring.zero] * 4
    kernels["shaped_demand"](p, 0, 2, motion, 0, q, 0, v, 0, b, out, 0, rows, 0, room, 0)
    inside = [K[j] * q[j] + C[j][0] * v[0] + C[j][1] * v[1] for j in range(2)]
    yield "shaped_demand", [*out, *rows], [*forces[:6], *(forces[6 + j] + inside[j] for j in range(2))]

    out = [ring.zero] * 52
    kernels["shaped_inertia"](p, 0, 2, q, 0, out, 0, room, 0)
    blocks = (range(6), range(6)), (range(6), range(6, 8)), (range(6, 8), range(6, 8))
    yield "shaped_inertia", out, [M[j][k] for rows, columns in blocks for j in rows for k in columns]

    out = [ring.zero] * 6
    twist = [*(x[str(s)] for s in VELOCITY), *motion[:3]]
    kernels["shaped_energy"](p, 0, 2, twist, 0, q, 0, v, 0, out, 0)
    strain = (K[0] * q[0] ** 2 + K[1] * q[1] ** 2) / 2
    first = [M[1][5], M[2][3], M[0][4]]  # force per angular acceleration
    yield "shaped_energy", out, [_product([*twist, *v], M) / 2, strain, _product(v, C), *first]


def _scale(kinds: tuple[str, str], ring: PolyRing, q: list, v: list, b: list) -> tuple[list, list]:
    """Derivatives of scale by two coordinates; scale, its rate and its acceleration."""
    alike = [[kinds[j] == kinds[k] and kinds[j] in SHORTENING for k in range(2)] for j in range(2)]
    names = [[sm.Symbol(f"scale_{min(j, k)}{max(j, k)}") for k in range(2)] for j in range(2)]
    A = [[ring.from_expr(names[j][k]) if alike[j][k] else ring.zero for k in range(2)] for j in range(2)]
    slopes = [A[j][0] * q[0] + A[j][1] * q[1] for j in range(2)]
    curved = sum(A[j][k] * v[j] * v[k] for j, k in product(range(2), repeat=2))
    scale, rate, change = (slopes[0] * x[0] + slopes[1] * x[1] for x in (q, v, b))
    return slopes, [scale / 2, rate, change + curved]


def _of_scale(kinds: tuple[str, str], name: str, j: int) -> sm.Expr:
    """A moment of scale xi along the beam alone or with the j-th shape."""
    bends = j < 2 and name == {"v": "N_y_N_x", "w": "N_z_N_x"}.get(kinds[j])
    return of_shape(kinds[j], j)["Q"] if bends else sm.S.Zero


def _along(slopes: list, numbers: Sequence) -> list:
    """Numbers of the body and of two shapes, from those of three whose last one moves with the others."""
    *body, one, other, third = numbers
    return [*body, one + slopes[0] * third, other + slopes[1] * third]


def _product(u: list[PolyElement], M: list[list[PolyElement]]) -> PolyElement:
    return sum(one * M[j][k] * other for j, one in enumerate(u) for k, other in enumerate(u))


@cache
def _kane() -> Callable:
    """Kane's equations of three shapes, and their mass matrix row by row, as a function of what they depend on."""
    equations, own = kane.shaped_equations(3), list(zip(*map(coordinates, range(3)), strict=True))
    M = equations.jacobian([*kane.ACCEL, *kane.EPSILON, *own[2]])
    moments = dict.fromkeys(symbol for symbol, *_ in _MOMENTS)
    return sm.lambdify([*MOTION, *(x for of in own for x in of), *moments], [*equations, *M], "math")


def _cubic(text: str) -> Comparisons:
    """Rows and strain energy of a cubic energy, of a beam's shapes and of others."""
    kernels, q, c = functions(text), sm.symbols("q_0:3"), sm.Symbol("c")
    others = [2, 0, 1, 2, c, 0, 0, 1, 2 * c]
    for kinds, factors, energy in (
        (CUBIC, [c, 0], c * q[0] * q[1] * q[2]), ("ggg", others, c * q[0] * q[1] * q[2] + 2 * c * q[0] ** 2 * q[1]),
    ):  # fmt: skip
        zeros = [0] * len(list(reading_order(kinds)))
        p = [*(list(kinds).count(kind) for kind in KINDS[:-1]), *zeros, *factors]
        out, rows, still = [sm.S.Zero] * 6, [sm.S.Zero] * 3, [0] * 9
        kernels["shaped_demand"](p, 0, 3, still, 0, q, 0, still, 0, still, out, 0, rows, 0, [0] * 6, 0)
        yield "shaped_demand", rows, [energy.diff(x) for x in q]
        kernels["shaped_energy"](p, 0, 3, still, 0, q, 0, still, 0, out, 0)
        yield "shaped_energy", [out[1]], [energy]
