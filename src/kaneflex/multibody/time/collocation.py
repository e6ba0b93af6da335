"""Compiled integration of a tree of bodies with closed loops, by three-stage collocation.

The unknowns of a simplified Newton iteration are the accelerations of the stages. With A = T diag(mu) T^-1 of the
method, the equations of three stages decouple into a real and a complex one of a single stage,

    (M + h mu C + h^2 mu^2 K) x = r        (Hairer & Wanner 1996, IV.8, for second-order equations),

where C and K contain shapes and springs at joints: they are constant and local, and include all stiff terms. Therefore
one factorisation serves the whole step, gyroscopic and geometric terms are left to the iteration, and no derivatives
are needed. Radau IIA (order 5, last stage at the end of the step, unresolved vibrations decay) and Gauss (order 6, no
numerical damping) are two tables of the same loop.

The step size control uses the defect of the collocation polynomial at the start of the step: M a - f for the
polynomial's acceleration there, as a displacement e = h^2 (M + h mu C + h^2 mu^2 K)^-1 (defect). For a resolved
vibration w it is (w h)^5/60 of the amplitude, twice the accumulated error of ten periods, since the error of a step is
(w h)^6/7200; for an unresolved one it is several times the amplitude.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.multibody.model.codes import (
    CASCADE, DAMPED, DONE, NO_CONVERGENCE, PARADOX, PAUSED, RESTED, SINGULAR, STRAYED, TOO_SMALL, TURNED,
)  # fmt: skip
from kaneflex.multibody.compile.values import copy, width
from kaneflex.multibody.dynamics import change_points, load_derivatives
from kaneflex.multibody.time import event_location, stage_residuals
from kaneflex.multibody.unilateral import active_set, factors, step_rows
from kaneflex.multibody.dynamics.loop_factors import factorise_closed, solve_closed
from kaneflex.multibody.compile.types import ENTRY, OPTIONS, basis, larger, no_inline, shifted, smaller
from kaneflex.multibody.dynamics.loop_condition import ill_conditioned
from kaneflex.multibody.dynamics.loop_closure import (
    NEAR, close, correct_accelerations, follow, follow_on, is_near_change_point,
)  # fmt: skip
from kaneflex.multibody.dynamics.powers import losses
from kaneflex.multibody.time.state_record import row_size, works_at, write_row
from kaneflex.multibody.model.layout import (
    ACCEL_SCALE, ACTS, BY_FORCES, COLUMNS, CONTACTS, COORDINATES, COURSE, COURSE_AT, CUTS, DRIVES, FREED, FRICTIONS,
    KEPT, LAST_A, LAST_R, LOADS, PAIR_PIVOTS, PIVOTS, PRESCRIBED, RATE_SCALE, REACTION, REACTIONS, ROW_AT, SCALE,
    SLOPED, SLOPE_PAIR_PIVOTS, SLOPE_PIVOTS, SPRINGS, STAGE_A, STAGE_C, STAGE_P, STAGE_R, VIRTUAL, WORKS, YIELDING,
)  # fmt: skip
from kaneflex.multibody.dynamics.courses import courses, prescribe
from kaneflex.multibody.dynamics.inverse_dynamics import demand
from kaneflex.multibody.dynamics.tree import assemble, resist

_NEAR, _CLOSE = 1e-3, 1e-5
"""Residual of a step's equations in tolerances. The smaller one is for Gauss, whose energy error depends on it, for
friction and contacts, whose powers in the stages are balanced, and for repeated steps, which are compared."""
_SLOW = 0.3
"""Contraction of Newton's iteration above which residuals in space are taken as accelerations from then on."""
_OF_ACCELERATIONS = 1e-2
"""Weight of changes of accelerations, in tolerances, if these are bounded: their errors at the end of a short step
would remain in all attempts at the next one."""
_FAR = 100.0
"""Steps, in lengths of the last one, up to which its polynomial is extrapolated."""


@njit(**OPTIONS)
def _first_guess(m, table, h, length, state):
    """Initial stages from the last step's polynomial, or constant if it does not apply."""
    no_inline()
    plan, w, c = m.plan, m.w, table.nodes
    n, r, length = plan[COORDINATES], plan[REACTIONS], length if _FAR * length > h else 0.0
    for i in range(3):
        x = 1.0 + c[i] * h / length if length > 0.0 else 0.0
        w_0, w_1, w_2 = basis(c, x, 0), basis(c, x, 1), basis(c, x, 2)
        for k in range(n):
            j, into = plan[LAST_A] + k, plan[STAGE_A] + n * i + k
            w[into] = w_0 * w[j] + w_1 * w[j + n] + w_2 * w[j + 2 * n] if length > 0.0 else state[1 + 2 * n + k]
        for k in range(r):
            j, into = plan[LAST_R] + k, plan[STAGE_R] + r * i + k
            w[into] = w_0 * w[j] + w_1 * w[j + r] + w_2 * w[j + 2 * r] if length > 0.0 else state[1 + 3 * n + k]


