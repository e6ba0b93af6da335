"""Newton's law of impact in the compiled integration: speeds that jump where rigid sides meet, and sides that rest.

At an instant all contacts that touch act together. Impulses p along their normals give the gaps' rates
v' = v + W p, W = J M^-1 J^T with all loops closed and prescribed drives held; p >= 0, v' >= e (-v) where v < 0 and
v' >= 0 else, and either the one or the other is zero: a linear complementarity problem (Moreau 1988, CISM 302;
Pfeiffer & Glocker 1996, Multibody Dynamics with Unilateral Contacts, ch. 8). The energy lost is p (v + v')/2 by contact
(Thomson & Tait 1879, Treatise on Natural Philosophy, sec. 309), the rest is work of the drives that are held.

The same problem of forces and accelerations says which of them rest from there on: a contact that loads press together,
and that parts so slowly that it would come back before it rose beyond rounding. Bounces that get ever shorter end so.
One that rests is a row like those of the cuts: a dependent coordinate follows from it, its force is an unknown. It
opens where this would pull; then the problem of forces is put again.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.multibody.acting import acceleration, lean, meet
from kaneflex.multibody.closed_factors import column, reach
from kaneflex.multibody.complementarity import complement
from kaneflex.multibody.contact_numbers import EPS, at, no_force, rigid, tolerance
from kaneflex.multibody.contacts import LETS_GO, part
from kaneflex.multibody.loops import follow, mend, middle
from kaneflex.multibody.rows import give, works_at
from kaneflex.multibody.tables import (
    ACTS, ALLOWED, APPROACH, AT, BEGUN_AT, BODIES, COMPLEMENT, CONTACTS, COORDINATES, COURSE, COURSE_AT, COURSE_OF,
    CUT_OF, CUT_ROWS, DOF, DUE, FIRST, FLANK, GAP, GAP_RATE, IMPULSE, KEPT, LOADS, LOST_BEFORE, MODAL, NOW, NUMBERS_AT,
    ON, OPTIONS, PEAK, POWER, PUSH_NOW, RATE, REACTION, RESISTING_MASS, RESTED, ROW_AT, ROW_OF, SCHUR, SEC, SECTION,
    SHAPES, SHUT, SINCE, SPRINGS, TOUCH, TOUCHING, WHAT, WORKS, YIELDING, apart, larger, of_contacts,
)  # fmt: skip

OLD, NEW, IMPULSES, FORCES, ACCELERATIONS, WANTED, STICKS, RESTED_BEFORE, MAY, QUIET = range(10)
"""Vectors over the contacts that touch: rates of their gaps before and after, impulses, forces at rest, accelerations
of gaps, the problem's b, whether they don't bounce, whether they rested, which may exert something, and a rate that is
none."""
_TOGETHER = 100.0
"""Tolerances of a gap within which sides meet at one instant."""
LEAST_HEIGHT = 16.0
"""Tolerances of a gap that a bounce must be high."""
NOISE = 1e-12
"""Of speeds and accelerations that add up to nothing."""


@njit(**OPTIONS)
def vector(m, which):
    """Where one of the vectors is."""
    n = m.plan[ACTS] - m.plan[CONTACTS]
    return m.plan[COMPLEMENT] + (2 * n + 1 + which) * n


@of_contacts(0.0)
@njit(**OPTIONS)
def collide(m, here, A, wanted):
    """Have rigid sides that touch where everything is bounce or rest; the next step [s], below 0 at a singular state.

    RESTED says whether others rest than before: then dependent coordinates are to be chosen anew. Of those that rest
    BEGUN_AT is 1.
    """
    apart()
    plan, w, t = m.plan, m.w, here[0]
    count, kept, cuts = gather(m, t), m.pivots[KEPT], 0
    if count == 0:
        return wanted
    for r in range(kept):
        cuts += plan[plan[ROW_OF] + r] < plan[CUT_ROWS]
    m.pivots[KEPT] = cuts  # whatever rested is free to part
    done = _collided(m, here, A, count)
    m.pivots[KEPT] = kept
    if not done:
        return -1.0
    _settle(m, here, count)
    if kept > cuts and w[plan[TOUCH] + RESTED] == 0.0 and not (follow(m, t) and mend(m, t, A, 0.0, 2)):
        return -1.0
    give(m, t, here)
    return wanted


@njit(**OPTIONS)
def gather(m, t):
    """List the contacts that touch, with the rates of their gaps; their number. None rests any more.

    Where the force of one has come to zero, all whose forces have are to part.
    """
    apart()
    plan, w, count, parting = m.plan, m.w, 0, False
    for c in range(plan[ACTS] - plan[CONTACTS]):
        parting = parting or (rigid(m, c) and w[at(m, c) + DUE] == LETS_GO)
    for c in range(plan[ACTS] - plan[CONTACTS]):
        act = plan[CONTACTS] + c
        if not rigid(m, c):
            continue
        k = meet(m, act)
        rested = w[k + BEGUN_AT] != 0.0
        rate = 0.0 if rested or abs(w[k + GAP_RATE]) <= 0.1 * NOISE * size_of(m, act, 3) else w[k + GAP_RATE]
        if parting and rested and w[k + PUSH_NOW] <= no_force(m, c):
            w[k + DUE] = LETS_GO
        if rested or w[k + DUE] != 0.0 or w[k + GAP] <= _TOGETHER * tolerance(m, c, t, rate):
            m.pivots[plan[TOUCHING] + count] = c
            w[vector(m, OLD) + count], w[vector(m, RESTED_BEFORE) + count] = rate, rested
            w[vector(m, STICKS) + count] = 0.0
            w[k + BEGUN_AT] = w[plan[NOW] + m.acts[act, ROW_AT]] = 0.0
            lean(m, act)
            count += 1
    return count


@njit(**OPTIONS)
def size_of(m, act, rate):
    """Size of the velocities (3) or accelerations (6) of a contact's two sections; of flanks that of their turning."""
    w, one, two = m.w, m.plan[SECTION] + SEC * m.acts[act, AT] + rate, m.plan[SECTION] + SEC * m.acts[act, ON] + rate
    if m.acts[act, WHAT] == FLANK:
        return abs(w[one + 2]) + abs(w[two + 2])
    return abs(w[one]) + abs(w[one + 1]) + abs(w[two]) + abs(w[two + 1])


