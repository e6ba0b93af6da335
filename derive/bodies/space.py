"""Module of bodies in space that deform: their kernels, printed by kinds of shapes.

With a and epsilon, acceleration of the origin less gravity and angular acceleration, and the sums of
:mod:`kaneflex.derive.bodies.kinds`, where P, H and J of shape j contain what they grow by with all q_k, its row is

    P_j.a + H_j.epsilon - omega.J_j omega + 2 omega.X_jk v_k + M_jk b_k + K_j q_j + C_jk v_k + cubic strain energy

S and I being what the first moment of mass and the moment of inertia grow by, S = q_j (P_j + P_j0) / 2 and
I = q_j (J_j + J_j0), force and moment beyond those of the rigid body are

    epsilon x S + omega x (omega x S + 2 v_j P_j) + b_j P_j + v_j v_k P_jk
    S x a + I epsilon + omega x (I omega + v_j H_j) + 2 v_j J_j omega + b_j H_j + v_j v_k H_jk

Nothing is printed that is not proved to be Kane's equations (:mod:`kaneflex.derive.bodies.proof`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import cache

import sympy as sm

from kaneflex.derive.bodies.kane import ACCEL, EPSILON, MOTION, OMEGA
from kaneflex.derive.bodies.kinds import CUBIC, KINDS, MOMENTS, SPACE, XYZ, numbers, section_motion, tables
from kaneflex.derive.bodies.loops import INDENT, Shape, batched, bounds, code, grow, loops, named, zeroed
from kaneflex.derive.bodies.proof import VELOCITY, prove
from kaneflex.derive.bodies.shortening import increments, kept, of_demand, of_energy, of_inertia
from kaneflex.derive.ir.names import Names
from kaneflex.derive.printers import module_text
from kaneflex.derive.printers import numba_printer as emit


def _components(letter: str, axes: Iterable[str] = XYZ) -> tuple[str, ...]:
    return tuple(f"{letter}_{each}" for each in axes)


P, H, X, J = (*map(_components, "PHX"), _components("J", MOMENTS))
_SPIN = _components("s", MOMENTS)
"""-omega_x^2, ..., -2 omega_y omega_z, ...: factors of J in a row."""


@cache
def spatial_shapes_text() -> str:
    """Text of ``generated/spatial_shapes.py``.

    Raises
    ------
    NotKane
        If a kernel differs from the derived equations.
    """
    kernels = kernels_text()
    prove(kernels, SPACE)
    section, raw = _section()
    before, after = emit.operations([(section, raw)])["section"]
    counted = f"Operations of section, written out -> with shared subexpressions: {before} -> {after}."
    about = [*_ABOUT.strip().split("\n"), counted, "", module_text.UNCHECKED]
    singles, pairs = tables()
    printed = [
        module_text.literal("KINDS", KINDS, "kinds of shapes in their order in a body"),
        module_text.literal("CUBIC", CUBIC, "kinds of the shapes of a cubic strain energy"),
        module_text.literal("MOMENTS", MOMENTS, "components of a symmetric matrix"),
        module_text.literal("SINGLE", singles, "numbers of a shape by its kind"),
        module_text.literal("PAIR", pairs, "numbers of a pair of shapes by their kinds"),
        'IN_ORDER = OPTIONS | {"fastmath": OPTIONS["fastmath"] - {"reassoc"}}  # reordered sums are slower here',
    ]
    text = [kernels, *emit.print_kernels([section], Names({}))]
    return module_text.module("Bodies in space that deform", about, printed, text)


def kernels_text() -> str:
    """Text of the kernels that loop over shapes, which has not been proved."""
    return "\n\n".join([_demand(), _inertia(), _energy()])


def _matrix(letter: str) -> sm.Matrix:
    """Symmetric matrix of the symbols of its MOMENTS."""
    found = sm.zeros(3, 3)
    for axes in MOMENTS:
        j, k = map(XYZ.index, axes)
        found[j, k] = found[k, j] = sm.Symbol(f"{letter}_{axes}")
    return found


def _vector(letter: str) -> sm.Matrix:
    return sm.Matrix(sm.symbols(_components(letter)))


def grown(shape: Shape) -> tuple[list[str], dict[str, sm.Expr]]:
    """Statements for P, H and J of the j-th shape, and these."""
    return named({name: shape.grown(name) for name in (*P, *H, *J)})


def first_and_second(shape: Shape, of: Mapping[str, sm.Expr]) -> dict[str, sm.Expr]:
    """Increments of S and I by the j-th shape."""
    q, total = sm.Symbol("q_j"), {}
    for name in (*P, *J):
        both = shape.single(name) + of.get(name, sm.S.Zero)
        total[name.replace("P", "S").replace("J", "I")] = q * both * (sm.Rational(1, 2) if name in P else 1)
    return total


def demanded(shape: Shape, row: str) -> tuple[list[str], dict[str, sm.Expr]]:
    """Statements that add what a motion takes of the j-th shape to its row, and increments of the sums of them all."""
    q, v, b = sm.symbols("q_j v_j b_j")
    lines, of = grown(shape)
    more, rates = named({f"{name}_rate": shape.total(name, "v") for name in (*P, *H)})
    own = shape.single("K") * q + shape.total("M", "b") + shape.total("C", "v")
    own += sum(of.get(name, 0) * x for name, x in zip((*P, *H), (*ACCEL, *EPSILON), strict=True))
    own += sum(of.get(name, 0) * x for name, x in zip(J, sm.symbols(_SPIN), strict=True))
    own += 2 * sum(shape.total(name, "v") * x for name, x in zip(X, OMEGA, strict=True))
    total = first_and_second(shape, of)
    for letter, names in (("V", P), ("h", H), ("D", J)):
        total |= {f"{letter}{name[1:]}": v * of.get(name, 0) for name in names}
    for name in (*P, *H):
        force = name.replace("P", "f").replace("H", "m")
        total[force] = b * of.get(name, 0) + v * rates.get(f"{name}_rate", 0)
    return [*lines, *more, *grow({row: own})], total


def spin() -> list[str]:
    """Statements for the factors of J in a row."""
    square = sm.expand((sm.Matrix(OMEGA).T * _matrix("J") * sm.Matrix(OMEGA))[0])
    return [f"{name} = {code(-square.coeff(of))}" for name, of in zip(_SPIN, sm.symbols(J), strict=True)]


def _demand() -> str:
    sums: dict[str, None] = {}

    def of_shape(shape: Shape) -> list[str]:
        lines, total = demanded(shape, "h[r + j]")
        total |= increments(shape, rates=True, accelerations=True)
        sums.update(dict.fromkeys(name for name, value in total.items() if value != 0))
        return [*lines, *kept(shape), *grow(total)]

    body, whole = loops(of_shape) + of_demand(), list[str]()

    def assigned(letter: str, values: sm.Matrix) -> sm.Matrix:
        whole.extend(f"{name} = {code(value)}" for name, value in zip(_components(letter), values, strict=True))
        return _vector(letter)

    adds = grow({f"out[{emit.offset('n', k)}]": value for k, value in enumerate(wrench(assigned))})
    lines = [*_reads("k", MOTION), *spin(), *_ENDS, *zeroed(sums), *body, *_cubic("h[r + {}]"), *whole, *adds]
    return _kernel("shaped_demand(p, o, count, w, k, q, i, u, s, du, out, n, h, r, room, z)", _DEMAND, lines)


def wrench(assigned: Callable[[str, sm.Matrix], sm.Matrix] = lambda letter, values: values) -> sm.Matrix:
    """Force and moment by the sums over all shapes; ``assigned`` may give vectors a name."""
    omega, a, epsilon = map(sm.Matrix, (OMEGA, ACCEL, EPSILON))
    S, inertia = _vector("S"), _matrix("I")
    u, l = assigned("u", omega.cross(S) + 2 * _vector("V")), assigned("l", inertia * omega + _vector("h"))
    force = epsilon.cross(S) + omega.cross(u) + _vector("f")
    moment = S.cross(a) + inertia * epsilon + omega.cross(l) + 2 * _matrix("D") * omega + _vector("m")
    return force.col_join(moment)


def _inertia() -> str:
    """Mass matrix beyond that of the rigid body, d (force, moment, rows) / d (a, epsilon, b)."""

    def of_shape(shape: Shape) -> list[str]:
        lines, of = grown(shape)
        stores = [f"out[coupling{f' + {k} * count' if k else ''} + j] = {code(of.get(name, sm.S.Zero))}"
                  for k, name in enumerate((*P, *H))]  # fmt: skip
        total = first_and_second(shape, of) | increments(shape, rates=False, accelerations=False)
        return [*lines, *stores, *kept(shape), *grow(total)]

    def of_pair(a: str, b: str) -> list[str]:
        mass = numbers(a, b).of.get("M", sm.S.Zero)
        mass = mass.xreplace({symbol: sm.Symbol(f"{symbol}_l") for symbol in mass.free_symbols})
        return [f"out[modal + count * j + l] = {code(mass)}"] if mass != 0 else []

    S = _vector("S")
    arm = sm.Matrix([[0, -S[2], S[1]], [S[2], 0, -S[0]], [-S[1], S[0], 0]])
    whole = sm.BlockMatrix([[sm.zeros(3, 3), -arm], [arm, _matrix("I")]]).as_explicit()
    adds = grow({f"out[{emit.offset('n', k)}]": value for k, value in enumerate(whole)})
    return _kernel("shaped_inertia(p, o, count, q, i, out, n, room, z)", _INERTIA, [
        "coupling, modal = n + 36, n + 36 + 6 * count", *_ENDS,
        "for j in range(count * count):", f"{INDENT}out[modal + j] = 0.0",
        *zeroed([*_components("S"), *_components("I", MOMENTS), "T_y", "T_z", "scale"]),
        *loops(of_shape, of_pair), *of_inertia(), *adds,
    ])  # fmt: skip


def energies(shape: Shape) -> tuple[list[str], dict[str, sm.Expr]]:
    """Statements for the j-th shape, and increments of energies and moments."""
    q, v = sm.symbols("q_j v_j")
    lines, of = grown(shape)
    speed = sum(of.get(name, 0) * x for name, x in zip((*P, *H), (*VELOCITY, *OMEGA), strict=True))
    return lines, {
        "kinetic": v * (speed + shape.total("M", "v") / 2), "strain": shape.single("K") * q**2 / 2,
    } | first_and_second(shape, of)  # fmt: skip


def rigid_energy() -> sm.Expr:
    """Kinetic energy by S and I, the body's shapes not in motion."""
    velocity, omega = sm.Matrix(VELOCITY), sm.Matrix(OMEGA)
    return ((omega.T * _matrix("I") * omega)[0] / 2 + velocity.dot(omega.cross(_vector("S")))).expand()


