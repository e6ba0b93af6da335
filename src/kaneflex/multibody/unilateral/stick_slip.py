"""Decision between slip and stick of frictions at an instant, and what is monitored of them over a step.

The speed of slipping friction is monitored like an open contact's gap: its zero ends the step. For sticking friction,
the reserve of its force is monitored; its zero ends the step, too. At such an instant :func:`decide` finds a consistent
choice of modes for all frictions without speed: a sticking one exerts at most its limit, a slipping one accelerates in
its direction of slip. Without a consistent choice, as in Painleve's paradox (1895, C. R. Acad. Sci. 121, 112), the run
ends with that outcome.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.multibody.compile.stand_ins import of_holds
from kaneflex.multibody.compile.values import width
from kaneflex.multibody.dynamics.algebra import absolute, linear_size
from kaneflex.multibody.dynamics.loop_closure import mend, rows_of_frictions
from kaneflex.multibody.compile.types import OPTIONS, apart, basis, larger, shifted
from kaneflex.multibody.model.layout import (
    ACROSS, BEFORE, BENDING, BODIES, BORE, COORDINATES, DUE, EXTENT, FIRMEST, FLOWING, FORCE, IN_A_ROW, LIMIT,
    MEMORY, MODE, NODES, NORMAL, OPEN, SLIP, SLIPPING, SLIP_RATE, STICKING, TOUCH, TURN, WHAT,
)  # fmt: skip
from kaneflex.multibody.model.tree_layout import BODY
from kaneflex.multibody.unilateral import lugre
from kaneflex.multibody.unilateral.frictions import exert, set_mode, size_of, slip, stick
from kaneflex.multibody.unilateral.relative_rows import extent
from kaneflex.multibody.unilateral.step_rows import along, correct_drift, respond
from kaneflex.multibody.unilateral.rows import (
    EPS, LAW_AT, LUGRE, SLOWEST, VISCOUS_LAW, across, act_of, at, frictions, law_at, magnitude, on_contact, product,
    row_at, second, way,
)  # fmt: skip

_CLOSE = 1e-11
"""Share of the largest holding force within which it counts as reached."""
_WRONG = 1e-9
"""Share of neighbouring accelerations above which one against the slip is not rounding."""
_SHORT, _ALIKE = 1e-6, 1e-9
"""Tolerances, as shares of the holding force, of the load of sticking friction that is to slip, and of equal loads."""
STILL, LET_GO = -1.0, -2.0
"""Values of DUE for friction without speed: its mode is to be found; sticking friction that is to slip."""
_TURNED = 1e3
"""Speed, in those that count as zero, above which slip that ends along its direction goes on in another one."""
_IMMOBILE = 1e-13
"""Response of a row, as a share of that of the other one in its tangent plane, that is rounding."""
_EASED = 0.9
"""Share of its limit that sticking friction bears after it has been relieved, if others can bear more."""
_DIRECTIONS = 50
"""Changes of a mode, or of its direction of slip, for each friction without speed in space."""
_CANDIDATES = 6
"""Largest number of frictions without speed of which all combinations are tried."""
_SETTLED = 40
"""Iterations for reactions and their friction to converge."""


@of_holds(None)
@njit(**OPTIONS)
def store_node(m, t, i):
    """Store what is monitored of all frictions, with its rate and tolerance, at node i of the step."""
    apart()
    w = m.w
    for n in range(-frictions(m), 0):
        k = at(m, n)
        j, mode = k + NODES + 4 * i, w[k + MODE]
        if mode == BENDING:
            w[j], w[j + 1] = w[k + SLIP], lugre.resisted(w, law_at(m, n), w[k + NORMAL], w[k + SLIP])
        elif mode == STICKING:
            bears = magnitude(m, n, FORCE) if m.acts[act_of(m, n), WHAT] != ACROSS else -1.0  # with its first row
            w[j], w[j + 1] = w[k + LIMIT] - bears, w[k + FORCE]
            w[j + 2], w[j + 3] = _CLOSE * w[k + LIMIT] + no_force(m, n), w[j]
        elif mode == SLIPPING:
            w[j], w[j + 1] = slowing(m, n)
            w[j + 2] = no_speed(m, n, t)


@of_holds(None)
@njit(**OPTIONS)
def extrapolate_to_end(m, table, last):
    """Extrapolate the forces of sticking frictions from the stages to the end of a step that isn't a stage."""
    apart()
    w = m.w
    for n in range(-frictions(m) if table.ends[0] == 0.0 else 0, 0):
        j, total = at(m, n) + NODES, 0.0
        if w[at(m, n) + MODE] == STICKING:
            for i in range(3):
                total += w[j + 4 * (i + 1)] * basis(table.nodes, 1.0, i)
            w[j + 4 * last] = w[j + 4 * last + 3] = total


