"""The loop of Newmark's family for at most LANES coordinates: a vector of them in one register.

A solve would wait for itself, number after number. So the inverse is written out for eight steps at once, and a step is
a few products of a matrix and a vector, by columns.
"""

import numpy as np
from numba import njit

from kaneflex.integrate import inverse, lanes, matrices
from kaneflex.integrate.inverse import invert
from kaneflex.integrate.lanes import FASTMATH, LANES, at, put, put_run, run_at, size, total
from kaneflex.integrate.matrices import (
    COMPLETED,
    ONE,
    SINGULAR,
    THREE,
    UNBOUNDED,
    ZERO,
    affine_sum,
    compiled,
    hand_over,
    room,
    rows_read,
    weights,
)
from kaneflex.integrate.system import Packed
from kaneflex.support.fingerprint import made_of

_WIDTH = np.uint64(LANES)


@compiled
def _columns(order, packed, scalars, block, c_weight, k_weight, sums, columns, scale, good):
    """The inverse of M + c_weight C + k_weight K, then C, K and F: LANES slots a column."""
    layout = packed.layout
    n, n_slots = np.uint64(len(order)), layout.n_slots
    affine_sum(packed, scalars, block, sums, ZERO)
    for i in range(n):
        for j in range(layout.first[i]):  # beyond the band: the last inverse is still there
            put(columns, _WIDTH * j + i, 0.0)
        for j in range(layout.last[i], n):
            put(columns, _WIDTH * j + i, 0.0)
        for j in range(layout.first[i], layout.last[i]):
            m = layout.base[i] + j
            c, k, slot = at(sums, n_slots + m), at(sums, n_slots + n_slots + m), _WIDTH * j + i
            put(columns, slot, at(sums, m) + c_weight * c + k_weight * k)
            put(columns, _WIDTH * n + slot, c)
            put(columns, _WIDTH * (n + n) + slot, k)
        put(columns, _WIDTH * THREE * n + i, at(sums, THREE * n_slots + i))
        m = layout.base[i] + i
        c, k = at(sums, n_slots + m), at(sums, n_slots + n_slots + m)
        put(scale, i, size(at(sums, m)) + size(c_weight * c) + size(k_weight * k))
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
@made_of(inverse.__file__, lanes.__file__, matrices.__file__)
def _newmark(order, packed, scalars, period, position, n_steps, coefficients, load, state, done, every, bound, stored):
    n, n_columns = np.uint64(len(order)), state[0].shape[0]
    step, from_q, from_a, kappa, c_weight, k_weight, v_start, v_known, z_start, z_known = weights(coefficients)
    sums, scale, good = room(THREE * packed.layout.n_slots + n), room(n), room(1)
    columns = np.zeros((_WIDTH * (THREE * n + ONE), LANES))  # zeros where there is no coordinate
    z, v, a, q = _wide(state[0]), _wide(state[1]), _wide(state[2]), _wide(state[3])
    unbalanced = np.zeros((1, LANES))
    columns_at, good_at = rows_read(z, columns), rows_read(z, good)
    due = every - done % every
    out = done // every + 1
    taken, status = n_steps, COMPLETED
    for count in range(n_steps):
        row = position % LANES
        if row == 0 or count == 0:
            _columns(order, packed, scalars, position // LANES, c_weight, k_weight, sums, columns, scale, good)
            hand_over(columns, columns_at)
            hand_over(good, good_at)
        if not good_at[row, 0] > 0.0:
            taken, status = count, SINGULAR
            break
        for column in range(n_columns):
            here = (column, 0)
            before, speed = run_at(a, here), run_at(v, here)
            known = from_q * run_at(q, here) + from_a * before
            displaced = run_at(z, here) + step * speed + z_start * before + z_known * known
            speed += v_start * before + v_known * known
            put_run(z, here, displaced)
            put_run(v, here, speed)
            force = load[column] * run_at(columns_at, (row, _WIDTH * THREE * n))
            reaction = 0.0 * force
            for j in range(n):
                force -= at(v, (column, j)) * run_at(columns_at, (row, _WIDTH * (n + j)))
                reaction += at(z, (column, j)) * run_at(columns_at, (row, _WIDTH * (n + n + j)))
            put_run(unbalanced, (0, 0), force - reaction)
            found = 0.0 * force
            for j in range(n):
                found += at(unbalanced, (0, j)) * run_at(columns_at, (row, _WIDTH * j))
            displaced += k_weight * found
            put_run(z, here, displaced)
            put_run(v, here, speed + c_weight * found)
            put_run(a, here, known + kappa * found)
            put_run(q, here, found)
            if not total(displaced * displaced) < bound:
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


def newmark(packed: Packed, *rest: object) -> tuple[int, int]:
    """As `kaneflex.integrate.steppers.newmark`, for motions one after the other."""
    return _newmark((0.0,) * int(packed.layout.n), packed, *rest)
