"""Compiled evaluation of a mechanism in space at one instant: positions, forces, and accelerations."""

from __future__ import annotations

import math

from numba import njit

from kaneflex.multibody.dynamics.spatial_dynamics import KEPT_ROWS, accelerations, close, tie
from kaneflex.multibody.dynamics.spatial_forces import deforming
from kaneflex.multibody.dynamics.spatial_kinematics import accelerate, goes, stands
from kaneflex.multibody.dynamics.spatial_work import DRIVEN, LOADS, OBSERVED, ROWS, SPEEDS
from kaneflex.multibody.model.layout import COURSES, MAGNITUDES, OPTIONS, apart, kernel
from kaneflex.support.inner import once

CLOSED = 1e-7
"""Largest violation of redundant rows, in rad or sizes of the mechanism."""

DONE, OPEN, APART, MASSLESS, INFINITE, GROWN, OVERTURNED, TOO_SMALL = range(8)
"""Outcome codes of an instant or of steps; all but DONE and GROWN are failures."""
REASONS = {
    OPEN: "a loop does not close, or the position is singular",
    APART: "the loops close at the start, but not there: redundant constraints are violated",
    MASSLESS: "the mass matrix is singular: a freedom carries no inertia",
    INFINITE: "the accelerations are not finite",
    OVERTURNED: "a bushing is rotated too far",
    TOO_SMALL: "the step size tends to zero",
}
"""Messages of the failures."""


def check(outcome: int, *at: float) -> None:
    """Raise ArithmeticError for an outcome other than DONE."""
    if outcome != DONE:
        raise ArithmeticError(REASONS[outcome], *at)


@njit(**OPTIONS)
def courses(m, t):
    """Coordinate, speed and acceleration of every prescribed drive."""
    apart()
    kernel(m.kernels, COURSES)(t, m.law_p, m.course, 0)


@once
@njit(**OPTIONS)
def stand(m, c, t):
    """Prescribed drives at t, closed loops, dependent speeds, then loads; returns the outcome."""
    apart()
    courses(m, t)
    for i in range(m.counts[DRIVEN]):
        m.q[m.driven[i]] = m.course[3 * i]
        m.u[c.prescribed[i]] = m.course[3 * i + 1]
        m.du[c.prescribed[i]] = m.course[3 * i + 2] + m.added[m.counts[LOADS] + i]
    if not close(m, c):
        return OPEN
    if c.counts[KEPT_ROWS] < m.counts[ROWS]:
        for row in range(m.counts[ROWS]):
            if not abs(m.rows[5 * row][0]) <= CLOSED * c.row_measure[row]:
                return APART
    if c.counts[KEPT_ROWS]:
        tie(m, c, m.u, 1)
    for i in range(m.counts[OBSERVED]):
        at, node = m.observed[i, 0], m.observed[i, 1]
        m.law_x[at], m.law_x[at + 1] = stands(m, node, m.q), goes(m, node, m.q, m.u)
    kernel(m.kernels, MAGNITUDES)(t, m.law_x, 0, m.law_p, m.sizes, 0)
    for i in range(m.counts[LOADS]):
        m.sizes[i] += m.added[i]
    return DONE


@once
@njit(**OPTIONS)
def project(m, c, t):
    """The same with the rates of all speeds."""
    apart()
    outcome = stand(m, c, t)
    if outcome != DONE:
        return outcome
    if not accelerations(m, c):
        return MASSLESS
    for s in range(m.counts[SPEEDS]):
        if not abs(m.du[s]) < math.inf:
            return INFINITE
    return DONE


@once
@njit(**OPTIONS)
def complete(m):
    """Accelerations of all nodes and the energies of deforming bodies, after ``project``."""
    apart()
    accelerate(m)
    deforming(m)
