"""Row of the compiled integration: motion, modes of contacts and frictions, and works."""

from __future__ import annotations

from numba import njit

from kaneflex.multibody.compile.values import by_size, inside
from kaneflex.multibody.dynamics import rotation_vectors
from kaneflex.multibody.unilateral.rows import at, contacts, frictions
from kaneflex.multibody.model.layout import (
    ACCEL, COORDINATES, MEMORY, MODE, MODE_SIZE, NOW, OPTIONS, RATE, REACTIONS, WORKS, Y, apart, shifted,
)  # fmt: skip


@njit(**OPTIONS)
def row_size(m):
    """Length of a row of the integration: t, coordinates, rates, accelerations, reactions of the cuts and frictions,
    MODE and MEMORY of the frictions and contacts, in space quaternions of balls, works."""
    return works_at(m) + m.plan[WORKS]


@njit(**OPTIONS)
def works_at(m):
    """Place of the works in a row."""
    return 1 + 3 * m.plan[COORDINATES] + m.plan[REACTIONS] + standing(m)


@njit(**OPTIONS)
def modes(m):
    """Number of entries of a row for the modes of contacts and frictions."""
    return MODE_SIZE * (frictions(m) + contacts(m))


@njit(**OPTIONS)
def standing(m):
    """Number of entries of a row for modes and, in space, for the quaternions of balls."""
    inside()
    return modes(m)


@njit(**OPTIONS)
def _standing_in_space(m):
    inside()
    return modes(m) + rotation_vectors.standing(m)


@njit(**OPTIONS)
def _take_modes(m, row):
    """Set the modes of contacts and frictions from a row."""
    for n in range(-frictions(m), contacts(m)):
        k, i = at(m, n), MODE_SIZE * (n + frictions(m))
        m.w[k + MODE], m.w[k + MEMORY] = row[i], row[i + 1]


@njit(**OPTIONS)
def stands(m, row):
    """Set the modes and, in space, the quaternions of balls from a row."""
    inside()
    _take_modes(m, row)


@njit(**OPTIONS)
def _stands_in_space(m, row):
    _take_modes(m, row)
    rotation_vectors.stands(m, shifted(row, modes(m)))


@njit(**OPTIONS)
def _store_modes(m, row):
    """Store the modes of contacts and frictions in a row."""
    for n in range(-frictions(m), contacts(m)):
        k, i = at(m, n), MODE_SIZE * (n + frictions(m))
        row[i], row[i + 1] = m.w[k + MODE], m.w[k + MEMORY]


@njit(**OPTIONS)
def stored(m, row):
    """Store the modes and, in space, the quaternions of balls in a row."""
    inside()
    _store_modes(m, row)


@njit(**OPTIONS)
def _stored_in_space(m, row):
    _store_modes(m, row)
    rotation_vectors.stored(m, shifted(row, modes(m)))


standing, stored = by_size(standing, _standing_in_space), by_size(stored, _stored_in_space)
stands = by_size(stands, _stands_in_space)


@njit(**OPTIONS)
def take(m, row):
    """Set the motion from a row."""
    apart()
    plan, w, n = m.plan, m.w, m.plan[COORDINATES]
    for i in range(n):
        w[plan[Y] + i], w[plan[RATE] + i], w[plan[ACCEL] + i] = row[1 + i], row[1 + n + i], row[1 + 2 * n + i]
    for r in range(plan[REACTIONS]):
        w[plan[NOW] + r] = row[1 + 3 * n + r]
    stands(m, shifted(row, 1 + 3 * n + plan[REACTIONS]))


@njit(**OPTIONS)
def give(m, t, row):
    """Store the motion in a row, without works."""
    apart()
    plan, w, n = m.plan, m.w, m.plan[COORDINATES]
    row[0] = t
    for i in range(n):
        row[1 + i], row[1 + n + i], row[1 + 2 * n + i] = w[plan[Y] + i], w[plan[RATE] + i], w[plan[ACCEL] + i]
    for r in range(plan[REACTIONS]):
        row[1 + 3 * n + r] = w[plan[NOW] + r]
    stored(m, shifted(row, 1 + 3 * n + plan[REACTIONS]))
