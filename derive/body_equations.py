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
from dataclasses import dataclass
from functools import cache
from itertools import combinations_with_replacement, product

import sympy as sm

from kaneflex.derive import spatial
from kaneflex.derive.body_kinds import moment
from kaneflex.derive.loops import COORDINATES
from kaneflex.derive.spatial_shapes import ACCEL, PAIR, SINGLE, coordinates, pair, shaped_equations, single
from kaneflex.derive.spatial_shapes import EPSILON as ANGULAR
from kaneflex.derive.spatial_shapes import OMEGA as SPIN

B, A = COORDINATES["s"], COORDINATES["w"]
MOTION = ALONG, ACROSS, EPSILON, OMEGA = sm.symbols("along across epsilon omega")
_PLANE = dict(zip((*SPIN, *ACCEL, *ANGULAR), (0, 0, OMEGA, ALONG, ACROSS, 0, 0, 0, EPSILON), strict=True))
_NAMES = {"u": "s", "v": "w", "theta_z": "psi"}
_ORDER = ("X", "s", "w", "H", "psi")
"""Factors in the name of a sum."""


@dataclass(frozen=True)
class BodyEquations:
    """Equations of a body with one shape of each kind, in its own axes; the symbols are those of ``loops.COORDINATES``.

    Attributes
    ----------
    forces : Matrix
        M u' - f, stiffness and damping included: along, across, moment about the start, then the rows of b and a.
        ``along``, ``across``: acceleration of the start less gravity.
    mass : Matrix
        M, d forces / d(along, across, epsilon, b2, a2).
    kinetic, strain, lost : Expr
        Energies [J] and dissipated power [W]; ``along``, ``across`` are there the speed of the start.
    """

    forces: sm.Matrix
    mass: sm.Matrix
    kinetic: sm.Expr
    strain: sm.Expr
    lost: sm.Expr


@cache
def body_equations() -> BodyEquations:
    """Kane's equations with one shape of each kind, with stiffness and damping."""
    own = dict(zip((*coordinates(0), *coordinates(1)), (*B, *A), strict=True))
    forces = planar_equations(1, 1).xreplace(own)
    K_b, K_a, C_bb, C_ba, C_aa = sm.symbols("stiffness_0 stiffness_1 damping_0_0 damping_0_1 damping_1_1")
    modal, rates = sm.Matrix([B[0], A[0]]), sm.Matrix([B[1], A[1]])
    K, C = sm.diag(K_b, K_a), sm.Matrix([[C_bb, C_ba], [C_ba, C_aa]])
    forces += sm.Matrix([0, 0, 0, *(K * modal + C * rates)])
    mass = forces.jacobian([ALONG, ACROSS, EPSILON, B[2], A[2]])
    u = sm.Matrix([ALONG, ACROSS, OMEGA, *rates])
    kinetic, strain, lost = (u.T * mass * u)[0] / 2, (modal.T * K * modal)[0] / 2, (rates.T * C * rates)[0]
    return BodyEquations(forces.expand(), mass, *(each.expand() for each in (kinetic, strain, lost)))


@cache
def planar_equations(axial: int, transverse: int) -> sm.Matrix:
    """M u' - f of a free body with so many shapes, in its axes: along, across, moment, rows of ``coordinates(j)``."""
    kinds = ("u",) * axial + ("v",) * transverse
    count = len(kinds)
    symbols = {single(name, j): (name, j, j) for j in range(count) for name in SINGLE}
    pairs = combinations_with_replacement(range(count), 2)
    symbols |= {pair(name, j, k): (name, j, k) for (j, k), name in product(pairs, PAIR)}
    moments = {symbol: _named(moment(kinds, *of), axial) for symbol, of in symbols.items()}
    derived = count + count % 2  # an odd shape more is still: so few numbers of shapes are derived
    still = {symbol: 0 for j in range(count, derived) for symbol in coordinates(j)}
    shaped = shaped_equations(derived, True).xreplace(_PLANE | still | moments) if count else sm.zeros(6, 1)
    rigid = spatial.body_equations().xreplace(_PLANE).xreplace(_rigid())
    forces = sm.Matrix([*(rigid + shaped[:6, :])[[0, 1, 5], :], *shaped[6 : 6 + count, :]])
    return forces.expand()


def _rigid() -> dict[sm.Symbol, sm.Expr]:
    """Numbers of a rigid body in space by the sums of one in the plane."""
    mass, X, Y = sm.symbols("mass mass_X mass_Y")
    J = sum(sm.symbols("mass_X_X mass_Y_Y inertia")) - (X**2 + Y**2) / mass
    return dict(zip(sm.symbols("centre_x centre_y J_z"), (X / mass, Y / mass, J), strict=True))


def _named(expression: sm.Expr, axial: int) -> sm.Expr:
    """Products of fields as sums of mass or rotary inertia by their names."""
    terms = expression.as_coefficients_dict().items()
    return sum((number * sm.Symbol("_".join(_factors(term, axial))) for term, number in terms if number), sm.S.Zero)


def _factors(term: sm.Expr, axial: int) -> list[str]:
    """Parts of a sum's name, like mass, X, H_0_1."""
    found, slopes, of = list[str](), list[int](), "mass"
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
