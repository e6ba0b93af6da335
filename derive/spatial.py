"""The module of bodies, joints and springs in space, printed once for every scene.

A section of a body is fifteen numbers of ``sec`` at 15 i: place, velocity, acceleration of its point, angular velocity
and acceleration of its body, each x, y, z and global. Axes are three numbers of ``axes`` at 3 k, unit vectors that turn
with their body, global, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import sympy as sm
from sympy.physics.mechanics import (
    KanesMethod,
    Point,
    ReferenceFrame,
    RigidBody,
    dynamicsymbols,
    inertia,
)  # fmt: skip

from kaneflex.derive import emit, module_text
from kaneflex.derive.joints import EITHER
from kaneflex.derive.program import Program, share
from kaneflex.mechanism import springs
from kaneflex.mechanism.parts import Spring
from kaneflex.mechanism.planar import GROUND, BodyPoint

_XYZ = "xyz"
SECTION = tuple(f"{letter}_{axis}" for letter in ("r", "v", "a", "omega", "epsilon") for axis in _XYZ)
BODY = ("mass", *(f"centre_{axis}" for axis in _XYZ), "J_x", "J_y", "J_z", "J_xy", "J_yz", "J_zx")
_MASS, _CENTRE, _J = sm.Symbol(BODY[0]), sm.symbols(BODY[1:4]), sm.symbols(BODY[4:])
_OMEGA, _ACCEL, _EPSILON = (sm.symbols(f"{letter}_x {letter}_y {letter}_z") for letter in ("omega", "a", "epsilon"))
_k, _c, _L_0 = sm.symbols("k c L_0")

_ABOUT = """
A body: mass [kg], its centre [m] and its moments and products of inertia about it [kg m^2], J_xy = -int x y dm, in
the body's own axes, which begin at its origin; ten numbers of p from p[o]. Its equations are Kane's, of its origin's
velocity and its angular velocity in its own axes, by SymPy's KanesMethod. A row of a joint is fifteen numbers: the
residual g that is to vanish, g', g'', then J_1 and J_2 of g' = J_1 V_1 + J_2 V_2, where V = (v, omega) are the twists
of the two sections, on which a multiplier lambda acts with the forces and moments J_1^T lambda and J_2^T lambda. Every
joint in space is some of three elementary constraints (Nikravesh 1988, Computer-Aided Analysis of Mechanical Systems,
sec. 7.3).
"""
_ROWS = {
    "coincide": "The points of two sections are one: three rows at out[n], out[n + 15] and out[n + 30].",
    "perpendicular": "Axis k of the first section and axis l of the second are at right angles: a row at out[n].",
    "on_plane": "The second point is in the plane across the axis k through the first: a row at out[n].",
}
_STORES = (
    "Stores at out[n]: length [m], tension [N], force on the second point x, y, z [N], energy [J], dissipated "
    "power [W]."
)
_PULLS = {
    True: f"Spring and damper T = k (L - L_0) + c L' between two points that are apart.\n\n    {_STORES}",
    False: f"The same without free length and damper, also where the points meet.\n\n    {_STORES}",
}
"""What the kernels of springs say of themselves, by whether the force needs a direction."""


def spatial_text() -> str:
    """Text of ``generated/spatial.py``."""
    kernels = [_demand(), _inertia(), *(_row(kind) for kind in _ROWS), _pull(True), _pull(False)]
    tables = [
        module_text.literal("SECTION", SECTION, "sec: the numbers of section i begin at 15 i"),
        module_text.literal("BODY", BODY, "p: the numbers of a body begin at o"),
    ]
    return emit.kernels_module("What bodies, joints and springs do in space", _ABOUT, tables, kernels, EITHER)


@cache
def body_equations() -> sm.Matrix:
    """-fr* of a free rigid body (6 x 1) in its own axes: three forces at its origin, three moments about it.

    SymPy's KanesMethod with the components of the origin's velocity and of the angular velocity in the body's axes for
    speeds (Kane & Levinson 1985, sec. 4.11); they are no rates of coordinates, which the equations don't have either.
    ``a`` is the acceleration of the origin in the body's axes; less gravity, its weight is in them.
    """
    space, body, origin = ReferenceFrame("space"), ReferenceFrame("body"), Point("origin")
    q, v, w = (dynamicsymbols(f"{letter}_:{count}") for letter, count in (("q", 6), ("v", 3), ("w", 3)))
    body.set_ang_vel(space, _vector(body, w))
    origin.set_vel(space, _vector(body, v))
    centre = origin.locatenew("centre", _vector(body, _CENTRE))
    centre.v2pt_theory(origin, space, body)
    rigid = RigidBody("body", centre, body, _MASS, (inertia(body, *_J), centre))
    kinematics = [speed - place.diff() for speed, place in zip([*v, *w], q, strict=True)]
    kane = KanesMethod(space, q_ind=q, u_ind=[*v, *w], kd_eqs=kinematics)
    _, inertial = kane.kanes_equations([rigid], [])
    spinning = sm.Matrix(w).cross(sm.Matrix(v))
    rates = {speed.diff(): value - turned for speed, value, turned in zip(v, _ACCEL, spinning, strict=True)}
    rates |= {speed.diff(): value for speed, value in zip(w, _EPSILON, strict=True)}
    found = (-inertial).xreplace(rates).xreplace(dict(zip(w, _OMEGA, strict=True))).expand()
    left = found.free_symbols - {_MASS, *_CENTRE, *_J, *_OMEGA, *_ACCEL, *_EPSILON}
    if left or found.has(sm.Derivative):
        raise ValueError(f"Kane's equations of a body depend on {sorted(map(str, left))}")
    return found


def _vector(frame: ReferenceFrame, components: Sequence[sm.Expr]):
    return sum((c * axis for c, axis in zip(components, (frame.x, frame.y, frame.z), strict=True)), 0 * frame.x)


def _of_body() -> tuple[tuple[sm.Symbol, str], ...]:
    return tuple((sm.Symbol(name), f"p[{emit.offset('o', k)}]") for k, name in enumerate(BODY))


def _demand() -> tuple[emit.Kernel, Program]:
    """What a motion asks for."""
    given = [(symbol, f"w[{emit.offset('k', n)}]") for n, symbol in enumerate((*_OMEGA, *_ACCEL, *_EPSILON))]
    outputs = tuple((f"out[{emit.offset('n', k)}]", value) for k, value in enumerate(body_equations()))
    raw = Program("demand", (_MASS, *_CENTRE, *_J, *_OMEGA, *_ACCEL, *_EPSILON), (), outputs)
    doc = (
        "Store the force and the moment about its origin that a body's motion takes, in its axes: Kane's -fr*.\n\n"
        "    w[k]: omega, acceleration of the origin less gravity, epsilon, in the body's axes."
    )
    return emit.Kernel(share(raw), ("p", "o", "w", "k", "out", "n"), (*_of_body(), *given), doc, zeros=True), raw


def _inertia() -> tuple[emit.Kernel, Program]:
    """Mass matrix."""
    matrix = body_equations().jacobian([*_ACCEL, *_EPSILON])
    outputs = tuple((f"out[{emit.offset('n', k)}]", value) for k, value in enumerate(matrix))
    raw = Program("inertia", (_MASS, *_CENTRE, *_J), (), outputs)
    doc = "Store the mass matrix of a body (6, 6) row by row, in its axes: of its origin's velocity and of omega."
    return emit.Kernel(share(raw), ("p", "o", "out", "n"), _of_body(), doc, zeros=True), raw


def _symbols(letter: str, side: int) -> tuple[sm.Symbol, ...]:
    return sm.symbols(" ".join(f"{letter}_{axis}_{side}" for axis in _XYZ))


_READS = tuple(
    (sm.Symbol(f"{name}_{side}"), f"sec[{emit.offset(f'15 * {index}', k)}]")
    for side, index in ((1, "i"), (2, "j"))
    for k, name in enumerate(SECTION)
)
_AXES = tuple(
    (symbol, f"axes[{emit.offset(f'3 * {index}', k)}]")
    for side, index in ((1, "k"), (2, "l"))
    for k, symbol in enumerate(_symbols("n", side))
)


def _rates() -> dict[sm.Symbol, sm.Expr]:
    """Symbol -> its rate; an axis n turns with its section, n' = omega x n."""
    found: dict[sm.Symbol, sm.Expr] = {}
    for side in (1, 2):
        place, velocity, accel, omega, epsilon, axis = (
            _symbols(letter, side) for letter in ("r", "v", "a", "omega", "epsilon", "n")
        )
        found |= dict(zip(place, velocity, strict=True)) | dict(zip(velocity, accel, strict=True))
        found |= dict(zip(omega, epsilon, strict=True))
        found |= dict(zip(axis, sm.Matrix(omega).cross(sm.Matrix(axis)), strict=True))
    return found


