"""Compiled loops over the steps of a run, and their parts: sums, factorisation and solution of banded equations.

Arguments of the loops are addresses of arrays, row by row:

plan           whole numbers, see `kaneflex.integrate.conventions.Plan`
layout, stages of the system and of all stages' unknowns: base, first and last of a `Layout`, see there
ends, what,    terms of the system: `AffineSystem.stacked`
values
scalars        table: of each step a row at its start and at its stages, if there are any, and the end of the last step;
               it is read again from its start after the last step in it
coefficients   numbers of the method, see `kaneflex.integrate.methods`
load_factor    (columns,): factor on F for each column (1 for a motion, 0 for a free one)
z, v, a, q     (n, columns): displacements, velocities, the method's own and the true accelerations; overwritten.
               Several columns share one factorisation a step.
work           room for the sums and factors of a step
stored_z, _v,  (rows, n): row k belongs to step k * every; the first column is stored
_a
bound          largest permitted sum of squares of z

They return the number of completed steps, times OUTCOMES, and an outcome.
"""

from numba import njit
from numba.types import CPointer, float64, int64

from kaneflex.integrate.conventions import COMPLETED, FASTMATH, OUTCOMES, SINGULAR, UNBOUNDED, Layout, Plan, Terms
from kaneflex.support.inner import PART, shifted

_SMALLEST_PIVOT = 1e-14  # relative to what was added up to it: less is rounding
_compiled = njit(error_model="numpy", fastmath=FASTMATH, _nrt=False, **PART)
_N, _WHOLE = CPointer(float64), CPointer(int64)
SIGNATURE = int64(*[_WHOLE] * 5, *[_N] * 12, float64)
"""Type of the loops."""


@_compiled
def _plan_of(p):
    """The numbers of a run by their names."""
    return Plan(p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8], p[9])


@_compiled
def _layout_of(n, n_slots, places):
    """Layout of a matrix of n unknowns."""
    return Layout(n, n_slots, places, shifted(places, n), shifted(places, 2 * n))


@_compiled
def _affine_sums(terms, count, scalars, sums):
    """M, C, K and F at one row of the table: ``count`` sums of scalar x constant."""
    for k in range(count):
        total = 0.0
        for term in range(terms.ends[k], terms.ends[k + 1]):
            total += terms.values[term] * scalars[terms.what[term]]
        sums[k] = total


@_compiled
def _factor(layout, lu, scale):
    """A = L U in place, without pivoting, reciprocal pivots on the diagonal; false where a pivot vanishes.

    scale: of each row, sum of the absolute values of what was added up in the diagonal
    """
    regular = True
    for k in range(layout.n):
        row_k = layout.base[k]
        regular = regular and _SMALLEST_PIVOT * scale[k] < abs(lu[row_k + k])
        lu[row_k + k] = 1.0 / lu[row_k + k]
        for i in range(k + 1, layout.last[k]):
            row_i = layout.base[i]
            share = lu[row_i + k] * lu[row_k + k]
            lu[row_i + k] = share
            for j in range(k + 1, layout.last[k]):
                lu[row_i + j] -= share * lu[row_k + j]
    return regular


@_compiled
def _solve(layout, columns, lu, x):
    """Solve L U x = x for all columns."""
    for i in range(layout.n):
        for j in range(layout.first[i], i):
            _subtract(columns, lu[layout.base[i] + j], shifted(x, columns * j), shifted(x, columns * i))
    for i in range(layout.n - 1, -1, -1):
        found = shifted(x, columns * i)
        for j in range(i + 1, layout.last[i]):
            _subtract(columns, lu[layout.base[i] + j], shifted(x, columns * j), found)
        for c in range(columns):
            found[c] *= lu[layout.base[i] + i]


@_compiled
def _subtract(columns, share, x, found):
    for c in range(columns):
        found[c] -= share * x[c]


@_compiled
def _residual(layout, columns, sums, load_factor, z, v, rest, apart):
    """F - C v - K z of all columns, in rows of `rest` that are `apart`."""
    damping, stiffness, force = layout.n_slots, 2 * layout.n_slots, 3 * layout.n_slots
    for i in range(layout.n):
        found = shifted(rest, columns * apart * i)
        for c in range(columns):
            found[c] = load_factor[c] * sums[force + i]
        for j in range(layout.first[i], layout.last[i]):
            of_v, of_z = sums[damping + layout.base[i] + j], sums[stiffness + layout.base[i] + j]
            for c in range(columns):
                found[c] -= of_v * v[columns * j + c] + of_z * z[columns * j + c]


@_compiled
def _within(n, columns, z, bound):
    """True if the sum of squares of every column is below a bound."""
    for c in range(columns):
        squares = 0.0
        for i in range(n):
            squares += z[columns * i + c] * z[columns * i + c]
        if not squares < bound:
            return False
    return True


