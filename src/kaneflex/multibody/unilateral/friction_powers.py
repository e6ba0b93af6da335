"""Energies and powers of holds in the compiled equations: see :mod:`kaneflex.multibody.unilateral.dry_friction`."""

from __future__ import annotations

from numba import njit

from kaneflex.multibody.compile.stand_ins import of_holds
from kaneflex.multibody.model.layout import DRIVES, HOLDING, MODE, NUMBERS_AT, OPTIONS, SLIP, STUCK_AT
from kaneflex.multibody.unilateral import lugre
from kaneflex.multibody.unilateral.dry_friction import BENDS, STUCK, count, number_at, virtual_inertia


@of_holds(0.0)
@njit(**OPTIONS)
def not_moved(m):
    """Kinetic energy [J] of virtual inertia."""
    total = 0.0
    for n in range(-count(m), 0):
        total += 0.5 * virtual_inertia(m, n) * m.w[number_at(m, n) + SLIP] * m.w[number_at(m, n) + SLIP]
    return total


@njit(**OPTIONS)
def _taken_by(m, n):
    """Power that a hold dissipates [W]: zero while sticking, whatever its rounding slip."""
    w, k = m.w, number_at(m, n)
    return -w[k + HOLDING] * w[k + SLIP] if w[k + MODE] != STUCK else 0.0


@of_holds(0.0)
@njit(**OPTIONS)
def lost(m):
    """Power that holds dissipate [W]."""
    total = 0.0
    for n in range(-count(m), 0):
        k, j = number_at(m, n), m.acts[m.plan[DRIVES] + n, NUMBERS_AT]
        total += _taken_by(m, n)
        if m.w[k + MODE] == BENDS:
            _, rate = lugre.by_now(m.w, k, j)
            total -= m.w[j + lugre.STIFFNESS_AT] * m.w[k + STUCK_AT] * rate
    return total


@of_holds(None)
@njit(**OPTIONS)
def losses(m, end):
    """Power of each hold, including energy stored in bristles, at the places before ``end``."""
    for n in range(-count(m), 0):
        m.w[end + n] = _taken_by(m, n)
