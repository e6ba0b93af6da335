"""Compiled loops over the steps of a run, and their parts: sums, factorisation and solution of banded equations.

Arguments of the loops:

layout, terms  of the system: :class:`kaneflex.integrate.system.Layout`, `AffineSystem.sums`
scalars        table: of each step a row at its start and at its stages, if there are any, and the end of the last step
period         steps in the table; it is read again from its start after the last one
position       steps already taken in this table
n_steps        steps to take
coefficients   numbers of the method, see `kaneflex.integrate.methods`
load_factor    shape (columns,): factor on F for each column (1 for a motion, 0 for a free one)
state          z, v, a, q, each of shape (n, columns): displacements, velocities, the method's own and the true
               accelerations; overwritten. Several columns share one factorisation a step.
done, every    steps taken before this call; the first column is stored after every `every` steps
bound          largest permitted sum of squares of z
stored         z, v, true accelerations, each of shape (rows, n): row k belongs to step k * every

They return the number of completed steps and a status.
"""

import numpy as np
from numba import njit, types
from numba.extending import intrinsic

from kaneflex.integrate import conventions
from kaneflex.integrate.conventions import COMPLETED, FASTMATH, SINGULAR, UNBOUNDED
from kaneflex.support.fingerprint import made_of
from kaneflex.support.inner import PART

_ZERO, _ONE, _TWO, _THREE = map(np.uint64, range(4))
"""Unsigned numbers, which numba need not test for a negative index; with a signed number they become a float."""
_SMALLEST_PIVOT = 1e-14  # relative to what was added up to it: less is rounding

_made_of_parts = made_of(conventions.__file__)
_compiled = njit(error_model="numpy", fastmath=FASTMATH, _nrt=False, **PART)
"""Decorator of parts that are compiled into the functions that call them."""
_cached = njit(cache=True, error_model="numpy", fastmath=FASTMATH, no_cfunc_wrapper=True)


@intrinsic
def _stay_apart(typing):
    """The function in which this stands is not compiled into each that calls it, which would take LLVM long."""

    def mark(context, builder, sig, args):
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return types.void(), mark


@_compiled
def _affine_sums(terms, scalars, sums, begin):
    """M, C, K and F at one row of the table, in `sums` from `begin` on: sums of scalar x constant."""
    _stay_apart()
    ends, what, values = terms
    for k in range(np.uint64(len(ends)) - _ONE):
        total = 0.0
        for term in range(ends[k], ends[k + _ONE]):
            total += values[term] * scalars[what[term]]
        sums[begin + k] = total


@_compiled
def _factor(layout, lu, scale):
    """A = L U in place, without pivoting, reciprocal pivots on the diagonal; false where a pivot vanishes.

    scale: of each row, sum of the absolute values of what was added up in the diagonal
    """
    _stay_apart()
    base, last, regular = layout.base, layout.last, True
    for k in range(layout.n):
        row_k = base[k]
        regular = regular and _SMALLEST_PIVOT * scale[k] < abs(lu[row_k + k])
        lu[row_k + k] = 1.0 / lu[row_k + k]
        for i in range(k + _ONE, last[k]):
            row_i = base[i]
            share = lu[row_i + k] * lu[row_k + k]
            lu[row_i + k] = share
            for j in range(k + _ONE, last[k]):
                lu[row_i + j] -= share * lu[row_k + j]
    return regular


@_compiled
def _solve(layout, lu, x):
    """Solve L U x = x for all columns."""
    _stay_apart()
    for i in range(layout.n):
        for j in range(layout.first[i], i):
            _subtract(lu[layout.base[i] + j], x[j], x[i])
    for back in range(layout.n):
        i = layout.n - _ONE - back
        for j in range(i + _ONE, layout.last[i]):
            _subtract(lu[layout.base[i] + j], x[j], x[i])
        reciprocal, found = lu[layout.base[i] + i], x[i]
        for c in range(len(found)):
            found[c] *= reciprocal


@_compiled
def _subtract(share, x, found):
    for c in range(len(x)):
        found[c] -= share * x[c]


@_compiled
def _residual(layout, sums, begin, load_factor, z, v, rest, place, apart):
    """F - C v - K z of all columns, with the sums from `begin` on, in rows of `rest` from `place` on, `apart`."""
    _stay_apart()
    damping = begin + layout.n_slots
    stiffness = damping + layout.n_slots
    force = stiffness + layout.n_slots
    for i in range(layout.n):
        found, own = rest[place + apart * i], sums[force + i]
        for c in range(len(found)):
            found[c] = load_factor[c] * own
        for j in range(layout.first[i], layout.last[i]):
            of_v, of_z = sums[damping + layout.base[i] + j], sums[stiffness + layout.base[i] + j]
            fast, there = v[j], z[j]
            for c in range(len(found)):
                found[c] -= of_v * fast[c] + of_z * there[c]


