"""The compiled loops. One specialisation of each serves every scene, a second one eight stretches of time at once.

Their parts are in `kaneflex.integrate.matrices` and `kaneflex.integrate.lanes`. Newmark's steps one after the other go
faster in loops for small systems and for long chains: `kaneflex.integrate.small`, `kaneflex.integrate.chains`.

Arguments of the loops `newmark`, `gauss` and `exact_modal`:

packed        the system, :class:`kaneflex.integrate.system.Packed`
scalars       table of the motion, see below
period        steps in the table; it is read again from its start after the last one
position      steps already taken in this table
n_steps       steps to take
coefficients  numbers of the method, see `kaneflex.integrate.methods`
load          shape (columns,): factor on F for each column (1 for a motion, 0 for a free one)
state         z, v, a, q, each of shape (columns, n): displacements, velocities, the method's own and the true
              accelerations; overwritten. Several columns share one factorisation a step.
done, every   steps taken before this call; the first column is stored after every `every` steps
bound         largest sum of squares of z that is still believed
stored        z, v, true accelerations, each of shape (rows, n): row k belongs to step k * every

They return the number of completed steps and a status.

Lanes. Matrices are added up and factorised for LANES steps at once, a number of each in one register, read by `at`
and written by `put`. So the table of `newmark` and `gauss` has the shape (blocks * nodes, n_scalars, LANES): step
LANES * b + l is in block b, lane l, with its scalars at the stages, if there are any, and at its end. The steps
themselves follow one another. Where `state` and `stored` have an axis of LANES more, each lane is a motion of its own,
takes the step of its lane in every block, and all go side by side; they stop where any lane would. So do motions of
LANES systems, whose `packed.data` and `coefficients` have that axis, too.
"""

import math

import numpy as np
from numba import njit

from kaneflex.integrate import lanes, matrices
from kaneflex.integrate.lanes import FASTMATH, LANES, at, everywhere, less, put, size
from kaneflex.integrate.matrices import (
    COMPLETED,
    ONE,
    SINGULAR,
    THREE,
    TWO,
    UNBOUNDED,
    affine_sum,
    compiled,
    factor,
    hand_over,
    inlined,
    mass_matrices,
    room,
    rows_read,
    solve,
    step_place,
    true_accelerations,
    unbalanced,
    weights,
)  # fmt: skip
from kaneflex.stamp import made_of

_STAGE_1, _STAGE_2 = 0.5 - math.sqrt(3.0) / 6.0, 0.5 + math.sqrt(3.0) / 6.0
_made_of_parts = made_of(lanes.__file__, matrices.__file__)
_cached = njit(cache=True, error_model="numpy", fastmath=FASTMATH, no_cfunc_wrapper=True)


@inlined
def _store(stored, out, z, v, q):
    """Row `out` of what is kept: the first column."""
    out_z, out_v, out_a = stored
    for i in range(z.shape[1]):
        put(out_z, (out, i), at(z, (0, i)))
        put(out_v, (out, i), at(v, (0, i)))
        put(out_a, (out, i), at(q, (0, i)))


@compiled
def _newmark_matrices(packed, scalars, row, c_weight, k_weight, sums, lu, scale, good):
    """All sums, and M + c_weight C + k_weight K factorised."""
    layout = packed.layout
    n_slots = layout.n_slots
    affine_sum(packed, scalars, row, sums)
    for i in range(n_slots):
        stiffness = at(sums, n_slots + n_slots + i)
        put(lu, i, at(sums, i) + c_weight * at(sums, n_slots + i) + k_weight * stiffness)
    for i in range(layout.n):
        m = layout.base[i] + i
        c_part, k_part = c_weight * at(sums, n_slots + m), k_weight * at(sums, n_slots + n_slots + m)
        put(scale, i, size(at(sums, m)) + size(c_part) + size(k_part))
    factor(layout, lu, scale, good)


