"""Modules of joints and springs between two sections of bodies, in the plane and in space, printed once for all scenes.

Residuals of joints are those of :mod:`kaneflex.mechanism.joints`, in space those of elementary constraints; forces of
springs are those of :mod:`kaneflex.mechanism.springs`. Here they are differentiated.

A section in the plane is nine numbers of ``sec`` at 9 i: x, y [m], theta [rad], their rates v_x, v_y, omega and the
rates of these, all global. In space it is fifteen numbers at 15 i: place and velocity of its point, angular velocity of
its body, then acceleration and angular acceleration, each x, y, z and global. Axes in space are three numbers of
``axes`` at 3 k, unit vectors that turn with their body, global, too.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType

import sympy as sm

from kaneflex.derive.bodies.kane import BODY, MOTION, RATE, XYZ, body_equations, planar_body_equations
from kaneflex.derive.ir.program import Assignment
from kaneflex.derive.printers import module_text
from kaneflex.derive.printers import numba_printer as emit
from kaneflex.mechanism import springs
from kaneflex.mechanism.joints import coordinate, residuals
from kaneflex.mechanism.parts import ROWS, Joint
from kaneflex.mechanism.planar import GROUND, BodyPoint, Pose, quarter_turn
from kaneflex.mechanism.springs import Spring

SECTION = ("x", "y", "theta", "v_x", "v_y", "omega", "a_x", "a_y", "epsilon")
_SPATIAL_SECTION = tuple(f"{letter}_{axis}" for letter in ("r", "v", "omega", "a", "epsilon") for axis in XYZ)
_RELATIVE = tuple(f"{name}{rate}" for rate in ("", "_rate", "_second_rate") for name in ("gap_x", "gap_y", "phi"))
"""The second section's numbers less those of the first."""
_D, _ANGLE = sm.symbols("d_x d_y"), sm.Symbol("angle")
_GUIDE = sm.symbols("t_x t_y")
"""Global direction of a guide, R(theta_1) d: a vector that turns with the first section."""
_k, _c, _L_0, _phi_0 = sm.symbols("k c L_0 phi_0")
_ENDS = tuple(BodyPoint(GROUND, name, (0, 0)) for name in ("first", "second"))

_DOCS = {
    "revolute": "Two points are one.",
    "weld": "Two points are one, and the second section is turned against the first by ``angle``.",
    "prismatic": "The second point stays on the guide d through the first, the second section is turned by ``angle``.",
    "turn": "Angle of the second section against the first [rad].",
    "slide": "Way of the second point along the guide d through the first [m].",
}
_ABOUT = """
A body: mass [kg], its centre [m] and its {inertia} about it [kg m^2], in the body's own axes, which begin at its
origin, from p[o]: BODY. Its equations are Kane's, of its origin's velocity and its angular velocity in its own axes, by
SymPy's KanesMethod. A row of a joint: the residual g that is to vanish, g', g'', then J_1 and J_2 of g' = J_1 V_1 + J_2
V_2, where V = {twist} are the twists of the two sections, on which a multiplier lambda acts with the forces and moments
J_1^T lambda and J_2^T lambda.{joints}
"""
_IN_PLANE = {
    "inertia": "moment of inertia", "twist": "(v_x, v_y, omega)", "joints": """
d is a guide's direction in the axes of the first section, angle [rad] by what a weld or a guide holds the second turned
against the first; of turn and slide g is the joint's coordinate.""",
}  # fmt: skip
_IN_SPACE = {
    "inertia": "moments and products of inertia, J_xy = -int x y dm,", "twist": "(v, omega)", "joints": """
Every joint in space is some of three elementary constraints (Nikravesh 1988, Computer-Aided Analysis of Mechanical
Systems, sec. 7.3).""",
}  # fmt: skip
_DEMAND = """\
Store the force and the moment about its origin that a body's motion takes, in its axes: Kane's -fr*.

w[k]: omega, acceleration of the origin less gravity, epsilon, in the body's axes."""
_INERTIA = (
    "Store the mass matrix of a body ({size}, {size}) row by row, in its axes: of its origin's velocity and of omega."
)
_SPRING = """{}

Stores at out[n]: {}, energy [J], dissipated power [W]."""
_PULLS = {
    True: "Spring and damper T = k (L - L_0) + c L' between two points that are apart.",
    False: "The same without free length and damper, also where the points meet.",
}
"""Docstrings of the kernels of springs between points, by True if the force needs a direction."""

_EITHER = '''@njit(**OPTIONS)
def pull(sec, i, j, k, c, L_0, out, n):
    """A spring between two points that may meet where it has neither free length nor damper: see its two cases."""
    if c == 0.0 and L_0 == 0.0:
        pull_regular(sec, i, j, k, out, n)
    else:
        pull_directed(sec, i, j, k, c, L_0, out, n)
'''


