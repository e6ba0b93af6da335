"""A scene as a folder of C11: its kernels, its numbers, and its linear equations stepped in time without Python."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib.resources import files

import numpy as np

from kaneflex.integrate.methods import METHODS, Method
from kaneflex.integrate.outcome import Trajectory
from kaneflex.multibody.binding import kernels_in_c
from kaneflex.multibody.model import Model
from kaneflex.scene import Scene
from kaneflex.scene.options import resolve_options
from kaneflex.scene.spatial_check import refuse_in_space
from kaneflex.solve.loading import load
from kaneflex.solve.simulation import solve
from kaneflex.support.errors import SceneError

_SHARED = "kaneflex_linear.h", "kaneflex_linear.c"
_STEPPED = ("dynamic", "frozen")
"""Ways of solving whose steps there are in C."""


def c_model(scene: Scene, progress: Callable[[str], None] = lambda stage: None) -> dict[str, str]:
    """Name of a file -> its text, all that a C compiler or CMake needs.

    Of every scene the kernels and its numbers. Where the linear equations are integrated, these too, with the state
    that the scene's own run begins at, steps of its integrator (of radau where that has none of its own) and a program
    that writes the coordinates of one run as CSV.

    Raises
    ------
    SceneError
        Under preset ``coupled`` and in space, which are compiled by numba alone.
    """
    refuse_in_space(scene, "--language", "equations are printed in C of what moves")
    if resolve_options(scene).dynamics == "coupled":
        raise SceneError(
            "solve.preset", "coupled", "its equations are compiled by numba alone, not printed in C",
            "Take another preset, like --preset stiffened",
        )  # fmt: skip
    model = load(scene, progress)
    name, texts = kernels_in_c(scene, progress)
    data = [_array("double", f"{name}_p", map(_number, model.motion.parameters))]
    sources, declared = [f"{name}.c", f"{name}_data.c"], ""
    stepped = model.options.dynamics in _STEPPED and model.reduced.size > 0
    if stepped:
        progress("where the run begins")
        numbers, sizes = _linear(model, name)
        data += numbers
        declared = _DECLARED.format(name=name, NAME=name.upper(), sizes=sizes)
        sources += [_SHARED[1]]
        folder = files("kaneflex.solve")
        texts |= {each: (folder / each).read_text(encoding="utf-8") for each in _SHARED}
        texts[f"{name}_run.c"] = _RUN.format(name=name, NAME=name.upper(), steps=model.options.steps)
    include = f'#include "{_SHARED[0]}"\n' if stepped else ""
    texts[f"{name}_data.h"] = _DATA_H.format(name=name, NAME=name.upper(), include=include, declared=declared)
    texts[f"{name}_data.c"] = f'#include "{name}_data.h"\n\n' + "\n".join(data)
    program = f"add_executable({name}_run {name}_run.c)\ntarget_link_libraries({name}_run {name})\n" if stepped else ""
    texts["CMakeLists.txt"] = _CMAKE.format(name=name, sources=" ".join(sources), program=program)
    return texts


def method_in_c(model: Model) -> Method:
    """The integrator of a run where it goes in fixed steps of one loop, radau else."""
    method = METHODS[model.options.integrator]
    return method if method.lanes else METHODS["radau"]


def _linear(model: Model, name: str) -> tuple[list[str], str]:
    """Texts of the arrays of the linear equations with what holds them, and their sizes."""
    system, method, begun = model.system, method_in_c(model), solve(model).trajectory
    assert isinstance(begun, Trajectory) and method.coefficients is not None  # of what goes in fixed steps
    if not len(begun.z):
        raise SceneError("solve.start", model.options.start, begun.message, "Start from zero or quasistatic")
    row = model.scalars(np.zeros(1))[0]
    weights = np.array(method.coefficients(system, row, model.step, model.options.rho_infinity))
    nodes = (*method.nodes[1:], 1.0)[: max(method.stages, 1)]
    places = [sorted(model.motion.column[each] for each in monomial) for monomial in model.monomials]
    ends, what, constants = system.sums
    arrays: dict[str, tuple[str, Iterable[object]]] = {
        "product_ends": ("size_t", np.cumsum([len(each) for each in places])),
        "factors": ("size_t", [place for each in places for place in each]),
        "sum_ends": ("size_t", ends[1:]),
        "sum_products": ("size_t", what),
        "sum_constants": ("double", map(_number, constants)),
        "nodes": ("double", map(_number, nodes)),
        "weights": ("double", map(_number, weights)),
        "z_0": ("double", map(_number, begun.z[0])),
        "v_0": ("double", map(_number, begun.v[0])),
        "coordinates": ("char *const", map(_text, model.reduced.coordinates)),
    }
    texts = [_array(kind, f"{name}_{key}", values, "static ") for key, (kind, values) in arrays.items()]
    sizes = (system.n, system.half_bandwidth, len(model.motion.column), len(places), max(method.stages, 1))
    period = model.options.steps if model.options.cycles else 0
    held = ", ".join(f"{name}_{key}" for key in arrays)
    numbers = f"{', '.join(map(str, sizes))}, {period}, {_number(model.step)}"
    numbers = f"    {numbers}, {name}_motion, {name}_p,\n    {held}\n"
    texts.append(f"const kaneflex_linear {name}_linear = {{\n{numbers}}};\n")
    return texts, ", ".join(map(str, sizes))


def _array(kind: str, name: str, values: Iterable[object], scope: str = "") -> str:
    found = [str(value) for value in values]
    lines = "".join(f"    {value},\n" for value in found or ["0"])  # C has no empty arrays
    return f"{scope}const {kind} {name}[] = {{\n{lines}}};\n"


def _number(value: float) -> str:
    return repr(float(value))


def _text(text: str) -> str:
    """A text in C's quotes; a question mark could begin a trigraph."""
    for letter in '\\"?':
        text = text.replace(letter, f"\\{letter}")
    return f'"{text}"'


