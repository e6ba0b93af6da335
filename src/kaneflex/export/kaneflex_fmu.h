/* A model's linear equations as one instance of an FMU, whichever version of the standard asks.
 *
 * Value references, in this order: 0 the time, the numbers that can be set, z, z', their derivatives z' and z'', the
 * sensors. All in SI.
 */
#ifndef KANEFLEX_FMU_H
#define KANEFLEX_FMU_H

#include "kaneflex_linear.h"

typedef struct {
    const kaneflex_linear *linear;
    const kaneflex_readings *readings;
    const char *token;      /* of the model description */
    size_t memory;          /* KANEFLEX_LINEAR_MEMORY of it */
    size_t numbers;         /* in p */
    size_t settable;        /* numbers that can be set */
    size_t inputs;          /* the first of these: at any time; the others before the initialization ends */
    const size_t *places;   /* of them in p */
} kaneflex_fmu_model;

extern const kaneflex_fmu_model kaneflex_fmu;

typedef struct {
    kaneflex_state state;
    double time;
    int steps_itself;       /* co-simulation */
    int begun;              /* the initialization has ended */
    int stale;              /* what is shown is of another instant */
    size_t count;           /* of doubles, in one piece with all that follows */
    double *numbers;        /* p */
    double *memory;         /* of the state */
    double *before;         /* z, v, a a step before */
    double *shown;          /* s, z, v, a of the time, and what sensors need beside them */
    double *work;
    double *sensors;
} kaneflex_instance;

enum { KANEFLEX_UNKNOWN = 10, KANEFLEX_TOO_LATE, KANEFLEX_TOO_EARLY, KANEFLEX_NOT_OFFERED };

kaneflex_instance *kaneflex_make(int steps_itself);
/* What it starts from, its numbers those of the scene again. */
int kaneflex_reset(kaneflex_instance *instance);
/* What was set is what it begins from. */
int kaneflex_begin(kaneflex_instance *instance);
int kaneflex_get(kaneflex_instance *instance, const unsigned references[], size_t count, double values[]);
int kaneflex_set(kaneflex_instance *instance, const unsigned references[], size_t count, const double values[]);
/* Integrated from outside: z, then z', and their derivatives at the time. */
void kaneflex_set_states(kaneflex_instance *instance, const double x[]);
void kaneflex_get_states(const kaneflex_instance *instance, double x[]);
int kaneflex_derivatives(kaneflex_instance *instance, double derivatives[]);
/* Steps of its own until `time` is reached or passed; what is shown there lies on the quintic through both ends. */
int kaneflex_advance(kaneflex_instance *instance, double time);
/* A copy that goes by the name of an FMU state, and back. */
kaneflex_instance *kaneflex_copy(const kaneflex_instance *instance);
void kaneflex_restore(kaneflex_instance *instance, const kaneflex_instance *copy);
const char *kaneflex_message(int ended);

#endif
