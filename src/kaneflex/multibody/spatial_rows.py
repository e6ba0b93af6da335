"""Compiled motion of a mechanism in space: states at one instant, and rows of them at many.

Results of an instant are in :class:`kaneflex.multibody.spatial_work.Work`; its first numbers are a row.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.generated import spatial as laws
from kaneflex.generated import spatial_shapes as shape_laws
from kaneflex.multibody import (
    coefficients,
    dense_lu,
    spatial_bushings,
    spatial_collocation,
    spatial_dynamics,
    spatial_forces,
    spatial_instant,
    spatial_kinematics,
    spatial_steps,
    spatial_stiffness,
    spatial_tables,
    spatial_vectors,
    spatial_work,
    tables,
)
from kaneflex.multibody.spatial_collocation import collocate
from kaneflex.multibody.spatial_dynamics import advance, basis, close, coordinate_rates, exerted, missed, pass_on
from kaneflex.multibody.spatial_forces import deforming, demand
from kaneflex.multibody.spatial_instant import DONE, GROWN, OPEN, complete, courses, project, stand
from kaneflex.multibody.spatial_kinematics import move, partials, place
from kaneflex.multibody.spatial_stiffness import powers
from kaneflex.multibody.tables import OPTIONS, OUTER, apart, larger
from kaneflex.support import inner
from kaneflex.support.fingerprint import made_of

_FAR = 0.05
"""Largest step of a prescribed drive [rad or sizes of the mechanism] in following loops."""
_GROWTH = 30.0
"""Largest ratio of the other speeds to those of the drives before dependent speeds are chosen again."""
_AT_ONCE = 256
"""Steps per call of compiled code, after which the position is recorded."""


_made_of_parts = made_of(
    laws.__file__, shape_laws.__file__, coefficients.__file__, dense_lu.__file__, inner.__file__,
    spatial_bushings.__file__, spatial_collocation.__file__, spatial_dynamics.__file__, spatial_forces.__file__,
    spatial_instant.__file__, spatial_kinematics.__file__, spatial_steps.__file__, spatial_stiffness.__file__,
    spatial_tables.__file__, spatial_vectors.__file__, spatial_work.__file__, tables.__file__,
)  # fmt: skip


@njit(**OPTIONS)
def _far(law, choice, k, t):
    """Least number of steps from the drives' current position to that at t."""
    apart()
    courses(law, t)
    farthest = 0.0
    for i in range(len(law.driven)):
        moved = abs(law.course[3 * i] - k.q[law.driven[i]])
        farthest = larger(farthest, moved / choice.measure[choice.prescribed[i]])
    return math.ceil(farthest / _FAR)


@njit(**OPTIONS)
def _grown(choice, u):
    """True if dependent speeds are large relative to the prescribed ones."""
    apart()
    largest = driven = 0.0
    for s in range(len(u)):
        largest = larger(largest, abs(u[s]) / choice.measure[s])
    for i in range(len(choice.prescribed)):
        s = choice.prescribed[i]
        driven = larger(driven, abs(u[s]) / choice.measure[s])
    return driven > 0.0 and largest > _GROWTH * driven


@njit(**OPTIONS)
def store(m, choice, k, row):
    """Complete an instant by velocities, accelerations and joint forces, and store it as a row."""
    apart()
    complete(m, k)
    exerted(m, k, choice, k.sizes, k.multipliers, k.wrenches, k.along)
    keep(k, row)


@njit(**OPTIONS)
def keep(k, row):
    """Store the numbers of the instant."""
    for i in range(len(row)):
        row[i] = k.kept[i]


@njit(**OPTIONS)
def followed(m, choice, k, law, times, out):
    """Rows at ascending times from the current position, with loops followed step by step.

    Returns their number; ``law.now`` has the last instant and its outcome: GROWN is valid, but the next ones need
    another choice of speeds.
    """
    apart()
    t, taken = law.now[0], 0
    law.now[1] = DONE
    for i in range(len(times)):
        reached = t == times[i]
        while not reached:
            if taken == _AT_ONCE:
                return i
            steps = _far(law, choice, k, times[i])
            reached = not steps > 1.0
            t = times[i] if reached else t + (times[i] - t) / steps
            taken += 1
            law.now[0], law.now[1] = t, project(m, choice, k, law, t)
            if law.now[1] == DONE and _grown(choice, k.u):
                law.now[1] = GROWN
            if law.now[1] != DONE:
                return i
        store(m, choice, k, out[i])
    return len(times)


