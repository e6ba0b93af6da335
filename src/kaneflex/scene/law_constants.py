"""Constant parts of a law, evaluated with bounds of their rounding errors, so that zeros are recognised.

Every part of a law that contains no name but pi is evaluated here, before any symbolic computation. Each value has an
absolute error bound by running error analysis (Higham 2002, Accuracy and Stability of Numerical Algorithms, sec. 3.3,
to first order): divisors and arguments of logarithms must exceed their own bound.
"""

from __future__ import annotations

import ast
import math
from typing import NamedTuple

from kaneflex.support.errors import Fault
from kaneflex.support.units import LARGEST

_UNIT = 2.0**-53
"""Unit roundoff of float64."""
_CURE = "Write finite and real numbers"


class _Number(NamedTuple):
    value: float
    error: float

    @property
    def is_zero(self) -> bool:
        """True if the value can't be distinguished from zero."""
        return abs(self.value) <= self.error


def check_constants(node: ast.expr) -> None:
    """Raise Fault for a constant part of a checked law that is not finite, not real, or beyond 1e60."""
    _value(node)


def _value(node: ast.expr) -> _Number | None:
    """Value of a part of a law; None if it contains a variable."""
    match node:
        case ast.Constant(value=value):
            found = _literal(value)
        case ast.Name(id=name):
            return _Number(math.pi, _UNIT * math.pi) if name == "pi" else None
        case ast.UnaryOp(op=op, operand=operand):
            inner = _value(operand)
            if inner is None:
                return None
            found = _Number(-inner.value if isinstance(op, ast.USub) else inner.value, inner.error)
        case ast.BinOp(op=op, left=left, right=right):
            a, b = _value(left), _value(right)
            if b is not None and isinstance(op, ast.Div) and b.is_zero:
                raise Fault(f"{ast.unparse(node)} divides by zero", _CURE)
            if a is None or b is None:
                return None
            found = _binary(node, a, b)
        case ast.Call(func=ast.Name(id=name), args=arguments):
            values = [_value(argument) for argument in arguments]
            if name == "step" and len(values) > 1:
                _check_course(node, values[1], values[3])
            known = [value for value in values if value is not None]
            if len(known) < len(values):
                return None
            found = _call(node, name, *known)
    if not abs(found.value) <= LARGEST:
        raise Fault(f"{_short(node)} is beyond {LARGEST:g}: products of such numbers are not finite", _CURE)
    return found


def _short(node: ast.expr) -> str:
    """Text of a part of a law, without numbers that are too long or beyond floats."""
    if isinstance(node, ast.Constant) and (isinstance(node.value, int) or math.isinf(node.value)):
        return "a number"
    return ast.unparse(node)


def _literal(value: float) -> _Number:
    try:
        number = float(value)
    except OverflowError:
        return _Number(math.inf, 0.0)
    return _Number(number, 0.0 if number == value and number.is_integer() else _UNIT * abs(number))


def _binary(node: ast.BinOp, a: _Number, b: _Number) -> _Number:
    match node.op:
        case ast.Add():
            value, error = a.value + b.value, a.error + b.error
        case ast.Sub():
            value, error = a.value - b.value, a.error + b.error
        case ast.Mult():
            value, error = a.value * b.value, abs(a.value) * b.error + abs(b.value) * a.error
        case ast.Div():
            value = a.value / b.value
            error = (a.error + abs(value) * b.error) / (abs(b.value) - b.error)
        case ast.Pow():
            return _power(node, a, b)
    return _Number(value, error + _UNIT * abs(value))


