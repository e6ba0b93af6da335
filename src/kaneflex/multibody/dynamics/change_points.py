"""Compiled treatment of change points: positions with all bars of a loop on one line, where branches of its motion
cross.

There the cut joints' rows lose rank, and reactions have a pole. At a small distance d, a rounding error of a loop
becomes 1/d in positions, 1/d^2 in rates and 1/d^3 in accelerations. The motion that keeps its velocities is smooth if a
single coordinate moves each loop, and so are the derivatives of dependent coordinates, which need no reactions: see
:func:`kaneflex.multibody.dynamics.loop_closure.is_near_change_point`. Elastic bodies pass such positions bent and don't
need this.
The next change point is predicted from the least pivot of the rows
(:func:`kaneflex.multibody.dynamics.loop_condition.margin`), which is proportional to d.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.multibody.compile.types import OPTIONS, larger, no_inline, shifted
from kaneflex.multibody.compile.values import copy
from kaneflex.multibody.dynamics.inverse_dynamics import demand
from kaneflex.multibody.dynamics.loop_closure import SIDES, is_near_change_point, reduce_across
from kaneflex.multibody.dynamics.loop_condition import determined, margin
from kaneflex.multibody.dynamics.reduction import update_reactions
from kaneflex.multibody.model.layout import (
    COORDINATES,
    CROSSING,
    DEPENDENT,
    KEPT,
    LEAST,
    MEASURE,
    PASSING,
    REACH,
    REACTIONS,
    SCALE,
    STAGE_A,
    STAGE_R,
    WHEN,
)

REGULAR = 0.06
"""Least pivot of regular loops: less admits rounding errors, more admits interpolation errors. Measured at the change
point of a four-bar of 1, 3, 2.5 and 4.5 m: the energy error is 5e-11 with it, 1.6e-9 with 0.08."""
_BESIDE = 3.0
"""Steps on either side of a change point in which reactions change too fast for the factors' gradients."""
_FAR = 1.0
"""Unit of a coordinate: motions beyond it don't predict a change point."""
_STRAYED = 0.25
"""Change of rates by closing the loops, as a share of the fastest rate, that indicates another branch."""


@njit(**OPTIONS)
def begin(m, t, h):
    """Note whether a step is near a change point; returns the share of it at which its factors are made, away from
    one."""
    w, shared = m.w, m.plan[CROSSING]
    away = w[shared + WHEN] - (t + 0.5 * h)
    m.pivots[PASSING] = abs(away) < _BESIDE * h + w[shared + REACH]
    return 0.4 if abs(away) < 0.05 * h else 0.5


@njit(**OPTIONS)
def project(m, t, i):
    """Near a change point, reduce stage i to the independent coordinates; False: singular."""
    no_inline()
    if m.pivots[PASSING] == 0:
        return True
    if is_near_change_point(m, t):
        reduce_across(m)
        return True
    if not update_reactions(m):
        return False
    copy(m.multipliers, shifted(m.w, m.plan[STAGE_R] + m.plan[REACTIONS] * i), m.plan[REACTIONS])
    return True


@njit(**OPTIONS)
def react_at_end(m, t):
    """Near a change point, compute a step's last reactions from its end; True there."""
    no_inline()
    if not is_near_change_point(m, t):
        return False
    for r in range(m.plan[REACTIONS]):
        m.multipliers[r] = 0.0
    demand(m, t)
    update_reactions(m)
    return True


@njit(**OPTIONS)
def leaves_branch(m, table, h, state):
    """True if closing the loops at a step's end changes the dependent rates as much as another branch would."""
    no_inline()
    plan, w, b = m.plan, m.w, table.b_1
    n, of, most = plan[COORDINATES], plan[STAGE_A], fastest(m, -1)
    for k in range(plan[KEPT]):
        i = plan[plan[DEPENDENT] + k]
        rate = state[1 + n + i] + h * (b[0] * w[of + i] + b[1] * w[of + n + i] + b[2] * w[of + 2 * n + i])
        moved = abs(m.u[i] - rate)
        if moved > _STRAYED * most * w[plan[MEASURE] + i] and h * moved > 100.0 * w[plan[SCALE] + i]:
            return True
    return False


@njit(**OPTIONS)
def fastest(m, row):
    """Largest rate in units of each coordinate [1/s], of coordinates that move a kept row, or of all if it is -1."""
    plan, w, most = m.plan, m.w, 0.0
    for i in range(plan[COORDINATES]):
        if row < 0 or m.J[plan[COORDINATES] * row + i] != 0.0:
            most = larger(most, abs(m.u[i]) / w[plan[MEASURE] + i])
    return most


@njit(**OPTIONS)
def end(m, t, h):
    """Predict the next change point at a step's end, from the decrease of the least pivot."""
    no_inline()
    w, shared = m.w, m.plan[CROSSING]
    before, now, row = w[shared + LEAST], 0.0, 0
    if not is_near_change_point(m, t):
        now, row = margin(m)
    w[shared + LEAST] = now
    if not t - h < w[shared + WHEN] <= t and 0.0 < now < before:
        ahead, reach = h * now / (before - now), REGULAR * h / (before - now)
        near = ahead < 2.0 * (_BESIDE * h + reach) and SIDES * reach * fastest(m, row) < _FAR
        w[shared + WHEN] = t + ahead if near and determined(m) else -math.inf
        w[shared + REACH] = reach