_DATA_H = """/* The numbers of the scene [SI]. */
#ifndef {NAME}_DATA_H
#define {NAME}_DATA_H

#include "{name}.h"
{include}
#ifdef __cplusplus
extern "C" {{
#endif

/* {NAME}_PARAMETERS numbers, then the blocks of the tables. */
extern const double {name}_p[];
{declared}
#ifdef __cplusplus
}}
#endif

#endif
"""
_DECLARED = """
/* The linear equations, from where the scene's own run begins. */
extern const kaneflex_linear {name}_linear;
#define {NAME}_MEMORY KANEFLEX_LINEAR_MEMORY({sizes})
"""
_RUN = """/* Writes one run as CSV: time [s], then the coordinates [m; rad where a name ends in theta or phi]. */
#include "{name}_data.h"

#include <stdio.h>

static double memory[{NAME}_MEMORY];

int main(void)
{{
    const kaneflex_linear *model = &{name}_linear;
    kaneflex_state state;
    int ended = kaneflex_start(&state, model, memory);
    printf("time");
    for (size_t i = 0; i < model->n; i++)
        printf(",\\"%s\\"", model->coordinates[i]);
    printf("\\n");
    for (int step = 0; !ended && step <= {steps}; step++) {{
        printf("%.17g", kaneflex_time(&state));
        for (size_t i = 0; i < model->n; i++)
            printf(",%.17g", state.z[i]);
        printf("\\n");
        if (step < {steps})
            ended = kaneflex_step(&state);
    }}
    if (ended)
        fprintf(stderr, "stopped at t = %.9g s: %s\\n", kaneflex_time(&state),
                ended == KANEFLEX_SINGULAR ? "a matrix is singular" : "the motion grows beyond all bounds");
    return ended;
}}
"""
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
if(UNIX)
  target_link_libraries({name} PUBLIC m)
endif()
{program}"""
