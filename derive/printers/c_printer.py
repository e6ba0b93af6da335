"""Compiled functions as C11, printed from the texts that numba compiles and the types of their arguments.

Printed are the engine's functions, which are written by hand, and the kernels that :mod:`.numba_printer` prints: numba
and C share one text of every law. A function is printed once for each list of argument types, as numba compiles it;
the type of a variable is the widest type assigned to it. The subset of Python:

- Values: bool, int, float and complex; tuples and named tuples of values; addresses of numbers, ``w[k]``, and
  ``shifted(w, k)`` or ``after(w, k)``. Of other types those with ``parts`` (a record, by its address), ``width`` (whole
  numbers in rows, ``f[k]``, ``f[row, k]``) or ``d`` (vectors of d numbers: ``v[j]`` is a tuple).
- Statements: assignment to names and places, to several at once, and in a chain; ``+= -= *= /=``; ``if``; ``while``;
  ``for`` over a ``range``, whose bounds count once; ``break``, ``continue``, and ``return`` anywhere.
- Expressions: arithmetic, ``//`` and ``%`` with Python's signs, ``**`` of floats, comparisons of real numbers, ``and or
  not``, ``a if b else c``; ``math``'s functions; ``abs min max int float complex``; modules' numbers.
- Calls of compiled functions by position. Of several functions of one name (an object with ``choose``) that of the
  arguments' types; ``kernel(table, WHICH)(...)`` calls one of the printer's kernels.
- Intrinsics ``vectors`` and ``numbers_of``, which give addresses another type; ``width`` of vectors. Branches of
  another ``width(...) == D`` are left out.
- The marks ``no_inline``, ``no_inline_vectorised`` and ``inline``.

C leaves the order open in which the operands of an expression are computed: none may store what another one reads.
All else raises NotImplementedError with the function, the line and the construct.
"""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from collections.abc import Iterator, Sequence
from typing import Any

from numba import types

from kaneflex.derive.printers.c_expressions import OPERATORS, Expressions
from kaneflex.derive.printers.c_types import WIDTH, Structures, bare, parts_of
from kaneflex.support.c_language import c_comment

_QUOTIENT = """/* Quotient, rounded down. */
static inline int64_t quotient_of(int64_t x, int64_t y)
{
    return x / y - (x % y != 0 && (x < 0) != (y < 0));
}
"""
_REMAINDER = """/* Remainder of a division, with the sign of the divisor. */
static inline KIND NAME(KIND x, KIND y)
{
    const KIND left = DIVIDED;
    return left != 0 && (left < 0) != (y < 0) ? left + y : left;
}
"""
_ARITHMETIC = {"quotient_of": _QUOTIENT} | {
    name: _REMAINDER.replace("KIND", kind).replace("NAME", name).replace("DIVIDED", divided)
    for name, kind, divided in (("remainder_of", "double", "fmod(x, y)"), ("whole_remainder_of", "int64_t", "x % y"))
}


