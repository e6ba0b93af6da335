"""An ordered record of assignments, from which a Program is made, and scalars of the motion that they lead to."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import sympy as sm


@dataclass(frozen=True)
class Scalar:
    """Scalar of the motion for the elastic stage and sensors: name, unit, meaning, and its expression (a number where
    the scene fixes it)."""

    name: str
    unit: str
    meaning: str
    value: sm.Expr


class Steps:
    """Assignments in the order in which they were derived.

    What turns out to be a number or another symbol is handed on instead of being assigned: this is how a zero
    (a fixed pivot, a constant speed, a piston that can't turn) prunes every term that it multiplies.
    """

    def __init__(self, taken: Iterable[sm.Symbol] = ()) -> None:
        self.assignments: list[tuple[sm.Symbol, sm.Expr]] = []
        self._taken = {symbol.name for symbol in taken}

    def assign(self, symbol: sm.Symbol, expression: sm.Expr) -> sm.Expr:
        """Record ``symbol = expression`` and return what stands for it from now on."""
        expression = sm.sympify(expression)
        if expression.is_Atom or (-expression).is_Atom:
            return expression
        while symbol.name in self._taken:  # a scene's own name may be one that the derivation uses
            symbol = sm.Symbol(f"{symbol.name}_")
        self._taken.add(symbol.name)
        self.assignments.append((symbol, expression))
        return symbol
