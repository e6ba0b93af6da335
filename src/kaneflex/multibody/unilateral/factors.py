"""Unilateral and frictional rows in the factors of a step or an instant, beside the rows of cut joints.

A closed contact, and slipping friction with a slope, have the compliance of their law. Sticking friction is rigid. The
row of bristles is their law. The factors also contain the friction forces caused by the reactions.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.generated import friction as laws
from kaneflex.multibody.compile.stand_ins import if_frictions, if_modes
from kaneflex.multibody.compile.types import OPTIONS, larger, no_inline, shifted, smaller
from kaneflex.multibody.compile.values import copy, width
from kaneflex.multibody.dynamics import dense_lu
from kaneflex.multibody.dynamics.algebra import dot
from kaneflex.multibody.dynamics.cut_rows import left_out
from kaneflex.multibody.dynamics.wrenches import row_wrench
from kaneflex.multibody.model.codes import NOTHING
from kaneflex.multibody.model.layout import (
    ACROSS, ALONG, BENDING, BOUNCE, BY_PRESS, BY_SPEED, COORDINATES, CUT_OF, DECIDES, FACTOR_ROWS, FLOWING, FORCE,
    GAP_ACCEL, KEPT, LIMIT, MEMORY, MODE, MODE_SIZE, REACTION, REACTIONS, RESISTING_MASS, ROW_AT, ROW_OF, SCHUR, SLIP,
    SLIPPING, SLIP_RATE, STICKING, STIFF, TURN, VIRTUAL, VISCOUS, WANTED, WHAT, YIELDING,
)  # fmt: skip
from kaneflex.multibody.unilateral import lugre
from kaneflex.multibody.unilateral.frictions import (
    bearing_forces, dry, fill_friction, joint_wrench, normal_force, sliding_size,
)  # fmt: skip
from kaneflex.multibody.unilateral.relative_rows import fill_row
from kaneflex.multibody.unilateral.rows import (
    ARM, END_AT, OF_AT, VISCOUS_AT, act_of, at, contact_of, contacts, frictions, in_impact, is_idle, is_rigid,
    is_second, law_at, magnitude, row_at, slip_sign,
)  # fmt: skip

_SOFT = 1e-9
"""Additional compliance of a sticking row, as a share of its own, at the largest force limit."""
_SOFTEST = 1e3
"""Factor on it at a small force limit."""
_DISTRIBUTED = 1e-7
"""Compliance of a rigid contact, as a share of its response without friction: rounding errors of redundant forces are
those of speeds, divided by it."""


@njit(**OPTIONS)
def virtual_coordinate(m, r):
    """Coordinate whose virtual inertia a row of the factors removes; -1 for rows of cuts, contacts and frictions."""
    plan = m.plan
    return m.pivots[plan[FACTOR_ROWS] + r - plan[KEPT]] if plan[KEPT] <= r < plan[KEPT] + plan[VIRTUAL] else -1


@njit(**OPTIONS)
def row_in(m, r):
    """Contact or friction of a factors' row after those of cut joints and of virtual inertia."""
    return m.pivots[m.plan[FACTOR_ROWS] + r - m.plan[KEPT]]


@njit(**OPTIONS)
def reaction_of(m, r):
    """Index of the reaction of a factors' row: of a cut joint, a friction or a rigid contact; -1 for others."""
    if r < m.plan[KEPT]:
        return m.plan[m.plan[ROW_OF] + r]
    n = row_in(m, r)
    return row_at(m, n) if virtual_coordinate(m, r) < 0 and (n < 0 or is_rigid(m, n)) else -1


@njit(**OPTIONS)
def memory_place(m, n):
    """Place of MEMORY in a row of the integration."""
    plan = m.plan
    return 2 + 3 * plan[COORDINATES] + plan[REACTIONS] + MODE_SIZE * (n + frictions(m))


