"""Parser of laws: a whitelist of Python's syntax, their size and their constants are checked."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Collection, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from kaneflex.scene.laws import BINARY, FUNCTIONS, ON_ARRAYS, UNARY, Law
from kaneflex.support.errors import Fault, nearest
from kaneflex.support.units import LARGEST

_WITH_UNIT = re.compile(r"\d+(?:\.\d*)?\s*([A-Za-z%]+)\b")
"""Number with a unit behind it."""
_LONGEST = 100_000
"""Largest number of characters, so that parsing is quick; the number of operations limits a law's size."""
_MOST_OPERATIONS = 1000
_DEEPEST = 100
"""Largest depth of nested operations (each term of a sum or a product counts), so that recursion stays possible."""
_MOST_NESTED = 24
"""Largest depth of nested functions and powers: a drive's law is differentiated twice, and each adds a factor."""
_COUNTS = {(1,): "one argument", (2,): "two arguments", (1, 5): "one argument, or five"}
_EXAMPLES = {name: f"{name}(t)" for name in FUNCTIONS} | {
    "atan2": "atan2(y, x)", "max": "max(0, t)", "min": "min(1, t)", "step": "step(t, 0.1, 0, 0.2, 50)",
}  # fmt: skip
_AS_A_TABLE = "Give such a function as a table"


def parse_law(text: str | None, names: Collection[str]) -> Law:
    """Parse a law, which may use `names` (t, drives' names and NAME_speed) and pi.

    The law's canonical text can be parsed again. Raises Fault: not an expression, too large, an unknown name, a call
    of other functions than FUNCTIONS, other Python syntax, a constant part that is not finite and real.
    """
    assert text is not None  # a load or drive of kind law has a law
    return _parsed(text, tuple(names))


@lru_cache(maxsize=256)
def _parsed(text: str, names: tuple[str, ...]) -> Law:
    """Parse each text once, since every point of a study needs the same laws."""
    if len(text) > _LONGEST:
        raise Fault(f"longer than {_LONGEST} characters", _AS_A_TABLE)
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except RecursionError:
        raise Fault(f"more than {_DEEPEST} nested operations", _AS_A_TABLE) from None
    except (SyntaxError, ValueError, MemoryError):
        for found in _WITH_UNIT.finditer(text):
            if found[1] not in {*names, *FUNCTIONS, "pi"}:
                cure = "Write SI numbers (rad, m, s, N), like 60 * pi / 180 for 60 deg"
                raise Fault(f"{found[0]!r} has a unit, and numbers in a law have none", cure) from None
        raise Fault("not an expression", "Write one like '120 * sin(2 * pi * 50 * t)'") from None
    _check_size(tree)
    _check(tree, {*names, "pi"})
    _constant(tree)
    return Law(ast.unparse(tree), tree)


def _check_size(tree: ast.expr) -> None:
    """Raise Fault for a tree that is too large to be walked recursively, or to be differentiated quickly."""
    level, operations, depth = [(tree, 0)], 0, 0
    while level:
        operations += sum(isinstance(node, ast.BinOp | ast.UnaryOp | ast.Call) for node, _ in level)
        depth += 1
        for what, number, most in (
            ("operations", operations, _MOST_OPERATIONS),
            ("nested operations", depth, _DEEPEST),
            ("nested functions and powers", max(nested for _, nested in level), _MOST_NESTED),
        ):
            if number > most:
                raise Fault(f"more than {most} {what}", _AS_A_TABLE)
        level = [
            (inner, nested + (isinstance(node, ast.Call) or isinstance(getattr(node, "op", None), ast.Pow)))
            for node, nested in level
            for inner in ast.iter_child_nodes(node)
            if isinstance(inner, ast.expr)
        ]


def _check(node: ast.expr, names: Collection[str]) -> None:
    match node:
        case ast.BinOp(op=ast.BitXor()):
            raise Fault(f"{ast.unparse(node)!r} is not a power", "Write ** for a power, like t**2")
        case ast.Constant(value=bool()) | ast.Constant(value=complex()):
            raise Fault(f"{ast.unparse(node)} is not a real number", "Use real numbers")
        case ast.Constant(value=int() | float()):
            return
        case ast.Name(id=name):
            if name not in names:
                raise Fault(f"unknown name {name!r}", nearest(name, names))
        case ast.Attribute():  # like the path main.speed in place of main_speed
            name = ast.unparse(node)
            raise Fault(f"unknown name {name!r}", nearest(name.replace(".", "_"), names))
        case ast.UnaryOp(op=ast.UAdd() | ast.USub(), operand=operand):
            _check(operand, names)
        case ast.BinOp(op=op, left=left, right=right) if type(op) in BINARY:
            _check(left, names)
            _check(right, names)
        case ast.Call(func=ast.Name(id=name), keywords=[]) if len(node.args) in FUNCTIONS.get(name, ()):
            for argument in node.args:
                _check(argument, names)
        case ast.Call():
            called = ast.unparse(node.func)
            cure = f"Use {', '.join(FUNCTIONS)}"
            if not isinstance(node.func, ast.Name) or called not in FUNCTIONS:
                raise Fault(f"a law cannot call {called!r}", cure)
            raise Fault(f"{called} takes {_COUNTS[FUNCTIONS[called]]}", f"Write it like {_EXAMPLES[called]!r}")
        case _:
            cure = "Use numbers, names, + - * / ** and " + ", ".join(FUNCTIONS)
            raise Fault(f"{ast.unparse(node)!r} is not arithmetic", cure)


