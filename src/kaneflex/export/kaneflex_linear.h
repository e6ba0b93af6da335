/* A mechanism's linear equations M z'' + C z' + K z = F, stepped in time without Python and without allocation.
 *
 * Every number of M, C, K and F is a sum of constant x product of scalars of the rigid motion. A model is data: which
 * scalars make a product, which products make a number. All in SI.
 */
#ifndef KANEFLEX_LINEAR_H
#define KANEFLEX_LINEAR_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    size_t n;        /* coordinates */
    size_t band;     /* largest |i - j| with an entry (i, j) */
    size_t scalars;  /* of the rigid motion */
    size_t products; /* of scalars */
    size_t stages;   /* of a step: 2 Gauss, 3 Radau IIA; 1 Newmark's family */
    size_t period;   /* steps of a cycle, after which all repeats; 0: none */
    double step;     /* [s] */

    void (*motion)(double t, const double p[], double s[]);
    const double *p;              /* its numbers */
    const size_t *product_ends;   /* where each product ends among factors */
    const size_t *factors;        /* scalars */
    const size_t *sum_ends;       /* where each number ends: (i, j) of M at (2 band + 1) i + j - i + band, C, K, then F */
    const size_t *sum_products;   /* products */
    const double *sum_constants;  /* and what is before them */

    const double *nodes;          /* of the stages, in steps */
    const double *weights;        /* of the method */
    const double *z_0;            /* where it begins with these p; with others the start may be another one */
    const double *v_0;
    const char *const *coordinates; /* their names */
} kaneflex_linear;

/* What sensors read: sums of constant x value x value. The values are what the motion's scalars s, then z, v and a are,
 * one, and those of each stage: its sums, and the unknowns x of its system A x = b, of which A and b are sums, too; with
 * more rows than unknowns x makes the sum of squares of A x - b least (forces of joints). Two unknowns without rows are
 * length and angle of a vector in a plane, whose x and y are sums. */
typedef struct {
    size_t count;            /* sensors */
    size_t given;            /* s, z, v and a */
    size_t values;           /* these and all others */
    size_t memory;           /* doubles to work in */
    size_t systems;
    const size_t *stages;    /* of each its sums that are values, its system's rows and unknowns; last the sensors */
    const size_t *ends;      /* where each sum ends: of a stage its values, A row by row, b, or x and y */
    const size_t *pairs;     /* places among the values, two of each term */
    const double *constants;
    const char *const *names;
} kaneflex_readings;

/* Doubles of memory that a model needs. */
#define KANEFLEX_LINEAR_MEMORY(n, band, scalars, products, stages) \
    (5 * (n) + (scalars) + (products) + (stages) * (3 * (n) * (2 * (band) + 1) + (n)) + (stages) * (n) \
     + (stages) * (n) * (2 * (stages) * ((band) + 1) - 1))

typedef struct {
    const kaneflex_linear *model;
    const double *p; /* numbers that motion reads: the model's */
    size_t steps;    /* taken */
    double *z;       /* displacements [m, rad] */
    double *v;       /* their rates */
    double *a;       /* accelerations */
    double *q;       /* what follows is the method's own */
    double *at;
    double *s;
    double *products;
    double *sums;
    double *x;
    double *matrix;
} kaneflex_state;

enum { KANEFLEX_OK, KANEFLEX_SINGULAR, KANEFLEX_UNBOUNDED };

/* Begin at model->z_0, v_0. memory: KANEFLEX_LINEAR_MEMORY doubles that stay the state's. Returns KANEFLEX_SINGULAR
 * where M is, at t = 0. */
int kaneflex_start(kaneflex_state *state, const kaneflex_linear *model, double memory[]);

/* One step on. Returns KANEFLEX_SINGULAR where the step's matrix is, KANEFLEX_UNBOUNDED where z is no number any more;
 * nothing can be made of the state then. */
int kaneflex_step(kaneflex_state *state);

/* state->a of M a = F - C v - K z at time t [s]. Returns KANEFLEX_SINGULAR where M is. */
int kaneflex_accelerations(kaneflex_state *state, double t);

/* Sensors at the state's time and z, v, a. values: readings->values doubles, memory: readings->memory of them. Returns
 * KANEFLEX_SINGULAR where a system is. */
int kaneflex_read(kaneflex_state *state, const kaneflex_readings *readings, double values[], double memory[], double out[]);

/* The same from s, z, v, a side by side in values. */
int kaneflex_sense(const kaneflex_readings *readings, double values[], double memory[], double out[]);

/* Time of the state [s]. */
double kaneflex_time(const kaneflex_state *state);

/* M, C, K (each n rows of 2 band + 1, entry (i, j) in column j - i + band of row i) and F (n), one after the other, at
 * time t [s]. Changes nothing of the state but its own numbers. */
void kaneflex_equations(kaneflex_state *state, double t, double sums[]);

#ifdef __cplusplus
}
#endif

#endif
