"""Expressions of compiled functions as C, with their types; the subset is described in :mod:`.c_printer`."""

from __future__ import annotations

import ast
import builtins
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from types import ModuleType
from typing import Any, NoReturn

from numba import types
from numba.core.registry import cpu_target

from kaneflex.derive.printers.c_types import WIDTH, Expression, Square, bare, constant, grouped, parts_of, safe, wider

OPERATORS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}
_COMPARED = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}
_MATHEMATICS = {getattr(math, name): name for name in (
    "acos acosh asin asinh atan atan2 atanh cbrt ceil copysign cos cosh erf erfc exp exp2 expm1 fabs floor fmod hypot "
    "ldexp log log10 log1p log2 pow sin sinh sqrt tan tanh trunc"
).split() if hasattr(math, name)}  # fmt: skip
_WHOLE = (math.ceil, math.floor, math.trunc)
"""Functions that return an int in Python."""


class Expressions:
    """Expressions of one function in C.

    Attributes
    ----------
    printer : Printer
        Prints the functions that are called.
    arguments, variables : dict of str
        Types by name.
    read : set of str
        Names that are read.
    inline : bool
        True for a function that is copied into its callers.
    """

    def __init__(self, printer: Any, function: Any, tree: ast.FunctionDef, given: Sequence[Any]) -> None:
        self.printer, self.function, self.tree, self.inline = printer, function, tree, False
        if tree.args.kwonlyargs or tree.args.vararg or tree.args.kwarg or len(tree.args.args) != len(given):
            self.refuse(tree.args, "arguments that are not given by their places")
        self.arguments = dict(zip((each.arg for each in tree.args.args), given, strict=True))
        self.variables: dict[str, Any] = {}
        self.read: set[str] = set()
        names = [node for node in ast.walk(tree) if isinstance(node, ast.Name)]
        self.names = {*self.arguments, *(node.id for node in names)}
        self.stores = Counter(node.id for node in names if isinstance(node.ctx, ast.Store))
        self.loads = Counter(node.id for node in names if isinstance(node.ctx, ast.Load))
        inner = dict(zip(function.__code__.co_freevars, function.__closure__ or (), strict=True))
        self._known = {**vars(builtins), **function.__globals__, **{name: inner[name].cell_contents for name in inner}}

    def named(self, name: str) -> str:
        """C name of an argument or variable."""
        return safe(name, self.printer.taken) if name == safe(name) else safe(name, self.printer.taken | self.names)

    def expression(self, node: ast.expr) -> Expression:
        """Text and type."""
        method = getattr(self, f"_of_{type(node).__name__}", None)
        if method is None:
            self.refuse(node)
        return method(node)

    def expressions(self, nodes: Sequence[ast.expr]) -> tuple[list[str], list[Any]]:
        """Texts without outer parentheses, and types."""
        found = [self.expression(node) for node in nodes]
        return [bare(text) for text, _ in found], [kind for _, kind in found]

    def condition(self, node: ast.expr) -> str:
        text, kind = self.expression(node)
        return bare(text) if kind == types.boolean else f"{text} != 0"

    def wider(self, node: ast.AST, one: Any, other: Any) -> Any:
        """The type that holds both."""
        try:
            return wider(one, other)
        except ValueError:
            self.refuse(node, f"{one} beside {other}")

    def _of_Constant(self, node: ast.Constant) -> Expression:
        return self._static(node, node.value)

    def _of_Name(self, node: ast.Name) -> Expression:
        kind = self.arguments.get(node.id, self.variables.get(node.id))
        if kind is not None:
            self.read.add(node.id)
            return self.named(node.id), kind
        return self._static(node, self.object_of(node))

    def _of_Attribute(self, node: ast.Attribute) -> Expression:
        if self._is_static(node):
            return self._static(node, self.object_of(node))
        text, kind = self.expression(node.value)
        if hasattr(kind, "parts"):
            return f"{text}->{safe(node.attr)}", kind.parts[node.attr]
        if isinstance(kind, types.BaseNamedTuple):
            return f"{text}.{safe(node.attr)}", kind.types[kind.fields.index(node.attr)]
        if kind not in WIDTH[2:] or node.attr not in ("real", "imag"):
            self.refuse(node)
        if kind == types.complex128:
            return f"c{node.attr}({bare(text)})", types.float64
        return (text if node.attr == "real" else "0.0"), kind

    def _static(self, node: ast.expr, value: Any) -> Expression:
        try:
            return constant(value)
        except TypeError:
            self.refuse(node)

    def _of_Subscript(self, node: ast.Subscript) -> Expression:
        text, kind = self.expression(node.value)
        if isinstance(node.slice, ast.Slice):
            self.refuse(node)
        if isinstance(kind, types.BaseTuple):
            return self._part(node, text, kind)
        places = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        index = [self._whole(place) for place in places]
        dtype, width = getattr(kind, "dtype", types.int64), getattr(kind, "width", None)
        if len(index) == 1 and hasattr(kind, "d"):
            return f"{text}[{bare(index[0])}]", types.UniTuple(dtype, kind.d)
        if len(index) == 1 and (isinstance(kind, types.CPointer) or width):
            return f"{text}[{bare(index[0])}]", dtype
        if len(index) == 2 and isinstance(kind, Square):
            return f"{text}[{bare(index[0])}][{bare(index[1])}]", types.float64
        if len(index) == 2 and width:
            return f"{text}[{index[0]} * {width} + {index[1]}]", dtype
        self.refuse(node)

    def _part(self, node: ast.Subscript, text: str, kind: Any) -> Expression:
        """Number of a tuple, whose place is a constant, or a variable in a tuple of numbers of one type."""
        if isinstance(node.slice, ast.Constant) and node.slice.value in range(len(kind.types)):
            name, of = parts_of(kind)[node.slice.value]
            return f"{text}.{name}", of
        constant = isinstance(node.slice, ast.Constant)
        if constant or not (isinstance(kind, types.UniTuple) and isinstance(node.value, ast.Name)):
            self.refuse(node)
        pointer = self.printer.declared(types.CPointer(kind.dtype))
        return f"((const {pointer})&{text})[{bare(self._whole(node.slice))}]", kind.dtype

    def _of_Tuple(self, node: ast.Tuple) -> Expression:
        texts, kinds = self.expressions(node.elts)
        return self._record(types.Tuple(kinds), texts)

    def _record(self, of: Any, texts: Sequence[str]) -> Expression:
        return f"({self.printer.declared(of)}){{{', '.join(texts)}}}", of

    def _whole(self, node: ast.expr) -> str:
        """An integer, even if its variable is a floating-point one elsewhere in the function."""
        text, kind = self.expression(node)
        if kind not in WIDTH[:3]:
            self.refuse(node)
        return f"(int64_t){text}" if kind == types.float64 else text

    def _of_UnaryOp(self, node: ast.UnaryOp) -> Expression:
        if isinstance(node.op, ast.Not):
            return f"(!{grouped(self.condition(node.operand))})", types.boolean
        text, kind = self.expression(node.operand)
        if not isinstance(node.op, ast.USub) or kind not in WIDTH[1:]:
            self.refuse(node)
        return f"(-{text})", kind

    def _of_BinOp(self, node: ast.BinOp) -> Expression:
        (left, one), (right, other) = self.expression(node.left), self.expression(node.right)
        if one not in WIDTH or other not in WIDTH:
            self.refuse(node)
        kind = max(wider(one, other), types.int64, key=WIDTH.index)
        if isinstance(node.op, ast.Pow):
            return self._power(node, left, right, kind)
        if isinstance(node.op, ast.Mod | ast.FloorDiv) and kind == types.int64:
            called = "whole_remainder_of" if isinstance(node.op, ast.Mod) else "quotient_of"
            return f"{called}({bare(left)}, {bare(right)})", kind
        if isinstance(node.op, ast.Mod) and kind == types.float64:
            return f"remainder_of({bare(left)}, {bare(right)})", kind
        if type(node.op) not in OPERATORS:
            self.refuse(node)
        if isinstance(node.op, ast.Div) and kind == types.int64:
            left, kind = f"(double){left}", types.float64
        return f"({left} {OPERATORS[type(node.op)]} {right})", kind

    def _power(self, node: ast.BinOp, left: str, right: str, kind: Any) -> Expression:
        if isinstance(node.right, ast.Constant) and node.right.value == 2 and isinstance(node.left, ast.Name):
            return f"({left} * {left})", kind
        if kind != types.float64:
            self.refuse(node, "a power of whole or complex numbers")
        return f"pow({bare(left)}, {bare(right)})", types.float64

    def _of_Compare(self, node: ast.Compare) -> Expression:
        found = [self.expression(each) for each in (node.left, *node.comparators)]
        ordered = not all(isinstance(of, ast.Eq | ast.NotEq) for of in node.ops)
        known = all(kind in WIDTH[: 4 - ordered] for _, kind in found)
        if not known or not all(type(of) in _COMPARED for of in node.ops):
            self.refuse(node)
        pairs = [f"{found[k][0]} {_COMPARED[type(of)]} {found[k + 1][0]}" for k, of in enumerate(node.ops)]
        return f"({' && '.join(pairs)})", types.boolean

    def _of_BoolOp(self, node: ast.BoolOp) -> Expression:
        between = " && " if isinstance(node.op, ast.And) else " || "
        return f"({between.join(grouped(self.condition(each)) for each in node.values)})", types.boolean

    def _of_IfExp(self, node: ast.IfExp) -> Expression:
        (one, kind), (other, of) = self.expression(node.body), self.expression(node.orelse)
        return f"({grouped(self.condition(node.test))} ? {one} : {other})", self.wider(node, kind, of)

    # ---- calls ------------------------------------------------------------------------------------------------

    def _of_Call(self, node: ast.Call) -> Expression:
        if node.keywords:
            self.refuse(node)
        if isinstance(node.func, ast.Call):
            return self._kernel(node.func, node)
        called = self.object_of(node.func)
        special = _SPECIAL.get(getattr(called, "__name__", "")) if _is_special(called) else None
        if special is not None:
            return special(self, node)
        if called in _MATHEMATICS:
            return self._mathematics(called, node)
        read = set(self.read)
        texts, kinds = self.expressions(node.args)
        if isinstance(called, type) and issubclass(called, tuple):
            return self._record(types.NamedTuple(kinds, called), texts)
        if hasattr(called, "where"):
            function, mechanisms, otherwise = called.where
            if kinds[0] not in mechanisms:  # not used by this mechanism, nor is what it is given
                self.read = read
                return ("", types.void) if otherwise is None else self._stand_in(otherwise)
            called = function
        called = called.choose(kinds) if hasattr(called, "choose") else called
        name, returned = self.printer.function(called if hasattr(called, "py_func") else self.refuse(node), kinds)
        return f"{name}({', '.join(texts)})", returned

    def _stand_in(self, value: Any) -> Expression:
        """A number, or several."""
        if not isinstance(value, tuple):
            return constant(value)
        texts, kinds = zip(*map(constant, value), strict=True)
        return self._record(types.Tuple(kinds), texts)

    def _mathematics(self, called: Callable[..., Any], node: ast.Call) -> Expression:
        texts, kinds = self.expressions(node.args)
        if not all(kind in WIDTH[:3] for kind in kinds):
            self.refuse(node)
        text = f"{_MATHEMATICS[called]}({', '.join(texts)})"
        return (f"(int64_t){text}", types.int64) if called in _WHOLE else (text, types.float64)

    def _kernel(self, chosen: ast.Call, node: ast.Call) -> Expression:
        """A call of ``kernel(table, WHICH)``."""
        if getattr(self.object_of(chosen.func), "__name__", "") != "kernel":
            self.refuse(node)
        texts, kinds = self.expressions(node.args)
        which = self.object_of(chosen.args[1])
        if not self.printer.kernels:
            table = self.expression(chosen.args[0])[0]
            given = ", ".join(map(self.printer.declared, kinds))
            return f"((void (*)({given})){table}[{which}])({', '.join(texts)})", types.void
        name, returned = self.printer.function(self.printer.kernels[which], kinds)
        return f"{name}({', '.join(texts)})", returned

    def _shifted(self, node: ast.Call) -> Expression:
        (text, kind), (k, _) = (self.expression(each) for each in node.args)
        return f"({text} + {k})", kind

    def _mark(self, node: ast.Call) -> Expression:
        self.inline = self.object_of(node.func).__name__ == "inline"
        return "", types.void

    def _addressed(self, node: ast.Call) -> Expression:
        """Numbers or vectors that begin at an address; numba says of which type they are."""
        texts, kinds = self.expressions(node.args)
        of = self.object_of(node.func)._defn(cpu_target.typing_context, *kinds)[0].return_type
        return f"(({self.printer.declared(of)}){grouped(texts[-1])})", of

    def _count(self, node: ast.Call) -> Expression:
        read = set(self.read)
        kind = self.expression(node.args[0])[1]
        self.read = read  # only its type counts
        found = (getattr(kind, name) for name in ("d", "count") if hasattr(kind, name))
        return str(next(found, None) or self.refuse(node)), types.int64

    def _absolute(self, node: ast.Call) -> Expression:
        text, kind = self.expression(node.args[0])
        of = {types.float64: "fabs", types.int64: "llabs", types.complex128: "cabs"}.get(kind) or self.refuse(node)
        return f"{of}({bare(text)})", types.int64 if kind == types.int64 else types.float64

    def _extreme(self, node: ast.Call) -> Expression:
        """Least or largest of numbers that are not NaN, as laws of scenes have them."""
        texts, kinds = self.expressions(node.args)
        if len(texts) < 2 or set(kinds) != {types.float64}:
            self.refuse(node)
        nested = f"f{self.object_of(node.func).__name__}(" * (len(texts) - 1) + bare(texts[0])
        return nested + "".join(f", {bare(text)})" for text in texts[1:]), types.float64

    def _converted(self, node: ast.Call) -> Expression:
        texts, kinds = self.expressions(node.args)
        name = self.object_of(node.func).__name__
        if not texts or len(texts) > 1 + (name == "complex") or not all(kind in WIDTH[:3] for kind in kinds):
            self.refuse(node)
        if name == "complex":
            return f"CMPLX({', '.join([*texts, '0.0'][:2])})", types.complex128
        kind = types.int64 if name == "int" else types.float64
        return f"({self.printer.declared(kind)}){grouped(texts[0])}", kind

    # ---- names ------------------------------------------------------------------------------------------------

    def _is_static(self, node: ast.expr) -> bool:
        """True if an attribute is that of a module."""
        while isinstance(node, ast.Attribute):
            node = node.value
        return isinstance(node, ast.Name) and isinstance(self._known.get(node.id), ModuleType)

    def object_of(self, node: ast.expr) -> Any:
        """Object of a name of the function's module, or of an attribute of a module."""
        if isinstance(node, ast.Name) and node.id in self._known:
            return self._known[node.id]
        if not (isinstance(node, ast.Attribute) and self._is_static(node)):
            self.refuse(node)
        return getattr(self.object_of(node.value), node.attr)

    def refuse(self, node: ast.AST, reason: str = "") -> NoReturn:
        code = self.function.__code__
        line = code.co_firstlineno + getattr(node, "lineno", 1) - 1
        text = ast.unparse(node).partition("\n")[0]
        raise NotImplementedError(
            f"{code.co_filename}:{line}: function {code.co_name}: not printed in C: {text}"
            f"{f' ({reason})' * bool(reason)}"
        )


def _is_special(called: Any) -> bool:
    """True for an intrinsic of numba's, and a function of Python's own."""
    return hasattr(called, "_defn") or getattr(called, "__module__", "") == "builtins"


_SPECIAL: Mapping[str, Callable[[Expressions, ast.Call], Expression]] = {
    "no_inline": Expressions._mark, "no_inline_vectorised": Expressions._mark, "inline": Expressions._mark,
    "shifted": Expressions._shifted, "after": Expressions._shifted, "numbers_of": Expressions._addressed,
    "vectors": Expressions._addressed, "twists": Expressions._addressed,
    "width": Expressions._count, "abs": Expressions._absolute,
    "int": Expressions._converted, "float": Expressions._converted, "complex": Expressions._converted,
    "min": Expressions._extreme, "max": Expressions._extreme,
}  # fmt: skip
