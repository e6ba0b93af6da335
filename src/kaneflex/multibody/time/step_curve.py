"""Gap or slip along a step of the compiled integration: at its nodes, and between them on the polynomial of the stages.

The speed of slipping friction is monitored like an open contact's gap: its zero ends the step. For sticking friction,
the reserve of its force is monitored; its zero ends the step, too.

Cubics between the nodes predict zeros, which are checked on the polynomial.
"""

from __future__ import annotations

import math
from numba import njit

from kaneflex.multibody.compile.stand_ins import if_frictions
from kaneflex.multibody.dynamics.forces import load_sizes
from kaneflex.multibody.dynamics.loop_closure import follow
from kaneflex.multibody.compile.types import OPTIONS, basis, larger, no_inline
from kaneflex.multibody.model.layout import (
    ACROSS, BENDING, COORDINATES, FORCE, GAP, GAP_RATE, LIMIT, MODE, NODES, NORMAL, OPEN, SHIFT, SLIP, SLIPPING,
    SLIP_RATE, STAGE_A, STICKING, WHAT,
)  # fmt: skip
from kaneflex.multibody.unilateral import lugre
from kaneflex.multibody.unilateral.frictions import CLOSE, fill_friction, zero_friction, zero_speed
from kaneflex.multibody.unilateral.relative_rows import fill_contact, zero_gap
from kaneflex.multibody.unilateral.rows import (
    across, act_of, at, contacts, frictions, is_rigid, is_switch, law_at, magnitude, slip_sign,
)  # fmt: skip

NEVER = 2.0


@njit(**OPTIONS)
def gap_of(m, c):
    """Gap of a contact [m], beyond rounding if it has separated from a rigid side without speed."""
    k = at(m, c)
    return m.w[k + GAP] + m.w[k + SHIFT] if is_rigid(m, c) and m.w[k + MODE] == OPEN else m.w[k + GAP]


@njit(**OPTIONS)
def fill_contacts(m, t):
    """Evaluate all contacts and switches of laws at the current position."""
    if is_switch(m, contacts(m) - 1):
        load_sizes(m, t)
    for n in range(contacts(m)):
        fill_contact(m, n)


@njit(**OPTIONS)
def node_shares(table, i, last):
    """Shares of a step at its nodes i and i + 1, the ``last`` of which is its end."""
    return table.nodes[i - 1] if i > 0 else 0.0, table.nodes[i] if i + 1 < last else 1.0


@njit(**OPTIONS)
def evaluate(m, table, t, h, state, x):
    """Evaluate the step's polynomial after a share x of the step; False: a loop doesn't close."""
    no_inline()
    plan, w, c, n = m.plan, m.w, table.nodes, m.plan[COORDINATES]
    a_1, of = table.a_1, plan[STAGE_A]
    for k in range(n):
        v_0 = state[1 + n + k]
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
        m.y[k], m.u[k], m.du[k] = state[1 + k] + h * y, v_0 + h * v, a
    if not follow(m, t + x * h):
        return False
    fill_contacts(m, t + x * h)
    for row in range(-frictions(m), 0):
        fill_friction(m, row)
    return True


@if_frictions(None)
@njit(**OPTIONS)
def store_node(m, t, i):
    """Store what is monitored of all frictions, with its rate and tolerance, at node i of the step."""
    no_inline()
    w = m.w
    for n in range(-frictions(m), 0):
        k = at(m, n)
        j, mode = k + NODES + 4 * i, w[k + MODE]
        if mode == BENDING:
            w[j], w[j + 1] = w[k + SLIP], lugre.sliding_resistance(w, law_at(m, n), w[k + NORMAL], w[k + SLIP])
        elif mode == STICKING:
            bears = magnitude(m, n, FORCE) if m.acts[act_of(m, n), WHAT] != ACROSS else -1.0  # with its first row
            w[j], w[j + 1] = w[k + LIMIT] - bears, w[k + FORCE]
            w[j + 2], w[j + 3] = CLOSE * w[k + LIMIT] + zero_friction(m, n), w[j]
        elif mode == SLIPPING:
            w[j], w[j + 1] = slip_speed(m, n)
            w[j + 2] = zero_speed(m, n, t)


@if_frictions(None)
@njit(**OPTIONS)
def extrapolate_to_end(m, table, last):
    """Extrapolate the forces of sticking frictions from the stages to the end of a step that isn't a stage."""
    no_inline()
    w = m.w
    for n in range(-frictions(m) if table.ends[0] == 0.0 else 0, 0):
        j, total = at(m, n) + NODES, 0.0
        if w[at(m, n) + MODE] == STICKING:
            for i in range(3):
                total += w[j + 4 * (i + 1)] * basis(table.nodes, 1.0, i)
            w[j + 4 * last] = w[j + 4 * last + 3] = total


@njit(**OPTIONS)
def slip_speed(m, n):
    """Speed of slipping friction and its rate; with two rows less that of the second: turns by 45 deg end a step."""
    w, k, beside = m.w, at(m, n), across(m, n, SLIP)
    turns = across(m, n, SLIP_RATE) * (1.0 if beside >= 0.0 else -1.0)
    return slip_sign(m, n) * w[k + SLIP] - abs(beside), slip_sign(m, n) * w[k + SLIP_RATE] - turns


@njit(**OPTIONS)
def dips(m, table, t, h, state, c, i, last):
    """Share of a step between its nodes i and i + 1 at which an open contact's gap dips below zero; else NEVER."""
    no_inline()
    w, k = m.w, at(m, c)
    x_a, x_b = node_shares(table, i, last)
    j = k + NODES + 4 * i
    p_0, m_0, p_1, m_1 = w[j], w[j + 1] * h, w[j + 4], w[j + 5] * h
    begin_x, g_0, r_0 = x_a, p_0, m_0
    tiny = zero_gap(m, c, 0.0, 0.0) if c >= 0 else w[j + 6]
    for _ in range(20):
        wide = x_b - x_a
        s = _lowest(p_0, m_0 * wide, p_1, m_1 * wide)
        if s < 0.0:
            return NEVER
        least = _cubic(p_0, m_0 * wide, p_1, m_1 * wide, s)
        if least > 0.1 * (larger(p_0, p_1) - least) + tiny:
            return NEVER
        x = x_a + s * wide
        if not evaluate(m, table, t, h, state, x):
            return NEVER
        gap, rate = gap_of(m, c), w[k + GAP_RATE] * h
        if c < 0:
            gap, rate = slip_speed(m, c)
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
