"""Compiled loop that evaluates the polynomials of sensors, many instants at once.

All arrays are given by their addresses, row by row. Rows of numbers have one instant after the other.
"""

from __future__ import annotations

import math

from numba import njit, void
from numba.types import CPointer, float64, int64

from kaneflex.integrate.conventions import BLOCK, FASTMATH
from kaneflex.support.inner import PART, shifted

_N, _WHOLE = CPointer(float64), CPointer(int64)
SIGNATURE = void(*[_WHOLE] * 3, *[_N] * 5)
_compiled = njit(error_model="numpy", fastmath=FASTMATH, _nrt=False, **PART)


@_compiled
def _set_zero(total):
    for t in range(BLOCK):
        total[t] = 0.0


@_compiled
def _add_product(total, factor, one, other):
    """Add factor x one x other."""
    for t in range(BLOCK):
        total[t] += factor * one[t] * other[t]


@_compiled
def _solve(rows, n, entries, x):
    """Least-squares solution x of A x = b, by Householder reflections (Golub and Van Loan 2013, 5.3).

    ``entries``: A, row by row, then b, and a row of work; all are overwritten.
    """
    along = shifted(entries, BLOCK * rows * (n + 1))
    for k in range(n):
        own = shifted(entries, BLOCK * (k * n + k))
        begin = shifted(x, BLOCK * k)  # of the solution until it is known: the diagonal of R
        _set_zero(along)
        for i in range(k, rows):
            column = shifted(entries, BLOCK * (i * n + k))
            _add_product(along, 1.0, column, column)
        for t in range(BLOCK):
            begin[t] = -math.copysign(math.sqrt(along[t]), own[t])
            own[t] -= begin[t]
        for j in range(k + 1, n + 1):
            first, apart = (j, n) if j < n else (rows * n, 1)
            _set_zero(along)
            for i in range(k, rows):
                other = shifted(entries, BLOCK * (first + i * apart))
                _add_product(along, 1.0, other, shifted(entries, BLOCK * (i * n + k)))
            for t in range(BLOCK):
                along[t] /= begin[t] * own[t]
            for i in range(k, rows):
                other = shifted(entries, BLOCK * (first + i * apart))
                _add_product(other, 1.0, along, shifted(entries, BLOCK * (i * n + k)))
    for k in range(n - 1, -1, -1):
        found, known = shifted(x, BLOCK * k), shifted(entries, BLOCK * (rows * n + k))
        for j in range(k + 1, n):
            _add_product(known, -1.0, shifted(entries, BLOCK * (k * n + j)), shifted(x, BLOCK * j))
        for t in range(BLOCK):
            found[t] = known[t] / found[t]


@_compiled
def read(plan, ends, pairs, given, constants, numbers, entries, found):
    """Evaluate the sensors (n_sensors, n_times) from given numbers and a one, (n_given + 1, n_times).

    plan: n_given + 1, n_times, which is a multiple of BLOCK, the number of stages, and the stages
    ends, pairs, constants, stages: see `kaneflex.response.polynomials.Readings`
    numbers, entries: work for one block of instants, (count, BLOCK) and (most sums of a system + 1, BLOCK)
    """
    width, n_times, n_stages, stages = plan[0], plan[1], plan[2], shifted(plan, 3)
    for begin in range(0, n_times, BLOCK):
        for k in range(width):
            for t in range(BLOCK):
                numbers[BLOCK * k + t] = given[n_times * k + begin + t]
        place, row, term = width, 0, 0
        for stage in range(n_stages):
            own, rows, n = stages[3 * stage], stages[3 * stage + 1], stages[3 * stage + 2]
            for k in range(own + rows * (n + 1)):
                total = shifted(numbers, BLOCK * (place + k)) if k < own else shifted(entries, BLOCK * (k - own))
                _set_zero(total)
                for each in range(term, ends[row]):
                    one, other = BLOCK * pairs[2 * each], BLOCK * pairs[2 * each + 1]
                    _add_product(total, constants[each], shifted(numbers, one), shifted(numbers, other))
                term = ends[row]
                row += 1
                if k >= own and n == 0:
                    for t in range(BLOCK):
                        found[n_times * (k - own) + begin + t] = total[t]
            place += own
            if n > 0:
                _solve(rows, n, entries, shifted(numbers, BLOCK * place))
                place += n