@_compiled
def _store_row(p, taken, z, v, q, stored_z, stored_v, stored_a):
    """Store the first column after so many steps of this call."""
    row = p.n * ((p.done + taken) // p.every)
    for i in range(p.n):
        k = p.columns * i
        stored_z[row + i], stored_v[row + i], stored_a[row + i] = z[k], v[k], q[k]


@_compiled
def _newmark_matrix(layout, sums, c_weight, k_weight, lu, scale):
    """Factorise M + c_weight C + k_weight K; false where a pivot vanishes."""
    damping, stiffness = layout.n_slots, 2 * layout.n_slots
    for i in range(layout.n_slots):
        lu[i] = sums[i] + c_weight * sums[damping + i] + k_weight * sums[stiffness + i]
    for i in range(layout.n):
        m = layout.base[i] + i
        scale[i] = abs(sums[m]) + abs(c_weight * sums[damping + m]) + abs(k_weight * sums[stiffness + m])
    return _factor(layout, lu, scale)


@_compiled
def newmark(
    plan, layout, stages, ends, what, values, scalars, coefficients, load_factor, z, v, a, q, work, stored_z, stored_v,
    stored_a, bound,
):  # fmt: skip
    """Newmark's family with weighted accelerations, unknown: the true acceleration q at the end of the step.

    With p = (alpha_f q_0 - alpha_m a_0) / (1 - alpha_m), known, and kappa = (1 - alpha_f) / (1 - alpha_m):

        a_1 = p + kappa q_1;
        v_1 = v_0 + h ((1 - gamma) a_0 + gamma a_1);
        z_1 = z_0 + h v_0 + h^2 ((1/2 - beta) a_0 + beta a_1);
        (M + gamma h kappa C + beta h^2 kappa K) q_1 = F - C v_p - K z_p  at the end of the step,

    where v_p and z_p are v_1 and z_1 without their share of q_1 (Arnold and Bruels 2007, section 2, whose
    accelerations satisfy the equation of motion; for constant M it is the method of Chung and Hulbert 1993).
    """
    p = _plan_of(plan)
    n, columns, own, terms = p.n, p.columns, _layout_of(p.n, p.n_slots, layout), Terms(ends, what, values)
    step, from_q, from_a, kappa = coefficients[0], coefficients[1], coefficients[2], coefficients[3]
    c_weight, k_weight, v_start, v_known = coefficients[4], coefficients[5], coefficients[6], coefficients[7]
    z_start, z_known, count = coefficients[8], coefficients[9], 3 * p.n_slots + p.n
    sums, lu, scale = work, shifted(work, count), shifted(work, count + p.n_slots)
    for taken in range(p.n_steps):
        row = (p.position + taken) % p.period + 1
        _affine_sums(terms, count, shifted(scalars, row * p.n_scalars), sums)
        if not _newmark_matrix(own, sums, c_weight, k_weight, lu, scale):
            return taken * OUTCOMES + SINGULAR
        for k in range(n * columns):
            before, speed = a[k], v[k]
            known = from_q * q[k] + from_a * before
            z[k] += step * speed + z_start * before + z_known * known
            v[k] += v_start * before + v_known * known
            a[k] = known
        _residual(own, columns, sums, load_factor, z, v, q, 1)
        _solve(own, columns, lu, q)
        for k in range(n * columns):
            z[k] += k_weight * q[k]
            v[k] += c_weight * q[k]
            a[k] += kappa * q[k]
        if not _within(n, columns, z, bound):
            return (taken + 1) * OUTCOMES + UNBOUNDED
        if (p.done + taken + 1) % p.every == 0:
            _store_row(p, taken + 1, z, v, q, stored_z, stored_v, stored_a)
    return p.n_steps * OUTCOMES + COMPLETED


@_compiled
def _stage_matrix(layout, stages, coefficients, sums, matrix, scale):
    """delta_sr M_s + h a_sr C_s + h^2 e_sr K_s at row (i, s), column (j, r), factorised; false where a pivot vanishes.

    sums: at one stage after the other
    """
    n_slots, count = layout.n_slots, stages.n // layout.n
    apart, a_weights, e_weights = 3 * n_slots + layout.n, 1 + count, 1 + count + count * count
    for i in range(layout.n):
        for s in range(count):
            row = s * apart + layout.base[i]
            for j in range(layout.first[i], layout.last[i]):
                c, k = sums[row + j + n_slots], sums[row + j + 2 * n_slots]
                slot = stages.base[count * i + s] + count * j
                for r in range(count):
                    place = s * count + r
                    matrix[slot + r] = coefficients[a_weights + place] * c + coefficients[e_weights + place] * k
                matrix[slot + s] += sums[row + j]
            m, place = row + i, s * (count + 1)
            damping = abs(coefficients[a_weights + place] * sums[m + n_slots])
            stiffness = abs(coefficients[e_weights + place] * sums[m + 2 * n_slots])
            scale[count * i + s] = damping + stiffness + abs(sums[m])
    return _factor(stages, matrix, scale)


@_compiled
def collocation(
    plan, layout, stages, ends, what, values, scalars, coefficients, load_factor, z, v, a, q, work, stored_z, stored_v,
    stored_a, bound,
):  # fmt: skip
    """Implicit Runge-Kutta methods of two or three stages.

    Unknowns are the accelerations x_s in M_s x_s + C_s v_s + K_s z_s = F_s at t + c_s h, with the tableau's a_sr and
    b_s (Hairer and Wanner 1996, section IV.5) and e = a a:

        v_s = v_0 + h sum_r a_sr x_r,  z_s = z_0 + c_s h v_0 + h^2 sum_r e_sr x_r
        v_1 = v_0 + h sum_r b_r x_r,   z_1 = z_0 + h v_0 + h^2 sum_sr b_s a_sr x_r

    coefficients: h, then c_s h, a_sr h, e_sr h^2, b_r h and sum_s b_s a_sr h^2
    stages: layout of the matrix of all stages' unknowns, those of a coordinate side by side

    The table has three rows a step. Where they are three stages, the last one is at the end of the step (Radau IIA):
    its x_s is the acceleration there, and satisfies the equation of motion. Two stages leave that equation to be
    solved for the acceleration, which takes what the step did not resolve at its stiffness.
    """
    p = _plan_of(plan)
    n, columns, own, terms = p.n, p.columns, _layout_of(p.n, p.n_slots, layout), Terms(ends, what, values)
    all_stages, count = _layout_of(p.stages * n, p.n_slots * p.stages * p.stages, stages), p.stages
    apart, step, v_weights = 3 * p.n_slots + n, coefficients[0], 1 + count + 2 * count * count
    z_weights = v_weights + count
    sums, scale = work, shifted(work, 3 * apart)
    matrix = shifted(scale, count * n)
    mass = shifted(matrix, all_stages.n_slots)
    at_stage = shifted(mass, p.n_slots)
    x = shifted(at_stage, n * columns)
    for taken in range(p.n_steps):
        row = (p.position + taken) % p.period * 3 + 1
        for s in range(3):
            _affine_sums(terms, apart, shifted(scalars, (row + s) * p.n_scalars), shifted(sums, s * apart))
        if not _stage_matrix(own, all_stages, coefficients, sums, matrix, scale):
            return taken * OUTCOMES + SINGULAR
        for s in range(count):
            for k in range(n * columns):
                at_stage[k] = z[k] + coefficients[1 + s] * v[k]
            _residual(own, columns, shifted(sums, s * apart), load_factor, at_stage, v, shifted(x, columns * s), count)
        _solve(all_stages, columns, matrix, x)
        for i in range(n):
            for c in range(columns):
                k, first = columns * i + c, columns * count * i + c
                faster, moved = 0.0, z[k] + step * v[k]
                for s in range(count):
                    faster += coefficients[v_weights + s] * x[first + columns * s]
                    moved += coefficients[z_weights + s] * x[first + columns * s]
                z[k], v[k], q[k] = moved, v[k] + faster, x[first + columns * (count - 1)]
        if not _within(n, columns, z, bound):
            return (taken + 1) * OUTCOMES + UNBOUNDED
        if (p.done + taken + 1) % p.every == 0:
            if count == 2:
                at_end = shifted(sums, 2 * apart)
                if not _newmark_matrix(own, at_end, 0.0, 0.0, mass, scale):
                    return taken * OUTCOMES + SINGULAR
                _residual(own, columns, at_end, load_factor, z, v, q, 1)
                _solve(own, columns, mass, q)
            _store_row(p, taken + 1, z, v, q, stored_z, stored_v, stored_a)
    return p.n_steps * OUTCOMES + COMPLETED


@_compiled
def exact_modal(
    plan, layout, stages, ends, what, values, forces, w, load_factor, z, v, a, q, work, stored_z, stored_v, stored_a,
    bound,
):  # fmt: skip
    """Decoupled modes m z'' + c z' + k z = F, the paper's eq. (143) and damping; exact for F linear in t.

    w, forces: coefficients (11, n) and table (period + 1, n), of `kaneflex.integrate.modal`; the forces are those at
    the steps. `bound` is that of each square.
    """
    p = _plan_of(plan)
    n, columns = p.n, p.columns
    for taken in range(p.n_steps):
        row, bounded = (p.position + taken) % p.period, True
        for i in range(n):
            for column in range(columns):
                k, factor = columns * i + column, load_factor[column]
                before, now = factor * forces[row * n + i], factor * forces[(row + 1) * n + i]
                moved, speed = z[k], v[k]
                z[k] = w[i] * moved + w[n + i] * speed + (w[2 * n + i] * before + w[3 * n + i] * now)
                v[k] = w[4 * n + i] * moved + w[5 * n + i] * speed + (w[6 * n + i] * before + w[7 * n + i] * now)
                q[k] = w[8 * n + i] * now - w[9 * n + i] * v[k] - w[10 * n + i] * z[k]
                bounded = bounded and z[k] * z[k] < bound
        if not bounded:
            return (taken + 1) * OUTCOMES + UNBOUNDED
        if (p.done + taken + 1) % p.every == 0:
            _store_row(p, taken + 1, z, v, q, stored_z, stored_v, stored_a)
    return p.n_steps * OUTCOMES + COMPLETED
