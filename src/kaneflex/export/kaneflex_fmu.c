#include "kaneflex_fmu.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Of a step: instants closer than this are the same. */
#define SAME 1e-9

static void lay_out(kaneflex_instance *instance)
{
    const kaneflex_fmu_model *m = &kaneflex_fmu;
    const size_t n = m->linear->n;
    instance->numbers = (double *)(instance + 1);
    instance->memory = instance->numbers + m->numbers;
    instance->before = instance->memory + m->memory;
    instance->shown = instance->before + 3 * n;
    instance->work = instance->shown + m->readings->values;
    instance->sensors = instance->work + m->readings->memory;
    instance->count = (size_t)(instance->sensors + m->readings->count - instance->numbers);
}

static size_t size(void)
{
    const kaneflex_fmu_model *m = &kaneflex_fmu;
    const size_t shown = m->readings->values + m->readings->memory + m->readings->count;
    return sizeof(kaneflex_instance) + sizeof(double) * (m->numbers + m->memory + 3 * m->linear->n + shown);
}

kaneflex_instance *kaneflex_make(int steps_itself)
{
    kaneflex_instance *instance = calloc(1, size());
    if (!instance)
        return NULL;
    lay_out(instance);
    instance->steps_itself = steps_itself;
    kaneflex_reset(instance);
    return instance;
}

int kaneflex_reset(kaneflex_instance *instance)
{
    memcpy(instance->numbers, kaneflex_fmu.linear->p, kaneflex_fmu.numbers * sizeof(double));
    instance->time = 0.0;
    instance->begun = 0;
    instance->stale = 1;
    const int ended = kaneflex_start(&instance->state, kaneflex_fmu.linear, instance->memory);
    instance->state.p = instance->numbers;
    return ended;
}

int kaneflex_begin(kaneflex_instance *instance)
{
    kaneflex_state *state = &instance->state;
    const int ended = kaneflex_accelerations(state, instance->time);
    for (size_t i = 0; i < state->model->n; i++)
        state->q[i] = state->a[i];
    instance->begun = instance->stale = 1;
    return ended;
}

/* The quintic through z, v, a at both ends of the last step, at its share x. */
static void between(kaneflex_instance *instance, double x, double *z, double *v, double *a)
{
    const kaneflex_state *state = &instance->state;
    const size_t n = state->model->n;
    const double h = state->model->step, *was = instance->before;
    for (size_t i = 0; i < n; i++) {
        const double z0 = was[i], v0 = h * was[n + i], a0 = h * h * was[2 * n + i];
        const double dz = state->z[i] - z0 - v0 - 0.5 * a0, dv = h * state->v[i] - v0 - a0;
        const double da = h * h * state->a[i] - a0;
        const double c3 = 10.0 * dz - 4.0 * dv + 0.5 * da, c4 = -15.0 * dz + 7.0 * dv - da;
        const double c5 = 6.0 * dz - 3.0 * dv + 0.5 * da;
        z[i] = z0 + x * (v0 + x * (0.5 * a0 + x * (c3 + x * (c4 + x * c5))));
        v[i] = (v0 + x * (a0 + x * (3.0 * c3 + x * (4.0 * c4 + x * 5.0 * c5)))) / h;
        a[i] = (a0 + x * (6.0 * c3 + x * (12.0 * c4 + x * 20.0 * c5))) / (h * h);
    }
}

/* s, z, v, a and sensors of the time. */
static int show(kaneflex_instance *instance)
{
    kaneflex_state *state = &instance->state;
    const kaneflex_linear *m = state->model;
    const size_t n = m->n;
    double *z = instance->shown + m->scalars, *v = z + n, *a = v + n;
    if (!instance->stale)
        return KANEFLEX_OK;
    if (!instance->steps_itself || !instance->begun) {
        const int ended = kaneflex_accelerations(state, instance->time);
        if (ended)
            return ended;
    }
    const double ahead = kaneflex_time(state) - instance->time;
    if (instance->steps_itself && ahead > SAME * m->step)
        between(instance, 1.0 - ahead / m->step, z, v, a);
    else {
        memcpy(z, state->z, n * sizeof(double));
        memcpy(v, state->v, n * sizeof(double));
        memcpy(a, state->a, n * sizeof(double));
    }
    memset(instance->shown, 0, m->scalars * sizeof(double));
    m->motion(instance->time, instance->numbers, instance->shown);
    const int ended = kaneflex_sense(kaneflex_fmu.readings, instance->shown, instance->work, instance->sensors);
    instance->stale = ended != KANEFLEX_OK;
    return ended;
}

