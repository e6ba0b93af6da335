"""Unilateral and frictional rows in a step: their share of its Newton matrix, of its stages and of its error estimate.

A contact has the stiffness and damping of its law in the middle of the step; its gap may be wrong by a share of its
depth.
"""

from __future__ import annotations

from numba import njit

from kaneflex.generated import contact as touching
from kaneflex.multibody.compile.stand_ins import if_contacts, if_frictions
from kaneflex.multibody.compile.values import width
from kaneflex.multibody.dynamics import dense_lu
from kaneflex.multibody.dynamics.arrays import PHI
from kaneflex.multibody.dynamics.courses import leave_out
from kaneflex.multibody.dynamics.cut_rows import left_out
from kaneflex.multibody.dynamics.interactions import gradient
from kaneflex.multibody.dynamics.kinematics import move
from kaneflex.multibody.dynamics.loop_closure import factorise_now, follow, rows_of_frictions
from kaneflex.multibody.dynamics.loop_factors import solve_closed
from kaneflex.multibody.compile.types import OPTIONS, larger, no_inline, shifted
from kaneflex.multibody.model.layout import (
    ALLOWED, ALONG, BENDING, BY_FORCES, BY_SPEED, CLOSED, COLUMNS, COORDINATES, DRIVES, FACTOR_ROWS, FIRMEST, FORCE,
    FRICTIONS, GAP, GAP_RATE, JAMS, KEPT, LAW, MEMORY, MODE, NODES, PIVOTS, PLACE, PRECISION, REACTION, REACTIONS,
    SCHUR, SHARED, SLIP, SLIP_RATE, STAGE_F, STAGE_R, STICKING, STIFF, TOUCH, VIRTUAL, VISCOUS, WANTED, WHAT, YIELDING,
)  # fmt: skip
from kaneflex.multibody.unilateral import lugre
from kaneflex.multibody.unilateral.factors import is_normal_force, memory_place, prescribe_nothing, row_in, rows_of_step
from kaneflex.multibody.unilateral.frictions import size_of
from kaneflex.multibody.unilateral.relative_rows import fill_contact, row_scale
from kaneflex.multibody.unilateral.rows import EPS, act_of, at, contacts, frictions, is_rigid, law_at, product, row_at

_NO_JAM = 1e-9
"""Share of a contact's compliance that counts as rounding."""


@njit(**OPTIONS)
def gradient_at(m, n):
    """Place of the gradient of a row, those of frictions last."""
    return m.plan[TOUCH] + SHARED + m.plan[COORDINATES] * (n if n >= 0 else contacts(m) - 1 - n)


@njit(**OPTIONS)
def along(m, n):
    """Derivatives of a row's value by all but prescribed coordinates; returns their place.

    Its row by the twists of its sections is known.
    """
    no_inline()
    out = gradient_at(m, n)
    for i in range(m.plan[COORDINATES]):
        m.w[out + i] = 0.0
    gradient(m, row_at(m, n), m.counts[PHI] > 0, out)
    leave_out(m, out)
    return out


@njit(**OPTIONS)
def effective_mass(m, n, A):
    """Force along a row per acceleration of its value, by the factors of this instant."""
    no_inline()
    plan, g = m.plan, along(m, n)
    answer = plan[COLUMNS] + plan[COORDINATES] * plan[KEPT]
    for i in range(plan[COORDINATES]):
        A[answer + i] = m.w[g + i]
    prescribe_nothing(m, A)
    solve_closed(m, A, plan[PIVOTS])
    return 1.0 / larger(abs(product(m.w, g, shifted(A, answer), plan[COORDINATES])), 1e-200)


@if_contacts(None)
@njit(**OPTIONS)
def collect_rows(m, h, state):
    """Collect closed contacts, by their slopes in the middle of the step, and frictions for the factors; positions are
    those there."""
    no_inline()
    plan, w, size, first = m.plan, m.w, m.plan[COORDINATES], m.plan[VIRTUAL]
    count = first
    for n in range(contacts(m)):
        if left_out(m, n) or (w[at(m, n) + MODE] == CLOSED and not is_rigid(m, n)):
            m.pivots[plan[FACTOR_ROWS] + count] = n
            count += 1
    m.pivots[YIELDING] = count
    if count == first and plan[FRICTIONS] == plan[DRIVES]:
        return
    for i in range(size):
        m.u[i] = state[1 + size + i] + 0.5 * h * state[1 + 2 * size + i]
    move(m, 0)
    for r in range(first, count):
        n = m.pivots[plan[FACTOR_ROWS] + r]
        k, law = fill_contact(m, n), m.acts[act_of(m, n), LAW]
        if is_rigid(m, n):
            continue
        by_gap, by_rate = touching.normal_slopes(law, w, law_at(m, n), w[k + MEMORY], w[k + GAP], w[k + GAP_RATE])
        w[k + STIFF], w[k + VISCOUS] = larger(-by_gap, 1e-200), larger(-by_rate, 0.0)
    more = rows_of_step(m, count, h, state)
    m.pivots[YIELDING] = count + more
    if count + more > first:
        m.pivots[BY_FORCES] = width(m) == 6
    for r in range(first, count + more):
        along(m, m.pivots[plan[FACTOR_ROWS] + r])


