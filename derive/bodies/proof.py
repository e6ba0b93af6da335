"""Proof that the printed kernels of a body are Kane's equations, in the plane and in space.

Run over polynomials for every pair of kinds of shapes, they are compared with what KanesMethod derives of a body with
two shapes whose sums over the mass are those of these kinds. Sums over more shapes are no different. In the plane the
motion has three components, and the others of force and moment are left out.

In space the displacement scale xi is a third shape, whose coordinate is the quadratic function that it is of the
others: its equation counts in theirs by the partial velocities (Kane & Levinson 1985, sec. 2.13 and 4.11). Only its
sums over the mass with bending are not zero. Other terms of more than two shapes are only those of the cubic strain
energy.

A frame that is attached at a free end moves against the shortening by as much as the link shortens. Then the squares of
H' are those of its own motion, and without them the mass matrix loses its definiteness: the frame has to be attached
where joints hold the link.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cache
from itertools import combinations_with_replacement, product

import sympy as sm
from sympy.polys.rings import PolyRing

from kaneflex.derive.bodies import kane
from kaneflex.derive.bodies.kane import MOTION, RATE, TWIST, coordinates, pair, single, still
from kaneflex.derive.bodies.kinds import (
    CUBIC,
    PLANE,
    POINT,
    SHORTENING,
    SPACE,
    Kinds,
    moment,
    of_shape,
    reading_order,
)

_COORDINATES = tuple(zip(*map(coordinates, range(2)), strict=True))
"""Coordinates of two shapes, their rates and their accelerations."""
_ELASTIC = sm.symbols("K_0 K_1 C_00 C_01 C_11")
_MOMENTS = list(dict.fromkeys([
    *((single(name, j), name, j, j) for j in range(3) for name in kane.SINGLE),
    *((pair(name, j, k), name, j, k) for j, k in combinations_with_replacement(range(3), 2) for name in kane.PAIR),
]))  # fmt: skip
"""Moments of two shapes and of scale in Kane's equations, with their names and shapes."""

Comparisons = Iterable[tuple[str, list, list]]
"""Every kernel with what it computes and what Kane's equations say, entry by entry."""


class NotKane(AssertionError):
    """A kernel computes something else than the derived equations."""


def prove(text: str, kinds: Kinds) -> None:
    """Raise NotKane if a kernel of this text differs from the derived equations."""
    for shapes in combinations_with_replacement(kinds.names, 2):
        if "g" not in shapes or shapes == ("g", "g"):
            demand_equal(comparisons(text, kinds, shapes), shapes)
    if kinds is SPACE:
        demand_equal(_cubic(text), CUBIC)


def comparisons(text: str, kinds: Kinds, shapes: tuple[str, str]) -> Comparisons:
    """Every kernel of a body with one shape of each of these kinds."""
    return [*_of_body(text, kinds, shapes), *(_of_point(text, shapes) if kinds is PLANE else [])]


def demand_equal(compared: Comparisons, shapes: Sequence[str]) -> None:
    """Raise NotKane where the two differ; both are polynomials, or expanded."""
    for name, found, expected in compared:
        for k, (one, other) in enumerate(zip(found, expected, strict=True)):
            left = one - other
            if left:
                raise NotKane(f"{name} of a body with shapes {', '.join(shapes)}: entry {k} is off by {left}")


def functions(text: str) -> dict[str, Callable]:
    """Functions of a text as plain Python, for any type with addition and multiplication."""
    names = {"njit": lambda **options: lambda kernel: kernel, "IN_ORDER": {}, "WITHIN": {}}
    exec(compile(text, "kernels", "exec"), names)
    return names


class _Body:
    """Kane's equations of a body with one shape of each of two kinds, over polynomials.

    Attributes
    ----------
    x : dict
        Symbol -> polynomial, zero for components of the motion that the kinds don't have.
    q, v, b : list
        Coordinates of the shapes, their rates and their accelerations.
    K, C : list
        Stiffness of each shape, damping of each pair.
    numbers : list
        Numbers of the shapes in the order in which kernels read them.
    """

    def __init__(self, kinds: Kinds, shapes: tuple[str, str]) -> None:
        fields = list(reading_order(shapes, kinds))
        moments = {symbol: _of_scale(shapes, name, j) if k == 2 else moment(shapes, name, j, k)
                   for symbol, name, j, k in _MOMENTS}.values()  # fmt: skip
        known = (*dict.fromkeys((*MOTION, *TWIST)), *(x for of in _COORDINATES for x in of), *_ELASTIC)
        free = set().union(*(value.free_symbols for value in (*moments, *fields))) - {*known}
        self.ring = ring = PolyRing([*known, *sorted(free, key=str)], sm.QQ, "lex")
        self.x = x = dict(zip(known, ring.gens, strict=False)) | dict.fromkeys(still(kinds.twist), ring.zero)
        self.q, self.v, self.b = ([x[symbol] for symbol in of] for of in _COORDINATES)
        pairs = [[kinds.of_pair(a, b, j, k).get("C", 0) for k, b in enumerate(shapes)] for j, a in enumerate(shapes)]
        self.K = [x[symbol] for symbol in _ELASTIC[:2]]
        self.C = [[*map(ring.from_expr, map(sm.sympify, row))] for row in pairs]
        self.numbers, self._moments = ([*map(ring.from_expr, of)] for of in (fields, moments))
        self._slopes, of_scale = _scale(shapes if kinds is SPACE else (), ring, self.q, self.v, self.b)
        self._shapes = [x for two, third in zip((self.q, self.v, self.b), of_scale, strict=True) for x in (*two, third)]

    def equations(self) -> tuple[list, list[list]]:
        """Force, moment and rows of the shapes; the mass matrix."""
        found = _kane()(*(self.x[symbol] for symbol in MOTION), *self._shapes, *self._moments)
        forces, *M = (_along(self._slopes, found[9 * k : 9 * k + 9]) for k in range(10))
        M = [*zip(*(_along(self._slopes, column) for column in zip(*M, strict=True)), strict=True)]
        inside = [K * q + C[0] * self.v[0] + C[1] * self.v[1] for K, q, C in zip(self.K, self.q, self.C, strict=True)]
        return [*forces[:6], *(forces[6 + j] + inside[j] for j in range(2))], M


