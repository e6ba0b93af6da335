"""Module of contacts between two sections of bodies, printed once for all scenes.

Gaps and contact forces are those of :mod:`kaneflex.mechanism.contacts`; here they are differentiated.
"""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sm

from kaneflex.derive.ir.program import Assignment
from kaneflex.derive.laws.joints import TINY, change, of_side, sections_at
from kaneflex.derive.printers import module_text
from kaneflex.derive.printers import numba_printer as emit
from kaneflex.mechanism import contacts
from kaneflex.mechanism.planar import Vector, dot, minus, quarter_turn

NUMBERS = ("direction_x", "direction_y", "reach", "K", "n", "chi", "e", "radius")
"""Numbers of a contact in the order in which the kernels read them."""
_D, _D_RATE, _NORMAL = sm.symbols("d_x d_y"), sm.symbols("d_x_rate d_y_rate"), sm.symbols("n_x n_y")
_LENGTH, _DEPTH, _RATE = sm.Symbol("length"), sm.Symbol("depth", positive=True), sm.Symbol("depth_rate")
_g, _g_rate, _v_0, _size = sm.symbols("g rate v_0 size")
_number = {name: sm.Symbol(name) for name in NUMBERS}
_OMEGAS = sm.symbols("omega_1 omega_2")

_ABOUT = """
A section is nine numbers of w from a or b on: x, y [m], theta [rad], their rates and the rates of these, all global. A
contact is the numbers of p from c on that NUMBERS names: of a line its unit normal in the first section's axes and how
far along it from the first point the second side may come, of circles 1 side by side or -1 one in the other, 0, and
the sum or the difference of their radii; of
flanks, all of whose lengths are angles and forces torques, 1 or -1, 0 and how far that way the second section may turn;
K [N/m^n] and n of K d^n; chi of the law, of Kelvin-Voigt its c [N s/m]; the restitution e that is asked for; the radius
[m] of the second side. n_x, n_y is the unit normal in which the second side is pushed, the first against it.
"""
_GAP = """{}

Stores at out[k], as a joint's row: g [m], above zero apart, g' and g'', then the Jacobian of g by the twists of both
sections."""
_GAPS = {
    "point-line": "A point, or a circle about it, and a straight face that turns with the first section.",
    "circles": "Two circles. About one centre no normal is known, and (0, 0): no g' either.",
    "angle": "Two flanks, of bodies that turn: g in rad.",
}
_FORCE = "Force [N] on the second side along the normal, of {}.{}"
_FORCES = {
    "hertz": "an elastic contact, K d^n",
    "kelvin-voigt": "a spring and a damper, K d^n + c d'",
    "hunt-crossley": "a contact that loses energy by hysteresis, K d^n (1 + chi d'/v_0)",
}
_ODD = "\n\nd = -g is the depth; apart, where d is below zero, the same law goes on, odd in d: no force of the contact."
_FUNCTION = {"hertz": "elastic", "kelvin-voigt": "damped", "hunt-crossley": "hysteretic"}
"""Law -> its kernel."""

_SLIDING = """Sliding of the second side past the first, along the normal turned by 90 deg, as a joint's row.

Stores at out[k]: the way [m] (of circles 0: theirs is no function of places), its two rates, then the Jacobian of the
first of them by the twists of both sections."""

_NORMAL_FORCE = """\
Force [N] on the second side along the normal by a law's number in LAWS but newton's: see its kernels.

v_0 [m/s] is the speed of approach with which the contact began, g and ``rate`` what ``gap`` stores first. The
contact ends where the depth is zero, or its force, whichever comes first: damped ones end with no force, and
hysteretic ones that are torn apart faster than their surfaces come back, too.
"""
_CHOICES = (
    ("gap(kind, w, a, b, p, c, out, k)", "Gap of a contact of this kind, by its number in KINDS: see its kernels.",
     ("point_line(w, a, b, p, c, out, k)", "circles(w, a, b, p, c, out, k)", "angle(w, a, b, p, c, out, k)")),
    ("along(kind, w, a, b, p, c, out, k)",
     "Sliding row of a contact of this kind, by its number in KINDS: see its kernels.",
     ("point_line_along(w, a, b, p, c, out, k)", "circles_along(w, a, b, p, c, out, k)")),
    ("normal_force(law, p, c, v_0, g, rate)", _NORMAL_FORCE,
     ("elastic(p, c, g)", "damped(p, c, g, rate)", "hysteretic(p, c, v_0, g, rate)")),
    ("normal_slopes(law, p, c, v_0, g, rate)", "Derivatives of ``normal_force`` by g [N/m] and by its rate [N s/m].",
     ("elastic_slopes(p, c, g)", "damped_slopes(p, c, g)", "hysteretic_slopes(p, c, v_0, g, rate)")),
)  # fmt: skip
"""Functions that choose a kernel by the number of a kind, or of a law."""