@if_frictions(None)
@njit(**OPTIONS)
def note_jams(m, t, step, A):
    """Record the first time at which friction jams a contact, by the factors of a step that is taken.

    A separating force with its friction then brings the sides closer: rigid sides would have no consistent force, or
    several (Painleve's paradox); these are compliant.
    """
    no_inline()
    plan, w, x = m.plan, m.w, m.plan[REACTION]
    count = plan[KEPT] + m.pivots[YIELDING]
    for r in range(plan[KEPT] + plan[VIRTUAL], count):
        c = row_in(m, r)
        for n in range(-frictions(m) if c >= 0 and not is_rigid(m, c) else 0, 0):
            since = at(m, n) + JAMS
            if w[since] == w[since] or not is_normal_force(m, n, r):
                continue
            for q in range(count):
                A[x + q] = 0.0
            A[x + r] = 1.0
            dense_lu.substitute(A, plan[SCHUR], count, m.pivots, plan[PIVOTS], x)
            soft = 1.0 / (step * (w[at(m, c) + VISCOUS] + step * w[at(m, c) + STIFF]))
            if 1.0 / A[x + r] < (1.0 - _NO_JAM) * soft:  # opening by a unit force, and the contact's compliance
                w[since] = t


@if_contacts(0.0)
@njit(**OPTIONS)
def change_of_gaps(m, h, real, pair, one, two, A, B):
    """Largest change of a gap by an iteration of one stage, in errors allowed."""
    no_inline()
    plan, w, largest = m.plan, m.w, 0.0
    step, steps = h * real, h * pair
    for r in range(plan[KEPT] + plan[VIRTUAL], plan[KEPT] + m.pivots[YIELDING]):
        n, x = row_in(m, r), plan[REACTION] + r
        if n < 0 or is_rigid(m, n):
            continue
        k = at(m, n)
        c, s = w[k + VISCOUS], w[k + STIFF]
        d = one * A[x] / (step * (c + step * s)) + (two * B[x] / (steps * (c + steps * s))).real
        largest = larger(largest, (h * h * abs(d) - EPS * 8.0 * row_scale(m, n)) / w[k + ALLOWED])
    return largest


@if_contacts(None)
@njit(**OPTIONS)
def resist_defect(m, step, A, answer):
    """Subtract the effect of the rows on a defect, at ACCEL, from the forces: see ``collocation._error``."""
    no_inline()
    plan, w, size = m.plan, m.w, m.plan[COORDINATES]
    for r in range(plan[VIRTUAL], m.pivots[YIELDING]):
        n = m.pivots[plan[FACTOR_ROWS] + r]
        k, g = at(m, n), gradient_at(m, n)
        slope = w[k + VISCOUS] + step * w[k + STIFF] + _bristle_slope(m, n, step)
        share = 0.0 if n >= 0 and is_rigid(m, n) else step * slope * product(w, g, m.du, size)
        for i in range(size):
            A[answer + i] -= share * w[g + i]


@if_contacts(0.0)
@njit(**OPTIONS)
def error_of_gaps(m, table, h, state, step, A, answer):
    """Largest error of a gap, and of the deflection of bristles, from the defect at ACCEL and the answer to it, as an
    acceleration in errors allowed; for bristles that is a share of the deflection before slip."""
    no_inline()
    plan, w, size, largest = m.plan, m.w, m.plan[COORDINATES], 0.0
    for r in range(plan[VIRTUAL], m.pivots[YIELDING]):
        n = m.pivots[plan[FACTOR_ROWS] + r]
        k, g = at(m, n), gradient_at(m, n)
        error = abs(product(w, g, m.du, size) + product(w, g, shifted(A, answer), size))
        if n >= 0:
            error = 0.0 if is_rigid(m, n) else error
            largest = larger(largest, (error - 16.0 * EPS * row_scale(m, n) / (h * h)) / w[k + ALLOWED])
            continue
        error -= 16.0 * EPS * size_of(m, n, 0) / h
        largest = larger(largest, _bristle_error(m, n, table, h, state, step, error))
    return largest


@if_frictions(0.0)
@njit(**OPTIONS)
def _bristle_slope(m, n, step):
    """Derivative of a force of bristles with respect to the speed, for a step; 0 for other rows."""
    k = at(m, n)
    return lugre.step_damping(m.w, k, law_at(m, n), step) * m.w[k + BY_SPEED] if m.w[k + MODE] == BENDING else 0.0