class Printer:
    """Prints functions with all that they call, each before its callers.

    Parameters
    ----------
    kernels : sequence
        For each number WHICH the function that ``kernel(table, WHICH)`` is; where there are none, the table has the
        addresses of functions with C's conventions.
    own : str
        Prefix of names that are the caller's.
    """

    def __init__(self, kernels: Sequence[Any] = (), own: str = "") -> None:
        self.kernels, self.own = kernels, own
        self.texts: dict[str, str] = {}
        self.asked: set[str] = set()
        self.functions: dict[tuple[Any, tuple], tuple[str, Any]] = {}
        self.taken: set[str] = set()
        self.structures = Structures(self.taken)
        self.declared = self.structures.declared
        self._open: list[Any] = []

    def text(self) -> str:
        """Definitions of all that was asked for, for <complex.h>, <math.h>, <stdbool.h>, <stdint.h> and <stdlib.h>.

        Functions of narrower types, which were printed before a variable's type was known, are left out.
        """
        wanted, found = set(self.asked), list[str]()
        for name, text in reversed((_ARITHMETIC | self.texts).items()):  # callers come after what they call
            if name in wanted:
                wanted.update(re.findall(r"\w+(?=\()", text))
                found.append(text)
        return "\n".join([*self.structures.definitions.values(), *reversed(found)])

    def function(self, function: Any, given: Sequence[Any], scope: str = "static ", name: str = "") -> tuple[str, Any]:
        """Name and returned type of a function of arguments of these types, printed if it was not yet."""
        function = getattr(function, "py_func", function)
        key = function, tuple(given)
        if key not in self.functions:
            written = _Written(self, function, given)
            if key in self._open:
                written.refuse(written.tree, "it calls itself")
            self._open.append(key)
            written.print()
            self._open.remove(key)
            name = name or self._name_of(function)
            self.taken.add(name)
            self.functions[key] = name, written.returned
            self.texts[name] = written.text(name, scope)
        self.asked |= set() if self._open else {self.functions[key][0]}
        return self.functions[key]

    def _name_of(self, function: Any) -> str:
        name = f"{function.__module__.rpartition('.')[2]}_{function.__name__.lstrip('_')}"
        if self.own and name.startswith(f"{self.own}_"):
            name = f"printed_{name}"
        return next(each for k in range(1, 1000) if (each := name if k == 1 else f"{name}_{k}") not in self.taken)