def _energy() -> str:
    def of_shape(shape: Shape) -> list[str]:
        lines, total = energies(shape)
        return [*lines, *grow(total | increments(shape, rates=True, accelerations=False))]

    whole = [f"kinetic += {code(rigid_energy())}"]
    stores = {"kinetic": 0, "strain": 1, "S_x": 2, "S_y": 3, "S_z": 4}
    whole += [f"out[{emit.offset('n', k)}] += {name}" for name, k in stores.items()]
    zeros = ["kinetic", "strain", *_components("S"), *_components("I", MOMENTS), "scale", "scale_1"]
    zeros += ["T_y", "T_z", "W_y", "W_z"]
    body = [*loops(of_shape), *of_energy(), *_cubic(""), *whole]
    return _kernel("shaped_energy(p, o, count, w, k, q, i, u, s, out, n)", _ENERGY, [
        *_reads("k", (*VELOCITY, *OMEGA)), *_ENDS, *zeroed(zeros), *body,
    ])  # fmt: skip


def _kernel(head: str, doc: str, lines: Iterable[str]) -> str:
    return module_text.function(head, doc, lines, "**IN_ORDER")


def _cubic(row: str) -> list[str]:
    """Statements of the strain energy of third order: of any shapes the products that exist, of beams all of CUBIC."""

    def product(j: str, k: str, l: str) -> list[str]:
        q = [f"q[i + {index}]" for index in (j, k, l)]
        if not row:
            return [f"strain += c * {' * '.join(q)}"]
        return [f"{row.format(one)} += c * {first} * {second}" for one, first, second in
                ((j, q[1], q[2]), (k, q[0], q[2]), (l, q[0], q[1]))]  # fmt: skip

    lines: list[str] = []
    for depth, (index, kind) in enumerate(zip("jkl", CUBIC, strict=True)):
        lines.append(f"{INDENT * depth}for {index} in range({bounds(kind)}):")
    lines += [INDENT * 3 + line for line in ["c = p[o]", *product("j", "k", "l"), "o += 1"]]
    lines.append("for e in range(int(p[o])):")
    lines.append(f"{INDENT}j, k, l, c = int(p[o + 1]), int(p[o + 2]), int(p[o + 3]), p[o + 4]")
    return lines + [INDENT + line for line in [*product("j", "k", "l"), "o += 4"]]