_RATE = _rates()


def _rate(expression: sm.Expr) -> sm.Expr:
    """d/dt."""
    return sum((expression.diff(symbol) * rate for symbol, rate in _RATE.items()), sm.S.Zero)


def _residuals(kind: str) -> list[sm.Expr]:
    """What must vanish."""
    gap = sm.Matrix(_symbols("r", 2)) - sm.Matrix(_symbols("r", 1))
    first, second = sm.Matrix(_symbols("n", 1)), sm.Matrix(_symbols("n", 2))
    return {"coincide": list(gap), "perpendicular": [first.dot(second)], "on_plane": [first.dot(gap)]}[kind]


def _row(kind: str) -> tuple[emit.Kernel, Program]:
    """Rows of an elementary constraint."""
    twists = [symbol for side in (1, 2) for letter in ("v", "omega") for symbol in _symbols(letter, side)]
    outputs = []
    for row, residual in enumerate(_residuals(kind)):
        rate = _rate(residual)
        entries = [residual, rate, _rate(rate), *(rate.diff(twist) for twist in twists)]
        outputs += [(f"out[{emit.offset('n', 15 * row + k)}]", entry) for k, entry in enumerate(entries)]
    reads = (*_READS, *_AXES)
    raw = Program(kind, tuple(symbol for symbol, _ in reads), (), tuple(outputs))
    axes = {"coincide": (), "perpendicular": ("axes", "k", "l"), "on_plane": ("axes", "k")}[kind]
    return emit.Kernel(share(raw), ("sec", "i", "j", *axes, "out", "n"), reads, _ROWS[kind], zeros=True), raw