def contact_text() -> str:
    """Text of the module."""
    kernels = [
        *(_gap_kernel(kind) for kind in contacts.KINDS),
        *(_sliding_kernel(kind) for kind in contacts.KINDS[:2]), *(_force_kernel(law) for law in _FORCES),
        *(_force_kernel(law, slopes=True) for law in _FORCES), _energy_kernel(),
    ]  # fmt: skip
    tables = [
        module_text.literal("NUMBERS", NUMBERS, "of a contact, in p"),
        module_text.literal("KINDS", contacts.KINDS, "of geometry"),
        module_text.literal("LAWS", contacts.LAWS, "of the force"),
    ]
    title = "Contacts between two bodies"
    return emit.kernels_module(title, _ABOUT, tables, kernels, (module_text.choice(*each) for each in _CHOICES))


_OWN = emit.places(_number.values(), "p", "c")
_READS = (*sections_at("w", "a", "b"), *_OWN)


def _place(side: int, letters: tuple[str, str]) -> Vector:
    return tuple(of_side(letter, side) for letter in letters)


def _moving(kind: str) -> tuple[list[Assignment], dict[sm.Expr, sm.Expr], sm.Expr]:
    """Assignments of a gap, the rates of all their symbols, and the gap."""
    steps: list[Assignment] = [
        *zip(_D, minus(_place(2, ("x", "y")), _place(1, ("x", "y"))), strict=True),
        *zip(_D_RATE, minus(_place(2, ("v_x", "v_y")), _place(1, ("v_x", "v_y"))), strict=True),
    ]
    a, epsilons = minus(_place(2, ("a_x", "a_y")), _place(1, ("a_x", "a_y"))), (of_side("epsilon", k) for k in (1, 2))
    rates: dict[sm.Expr, sm.Expr] = dict(zip((*_D, *_D_RATE, *_OMEGAS), (*_D_RATE, *a, *epsilons), strict=True))
    direction = _number["direction_x"], _number["direction_y"]
    if kind == "circles":
        steps.append((_LENGTH, sm.sqrt(dot(_D, _D) + TINY)))
        rates[_LENGTH] = dot(_NORMAL, _D_RATE) / direction[0]  # finite about one centre
        gap, normal = contacts.apart(kind, _D, _LENGTH, direction, _number["reach"])
        for n, d in zip(_NORMAL, _D_RATE, strict=True):
            rates[n] = (direction[0] * d - n * rates[_LENGTH]) / _LENGTH
    else:
        c, s = sm.cos(of_side("theta", 1)), sm.sin(of_side("theta", 1))
        normal = (c * direction[0] - s * direction[1], s * direction[0] + c * direction[1])
        rates |= {part: _OMEGAS[0] * turned for part, turned in zip(_NORMAL, quarter_turn(_NORMAL), strict=True)}
        gap, _ = contacts.apart(kind, _D, _LENGTH, _NORMAL, _number["reach"])
    return [*steps, *zip(_NORMAL, normal, strict=True)], rates, gap


def _sliding(arm: Vector) -> sm.Expr:
    return contacts.sliding(_NORMAL, _D_RATE, ((_D[0] + arm[0], _D[1] + arm[1]), arm), _OMEGAS)


def _sliding_kernel(kind: str) -> emit.Printed:
    """Kernel of the sliding speed, its rate and its derivatives by the twists."""
    steps, rates, _ = _moving(kind)
    speed, place = _sliding(contacts.touched(_NORMAL, _number["radius"])), sm.S.Zero
    if kind == "point-line":
        turned = of_side("theta", 2) - of_side("theta", 1)
        place = dot(quarter_turn(_NORMAL), _D) - _number["radius"] * turned
    return _stored(f"{kind}_along", steps, _row(place, speed, rates), _SLIDING)


