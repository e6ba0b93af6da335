"""Laws: a user's expression for a load in the time, the drives' angles and speeds.

Parsed by Python's `ast` and checked against a whitelist; nothing is ever evaluated as Python code. `Law.to`
walks the checked tree and builds the expression from any kind of number: SymPy's, NumPy's or plain floats.
"""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

from kaneflex.errors import Fault, nearest

FUNCTIONS = ("abs", "cos", "exp", "log", "sin", "sqrt", "tan", "tanh")

_BINARY = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
_UNARY = {ast.UAdd: operator.pos, ast.USub: operator.neg}
_LONGEST = 1000  # characters; Python's own parser may overflow its stack far beyond


@dataclass(frozen=True)
class Law:
    """A checked law: its canonical text (the same however the law was spaced) and its syntax tree."""

    text: str
    tree: ast.expr

    def to(self, functions: Mapping[str, Callable], names: Mapping[str, Any], number: Callable[[float], Any]) -> Any:
        """The law built from other objects.

        functions: for each of FUNCTIONS that it calls; names: what stands for each name, `pi` included;
        number: makes a literal's value one of these objects, e.g. `sympy.Float` or `float`.
        """

        def build(node: ast.expr) -> Any:
            match node:
                case ast.Constant():
                    return number(node.value)
                case ast.Name():
                    return names[node.id]
                case ast.UnaryOp():
                    return _UNARY[type(node.op)](build(node.operand))
                case ast.BinOp():
                    return _BINARY[type(node.op)](build(node.left), build(node.right))
                case ast.Call():
                    return functions[node.func.id](build(node.args[0]))
            raise AssertionError(f"parse_law let through {ast.dump(node)}")

        return build(self.tree)


def parse_law(text: str, names: Collection[str]) -> Law:
    """The law of `text`, which may use `names` (t, drives' names and NAME_speed) and pi.

    Raises Fault: not an expression, an unknown name, a call of anything but FUNCTIONS, anything else Python
    has.
    """
    if len(text) > _LONGEST:
        raise Fault(f"longer than {_LONGEST} characters", "Give such a course as a table")
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise Fault("not an expression", "Write like '120 * sin(2 * pi * 50 * t)'") from None
    _check(tree, {*names, "pi"})
    return Law(ast.unparse(tree), tree)


def _check(node: ast.expr, names: Collection[str]) -> None:
    match node:
        case ast.Constant(value=bool()) | ast.Constant(value=complex()):
            raise Fault(f"{ast.unparse(node)} is not a real number", "Use real numbers")
        case ast.Constant(value=int() | float()):
            return
        case ast.Name(id=name):
            if name not in names:
                raise Fault(f"unknown name {name!r}", nearest(name, names))
        case ast.UnaryOp(op=ast.UAdd() | ast.USub(), operand=operand):
            _check(operand, names)
        case ast.BinOp(op=op, left=left, right=right) if type(op) in _BINARY:
            _check(left, names)
            _check(right, names)
        case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if name in FUNCTIONS:
            _check(argument, names)
        case ast.Call():
            called = ast.unparse(node.func)
            known = isinstance(node.func, ast.Name) and called in FUNCTIONS
            reason = f"{called} takes one argument" if known else f"a law cannot call {called!r}"
            raise Fault(reason, f"It can call {', '.join(FUNCTIONS)}, each with one argument")
        case _:
            cure = "Use numbers, names, + - * / ** and " + ", ".join(FUNCTIONS)
            raise Fault(f"{ast.unparse(node)!r} is not arithmetic", cure)
