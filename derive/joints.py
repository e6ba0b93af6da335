"""The module of joints and springs between two sections of bodies, printed once for every scene.

A section is nine numbers of ``sec`` at 9 i: x, y [m], theta [rad], their rates v_x, v_y, omega and the rates of these,
all global. What a joint demands (:mod:`kaneflex.mechanism.joints`) and what a spring pulls with
(:mod:`kaneflex.mechanism.springs`) is said there; here it is differentiated.
"""

from __future__ import annotations

import sympy as sm

from kaneflex.derive import emit, module_text
from kaneflex.derive.program import Assignment, Program, share
from kaneflex.mechanism import springs
from kaneflex.mechanism.joints import coordinate, residuals
from kaneflex.mechanism.parts import ROWS, Joint, Spring
from kaneflex.mechanism.planar import GROUND, BodyPoint, Pose, dot, quarter_turn

SECTION = ("x", "y", "theta", "v_x", "v_y", "omega", "a_x", "a_y", "epsilon")
_SIDES = {"i": 1, "j": 2}
"""Which section an index of a kernel is: the joint's first or its second."""
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
_PULL = "length [m], tension [N], force on the second point x, y [N]"
_TWIST = "angle phi [rad], torque on the first section [N m], no force: 0, 0"
_SPRINGS = {
    "pull_directed": (
        "Spring and damper T = k (L - L_0) + c L' between two points that are apart.", ("k", "c", "L_0"), _PULL,
    ),
    "pull_regular": ("The same without free length and damper, also where the points meet.", ("k",), _PULL),
    "twist": (
        "Spring and damper k (phi - phi_0) + c phi' that turn two sections back.", ("k", "c", "phi_0"), _TWIST,
    ),
}  # fmt: skip

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
    kernels = [*(_joint_kernel(kind) for kind in _DOCS), *(_spring_kernel(name) for name in _SPRINGS)]
    tables = [
        module_text.literal("SECTION", SECTION, "sec: the numbers of section i begin at 9 i"),
        module_text.literal("ROWS", {kind: _count(kind) for kind in _DOCS}, "kernel -> the rows that it stores"),
    ]
    title = "What joints and springs do between two sections of bodies"
    return emit.kernels_module(title, _ABOUT, tables, kernels, EITHER)


def _count(kind: str) -> int:
    return len(ROWS.get(kind, (kind,)))


def _symbol(letter: str, side: int) -> sm.Symbol:
    return sm.Symbol(f"{letter}_{side}")


_READS = tuple(
    (_symbol(letter, side), f"sec[{emit.offset(f'9 * {index}', k)}]")
    for index, side in _SIDES.items()
    for k, letter in enumerate(SECTION)
)
_DIFFERENCES = {
    sm.Symbol(name): _symbol(letter, 2) - _symbol(letter, 1) for name, letter in zip(_RELATIVE, SECTION, strict=True)
}


def _rates() -> dict[sm.Symbol, sm.Expr]:
    """Symbol -> its rate: of what the second section is less the first, and t' = omega_1 S t."""
    relative = list(_DIFFERENCES)
    found = dict(zip(relative[:-3], relative[3:], strict=True))
    omega, epsilon = _symbol("omega", 1), _symbol("epsilon", 1)
    return found | {omega: epsilon} | dict(zip(_GUIDE, (omega * part for part in quarter_turn(_GUIDE)), strict=True))


_RATE = _rates()


def _rate(expression: sm.Expr) -> sm.Expr:
    """d/dt."""
    used = sorted(expression.free_symbols & set(_RATE), key=str)
    return sum((expression.diff(symbol) * _RATE[symbol] for symbol in used), sm.S.Zero)


def _sections() -> tuple[Pose, Pose]:
    """The two sections, as seen from the first in axes along and across the guide, whose direction there is (1, 0)."""
    gap_x, gap_y, phi, *_ = _DIFFERENCES
    return Pose(sm.S.Zero, sm.S.Zero, *_GUIDE, sm.S.Zero), Pose(gap_x, gap_y, None, None, phi)


