"""Kinds of shapes, and the sums over a body's mass that the motion of each kind requires.

A particle at r of a body that deforms is at p = r + N_j q_j + G_jk q_j q_k / 2 in the body's axes. The equations of
motion (:mod:`kaneflex.derive.bodies.kernels`) need, summed over the mass,

    of a shape:  P = N_j and H = r x N_j, momentum per rate; J = (r.N_j) 1 - sym(r N_j^T), half of the derivative of the
                 moment of inertia by q_j; K, its stiffness
    of a pair:   P = G_jk, H = r x G_jk + N_k x N_j and J = (N_j.N_k + r.G_jk) 1 - sym(N_j N_k^T + r G_jk^T), by which
                 those of shape j grow with q_k; X = N_k x N_j (Coriolis); M = N_j.N_k; C, damping

The axes of a pinned beam follow its mean rotation about the pin, its section there about the others. Bending can undo a
rotation about these but for a short piece, which hardly has any mass. To the second order alone the mass matrix is then
not positive definite from a bending of 1 % of the length on. So the products of bending with the shortening are kept
that contain this rotation, of a shape Q, the sum of its displacement times the distance xi from the pin, and of a pair
scale_jk, the best fit of G_x by scale_jk xi (:mod:`kaneflex.derive.bodies.shortening`). Of other bodies both are zero.

Shapes of a straight beam whose sections have principal axes y and z through their centres are of four kinds: stretch
u, bending v in the x-y plane and w in the x-z plane, twist t. The sums that vanish for a kind follow from its fields.
Any other shape is of kind g.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product

import sympy as sm

from kaneflex.derive.bodies.kane import IN_PLANE, IN_SPACE, XYZ

KINDS = ("u", "v", "w", "t", "g")
"""Kinds of shapes in their order in a body; g: any."""
CUBIC = ("v", "w", "t")
"""One shape of each of these: in a beam's strain energy of third order stand theta_x' theta_y theta_z' and its like."""
SHORTENING = ("v", "w", "t")
"""Kinds of shapes that shorten a beam."""
_TERMS = 9
"""Terms of power series of a section's rotation."""
MOMENTS = ("xx", "yy", "zz", "yz", "zx", "xy")
"""Components of a symmetric matrix."""
R = x, y, z = sm.symbols("x y z")
_SECTION = {(0, 0): sm.S.One, (2, 0): sm.Symbol("I_z"), (0, 2): sm.Symbol("I_y")}
"""Mean of y^m z^n over the section, by the powers; others vanish."""
Values = dict[str, sm.Expr]


@dataclass(frozen=True)
class Numbers:
    """Numbers of a shape or of a pair that are stored, and the others as linear combinations of these.

    ``stored`` in reading order; ``of``: name -> combination in symbols of the stored names, zero where it vanishes.
    """

    stored: tuple[str, ...]
    of: Mapping[str, sm.Expr]


def section_motion(theta: Sequence[sm.Expr], rate: Sequence[sm.Expr]) -> tuple[sm.Matrix, sm.Matrix, sm.Matrix]:
    """R, T and T' theta' of a section that bends the shortest way by theta_y and theta_z, then turns by theta_x.

    Bending has the rotation vector b = (0, theta_y, theta_z): R = 1 + s b~ + c b~ b~ by Rodrigues' formula, and the
    angular velocity (1 + c b~ + d b~ b~) b' (left Jacobian; Sola, Deray & Atchuthan 2018, arXiv:1812.01537)
    with c = (1 - cos |b|) / |b|^2, d = (|b| - sin |b|) / |b|^3 and s = 1 - d |b|^2. R has the section's axes in the
    body's, its angular velocity against it is T theta', there, too.
    """
    x, y, z = theta
    c, d, square = sm.symbols("c d square")
    bending = sm.Matrix([[0, -z, y], [z, 0, 0], [-y, 0, 0]])
    R, by_bending = (
        sm.eye(3) + one * bending + two * bending * bending for one, two in ((1 - d * (y**2 + z**2), c), (c, d))
    )
    twist = sm.Matrix([[1, 0, 0], [0, sm.cos(x), -sm.sin(x)], [0, sm.sin(x), sm.cos(x)]])
    T = sm.Matrix.hstack(R[:, 0], by_bending[:, 1:])
    velocity, growth = T * sm.Matrix(rate), 2 * (y * rate[1] + z * rate[2])
    series = {part: _rest_of_series(n, square) for n, part in ((2, c), (3, d))}
    rates = {y: rate[1], z: rate[2], **{part: sm.horner(of.diff(square)) * growth for part, of in series.items()}}
    gamma = sum((velocity.diff(part) * speed for part, speed in rates.items()), sm.zeros(3, 1))
    known = {part: sm.horner(of) for part, of in series.items()}
    return tuple(each.xreplace(known).xreplace({square: y**2 + z**2}) for each in (R * twist, T, gamma))


