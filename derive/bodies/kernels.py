"""Modules of bodies that deform: their kernels, printed by kinds of shapes for space, and restricted to a plane.

With a and epsilon, acceleration of the origin less gravity and angular acceleration, and the sums of
:mod:`kaneflex.derive.bodies.kinds`, where P, H and J of shape j contain what they grow by with all q_k, its row is

    P_j.a + H_j.epsilon - omega.J_j omega + 2 omega.X_jk v_k + M_jk b_k + K_j q_j + C_jk v_k + cubic strain energy

S and I being what the first moment of mass and the moment of inertia grow by, S = q_j (P_j + P_j0) / 2 and
I = q_j (J_j + J_j0), force and moment beyond those of the rigid body are

    epsilon x S + omega x (omega x S + 2 v_j P_j) + b_j P_j + v_j v_k P_jk
    S x a + I epsilon + omega x (I omega + v_j H_j) + 2 v_j J_j omega + b_j H_j + v_j v_k H_jk

In the x-y plane shapes are of the kinds u, stretch, and v, bending, and a twist is (v_x, v_y, omega_z): the other
components of the motion are zero, and with them all sums that nothing adds to.

Nothing is printed that is not proved to be Kane's equations (:mod:`kaneflex.derive.bodies.proof`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import cache

import sympy as sm

from kaneflex.derive.bodies.kane import ACCEL, EPSILON, MOTION, OMEGA, RATE, XYZ, still
from kaneflex.derive.bodies.kinds import CUBIC, MOMENTS, PLANE, SPACE, Kinds, numbers, section_motion, tables
from kaneflex.derive.bodies.loops import INDENT, Shape, bounds, code, ends, grow, loops, named, zeroed
from kaneflex.derive.bodies.point import point_kernels, point_table
from kaneflex.derive.bodies.proof import prove
from kaneflex.derive.bodies.shortening import increments, kept, of_demand, of_inertia
from kaneflex.derive.ir.names import Names
from kaneflex.derive.printers import module_text
from kaneflex.derive.printers import numba_printer as emit
from kaneflex.derive.printers.bracketed import reads

Values = dict[str, sm.Expr]
Zeros = Mapping[sm.Symbol, sm.Expr]


def _components(letter: str, axes: Iterable[str] = XYZ) -> tuple[str, ...]:
    return tuple(f"{letter}_{each}" for each in axes)


P, H, X, J = (*map(_components, "PHX"), _components("J", MOMENTS))
_SPIN = _components("s", MOMENTS)
"""-omega_x^2, ..., -2 omega_y omega_z, ...: factors of J in a row."""
_SUMS = sm.symbols([name for letter in "SVhfm" for name in _components(letter)]
                   + [name for letter in "ID" for name in _components(letter, MOMENTS)])  # fmt: skip
"""Sums over all shapes that force and moment consist of."""


@cache
def spatial_shapes_text() -> str:
    """Text of ``generated/spatial_shapes.py``.

    Raises
    ------
    NotKane
        If a kernel differs from the derived equations.
    """
    section, raw = _section()
    before, after = emit.operations([(section, raw)])["section"]
    counted = f"Operations of section, written out -> with shared subexpressions: {before} -> {after}."
    about = [*_ABOUT.strip().split("\n"), counted, "", module_text.UNCHECKED]
    printed = [
        *_tables(SPACE),
        module_text.literal("CUBIC", CUBIC, "kinds of the shapes of a cubic strain energy"),
        module_text.literal("MOMENTS", MOMENTS, "components of a symmetric matrix"),
        _OPTIONS.format("IN_ORDER", ""),
    ]
    text = [_proved(SPACE), *emit.print_kernels([section], Names({}))]
    return module_text.module("Bodies in space that deform", about, printed, text)


@cache
def shapes_text() -> str:
    """Text of ``generated/shapes.py``: the same in the plane, with the points of a body. Raises NotKane, too."""
    about = [*_ABOUT_PLANE.strip().split("\n"), "", module_text.UNCHECKED]
    printed = [*_tables(PLANE), point_table(), _OPTIONS.format("WITHIN", ', "forceinline": True')]
    return module_text.module("Bodies in the plane that deform", about, printed, [_proved(PLANE)])


def _proved(kinds: Kinds) -> str:
    text = "\n\n".join([_demand(kinds), _inertia(kinds), _strain(kinds), *point_kernels(kinds)])
    prove(text, kinds)
    return text


def _tables(kinds: Kinds) -> list[str]:
    singles, pairs = tables(kinds)
    return [
        module_text.literal("KINDS", kinds.names, "kinds of shapes in their order in a body"),
        module_text.literal("SINGLE", singles, "numbers of a shape by its kind"),
        module_text.literal("PAIR", pairs, "numbers of a pair of shapes by their kinds"),
    ]


def _matrix(letter: str) -> sm.Matrix:
    """Symmetric matrix of the symbols of its MOMENTS."""
    found = sm.zeros(3, 3)
    for axes in MOMENTS:
        j, k = map(XYZ.index, axes)
        found[j, k] = found[k, j] = sm.Symbol(f"{letter}_{axes}")
    return found


def _vector(letter: str) -> sm.Matrix:
    return sm.Matrix(sm.symbols(_components(letter)))


def _grown(shape: Shape) -> tuple[list[str], Values]:
    """Statements for P, H and J of the j-th shape, and these."""
    return named({name: shape.grown(name) for name in (*P, *H, *J)})


def _first_and_second(shape: Shape, of: Values) -> Values:
    """Increments of S and I by the j-th shape."""
    q, total = sm.Symbol("q_j"), {}
    for name in (*P, *J):
        both = shape.single(name) + of.get(name, sm.S.Zero)
        total[name.replace("P", "S").replace("J", "I")] = q * both * (sm.Rational(1, 2) if name in P else 1)
    return total


def _summed(
    kinds: Kinds, of_shape: Callable[[Shape], tuple[list[str], Values]], of_pair=lambda a, b: []
) -> tuple[list[str], Zeros]:
    """Loops over the shapes with their increments of sums, behind the zeros of these; what is zero in these kernels:
    the motion's components that the kinds don't have, and all other sums."""
    sums: dict[str, None] = {}

    def statements(shape: Shape) -> list[str]:
        lines, total = of_shape(shape)
        sums.update(dict.fromkeys(name for name, value in total.items() if value != 0))
        return [*lines, *grow(total)]

    body = loops(statements, of_pair, kinds)
    never = {symbol: sm.S.Zero for symbol in _SUMS if symbol.name not in sums}
    return [*zeroed(sums), *body], still(kinds.twist) | never


def _demand(kinds: Kinds) -> str:
    whole, adds = _wrench(kinds, still(kinds.twist))
    needed = {symbol.name for value in (*adds, *whole.values()) for symbol in value.free_symbols}

    def of_shape(shape: Shape) -> tuple[list[str], Values]:
        lines, total = _demanded(shape, "h[i + j]")
        total = {name: value for name, value in total.items() if name in needed}
        return [*lines, *kept(shape)], total | increments(shape, rates=True)

    body, zero = _summed(kinds, of_shape)
    whole, adds = _wrench(kinds, zero)
    lines = [*body, *_beyond(kinds, of_demand), *_cubic(kinds, "h[i + {}]")]
    lines += [*(f"{name} = {code(value)}" for name, value in whole.items()), *_added(adds)]
    head = "shaped_demand(p, o, count, w, k, q, v, b, i, out, n, h"
    return _kernel(kinds, head, _DEMAND, [*_reads(MOTION, zero), *_spin(zero), *ends(kinds), *lines])


def _demanded(shape: Shape, row: str) -> tuple[list[str], Values]:
    """Statements that add what a motion takes of the j-th shape to its row, and increments of the sums of them all."""
    q, v, b = sm.symbols("q_j v_j b_j")
    lines, of = _grown(shape)
    more, rates = named({f"{name}_rate": shape.total(name, "v") for name in (*P, *H)})
    own = shape.single("K") * q + shape.total("M", "b") + shape.total("C", "v")
    own += sum(of.get(name, 0) * x for name, x in zip((*P, *H), RATE, strict=True))
    own += sum(of.get(name, 0) * x for name, x in zip(J, sm.symbols(_SPIN), strict=True))
    own += 2 * sum(shape.total(name, "v") * x for name, x in zip(X, OMEGA, strict=True))
    total = _first_and_second(shape, of)
    for letter, names in (("V", P), ("h", H), ("D", J)):
        total |= {f"{letter}{name[1:]}": v * of.get(name, 0) for name in names}
    for name in (*P, *H):
        force = name.replace("P", "f").replace("H", "m")
        total[force] = b * of.get(name, 0) + v * rates.get(f"{name}_rate", 0)
    return [*lines, *more, *grow({row: own})], total


def _spin(zero: Zeros) -> list[str]:
    """Statements for the factors of J in a row."""
    omega = sm.Matrix(OMEGA).xreplace(zero)
    square = sm.expand((omega.T * _matrix("J") * omega)[0])
    factors = zip(_SPIN, map(square.coeff, sm.symbols(J)), strict=True)
    return [f"{name} = {code(-factor)}" for name, factor in factors if factor != 0]


def _wrench(kinds: Kinds, zero: Zeros) -> tuple[Values, sm.Matrix]:
    """Force and moment by the sums over all shapes; before them the vectors u and l in brackets, by their names."""
    omega, a, epsilon = (sm.Matrix(each).xreplace(zero) for each in (OMEGA, ACCEL, EPSILON))
    S, inertia = _vector("S"), _matrix("I")
    inner = {"u": omega.cross(S) + 2 * _vector("V"), "l": inertia * omega + _vector("h")}
    whole = {f"{letter}_{axis}": value for letter, of in inner.items()
             for axis, value in zip(XYZ, of.xreplace(zero), strict=True)}  # fmt: skip
    force = epsilon.cross(S) + omega.cross(_vector("u")) + _vector("f")
    moment = S.cross(a) + inertia * epsilon + omega.cross(_vector("l")) + 2 * _matrix("D") * omega + _vector("m")
    found = force.col_join(moment).xreplace(zero)[list(kinds.twist), :]
    return {name: value for name, value in whole.items() if found.has(sm.Symbol(name))}, found


def _inertia(kinds: Kinds) -> str:
    """Mass matrix beyond that of the rigid body, d (force, moment, rows) / d (a, epsilon, b)."""
    momenta, size = [(*P, *H)[k] for k in kinds.twist], len(kinds.twist)

    def of_shape(shape: Shape) -> tuple[list[str], Values]:
        lines, of = _grown(shape)
        stores = [f"out[{emit.offset(f'coupling + {size} * j', k)}] = {code(of.get(name, sm.S.Zero))}"
                  for k, name in enumerate(momenta)]  # fmt: skip
        total = _first_and_second(shape, of) | increments(shape, rates=False)
        return [*lines, *stores, *kept(shape)], total

    def of_pair(a: str, b: str) -> list[str]:
        mass = numbers(a, b, kinds).of.get("M", sm.S.Zero)
        mass = mass.xreplace({symbol: sm.Symbol(f"{symbol}_l") for symbol in mass.free_symbols})
        return [f"out[modal + count * j + l] = {code(mass)}"] if mass != 0 else []

    body, zero = _summed(kinds, of_shape, of_pair)
    S = _vector("S")
    arm = sm.Matrix([[0, -S[2], S[1]], [S[2], 0, -S[0]], [-S[1], S[0], 0]])
    whole = sm.BlockMatrix([[sm.zeros(3, 3), -arm], [arm, _matrix("I")]]).as_explicit().xreplace(zero)
    return _kernel(kinds, "shaped_inertia(p, o, count, q, i, out, n", _INERTIA, [
        f"coupling, modal = n + {size**2}, n + {size**2} + {size} * count", *ends(kinds),
        "for j in range(count * count):", f"{INDENT}out[modal + j] = 0.0",
        *body, *_beyond(kinds, of_inertia), *_added(whole.extract(list(kinds.twist), list(kinds.twist))),
    ])  # fmt: skip


def _strain(kinds: Kinds) -> str:
    body, _ = _summed(kinds, lambda shape: ([], {"strain": shape.single("K") * sm.Symbol("q_j") ** 2 / 2}))
    lines = [*ends(kinds), *body, *_cubic(kinds, ""), "return strain"]
    return _kernel(kinds, "shaped_strain(p, o, count, q, i", _STRAIN, lines)


def _kernel(kinds: Kinds, head: str, doc: str, lines: Iterable[str]) -> str:
    """Text of a kernel; in space shaped_demand and shaped_inertia have room for what their second loops need."""
    if not kinds.in_space:
        return module_text.function(f"{head})", doc, lines, "**WITHIN")
    if "strain" not in head:
        head, doc = f"{head}, room, z", f"{doc}\n\nRoom at room[z]: two numbers for each shape."
    return module_text.function(f"{head})", doc, lines, "**IN_ORDER")


def _beyond(kinds: Kinds, statements: Callable[[], list[str]]) -> list[str]:
    """Statements of :mod:`kaneflex.derive.bodies.shortening`, for bodies in space."""
    return statements() if kinds.in_space else []


def _added(values: Iterable[sm.Expr]) -> list[str]:
    """Statements that add to out from out[n] on."""
    return grow({f"out[{emit.offset('n', k)}]": value for k, value in enumerate(values)})


def _cubic(kinds: Kinds, row: str) -> list[str]:
    """Statements of the strain energy of third order: of any shapes the products that exist, of beams all of CUBIC."""

    def product(j: str, k: str, l: str) -> list[str]:
        q = [f"q[i + {index}]" for index in (j, k, l)]
        if not row:
            return [f"strain += c * {' * '.join(q)}"]
        return [f"{row.format(one)} += c * {first} * {second}" for one, first, second in
                ((j, q[1], q[2]), (k, q[0], q[2]), (l, q[0], q[1]))]  # fmt: skip

    lines: list[str] = []
    for depth, (index, kind) in enumerate(zip("jkl", CUBIC, strict=True)) if kinds.in_space else ():
        lines.append(f"{INDENT * depth}for {index} in range({bounds(kind)}):")
    if not lines:
        return []
    lines += [INDENT * 3 + line for line in ["c = p[o]", *product("j", "k", "l"), "o += 1"]]
    lines.append("for e in range(int(p[o])):")
    lines.append(f"{INDENT}j, k, l, c = int(p[o + 1]), int(p[o + 2]), int(p[o + 3]), p[o + 4]")
    return lines + [INDENT + line for line in [*product("j", "k", "l"), "o += 4"]]


def _reads(symbols: Iterable[sm.Symbol], zero: Zeros) -> list[str]:
    """Statements that read those symbols from w[k] on that are not zero."""
    places = emit.places((symbol for symbol in symbols if symbol not in zero), "w", "k")
    return list(reads((str(symbol), place) for symbol, place in places))


def _section() -> emit.Printed:
    """Kernel of a section's rotation and its rates."""
    theta, rate = (sm.symbols(f"{name}_x {name}_y {name}_z") for name in ("theta", "rate"))
    parts = section_motion(theta, rate)
    values = [value for part in parts for value in part]
    places = emit.places((*theta, *rate), "w", "k")
    doc = (
        "Store R, T row by row and T' theta' of a section turned by theta_y and theta_z, then by theta_x about itself."
        "\n\nw[k]: theta, theta'. R: the section's axes in the body's; T theta': its angular velocity there."
    )
    return emit.kernel("section", ("w", "k", "out", "n"), places, values, doc, out="n")


