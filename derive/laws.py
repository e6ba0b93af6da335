"""A user's law as a SymPy expression: built from the checked syntax tree, never parsed by SymPy."""

from __future__ import annotations

from collections.abc import Mapping

import sympy as sm

_FUNCTIONS = {
    "sin": sm.sin, "cos": sm.cos, "tan": sm.tan, "exp": sm.exp, "log": sm.log, "sqrt": sm.sqrt,
    "tanh": sm.tanh, "abs": sm.Abs,
}  # fmt: skip


def law_expression(text: str, names: Mapping[str, sm.Expr]) -> sm.Expr:
    """The law with each of its names replaced by the expression given for it."""
    from kaneflex.laws import parse_law

    return parse_law(text, tuple(names)).to(_FUNCTIONS, {**names, "pi": sm.pi}, sm.Float)