def _rest_of_series(n: int, square: sm.Symbol) -> sm.Expr:
    """1/n! - x^2/(n + 2)! + ... by x^2, to rounding up to 2 rad."""
    return sum(((-square) ** k / sm.factorial(2 * k + n) for k in range(_TERMS)), sm.S.Zero)


@cache
def _curvature_of_fibres() -> tuple[tuple[sm.Matrix, ...], ...]:
    """Second derivatives by two angles, at zero, of the place of a fibre (0, y, z) of a section that turns."""
    theta = sm.symbols("theta_x theta_y theta_z")
    still = dict.fromkeys(theta, 0)
    place = section_motion(theta, theta)[0] * sm.Matrix([0, y, z])
    return tuple(tuple(place.diff(a).diff(b).xreplace(still) for b in theta) for a in theta)


def _field(kind: str, j: int) -> tuple[sm.Matrix, sm.Matrix]:
    """Displacement of the axis and rotation of the section by the j-th shape of a kind."""
    moved, turned = sm.zeros(3, 1), sm.zeros(3, 1)
    if kind == "t":
        turned[0] = sm.Symbol(f"theta_x{j}")
    else:
        moved["uvw".index(kind)] = sm.Symbol(f"{kind}{j}")
        if kind != "u":
            turned[{"v": 2, "w": 1}[kind]] = sm.Symbol(f"theta_{'z' if kind == 'v' else 'y'}{j}")
    return moved, turned


def first_order(kind: str, j: int) -> sm.Matrix:
    """N of the j-th shape, in symbols of its fields."""
    if kind == "g":
        return sm.Matrix([sm.Symbol(f"N_{axis}{j}") for axis in XYZ])
    moved, turned = _field(kind, j)
    return moved + turned.cross(sm.Matrix([0, y, z]))


def second_order(a: str, j: int, b: str, k: int) -> sm.Matrix:
    """G of the j-th and the k-th shape: of a link its shortening, and what its sections move their fibres by."""
    if "g" in (a, b):
        return sm.Matrix([sm.Symbol(f"G_{axis}{min(j, k)}{max(j, k)}") for axis in XYZ])
    turned, of = _curvature_of_fibres(), (_field(a, j)[1], _field(b, k)[1])
    found = sum((turned[m][n] * of[0][m] * of[1][n] for m in range(3) for n in range(3)), sm.zeros(3, 1))
    if a == b != "u":
        found[0] -= sm.Symbol(f"slope_{a}{j}") * sm.Symbol(f"slope_{a}{k}")
    return found.expand()


def summed(kinds: Iterable[str], expression: sm.Expr) -> sm.Expr:
    """Sum over the mass of a polynomial in y, z and the fields of shapes of these kinds.

    The integral over x is linear: each product of fields that is left stands for its integral.
    """
    if "g" in kinds:
        return expression.expand()
    terms = sm.Poly(expression, y, z).terms()
    return sum((_SECTION.get(powers, sm.S.Zero) * coefficient for powers, coefficient in terms), sm.S.Zero).expand()


def moment(kinds: Sequence[str], name: str, j: int, k: int) -> sm.Expr:
    """Sum over the mass of N_x, x_N_y, N_x_N_y, G_x or x_G_y of shapes of these kinds, in products of their fields."""
    *before, letter, axis = name.split("_")
    G = second_order(kinds[j], j, kinds[k], k) if letter == "G" else first_order(kinds[k], k)
    whole = G[XYZ.index(axis)]
    if len(before) == 2:
        whole *= first_order(kinds[j], j)[XYZ.index(before[1])]
    elif before:
        whole *= R[XYZ.index(before[0])]
    return summed(kinds, whole.expand())


def _symmetric(Q: sm.Matrix) -> sm.Matrix:
    """tr(Q) 1 - sym(Q)."""
    return Q.trace() * sm.eye(3) - (Q + Q.T) / 2


def _named(letter: str, of: sm.Matrix) -> Values:
    """Components of a vector or a symmetric matrix by their names."""
    if of.shape == (3, 1):
        return {f"{letter}_{axis}": of[k] for k, axis in enumerate(XYZ)}
    return {f"{letter}_{axes}": of[XYZ.index(axes[0]), XYZ.index(axes[1])] for axes in MOMENTS}


def of_shape(kind: str, j: int = 0) -> Values:
    """Sums of the j-th shape, in products of its fields."""
    r, N = sm.Matrix(R), first_order(kind, j)
    values = _named("P", N) | _named("H", r.cross(N)) | _named("J", _symmetric(r * N.T))
    if kind in "vw":
        values["Q"] = sm.Symbol("xi") * N["uvw".index(kind)]
    return {name: summed(kind, value) for name, value in values.items()} | {"K": sm.Symbol(f"K_{j}")}


