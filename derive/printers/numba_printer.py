"""Print programs as readable numba kernels. Pure: the text depends on its arguments alone."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from types import MappingProxyType

import sympy as sm
from sympy.printing.pycode import PythonCodePrinter

from kaneflex.derive.ir.names import Names
from kaneflex.derive.ir.program import LARGEST_PRODUCT, Program, expanded_operation_count, operation_count, share
from kaneflex.derive.printers.bracketed import reads
from kaneflex.derive.printers.functions_text import LAW_FUNCTIONS, TABLE_LOOKUPS
from kaneflex.derive.printers.module_text import UNCHECKED, function, module, operations_table


class NumbaPrinter(PythonCodePrinter):
    """Python for numba: rationals are printed as one number, small powers as products.

    ``identifiers``: names of symbols that are printed differently.
    """

    def __init__(self, identifiers: Mapping[sm.Symbol, str] = MappingProxyType({})) -> None:
        super().__init__({"fully_qualified_modules": True, "standard": "python3"})
        self._identifiers = identifiers

    def _print_Symbol(self, expr):
        return self._identifiers.get(expr, expr.name)

    def _print_Integer(self, expr):
        return f"{int(expr)}.0"

    def _print_Rational(self, expr):
        return repr(int(expr.p) / int(expr.q))

    _print_Half = _print_Rational

    def _print_Float(self, expr):
        return repr(float(expr))  # SymPy's own would drop the last two digits

    def _print_NumberSymbol(self, expr):
        return repr(float(expr))

    def _print_Pow(self, expr, rational=False):
        base, exponent = expr.as_base_exp()
        if exponent == sm.Rational(1, 2):
            return f"math.sqrt({self._print(base)})"
        if exponent == sm.Rational(-1, 2):
            return f"1.0/math.sqrt({self._print(base)})"
        factor = self.parenthesize(base, 60)
        if exponent.is_Integer and 1 < abs(exponent) <= LARGEST_PRODUCT:
            product = "*".join([factor] * abs(int(exponent)))
            return f"({product})" if exponent > 0 else f"1.0/({product})"
        return f"1.0/{factor}" if exponent == -1 else f"{factor}**{self.parenthesize(exponent, 60)}"

    def parenthesize(self, item, level, strict=False):
        if item.is_Rational and item.is_positive:  # printed as one number, not as a quotient
            return self._print(item)
        return super().parenthesize(item, level, strict)

    def _print_Function(self, expr):
        if expr.func.__name__ in TABLE_LOOKUPS:
            x, start = (self._print(argument) for argument in expr.args)
            return f"{expr.func.__name__}({x}, p, int({start}))"
        if expr.func.__name__ in LAW_FUNCTIONS:
            return f"{expr.func.__name__}({', '.join(self._print(argument) for argument in expr.args)})"
        return super()._print_Function(expr)


@dataclass(frozen=True)
class Kernel:
    """A program, and what its function needs beside it.

    zeros: zero outputs are stored too, as the array may contain other numbers. returns: the outputs are returned, not
    stored. by_rows: outputs are entries of a matrix, stored last and row by row: processors write neighbouring numbers
    twice as fast. calls: statements after the program's own, which read its outputs by name. inline: into every caller.
    """

    program: Program
    arguments: tuple[str, ...]
    reads: tuple[tuple[sm.Symbol, str], ...]
    doc: str
    zeros: bool = False
    returns: bool = False
    by_rows: bool = False
    calls: tuple[str, ...] = ()
    inline: bool = False


Printed = tuple[Kernel, Program]
"""A kernel, and its program before common subexpressions were extracted."""
Reads = tuple[tuple[sm.Symbol, str], ...]
"""Numbers that a kernel reads, and their places."""


def kernel(
    name: str, arguments: Iterable[str], reads: Reads, values: Iterable[sm.Expr], doc: str, steps=(), out: str = ""
) -> Printed:
    """A kernel that stores values from out[``out``] on, or returns them if ``out`` is empty.

    Values depend on ``reads``, on the arguments and on symbols that ``steps`` assign.
    """
    arguments = tuple(arguments)
    outputs = tuple((f"out[{offset(out, k)}]" if out else str(k), sm.sympify(value)) for k, value in enumerate(values))
    raw = Program(name, (*(symbol for symbol, _ in reads), *map(sm.Symbol, arguments)), tuple(steps), outputs)
    return Kernel(share(raw), arguments, reads, doc, zeros=True, returns=not out), raw


def places(symbols: Iterable[sm.Symbol], array: str, begin: str = "") -> Reads:
    """Neighbouring numbers of an array, from its beginning or from an index on."""
    return tuple((symbol, f"{array}[{offset(begin, k)}]") for k, symbol in enumerate(symbols))


def print_kernels(kernels: Iterable[Kernel], names: Names) -> list[str]:
    """Functions of a module, with one name for a symbol in all of them."""
    kernels = list(kernels)
    arguments = [argument for kernel in kernels for argument in kernel.arguments]
    programs = [kernel.program for kernel in kernels]
    identifiers = names.identifiers(programs, [*arguments, *TABLE_LOOKUPS, *LAW_FUNCTIONS])
    return [print_kernel(kernel, identifiers) for kernel in kernels]


def print_kernel(kernel: Kernel, identifiers: Mapping[sm.Symbol, str] = MappingProxyType({})) -> str:
    """One compiled function: reads, then assignments, which store outputs at once, then the other stores."""
    printer = NumbaPrinter(identifiers)
    used = set().union(*(e.free_symbols for _, e in (*kernel.program.assignments, *kernel.program.outputs)))
    body = [*reads((printer.doprint(symbol), source) for symbol, source in kernel.reads if symbol in used)]
    body += statements(kernel, printer)
    if kernel.returns:
        values = (_bare(printer.doprint(expression)) for _, expression in kernel.program.outputs)
        body.append(f"return {', '.join(values)}")
    body += kernel.calls
    options = "forceinline=True, **OPTIONS" if kernel.inline else "**OPTIONS"
    return function(f"{kernel.program.name}({', '.join(kernel.arguments)})", kernel.doc, body, options)


def statements(kernel: Kernel, printer: NumbaPrinter) -> Iterator[str]:
    """Statements of a kernel that assign numbers and store them.

    Entries that are zero by structure are stored only if ``kernel.zeros``. Equal entries share a statement.
    """
    program, text = kernel.program, printer.doprint
    stored: dict[sm.Expr, list[str]] = {}
    for slot, expression in () if kernel.returns or kernel.by_rows else program.outputs:
        if expression != 0 or kernel.zeros:
            stored.setdefault(expression, []).append(slot)
    for symbol, expression in program.assignments:
        yield " = ".join([text(symbol), *stored.pop(symbol, []), _bare(text(expression))])
    yield from (" = ".join([*slots, _bare(text(expression))]) for expression, slots in stored.items())
    for _, row in groupby(program.outputs if kernel.by_rows else (), lambda output: output[0].partition(",")[0]):
        slots, values = zip(*row, strict=True)
        yield f"{', '.join(slots)} = {', '.join(map(text, values))}"


def _bare(text: str) -> str:
    """Text without parentheses around all of it."""
    return text[1:-1] if text.startswith("(") and text.find(")") == len(text) - 1 else text


def operations(kernels: Sequence[Printed]) -> dict[str, tuple[int, int]]:
    """Kernel -> (operations when every output is written out, operations as printed)."""
    return {
        kernel.program.name: (expanded_operation_count(raw), operation_count(kernel.program)) for kernel, raw in kernels
    }


def offset(begin: str, k: int) -> str:
    """Text of an index k after another one."""
    return f"{begin} + {k}" if k and begin else begin or str(k)


def kernels_module(
    title: str, about: str, tables: Iterable[str], kernels: Sequence[Printed], more: Iterable[str]
) -> str:
    """Text of a module for all scenes: kernels with their operations, and ``more`` functions, which call them."""
    printed = print_kernels((kernel for kernel, _ in kernels), Names({}))
    tables = [*tables, operations_table(operations(kernels))]
    return module(title, [*textwrap.wrap(about.strip(), 118), "", UNCHECKED], tables, [*printed, *more])
