"""Kane's equations of one body in the plane that moves freely and deforms by modal coordinates.

A slice rho A dx of the body stands at the distance X from the body's start; axial coordinates b_j stretch it by the
shapes s_j(X), transverse ones a_j bend it by w_j(X) and turn it by psi_j(X):

    p = r + R(phi) (X + s_j b_j - 1/2 H_jk a_j a_k, Y + w_j a_j),    H_jk(X) = int_X_0^X w_j' w_k' dx

s and w vanish where the link holds its frame, at X_0; there H begins. r is where the start was before the deformation.

The foreshortening -1/2 H_jk a_j a_k is part of the position before partial velocities are formed, so that geometric
stiffening comes out of Kane's equations by itself (Kane, Ryan & Banerjee 1987). The sum over all slices turns products
of shapes into moments, which are parameters: one set of equations serves every section, length and set of shapes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import combinations_with_replacement

import sympy as sm
from sympy.physics.mechanics import (
    Force,
    KanesMethod,
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)

from kaneflex.derive.rigid import TIME

HIGHEST_ORDER = 2
"""Highest order of a moment in the displacements (H counts two): kinetic energy is complete to the second order.

A frame that hangs at a free end moves against the shortening by as much as the link shortens; then the squares of H'
that are left out are those of its own motion, and without them the mass matrix loses its definiteness. So the frame has
to be attached where joints hold the link.