@njit(**OPTIONS)
def _factors(m, table, t, h, state, A, B, sloped):
    """Factors at the middle of the step, so that the mass matrix is accurate everywhere in it. False at a singular
    state.

    ``sloped``: include derivatives of loads and springs, see :mod:`kaneflex.multibody.dynamics.load_derivatives`.
    """
    no_inline()
    plan = m.plan
    n, step = plan[COORDINATES], h * change_points.begin(m, t, h)
    for k in range(n):
        m.y[k] = state[1 + k] + step * (state[1 + n + k] + 0.5 * step * state[1 + 2 * n + k])
    prescribe(m, t + step)
    if not close(m, NEAR):
        return False
    step_rows.collect_rows(m, h, state)
    m.pivots[SLOPED] = 0
    if sloped:
        load_derivatives.find(m, t + 0.5 * h, h, state)
    assemble(m)
    one, two = h * table.real[0], h * table.pair[0]
    if not (factorise_closed(m, one, A, plan[PIVOTS]) and factorise_closed(m, two, B, plan[PAIR_PIVOTS])):
        return False
    if not sloped:
        return True
    found = load_derivatives.factorise(m, one, A, plan[PIVOTS], plan[SLOPE_PIVOTS])
    return found and load_derivatives.factorise(m, two, B, plan[PAIR_PIVOTS], plan[SLOPE_PAIR_PIVOTS])


@njit(**OPTIONS)
def _slopes_needed(m, table, t, h, state, A, B):
    """Derivatives of loads and springs that Newton's iteration needs, see ``load_derivatives.needed_slopes``."""
    if m.plan[LOADS] == m.plan[CONTACTS] or not _factors(m, table, t, h, state, A, B, True):
        return 0.0
    return load_derivatives.needed_slopes(m, h * table.real[0], A)


@njit(**OPTIONS)
def _stage(m, table, t, h, i, state):
    """Kinematics and residual of stage i; False if a loop does not close."""
    no_inline()
    plan, w, c = m.plan, m.w, table.nodes[i]
    n, r, a_1, a_2, of = plan[COORDINATES], plan[REACTIONS], table.a_1, table.a_2, plan[STAGE_A]
    for k in range(n):
        a, b, d = w[of + k], w[of + n + k], w[of + 2 * n + k]
        v_0, j = state[1 + n + k], 3 * i
        m.u[k] = v_0 + h * (a_1[j] * a + a_1[j + 1] * b + a_1[j + 2] * d)
        m.y[k] = state[1 + k] + h * (c * v_0 + h * (a_2[j] * a + a_2[j + 1] * b + a_2[j + 2] * d))
    copy(shifted(w, of + n * i), m.du, n)
    copy(shifted(w, plan[STAGE_R] + r * i), m.multipliers, r)
    if not follow_on(m, t + c * h, NEAR):
        return False
    demand(m, t + c * h)
    if not change_points.project(m, t + c * h, i):
        return False
    copy(m.du, shifted(w, of + n * i), n)
    count = courses(m)
    for k in range(count):
        w[plan[STAGE_C] + count * i + k] = w[plan[COURSE] + 3 * k + 1]
    event_location.monitor(m, t + c * h, i + 1)
    step_rows.store_stage(m, i)
    return True


@njit(**OPTIONS)
def _drive(m, i, course, force):
    """Power of a prescribed drive in stage i."""
    plan = m.plan
    first = plan[STAGE_P] + plan[WORKS] * i + 1 + plan[SPRINGS] - plan[LOADS]
    m.w[first + course] = force * m.w[plan[STAGE_C] + courses(m) * i + course]