@njit(**OPTIONS)
def _collided(m, here, A, count):
    """Speeds after the impact, accelerations without contacts, and forces of those that rest; False: singular."""
    apart()
    t = here[0]
    for _ in range(count + 1):
        if not _jump(m, here, A, count) or not follow(m, t) or not mend(m, t, A, 0.0, 1):
            return False
        again = _press(m, t, count)
        if again <= 0:
            return again == 0
    return False


@njit(**OPTIONS)
def _solve(m, x, u, count):
    """See :func:`complementarity.complement`."""
    return complement(m, m.plan[COMPLEMENT], vector(m, WANTED), vector(m, x), vector(m, u), vector(m, MAY), count)


@njit(**OPTIONS)
def _jump(m, here, A, count):
    """Impulses of the contacts, and all speeds after them; False at a singular state."""
    apart()
    plan, w, n = m.plan, m.w, m.plan[COORDINATES]
    old, new, wanted = vector(m, OLD), vector(m, NEW), vector(m, WANTED)
    middle(m)
    m.pivots[YIELDING] = count
    if not reach(m, 0.0, A):
        return False
    cuts, total, S, W = m.pivots[KEPT], m.pivots[KEPT] + count, plan[SCHUR], plan[COMPLEMENT]
    for q in range(cuts):  # whose rows are those of a positive definite matrix
        for i in range(q + 1, total):
            factor = A[S + total * i + q] / A[S + total * q + q]
            for j in range(q + 1, total):
                A[S + total * i + j] -= factor * A[S + total * q + j]
    for i in range(count):
        c = m.pivots[plan[TOUCHING] + i]
        for j in range(count):
            w[W + count * i + j] = A[S + total * (cuts + i) + cuts + j]
        e = 0.0 if w[vector(m, STICKS) + i] != 0.0 else w[m.acts[plan[CONTACTS] + c, NUMBERS_AT] + 6]
        w[wanted + i] = w[old + i] * (1.0 + e) if w[old + i] < 0.0 else w[old + i]
        w[vector(m, MAY) + i] = 1.0
    if not _solve(m, IMPULSES, ACCELERATIONS, count):
        return False
    x, p = plan[REACTION], vector(m, IMPULSES)
    for i in range(count):
        w[new + i] = w[old + i]
        for j in range(count):
            w[new + i] += w[W + count * i + j] * w[p + j]
        A[x + cuts + i] = w[p + i]
    for q in range(cuts - 1, -1, -1):
        reaction = 0.0
        for j in range(q + 1, total):
            reaction -= A[S + total * q + j] * A[x + j]
        A[x + q] = reaction / A[S + total * q + q]
    for k in range(n):
        w[plan[RATE] + k] = here[1 + n + k]
    _share(m, A, total)
    return True


@njit(**OPTIONS)
def _share(m, A, total):
    """Add to all rates what the rows' impulses at REACTION make of them; at POWER works of the drives that hold on."""
    apart()
    plan, w, x = m.plan, m.w, m.plan[REACTION]
    drives = plan[POWER] + 1 + plan[SPRINGS] - plan[LOADS]
    for k in range(plan[WORKS]):
        w[plan[POWER] + k] = 0.0
    for r in range(total):
        of = column(m, r)
        for b in range(plan[BODIES]):
            first, course = m.bodies[b, FIRST], m.bodies[b, COURSE_OF]
            if course >= 0:
                w[drives + course] += A[of + first] * A[x + r] * w[plan[COURSE] + 3 * course + 1]
                continue
            for k in range(first, first + m.bodies[b, DOF]):
                w[plan[RATE] + k] += A[of + k] * A[x + r]
        for b in range(plan[BODIES]):
            for k in range(m.bodies[b, MODAL], m.bodies[b, MODAL] + m.bodies[b, SHAPES]):
                w[plan[RATE] + k] += A[of + k] * A[x + r]
        if r < m.pivots[KEPT]:
            course = m.acts[plan[plan[CUT_OF] + r], COURSE_AT]
            if course >= 0:
                w[drives + course] += A[x + r] * w[plan[COURSE] + 3 * course + 1]