What is kept is still the exact equation of a mechanical system: kinetic energy is linear in the moments, so leaving
some out leaves its energy integral intact.
"""


@dataclass(frozen=True)
class Moment:
    """A sum over the slices of a body, of mass times a product of shape functions: its name, unit and symbol.

    ``factors`` are the names of the functions under the sum: X, s_j, w_j, H_j_k with the mass of a slice, psi_j with
    its rotary inertia (``of`` is then "inertia").
    """

    name: str
    of: str
    factors: tuple[str, ...]
    symbol: sm.Symbol


@dataclass(frozen=True)
class FlexibleBody:
    """Equations M q'' = f of a free body without joints and stiffness, over plain symbols.

    Attributes
    ----------
    q, v : tuple of Symbol
        x, y, phi of the body's start, then its modal coordinates, axial ones first; and their rates.
    gravity : (Symbol, Symbol)
        Components of the acceleration of gravity.
    mass : Matrix
        M(q).
    forcing : Matrix
        f(q, v): quadratic in the rates, and the weight.
    weight : Expr
        Potential energy of the weight.
    moments : tuple of Moment
    """

    q: tuple[sm.Symbol, ...]
    v: tuple[sm.Symbol, ...]
    gravity: tuple[sm.Symbol, sm.Symbol]
    mass: sm.Matrix
    forcing: sm.Matrix
    weight: sm.Expr
    moments: tuple[Moment, ...]


@cache
def flexible_body(axial: int, transverse: int, rotary: bool) -> FlexibleBody:
    """Kane's equations of a body with so many axial and transverse shapes (none of both: a rigid body).

    ``rotary``: whether its slices have rotary inertia of their own; a rigid body has, as that about its start.
    """
    slice_ = Slice(axial, transverse, rotary)
    x, y, phi = coordinates = dynamicsymbols("x y phi")
    v_x, v_y, omega = speeds = dynamicsymbols("v_x v_y omega")
    b, b_rate = _indexed("b", axial), _indexed("b_rate", axial)
    a, a_rate = _indexed("a", transverse), _indexed("a_rate", transverse)
    q, u = [*coordinates, *b, *a], [*speeds, *b_rate, *a_rate]
    rate = {coordinate.diff(TIME): speed for coordinate, speed in zip(q, u, strict=True)}

    inertial, ground = ReferenceFrame("inertial"), Point("ground")
    axes = inertial.orientnew("axes", "Axis", (phi, inertial.z))
    ground.set_vel(inertial, 0)
    axes.set_ang_vel(inertial, omega * inertial.z)
    along, across, turn = slice_.place(b, a)
    start = ground.locatenew("start", x * inertial.x + y * inertial.y)
    start.set_vel(inertial, v_x * inertial.x + v_y * inertial.y)
    point = start.locatenew("slice", along * axes.x + across * axes.y)
    relative = along.diff(TIME).subs(rate) * axes.x + across.diff(TIME).subs(rate) * axes.y
    carried = omega * (along * axes.y - across * axes.x)
    point.set_vel(inertial, start.vel(inertial) + relative + carried)
    section = axes.orientnew("section", "Axis", (turn, axes.z)) if turn else axes
    if turn:
        section.set_ang_vel(axes, turn.diff(TIME).subs(rate) * axes.z)
    body = RigidBody("slice", point, section, slice_.mass, (inertia(section, 0, 0, slice_.inertia), point))
    g_x, g_y = sm.symbols("g_x g_y")
    weight = slice_.mass * (g_x * inertial.x + g_y * inertial.y)
    kane = KanesMethod(inertial, q_ind=q, u_ind=u, kd_eqs=[c.diff(TIME) - s for c, s in zip(q, u, strict=True)])
    kane.kanes_equations([body], [Force(point, weight)])
    potential = -weight.dot(point.pos_from(ground))

    plain = {function: sm.Symbol(function.func.__name__) for function in (*u, *q)}
    moments = slice_.moments()

    def summed(expression: sm.Expr) -> sm.Expr:
        return slice_.summed(expression.xreplace(plain), moments)

    return FlexibleBody(
        tuple(plain[c] for c in q),
        tuple(plain[s] for s in u),
        (g_x, g_y),
        kane.mass_matrix.applyfunc(summed),
        kane.forcing.applyfunc(summed),
        summed(potential),
        moments,
    )


def _indexed(name: str, count: int) -> list[sm.Function]:
    return [dynamicsymbols(f"{name}_{k}") for k in range(count)]


class Slice:
    """A slice of the body: its mass, its rotary inertia, and what its place depends on."""

    def __init__(self, axial: int, transverse: int, rotary: bool) -> None:
        self.mass, self.inertia = sm.Symbol("mass"), sm.Symbol("inertia") if rotary else sm.S.Zero
        self.s = [sm.Symbol(f"s_{j}") for j in range(axial)]
        self.w = [sm.Symbol(f"w_{j}") for j in range(transverse)]
        self.psi = [sm.Symbol(f"psi_{j}") for j in range(transverse)] if rotary else []
        pairs = combinations_with_replacement(range(transverse), 2)
        self.H = {(j, k): sm.Symbol(f"H_{j}_{k}") for j, k in pairs}
        self.X, self.Y = sm.Symbol("X"), sm.S.Zero if axial or transverse else sm.Symbol("Y")

    def place(self, b: list, a: list) -> tuple[sm.Expr, sm.Expr, sm.Expr]:
        """Position along and across the body, and rotation of the section."""
        shortening = sum(((1 if j == k else 2) * H * a[j] * a[k] for (j, k), H in self.H.items()), sm.S.Zero) / 2
        along = self.X + sum((s * c for s, c in zip(self.s, b, strict=True)), sm.S.Zero) - shortening
        across = self.Y + sum((w * c for w, c in zip(self.w, a, strict=True)), sm.S.Zero)
        turn = sum((psi * c for psi, c in zip(self.psi, a, strict=False)), sm.S.Zero)
        return along, across, turn

    @property
    def functions(self) -> list[sm.Symbol]:
        """Everything that depends on where the slice is."""
        return [*self._orders(), *self.psi]

    def _orders(self) -> dict[sm.Symbol, int]:
        """Order of every function under the sum in the displacements."""
        orders = {self.X: 0} | ({self.Y: 0} if self.Y else {})
        return orders | dict.fromkeys([*self.s, *self.w], 1) | dict.fromkeys(self.H.values(), 2)

    def moments(self) -> tuple[Moment, ...]:
        orders = self._orders()
        products: list[tuple[sm.Symbol, ...]] = [()] + [(f,) for f in orders]
        products += [
            pair for pair in combinations_with_replacement(orders, 2) if sum(orders[f] for f in pair) <= HIGHEST_ORDER
        ]
        found = [self._moment("mass", product) for product in products]
        if self.inertia:
            turns = [(), *((f,) for f in self.psi), *combinations_with_replacement(self.psi, 2)]
            found += [self._moment("inertia", product) for product in turns]
        return tuple(found)

    @staticmethod
    def _moment(of: str, product: tuple[sm.Symbol, ...]) -> Moment:
        factors = tuple(str(factor) for factor in product)
        name = "_".join([of, *factors])
        return Moment(name, of, factors, sm.Symbol(name))

    def summed(self, expression: sm.Expr, moments: tuple[Moment, ...]) -> sm.Expr:
        """The sum over all slices of an expression that is linear in mass and inertia, quadratic in the functions."""
        functions = self.functions
        total = sm.S.Zero
        for of, amount in (("mass", self.mass), ("inertia", self.inertia)):
            if not amount:
                continue
            share = expression.xreplace({self.mass: sm.S.Zero, self.inertia: sm.S.Zero, amount: sm.S.One})
            if share == 0:
                continue
            for moment in moments:
                if moment.of != of:
                    continue
                present = {sm.Symbol(factor) for factor in moment.factors}
                alone = share.xreplace({f: sm.S.Zero for f in functions if f not in present})
                for factor in moment.factors:
                    alone = alone.diff(sm.Symbol(factor))
                alone = alone.xreplace(dict.fromkeys(present, sm.S.Zero))
                twice = 2 if len(moment.factors) == 2 and len(present) == 1 else 1
                total += moment.symbol * alone / twice
        return total
