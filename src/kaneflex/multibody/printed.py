"""Compiled functions as C11, printed from the texts that numba compiles and the types of their arguments.

The engine's functions use a small subset of Python: integers and floating-point numbers, addresses, loops, branches and
calls. Only this subset is printed; anything else is refused with its location. So numba and C share one text of every
law.

A function is printed once for each list of argument types, as numba compiles it; the type of a variable is the widest
type assigned to it.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Sequence
from typing import Any

from numba import types
from numba.core.dispatcher import Dispatcher

from kaneflex.generated.packs import unpacked
from kaneflex.multibody import tables
from kaneflex.multibody.c_text import NAMES, WIDTH, declared, safe, type_name, wider
from kaneflex.multibody.printed_expressions import OPERATORS, Expressions
from kaneflex.support.c_language import RESERVED
from kaneflex.support.escaping import c_comment
from kaneflex.support.machine_code import Kernel

REMAINDER = """/* What is left of a division, with the sign of what it is divided by. */
static inline double remainder_of(double x, double y)
{
    const double left = fmod(x, y);
    return left != 0.0 && (left < 0.0) != (y < 0.0) ? left + y : left;
}
"""
_LETTERS = {types.boolean: "b", types.int64: "i", types.float64: "d", types.complex128: "z"}


class Printer:
    """Prints functions with all that they call, each before its callers.

    Parameters
    ----------
    kernels : sequence
        A structure's kernels and those of every kind of bodies, in the order of :class:`tables.Handed`'s ``kernels``.
    own : str
        What names begin with that whoever prints gives others.
    """

    def __init__(self, kernels: Sequence[Dispatcher], own: str = "") -> None:
        self.kernels, self.own = kernels, own
        self.texts: list[str] = []
        self.pairs: dict[Any, str] = {}
        self._made: dict[tuple[Any, tuple], tuple[str, Any]] = {}
        self._taken: set[str] = set(RESERVED)
        self._choices: dict[tuple[int, tuple], tuple[str, Any]] = {}

    def function(
        self, dispatcher: Dispatcher | Kernel, given: Sequence[Any], scope: str = "static "
    ) -> tuple[str, Any]:
        """Name and returned type of a function of arguments of these types, printed if it was not yet."""
        key = dispatcher.py_func, tuple(given)
        if key not in self._made:
            name = self._name_of(dispatcher.py_func)
            written = _Written(self, dispatcher.py_func, name, given)
            self._made[key] = name, written.returned
            self.texts.append(written.text(scope))
        return self._made[key]

    def _name_of(self, function: Any) -> str:
        room = function.__module__.rpartition(".")[2]
        name = f"{room}_{function.__name__.lstrip('_')}"
        if self.own and name.startswith(f"{self.own}_"):
            name = f"printed_{name}"
        free = (each for k in range(1, 1000) if (each := name if k == 1 else f"{name}_{k}") not in self._taken)
        found = next(free)
        self._taken.add(found)
        return found

    def pair(self, of: Any) -> str:
        """Name of the structure that several numbers are returned as."""
        if of not in self.pairs:
            self.pairs[of] = f"several_{''.join(_LETTERS[kind] for kind in of.types)}"
            self._taken.add(self.pairs[of])
        return self.pairs[of]

    def structures(self) -> str:
        """Definitions of these structures."""
        return "\n".join(
            f"typedef struct {{ {' '.join(f'{NAMES[kind]} _{k};' for k, kind in enumerate(of.types))} }} {name};"
            for of, name in self.pairs.items()
        )

    def chosen(self, which: int, given: Sequence[Any]) -> tuple[str, Any, bool]:
        """Call of a structure's kernel, or of one of a body kind, whose number is the first argument then."""
        own = len(tables.STRUCTURE_KERNELS)
        if which < own:
            return *self.function(self.kernels[which], given), False
        key = which, tuple(given)
        if key not in self._choices:
            self._choices[key] = self._choice(which, given)
        return *self._choices[key], True

    def _choice(self, which: int, given: Sequence[Any]) -> tuple[str, Any]:
        each = len(tables.BODY_KERNELS)
        found = [self.function(self.kernels[k], given) for k in range(which, len(self.kernels), each)]
        returned, name = found[0][1], f"kernel_{list(tables.BODY_KERNELS)[which - len(tables.STRUCTURE_KERNELS)]}"
        arguments = ", ".join(f"{declared(kind, f'a{k}')}" for k, kind in enumerate(given))
        passed = ", ".join(f"a{k}" for k in range(len(given)))
        lines = [f"static {self.declared_type(returned)} {name}(int64_t kind, {arguments})", "{", "    switch (kind) {"]
        for k, (of, _) in enumerate(found):
            lines.append(f"    case {each * k}:" if k + 1 < len(found) else "    default:")
            call = f"{of}({passed});"
            lines += [f"        {call}", "        break;"] if returned == types.void else [f"        return {call}"]
        self.texts.append("\n".join([*lines, "    }", "}\n"]))
        return name, returned

    def declared_type(self, of: Any) -> str:
        return self.pair(of) if isinstance(of, types.BaseTuple) else type_name(of)