def joints_text() -> str:
    """Text of ``generated/joints.py``: rigid bodies, joints and springs in the plane."""
    gap_x, gap_y, _, *rates = list(_DIFFERENCES)[:5]
    numbers, bodies = _rigid_body(planar_body_equations())
    pulls = [_pull(directed, _READS, (gap_x, gap_y), rates, _DIFFERENCES.items()) for directed in _PULLS]
    kernels = [*bodies, *(_joint_kernel(kind) for kind in _DOCS), *pulls, _twist()]
    tables = [
        module_text.literal("SECTION", SECTION, "sec: the numbers of section i begin at 9 i"),
        numbers,
        module_text.literal("ROWS", {kind: _count(kind) for kind in _DOCS}, "kernel -> the rows that it stores"),
    ]
    about = _ABOUT.format(**_IN_PLANE)
    return emit.kernels_module("Bodies, joints and springs in the plane", about, tables, kernels, [_EITHER])


def spatial_text() -> str:
    """Text of ``generated/spatial.py``: rigid bodies, joints and springs in space."""
    numbers, bodies = _rigid_body(body_equations())
    pulls = [_pull(directed, _SPATIAL_READS, _gap("r"), _gap("v"), ()) for directed in _PULLS]
    kernels = [*bodies, *_elementary_constraints(), *pulls]
    tables = [module_text.literal("SECTION", _SPATIAL_SECTION, "sec: the numbers of section i begin at 15 i"), numbers]
    about = _ABOUT.format(**_IN_SPACE)
    return emit.kernels_module("Bodies, joints and springs in space", about, tables, kernels, [_EITHER])


def _rigid_body(equations: sm.Matrix) -> tuple[str, list[emit.Printed]]:
    """Table of a rigid body's numbers, and the kernels of its equations: inverse dynamics and mass matrix."""
    numbers, motion, rates = (
        [symbol for symbol in of if equations.has(symbol)] for of in (sm.symbols(BODY), MOTION, RATE)
    )
    own, moving = emit.places(numbers, "p", "o"), emit.places(motion, "w", "k")
    inertia, size = equations.jacobian(rates), len(rates)
    return module_text.literal("BODY", tuple(map(str, numbers)), "p: the numbers of a body begin at o"), [
        emit.kernel("demand", ("p", "o", "w", "k", "out", "n"), (*own, *moving), equations, _DEMAND, out="n"),
        emit.kernel("inertia", ("p", "o", "out", "n"), own, inertia, _INERTIA.format(size=size), out="n"),
    ]


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


def _rows(
    demands: Iterable[sm.Expr], rates: Mapping[sm.Symbol, sm.Expr], twists: Iterable[str],
    relative: Mapping[sm.Symbol, sm.Expr] = MappingProxyType({}),
) -> list[sm.Expr]:  # fmt: skip
    """Rows of residuals: each with its first and second rate, and the first one's derivatives by both twists.

    ``relative`` symbols are named differences of the sections' numbers.
    """
    own = {difference: symbol for symbol, difference in relative.items()}
    speeds = [of_side(letter, side) for side in (1, 2) for letter in twists]
    entries: list[sm.Expr] = []
    for residual in demands:
        rate = change(residual, rates)
        jacobian = [rate.xreplace(relative).diff(speed).xreplace(own) for speed in speeds]
        entries += [residual, rate, change(rate, rates), *jacobian]
    return entries


# ---- the plane ------------------------------------------------------------------------------------------------------

_READS = sections_at("sec", "9 * i", "9 * j")
_DIFFERENCES = {
    sm.Symbol(name): of_side(letter, 2) - of_side(letter, 1) for name, letter in zip(_RELATIVE, SECTION, strict=True)
}


def _count(kind: str) -> int:
    return len(ROWS.get(kind, (kind,)))