@_cached
@_made_of_parts
def newmark(packed, scalars, period, position, n_steps, coefficients, load, state, done, every, bound, stored):
    """Newmark's family with weighted accelerations, unknown: the true acceleration q at the end of the step.

    With p = (alpha_f q_0 - alpha_m a_0) / (1 - alpha_m), known, and kappa = (1 - alpha_f) / (1 - alpha_m):

        a_1 = p + kappa q_1
        v_1 = v_0 + h ((1 - gamma) a_0 + gamma a_1)
        z_1 = z_0 + h v_0 + h^2 ((1/2 - beta) a_0 + beta a_1)
        (M + gamma h kappa C + beta h^2 kappa K) q_1 = F - C v_p - K z_p  at the end of the step,

    v_p and z_p being v_1 and z_1 less their share of q_1 (Arnold and Bruels 2007, section 2, whose
    accelerations satisfy the equation of motion; for constant M it is the method of Chung and Hulbert 1993).
    """
    layout, (z, v, a, q) = packed.layout, state
    n, n_slots = layout.n, layout.n_slots
    step, from_q, from_a, kappa, c_weight, k_weight, v_start, v_known, z_start, z_known = weights(coefficients)
    sums, lu, scale, good = room(THREE * n_slots + n), room(n_slots), room(n), room(1)
    sums_at, lu_at, good_at = rows_read(z, sums), rows_read(z, lu), rows_read(z, good)
    due = every - done % every
    out = done // every + 1
    for count in range(n_steps):
        block, row = step_place(z, position)
        if row == 0 or count == 0:
            _newmark_matrices(packed, scalars, block, c_weight, k_weight, sums, lu, scale, good)
            hand_over(sums, sums_at)
            hand_over(lu, lu_at)
            hand_over(good, good_at)
        if not everywhere(less(0.0, at(good_at, (row, 0)))):
            return count, SINGULAR
        for column in range(z.shape[0]):
            for i in range(n):
                here = (column, i)
                before, speed = at(a, here), at(v, here)
                known = from_q * at(q, here) + from_a * before
                put(z, here, at(z, here) + step * speed + z_start * before + z_known * known)
                put(v, here, speed + v_start * before + v_known * known)
                put(a, here, known)
            for i in range(n):
                put(q, (column, i), unbalanced(layout, sums_at, row, load[column], z, column, v, column, i))
            solve(layout, lu_at, row, q, column)
            squares = 0.0 * at(z, (column, 0))
            for i in range(n):
                here = (column, i)
                found = at(q, here)
                moved = at(z, here) + k_weight * found
                put(z, here, moved)
                put(v, here, at(v, here) + c_weight * found)
                put(a, here, at(a, here) + kappa * found)
                squares += moved * moved
            if not everywhere(less(squares, bound)):
                return count + 1, UNBOUNDED
        position += 1
        if position == period:
            position = 0
        due -= 1
        if due == 0:
            due = every
            _store(stored, out, z, v, q)
            out += 1
    return n_steps, COMPLETED


@compiled
def _gauss_matrices(packed, scalars, row, step, sums_1, sums_2, matrix, scale, good):
    """All sums at the stages; delta_sr M_s + h a_sr C_s + h^2 e_sr K_s at row (i, s), column (j, r), factorised."""
    layout, pairs = packed.layout, packed.pairs
    n_slots = layout.n_slots
    root = math.sqrt(3.0) / 6.0
    c_same, c_12, c_21 = 0.25 * step, (0.25 - root) * step, (0.25 + root) * step
    k_same, k_12, k_21 = step * step / 24.0, 0.5 * step * c_12, 0.5 * step * c_21
    affine_sum(packed, scalars, row, sums_1)
    affine_sum(packed, scalars, row + 1, sums_2)
    for i in range(layout.n):
        base = layout.base[i]
        row_1 = pairs.base[TWO * i]
        row_2 = pairs.base[TWO * i + ONE]
        for j in range(layout.first[i], layout.last[i]):
            m, c, k = base + j, n_slots + base + j, n_slots + n_slots + base + j
            c_1, k_1, c_2, k_2 = at(sums_1, c), at(sums_1, k), at(sums_2, c), at(sums_2, k)
            put(matrix, row_1 + TWO * j, at(sums_1, m) + c_same * c_1 + k_same * k_1)
            put(matrix, row_1 + TWO * j + ONE, c_12 * c_1 + k_12 * k_1)
            put(matrix, row_2 + TWO * j, c_21 * c_2 + k_21 * k_2)
            put(matrix, row_2 + TWO * j + ONE, at(sums_2, m) + c_same * c_2 + k_same * k_2)
        m, c, k = base + i, n_slots + base + i, n_slots + n_slots + base + i
        for stage in range(TWO):
            sums = sums_1 if stage == 0 else sums_2
            parts = size(at(sums, m)) + size(c_same * at(sums, c)) + size(k_same * at(sums, k))
            put(scale, TWO * i + stage, parts)
    factor(pairs, matrix, scale, good)


