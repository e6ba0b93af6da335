"""Print programs as readable numba modules. Pure: the text depends on its arguments alone."""

from __future__ import annotations

import hashlib
import re
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType

import sympy as sm
from sympy.core.function import AppliedUndef
from sympy.printing.codeprinter import CodePrinter
from sympy.printing.pycode import PythonCodePrinter

from kaneflex.derive import packs
from kaneflex.derive.names import Names
from kaneflex.derive.program import LARGEST_PRODUCT, Program, expanded_operation_count, operation_count
from kaneflex.support.contract import FORMAT


class ScalarPrinter(CodePrinter):
    """What scalar float64 code is in any language: rationals divided beforehand, small powers multiplied out.

    ``identifiers`` says what symbols are called that are not called by their names.
    """

    square_root: str
    whole: str
    """How the place of a table in p, a number there, is made a whole one."""

    def __init__(self, identifiers: Mapping[sm.Symbol, str], settings: dict[str, object]) -> None:
        super().__init__(settings)
        self._identifiers = identifiers

    def _raised(self, base: sm.Expr, exponent: sm.Expr) -> str:
        """Any other power."""
        raise NotImplementedError

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
            return f"{self.square_root}({self._print(base)})"
        if exponent == sm.Rational(-1, 2):
            return f"1.0/{self.square_root}({self._print(base)})"
        if exponent.is_Integer and 1 < abs(exponent) <= LARGEST_PRODUCT:
            factor = self.parenthesize(base, 60)
            product = "*".join([factor] * abs(int(exponent)))
            return f"({product})" if exponent > 0 else f"1.0/({product})"
        if exponent == -1:
            return f"1.0/{self.parenthesize(base, 60)}"
        return self._raised(base, exponent)

    def parenthesize(self, item, level, strict=False):
        if item.is_Rational and item.is_positive:  # printed as one number, not as a quotient
            return self._print(item)
        return super().parenthesize(item, level, strict)

    def _print_Function(self, expr):
        if expr.func.__name__ in TABLE_LOOKUPS:
            x, start = (self._print(argument) for argument in expr.args)
            return f"{expr.func.__name__}({x}, p, {self.whole}({start}))"
        if expr.func.__name__ in LAW_FUNCTIONS:
            return f"{expr.func.__name__}({', '.join(self._print(argument) for argument in expr.args)})"
        return super()._print_Function(expr)


class NumbaPrinter(ScalarPrinter, PythonCodePrinter):
    """Python as numba compiles it."""

    square_root, whole = "math.sqrt", "int"

    def __init__(self, identifiers: Mapping[sm.Symbol, str] = MappingProxyType({})) -> None:
        super().__init__(identifiers, {"fully_qualified_modules": True, "standard": "python3"})

    def _raised(self, base, exponent):
        return f"{self.parenthesize(base, 60)}**{self.parenthesize(exponent, 60)}"


@dataclass(frozen=True)
class Kernel:
    """A program with what its function needs around it; ``zeros``: whether its array may arrive with other numbers.

    One that ``returns`` has no array: its outputs are numbers by names of their own. ``calls``: statements behind the
    program's own, which read its outputs. ``inline``: into what calls it, whatever its size. ``packed``: outputs
    are stored at last and in one go where they are neighbours. ``unpacked``: what is read of an array
    is read in one go. ``fill``: they are a matrix that its
    independent entries are stored as.
    """

    program: Program
    arguments: tuple[str, ...]
    reads: tuple[tuple[sm.Symbol, str], ...]
    doc: str
    zeros: bool = False
    returns: bool = False
    calls: tuple[str, ...] = ()
    inline: bool = False
    packed: bool = False
    unpacked: bool = False
    fill: bool = False


def print_kernels(kernels: Iterable[Kernel], names: Names) -> list[str]:
    """The functions of a module, in which a symbol is called alike in all of them."""
    kernels = list(kernels)
    arguments = [argument for kernel in kernels for argument in kernel.arguments]
    programs = [kernel.program for kernel in kernels]
    identifiers = names.identifiers(programs, [*arguments, *packs.CALLED, *TABLE_LOOKUPS, *LAW_FUNCTIONS])
    return [print_kernel(kernel, identifiers) for kernel in kernels]


