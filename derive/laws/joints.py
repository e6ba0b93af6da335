"""The module of joints and springs between two sections of bodies, printed once for every scene.

A section is nine numbers of ``sec`` at 9 i: x, y [m], theta [rad], their rates v_x, v_y, omega and the rates of these,
all global. What a joint demands (:mod:`kaneflex.mechanism.joints`) and what a spring pulls with
(:mod:`kaneflex.mechanism.springs`) is said there; here it is differentiated.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import sympy as sm

from kaneflex.derive.ir.program import Assignment
from kaneflex.derive.printers import module_text
from kaneflex.derive.printers import numba_printer as emit
from kaneflex.mechanism import springs
from kaneflex.mechanism.joints import coordinate, residuals
from kaneflex.mechanism.parts import ROWS, Joint, Spring
from kaneflex.mechanism.planar import GROUND, BodyPoint, Pose, quarter_turn

SECTION = ("x", "y", "theta", "v_x", "v_y", "omega", "a_x", "a_y", "epsilon")
_RELATIVE = tuple(f"{name}{rate}" for rate in ("", "_rate", "_second_rate") for name in ("gap_x", "gap_y", "phi"))
"""The second section's numbers less those of the first."""
_D, _ANGLE = sm.symbols("d_x d_y"), sm.Symbol("angle")
_GUIDE = sm.symbols("t_x t_y")
"""Global direction of a guide, R(theta_1) d: a vector that turns with the first section."""
_k, _c, _L_0, _phi_0 = sm.symbols("k c L_0 phi_0")

_DOCS = {
    "revolute": "Two points are one.",
    "weld": "Two points are one, and the second section is turned against the first by ``angle``.",
    "prismatic": "The second point stays on the guide d through the first, the second section is turned by ``angle``.",
    "turn": "Angle of the second section against the first [rad].",
    "slide": "Way of the second point along the guide d through the first [m].",
}
_ABOUT = """
A row of a joint is nine numbers: the residual g that is to vanish (of turn and slide the joint's coordinate), g', g'',
then J_1 and J_2 of g' = J_1 V_1 + J_2 V_2, where V = (v_x, v_y, omega) are the twists of the two sections, on which a
multiplier lambda acts with the forces J_1^T lambda and J_2^T lambda. d is a guide's direction in the axes of the first
section, angle [rad] by what a weld or a guide holds the second turned against the first.
"""
_ROW = """{}

Stores {} row{} at out[k], as is said above."""
_SPRING = """{}

Stores at out[n]: {}, energy [J], dissipated power [W]."""
_PULLS = {
    True: "Spring and damper T = k (L - L_0) + c L' between two points that are apart.",
    False: "The same without free length and damper, also where the points meet.",
}
"""Docstrings of the kernels of springs between points, by True if the force needs a direction."""

EITHER = '''@njit(**OPTIONS)
def pull(sec, i, j, k, c, L_0, out, n):
    """A spring between two points that may meet where it has neither free length nor damper: see its two cases."""
    if c == 0.0 and L_0 == 0.0:
        pull_regular(sec, i, j, k, out, n)
    else:
        pull_directed(sec, i, j, k, c, L_0, out, n)
'''


def joints_text() -> str:
    """Text of the module."""
    gap_x, gap_y, _, *rates = list(_DIFFERENCES)[:5]
    pulls = [pull(way, _READS, (gap_x, gap_y), rates, _DIFFERENCES.items()) for way in _PULLS]
    kernels = [*(_joint_kernel(kind) for kind in _DOCS), *pulls, _twist()]
    tables = [
        module_text.literal("SECTION", SECTION, "sec: the numbers of section i begin at 9 i"),
        module_text.literal("ROWS", {kind: _count(kind) for kind in _DOCS}, "kernel -> the rows that it stores"),
    ]
    title = "Joints and springs between two sections of bodies"
    return emit.kernels_module(title, _ABOUT, tables, kernels, EITHER)


def _count(kind: str) -> int:
    return len(ROWS.get(kind, (kind,)))


def of_side(letter: str, side: int) -> sm.Symbol:
    """Number of a section."""
    return sm.Symbol(f"{letter}_{side}")


def sections_at(array: str, first: str, second: str, numbers: Iterable[str] = SECTION) -> emit.Reads:
    """Numbers of two sections, which begin at these places of an array."""
    numbers, begins = tuple(numbers), {1: first, 2: second}
    return tuple(place for side, begin in begins.items()
                 for place in emit.places((of_side(letter, side) for letter in numbers), array, begin))  # fmt: skip


def change(value: sm.Expr, rates: Mapping[sm.Expr, sm.Expr]) -> sm.Expr:
    """Rate of a value by those of its symbols."""
    return sum((sm.sympify(value).diff(symbol) * rate for symbol, rate in rates.items()), sm.S.Zero)


_READS = sections_at("sec", "9 * i", "9 * j")
_DIFFERENCES = {
    sm.Symbol(name): of_side(letter, 2) - of_side(letter, 1) for name, letter in zip(_RELATIVE, SECTION, strict=True)
}


