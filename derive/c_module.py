"""The module of a scene as portable C11, from the same programs as the numba one: :func:`generate_c`.

Two files: a header with the places of all numbers in their arrays, and the kernels. They allocate nothing, call the
mathematics of the standard library alone, and compile without a warning.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import sympy as sm
from sympy.printing.c import C11CodePrinter

from kaneflex.derive import emit, lookups_numba, module_text, packs
from kaneflex.derive.beam import beam_element
from kaneflex.derive.elements import element_kernel, in_letters
from kaneflex.derive.generate import Equations, Progress, derive_equations, kernels_of, lower, table_paths
from kaneflex.derive.lookups_c import LAW_TEXTS, TABLE_TEXTS
from kaneflex.derive.names import ascii_identifier
from kaneflex.derive.program import Program, named
from kaneflex.support.c_language import RESERVED
from kaneflex.support.contract import BEAMS, FORMAT, LINK_SCALARS, element_parameters
from kaneflex.support.escaping import c_comment, c_inline
from kaneflex.support.output_folders import LONGEST_STEM


class CPrinter(emit.ScalarPrinter, C11CodePrinter):
    """C11."""

    square_root, whole = "sqrt", "(size_t)"

    def __init__(self, identifiers: Mapping[sm.Symbol, str] = MappingProxyType({})) -> None:
        super().__init__(identifiers, {})

    def _raised(self, base, exponent):
        return f"pow({self._print(base)}, {self._print(exponent)})"


def generate_c(scene: Any, name: str, progress: Progress = lambda stage: None) -> dict[str, str]:
    """Name of a file -> its text: NAME.h and NAME.c of a scene's structure.

    Parameters
    ----------
    scene : Scene
    name : str
        What all names begin with, an identifier.
    progress : callable
        Called with the name of each stage as it begins.
    """
    progress("Kane's equations")
    equations = derive_equations(scene.structure())
    progress("programs")
    kernels = [*lower(equations), *_element_kernels(equations)]
    progress("module text")
    identifiers = equations.mechanism.names.identifiers(
        [kernel.program for kernel, _ in kernels],
        [*RESERVED, *lookups_numba.TABLE_LOOKUPS, *lookups_numba.LAW_FUNCTIONS,
         *(argument for kernel, _ in kernels for argument in kernel.arguments)],
    )
    about = _about(scene, equations, emit.operations(kernels))
    raw = [raw for _, raw in kernels]
    text = _SOURCE.format(
        about=c_comment(about), name=name, lookups="".join(f"{text}\n" for text in _called(raw)),
        kernels="\n".join(_function(kernel, name, identifiers) for kernel, _ in kernels),
    )  # fmt: skip
    head = _HEADER.format(
        about=c_comment(about), guard=f"{name.upper()}_H", tables="\n".join(_tables(equations, name.upper())),
        kernels="\n".join(f"{c_comment(kernel.doc)}\n{_signature(kernel, name)};\n" for kernel, _ in kernels),
    )  # fmt: skip
    return {f"{name}.h": head, f"{name}.c": text}


def _element_kernels(equations: Equations) -> list[emit.Printed]:
    """The kernels of the element that its numba module shares with other scenes."""
    if not equations.beam:
        return []
    element = beam_element(**BEAMS[equations.beam], with_frame=False)
    return [element_kernel(name, element) for name in kernels_of(equations.terms)]


def _called(programs: Sequence[Program]) -> list[str]:
    """The lookups and the functions of laws that programs call, and those which these call."""
    texts = {**TABLE_TEXTS, **LAW_TEXTS}
    wanted = {name for name in texts if any(lookups_numba.calls(program, name) for program in programs)}
    if wanted & TABLE_TEXTS.keys():
        wanted.add("place_in_table")
    if "clamped" in wanted:
        wanted |= {"smaller", "larger"}
    return [text for name, text in texts.items() if name in wanted]


def _function(kernel: emit.Kernel, name: str, identifiers: Mapping[sm.Symbol, str]) -> str:
    """The definition of a kernel. A number that only goes into the array has no name of its own there."""
    program, printer = kernel.program, CPrinter(identifiers)
    if kernel.fill:
        program = named(program)
        program = replace(program, outputs=packs.full(program.outputs))
        kernel = replace(kernel, program=program)
    assigned = {symbol for symbol, _ in program.assignments}
    rights = [value for _, value in (*program.assignments, *program.outputs) if value not in assigned]
    asked = {printer.doprint(symbol) for value in rights for symbol in value.free_symbols}
    lines, texts = [], []
    read = ((local, [], source) for local, source in emit.reads(kernel, printer))
    for local, slots, value in (*read, *emit.statements(kernel, printer)):
        places = [slot.replace(", ", "][") for slot in slots]
        texts.append(value)
        targets = ([f"const double {local}"] if local in asked or not places else []) + places
        lines.append(f"    {' = '.join([*targets, value])};")
    for argument in kernel.arguments[:-1]:
        if not any(re.search(rf"\b{argument}\b", value) for value in texts):
            lines.insert(0, f"    (void){argument};")
    body = "\n".join(lines)
    return f"{_signature(kernel, name)}\n{{\n{body}\n}}\n"


def _signature(kernel: emit.Kernel, name: str) -> str:
    square = any(", " in slot for slot, _ in kernel.program.outputs)
    types = {"t": "double t", "out": "double out[6][6]" if square else "double out[]", "s": "const double s[]"}
    if kernel.arguments[-1] == "s":
        types["s"] = "double s[]"
    given = ", ".join(types.get(argument, f"const double {argument}[]") for argument in kernel.arguments)
    return f"void {name}_{kernel.program.name}({given})"


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


def _tables(equations: Equations, prefix: str) -> list[str]:
    """The places of all numbers in the arrays that kernels take."""
    mechanism, motion = equations.mechanism, equations.motion
    names = mechanism.names
    parameters = [(path, f"{path} [{unit}]") for path, (_, unit) in mechanism.parameters.items()]
    for link in motion.links if equations.beam else ():
        of_element = element_parameters(**BEAMS[equations.beam])
        parameters += [(f"bodies.{link}.element.{name}",) * 2 for name, *_ in of_element]
    scalars = [(s.name, f"{s.name} [{s.unit}]: {s.meaning}") for s in motion.stored]
    in_links = (scalar for block in motion.links.values() for scalar in block)
    fixed = {s.name: float(s.value) for s in (*in_links, *motion.scalars) if s.value.is_number}
    tables = names.told(table_paths(mechanism))
    found = [
        c_comment("p: numbers of the scene. Blocks of tables stand behind them, where PATH.table says."
                  + (f" Tables: {', '.join(tables)}." if tables else "")),
        places(f"{prefix}_P", names.told(parameters), f"{prefix}_PARAMETERS"),
        "",
        c_comment("s: scalars of the rigid motion."
                  + (f" Always: {', '.join(f'{names.text(k)} = {v:g}' for k, v in fixed.items())}." if fixed else "")),
        places(f"{prefix}_S", names.told(scalars), f"{prefix}_SCALARS"),
    ]  # fmt: skip
    if equations.beam:
        element = [(name, f"{unit}: {meaning}") for name, unit, meaning in element_parameters(**BEAMS[equations.beam])]
        link = [(name, f"{unit}: {meaning}") for name, unit, meaning in LINK_SCALARS]
        begins = ", ".join(f"{names.text(each)} at {k * len(LINK_SCALARS)}" for k, each in enumerate(motion.links))
        found += [
            "", c_comment("p of the kernels of one element."), places(f"{prefix}_E", element, f"{prefix}_ELEMENT"), "",
            c_comment(f"s of the kernels of one element; those of a link stand in s of the motion: {begins}."),
            places(f"{prefix}_L", link, f"{prefix}_LINK"),
        ]  # fmt: skip
    return found


def _about(scene: Any, equations: Equations, counts: Mapping[str, tuple[int, int]]) -> str:
    lines = [
        "Equations of motion of a mechanism, generated by kaneflex. Do not edit.",
        "",
        f"Structure {scene.structure_hash()}, format {FORMAT}, SymPy {module_text.version()}; "
        "made by: kaneflex derive SCENE --language c -o DIR",
        "",
    ]
    if equations.beam:
        lines += [
            "In link axes, with one scalar of the motion before each constant matrix:",
            f"    {in_letters()}",
            "    q = (u1, v1, theta1, u2, v2, theta2) of an element",
            *module_text.ROTARY * BEAMS[equations.beam]["rotary"],
            "",
        ]
    width = max(map(len, counts))
    lines.append("Operations of one call, written out -> with shared subexpressions:")
    lines += [f"    {name:<{width}}  {before:>6} -> {after}" for name, (before, after) in counts.items()]
    return "\n".join([*lines, "", "Kernels check nothing, and allocate nothing."])


_HEADER = """{about}
#ifndef {guard}
#define {guard}

#ifdef __cplusplus
extern "C" {{
#endif

{tables}

{kernels}
#ifdef __cplusplus
}}
#endif

#endif
"""
_SOURCE = """{about}
#include "{name}.h"

#include <math.h>
#include <stddef.h>

{lookups}{kernels}"""
