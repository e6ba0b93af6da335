"""A user's law as a SymPy expression: built from the checked syntax tree, never parsed by SymPy."""

from __future__ import annotations

import math
from collections.abc import Mapping

import sympy as sm

_FUNCTIONS = {
    "sin": sm.sin, "cos": sm.cos, "tan": sm.tan, "exp": sm.exp, "log": sm.log, "sqrt": sm.sqrt,
    "tanh": sm.tanh, "abs": sm.Abs,
}  # fmt: skip
_NOT_A_NUMBER = (sm.zoo, sm.nan, sm.oo, sm.S.NegativeInfinity, sm.I)


def law_expression(text: str, names: Mapping[str, sm.Expr], key: str = "law") -> sm.Expr:
    """The law with each of its names replaced by the expression given for it; ``key`` is where the scene has it.

    Raises
    ------
    SceneError
        If terms cancel, or numbers multiply, to something that is not finite and real.
    """
    from kaneflex.scene.laws import parse_law
    from kaneflex.support.errors import SceneError

    law = parse_law(text, tuple(names)).to(_FUNCTIONS, {**names, "pi": sm.pi}, sm.Float)
    numbers = [float(number) for number in law.atoms(sm.Float)]
    if law.has(*_NOT_A_NUMBER) or not all(map(math.isfinite, numbers)):
        reason = "its terms cancel or multiply to what is not finite and real"
        raise SceneError(key, text, reason, "Write it without quotients of what cancels, and with smaller numbers")
    return law