def _steps() -> list[Assignment]:
    """What the rows are written in: the differences, and t = R(theta_1) d."""
    theta = _symbol("theta", 1)
    guide = Pose(0, 0, sm.cos(theta), sm.sin(theta)).turn(_D)
    return [*_DIFFERENCES.items(), *zip(_GUIDE, guide, strict=True)]


def _joint_kernel(kind: str) -> tuple[emit.Kernel, Program]:
    """Rows of a kind of joint; of "turn" and "slide" the coordinate of one that turns, or slides."""
    first, second = (BodyPoint(GROUND, name, (0, 0)) for name in ("first", "second"))
    if kind in ROWS:
        demands = residuals(Joint("", kind, first, second, (1, 0), angle=_ANGLE), *_sections())
    else:
        joint = Joint("", "prismatic" if kind == "slide" else "revolute", first, second, (1, 0))
        demands = (coordinate(joint, *_sections()),)
    twists = [_symbol(letter, side) for side in _SIDES.values() for letter in SECTION[3:6]]
    outputs = []
    for row, residual in enumerate(demands):
        rate = _rate(residual)
        jacobian = [rate.xreplace(_DIFFERENCES).diff(twist) for twist in twists]
        own = {difference: symbol for symbol, difference in _DIFFERENCES.items()}
        entries = [residual, rate, _rate(rate), *(entry.xreplace(own) for entry in jacobian)]
        outputs += [(f"out[{emit.offset('k', 9 * row + n)}]", entry) for n, entry in enumerate(entries)]
    inputs = (*(symbol for symbol, _ in _READS), *_D, _ANGLE)
    raw = Program(kind, inputs, tuple(_steps()), tuple(outputs))
    doc = _ROW.format(_DOCS[kind], _count(kind), "s" * (_count(kind) > 1))
    arguments = ("sec", "i", "j", "d_x", "d_y", "angle", "out", "k")
    return emit.Kernel(share(raw), arguments, _READS, doc, zeros=True), raw


def _spring_kernel(name: str) -> tuple[emit.Kernel, Program]:
    doc, numbers, stored = _SPRINGS[name]
    steps, values = _twist() if name == "twist" else _pull(directed=name == "pull_directed")
    inputs = (*(symbol for symbol, _ in _READS), *sm.symbols(numbers))
    outputs = tuple((f"out[{emit.offset('n', k)}]", value) for k, value in enumerate(values))
    raw = Program(name, inputs, (*_DIFFERENCES.items(), *steps), outputs)
    arguments = ("sec", "i", "j", *numbers, "out", "n")
    return emit.Kernel(share(raw), arguments, _READS, _SPRING.format(doc, stored), zeros=True), raw


def _spring(stiffness: sm.Expr, damping: sm.Expr, free: sm.Expr) -> Spring:
    first, second = (BodyPoint(GROUND, name, (0, 0)) for name in ("first", "second"))
    return Spring("", first, second, None, stiffness, damping, free)


def _pull(directed: bool) -> tuple[list[Assignment], list[sm.Expr]]:
    """Length, tension, force on the second point, energy and dissipated power of a spring between two points."""
    spring = _spring(_k, _c, _L_0) if directed else _spring(_k, sm.S.Zero, sm.S.Zero)
    gap_x, gap_y, _, *gap_rate = list(_DIFFERENCES)[:5]
    length, tension, rate = sm.symbols("length tension rate")
    change = springs.rate_of_length((gap_x, gap_y), gap_rate, length) if directed else sm.S.Zero
    steps = [(length, sm.sqrt(dot((gap_x, gap_y), (gap_x, gap_y)))), (rate, change)]
    steps.append((tension, springs.tension(spring, length, rate)))
    force = springs.force(spring, (gap_x, gap_y), tension, length)
    return steps, [length, tension, *force, springs.potential(spring, length), springs.drag(spring, rate) * rate]


def _twist() -> tuple[list[Assignment], list[sm.Expr]]:
    """Angle, torque on the first section, no force, energy and dissipated power of a spring between two sections."""
    spring, phi = _spring(_k, _c, _phi_0), sm.Symbol("phi")
    rate = _RATE[phi]
    torque = springs.tension(spring, phi, rate)
    return [], [phi, torque, sm.S.Zero, sm.S.Zero, springs.potential(spring, phi), springs.drag(spring, rate) * rate]
