"""Functions that kernels call beside ``math``: lookups in cubic tables, and functions of laws."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

from sympy.core.function import AppliedUndef

from kaneflex.derive.ir.program import Program
from kaneflex.derive.printers.module_text import function, import_called, module


def calls(program: Program, function: str) -> bool:
    """True if a program calls this function."""
    everything = (*program.assignments, *program.outputs)
    return any(call.func.__name__ == function for _, e in everything for call in e.atoms(AppliedUndef))


def import_lookups(programs: Sequence[Program]) -> list[str]:
    """Imports of the lookups and functions of laws that programs call."""
    found = []
    for where, functions, text in (("tables", TABLE_LOOKUPS, tables_text), ("laws", LAW_FUNCTIONS, laws_text)):
        called = [name for name in functions if any(calls(program, name) for program in programs)]
        found += [import_called(where, called, text())] if called else []
    return found


_PLACE = '''@njit(forceinline=True, **OPTIONS)
def place_in_table(x, p, start):
    """Distance from the breakpoint before x, and where the cubic there begins.

    p[start] intervals, p[start + 1] the period (0 if none), breakpoints, coefficients."""
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
    return x - p[knots + low], knots + n + 1 + 4 * low
'''
TABLE_LOOKUPS = {
    name: function(f"{name}(x, p, start)", f"{doc}, whose block begins at p[start].",
                   ["d, k = place_in_table(x, p, start)", f"return {value}"])
    for name, doc, value in (
        ("table", "Piecewise cubic table", "p[k] + d * (p[k + 1] + d * (p[k + 2] + d * p[k + 3]))"),
        ("table_rate", "First derivative of a cubic table", "p[k + 1] + d * (2.0 * p[k + 2] + d * 3.0 * p[k + 3])"),
        ("table_curvature", "Second derivative of a cubic table", "2.0 * p[k + 2] + d * 6.0 * p[k + 3]"),
    )
}  # fmt: skip
"""Name of a lookup -> its text; d is the distance from the breakpoint where the cubic at k begins."""


def tables_text() -> str:
    """Text of the module of lookups in tables."""
    title = "Names of a block's numbers are said in kaneflex.scene.tables."
    return module("Piecewise cubic tables", [title], [], [_PLACE, *TABLE_LOOKUPS.values()])


LAW_FUNCTIONS = {
    name: function(f"{name}({arguments})", doc, textwrap.dedent(code).strip().split("\n"))
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
    """Text of the module of functions of laws."""
    title = "What is no number comes through as none."
    idle = [
        function(head, doc, [])
        for head, doc in (
            ("no_courses(t, p, out, k)", "Courses of a structure without a prescribed drive: nothing is stored."),
            ("no_magnitudes(t, x, i, p, out, k)", "Sizes of the loads of a structure that has none."),
        )
    ]
    return module("Functions of laws", [title], [], [*LAW_FUNCTIONS.values(), *idle])
