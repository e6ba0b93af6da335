"""Module of bodies in the plane that deform: the equations in space (:mod:`kaneflex.derive.bodies.space`), restricted.

Shapes are of the kinds u, stretch, and v, bending; omega and epsilon have a z component only. Kernels include the rigid
body, whose numbers are the initial values of the sums over shapes, and rotate force and moment into global axes. Every
kernel is proved before it is printed (:mod:`kaneflex.derive.bodies.proof`).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from functools import cache
from itertools import product
from types import MappingProxyType

import sympy as sm

from kaneflex.derive.bodies.kane import ACCEL, EPSILON, OMEGA
from kaneflex.derive.bodies.kinds import PLANE, POINT, Kinds, numbers
from kaneflex.derive.bodies.loops import Shape, added, code, grow, loops, zeroed
from kaneflex.derive.bodies.proof import RIGID, C, S, prove
from kaneflex.derive.bodies.space import (
    VELOCITY,
    demanded,
    energies,
    first_and_second,
    grown,
    rigid_energy,
    spin,
    wrench,
)
from kaneflex.derive.printers import module_text

MASS = RIGID[0]
_STILL = dict.fromkeys((*OMEGA[:2], ACCEL[2], *EPSILON[:2], VELOCITY[2]), 0)
_PLACE = {"x": "xi", "y": "eta", "turn": "turn"}
"""Displacement of a section along and across the body, and its rotation."""
_ROW = "out[k + j]"
_OWN = {"": ({"mass": 1}, {"mass_X": 1}, {"mass_Y": 1}, {"inertia": 1, "mass_X_X": 1, "mass_Y_Y": 1})}
"""Sums of the rigid body, as in a table."""
_FIELDS = {"u": "s", "v": "w", "slope_v": "H", "theta_z": "psi", "x": "X"}
"""Fields by their names in ``scene.modal_data``; of slopes there is the integral of both shapes' product."""
_ORDER = ("X", "s", "w", "H", "psi")
"""Factors in the name of a sum."""
_ELASTIC = {"K_": "stiffness", "C_": "damping"}


@cache
def body_text() -> str:
    """Text of ``generated/body.py``.

    Raises
    ------
    NotKane
        If a kernel differs from the derived equations.
    """
    text = kernels_text()
    prove(text, PLANE)
    printed = [
        _table("BODY", PLANE, "mass", "numbers of a body: its own, of a shape by its kind, of a pair of shapes", _OWN),
        _table("POINT", POINT, "", "numbers of a point of a body in the same way"),
        "# reordered sums are slower here, and so are calls",
        'WITHIN = OPTIONS | {"fastmath": OPTIONS["fastmath"] - {"reassoc"}, "forceinline": True}',
    ]
    about = [*_ABOUT.strip().split("\n"), "", module_text.UNCHECKED]
    return module_text.module("Bodies that move freely in the plane and deform", about, printed, [text])


def kernels_text() -> str:
    """Text of all kernels, which has not been proved."""
    return "\n\n".join([_displace(), _growth(), _inverse(), _inertia(), _energy()])


def _table(name: str, kinds: Kinds, of: str, comment: str, first: Mapping[str, object] = MappingProxyType({})) -> str:
    """Sums that the stored numbers consist of, with their signs, by the names of ``scene.modal_data``."""
    values = {a: kinds.of_shape(a) for a in kinds.names} | {
        a + b: kinds.of_pair(a, b) for a, b in product(kinds.names, repeat=2)
    }
    found = dict(first)
    for key, sums in values.items():
        own = tuple(_signs(sums[each], of) for each in numbers(*key, kinds=kinds).stored)
        found |= {key: own} if own else {}
    return module_text.literal(name, found, comment)


def _signs(value: sm.Expr, of: str) -> dict[str, int]:
    """Names of the sums over mass or rotary inertia that an expression has, with their coefficients."""
    return dict(sorted((_name(term, of), int(sign)) for term, sign in value.as_coefficients_dict().items()))


def _name(term: sm.Expr, of: str) -> str:
    """Name of a product of fields as a sum, like mass_X_H; with ``of`` empty, of a point."""
    powers = term.as_powers_dict().items()
    letters = [re.sub(r"\d+$", "", str(symbol)) for symbol, power in powers for _ in range(power)]
    if letters[0] in _ELASTIC:
        return _ELASTIC[letters[0]]
    fields = sorted((_FIELDS[letter] for letter in letters if letter != "I_z"), key=_ORDER.index)
    return "_".join([*filter(None, ["inertia" if "I_z" in letters else of]), *fields]).replace("H_H", "H")


def _moved(shape: Shape) -> dict[str, sm.Expr]:
    """Increments of a section's displacement and rotation by the j-th shape."""
    q = sm.Symbol("q_j")
    return {place: q * (shape.single(name) + shape.grown(name)) / 2 for name, place in _PLACE.items()}


def _displace() -> str:
    def of_shape(shape: Shape) -> list[str]:
        twist = [f"out[k + 3 * j{f' + {k}' if k else ''}] = {code(shape.grown(name))}" for k, name in enumerate(_PLACE)]
        return [*twist, *grow(_moved(shape))]

    doc = (
        "Store the twists of a section for a unit of each shape, (shapes, 3), in the body's axes; return its "
        "displacement\nand rotation."
    )
    return _kernel("displace(p, o, q, i, out, k)", doc, [
        *_BEGUN_POINT, *zeroed(_PLACE.values()), *loops(of_shape, kinds=POINT), "return xi, eta, turn",
    ])  # fmt: skip


