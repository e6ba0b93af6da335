"""Newton's law of impact: speeds after impacts of rigid sides, and resting contacts.

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

from kaneflex.multibody.compile.stand_ins import of_impacts
from kaneflex.multibody.compile.values import copy
from kaneflex.multibody.dynamics.algebra import angular_size, linear_size
from kaneflex.multibody.dynamics.courses import courses
from kaneflex.multibody.dynamics.kinematics import section_motion
from kaneflex.multibody.dynamics.loop_closure import follow, mend
from kaneflex.multibody.dynamics.loop_factors import factorise_closed, solve_closed
from kaneflex.multibody.dynamics.tree import assemble
from kaneflex.multibody.compile.types import OPTIONS, apart, larger, shifted
from kaneflex.multibody.model.codes import (
    ACCELERATIONS, FORCES, IMPULSES, MAY, NEW, OLD, QUIET, RESTED_BEFORE, STICKS, UNIT, WANTED,
)  # fmt: skip
from kaneflex.multibody.model.layout import (
    ALLOWED, AT, CLOSED, COLUMNS, COMPLEMENT, COORDINATES, COURSE, COURSE_AT, CUT_OF, CUT_ROWS, DRIVES, DUE, FLANK,
    FORCE, FREED, GAP, GAP_ACCEL, GAP_RATE, HOLDS, IMPULSE, KEPT, LAST_R, LOADS, MODE, ON, OPEN, PIVOTS, POWER,
    PRESCRIBED, REACTION, REACTIONS, RESISTING_MASS, RESTED, ROW_OF, SHUT, SPRINGS, TOUCH, WHAT, WORKS,
)  # fmt: skip
from kaneflex.multibody.time.state_record import give, works_at
from kaneflex.multibody.unilateral import rigid_friction
from kaneflex.multibody.unilateral.active_set import LETS_GO, begin, part
from kaneflex.multibody.unilateral.complementarity import complement, listed, moved, vector
from kaneflex.multibody.unilateral.factors import prescribe_nothing, use_rows_now
from kaneflex.multibody.unilateral.relative_rows import meet, near
from kaneflex.multibody.unilateral.rows import EPS, act_of, at, contacts, law_at, no_force, rigid, row_at
from kaneflex.multibody.unilateral.step_rows import derivatives, gradient_at

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

    RESTED is set if other contacts rest than before: dependent coordinates must be chosen again then.
    """
    apart()
    plan, w, t = m.plan, m.w, state[0]
    count, kept, cuts = _gather(m, t), m.pivots[KEPT], 0
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
    if kept > cuts and w[plan[TOUCH] + RESTED] == 0.0 and not (follow(m, t) and mend(m, t, A, 2)):
        return -1.0
    give(m, t, state)
    return wanted


@njit(**OPTIONS)
def _gather(m, t):
    """List the touching contacts with the rates of their gaps; returns their number. All are marked as not resting.

    If the force of one has come to zero, all with zero force separate.
    """
    apart()
    w, count, parting = m.w, 0, False
    for n in range(contacts(m)):
        parting = parting or (rigid(m, n) and w[at(m, n) + DUE] == LETS_GO)
    for n in range(contacts(m)):
        if not rigid(m, n):
            continue
        k = meet(m, n)
        rested = w[k + MODE] == CLOSED
        rate = 0.0 if rested or abs(w[k + GAP_RATE]) <= 0.1 * NOISE * motion_size(m, n, 0) else w[k + GAP_RATE]
        if parting and rested and w[k + FORCE] <= no_force(m, n):
            w[k + DUE] = LETS_GO
        if rested or w[k + DUE] != 0.0 or w[k + GAP] <= _TOGETHER * near(m, n, t, rate):
            m.pivots[listed(m) + count] = n
            w[vector(m, OLD) + count], w[vector(m, RESTED_BEFORE) + count] = rate, rested
            w[vector(m, STICKS) + count] = 0.0
            w[k + MODE], m.multipliers[row_at(m, n)] = OPEN, 0.0
            count += 1
    return count