class _Written(Expressions):
    """One function, for arguments of certain types."""

    def __init__(self, printer: Printer, function: Any, given: Sequence[Any]) -> None:
        source = textwrap.dedent(inspect.getsource(function))
        tree = next(node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.FunctionDef))
        super().__init__(printer, function, tree, given)
        self.returned = types.void
        self.lines: list[str] = []
        self.depth = self.spare = 0

    def print(self) -> None:
        """Print the statements until no variable is wider than where it was assigned first."""
        before = None
        while before != (self.arguments, self.variables, self.returned):
            before = dict(self.arguments), dict(self.variables), self.returned
            self.lines, self.spare, self.local, self.stored = [], 0, set[str](), set(self.arguments)
            self._block(self.tree.body, 1)

    def text(self, name: str, scope: str) -> str:
        """Its definition."""
        arguments = [self.printer.declared(kind, self.named(each)) for each, kind in self.arguments.items()]
        variables = {each: kind for each, kind in self.variables.items() if each not in self.local}
        declared = {self.printer.declared(kind, self.named(each)): kind for each, kind in variables.items()}
        lines = [f"    {each} = {'0' if kind in WIDTH or '*' in each else '{0}'};" for each, kind in declared.items()]
        unread = [each for each in (*self.arguments, *variables) if each not in self.read]
        lines += [f"    (void){self.named(each)};" for each in unread]
        doc = ast.get_docstring(self.tree)
        about = f"{c_comment(doc)}\n" if doc else ""
        head = f"{'static inline ' if scope and self.inline else scope}{self.printer.declared(self.returned, name)}"
        body = "\n".join([*lines, *self.lines])
        return f"{about}{head}({', '.join(arguments) or 'void'})\n{{\n{body}\n}}\n"

    # ---- statements -------------------------------------------------------------------------------------------

    def _block(self, statements: Sequence[ast.stmt], depth: int) -> None:
        for statement in self._reached(statements):
            self.depth = depth
            method = getattr(self, f"_{type(statement).__name__}", None)
            if method is None:
                self.refuse(statement)
            method(statement)

    def _reached(self, statements: Sequence[ast.stmt]) -> Iterator[ast.stmt]:
        """Statements for this dimension: neither the branches of another one, nor what follows a return of this one."""
        for statement in statements:
            holds = self._decided(statement.test) if isinstance(statement, ast.If) else None
            if holds is None:
                yield statement
                continue
            branch = statement.body if holds else statement.orelse
            yield from self._reached(branch)
            if branch and isinstance(branch[-1], ast.Return):
                return

    def _decided(self, test: ast.expr) -> bool | None:
        """Truth of a test that ``width(...) == D`` decides; None of another one."""
        if isinstance(test, ast.BoolOp):
            decisive = isinstance(test.op, ast.Or)
            return decisive if decisive in map(self._decided, test.values) else None
        of = getattr(getattr(test, "left", None), "func", None)
        if not isinstance(of, ast.Name) or of.id != "width":
            return None
        one, _, other = self.condition(test).partition(" == ")
        return one == other

    def _line(self, text: str) -> None:
        self.lines.append("    " * self.depth + text)

    def _within(self, head: str, statements: Sequence[ast.stmt], first: str = "") -> None:
        depth = self.depth
        self._line(f"{head} {{")
        if first:
            self.lines.append("    " * (depth + 1) + first)
        self._block(statements, depth + 1)
        self.depth = depth
        self._line("}")

    def _Expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Constant):  # its documentation
            return
        text, _ = self.expression(node.value)
        if text:
            self._line(f"{text};")

    def _Assign(self, node: ast.Assign) -> None:
        if any(isinstance(target, ast.Tuple) for target in node.targets):
            self._parallel(node.targets[0].elts if len(node.targets) == 1 else self.refuse(node), node)
            return
        self._store(node.targets, *self.expression(node.value), node)

    def _store(self, targets: Sequence[ast.expr], text: str, kind: Any, node: ast.AST) -> None:
        """One value to all targets that are read, each of which must hold it; may declare a variable."""
        targets = [target for target in targets if not isinstance(target, ast.Name) or self.loads[target.id]]
        first = targets[0].id if targets and isinstance(targets[0], ast.Name) else ""
        declares = self.depth == 1 and first in self.read - self.stored
        places = [] if targets or "(" not in text else ["(void)"]
        for target in targets:
            of = self._take(target, kind)
            if of != kind and not (of in WIDTH and kind in WIDTH):
                text = self._as(of, text, kind) if len(targets) == 1 else self.refuse(node)
            if kind in WIDTH and len(targets) > 1 and self.wider(node, of, kind) != of:
                self.refuse(node, "a place for whole numbers in a chain")
            places.append(self._place(target))
        if declares:
            self.local.add(first)
            declared = self.printer.declared(self.variables[first], places[0])
            places[0] = f"const {declared}" if self.stores[first] == 1 and "*" not in declared else declared
        if places:
            self._line(f"{' = '.join(places)} = {bare(text)};".replace("(void) = ", "(void)"))

    def _as(self, of: Any, text: str, kind: Any) -> str:
        """A tuple of numbers as one of wider numbers."""
        tuples = isinstance(of, types.UniTuple) and isinstance(kind, types.UniTuple) and of.count == kind.count
        if not tuples or self.wider(self.tree, of.dtype, kind.dtype) != of.dtype:
            self.refuse(self.tree, f"{kind} stored as {of}")
        value = self._copied(text, kind)
        return f"({self.printer.declared(of)}){{{', '.join(f'{value}.{name}' for name, _ in parts_of(kind))}}}"

    def _parallel(self, targets: Sequence[ast.expr], node: ast.Assign) -> None:
        """Several at once: in sequence if no value uses a target assigned before it, else by copies."""
        if isinstance(node.value, ast.Tuple) and len(node.value.elts) == len(targets):
            values = [self.expression(value) for value in node.value.elts]
            names = {target.id if isinstance(target, ast.Name) else "" for target in targets[:-1]}
            later = [each for value in node.value.elts[1:] for each in ast.walk(value)]
            stored = "" in names and any(isinstance(each, ast.Subscript | ast.Call) for each in later)
            if stored or any(isinstance(each, ast.Name) and each.id in names for each in later):
                values = [(self._copied(*value), value[1]) for value in values]
        else:
            text, whole = self.expression(node.value)
            if not isinstance(whole, types.BaseTuple) or len(whole.types) != len(targets):
                self.refuse(node)
            found = self._copied(text, whole)
            values = [(f"{found}.{name}", kind) for name, kind in parts_of(whole)]
        for target, value in zip(targets, values, strict=True):
            self._store([target], *value, node)

    def _copied(self, text: str, kind: Any) -> str:
        """Name of a variable of its own that has a value."""
        name = self._spare("t")
        if self.depth > 1:
            self.variables[name] = kind
            self.read.add(name)
            self._line(f"{name} = {bare(text)};")
        else:
            declared = self.printer.declared(kind, name)
            self._line(f"{'' if '*' in declared else 'const '}{declared} = {bare(text)};")
        return name

    def _spare(self, stem: str) -> str:
        """A name that the function has not."""
        self.spare += 1
        while f"{stem}{self.spare}" in self.names:
            self.spare += 1
        return f"{stem}{self.spare}"

    def _take(self, target: ast.expr, kind: Any) -> Any:
        """Type of a target, that of a variable widened to this one."""
        if not isinstance(target, ast.Name):
            return self.expression(target)[1] if isinstance(target, ast.Subscript) else self.refuse(target)
        self.stored.add(target.id)
        known = self.variables if target.id not in self.arguments else self.arguments
        known[target.id] = self.wider(target, known.get(target.id, kind), kind)
        return known[target.id]

    def _place(self, target: ast.expr) -> str:
        return self.named(target.id) if isinstance(target, ast.Name) else self.expression(target)[0]

    def _AugAssign(self, node: ast.AugAssign) -> None:
        text, kind = self.expression(node.value)
        operator = OPERATORS.get(type(node.op))
        if operator is None or kind not in WIDTH or (isinstance(node.op, ast.Div) and kind == types.int64):
            self.refuse(node)
        self._take(node.target, kind)
        self._line(f"{self._place(node.target)} {operator}= {bare(text)};")

    def _If(self, node: ast.If, head: str = "if") -> None:
        self._within(f"{head} ({self.condition(node.test)})", node.body)
        if node.orelse:
            self.lines.pop()
        if len(node.orelse) == 1 and isinstance(node.orelse[0], ast.If):
            self._If(node.orelse[0], "} else if")
        elif node.orelse:
            self._within("} else", node.orelse)

    def _While(self, node: ast.While) -> None:
        if node.orelse:
            self.refuse(node)
        self._within(f"while ({self.condition(node.test)})", node.body)

    def _For(self, node: ast.For) -> None:
        """Over a range, whose bounds count once; the variable keeps its last value."""
        call, target = node.iter, node.target
        if not (isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "range"):
            self.refuse(node)
        if not isinstance(target, ast.Name) or node.orelse or call.keywords:
            self.refuse(node)
        bounds = [self._whole(each) for each in call.args]
        start, stop = ("0", bounds[0]) if len(bounds) == 1 else (bounds[0], bounds[1])
        step = int(bounds[2].strip("()")) if len(bounds) == 3 and bounds[2].strip("()-").isdigit() else 1
        if step == 0 or (step == 1 and len(bounds) == 3 and bare(bounds[2]) != "1"):
            self.refuse(node, "the step of a range must be a constant")
        self._take(target, types.int64)
        within = [each.id for line in node.body for each in ast.walk(line) if isinstance(each, ast.Name)]
        own = self.stores[target.id] == 1 and within.count(target.id) == self.loads[target.id]
        k, end = self.named(target.id) if own else self._spare("k"), self._spare("end")
        self.local |= {target.id} if own else set()
        on = f"++{k}" if step == 1 else f"{k} += {step}"
        head = f"for (int64_t {k} = {bare(start)}, {end} = {bare(stop)}; {k} {'<' if step > 0 else '>'} {end}; {on})"
        self._within(head, node.body, "" if own else f"{self.named(target.id)} = {k};")

    def _Break(self, node: ast.Break | ast.Continue) -> None:
        self._line(f"{ast.unparse(node)};")

    _Continue = _Break

    def _Return(self, node: ast.Return) -> None:
        if node.value is None:
            self._line("return;")
            return
        text, kind = self.expression(node.value)
        self.returned = kind if self.returned == types.void else self.wider(node, self.returned, kind)
        self._line(f"return {bare(text)};")