@njit(**OPTIONS)
def _improve(m, table, h, A, B):
    """One Newton iteration of the stages; returns the largest change, as a displacement in tolerances.

    The drives' powers are updated, since their forces are part of the solution.
    """
    no_inline()
    plan, w = m.plan, m.w
    n, count = plan[COORDINATES], plan[KEPT]
    answer = plan[COLUMNS] + count * n
    stage_residuals.fill_right_hand_sides(m, table, h, A, B)
    step_rows.prescribe_in_stages(m, table.into, A, B)
    solve_closed(m, A, plan[PIVOTS])
    solve_closed(m, B, plan[PAIR_PIVOTS])
    if m.pivots[SLOPED]:
        load_derivatives.correct(m, h * table.real[0], A, plan[SLOPE_PIVOTS])
        load_derivatives.correct(m, h * table.pair[0], B, plan[SLOPE_PAIR_PIVOTS])
    stage_residuals.complete_solution(m, A)
    stage_residuals.complete_solution(m, B)
    change = 0.0
    for i in range(3):
        one, two = table.out[i].real, 2.0 * table.out[3 + i]
        for course in range(courses(m)):
            k = plan[plan[PRESCRIBED] + course]
            if k >= 0:
                _drive(m, i, course, one * A[answer + k] + (two * B[answer + k]).real)
        for k in range(n):
            if plan[plan[FREED] + k] != 0:
                d = one * A[answer + k] + (two * B[answer + k]).real
                w[plan[STAGE_A] + n * i + k] += d
                change = larger(change, h * h * abs(d) / w[plan[SCALE] + k])
                change = larger(change, _OF_ACCELERATIONS * abs(d) / w[plan[ACCEL_SCALE] + k])
        for r in range(count + m.pivots[YIELDING]):
            row = factors.reaction_of(m, r)
            if row >= 0:
                d = one * A[plan[REACTION] + r] + (two * B[plan[REACTION] + r]).real
                w[plan[STAGE_R] + plan[REACTIONS] * i + row] += d
        if m.pivots[YIELDING]:
            gaps = step_rows.change_of_gaps(m, h, table.real[0], table.pair[0], one, two, A, B)
            change = larger(change, gaps)
        for cut in range(plan[CUTS], plan[DRIVES]):
            if m.acts[cut, COURSE_AT] >= 0:
                force = w[plan[STAGE_R] + plan[REACTIONS] * i + m.acts[cut, ROW_AT]]
                _drive(m, i, m.acts[cut, COURSE_AT], force)
    return change


@njit(**OPTIONS)
def _iterate(m, table, t, h, state, replayed, counts, A, B):
    """Solve the stage equations; return True if converged."""
    no_inline()
    before, plan = 0.0, m.plan
    touches = plan[FRICTIONS] < plan[DRIVES] or plan[CONTACTS] < plan[ACTS]
    bounded = m.w[plan[ACCEL_SCALE]] < 1e300
    rounded = 1.0 if replayed else _OF_ACCELERATIONS if bounded else 0.0  # a change that may be rounding
    enough = _CLOSE if replayed or touches or table.ends[0] == 0.0 else _NEAR
    for iteration in range(30 if replayed else 10):
        counts[2] += 1
        for i in range(3):
            if not (_stage(m, table, t, h, i, state) and stage_residuals.store_residual(m, i, iteration == 0)):
                return False
            if iteration > 0:
                losses(m, m.plan[STAGE_P] + m.plan[WORKS] * i)
        step_rows.deflect_bristles(m, table, h, state)
        change = _improve(m, table, h, A, B)
        if not change < 1e200:
            return False
        if iteration > 0:
            rate = change / before
            if rate >= 0.5 and change < rounded:
                return True
            slow = m.pivots[BY_FORCES] and m.pivots[YIELDING] == plan[VIRTUAL]
            if rate >= (_SLOW if slow else 1.0) and change > 1e-3:
                return False
            if change * rate < enough * larger(1.0 - rate, 0.0):
                return True
            if change < 1e-6:
                return True
        before = change
    return False


@njit(**OPTIONS)
def _larger_error(error, other, power):
    """Larger of two errors, the second one raised to a power so that both scale alike with the step."""
    return larger(error, other**power) if other > 0.0 else error


