"""Export of a scene as C11: kernels, numbers, and its linear equations with time steps."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from kaneflex.export.c_text import RUN, Arrays, array_in_c, cmake_text, number_in_c, shared_texts, structure_in_c
from kaneflex.integrate.methods import METHODS, Method
from kaneflex.integrate.system import Trajectory
from kaneflex.multibody.model.bound_model import Model
from kaneflex.response.polynomials import Readings, sensor_readings
from kaneflex.scene import Scene
from kaneflex.scene.options import resolve_options
from kaneflex.solve.loading import integrated, load
from kaneflex.solve.repeated_motion import Harmonics, check_cycle, harmonics_of, one_way_cure
from kaneflex.solve.simulation import solve
from kaneflex.support.c_language import c_comment, c_inline, c_literal, header_text
from kaneflex.support.errors import SceneError

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
        texts[f"{name}_run.c"] = _run_text(model, name)
    if scene.is_spatial:
        progress("harmonics of the motion")
        needed = sorted(_needed(model, readings))
        texts |= _motion(harmonics_of(model, needed, asked), _by_loads(model, needed, asked), model, name)
        sources += [_IN_SPACE[1]]
    else:
        texts |= generate_c(model.module, name)
    include = f'#include "{name}.h"\n' + f'#include "{_SHARED[0]}"\n' * (readings is not None)
    declared = f"{_NUMBERS.format(name=name, NAME=name.upper())}{declared}"
    about = "/* The numbers of the scene [SI]. */"
    texts[f"{name}_data.h"] = header_text(f"{name}_data", about, declared, f"{include}\n")
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
    texts, added = _series(found, f"{name}_series"), list[str]()
    for place, each in by_loads.items():
        texts += _series(each, f"{name}_load_{place}")
        value = number_in_c(model.motion.parameters[place])
        added.append(f"    kaneflex_add(&{name}_load_{place}, p[{place}] - {value}, t, s);\n")
    fields = {"name": name, "harmonics": found.count, "error": f"{found.error:.0e}"}
    tables = f"{places(f'{NAME}_P', p, f'{NAME}_PARAMETERS')}\n\n{places(f'{NAME}_S', rows, f'{NAME}_SCALARS')}"
    motion = f"/* s at time t [s]. */\nvoid {name}_motion(double t, const double p[], double s[]);"
    head = header_text(name, c_comment(_MOTION_H.format(**fields)), f"{tables}\n\n{motion}")
    unread = "" if added else "    (void)p;\n"
    source = _MOTION_C.format(series="\n".join(texts), added="".join(added), unread=unread, **fields)
    return {f"{name}.h": head, f"{name}.c": source} | shared_texts(_IN_SPACE)


def _series(found: Harmonics, name: str) -> list[str]:
    """Definitions of the arrays of Fourier series and of their structure."""
    arrays: Arrays = {
        "places": ("size_t", found.columns),
        "drifts": ("double", found.drifts),
        "numbers": ("double", found.numbers.ravel()),
    }
    first = f"{number_in_c(found.period)}, {len(found.columns)}, {found.count}"
    return structure_in_c("kaneflex_series", name, name, first, arrays, "static ")


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
    arrays: Arrays = {
        "product_ends": ("size_t", np.cumsum([len(each) for each in places])),
        "factors": ("size_t", [place for each in places for place in each]),
        "sum_ends": ("size_t", system.stacked.indptr[1:]),
        "sum_products": ("size_t", system.stacked.indices),
        "sum_constants": ("double", system.stacked.data),
        "nodes": ("double", nodes),
        "weights": ("double", weights),
        "z_0": ("double", begun.z[0]),
        "v_0": ("double", begun.v[0]),
        "coordinates": ("char *const", map(c_literal, model.reduced.coordinates)),
    }
    sizes = ", ".join(map(str, (system.n, system.half_bandwidth, len(model.motion.column), len(places), len(nodes))))
    period = model.options.steps if model.options.cycles else 0
    first = f"{sizes}, {period}, {number_in_c(model.step)}, {name}_motion, {name}_p"
    texts = structure_in_c("kaneflex_linear", f"{name}_linear", name, first, arrays)
    return texts, sizes, (tuple(begun.z[0].tolist()), tuple(begun.v[0].tolist()))


def unread(readings: Readings, model: Model) -> list[str]:
    """Sensors that the C code can't read: angles of bodies with full turns, whose number needs the history."""
    return [name for name in model.scene.sensors if name not in readings.sensors]