def print_kernel(kernel: Kernel, identifiers: Mapping[sm.Symbol, str] = MappingProxyType({})) -> str:
    """One jitted function: parameters and scalars read once, then the assignments, which store what is asked for, then
    the other stores."""
    printer = NumbaPrinter(identifiers)
    read, told = reads(kernel, printer), statements(kernel, printer)
    body = [*packs.loads(read)] if kernel.unpacked else [f"{name} = {source}" for name, source in read]
    if kernel.packed:
        slots = {}
        for name, places, value in told:
            body += [f"{name} = {value}"] if name else []
            slots |= {tuple(map(int, re.findall(r"\d+", place))): name or value for place in places}
        body += [packs.filled(slots)] if kernel.fill else packs.stores(list(slots.items()))
    else:
        body += [" = ".join([*([name] if name else []), *slots, value]) for name, slots, value in told]
    if kernel.returns:
        values = (_bare(printer.doprint(expression)) for _, expression in kernel.program.outputs)
        body.append(f"return {', '.join(values)}")
    body += kernel.calls
    text = textwrap.indent("\n".join([f'"""{kernel.doc}"""', *(body or ["pass"])]), "    ")
    options = "forceinline=True, **OPTIONS" if kernel.inline else "**OPTIONS"
    return f"@njit({options})\ndef {kernel.program.name}({', '.join(kernel.arguments)}):\n{text}\n"


def reads(kernel: Kernel, printer: ScalarPrinter) -> Iterator[tuple[str, str]]:
    """What a kernel reads of its arrays, in any language: name of the number, its place."""
    program = kernel.program
    used = set().union(*(e.free_symbols for _, e in (*program.assignments, *program.outputs)))
    return ((printer.doprint(symbol), source) for symbol, source in kernel.reads if symbol in used)


def statements(kernel: Kernel, printer: ScalarPrinter) -> Iterator[tuple[str, list[str], str]]:
    """What a kernel computes of these, in any language: the number's name, empty where it has none; where it is stored;
    its value.

    Arrays arrive zeroed, mostly: an entry that is zero by structure is not stored. Equal entries share a statement.
    """
    program, text = kernel.program, printer.doprint
    stored: dict[sm.Expr, list[str]] = {}
    for slot, expression in () if kernel.returns else program.outputs:
        if expression != 0 or kernel.zeros:
            stored.setdefault(expression, []).append(slot)
    for symbol, expression in program.assignments:
        yield text(symbol), stored.pop(symbol, []), _bare(text(expression))
    yield from (("", slots, _bare(text(expression))) for expression, slots in stored.items())


def _bare(text: str) -> str:
    """A product that is a whole right-hand side needs no parentheses."""
    return text[1:-1] if text.startswith("(") and text.find(")") == len(text) - 1 else text


def operations(kernels: Sequence[tuple[Kernel, Program]]) -> dict[str, tuple[int, int]]:
    """Kernel -> (operations when every output is written out, operations as printed)."""
    return {
        kernel.program.name: (expanded_operation_count(raw), operation_count(kernel.program)) for kernel, raw in kernels
    }


def literal(name: str, value: object, comment: str = "") -> str:
    """A module-level table; where one line does not hold it one entry a line, so that differences between modules read
    well, and of mere words as many as there is room for.

    Names that a scene gives enter the text of a module here, as literals, and as identifiers; nowhere else.
    """
    brackets = "{}" if isinstance(value, dict) else "()"
    entries = [f"{key!r}: {entry!r}" for key, entry in value.items()] if isinstance(value, dict) else map(repr, value)
    line = f"{name} = {value!r}" + (f"  # {comment}" if comment else "")
    if len(line) <= _LINE:
        return line
    if isinstance(value, tuple) and all(isinstance(entry, str) for entry in value):
        words = wrapped("", list(entries), ",").lstrip()
        return f"# {comment}\n{name} = (\n    {words}\n)"
    return table(name, entries, comment, brackets)


def operations_table(counts: Mapping[str, tuple[int, int]], more: str = "") -> str:
    """OPERATIONS of a module's own kernels; ``more``: what has those of others."""
    entries = [f"{name!r}: {pair!r}" for name, pair in counts.items()]
    line = f"OPERATIONS = {{{', '.join(entries)}}}{more}"
    if len(line) > _LINE:
        line = f"OPERATIONS = {{\n    {wrapped('', entries, ',').lstrip()}\n}}{more}"
    return f"# kernel -> operations written out, operations with shared subexpressions\n{line}"


def table(name: str, lines: Iterable[str], comment: str, brackets: str = "()") -> str:
    """A module-level table of entries in text."""
    lines = [f"    {line}," for line in lines]
    inside = "\n".join(["", *lines, ""]) if lines else ""
    return f"# {comment}\n{name} = {brackets[0]}{inside}{brackets[1]}"