@_compiled
def _within(z, bound):
    """True if the sum of squares of every column is below a bound."""
    _stay_apart()
    for c in range(z.shape[1]):
        squares = 0.0
        for i in range(len(z)):
            squares += z[i, c] * z[i, c]
        if not squares < bound:
            return False
    return True


@_compiled
def _store_row(stored, out, z, v, q):
    """Store the first column in row `out`."""
    out_z, out_v, out_a = stored
    for i in range(len(z)):
        out_z[out, i], out_v[out, i], out_a[out, i] = z[i, 0], v[i, 0], q[i, 0]


@_compiled
def _newmark_matrix(layout, sums, begin, c_weight, k_weight, lu, scale):
    """Factorise M + c_weight C + k_weight K, of the sums from `begin` on; false where a pivot vanishes."""
    _stay_apart()
    damping = begin + layout.n_slots
    stiffness = damping + layout.n_slots
    for i in range(layout.n_slots):
        lu[i] = sums[begin + i] + c_weight * sums[damping + i] + k_weight * sums[stiffness + i]
    for i in range(layout.n):
        m = layout.base[i] + i
        scale[i] = abs(sums[begin + m]) + abs(c_weight * sums[damping + m]) + abs(k_weight * sums[stiffness + m])
    return _factor(layout, lu, scale)


