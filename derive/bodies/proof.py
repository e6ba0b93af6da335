"""Equations of a body in the plane, and the proof that the printed kernels are these.

Kane's equations in space are restricted to stretch u, bending v and omega about z. Sums over the mass have the names of
:mod:`kaneflex.scene.modal_data`: of mass times X, s_j (stretch), w_j (bending) and H_jk, the integral of w_j' w_k', and
of rotary inertia times psi_j, the rotation of the section.

A frame that is attached at a free end moves against the shortening by as much as the link shortens. Then the squares of
H' are those of its own motion, and without them the mass matrix loses its definiteness: the frame has to be attached
where joints hold the link.

The proof executes the printed text with symbols in its arrays, for small numbers of shapes. Sums over equal indices are
no different for more shapes.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from itertools import combinations_with_replacement, product
from types import SimpleNamespace

import sympy as sm
from sympy.physics.mechanics import dynamicsymbols

from kaneflex.derive.bodies import kane
from kaneflex.derive.bodies.kane import coordinates, pair, single
from kaneflex.derive.bodies.kinds import PLANE, POINT, Kinds, moment, reading_order

ALONG, ACROSS, EPSILON, OMEGA = sm.symbols("along across epsilon omega")
_PLANE = dict(zip(kane.MOTION, (0, 0, OMEGA, ALONG, ACROSS, 0, 0, 0, EPSILON), strict=True))
_NAMES = {"u": "s", "v": "w", "theta_z": "psi"}
_ELASTIC = {"K_": "stiffness", "C_": "damping"}
_ORDER = ("X", "s", "w", "H", "psi")
"""Factors in the name of a sum."""
RIGID = (*sm.symbols("mass mass_X mass_Y"), sum(sm.symbols("mass_X_X mass_Y_Y inertia")))
"""Sums of a rigid body."""


@cache
def planar_equations(axial: int, transverse: int) -> sm.Matrix:
    """M u' - f of a free body with so many shapes, in its axes: along, across, moment, rows of ``coordinates(j)``."""
    kinds = ("u",) * axial + ("v",) * transverse
    count = len(kinds)
    symbols = {single(name, j): (name, j, j) for j in range(count) for name in kane.SINGLE}
    pairs = combinations_with_replacement(range(count), 2)
    symbols |= {pair(name, j, k): (name, j, k) for (j, k), name in product(pairs, kane.PAIR)}
    moments = {symbol: by_name(moment(kinds, *of), axial) for symbol, of in symbols.items()}
    derived = count + count % 2  # an odd shape more is still: so few numbers of shapes are derived
    still = {symbol: 0 for j in range(count, derived) for symbol in coordinates(j)}
    shaped = kane.shaped_equations(derived, True).xreplace(_PLANE | still | moments) if count else sm.zeros(6, 1)
    rigid = kane.body_equations().xreplace(_PLANE).xreplace(_rigid())
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
    """Displacement along and across the body, and rotation, of a section with these modal coordinates."""
    both = product(enumerate(a), repeat=2)
    shortening = sum((sm.Symbol(f"H_{min(j, k)}_{max(j, k)}") * c * d for (j, c), (k, d) in both), sm.S.Zero) / 2
    along, across, turn = (sum((sm.Symbol(f"{name}_{j}") * c for j, c in enumerate(of)), sm.S.Zero)
                           for name, of in (("s", b), ("w", a), ("psi", a)))  # fmt: skip
    return along - shortening, across, turn


# ---- proof ----------------------------------------------------------------------------------------------------------

PROVED = ((0, 0), (1, 0), (0, 1), (1, 2), (2, 2))
"""Numbers of axial and transverse shapes for which the kernels are proved: every sum runs over none, one and two."""

C, S, PHI = sm.symbols("c s phi")
TIME = dynamicsymbols._t


class NotKane(AssertionError):
    """A kernel computes something else than the derived equations."""


def prove(text: str) -> None:
    """Raise NotKane if a kernel of this text differs from the derived equations."""
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
    names = {"njit": lambda **options: lambda kernel: kernel, "IN_ORDER": {}, "WITHIN": {}}
    exec(compile(text, "kernels", "exec"), names)
    return names


def comparisons(text: str, axial: int, transverse: int) -> Comparisons:
    """Comparisons of a body, then of its points."""
    kernels = SimpleNamespace(**functions(text))
    yield from _of_body(kernels, axial, transverse)
    yield from _of_point(kernels, axial, transverse)


