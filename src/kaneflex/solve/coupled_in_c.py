"""Export of a scene under preset ``coupled`` as C11: engine, numbers, and a run."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from kaneflex.multibody.compile.library import ENTRIES
from kaneflex.multibody.dynamics import load_derivatives, unfolding
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.system import CoupledSystem
from kaneflex.multibody.time import collocation
from kaneflex.multibody.time.coefficients import GAUSS, RADAU, Table
from kaneflex.multibody.time.run import Run
from kaneflex.multibody.time.trajectory import CoupledTrajectory
from kaneflex.scene import Scene
from kaneflex.solve.c_model import array_in_c, cmake_text
from kaneflex.solve.coupled import beginning, method_of
from kaneflex.solve.loading import load
from kaneflex.solve.one_way import one_way_cure
from kaneflex.solve.simulation import simulate
from kaneflex.support.errors import SceneError
from kaneflex.support.escaping import c_comment, c_literal

_STEPS = 1000
"""Steps between two checks for the end of the run."""


def coupled_in_c(scene: Scene, progress: Callable[[str], None] = lambda stage: None) -> dict[str, str]:
    """C files by name: the engine's compiled functions printed as C, with all that they call.

    NAME.h and NAME.c compute accelerations from independent coordinates and rates, and integrate with the engine's
    steps from the scene's initial state; NAME_run.c writes a run as CSV.

    Raises
    ------
    SceneError
        For contacts, clearances, friction, discontinuous laws and mechanisms in space, which are not exported as C;
        for ``solve.bounded``, and a run without initial state.
    """
    if scene.is_spatial:
        reason = "mechanisms in space can't be exported as C with it"
        raise SceneError("solve.preset", "coupled", reason, one_way_cure(scene, "--language", integrated=False))
    model = load(scene, progress)
    system = model.coupled
    assert system is not None
    if model.options.bounded:
        raise SceneError(
            "solve.bounded", ", ".join(model.options.bounded), "steps in C control the error of displacements only",
            "Leave it out, and use a smaller solve.tolerance",
        )  # fmt: skip
    _check_untouched(scene, system)
    progress("initial state")
    run = _begun(model)
    from kaneflex.derive.c_module import prefix_of

    name = prefix_of(scene.name)
    progress("printing the engine")
    sizes = _sizes(run)
    data = "\n".join(_data(run, name))
    about = {key: c_comment(f"{scene.name} under preset coupled: {text}") for key, text in _ABOUT.items()}
    given = {
        "name": name, "NAME": name.upper(), **about, "data": data, **_engine(run, name),
        "enumerated": _enumerated(sizes, name.upper()), "steps": model.options.steps, "step": repr(model.step),
        "most": _STEPS, "longest": repr(run.longest), "free": sizes["FREE"], "Y": at.Y, "RATE": at.RATE,
        "ACCEL": at.ACCEL, "DONE": collocation.DONE, "PAUSED": collocation.PAUSED, "TURNED": collocation.TURNED,
        "SINGULAR": collocation.SINGULAR, "integrator": run.method.integrator, "DAMPED": load_derivatives.DAMPED,
    }  # fmt: skip
    return {
        f"{name}.h": _HEADER.format(**given),
        f"{name}.c": _SOURCE.format(**given),
        f"{name}_run.c": _RUN.format(**given),
        "CMakeLists.txt": cmake_text(name, [f"{name}.c"], runs=True),
    }


def _check_untouched(scene: Scene, system: CoupledSystem) -> None:
    """Raise SceneError for contacts, friction and discontinuous loads, which are not exported as C."""
    touching = (*system.mechanism.contacts, *system.mechanism.frictions)
    switched = getattr(system.module, "SWITCHES", ())
    if not (touching or switched or len(system.engine.contacts) or len(system.engine.holds)):
        return
    cure = one_way_cure(scene, "--language", integrated=False)
    if touching:
        table = "contacts" if touching[0] in scene.raw.get("contacts", {}) else "joints"
        key, reason = f"{table}.{touching[0]}", "contacts and friction can't be exported as C"
    elif switched:
        key, reason = f"loads.{switched[0]}", "discontinuous loads can't be exported as C"
    else:
        key, reason = "solve.preset", "bodies without inertia can't be exported as C"
    raise SceneError(key, None, reason, cure)


def _begun(model: Model) -> Run:
    """A run at its first instant, with the engine's tables at that state."""
    system = model.coupled
    assert system is not None
    times = model.step * np.arange(model.options.steps + 1)
    if model.options.start == "periodic":
        found = simulate(model).trajectory
        assert isinstance(found, CoupledTrajectory)
        if not len(found.times):
            raise SceneError("solve.start", "periodic", found.message, "Start from zero")
        q, v = found.q[0], found.v[0]
    else:
        q, v = beginning(model)
    run = Run(system, q, v, times, method_of(model), np.zeros(0))
    if not run.projected:
        reason = "the mechanism is in a singular position at the start"
        raise SceneError("solve.start", model.options.start, reason, "Start from another position")
    return run


