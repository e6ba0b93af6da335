"""Export of a scene as C11: kernels, numbers, and its linear equations with time steps."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from importlib.resources import files
from typing import Any

import numpy as np

from kaneflex.integrate.methods import METHODS, Method
from kaneflex.integrate.outcome import Trajectory
from kaneflex.multibody.model.bound_model import Model
from kaneflex.response.polynomials import Readings, sensor_readings
from kaneflex.scene import Scene
from kaneflex.scene.options import resolve_options
from kaneflex.solve.free_motion import integrated
from kaneflex.solve.loading import load
from kaneflex.solve.one_way import one_way_cure
from kaneflex.solve.repeated_motion import Harmonics, check_cycle, harmonics_of
from kaneflex.solve.simulation import solve
from kaneflex.support.errors import SceneError
from kaneflex.support.escaping import c_inline, c_literal

_SHARED = "kaneflex_linear.h", "kaneflex_linear.c"
_IN_SPACE = "kaneflex_series.h", "kaneflex_series.c"
_STEPPED = ("dynamic", "frozen")
"""Kinds of dynamics with time steps in C."""
_ROUNDING = 1e-13
"""Share of a scalar's size; a smaller change by a load counts as none."""


Start = tuple[tuple[float, ...], tuple[float, ...]]
"""z and z'."""


@dataclass(frozen=True, eq=False)
class CModel:
    """A scene in C.

    Attributes
    ----------
    name : str
        Prefix of its files and C names.
    texts : mapping of str to str
        Name of a file -> its text, complete for a C compiler or CMake.
    readings : Readings or None
        Sensors of the linear equations; None without time steps.
    start : pair of tuple of float
        Initial z and z'; empty without time steps.
    """

    name: str
    model: Model
    texts: Mapping[str, str]
    readings: Readings | None
    start: Start


def c_model(
    scene: Scene, progress: Callable[[str], None] = lambda stage: None, asked: str = "--language"
) -> CModel:
    """Export a scene as a folder of C.

    It has the kernels and numbers of any scene; in space, the motion as Fourier series instead of kernels. If the
    linear equations are integrated, also these, with the initial state of the scene's run, steps of its integrator
    (radau if that has no fixed steps), the sensors, and a program that writes a run's coordinates and sensors as CSV.

    Raises
    ------
    SceneError
        Under preset ``coupled`` (see :mod:`.coupled_in_c`), and in space for motions that are not periodic.
    """
    if resolve_options(scene).dynamics == "coupled":
        raise SceneError(
            "solve.preset", "coupled", "its equations can't be exported as C",
            one_way_cure(scene, asked, integrated=False),
        )  # fmt: skip
    from kaneflex.derive.printers.c_module import generate_c, prefix_of

    if scene.is_spatial:
        check_cycle(scene, asked)
    model = integrated(load(scene, progress))
    name, texts = prefix_of(scene.name), dict[str, str]()
    data = [array_in_c("double", f"{name}_p", model.motion.parameters, "")]
    sources, declared, readings = [f"{name}.c", f"{name}_data.c"], "", None
    start: Start = (), ()
    if model.options.dynamics in _STEPPED and model.reduced.size > 0:
        progress("initial state")
        numbers, sizes, start = _linear(model, name)
        readings = sensor_readings(model)
        more, fields = _readings(readings, model, name)
        data += numbers + more
        declared = _DECLARED.format(name=name, NAME=name.upper(), sizes=sizes, **fields)
        sources += [_SHARED[1]]
        texts |= shared_texts(_SHARED)
        texts[f"{name}_run.c"] = _RUN.format(name=name, NAME=name.upper(), steps=model.options.steps)
    if scene.is_spatial:
        progress("harmonics of the motion")
        needed = sorted(_needed(model, readings))
        texts |= _motion(harmonics_of(model, needed, asked), _by_loads(model, needed, asked), model, name)
        sources += [_IN_SPACE[1]]
    else:
        texts |= generate_c(model.module, name)
    include = f'#include "{_SHARED[0]}"\n' if readings else ""
    texts[f"{name}_data.h"] = _DATA_H.format(name=name, NAME=name.upper(), include=include, declared=declared)
    texts[f"{name}_data.c"] = f'#include "{name}_data.h"\n\n' + "\n".join(data)
    texts["CMakeLists.txt"] = cmake_text(name, sources, f"{name}_run.c" in texts)
    return CModel(name, model, texts, readings, start)


