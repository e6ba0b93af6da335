"""Texts of the C of scenes under preset ``coupled``, see :mod:`.coupled_in_c`; by D = 3 and 6 where they differ."""

from __future__ import annotations

ABOUT = {
    "about_header": "large motions of elastic bodies. All numbers are SI.\n\nA state holds a mechanism's tables and "
    "its motion; states are independent of each other. No memory is allocated.",
    "about_source": "the engine's functions, as compiled by numba, and the numbers.",
}
HEADER = """enum {{
{enumerated}
}};

/* Outcome of a run: done, singular state, change of the independent coordinates needed; other: step too small. */
enum {{ {NAME}_DONE = {DONE}, {NAME}_SINGULAR = {SINGULAR}, {NAME}_TURNED = {TURNED} }};

typedef struct {{
    int64_t plan[{NAME}_PLAN];
    double numbers[{NAME}_NUMBERS], real[{NAME}_REAL], pair[2 * {NAME}_PAIR];
    double row[{NAME}_ROW]; /* time [s] and the motion there */
    double step, last_step, sloped, counts[5];
{stored}}} {name}_state;

extern const char *const {name}_coordinate_names[];
extern const char *const {name}_force_names[];
{extern}
/* Set a state to the initial state of the scene's run. */
void {name}_start({name}_state *state);

/* Time [s] of a state. */
double {name}_time(const {name}_state *state);

{declared}
/* Integrate until an instant [s] with error-controlled steps of the scene's tolerance. Returns the outcome. In the
 * plane, and in space if a body has no inertia, the independent coordinates stay the same: the run ends if
 * a loop comes near a dead centre of these. */
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
{begun}}}

double {name}_time(const {name}_state *state)
{{
    return state->row[0];
}}

{accelerations}
int {name}_run({name}_state *state, double until)
{{
    const mechanism m = {name}_handed(state);
    double times[2] = {{state->row[0], until}}, rows[2 * {NAME}_ROW], ends[{most} + 1], none[1] = {{0.0}};
{locals}    int64_t status = {DONE};
    if (until <= state->row[0])
        return {NAME}_DONE;
    do {{
{forgotten}        double control[9] = {{
            state->step, {longest}, {at_once}, 0.0, 0.0, state->last_step, {patient}, state->sloped, 0.0
        }};
        const table *method = state->sloped == {DAMPED} ? &{name}_radau_method : &{name}_{integrator}_method;
        status = {integrate}(
            &m, method, control, state->row, none, 0, times, 2, rows, state->counts, ends, 1);
        state->step = control[0];
        state->last_step = control[5];
        state->sloped = control[7];
{turned}    }} while (status == {PAUSED});
    return (int)status;
}}

void {name}_motion({name}_state *state, double q[], double v[], double a[], double forces[])
{{
    const mechanism m = {name}_handed(state);
    {unfold}(&m, state->row{unfolded});
    for (int k = 0; k < {NAME}_COORDINATES; k++)
        q[k] = m.kept[{name}_columns_q[k]];
    for (int k = 0; k < {NAME}_{rates}; k++) {{
        v[k] = m.kept[{name}_columns_v[k]];
        a[k] = m.kept[{name}_columns_a[k]];
    }}
    for (int k = 0; k < {NAME}_FORCES; k++)
        forces[k] = {name}_unknown[k] ? NAN : m.kept[{name}_columns_forces[k]];
}}
"""
RUN_PARTS = {
    "about": "coordinates of the bodies [m, rad], forces of joints and drives [N, N m]", "header": "{name}.h",
    "memory": "static {name}_state state;\nstatic double q[{NAME}_COORDINATES], v[{NAME}_{rates}], a[{NAME}_{rates}], "
    "forces[{NAME}_FORCES + 1];",
    "begin": "int ended = {NAME}_DONE;\n    {name}_start(&state);", "advance": "{name}_run(&state, {step} * step)",
    "first": "{NAME}_COORDINATES, {name}_coordinate_names", "first_values": "q", "time": "{name}_time(&state)",
    "second": "{NAME}_FORCES, {name}_force_names", "second_values": "forces",
    "read": "{name}_motion(&state, q, v, a, forces)",
    "message": 'ended == {NAME}_SINGULAR ? "a singular state"\n                : '
    'ended == {NAME}_TURNED ? "near a dead centre of the independent coordinates" : "the step is zero"',
}  # fmt: skip
"""Parts of the program that writes a run."""

