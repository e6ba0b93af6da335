"""Compiled entries for a mechanism in space: states at one instant, rows of them at many, and steps.

Results of an instant are in :class:`kaneflex.multibody.dynamics.spatial_work.Work`; its first numbers are a row.
"""

from __future__ import annotations

import math

from numba import njit
from numba.types import boolean, float64, int64, void

from kaneflex.multibody.compile.values import after
from kaneflex.multibody.dynamics import spatial_dynamics, spatial_instant
from kaneflex.multibody.dynamics.spatial_dynamics import (
    CHOICE,
    INDEPENDENT,
    PRESCRIBED,
    coordinate_rates,
    missed,
    reduced,
)
from kaneflex.multibody.dynamics.spatial_dynamics import advance as advanced_by
from kaneflex.multibody.dynamics.spatial_forces import deforming, demand, mass_matrix
from kaneflex.multibody.dynamics.spatial_instant import DONE, GROWN, courses, stand
from kaneflex.multibody.dynamics.spatial_kinematics import directions, move
from kaneflex.multibody.dynamics.spatial_kinematics import place as place_nodes
from kaneflex.multibody.dynamics.spatial_stiffness import powers
from kaneflex.multibody.dynamics.spatial_work import COORDINATES, DRIVEN, KEPT, LOADS, SPACE, SPEEDS
from kaneflex.multibody.model.layout import ENTRY, OPTIONS, N, apart, larger
from kaneflex.multibody.time import spatial_collocation
from kaneflex.multibody.time.spatial_collocation import STEPS

_FAR = 0.05
"""Largest step of a prescribed drive [rad or sizes of the mechanism] in following loops."""
_GROWTH = 30.0
"""Largest ratio of the other speeds to those of the drives before dependent speeds are chosen again."""
_AT_ONCE = 256
"""Steps per call of compiled code, after which the position is recorded."""


@njit(**ENTRY)
def place(m):
    """Positions, axes and directions."""
    place_nodes(m)
    directions(m)


@njit(**ENTRY)
def close(m, c):
    """See :func:`kaneflex.multibody.dynamics.spatial_dynamics.close`."""
    return spatial_dynamics.close(m, c)


@njit(**ENTRY)
def project(m, c, t):
    """State at t with accelerations; returns the outcome."""
    outcome = spatial_instant.project(m, c, t)
    if outcome == DONE:
        spatial_instant.complete(m)
    return outcome


@njit(**ENTRY)
def exert(m, c):
    """See :func:`kaneflex.multibody.dynamics.spatial_dynamics.exerted`."""
    return spatial_dynamics.exerted(m, c)


@njit(**ENTRY)
def pass_on(m):
    """See :func:`kaneflex.multibody.dynamics.spatial_dynamics.pass_on`."""
    spatial_dynamics.pass_on(m)


@njit(**ENTRY)
def basis(m, c):
    """See :func:`kaneflex.multibody.dynamics.spatial_dynamics.basis`."""
    spatial_dynamics.basis(m, c)


@njit(**ENTRY)
def rates(m, c, out, works):
    """Rates of the coordinates, and powers, after ``project``."""
    coordinate_rates(m, m.q, m.u, out)
    if c.counts[PRESCRIBED]:
        reduced(m, c, m.h, c.step)
    powers(m, c, c.step, works)


@njit(**ENTRY)
def advance(m, steps, count, out):
    """Move rows of coordinates by rows of steps of the speeds."""
    for i in range(count):
        advanced_by(m, after(out, m.counts[COORDINATES] * i), after(steps, m.counts[SPEEDS] * i))


@njit(**ENTRY)
def mass(m, unit):
    """Mass matrix M of all speeds at the place of m; ``unit`` is zero before and after, one number a speed."""
    mass_matrix(m, unit)


@njit(**OPTIONS)
def _far(m, c, t):
    """Least number of steps from the drives' current position to that at t."""
    apart()
    courses(m, t)
    farthest = 0.0
    for i in range(m.counts[DRIVEN]):
        moved = abs(m.course[3 * i] - m.q[m.driven[i]])
        farthest = larger(farthest, moved / c.measure[c.prescribed[i]])
    return math.ceil(farthest / _FAR)


@njit(**OPTIONS)
def _grown(m, c):
    """True if dependent speeds are large relative to the prescribed ones."""
    apart()
    largest = driven = 0.0
    for s in range(m.counts[SPEEDS]):
        largest = larger(largest, abs(m.u[s]) / c.measure[s])
    for i in range(c.counts[PRESCRIBED]):
        s = c.prescribed[i]
        driven = larger(driven, abs(m.u[s]) / c.measure[s])
    return driven > 0.0 and largest > _GROWTH * driven


