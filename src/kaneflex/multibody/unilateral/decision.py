"""Modes of unilateral and frictional rows at an instant: one search for contacts and frictions, impulses and forces.

A choice of modes is solved with the factors of the whole mechanism: closed rigid contacts and sticking frictions are
rows there, slipping frictions follow their normal forces. The choice is consistent if closed contacts push, open ones
separate, sticking frictions exert at most their limit, and slipping ones move on in their direction: for impulses and
the speeds after them, or for forces and accelerations, as DECIDES says. Else modes change: first those of all
inconsistent rows together, so that the order of rows decides nothing; then that of the least consistent row, later of
the first one (Murty 1974, Math. Program. 7, 326: without friction this ends), at last all combinations are tried.
Without a consistent choice, as in Painleve's paradox (1895, C. R. Acad. Sci. 121, 112), the run ends with that outcome.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.multibody.compile.stand_ins import if_frictions, if_impacts, if_modes
from kaneflex.multibody.compile.types import OPTIONS, larger, no_inline
from kaneflex.multibody.compile.values import width
from kaneflex.multibody.dynamics.loop_closure import factorise_now, rows_of_frictions
from kaneflex.multibody.dynamics.loop_factors import solve_closed
from kaneflex.multibody.model.codes import FORCES, NOTHING
from kaneflex.multibody.model.layout import (
    BEFORE, BENDING, BOUNCE, BREAKAWAY, CLOSED, COLUMNS, COORDINATES, DECIDES, DUE, FLOWING, FORCE, GAP_ACCEL, IN_A_ROW,
    KEPT, LIMIT, MAY, MODE, NODES, OPEN, PIVOTS, REACTION, RESISTING_MASS, ROUNDED, SLIP, SLIPPING, SLIP_RATE, STICKING,
    TOUCH, UNSURE, VIRTUAL, YIELDING,
)  # fmt: skip
from kaneflex.multibody.unilateral.chosen_motion import UNEVEN, negligible_force, solve_choice
from kaneflex.multibody.unilateral.factors import is_across_slip, prescribe_now, row_in
from kaneflex.multibody.unilateral.frictions import (
    CLOSE, WRONG, open_with_contact, set_mode, slip, stick, zero_acceleration, zero_friction, zero_speed,
)  # fmt: skip
from kaneflex.multibody.unilateral.rows import (
    LAW_AT, LUGRE, VISCOUS_LAW, across, at, contacts, frictions, in_impact, is_idle, is_second, law_at, magnitude,
    row_at, second_row, slip_sign,
)  # fmt: skip
from kaneflex.multibody.unilateral.step_rows import correct_drift

_SHORT, _ALIKE = 1e-6, 1e-9
"""Shares of the holding force: largest difference from it of the load of friction that is to slip, and between equal
loads."""
STILL, LET_GO = -1.0, -2.0
"""Values of DUE for friction without speed: its mode is to be found; sticking friction that is to slip."""
TURNED = 1e3
"""Speed, in multiples of :func:`zero_speed`, above which slip that ends along its direction continues in another
one."""
_EASED = 0.9
"""Share of its limit that sticking friction bears after it has been relieved, if others can bear more."""
_ALIGNED = 1e-10
"""Angle [rad] between the slip after an impact in space and the impulse against it."""
_TOGETHER = 2
"""Choices for each row in which modes change together."""
_DIRECTIONS = 20
"""Changes of a mode, or of its direction of slip, for each friction without speed in space."""
_MOST_CHOICES = 7776
"""Largest number of combinations tried: 2 of a contact and 3 of a friction, so those of five contacts with friction."""
_ASTRAY = 0.01
"""Weight of the motion of closed and sticking rows, in rounding errors: if there are more rows than freedoms, they
move, and their large forces mean nothing."""
_REFLECTED = 40
"""Iterations for the loads of redundant frictions."""
_NONE = -1000000
"""Index of no row."""


@if_frictions(0)
@njit(**OPTIONS)
def decide(m, t, A):
    """Find which frictions slip and which are stuck at the current state; 0, or 1 at a singular state, 2 without a
    consistent choice.

    Accelerations and reactions are those of that choice.
    """
    undecided = search(m, t, A) if begin(m, t, A) else 1
    for n in range(-frictions(m) if undecided == 0 else 0, 0):
        m.w[at(m, n) + DUE] = 0.0
    return undecided


@if_frictions(True)
@njit(**OPTIONS)
def begin(m, t, A):
    """Modes of frictions with a speed, and the first ones of those without; False: singular."""
    no_inline()
    for _ in range(2):
        # A friction that sticks may stop others, as in a mechanism with one degree of freedom.
        rows_of_frictions(m)
        free = 0
        for n in range(-frictions(m), 0):
            free += _first_mode(m, n, t)
        if free and not correct_drift(m, t, A, 1):
            return False
    return True


@njit(**OPTIONS)
def _is_free(m, n):
    """True if the mode of a row is to be found."""
    if n >= 0 or in_impact(m):
        return m.pivots[DECIDES] != NOTHING and m.w[at(m, n) + MAY] != 0.0 and not is_second(m, n)
    return m.w[at(m, n) + DUE] < 0.0


@if_modes(0)
@njit(**OPTIONS)
def search(m, t, A):
    """Find the modes of all rows that are free; returns as :func:`decide`."""
    no_inline()
    free, choices = 0, 1
    for n in range(-frictions(m), contacts(m)):
        if _is_free(m, n):
            free, choices = free + 1, choices * (3 if n < 0 else 2) if choices <= _MOST_CHOICES else choices
    if free and not in_impact(m) and _share_load(m, t, A) == 1:
        return 1
    patience = (_DIRECTIONS if width(m) == 6 else 4) * (free + 1)
    for turn in range(2 * patience):
        settled = _relieve(m, t, A)
        if settled == 1:
            return 1
        n = _least_consistent(m, t, turn >= patience)
        if n == _NONE:
            if settled == 0 or m.pivots[DECIDES] == FORCES:  # of moving sides they are only an estimate
                return 0
            break
        if not _change(m, t, A, _NONE if turn < _TOGETHER * free else n):
            return 1
    for choice in range(choices if choices <= _MOST_CHOICES else 0):
        left = choice
        for n in range(-frictions(m), contacts(m)):
            if _is_free(m, n):
                left = _choose(m, n, left)
        settled = solve_choice(m, t, A)
        if settled == 1:
            return 1
        if settled == 0 and _least_consistent(m, t, True) == _NONE:
            return 0
    return 2


@njit(**OPTIONS)
def _choose(m, n, left):
    """Set the mode of a row from the number of a combination; returns the number left for the other rows."""
    if n >= 0:
        m.w[at(m, n) + MODE] = CLOSED if left % 2 == 0 else OPEN
        return left // 2
    stick(m, n)
    if left % 3 != 0:
        slip(m, n, 1.5 - left % 3, 0.0)
    return left // 3


@njit(**OPTIONS)
def _change(m, t, A, only):
    """Change the modes of all inconsistent rows together, or of ``only`` one, or turn slips in tangent planes; False:
    singular."""
    no_inline()
    w, rate, turning = m.w, SLIP_RATE - in_impact(m), False
    for n in range(-frictions(m), contacts(m)):
        k = at(m, n)
        w[k + BEFORE] = n == only or (only == _NONE and _inconsistency(m, n, t, False) > 1.0)
        if w[k + BEFORE] != 0.0 and n < 0 and second_row(m, n) and w[k + MODE] == SLIPPING and w[k + rate] > 0.0:
            w[k + BEFORE], turning = 0.0, True
    if turning and not _turn_all(m, A):
        return False
    for n in range(-frictions(m), contacts(m)):
        k = at(m, n)
        if w[k + BEFORE] == 0.0:
            continue
        if n >= 0:
            w[k + MODE] = CLOSED if w[k + MODE] == OPEN else OPEN
        elif w[k + MODE] == STICKING:
            slip(m, n, -w[k + FORCE], -across(m, n, FORCE))
        else:
            stick(m, n)
    return True


@njit(**OPTIONS)
def _is_turning(m, n):
    """True for slip in a tangent plane whose direction is to be found."""
    return second_row(m, n) != 0 and m.w[at(m, n) + MODE] == SLIPPING and _is_free(m, n)


@njit(**OPTIONS)
def _turn_all(m, A):
    """Turn all frictions that slip in tangent planes to where they move (Newton's method); False: singular.

    Turned one after the other they converge slowly where they slip at a small share of the speeds before. In this step
    the row across a slip is viscous: its force is the same share of the limit as its speed is of the slip's.
    """
    no_inline()
    w, answer = m.w, m.plan[COLUMNS] + m.plan[COORDINATES] * m.plan[KEPT]
    for n in range(-frictions(m), 0):
        if _is_turning(m, n) and w[at(m, n) + LIMIT] > negligible_force(m, n):
            w[at(m, second_row(m, n)) + MODE] = STICKING
    if not factorise_now(m, A):
        return False
    for i in range(m.plan[COORDINATES]):
        A[answer + i] = 0.0
    prescribe_now(m, A)
    solve_closed(m, A, m.plan[PIVOTS])
    for r in range(m.plan[KEPT] + m.plan[VIRTUAL], m.plan[KEPT] + m.pivots[YIELDING]):
        if is_across_slip(m, row_in(m, r)):
            w[at(m, row_in(m, r)) + FORCE] = A[m.plan[REACTION] + r]
    for n in range(-frictions(m), 0):
        if _is_turning(m, n):
            slip(m, n, -w[at(m, n) + FORCE], -across(m, n, FORCE))
    return True


@njit(**OPTIONS)
def _first_mode(m, n, t):
    """First choice for a friction; 1 if it has no speed and other choices are possible: DUE is below zero then."""
    w, k, law = m.w, at(m, n), m.w[law_at(m, n) + LAW_AT]
    shifts, before, v, none = w[k + DUE] > 0.0, w[k + MODE], magnitude(m, n, SLIP), zero_speed(m, n, t)
    if w[k + DUE] < 0.0:
        return 1
    if is_second(m, n) or open_with_contact(m, n):
        return 0
    if law >= VISCOUS_LAW:
        set_mode(m, n, BENDING if law == LUGRE else FLOWING)
        return 0
    if before != STICKING and v > (none if not shifts else TURNED * none if second_row(m, n) else math.inf):
        w[k + DUE] = 0.0
        slip(m, n, w[k + SLIP], across(m, n, SLIP))
        return 0
    w[k + DUE] = STILL
    if before == STICKING:
        if shifts:
            w[k + DUE], w[k + BREAKAWAY] = LET_GO, magnitude(m, n, FORCE)
    elif shifts or before == OPEN or w[m.plan[TOUCH] + IN_A_ROW] == 0.0:
        stick(m, n)  # else it was released just before others
    return 1


@if_frictions(0)
@njit(**OPTIONS)
def _share_load(m, t, A):
    """Distribute loads again among sticking frictions, and let those slip that are due, with equally loaded ones.

    Among several frictions of one body, as its feet, one at its limit needn't slip if others can bear more. Returns as
    :func:`solve_choice`.
    """
    no_inline()
    w, level = m.w, 0.0
    for n in range(-frictions(m), 0):
        if w[at(m, n) + MODE] == STICKING:
            m.multipliers[row_at(m, n)] = 0.0
    settled = _relieve(m, t, A)
    for turn in range(2):
        for n in range(-frictions(m), 0):
            k = at(m, n)
            share = _load(m, n)
            if w[k + DUE] >= 0.0 or w[k + MODE] != STICKING:
                continue
            lets = w[k + DUE] == LET_GO and magnitude(m, n, FORCE) >= (1.0 - _SHORT) * w[k + BREAKAWAY]
            if turn == 0 and lets:
                level = larger(level, share)
            elif lets or (level > 1.0 - _SHORT and share >= level - _ALIKE):
                force = w[k + FORCE]
                if abs(force) <= zero_friction(m, n):
                    force = w[k + NODES + 5]  # at the first node of the step that exceeds the limit
                slip(m, n, -force, -across(m, n, FORCE))
    return settled


@njit(**OPTIONS)
def _relieve(m, t, A):
    """Settle, and in space shift loads from sticking frictions beyond their limits to others, as far as they are
    redundant.

    The forces beyond a share of their limits are reflected at it, then those that hold the mechanism are found again.
    Returns as :func:`solve_choice`.
    """
    no_inline()
    before, settled = 0.0, solve_choice(m, t, A)
    for turn in range(_REFLECTED if width(m) == 6 else 0):
        worst = 0.0
        for n in range(-frictions(m), 0):
            worst = larger(worst, _load(m, n))
        if worst <= (_EASED if turn else 1.0 - _SHORT) or (turn == 1 and worst > 0.999 * before):
            break
        for n in range(-frictions(m), 0):
            if _load(m, n) > _EASED:
                share, other = 2.0 * _EASED / _load(m, n) - 1.0, second_row(m, n)
                m.multipliers[row_at(m, n)] *= share
                if other:
                    m.multipliers[row_at(m, other)] *= share
        before, settled = worst, solve_choice(m, t, A)
    return settled


@njit(**OPTIONS)
def _load(m, n):
    """Force of sticking friction without speed, as a share of its limit; 0 for other frictions."""
    k = at(m, n)
    if m.w[k + MODE] != STICKING or m.w[k + DUE] >= 0.0:
        return 0.0
    return magnitude(m, n, FORCE) / (m.w[k + LIMIT] + zero_friction(m, n))


@njit(**OPTIONS)
def _least_consistent(m, t, first):
    """Row with the largest inconsistency of its mode among the free ones, or the ``first`` one; _NONE if all are
    consistent."""
    no_inline()
    worst, found = 1.0, _NONE
    for n in range(-frictions(m), contacts(m)):
        off = _inconsistency(m, n, t, first)
        if off > worst:
            if first:
                return n
            worst, found = off, n
    return found


@njit(**OPTIONS)
def _inconsistency(m, n, t, late):
    """Inconsistency of a row's mode, in rounding errors; 0 for modes that are known or have no effect."""
    if not _is_free(m, n) or (n < 0 and is_idle(m, n)):
        return 0.0
    return _contact_inconsistency(m, n) if n >= 0 else _friction_inconsistency(m, n, t, late)


@if_impacts(0.0)
@njit(**OPTIONS)
def _contact_inconsistency(m, n):
    """Pull of a closed rigid contact, or approach of an open one, in rounding errors."""
    w, k = m.w, at(m, n)
    size = w[k + ROUNDED] if in_impact(m) else w[k + UNSURE]
    aim = w[k + BOUNCE] if in_impact(m) else 0.0
    closer = (aim - w[k + GAP_ACCEL - in_impact(m)]) / (10.0 * size + 1e-300)
    if w[k + MODE] == OPEN:
        return closer
    return larger(-w[k + FORCE] / (10.0 * size * w[k + RESISTING_MASS] + 1e-300), _ASTRAY * abs(closer))


@if_frictions(0.0)
@njit(**OPTIONS)
def _friction_inconsistency(m, n, t, late):
    """Force of a sticking friction beyond its limit, or motion of a slipping one against its direction, in rounding
    errors."""
    w, k, rate = m.w, at(m, n), SLIP_RATE - in_impact(m)
    unsure = _SHORT / WRONG if w[k + DUE] == LET_GO else 1.0  # as its load
    none = w[k + ROUNDED] + zero_speed(m, n, t) if in_impact(m) else unsure * zero_acceleration(m, n)
    none += w[k + UNSURE] if m.pivots[DECIDES] == FORCES else 0.0
    if w[k + MODE] != STICKING:
        if second_row(m, n):
            aside = larger(abs(across(m, n, rate)) - _ALIGNED * abs(w[k + rate]), -w[k + rate])
            negligible = magnitude(m, n, rate) <= UNEVEN * none or w[k + LIMIT] <= negligible_force(m, n)
            return 0.0 if negligible else aside / (UNEVEN * none if late else none)
        return (abs(across(m, n, rate)) - slip_sign(m, n) * w[k + rate]) / none
    off = (magnitude(m, n, FORCE) - w[k + LIMIT]) / (CLOSE * w[k + LIMIT] + negligible_force(m, n))
    return larger(off, _ASTRAY * magnitude(m, n, rate) / none if m.pivots[DECIDES] != NOTHING else 0.0)
