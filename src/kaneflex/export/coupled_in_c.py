"""Export of a scene under preset ``coupled`` as C11: engine, numbers, and a run."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from kaneflex.export.c_text import RUN, array_in_c, cmake_text
from kaneflex.export.coupled_c_text import ABOUT, HEADER, RUN_PARTS, SAID, SOURCE
from kaneflex.mechanism.spatial_frame import AXES
from kaneflex.multibody.compile.entries import EXPORTED
from kaneflex.multibody.compile.mechanisms import HANDED, typed
from kaneflex.multibody.dynamics import exported_entries
from kaneflex.multibody.engine import Engine
from kaneflex.multibody.model import codes
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.state import State
from kaneflex.multibody.time.coefficients import GAUSS, RADAU, Table
from kaneflex.multibody.time.run import PATIENT, Run
from kaneflex.multibody.time.trajectory import CoupledTrajectory
from kaneflex.scene import Scene
from kaneflex.scene.options import resolve_options
from kaneflex.solve.coupled import beginning, method_of
from kaneflex.solve.loading import load
from kaneflex.solve.simulation import simulate
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
_PLACE = {3: ("x", "y", "phi"), 6: (*"xyz", *(f"axes_{name}" for name in AXES))}
_TWIST = {3: ("v_x", "v_y", "omega"), 6: tuple(f"{what}_{axis}" for what in ("v", "omega") for axis in "xyz")}
"""Coordinates and rates of a body's frame, by D."""
_SCRATCH = (at.COURSE, at.INPUT), (at.SUMS, at.SCALE), (at.GRADIENT, at.CONTACT), (at.WAYS, at.CROSSING)
"""Ranges of numbers that every evaluation fills before it reads them; the holds' numbers precede CONTACT."""
_FILLED = (
    "r", "twist", "rate", "exerted", "along", "springs", "energies", "powers", "sizes", "y", "P", "moved", "wrenches",
    "slow", "rows", "bent", "S", "phi", "M", "F", "alpha", "x", "geometry",
)  # fmt: skip
"""Arrays of that kind."""
_LEAST = 1e-6
"""Share of the largest inertia of a speed below which virtual inertia is that one's."""


def coupled_in_c(scene: Scene, progress: Callable[[str], None] = lambda stage: None) -> dict[str, str]:
    """C files by name: the engine's compiled functions printed as C, with all that they call.

    NAME.h and NAME.c compute accelerations from independent coordinates and rates, and integrate with the engine's
    steps from the scene's initial state; NAME_run.c writes a run as CSV.

    Raises
    ------
    SceneError
        For other presets than ``coupled``, for ``solve.bounded``, and a run without initial state.
    """
    options = resolve_options(scene)
    if options.dynamics != "coupled":
        raise SceneError(
            "solve.preset", options.preset, "the engine is printed in C for large motions", "Choose preset coupled"
        )
    model = load(scene, progress)
    if model.options.bounded:
        raise SceneError(
            "solve.bounded", ", ".join(model.options.bounded), "steps in C control the error of displacements only",
            "Leave it out, and use a smaller solve.tolerance",
        )  # fmt: skip
    progress("initial state")
    start = begun(model)
    bodies, forces, undetermined = _reactions(model)
    from kaneflex.derive.printers.c_module import prefix_of
    from kaneflex.derive.printers.c_printer import Printer

    name = prefix_of(scene.name)
    progress("printing the engine")
    engine, printer = start.engine, Printer(start.engine.kernels, name)
    m, names = HANDED[engine.kind], _names(engine, bodies) | {"force": forces}
    called = {each.__name__: printer.function(each, (m, *of.args[1:]))[0] for each, of in typed(EXPORTED, m).items()}
    given = {
        "name": name, "NAME": name.upper(), "step": repr(model.step), "most": _STEPS, "patience": PATIENT,
        "longest": repr(model.step), "step_1": repr(start.step), "sloped": start.sloped,
        "integrator": start.method.integrator, "IMPACTS": at.IMPACTS, **{key: getattr(codes, key) for key in _OUTCOMES},
        "FAILED": exported_entries.FAILED, "CHANGED": exported_entries.CHANGED,
        "PROJECTED": exported_entries.PROJECTED, **called,
        "extern": "\n".join(f"extern const char *const {name}_{key}_names[];" for key in names),
    }  # fmt: skip
    given |= {key: c_comment(f"{scene.name} under preset coupled: {text}") for key, text in ABOUT.items()} | {
        "arrays": ",\n".join(f"        {each}" for each in _arrays(engine, name, printer)), "engine": printer.text(),
        "data": "\n".join(_data(start, name, names, undetermined)),
        "enumerated": _enumerated(_sizes(start, names), SAID, name.upper()),
    }  # fmt: skip
    run = {key: text.format(**given) for key, text in RUN_PARTS.items()}
    return {
        f"{name}.h": header_text(name, given["about_header"], HEADER.format(**given), "#include <stdint.h>\n\n"),
        f"{name}.c": SOURCE.format(**given),
        f"{name}_run.c": RUN.format(**run, steps=model.options.steps),
        "CMakeLists.txt": cmake_text(name, [f"{name}.c"], runs=True),
    }