@njit(**OPTIONS)
def _given(k, law, given):
    """Set coordinates and speeds, and accelerations and inputs if they are given, too."""
    q, u = len(k.q), len(k.u)
    for j in range(q):
        k.q[j] = given[j]
    for j in range(u):
        k.u[j] = given[q + j]
    if len(given) > q + u:
        for j in range(u):
            k.du[j] = given[q + u + j]
        for j in range(len(law.added)):
            law.added[j] = given[q + 2 * u + j]


@njit(**OPTIONS)
def near(m, choice, k, law, times, given, out, whole):
    """Rows at times near given coordinates and speeds; returns their number; ``law.now`` as of :func:`followed`.

    Without ``whole`` accelerations and reactions are left out: their mass matrix takes most of the time.
    """
    apart()
    for i in range(len(times)):
        _given(k, law, given[i])
        law.now[0] = times[i]
        law.now[1] = project(m, choice, k, law, times[i]) if whole else stand(m, choice, k, law, times[i])
        if law.now[1] != DONE:
            return i
        if whole:
            store(m, choice, k, out[i])
        else:
            move(m, k.u, k)
            demand(m, k, k.sizes, False)  # springs have their energies by it
            deforming(m, k)
            keep(k, out[i])
    return len(times)


@njit(**OPTIONS)
def lacked(m, choice, k, law, times, given, out):
    """Residuals of the independent speeds by given accelerations, then all speeds; otherwise as :func:`near`."""
    apart()
    free = len(choice.independent)
    for i in range(len(times)):
        _given(k, law, given[i])
        law.now[0], law.now[1] = times[i], stand(m, choice, k, law, times[i])
        if law.now[1] != DONE:
            return i
        missed(m, k, choice, k.u, k.du, k.sizes, False, out[i])
        for j in range(len(k.u)):
            out[i, free + j] = k.u[j]
    return len(times)


PLACE, CLOSE, PROJECT, EXERT, PASS_ON, BASIS, RATES, ADVANCE, DEMAND, FOLLOW, NEAR, MOVED, LACKED, COLLOCATE = range(14)
"""Tasks of :func:`compute`."""


@njit(**OPTIONS)
def _computed(what, m, choice, k, law, times, given, out):
    apart()
    if what == PLACE:
        place(m, k.q, k)
        partials(m, k)
    elif what == CLOSE:
        return DONE if close(m, k.q, k, choice) else OPEN
    elif what == PROJECT:
        outcome = project(m, choice, k, law, times[0])
        if outcome == DONE:
            complete(m, k)
        return outcome
    elif what == EXERT:
        exerted(m, k, choice, k.sizes, k.multipliers, k.wrenches, k.along)
    elif what == PASS_ON:
        pass_on(m, k, k.multipliers, k.wrenches)
    elif what == BASIS:
        basis(k, choice)
    elif what == RATES:
        coordinate_rates(m, k.q, k.u, out[0])
        powers(m, choice, k, law.steps.C, out[1])
    elif what == ADVANCE:
        for i in range(len(given)):
            advance(m, out[i], given[i])
    elif what == DEMAND:
        demand(m, k, k.sizes, True)
    elif what == FOLLOW:
        return followed(m, choice, k, law, times, out)
    elif what == NEAR or what == MOVED:
        return near(m, choice, k, law, times, given, out, what == NEAR)
    return DONE


@njit(cache=True, **OUTER)
@_made_of_parts
def compute(what, m, choice, k, law, times, given, out):
    """Entry for Python: one function, so that it is compiled once; returns the outcome or the number of rows."""
    return _computed(what, m, choice, k, law, times, given, out)


@njit(cache=True, **OUTER)
@_made_of_parts
def compute_coupled(what, m, choice, k, law, times, given, out):
    """As :func:`compute`, with LACKED and COLLOCATE, whose compilation other scenes avoid."""
    if what == LACKED:
        return lacked(m, choice, k, law, times, given, out)
    if what == COLLOCATE:
        return collocate(m, choice, k, law, law.steps, times, out)
    return _computed(what, m, choice, k, law, times, given, out)
