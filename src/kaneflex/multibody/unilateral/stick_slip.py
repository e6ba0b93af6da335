"""Decision between slip and stick of holds in the compiled integration, at an instant and over a step.

The speed of a slipping hold is monitored like an open contact's gap: its zero ends the step. For a stuck hold, the
reserve of its friction force is monitored; its zero ends the step, too. At such an instant :func:`decide` finds a
consistent choice of modes for all holds without speed: a stuck one exerts at most its friction limit, a slipping one
accelerates in its direction of slip. Without a consistent choice, as in Painleve's paradox (1895, C. R. Acad. Sci. 121,
112), the run ends with that outcome.
"""

from __future__ import annotations

from numba import njit

from kaneflex.multibody.unilateral import lugre
from kaneflex.multibody.dynamics.tree import assemble
from kaneflex.multibody.dynamics.loop_factors import factorise_closed, solve_closed
from kaneflex.multibody.unilateral.dry_friction import (
    BENDS, FLOWS, IDLE, LAW_AT, OF_AT, STUCK, count, exert, number_at, row_at, rows_now,
)  # fmt: skip
from kaneflex.multibody.dynamics.loop_closure import follow, hold_now, mend
from kaneflex.multibody.compile.stand_ins import of_holds
from kaneflex.multibody.model.layout import (
    ALONG, AT, BEFORE, BEGUN_AT, BODIES, BORE, COLUMNS, CONTACT, CONTACTS, CONTACT_SIZE, COORDINATES, CUT,
    DRIVES, DUE, EXTENT, FIRMEST, GRAVITY, HOLDING, IN_A_ROW, KEPT, LIMIT, MODE, NODES, NORMAL, NOW,
    NUMBERS_AT, OPTIONS, PIVOTS, PLACE, RATE, ROW_SIZE, SEC, SECTION, SLIP, SLIP_RATE, SPEED_SIZE, STUCK_AT, TOUCH,
    TURN, WANTED, WHAT, Y, YIELDING, apart, larger,
)  # fmt: skip
from kaneflex.multibody.model.spatial_layout import BODY

_EPS = 2.3e-16
_CLOSE = 1e-11
"""Share of the largest holding force within which it counts as reached."""
_WRONG = 1e-9
"""Share of neighbouring accelerations above which one against the slip is not rounding."""
_SHORT, _ALIKE = 1e-6, 1e-9
"""Tolerances, as shares of the holding force, of a hold's load where it is to slip, and of equal loads."""
LET_GO = -2.0
"""Value of DUE for a stuck hold that is to slip; -1 for all others without speed."""
_STILL = 1e-11
"""Speed that counts as zero, in sizes of the mechanism, or rad, a second."""
_CANDIDATES = 6
"""Largest number of holds without speed of which all combinations are tried."""
_SETTLED = 40
"""Iterations for reactions and their friction to converge."""


@of_holds(None)
@njit(**OPTIONS)
def begin(m):
    """Initialise the monitoring at the start of a step, after contacts."""
    exert(m)


@of_holds(None)
@njit(**OPTIONS)
def store_node(m, t, i):
    """Store the monitored quantity of all holds, with its rate and tolerance, at node i of the step."""
    apart()
    w = m.w
    for n in range(-count(m), 0):
        k = number_at(m, n)
        j, mode = k + NODES + 4 * i, w[k + MODE]
        if mode == BENDS:
            own = m.acts[m.plan[DRIVES] + n, NUMBERS_AT]
            w[j], w[j + 1] = w[k + SLIP], lugre.resisted(w, own, w[k + NORMAL], w[k + SLIP])
            continue
        if mode == STUCK:
            w[j], w[j + 1] = w[k + LIMIT] - abs(w[k + HOLDING]), w[k + HOLDING]
            w[j + 2] = _CLOSE * w[k + LIMIT] + no_force(m, n)
        else:
            w[j], w[j + 1], w[j + 2] = mode * w[k + SLIP], mode * w[k + SLIP_RATE], no_speed(m, n, t)
        w[j + 3] = w[j]