@njit(**OPTIONS)
def _press(m, t, count):
    """Forces of the contacts that rest; how many part too slowly to bounce, and are not to part; -1: no such forces."""
    apart()
    plan, w, W = m.plan, m.w, m.plan[COMPLEMENT]
    new, p, f, sticks = vector(m, NEW), vector(m, IMPULSES), vector(m, FORCES), vector(m, STICKS)
    for i in range(count):
        w[vector(m, WANTED) + i] = acceleration(m, plan[CONTACTS] + m.pivots[plan[TOUCHING] + i])
    slowed = 0
    for turn in range(2):  # by all of them, then by those alone that don't bounce
        for i in range(count):
            stays = w[at(m, m.pivots[plan[TOUCHING] + i]) + DUE] != LETS_GO
            w[vector(m, MAY) + i] = stays and (turn == 0 or w[sticks + i] != 0.0)
        if not _solve(m, FORCES, ACCELERATIONS, count):
            return -1
        others = False
        for i in range(count if turn == 0 else 0):
            c = m.pivots[plan[TOUCHING] + i]
            act = plan[CONTACTS] + c
            noise, v, pressing = NOISE * abs(w[vector(m, OLD) + i]), abs(w[new + i]), w[W + (count + 1) * i] * w[f + i]
            if w[vector(m, ACCELERATIONS) + i] <= 10.0 * NOISE * size_of(m, act, 6):  # or others keep it closed
                pressing = larger(pressing, -w[vector(m, WANTED) + i])
            for j in range(count):
                noise += NOISE * abs(w[W + count * i + j]) * w[p + j]
            low = math.sqrt(2.0 * LEAST_HEIGHT * tolerance(m, c, t, v) * pressing)
            low = larger(low, 32.0 * EPS * abs(t) * pressing)
            w[vector(m, QUIET) + i] = larger(noise, low)  # by the impact of another one it may part as slowly as this
            if w[sticks + i] == 0.0 and v <= larger(noise, low):
                w[sticks + i] = 1.0
                slowed += v > noise
            others = others or (w[sticks + i] == 0.0 and w[f + i] > 0.0)
        if slowed or not others:
            break
    return slowed


@njit(**OPTIONS)
def _settle(m, here, count):
    """Note what the contacts that touched do from here on, and keep the impacts that are over."""
    apart()
    plan, w, t, works, W = m.plan, m.w, here[0], works_at(m), m.plan[COMPLEMENT]
    for k in range(plan[WORKS]):
        here[works + k] += w[plan[POWER] + k]
    w[plan[TOUCH] + RESTED] = 0.0
    for i in range(count):
        c = m.pivots[plan[TOUCHING] + i]
        k, work = at(m, c), works + plan[WORKS] - plan[ACTS] + plan[CONTACTS] + c
        old, new, p = w[vector(m, OLD) + i], w[vector(m, NEW) + i], w[vector(m, IMPULSES) + i]
        f, rested = w[vector(m, FORCES) + i], w[vector(m, RESTED_BEFORE) + i]
        size = size_of(m, plan[CONTACTS] + c, 6) + abs(w[vector(m, WANTED) + i])
        nothing = 1e-10 * size / (w[W + (count + 1) * i] + 1e-300)
        resting = w[vector(m, STICKS) + i] != 0.0 and w[k + DUE] != LETS_GO and abs(new) <= w[vector(m, QUIET) + i]
        held = abs(w[vector(m, ACCELERATIONS) + i]) <= 10.0 * NOISE * size and (rested != 0.0 or old < 0.0 or p > 0.0)
        resting = resting and (f > nothing or held)
        if rested == 0.0 and (resting or p > 0.0):
            w[k + SINCE], w[k + APPROACH], w[k + LOST_BEFORE] = t, larger(-old, 0.0), here[work]
            w[k + IMPULSE] = w[k + PEAK] = 0.0
        w[k + IMPULSE] += p
        here[work] -= 0.5 * p * (old + new)
        w[k + ALLOWED], w[k + RESISTING_MASS] = 1e-10 * f + nothing, 1.0 / (w[W + (count + 1) * i] + 1e-300)
        w[k + GAP_RATE], w[k + DUE] = new, 0.0
        if resting:
            w[k + BEGUN_AT] = 1.0
        elif rested != 0.0 or p > 0.0:
            part(m, c, t, here[work])
        if resting != (w[k + SHUT] != 0.0):
            w[plan[TOUCH] + RESTED] = 1.0
