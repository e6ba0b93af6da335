"""Equations of a body in the plane: those in space, restricted to stretch u, bending v and omega about z.

Sums over the mass have the names of :mod:`kaneflex.scene.modal_data`: of mass times X, s_j (stretch), w_j (bending) and
H_jk, the integral of w_j' w_k', and of rotary inertia times psi_j, the rotation of the section.

A frame that is attached at a free end moves against the shortening by as much as the link shortens. Then the squares of
H' are those of its own motion, and without them the mass matrix loses its definiteness: the frame has to be attached
where joints hold the link.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache
from itertools import combinations_with_replacement, product

import sympy as sm

from kaneflex.derive.bodies.kane import ACCEL, PAIR, SINGLE, body_equations, coordinates, pair, shaped_equations, single
from kaneflex.derive.bodies.kane import EPSILON as ANGULAR
from kaneflex.derive.bodies.kane import OMEGA as SPIN
from kaneflex.derive.bodies.kinds import moment

ALONG, ACROSS, EPSILON, OMEGA = sm.symbols("along across epsilon omega")
_PLANE = dict(zip((*SPIN, *ACCEL, *ANGULAR), (0, 0, OMEGA, ALONG, ACROSS, 0, 0, 0, EPSILON), strict=True))
_NAMES = {"u": "s", "v": "w", "theta_z": "psi"}
_ELASTIC = {"K_": "stiffness", "C_": "damping"}
_ORDER = ("X", "s", "w", "H", "psi")
"""Factors in the name of a sum."""
RIGID = (*sm.symbols("mass mass_X mass_Y"), sum(sm.symbols("mass_X_X mass_Y_Y inertia")))
"""Sums of a rigid body."""
AT = sm.symbols("share X Y")
"""A point of it, and its share of the forces there."""


@cache
def planar_equations(axial: int, transverse: int) -> sm.Matrix:
    """M u' - f of a free body with so many shapes, in its axes: along, across, moment, rows of ``coordinates(j)``."""
    kinds = ("u",) * axial + ("v",) * transverse
    count = len(kinds)
    symbols = {single(name, j): (name, j, j) for j in range(count) for name in SINGLE}
    pairs = combinations_with_replacement(range(count), 2)
    symbols |= {pair(name, j, k): (name, j, k) for (j, k), name in product(pairs, PAIR)}
    moments = {symbol: by_name(moment(kinds, *of), axial) for symbol, of in symbols.items()}
    derived = count + count % 2  # an odd shape more is still: so few numbers of shapes are derived
    still = {symbol: 0 for j in range(count, derived) for symbol in coordinates(j)}
    shaped = shaped_equations(derived, True).xreplace(_PLANE | still | moments) if count else sm.zeros(6, 1)
    rigid = body_equations().xreplace(_PLANE).xreplace(_rigid())
    forces = sm.Matrix([*(rigid + shaped[:6, :])[[0, 1, 5], :], *shaped[6 : 6 + count, :]])
    return forces.expand()


def _rigid() -> dict[sm.Symbol, sm.Expr]:
    """Numbers of a rigid body in space by the sums of one in the plane."""
    mass, X, Y = sm.symbols("mass mass_X mass_Y")
    J = sum(sm.symbols("mass_X_X mass_Y_Y inertia")) - (X**2 + Y**2) / mass
    return dict(zip(sm.symbols("centre_x centre_y J_z"), (X / mass, Y / mass, J), strict=True))


def by_name(expression: sm.Expr, axial: int = 0, of: str = "mass") -> sm.Expr:
    """Products of fields as sums of mass or rotary inertia by their names; with ``of`` empty, of a point."""
    terms = expression.as_coefficients_dict().items()
    names = ((number, "_".join(filter(None, _factors(term, axial, of)))) for term, number in terms if number)
    return sum((number * sm.Symbol(name) for number, name in names), sm.S.Zero)


def _factors(term: sm.Expr, axial: int, of: str) -> list[str]:
    """Parts of a sum's name, like mass, X, H_0_1."""
    if str(term)[:2] in _ELASTIC:
        return [_ELASTIC[str(term)[:2]], *str(term)[2:]]
    found, slopes = list[str](), list[int]()
    for symbol, power in term.as_powers_dict().items():
        letter, index = re.fullmatch(r"(.+?)(\d*)", str(symbol)).groups()
        if letter == "I_z":
            of = "inertia"
        elif letter == "slope_v":
            slopes += [int(index) - axial] * power
        elif letter == "x":
            found += ["X"] * power
        else:
            found += [f"{_NAMES[letter]}_{int(index) - (letter != 'u') * axial}"] * power
    found += [f"H_{min(slopes)}_{max(slopes)}"] if slopes else []
    return [of, *sorted(found, key=lambda each: (_ORDER.index(each.partition("_")[0]), each))]


def place(b: Sequence[sm.Expr], a: Sequence[sm.Expr]) -> tuple[sm.Expr, sm.Expr, sm.Expr]:
    """Position along and across the body, and rotation of the section, of a point with these modal coordinates."""
    both = product(enumerate(a), repeat=2)
    shortening = sum((sm.Symbol(f"H_{min(j, k)}_{max(j, k)}") * c * d for (j, c), (k, d) in both), sm.S.Zero) / 2
    along, across, turn = (sum((sm.Symbol(f"{name}_{j}") * c for j, c in enumerate(of)), sm.S.Zero)
                           for name, of in (("s", b), ("w", a), ("psi", a)))  # fmt: skip
    return sm.Symbol("X") + along - shortening, sm.Symbol("Y") + across, turn