@if_frictions(0.0)
@njit(**OPTIONS)
def _bristle_error(m, n, table, h, state, step, error):
    """Error of the bristles' deflection as a share of its largest, by that of the slip's acceleration; 0 of other
    rows."""
    w, k, j = m.w, at(m, n), law_at(m, n)
    if w[k + MODE] != BENDING:
        return 0.0
    own = lugre.turn_error(table, h, step, w, k, j, state[memory_place(m, n)])
    return (error * lugre.sensitivity(w, k, j, step) + own / (0.5 * h * h)) / w[m.plan[TOUCH] + PRECISION]


@if_frictions(None)
@njit(**OPTIONS)
def store_stage(m, i):
    """Store results of frictions in a stage: accelerations of all, and forces of slipping ones."""
    no_inline()
    plan, w = m.plan, m.w
    for n in range(-frictions(m), 0):
        w[plan[STAGE_F] + frictions(m) * (i + 1) + n] = w[at(m, n) + SLIP_RATE]
        w[plan[STAGE_R] + plan[REACTIONS] * i + row_at(m, n)] = w[at(m, n) + FORCE]


@if_frictions(None)
@njit(**OPTIONS)
def prescribe_in_stages(m, into, A, B):
    """Prescribe zero accelerations of sticking friction to an iteration of the stages; for bristles the missing
    force."""
    no_inline()
    plan, w, count = m.plan, m.w, frictions(m)
    for n in range(-count, 0):
        own = plan[STAGE_F] + count + n
        a_0, a_1, a_2 = w[own], w[own + count], w[own + 2 * count]
        stuck = w[at(m, n) + MODE] == STICKING or w[at(m, n) + MODE] == BENDING
        one = -(into[0].real * a_0 + into[1].real * a_1 + into[2].real * a_2)
        two = -(into[3] * a_0 + into[4] * a_1 + into[5] * a_2)
        A[plan[WANTED] - 1 - n] = one if stuck else 0.0
        B[plan[WANTED] - 1 - n] = two if stuck else 0.0 * two


@if_frictions(None)
@njit(**OPTIONS)
def deflect_bristles(m, table, h, state):
    """Deflection of bristles in the stages of a step h; STAGE_F gets their force minus the stages'."""
    no_inline()
    plan, w = m.plan, m.w
    for n in range(-frictions(m), 0):
        k = at(m, n)
        if w[k + MODE] == BENDING:
            lugre.deflect(table, h, w, k, law_at(m, n), state[memory_place(m, n)])
            for i in range(3):
                has = w[plan[STAGE_R] + plan[REACTIONS] * i + row_at(m, n)]
                w[plan[STAGE_F] + frictions(m) * (i + 1) + n] = has - w[k + NODES + 7 + 4 * i]


@if_frictions(None)
@njit(**OPTIONS)
def finish_bristles(m, table, h, state):
    """Set the bristles' deflection at the end of a step h."""
    no_inline()
    w = m.w
    for n in range(-frictions(m), 0):
        k = at(m, n)
        if w[k + MODE] == BENDING:
            for i in range(3 if m.acts[act_of(m, n), WHAT] == ALONG else 0):
                w[k + FIRMEST] = larger(w[k + FIRMEST], w[k + NODES + 5 + 4 * i])
            w[k + MEMORY] = lugre.deflection_at_end(table, h, w, k, law_at(m, n), state[memory_place(m, n)])


@if_frictions(True)
@njit(**OPTIONS)
def restore_stuck(m, t, h, A):
    """Return sticking frictions to their positions and to zero speed, after a step of h; False: singular."""
    no_inline()
    w, off, faster = m.w, False, False
    rows_of_frictions(m)
    for n in range(-frictions(m), 0):
        k = at(m, n)
        if w[k + MODE] == STICKING:
            near = 4.0 * EPS * (abs(w[k + PLACE]) + row_scale(m, n))
            off = off or abs(w[k + PLACE] - w[k + MEMORY]) > near
            faster = faster or abs(w[k + SLIP]) * h > near
    return (not off or correct_drift(m, t, A, 0)) and (not (off or faster) or correct_drift(m, t, A, 1))


@njit(**OPTIONS)
def correct_drift(m, t, A, level):
    """Change positions, or with level 1 speeds, by the least correction that removes the drift of sticking frictions.

    The correction is the least in the norm of the mass matrix, as by an impulse.
    """
    no_inline()
    plan, w, moved = m.plan, m.w, m.u if level else m.y
    if not factorise_now(m, A):
        return False
    answer = plan[COLUMNS] + plan[KEPT] * plan[COORDINATES]
    for i in range(plan[COORDINATES]):
        A[answer + i] = 0.0
    for n in range(-frictions(m), 0):
        k = at(m, n)
        A[plan[WANTED] - 1 - n] = 0.0
        if w[k + MODE] == STICKING:
            A[plan[WANTED] - 1 - n] = -w[k + SLIP] if level else w[k + MEMORY] - w[k + PLACE]
    solve_closed(m, A, plan[PIVOTS])
    for i in range(plan[COORDINATES]):
        moved[i] += A[answer + i]
    return follow(m, t)