@njit(**OPTIONS)
def motion_size(m, n, rate):
    """Size of the velocities (0) or accelerations (1) of a contact's two sections; of flanks that of their turning.

    Rates of gaps are differences of these, whatever their direction: all are from one solution of the equations.
    """
    act = act_of(m, n)
    one, two = section_motion(m, m.acts[act, AT], rate), section_motion(m, m.acts[act, ON], rate)
    if m.acts[act, WHAT] == FLANK:
        return angular_size(one) + angular_size(two)
    return linear_size(one) + linear_size(two)


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
def _response_matrix(m, A, rows):
    """Fill W of the problem for ``rows`` rows: their rates by unit forces along them, while loops stay closed and
    drives are kinematic; bristles exert the resulting friction. False at a singular state."""
    apart()
    plan, w, unit = m.plan, m.w, vector(m, UNIT)
    use_rows_now(m)
    if not factorise_closed(m, 0.0, A, plan[PIVOTS]):
        return False
    for j in range(rows):
        derivatives(m, m.pivots[listed(m) + j])
        w[unit + j] = 0.0
    answer = plan[COLUMNS] + plan[COORDINATES] * m.pivots[KEPT]
    for j in range(rows):
        w[unit + j] = 1.0
        _respond(m, A, rows, unit)
        w[unit + j] = 0.0
        for i in range(rows):
            g, total = gradient_at(m, m.pivots[listed(m) + i]), 0.0
            for k in range(plan[COORDINATES]):
                if plan[plan[FREED] + k] != 0:
                    total += w[g + k] * A[answer + k]
            w[plan[COMPLEMENT] + rows * i + j] = total
    return True


@njit(**OPTIONS)
def _respond(m, A, rows, x):
    """Rates of the coordinates for forces x of the rows, with the friction that they bring; forces of the loops at
    REACTION."""
    apart()
    plan, w = m.plan, m.w
    answer = plan[COLUMNS] + plan[COORDINATES] * m.pivots[KEPT]
    for k in range(plan[COORDINATES]):
        A[answer + k] = 0.0
    for j in range(rows):
        if w[x + j] != 0.0:
            n = m.pivots[listed(m) + j]
            g = gradient_at(m, n)
            for k in range(plan[COORDINATES]):
                A[answer + k] += w[x + j] * w[g + k]
            rigid_friction.add_friction(m, n, w[x + j], A, answer)
    prescribe_nothing(m, A)
    solve_closed(m, A, plan[PIVOTS])


