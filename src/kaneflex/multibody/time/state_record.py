"""Row of the compiled integration: motion, modes of contacts and frictions, and works."""

from __future__ import annotations

from numba import njit

from kaneflex.multibody.dynamics.arrays import BALLS
from kaneflex.multibody.unilateral.rows import at, contacts, frictions
from kaneflex.multibody.compile.types import OPTIONS, no_inline, shifted
from kaneflex.multibody.model.layout import COORDINATES, MEMORY, MODE, MODE_SIZE, REACTIONS, WORKS


@njit(**OPTIONS)
def row_size(m):
    """Length of a row of the integration: t, coordinates, rates, accelerations, reactions of the cuts and frictions,
    MODE and MEMORY of the frictions and contacts, quaternions of balls, works."""
    return works_at(m) + m.plan[WORKS]


@njit(**OPTIONS)
def works_at(m):
    """Place of the works in a row."""
    return 1 + 3 * m.plan[COORDINATES] + m.plan[REACTIONS] + mode_count(m) + 4 * m.counts[BALLS]


@njit(**OPTIONS)
def mode_count(m):
    """Number of entries of a row for the modes of contacts and frictions."""
    return MODE_SIZE * (frictions(m) + contacts(m))


@njit(**OPTIONS)
def read_row(m, row):
    """Set the motion from a row."""
    no_inline()
    plan, n = m.plan, m.plan[COORDINATES]
    for i in range(n):
        m.y[i], m.u[i], m.du[i] = row[1 + i], row[1 + n + i], row[1 + 2 * n + i]
    for r in range(plan[REACTIONS]):
        m.multipliers[r] = row[1 + 3 * n + r]
    state = shifted(row, 1 + 3 * n + plan[REACTIONS])
    for n in range(-frictions(m), contacts(m)):
        k, i = at(m, n), MODE_SIZE * (n + frictions(m))
        m.w[k + MODE], m.w[k + MEMORY] = state[i], state[i + 1]
    for k in range(4 * m.counts[BALLS]):
        m.q[m.balls[k // 4, 0] + k % 4] = state[mode_count(m) + k]


@njit(**OPTIONS)
def write_row(m, t, row):
    """Store the motion in a row, without works."""
    no_inline()
    plan, n = m.plan, m.plan[COORDINATES]
    row[0] = t
    for i in range(n):
        row[1 + i], row[1 + n + i], row[1 + 2 * n + i] = m.y[i], m.u[i], m.du[i]
    for r in range(plan[REACTIONS]):
        row[1 + 3 * n + r] = m.multipliers[r]
    state = shifted(row, 1 + 3 * n + plan[REACTIONS])
    for n in range(-frictions(m), contacts(m)):
        k, i = at(m, n), MODE_SIZE * (n + frictions(m))
        state[i], state[i + 1] = m.w[k + MODE], m.w[k + MEMORY]
    for k in range(4 * m.counts[BALLS]):
        state[mode_count(m) + k] = m.q[m.balls[k // 4, 0] + k % 4]
