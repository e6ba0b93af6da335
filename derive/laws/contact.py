"""Module of the contact forces of :mod:`kaneflex.mechanism.contacts` with their slopes, printed once for all scenes."""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sm

from kaneflex.derive.printers import module_text
from kaneflex.derive.printers import numba_printer as emit
from kaneflex.mechanism import contacts

NUMBERS = ("direction_x", "direction_y", "reach", "K", "n", "chi", "e", "radius")
"""Numbers of a contact in the order in which the kernels read them."""
_DEPTH, _RATE = sm.Symbol("depth", positive=True), sm.Symbol("depth_rate")
_g, _g_rate, _v_0, _size = sm.symbols("g rate v_0 size")
_number = {name: sm.Symbol(name) for name in NUMBERS}
_OWN = emit.places(_number.values(), "p", "c")

_ABOUT = """
A contact is the numbers of p from c on that NUMBERS names: of a line its unit normal in the first section's axes and
how far along it from the first point the second side may come, of circles 1 side by side or -1 one in the other, 0, and
the sum or the difference of their radii; of flanks, all of whose lengths are angles and forces torques, 1 or -1, 0 and
how far that way the second section may turn; K [N/m^n] and n of K d^n; chi of the law, of Kelvin-Voigt its c [N s/m];
the restitution e that is asked for; the radius [m] of the second side.
"""
_FORCE = "Force [N] on the second side along the normal, of {}.{}"
_FORCES = {
    "hertz": "an elastic contact, K d^n",
    "kelvin-voigt": "a spring and a damper, K d^n + c d'",
    "hunt-crossley": "a contact that loses energy by hysteresis, K d^n (1 + chi d'/v_0)",
}
_ODD = "\n\nd = -g is the depth; apart, where d is below zero, the same law goes on, odd in d: no force of the contact."
_FUNCTION = {"hertz": "elastic", "kelvin-voigt": "damped", "hunt-crossley": "hysteretic"}
"""Law -> its kernel."""

_NORMAL_FORCE = """\
Force [N] on the second side along the normal by a law's number in LAWS but newton's: see its kernels.

v_0 [m/s] is the speed of approach with which the contact began, g [m] the gap and ``rate`` its rate. The
contact ends where the depth is zero, or its force, whichever comes first: damped ones end with no force, and
hysteretic ones that are torn apart faster than their surfaces come back, too.
"""
_CHOICES = (
    ("normal_force(law, p, c, v_0, g, rate)", _NORMAL_FORCE,
     ("elastic(p, c, g)", "damped(p, c, g, rate)", "hysteretic(p, c, v_0, g, rate)")),
    ("normal_slopes(law, p, c, v_0, g, rate)", "Derivatives of ``normal_force`` by g [N/m] and by its rate [N s/m].",
     ("elastic_slopes(p, c, g)", "damped_slopes(p, c, g)", "hysteretic_slopes(p, c, v_0, g, rate)")),
)  # fmt: skip
"""Functions that choose a kernel by the number of a law."""


def contact_text() -> str:
    """Text of the module."""
    laws = [_force_kernel(law, slopes) for slopes in (False, True) for law in _FORCES]
    tables = [
        module_text.literal("NUMBERS", NUMBERS, "of a contact, in p"),
        module_text.literal("KINDS", contacts.KINDS, "of geometry"),
        module_text.literal("LAWS", contacts.LAWS, "of the force"),
    ]
    title = "Contacts between two bodies"
    return emit.kernels_module(title, _ABOUT, tables, [*laws, _energy_kernel()], (_chosen(*each) for each in _CHOICES))


def _chosen(head: str, doc: str, calls: Sequence[str]) -> str:
    """Text of a function that returns the call with the number of the law."""
    lines = [line for law, call in enumerate(calls[:-1]) for line in (f"if law == {law}:", f"    return {call}")]
    return module_text.function(head, doc, [*lines, f"return {calls[-1]}"])


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
