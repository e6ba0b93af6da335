"""Compiled loops over the steps of a run; their parts are in `kaneflex.integrate.matrices`.

Arguments of the loops:

layout, terms  of the system: :class:`kaneflex.integrate.system.Layout`, `AffineSystem.sums`
scalars        table: of each step a row at its start and at its stages, if there are any, and the end of the last step
period         steps in the table; it is read again from its start after the last one
position       steps already taken in this table
n_steps        steps to take
coefficients   numbers of the method, see `kaneflex.integrate.methods`
load_factor    shape (columns,): factor on F for each column (1 for a motion, 0 for a free one)
state          z, v, a, q, each of shape (columns, n): displacements, velocities, the method's own and the true
               accelerations; overwritten. Several columns share one factorisation a step.
done, every    steps taken before this call; the first column is stored after every `every` steps
bound          largest permitted sum of squares of z
stored         z, v, true accelerations, each of shape (rows, n): row k belongs to step k * every

They return the number of completed steps and a status.

Matrices are added up and factorised for LANES steps at once, a number of each in one register, read by `load` and
written by `store`; then the steps follow one another, each for LANES columns at once.
"""

import numpy as np
from numba import njit

from kaneflex.integrate import conventions, lanes, matrices
from kaneflex.integrate.conventions import COMPLETED, FASTMATH, LANES, SINGULAR, UNBOUNDED
from kaneflex.integrate.lanes import absolute, everywhere, less, load, store
from kaneflex.integrate.matrices import (
    ONE,
    THREE,
    TWO,
    ZERO,
    affine_sums,
    compiled,
    factor,
    in_lanes,
    out_of_lanes,
    read_steps,
    residual,
    solve,
)
from kaneflex.support.fingerprint import made_of

# numba hands over and types tuples of arrays one by one, and every number of a run by itself: hence the parameters.
_made_of_parts = made_of(conventions.__file__, lanes.__file__, matrices.__file__)
_cached = njit(cache=True, error_model="numpy", fastmath=FASTMATH, no_cfunc_wrapper=True)


@compiled
def _store_row(stored, out, z, v, q):
    """Store the first column of states in lanes in row `out`."""
    out_z, out_v, out_a = stored
    for i in range(z.shape[1]):
        out_z[out, i], out_v[out, i], out_a[out, i] = z[0, i, 0], v[0, i, 0], q[0, i, 0]