def _sizes(run: Run) -> dict[str, int]:
    """Lengths of the C arrays, by the names of the enumeration."""
    engine, system = run.engine, run.system
    return {
        "PLAN": len(engine.tables.plan), "NUMBERS": len(engine.tables.w), "REAL": max(1, len(engine.real)),
        "PAIR": max(1, len(engine.pair)), "ROW": len(run.here), "FREE": len(engine.independent),
        "COORDINATES": system.size, "FORCES": len(system.constraints), "TREE": engine.size,
        "EXERTED": 3 * engine.count(at.BODIES) + engine.count(at.REACTIONS) + 5,  # room for one
        # contact: the compiler can't see that the loop over contacts is empty
        "WORKS": engine.count(at.WORKS),
    }  # fmt: skip


_SAID = {
    "COORDINATES": "of the bodies: x, y [m] and angle [rad] of each, then the amplitudes of its shapes [m]",
    "FORCES": "forces of joints and drives [N, N m]",
    "FREE": "independent coordinates: of joints [rad, m] and of shapes [m]",
}


def _enumerated(sizes: dict[str, int], NAME: str) -> str:
    shown = [f"    {NAME}_{key} = {sizes[key]}, /* {said} */" for key, said in _SAID.items()]
    return "\n".join([*shown, *(f"    {NAME}_{key} = {size}," for key, size in sizes.items() if key not in _SAID)])


def _engine(run: Run, name: str) -> dict[str, str]:
    """Text ``engine`` of the entry functions and all that they call, and their names in C."""
    from kaneflex.derive.printers.c_printer import Printer

    printer = Printer(run.engine.kernels, name)
    entries = {"project": collocation.project, "integrate": collocation.integrate, "unfold": unfolding.unfold}
    names = {key: printer.function(entry, ENTRIES[entry].args)[0] for key, entry in entries.items()}
    return {"engine": printer.text(), **names}


def _data(run: Run, name: str) -> Iterator[str]:
    """Tables of the mechanism at the initial state."""
    engine, system = run.engine, run.system
    plan, bodies, sections, acts, w = engine.tables
    for key, table in (("plan", plan), ("bodies", bodies), ("sections", sections), ("acts", acts)):
        yield array_in_c("int64_t", f"{name}_{key}", table.ravel())
    there = np.flatnonzero((w != 0.0) | ~np.isfinite(w))
    yield array_in_c("int64_t", f"{name}_places", there)
    yield array_in_c("double", f"{name}_numbers", w[there])
    yield array_in_c("double", f"{name}_p", engine.p)
    yield array_in_c("double", f"{name}_row", run.here)
    yield array_in_c("int64_t", f"{name}_order", system.order)
    yield array_in_c("int64_t", f"{name}_exerted", system.exerted)
    yield array_in_c("int64_t", f"{name}_unknown", [name_ in system.undetermined for name_ in system.constraints])
    yield array_in_c("int64_t", f"{name}_free", engine.independent)
    names = {"coordinate": [key for key, _ in system.coordinates], "force": system.constraints, "free": engine.names}
    for key, found in names.items():
        yield array_in_c("char *const", f"{name}_{key}_names", map(c_literal, found), "")
    yield f"static const double {name}_first_step = {run.step!r};\n"
    yield from _method(RADAU, f"{name}_radau")
    if run.method.integrator == "gauss":
        yield from _method(GAUSS, f"{name}_gauss")