def _row(value: sm.Expr, speed: sm.Expr, rates: dict[sm.Expr, sm.Expr]) -> tuple[sm.Expr, ...]:
    """A value, its two rates, and the Jacobian of the first of them by the twists of both sections."""
    twists = [
        part for omega, sign in zip(_OMEGAS, (-1, 1), strict=True)
        for part in (*(sign * speed.diff(rate) for rate in _D_RATE), speed.diff(omega))
    ]  # fmt: skip
    return value, speed, change(speed, rates), *twists


def _gap_kernel(kind: str) -> emit.Printed:
    """Kernel of g with its two rates: total derivatives by d, the length and the normal, times the rates of these."""
    if kind == "angle":
        phi, omega, epsilon = (of_side(letter, 2) - of_side(letter, 1) for letter in ("theta", "omega", "epsilon"))
        turn = _number["direction_x"]
        gap, _ = contacts.apart(kind, (phi, sm.S.Zero), _LENGTH, (turn, sm.S.Zero), _number["reach"])
        steps, values = (), (gap, turn * omega, turn * epsilon, 0, 0, -turn, 0, 0, turn)
    else:
        steps, rates, gap = _moving(kind)
        values = _row(gap, change(gap, rates), rates)
    return _stored(kind, steps, values, _GAP.format(_GAPS[kind]))


def _stored(name: str, steps: Sequence[Assignment], values: Sequence[sm.Expr], doc: str) -> emit.Printed:
    arguments = ("w", "a", "b", "p", "c", "out", "k")
    return emit.kernel(name.replace("-", "_"), arguments, _READS, values, doc, steps, out="k")


def _odd(force: sm.Expr) -> sm.Expr:
    """Odd continuation of a force to depths d below zero: K d^n becomes K d |d|^(n - 1)."""
    n = _number["n"]
    return sm.expand(force).xreplace({_DEPTH**n: -_g * _size ** (n - 1)})


def _even(slope: sm.Expr) -> sm.Expr:
    """Even continuation of a force's derivative, whose powers are those of |d|."""
    return sm.powsimp(sm.expand(slope)).xreplace({_DEPTH: _size})


def _force_kernel(law: str, slopes: bool = False) -> emit.Printed:
    """Kernel of the force, or of its derivatives by g and g', with d = -g and d' = -g'."""
    K, n, chi = (_number[name] for name in ("K", "n", "chi"))
    force = contacts.push(law, K, n, chi, _v_0, _DEPTH, _RATE)
    if slopes:
        by_rate = force.diff(_RATE)
        values = [-_even(force.diff(_DEPTH)), -(_odd(by_rate) if by_rate.has(_DEPTH) else by_rate)]
        doc = f"Derivatives of ``{_FUNCTION[law]}`` by g [N/m] and by its rate [N s/m]."
    else:
        values, doc = [_odd(force)], _FORCE.format(_FORCES[law], _ODD)
    values = [sm.sympify(value).xreplace({_RATE: -_g_rate}) for value in values]
    return _returning(_FUNCTION[law] + "_slopes" * slopes, values, doc)


def _energy_kernel() -> emit.Printed:
    """Kernel of the energy int K d^n dd, which is even in d."""
    K, n = _number["K"], sm.Symbol("n", positive=True)
    energy = sm.integrate(contacts.elastic(K, n, _DEPTH), (_DEPTH, 0, _DEPTH))
    energy = (energy / _DEPTH ** (n + 1)).simplify() * _g**2 * _size ** (n - 1)  # whose power is that of the force
    energy = energy.xreplace({n: _number["n"]})
    return _returning("stored", [energy], "Energy [J] of a contact that is as deep as -g, K d^(n + 1)/(n + 1).")


def _returning(name: str, values: list[sm.Expr], doc: str) -> emit.Printed:
    """Kernel that returns values, with a contact's numbers, its gap and what else they depend on as arguments."""
    read = set().union(*(value.free_symbols for value in values))
    own = [symbol.name for symbol in (_v_0, _g, _g_rate) if symbol in read or symbol == _g]
    return emit.kernel(name, ("p", "c", *own), _OWN, values, doc, ((_size, sm.Abs(_g)),))