def _growth() -> str:
    def of_shape(shape: Shape) -> list[str]:
        return grow({place: sm.Symbol("v_j") * shape.total(name, "v") for name, place in _PLACE.items()})

    doc = "Return the acceleration of a section along the body at constant rates of its shapes."
    return _kernel("growth(p, o, v, i)", doc, [
        *_BEGUN_POINT, *zeroed(["xi"]), *loops(of_shape, kinds=POINT), "return xi",
    ])  # fmt: skip


def _stored(first: str, of: Mapping[str, sm.Expr], names: Iterable[str]) -> list[str]:
    """Statements that store a vector of the j-th shape, of these components, in global axes."""
    along, across, turn = (of.get(name, sm.S.Zero) for name in names)
    values = C * along - S * across, S * along + C * across, turn
    return [f"out[{first} + 3 * j{f' + {k}' if k else ''}] = {code(value)}" for k, value in enumerate(values)]


def _inverse() -> str:
    force = (wrench() + MASS * sm.Matrix([*ACCEL, 0, 0, 0])).xreplace(_STILL)
    f_x, f_y, moment = (code(force[k]) for k in (0, 1, 5))
    needed = set(map(str, force.free_symbols))

    def of_shape(shape: Shape) -> list[str]:
        lines, total = demanded(shape, _ROW)
        return [*lines, *grow({name: value for name, value in total.items() if name in needed})]

    body = loops(of_shape, kinds=PLANE)
    zeros = [name for name in ("V_x", "V_y", "D_zz", "f_x", "f_y", "m_z") if name in needed]
    doc = (
        "Return the force and moment that a motion takes, and add the forces along its shapes, M u' - f; x, y: "
        "acceleration\nof the start less gravity."
    )
    return _kernel("inverse(p, o, q, v, a, i, c, s, omega_z, x, y, epsilon_z, out, k)", doc, [
        "a_x, a_y = c * x + s * y, c * y - s * x",
        *(line for line in spin() if line.startswith("s_zz")), *_BEGUN, *zeroed(zeros), *body,
        f"along = {f_x}", f"across = {f_y}",
        f"return c * along - s * across, s * along + c * across, {moment}",
    ])  # fmt: skip


def _inertia() -> str:
    def of_shape(shape: Shape) -> list[str]:
        lines, of = grown(shape)
        return [*lines, *_stored("coupling", of, ("P_x", "P_y", "H_z")), *grow(first_and_second(shape, of))]

    def of_pair(a: str, b: str) -> list[str]:
        mass = numbers(a, b, PLANE).of["M"]
        mass = mass.xreplace({symbol: sm.Symbol(f"{symbol}_l") for symbol in mass.free_symbols})
        return [f"out[modal + to_v * j + l] = {code(mass)}"]

    doc = (
        "Store the inertia (3, 3) for the twist of the frame, what couples it to the shapes, (shapes, 3), and the "
        "mass\nmatrix of these, all row by row."
    )
    return _kernel("inertia(p, o, q, i, c, s, out, k, coupling, modal)", doc, [
        *_BEGUN, *loops(of_shape, of_pair, PLANE),
        "out[k] = out[k + 4] = mass", "out[k + 1] = out[k + 3] = 0.0",
        "out[k + 2] = out[k + 6] = -s * S_x - c * S_y", "out[k + 5] = out[k + 7] = c * S_x - s * S_y",
        "out[k + 8] = I_zz",
    ])  # fmt: skip


def _energy() -> str:
    def of_shape(shape: Shape) -> list[str]:
        lines, total = energies(shape)
        return [*lines, *grow(total)]

    kinetic = rigid_energy() + MASS * sum(x**2 for x in VELOCITY) / 2
    doc = (
        "Add kinetic and strain energy [J]; return mass times its centre's place from r; x, y: velocity of the start."
    )
    return _kernel("energy(p, o, q, v, i, c, s, x, y, omega_z, out)", doc, [
        "v_x, v_y = c * x + s * y, c * y - s * x", *_BEGUN, "kinetic = strain = 0.0",
        *loops(of_shape, kinds=PLANE), *added("out[0]", kinetic.xreplace(_STILL)),
        "out[0] += kinetic", "out[1] += strain",
        "return c * S_x - s * S_y, s * S_x + c * S_y",
    ])  # fmt: skip


def _kernel(head: str, doc: str, lines: Iterable[str]) -> str:
    return module_text.function(head, doc, lines, "**WITHIN")


_ABOUT = """
A particle at (X, Y) of the body is at (X + s_j b_j - 1/2 H_jk a_j a_k, Y + w_j a_j) in its axes, a section turns by
psi_k a_k. Shapes are of the kinds u (axial, with coordinates b) and v (transverse, a); their coordinates begin at q[i],
rates at v[i], accelerations at a[i]. c and s are the cosine and the sine of the body's angle, omega_z is its rate.

Numbers of a body from p[o], of a point in the same way: its own; how many shapes it has of kind u, and of both kinds;
of every shape in turn its numbers, then those of all pairs with it. BODY and POINT have the sums that they are, by the
names of kaneflex.scene.modal_data. P, H, J, X, M, K and C are those of kaneflex.generated.spatial_shapes, a sum like
P_x_vq is that of P_x q over shapes of kind v.
"""
_BEGUN = (
    "mass, S_x, S_y, I_zz = p[o], p[o + 1], p[o + 2], p[o + 3]", "to_u, to_v = int(p[o + 4]), int(p[o + 5])", "o += 6",
)  # fmt: skip
_BEGUN_POINT = "to_u, to_v = int(p[o]), int(p[o + 1])", "o += 2"