def _needed(model: Model, readings: Readings | None) -> Iterable[int]:
    """Columns of the scalars that the C code reads; all known ones if there are no sensors."""
    if readings is None:
        known = np.isfinite(model.motion.table(np.zeros(1))[0])
        return np.flatnonzero(known).tolist()
    read = {int(place) for place in readings.pairs.ravel() if place < len(model.motion.column)}
    return read | {model.motion.column[each] for monomial in model.monomials for each in monomial}


def _by_loads(model: Model, columns: list[int], asked: str) -> dict[int, Harmonics]:
    """Series of the changes of scalars with each constant load, by its place in p: reactions are linear in it."""
    found, scene, p = dict[int, Harmonics](), model.scene, model.motion.parameters
    times = scene.horizon * np.array([0.0, 0.19, 0.38, 0.61])
    for place, (path, _) in enumerate(model.module.PARAMETERS):
        if not (path.startswith("loads.") and path.endswith(".value")):
            continue
        name = path[len("loads.") : -len(".value")]
        by = max(1.0, abs(p[place]))  # rounding of the difference remains small
        more = scene.loads[name].model_copy(update={"value": p[place] + by})
        other = integrated(load(scene.model_copy(update={"loads": {**scene.loads, name: more}})))
        before, after = (each.motion.table(times)[:, columns] for each in (model, other))
        moved = abs(after - before).max(axis=0) > _ROUNDING * abs(before).max(axis=0, initial=by)
        if moved.any():
            series = harmonics_of(other, np.array(columns)[moved].tolist(), asked, model.motion)
            found[place] = replace(series, drifts=series.drifts / by, numbers=series.numbers / by)
    return found


def _motion(found: Harmonics, by_loads: Mapping[int, Harmonics], model: Model, name: str) -> dict[str, str]:
    """Header and source of the motion in space: Fourier series and the functions that evaluate them."""
    from kaneflex.derive.printers.c_module import places

    NAME, scalars, module = name.upper(), list(model.motion.column), model.module
    series = {scalars[k] for k in found.columns}
    rows = [(scalar, f"{scalar} [{unit}]: {meaning}{'' if scalar in series else '; not computed'}")
            for scalar, unit, meaning in module.SCALARS]  # fmt: skip
    p = [(path, f"{path} [{unit}]") for path, unit in module.PARAMETERS]
    texts, added = list(_series(found, f"{name}_series")), list[str]()
    for place, each in by_loads.items():
        texts += _series(each, f"{name}_load_{place}")
        value = _number(model.motion.parameters[place])
        added.append(f"    kaneflex_add(&{name}_load_{place}, p[{place}] - {value}, t, s);\n")
    fields = {"name": name, "NAME": NAME, "harmonics": found.count, "error": f"{found.error:.0e}"}
    tables = f"{places(f'{NAME}_P', p, f'{NAME}_PARAMETERS')}\n\n{places(f'{NAME}_S', rows, f'{NAME}_SCALARS')}"
    head = _MOTION_H.format(tables=tables, **fields)
    unread = "" if added else "    (void)p;\n"
    source = _MOTION_C.format(series="\n".join(texts), added="".join(added), unread=unread, **fields)
    return {f"{name}.h": head, f"{name}.c": source} | shared_texts(_IN_SPACE)


