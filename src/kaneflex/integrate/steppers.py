"""Compiled loops. One specialisation of each serves every scene, a second one eight segments of time at once.

Their parts are in `kaneflex.integrate.matrices` and `kaneflex.integrate.lanes`. Faster loops of Newmark's steps for
small systems and for long chains are in `kaneflex.integrate.dense` and `kaneflex.integrate.banded`.

Arguments of the loops `newmark`, `collocation` and `exact_modal`:

packed        the system, :class:`kaneflex.integrate.system.Packed`
scalars       table of the motion, see below
period        steps in the table; it is read again from its start after the last one
position      steps already taken in this table
n_steps       steps to take
coefficients  numbers of the method, see `kaneflex.integrate.methods`
load_factor   shape (columns,): factor on F for each column (1 for a motion, 0 for a free one)
state         z, v, a, q, each of shape (columns, n): displacements, velocities, the method's own and the true
              accelerations; overwritten. Several columns share one factorisation a step.
done, every   steps taken before this call; the first column is stored after every `every` steps
bound         largest permitted sum of squares of z
stored        z, v, true accelerations, each of shape (rows, n): row k belongs to step k * every

They return the number of completed steps and a status.

Lanes. Matrices are added up and factorised for LANES steps at once, a number of each in one register, read by `load`
and written by `store`. So the table of `newmark` and `collocation` has the shape (blocks * nodes, n_scalars, LANES):
step LANES * b + l is in block b, lane l, with its scalars at the stages, if there are any, and at its end. The steps
themselves follow one another. Where `state` and `stored` have an axis of LANES more, each lane is a motion of its own,
takes the step of its lane in every block, and all go side by side; they stop where any lane would.
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
    affine_sum,
    compiled,
    empty_lanes,
    factor,
    hand_over,
    inlined,
    mass_matrices,
    residual,
    rows_read,
    solve,
    step_place,
    true_accelerations,
    weights,
)  # fmt: skip
from kaneflex.support.fingerprint import made_of

# Compiled in one piece, with as many lines and parameters as a step needs: a step in a function of its own would be
# called once a step, which costs as much as a small solve.
_made_of_parts = made_of(conventions.__file__, lanes.__file__, matrices.__file__)
_cached = njit(cache=True, error_model="numpy", fastmath=FASTMATH, no_cfunc_wrapper=True)


@inlined
def _store_row(stored, out, z, v, q):
    """Store the first column in row `out`."""
    out_z, out_v, out_a = stored
    for i in range(z.shape[1]):
        store(out_z, (out, i), load(z, (0, i)))
        store(out_v, (out, i), load(v, (0, i)))
        store(out_a, (out, i), load(q, (0, i)))


@compiled
def _newmark_matrices(packed, scalars, row, c_weight, k_weight, sums, lu, scale, good):
    """Compute all sums, and factorise M + c_weight C + k_weight K."""
    layout = packed.layout
    n_slots = layout.n_slots
    affine_sum(packed, scalars, row, sums, ZERO)
    for i in range(n_slots):
        stiffness = load(sums, n_slots + n_slots + i)
        store(lu, i, load(sums, i) + c_weight * load(sums, n_slots + i) + k_weight * stiffness)
    for i in range(layout.n):
        m = layout.base[i] + i
        c_part, k_part = c_weight * load(sums, n_slots + m), k_weight * load(sums, n_slots + n_slots + m)
        store(scale, i, absolute(load(sums, m)) + absolute(c_part) + absolute(k_part))
    factor(layout, lu, scale, good)


@_cached
@_made_of_parts
def newmark(packed, scalars, period, position, n_steps, coefficients, load_factor, state, done, every, bound, stored):
    """Newmark's family with weighted accelerations, unknown: the true acceleration q at the end of the step.

    With p = (alpha_f q_0 - alpha_m a_0) / (1 - alpha_m), known, and kappa = (1 - alpha_f) / (1 - alpha_m):

        a_1 = p + kappa q_1;
        v_1 = v_0 + h ((1 - gamma) a_0 + gamma a_1);
        z_1 = z_0 + h v_0 + h^2 ((1/2 - beta) a_0 + beta a_1);
        (M + gamma h kappa C + beta h^2 kappa K) q_1 = F - C v_p - K z_p  at the end of the step,

    where v_p and z_p are v_1 and z_1 without their share of q_1 (Arnold and Bruels 2007, section 2, whose
    accelerations satisfy the equation of motion; for constant M it is the method of Chung and Hulbert 1993).
    """
    layout, (z, v, a, q) = packed.layout, state
    n, n_slots = layout.n, layout.n_slots
    step, from_q, from_a, kappa, c_weight, k_weight, v_start, v_known, z_start, z_known = weights(coefficients)
    sums, lu, scale, good = empty_lanes(THREE * n_slots + n), empty_lanes(n_slots), empty_lanes(n), empty_lanes(1)
    sums_rows, lu_rows, good_rows = rows_read(z, sums), rows_read(z, lu), rows_read(z, good)
    due = every - done % every
    out = done // every + 1
    for count in range(n_steps):
        block, row = step_place(z, position)
        if row == 0 or count == 0:
            _newmark_matrices(packed, scalars, block, c_weight, k_weight, sums, lu, scale, good)
            hand_over(sums, sums_rows)
            hand_over(lu, lu_rows)
            hand_over(good, good_rows)
        if not everywhere(less(0.0, load(good_rows, (row, 0)))):
            return count, SINGULAR
        for column in range(z.shape[0]):
            for i in range(n):
                here = (column, i)
                before, speed = load(a, here), load(v, here)
                known = from_q * load(q, here) + from_a * before
                store(z, here, load(z, here) + step * speed + z_start * before + z_known * known)
                store(v, here, speed + v_start * before + v_known * known)
                store(a, here, known)
            for i in range(n):
                rest = residual(layout, sums_rows, row, ZERO, load_factor[column], z, column, v, column, i)
                store(q, (column, i), rest)
            solve(layout, lu_rows, row, q, column)
            squares = 0.0 * load(z, (column, 0))
            for i in range(n):
                here = (column, i)
                found = load(q, here)
                moved = load(z, here) + k_weight * found
                store(z, here, moved)
                store(v, here, load(v, here) + c_weight * found)
                store(a, here, load(a, here) + kappa * found)
                squares += moved * moved
            if not everywhere(less(squares, bound)):
                return count + 1, UNBOUNDED
        position += 1
        if position == period:
            position = 0
        due -= 1
        if due == 0:
            due = every
            _store_row(stored, out, z, v, q)
            out += 1
    return n_steps, COMPLETED


@compiled
def _stage_matrices(packed, stages, order, scalars, row, coefficients, sums, matrix, scale, good):
    """All sums at the stages; delta_sr M_s + h a_sr C_s + h^2 e_sr K_s at row (i, s), column (j, r), factorised."""
    layout, count = packed.layout, np.uint64(len(order))
    n_slots = layout.n_slots
    apart = THREE * n_slots + layout.n
    for s in range(count):
        affine_sum(packed, scalars, row + s, sums, s * apart)
    a_weights = ONE + count
    e_weights = a_weights + count * count
    for i in range(layout.n):
        base = layout.base[i]
        for j in range(layout.first[i], layout.last[i]):
            for s in range(count):
                m = s * apart + base + j
                c, k = load(sums, m + n_slots), load(sums, m + n_slots + n_slots)
                slot = stages.base[count * i + s] + count * j
                for r in range(count):
                    place = s * count + r
                    both = load(coefficients, a_weights + place) * c + load(coefficients, e_weights + place) * k
                    store(matrix, slot + r, both)
                store(matrix, slot + s, load(matrix, slot + s) + load(sums, m))
        for s in range(count):
            m, place = s * apart + base + i, s * count + s
            c, k = load(sums, m + n_slots), load(sums, m + n_slots + n_slots)
            c, k = load(coefficients, a_weights + place) * c, load(coefficients, e_weights + place) * k
            store(scale, count * i + s, absolute(c) + absolute(k) + absolute(load(sums, m)))
    factor(stages, matrix, scale, good)


@_cached
@_made_of_parts
def collocation(
    packed, stages, order, scalars, period, position, n_steps, coefficients, load_factor, state, done, every, bound,
    stored,
):  # fmt: skip
    """Implicit Runge-Kutta methods of two or three stages, that many numbers in `order`, of which none matters.

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
    layout, (z, v, _, q) = packed.layout, state
    n, n_slots, count_s = layout.n, layout.n_slots, np.uint64(len(order))
    apart = THREE * n_slots + n
    step = load(coefficients, 0)
    v_weights = ONE + count_s + count_s * count_s + count_s * count_s
    z_weights = v_weights + count_s
    sums, matrix = empty_lanes(THREE * apart), empty_lanes(stages.n_slots)
    scale, good = empty_lanes(count_s * n), empty_lanes(1)
    mass, good_mass = empty_lanes(n_slots), empty_lanes(1)
    sums_rows, matrix_rows, good_rows = rows_read(z, sums), rows_read(z, matrix), rows_read(z, good)
    mass_rows, good_mass_rows = rows_read(z, mass), rows_read(z, good_mass)
    at_stage, x = np.empty((1, *z.shape[1:])), np.empty((1, len(order) * z.shape[1], *z.shape[2:]))
    due = every - done % every
    out = done // every + 1
    for count in range(n_steps):
        block, row = step_place(z, position)
        if row == 0 or count == 0:
            _stage_matrices(packed, stages, order, scalars, 3 * block, coefficients, sums, matrix, scale, good)
            if count_s == TWO and due <= good_rows.shape[0]:
                mass_matrices(packed, scalars, 3 * block + 2, sums, TWO * apart, mass, scale, good_mass)
                hand_over(mass, mass_rows)
                hand_over(good_mass, good_mass_rows)
            hand_over(sums, sums_rows)
            hand_over(matrix, matrix_rows)
            hand_over(good, good_rows)
        if not everywhere(less(0.0, load(good_rows, (row, 0)))):
            return count, SINGULAR
        for column in range(z.shape[0]):
            for s in range(count_s):
                ahead = load(coefficients, ONE + s)
                for i in range(n):
                    store(at_stage, (0, i), load(z, (column, i)) + ahead * load(v, (column, i)))
                for i in range(n):
                    rest = residual(layout, sums_rows, row, s * apart, load_factor[column], at_stage, 0, v, column, i)
                    store(x, (0, count_s * i + s), rest)
            solve(stages, matrix_rows, row, x, 0)
            squares = 0.0 * load(z, (column, 0))
            for i in range(n):
                here = (column, i)
                faster = 0.0 * squares
                moved = step * load(v, here)
                for s in range(count_s):
                    found = load(x, (0, count_s * i + s))
                    faster += load(coefficients, v_weights + s) * found
                    moved += load(coefficients, z_weights + s) * found
                moved += load(z, here)
                store(z, here, moved)
                store(v, here, load(v, here) + faster)
                store(q, here, load(x, (0, count_s * i + count_s - ONE)))
                squares += moved * moved
            if not everywhere(less(squares, bound)):
                return count + 1, UNBOUNDED
        position += 1
        if position == period:
            position = 0
        due -= 1
        if due == 0:
            due = every
            if count_s == TWO:
                if not everywhere(less(0.0, load(good_mass_rows, (row, 0)))):
                    return count, SINGULAR
                true_accelerations(layout, sums_rows, mass_rows, row, TWO * apart, load_factor, z, v, q, 0)
            _store_row(stored, out, z, v, q)
            out += 1
    return n_steps, COMPLETED


