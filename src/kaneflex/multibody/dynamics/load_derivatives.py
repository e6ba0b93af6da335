"""Derivatives of loads' laws and of springs between points in the Newton matrix of a step.

A load whose size depends on coordinates and speeds of joints adds to the step's matrix S = M + h C + h^2 K the term -p
(h ds/dx' + h^2 ds/dx) g^T. Here p is its partial velocity and g the gradient of the joint's coordinate. A spring adds
g (h c + h^2 k) g^T with the gradient g of its length or angle. Without these terms a light body on a damper limits the
step to its time constant m/c: Newton's iteration doesn't converge for longer ones, and S^-1, which filters the error
estimate (Hairer & Wanner 1996, IV.8), is inconsistent with the equations.

Most steps converge without them. So the terms are omitted until Newton's iteration fails in a step that they would
change by ``SMALL``; from then on the Woodbury formula adds them to the factors of ``loop_factors``. Springs at joints
of the tree and contacts are in these factors already.
"""

from __future__ import annotations  # noqa: I001, names of the tables' places stand side by side

from numba import njit

from kaneflex.multibody.model.codes import DAMPED, STIFF
from kaneflex.multibody.compile.stand_ins import if_stiffness
from kaneflex.multibody.compile.values import twists
from kaneflex.multibody.dynamics import dense_lu
from kaneflex.multibody.unilateral import factors
from kaneflex.multibody.dynamics.loop_factors import solve_closed
from kaneflex.multibody.unilateral.rows import product
from kaneflex.multibody.dynamics.courses import leave_out
from kaneflex.multibody.dynamics.kinematics import move
from kaneflex.multibody.dynamics.arrays import PHI
from kaneflex.multibody.dynamics.forces import joint_row, load_sizes
from kaneflex.multibody.dynamics.interactions import along, along_both, unit_wrench
from kaneflex.multibody.compile.types import OPTIONS, kernel, magnitude, no_inline, shifted
from kaneflex.multibody.model.layout import (
    AT, COLUMNS, CONTACTS, COORDINATES, COURSE_AT, DRIVES, EXTENT, INPUT, KEPT, LOADS, MAGNITUDES, NUMBERS_AT, PUSHED,
    PUSHES, REACTION, SLIDE, SLOPED, SLOPES, SLOPE_COLUMNS, SLOPE_FORCES, SLOPE_SQUARE, SPRINGS, SUMS, TOUCH, VARIED,
    WAYS, WHAT, WITH_SLOPES, YIELDING, X,
)  # fmt: skip

SMALL = 0.1
"""Largest relative change of a step's matrix along a load or a spring that Newton's iteration tolerates: its error
falls by that factor in each iteration."""
_NUDGE = 1e-8
"""Change of a coordinate for a difference quotient, in rad or sizes of the mechanism: the root of rounding errors."""


@njit(**OPTIONS)
def _joints(m):
    """Number of joints whose coordinates occur in laws."""
    return m.plan[LOADS] - m.plan[DRIVES]


@njit(**OPTIONS)
def _way(m, act):
    """Place of the gradient of a joint's coordinate or of a spring's length, or of a load's partial velocity."""
    return m.plan[WAYS] + m.plan[COORDINATES] * (act - m.plan[DRIVES])


@njit(**OPTIONS)
def _slope(m, act):
    """Place of a load's derivatives by coordinate and speed of each joint, or of a spring's negative k and c."""
    return m.plan[SLOPES] + 2 * (_joints(m) + 1) * (act - m.plan[LOADS])


@njit(**OPTIONS)
def _derive_sizes(m, t, h):
    """Derivatives of the loads' sizes by coordinates and speeds of joints at t, as difference quotients; 0 if a
    neighbouring value of a law is undefined."""
    no_inline()
    plan, w, count = m.plan, m.w, _joints(m)
    load_sizes(m, t)
    for j in range(count):
        unit = w[plan[TOUCH] + EXTENT] if m.acts[plan[DRIVES] + j, WHAT] == SLIDE else 1.0
        for rate in range(2):
            at = plan[X] + 2 * j + rate
            before = w[at]
            w[at] = before + _NUDGE * (unit / h if rate else unit)
            kernel(m.kernels, MAGNITUDES)(t, w, plan[X], m.p, w, plan[VARIED])
            for n in range(plan[SPRINGS] - plan[LOADS]):
                change = w[plan[VARIED] + n] + w[plan[INPUT] + n] - m.sizes[n]
                slope = change / (w[at] - before)
                w[_slope(m, plan[LOADS] + n) + 2 * j + rate] = slope if abs(slope) < 1e300 else 0.0
            w[at] = before


@njit(**OPTIONS)
def _fill_ways(m):
    """Gradients at the current position. Prescribed coordinates are excluded: only loads do work along them."""
    no_inline()
    plan, w, bends = m.plan, m.w, m.counts[PHI] > 0
    for k in range(plan[COORDINATES] * (plan[CONTACTS] - plan[DRIVES])):
        w[plan[WAYS] + k] = 0.0
    for act in range(plan[DRIVES], plan[LOADS]):
        if m.acts[act, COURSE_AT] >= 0:
            w[_way(m, act) + m.acts[act, COURSE_AT]] = 1.0
        else:
            joint_row(m, act)
            for side in range(2):
                wrench = twists(m, shifted(w, plan[SUMS] + 3))[side]
                along(m, m.acts[act, AT + side], wrench, bends, _way(m, act))
        leave_out(m, _way(m, act))
    for act in range(plan[PUSHES], plan[PUSHED]):
        along_both(m, act, unit_wrench(m, act), bends, _way(m, plan[LOADS] + m.acts[act, COURSE_AT]))
    for act in range(plan[SPRINGS], plan[CONTACTS]):
        along_both(m, act, unit_wrench(m, act), bends, _way(m, act))
        leave_out(m, _way(m, act))


