"""Kane's equations of a body in space that deforms by shapes, less those of the rigid body that it is without.

A particle of the body that stands at r in its axes is moved by the shapes N_j(r), whose modal coordinates are q_j, and
to the second order by G_jk(r), which are symmetric in j and k:

    p = r + N_j q_j + 1/2 G_jk q_j q_k

Of a link G has its shortening by bending and what sections that turn far move their fibres by. It is part of the
position before partial velocities are formed (Kane, Ryan & Banerjee 1987). The sum over all particles turns products of
these fields into moments; products of up to two shapes are kept, G counting for two, so that kinetic energy is complete
to the second order. As it is linear in the moments, what is kept is still the exact equation of a system whose energy
has an integral.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from itertools import combinations_with_replacement

import sympy as sm
from sympy.physics.mechanics import KanesMethod, Particle, Point, ReferenceFrame, dynamicsymbols

XYZ = "xyz"
VELOCITY, OMEGA, ACCEL, EPSILON = (
    sm.symbols(f"{letter}_x {letter}_y {letter}_z") for letter in ("v", "omega", "a", "epsilon")
)
TWIST, RATE, MOTION = (*VELOCITY, *OMEGA), (*ACCEL, *EPSILON), (*OMEGA, *ACCEL, *EPSILON)
"""Velocity of the origin and angular velocity; acceleration of the origin less gravity and angular acceleration; the
motion that equations depend on: all in the body's axes."""
IN_SPACE, IN_PLANE = tuple(range(6)), (0, 1, 5)
"""Components of a twist in space, and in the x-y plane."""
SINGLE = (*(f"N_{a}" for a in XYZ), *(f"{a}_N_{b}" for a in XYZ for b in XYZ))
"""Moments of one shape: sums over the mass of N_a, r_a N_b."""
PAIR = (
    *(f"N_{a}_N_{b}" for a in XYZ for b in XYZ), *(f"G_{a}" for a in XYZ), *(f"{a}_G_{b}" for a in XYZ for b in XYZ),
)  # fmt: skip
"""Moments of a pair j, k: of N_ja N_kb, G_jka, r_a G_jkb."""
_ORDER = sm.Symbol("order")
MASS = sm.Symbol("dm")
PLACE = sm.symbols("r_x r_y r_z")
BODY = ("mass", *(f"centre_{a}" for a in XYZ), "J_x", "J_y", "J_z", "J_xy", "J_yz", "J_zx")
"""Numbers of a rigid body: mass, centre of mass, moments and products of inertia about it (J_xy = -int x y dm)."""


def coordinates(j: int) -> tuple[sm.Symbol, sm.Symbol, sm.Symbol]:
    """Coordinate of the j-th shape, its rate and its acceleration."""
    return sm.symbols(f"q_{j} v_{j} b_{j}")


def single(name: str, j: int) -> sm.Symbol:
    """A moment of one shape."""
    return sm.Symbol(f"{name}_{j}")


def pair(name: str, j: int, k: int) -> sm.Symbol:
    """A moment of two shapes; both orders of the same are one symbol."""
    if "G" not in name and (j > k or (j == k and name[2] > name[-1])):
        name = f"N_{name[-1]}_N_{name[2]}"
    return sm.Symbol("{}_{}_{}".format(name, *sorted((j, k))))


@cache
def body_equations() -> sm.Matrix:
    """-fr* of a free rigid body (6 x 1) in its own axes: three forces at its origin, three moments about it.

    The sum of Kane's equations of its particles (:func:`particle_equations`) by the numbers BODY.
    """
    mass, *rest = sm.symbols(BODY)
    centre, (J_x, J_y, J_z, J_xy, J_yz, J_zx) = rest[:3], rest[3:]
    second = [[(J_y + J_z - J_x) / 2, -J_xy, -J_zx], [0, (J_z + J_x - J_y) / 2, -J_yz], [0, 0, (J_x + J_y - J_z) / 2]]
    sums = {(MASS,): mass} | {(MASS, r): mass * at for r, at in zip(PLACE, centre, strict=True)}
    for a, b in combinations_with_replacement(range(3), 2):
        sums[MASS, PLACE[a], PLACE[b]] = second[a][b] + mass * centre[a] * centre[b]
    return sm.Matrix([summed(row, sums) for row in particle_equations(PLACE, 0)]).expand()


@cache
def planar_body_equations() -> sm.Matrix:
    """The same in the plane, (3, 1): two forces and the moment, by omega_z, a_x, a_y, epsilon_z."""
    rows = body_equations()[list(IN_PLANE), :].xreplace(still(IN_PLANE))
    return rows.applyfunc(lambda row: sm.collect(row, EPSILON[2]))


def still(twist: Sequence[int]) -> dict[sm.Symbol, sm.Expr]:
    """Zero for the motion's other components than these of a twist."""
    return {of[k]: sm.S.Zero for of in (TWIST, RATE) for k in IN_SPACE if k not in twist}


@cache
def shaped_equations(count: int) -> sm.Matrix:
    """-fr* of a body with so many shapes in moments and MOTION, less that of the same body without: three forces, three
    moments about its origin, then the row of each shape, (6 + count, 1).
    """
    particle = particle_equations([_place(a, at, count) for a, at in zip(XYZ, PLACE, strict=True)], count)
    products, first = dict(_products(count)), particle.diff(_ORDER)
    kept = (first + first.diff(_ORDER) / 2).xreplace({_ORDER: sm.S.Zero})
    return sm.Matrix([summed(row, products) for row in kept])


