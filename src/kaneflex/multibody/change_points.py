"""Change points, compiled: places where all bars of a loop lie on one line, and branches of its motion cross.

There the cuts' rows lose rank, and reactions have a pole. At a small distance d from there a rounding error of a loop
is one of 1/d in places, 1/d^2 in rates and 1/d^3 in accelerations. The motion that goes on with its velocities is
smooth where one coordinate alone moves each loop, and so are the derivatives of dependent coordinates, by which no
reaction is needed: see :func:`kaneflex.multibody.loops.crosses`. Elastic bodies, whose loops pass such a place bent,
have no need of that. When the next change point comes is foreseen: the least pivot of the rows
(:func:`kaneflex.multibody.dependents.margin`) falls in proportion to d.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.multibody.dependents import determined, margin
from kaneflex.multibody.loops import SIDES, bent, crosses, reduce_across
from kaneflex.multibody.reduction import react
from kaneflex.multibody.rows import copy
from kaneflex.multibody.tables import (
    COORDINATES,
    CROSSING,
    DEPENDENT,
    KEPT,
    LEAST,
    MEASURE,
    NOW,
    OPTIONS,
    PASSED,
    PASSING,
    RATE,
    REACH,
    REACTIONS,
    SCALE,
    STAGE_A,
    STAGE_R,
    WHEN,
    apart,
    larger,
)  # fmt: skip
from kaneflex.multibody.tree import demand

REGULAR = 0.06
"""Least pivot of loops that are regular: less lets rounding through, more lets the interpolation's error through.
Measured at the change point of a four-bar of 1, 3, 2.5 and 4.5 m: energy is kept to 5e-11 with it, to 1.6e-9 with 0.08.
"""
_BESIDE = 3.0
"""Steps on either side of a change point in which reactions change too fast for the gradients of the factors' place."""
_FAR = 1.0
"""What counts as one in a coordinate: a motion farther than that says nothing of a change point."""
_STRAYED = 0.25
"""Of the fastest rate: a change of rates by closing the loops that leads onto another branch."""


@njit(**OPTIONS)
def begin(m, t, h):
    """Note whether a step is beside a change point; the share of it at which its factors are made, away from one."""
    w, shared = m.w, m.plan[CROSSING]
    away = w[shared + WHEN] - (t + 0.5 * h)
    m.pivots[PASSING] = abs(away) < _BESIDE * h + w[shared + REACH]
    return 0.4 if abs(away) < 0.05 * h else 0.5


@njit(**OPTIONS)
def project(m, t, i):
    """Beside a change point, let only independent coordinates ask for anything in stage i; False: singular."""
    apart()
    if m.pivots[PASSING] == 0:
        return True
    if crosses(m, t):
        reduce_across(m)
        return True
    bent(m)
    if not react(m):
        return False
    copy(m.w, m.plan[NOW], m.plan[STAGE_R] + m.plan[REACTIONS] * i, m.plan[REACTIONS])
    return True


@njit(**OPTIONS)
def react_at_end(m, t):
    """Close to a change point, take a step's last reactions from what its end asks for: True there."""
    apart()
    if not crosses(m, t):
        return False
    for r in range(m.plan[REACTIONS]):
        m.w[m.plan[NOW] + r] = 0.0
    demand(m, t)
    bent(m)
    react(m)
    return True


@njit(**OPTIONS)
def strays(m, table, h, here):
    """Whether closing the loops at a step's end has changed the dependent rates so far that it is another branch."""
    apart()
    plan, w, b = m.plan, m.w, table.b_1
    n, of, fastest = plan[COORDINATES], plan[STAGE_A], _fastest(m)
    for k in range(plan[KEPT]):
        i = plan[plan[DEPENDENT] + k]
        rate = here[1 + n + i] + h * (b[0] * w[of + i] + b[1] * w[of + n + i] + b[2] * w[of + 2 * n + i])
        moved = abs(w[plan[RATE] + i] - rate)
        if moved > _STRAYED * fastest * w[plan[MEASURE] + i] and h * moved > 100.0 * w[plan[SCALE] + i]:
            return True
    return False


@njit(**OPTIONS)
def _fastest(m):
    """Largest rate, by what counts as one in each coordinate [1/s]."""
    fastest = 0.0
    for i in range(m.plan[COORDINATES]):
        fastest = larger(fastest, abs(m.w[m.plan[RATE] + i]) / m.w[m.plan[MEASURE] + i])
    return fastest


@njit(**OPTIONS)
def end(m, t, h):
    """Where a step ends, see when the next change point comes, as the least pivot falls."""
    apart()
    w, shared = m.w, m.plan[CROSSING]
    before, now = w[shared + LEAST], 0.0 if crosses(m, t) else margin(m)
    w[shared + LEAST] = now
    if t - h < w[shared + WHEN] <= t:
        w[shared + PASSED] = w[shared + WHEN]
    elif 0.0 < now < before:
        ahead, reach = h * now / (before - now), REGULAR * h / (before - now)
        near = ahead < 2.0 * (_BESIDE * h + reach) and SIDES * reach * _fastest(m) < _FAR
        w[shared + WHEN] = t + ahead if near and determined(m) else -math.inf
        w[shared + REACH] = reach