@if_stiffness(None)
@njit(**OPTIONS)
def find(m, t, h, state):
    """Find all loads and springs with slopes for the factors of a step of h; t and positions are of its middle."""
    no_inline()
    plan, w, n, found = m.plan, m.w, m.plan[COORDINATES], 0
    for k in range(n):
        m.u[k] = state[1 + n + k] + 0.5 * h * state[1 + 2 * n + k]
    move(m, 0)
    _fill_ways(m)
    _derive_sizes(m, t, h)
    for act in range(plan[LOADS], plan[CONTACTS]):
        k, size = _slope(m, act), 0.0
        if act >= plan[SPRINGS]:  # those of the tree's joints are in the factors already
            of = m.acts[act, NUMBERS_AT]
            share = 0.0 if m.acts[act, COURSE_AT] >= 0 else -1.0
            w[k], w[k + 1] = share * w[of], share * w[of + 1]
        for j in range(2 if act >= plan[SPRINGS] else 2 * _joints(m)):
            size += abs(w[k + j])
        if size > 0.0:
            m.pivots[plan[WITH_SLOPES] + found] = act
            found += 1
    m.pivots[SLOPED] = found


@njit(**OPTIONS)
def _grown(m, r, h, square, values):
    """Growth of the force of the r-th load or spring: h times its slopes by speeds and h^2 (``square``) times those by
    coordinates, along a motion."""
    w, n, act, total = m.w, m.plan[COORDINATES], m.pivots[m.plan[WITH_SLOPES] + r], 0.0 * values[0]
    k = _slope(m, act)
    if act >= m.plan[SPRINGS]:
        return (h * w[k + 1] + square * w[k]) * product(w, _way(m, act), values, n)
    for j in range(_joints(m)):
        if w[k + 2 * j] != 0.0 or w[k + 2 * j + 1] != 0.0:
            moved = product(w, _way(m, m.plan[DRIVES] + j), values, n)
            total += (h * w[k + 2 * j + 1] + square * w[k + 2 * j]) * moved
    return total


@njit(**OPTIONS)
def _column(m, r):
    """Place of the response to a unit of the r-th force: coordinates, then reactions of the factors' rows."""
    return m.plan[SLOPE_COLUMNS] + (m.plan[COORDINATES] + m.plan[KEPT] + m.pivots[YIELDING]) * r


@if_stiffness(True)
@njit(**OPTIONS)
def factorise(m, h, A, pivots, own):
    """Add the slopes to the factors of ``loop_factors`` for h; False: the matrix is singular.

    ``pivots``, ``own``: places of the pivots of those factors, and of the ones made here.
    """
    no_inline()
    plan, w, n, count = m.plan, m.w, m.plan[COORDINATES], m.pivots[SLOPED]
    answer = plan[COLUMNS] + plan[KEPT] * n
    for q in range(count):
        way = _way(m, m.pivots[plan[WITH_SLOPES] + q])
        for i in range(n):
            A[answer + i] = w[way + i]
        factors.prescribe_nothing(m, A)
        solve_closed(m, A, pivots)
        for i in range(n):
            A[_column(m, q) + i] = A[answer + i]
        for r in range(plan[KEPT] + m.pivots[YIELDING]):
            A[_column(m, q) + n + r] = A[plan[REACTION] + r]
        for r in range(count):
            A[plan[SLOPE_SQUARE] + count * r + q] = -_grown(m, r, h, h * h, shifted(A, answer))
        A[plan[SLOPE_SQUARE] + (count + 1) * q] += 1.0
    return dense_lu.factorise(A, plan[SLOPE_SQUARE], count, m.pivots, own)


@if_stiffness(0.0)
@njit(**OPTIONS)
def needed_slopes(m, h, A):
    """DAMPED if Newton's iteration needs the slopes by speeds, STIFF if only those by coordinates, else 0."""
    found = 0.0
    for r in range(m.pivots[SLOPED]):
        column = shifted(A, _column(m, r))
        if magnitude(_grown(m, r, h, 0.0, column)) > SMALL:
            return DAMPED
        if magnitude(_grown(m, r, h, h * h, column)) > SMALL:
            found = STIFF
    return found


@if_stiffness(None)
@njit(**OPTIONS)
def correct(m, h, A, own):
    """Correct the solution of ``solve_closed``, reactions included, by the slopes."""
    no_inline()
    plan, n, count, x = m.plan, m.plan[COORDINATES], m.pivots[SLOPED], m.plan[SLOPE_FORCES]
    answer = plan[COLUMNS] + plan[KEPT] * n
    for r in range(count):
        A[x + r] = _grown(m, r, h, h * h, shifted(A, answer))
    dense_lu.substitute(A, plan[SLOPE_SQUARE], count, m.pivots, own, x)
    for q in range(count):
        for i in range(n):
            A[answer + i] += A[_column(m, q) + i] * A[x + q]
        for r in range(plan[KEPT] + m.pivots[YIELDING]):
            A[plan[REACTION] + r] += A[_column(m, q) + n + r] * A[x + q]


@if_stiffness(None)
@njit(**OPTIONS)
def resist_defect(m, h, defect, A, answer):
    """Add the effect of the slopes on a defect to the forces: see ``collocation._error``."""
    no_inline()
    for r in range(m.pivots[SLOPED]):
        size, way = _grown(m, r, h, h * h, defect), _way(m, m.pivots[m.plan[WITH_SLOPES] + r])
        for i in range(m.plan[COORDINATES]):
            A[answer + i] += size * m.w[way + i]
