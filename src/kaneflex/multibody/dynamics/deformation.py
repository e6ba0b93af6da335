"""Sections of deforming bodies relative to their axes: displacements, rotations, and twists by shapes.

Functions of the same name in the plane and in space: the type of the tables selects them. All vectors are in the axes
of the body.
"""

from __future__ import annotations

from numba import njit

from kaneflex.generated import shapes
from kaneflex.generated import spatial_shapes as laws
from kaneflex.multibody.compile.stand_ins import if_stiffness
from kaneflex.multibody.compile.types import OPTIONS, no_inline
from kaneflex.multibody.compile.values import after, by_size, numbers_of, width
from kaneflex.multibody.dynamics.algebra import axpy, first, joined, last, plus, scaled, twist_at
from kaneflex.multibody.dynamics.arrays import NODES
from kaneflex.multibody.model.tree_layout import AT, COUNT, KIND, ROW_OF, SHAPES, SPEED
from kaneflex.support.inner import once


@njit(**OPTIONS)
def displace(m, n):
    """Displacement and rotation of a section; sets its twists for a unit of every shape."""
    no_inline()
    count, row = m.nodes[n, COUNT], 3 * m.nodes[n, ROW_OF]
    return shapes.displace(m.block, m.nodes[n, AT], count, m.y, m.nodes[n, SPEED], numbers_of(m.phi), row)


@njit(**OPTIONS)
def _displace_in_space(m, n):
    """Displacement N q + 1/2 G q q.

    The section's twists for a unit of every shape are, as G is symmetric, N_j + G_jk q_k and T psi_j.
    """
    no_inline()
    count, o, q = m.nodes[n, COUNT], m.nodes[n, AT], after(m.y, m.nodes[n, SPEED])
    _section(m, _shaped(m, n, 3, q), (0.0, 0.0, 0.0))
    for i in range(3):
        k = 6 + 3 * i
        m.bent[3 * n + i] = m.x[k], m.x[k + 1], m.x[k + 2]
    phi, at, moved = after(m.phi, m.nodes[n, ROW_OF]), o + 6 * count, (0.0, 0.0, 0.0)
    for j in range(count):
        v, psi = (m.block[o + j], m.block[o + count + j], m.block[o + 2 * count + j]), o + 3 * count + j
        phi[j] = joined(v, _of_x(m, 15, (m.block[psi], m.block[psi + count], m.block[psi + 2 * count])))
        moved = axpy(q[j], v, moved)
    for _ in range(int(m.block[at])):
        i, j = int(m.block[at + 1]), int(m.block[at + 2])
        g = m.block[at + 3], m.block[at + 4], m.block[at + 5]
        phi[i] = joined(axpy(q[j], g, first(phi[i])), last(phi[i]))
        if i != j:
            phi[j] = joined(axpy(q[i], g, first(phi[j])), last(phi[j]))
        moved = axpy((0.5 if i == j else 1.0) * q[i] * q[j], g, moved)
        at += 5
    return moved


@once
@njit(**OPTIONS)
def _shaped(m, n, row, q):
    """Vector of the rows N q or psi q (``row`` 0 or 3) of a station, coordinates from q on."""
    no_inline()
    count, o = m.nodes[n, COUNT], m.nodes[n, AT] + m.nodes[n, COUNT] * row
    x = y = z = 0.0
    for s in range(count):
        x += m.block[o + s] * q[s]
        y += m.block[o + count + s] * q[s]
        z += m.block[o + 2 * count + s] * q[s]
    return x, y, z


@njit(**OPTIONS)
def _section(m, theta, rate):
    """Rotation R, T and T' theta' of a section with its angles and their rates, at x[6], x[15] and x[24]."""
    for i in range(3):
        m.x[i], m.x[3 + i] = theta[i], rate[i]
    laws.section(m.x, 0, m.x, 6)


@njit(**OPTIONS)
def _of_x(m, k, a):
    """The matrix at x[k], row by row, times a vector."""
    return (m.x[k] * a[0] + m.x[k + 1] * a[1] + m.x[k + 2] * a[2],
            m.x[k + 3] * a[0] + m.x[k + 4] * a[1] + m.x[k + 5] * a[2],
            m.x[k + 6] * a[0] + m.x[k + 7] * a[1] + m.x[k + 8] * a[2])  # fmt: skip


@njit(**OPTIONS)
def bias_acceleration(m, n):
    """Acceleration of a section at constant speeds of the shapes: G u u and T' theta'."""
    no_inline()
    return shapes.growth(m.block, m.nodes[n, AT], m.nodes[n, COUNT], m.u, m.nodes[n, SPEED]), 0.0, 0.0


@njit(**OPTIONS)
def _bias_acceleration_in_space(m, n):
    no_inline()
    s = m.nodes[n, SPEED]
    u, x, at = after(m.u, s), (0.0, 0.0, 0.0), m.nodes[n, AT] + 6 * m.nodes[n, COUNT]
    _section(m, _shaped(m, n, 3, after(m.y, s)), _shaped(m, n, 3, u))
    for _ in range(int(m.block[at])):
        i, j = int(m.block[at + 1]), int(m.block[at + 2])
        share = (1.0 if i == j else 2.0) * u[i] * u[j]
        x = axpy(share, (m.block[at + 3], m.block[at + 4], m.block[at + 5]), x)
        at += 5
    return joined(x, (m.x[24], m.x[25], m.x[26]))


displace = by_size(displace, _displace_in_space)
bias_acceleration = by_size(bias_acceleration, _bias_acceleration_in_space)


@if_stiffness(None)
@njit(**OPTIONS)
def deform(m):
    """Displacements and rotations of all sections that shapes move, and their twists for a unit of every shape."""
    no_inline()
    for n in range(m.counts[NODES]):
        if m.nodes[n, ROW_OF] >= 0:
            m.moved[n] = displace(m, n)
            if m.nodes[n, KIND] == SHAPES:
                _turn_back(m, n)


@njit(**OPTIONS)
def _turn_back(m, n):
    """Twists of a body's axes relative to the section of its joint, and the section's place in these axes."""
    phi = after(m.phi, m.nodes[n, ROW_OF])
    m.offset[n] = plus(m.numbers[width(m) * (n + 1) - 1], m.moved[n])
    back = scaled(-1.0, m.offset[n])
    for j in range(m.nodes[n, COUNT]):
        phi[j] = scaled(-1.0, twist_at(phi[j], back))
