"""The loop of Newmark's family for at most LANES coordinates: a vector of them in one register.

A solve would wait for itself, number after number. So the inverse is written out for eight steps at once, and a step is
a few products of a matrix and a vector, by columns.
"""

import numpy as np
from numba import njit

from kaneflex.integrate import conventions, inverse, lanes, matrices
from kaneflex.integrate.conventions import COMPLETED, FASTMATH, LANES, SINGULAR, UNBOUNDED
from kaneflex.integrate.inverse import invert
from kaneflex.integrate.lanes import absolute, lane_sum, load, load_run, store, store_run
from kaneflex.integrate.matrices import (
    ONE,
    THREE,
    ZERO,
    affine_sum,
    compiled,
    empty_lanes,
    hand_over,
    rows_read,
    weights,
)
from kaneflex.support.fingerprint import made_of

# Compiled in one piece, as the loops of `steppers` are: what is left of a step here is less work than a call.
_WIDTH = np.uint64(LANES)


@compiled
def _columns(order, packed, scalars, block, c_weight, k_weight, sums, columns, scale, good):
    """The inverse of M + c_weight C + k_weight K, then C, K and F: LANES slots a column."""
    layout = packed.layout
    n, n_slots = np.uint64(len(order)), layout.n_slots
    affine_sum(packed, scalars, block, sums, ZERO)
    for i in range(n):
        for j in range(layout.first[i]):  # beyond the band: the last inverse is still there
            store(columns, _WIDTH * j + i, 0.0)
        for j in range(layout.last[i], n):
            store(columns, _WIDTH * j + i, 0.0)
        for j in range(layout.first[i], layout.last[i]):
            m = layout.base[i] + j
            c, k, slot = load(sums, n_slots + m), load(sums, n_slots + n_slots + m), _WIDTH * j + i
            store(columns, slot, load(sums, m) + c_weight * c + k_weight * k)
            store(columns, _WIDTH * n + slot, c)
            store(columns, _WIDTH * (n + n) + slot, k)
        store(columns, _WIDTH * THREE * n + i, load(sums, THREE * n_slots + i))
        m = layout.base[i] + i
        c, k = load(sums, n_slots + m), load(sums, n_slots + n_slots + m)
        store(scale, i, absolute(load(sums, m)) + absolute(c_weight * c) + absolute(k_weight * k))
    invert(order, columns, scale, good)


@compiled
def _copy(source, target, n):
    for column in range(source.shape[0]):
        for i in range(n):
            target[column, i] = source[column, i]


@compiled
def _wide(part):
    """Columns of n numbers, filled up with zeros to LANES: shape (columns, LANES)."""
    filled = np.zeros((part.shape[0], LANES))
    _copy(part, filled, part.shape[1])
    return filled


@njit(cache=True, error_model="numpy", fastmath=FASTMATH, no_cfunc_wrapper=True)
@made_of(conventions.__file__, inverse.__file__, lanes.__file__, matrices.__file__)
def newmark(
    order, packed, scalars, period, position, n_steps, coefficients, load_factor, state, done, every, bound, stored
):
    """The steps of `kaneflex.integrate.steppers.newmark`, one motion after the other; order: as `invert` takes it."""
    n, n_columns = np.uint64(len(order)), state[0].shape[0]
    step, from_q, from_a, kappa, c_weight, k_weight, v_start, v_known, z_start, z_known = weights(coefficients)
    sums, scale, good = empty_lanes(THREE * packed.layout.n_slots + n), empty_lanes(n), empty_lanes(1)
    columns = np.zeros((_WIDTH * (THREE * n + ONE), LANES))  # zeros where there is no coordinate
    z, v, a, q = _wide(state[0]), _wide(state[1]), _wide(state[2]), _wide(state[3])
    residual = np.zeros((1, LANES))
    column_rows, good_rows = rows_read(z, columns), rows_read(z, good)
    due = every - done % every
    out = done // every + 1
    taken, status = n_steps, COMPLETED
    for count in range(n_steps):
        row = position % LANES
        if row == 0 or count == 0:
            _columns(order, packed, scalars, position // LANES, c_weight, k_weight, sums, columns, scale, good)
            hand_over(columns, column_rows)
            hand_over(good, good_rows)
        if not good_rows[row, 0] > 0.0:
            taken, status = count, SINGULAR
            break
        for column in range(n_columns):
            here = (column, 0)
            before, speed = load_run(a, here), load_run(v, here)
            known = from_q * load_run(q, here) + from_a * before
            displaced = load_run(z, here) + step * speed + z_start * before + z_known * known
            speed += v_start * before + v_known * known
            store_run(z, here, displaced)
            store_run(v, here, speed)
            force = load_factor[column] * load_run(column_rows, (row, _WIDTH * THREE * n))
            reaction = 0.0 * force
            for j in range(n):
                force -= load(v, (column, j)) * load_run(column_rows, (row, _WIDTH * (n + j)))
                reaction += load(z, (column, j)) * load_run(column_rows, (row, _WIDTH * (n + n + j)))
            store_run(residual, (0, 0), force - reaction)
            found = 0.0 * force
            for j in range(n):
                found += load(residual, (0, j)) * load_run(column_rows, (row, _WIDTH * j))
            displaced += k_weight * found
            store_run(z, here, displaced)
            store_run(v, here, speed + c_weight * found)
            store_run(a, here, known + kappa * found)
            store_run(q, here, found)
            if not lane_sum(displaced * displaced) < bound:
                taken, status = count + 1, UNBOUNDED
                break
        if status != COMPLETED:
            break
        position += 1
        if position == period:
            position = 0
        due -= 1
        if due == 0:
            due = every
            for i in range(n):
                stored[0][out, i], stored[1][out, i], stored[2][out, i] = z[0, i], v[0, i], q[0, i]
            out += 1
    _copy(z, state[0], n)
    _copy(v, state[1], n)
    _copy(a, state[2], n)
    _copy(q, state[3], n)
    return taken, status