@of_holds(None)
@njit(**OPTIONS)
def extrapolate_to_end(m, table, last):
    """Extrapolate the forces of stuck holds from the stages to the end of a step that isn't a stage."""
    apart()
    w, c = m.w, table.nodes
    if table.ends[0] != 0.0:
        return
    for n in range(-count(m), 0):
        k = number_at(m, n)
        if w[k + MODE] == STUCK:
            j, total = k + NODES, 0.0
            for i in range(3):
                one, two = c[(i + 1) % 3], c[(i + 2) % 3]
                total += w[j + 4 * (i + 1)] * (1.0 - one) * (1.0 - two) / ((c[i] - one) * (c[i] - two))
            w[j + 4 * last] = w[j + 4 * last + 3] = total


@of_holds(False)
@njit(**OPTIONS)
def due(m, n, last):
    """True if a hold changes at the step's end, within rounding."""
    w = m.w
    j = number_at(m, n) + NODES + 4 * last
    return abs(w[j]) <= w[j + 2] and (w[number_at(m, n) + MODE] == STUCK or w[j + 1] < 0.0)


@njit(**OPTIONS)
def no_speed(m, n, t):
    """Speed of a hold that counts as zero."""
    w, k = m.w, number_at(m, n)
    least = 1.0 if m.acts[m.plan[DRIVES] + n, WHAT] == TURN else w[m.plan[TOUCH] + EXTENT]
    return _STILL * least + 8.0 * _EPS * (w[k + SPEED_SIZE] + abs(t * w[k + SLIP_RATE])) + 1e-300


@njit(**OPTIONS)
def no_force(m, n):
    """Force, or moment, of a hold that counts as zero: rounding error of the force that moves all bodies."""
    apart()
    plan, w, total = m.plan, m.w, 0.0
    for b in range(plan[BODIES]):
        node = m.frames[b, 0]
        x, z, _ = m.rate[node]
        size = abs(w[plan[GRAVITY]]) + abs(w[plan[GRAVITY] + 1]) + abs(x) + abs(z)
        total += w[m.nodes[node, BODY]] * size
    arm = w[plan[TOUCH] + EXTENT] if m.acts[plan[DRIVES] + n, WHAT] == TURN else 1.0
    return 1e-14 * total * arm + 1e-300


@njit(**OPTIONS)
def no_rate(m, n):
    """Acceleration of a hold that counts as zero."""
    plan, w, size = m.plan, m.w, 0.0
    for side in range(2):
        at = plan[SECTION] + SEC * m.acts[plan[DRIVES] + n, AT + side] + 6
        own = plan[CUT] + ROW_SIZE * row_at(m, n) + 3 + 3 * side
        for i in range(3):
            size += abs(w[own + i] * w[at + i])
    return _WRONG * (size + abs(w[plan[GRAVITY]]) + abs(w[plan[GRAVITY] + 1])) + 1e-300


@of_holds(True)
@njit(**OPTIONS)
def restore_stuck(m, t, h, A):
    """Return stuck holds to their positions and to zero speed, after a step of h; False: singular."""
    apart()
    w, extent, off, faster = m.w, m.w[m.plan[TOUCH] + EXTENT], False, False
    hold_now(m)
    for n in range(-count(m), 0):
        k = number_at(m, n)
        if w[k + MODE] == STUCK:
            size = 1.0 if m.acts[m.plan[DRIVES] + n, WHAT] == TURN else extent
            near = 4.0 * _EPS * (abs(w[k + PLACE]) + size)
            off = off or abs(w[k + PLACE] - w[k + STUCK_AT]) > near
            faster = faster or abs(w[k + SLIP]) * h > near
    return (not off or correct_drift(m, t, A, 0)) and (not (off or faster) or correct_drift(m, t, A, 1))