def _reads(k: str, symbols: Iterable[sm.Symbol]) -> list[str]:
    """Statements that read symbols from w, three at a time."""
    threes = (zip(*part, strict=True) for part in batched(emit.places(symbols, "w", k), 3))
    return [f"{', '.join(map(str, names))} = {', '.join(at)}" for names, at in threes]


def _section() -> emit.Printed:
    """Kernel of a section's rotation and its rates."""
    theta, rate = (sm.symbols(f"{name}_x {name}_y {name}_z") for name in ("theta", "rate"))
    parts = section_motion(theta, rate)
    values = [value for part in parts for value in part]
    reads = emit.places((*theta, *rate), "w", "k")
    doc = (
        "Store R, T row by row and T' theta' of a section turned by theta_y and theta_z, then by theta_x about itself."
        "\n\nw[k]: theta, theta'. R: the section's axes in the body's; T theta': its angular velocity there."
    )
    return emit.kernel("section", ("w", "k", "out", "n"), reads, values, doc, out="n")


_ENDS = (
    *(f"to_{kind} = {f'to_{KINDS[k - 1]} + ' if k else ''}int(p[o{f' + {k}' if k else ''}])"
      for k, kind in enumerate(KINDS[:-1])),
    f"to_{KINDS[-1]} = count", f"o += {len(KINDS) - 1}",
)  # fmt: skip
"""Ends of the kinds among the shapes."""
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
_DEMAND = """\
Add the force and the moment that a body's shapes ask for beyond those of the rigid body, and every shape's own.

w[k]: omega, acceleration of the origin less gravity, epsilon, in the body's axes. Coordinates begin at q[i], their
rates at u[s], accelerations at du[s]; the rows of the shapes at h[r]. Room at room[z]: two numbers for each shape.
"""
_INERTIA = """\
Add what shapes change of a body's mass matrix (6, 6) at out[n], which is symmetric; store behind it what couples
them to it, (6, count), and their own, (count, count), all row by row. Room at room[z]: two numbers for each shape.
"""
_ENERGY = """\
Add kinetic energy beyond that of the rigid body, strain energy [J] and the first moment of mass beyond that of the
rigid body; w[k]: velocity of the origin and omega in the body's axes."""
