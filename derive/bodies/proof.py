"""Proof that the printed kernels of a body are Kane's equations, in the plane and in space.

Run over polynomials for every pair of kinds of shapes, they are compared with what KanesMethod derives of a body with
two shapes whose sums over the mass are those of these kinds. Sums over more shapes are no different. In the plane omega
is about z, the rigid body is one of the kernels' own, and vectors are rotated into global axes.

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
from sympy.polys.rings import PolyElement, PolyRing

from kaneflex.derive.bodies import kane
from kaneflex.derive.bodies.kane import ACCEL, EPSILON, MOTION, coordinates, pair, single
from kaneflex.derive.bodies.kinds import (
    CUBIC,
    KINDS,
    PLANE,
    POINT,
    SHORTENING,
    SPACE,
    Kinds,
    moment,
    of_shape,
    reading_order,
)

VELOCITY = sm.symbols("v_x v_y v_z")
RIGID = sm.symbols("mass mass_X mass_Y second")
"""Mass, first moments, and moment of inertia about the origin, of a rigid body in the plane."""
C, S = sm.symbols("c s")
"""Cosine and sine of the angle of a body in the plane."""
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
    return [*_in_plane(text, shapes), *_of_point(text, shapes)] if kinds is PLANE else _in_space(text, shapes)


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
        Name of a symbol -> polynomial; ``more`` symbols are a kernel's own.
    q, v, b : list
        Coordinates of the shapes, their rates and their accelerations.
    K, C : list
        Stiffness of each shape, damping of each pair.
    numbers : list
        Numbers of the shapes in the order in which kernels read them.
    """

    def __init__(self, kinds: Kinds, shapes: tuple[str, str], more: Iterable[sm.Symbol] = ()) -> None:
        fields = list(reading_order(shapes, kinds))
        moments = {symbol: _of_scale(shapes, name, j) if k == 2 else moment(shapes, name, j, k)
                   for symbol, name, j, k in _MOMENTS}.values()  # fmt: skip
        known = (*MOTION, *VELOCITY, *(x for of in _COORDINATES for x in of), *_ELASTIC, *more)
        free = set().union(*(value.free_symbols for value in (*moments, *fields))) - {*known}
        self.ring = ring = PolyRing([*known, *sorted(free, key=str)], sm.QQ, "lex")
        self.x = x = dict(zip(map(str, known), ring.gens, strict=False))
        self.q, self.v, self.b = ([x[str(s)] for s in of] for of in _COORDINATES)
        pairs = [[kinds.of_pair(a, b, j, k).get("C", 0) for k, b in enumerate(shapes)] for j, a in enumerate(shapes)]
        self.K, self.C = [x["K_0"], x["K_1"]], [[*map(ring.from_expr, map(sm.sympify, row))] for row in pairs]
        self.numbers, self._moments = ([*map(ring.from_expr, of)] for of in (fields, moments))
        self._slopes, of_scale = _scale(shapes if kinds is SPACE else (), ring, self.q, self.v, self.b)
        self._shapes = [x for two, third in zip((self.q, self.v, self.b), of_scale, strict=True) for x in (*two, third)]

    def equations(self, motion: Sequence) -> tuple[list, list[list]]:
        """Force, moment and rows of the shapes by MOTION; the mass matrix."""
        found = _kane()(*motion, *self._shapes, *self._moments)
        forces, *M = (_along(self._slopes, found[9 * k : 9 * k + 9]) for k in range(10))
        M = [*zip(*(_along(self._slopes, column) for column in zip(*M, strict=True)), strict=True)]
        inside = [K * q + C[0] * self.v[0] + C[1] * self.v[1] for K, q, C in zip(self.K, self.q, self.C, strict=True)]
        return [*forces[:6], *(forces[6 + j] + inside[j] for j in range(2))], M

    def energies(self, twist: Sequence, M: Sequence[Sequence]) -> list:
        """Kinetic energy and strain energy."""
        strain = (self.K[0] * self.q[0] ** 2 + self.K[1] * self.q[1] ** 2) / 2
        return [_product([*twist, *self.v], M) / 2, strain]


# ---- space ----------------------------------------------------------------------------------------------------------


def _in_space(text: str, shapes: tuple[str, str]) -> Comparisons:
    kernels, body = functions(text), _Body(SPACE, shapes)
    ring, q, v, b = body.ring, body.q, body.v, body.b
    motion, velocity = [body.x[str(s)] for s in MOTION], [body.x[str(s)] for s in VELOCITY]
    forces, M = body.equations(motion)
    p = [*(shapes.count(kind) for kind in KINDS[:-1]), *body.numbers, 0]

    out, rows, room = [ring.zero] * 6, [ring.zero] * 2, [ring.zero] * 4
    kernels["shaped_demand"](p, 0, 2, motion, 0, q, 0, v, 0, b, out, 0, rows, 0, room, 0)
    yield "shaped_demand", [*out, *rows], forces

    out = [ring.zero] * 52
    kernels["shaped_inertia"](p, 0, 2, q, 0, out, 0, room, 0)
    blocks = (range(6), range(6)), (range(6), range(6, 8)), (range(6, 8), range(6, 8))
    yield "shaped_inertia", out, [M[j][k] for rows, columns in blocks for j in rows for k in columns]

    out, twist = [ring.zero] * 5, [*velocity, *motion[:3]]
    kernels["shaped_energy"](p, 0, 2, twist, 0, q, 0, v, 0, out, 0)
    first = [M[1][5], M[2][3], M[0][4]]  # force per angular acceleration
    yield "shaped_energy", out, [*body.energies(twist, M), *first]


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
        yield "shaped_demand", [*map(sm.expand, rows)], [energy.diff(x) for x in q]
        kernels["shaped_energy"](p, 0, 3, still, 0, q, 0, still, 0, out, 0)
        yield "shaped_energy", [sm.expand(out[1])], [energy]