def begun(model: Model) -> Run:
    """Run of a coupled model at its first instant. Raises SceneError if it has none."""
    start = beginning(model) if model.options.start != "periodic" else _periodic(model)
    times = model.step * np.arange(model.options.steps + 1)
    run = Run(model.coupled_system, start, times, method_of(model))
    if not run.projected:
        reason = "the mechanism is in a singular position at the start"
        raise SceneError("solve.start", model.options.start, reason, "Start from another position")
    return run


def _periodic(model: Model) -> State:
    """Start of a periodic motion."""
    found = simulate(model).trajectory
    assert isinstance(found, CoupledTrajectory)
    if not len(found.times):
        raise SceneError("solve.start", "periodic", found.message, "Start from zero")
    start: State = found.curve.start
    return start


def _virtual_inertia(engine: Engine) -> np.ndarray:
    """Virtual inertia of the speeds without drives, of the size of their own; zero if all bodies have inertia."""
    found = np.zeros(engine.size)
    if engine.light:
        free, inertia = engine.open_speeds, engine.mass().diagonal()
        most = (inertia * engine.measure**2).max(initial=0.0) / engine.measure**2
        found[free] = np.where(inertia > _LEAST * most, inertia, most)[free]
    return found


def _reactions(model: Model) -> tuple[Iterable[str], Sequence[str], Collection[str]]:
    """Bodies, joint and drive forces in the order of the record, and forces that are statically indeterminate."""
    system, motion = model.coupled, model.coupled_in_space
    if system is not None:
        return system.mechanism.bodies, system.constraints, system.undetermined
    assert motion is not None
    system = motion.module.system
    return system.layout.node_of, system.constraints, motion.module.open_reactions


def _names(engine: Engine, bodies: Iterable[str]) -> dict[str, Sequence[str]]:
    """Names of the entries of arrays: coordinates of these bodies, then of joints and shapes."""
    layout, coordinates, rates = engine.layout, list[str](), list[str]()
    for body in bodies:
        shapes = [layout.positions[k][0] for k in engine.amplitudes(body)[0]]
        coordinates += [f"{body}.{part}" for part in _PLACE[engine.kind.d]] + shapes
        rates += [f"{body}.{part}" for part in _TWIST[engine.kind.d]] + [f"{shape}_rate" for shape in shapes]
    positions = [name for name, _ in layout.positions]
    return {"coordinate": coordinates, "rate": rates, "position": positions, "speed": layout.speeds}


def _sizes(start: Run, names: Mapping[str, Sequence[str]]) -> dict[str, int]:
    """Lengths of the C arrays, by the names of the enumeration."""
    engine = start.engine
    return {
        "PLAN": len(engine.tables.plan), "NUMBERS": len(engine.tables.w), "REAL": max(1, len(engine.real)),
        "PAIR": max(1, len(engine.pair)), "ROW": len(start.state),
        **{f"{key.upper()}S": len(found) for key, found in names.items()},
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


def _data(
    start: Run, name: str, names: Mapping[str, Sequence[str]], undetermined: Collection[str]
) -> Iterator[str]:
    """Tables of the mechanism at the initial state; ``undetermined``: forces that are NaN."""
    engine, numbers, record = start.engine, _without_scratch(start), start.system.record
    virtual = _virtual_inertia(engine)
    fixed = {f"table_{key}": each for key, each in engine.arrays.items() if key not in (*engine.views, *_OF_STATE)}
    there = np.flatnonzero((numbers != 0.0) | ~np.isfinite(numbers))
    columns = {f"columns_{key}": getattr(record, key) for key in ("q", "v", "a", "forces")}
    tables = {**fixed, "table_plan": engine.tables.plan, "places": there, "numbers": numbers[there], "row": start.state,
              **columns, "level": engine.levels, "virtual": virtual,
              "unknown": np.array([each in undetermined for each in names["force"]], int)}  # fmt: skip
    for key, table in tables.items():
        yield array_in_c("double" if table.dtype.kind == "f" else "int64_t", f"{name}_{key}", table.ravel())
    for key, found in names.items():
        yield array_in_c("char *const", f"{name}_{key}_names", map(c_literal, found), "")
    yield from _method(RADAU, f"{name}_radau")
    if start.method.integrator == "gauss":
        yield from _method(GAUSS, f"{name}_gauss")


def _without_scratch(start: Run) -> np.ndarray:
    """Numbers of the tables at the start of a run, with zeros in place of what was evaluated before."""
    engine, plan = start.engine, start.engine.tables.plan
    engine.unfold(start.state[None])  # so that the bodies' axes are those of the start
    numbers = engine.tables.w.copy()
    for first, end in _SCRATCH:
        numbers[plan[first] : plan[end] - at.CONTACT_SIZE * len(engine.frictions) * (end == at.CONTACT)] = 0.0
    for first, shape in (engine.views[name] for name in _FILLED):
        numbers[first : first + np.prod(shape, dtype=int)] = 0.0
    return numbers


def _method(table: Table, name: str) -> Iterator[str]:
    """Coefficients of the collocation method; complex ones as pairs."""
    for key, values in table._asdict().items():
        flat = np.ascontiguousarray(values).ravel()
        yield array_in_c("double", f"{name}_{key}", flat.view(float))
    kinds = {key: "double complex" if np.iscomplexobj(values) else "double" for key, values in table._asdict().items()}
    parts = (f"({kind} *){name}_{key}" for key, kind in kinds.items())
    yield f"static const table {name}_method = {{\n    {', '.join(parts)}\n}};\n"