class _Written(Expressions):
    """One function, for arguments of certain types."""

    def __init__(self, printer: Printer, function: Any, name: str, given: Sequence[Any]) -> None:
        source = textwrap.dedent(inspect.getsource(function))
        self.tree = next(node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.FunctionDef))
        super().__init__(printer, function, dict(zip((each.arg for each in self.tree.args.args), given, strict=True)))
        self.name, self.returned = name, types.void
        self.lines: list[str] = []
        self.depth = self.spare = 0
        before = None
        while before != (self.variables, self.returned):  # one may be wider than where it was assigned first
            before = dict(self.variables), self.returned
            self.lines, self.spare = [], 0
            self._block(self.tree.body, 1)

    def text(self, scope: str) -> str:
        """Its definition."""
        arguments = ", ".join(declared(kind, safe(name)) for name, kind in self.arguments.items()) or "void"
        lines = [f"    {self._declaration(kind, safe(name))};" for name, kind in self.variables.items()]
        unread = [name for name in (*self.arguments, *self.variables) if name not in self.read]
        lines += [f"    (void){safe(name)};" for name in unread]
        said = ast.get_docstring(self.tree)
        about = f"{c_comment(said)}\n" if said else ""
        kind = self.printer.declared_type(self.returned)
        return f"{about}{scope}{kind} {self.name}({arguments})\n{{\n" + "\n".join([*lines, *self.lines]) + "\n}\n"

    def _declaration(self, kind: Any, name: str) -> str:
        if isinstance(kind, types.BaseTuple):
            return f"{self.printer.pair(kind)} {name}"
        return f"{declared(kind, name)} = 0"

    # ---- statements -------------------------------------------------------------------------------------------

    def _block(self, statements: Sequence[ast.stmt], depth: int) -> None:
        for statement in statements:
            self.depth = depth
            method = getattr(self, f"_{type(statement).__name__}", None)
            if method is None:
                self.refuse(statement)
            method(statement)

    def _line(self, text: str) -> None:
        self.lines.append("    " * self.depth + text)

    def _within(self, statements: Sequence[ast.stmt]) -> None:
        depth = self.depth
        self._block(statements, depth + 1)
        self.depth = depth

    def _Expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Constant):  # its documentation
            return
        text, _ = self.expression(node.value)
        if text:
            self._line(f"{text};")

    def _Pass(self, node: ast.Pass) -> None:
        pass

    def _Assign(self, node: ast.Assign) -> None:
        for target in node.targets:
            if isinstance(target, ast.Tuple):
                self._parallel(target.elts, node)
                return
        text, kind = self.expression(node.value)
        for target in node.targets:
            self._take(target, kind)
        self._line(f"{' = '.join(self._place(target) for target in node.targets)} = {text};")

    def _parallel(self, targets: Sequence[ast.expr], node: ast.Assign) -> None:
        """Several at once: in sequence if no value uses a target assigned before it, else by copies."""
        if len(node.targets) > 1:
            self.refuse(node)
        value = node.value
        if isinstance(value, ast.Call) and isinstance(value.func, ast.Name) and self._object(value.func) is unpacked:
            self._read(targets, *value.args)
            return
        if not isinstance(node.value, ast.Tuple):
            text, kind = self.expression(node.value)
            if not isinstance(kind, types.BaseTuple):
                self.refuse(node)
            found = self._spare(kind)
            self._line(f"{found} = {text};")
            for k, (target, of) in enumerate(zip(targets, kind.types, strict=True)):
                self._take(target, of)
                self._line(f"{self._place(target)} = {found}._{k};")
            return
        values = [self.expression(value) for value in node.value.elts]
        copied = self._meet(targets, node.value.elts)
        if copied:
            names = [self._spare(kind) for _, kind in values]
            for name, (text, _) in zip(names, values, strict=True):
                self._line(f"{name} = {text};")
            values = [(name, kind) for name, (_, kind) in zip(names, values, strict=True)]
        for target, (text, kind) in zip(targets, values, strict=True):
            self._take(target, kind)
            self._line(f"{self._place(target)} = {text};")

    def _read(self, targets: Sequence[ast.expr], array: ast.expr, _: ast.expr, *start: ast.expr) -> None:
        """Elements of an array one by one, except those named ``_``."""
        for k, target in enumerate(targets):
            if not (isinstance(target, ast.Name) and target.id == "_"):
                place = ast.BinOp(start[0], ast.Add(), ast.Constant(k)) if start else ast.Constant(k)
                text, kind = self.expression(ast.Subscript(array, place))
                self._take(target, kind)
                self._line(f"{self._place(target)} = {text};")

    @staticmethod
    def _meet(targets: Sequence[ast.expr], values: Sequence[ast.expr]) -> bool:
        """True if a value may use a target that is assigned before it."""
        for k, target in enumerate(targets):
            later = [node for value in values[k + 1 :] for node in ast.walk(value)]
            if isinstance(target, ast.Name):
                if any(isinstance(node, ast.Name) and node.id == target.id for node in later):
                    return True
            elif any(isinstance(node, (ast.Subscript, ast.Call)) for node in later):
                return True
        return False

    def _spare(self, kind: Any) -> str:
        self.spare += 1
        name = f"t{self.spare}"
        self.variables[name] = kind
        self.read.add(name)
        return name

    def _take(self, target: ast.expr, kind: Any) -> None:
        """Widen a variable's type to this one."""
        if isinstance(target, ast.Name):
            known = self.variables if target.id not in self.arguments else self.arguments
            known[target.id] = wider(known.get(target.id, kind), kind) if kind in WIDTH else kind
        elif not isinstance(target, ast.Subscript):
            self.refuse(target)

    def _place(self, target: ast.expr) -> str:
        if isinstance(target, ast.Name):
            return safe(target.id)
        return self.expression(target)[0]

    def _AugAssign(self, node: ast.AugAssign) -> None:
        text, kind = self.expression(node.value)
        if isinstance(node.target, ast.Name):
            self._take(node.target, kind)
        operator = OPERATORS.get(type(node.op))
        if operator is None or (isinstance(node.op, ast.Div) and kind == types.int64):
            self.refuse(node)
        self._line(f"{self._place(node.target)} {operator}= {text};")

    def _If(self, node: ast.If) -> None:
        self._line(f"if ({self.condition(node.test)}) {{")
        self._within(node.body)
        if node.orelse:
            self._line("} else {")
            self._within(node.orelse)
        self._line("}")

    def _While(self, node: ast.While) -> None:
        if node.orelse:
            self.refuse(node)
        self._line(f"while ({self.condition(node.test)}) {{")
        self._within(node.body)
        self._line("}")

    def _For(self, node: ast.For) -> None:
        """Over a range, whose bounds count once; the variable keeps its last value."""
        call, target = node.iter, node.target
        if not (isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "range"):
            self.refuse(node)
        if not isinstance(target, ast.Name) or node.orelse:
            self.refuse(node)
        bounds = [self.whole(each) for each in call.args]
        start, stop = ("0", bounds[0]) if len(bounds) == 1 else (bounds[0], bounds[1])
        step = ast.literal_eval(call.args[2]) if len(bounds) == 3 else 1
        self._take(target, types.int64)
        self.spare += 1
        k, end = f"k{self.spare}", f"end{self.spare}"
        on = f"++{k}" if step == 1 else f"{k} += {step}"
        self._line(f"for (int64_t {k} = {start}, {end} = {stop}; {k} {'<' if step > 0 else '>'} {end}; {on}) {{")
        name = safe(target.id)
        self.lines.append("    " * (self.depth + 1) + f"{name} = {k};")
        self._within(node.body)
        self._line("}")

    def _Break(self, node: ast.Break) -> None:
        self._line("break;")

    def _Continue(self, node: ast.Continue) -> None:
        self._line("continue;")

    def _Return(self, node: ast.Return) -> None:
        if node.value is None:
            self._line("return;")
            return
        if isinstance(node.value, ast.Tuple):
            values = [self.expression(value) for value in node.value.elts]
            self.returned = types.Tuple([kind for _, kind in values])
            self._line(f"return ({self.printer.pair(self.returned)}){{{', '.join(text for text, _ in values)}}};")
            return
        text, kind = self.expression(node.value)
        self.returned = kind if self.returned == types.void else wider(self.returned, kind)
        self._line(f"return {text};")