@njit(**OPTIONS)
def slowing(m, n):
    """Speed of slipping friction and its rate; with two rows less that of the second: turns by 45 deg end a step."""
    w, k, beside = m.w, at(m, n), across(m, n, SLIP)
    turns = across(m, n, SLIP_RATE) * (1.0 if beside >= 0.0 else -1.0)
    return way(m, n) * w[k + SLIP] - abs(beside), way(m, n) * w[k + SLIP_RATE] - turns


@njit(**OPTIONS)
def no_speed(m, n, t):
    """Speed of a friction that counts as zero."""
    w, k = m.w, at(m, n)
    return SLOWEST * extent(m, n) + 8.0 * EPS * (size_of(m, n, 0) + abs(t * w[k + SLIP_RATE])) + 1e-300


@njit(**OPTIONS)
def _weight(m):
    """Sum of the sizes of gravity's components."""
    g = absolute(m.gravity[0])
    return g[0] + g[1] + g[2]


@njit(**OPTIONS)
def no_force(m, n):
    """Force, or moment, of a friction that counts as zero: rounding error of the force that moves all bodies."""
    apart()
    plan, w, total = m.plan, m.w, 0.0
    for b in range(plan[BODIES]):
        node = m.frames[b, 0]
        if m.nodes[node, BODY] >= 0:
            total += m.block[m.nodes[node, BODY]] * (_weight(m) + linear_size(m.rate[node]))
    return 1e-14 * total * (w[plan[TOUCH] + EXTENT] if m.acts[act_of(m, n), WHAT] == TURN else 1.0) + 1e-300


@njit(**OPTIONS)
def no_rate(m, n):
    """Acceleration of a friction that counts as zero."""
    return _WRONG * (size_of(m, n, 1) + _weight(m)) + 1e-300


@of_holds(0)
@njit(**OPTIONS)
def decide(m, t, A):
    """Find which frictions slip and which are stuck at the current state; 0, or 1 at a singular state, 2 without a
    consistent choice.

    Accelerations and reactions are those of that choice.
    """
    apart()
    w, free = m.w, 0
    for _ in range(2):
        # A friction that sticks may stop others, as in a mechanism with one degree of freedom.
        rows_of_frictions(m)
        free = 0
        for n in range(-frictions(m), 0):
            free += _first_mode(m, n, t)
        if free and not correct_drift(m, t, A, 1):
            return 1
    if free and _share(m, t, A) == 1:
        return 1
    for _ in range((_DIRECTIONS if width(m) == 6 else 4) * (free + 1)):
        settled = _relieve(m, t, A)
        if settled == 1:
            return 1
        n = _least_consistent(m)
        if n == 0:
            if settled == 0:
                return _end_decision(m)
            break
        if second(m, n):
            if not _stick_or_slip(m, n, t, A):
                return 1
        elif w[at(m, n) + MODE] == STICKING:
            slip(m, n, -w[at(m, n) + FORCE], 0.0)
        else:
            stick(m, n)
    if free > _CANDIDATES:
        return 2
    choices = 1
    for _ in range(free):
        choices *= 3
    for choice in range(choices):
        left = choice
        for n in range(-frictions(m), 0):
            if w[at(m, n) + DUE] < 0.0:
                stick(m, n)
                if left % 3 != 0:
                    slip(m, n, 1.5 - left % 3, 0.0)
                left = left // 3
        settled = settle(m, t, A)
        if settled == 1:
            return 1
        if settled == 0 and _least_consistent(m) == 0:
            return _end_decision(m)
    return 2


