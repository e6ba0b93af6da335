"""Kane's equations of a body in space that deforms by shapes, less those of the rigid body that it is without.

A slice of the body stands at the distance X along the body's axis x; with modal coordinates q_j its point moves by the
shapes N_j(X), the body shortens by both planes of bending, and its section turns by the angles psi_j(X):

    p = (X - 1/2 H_jk q_j q_k) e_x + N_j q_j,    H_jk(X) = int (v_j' v_k' + w_j' w_k') dX,    theta = psi_j q_j

The foreshortening is part of the position before partial velocities are formed (Kane, Ryan & Banerjee 1987), and a
section turns by bending the shortest way, then about its tangent (:mod:`kaneflex.derive.spatial_slice`). The sum over
all slices turns products of shapes into moments; products of up to two shapes are kept, H counting for two, so that
kinetic energy is complete to the second order. As it is linear in the moments, what is kept is still the exact equation
of a system whose energy has an integral.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache, reduce

import sympy as sm
from sympy.physics.mechanics import KanesMethod, Point, ReferenceFrame, RigidBody, dynamicsymbols, inertia

from kaneflex.derive.spatial_slice import section_angular_velocity, section_rotation

XYZ = "xyz"
OMEGA, ACCEL, EPSILON = (sm.symbols(f"{letter}_x {letter}_y {letter}_z") for letter in ("omega", "a", "epsilon"))
MOTION = (*OMEGA, *ACCEL, *EPSILON)
"""Angular velocity, acceleration of the origin less gravity, angular acceleration, in the body's axes."""
SINGLE = (
    *(f"mass_{a}" for a in XYZ), *(f"mass_X_{a}" for a in XYZ), *(f"I_y_{a}" for a in XYZ), *(f"I_z_{a}" for a in XYZ),
)  # fmt: skip
"""Moments of one shape: sums over the slices of dm N_a, dm X N_a, dI_y psi_a, dI_z psi_a."""
PAIR = (
    *(f"mass_{a}{b}" for a in XYZ for b in XYZ), "mass_H", "mass_X_H",
    *(f"I_y_{a}{b}" for a in XYZ for b in XYZ), *(f"I_z_{a}{b}" for a in XYZ for b in XYZ),
)  # fmt: skip
"""Moments of a pair j, k: of dm N_ja N_kb, dm H_jk, dm X H_jk, dI_y psi_ja psi_kb, dI_z psi_ja psi_kb."""
_ORDER = sm.Symbol("order")
_X, _MASS, _I_Y, _I_Z = sm.symbols("X mass I_y I_z")


def coordinates(j: int) -> tuple[sm.Symbol, sm.Symbol, sm.Symbol]:
    """Coordinate of the j-th shape, its rate and its acceleration."""
    return sm.symbols(f"q_{j} v_{j} b_{j}")


def single(name: str, j: int) -> sm.Symbol:
    """A moment of one shape."""
    return sm.Symbol(f"{name}_{j}")


def pair(name: str, j: int, k: int) -> sm.Symbol:
    """A moment of two shapes; both orders of the same are one symbol."""
    if j > k:
        j, k = k, j
        name = name if name.endswith("H") else name[:-2] + name[:-3:-1]
    elif j == k and not name.endswith("H"):
        name = name[:-2] + "".join(sorted(name[-2:]))
    return sm.Symbol(f"{name}_{j}_{k}")


@cache
def shaped_equations(count: int) -> sm.Matrix:
    """-fr* of a body with so many shapes in moments and MOTION, less that of the same body without: three forces, three
    moments about its origin, then the row of each shape, (6 + count, 1)."""
    rows = [_orders(row) for row in _of_slice(count)]
    return sm.Matrix([_summed(first + second, count) for _, first, second in rows])


def _orders(expression: sm.Expr) -> tuple[sm.Expr, ...]:
    """What stands before the powers 0, 1 and 2 of _ORDER in a polynomial: to expand all of it would take long."""
    none = (sm.S.Zero,) * 2
    if expression == _ORDER:
        return sm.S.Zero, sm.S.One, sm.S.Zero
    if not expression.has(_ORDER):
        return expression, *none
    if expression.is_Pow:
        return reduce(_times, [_orders(expression.base)] * int(expression.exp))
    parts = [_orders(part) for part in expression.args]
    return reduce(_times, parts) if expression.is_Mul else tuple(sm.Add(*of) for of in zip(*parts, strict=True))


def _times(left: tuple[sm.Expr, ...], right: tuple[sm.Expr, ...]) -> tuple[sm.Expr, ...]:
    (a, b, c), (d, e, f) = left, right
    return a * d, a * e + b * d, a * f + b * e + c * d