def wrapped(opening: str, entries: Sequence[str], closing: str) -> str:
    """Entries between brackets, in so many lines as hold them four columns from the left."""
    lines = [opening]
    for k, entry in enumerate(entries, start=1):
        entry += "," if k < len(entries) else closing
        if len(lines[-1]) + 1 + len(entry) > _LINE - 5:
            lines.append(f"    {entry}")
        else:
            lines[-1] += entry if lines[-1].endswith("(") else f" {entry}"
    return "\n    ".join(lines)


UNCHECKED = "Kernels check nothing: of an array that is too short they read what lies behind it."
"""What a module of kernels says of them."""

CHECKED = "Kernels read beyond an array that is too short; those of kaneflex.checked(module) name it instead."
"""What one says whose kernels ``kaneflex.checked`` takes."""

ROTARY = ["    Beside omega^2 stands the M of translation: rotary inertia neither softens nor stiffens."]
"""What a module says of an element's equations where sections have rotary inertia."""

MODULE = '''"""{title}, generated by kaneflex. Do not edit.

{about}
"""

{imports}

{constants}
OPTIONS = {{"cache": True, "error_model": "numpy", "fastmath": {{"nsz", "arcp", "contract", "afn", "reassoc"}}}}

{tables}


{kernels}'''

_LINE = 120


def module(
    title: str,
    about: Iterable[str],
    tables: Iterable[str],
    kernels: Iterable[str],
    imports: Iterable[str] = (),
    before: Iterable[str] = (),
    structure: str = "",
    made: str = "make derive",
) -> str:
    """Text of a module, which imports ``math``, ``rows`` and ``packs`` where its text calls them.

    ``imports`` are those of other siblings, ``before`` other ones before numba's; ``made``: the command that makes a
    module of this ``structure``, or of every one.
    """
    kernels, tables = "\n\n".join(kernels), _together(tables)
    packed = [name for name in packs.CALLED if f" {name}(" in kernels]
    imports = [*([import_called("packs", packed, packs.TEXT)] if packed else []), *imports]
    if re.search(r"\brows\.\w+\(", tables):
        imports.insert(0, "from kaneflex.generated import rows")
    before = ["import math"] * ("math." in kernels) + list(before)
    lines = [*before, *([""] if before else []), "from numba import njit"]
    found, constants = f"format {FORMAT}, SymPy {version()}; made by: {made}", [f"FORMAT = {FORMAT}"]
    if structure:
        found, constants = f"structure {structure}, {found}", [*constants, f'STRUCTURE = "{structure}"']
    return MODULE.format(
        title=title,
        about="\n".join([f"{found[0].upper()}{found[1:]}", "", *about]),
        imports="\n".join([*lines, *([""] if imports else []), *imports]),
        constants="\n".join(constants),
        tables=tables,
        kernels=kernels,
    )


def _together(tables: Iterable[str]) -> str:
    """Tables of one line beside each other, the others apart."""
    text = ""
    for before, each in pairwise(["", *tables]):
        text += f"{each}\n" if not before or "\n" not in before + each else f"\n{each}\n"
    return text.rstrip("\n")


def kernels_module(
    title: str, about: str, tables: Iterable[str], kernels: Sequence[tuple[Kernel, Program]], more: str
) -> str:
    """Text of a module that is printed once for every scene, of kernels with their operations; ``more``: those that
    call the others."""
    printed = print_kernels((kernel for kernel, _ in kernels), Names({}))
    tables = [*tables, operations_table(operations(kernels))]
    return module(title, [*textwrap.wrap(about.strip(), 118), "", UNCHECKED], tables, [*printed, more])


def offset(begin: str, k: int) -> str:
    """The text of an index that is k after another one."""
    return f"{begin} + {k}" if k else begin


def version() -> str:
    """SymPy's minor version, which the text of a module depends on."""
    return ".".join(sm.__version__.split(".")[:2])


def import_called(module: str, names: Iterable[str], text: str) -> str:
    """Import kernels that this module's own ones call, from the module of this text.

    numba keeps what it compiled of a function for as long as the function's own file stays as it is, whatever becomes
    of a callee in another file. So the digest of that file is part of this one.
    """
    return f"{import_names(module, names)}  # digest {hashlib.sha256(text.encode()).hexdigest()[:16]}"