int kaneflex_get(kaneflex_instance *instance, const unsigned references[], size_t count, double values[])
{
    const size_t n = kaneflex_fmu.linear->n, settable = kaneflex_fmu.settable;
    for (size_t k = 0; k < count; k++) {
        size_t place = references[k];
        if (place == 0) {
            values[k] = instance->time;
            continue;
        }
        if (--place < settable) {
            values[k] = instance->numbers[kaneflex_fmu.places[place]];
            continue;
        }
        const int ended = show(instance);
        if (ended)
            return ended;
        place -= settable;
        const double *moved = instance->shown + kaneflex_fmu.linear->scalars;
        if (place < 4 * n)
            values[k] = moved[place < 2 * n ? place : place - n]; /* z, v; then v, a */
        else if (place - 4 * n < kaneflex_fmu.readings->count)
            values[k] = instance->sensors[place - 4 * n];
        else
            return KANEFLEX_UNKNOWN;
    }
    return KANEFLEX_OK;
}

int kaneflex_set(kaneflex_instance *instance, const unsigned references[], size_t count, const double values[])
{
    const size_t n = kaneflex_fmu.linear->n, settable = kaneflex_fmu.settable;
    instance->stale = 1;
    for (size_t k = 0; k < count; k++) {
        const size_t place = references[k] - 1;
        if (references[k] == 0 || place >= settable + 2 * n)
            return KANEFLEX_UNKNOWN;
        if (place >= kaneflex_fmu.inputs && instance->begun && (instance->steps_itself || place < settable))
            return KANEFLEX_TOO_LATE;
        if (place < settable)
            instance->numbers[kaneflex_fmu.places[place]] = values[k];
        else if (place < settable + n)
            instance->state.z[place - settable] = values[k];
        else
            instance->state.v[place - settable - n] = values[k];
    }
    return KANEFLEX_OK;
}

void kaneflex_set_states(kaneflex_instance *instance, const double x[])
{
    const size_t n = kaneflex_fmu.linear->n;
    memcpy(instance->state.z, x, n * sizeof(double));
    memcpy(instance->state.v, x + n, n * sizeof(double));
    instance->stale = 1;
}

void kaneflex_get_states(const kaneflex_instance *instance, double x[])
{
    const size_t n = kaneflex_fmu.linear->n;
    memcpy(x, instance->state.z, n * sizeof(double));
    memcpy(x + n, instance->state.v, n * sizeof(double));
}

int kaneflex_derivatives(kaneflex_instance *instance, double derivatives[])
{
    kaneflex_state *state = &instance->state;
    const size_t n = state->model->n;
    const int ended = kaneflex_accelerations(state, instance->time);
    memcpy(derivatives, state->v, n * sizeof(double));
    memcpy(derivatives + n, state->a, n * sizeof(double));
    return ended;
}

int kaneflex_advance(kaneflex_instance *instance, double time)
{
    kaneflex_state *state = &instance->state;
    const size_t n = state->model->n;
    int ended = KANEFLEX_OK;
    while (!ended && kaneflex_time(state) < time - SAME * state->model->step) {
        memcpy(instance->before, state->z, n * sizeof(double));
        memcpy(instance->before + n, state->v, n * sizeof(double));
        memcpy(instance->before + 2 * n, state->a, n * sizeof(double));
        ended = kaneflex_step(state);
    }
    if (!ended)
        instance->time = time;
    instance->stale = 1;
    return ended;
}

kaneflex_instance *kaneflex_copy(const kaneflex_instance *instance)
{
    kaneflex_instance *copy = malloc(size());
    if (copy) {
        memcpy(copy, instance, size());
        lay_out(copy);
    }
    return copy;
}

void kaneflex_restore(kaneflex_instance *instance, const kaneflex_instance *copy)
{
    instance->state.steps = copy->state.steps;
    instance->time = copy->time;
    instance->begun = copy->begun;
    instance->stale = 1;
    memcpy(instance->numbers, copy->numbers, instance->count * sizeof(double));
}

const char *kaneflex_message(int ended)
{
    switch (ended) {
    case KANEFLEX_SINGULAR:
        return "a matrix is singular: the mechanism can't stand there";
    case KANEFLEX_UNBOUNDED:
        return "the motion grows beyond all bounds, or the mechanism can't close";
    case KANEFLEX_UNKNOWN:
        return "no such value reference, or not one that can be set";
    case KANEFLEX_TOO_LATE:
        return "a parameter or a start value is set after the initialization";
    case KANEFLEX_TOO_EARLY:
        return "the motion begins at 0 s: no other start time";
    case KANEFLEX_NOT_OFFERED:
        return "not offered: see the capabilities in modelDescription.xml";
    default:
        return "";
    }
}