def _of_body(text: str, kinds: Kinds, shapes: tuple[str, str]) -> Comparisons:
    kernels, body = functions(text), _Body(kinds, shapes)
    zero, q, v, b, D = body.ring.zero, body.q, body.v, body.b, len(kinds.twist)
    forces, M = body.equations()
    kept, room = [*kinds.twist, 6, 7], [[zero] * 4, 0] if kinds.in_space else []
    twist, rate = ([of[k] for k in kinds.twist] for of in (TWIST, RATE))
    p = [*(shapes.count(kind) for kind in kinds.names[:-1]), *body.numbers, 0]

    out, rows, motion = [zero] * D, [zero] * 2, [body.x[symbol] for symbol in MOTION if symbol in {*twist, *rate}]
    kernels["shaped_demand"](p, 0, 2, motion, 0, q, v, b, 0, out, 0, rows, *room)
    yield "shaped_demand", [*out, *rows], [forces[k] for k in kept]

    out = [zero] * (D + 2) ** 2
    kernels["shaped_inertia"](p, 0, 2, q, 0, out, 0, *room)
    blocks = (range(D), range(D)), (range(D, D + 2), range(D)), (range(D, D + 2), range(D, D + 2))
    whole = [M[kept[j]][kept[k]] for rows, columns in blocks for j in rows for k in columns]
    yield "shaped_inertia", out[: len(whole)], whole

    strain = sum(K * x**2 for K, x in zip(body.K, q, strict=True)) / 2
    yield "shaped_strain", [kernels["shaped_strain"](p, 0, 2, q, 0)], [strain]


def _cubic(text: str) -> Comparisons:
    """Rows and strain energy of a cubic energy, of a beam's shapes and of others."""
    kernels, q, c = functions(text), sm.symbols("q_0:3"), sm.Symbol("c")
    others = [2, 0, 1, 2, c, 0, 0, 1, 2 * c]
    for kinds, factors, energy in (
        (CUBIC, [c, 0], c * q[0] * q[1] * q[2]), ("ggg", others, c * q[0] * q[1] * q[2] + 2 * c * q[0] ** 2 * q[1]),
    ):  # fmt: skip
        zeros = [0] * len(list(reading_order(kinds)))
        p = [*(list(kinds).count(kind) for kind in SPACE.names[:-1]), *zeros, *factors]
        out, rows, nothing = [sm.S.Zero] * 6, [sm.S.Zero] * 3, [0] * 9
        kernels["shaped_demand"](p, 0, 3, nothing, 0, q, nothing, nothing, 0, out, 0, rows, [0] * 6, 0)
        yield "shaped_demand", [*map(sm.expand, rows)], [energy.diff(x) for x in q]
        yield "shaped_strain", [sm.expand(kernels["shaped_strain"](p, 0, 3, q, 0))], [energy]


def _of_point(text: str, shapes: tuple[str, str]) -> Comparisons:
    """Displacement and rotation of a section, their derivatives, and the acceleration at constant rates."""
    kernels, q, v = functions(text), *(sm.symbols(f"{name}_0 {name}_1") for name in "qv")
    N = [POINT.of_shape(kind, j) for j, kind in enumerate(shapes)]
    G = [[POINT.of_pair(a, b, j, k)["x"] for k, b in enumerate(shapes)] for j, a in enumerate(shapes)]
    grown = [sum(G[j][k] * q[k] for k in range(2)) for j in range(2)]
    twists = [[N[j]["x"] + grown[j], N[j]["y"], N[j]["turn"]] for j in range(2)]
    here = [sum(twists[j][k] * q[j] for j in range(2)) for k in range(3)]
    here[0] -= sum(grown[j] * q[j] for j in range(2)) / 2
    p = [shapes.count("u"), *reading_order(shapes, POINT)]

    out = [sm.S.Zero] * 6
    moved = kernels["displace"](p, 0, 2, q, 0, out, 0)
    yield "displace", [*map(sm.expand, (*moved, *out))], [*map(sm.expand, (*here, *twists[0], *twists[1]))]
    grows = sum(G[j][k] * v[j] * v[k] for j, k in product(range(2), repeat=2))
    yield "growth", [sm.expand(kernels["growth"](p, 0, 2, v, 0))], [sm.expand(grows)]


def _scale(kinds: Sequence[str], ring: PolyRing, q: list, v: list, b: list) -> tuple[list, list]:
    """Derivatives of scale by two coordinates; scale, its rate and its acceleration; without kinds they are zero."""
    alike = [[bool(kinds) and kinds[j] == kinds[k] and kinds[j] in SHORTENING for k in range(2)] for j in range(2)]
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


@cache
def _kane() -> Callable:
    """Kane's equations of three shapes, and their mass matrix row by row, as a function of what they depend on."""
    equations, own = kane.shaped_equations(3), list(zip(*map(coordinates, range(3)), strict=True))
    M = equations.jacobian([*kane.ACCEL, *kane.EPSILON, *own[2]])
    moments = dict.fromkeys(symbol for symbol, *_ in _MOMENTS)
    return sm.lambdify([*MOTION, *(x for of in own for x in of), *moments], [*equations, *M], "math")
