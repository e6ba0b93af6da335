"""Texts of the C of scenes under preset ``coupled``, see :mod:`.coupled_in_c`."""

from __future__ import annotations

ABOUT = {
    "about_header": "large motions of elastic bodies. All numbers are SI.\n\nA state holds a mechanism's tables and "
    "its motion; states are independent of each other. No memory is allocated.",
    "about_source": "the engine's functions, as compiled by numba, and the numbers.",
}
HEADER = """enum {{
{enumerated}
}};

/* Outcome of a run: done, singular state; other: the step is zero, or frictions have no consistent modes. */
enum {{ {NAME}_DONE = {DONE}, {NAME}_SINGULAR = {SINGULAR} }};

typedef struct {{
    int64_t plan[{NAME}_PLAN];
    double numbers[{NAME}_NUMBERS], real[{NAME}_REAL], pair[2 * {NAME}_PAIR];
    double row[{NAME}_ROW]; /* time [s] and the motion there */
    double step, last_step, sloped, counts[5];
}} {name}_state;

{extern}

/* Set a state to the initial state of the scene's run. */
void {name}_start({name}_state *state);

/* Time [s] of a state. */
double {name}_time(const {name}_state *state);

/* Rates of the positions y, and accelerations a of all speeds v, at t [s], in the orders of {name}_position_names and
 * {name}_speed_names. Speeds and positions that loops and drives determine are computed: those given are first guesses,
 * or not read. Returns {NAME}_DONE or {NAME}_SINGULAR. */
int {name}_accelerations(
    {name}_state *state, double t, const double y[], const double v[], double rates[], double a[]);

/* Integrate until an instant [s] with error-controlled steps of the scene's tolerance. Returns the outcome. */
int {name}_run({name}_state *state, double until);

/* Coordinates of the bodies, their rates and accelerations, and forces of joints and drives at the current time.
 * Statically indeterminate forces are NaN. */
void {name}_motion({name}_state *state, double q[], double v[], double a[], double forces[]);
"""
SOURCE = """{about_source}
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
{arrays}
    }};
    return handed;
}}

void {name}_start({name}_state *state)
{{
    memset(state, 0, sizeof *state);
    memcpy(state->plan, {name}_table_plan, sizeof {name}_table_plan);
    for (size_t k = 0; k < sizeof {name}_places / sizeof {name}_places[0]; k++)
        state->numbers[{name}_places[k]] = {name}_numbers[k];
    memcpy(state->row, {name}_row, sizeof {name}_row);
    state->step = {step_1};
    state->sloped = {sloped};
}}

double {name}_time(const {name}_state *state)
{{
    return state->row[0];
}}

int {name}_accelerations(
    {name}_state *state, double t, const double y[], const double v[], double rates[], double a[])
{{
    const mechanism m = {name}_handed(state);
    return {accelerate}(&m, t, (double *)y, (double *)v, rates, a) ? {NAME}_DONE : {NAME}_SINGULAR;
}}

int {name}_run({name}_state *state, double until)
{{
    const mechanism m = {name}_handed(state);
    double times[2] = {{state->row[0], until}}, rows[2 * {NAME}_ROW], ends[2 * ({most} + 1)], none[1] = {{0.0}};
    double patient = 0.0;
    int64_t status = {DONE};
    if (until <= state->row[0])
        return {NAME}_DONE;
    do {{
        m.w[m.plan[{IMPACTS}]] = 0.0; /* the run would wait for finished impacts to be read */
        double control[8] = {{
            state->step, {longest}, patient != 0.0 ? {patience} : {most}, 0.0, 0.0, state->last_step, patient,
            state->sloped
        }};
        const table *method = state->sloped == {DAMPED} ? &{name}_radau_method : &{name}_{integrator}_method;
        status = {integrate}(
            &m, method, control, state->row, none, 0, times, 2, rows, state->counts, ends, 1);
        state->step = control[0];
        state->last_step = control[5];
        state->sloped = control[7];
        patient = 0.0;
        if (status == {TURNED} || status == {RESTED}) {{
            const int64_t chosen = {change}(
                &m, state->row, (int64_t *){name}_level, (double *){name}_virtual, status == {RESTED});
            status = chosen == {FAILED} ? {SINGULAR} : state->row[0] < until ? {PAUSED} : {DONE};
            if (chosen == {PROJECTED})
                state->last_step = 0.0;
            else if (chosen != {CHANGED})
                patient = 1.0; /* this choice is the best one: it is not checked in the next steps */
        }}
    }} while (status == {PAUSED});
    return (int)status;
}}

void {name}_motion({name}_state *state, double q[], double v[], double a[], double forces[])
{{
    const mechanism m = {name}_handed(state);
    {read}(&m, state->row);
    for (int k = 0; k < {NAME}_COORDINATES; k++)
        q[k] = m.kept[{name}_columns_q[k]];
    for (int k = 0; k < {NAME}_RATES; k++) {{
        v[k] = m.kept[{name}_columns_v[k]];
        a[k] = m.kept[{name}_columns_a[k]];
    }}
    for (int k = 0; k < {NAME}_FORCES; k++)
        forces[k] = {name}_unknown[k] ? NAN : m.kept[{name}_columns_forces[k]];
}}
"""
RUN_PARTS = {
    "about": "coordinates of the bodies [m, rad], forces of joints and drives [N, N m]", "header": "{name}.h",
    "memory": "static {name}_state state;\nstatic double q[{NAME}_COORDINATES], v[{NAME}_RATES], a[{NAME}_RATES], "
    "forces[{NAME}_FORCES + 1];",
    "begin": "int ended = {NAME}_DONE;\n    {name}_start(&state);", "advance": "{name}_run(&state, {step} * step)",
    "first": "{NAME}_COORDINATES, {name}_coordinate_names", "first_values": "q", "time": "{name}_time(&state)",
    "second": "{NAME}_FORCES, {name}_force_names", "second_values": "forces",
    "read": "{name}_motion(&state, q, v, a, forces)",
    "message": 'ended == {NAME}_SINGULAR ? "a singular state" : "the step is zero, or modes are inconsistent"',
}  # fmt: skip
"""Parts of the program that writes a run."""

SAID = {
    "COORDINATES": "of the bodies, with one angle [rad] each or the axes in space, and amplitudes of shapes [m, rad]",
    "RATES": "of the bodies: velocity of the start and angular velocity of each, then rates of its shapes",
    "FORCES": "forces and moments of joints, then of drives [N, N m]",
    "POSITIONS": "coordinates of joints and shapes [rad, m]; a ball has a unit quaternion",
    "SPEEDS": "speeds of joints and shapes [rad/s, m/s]",
}
"""Comments on lengths of arrays."""