def _pull(directed: bool) -> tuple[emit.Kernel, Program]:
    """A spring between two points that are apart, or one whose force needs no direction."""
    ends = (BodyPoint(GROUND, name, (0, 0)) for name in ("first", "second"))
    spring = Spring("", *ends, None, _k, *((_c, _L_0) if directed else (sm.S.Zero, sm.S.Zero)))
    gap, gap_rate = (sm.Matrix(_symbols(letter, 2)) - sm.Matrix(_symbols(letter, 1)) for letter in "rv")
    length, rate, tension = sm.symbols("length rate tension")
    change = gap.dot(gap_rate) / length if directed else sm.S.Zero
    steps = ((length, sm.sqrt(gap.dot(gap))), (rate, change), (tension, springs.tension(spring, length, rate)))
    force = springs.force(spring, tuple(gap), tension, length)
    values = length, tension, *force, springs.potential(spring, length), springs.drag(spring, rate) * rate
    outputs = tuple((f"out[{emit.offset('n', k)}]", value) for k, value in enumerate(values))
    name, numbers = ("pull_directed", ("k", "c", "L_0")) if directed else ("pull_regular", ("k",))
    raw = Program(name, (*(symbol for symbol, _ in _READS), *sm.symbols(numbers)), steps, outputs)
    arguments = ("sec", "i", "j", *numbers, "out", "n")
    return emit.Kernel(share(raw), arguments, _READS, _PULLS[directed], zeros=True), raw