def _joint_kernel(kind: str) -> emit.Printed:
    """Rows of a kind of joint; of "turn" and "slide" the coordinate of one that turns, or slides.

    They are written in differences of the sections' numbers and in the guide's direction t, t' = omega_1 S t: the first
    section is seen in axes along and across the guide, whose direction there is (1, 0).
    """
    gap_x, gap_y, phi, *_ = relative = list(_DIFFERENCES)
    sections = Pose(sm.S.Zero, sm.S.Zero, *_GUIDE, sm.S.Zero), Pose(gap_x, gap_y, None, None, phi)
    if kind in ROWS:
        demands = residuals(Joint("", kind, *_ENDS, (1, 0), angle=_ANGLE), *sections)
    else:
        demands = (coordinate(Joint("", "prismatic" if kind == "slide" else "revolute", *_ENDS, (1, 0)), *sections),)
    theta, omega, epsilon = (of_side(letter, 1) for letter in ("theta", "omega", "epsilon"))
    rates = dict(zip(relative[:-3], relative[3:], strict=True)) | {omega: epsilon}
    rates |= dict(zip(_GUIDE, (omega * part for part in quarter_turn(_GUIDE)), strict=True))
    entries = _rows(demands, rates, SECTION[3:6], _DIFFERENCES)
    guide = Pose(0, 0, sm.cos(theta), sm.sin(theta)).turn(_D)
    steps = [*_DIFFERENCES.items(), *zip(_GUIDE, guide, strict=True)]
    doc = f"{_DOCS[kind]}\n\nStores {_count(kind)} row{'s' * (_count(kind) > 1)} at out[k], as is said above."
    return emit.kernel(kind, ("sec", "i", "j", "d_x", "d_y", "angle", "out", "k"), _READS, entries, doc, steps, out="k")


def _twist() -> emit.Printed:
    """Angle, torque on the first section, no force, energy and dissipated power of a spring between two sections."""
    spring, (phi, rate) = Spring("", *_ENDS, None, _k, _c, _phi_0), sm.symbols("phi phi_rate")
    torque, drag = springs.tension(spring, phi, rate), springs.drag(spring, rate)
    values = phi, torque, sm.S.Zero, sm.S.Zero, springs.potential(spring, phi), drag * rate
    summary = "Spring and damper k (phi - phi_0) + c phi' that turn two sections back."
    doc = _SPRING.format(summary, "angle phi [rad], torque on the first section [N m], no force: 0, 0")
    arguments = ("sec", "i", "j", "k", "c", "phi_0", "out", "n")
    return emit.kernel("twist", arguments, _READS, values, doc, _DIFFERENCES.items(), out="n")


# ---- both -----------------------------------------------------------------------------------------------------------


def _pull(
    directed: bool, reads: emit.Reads, gap: Sequence[sm.Expr], gap_rate: Sequence[sm.Expr], steps: Iterable[Assignment]
) -> emit.Printed:
    """Length, tension, force on the second point, energy and dissipated power of a spring between two points.

    They are apart, or its force needs no direction: it has neither free length nor damper.
    """
    spring = Spring("", *_ENDS, None, _k, *((_c, _L_0) if directed else (sm.S.Zero, sm.S.Zero)))
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


# ---- space ----------------------------------------------------------------------------------------------------------


def _symbols(letter: str, side: int) -> sm.Matrix:
    return sm.Matrix([of_side(f"{letter}_{axis}", side) for axis in XYZ])


def _gap(letter: str) -> list[sm.Expr]:
    """A vector of the second section less that of the first."""
    return list(_symbols(letter, 2) - _symbols(letter, 1))


_SPATIAL_READS = sections_at("sec", "15 * i", "15 * j", _SPATIAL_SECTION)
_TWISTS = tuple(f"{letter}_{axis}" for letter in ("v", "omega") for axis in XYZ)


def _elementary_constraints() -> list[emit.Printed]:
    """Rows of the constraints that every joint in space consists of (Nikravesh 1988, sec. 7.3).

    Axes n turn with their sections, n' = omega x n.
    """
    rates: dict[sm.Symbol, sm.Expr] = {}
    for side in (1, 2):
        place, velocity, accel, omega, epsilon, axis = (
            _symbols(letter, side) for letter in ("r", "v", "a", "omega", "epsilon", "n")
        )
        rates |= zip([*place, *velocity, *omega, *axis], [*velocity, *accel, *epsilon, *omega.cross(axis)], strict=True)
    first, second, gap = _symbols("n", 1), _symbols("n", 2), sm.Matrix(_gap("r"))
    reads = (*_SPATIAL_READS, *emit.places(first, "axes", "3 * k"), *emit.places(second, "axes", "3 * l"))
    kinds = (
        ("coincide", (), gap, "The points of two sections are one: three rows at out[n], out[n + 15] and out[n + 30]."),
        ("perpendicular", ("axes", "k", "l"), [first.dot(second)],
         "Axis k of the first section and axis l of the second are at right angles: a row at out[n]."),
        ("on_plane", ("axes", "k"), [first.dot(gap)],
         "The second point is in the plane across the axis k through the first: a row at out[n]."),
    )  # fmt: skip
    return [
        emit.kernel(kind, ("sec", "i", "j", *axes, "out", "n"), reads, _rows(demands, rates, _TWISTS), doc, out="n")
        for kind, axes, demands, doc in kinds
    ]