_UNIT = 2.0**-53
"""Unit roundoff of float64."""
_REAL = "Write finite and real numbers"
_DOMAINS = {"log": (0.0, np.inf), "sqrt": (0.0, np.inf), "acos": (-1.0, 1.0), "asin": (-1.0, 1.0)}
"""Ranges of arguments for which a function is real."""


class _Number(NamedTuple):
    """Value of a constant part of a law, and a bound of its rounding error.

    Running error analysis to first order (Higham 2002, Accuracy and Stability of Numerical Algorithms, sec. 3.3), by
    the values at the bounds of each argument: divisors and arguments of logarithms must exceed their own bound.
    """

    value: float
    error: float

    @property
    def is_zero(self) -> bool:
        """True if the value can't be distinguished from zero."""
        return bool(abs(self.value) <= self.error)


def _constant(node: ast.expr) -> _Number | None:
    """Value of a part of a checked law; None if it contains a variable.

    Raises Fault for a constant part that is not finite, not real, or beyond 1e60.
    """
    match node:
        case ast.Name(id=name):
            return _Number(np.pi, _UNIT * np.pi) if name == "pi" else None
        case ast.UnaryOp(op=op, operand=operand):
            number = _applied(UNARY[type(op)], [_constant(operand)])
        case ast.Constant(value=value):
            number = _literal(value)
        case ast.BinOp(op=op, left=left, right=right):
            a, b = _constant(left), _constant(right)
            _check_operands(node, a, b)
            number = _applied(BINARY[type(op)], [a, b])
        case ast.Call(func=ast.Name(id=name), args=arguments):
            values = [_constant(argument) for argument in arguments]
            _check_arguments(node, name, values)
            number = _applied(ON_ARRAYS[name], values, *_DOMAINS.get(name, (-np.inf, np.inf)))
    if number is not None and not abs(number.value) <= LARGEST:
        unnamed = isinstance(node, ast.Constant) and (isinstance(node.value, int) or np.isinf(node.value))
        shown = "a number" if unnamed else ast.unparse(node)
        raise Fault(f"{shown} is beyond {LARGEST:g}: products of such numbers are not finite", _REAL)
    return number


def _literal(value: Any) -> _Number:
    try:
        number = float(value)
    except OverflowError:
        return _Number(np.inf, 0.0)
    return _Number(number, 0.0 if number == value and number.is_integer() else _UNIT * abs(number))


def _applied(
    function: Callable[..., Any], numbers: Sequence[_Number | None], low: float = -np.inf, high: float = np.inf
) -> _Number | None:
    """Value of a function of numbers, which are limited to its domain; None if one of them is a variable."""
    known = [number for number in numbers if number is not None]
    if len(known) < len(numbers):
        return None
    at = [np.clip(number.value, low, high) for number in known]
    with np.errstate(all="ignore"):
        value = function(*at)
        error = _UNIT * abs(value)
        for k, number in enumerate(known):
            ends = np.clip([number.value - number.error, number.value + number.error], low, high)
            apart = np.array([abs(function(*at[:k], end, *at[k + 1 :]) - value) for end in ends])
            error += apart[np.isfinite(apart)].max(initial=0.0)
    return _Number(float(value), float(error))


def _check_operands(node: ast.BinOp, a: _Number | None, b: _Number | None) -> None:
    if b is None or (a is None and not isinstance(node.op, ast.Div)):
        return
    power = isinstance(node.op, ast.Pow) and a
    if (isinstance(node.op, ast.Div) and b.is_zero) or (power and power.is_zero and b.value < 0):
        raise Fault(f"{ast.unparse(node)} divides by zero", _REAL)
    if power and power.value < 0 and not b.value.is_integer():
        raise Fault(f"{ast.unparse(node)} is not real", _REAL)


def _check_arguments(node: ast.Call, name: str, values: Sequence[_Number | None]) -> None:
    if len(values) == 5 and (begin := values[1]) and (end := values[3]):  # step
        if abs(end.value - begin.value) <= end.error + begin.error:
            cure = "Write step(x) for a sharp step, where x passes zero"
            raise Fault(f"{ast.unparse(node)} begins where it ends", cure)
    if (x := values[0]) is None:
        return
    low, high = _DOMAINS.get(name, (-np.inf, np.inf))
    if not low - x.error <= x.value <= high + x.error:
        raise Fault(f"{ast.unparse(node)} is not real", _REAL)
    if (name == "log" and x.is_zero) or (name == "tan" and abs(np.cos(x.value)) <= x.error):
        raise Fault(f"{ast.unparse(node)} is not finite", _REAL)
