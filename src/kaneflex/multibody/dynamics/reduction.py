"""Compiled residual of the equations of motion as generalised forces of the independent coordinates.

It is N^T (M a - f), Kane's equations with the partial velocities N of the independent coordinates, and zero for
solutions. The reactions of the cuts balance the dependent coordinates of the tree.
"""

from __future__ import annotations

from numba import njit
from numba.types import CPointer, int64

from kaneflex.multibody.dynamics.dimensions import bent, demand, gradient
from kaneflex.multibody.dynamics import dense_lu
from kaneflex.multibody.dynamics.loop_closure import follow
from kaneflex.multibody.model.layout import (
    ACCEL, COORDINATES, CUT_OF, DEMAND, DEPENDENT, ENTRY, GRADIENT, INPUT, KEPT, LOOP, LOOP_PIVOTS, MECHANISM, N, NOW,
    OPTIONS, RATE, REACTIONS, ROW_OF, SIDE, Y, apart, shifted,
)  # fmt: skip


@njit(**OPTIONS)
def react(m):
    """Update the reactions of the cuts at NOW to balance the dependent coordinates; False: singular.

    At DEMAND the independent coordinates then have the whole residual.
    """
    apart()
    plan, w = m.plan, m.w
    n, count = plan[COORDINATES], plan[KEPT]
    for r in range(count):
        at = plan[GRADIENT] + n * r
        for i in range(n):
            w[at + i] = 0.0
        gradient(m, plan[plan[ROW_OF] + r], plan[plan[CUT_OF] + r], True, at)
        for k in range(count):
            w[plan[LOOP] + count * k + r] = w[at + plan[plan[DEPENDENT] + k]]
        w[plan[SIDE] + r] = w[plan[DEMAND] + plan[plan[DEPENDENT] + r]]
    if not dense_lu.factorise(w, plan[LOOP], count, m.pivots, plan[LOOP_PIVOTS]):
        return False
    dense_lu.substitute(w, plan[LOOP], count, m.pivots, plan[LOOP_PIVOTS], plan[SIDE])
    for r in range(count):
        size = w[plan[SIDE] + r]
        w[plan[NOW] + plan[plan[ROW_OF] + r]] += size
        for i in range(n):
            w[plan[DEMAND] + i] -= size * w[plan[GRADIENT] + n * r + i]
    return True


@njit(**ENTRY)
def reduced_demand(m, independent, n, rows, count, width, out):
    """Generalised forces of every row's motion, (count, n), N = kg m/s^2 or N m.

    A row: t [s], then the n independent coordinates, their rates and accelerations, then additions to the sizes of the
    loads and to the prescribed accelerations. independent: their numbers among the tree's coordinates. The tables keep
    the last row, with the reactions of its cuts, and without additions. Returns the number of rows done: the next one
    doesn't close.
    """
    plan, w = m.plan, m.w
    added, done = width - 1 - 3 * n, 0
    for row in range(count):
        here = shifted(rows, row * width)
        for k in range(n):
            i = independent[k]
            w[plan[Y] + i], w[plan[RATE] + i], w[plan[ACCEL] + i] = here[1 + k], here[1 + n + k], here[1 + 2 * n + k]
        for k in range(added):
            w[plan[INPUT] + k] = here[1 + 3 * n + k]
        for r in range(plan[REACTIONS]):
            w[plan[NOW] + r] = 0.0
        # Twice: the second pass starts with closed loops, so that rates follow from the gradient at this position.
        if not (follow(m, here[0]) and follow(m, here[0])):
            break
        demand(m, here[0])
        bent(m)
        if not react(m):
            break
        for k in range(n):
            out[n * row + k] = w[plan[DEMAND] + independent[k]]
        done += 1
    for k in range(added):
        w[plan[INPUT] + k] = 0.0
    return done


ENTRIES = {reduced_demand: int64(MECHANISM, CPointer(int64), int64, N, int64, int64, N)}
"""Signatures of the functions that Python calls."""