def _numbers(first: Iterable[sm.Expr], axial: int, transverse: int, kinds: Kinds, of: str) -> list[sm.Expr]:
    """Numbers of a body or of a point in the moments' symbols."""
    shapes = reading_order("u" * axial + "v" * transverse, kinds)
    return [*first, axial, axial + transverse, *(by_name(value, axial, of) for value in shapes)]


def _of_body(kernels: SimpleNamespace, axial: int, transverse: int):
    shapes = axial + transverse
    n, own = 3 + shapes, planar_equations(axial, transverse)
    p = _numbers(RIGID, axial, transverse, PLANE, "mass")
    stiffness = sm.diag(*(sm.Symbol(f"stiffness_{k}") for k in range(shapes)))
    damping = sm.Matrix(shapes, shapes, lambda j, k: sm.Symbol(f"damping_{min(j, k)}_{max(j, k)}"))
    q, v, a = (list(of) for of in zip(*map(coordinates, range(shapes)), strict=True)) if shapes else ([], [], [])
    modal, rates = sm.Matrix(shapes, 1, q), sm.Matrix(shapes, 1, v)
    inside = sm.Matrix([0, 0, 0, *(stiffness * modal + damping * rates)])
    turn = sm.eye(n)
    turn[:2, :2] = sm.Matrix([[C, -S], [S, C]])
    x, y, v_x, v_y = sm.symbols("x y v_x v_y")

    M = own.jacobian([ALONG, ACROSS, EPSILON, *a])
    out = [sm.S.Zero] * (9 + 3 * shapes + shapes**2)
    kernels.inertia(p, 0, q, 0, C, S, out, 0, 9, 9 + 3 * shapes)
    whole = turn * M * turn.T
    yield "inertia", out, [*whole[:3, :3], *whole[3:, :3], *whole[3:, 3:]]

    out = [sm.S.Zero] * shapes
    frame = kernels.inverse(p, 0, q, v, a, 0, C, S, OMEGA, x, y, EPSILON, out, 0)
    yield "inverse", [*frame, *out], list(turn * own.xreplace({ALONG: C * x + S * y, ACROSS: C * y - S * x}) + inside)

    out = [sm.S.Zero] * 3
    centre = kernels.energy(p, 0, q, v, 0, C, S, v_x, v_y, OMEGA, out)
    u = turn.T * sm.Matrix([v_x, v_y, OMEGA, *v])
    strain, lost = (modal.T * stiffness * modal / 2, rates.T * damping * rates) if shapes else ([0], [0])
    yield "energy", out, [(u.T * M * u)[0] / 2, strain[0], lost[0]]
    yield "centre", list(centre), list(turn[:2, :2] * sm.Matrix([M[1, 2], -M[0, 2]]))


def _of_point(kernels: SimpleNamespace, axial: int, transverse: int):
    p = _numbers((), axial, transverse, POINT, "")
    b, a = ([dynamicsymbols(f"{name}_{k}") for k in range(count)] for name, count in (("b", axial), ("a", transverse)))
    modal = [*b, *a]
    q, v = ([sm.Symbol(f"{name}_{k}") for k in range(len(modal))] for name in ("q", "v"))
    plain = dict(zip(modal, q, strict=True))
    inside = sm.Matrix([sm.sympify(entry) for entry in place(b, a)])

    out = [sm.S.Zero] * 3 * len(modal)
    moved = kernels.displace(p, 0, q, 0, out, 0)
    here = inside.xreplace(plain)
    yield "displace", [*moved, *out], [*here, *(entry.diff(each) for each in q for entry in here)]

    still = {c.diff(TIME, 2): 0 for c in modal}
    rates = {c.diff(TIME): symbol for c, symbol in zip(modal, v, strict=True)}
    grows = inside.diff(TIME, 2).subs(still).subs(rates).xreplace(plain)
    yield "growth", [kernels.growth(p, 0, v, 0), 0, 0], list(grows)


def _plain(expression: sm.Expr) -> sm.Expr:
    """Expanded, with one sine at most in every product."""
    named = sm.sympify(expression).xreplace({sm.cos(PHI): C, sm.sin(PHI): S})
    return named.expand().xreplace({S**2: 1 - C**2}).expand()