_OPTIONS = '{} = OPTIONS | {{"fastmath": OPTIONS["fastmath"] - {{"reassoc"}}{}}}  # reordered sums are slower here'
_ABOUT = """
A particle at r of the body is at p = r + N_j q_j + G_jk q_j q_k / 2 in its axes. Sums over the mass, of a shape: P of N
and H of r x N, momentum per rate; J of (r.N) 1 - sym(r N^T), half of what the moment of inertia grows by; stiffness K.
Of a pair: P, H and J, by which those of shape j grow with q_k; X of N_k x N_j; M of N_j.N_k; damping C. Of a pinned
beam, xi being the distance from its pin: Q of xi times the displacement, and scale xi, the best fit of G_x. Shapes of a
straight beam are of the kinds u, v, w (displaced along x, y, z) and t (twist), others of kind g.

Numbers of a body from p[o]: how many shapes of each kind but g it has; of every shape in turn SINGLE, then of all pairs
with it PAIR. Behind them a cubic strain energy: of shapes v, w, t the factors of all q_j q_k q_l; then how many other
products there are, and of each its three shapes and its factor. A sum like P_x_vq is that of P_x q over shapes of kind
v. A section turns by angles that are linear in q. Equations are Kane's, by SymPy's KanesMethod, less those of the rigid
body (kaneflex.generated.spatial).
"""
_ABOUT_PLANE = """
Restriction of kaneflex.generated.spatial_shapes to the x-y plane and shapes of the kinds u and v: their sums go by the
same names, and a sum like P_x_vq is that of P_x q over shapes of kind v. A twist is v_x, v_y, omega_z.

Numbers of a body from p[o]: how many shapes of kind u it has; of every shape in turn SINGLE, then of all pairs with it
PAIR. Numbers of a point of a body in the same way: POINT has displacements x, y and rotation of its section by a unit
of a shape, and by pairs the x that they shorten the body by. Equations are Kane's, by SymPy's KanesMethod, less those
of the rigid body (kaneflex.generated.joints).
"""
_DEMAND = """\
Add the force and the moment that a body's shapes ask for beyond those of the rigid body, and every shape's own.

w[k]: omega, acceleration of the origin less gravity, epsilon, in the body's axes. Coordinates of the shapes begin
at q[i], their rates at v[i], accelerations at b[i], their rows at h[i]."""
_INERTIA = """\
Add what shapes change of a body's mass matrix at out[n], which is symmetric; store behind it what couples them to
it, a momentum per rate of each shape, and their own, (count, count), all row by row."""
_STRAIN = "Return the strain energy of a body's shapes [J]."