def _series(found: Harmonics, name: str) -> Iterator[str]:
    """Definitions of the arrays of Fourier series and of their structure."""
    arrays: dict[str, tuple[str, Iterable[object]]] = {
        "places": ("size_t", found.columns),
        "drifts": ("double", found.drifts),
        "numbers": ("double", found.numbers.ravel()),
    }
    for key, (kind, values) in arrays.items():
        yield array_in_c(kind, f"{name}_{key}", values)
    held = ", ".join(f"{name}_{key}" for key in arrays)
    yield (f"static const kaneflex_series {name} = {{\n    {_number(found.period)}, {len(found.columns)}, "
           f"{found.count},\n    {held}\n}};\n")  # fmt: skip


def cmake_text(name: str, sources: Iterable[str], runs: bool) -> str:
    """CMake file for a library of the sources, and for NAME_run.c if there is one."""
    program = f"add_executable({name}_run {name}_run.c)\ntarget_link_libraries({name}_run {name})\n" if runs else ""
    return _CMAKE.format(name=name, sources=" ".join(sources), program=program)


def shared_texts(names: Iterable[str]) -> dict[str, str]:
    """C files that are the same for every scene."""
    return {name: (files("kaneflex.export") / name).read_text(encoding="utf-8") for name in names}


def method_in_c(model: Model) -> Method:
    """Integrator of the run if it has fixed steps, else radau."""
    method = METHODS[model.options.integrator]
    return method if method.varying else METHODS["radau"]


def _linear(model: Model, name: str) -> tuple[list[str], str, Start]:
    """Texts of the arrays of the linear equations and of their structure, their sizes, and the initial z and z'."""
    system, method, begun = model.system, method_in_c(model), solve(model).trajectory
    assert isinstance(begun, Trajectory) and method.coefficients is not None  # fixed steps
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
        "sum_constants": ("double", constants),
        "nodes": ("double", nodes),
        "weights": ("double", weights),
        "z_0": ("double", begun.z[0]),
        "v_0": ("double", begun.v[0]),
        "coordinates": ("char *const", map(c_literal, model.reduced.coordinates)),
    }
    texts = [array_in_c(kind, f"{name}_{key}", values) for key, (kind, values) in arrays.items()]
    sizes = (system.n, system.half_bandwidth, len(model.motion.column), len(places), max(method.stages, 1))
    period = model.options.steps if model.options.cycles else 0
    held = ", ".join(f"{name}_{key}" for key in arrays)
    numbers = f"{', '.join(map(str, sizes))}, {period}, {_number(model.step)}"
    numbers = f"    {numbers}, {name}_motion, {name}_p,\n    {held}\n"
    texts.append(f"const kaneflex_linear {name}_linear = {{\n{numbers}}};\n")
    return texts, ", ".join(map(str, sizes)), (tuple(begun.z[0].tolist()), tuple(begun.v[0].tolist()))


def unread(readings: Readings, model: Model) -> list[str]:
    """Sensors that the C code can't read: angles of bodies with full turns, whose number needs the history."""
    return [name for name in model.scene.sensors if name not in readings.sensors]


def _readings(readings: Readings, model: Model, name: str) -> tuple[list[str], dict[str, object]]:
    """Texts of the sensors' arrays and of their structure, and the declared sizes."""
    arrays: dict[str, tuple[str, Iterable[object]]] = {
        "stages": ("size_t", readings.stages.ravel()),
        "ends": ("size_t", readings.ends),
        "pairs": ("size_t", readings.pairs.ravel()),
        "constants": ("double", readings.constants),
        "sensors": ("char *const", map(c_literal, readings.sensors)),
    }
    texts = [array_in_c(kind, f"{name}_read_{key}", values) for key, (kind, values) in arrays.items()]
    memory = max(rows * (n + 1) + n * n for _, rows, n in readings.stages.tolist())  # x and y fit in n * n
    count, held = len(readings.sensors), ", ".join(f"{name}_read_{key}" for key in arrays)
    numbers = f"    {count}, {readings.given}, {readings.count}, {memory}, {len(readings.stages) - 1},\n    {held}\n"
    missing = ", ".join(unread(readings, model))
    sizes = {"sensors": count, "values": readings.count, "memory": max(memory, 1)}
    fields = {"left": missing and c_inline(f" Not {missing}."), **sizes}
    return [*texts, f"const kaneflex_readings {name}_readings = {{\n{numbers}}};\n"], fields


