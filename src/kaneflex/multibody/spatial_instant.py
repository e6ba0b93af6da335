"""Compiled evaluation of a mechanism in space at one instant: positions, forces, and accelerations."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from kaneflex.multibody.spatial_dynamics import accelerations, close, tie
from kaneflex.multibody.spatial_forces import deforming
from kaneflex.multibody.spatial_kinematics import accelerate, goes, stands
from kaneflex.multibody.tables import COURSES, MAGNITUDES, OPTIONS, address, apart, kernel
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


class Laws(NamedTuple):
    """Arguments of a structure's own kernels, and the progress of rows.

    Attributes
    ----------
    kernels : ndarray (2,)
        Addresses of those of :data:`kaneflex.multibody.tables.STRUCTURE_KERNELS`.
    p : ndarray
        Their parameters.
    driven : ndarray (n_driven,)
        Coordinates of the prescribed drives.
    told : ndarray (n_told, 2)
        Place in ``x`` and node of every joint whose coordinate occurs in magnitudes.
    x, course : ndarray
        Input of magnitudes, and output of courses.
    now : ndarray (2,)
        Last instant of rows [s], and its outcome.
    added : ndarray (n_loads + n_driven,)
        Additions to the sizes of the loads and to the accelerations of the prescribed drives.
    steps : kaneflex.multibody.spatial_steps.Steps
        Current integration, if any.
    """

    kernels: np.ndarray
    p: np.ndarray
    driven: np.ndarray
    told: np.ndarray
    x: np.ndarray
    course: np.ndarray
    now: np.ndarray
    added: np.ndarray
    steps: Any


@njit(**OPTIONS)
def courses(law, t):
    """Coordinate, speed and acceleration of every prescribed drive."""
    apart()
    kernel(address(law.kernels), COURSES)(t, address(law.p), address(law.course), 0)


@once
@njit(**OPTIONS)
def stand(m, choice, k, law, t):
    """Prescribed drives at t, closed loops, dependent speeds, then loads; returns the outcome."""
    apart()
    courses(law, t)
    for i in range(len(law.driven)):
        k.q[law.driven[i]] = law.course[3 * i]
        k.u[choice.prescribed[i]] = law.course[3 * i + 1]
        k.du[choice.prescribed[i]] = law.course[3 * i + 2] + law.added[len(k.sizes) + i]
    if not close(m, k.q, k, choice):
        return OPEN
    if len(choice.rows) < len(k.rows):
        for row in range(len(k.rows)):
            if not abs(k.rows[row, 0]) <= CLOSED * choice.row_measure[row]:
                return APART
    if len(choice.dependent):
        tie(k, choice, k.u, -1, False)
    for i in range(len(law.told)):
        at, node = law.told[i, 0], law.told[i, 1]
        law.x[at], law.x[at + 1] = stands(m, node, k.q), goes(m, node, k.q, k.u)
    kernel(address(law.kernels), MAGNITUDES)(t, address(law.x), 0, address(law.p), address(k.sizes), 0)
    for i in range(len(k.sizes)):
        k.sizes[i] += law.added[i]
    return DONE


@once
@njit(**OPTIONS)
def project(m, choice, k, law, t):
    """The same with the rates of all speeds."""
    apart()
    outcome = stand(m, choice, k, law, t)
    if outcome != DONE:
        return outcome
    if not accelerations(m, k, choice, k.u, k.du, k.sizes):
        return MASSLESS
    for s in range(len(k.du)):
        if not abs(k.du[s]) < math.inf:
            return INFINITE
    return DONE


@once
@njit(**OPTIONS)
def complete(m, k):
    """Accelerations of all nodes and the energies of deforming bodies, after ``project``."""
    apart()
    accelerate(m, k.u, k.du, k)
    deforming(m, k)
