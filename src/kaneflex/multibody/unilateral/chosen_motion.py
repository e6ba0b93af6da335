"""Motion by a choice of modes at an instant: accelerations and forces, or speeds after impulses and these.

Closed rigid contacts and sticking frictions are rows of the mechanism's factors, slipping frictions follow their normal
forces. Normal forces of joints depend on the reactions, so solutions are repeated until both agree.
"""

from __future__ import annotations

from numba import njit

from kaneflex.multibody.compile.stand_ins import if_impacts, if_modes
from kaneflex.multibody.compile.types import OPTIONS, larger, no_inline, shifted
from kaneflex.multibody.compile.values import copy
from kaneflex.multibody.dynamics.courses import courses
from kaneflex.multibody.dynamics.loop_closure import correct_accelerations, factorise_now, follow, rows_of_frictions
from kaneflex.multibody.dynamics.loop_factors import solve_closed
from kaneflex.multibody.model.codes import FORCES, NOTHING
from kaneflex.multibody.model.layout import (
    BEFORE, COLUMNS, COORDINATES, COURSE, COURSE_AT, CUT_OF, DECIDES, FORCE, FREED, KEPT, LAST_A, LIMIT, LOADS, MAY,
    MODE_BEFORE, OLD, PIVOTS, POWER, PRESCRIBED, REACTION, REACTIONS, RESISTING_MASS, ROUNDED, ROW_OF, SLIP, SPRINGS,
    STICKING, UNSURE, WORKS, YIELDING,
)  # fmt: skip
from kaneflex.multibody.unilateral.factors import prescribe_now, reaction_of
from kaneflex.multibody.unilateral.frictions import apply_friction, zero_friction
from kaneflex.multibody.unilateral.rows import (
    at, contacts, frictions, in_impact, is_second, magnitude, row_at, second_row,
)  # fmt: skip

_SETTLED = 40
"""Iterations for reactions and their friction to converge."""
UNEVEN = 1e3
"""Tolerances, in rounding errors: of changes of forces beside those of stiff bodies, and of slip in space after
impulses that are redundant."""
_REFINED = 5
"""Solutions for impulses: sticking rows have a small compliance, whose effect the later ones remove."""


@if_modes(0)
@njit(**OPTIONS)
def solve_choice(m, t, A):
    """Iterate impulses or accelerations and reactions of a choice, with friction by reactions; 0, or 1 at a singular
    state, 2 without convergence."""
    no_inline()
    w = m.w
    for n in range(-frictions(m), contacts(m) if m.pivots[DECIDES] != NOTHING else -frictions(m)):
        m.multipliers[row_at(m, n)] = 0.0  # else redundant rows keep forces that other choices have left
    for turn in range(_SETTLED):
        if not (_speeds_after(m, t, A) if in_impact(m) else correct_accelerations(m, t, A, 1)):
            return 1
        if m.pivots[DECIDES] != NOTHING:
            rows_of_frictions(m)
        for n in range(-frictions(m), 0):
            w[at(m, n) + BEFORE] = _force_size(m, n)
        apply_friction(m)
        moved = 0.0
        for n in range(-frictions(m), 0):
            k = at(m, n)
            allowed = 1e-12 * (w[k + LIMIT] + abs(w[k + FORCE])) + negligible_force(m, n)
            moved = larger(moved, abs(_force_size(m, n) - w[k + BEFORE]) / allowed)
        if turn > 0 and not moved > (1.0 if 2 * turn < _SETTLED else UNEVEN):
            return 0
    return 2


@if_impacts(True)
@njit(**OPTIONS)
def _speeds_after(m, t, A):
    """Speeds after impulses by a choice of modes, from those at LAST_A: impulses are at NOW, works of prescribed drives
    at POWER; False: singular."""
    no_inline()
    plan, w, n = m.plan, m.w, m.plan[COORDINATES]
    answer = plan[COLUMNS] + plan[KEPT] * n
    copy(shifted(w, plan[LAST_A]), m.u, n)
    if not follow(m, t) or not factorise_now(m, A):
        return False
    for k in range(-frictions(m), 0):  # along the rows as they are turned now
        w[at(m, k) + OLD] = 0.0 if w[at(m, k) + MODE_BEFORE] == STICKING else w[at(m, k) + SLIP]
    for r in range(plan[REACTIONS]):
        m.multipliers[r] = 0.0
    for k in range(plan[WORKS]):
        w[plan[POWER] + k] = 0.0
    for _ in range(_REFINED):
        for k in range(n):
            A[answer + k] = 0.0
        prescribe_now(m, A)
        solve_closed(m, A, plan[PIVOTS])
        _add_impulses(m, A, answer)
        if not follow(m, t):
            return False
        rows_of_frictions(m)
    return True


@njit(**OPTIONS)
def _add_impulses(m, A, answer):
    """Add the response to impulses to all rates, and the impulses to the reactions; works of prescribed drives."""
    no_inline()
    plan, w = m.plan, m.w
    drives = plan[POWER] + 1 + plan[SPRINGS] - plan[LOADS]
    for course in range(courses(m)):
        k = plan[plan[PRESCRIBED] + course]
        if k >= 0:
            w[drives + course] += A[answer + k] * w[plan[COURSE] + 3 * course + 1]
    for k in range(plan[COORDINATES]):
        if plan[plan[FREED] + k] != 0:
            m.u[k] += A[answer + k]
    for r in range(plan[KEPT] + m.pivots[YIELDING]):
        row = reaction_of(m, r)
        if row >= 0:
            m.multipliers[row] += A[plan[REACTION] + r]
        course = m.acts[plan[plan[CUT_OF] + plan[plan[ROW_OF] + r]], COURSE_AT] if r < plan[KEPT] else -1
        if course >= 0:
            w[drives + course] += A[plan[REACTION] + r] * w[plan[COURSE] + 3 * course + 1]


@njit(**OPTIONS)
def negligible_force(m, n):
    """Force, or impulse, of a friction that counts as zero."""
    w, k, decides = m.w, at(m, n), m.pivots[DECIDES]
    if in_impact(m):
        return w[k + ROUNDED] * w[k + RESISTING_MASS] + 1e-300
    noise = w[k + UNSURE] * w[k + RESISTING_MASS] if decides == FORCES and w[k + MAY] != 0.0 else 0.0
    return zero_friction(m, n) + noise


@njit(**OPTIONS)
def _force_size(m, n):
    """Force of a friction; with two rows the size of both, as one alone may be rounding where the mechanism can't
    move."""
    if is_second(m, n):
        return 0.0
    return magnitude(m, n, FORCE) if second_row(m, n) else m.w[at(m, n) + FORCE]