@njit(**OPTIONS)
def use_rows_now(m):
    """Set the rows of the factors at an instant: of virtual inertia, of sticking friction, and of rigid contacts at
    rest that are no kept rows."""
    m.pivots[YIELDING] = m.plan[VIRTUAL] + _rows_now(m)


@if_modes(0)
@njit(**OPTIONS)
def _rows_now(m):
    """Add sticking friction and such contacts to the rows; returns their number."""
    no_inline()
    found = 0
    for n in range(-frictions(m), contacts(m)):
        w, k = m.w, at(m, n)
        if left_out(m, n) if n >= 0 else (w[k + MODE] == STICKING or w[k + MODE] == BENDING) and not is_idle(m, n):
            m.pivots[m.plan[FACTOR_ROWS] + m.plan[VIRTUAL] + found] = n
            found += 1
            w[k + VISCOUS] = 0.0
        if n < 0 and w[k + MODE] == BENDING:
            lugre.linearise(w, k, law_at(m, n), normal_force(m, n), w[k + SLIP], w[k + MEMORY], 0.0)
    return found


@if_frictions(0)
@njit(**OPTIONS)
def rows_of_step(m, first, h, state):
    """Add frictions to the rows of a step's factors, halfway through the step from ``state``, after ``first`` others;
    returns their number."""
    no_inline()
    plan, w, found = m.plan, m.w, 0
    copy(shifted(state, 1 + 3 * plan[COORDINATES]), m.multipliers, plan[REACTIONS])
    for n in range(-frictions(m), 0):
        if contact_of(m, n) >= 0:
            fill_row(m, contact_of(m, n))
        fill_friction(m, n)
    for n in range(-frictions(m), 0):
        k, j = at(m, n), law_at(m, n)
        mode, w[k + VISCOUS] = w[k + MODE], 0.0
        if mode == BENDING:
            lugre.linearise(w, k, j, normal_force(m, n), w[k + SLIP], state[memory_place(m, n)], 0.5 * h)
        elif mode == FLOWING:
            w[k + VISCOUS] = w[j + VISCOUS_AT] + _turning(m, n)
        elif mode == SLIPPING:
            v = magnitude(m, n, SLIP)
            w[k + VISCOUS] = larger(w[j + VISCOUS_AT] + laws.dry_slope(w, j, normal_force(m, n), v), 0.0)
        if mode == STICKING or mode == BENDING or w[k + VISCOUS] > 0.0:
            m.pivots[plan[FACTOR_ROWS] + first + found] = n
            found += 1
    return found


@njit(**OPTIONS)
def _turning(m, n):
    """Derivative of a slipping friction's force across its slip by the speed across it; 0 for other rows."""
    along = int(m.w[law_at(m, n) + 1])
    if m.acts[act_of(m, n), WHAT] != ACROSS or m.w[at(m, along) + MODE] != SLIPPING:
        return 0.0
    dry = laws.dry(m.w, law_at(m, n), normal_force(m, n), magnitude(m, along, SLIP))
    return dry / sliding_size(m, along)


@if_frictions(0.0)
@njit(**OPTIONS)
def largest_limit(m, rows, A):
    """Largest force limit of sticking rows of the factors, as its square times the row's response to a unit force."""
    largest = 0.0
    for r in range(m.plan[KEPT] + m.plan[VIRTUAL], rows):
        n = row_in(m, r)
        if n < 0 and m.w[at(m, n) + MODE] == STICKING:
            largest = larger(largest, m.w[at(m, n) + LIMIT] ** 2 * abs(A[m.plan[SCHUR] + (rows + 1) * r]))
    return largest


@njit(**OPTIONS)
def is_across_slip(m, n):
    """True for the row across the slip of a friction in a tangent plane that slips."""
    return n < 0 and is_second(m, n) and m.w[at(m, int(m.w[law_at(m, n) + 1])) + MODE] == SLIPPING


