"""Modes of frictions and rigid contacts at an instant, and what is monitored of frictions over a step.

The speed of slipping friction is monitored like an open contact's gap: its zero ends the step. For sticking friction,
the reserve of its force is monitored; its zero ends the step, too. At such an instant :func:`choose` finds a consistent
choice of modes for all rows without rate: a sticking friction exerts at most its limit, a slipping one accelerates in
its direction of slip, a rigid contact pushes or opens. Without a consistent choice, as in Painleve's paradox (1895, C.
R. Acad. Sci. 121, 112), the run ends with that outcome.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.multibody.compile.stand_ins import of_holds, of_reactions
from kaneflex.multibody.dynamics.algebra import absolute, linear_size
from kaneflex.multibody.dynamics.loop_closure import follow, mend, rows_of_frictions
from kaneflex.multibody.dynamics.loop_factors import factorise_closed, solve_closed
from kaneflex.multibody.dynamics.tree import assemble
from kaneflex.multibody.compile.types import OPTIONS, apart, basis, larger
from kaneflex.multibody.model.layout import (
    ACROSS, BEFORE, BENDING, BODIES, BORE, CLOSED, COLUMNS, COORDINATES, DUE, EXTENT, FIRMEST, FLOWING, FORCE,
    GAP_ACCEL, IN_A_ROW, KEPT, LIMIT, MEMORY, MODE, NODES, NORMAL, OPEN, PIVOTS, PLACE, RESISTING_MASS, RIGID, ROUNDED,
    SLIP, SLIPPING, SLIP_RATE, STICKING, TOUCH, TURN, WANTED, WHAT,
)  # fmt: skip
from kaneflex.multibody.model.tree_layout import BODY
from kaneflex.multibody.unilateral import lugre
from kaneflex.multibody.unilateral.factors import prescribe_nothing, use_rows_now
from kaneflex.multibody.unilateral.frictions import exert, set_mode, size_of, slip, stick
from kaneflex.multibody.unilateral.relative_rows import extent
from kaneflex.multibody.unilateral.rows import (
    EPS, LAW_AT, LUGRE, SLOWEST, VISCOUS_LAW, across, act_of, at, contacts, frictions, held, law_at, magnitude,
    on_contact, row_at, second, sticks, way,
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
_CANDIDATES = 8
"""Largest number of rows without rate of which all combinations are tried."""
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
    rounded = w[k + ROUNDED] + 8.0 * EPS * (size_of(m, n, 0) + abs(t * w[k + SLIP_RATE]))
    return SLOWEST * extent(m, n) + rounded + 1e-300


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
    """Acceleration of a row that counts as zero."""
    return _WRONG * (size_of(m, n, 1) + _weight(m)) + 1e-300


@of_reactions(True)
@njit(**OPTIONS)
def restore_stuck(m, t, h, A):
    """Return sticking frictions, and contacts at rest, to their positions and to zero speed, after a step of h; False:
    singular."""
    apart()
    w, off, faster = m.w, False, False
    rows_of_frictions(m)
    for n in range(-frictions(m), m.plan[RIGID]):
        k = at(m, n)
        if sticks(m, n):
            near = 4.0 * EPS * (abs(w[k + PLACE]) + extent(m, n))
            off = off or abs(w[k + PLACE] - w[k + MEMORY]) > near
            faster = faster or abs(w[k + SLIP]) * h > near
    return (not off or correct_drift(m, t, A, 0)) and (not (off or faster) or correct_drift(m, t, A, 1))


@njit(**OPTIONS)
def correct_drift(m, t, A, level):
    """Change positions, or with level 1 speeds, by the least correction that removes the drift of rows without rate.

    The correction is the least in the norm of the mass matrix, as by an impulse.
    """
    apart()
    plan, w, moved = m.plan, m.w, m.u if level else m.y
    rows_of_frictions(m)
    assemble(m)
    use_rows_now(m)
    if not factorise_closed(m, 0.0, A, plan[PIVOTS]):
        return False
    answer = plan[COLUMNS] + plan[KEPT] * plan[COORDINATES]
    for i in range(plan[COORDINATES]):
        A[answer + i] = 0.0
    prescribe_nothing(m, A)
    for n in range(-frictions(m), plan[RIGID]):
        k = at(m, n)
        if sticks(m, n):
            A[plan[WANTED] + held(m, n)] = -w[k + SLIP] if level else w[k + MEMORY] - w[k + PLACE]
    solve_closed(m, A, plan[PIVOTS])
    for i in range(plan[COORDINATES]):
        moved[i] += A[answer + i]
    return follow(m, t)


@of_holds(0)
@njit(**OPTIONS)
def decide(m, t, A):
    """Find which frictions slip and which are stuck at the current state; 0, or 1 at a singular state, 2 without a
    consistent choice.

    Accelerations and reactions are those of that choice.
    """
    apart()
    for _ in range(2):
        # A friction that sticks may stop others, as in a mechanism with one degree of freedom.
        rows_of_frictions(m)
        free = 0
        for n in range(-frictions(m), 0):
            free += first_mode(m, n, t)
        if free and not correct_drift(m, t, A, 1):
            return 1
    found = choose(m, t, A)
    for n in range(-frictions(m) if found == 0 else 0, 0):
        m.w[at(m, n) + DUE] = m.w[at(m, n) + ROUNDED] = 0.0
    return found


@of_reactions(0)
@njit(**OPTIONS)
def choose(m, t, A):
    """Find consistent modes of the frictions and rigid contacts whose DUE is below zero; returns as :func:`decide`.

    A closed contact pushes, an open one does not accelerate to its other side.
    """
    apart()
    free = 0
    for n in range(-frictions(m), m.plan[RIGID]):
        free += m.w[at(m, n) + DUE] < 0.0
    if free and _share(m, t, A) == 1:
        return 1
    for _ in range(4 * free + 4):
        settled = settle(m, t, A)
        if settled == 1:
            return 1
        n = _least_consistent(m)
        if n == contacts(m):
            if settled == 0:
                return 0
            break
        if n >= 0:
            _shut(m, n, t, m.w[at(m, n) + MODE] == OPEN)
        elif m.w[at(m, n) + MODE] == STICKING:
            slip(m, n, -m.w[at(m, n) + FORCE], -across(m, n, FORCE))
        else:
            stick(m, n)
    return _try_all(m, t, A, free)


@njit(**OPTIONS)
def _try_all(m, t, A, free):
    """Try all combinations of modes; returns as :func:`decide`."""
    apart()
    w, pairs = m.w, 1
    for n in range(m.plan[RIGID]):
        pairs *= 2 if w[at(m, n) + DUE] < 0.0 else 1
    for k in range(pairs if free <= _CANDIDATES else 0):
        left, choices = k, 1
        for n in range(m.plan[RIGID]):
            if w[at(m, n) + DUE] < 0.0:
                _shut(m, n, t, left % 2 == 0)
                left = left // 2
        for n in range(-frictions(m), 0):
            choices *= 3 if w[at(m, n) + DUE] < 0.0 else 1
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
            if settled == 0 and _least_consistent(m) == contacts(m):
                return 0
    return 2


@njit(**OPTIONS)
def _shut(m, n, t, closes):
    """Close or open a contact, with the first modes of its frictions."""
    w, k = m.w, at(m, n)
    w[k + MODE], m.multipliers[row_at(m, n)] = CLOSED if closes else OPEN, 0.0
    for q in range(-frictions(m), 0):
        if on_contact(m, q) == n:
            w[at(m, q) + DUE] = 0.0
            first_mode(m, q, t)


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
def first_mode(m, n, t):
    """First choice for a friction; 1 if it has no speed and other choices are possible: DUE is below zero then."""
    w, k, law = m.w, at(m, n), m.w[law_at(m, n) + LAW_AT]
    shifts, before, v, none = w[k + DUE] > 0.0, w[k + MODE], magnitude(m, n, SLIP), no_speed(m, n, t)
    if m.acts[act_of(m, n), WHAT] == ACROSS or opens(m, n):
        w[k + DUE] = 0.0
        return 0
    if w[k + DUE] < 0.0:
        return 1
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
    w, level, free = m.w, 0.0, False
    for n in range(-frictions(m), 0):
        free = free or w[at(m, n) + DUE] < 0.0
        if w[at(m, n) + MODE] == STICKING:
            m.multipliers[row_at(m, n)] = 0.0
    if not free:
        return 0
    settled = settle(m, t, A)
    for turn in range(2):
        for n in range(-frictions(m), 0):
            k = at(m, n)
            bears = magnitude(m, n, FORCE)
            share = bears / (w[k + LIMIT] + no_force(m, n))
            if w[k + DUE] >= 0.0 or w[k + MODE] != STICKING:
                continue
            lets = w[k + DUE] == LET_GO and bears >= (1.0 - _SHORT) * w[k + BORE]
            if turn == 0 and lets:
                level = larger(level, share)
            elif lets or (level > 1.0 - _SHORT and share >= level - _ALIKE):
                slip(m, n, _slip_direction(m, n), -across(m, n, FORCE))
    return settled


@njit(**OPTIONS)
def _slip_direction(m, n):
    """Direction of slip of a sticking friction: opposite to its force, or if that is zero, to its force at the first
    node of the step that exceeds the limit."""
    w, k = m.w, at(m, n)
    return -w[k + FORCE] if abs(w[k + FORCE]) > no_force(m, n) else -w[k + NODES + 5]


@of_reactions(0)
@njit(**OPTIONS)
def settle(m, t, A):
    """Iterate accelerations and reactions of a choice with friction by reactions; 0, or 1 at a singular state, 2
    without convergence."""
    apart()
    w = m.w
    for n in range(m.plan[RIGID]):  # friction is linear in a force that grows from zero
        if w[at(m, n) + DUE] < 0.0:
            m.multipliers[row_at(m, n)] = 0.0
    if not frictions(m):
        return 0 if mend(m, t, A, 2) else 1
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
    """Row with the largest inconsistency of its mode among those to be chosen, frictions first; the number of contacts
    if all are consistent."""
    apart()
    w, worst, found = m.w, 0.0, contacts(m)
    for n in range(-frictions(m), m.plan[RIGID]):
        k = at(m, n)
        if w[k + DUE] >= 0.0 or (n >= 0 and found < 0):
            continue
        if n >= 0:
            least = no_rate(m, n)
            off = -w[k + GAP_ACCEL] / least if w[k + MODE] == OPEN else -w[k + FORCE] / (least * w[k + RESISTING_MASS])
        elif w[k + MODE] == STICKING:
            off = (magnitude(m, n, FORCE) - w[k + LIMIT]) / (_CLOSE * w[k + LIMIT] + no_force(m, n))
        else:
            unsure = _SHORT / _WRONG if w[k + DUE] == LET_GO else 1.0  # as its load
            off = -way(m, n) * w[k + SLIP_RATE] / (unsure * no_rate(m, n))
        if off > larger(worst, 1.0):
            worst, found = off, n
    return found

