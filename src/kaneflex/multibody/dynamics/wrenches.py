"""Wrenches on sections: a force and a moment, D numbers like a twist."""

from __future__ import annotations

from numba import njit

from kaneflex.multibody.compile.types import OPTIONS, no_inline, shifted
from kaneflex.multibody.compile.values import after, row_length, twists
from kaneflex.multibody.dynamics.algebra import axpy, dot, force_at, minus
from kaneflex.multibody.dynamics.axes import base, freedoms, to_axes
from kaneflex.multibody.dynamics.kinematics import section_place
from kaneflex.multibody.model.tree_layout import COUNT, PARENT, ROW_OF, SPEED
from kaneflex.support.inner import once


@once
@njit(**OPTIONS)
def push(m, n, wrench):
    """Subtract a wrench on a section from the inertia forces of its body."""
    no_inline()
    on = m.on[n]
    if on >= 0:
        wrench = force_at(wrench, minus(section_place(m, n), m.r[on]))
        m.wrenches[on] = axpy(-1.0, wrench, m.wrenches[on])


@njit(**OPTIONS)
def row_wrench(m, row, side):
    """Wrench of a row's unit reaction on one of its sections."""
    return twists(m, shifted(m.rows, row_length(m) * row + 3))[side]


@once
@njit(**OPTIONS)
def along(m, n, wrench, bends, out):
    """Add the generalised forces of a section's wrench along all coordinates at ``out``; shapes only if requested.

    The wrench is passed inwards from node to node.
    """
    no_inline()
    node, w = m.on[n], after(m.w, out)
    if node < 0:
        return
    wrench = force_at(wrench, minus(section_place(m, n), m.r[node]))
    while node >= 0:
        s, parent = m.nodes[node, SPEED], m.nodes[node, PARENT]
        if m.nodes[node, ROW_OF] < 0:
            for j in range(s, s + freedoms(m, node)):
                w[j] += dot(m.S[j], wrench)
        elif bends:
            own = to_axes(m, base(m, node), wrench)
            for j in range(m.nodes[node, COUNT]):
                w[s + j] += dot(m.phi[m.nodes[node, ROW_OF] + j], own)
        if parent >= 0:
            wrench = force_at(wrench, minus(m.r[node], m.r[parent]))
        node = parent