@njit(**OPTIONS)
def compliance(m, n, h, r, size, A, largest):
    """Compliance of row n in the factors, their r-th of ``size``; ``largest``: see :func:`largest_limit`.

    Almost zero for rigid contacts and sticking friction, and without effect after iterative refinement. For redundant
    rows it determines the distribution of force: of contacts whatever the modes of frictions, of these in proportion to
    their limits. In a tangent plane it is the same in all directions.
    """
    k, own, diagonal = at(m, n), A[m.plan[SCHUR] + (size + 1) * r], m.plan[SCHUR]
    if n >= 0 and is_rigid(m, n):
        mass = m.w[k + RESISTING_MASS]  # zero where states are read that were computed elsewhere
        return _DISTRIBUTED * (1.0 / mass if mass > 0.0 else abs(own)) + 0.0 * h
    if n >= 0 or m.w[k + VISCOUS] > 0.0:
        return 1.0 / (h * (m.w[k + VISCOUS] + h * m.w[k + STIFF]))
    if is_across_slip(m, n):
        A[m.plan[WANTED] + frictions(m) - 1 - n] = 0.0 * h
        along = int(m.w[law_at(m, n) + 1])
        return magnitude(m, along, SLIP_RATE - in_impact(m)) / m.w[at(m, along) + LIMIT] + 0.0 * h
    for q in range(m.plan[KEPT] + m.plan[VIRTUAL], size if width(m) == 6 and contact_of(m, n) >= 0 else 0):
        if row_in(m, q) == int(m.w[law_at(m, n) + 1]):
            own += A[diagonal + (size + 1) * q]
    share = math.sqrt(largest / (m.w[k + LIMIT] * m.w[k + LIMIT] * abs(own) + 1e-300))
    soft = _SOFT * own * larger(1.0, smaller(share, _SOFTEST)) + 0.0 * h
    A[m.plan[WANTED] + frictions(m) - 1 - n] = soft
    return soft


@if_frictions(None)
@njit(**OPTIONS)
def leave_out_idle(m, A, size, pivots):
    """Remove forces of sticking rows that move nothing from the reactions of ``size`` rows: rounding errors, divided by
    the compliance.

    A second solution for the displacements of this compliance contains nearly the same idle forces, and of others a
    small share only, which iterative refinement restores.
    """
    no_inline()
    plan, x, stuck = m.plan, m.plan[REACTION], False
    y = x + size
    for r in range(size):
        n, A[y + r] = row_in(m, r) if r >= plan[KEPT] + plan[VIRTUAL] else 0, 0.0 * A[x + r]
        if n < 0 and m.w[at(m, n) + MODE] == STICKING:
            A[y + r], stuck = A[plan[WANTED] + frictions(m) - 1 - n] * A[x + r], True
    if not stuck:
        return
    dense_lu.substitute(A, plan[SCHUR], size, m.pivots, pivots, y)
    for r in range(size):
        A[x + r] -= A[y + r]


@if_frictions(False)
@njit(**OPTIONS)
def use_force_law(m, n, r, size, h, A):
    """Replace a bristle's row of the factors by its force law; True if the row is one.

    dF + h slope (row) - (normal force) = missing force, where a contact's row is by its compliance: in uniform sliding
    the compliance is infinite.
    """
    plan, w, k = m.plan, m.w, at(m, n)
    if n >= 0 or w[k + MODE] != BENDING:
        return False
    firm = lugre.step_damping(w, k, law_at(m, n), h)
    d, row = h * (w[k + VISCOUS] + firm * w[k + BY_SPEED]), plan[SCHUR] + size * r
    A[plan[WANTED] + frictions(m) - 1 - n] = d
    for q in range(size):
        A[row + q] = d * A[row + q]
        if is_normal_force(m, n, q):
            A[row + q] += firm * w[k + BY_PRESS] * normal_force_by_reaction(m, n, q)
    A[row + r] += 1.0
    return True