def _power(node: ast.BinOp, a: _Number, b: _Number) -> _Number:
    """Power a**b; its relative error is b da / a + log |a| db."""
    if a.is_zero and b.value < 0:
        raise Fault(f"{ast.unparse(node)} divides by zero", _CURE)
    if a.value < 0 and not b.value.is_integer():
        raise Fault(f"{ast.unparse(node)} is not real", _CURE)
    try:
        value = a.value**b.value
    except OverflowError:
        value = math.inf
    if a.is_zero:
        return _Number(value, abs(value))
    relative = abs(b.value) * a.error / abs(a.value) + abs(math.log(abs(a.value))) * b.error
    return _Number(value, abs(value) * min(relative + _UNIT, 1.0))


def _check_course(node: ast.Call, begin: _Number | None, end: _Number | None) -> None:
    """Raise Fault for a smooth step with constant ends that coincide."""
    if begin is not None and end is not None and abs(end.value - begin.value) <= end.error + begin.error:
        raise Fault(f"{ast.unparse(node)} begins where it ends", "Write step(x) for a sharp step, where x passes zero")


def _call(node: ast.Call, name: str, x: _Number, *more: _Number) -> _Number:
    """Value of a function; its error is that of its argument times its slope."""
    v, e = x
    if name in ("sign", "step", "min", "max", "atan2"):
        return _switched(name, x, *more)
    outside = (name in ("log", "sqrt") and v < 0 and not x.is_zero) or (name in ("asin", "acos") and abs(v) > 1.0 + e)
    if outside:
        raise Fault(f"{ast.unparse(node)} is not real", _CURE)
    if (name == "log" and x.is_zero) or (name == "tan" and abs(math.cos(v)) <= e):
        raise Fault(f"{ast.unparse(node)} is not finite", _CURE)
    match name:
        case "abs":
            return _Number(abs(v), e)
        case "sqrt":
            value = math.sqrt(max(v, 0.0))
            slope = 1.0 / (2.0 * value) if value else 0.0
            error = min(e * slope, math.sqrt(e))
        case "exp":
            value = math.exp(v) if v < _LARGEST_EXPONENT else math.inf
            error = e * value
        case "log":
            value, error = math.log(v), e / v
        case "tan":
            value = math.tan(v)
            error = e * (1.0 + value * value)
        case "asin" | "acos":
            value = getattr(math, name)(min(max(v, -1.0), 1.0))
            room = (1.0 - abs(v)) * (1.0 + abs(v))
            error = math.sqrt(2.0 * e) + e if room <= e else e / math.sqrt(room)
        case _:  # sin, cos, tanh, atan have slopes up to one
            value, error = getattr(math, name)(v), e
    return _Number(value, error + _UNIT * abs(value))


def _switched(name: str, x: _Number, *more: _Number) -> _Number:
    """Value of a jump or a choice between two values; if it is uncertain, the error is as large as the jump."""
    v, e = x
    if name == "sign" or not more:
        side = 0.0 if x.is_zero else math.copysign(1.0, v)
        found, error = side, float(x.is_zero and e > 0.0)
        return _Number(found, error) if name == "sign" else _Number(0.5 + 0.5 * found, 0.5 * error)
    if name == "atan2":
        across = more[0]
        size = math.hypot(v, across.value)
        cut = across.value < 0.0 and 0.0 < e and x.is_zero
        error = math.tau if cut or size <= e + across.error else (e + across.error) / size
        return _Number(math.atan2(v, across.value), error if e + across.error > 0.0 else 0.0)
    if len(more) > 1:
        x_0, h_0, x_1, h_1 = more
        s = min(max((v - x_0.value) / (x_1.value - x_0.value), 0.0), 1.0)
        value = h_0.value + (h_1.value - h_0.value) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        slope = 2.0 * abs((h_1.value - h_0.value) / (x_1.value - x_0.value))  # 15/8 at most
        return _Number(value, h_0.error + h_1.error + slope * (e + x_0.error + x_1.error) + _UNIT * abs(value))
    pick = min if name == "min" else max
    return _Number(pick(v, more[0].value), max(e, more[0].error))


_LARGEST_EXPONENT = 700.0
"""Exponential as infinity beyond 709, where math.exp raises."""
