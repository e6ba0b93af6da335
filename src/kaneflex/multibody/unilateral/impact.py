"""Newton's law of impact in the compiled integration: speeds after impacts of rigid sides, and resting contacts.

At an instant all touching contacts act together. Impulses p along their normals give the gaps' rates v' = v + W p, W =
J M^-1 J^T with all loops closed and prescribed drives held; p >= 0, v' >= e (-v) if v < 0 and v' >= 0 otherwise, and
one of both is an equality: a linear complementarity problem (Moreau 1988, CISM 302; Pfeiffer & Glocker 1996, Multibody
Dynamics with Unilateral Contacts, ch. 8). Each contact loses the energy p (v + v')/2 (Thomson & Tait 1879, Treatise on
Natural Philosophy, sec. 309), the rest is work of the drives.

The same problem with forces and accelerations determines the resting contacts: those that loads press together, and
that separate so slowly that they would return before the gap exceeds rounding. This ends sequences of ever shorter
bounces. A resting contact is a row like those of the cuts: it determines a dependent coordinate, and its force is an
unknown. It opens if the force would become tensile; then the problem of forces is solved again.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.multibody.compile.values import copy
from kaneflex.multibody.unilateral import rigid_friction
from kaneflex.multibody.dynamics.tree import assemble
from kaneflex.multibody.dynamics.forces import acceleration, lean, meet
from kaneflex.multibody.unilateral.complementarity import (
    ACCELERATIONS, FORCES, IMPULSES, MAY, NEW, OLD, QUIET, RESTED_BEFORE, STICKS, WANTED, complement, listed, vector,
)  # fmt: skip
from kaneflex.multibody.unilateral.contact_numbers import EPS, at, no_force, rigid, tolerance
from kaneflex.multibody.unilateral.contacts import LETS_GO, part
from kaneflex.multibody.unilateral.impulse_response import apply_impulses, reactions_of, response_matrix
from kaneflex.multibody.dynamics.loop_closure import follow, mend
from kaneflex.multibody.time.state_record import give, works_at
from kaneflex.multibody.compile.stand_ins import of_impacts
from kaneflex.multibody.model.layout import (
    ACTS, ALLOWED, APPROACH, AT, BEGAN_X, BEGAN_Y, BEGUN_AT, COMPLEMENT, CONTACTS, COORDINATES, CUT_ROWS, DRIVES, DUE,
    FLANK, GAP, GAP_RATE, HOLDS, IMPULSE, KEPT, LAST_R, LOST_BEFORE, NOW, NUMBERS_AT, ON, OPTIONS, PEAK, PLACE_X,
    PLACE_Y, POWER, PUSH_NOW, RATE, REACTIONS, RESISTING_MASS, RESTED, ROW_AT, ROW_OF, SEC, SECTION, SHUT, SINCE, TOUCH,
    WHAT, WORKS, apart, larger,
)  # fmt: skip

_TOGETHER = 100.0
"""Tolerances of a gap within which sides meet at one instant."""
LEAST_HEIGHT = 16.0
"""Tolerances of a gap that a bounce must be high."""
NOISE = 1e-12
"""Rounding error of cancelling speeds and accelerations, relative to them."""
_TURNS = 40
"""Iterations in which impulses of joints and their friction converge, or after which the increments are halved. If
several joints stop at once, their loads are statically indeterminate: one solution is taken."""


@of_impacts(0.0)
@njit(**OPTIONS)
def collide(m, state, A, wanted):
    """Solve the impacts of touching rigid sides and find those that rest; returns the next step [s], -1 at a singular
    state, -2 without a solution with friction.

    RESTED is set if other contacts rest than before: dependent coordinates must be chosen again then. BEGUN_AT of
    resting contacts is 1.
    """
    apart()
    plan, w, t = m.plan, m.w, state[0]
    count, kept, cuts = gather(m, t), m.pivots[KEPT], 0
    if count == 0:
        return wanted
    for r in range(kept):
        cuts += plan[plan[ROW_OF] + r] < plan[CUT_ROWS]
    m.pivots[KEPT] = cuts  # resting contacts may separate
    slips = rigid_friction.gather(m, count)
    done = _collided(m, state, A, count, slips)
    m.pivots[KEPT] = kept
    if done < 0.0:
        return done
    _settle(m, state, count, slips)
    if kept > cuts and w[plan[TOUCH] + RESTED] == 0.0 and not (follow(m, t) and mend(m, t, A, 0.0, 2)):
        return -1.0
    give(m, t, state)
    return wanted


@njit(**OPTIONS)
def gather(m, t):
    """List the touching contacts with the rates of their gaps; returns their number. All are marked as not resting.

    If the force of one has come to zero, all with zero force separate.
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
            m.pivots[listed(m) + count] = c
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
def _collided(m, state, A, count, slips):
    """Speeds after the impact, accelerations without contacts, and forces of the resting contacts; returns as
    :func:`collide`."""
    apart()
    t = state[0]
    for _ in range(count + 1):
        done = _jump(m, state, A, count, slips)
        if done < 0.0:
            return done
        if not follow(m, t):
            return -1.0
        rigid_friction.modes_after_impact(m, t, count, slips)
        again = _forces(m, t, A, count, slips)
        if again <= 0:
            return 1.0 if again == 0 else -2.0 if slips and again == -1 else -1.0
    return -1.0