@njit(**OPTIONS)
def right_hand_side(m, A, r, opening):
    """Right-hand side of a row of the factors: the acceleration prescribed to a sticking row less its opening; for
    bristles, whose row is a force, the missing force less the weighted opening."""
    n = row_in(m, r)
    if r < m.plan[KEPT] + m.plan[VIRTUAL] or (n >= 0 and m.pivots[DECIDES] == NOTHING):
        return -opening
    if n >= 0:
        return A[m.plan[WANTED] + 2 * frictions(m) + n] - opening
    if m.w[at(m, n) + MODE] == BENDING:
        opening *= A[m.plan[WANTED] + frictions(m) - 1 - n]
    return A[m.plan[WANTED] - 1 - n] - opening


@if_frictions(None)
@njit(**OPTIONS)
def prescribe_nothing(m, A):
    """Set prescribed accelerations of all rows to zero."""
    for n in range(frictions(m)):
        A[m.plan[WANTED] + n] = 0.0 * A[0]


@if_modes(None)
@njit(**OPTIONS)
def prescribe_now(m, A):
    """Prescribe zero acceleration to sticking friction and closed rigid contacts at the current state, for impulses a
    change of speed; to bristles their force law."""
    w, rate = m.w, GAP_ACCEL - in_impact(m)
    for n in range(-frictions(m), contacts(m) if m.pivots[DECIDES] != NOTHING else 0):
        k = at(m, n)
        if n >= 0:
            A[m.plan[WANTED] + 2 * frictions(m) + n] = in_impact(m) * w[k + BOUNCE] - w[k + rate]
            continue
        A[m.plan[WANTED] - 1 - n] = -w[k + rate] if w[k + MODE] == STICKING else 0.0
        if w[k + MODE] == BENDING:
            A[m.plan[WANTED] - 1 - n] = lugre.force_now(w, k, law_at(m, n)) - w[k + FORCE]


@if_frictions(0)
@njit(**OPTIONS)
def friction_by_reaction(m, r):
    """Slipping friction whose force depends on the reaction of a factors' row; 0: none."""
    no_inline()
    for n in range(-frictions(m), 0):
        if m.w[at(m, n) + MODE] == SLIPPING and is_normal_force(m, n, r):
            return n
    return 0


@njit(**OPTIONS)
def is_normal_force(m, n, r):
    """True if the reaction of a factors' row is the normal force of a friction, or a part of it."""
    plan, of = m.plan, int(m.w[law_at(m, n) + OF_AT])
    if r >= plan[KEPT]:
        return virtual_coordinate(m, r) < 0 and act_of(m, row_in(m, r)) == of
    row = plan[plan[ROW_OF] + r]
    return plan[plan[CUT_OF] + row] == of or m.acts[of, ROW_AT] <= row < int(m.w[law_at(m, n) + END_AT])


@if_frictions(0.0)
@njit(**OPTIONS)
def force_by_reaction(m, n, r):
    """Derivative of a slipping friction's force with respect to the reaction of a factors' row."""
    v = magnitude(m, n, SLIP)
    by_normal = dry(m, n, 1.0, v) - dry(m, n, 0.0, v)
    return -slip_sign(m, n) * by_normal * normal_force_by_reaction(m, n, r)


@njit(**OPTIONS)
def normal_force_by_reaction(m, n, r):
    """Derivative of a friction's normal force with respect to the reaction of a factors' row."""
    no_inline()
    plan, what = m.plan, m.acts[act_of(m, n), WHAT]
    if r >= plan[KEPT] or what >= ALONG:
        return 1.0
    row = plan[plan[ROW_OF] + r]
    one, two = bearing_forces(m, n, joint_wrench(m, n))
    one_by, two_by = bearing_forces(m, n, row_wrench(m, row, 1))
    total = dot(one, one_by) / larger(math.sqrt(dot(one, one)), 1e-300)
    total += dot(two, two_by) / larger(math.sqrt(dot(two, two)), 1e-300)
    return m.w[law_at(m, n) + ARM] * total if what == TURN else total