@compiled
def _gathered(part, column, block):
    """LANES numbers of a column from the block's first one on, shape (1, LANES); zeros beyond the last."""
    lanes = np.zeros((1, LANES))
    for i in range(min(LANES, part.shape[1] - block * LANES)):
        lanes[0, i] = part[column, block * LANES + i]
    return lanes


@compiled
def _scattered(numbers, lanes, part, row, block):
    """Inverse of `_gathered`; `lanes` is empty_lanes for it."""
    store(lanes, 0, numbers)
    for i in range(min(LANES, part.shape[1] - block * LANES)):
        part[row, block * LANES + i] = lanes[0, i]


@_cached
@_made_of_parts
def exact_modal(
    packed, forces, period, position, n_steps, coefficients, load_factor, state, done, every, bound, stored
):
    """Decoupled modes m z'' + c z' + k z = F, the paper's eq. (143) and damping; exact for F linear in t.

    LANES modes are in a register for the whole run. coefficients, forces: shapes (11, blocks, LANES) and (period + 1,
    blocks, LANES), of `kaneflex.integrate.modal`; the forces are those at the steps. `bound` is that of each square.
    """
    z, v, _, q = state
    out_z, out_v, out_a = stored
    status = COMPLETED
    for block in range(forces.shape[1]):
        z_z, z_v, z_0, z_1 = (
            load(coefficients, (0, block)), load(coefficients, (1, block)), load(coefficients, (2, block)),
            load(coefficients, (3, block)),
        )  # fmt: skip
        v_z, v_v, v_0, v_1 = (
            load(coefficients, (4, block)), load(coefficients, (5, block)), load(coefficients, (6, block)),
            load(coefficients, (7, block)),
        )  # fmt: skip
        mobility, rate, square = (
            load(coefficients, (8, block)), load(coefficients, (9, block)), load(coefficients, (10, block))
        )  # fmt: skip
        for column in range(z.shape[0]):
            lanes = _gathered(v, column, block)
            moved, speed = load(_gathered(z, column, block), 0), load(lanes, 0)
            place, due, out = position, every - done % every, done // every + 1
            before = load_factor[column] * load(forces, (place, block))
            for count in range(n_steps):
                place += 1
                now = load_factor[column] * load(forces, (place, block))
                here = z_z * moved + z_v * speed + (z_0 * before + z_1 * now)
                speed = v_z * moved + v_v * speed + (v_0 * before + v_1 * now)
                moved, before = here, now
                if not everywhere(less(moved * moved, bound)):
                    n_steps, status = count + 1, UNBOUNDED
                    break
                if place == period:
                    place = 0
                due -= 1
                if due == 0 and column == 0:
                    _scattered(moved, lanes, out_z, out, block)
                    _scattered(speed, lanes, out_v, out, block)
                    _scattered(mobility * now - rate * speed - square * moved, lanes, out_a, out, block)
                    out += 1
                if due == 0:
                    due = every
            _scattered(moved, lanes, z, column, block)
            _scattered(speed, lanes, v, column, block)
            _scattered(mobility * before - rate * speed - square * moved, lanes, q, column, block)
    return n_steps, status
