#include "kaneflex_linear.h"

#include <math.h>

/* Less than this, relative to what was added up to a pivot, is rounding. */
#define SMALLEST_PIVOT 1e-14

static size_t before(size_t i, size_t band)
{
    return i > band ? i - band : 0;
}

static size_t behind(size_t i, size_t band, size_t n)
{
    return i + band + 1 < n ? i + band + 1 : n;
}

/* A = L U in place, without pivoting, reciprocal pivots on the diagonal: the entry (i, j) at row i, j - i + band.
 * scale: of each row, sum of the absolute values of what was added up in the diagonal. */
static int factor(size_t n, size_t band, double a[], const double scale[])
{
    const size_t width = 2 * band + 1;
    for (size_t k = 0; k < n; k++) {
        const size_t last = behind(k, band, n);
        double *pivot = a + k * width + band;
        if (!(fabs(*pivot) > SMALLEST_PIVOT * scale[k]))
            return KANEFLEX_SINGULAR;
        *pivot = 1.0 / *pivot;
        for (size_t i = k + 1; i < last; i++) {
            double *row = a + i * width + band - (i - k);
            row[0] *= *pivot;
            for (size_t j = 1; j < last - k; j++)
                row[j] -= row[0] * pivot[j];
        }
    }
    return KANEFLEX_OK;
}

static void solve(size_t n, size_t band, const double lu[], double x[])
{
    const size_t width = 2 * band + 1;
    for (size_t i = 0; i < n; i++)
        for (size_t j = before(i, band); j < i; j++)
            x[i] -= lu[i * width + j + band - i] * x[j];
    for (size_t i = n; i-- > 0;) {
        for (size_t j = i + 1; j < behind(i, band, n); j++)
            x[i] -= lu[i * width + j + band - i] * x[j];
        x[i] *= lu[i * width + band];
    }
}

static void multiply(size_t count, const size_t ends[], const size_t factors[], const double values[], double out[])
{
    for (size_t k = 0, i = 0; k < count; k++) {
        double product = 1.0;
        for (; i < ends[k]; i++)
            product *= values[factors[i]];
        out[k] = product;
    }
}

static void add_up(size_t count, const size_t ends[], const size_t what[], const double constants[],
                   const double products[], double out[])
{
    for (size_t row = 0, i = 0; row < count; row++) {
        double sum = 0.0;
        for (; i < ends[row]; i++)
            sum += constants[i] * products[what[i]];
        out[row] = sum;
    }
}

void kaneflex_equations(kaneflex_state *state, double t, double sums[])
{
    const kaneflex_linear *m = state->model;
    for (size_t i = 0; i < m->scalars; i++)
        state->s[i] = 0.0;
    m->motion(t, state->p, state->s);
    multiply(m->products, m->product_ends, m->factors, state->s, state->products);
    add_up(3 * m->n * (2 * m->band + 1) + m->n, m->sum_ends, m->sum_products, m->sum_constants, state->products, sums);
}

/* x of A x = b in place of b, A n x n row by row, by elimination with pivots from each column. */
static int eliminate(size_t n, double a[], double b[])
{
    for (size_t k = 0; k < n; k++) {
        size_t best = k;
        for (size_t i = k + 1; i < n; i++)
            if (fabs(a[i * n + k]) > fabs(a[best * n + k]))
                best = i;
        if (!(fabs(a[best * n + k]) > 0.0))
            return KANEFLEX_SINGULAR;
        for (size_t j = k; j < n && best != k; j++) {
            const double moved = a[k * n + j];
            a[k * n + j] = a[best * n + j];
            a[best * n + j] = moved;
        }
        const double moved = b[k];
        b[k] = b[best];
        b[best] = moved;
        for (size_t i = k + 1; i < n; i++) {
            const double share = a[i * n + k] / a[k * n + k];
            for (size_t j = k + 1; j < n; j++)
                a[i * n + j] -= share * a[k * n + j];
            b[i] -= share * b[k];
        }
    }
    for (size_t k = n; k-- > 0;) {
        for (size_t j = k + 1; j < n; j++)
            b[k] -= a[k * n + j] * b[j];
        b[k] /= a[k * n + k];
    }
    return KANEFLEX_OK;
}