_PLANE = {
    "rates": "COORDINATES", "unfolded": ", 1, m.kept", "stored": "", "begun": "",
    "locals": "", "patient": "0.0", "at_once": "{most}", "turned": "",
    "extern": "extern const char *const {name}_free_names[];\n",
    "declared": """\
/* Accelerations a of the independent coordinates y with rates v at t [s], in the order of {name}_free_names.
 * Loops are closed starting from their last position. Returns {NAME}_DONE or {NAME}_SINGULAR. */
int {name}_accelerations({name}_state *state, double t, const double y[], const double v[], double a[]);
""",
    "accelerations": """\
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
""",
}  # fmt: skip
_SPACE = {
    "rates": "RATES", "unfolded": "",
    "stored": "    int64_t free[{NAME}_FREE + 1]; /* numbers of the independent speeds */\n",
    "begun": """\
    memcpy(state->free, {name}_free, {free} * sizeof {name}_free[0]);
""",
    "locals": "    double patient = 0.0;\n", "patient": "patient",
    "at_once": "patient != 0.0 ? {patience} : {most}",
    "extern": "extern const char *const {name}_rate_names[];\nextern const char *const {name}_position_names[];\n"
    "extern const char *const {name}_speed_names[];\n",
    "declared": """\
/* Rates of the positions y, and accelerations a of all speeds v, at t [s], in the orders of {name}_position_names and
 * {name}_speed_names. Speeds and positions that loops and drives determine are computed: those given are first guesses,
 * or not read. Returns {NAME}_DONE or {NAME}_SINGULAR. */
int {name}_accelerations(
    {name}_state *state, double t, const double y[], const double v[], double rates[], double a[]);
""",
    "accelerations": """\
int {name}_accelerations(
    {name}_state *state, double t, const double y[], const double v[], double rates[], double a[])
{{
    const mechanism m = {name}_handed(state);
    if ({project}(&m, t, (double *)y, (double *)v) != 0)
        return {NAME}_SINGULAR;
    {rates_of}(&m, rates);
    memcpy(a, m.du, {NAME}_SPEEDS * sizeof a[0]);
    return {NAME}_DONE;
}}
""",
    "turned": """\
        patient = 0.0;
        if (status == {TURNED}) {{
            const int64_t chosen = {change}(&m, state->row, (int64_t *){name}_level, state->free, {fixed});
            if (chosen != {FIXED})
                status = state->row[0] < until ? {PAUSED} : {DONE};
            if (chosen == {CHANGED})
                state->last_step = 0.0;
            else
                patient = 1.0; /* this choice is the best one: it is not checked in the next steps */
        }}
""",
}  # fmt: skip
BY_SIZE = {3: _PLANE, 6: _SPACE}
SAID = {
    3: {
            "COORDINATES": "of the bodies: x, y [m] and angle [rad] of each, then the amplitudes of its shapes [m]",
            "FORCES": "forces of joints and drives [N, N m]",
            "FREE": "independent coordinates: of joints [rad, m] and of shapes [m]",
        },
    6: {
            "COORDINATES": "of the bodies: x, y, z [m] of the start and the axes of each, then its shapes [m, rad]",
            "RATES": "of the bodies: velocity of the start and angular velocity of each, then rates of its shapes",
            "FORCES": "forces and moments of joints, then of drives [N, N m]",
            "POSITIONS": "coordinates of joints and shapes [rad, m]; a ball has a unit quaternion",
            "SPEEDS": "speeds of joints and shapes [rad/s, m/s]",
        },
}
"""Comments on lengths of arrays."""