@njit(**OPTIONS)
def _error(m, table, h, state, A):
    """Error of the step in tolerances: of displacements, and of speeds and accelerations if they are bounded.

    The defect at the step's start is M d, where d is the polynomial's acceleration minus that of the motion; with S = M
    + h mu C + h^2 mu^2 K, S^-1 M d = d - S^-1 (h mu C + h^2 mu^2 K) d.
    """
    no_inline()
    plan, w, c = m.plan, m.w, table.nodes
    n, of, step = plan[COORDINATES], plan[STAGE_A], h * table.real[0]
    w_0, w_1, w_2 = basis(c, 0.0, 0), basis(c, 0.0, 1), basis(c, 0.0, 2)
    for k in range(n):
        m.du[k] = w_0 * w[of + k] + w_1 * w[of + n + k] + w_2 * w[of + 2 * n + k] - state[1 + 2 * n + k]
    answer = plan[COLUMNS] + plan[KEPT] * n
    error = 1e-12
    for k in range(n):
        error = _larger_error(error, abs(m.du[k]) / w[plan[ACCEL_SCALE] + k], 5.0 / 3.0)
    resist(m, step, m.du, A, answer)
    if m.pivots[YIELDING]:
        step_rows.resist_defect(m, step, A, answer)
    if m.pivots[SLOPED]:
        load_derivatives.resist_defect(m, step, m.du, A, answer)
    factors.prescribe_nothing(m, A)
    solve_closed(m, A, plan[PIVOTS])
    if m.pivots[SLOPED]:
        load_derivatives.correct(m, step, A, plan[SLOPE_PIVOTS])
    for k in range(n):
        if plan[plan[FREED] + k] != 0:
            missed = abs(m.du[k] + A[answer + k])
            error = larger(error, 0.5 * h * h * missed / w[plan[SCALE] + k])
            error = _larger_error(error, h * missed / w[plan[RATE_SCALE] + k], 5.0 / 4.0)
    if m.pivots[YIELDING]:
        error = larger(error, 0.5 * h * h * step_rows.error_of_gaps(m, table, h, state, step, A, answer))
    return error


@njit(**OPTIONS)
def _finish(m, table, h, end, state, A):
    """Advance ``state`` to the end of the step, works included; SINGULAR, or STRAYED on another branch."""
    no_inline()
    plan, w = m.plan, m.w
    n, r, of = plan[COORDINATES], plan[REACTIONS], plan[STAGE_A]
    step_rows.note_jams(m, state[0], h * table.real[0], A)
    b_1, b_2 = table.b_1, table.b_2
    w_0, w_1, w_2 = basis(table.nodes, 1.0, 0), basis(table.nodes, 1.0, 1), basis(table.nodes, 1.0, 2)
    for k in range(n):
        a, b, d = w[of + k], w[of + n + k], w[of + 2 * n + k]
        v_0 = state[1 + n + k]
        m.u[k] = v_0 + h * (b_1[0] * a + b_1[1] * b + b_1[2] * d)
        m.y[k] = state[1 + k] + h * (v_0 + h * (b_2[0] * a + b_2[1] * b + b_2[2] * d))
        m.du[k] = w_0 * a + w_1 * b + w_2 * d
    of = plan[STAGE_R]
    for k in range(r):
        m.multipliers[k] = w_0 * w[of + k] + w_1 * w[of + r + k] + w_2 * w[of + 2 * r + k]
    step_rows.finish_bristles(m, table, h, state)
    if not follow(m, end):
        return SINGULAR
    if change_points.leaves_branch(m, table, h, state):
        return STRAYED
    change_points.end(m, end, h)
    if not step_rows.restore_stuck(m, end, h, A):
        return SINGULAR
    if not change_points.react_at_end(m, end) and table.ends[0] == 0.0 and not correct_accelerations(m, end, A, 1):
        return SINGULAR
    for i in range(3):
        for k in range(plan[WORKS]):
            state[works_at(m) + k] += h * table.b_1[i] * w[plan[STAGE_P] + plan[WORKS] * i + k]
    copy(shifted(w, plan[STAGE_A]), shifted(w, plan[LAST_A]), 3 * n)
    copy(shifted(w, plan[STAGE_R]), shifted(w, plan[LAST_R]), 3 * r)
    stage_residuals.prepare_next_step(m)
    write_row(m, end, state)
    return DONE