@_cached
@_made_of_parts
def newmark(
    layout, terms, scalars, period, position, n_steps, coefficients, load_factor, state, done, every, bound, stored
):
    """Newmark's family with weighted accelerations, unknown: the true acceleration q at the end of the step.

    With p = (alpha_f q_0 - alpha_m a_0) / (1 - alpha_m), known, and kappa = (1 - alpha_f) / (1 - alpha_m):

        a_1 = p + kappa q_1;
        v_1 = v_0 + h ((1 - gamma) a_0 + gamma a_1);
        z_1 = z_0 + h v_0 + h^2 ((1/2 - beta) a_0 + beta a_1);
        (M + gamma h kappa C + beta h^2 kappa K) q_1 = F - C v_p - K z_p  at the end of the step,

    where v_p and z_p are v_1 and z_1 without their share of q_1 (Arnold and Bruels 2007, section 2, whose
    accelerations satisfy the equation of motion; for constant M it is the method of Chung and Hulbert 1993).
    """
    z, v, a, q = state
    step, from_q, from_a, kappa = coefficients[0], coefficients[1], coefficients[2], coefficients[3]
    c_weight, k_weight, v_start, v_known = coefficients[4], coefficients[5], coefficients[6], coefficients[7]
    z_start, z_known = coefficients[8], coefficients[9]
    sums, lu, scale = np.empty(_THREE * layout.n_slots + layout.n), np.empty(layout.n_slots), np.empty(layout.n)
    for taken in range(n_steps):
        _affine_sums(terms, scalars[(position + taken) % period + 1], sums, _ZERO)
        if not _newmark_matrix(layout, sums, _ZERO, c_weight, k_weight, lu, scale):
            return taken, SINGULAR
        for i in range(layout.n):
            for c in range(z.shape[1]):
                before, speed = a[i, c], v[i, c]
                known = from_q * q[i, c] + from_a * before
                z[i, c] += step * speed + z_start * before + z_known * known
                v[i, c] += v_start * before + v_known * known
                a[i, c] = known
        _residual(layout, sums, _ZERO, load_factor, z, v, q, _ZERO, _ONE)
        _solve(layout, lu, q)
        for i in range(layout.n):
            for c in range(z.shape[1]):
                found = q[i, c]
                z[i, c] += k_weight * found
                v[i, c] += c_weight * found
                a[i, c] += kappa * found
        if not _within(z, bound):
            return taken + 1, UNBOUNDED
        if (done + taken + 1) % every == 0:
            _store_row(stored, (done + taken + 1) // every, z, v, q)
    return n_steps, COMPLETED


@_compiled
def _stage_matrix(layout, stages, count, coefficients, sums, matrix, scale):
    """delta_sr M_s + h a_sr C_s + h^2 e_sr K_s at row (i, s), column (j, r), factorised; false where a pivot vanishes.

    sums: at one stage after the other
    """
    _stay_apart()
    n_slots = layout.n_slots
    apart = _THREE * n_slots + layout.n
    a_weights = _ONE + count
    e_weights = a_weights + count * count
    for i in range(layout.n):
        for s in range(count):
            row = s * apart + layout.base[i]
            for j in range(layout.first[i], layout.last[i]):
                c, k = sums[row + j + n_slots], sums[row + j + _TWO * n_slots]
                slot = stages.base[count * i + s] + count * j
                for r in range(count):
                    place = s * count + r
                    matrix[slot + r] = coefficients[a_weights + place] * c + coefficients[e_weights + place] * k
                matrix[slot + s] += sums[row + j]
            m, place = row + i, s * (count + _ONE)
            damping = abs(coefficients[a_weights + place] * sums[m + n_slots])
            stiffness = abs(coefficients[e_weights + place] * sums[m + _TWO * n_slots])
            scale[count * i + s] = damping + stiffness + abs(sums[m])
    return _factor(stages, matrix, scale)


@_cached
@_made_of_parts
def collocation(
    layout, terms, stages, scalars, period, position, n_steps, coefficients, load_factor, state, done, every, bound,
    stored,
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
    z, v, _, q = state
    n, count, columns = layout.n, stages.n // layout.n, z.shape[1]
    apart, step = _THREE * layout.n_slots + n, coefficients[0]
    v_weights = _ONE + count + _TWO * count * count
    z_weights = v_weights + count
    sums, scale = np.empty(_THREE * apart), np.empty(stages.n)
    matrix, mass = np.empty(stages.n_slots), np.empty(layout.n_slots)
    at_stage, x = np.empty((n, columns)), np.empty((stages.n, columns))
    for taken in range(n_steps):
        row = (position + taken) % period * 3
        for s in range(3):
            _affine_sums(terms, scalars[row + s + 1], sums, np.uint64(s) * apart)
        if not _stage_matrix(layout, stages, count, coefficients, sums, matrix, scale):
            return taken, SINGULAR
        for s in range(count):
            for i in range(n):
                for c in range(columns):
                    at_stage[i, c] = z[i, c] + coefficients[_ONE + s] * v[i, c]
            _residual(layout, sums, s * apart, load_factor, at_stage, v, x, s, count)
        _solve(stages, matrix, x)
        for i in range(n):
            for c in range(columns):
                faster, moved = 0.0, z[i, c] + step * v[i, c]
                for s in range(count):
                    faster += coefficients[v_weights + s] * x[count * i + s, c]
                    moved += coefficients[z_weights + s] * x[count * i + s, c]
                z[i, c], v[i, c], q[i, c] = moved, v[i, c] + faster, x[count * i + count - _ONE, c]
        if not _within(z, bound):
            return taken + 1, UNBOUNDED
        if (done + taken + 1) % every == 0:
            if count == _TWO:
                if not _newmark_matrix(layout, sums, _TWO * apart, 0.0, 0.0, mass, scale):
                    return taken, SINGULAR
                _residual(layout, sums, _TWO * apart, load_factor, z, v, q, _ZERO, _ONE)
                _solve(layout, mass, q)
            _store_row(stored, (done + taken + 1) // every, z, v, q)
    return n_steps, COMPLETED


@_cached
@_made_of_parts
def exact_modal(
    layout, terms, forces, period, position, n_steps, coefficients, load_factor, state, done, every, bound, stored
):
    """Decoupled modes m z'' + c z' + k z = F, the paper's eq. (143) and damping; exact for F linear in t.

    coefficients, forces: shapes (11, n) and (period + 1, n), of `kaneflex.integrate.modal`; the forces are those at
    the steps. `bound` is that of each square.
    """
    z, v, _, q = state
    w = coefficients
    for count in range(n_steps):
        row, bounded = (position + count) % period, True
        for i in range(layout.n):
            for column in range(z.shape[1]):
                factor, moved, speed = load_factor[column], z[i, column], v[i, column]
                before, now = factor * forces[row, i], factor * forces[row + 1, i]
                there = w[0, i] * moved + w[1, i] * speed + (w[2, i] * before + w[3, i] * now)
                speed = w[4, i] * moved + w[5, i] * speed + (w[6, i] * before + w[7, i] * now)
                z[i, column], v[i, column] = there, speed
                q[i, column] = w[8, i] * now - w[9, i] * speed - w[10, i] * there
                bounded = bounded and there * there < bound
        if not bounded:
            return count + 1, UNBOUNDED
        if (done + count + 1) % every == 0:
            _store_row(stored, (done + count + 1) // every, z, v, q)
    return n_steps, COMPLETED