def array_in_c(kind: str, name: str, values: Iterable[Any], scope: str = "static ") -> str:
    """Definition of an array of numbers or texts, eight in a line; C has no empty arrays."""
    text: Callable[[Any], str] = _number if kind == "double" else str if kind == "char *const" else _whole
    found = [text(value) for value in values] or ["0"]
    lines = "".join(f"    {', '.join(found[k : k + 8])},\n" for k in range(0, len(found), 8))
    return f"{scope}const {kind} {name}[] = {{\n{lines}}};\n"


def _whole(value: Any) -> str:
    return str(int(value))


def _number(value: float) -> str:
    text = repr(float(value))
    return {"inf": "INFINITY", "-inf": "-INFINITY", "nan": "NAN"}.get(text, text)


_MOTION_H = """/* The rigid motion of a mechanism in space, by kaneflex. Do not edit.
 *
 * Its scalars are Fourier series of {harmonics} harmonics of the cycle, with an error of {error} of their peaks.
 * Of the numbers p it reads the values of constant loads; the others are part of the series. */
#ifndef {NAME}_H
#define {NAME}_H

#ifdef __cplusplus
extern "C" {{
#endif

{tables}

/* s at time t [s]. */
void {name}_motion(double t, const double p[], double s[]);

#ifdef __cplusplus
}}
#endif

#endif
"""
_MOTION_C = """#include "{name}.h"
#include "kaneflex_series.h"

{series}
void {name}_motion(double t, const double p[], double s[])
{{
{unread}    kaneflex_repeat(&{name}_series, t, s);
{added}}}
"""
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
/* The linear equations and the initial state of the scene's run. */
extern const kaneflex_linear {name}_linear;
#define {NAME}_MEMORY KANEFLEX_LINEAR_MEMORY({sizes})

/* What the scene's sensors read.{left} */
extern const kaneflex_readings {name}_readings;
enum {{ {NAME}_SENSORS = {sensors}, {NAME}_VALUES = {values}, {NAME}_READING_MEMORY = {memory} }};
"""
_RUN = """/* Writes one run as CSV: time [s], coordinates [m; rad where a name ends in theta or phi], sensors [SI]. */
#include "{name}_data.h"

#include <stdio.h>

static double memory[{NAME}_MEMORY], values[{NAME}_VALUES], more[{NAME}_READING_MEMORY];
static double read[{NAME}_SENSORS + 1];

int main(void)
{{
    const kaneflex_linear *model = &{name}_linear;
    const kaneflex_readings *readings = &{name}_readings;
    kaneflex_state state;
    int ended = kaneflex_start(&state, model, memory);
    printf("time");
    for (size_t i = 0; i < model->n; i++)
        printf(",\\"%s\\"", model->coordinates[i]);
    for (size_t i = 0; i < readings->count; i++)
        printf(",\\"%s\\"", readings->names[i]);
    printf("\\n");
    for (int step = 0; !ended && step <= {steps}; step++) {{
        ended = kaneflex_read(&state, readings, values, more, read);
        printf("%.17g", kaneflex_time(&state));
        for (size_t i = 0; i < model->n; i++)
            printf(",%.17g", state.z[i]);
        for (size_t i = 0; i < readings->count; i++)
            printf(",%.17g", read[i]);
        printf("\\n");
        if (!ended && step < {steps})
            ended = kaneflex_step(&state);
    }}
    if (ended)
        fprintf(stderr, "stopped at t = %.9g s: %s\\n", kaneflex_time(&state),
                ended == KANEFLEX_SINGULAR ? "a matrix is singular" : "the motion is not finite");
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
if(CMAKE_C_COMPILER_ID STREQUAL "GNU")  # products of complex numbers without a search for infinities, roots inline
  target_compile_options({name} PRIVATE -fcx-limited-range -fno-math-errno)
endif()
if(UNIX)
  target_link_libraries({name} PUBLIC m)
endif()
{program}"""
