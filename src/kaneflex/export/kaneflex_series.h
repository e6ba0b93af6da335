/* A rigid motion that repeats itself, as Fourier series of its scalars. All in SI. */
#ifndef KANEFLEX_SERIES_H
#define KANEFLEX_SERIES_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    double period;         /* [s] */
    size_t count;          /* series */
    size_t harmonics;      /* of each */
    const size_t *places;  /* of them among the motion's scalars */
    const double *drifts;  /* what each is more after a cycle: turns of an angle */
    const double *numbers; /* count means, then of each harmonic count factors of its cosine, and of its sine */
} kaneflex_series;

/* The scalars at time t [s]; those that have no series stay as they are. */
void kaneflex_repeat(const kaneflex_series *series, double t, double s[]);

/* Add a multiple of the series. */
void kaneflex_add(const kaneflex_series *series, double factor, double t, double s[]);

#ifdef __cplusplus
}
#endif

#endif
