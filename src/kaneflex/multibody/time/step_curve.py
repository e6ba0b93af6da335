"""Gap along a step of the compiled integration, between its nodes, on the polynomial of the stages.

Cubics between the nodes predict zeros, which are checked on the polynomial.
"""

from __future__ import annotations

import math
from numba import njit

from kaneflex.multibody.dynamics.forces import load_sizes
from kaneflex.multibody.dynamics.loop_closure import follow
from kaneflex.multibody.compile.types import OPTIONS, apart, larger
from kaneflex.multibody.model.layout import (
    COORDINATES, GAP, GAP_RATE, MODE, NODES, OPEN, SHIFT, STAGE_A,
)  # fmt: skip
from kaneflex.multibody.unilateral import stick_slip
from kaneflex.multibody.unilateral.frictions import row_of
from kaneflex.multibody.unilateral.relative_rows import meet, near
from kaneflex.multibody.unilateral.rows import at, contacts, frictions, rigid, switches

NEVER = 2.0


@njit(**OPTIONS)
def gap_of(m, c):
    """Gap of a contact [m], beyond rounding if it has separated from a rigid side without speed."""
    k = at(m, c)
    return m.w[k + GAP] + m.w[k + SHIFT] if rigid(m, c) and m.w[k + MODE] == OPEN else m.w[k + GAP]


@njit(**OPTIONS)
def meet_all(m, t):
    """Evaluate all contacts and switches of laws at the current position."""
    if switches(m, contacts(m) - 1):
        load_sizes(m, t)
    for n in range(contacts(m)):
        meet(m, n)


@njit(**OPTIONS)
def shares(table, i, last):
    """Shares of a step at its nodes i and i + 1, the ``last`` of which is its end."""
    return table.nodes[i - 1] if i > 0 else 0.0, table.nodes[i] if i + 1 < last else 1.0


@njit(**OPTIONS)
def between(m, table, t, h, here, x):
    """Evaluate the step's polynomial after a share x of the step; False: a loop doesn't close."""
    apart()
    plan, w, c, n = m.plan, m.w, table.nodes, m.plan[COORDINATES]
    a_1, of = table.a_1, plan[STAGE_A]
    for k in range(n):
        v_0 = here[1 + n + k]
        y, v, a = 0.0, 0.0, 0.0
        for i in range(3):
            other, third = c[(i + 1) % 3], c[(i + 2) % 3]
            scale = 1.0 / ((c[i] - other) * (c[i] - third))
            part = x * (x * (x / 3.0 - 0.5 * (other + third)) + other * third) * scale
            rate = v_0
            for j in range(3):
                rate += h * a_1[3 * i + j] * w[of + n * j + k]
            y += part * rate
            v += part * w[of + n * i + k]
            a += (x - other) * (x - third) * scale * w[of + n * i + k]
        m.y[k], m.u[k], m.du[k] = here[1 + k] + h * y, v_0 + h * v, a
    if not follow(m, t + x * h):
        return False
    meet_all(m, t + x * h)
    for row in range(-frictions(m), 0):
        row_of(m, row)
    return True


@njit(**OPTIONS)
def dips(m, table, t, h, here, c, i, last):
    """Share of a step between its nodes i and i + 1 at which an open contact's gap dips below zero; else NEVER."""
    apart()
    w, k = m.w, at(m, c)
    x_a, x_b = shares(table, i, last)
    j = k + NODES + 4 * i
    p_0, m_0, p_1, m_1 = w[j], w[j + 1] * h, w[j + 4], w[j + 5] * h
    begin_x, g_0, r_0 = x_a, p_0, m_0
    tiny = near(m, c, 0.0, 0.0) if c >= 0 else w[j + 6]
    for _ in range(20):
        wide = x_b - x_a
        s = _lowest(p_0, m_0 * wide, p_1, m_1 * wide)
        if s < 0.0:
            return NEVER
        least = _cubic(p_0, m_0 * wide, p_1, m_1 * wide, s)
        if least > 0.1 * (larger(p_0, p_1) - least) + tiny:
            return NEVER
        x = x_a + s * wide
        if not between(m, table, t, h, here, x):
            return NEVER
        gap, rate = gap_of(m, c), w[k + GAP_RATE] * h
        if c < 0:
            gap, rate = stick_slip.slowing(m, c)
            gap, rate = gap + tiny, rate * h
        if gap <= 0.0:
            wide = x - begin_x
            return begin_x + wide * falls(g_0, r_0 * wide, gap, rate * wide)
        if abs(rate) * wide < tiny:
            return NEVER
        if rate < 0.0:
            x_a, p_0, m_0 = x, gap, rate
        else:
            x_b, p_1, m_1 = x, gap, rate
    return NEVER


@njit(**OPTIONS)
def falls(p_0, m_0, p_1, m_1):
    """Zero of the cubic where it falls; if it was never positive, the place where it falls."""
    low, high = 0.0, 1.0
    if p_0 <= 0.0:
        low = _lowest(-p_0, -m_0, -p_1, -m_1)
        if low < 0.0:
            return 0.0
        if _cubic(p_0, m_0, p_1, m_1, low) <= 0.0:
            return low
    for _ in range(52):
        middle_ = 0.5 * (low + high)
        if _cubic(p_0, m_0, p_1, m_1, middle_) > 0.0:
            low = middle_
        else:
            high = middle_
    return high


@njit(**OPTIONS)
def _lowest(p_0, m_0, p_1, m_1):
    """Minimum of the cubic, -1 without one inside."""
    a, b = 3.0 * (2.0 * (p_0 - p_1) + m_0 + m_1), 3.0 * (p_1 - p_0) - 2.0 * m_0 - m_1
    root = b * b - a * m_0
    if not root > 0.0:
        return -1.0
    root = math.sqrt(root)
    s = -m_0 / (b + root) if b > 0.0 else ((root - b) / a if a != 0.0 else -1.0)
    return s if 0.0 < s < 1.0 else -1.0


@njit(**OPTIONS)
def _cubic(p_0, m_0, p_1, m_1, s):
    """Hermite's cubic of two values and slopes at s in [0, 1]."""
    a, b = 2.0 * (p_0 - p_1) + m_0 + m_1, 3.0 * (p_1 - p_0) - 2.0 * m_0 - m_1
    return ((a * s + b) * s + m_0) * s + p_0