@njit(**OPTIONS)
def _stick_or_slip(m, n, t, A):
    """Let a friction in a tangent plane stick, or slip in the direction in which it then accelerates; False: singular.

    With the response W of its rows and the force f, a vector of the size of the limit, the acceleration a + W f is
    -s f, s >= 0: the size of f = -(W + s)^-1 a falls with s. If f without s is within the limit, it sticks.
    """
    apart()
    k, other, size = at(m, n), second(m, n), m.plan[COORDINATES]
    w, limit, s = m.w, m.w[k + LIMIT], 0.0
    if w[k + MODE] == STICKING:
        slip(m, n, -w[k + FORCE], -across(m, n, FORCE))
    if not mend(m, t, A, 1):
        return False
    exert(m)
    one, f, g = shifted(A, respond(m, n, A)), w[k + FORCE], w[at(m, other) + FORCE]
    w_11, w_12 = product(w, along(m, n), one, size), product(w, along(m, other), one, size)
    w_22 = product(w, along(m, other), shifted(A, respond(m, other, A)), size)
    a, b = w[k + SLIP_RATE] - w_11 * f - w_12 * g, w[at(m, other) + SLIP_RATE] - w_12 * f - w_22 * g
    s = least = _IMMOBILE * (w_11 + w_22) + 1e-300
    for _ in range(_SETTLED):
        determinant = (w_11 + s) * (w_22 + s) - w_12 * w_12
        f, g = (w_12 * b - (w_22 + s) * a) / determinant, (w_12 * a - (w_11 + s) * b) / determinant
        force = math.hypot(f, g)
        if not force > (1.0 + _CLOSE) * limit + no_force(m, n):
            break
        # Newton's method for the inverse of its size
        slope = ((w_22 + s) * f * f - 2.0 * w_12 * f * g + (w_11 + s) * g * g) / determinant
        s += (force / larger(limit, _SHORT * force) - 1.0) * force * force / slope
    if s == least:
        stick(m, n)
    else:
        slip(m, n, -f, -g)
    return True


@njit(**OPTIONS)
def opens(m, n):
    """True if a friction belongs to an open contact, which exerts no force; its bristles relax."""
    w, k, of = m.w, at(m, n), on_contact(m, n)
    if of < 0 or w[at(m, of) + MODE] != OPEN:
        return False
    set_mode(m, n, OPEN)
    w[k + MEMORY], w[k + FIRMEST] = 0.0, 0.0
    return True


@njit(**OPTIONS)
def _first_mode(m, n, t):
    """First choice for a friction; 1 if it has no speed and other choices are possible: DUE is below zero then."""
    w, k, law = m.w, at(m, n), m.w[law_at(m, n) + LAW_AT]
    shifts, before, v, none = w[k + DUE] > 0.0, w[k + MODE], magnitude(m, n, SLIP), no_speed(m, n, t)
    if w[k + DUE] < 0.0:
        return 1
    if m.acts[act_of(m, n), WHAT] == ACROSS or opens(m, n):
        return 0
    if law >= VISCOUS_LAW:
        set_mode(m, n, BENDING if law == LUGRE else FLOWING)
        return 0
    if before != STICKING and v > (none if not shifts else _TURNED * none if second(m, n) else math.inf):
        w[k + DUE] = 0.0
        slip(m, n, w[k + SLIP], across(m, n, SLIP))
        return 0
    w[k + DUE] = STILL
    if before == STICKING:
        if shifts:
            w[k + DUE], w[k + BORE] = LET_GO, magnitude(m, n, FORCE)
    elif shifts or before == OPEN or w[m.plan[TOUCH] + IN_A_ROW] == 0.0:
        stick(m, n)  # else it was released just before others
    return 1


@njit(**OPTIONS)
def _share(m, t, A):
    """Distribute loads again among sticking frictions, and let those slip that are due, with equally loaded ones.

    Among several frictions of one body, as its feet, one at its limit needn't slip if others can bear more. Returns as
    :func:`settle`.
    """
    apart()
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
            lets = w[k + DUE] == LET_GO and magnitude(m, n, FORCE) >= (1.0 - _SHORT) * w[k + BORE]
            if turn == 0 and lets:
                level = larger(level, share)
            elif lets or (level > 1.0 - _SHORT and share >= level - _ALIKE):
                slip(m, n, _slip_direction(m, n), -across(m, n, FORCE))
    return settled