def _method(table: Table, name: str) -> Iterator[str]:
    """Coefficients of the collocation method; complex ones as pairs."""
    for key, values in table._asdict().items():
        flat = np.ascontiguousarray(values).ravel()
        yield array_in_c("double", f"{name}_{key}", flat.view(float))
    kinds = {key: "double complex" if np.iscomplexobj(values) else "double" for key, values in table._asdict().items()}
    parts = (f"({kind} *){name}_{key}" for key, kind in kinds.items())
    yield f"static const table {name}_method = {{\n    {', '.join(parts)}\n}};\n"


_ABOUT = {
    "about_header": "large motions of elastic bodies. All numbers are SI.\n\nA state holds a mechanism's tables and "
    "its motion; states are independent of each other. No memory is allocated.",
    "about_source": "the engine's functions, as compiled by numba, and the numbers.",
}
_HEADER = """{about_header}
#ifndef {NAME}_H
#define {NAME}_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {{
#endif

enum {{
{enumerated}
}};

/* Outcome of a run: done, singular state, change of the independent coordinates needed; other: step too small. */
enum {{ {NAME}_DONE = {DONE}, {NAME}_SINGULAR = {SINGULAR}, {NAME}_TURNED = {TURNED} }};

typedef struct {{
    int64_t plan[{NAME}_PLAN];
    double numbers[{NAME}_NUMBERS], real[{NAME}_REAL], pair[2 * {NAME}_PAIR];
    double row[{NAME}_ROW]; /* time [s] and the motion there */
    double step, last_step, sloped, counts[5];
}} {name}_state;

extern const char *const {name}_coordinate_names[];
extern const char *const {name}_force_names[];
extern const char *const {name}_free_names[];

/* Set a state to the initial state of the scene's run. */
void {name}_start({name}_state *state);

/* Time [s] of a state. */
double {name}_time(const {name}_state *state);

/* Accelerations a of the independent coordinates y with rates v at t [s], in the order of {name}_free_names.
 * Loops are closed starting from their last position. Returns {NAME}_DONE or {NAME}_SINGULAR. */
int {name}_accelerations({name}_state *state, double t, const double y[], const double v[], double a[]);

/* Integrate until an instant [s] with error-controlled steps of the scene's tolerance. Returns the outcome. The
 * independent coordinates stay the same: the run ends if a loop comes near a dead centre of these. */
int {name}_run({name}_state *state, double until);

/* Coordinates of the bodies, their rates and accelerations, and forces of joints and drives at the current time.
 * Statically indeterminate forces are NaN. */
void {name}_motion({name}_state *state, double q[], double v[], double a[], double forces[]);

#ifdef __cplusplus
}}
#endif

#endif
"""
_SOURCE = """{about_source}
#include "{name}.h"

#include <complex.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

{engine}
{data}
static mechanism {name}_handed({name}_state *state)
{{
    const mechanism handed = {{
        state->plan, {name}_bodies, {name}_sections, {name}_acts, state->numbers, state->plan,
        NULL, (double *){name}_p, state->real, (double complex *)state->pair
    }};
    return handed;
}}

void {name}_start({name}_state *state)
{{
    memset(state, 0, sizeof *state);
    memcpy(state->plan, {name}_plan, sizeof {name}_plan);
    for (size_t k = 0; k < sizeof {name}_places / sizeof {name}_places[0]; k++)
        state->numbers[{name}_places[k]] = {name}_numbers[k];
    memcpy(state->row, {name}_row, sizeof {name}_row);
    state->step = {name}_first_step;
}}

double {name}_time(const {name}_state *state)
{{
    return state->row[0];
}}

int {name}_accelerations({name}_state *state, double t, const double y[], const double v[], double a[])
{{
    const mechanism m = {name}_handed(state);
    for (int k = 0; k < {free}; k++) {{
        m.w[m.plan[{Y}] + {name}_free[k]] = y[k];
        m.w[m.plan[{RATE}] + {name}_free[k]] = v[k];
    }}
    if (!{project}(&m, t))
        return {NAME}_SINGULAR;
    for (int k = 0; k < {free}; k++)
        a[k] = m.w[m.plan[{ACCEL}] + {name}_free[k]];
    return {NAME}_DONE;
}}

int {name}_run({name}_state *state, double until)
{{
    const mechanism m = {name}_handed(state);
    double times[2] = {{state->row[0], until}}, rows[2 * {NAME}_ROW], ends[{most} + 1], none[1] = {{0.0}};
    int64_t status = {DONE};
    if (until <= state->row[0])
        return {NAME}_DONE;
    do {{
        double control[9] = {{state->step, {longest}, {most}, 0.0, 0.0, state->last_step, 0.0, state->sloped, 0.0}};
        const table *method = state->sloped == {DAMPED} ? &{name}_radau_method : &{name}_{integrator}_method;
        status = {integrate}(
            &m, method, control, state->row, none, 0, times, 2, rows, state->counts, ends, 1);
        state->step = control[0];
        state->last_step = control[5];
        state->sloped = control[7];
    }} while (status == {PAUSED});
    return (int)status;
}}

void {name}_motion({name}_state *state, double q[], double v[], double a[], double forces[])
{{
    const mechanism m = {name}_handed(state);
    double moved[3][{NAME}_COORDINATES], exerted[{NAME}_EXERTED], sums[4], rates[{NAME}_WORKS];
    {unfold}(&m, state->row, 1, moved[0], moved[1], moved[2], exerted, sums, rates);
    for (int k = 0; k < {NAME}_COORDINATES; k++) {{
        q[{name}_order[k]] = moved[0][k];
        v[{name}_order[k]] = moved[1][k];
        a[{name}_order[k]] = moved[2][k];
    }}
    for (int k = 0; k < {NAME}_FORCES; k++)
        forces[k] = {name}_unknown[k] ? NAN : exerted[{name}_exerted[k]];
}}
"""
_RUN = """/* Writes a run as CSV: time [s], coordinates of the bodies [m, rad], forces of joints and drives [N, N m]. */
#include "{name}.h"

#include <stdio.h>

static {name}_state state;

int main(void)
{{
    static double q[{NAME}_COORDINATES], v[{NAME}_COORDINATES], a[{NAME}_COORDINATES], forces[{NAME}_FORCES + 1];
    int ended = {NAME}_DONE;
    {name}_start(&state);
    printf("time");
    for (int k = 0; k < {NAME}_COORDINATES; k++)
        printf(",\\"%s\\"", {name}_coordinate_names[k]);
    for (int k = 0; k < {NAME}_FORCES; k++)
        printf(",\\"%s\\"", {name}_force_names[k]);
    printf("\\n");
    for (int step = 0; step <= {steps}; step++) {{
        if (step > 0)
            ended = {name}_run(&state, {step} * step);
        if (ended != {NAME}_DONE)
            break;
        {name}_motion(&state, q, v, a, forces);
        printf("%.17g", {name}_time(&state));
        for (int k = 0; k < {NAME}_COORDINATES; k++)
            printf(",%.17g", q[k]);
        for (int k = 0; k < {NAME}_FORCES; k++)
            printf(",%.17g", forces[k]);
        printf("\\n");
    }}
    if (ended != {NAME}_DONE)
        fprintf(stderr, "stopped at t = %.9g s: %s\\n", {name}_time(&state),
                ended == {NAME}_SINGULAR ? "a singular state"
                : ended == {NAME}_TURNED ? "near a dead centre of the independent coordinates" : "the step is zero");
    return ended;
}}
"""
