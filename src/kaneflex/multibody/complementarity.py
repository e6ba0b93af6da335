"""Linear complementarity problems of small size: what rigid sides exert on each other where several of them touch.

x >= 0, u = W x + b >= 0 and x . u = 0, W being symmetric and positive semidefinite: u are rates of gaps, or their
accelerations, and x impulses, or forces. It is that of the least x . (W x/2 + b) with x >= 0, solved by an active set
(van de Panne & Whinston 1964, Oper. Res. 12, 422; as in Baraff 1994, Proc. SIGGRAPH, 23): one x after another
grows until its u is zero, while those that are above zero already keep theirs at zero; whichever comes to zero on the
way leaves. Where W is singular, as with more contacts than a body needs, x is one of many and u the only one.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.multibody import dense_lu
from kaneflex.multibody.tables import ACTS, CONTACTS, OPTIONS, TOUCHING, apart, larger

_NOTHING = 1e-13
"""Of the largest b: a u that is no less than its negative."""
_FLAT = 1e-12
"""Of W's own: what is left of it where others determine it."""


@njit(**OPTIONS)
def complement(m, W, b, x, u, may, n):
    """Fill x and u [places in w] of n contacts; those whose ``may`` is 0 stay at x = 0, whatever their u. False: none.

    After W lies room for as large a square and a row more, and for whole numbers after the list of those that touch.
    """
    apart()
    w, most = m.w, m.plan[ACTS] - m.plan[CONTACTS]
    active, chosen, largest = m.plan[TOUCHING] + most, 0, 0.0
    for i in range(n):
        w[x + i], w[u + i] = 0.0, w[b + i]
        largest = larger(largest, abs(w[b + i]))
    for _ in range(20 * (n + 1)):
        j, least = -1, 0.0
        for i in range(n):
            size = w[u + i] / math.sqrt(w[W + (n + 1) * i] + 1e-300)
            if w[may + i] != 0.0 and w[u + i] < -_NOTHING * largest and size < least:
                j, least = i, size
        if j < 0:
            return True
        leaving = 0
        while leaving >= 0:
            leaving, step = _step(m, W, x, u, chosen, n, j)
            if step < 0.0:
                if w[u + j] < -1e-9 * largest:
                    return False
                w[may + j] = 0.0  # more contacts than determine each other, but for rounding
                break
            _go(m, W, x, u, chosen, n, j, step)
            if leaving < 0:
                m.pivots[active + chosen] = j
                chosen += 1
            else:
                w[x + m.pivots[active + leaving]] = 0.0
                chosen -= 1
                for r in range(leaving, chosen):
                    m.pivots[active + r] = m.pivots[active + r + 1]
            for r in range(chosen):
                w[u + m.pivots[active + r]] = 0.0
    return False


@njit(**OPTIONS)
def _step(m, W, x, u, chosen, n, j):
    """Which of the active leaves first as x of j grows, -1 where u of j comes to zero before, and by how much x does.

    Below zero: neither. Those that are active change, after the room's square, so that their u stay.
    """
    w, pivots, most = m.w, m.pivots, m.plan[ACTS] - m.plan[CONTACTS]
    active, room = m.plan[TOUCHING] + most, W + most * most
    d = room + most * most
    for r in range(chosen):
        i = pivots[active + r]
        for s in range(chosen):
            w[room + chosen * r + s] = w[W + n * i + pivots[active + s]]
        w[d + r] = -w[W + n * i + j]
    if chosen:
        dense_lu.factorise(w, room, chosen, pivots, active + most)
        dense_lu.substitute(w, room, chosen, pivots, active + most, d)
    curvature = w[W + (n + 1) * j]
    for r in range(chosen):
        curvature += w[W + n * j + pivots[active + r]] * w[d + r]
    leaving, step = -1, -1.0
    if curvature > _FLAT * w[W + (n + 1) * j]:
        step = -w[u + j] / curvature
    for r in range(chosen):
        i = pivots[active + r]
        if w[d + r] < 0.0 and (step < 0.0 or w[x + i] < -step * w[d + r]):
            leaving, step = r, -w[x + i] / w[d + r]
    return leaving, step


@njit(**OPTIONS)
def _go(m, W, x, u, chosen, n, j, step):
    """Let x of j grow by a step, with those that are active."""
    w, most = m.w, m.plan[ACTS] - m.plan[CONTACTS]
    active, d = m.plan[TOUCHING] + most, W + 2 * most * most
    for r in range(chosen + 1):
        i = m.pivots[active + r] if r < chosen else j
        change = step * w[d + r] if r < chosen else step
        w[x + i] += change
        for k in range(n):
            w[u + k] += change * w[W + n * k + i]