@njit(**OPTIONS)
def _forces(m, t, A, count, slips):
    """Accelerations without contacts, and forces of the resting contacts, with the friction of the joints' reactions;
    returns as :func:`_press`, -2: singular."""
    apart()
    plan, w, again, missed, turn = m.plan, m.w, 0, math.inf, 0
    while missed > 1.0 and turn < _TURNS:
        copy(w, plan[NOW], plan[LAST_R], plan[REACTIONS])
        if not mend(m, t, A, 0.0, 1):
            return -2
        rigid_friction.exchange_reactions(m)
        if plan[HOLDS] < plan[DRIVES] and not response_matrix(m, A, count + slips):
            return -2
        again = _press(m, t, count, slips)
        rigid_friction.exchange_reactions(m)
        if again != 0:
            return again
        missed = rigid_friction.update_joint_reactions(m, A, count, slips)
        turn += 1
    return again


@njit(**OPTIONS)
def _jump(m, state, A, count, slips):
    """Impulses of the contacts and holds, and all speeds after them; returns as :func:`collide`."""
    apart()
    plan, w, n, rows, W = m.plan, m.w, m.plan[COORDINATES], count + slips, m.plan[COMPLEMENT]
    old, new, p = vector(m, OLD), vector(m, NEW), vector(m, IMPULSES)
    assemble(m)
    rigid_friction.begin(m, count, slips)
    if not response_matrix(m, A, rows):
        return -1.0
    for i in range(count):
        e = w[m.acts[plan[CONTACTS] + m.pivots[listed(m) + i], NUMBERS_AT] + 6]
        e = 0.0 if w[vector(m, STICKS) + i] != 0.0 else e
        w[vector(m, WANTED) + i] = w[old + i] * (1.0 + e) if w[old + i] < 0.0 else w[old + i]
        w[vector(m, MAY) + i] = 1.0
    copy(w, plan[NOW], plan[LAST_R], plan[REACTIONS])
    missed, turn = math.inf, 0
    while missed > 1.0 and turn < 5 * _TURNS:
        if not complement(m, IMPULSES, ACCELERATIONS, count, slips):
            for i in range(count):  # in a jamming wedge no impulses satisfy restitution
                w[vector(m, WANTED) + i] = w[old + i]
            if not complement(m, IMPULSES, ACCELERATIONS, count, slips):
                return -2.0 if slips else -1.0
        reactions_of(m, A, rows, p)
        missed = rigid_friction.update_joint_limits(m, A, count, slips, 0.5 ** (turn // _TURNS))
        turn += 1
    copy(w, plan[LAST_R], plan[NOW], plan[REACTIONS])
    for i in range(rows):
        w[new + i] = w[old + i]
        for j in range(rows):
            w[new + i] += w[W + rows * i + j] * w[p + j]
    for k in range(n):
        w[plan[RATE] + k] = state[1 + n + k]
    apply_impulses(m, A)
    return 1.0


@njit(**OPTIONS)
def _press(m, t, count, slips):
    """Forces of the resting contacts; returns the number of those that separate too slowly to bounce, and stay; -1: no
    solution."""
    apart()
    plan, w, W, rows = m.plan, m.w, m.plan[COMPLEMENT], count + slips
    new, p, f, sticks = vector(m, NEW), vector(m, IMPULSES), vector(m, FORCES), vector(m, STICKS)
    for i in range(count):
        w[vector(m, WANTED) + i] = acceleration(m, plan[CONTACTS] + m.pivots[listed(m) + i])
    rigid_friction.problem_of_forces(m, count, slips)
    slowed = 0
    for turn in range(2):  # by all of them, then by those alone that don't bounce
        for i in range(count):
            stays = w[at(m, m.pivots[listed(m) + i]) + DUE] != LETS_GO
            w[vector(m, MAY) + i] = stays and (turn == 0 or w[sticks + i] != 0.0)
        if not complement(m, FORCES, ACCELERATIONS, count, slips):
            return -1
        others = False
        for i in range(count if turn == 0 else 0):
            c = m.pivots[listed(m) + i]
            act = plan[CONTACTS] + c
            noise, v = NOISE * abs(w[vector(m, OLD) + i]), abs(w[new + i])
            pressing = abs(w[W + (rows + 1) * i]) * w[f + i]
            if w[vector(m, ACCELERATIONS) + i] <= 10.0 * NOISE * size_of(m, act, 6):  # or others keep it closed
                pressing = larger(pressing, -w[vector(m, WANTED) + i])
            for j in range(rows):
                noise += NOISE * abs(w[W + rows * i + j] * w[p + j])
            low = math.sqrt(2.0 * LEAST_HEIGHT * tolerance(m, c, t, v) * pressing)
            low = larger(low, 32.0 * EPS * abs(t) * pressing)
            w[vector(m, QUIET) + i] = larger(noise, low)  # negligible rate, also after the impact of another contact
            if w[sticks + i] == 0.0 and v <= larger(noise, low):
                w[sticks + i] = 1.0
                slowed += v > noise
            others = others or (w[sticks + i] == 0.0 and w[f + i] > 0.0)
        if slowed or not others:
            break
    return slowed


@njit(**OPTIONS)
def _settle(m, state, count, slips):
    """Update the modes of the contacts, and record the impacts."""
    apart()
    plan, w, t, works, W = m.plan, m.w, state[0], works_at(m), m.plan[COMPLEMENT]
    for k in range(plan[WORKS]):
        state[works + k] += w[plan[POWER] + k]
    w[plan[TOUCH] + RESTED] = 0.0
    for i in range(count):
        c = m.pivots[listed(m) + i]
        k, work = at(m, c), works + plan[WORKS] - plan[ACTS] + plan[CONTACTS] + c
        old, new, p = w[vector(m, OLD) + i], w[vector(m, NEW) + i], w[vector(m, IMPULSES) + i]
        f, rested = w[vector(m, FORCES) + i], w[vector(m, RESTED_BEFORE) + i]
        size = size_of(m, plan[CONTACTS] + c, 6) + abs(w[vector(m, WANTED) + i])
        mass = 1.0 / (abs(w[W + (count + slips + 1) * i]) + 1e-300)
        nothing = 1e-10 * size * mass
        resting = w[vector(m, STICKS) + i] != 0.0 and w[k + DUE] != LETS_GO and abs(new) <= w[vector(m, QUIET) + i]
        held = abs(w[vector(m, ACCELERATIONS) + i]) <= 10.0 * NOISE * size and (rested != 0.0 or old < 0.0 or p > 0.0)
        resting = resting and (f > nothing or held)
        if rested == 0.0 and (resting or p > 0.0):
            w[k + SINCE], w[k + APPROACH], w[k + LOST_BEFORE] = t, larger(-old, 0.0), state[work]
            w[k + IMPULSE] = w[k + PEAK] = 0.0
            w[k + BEGAN_X], w[k + BEGAN_Y] = w[k + PLACE_X], w[k + PLACE_Y]
        w[k + IMPULSE] += p
        state[work] -= 0.5 * p * (old + new)
        w[k + ALLOWED], w[k + RESISTING_MASS] = 1e-10 * f + nothing, mass
        w[k + GAP_RATE], w[k + DUE] = new, 0.0
        if resting:
            w[k + BEGUN_AT] = 1.0
        elif rested != 0.0 or p > 0.0:
            part(m, c, t, state[work])
        if resting != (w[k + SHUT] != 0.0):
            w[plan[TOUCH] + RESTED] = 1.0
    rigid_friction.settle(m, state, count, slips)