def of_pair(a: str, b: str, j: int = 0, k: int = 1) -> Values:
    """Sums of the j-th shape of one kind with the k-th of another."""
    if "g" in (a, b) and a != b:
        return {}
    r, N_j, N_k, G = sm.Matrix(R), first_order(a, j), first_order(b, k), second_order(a, j, b, k)
    X = N_k.cross(N_j)
    values = _named("P", G) | _named("H", r.cross(G) + X) | _named("X", X)
    values |= _named("J", _symmetric(N_j * N_k.T + r * G.T)) | {"M": N_j.dot(N_k)}
    given = [*(["scale"] if a in SHORTENING else []), "C"] if a == b else []
    of_pair = {name: sm.Symbol(f"{name}_{min(j, k)}{max(j, k)}") for name in given}
    return {name: summed((a, b), value) for name, value in values.items()} | of_pair


@dataclass(frozen=True)
class Kinds:
    """Kinds of shapes that a text is printed for, and the sums that it needs of them.

    ``names`` in their order in a body; ``twist``: components of a twist that the body's motion has.
    """

    names: tuple[str, ...]
    of_shape: Callable[..., Values]
    of_pair: Callable[..., Values]
    twist: tuple[int, ...] = IN_PLANE

    @property
    def in_space(self) -> bool:
        return self.twist == IN_SPACE


SPACE = Kinds(KINDS, of_shape, of_pair, IN_SPACE)
_PLANE = ("P_x", "P_y", "H_z", "J_zz", "X_z", "M", "K")
"""Sums that motion in the x-y plane needs."""


def _in_plane(values: Values) -> Values:
    return {name: values[name] for name in _PLANE if name in values}


def _pair_in_plane(a: str, b: str, j: int = 0, k: int = 1) -> Values:
    return _in_plane(of_pair(a, b, j, k)) | {"C": sm.Symbol(f"C_{min(j, k)}{max(j, k)}")}


def _at_point(kind: str, j: int = 0) -> Values:
    """Displacement of a point of the axis, and rotation of its section."""
    moved, turned = _field(kind, j)
    return {"x": moved[0], "y": moved[1], "turn": turned[2]}


def _pair_at_point(a: str, b: str, j: int = 0, k: int = 1) -> Values:
    return {"x": second_order(a, j, b, k)[0].xreplace({y: 0, z: 0})}


PLANE = Kinds(("u", "v"), lambda kind, j=0: _in_plane(of_shape(kind, j)), _pair_in_plane)
POINT = Kinds(("u", "v"), _at_point, _pair_at_point)
"""A point of the axis in the plane."""


@cache
def numbers(a: str, b: str = "", kinds: Kinds = SPACE) -> Numbers:
    """Numbers of a shape of kind ``a``, or of a pair with one of kind ``b``."""
    values, stored, of = kinds.of_pair(a, b) if b else kinds.of_shape(a), dict[str, sm.Expr](), Values()
    for name, value in values.items():
        found = _combination(value, stored)
        if found is None:
            stored[name], found = value, sm.Symbol(name)
        of[name] = found
    return Numbers(tuple(stored), of)


def _combination(value: sm.Expr, stored: Values) -> sm.Expr | None:
    """A sum as a linear combination of others, by their names; None if it is independent."""
    if value == 0:
        return sm.S.Zero
    terms = [each.as_coefficients_dict() for each in (*stored.values(), value)]
    products = sorted(set().union(*terms), key=str)
    system = sm.Matrix([[of[product] for of in terms] for product in products])
    try:
        solution, free = system[:, :-1].gauss_jordan_solve(system[:, -1])
    except ValueError:
        return None
    names = [sm.Symbol(name) for name in stored]
    return sum((c * name for c, name in zip(solution.xreplace(dict.fromkeys(free, 0)), names, strict=True)), sm.S.Zero)


def tables(kinds: Kinds) -> tuple[dict[str, tuple[str, ...]], dict[str, tuple[str, ...]]]:
    """Stored names of the shapes by kind, and of the pairs by both kinds, like "uv"."""
    pairs = {a + b: numbers(a, b, kinds).stored for a, b in product(kinds.names, repeat=2)}
    singles = {kind: numbers(kind, kinds=kinds).stored for kind in kinds.names}
    return singles, {both: names for both, names in pairs.items() if names}


def reading_order(shapes: Sequence[str], kinds: Kinds = SPACE) -> Iterator[sm.Expr]:
    """Numbers of a body with shapes of these kinds, in products of their fields."""
    for j, a in enumerate(shapes):
        own = kinds.of_shape(a, j)
        yield from (own[name] for name in numbers(a, kinds=kinds).stored)
        for k, b in enumerate(shapes):
            both = kinds.of_pair(a, b, j, k)
            yield from (both[name] for name in numbers(a, b, kinds).stored)