def import_names(module: str, names: Iterable[str]) -> str:
    """Import from a sibling, over several lines where one is too short."""
    line = f"from kaneflex.generated.{module} import {', '.join(names)}"
    if len(line) <= _LINE:
        return line
    head, _, rest = line.partition(" import ")
    inside = textwrap.fill(rest + ",", _LINE, initial_indent="    ", subsequent_indent="    ")
    return f"{head} import (\n{inside}\n)"


def calls(program: Program, function: str) -> bool:
    """Whether a program looks a table up by this function."""
    everything = (*program.assignments, *program.outputs)
    return any(call.func.__name__ == function for _, e in everything for call in e.atoms(AppliedUndef))


def import_lookups(programs: Sequence[Program]) -> list[str]:
    """The imports of the lookups and the functions of laws that programs call, none if there are none."""
    found = []
    for module, functions, text in (("tables", TABLE_LOOKUPS, tables_text), ("laws", LAW_FUNCTIONS, laws_text)):
        called = [name for name in functions if any(calls(program, name) for program in programs)]
        found += [import_called(module, called, text())] if called else []
    return found

TABLES = {
    "table": ("Piecewise cubic table", "p[k] + d * (p[k + 1] + d * (p[k + 2] + d * p[k + 3]))"),
    "table_rate": ("First derivative of a cubic table", "p[k + 1] + d * (2.0 * p[k + 2] + d * 3.0 * p[k + 3])"),
    "table_curvature": ("Second derivative of a cubic table", "2.0 * p[k + 2] + d * 6.0 * p[k + 3]"),
    "table_jerk": ("Third derivative of a cubic table", "6.0 * p[k + 3]"),
}
"""Name of a lookup -> what it is, and its value at the distance d from the breakpoint where the cubic at k begins."""
_TABLE = '''@njit(**OPTIONS)
def {name}(x, p, start):
    """{doc}: p[start] intervals, p[start + 1] the period (0 if none), breakpoints, coefficients."""
    n = int(p[start])
    period = p[start + 1]
    knots = start + 2
    if period > 0.0:
        x = p[knots] + (x - p[knots]) % period
    low = 0
    high = n
    while high - low > 1:
        middle = (low + high) // 2
        if p[knots + middle] <= x:
            low = middle
        else:
            high = middle
    d = x - p[knots + low]
    k = knots + n + 1 + 4 * low
    return {value}
'''
TABLE_LOOKUPS = {name: _TABLE.format(name=name, doc=doc, value=value) for name, (doc, value) in TABLES.items()}
"""Name of a lookup -> its text."""


def tables_text() -> str:
    """Text of the module of lookups in tables, which every module imports what it calls from."""
    said = "Names of a block's numbers are said in kaneflex.scene.tables."
    return module("Piecewise cubic tables", [said], [], TABLE_LOOKUPS.values())


_LAW = '''@njit(**OPTIONS)
def {name}({arguments}):
    """{doc}"""
{code}
'''
LAW_FUNCTIONS = {
    name: _LAW.format(
        name=name, arguments=arguments, doc=doc, code=textwrap.indent(textwrap.dedent(code).strip(), "    ")
    )
    for name, arguments, doc, code in (
        ("sign", "x", "-1 below zero, 1 above, 0 at it.", "return 1.0 if x > 0.0 else (-1.0 if x < 0.0 else x)"),
        ("smaller", "a, b", "The smaller of two numbers.", "return a if a <= b or a != a else b"),
        ("larger", "a, b", "The larger of two numbers.", "return a if a >= b or a != a else b"),
        ("clamped", "s", "A number, or the end of [0, 1] beyond which it is.", "return smaller(larger(s, 0.0), 1.0)"),
        ("within", "s", "The slope of ``clamped``.", "return 1.0 if 0.0 < s < 1.0 else 0.0"),
        ("chosen", "side, a, b", "The first, below zero the second.", "return b if side < 0.0 else a"),
        ("around", "side, y, x", "The angle of (x, y), on this side of y across its cut: beyond pi, or -pi.", """
            angle = math.atan2(y, x)
            if x < 0.0 and side * angle < 0.0:
                angle += side * 2.0 * math.pi
            return angle
        """),
    )
}  # fmt: skip
"""Name of a function of laws -> its text."""


def laws_text() -> str:
    """Text of the module of what laws call beside math, which every module imports what it calls from."""
    said = "What is no number comes through as none."
    return module("Functions of laws", [said], [], LAW_FUNCTIONS.values())
