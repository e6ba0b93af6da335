"""Compiled sizes of the loads on a tree's bodies, by the coordinates and speeds of joints in their laws."""

from __future__ import annotations

from numba import njit

from kaneflex.generated import joints as laws
from kaneflex.multibody.compile.stand_ins import if_changes
from kaneflex.multibody.compile.values import width
from kaneflex.multibody.unilateral import rows
from kaneflex.multibody.compile.types import OPTIONS, kernel, no_inline
from kaneflex.multibody.model.layout import (
    AT, COURSE_AT, DRIVES, INPUT, LOADS, MAGNITUDES, MEMORY, NUMBERS_AT, ON, ROW_AT, SIZE, SPRINGS, SUMS, TURN, WHAT, X,
)  # fmt: skip


@njit(**OPTIONS)
def joint_row(m, act):
    """Row of a joint in laws that is a cut, at SUMS: its coordinate and two rates, then its Jacobian; in space zero."""
    no_inline()
    if width(m) == 6:
        return
    w, j = m.w, m.acts[act, NUMBERS_AT]
    if m.acts[act, WHAT] == TURN:
        laws.turn(m.sections, m.acts[act, AT], m.acts[act, ON], w[j], w[j + 1], 0.0, w, m.plan[SUMS])
    else:
        laws.slide(m.sections, m.acts[act, AT], m.acts[act, ON], w[j], w[j + 1], 0.0, w, m.plan[SUMS])


@njit(**OPTIONS)
def load_sizes(m, t):
    """Magnitudes of the loads, which may depend on joint coordinates and their rates."""
    no_inline()
    plan, w = m.plan, m.w
    for n in range(plan[DRIVES], plan[LOADS]):
        k, i = plan[X] + 2 * (n - plan[DRIVES]), m.acts[n, COURSE_AT]
        second_rate = plan[X] + 2 * (plan[LOADS] - plan[DRIVES]) + n - plan[DRIVES]
        if i >= 0:
            w[k], w[k + 1], w[second_rate] = m.y[i], m.u[i], m.du[i]
        else:
            joint_row(m, n)
            w[k], w[k + 1], w[second_rate] = w[plan[SUMS]], w[plan[SUMS] + 1], w[plan[SUMS] + 2]
    if plan[LOADS] == plan[SPRINGS]:
        return
    take_sides(m)
    kernel(m.kernels, MAGNITUDES)(t, w, plan[X], m.p, w, plan[SIZE])
    for k in range(plan[SPRINGS] - plan[LOADS]):
        m.sizes[k] += w[plan[INPUT] + k]


@if_changes(None)
@njit(**OPTIONS)
def take_sides(m):
    """Select the branch of discontinuous laws by the side of zero of their switching arguments."""
    no_inline()
    first = m.plan[X] + 3 * (m.plan[LOADS] - m.plan[DRIVES])
    for n in range(rows.contacts(m)):
        if rows.is_switch(m, n):
            m.w[first + m.acts[rows.act_of(m, n), ROW_AT]] = m.w[rows.at(m, n) + MEMORY]
