"""Prescribed courses of drives, as coordinates of the tree."""

from __future__ import annotations

from numba import njit

from kaneflex.multibody.compile.types import OPTIONS, kernel, no_inline
from kaneflex.multibody.model.layout import (
    ACTS,
    CONTACTS,
    COURSE,
    COURSES,
    DRIVES,
    FRICTIONS,
    INPUT,
    LOADS,
    PRESCRIBED,
    SPRINGS,
    WORKS,
)


@njit(**OPTIONS)
def courses(m):
    """Number of drives with a prescribed course."""
    plan = m.plan
    acting = plan[SPRINGS] - plan[LOADS] + plan[DRIVES] - plan[FRICTIONS] + plan[ACTS] - plan[CONTACTS]
    return plan[WORKS] - 1 - acting


@njit(**OPTIONS)
def prescribe(m, t):
    """Set the coordinates that drives prescribe, with their rates."""
    no_inline()
    plan, w = m.plan, m.w
    kernel(m.kernels, COURSES)(t, m.p, w, plan[COURSE])
    loads = plan[SPRINGS] - plan[LOADS]
    for k in range(courses(m)):
        i, at = plan[plan[PRESCRIBED] + k], plan[COURSE] + 3 * k
        w[at + 2] += w[plan[INPUT] + loads + k]
        if i >= 0:
            m.y[i], m.u[i], m.du[i] = w[at], w[at + 1], w[at + 2]


@njit(**OPTIONS)
def leave_out(m, gradient):
    """Set a gradient's derivatives by prescribed coordinates to zero."""
    for k in range(courses(m)):
        if m.plan[m.plan[PRESCRIBED] + k] >= 0:
            m.w[gradient + m.plan[m.plan[PRESCRIBED] + k]] = 0.0