def _readings(readings: Readings, model: Model, name: str) -> tuple[list[str], dict[str, object]]:
    """Texts of the sensors' arrays and of their structure, and the declared sizes."""
    arrays: Arrays = {
        "stages": ("size_t", readings.stages.ravel()),
        "ends": ("size_t", readings.ends),
        "pairs": ("size_t", readings.pairs.ravel()),
        "constants": ("double", readings.constants),
        "sensors": ("char *const", map(c_literal, readings.sensors)),
    }
    memory = max(rows * (n + 1) + n * n for _, rows, n in readings.stages.tolist())  # x and y fit in n * n
    count = len(readings.sensors)
    first = f"{count}, {readings.given}, {readings.count}, {memory}, {len(readings.stages) - 1}"
    texts = structure_in_c("kaneflex_readings", f"{name}_readings", f"{name}_read", first, arrays)
    missing = ", ".join(unread(readings, model))
    sizes = {"sensors": count, "values": readings.count, "memory": max(memory, 1)}
    return texts, {"left": missing and c_inline(f" Not {missing}."), **sizes}


def _run_text(model: Model, name: str) -> str:
    NAME, linear, readings = name.upper(), f"{name}_linear", f"{name}_readings"
    return RUN.format(
        about="coordinates [m; rad where a name ends in theta or phi], sensors [SI]", header=f"{name}_data.h",
        memory=f"static double memory[{NAME}_MEMORY], values[{NAME}_VALUES], more[{NAME}_READING_MEMORY];\n"
        f"static double read[{NAME}_SENSORS + 1];",
        begin=f"kaneflex_state state;\n    int ended = kaneflex_start(&state, &{linear}, memory);",
        first=f"{linear}.n, {linear}.coordinates", first_values="state.z", steps=model.options.steps,
        second=f"{readings}.count, {readings}.names", second_values="read", time="kaneflex_time(&state)",
        read=f"ended = kaneflex_read(&state, &{readings}, values, more, read)", advance="kaneflex_step(&state)",
        message='ended == KANEFLEX_SINGULAR ? "a matrix is singular" : "the motion is not finite"',
    )  # fmt: skip


_MOTION_H = """The rigid motion of a mechanism in space, by kaneflex. Do not edit.

Its scalars are Fourier series of {harmonics} harmonics of the cycle, with an error of {error} of their peaks.
Of the numbers p it reads the values of constant loads; the others are part of the series."""
_MOTION_C = """#include "{name}.h"
#include "kaneflex_series.h"

{series}
void {name}_motion(double t, const double p[], double s[])
{{
{unread}    kaneflex_repeat(&{name}_series, t, s);
{added}}}
"""
_NUMBERS = """/* {NAME}_PARAMETERS numbers, then the blocks of the tables. */
extern const double {name}_p[];
"""
_DECLARED = """
/* The linear equations and the initial state of the scene's run, for the numbers above. Only numbers of drives and
 * loads may be changed, as lengths and masses are also in constants. Another start than zero then no longer fits. */
extern const kaneflex_linear {name}_linear;
#define {NAME}_MEMORY KANEFLEX_LINEAR_MEMORY({sizes})

/* What the scene's sensors read.{left} */
extern const kaneflex_readings {name}_readings;
enum {{ {NAME}_SENSORS = {sensors}, {NAME}_VALUES = {values}, {NAME}_READING_MEMORY = {memory} }};
"""