/* x with the least sum of squares of A x - b, by A^T A x = A^T b where there are more rows than unknowns.
 * normal: memory for A^T A. */
static int least_squares(size_t rows, size_t n, double a[], double b[], double normal[], double x[])
{
    double *matrix = rows == n ? a : normal;
    for (size_t i = 0; i < n; i++) {
        x[i] = rows == n ? b[i] : 0.0;
        for (size_t r = 0; r < rows && rows != n; r++)
            x[i] += a[r * n + i] * b[r];
        for (size_t j = 0; j < n && rows != n; j++) {
            normal[i * n + j] = 0.0;
            for (size_t r = 0; r < rows; r++)
                normal[i * n + j] += a[r * n + i] * a[r * n + j];
        }
    }
    return eliminate(n, matrix, x);
}

/* Sums number `row` to `end` to out, which may be where later ones find their values. */
static void evaluate(const kaneflex_readings *readings, size_t row, size_t end, const double values[], double out[])
{
    size_t i = row ? readings->ends[row - 1] : 0;
    for (; row < end; row++) {
        double sum = 0.0;
        for (; i < readings->ends[row]; i++)
            sum += readings->constants[i] * values[readings->pairs[2 * i]] * values[readings->pairs[2 * i + 1]];
        *out++ = sum;
    }
}

int kaneflex_sense(const kaneflex_readings *readings, double values[], double memory[], double out[])
{
    double *x = values + readings->given;
    const size_t *stage = readings->stages;
    size_t row = 0;
    *x++ = 1.0;
    for (size_t k = 0; k < readings->systems; k++, stage += 3) {
        const size_t own = stage[0], rows = stage[1], n = stage[2], end = row + own + (rows ? rows * (n + 1) : 2);
        double *right = memory + rows * n;
        evaluate(readings, row, row + own, values, x);
        evaluate(readings, row + own, end, values, memory);
        x += own;
        if (!rows) {
            x[0] = hypot(memory[0], memory[1]);
            x[1] = atan2(memory[1], memory[0]);
        } else if (least_squares(rows, n, memory, right, right + rows, x))
            return KANEFLEX_SINGULAR;
        x += n;
        row = end;
    }
    evaluate(readings, row, row + stage[0], values, x);
    evaluate(readings, row + stage[0], row + stage[0] + readings->count, values, out);
    return KANEFLEX_OK;
}

int kaneflex_read(kaneflex_state *state, const kaneflex_readings *readings, double values[], double memory[], double out[])
{
    const kaneflex_linear *m = state->model;
    double *moved = values + m->scalars;
    for (size_t i = 0; i < m->scalars; i++)
        values[i] = 0.0;
    m->motion(kaneflex_time(state), state->p, values);
    for (size_t i = 0; i < m->n; i++) {
        moved[i] = state->z[i];
        moved[m->n + i] = state->v[i];
        moved[2 * m->n + i] = state->a[i];
    }
    return kaneflex_sense(readings, values, memory, out);
}

/* F - C v - K z, row by row. */
static void residual(const kaneflex_linear *m, const double sums[], const double z[], const double v[], double out[],
                     size_t apart)
{
    const size_t width = 2 * m->band + 1, all = m->n * width;
    for (size_t i = 0; i < m->n; i++) {
        double force = sums[3 * all + i], reaction = 0.0;
        for (size_t j = before(i, m->band); j < behind(i, m->band, m->n); j++) {
            const size_t slot = i * width + j + m->band - i;
            force -= sums[all + slot] * v[j];
            reaction += sums[2 * all + slot] * z[j];
        }
        out[i * apart] = force - reaction;
    }
}