@njit(**ENTRY)
def integrate(m, table, control, state, given, fixed, times, count, rows, counts, ends, wide):
    """Fill rows 1, 2, ... of a table at ``times`` [s], starting from ``state``; a step ends at each of them.

    ``control``: next step; longest step; most steps to try; last row filled; ends stored; length of the last step or 0;
    1 if the dependent coordinates are fixed; derivatives of loads and springs for the factors (see
    ``load_derivatives.needed_slopes``). ``state``: a row of the table with the state before row 1, updated: t, then
    coordinates, rates, accelerations, reactions of cut joints and frictions, states of contacts and frictions, works.
    ``given``: ends [s] of the ``fixed`` steps to take, including the ``times``; none for error control. Works are time
    integrals of powers (dissipation, loads, drives, frictions, contacts). ``counts``: accepted and rejected steps,
    Newton iterations, factorisations. ``ends``: the first ``wide`` numbers of the rows at the ends of the steps taken,
    and after each change there. Returns an outcome.
    """
    A, B, size, touching = m.real, m.pair, row_size(m), event_location.has_events(m)
    trial, found = 0.0, event_location.PASSED
    if touching and not event_location.restore(m, state):
        return SINGULAR
    wanted, row, length, replayed = control[0], 0, control[5], fixed > 0
    taken, tried, stored, status = 0, 0, 0, DONE
    m.pivots[BY_FORCES] = width(m) == 6
    while row + 1 < count:
        if (tried >= control[2] and trial == 0.0) or (touching and active_set.is_record_full(m)):
            status = PAUSED
            break
        tried += 1
        t = state[0]
        if replayed:
            end = given[taken]
            h = end - t
        else:
            longest = smaller(control[1], event_location.turn_limit(m)) if touching else control[1]
            wanted = smaller(wanted, longest)
            if wanted < 1e-12 * (times[count - 1] - times[0]):
                status = TOO_SMALL
                break
            # steps of equal length up to the next instant, so that none is very short
            left = times[row + 1] - t
            h = left / math.ceil(left / wanted * (1.0 - 1e-9))
            end = times[row + 1] if h >= left * (1.0 - 1e-9) else t + h
            if touching:
                trial_or_aim = trial if trial > 0.0 else event_location.step_to_contact(m, h)
                if trial_or_aim != h:
                    end = t + trial_or_aim
            h = end - t  # the actual length, which differs by rounding for short steps
        _first_guess(m, table, h, length, state)
        counts[3] += 1
        solved = _factors(m, table, t, h, state, A, B, control[7] != 0.0)
        if not (solved and _iterate(m, table, t, h, state, replayed, counts, A, B)):
            if m.pivots[BY_FORCES] and m.pivots[YIELDING] == m.plan[VIRTUAL]:
                m.pivots[BY_FORCES] = 0
                continue
            needed = _slopes_needed(m, table, t, h, state, A, B) if control[7] < DAMPED else 0.0
            if needed > control[7]:
                control[7] = needed
                counts[1] += 1
                if needed == DAMPED and table.ends[0] == 0.0:
                    status = PAUSED  # overdamped modes oscillate with Gauss and decay with Radau
                    break
                continue
            if replayed:
                status = NO_CONVERGENCE
                break
            counts[1] += 1
            wanted, length, trial = 0.4 * h, 0.0, 0.0
            continue
        if not replayed:
            error = _error(m, table, h, state, A)
            growth = smaller(3.0, larger(0.2, 0.9 * error ** (-0.2)))
            if not error <= 1.0:
                counts[1] += 1
                wanted, length, trial = h * smaller(growth, 0.9), 0.0, 0.0
                continue
            wanted = larger(wanted, h * growth) if growth >= 1.0 else h * growth
        if touching:
            found = event_location.find_change(m, table, t, h, state, trial > 0.0)
            trial = event_location.next_trial(m, found)
            counts[1] += found >= event_location.AT_ONCE
            if found == event_location.ASTRAY:
                wanted, length = 0.4 * h, 0.0
            if found >= event_location.AGAIN:
                continue
        at_once = found == event_location.AT_ONCE
        finished = DONE if at_once else _finish(m, table, h, end, state, A)
        if finished == STRAYED and not replayed:
            counts[1] += 1
            wanted, length, trial = 0.4 * h, 0.0, 0.0
            continue
        solved = event_location.restore(m, state) if at_once else finished == DONE
        if not at_once:
            counts[0] += 1
            copy(state, shifted(ends, wide * stored), wide)
            length, taken, stored = h, taken + 1, stored + 1
        if touching and solved:
            wanted = event_location.next_step(m, table, h, state, A, wanted, found)
            if found != event_location.PASSED:
                copy(state, shifted(ends, wide * stored), wide)
                length, stored = 0.0, stored + 1
        if not solved or wanted <= 0.0:
            status = CASCADE if solved and wanted == 0.0 else PARADOX if wanted == -2.0 else SINGULAR
            break
        if state[0] == times[row + 1]:
            row += 1
            copy(state, shifted(rows, row * size), size)
        if touching and event_location.rest_changed(m):
            status = RESTED
            break
        if control[6] == 0.0 and not is_near_change_point(m, state[0]) and ill_conditioned(m):
            status = TURNED
            break
    control[0], control[3], control[4], control[5] = wanted, row, stored, length
    return status