@compiled
def _newmark_matrices(layout, sums, begin, c_weight, k_weight, lu, scale, good):
    """Factorise M + c_weight C + k_weight K of LANES steps, of the sums from `begin` on."""
    damping = begin + layout.n_slots
    stiffness = damping + layout.n_slots
    for i in range(layout.n_slots):
        damped = load(sums, begin + i) + c_weight * load(sums, damping + i)
        store(lu, i, damped + k_weight * load(sums, stiffness + i))
    for i in range(layout.n):
        m = layout.base[i] + i
        c_part, k_part = c_weight * load(sums, damping + m), k_weight * load(sums, stiffness + m)
        store(scale, i, absolute(load(sums, begin + m)) + absolute(c_part) + absolute(k_part))
    factor(layout, lu, scale, good)


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
    z, v, a, q = in_lanes(state[0]), in_lanes(state[1]), in_lanes(state[2]), in_lanes(state[3])
    loads = in_lanes(load_factor.reshape((-1, 1)))
    step, from_q, from_a, kappa = coefficients[0], coefficients[1], coefficients[2], coefficients[3]
    c_weight, k_weight, v_start, v_known = coefficients[4], coefficients[5], coefficients[6], coefficients[7]
    z_start, z_known = coefficients[8], coefficients[9]
    sums, now = np.empty((THREE * layout.n_slots + layout.n, LANES)), np.empty((scalars.shape[1], LANES))
    lu, scale, good = np.empty((layout.n_slots, LANES)), np.empty((layout.n, LANES)), np.empty((1, LANES))
    taken, status = 0, COMPLETED
    while taken < n_steps and status == COMPLETED:
        lane = taken % LANES
        if lane == 0:
            read_steps(scalars, position + taken, 1, period, 1, 1, now)
            affine_sums(terms, now, sums, ZERO)
            _newmark_matrices(layout, sums, ZERO, c_weight, k_weight, lu, scale, good)
        if not good[0, lane] > 0.0:
            status = SINGULAR
            break
        for block in range(len(z)):
            z_own, v_own, a_own, q_own = z[block], v[block], a[block], q[block]
            for i in range(layout.n):
                before, speed = load(a_own, i), load(v_own, i)
                known = from_q * load(q_own, i) + from_a * before
                store(z_own, i, load(z_own, i) + step * speed + z_start * before + z_known * known)
                store(v_own, i, speed + v_start * before + v_known * known)
                store(a_own, i, known)
            residual(layout, sums, ZERO, lane, load(loads[block], 0), z_own, v_own, q_own, ZERO, ONE)
            solve(layout, lu, lane, q_own)
            squares = 0.0 * load(z_own, 0)
            for i in range(layout.n):
                found = load(q_own, i)
                moved = load(z_own, i) + k_weight * found
                store(z_own, i, moved)
                store(v_own, i, load(v_own, i) + c_weight * found)
                store(a_own, i, load(a_own, i) + kappa * found)
                squares += moved * moved
            if not everywhere(less(squares, bound)):
                status = UNBOUNDED
        taken += 1
        if status == COMPLETED and (done + taken) % every == 0:
            _store_row(stored, (done + taken) // every, z, v, q)
    out_of_lanes(z, state[0])
    out_of_lanes(v, state[1])
    out_of_lanes(a, state[2])
    out_of_lanes(q, state[3])
    return taken, status


@compiled
def _stage_matrices(layout, stages, count, coefficients, sums, matrix, scale, good):
    """delta_sr M_s + h a_sr C_s + h^2 e_sr K_s of LANES steps at row (i, s), column (j, r), factorised.

    sums: at one stage after the other
    """
    n_slots = layout.n_slots
    apart = THREE * n_slots + layout.n
    a_weights = ONE + count
    e_weights = a_weights + count * count
    for i in range(layout.n):
        for s in range(count):
            row = s * apart + layout.base[i]
            for j in range(layout.first[i], layout.last[i]):
                c, k = load(sums, row + j + n_slots), load(sums, row + j + TWO * n_slots)
                slot = stages.base[count * i + s] + count * j
                for r in range(count):
                    place = s * count + r
                    both = coefficients[a_weights + place] * c + coefficients[e_weights + place] * k
                    store(matrix, slot + r, both)
                store(matrix, slot + s, load(matrix, slot + s) + load(sums, row + j))
            m, place = row + i, s * (count + ONE)
            c, k = load(sums, m + n_slots), load(sums, m + TWO * n_slots)
            c, k = coefficients[a_weights + place] * c, coefficients[e_weights + place] * k
            store(scale, count * i + s, absolute(c) + absolute(k) + absolute(load(sums, m)))
    factor(stages, matrix, scale, good)


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
    z, v, q = in_lanes(state[0]), in_lanes(state[1]), in_lanes(state[3])
    loads = in_lanes(load_factor.reshape((-1, 1)))
    n, count_s = layout.n, stages.n // layout.n
    apart, step = THREE * layout.n_slots + n, coefficients[0]
    v_weights = ONE + count_s + TWO * count_s * count_s
    z_weights = v_weights + count_s
    sums, now = np.empty((THREE * apart, LANES)), np.empty((scalars.shape[1], LANES))
    matrix, scale, good = np.empty((stages.n_slots, LANES)), np.empty((stages.n, LANES)), np.empty((1, LANES))
    mass, good_mass = np.empty((layout.n_slots, LANES)), np.empty((1, LANES))
    at_stage, x = np.empty((n, LANES)), np.empty((stages.n, LANES))
    taken, status = 0, COMPLETED
    while taken < n_steps and status == COMPLETED:
        lane = taken % LANES
        if lane == 0:
            for s in range(3):
                read_steps(scalars, position + taken, 1, period, 3, s + 1, now)
                affine_sums(terms, now, sums, np.uint64(s) * apart)
            _stage_matrices(layout, stages, count_s, coefficients, sums, matrix, scale, good)
            if count_s == TWO:
                _newmark_matrices(layout, sums, TWO * apart, 0.0, 0.0, mass, scale, good_mass)
        if not good[0, lane] > 0.0:
            status = SINGULAR
            break
        for block in range(len(z)):
            z_own, v_own, q_own = z[block], v[block], q[block]
            for s in range(count_s):
                ahead = coefficients[ONE + s]
                for i in range(n):
                    store(at_stage, i, load(z_own, i) + ahead * load(v_own, i))
                residual(layout, sums, s * apart, lane, load(loads[block], 0), at_stage, v_own, x, s, count_s)
            solve(stages, matrix, lane, x)
            squares = 0.0 * load(z_own, 0)
            for i in range(n):
                faster, moved = 0.0 * squares, load(z_own, i) + step * load(v_own, i)
                for s in range(count_s):
                    found = load(x, count_s * i + s)
                    faster += coefficients[v_weights + s] * found
                    moved += coefficients[z_weights + s] * found
                store(z_own, i, moved)
                store(v_own, i, load(v_own, i) + faster)
                store(q_own, i, load(x, count_s * i + count_s - ONE))
                squares += moved * moved
            if not everywhere(less(squares, bound)):
                status = UNBOUNDED
        if status == COMPLETED and (done + taken + 1) % every == 0:
            if count_s == TWO:
                if not good_mass[0, lane] > 0.0:
                    status = SINGULAR
                    break
                residual(layout, sums, TWO * apart, lane, load(loads[0], 0), z[0], v[0], q[0], ZERO, ONE)
                solve(layout, mass, lane, q[0])
            _store_row(stored, (done + taken + 1) // every, z, v, q)
        taken += 1
    out_of_lanes(z, state[0])
    out_of_lanes(v, state[1])
    out_of_lanes(q, state[3])
    return taken, status


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
        row = (position + count) % period
        for column in range(z.shape[0]):
            factor, bounded = load_factor[column], True
            for i in range(layout.n):
                moved, speed = z[column, i], v[column, i]
                before, now = factor * forces[row, i], factor * forces[row + 1, i]
                there = w[0, i] * moved + w[1, i] * speed + (w[2, i] * before + w[3, i] * now)
                speed = w[4, i] * moved + w[5, i] * speed + (w[6, i] * before + w[7, i] * now)
                z[column, i], v[column, i] = there, speed
                q[column, i] = w[8, i] * now - w[9, i] * speed - w[10, i] * there
                bounded = bounded and there * there < bound
            if not bounded:
                return count + 1, UNBOUNDED
        if (done + count + 1) % every == 0:
            out_z, out_v, out_a = stored
            out = (done + count + 1) // every
            for i in range(layout.n):
                out_z[out, i], out_v[out, i], out_a[out, i] = z[0, i], v[0, i], q[0, i]
    return n_steps, COMPLETED
