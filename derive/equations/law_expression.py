"""A user's law as a SymPy expression: built from the checked syntax tree, never parsed by SymPy.

A law whose value or slope jumps has arguments that pass zero there. An engine that ends its steps at such zeros needs
these arguments with their rates, and a law fixed on one side of them: :class:`Switches`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import sympy as sm

from kaneflex.derive.ir.functions import around, chosen, clamped, larger, sign, smaller
from kaneflex.scene.law_parser import parse_law
from kaneflex.scene.laws import smooth
from kaneflex.support.errors import SceneError

_NOT_A_NUMBER = (sm.zoo, sm.nan, sm.oo, sm.S.NegativeInfinity, sm.I)


def _step(x: sm.Expr, *course: sm.Expr, side: Callable[[sm.Expr], sm.Expr] = sign) -> sm.Expr:
    if not course:
        return sm.Rational(1, 2) * (1 + side(x))
    x_0, h_0, x_1, h_1 = course
    return h_0 + (h_1 - h_0) * smooth(clamped((x - x_0) / (x_1 - x_0)))


FUNCTIONS = {
    "sin": sm.sin, "cos": sm.cos, "tan": sm.tan, "exp": sm.exp, "log": sm.log, "sqrt": sm.sqrt,
    "tanh": sm.tanh, "abs": sm.Abs, "acos": sm.acos, "asin": sm.asin, "atan": sm.atan,
    "atan2": sm.atan2, "max": larger, "min": smaller, "sign": sign,
    "step": _step,
}  # fmt: skip


def law_expression(
    text: str, names: Mapping[str, sm.Expr], key: str = "law", functions: Mapping[str, Callable] = FUNCTIONS
) -> sm.Expr:
    """The law with each of its names replaced by the expression given for it; ``key`` is where the scene has it.

    Raises
    ------
    SceneError
        If terms cancel, or numbers multiply, to something that is not finite and real.
    """
    law = parse_law(text, tuple(names)).to(functions, {**names, "pi": sm.pi}, sm.Float)
    numbers = [float(number) for number in law.atoms(sm.Float)]
    if law.has(*_NOT_A_NUMBER) or not all(map(math.isfinite, numbers)):
        reason = "its terms cancel or multiply to what is not finite and real"
        raise SceneError(key, text, reason, "Write it without quotients of what cancels, and with smaller numbers")
    return law


@dataclass
class Switches:
    """Arguments whose passing of zero changes a law, found as laws are built by ``functions``.

    ``sides`` maps each to the symbol for its side: 1 where it is above zero, -1 below, 0 where it stays at it. ``of``
    has the load that was the first to have it.
    """

    sides: dict[sm.Expr, sm.Symbol] = field(default_factory=dict)
    of: list[str] = field(default_factory=list)
    load: str = ""

    @property
    def functions(self) -> dict[str, Callable]:
        """Functions of a law, each on the sides of its arguments."""
        return FUNCTIONS | {
            "abs": lambda x: self._side(x) * x,
            "atan2": lambda y, x: around(self._side(y), y, x),
            "max": lambda a, b: chosen(self._side(a - b), a, b),
            "min": lambda a, b: chosen(self._side(a - b), b, a),
            "sign": self._side,
            "step": lambda x, *course: _step(x, *course, side=self._side),
        }

    def _side(self, argument: sm.Expr) -> sm.Expr:
        if not argument.free_symbols:
            return sm.sign(argument)
        if argument not in self.sides:
            self.sides[argument] = sm.Symbol(f"side_{len(self.sides) + 1}")
            self.of.append(self.load)
        return self.sides[argument]