def _place(a: str, at: sm.Symbol, count: int) -> sm.Expr:
    """Component of a particle's place; every field is multiplied by _ORDER to the power that it counts for."""
    q = [coordinates(j)[0] for j in range(count)]
    first = sum((_N(a, j) * q[j] for j in range(count)), sm.S.Zero)
    return at + _ORDER * first + _ORDER**2 / 2 * sum(
        (_G(a, j, k) * q[j] * q[k] for j in range(count) for k in range(count)), sm.S.Zero
    )


def particle_equations(place: Sequence[sm.Expr], count: int) -> sm.Matrix:
    """-fr* of one particle of mass MASS whose ``place`` in the body's axes depends on so many coordinates.

    SymPy's KanesMethod with the components of the origin's velocity and of the angular velocity in the body's axes for
    speeds (Kane & Levinson 1985, sec. 4.11); they are no rates of coordinates, which the equations don't have either.
    ACCEL is the acceleration of the origin in the body's axes; less gravity, its weight is in them.
    """
    q, rates = ([dynamicsymbols(f"{name}_{j}") for j in range(count)] for name in "qv")
    v, w = dynamicsymbols("v_x v_y v_z"), dynamicsymbols("w_x w_y w_z")
    inertial, body = ReferenceFrame("inertial"), ReferenceFrame("body")
    origin, point, time = Point("origin"), Point("point"), dynamicsymbols._t
    moving = {coordinates(j)[0]: q[j] for j in range(count)}
    place = [component.xreplace(moving) for component in place]
    rate = {c.diff(time): r for c, r in zip(q, rates, strict=True)}

    def in_body(components: Sequence[sm.Expr]):
        return sum((c * axis for c, axis in zip(components, body, strict=True)), 0 * body.x)

    body.set_ang_vel(inertial, in_body(w))
    origin.set_vel(inertial, in_body(v))
    point.set_pos(origin, in_body(place))
    point.set_vel(body, in_body([component.diff(time).xreplace(rate) for component in place]))
    point.v1pt_theory(origin, inertial, body)
    places = dynamicsymbols("p_:6")  # coordinates of the body, which the equations don't have
    kinematics = [c.diff(time) - r for c, r in zip((*q, *places), (*rates, *v, *w), strict=True)]
    kane = KanesMethod(inertial, q_ind=[*q, *places], u_ind=[*v, *w, *rates], kd_eqs=kinematics)
    _, inertial_forces = kane.kanes_equations([Particle("particle", point, MASS)], [])
    carried = sm.Matrix(ACCEL) - sm.Matrix(OMEGA).cross(sm.Matrix(v))
    own = [coordinates(j) for j in range(count)]
    plain = dict(zip((each.diff(time) for each in (*w, *v, *rates)),
                     (*EPSILON, *carried, *(b for *_, b in own)), strict=True))  # fmt: skip
    symbols = dict(zip((*w, *q, *rates), (*OMEGA, *(c for c, *_ in own), *(r for _, r, _ in own)), strict=True))
    return (-inertial_forces).xreplace(plain | rate).xreplace(symbols)


def _N(a: str, j: int) -> sm.Symbol:
    return sm.Symbol(f"N{j}_{a}")


def _G(a: str, j: int, k: int) -> sm.Symbol:
    return sm.Symbol("G{}{}_{}".format(*sorted((j, k)), a))


def summed(expression: sm.Expr, products: Mapping[tuple[sm.Symbol, ...], sm.Expr]) -> sm.Expr:
    """The sum over the particles of an expression: products of fields, in the order of their names, become moments."""
    fields = sorted({f for product in products for f in product}, key=str)
    total = sm.S.Zero
    for powers, coefficient in sm.Poly(expression.expand(), *fields).terms():
        product = tuple(f for f, power in zip(fields, powers, strict=True) for _ in range(power))
        total += products[product] * coefficient if coefficient else 0
    left = total.free_symbols & {MASS, *PLACE, *fields}
    if left or total.has(sm.Derivative):
        raise ValueError(f"Kane's equations of a body depend on {sorted(map(str, left))}")
    return total


def _products(count: int) -> Iterator[tuple[tuple[sm.Symbol, ...], sm.Symbol]]:
    """Products under the sum, factors in the order of their names, with the moments that they are."""

    def key(*factors: sm.Symbol) -> tuple[sm.Symbol, ...]:
        return tuple(sorted((MASS, *factors), key=str))

    for j in range(count):
        for b in XYZ:
            yield key(_N(b, j)), single(f"N_{b}", j)
            for a, at in zip(XYZ, PLACE, strict=True):
                yield key(at, _N(b, j)), single(f"{a}_N_{b}", j)
        for k in range(j, count):
            for b in XYZ:
                yield key(_G(b, j, k)), pair(f"G_{b}", j, k)
                for a, at in zip(XYZ, PLACE, strict=True):
                    yield key(_N(a, j), _N(b, k)), pair(f"N_{a}_N_{b}", j, k)
                    yield key(at, _G(b, j, k)), pair(f"{a}_G_{b}", j, k)
