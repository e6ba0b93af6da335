"""Expressions of compiled functions as C, with their types."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Mapping
from types import ModuleType
from typing import TYPE_CHECKING, Any, NoReturn

from numba import types
from numba.core.dispatcher import Dispatcher

from kaneflex.multibody import tables
from kaneflex.multibody.c_text import Expression, bare, constant, grouped, safe, wider
from kaneflex.multibody.tables import Fixed, Handed
from kaneflex.support.machine_code import Kernel

if TYPE_CHECKING:
    from kaneflex.multibody.printed import Printer

OPERATORS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}
_COMPARED = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}
_MATHEMATICS = {getattr(math, name): name for name in (
    "acos acosh asin asinh atan atan2 atanh cbrt ceil copysign cos cosh erf erfc exp exp2 expm1 fabs floor fmod hypot "
    "log log10 log1p log2 pow sin sinh sqrt tan tanh trunc"
).split() if hasattr(math, name)}  # fmt: skip
_WHOLE = (math.ceil, math.floor, math.trunc)
"""Functions that return an int in Python."""


class Expressions:
    """Expressions of one function in C.

    Attributes
    ----------
    arguments, variables : dict of str
        Types by name.
    read : set of str
        Names that are read.
    """

    def __init__(self, printer: Printer, function: Any, arguments: dict[str, Any]) -> None:
        self.printer, self.function, self.arguments = printer, function, arguments
        self.known = _names_of(function)
        self.variables: dict[str, Any] = {}
        self.read: set[str] = set()

    def expression(self, node: ast.expr) -> Expression:
        """Text and type."""
        method = getattr(self, f"_of_{type(node).__name__}", None)
        if method is None:
            self.refuse(node)
        return method(node)

    def condition(self, node: ast.expr) -> str:
        text, kind = self.expression(node)
        return bare(text) if kind == types.boolean else f"{text} != 0"

    def _of_Constant(self, node: ast.Constant) -> Expression:
        return constant(node.value)

    def _of_Name(self, node: ast.Name) -> Expression:
        kind = self.arguments.get(node.id, self.variables.get(node.id))
        if kind is not None:
            self.read.add(node.id)
            return safe(node.id), kind
        return self._static(node, self._object(node))

    def _of_Attribute(self, node: ast.Attribute) -> Expression:
        if not self._is_static(node):
            text, kind = self.expression(node.value)
            if isinstance(kind, Handed):
                return f"{text}->{node.attr}", kind.parts[node.attr]
            if kind == types.complex128:
                return f"c{node.attr}({bare(text)})", types.float64
            if kind == types.float64 and node.attr == "real":
                return text, kind
            if kind == types.float64 and node.attr == "imag":
                return "0.0", kind
            self.refuse(node)
        return self._static(node, self._object(node))

    def _static(self, node: ast.expr, value: Any) -> Expression:
        if not isinstance(value, (bool, int, float)):
            self.refuse(node)
        return constant(value)

    def _of_Subscript(self, node: ast.Subscript) -> Expression:
        text, kind = self.expression(node.value)
        if isinstance(kind, Fixed):
            if isinstance(node.slice, ast.Tuple):
                row, column = map(self.whole, node.slice.elts)
                return f"{text}[{row} * {kind.width} + {column}]", types.int64
            return f"{text}[{bare(self.whole(node.slice))}]", types.int64
        if isinstance(kind, types.CPointer):
            return f"{text}[{bare(self.whole(node.slice))}]", kind.dtype
        if isinstance(kind, types.BaseTuple) and isinstance(node.slice, ast.Constant):
            k = node.slice.value
            assert isinstance(k, int)
            return f"{text}._{k}", kind.types[k]
        self.refuse(node)

    def whole(self, node: ast.expr) -> str:
        """An integer, even if its variable is a floating-point one elsewhere in the function."""
        text, kind = self.expression(node)
        return f"(int64_t){text}" if kind == types.float64 else text

    def _of_UnaryOp(self, node: ast.UnaryOp) -> Expression:
        if isinstance(node.op, ast.Not):
            return f"(!{grouped(self.condition(node.operand))})", types.boolean
        text, kind = self.expression(node.operand)
        if not isinstance(node.op, ast.USub):
            self.refuse(node)
        return f"(-{text})", kind

    def _of_BinOp(self, node: ast.BinOp) -> Expression:
        (left, one), (right, other) = self.expression(node.left), self.expression(node.right)
        kind = wider(one, other)
        if isinstance(node.op, ast.Pow):
            if isinstance(node.right, ast.Constant) and node.right.value == 2 and left.replace("_", "").isalnum():
                return f"({left} * {left})", kind
            if kind == types.complex128:
                self.refuse(node)
            return f"pow({bare(left)}, {bare(right)})", types.float64
        if isinstance(node.op, ast.Mod) and kind in (types.int64, types.float64):
            text = f"remainder_of({bare(left)}, {bare(right)})"
            return (f"(int64_t){text}" if kind == types.int64 else text), kind
        if isinstance(node.op, ast.FloorDiv) and kind == types.int64:
            return f"(int64_t)floor((double){left} / {right})", kind
        if type(node.op) not in OPERATORS:
            self.refuse(node)
        if isinstance(node.op, ast.Div) and kind == types.int64:
            left, kind = f"(double){left}", types.float64
        return f"({left} {OPERATORS[type(node.op)]} {right})", kind

    def _of_Compare(self, node: ast.Compare) -> Expression:
        operands = [self.expression(each)[0] for each in (node.left, *node.comparators)]
        pairs = [
            f"{operands[k]} {_COMPARED[type(operator)]} {operands[k + 1]}" for k, operator in enumerate(node.ops)
        ]
        return f"({' && '.join(pairs)})", types.boolean

    def _of_BoolOp(self, node: ast.BoolOp) -> Expression:
        between = " && " if isinstance(node.op, ast.And) else " || "
        return f"({between.join(grouped(self.condition(each)) for each in node.values)})", types.boolean

    def _of_IfExp(self, node: ast.IfExp) -> Expression:
        (one, kind), (other, of) = self.expression(node.body), self.expression(node.orelse)
        return f"({grouped(self.condition(node.test))} ? {one} : {other})", wider(kind, of)

    def _of_Call(self, node: ast.Call) -> Expression:
        if node.keywords:
            self.refuse(node)
        if isinstance(node.func, ast.Call):
            return self._kernel(node.func, node)
        called = self._object(node.func)
        special = _SPECIAL.get(called) if isinstance(called, Callable) else None  # type: ignore[arg-type]
        if special is not None:
            return special(self, node)
        if hasattr(called, "where"):
            function, mechanisms, otherwise = called.where
            if self.expression(node.args[0])[1] not in mechanisms:  # not used by this mechanism
                return ("", types.void) if otherwise is None else constant(otherwise)
            called = function
        given = [self.expression(each) for each in node.args]
        passed = ", ".join(bare(text) for text, _ in given)
        if called in _MATHEMATICS:
            if called in _WHOLE:
                return f"(int64_t){_MATHEMATICS[called]}({passed})", types.int64
            return f"{_MATHEMATICS[called]}({passed})", types.float64
        if not isinstance(called, Dispatcher | Kernel):
            self.refuse(node)
        name, returned = self.printer.function(called, [kind for _, kind in given])
        return f"{name}({passed})", returned

    def _kernel(self, chosen: ast.Call, node: ast.Call) -> Expression:
        """A call of ``kernel(m.kernels, WHICH)`` or ``kernel(of_body(m, b), WHICH)``."""
        if self._object(chosen.func) is not tables.kernel:
            self.refuse(node)
        of, which = chosen.args
        given = [self.expression(each) for each in node.args]
        passed = [bare(text) for text, _ in given]
        name, returned, by_body = self.printer.chosen(self._object(which), [kind for _, kind in given])
        if by_body:
            assert isinstance(of, ast.Call)
            m, b = (self.expression(each)[0] for each in of.args)
            passed.insert(0, f"{m}->bodies[{b} * {_BODY_COLUMNS} + {tables.KIND}]")
        return f"{name}({', '.join(passed)})", returned

    def _shifted(self, node: ast.Call) -> Expression:
        (text, kind), (k, _) = (self.expression(each) for each in node.args)
        return f"({text} + {k})", kind

    def _apart(self, node: ast.Call) -> Expression:
        return "", types.void

    def _absolute(self, node: ast.Call) -> Expression:
        text, kind = self.expression(node.args[0])
        of = {types.float64: "fabs", types.int64: "llabs", types.complex128: "cabs"}[kind]
        return f"{of}({bare(text)})", types.int64 if kind == types.int64 else types.float64

    def _to_whole(self, node: ast.Call) -> Expression:
        return f"(int64_t){self.expression(node.args[0])[0]}", types.int64

    def _to_float(self, node: ast.Call) -> Expression:
        return f"(double){self.expression(node.args[0])[0]}", types.float64

    # ---- names ------------------------------------------------------------------------------------------------

    def _is_static(self, node: ast.expr) -> bool:
        """True if an attribute is that of a module."""
        while isinstance(node, ast.Attribute):
            node = node.value
        return isinstance(node, ast.Name) and isinstance(self.known.get(node.id), ModuleType)

    def _object(self, node: ast.expr) -> Any:
        """Object of a name of the function's module, or of an attribute of a module."""
        if isinstance(node, ast.Name):
            if node.id not in self.known:
                self.refuse(node)
            return self.known[node.id]
        if isinstance(node, ast.Attribute):
            return getattr(self._object(node.value), node.attr)
        self.refuse(node)

    def refuse(self, node: ast.AST) -> NoReturn:
        code = self.function.__code__
        line = code.co_firstlineno + getattr(node, "lineno", 1) - 1
        raise NotImplementedError(f"{code.co_filename}:{line}: not printed in C: {ast.unparse(node)}")


_BODY_COLUMNS = tables.MECHANISM.parts["bodies"].width
_SPECIAL: Mapping[Any, Callable[[Expressions, ast.Call], Expression]] = {
    tables.apart: Expressions._apart, tables.shifted: Expressions._shifted, abs: Expressions._absolute,
    int: Expressions._to_whole, float: Expressions._to_float,
}  # fmt: skip


def _names_of(function: Any) -> dict[str, Any]:
    """Objects of the global and enclosing names of a function."""
    inner = dict(zip(function.__code__.co_freevars, function.__closure__ or (), strict=True))
    builtins = {each.__name__: each for each in (abs, int, float, range)}
    return {**builtins, **function.__globals__, **{name: cell.cell_contents for name, cell in inner.items()}}