def _rates() -> dict[sm.Symbol, sm.Expr]:
    """Symbol -> its rate: of what the second section is less the first, and t' = omega_1 S t."""
    relative = list(_DIFFERENCES)
    found = dict(zip(relative[:-3], relative[3:], strict=True))
    omega, epsilon = of_side("omega", 1), of_side("epsilon", 1)
    return found | {omega: epsilon} | dict(zip(_GUIDE, (omega * part for part in quarter_turn(_GUIDE)), strict=True))


_RATE = _rates()


def _sections() -> tuple[Pose, Pose]:
    """The two sections, as seen from the first in axes along and across the guide, whose direction there is (1, 0)."""
    gap_x, gap_y, phi, *_ = _DIFFERENCES
    return Pose(sm.S.Zero, sm.S.Zero, *_GUIDE, sm.S.Zero), Pose(gap_x, gap_y, None, None, phi)


def _steps() -> list[Assignment]:
    """Common assignments of the rows: the differences, and t = R(theta_1) d."""
    theta = of_side("theta", 1)
    guide = Pose(0, 0, sm.cos(theta), sm.sin(theta)).turn(_D)
    return [*_DIFFERENCES.items(), *zip(_GUIDE, guide, strict=True)]


def _joint_kernel(kind: str) -> emit.Printed:
    """Rows of a kind of joint; of "turn" and "slide" the coordinate of one that turns, or slides."""
    first, second = (BodyPoint(GROUND, name, (0, 0)) for name in ("first", "second"))
    if kind in ROWS:
        demands = residuals(Joint("", kind, first, second, (1, 0), angle=_ANGLE), *_sections())
    else:
        joint = Joint("", "prismatic" if kind == "slide" else "revolute", first, second, (1, 0))
        demands = (coordinate(joint, *_sections()),)
    twists = [of_side(letter, side) for side in (1, 2) for letter in SECTION[3:6]]
    own = {difference: symbol for symbol, difference in _DIFFERENCES.items()}
    entries: list[sm.Expr] = []
    for residual in demands:
        rate = change(residual, _RATE)
        jacobian = [rate.xreplace(_DIFFERENCES).diff(twist) for twist in twists]
        entries += [residual, rate, change(rate, _RATE), *(entry.xreplace(own) for entry in jacobian)]
    doc = _ROW.format(_DOCS[kind], _count(kind), "s" * (_count(kind) > 1))
    arguments = ("sec", "i", "j", "d_x", "d_y", "angle", "out", "k")
    return emit.kernel(kind, arguments, _READS, entries, doc, _steps(), out="k")


def _spring(stiffness: sm.Expr, damping: sm.Expr, free: sm.Expr) -> Spring:
    first, second = (BodyPoint(GROUND, name, (0, 0)) for name in ("first", "second"))
    return Spring("", first, second, None, stiffness, damping, free)


def pull(
    directed: bool, reads: emit.Reads, gap: Sequence[sm.Expr], gap_rate: Sequence[sm.Expr], steps: Iterable[Assignment]
) -> emit.Printed:
    """Length, tension, force on the second point, energy and dissipated power of a spring between two points.

    They are apart, or its force needs no direction: it has neither free length nor damper.
    """
    spring = _spring(_k, _c, _L_0) if directed else _spring(_k, sm.S.Zero, sm.S.Zero)
    length, tension, rate = sm.symbols("length tension rate")
    steps = [*steps, (length, sm.sqrt(sum(part**2 for part in gap)))]
    steps += [(rate, springs.rate_of_length(gap, gap_rate, length) if directed else sm.S.Zero)]
    steps += [(tension, springs.tension(spring, length, rate))]
    force = springs.force(spring, gap, tension, length)
    values = length, tension, *force, springs.potential(spring, length), springs.drag(spring, rate) * rate
    name, numbers = ("pull_directed", ("k", "c", "L_0")) if directed else ("pull_regular", ("k",))
    stored = f"length [m], tension [N], force on the second point {', '.join('xyz'[: len(gap)])} [N]"
    doc = _SPRING.format(_PULLS[directed], stored)
    return emit.kernel(name, ("sec", "i", "j", *numbers, "out", "n"), reads, values, doc, steps, out="n")


def _twist() -> emit.Printed:
    """Angle, torque on the first section, no force, energy and dissipated power of a spring between two sections."""
    spring, phi = _spring(_k, _c, _phi_0), sm.Symbol("phi")
    rate = _RATE[phi]
    torque, drag = springs.tension(spring, phi, rate), springs.drag(spring, rate)
    values = phi, torque, sm.S.Zero, sm.S.Zero, springs.potential(spring, phi), drag * rate
    said = "Spring and damper k (phi - phi_0) + c phi' that turn two sections back."
    doc = _SPRING.format(said, "angle phi [rad], torque on the first section [N m], no force: 0, 0")
    arguments = ("sec", "i", "j", "k", "c", "phi_0", "out", "n")
    return emit.kernel("twist", arguments, _READS, values, doc, _DIFFERENCES.items(), out="n")