@njit(**OPTIONS)
def correct_drift(m, t, A, level):
    """Change positions, or with level 1 speeds, by the least correction that removes the drift of stuck holds.

    The correction is the least in the norm of the mass matrix, as by an impulse.
    """
    apart()
    plan, w, of = m.plan, m.w, m.plan[RATE] if level else m.plan[Y]
    hold_now(m)
    assemble(m)
    m.pivots[YIELDING] = rows_now(m, 0)
    if not factorise_closed(m, 0.0, A, plan[PIVOTS]):
        return False
    answer = plan[COLUMNS] + plan[KEPT] * plan[COORDINATES]
    for i in range(plan[COORDINATES]):
        A[answer + i] = 0.0
    for n in range(-count(m), 0):
        k = number_at(m, n)
        A[plan[WANTED] - 1 - n] = 0.0
        if w[k + MODE] == STUCK:
            A[plan[WANTED] - 1 - n] = -w[k + SLIP] if level else w[k + STUCK_AT] - w[k + PLACE]
    solve_closed(m, A, plan[PIVOTS])
    for i in range(plan[COORDINATES]):
        w[of + i] += A[answer + i]
    return follow(m, t)


@of_holds(0)
@njit(**OPTIONS)
def decide(m, t, A):
    """Find which holds slip and which are stuck at the current state; 0, or 1 at a singular state, 2 without a
    consistent choice.

    Accelerations and reactions are those of that choice.
    """
    apart()
    w, free = m.w, 0
    for _ in range(2):
        # A hold that sticks may stop others, as in a mechanism with one degree of freedom.
        hold_now(m)
        free = 0
        for n in range(-count(m), 0):
            free += _first_mode(m, n, t)
        if free and not correct_drift(m, t, A, 1):
            return 1
    if free and _share(m, t, A) == 1:
        return 1
    for _ in range(4 * free + 4):
        settled = _settle(m, t, A)
        if settled == 1:
            return 1
        n = _least_consistent(m)
        if n == 0:
            if settled == 0:
                return _end_decision(m)
            break
        k = number_at(m, n)
        w[k + MODE] = (-1.0 if w[k + HOLDING] > 0.0 else 1.0) if w[k + MODE] == STUCK else STUCK
    if free > _CANDIDATES:
        return 2
    for choice in range(3**free):
        left = choice
        for n in range(-count(m), 0):
            if w[number_at(m, n) + DUE] < 0.0:
                w[number_at(m, n) + MODE] = (STUCK, 1.0, -1.0)[left % 3]
                left //= 3
        settled = _settle(m, t, A)
        if settled == 1:
            return 1
        if settled == 0 and _least_consistent(m) == 0:
            return _end_decision(m)
    return 2


@njit(**OPTIONS)
def opens(m, n):
    """True if a hold belongs to an open contact, which exerts no force; its bristles relax."""
    plan, w, k, j = m.plan, m.w, number_at(m, n), m.acts[m.plan[DRIVES] + n, NUMBERS_AT]
    of = plan[CONTACT] + CONTACT_SIZE * (int(w[j + OF_AT]) - plan[CONTACTS])
    if m.acts[plan[DRIVES] + n, WHAT] != ALONG or w[of + BEGUN_AT] != 0.0:
        return False
    w[k + MODE] = IDLE
    w[k + STUCK_AT] *= w[j + LAW_AT] != lugre.LUGRE
    w[k + FIRMEST] = 0.0
    return True


@njit(**OPTIONS)
def _first_mode(m, n, t):
    """First choice for a hold; True if it has no speed and other choices are possible: DUE is below zero then."""
    w, k, j = m.w, number_at(m, n), m.acts[m.plan[DRIVES] + n, NUMBERS_AT]
    shifts, before, v = w[k + DUE] > 0.0, w[k + MODE], w[k + SLIP]
    if w[k + DUE] < 0.0:
        return 1
    if w[j + LAW_AT] < 0.0:
        return 0
    if opens(m, n):
        return 0
    if w[j + LAW_AT] >= 2.0:
        w[k + MODE] = BENDS if w[j + LAW_AT] == lugre.LUGRE else FLOWS
        return 0
    if before != STUCK and not shifts and abs(v) > no_speed(m, n, t):
        w[k + MODE] = 1.0 if v > 0.0 else -1.0
        return 0
    w[k + DUE], w[k + MODE] = -1.0, STUCK
    if before != STUCK:
        w[k + STUCK_AT] = w[k + PLACE]
        if w[m.plan[TOUCH] + IN_A_ROW] > 0.0 and not shifts and before != IDLE:
            w[k + MODE] = before  # it was released just before others
    elif shifts:
        w[k + DUE], w[k + BORE] = LET_GO, abs(w[k + HOLDING])
    return 1