# ---- the plane ------------------------------------------------------------------------------------------------------


def _in_plane(text: str, shapes: tuple[str, str]) -> Comparisons:
    kernels, place = functions(text), sm.symbols("x y")
    body = _Body(PLANE, shapes, (C, S, *place, *RIGID))
    ring, x, q, v = body.ring, body.x, body.q, body.v
    c, s, X, Y, omega, epsilon = (x[name] for name in ("c", "s", "x", "y", "omega_z", "epsilon_z"))
    along, across = c * X + s * Y, c * Y - s * X
    p = [*(x[str(each)] for each in RIGID), shapes.count("u"), 2, *body.numbers]

    def plain(values: Iterable) -> list:
        return [(ring.zero + value).rem([c**2 + s**2 - 1]) for value in values]

    def turned(vector: Sequence) -> list:
        """A vector in global axes, of the body's."""
        return [c * vector[0] - s * vector[1], s * vector[0] + c * vector[1], *vector[2:]]

    forces, M = body.equations([0, 0, omega, along, across, 0, 0, 0, epsilon])
    own, kept = _rigid(), (0, 1, 5, 6, 7)
    inertia = own.jacobian([*ACCEL[:2], EPSILON[2]])
    turning = dict(zip(ACCEL, (C * place[0] + S * place[1], C * place[1] - S * place[0]), strict=False))
    rigid = [*map(ring.from_expr, own.xreplace(turning).expand()), 0, 0]
    forces = [one + forces[k] for one, k in zip(rigid, kept, strict=True)]
    M = [[M[m][n] + (ring.from_expr(inertia[j, k]) if max(j, k) < 3 else 0) for k, n in enumerate(kept)]
         for j, m in enumerate(kept)]  # fmt: skip

    out = [ring.zero] * 2
    frame = kernels["inverse"](p, 0, q, v, body.b, 0, c, s, omega, X, Y, epsilon, out, 0)
    yield "inverse", plain([*frame, *out]), plain(turned(forces))

    out = [ring.zero] * 19
    kernels["inertia"](p, 0, q, 0, c, s, out, 0, 9, 15)
    whole = [turned(row) for row in zip(*map(turned, zip(*M, strict=True)), strict=True)]
    blocks = (range(3), range(3)), (range(3, 5), range(3)), (range(3, 5), range(3, 5))
    yield "inertia", plain(out), plain(whole[j][k] for rows, columns in blocks for j in rows for k in columns)

    out = [ring.zero] * 2
    centre = kernels["energy"](p, 0, q, v, 0, c, s, X, Y, omega, out)
    yield "energy", plain(out), plain(body.energies([along, across, omega], M))
    yield "centre", plain(centre), plain(turned([M[1][2], -M[0][2]]))


def _rigid() -> sm.Matrix:
    """Force and moment of a rigid body, by its sums."""
    mass, X, Y, second = RIGID
    own = X / mass, Y / mass, second - (X**2 + Y**2) / mass
    known = dict(zip(sm.symbols("centre_x centre_y J_z"), own, strict=True))
    return kane.planar_body_equations().xreplace(known).expand()


def _of_point(text: str, shapes: tuple[str, str]) -> Comparisons:
    """Displacement and rotation of a section, their derivatives, and the acceleration at constant rates."""
    kernels, q, v = functions(text), *(sm.symbols(f"{name}_0 {name}_1") for name in "qv")
    N = [POINT.of_shape(kind, j) for j, kind in enumerate(shapes)]
    G = [[POINT.of_pair(a, b, j, k)["x"] for k, b in enumerate(shapes)] for j, a in enumerate(shapes)]
    grown = [sum(G[j][k] * q[k] for k in range(2)) for j in range(2)]
    twists = [[N[j]["x"] + grown[j], N[j]["y"], N[j]["turn"]] for j in range(2)]
    here = [sum(twists[j][k] * q[j] for j in range(2)) for k in range(3)]
    here[0] -= sum(grown[j] * q[j] for j in range(2)) / 2
    p = [shapes.count("u"), 2, *reading_order(shapes, POINT)]

    out = [sm.S.Zero] * 6
    moved = kernels["displace"](p, 0, q, 0, out, 0)
    yield "displace", [*map(sm.expand, (*moved, *out))], [*map(sm.expand, (*here, *twists[0], *twists[1]))]
    grows = sum(G[j][k] * v[j] * v[k] for j, k in product(range(2), repeat=2))
    yield "growth", [sm.expand(kernels["growth"](p, 0, v, 0))], [sm.expand(grows)]


# ---- both -----------------------------------------------------------------------------------------------------------


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


def _product(u: list[PolyElement], M: list[list[PolyElement]]) -> PolyElement:
    return sum(one * M[j][k] * other for j, one in enumerate(u) for k, other in enumerate(u))


@cache
def _kane() -> Callable:
    """Kane's equations of three shapes, and their mass matrix row by row, as a function of what they depend on."""
    equations, own = kane.shaped_equations(3), list(zip(*map(coordinates, range(3)), strict=True))
    M = equations.jacobian([*kane.ACCEL, *kane.EPSILON, *own[2]])
    moments = dict.fromkeys(symbol for symbol, *_ in _MOMENTS)
    return sm.lambdify([*MOTION, *(x for of in own for x in of), *moments], [*equations, *M], "math")