@_cached
@_made_of_parts
def gauss(packed, scalars, period, position, n_steps, coefficients, load, state, done, every, bound, stored):
    """Two-stage Gauss-Legendre (Hairer and Wanner 1996, table IV.5.1); unknowns: accelerations at the stages.

    With x_1, x_2 in M_s x_s + C_s v_s + K_s z_s = F_s at t + c_s h, the tableau's a_sr and e_sr = (A A)_sr:

        v_s = v_0 + h sum_r a_sr x_r,  z_s = z_0 + c_s h v_0 + h^2 sum_r e_sr x_r
        v_1 = v_0 + h/2 (x_1 + x_2),   z_1 = z_0 + h v_0 + h^2/2 ((1 - c_1) x_1 + (1 - c_2) x_2)

    The accelerations that are stored come from the equation of motion at the end of the step.
    """
    layout, pairs, (z, v, _, q) = packed.layout, packed.pairs, state
    n, n_slots = layout.n, layout.n_slots
    step = at(coefficients, 0)
    v_weight = 0.5 * step
    z_weight_1, z_weight_2 = v_weight * step * _STAGE_2, v_weight * step * _STAGE_1  # 1 - c_1 = c_2
    sums_1, sums_2, sums_3 = room(THREE * n_slots + n), room(THREE * n_slots + n), room(THREE * n_slots + n)
    matrix, mass, scale = room(pairs.n_slots), room(n_slots), room(TWO * n)
    good, good_mass = room(1), room(1)
    sums_1_at, sums_2_at, sums_3_at = rows_read(z, sums_1), rows_read(z, sums_2), rows_read(z, sums_3)
    matrix_at, mass_at = rows_read(z, matrix), rows_read(z, mass)
    good_at, good_mass_at = rows_read(z, good), rows_read(z, good_mass)
    at_stage, x = np.empty((1, *z.shape[1:])), np.empty((1, 2 * z.shape[1], *z.shape[2:]))
    due = every - done % every
    out = done // every + 1
    for count in range(n_steps):
        block, row = step_place(z, position)
        if row == 0 or count == 0:
            _gauss_matrices(packed, scalars, 3 * block, step, sums_1, sums_2, matrix, scale, good)
            hand_over(sums_1, sums_1_at)
            hand_over(sums_2, sums_2_at)
            hand_over(matrix, matrix_at)
            if due <= good_at.shape[0]:
                mass_matrices(packed, scalars, 3 * block + 2, sums_3, mass, scale, good_mass)
                hand_over(sums_3, sums_3_at)
                hand_over(mass, mass_at)
                hand_over(good_mass, good_mass_at)
            hand_over(good, good_at)
        if not everywhere(less(0.0, at(good_at, (row, 0)))):
            return count, SINGULAR
        for column in range(z.shape[0]):
            for stage in range(TWO):
                ahead = step * (_STAGE_1 if stage == 0 else _STAGE_2)
                sums = sums_1_at if stage == 0 else sums_2_at
                for i in range(n):
                    put(at_stage, (0, i), at(z, (column, i)) + ahead * at(v, (column, i)))
                for i in range(n):
                    rest = unbalanced(layout, sums, row, load[column], at_stage, 0, v, column, i)
                    put(x, (0, TWO * i + stage), rest)
            solve(pairs, matrix_at, row, x, 0)
            squares = 0.0 * at(z, (column, 0))
            for i in range(n):
                here = (column, i)
                x_1, x_2, speed = at(x, (0, TWO * i)), at(x, (0, TWO * i + ONE)), at(v, here)
                moved = at(z, here) + step * speed + z_weight_1 * x_1 + z_weight_2 * x_2
                put(z, here, moved)
                put(v, here, speed + v_weight * (x_1 + x_2))
                squares += moved * moved
            if not everywhere(less(squares, bound)):
                return count + 1, UNBOUNDED
        position += 1
        if position == period:
            position = 0
        due -= 1
        if due == 0:
            due = every
            if not everywhere(less(0.0, at(good_mass_at, (row, 0)))):
                return count, SINGULAR
            true_accelerations(layout, sums_3_at, mass_at, row, load, z, v, q, 0)
            _store(stored, out, z, v, q)
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
    """The inverse of `_gathered`; `lanes` is room for it."""
    put(lanes, 0, numbers)
    for i in range(min(LANES, part.shape[1] - block * LANES)):
        part[row, block * LANES + i] = lanes[0, i]


@_cached
@_made_of_parts
def exact_modal(packed, forces, period, position, n_steps, coefficients, load, state, done, every, bound, stored):
    """Decoupled modes m z'' + c z' + k z = F, the paper's eq. (143) and damping; exact for F linear in t.

    LANES modes are in a register for the whole run. coefficients, forces: shapes (11, blocks, LANES) and (period + 1,
    blocks, LANES), of `kaneflex.integrate.modal`; the forces are those at the steps. `bound` is that of each square.
    """
    z, v, _, q = state
    out_z, out_v, out_a = stored
    status = COMPLETED
    for block in range(forces.shape[1]):
        z_z, z_v, z_0, z_1 = (
            at(coefficients, (0, block)), at(coefficients, (1, block)), at(coefficients, (2, block)),
            at(coefficients, (3, block)),
        )  # fmt: skip
        v_z, v_v, v_0, v_1 = (
            at(coefficients, (4, block)), at(coefficients, (5, block)), at(coefficients, (6, block)),
            at(coefficients, (7, block)),
        )  # fmt: skip
        mobility, rate, square = (
            at(coefficients, (8, block)), at(coefficients, (9, block)), at(coefficients, (10, block))
        )  # fmt: skip
        for column in range(z.shape[0]):
            lanes = _gathered(v, column, block)
            moved, speed = at(_gathered(z, column, block), 0), at(lanes, 0)
            place, due, out = position, every - done % every, done // every + 1
            before = load[column] * at(forces, (place, block))
            for count in range(n_steps):
                place += 1
                now = load[column] * at(forces, (place, block))
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