/* a of M a = F - C v - K z, of the first sums. */
static int accelerations(kaneflex_state *state)
{
    const kaneflex_linear *m = state->model;
    const size_t width = 2 * m->band + 1;
    for (size_t i = 0; i < m->n * width; i++)
        state->matrix[i] = state->sums[i];
    for (size_t i = 0; i < m->n; i++)
        state->at[i] = fabs(state->sums[i * width + m->band]);
    if (factor(m->n, m->band, state->matrix, state->at))
        return KANEFLEX_SINGULAR;
    residual(m, state->sums, state->z, state->v, state->x, 1);
    solve(m->n, m->band, state->matrix, state->x);
    for (size_t i = 0; i < m->n; i++)
        state->a[i] = state->x[i];
    return KANEFLEX_OK;
}

int kaneflex_accelerations(kaneflex_state *state, double t)
{
    kaneflex_equations(state, t, state->sums);
    return accelerations(state);
}

int kaneflex_start(kaneflex_state *state, const kaneflex_linear *model, double memory[])
{
    const size_t n = model->n, sums = 3 * n * (2 * model->band + 1) + n;
    state->model = model;
    state->p = model->p;
    state->steps = 0;
    state->z = memory;
    state->v = state->z + n;
    state->a = state->v + n;
    state->q = state->a + n;
    state->at = state->q + n;
    state->s = state->at + n;
    state->products = state->s + model->scalars;
    state->sums = state->products + model->products;
    state->x = state->sums + model->stages * sums;
    state->matrix = state->x + model->stages * n;
    for (size_t i = 0; i < n; i++) {
        state->z[i] = model->z_0[i];
        state->v[i] = model->v_0[i];
    }
    if (kaneflex_accelerations(state, 0.0))
        return KANEFLEX_SINGULAR;
    for (size_t i = 0; i < n; i++)
        state->q[i] = state->a[i];
    return KANEFLEX_OK;
}

double kaneflex_time(const kaneflex_state *state)
{
    return (double)state->steps * state->model->step;
}

/* Time in the step, `share` of it on [s]; in a motion that repeats itself that of its first cycle. With other numbers
 * than the model's it may repeat itself elsewhere. */
static double within(const kaneflex_state *state, double share)
{
    const kaneflex_linear *m = state->model;
    const size_t step = m->period && state->p == m->p ? state->steps % m->period : state->steps;
    return ((double)step + share) * m->step;
}

/* Newmark's family with weighted accelerations (Newmark 1959; Chung and Hulbert 1993; Arnold and Bruels 2007):
 *     p = w1 q + w2 q_a,  a_1 = p + w3 x,  v_1 = v + w6 q_a + w7 p + w4 x,  z_1 = z + w0 v + w8 q_a + w9 p + w5 x
 *     (M + w4 C + w5 K) x = F - C v_p - K z_p at the end of the step
 * a is the true acceleration x, q the method's own. */
static int newmark(kaneflex_state *state)
{
    const kaneflex_linear *m = state->model;
    const size_t n = m->n, width = 2 * m->band + 1, all = n * width;
    const double *w = m->weights;
    kaneflex_equations(state, within(state, 1.0), state->sums);
    for (size_t k = 0; k < all; k++)
        state->matrix[k] = state->sums[k] + w[4] * state->sums[all + k] + w[5] * state->sums[2 * all + k];
    for (size_t i = 0; i < n; i++) {
        const double *at = state->sums + i * width + m->band;
        state->x[i] = fabs(at[0]) + fabs(w[4] * at[all]) + fabs(w[5] * at[2 * all]);
    }
    if (factor(n, m->band, state->matrix, state->x))
        return KANEFLEX_SINGULAR;
    for (size_t i = 0; i < n; i++) {
        const double own = state->q[i], known = w[1] * state->a[i] + w[2] * own;
        state->z[i] += w[0] * state->v[i] + w[8] * own + w[9] * known;
        state->v[i] += w[6] * own + w[7] * known;
        state->q[i] = known;
    }
    residual(m, state->sums, state->z, state->v, state->x, 1);
    solve(n, m->band, state->matrix, state->x);
    for (size_t i = 0; i < n; i++) {
        const double found = state->x[i];
        state->z[i] += w[5] * found;
        state->v[i] += w[4] * found;
        state->q[i] += w[3] * found;
        state->a[i] = found;
    }
    state->steps++;
    return KANEFLEX_OK;
}