@njit(**OPTIONS)
def _share(m, t, A):
    """Distribute loads again among stuck holds, and let those slip that are due, with equally loaded ones.

    Among several holds of one body, as its feet, one at its limit needn't slip if others can bear more. Returns as
    :func:`_settle`.
    """
    apart()
    w, level = m.w, 0.0
    for n in range(-count(m), 0):
        if w[number_at(m, n) + MODE] == STUCK:
            w[m.plan[NOW] + row_at(m, n)] = 0.0
    settled = _settle(m, t, A)
    for turn in range(2):
        for n in range(-count(m), 0):
            k = number_at(m, n)
            bears, share = abs(w[k + HOLDING]), abs(w[k + HOLDING]) / (w[k + LIMIT] + no_force(m, n))
            if w[k + DUE] >= 0.0 or w[k + MODE] != STUCK:
                continue
            lets = w[k + DUE] <= LET_GO and bears >= (1.0 - _SHORT) * w[k + BORE]
            if turn == 0 and lets:
                level = larger(level, share)
            elif lets or (level > 1.0 - _SHORT and share >= level - _ALIKE):
                w[k + MODE] = _slip_direction(m, n)
    return settled


@njit(**OPTIONS)
def _slip_direction(m, n):
    """Direction of slip of a stuck hold: opposite to its force, or if that is zero, to its force at the first node of
    the step that exceeds the limit."""
    w, k = m.w, number_at(m, n)
    force = w[k + HOLDING] if abs(w[k + HOLDING]) > no_force(m, n) else w[k + NODES + 5]
    return -1.0 if force > 0.0 else 1.0


@njit(**OPTIONS)
def _settle(m, t, A):
    """Iterate accelerations and reactions of a choice with friction by reactions; 0, or 1 at a singular state, 2
    without convergence."""
    apart()
    w = m.w
    for turn in range(_SETTLED):
        if not mend(m, t, A, 0.0, 1):
            return 1
        for n in range(-count(m), 0):
            w[number_at(m, n) + BEFORE] = w[number_at(m, n) + HOLDING]
        exert(m)
        moved = 0.0
        for n in range(-count(m), 0):
            k = number_at(m, n)
            allowed = 1e-12 * (w[k + LIMIT] + abs(w[k + HOLDING])) + no_force(m, n)
            moved = larger(moved, abs(w[k + HOLDING] - w[k + BEFORE]) / allowed)
        if turn > 0 and not moved > 1.0:
            return 0
    return 2


@njit(**OPTIONS)
def _least_consistent(m):
    """Hold with the largest inconsistency of its mode among those without speed; 0 if all are consistent."""
    apart()
    w, worst, found = m.w, 0.0, 0
    for n in range(-count(m), 0):
        k = number_at(m, n)
        if w[k + DUE] >= 0.0:
            continue
        if w[k + MODE] == STUCK:
            off = (abs(w[k + HOLDING]) - w[k + LIMIT]) / (_CLOSE * w[k + LIMIT] + no_force(m, n))
        else:
            unsure = _SHORT / _WRONG if w[k + DUE] <= LET_GO else 1.0  # as its load
            off = -w[k + MODE] * w[k + SLIP_RATE] / (unsure * no_rate(m, n))
        if off > larger(worst, 1.0):
            worst, found = off, n
    return found


@njit(**OPTIONS)
def _end_decision(m):
    """End the decision about slip and stick."""
    for n in range(-count(m), 0):
        m.w[number_at(m, n) + DUE] = 0.0
    return 0