def _of_slice(count: int) -> sm.Matrix:
    """-fr* of one slice; every shape stands with the symbol _ORDER to the power that it counts for."""
    N, psi = ([sm.symbols(f"{name}{j}_x {name}{j}_y {name}{j}_z") for j in range(count)] for name in ("N", "psi"))
    q, rates = ([dynamicsymbols(f"{name}_{j}") for j in range(count)] for name in "qv")
    v, w = dynamicsymbols("v_x v_y v_z"), dynamicsymbols("w_x w_y w_z")
    inertial, body, section = (ReferenceFrame(name) for name in ("inertial", "body", "section"))
    origin, point, time = Point("origin"), Point("point"), dynamicsymbols._t
    rate = {c.diff(time): r for c, r in zip(q, rates, strict=True)}

    def in_body(components: Sequence[sm.Expr]):
        return sum((c * axis for c, axis in zip(components, body, strict=True)), 0 * body.x)

    def field(shapes: Sequence, factors: Sequence) -> list[sm.Expr]:
        return [_ORDER * sum((s[i] * c for s, c in zip(shapes, factors, strict=True)), sm.S.Zero) for i in range(3)]

    along, across, aside = field(N, q)
    shortening = sum((_H(j, k) * q[j] * q[k] for j in range(count) for k in range(count)), sm.S.Zero) / 2
    place = (_X + along - _ORDER**2 * shortening, across, aside)
    body.set_ang_vel(inertial, in_body(w))
    origin.set_vel(inertial, in_body(v))
    point.set_pos(origin, in_body(place))
    point.set_vel(body, in_body([component.diff(time).xreplace(rate) for component in place]))
    point.v1pt_theory(origin, inertial, body)
    section.orient_explicit(body, section_rotation(*field(psi, q)))
    section.set_ang_vel(body, in_body(section_angular_velocity(field(psi, q), field(psi, rates))))
    slice_ = RigidBody("slice", point, section, _MASS, (inertia(section, _I_Y + _I_Z, _I_Y, _I_Z), point))
    kinematics = [c.diff(time) - r for c, r in zip(q, rates, strict=True)]
    places = dynamicsymbols("p_:6")  # coordinates of the body, which the equations don't have
    kinematics += [p.diff(time) - u for p, u in zip(places, (*v, *w), strict=True)]
    kane = KanesMethod(inertial, q_ind=[*q, *places], u_ind=[*v, *w, *rates], kd_eqs=kinematics)
    _, inertial_forces = kane.kanes_equations([slice_], [])
    plain = {c.diff(time): value for c, value in zip(w, EPSILON, strict=True)}
    turned = sm.Matrix(OMEGA).cross(sm.Matrix(v))
    plain |= {c.diff(time): a - t for c, a, t in zip(v, ACCEL, turned, strict=True)}
    for j in range(count):
        plain |= dict(zip((q[j].diff(time), rates[j].diff(time)), coordinates(j)[1:], strict=True))
    found = (-inertial_forces).xreplace(plain).xreplace(dict(zip(w, OMEGA, strict=True)))
    for j in range(count):
        found = found.xreplace(dict(zip((q[j], rates[j]), coordinates(j), strict=False)))
    return found


def _H(j: int, k: int) -> sm.Symbol:
    return sm.Symbol("H{}_{}".format(*sorted((j, k))))


def _summed(expression: sm.Expr, count: int) -> sm.Expr:
    """The sum over the slices of an expression: products of functions of X become moments."""
    products = dict(_products(count))
    functions = sorted({f for product in products for f, _ in product}, key=str)
    total = sm.S.Zero
    for powers, coefficient in sm.Poly(expression.expand(), *functions).terms():
        product = tuple((f, power) for f, power in zip(functions, powers, strict=True) if power)
        total += products[product] * coefficient
    left = total.free_symbols & {_X, _MASS, _I_Y, _I_Z, *functions}
    if left or total.has(sm.Derivative):
        raise ValueError(f"Kane's equations of a body that deforms depend on {sorted(map(str, left))}")
    return total


def _products(count: int) -> Iterator[tuple[tuple[tuple[sm.Symbol, int], ...], sm.Symbol]]:
    """Products under the sum, as powers of functions in the order of their names, with the moments that they are."""

    def key(*factors: sm.Symbol) -> tuple[tuple[sm.Symbol, int], ...]:
        return tuple((f, factors.count(f)) for f in sorted(set(factors), key=str))

    for j in range(count):
        for a in XYZ:
            N, psi = sm.Symbol(f"N{j}_{a}"), sm.Symbol(f"psi{j}_{a}")
            yield key(_MASS, N), single(f"mass_{a}", j)
            yield key(_MASS, _X, N), single(f"mass_X_{a}", j)
            for of in (_I_Y, _I_Z):
                yield key(of, psi), single(f"{of}_{a}", j)
            for k in range(j, count):
                for b in XYZ:
                    yield key(_MASS, N, sm.Symbol(f"N{k}_{b}")), pair(f"mass_{a}{b}", j, k)
                    for of in (_I_Y, _I_Z):
                        yield key(of, psi, sm.Symbol(f"psi{k}_{b}")), pair(f"{of}_{a}{b}", j, k)
        for k in range(j, count):
            yield key(_MASS, _H(j, k)), pair("mass_H", j, k)
            yield key(_MASS, _X, _H(j, k)), pair("mass_X_H", j, k)
