"""Compiled motion of a mechanism in space: where it stands at an instant, and rows of that at many.

What is found of an instant lies in :class:`kaneflex.multibody.spatial_work.Work`; the first of its numbers make a
row.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numba.extending import intrinsic
from numba.types import CPointer

from kaneflex.generated import spatial as laws
from kaneflex.generated import spatial_shapes as shape_laws
from kaneflex.multibody import (
    dense_lu,
    inner,
    spatial_bushings,
    spatial_dynamics,
    spatial_forces,
    spatial_kinematics,
    spatial_tables,
    spatial_work,
    tables,
)
from kaneflex.multibody.spatial_dynamics import (
    accelerations,
    advance,
    basis,
    close,
    coordinate_rates,
    exerted,
    pass_on,
    tie,
)
from kaneflex.multibody.spatial_forces import deforming, demand
from kaneflex.multibody.spatial_kinematics import partials, place
from kaneflex.multibody.tables import COURSES, MAGNITUDES, OPTIONS, OUTER, apart, kernel, larger
from kaneflex.support.fingerprint import made_of

CLOSED = 1e-7
"""How far off rows may be that follow from others, in rad or sizes of the mechanism."""
_FAR = 0.05
"""Largest step of a prescribed drive [rad or sizes of the mechanism] from place to place where loops are followed."""
_GROWTH = 30.0
"""How many times faster than the drives the other speeds may be before dependent speeds are chosen anew."""
_AT_ONCE = 256
"""Places on the way, after which Python is to remember where the mechanism is."""

DONE, OPEN, APART, MASSLESS, INFINITE, GROWN = range(6)
"""What came of an instant: the rest, but GROWN, are why there is none."""

_made_of_parts = made_of(
    laws.__file__, shape_laws.__file__, dense_lu.__file__, inner.__file__, spatial_dynamics.__file__,
    spatial_bushings.__file__, spatial_forces.__file__, spatial_kinematics.__file__, spatial_tables.__file__,
    spatial_work.__file__, tables.__file__,
)  # fmt: skip


class Laws(NamedTuple):
    """What a structure's own kernels need.

    Attributes
    ----------
    kernels : ndarray (2,)
        Addresses of those of :data:`kaneflex.multibody.tables.STRUCTURE_KERNELS`.
    p : ndarray
        Their parameters.
    driven : ndarray (n_driven,)
        Coordinates of the prescribed drives.
    told : ndarray (n_told, 3)
        Of every joint that magnitudes know its place in ``x``, coordinate and speed.
    x, course : ndarray
        What magnitudes read, and what courses store.
    now : ndarray (2,)
        Where rows go on: the instant [s], and what came of it.
    added : ndarray (n_loads + n_driven,)
        To the sizes of the loads and to the accelerations of the prescribed drives.
    """

    kernels: np.ndarray
    p: np.ndarray
    driven: np.ndarray
    told: np.ndarray
    x: np.ndarray
    course: np.ndarray
    now: np.ndarray
    added: np.ndarray


@intrinsic
def _address(typing, array):
    """Where an array's numbers begin."""

    def read(context, builder, sig, args):
        return context.make_array(sig.args[0])(context, builder, args[0]).data

    return CPointer(array.dtype)(array), read


@njit(**OPTIONS)
def _courses(law, t):
    """Coordinate, speed and acceleration of every prescribed drive."""
    apart()
    kernel(_address(law.kernels), COURSES)(t, _address(law.p), _address(law.course), 0)


@njit(**OPTIONS)
def settle(m, choice, k, law, t):
    """Prescribed drives where they are at t, loops closed, dependent speeds tied: then loads know what they ask of
    joints, and all rates follow. What came of it."""
    apart()
    _courses(law, t)
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
        at = law.told[i, 0]
        law.x[at], law.x[at + 1] = k.q[law.told[i, 1]], k.u[law.told[i, 2]]
    kernel(_address(law.kernels), MAGNITUDES)(t, _address(law.x), 0, _address(law.p), _address(k.sizes), 0)
    for i in range(len(k.sizes)):
        k.sizes[i] += law.added[i]
    if not accelerations(m, k, choice, k.u, k.du, k.sizes):
        return MASSLESS
    for s in range(len(k.du)):
        if not abs(k.du[s]) < math.inf:
            return INFINITE
    deforming(m, k)
    return DONE


@njit(**OPTIONS)
def _far(law, choice, k, t):
    """How many steps it is at least from where the drives stand to where they are at t."""
    apart()
    _courses(law, t)
    farthest = 0.0
    for i in range(len(law.driven)):
        moved = abs(law.course[3 * i] - k.q[law.driven[i]])
        farthest = larger(farthest, moved / choice.measure[choice.prescribed[i]])
    return math.ceil(farthest / _FAR)


@njit(**OPTIONS)
def _grown(choice, u):
    """Whether dependent speeds have grown fast beside the prescribed ones."""
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
    """What joints exert, and then all of the instant."""
    apart()
    exerted(m, k, choice, k.sizes, k.multipliers, k.wrenches, k.along)
    for i in range(len(row)):
        row[i] = k.kept[i]


@njit(**OPTIONS)
def followed(m, choice, k, law, times, out):
    """Rows at times in their order, from where the mechanism stands, loops followed from place to place.

    How many there are; ``law.now`` has where it stands then, and what came of that instant: where it is GROWN the
    instant is as good as any, and the next ones ask for another choice of speeds.
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
            law.now[0], law.now[1] = t, settle(m, choice, k, law, t)
            if law.now[1] == DONE and _grown(choice, k.u):
                law.now[1] = GROWN
            if law.now[1] != DONE:
                return i
        store(m, choice, k, out[i])
    return len(times)


@njit(**OPTIONS)
def near(m, choice, k, law, times, given, out):
    """Rows at times near coordinates and speeds that are given: how many there are; ``law.now`` as of
    :func:`followed`."""
    apart()
    for i in range(len(times)):
        for j in range(len(k.q)):
            k.q[j] = given[i, j]
        for j in range(len(k.u)):
            k.u[j] = given[i, len(k.q) + j]
        law.now[0], law.now[1] = times[i], settle(m, choice, k, law, times[i])
        if law.now[1] != DONE:
            return i
        store(m, choice, k, out[i])
    return len(times)


PLACE, CLOSE, SETTLE, EXERT, PASS_ON, BASIS, RATES, ADVANCE, DEMAND, FOLLOW, NEAR = range(11)
"""What :func:`compute` does."""


@njit(cache=True, **OUTER)
@_made_of_parts
def compute(what, m, choice, k, law, times, given, out):
    """What Python calls of these: one function, so that it is compiled once; what came of it, or how many rows."""
    if what == PLACE:
        place(m, k.q, k)
        partials(m, k)
    elif what == CLOSE:
        return DONE if close(m, k.q, k, choice) else OPEN
    elif what == SETTLE:
        return settle(m, choice, k, law, times[0])
    elif what == EXERT:
        exerted(m, k, choice, k.sizes, k.multipliers, k.wrenches, k.along)
    elif what == PASS_ON:
        pass_on(m, k, k.multipliers, k.wrenches)
    elif what == BASIS:
        basis(k, choice)
    elif what == RATES:
        coordinate_rates(m, k.q, k.u, out[0])
    elif what == ADVANCE:
        for i in range(len(given)):
            advance(m, out[i], given[i])
    elif what == DEMAND:
        demand(m, k, k.sizes, True)
    elif what == FOLLOW:
        return followed(m, choice, k, law, times, out)
    else:
        return near(m, choice, k, law, times, given, out)
    return DONE
