"""Module of friction by the laws of :mod:`kaneflex.mechanism.friction`, printed once for all scenes."""

from __future__ import annotations

import sympy as sm

from kaneflex.derive.printers import module_text
from kaneflex.derive.printers import numba_printer as emit
from kaneflex.mechanism import friction

NUMBERS = (
    "direction_x", "direction_y", "end", "mu", "mu_static", "v_s", "delta", "viscous", "preload", "arm", "law", "of",
    "sigma_0", "sigma_1",
)  # fmt: skip
"""Numbers of a friction in the order in which the kernels read them."""
_number = {name: sm.Symbol(name) for name in NUMBERS}
_OWN = emit.places(_number.values(), "p", "c")
_N, _v, _size = sm.symbols("N v size")
_g, _slope, _way, _z = sm.symbols("g slope way z")

_ABOUT = """
A friction is the numbers of p from c on that NUMBERS names: direction of its joint, end of its rows; kinetic and static
coefficient; Stribeck's speed v_s [m/s or rad/s] and exponent; viscous [N s/m or N m s/rad]; preload [N or N m]; the arm
of its joint; the number of its law, and of the act that it belongs to; stiffness [N/m or N m/rad] and damping of its
bristles, which are bent by z [m or rad]. g is what ``dry`` gives, slope ``dry_slope``, way the sign of v. N is what
presses the sides together [N or N m], v the speed of the second past the first.
"""
_CHOICES = (
    ("dry(p, c, N, v)", "Friction force at the speed v of either sign [N or N m], by Coulomb's or by Stribeck's law.",
     ["return stribeck(p, c, N, v) if p[c + 5] > 0.0 else coulomb(p, c, N)"]),
    ("dry_slope(p, c, N, v)", "Derivative of ``dry`` by |v|.",
     ["return stribeck_slope(p, c, N, v) if p[c + 5] > 0.0 else 0.0"]),
)  # fmt: skip


def friction_text() -> str:
    """Text of the module."""
    tables = [
        module_text.literal("NUMBERS", NUMBERS, "of a friction, in p"),
        module_text.literal("LAWS", friction.LAWS, "of friction"),
    ]
    title = "Friction between two sliding sides"
    return emit.kernels_module(title, _ABOUT, tables, _kernels(), (module_text.function(*each) for each in _CHOICES))


def _kernels() -> list[emit.Printed]:
    """Kernels of Coulomb's and Stribeck's laws, then of law lugre, whose rate is linear in z.

    Derivatives by v include those of |v| and g.
    """
    mu, mu_static, preload = (_number[name] for name in ("mu", "mu_static", "preload"))
    left = friction.excess(_number["v_s"], _size, _number["delta"], sm.exp)
    falling = friction.dry(mu, mu_static, preload, _N, left)
    stiffness, damping = _number["sigma_0"], _number["sigma_1"]
    rate = friction.bristle_rate(stiffness, _g, _v, _size, _z)
    force = friction.bristle_force(stiffness, damping, _number["viscous"], rate, _v, _z)
    by_speed = rate.diff(_v) + _way * (rate.diff(_size) + _slope * rate.diff(_g))
    return [
        _returning("limit", friction.limit(mu_static, preload, _N), "Largest force that holds [N or N m].", _N),
        _returning("coulomb", friction.dry(mu, mu_static, preload, _N, sm.S.Zero), "Force by Coulomb's law.", _N),
        _returning("stribeck", falling, "Force by Stribeck's law.", _N, _v),
        _returning("stribeck_slope", falling.diff(_size), "Derivative of ``stribeck`` by |v|.", _N, _v),
        _returning("bristle_decay", -rate.diff(_z), "Decay rate of the bristles' deflection [1/s].", _g, _v),
        _returning("bristle_rate", rate, "Rate of the bristles' deflection [m/s or rad/s].", _g, _v, _z),
        _returning("bristle_force", force, "Against the motion, of bristles.", _g, _v, _z),
        _returning("bristle_by_speed", by_speed, "Derivative of their rate by v.", _g, _slope, _v, _way, _z),
        _returning("bristle_by_dry", rate.diff(_g), "Derivative of their rate by g.", _g, _v, _z),
    ]


def _returning(name: str, value: sm.Expr, doc: str, *given: sm.Symbol) -> emit.Printed:
    steps = ((_size, sm.Abs(_v)),) if value.has(_size) else ()
    return emit.kernel(name, ("p", "c", *map(str, given)), _OWN, (value,), doc, steps)
