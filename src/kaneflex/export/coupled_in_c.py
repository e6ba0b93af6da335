"""Export of a scene under preset ``coupled`` as C11: engine, numbers, and a run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from kaneflex.export.c_text import RUN, array_in_c, cmake_text
from kaneflex.export.coupled_c_text import ABOUT, HEADER, RUN_PARTS, SAID, SOURCE
from kaneflex.multibody.compile.mechanisms import HANDED
from kaneflex.multibody.dynamics import exported_entries
from kaneflex.multibody.engine import Engine
from kaneflex.multibody.model import codes
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.time.coefficients import GAUSS, RADAU, Table
from kaneflex.multibody.time.run import PATIENT
from kaneflex.scene import Scene
from kaneflex.solve.coupled_start import Begun, begun
from kaneflex.solve.loading import load
from kaneflex.support.c_language import c_comment, c_literal, header_text
from kaneflex.support.errors import SceneError

_OUTCOMES = "DONE", "PAUSED", "TURNED", "RESTED", "SINGULAR", "DAMPED"
"""Codes of the engine in the texts."""
_STEPS = 1000
"""Steps between two checks for the end of the run."""
_OF_STATE = {
    "plan": "state->plan", "pivots": "state->plan", "kernels": "NULL", "w": "state->numbers", "real": "state->real",
    "pair": "state->pair",
}  # fmt: skip
"""Arrays of a state; the printer replaces the kernels by their names."""


def coupled_in_c(scene: Scene, progress: Callable[[str], None] = lambda stage: None) -> dict[str, str]:
    """C files by name: the engine's compiled functions printed as C, with all that they call.

    NAME.h and NAME.c compute accelerations from independent coordinates and rates, and integrate with the engine's
    steps from the scene's initial state; NAME_run.c writes a run as CSV.

    Raises
    ------
    SceneError
        For ``solve.bounded``, and a run without initial state.
    """
    model = load(scene, progress)
    if model.options.bounded:
        raise SceneError(
            "solve.bounded", ", ".join(model.options.bounded), "steps in C control the error of displacements only",
            "Leave it out, and use a smaller solve.tolerance",
        )  # fmt: skip
    progress("initial state")
    start = begun(model)
    from kaneflex.derive.printers.c_module import prefix_of
    from kaneflex.derive.printers.c_printer import Printer

    name = prefix_of(scene.name)
    progress("printing the engine")
    engine, printer = start.engine, Printer(start.engine.kernels, name)
    m = HANDED[engine.kind]
    called = {key: printer.function(each, (m, *of.args[1:]))[0] for key, (each, of) in start.entries.items()}
    given = {
        "name": name, "NAME": name.upper(), "step": repr(model.step), "most": _STEPS, "patience": PATIENT,
        "longest": repr(model.step), "step_1": repr(start.step), "sloped": start.sloped,
        "integrator": start.integrator, "IMPACTS": at.IMPACTS, **{key: getattr(codes, key) for key in _OUTCOMES},
        "FAILED": exported_entries.FAILED, "CHANGED": exported_entries.CHANGED,
        "PROJECTED": exported_entries.PROJECTED, **called,
        "extern": "\n".join(f"extern const char *const {name}_{key}_names[];" for key in start.names),
    }  # fmt: skip
    given |= {key: c_comment(f"{scene.name} under preset coupled: {text}") for key, text in ABOUT.items()} | {
        "arrays": ",\n".join(f"        {each}" for each in _arrays(engine, name, printer)), "engine": printer.text(),
        "data": "\n".join(_data(start, name)),
        "enumerated": _enumerated(_sizes(start), SAID, name.upper()),
    }  # fmt: skip
    run = {key: text.format(**given) for key, text in RUN_PARTS.items()}
    return {
        f"{name}.h": header_text(name, given["about_header"], HEADER.format(**given), "#include <stdint.h>\n\n"),
        f"{name}.c": SOURCE.format(**given),
        f"{name}_run.c": RUN.format(**run, steps=model.options.steps),
        "CMakeLists.txt": cmake_text(name, [f"{name}.c"], runs=True),
    }


def _sizes(start: Begun) -> dict[str, int]:
    """Lengths of the C arrays, by the names of the enumeration."""
    engine = start.engine
    return {
        "PLAN": len(engine.tables.plan), "NUMBERS": len(engine.tables.w), "REAL": max(1, len(engine.real)),
        "PAIR": max(1, len(engine.pair)), "ROW": len(start.row),
        **{f"{key.upper()}S": len(found) for key, found in start.names.items()},
    }  # fmt: skip


def _enumerated(sizes: dict[str, int], comments: dict[str, str], NAME: str) -> str:
    shown = [f"    {NAME}_{key} = {sizes[key]}, /* {text} */" for key, text in comments.items()]
    return "\n".join([*shown, *(f"    {NAME}_{key} = {size}," for key, size in sizes.items() if key not in comments)])


def _arrays(engine: Engine, name: str, printer: Any) -> Iterator[str]:
    """C expressions of the engine's arrays."""
    for key, kind in HANDED[engine.kind].parts.items():
        where = _OF_STATE.get(key, f"{name}_table_{key}")
        if key in engine.views:
            where = f"state->numbers + {engine.views[key][0]}"
        yield f"({printer.declared(kind)})({where})"


def _data(start: Begun, name: str) -> Iterator[str]:
    """Tables of the mechanism at the initial state."""
    engine, numbers = start.engine, start.engine.tables.w
    fixed = {f"table_{key}": each for key, each in engine.arrays.items() if key not in (*engine.views, *_OF_STATE)}
    there = np.flatnonzero((numbers != 0.0) | ~np.isfinite(numbers))
    unknown = np.array([each in start.undetermined for each in start.names["force"]], int)
    tables = {**fixed, "table_plan": engine.tables.plan, "places": there, "numbers": numbers[there], "row": start.row,
              **start.tables, "unknown": unknown}  # fmt: skip
    for key, table in tables.items():
        yield array_in_c("double" if table.dtype.kind == "f" else "int64_t", f"{name}_{key}", table.ravel())
    for key, found in start.names.items():
        yield array_in_c("char *const", f"{name}_{key}_names", map(c_literal, found), "")
    yield from _method(RADAU, f"{name}_radau")
    if start.integrator == "gauss":
        yield from _method(GAUSS, f"{name}_gauss")


def _method(table: Table, name: str) -> Iterator[str]:
    """Coefficients of the collocation method; complex ones as pairs."""
    for key, values in table._asdict().items():
        flat = np.ascontiguousarray(values).ravel()
        yield array_in_c("double", f"{name}_{key}", flat.view(float))
    kinds = {key: "double complex" if np.iscomplexobj(values) else "double" for key, values in table._asdict().items()}
    parts = (f"({kind} *){name}_{key}" for key, kind in kinds.items())
    yield f"static const table {name}_method = {{\n    {', '.join(parts)}\n}};\n"