/* The matrix of all stages' unknowns, those of a coordinate side by side; x: the scale of its rows. */
static void stage_matrix(kaneflex_state *state, const double a[], const double e[])
{
    const kaneflex_linear *m = state->model;
    const size_t n = m->n, count = m->stages, width = 2 * m->band + 1, all = n * width, apart = 3 * all + n;
    const size_t band = count * (m->band + 1) - 1, wide = 2 * band + 1;
    for (size_t k = 0; k < count * n * wide; k++)
        state->matrix[k] = 0.0;
    for (size_t i = 0; i < n; i++)
        for (size_t s = 0; s < count; s++) {
            double *row = state->matrix + (i * count + s) * wide + band - (i * count + s);
            for (size_t j = before(i, m->band); j < behind(i, m->band, n); j++) {
                const double *sums = state->sums + s * apart + i * width + j + m->band - i;
                for (size_t r = 0; r < count; r++) {
                    const double c = a[s * count + r] * sums[all], k = e[s * count + r] * sums[2 * all];
                    row[j * count + r] = c + k + (r == s ? sums[0] : 0.0);
                    if (j == i && r == s)
                        state->x[i * count + s] = fabs(sums[0]) + fabs(c) + fabs(k);
                }
            }
        }
}

/* Implicit Runge-Kutta methods by collocation (Hairer and Wanner 1996, section IV.5). Unknowns are the accelerations x_s
 * in M_s x_s + C_s v_s + K_s z_s = F_s at t + c_s h:
 *     v_s = v + h sum_r a_sr x_r,  z_s = z + c_s h v + h^2 sum_r e_sr x_r,  e = a a
 * weights: h, c_s h, a_sr h, e_sr h^2, b_r h, sum_s b_s a_sr h^2. */
static int collocation(kaneflex_state *state)
{
    const kaneflex_linear *m = state->model;
    const size_t n = m->n, count = m->stages, apart = 3 * n * (2 * m->band + 1) + n;
    const double *c = m->weights + 1, *a = c + count, *e = a + count * count, *b = e + count * count, *d = b + count;
    const size_t band = count * (m->band + 1) - 1;
    for (size_t s = 0; s < count; s++)
        kaneflex_equations(state, within(state, m->nodes[s]), state->sums + s * apart);
    stage_matrix(state, a, e);
    if (factor(count * n, band, state->matrix, state->x))
        return KANEFLEX_SINGULAR;
    for (size_t s = 0; s < count; s++) {
        for (size_t i = 0; i < n; i++)
            state->at[i] = state->z[i] + c[s] * state->v[i];
        residual(m, state->sums + s * apart, state->at, state->v, state->x + s, count);
    }
    solve(count * n, band, state->matrix, state->x);
    for (size_t i = 0; i < n; i++) {
        const double *found = state->x + count * i;
        double moved = m->weights[0] * state->v[i], faster = 0.0;
        for (size_t s = 0; s < count; s++) {
            moved += d[s] * found[s];
            faster += b[s] * found[s];
        }
        state->z[i] += moved;
        state->v[i] += faster;
        state->a[i] = found[count - 1];
    }
    state->steps++;
    if (m->nodes[count - 1] == 1.0)
        return KANEFLEX_OK; /* the last stage was the end of the step */
    kaneflex_equations(state, within(state, 0.0), state->sums);
    return accelerations(state);
}

int kaneflex_step(kaneflex_state *state)
{
    const int ended = state->model->stages == 1 ? newmark(state) : collocation(state);
    for (size_t i = 0; i < state->model->n; i++)
        if (!isfinite(state->z[i]))
            return ended ? ended : KANEFLEX_UNBOUNDED;
    return ended;
}