@njit(**OPTIONS)
def _store(m, c, row):
    """Complete an instant by velocities, accelerations and joint forces, and store it as a row."""
    apart()
    spatial_instant.complete(m)
    spatial_dynamics.exerted(m, c)
    _keep(m, row)


@njit(**OPTIONS)
def _keep(m, row):
    """Store the numbers of the instant."""
    for i in range(m.counts[KEPT]):
        row[i] = m.kept[i]


@njit(**ENTRY)
def follow(m, c, times, count, out):
    """Rows at ascending times from the current position, with loops followed step by step.

    Returns their number; ``now`` has the last instant and its outcome: GROWN is valid, but the next ones need another
    choice of speeds.
    """
    t, taken = m.now[0], 0
    m.now[1] = DONE
    for i in range(count):
        reached = t == times[i]
        while not reached:
            if taken == _AT_ONCE:
                return i
            steps = _far(m, c, times[i])
            reached = not steps > 1.0
            t = times[i] if reached else t + (times[i] - t) / steps
            taken += 1
            m.now[0], m.now[1] = t, spatial_instant.project(m, c, t)
            if m.now[1] == DONE and _grown(m, c):
                m.now[1] = GROWN
            if m.now[1] != DONE:
                return i
        _store(m, c, after(out, m.counts[KEPT] * i))
    return count


@njit(**OPTIONS)
def _given(m, given, width):
    """Set coordinates and speeds, and accelerations and inputs if they are given, too."""
    q, u = m.counts[COORDINATES], m.counts[SPEEDS]
    for j in range(q):
        m.q[j] = given[j]
    for j in range(u):
        m.u[j] = given[q + j]
    if width > q + u:
        for j in range(u):
            m.du[j] = given[q + u + j]
        for j in range(m.counts[LOADS] + m.counts[DRIVEN]):
            m.added[j] = given[q + 2 * u + j]


@njit(**ENTRY)
def near(m, c, times, count, given, width, out, whole):
    """Rows at times near given coordinates and speeds; returns their number; ``now`` as of :func:`follow`.

    Without ``whole`` accelerations and reactions are left out: their mass matrix takes most of the time.
    """
    for i in range(count):
        _given(m, after(given, width * i), width)
        m.now[0] = times[i]
        m.now[1] = spatial_instant.project(m, c, times[i]) if whole else stand(m, c, times[i])
        if m.now[1] != DONE:
            return i
        row = after(out, m.counts[KEPT] * i)
        if whole:
            _store(m, c, row)
        else:
            move(m)
            demand(m)  # springs have their energies by it
            deforming(m)
            _keep(m, row)
    return count


@njit(**ENTRY)
def lacked(m, c, times, count, given, width, out):
    """Residuals of the independent speeds by given accelerations, then all speeds; otherwise as :func:`near`."""
    free, speeds = c.counts[INDEPENDENT], m.counts[SPEEDS]
    for i in range(count):
        _given(m, after(given, width * i), width)
        m.now[0], m.now[1] = times[i], stand(m, c, times[i])
        if m.now[1] != DONE:
            return i
        row = after(out, (free + speeds) * i)
        missed(m, c, False, row)
        for j in range(speeds):
            row[free + j] = m.u[j]
    return count


@njit(**ENTRY)
def collocate(m, c, s, times, count, out, most, width):
    """See :func:`kaneflex.multibody.time.spatial_collocation.collocate`."""
    return spatial_collocation.collocate(m, c, s, times, count, out, most, width)


RIGID_ENTRIES = {
    place: void(SPACE), close: boolean(SPACE, CHOICE), project: int64(SPACE, CHOICE, float64),
    exert: boolean(SPACE, CHOICE), pass_on: void(SPACE), basis: void(SPACE, CHOICE),
    rates: void(SPACE, CHOICE, N, N), advance: void(SPACE, N, int64, N), mass: void(SPACE, N),
    follow: int64(SPACE, CHOICE, N, int64, N), near: int64(SPACE, CHOICE, N, int64, N, int64, N, boolean),
    lacked: int64(SPACE, CHOICE, N, int64, N, int64, N),
}  # fmt: skip
ENTRIES = RIGID_ENTRIES | {collocate: int64(SPACE, CHOICE, STEPS, N, int64, N, int64, int64)}
"""Functions called by Python, and their argument types; without ``collocate`` for bodies that do not deform."""
NEAR, MOVED, LACKED = range(3)
"""Rows of :func:`near`, whole or not, or of :func:`lacked`."""
