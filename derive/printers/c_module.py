"""Kernels of a generated module as portable C11: :func:`generate_c`.

Two files: a header with the places of all numbers in their arrays, and the kernels. They allocate nothing, call the
mathematics of the standard library alone, and compile without a warning.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from inspect import getdoc, signature
from typing import Any

from numba.types import CPointer, float64

from kaneflex.derive.elements.parameters import LINK_SCALARS
from kaneflex.derive.printers.c_printer import Printer
from kaneflex.derive.printers.c_types import ReadOnly, Square
from kaneflex.support.c_language import RESERVED, c_comment, c_inline, header_text
from kaneflex.support.contract import ELEMENT_KERNELS
from kaneflex.support.escaping import ascii_identifier
from kaneflex.support.files import LONGEST_STEM


def generate_c(module: Any, name: str) -> dict[str, str]:
    """Name of a file -> its text: NAME.h and NAME.c of a structure's module.

    Parameters
    ----------
    module : module
    name : str
        Prefix of all names, an identifier.
    """
    printer, heads = Printer(own=name), []
    for kernel in ("motion", *ELEMENT_KERNELS):
        function = getattr(module, kernel, None)
        if function is not None:
            written = {"s": CPointer(float64)} if kernel == "motion" else {}
            written["out"] = CPointer(float64) if kernel == "F" else Square()
            known = {"t": float64, **written}
            kinds = {each: known.get(each, ReadOnly(float64)) for each in signature(function.py_func).parameters}
            called, _ = printer.function(function, list(kinds.values()), "", f"{name}_{kernel}")
            arguments = ", ".join(printer.declared(kind, each) for each, kind in kinds.items())
            heads.append(f"{c_comment(getdoc(function.py_func) or '')}\nvoid {called}({arguments});\n")
    about = c_comment(_about(module))
    tables = "\n".join(_tables(module, name.upper()))
    head = header_text(name, about, "\n".join([tables, "", *heads]))
    return {f"{name}.h": head, f"{name}.c": _SOURCE.format(about=about, name=name, text=printer.text())}


def places(prefix: str, rows: Iterable[tuple[str, str]], count: str) -> str:
    """An enumeration of the places in an array: what is there and a comment on it; ``count`` is the array's length."""
    found: dict[str, str] = {}
    for what, meaning in rows:
        stem = symbol = f"{prefix}_{identifier(what).upper()}"
        number = 1
        while symbol in found or symbol == count:
            number += 1
            symbol = f"{stem}_{number}"
        found[symbol] = f"/* {c_inline(meaning)} */"
    lines = [f"    {symbol}, {meaning}" for symbol, meaning in found.items()]
    return "\n".join(["enum {", *lines, f"    {count}", "};"])


def identifier(name: str) -> str:
    """A name of a scene as a part of one of C."""
    return re.sub(r"\W", "_", ascii_identifier(name))


def prefix_of(scene: str) -> str:
    """Prefix of the names of a scene's C: no reserved word of C, no name of a shared file."""
    name = identifier(scene)[:LONGEST_STEM]
    return name if name[:1].isalpha() and name not in RESERVED and not name.startswith("kaneflex") else f"scene_{name}"


def _tables(module: Any, prefix: str) -> list[str]:
    """The places of all numbers in the arrays that kernels take."""
    tables = f" Tables: {', '.join(module.TABLES)}." if module.TABLES else ""
    fixed = ", ".join(f"{name} = {value:g}" for name, value in module.CONSTANTS.items())
    found = [
        c_comment(f"p: numbers of the scene. Blocks of tables stand behind them, where PATH.table says.{tables}"),
        places(f"{prefix}_P", ((path, f"{path} [{unit}]") for path, unit in module.PARAMETERS), f"{prefix}_PARAMETERS"),
        "",
        c_comment(f"s: scalars of the rigid motion.{f' Always: {fixed}.' if fixed else ''}"),
        places(f"{prefix}_S", ((s, f"{s} [{unit}]: {meaning}") for s, unit, meaning in module.SCALARS),
               f"{prefix}_SCALARS"),
    ]  # fmt: skip
    if module.LINKS:
        element = [(name, f"{unit}: {meaning}") for name, unit, meaning in module.ELEMENT_PARAMETERS]
        link = [(name, f"{unit}: {meaning}") for name, unit, meaning in LINK_SCALARS]
        begins = ", ".join(f"{name} at {place}" for name, place in module.LINKS.items())
        found += [
            "", c_comment("p of the kernels of one element."), places(f"{prefix}_E", element, f"{prefix}_ELEMENT"), "",
            c_comment(f"s of the kernels of one element; those of a link stand in s of the motion: {begins}."),
            places(f"{prefix}_L", link, f"{prefix}_LINK"),
        ]  # fmt: skip
    return found


def _about(module: Any) -> str:
    title, structure, *_ = module.__doc__.strip().split("\n\n")
    structure = structure.partition("; made by")[0]
    lines = [title, "", f"{structure}; made by: kaneflex derive SCENE --language c -o DIR", ""]
    if module.LINKS:
        lines += [module.beam.__doc__.strip().split("\n\n")[2], ""]
    operations = {name: counts for name, counts in module.OPERATIONS.items() if hasattr(module, name)}
    width = max(map(len, operations))
    lines.append("Operations of one call, written out -> with shared subexpressions:")
    lines += [f"    {name:<{width}}  {before:>6} -> {after}" for name, (before, after) in operations.items()]
    return "\n".join([*lines, "", "Kernels check nothing, and allocate nothing."])


_SOURCE = """{about}
#include "{name}.h"

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

{text}"""