@njit(**OPTIONS)
def _jump(m, state, A, count, slips):
    """Impulses of the contacts and frictions, and all speeds after them; returns as :func:`collide`."""
    apart()
    plan, w, size, rows = m.plan, m.w, m.plan[COORDINATES], count + slips
    old, new, p, b = vector(m, OLD), vector(m, NEW), vector(m, IMPULSES), vector(m, WANTED)
    assemble(m)
    rigid_friction.begin(m, count, slips)
    if not _response_matrix(m, A, rows):
        return -1.0
    for i in range(count):
        e = w[law_at(m, m.pivots[listed(m) + i]) + 6] if w[vector(m, STICKS) + i] == 0.0 else 0.0
        w[b + i] = w[old + i] * (1.0 + e) if w[old + i] < 0.0 else w[old + i]
        w[vector(m, MAY) + i] = 1.0
    copy(m.multipliers, shifted(w, plan[LAST_R]), plan[REACTIONS])
    missed, turn = math.inf, 0
    while missed > 1.0 and turn < 5 * _TURNS:
        if not complement(m, IMPULSES, ACCELERATIONS, count, slips):
            for i in range(count):  # in a jamming wedge no impulses satisfy restitution
                w[b + i] = w[old + i]
            if not complement(m, IMPULSES, ACCELERATIONS, count, slips):
                return -2.0 if slips else -1.0
        _respond(m, A, rows, p)
        missed = rigid_friction.update_joint_limits(m, A, count, slips, 0.5 ** (turn // _TURNS))
        turn += 1
    copy(shifted(w, plan[LAST_R]), m.multipliers, plan[REACTIONS])
    for i in range(rows):
        w[new + i] = w[old + i] + moved(m, i, p, rows)[0]
    for k in range(size):
        m.u[k] = state[1 + size + k]
    _apply_impulses(m, A)
    return 1.0


@njit(**OPTIONS)
def _apply_impulses(m, A):
    """Add the response to the impulses to all rates; works of prescribed drives at POWER."""
    apart()
    plan, w = m.plan, m.w
    answer = plan[COLUMNS] + plan[COORDINATES] * m.pivots[KEPT]
    drives = plan[POWER] + 1 + plan[SPRINGS] - plan[LOADS]
    for k in range(plan[WORKS]):
        w[plan[POWER] + k] = 0.0
    for course in range(courses(m)):
        k = plan[plan[PRESCRIBED] + course]
        if k >= 0:
            w[drives + course] += A[answer + k] * w[plan[COURSE] + 3 * course + 1]
    for k in range(plan[COORDINATES]):
        if plan[plan[FREED] + k] != 0:
            m.u[k] += A[answer + k]
    for r in range(m.pivots[KEPT]):
        course = m.acts[plan[plan[CUT_OF] + plan[plan[ROW_OF] + r]], COURSE_AT]
        if course >= 0:
            w[drives + course] += A[plan[REACTION] + r] * w[plan[COURSE] + 3 * course + 1]


@njit(**OPTIONS)
def _forces(m, t, A, count, slips):
    """Accelerations without contacts, and forces of the resting contacts, with the friction of the joints' reactions;
    returns as :func:`_press`, -2: singular."""
    apart()
    plan, w, again, missed, turn = m.plan, m.w, 0, math.inf, 0
    while missed > 1.0 and turn < _TURNS:
        copy(m.multipliers, shifted(w, plan[LAST_R]), plan[REACTIONS])
        if not mend(m, t, A, 1):
            return -2
        rigid_friction.exchange_reactions(m)
        if plan[HOLDS] < plan[DRIVES] and not _response_matrix(m, A, count + slips):
            return -2
        again = _press(m, t, count, slips)
        if again == 0 and rigid_friction.joints_rub(m):
            _respond(m, A, count + slips, vector(m, FORCES))
        rigid_friction.exchange_reactions(m)
        if again != 0:
            return again
        missed = rigid_friction.update_joint_reactions(m, A)
        turn += 1
    return again


@njit(**OPTIONS)
def _press(m, t, count, slips):
    """Forces of the resting contacts; returns the number of those that separate too slowly to bounce, and stay; -1: no
    solution."""
    apart()
    w, W, rows = m.w, m.plan[COMPLEMENT], count + slips
    new, p, f, sticks = vector(m, NEW), vector(m, IMPULSES), vector(m, FORCES), vector(m, STICKS)
    for i in range(count):
        w[vector(m, WANTED) + i] = w[meet(m, m.pivots[listed(m) + i]) + GAP_ACCEL]
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
            n, v = m.pivots[listed(m) + i], abs(w[new + i])
            noise = NOISE * (abs(w[vector(m, OLD) + i]) + moved(m, i, p, rows)[1])
            pressing = abs(w[W + (rows + 1) * i]) * w[f + i]
            if w[vector(m, ACCELERATIONS) + i] <= 10.0 * NOISE * motion_size(m, n, 1):  # or others keep it closed
                pressing = larger(pressing, -w[vector(m, WANTED) + i])
            low = math.sqrt(2.0 * LEAST_HEIGHT * near(m, n, t, v) * pressing)
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
    plan, w, t, works = m.plan, m.w, state[0], works_at(m)
    for k in range(plan[WORKS]):
        state[works + k] += w[plan[POWER] + k]
    w[plan[TOUCH] + RESTED] = 0.0
    for i in range(count):
        n = m.pivots[listed(m) + i]
        k, work = at(m, n), works + plan[WORKS] - contacts(m) + n
        old, new, p = w[vector(m, OLD) + i], w[vector(m, NEW) + i], w[vector(m, IMPULSES) + i]
        f, rested = w[vector(m, FORCES) + i], w[vector(m, RESTED_BEFORE) + i] != 0.0
        size = motion_size(m, n, 1) + abs(w[vector(m, WANTED) + i])
        mass = 1.0 / (abs(w[plan[COMPLEMENT] + (count + slips + 1) * i]) + 1e-300)
        nothing = 1e-10 * size * mass
        held = abs(w[vector(m, ACCELERATIONS) + i]) <= 10.0 * NOISE * size and (rested or old < 0.0 or p > 0.0)
        resting = w[vector(m, STICKS) + i] != 0.0 and w[k + DUE] != LETS_GO and abs(new) <= w[vector(m, QUIET) + i]
        resting = resting and (f > nothing or held)
        if not rested and (resting or p > 0.0):
            begin(m, n, t, larger(-old, 0.0), state[work])
        w[k + IMPULSE] += p
        state[work] -= 0.5 * p * (old + new)
        w[k + ALLOWED], w[k + RESISTING_MASS] = 1e-10 * f + nothing, mass
        w[k + GAP_RATE], w[k + DUE] = new, 0.0
        if resting:
            w[k + MODE] = CLOSED
        elif rested or p > 0.0:
            part(m, n, t, state[work])
        if resting != (w[k + SHUT] != 0.0):
            w[plan[TOUCH] + RESTED] = 1.0
    rigid_friction.settle(m, state, count, slips)
