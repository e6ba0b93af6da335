"""Texts that exported C shares: arrays, structures, headers, the program that writes a run, and its build file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from importlib.resources import files
from typing import Any, TypeAlias

Arrays: TypeAlias = Mapping[str, tuple[str, Iterable[Any]]]
"""Name of an array -> type of its entries, and these."""


def array_in_c(kind: str, name: str, values: Iterable[Any], scope: str = "static ") -> str:
    """Definition of an array of numbers or texts, eight in a line; C has no empty arrays."""
    text: Callable[[Any], str] = number_in_c if kind == "double" else str if kind == "char *const" else _whole
    found = [text(value) for value in values] or ["0"]
    lines = "".join(f"    {', '.join(found[k : k + 8])},\n" for k in range(0, len(found), 8))
    return f"{scope}const {kind} {name}[] = {{\n{lines}}};\n"


def structure_in_c(kind: str, name: str, prefix: str, first: str, arrays: Arrays, scope: str = "") -> list[str]:
    """Definitions of arrays, then of the structure that holds its first members and them."""
    texts = [array_in_c(of, f"{prefix}_{key}", values) for key, (of, values) in arrays.items()]
    held = ", ".join(f"{prefix}_{key}" for key in arrays)
    return [*texts, f"{scope}const {kind} {name} = {{\n    {first},\n    {held}\n}};\n"]


def _whole(value: Any) -> str:
    return str(int(value))


def number_in_c(value: float) -> str:
    text = repr(float(value))
    return {"inf": "INFINITY", "-inf": "-INFINITY", "nan": "NAN"}.get(text, text)


def shared_texts(names: Iterable[str]) -> dict[str, str]:
    """C files that are the same for every scene."""
    return {name: (files("kaneflex.export") / name).read_text(encoding="utf-8") for name in names}


def cmake_text(name: str, sources: Iterable[str], runs: bool) -> str:
    """CMake file for a library of the sources, and for NAME_run.c if there is one."""
    program = f"add_executable({name}_run {name}_run.c)\ntarget_link_libraries({name}_run {name})\n" if runs else ""
    return _CMAKE.format(name=name, sources=" ".join(sources), program=program)


RUN = """/* Writes a run as CSV: time [s], {about}. */
#include "{header}"

#include <stdio.h>

{memory}

static void write_row(size_t count, const char *const names[], const double values[])
{{
    for (size_t k = 0; k < count; k++)
        if (values)
            printf(",%.17g", values[k]);
        else
            printf(",\\"%s\\"", names[k]);
}}

int main(void)
{{
    {begin}
    printf("time");
    write_row({first}, NULL);
    write_row({second}, NULL);
    for (int step = 0; !ended && step <= {steps}; step++) {{
        if (step > 0)
            ended = {advance};
        if (ended)
            break;
        {read};
        printf("\\n%.17g", {time});
        write_row({first}, {first_values});
        write_row({second}, {second_values});
    }}
    printf("\\n");
    if (ended)
        fprintf(stderr, "stopped at t = %.9g s: %s\\n", {time},
                {message});
    return ended;
}}
"""
"""Program that writes a run as CSV; DONE is 0 under all presets."""
_CMAKE = """cmake_minimum_required(VERSION 3.10)
project({name} C)
set(CMAKE_C_STANDARD 11)
set(CMAKE_C_STANDARD_REQUIRED ON)
set(CMAKE_C_EXTENSIONS OFF)
if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release)
endif()
add_library({name} STATIC {sources})
target_include_directories({name} PUBLIC ${{CMAKE_CURRENT_SOURCE_DIR}})
if(CMAKE_C_COMPILER_ID STREQUAL "GNU")  # products of complex numbers without a search for infinities, roots inline
  target_compile_options({name} PRIVATE -fcx-limited-range -fno-math-errno)
endif()
if(UNIX)
  target_link_libraries({name} PUBLIC m)
endif()
{program}"""