@njit(**OPTIONS)
def _relieve(m, t, A):
    """Settle, and in space shift loads from sticking frictions beyond their limits to others, as far as they are
    redundant.

    The forces beyond a share of their limits are reflected at it, then those that hold the mechanism are found again.
    Returns as :func:`settle`.
    """
    apart()
    before, settled = 0.0, settle(m, t, A)
    for turn in range(_SETTLED if width(m) == 6 else 0):
        worst = 0.0
        for n in range(-frictions(m), 0):
            worst = larger(worst, _load(m, n))
        if worst <= (_EASED if turn else 1.0 - _SHORT) or (turn == 1 and worst > 0.999 * before):
            break
        for n in range(-frictions(m), 0):
            if _load(m, n) > _EASED:
                share, other = 2.0 * _EASED / _load(m, n) - 1.0, second(m, n)
                m.multipliers[row_at(m, n)] *= share
                if other:
                    m.multipliers[row_at(m, other)] *= share
        before, settled = worst, settle(m, t, A)
    return settled


@njit(**OPTIONS)
def _load(m, n):
    """Force of sticking friction without speed, as a share of its limit; 0 of other frictions."""
    k = at(m, n)
    if m.w[k + MODE] != STICKING or m.w[k + DUE] >= 0.0:
        return 0.0
    return magnitude(m, n, FORCE) / (m.w[k + LIMIT] + no_force(m, n))


@njit(**OPTIONS)
def _slip_direction(m, n):
    """Direction of slip of a sticking friction: opposite to its force, or if that is zero, to its force at the first
    node of the step that exceeds the limit."""
    w, k = m.w, at(m, n)
    return -w[k + FORCE] if abs(w[k + FORCE]) > no_force(m, n) else -w[k + NODES + 5]


@of_holds(0)
@njit(**OPTIONS)
def settle(m, t, A):
    """Iterate accelerations and reactions of a choice with friction by reactions; 0, or 1 at a singular state, 2
    without convergence."""
    apart()
    w = m.w
    for turn in range(_SETTLED):
        if not mend(m, t, A, 1):
            return 1
        for n in range(-frictions(m), 0):
            w[at(m, n) + BEFORE] = _bears(m, n)
        exert(m)
        moved = 0.0
        for n in range(-frictions(m), 0):
            k = at(m, n)
            allowed = 1e-12 * (w[k + LIMIT] + abs(w[k + FORCE])) + no_force(m, n)
            moved = larger(moved, abs(_bears(m, n) - w[k + BEFORE]) / allowed)
        if turn > 0 and not moved > 1.0:
            return 0
    return 2


@njit(**OPTIONS)
def _bears(m, n):
    """Force of a friction, of one with two rows their size: where the mechanism can't move one of them is rounding."""
    if m.acts[act_of(m, n), WHAT] == ACROSS:
        return 0.0
    return magnitude(m, n, FORCE) if second(m, n) else m.w[at(m, n) + FORCE]


@njit(**OPTIONS)
def _least_consistent(m):
    """Friction with the largest inconsistency of its mode among those without speed; 0 if all are consistent."""
    apart()
    w, worst, found = m.w, 0.0, 0
    for n in range(-frictions(m), 0):
        k = at(m, n)
        if w[k + DUE] >= 0.0:
            continue
        if w[k + MODE] == STICKING:
            off = (magnitude(m, n, FORCE) - w[k + LIMIT]) / (_CLOSE * w[k + LIMIT] + no_force(m, n))
        else:
            unsure = _SHORT / _WRONG if w[k + DUE] == LET_GO else 1.0  # as its load
            off = (abs(across(m, n, SLIP_RATE)) - way(m, n) * w[k + SLIP_RATE]) / (unsure * no_rate(m, n))
        if off > larger(worst, 1.0):
            worst, found = off, n
    return found


@njit(**OPTIONS)
def _end_decision(m):
    """End the decision about slip and stick."""
    for n in range(-frictions(m), 0):
        m.w[at(m, n) + DUE] = 0.0
    return 0
