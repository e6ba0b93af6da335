"""Compiled forces in space: inertia forces of the bodies less those of loads and springs.

Kane's equations of each free body (``kaneflex.generated.spatial``) along the partial velocities: M u' + h of the tree
(Kane & Levinson 1985, ch. 4 and 6).
"""

from __future__ import annotations

from numba import njit

from kaneflex.generated import spatial as laws
from kaneflex.generated import spatial_shapes as shape_laws
from kaneflex.multibody.spatial_bushings import FORCE, MOMENT, cushion
from kaneflex.multibody.spatial_tables import BODY, COORDINATE, COUNT, KIND, SHAPES, SPEED
from kaneflex.multibody.spatial_vectors import add_cross, less, times
from kaneflex.multibody.tables import OPTIONS, address, apart, together
from kaneflex.support.inner import once

_OWN = len(laws.BODY)
"""Numbers of a rigid body, which precede those of its shapes."""


@once
@njit(**OPTIONS)
def demand(m, k, sizes, with_mass):
    """Fill F, the bodies' inertia forces less loads and springs, h = F along the speeds, and M on request."""
    apart()
    x, count = k.x, len(k.h)
    for s in range(count):
        k.h[s] = 0.0
        for t in range(count if with_mass else 0):
            k.M[s, t] = 0.0
    for n in range(len(m.nodes)):
        F, R, own = k.F[n], k.R[n], m.nodes[n, BODY]
        for i in range(6):
            F[i] = 0.0
        if own < 0:
            continue
        for i in range(3):
            x[i] = x[3 + i] = x[6 + i] = 0.0
            for j in range(3):
                x[i] += R[j, i] * k.w[n, j]
                x[3 + i] += R[j, i] * (k.a[n, j] - m.gravity[j])
                x[6 + i] += R[j, i] * k.e[n, j]
        laws.demand(m.p, own, x, 0, x, 9)
        if m.nodes[n, KIND] == SHAPES:
            q, u, shapes = m.nodes[n, COORDINATE], m.nodes[n, SPEED], m.nodes[n, COUNT]
            shape_laws.shaped_demand(address(m.p), own + _OWN, shapes, address(x), 0, address(k.q), q, address(k.u), u,
                                     address(k.du), address(x), 9, address(k.h), u)  # fmt: skip
        times(R, x, 9, F, 0)
        times(R, x, 12, F, 3)
        if with_mass:
            _add_mass(m, k, n)
    _act(m, k, sizes)
    for n in range(len(m.nodes)):
        for s in range(count):
            for i in range(3):
                k.h[s] += k.F[n, i] * k.Jv[n, s, i] + k.F[n, 3 + i] * k.Jw[n, s, i]


@njit(**OPTIONS)
def _fill_inertia(m, k, n):
    """Mass matrix of a node's body in its axes at k.I: (6, 6), coupling to its shapes, and the shapes' own; returns
    their number."""
    apart()
    shapes = m.nodes[n, COUNT] if m.nodes[n, KIND] == SHAPES else 0
    laws.inertia(m.p, m.nodes[n, BODY], k.I, 0)
    if shapes:
        q = m.nodes[n, COORDINATE]
        shape_laws.shaped_inertia(address(m.p), m.nodes[n, BODY] + _OWN, shapes, address(k.q), q, address(k.I), 0)
    return shapes


@njit(**OPTIONS)
def pile(B, Y, M):
    """Add B^T Y to M, for all speeds; long enough to be vectorised."""
    together()
    for s in range(M.shape[0]):
        for i in range(B.shape[0]):
            share = B[i, s]
            for t in range(M.shape[1]):
                M[s, t] += share * Y[i, t]


@njit(**OPTIONS)
def _add_mass(m, k, n):
    """Add B^T I B to M, B the partial velocities of a body in its axes and the rates of its shapes."""
    apart()
    B, R, I, first = k.B, k.R[n], k.I, m.nodes[n, SPEED]
    shapes = _fill_inertia(m, k, n)
    for s in range(len(k.h)):
        for i in range(3):
            B[i, s] = B[3 + i, s] = 0.0
            for j in range(3):
                B[i, s] += R[j, i] * k.Jv[n, s, j]
                B[3 + i, s] += R[j, i] * k.Jw[n, s, j]
    count = len(k.h)
    for i in range(6):
        for t in range(count):
            own = t - first if first <= t < first + shapes else -1
            k.Y[i, t] = I[36 + shapes * i + own] if own >= 0 else 0.0
    pile(I[:36].reshape(6, 6), B, k.Y)
    pile(B, k.Y, k.M)
    if shapes:
        for j in range(shapes):
            for t in range(shapes):
                k.M[first + j, first + t] += I[36 + 6 * shapes + shapes * j + t]
        pile(I[36 : 36 + 6 * shapes].reshape(6, shapes), B, k.M[first : first + shapes])


@njit(**OPTIONS)
def deforming(m, k):
    """Contributions of shapes to energies and dissipated power, after ``accelerate``."""
    apart()
    x = k.x
    for i in range(4):
        k.deforming[i] = 0.0
    for n in range(len(m.nodes)):
        if m.nodes[n, KIND] != SHAPES:
            continue
        shapes, R, q, u = m.nodes[n, COUNT], k.R[n], m.nodes[n, COORDINATE], m.nodes[n, SPEED]
        for i in range(15):
            x[i] = 0.0
        for i in range(3):
            for j in range(3):
                x[i] += R[j, i] * k.v[n, j]
                x[3 + i] += R[j, i] * k.w[n, j]
                x[6 + i] += R[j, i] * m.gravity[j]
        shape_laws.shaped_energy(address(m.p), m.nodes[n, BODY] + _OWN, shapes, address(x), 0, address(k.q), q,
                                 address(k.u), u, address(x), 9)  # fmt: skip
        k.deforming[0] += x[9]
        k.deforming[1] += x[10]
        k.deforming[2] -= x[6] * x[12] + x[7] * x[13] + x[8] * x[14]
        k.deforming[3] += x[11]


@once
@njit(**OPTIONS)
def push(m, k, section, wrench, at, share):
    """Subtract a share of a force and a moment at a section from its body's inertia forces."""
    apart()
    on, x = m.on[section], k.x
    if on >= 0:
        less(k.sections[section], k.r[on], x, 90)
        x[93] = x[94] = x[95] = 0.0
        add_cross(x, 90, wrench, at, x, 93)
        for i in range(3):
            k.F[on, i] -= share * wrench[at + i]
            k.F[on, 3 + i] -= share * (wrench[at + 3 + i] + x[93 + i])


@njit(**OPTIONS)
def _act(m, k, sizes):
    """Subtract loads and springs from the bodies' inertia forces."""
    apart()
    x = k.x
    for i in range(84, 90):
        x[i] = 0.0
    for n in range(len(m.forces)):
        for i in range(3):
            x[84 + i] = k.axes[m.forces[n, 1], i]
        push(m, k, m.forces[n, 0], x, 84, sizes[m.forces[n, 2]])
    for n in range(len(m.springs)):
        laws.pull(k.sections.reshape(-1), m.springs[n, 0], m.springs[n, 1], m.stiffness[n, 0], m.stiffness[n, 1],
                  m.stiffness[n, 2], k.springs.reshape(-1), 7 * n)  # fmt: skip
        for i in range(3):
            x[84 + i] = k.springs[n, 2 + i]
        push(m, k, m.springs[n, 1], x, 84, 1.0)
        push(m, k, m.springs[n, 0], x, 84, -1.0)
    for i in range(3):
        x[84 + i] = 0.0
    for n in range(len(m.torques)):
        for i in range(3):
            x[87 + i] = k.axes[m.torques[n, 2], i]
        push(m, k, m.torques[n, 1], x, 84, sizes[m.torques[n, 3]])
        push(m, k, m.torques[n, 0], x, 84, -sizes[m.torques[n, 3]])
    for n in range(len(m.twists)):
        stiffness, damping, rate, turned = m.torsion[n, 0], m.torsion[n, 1], 0.0, k.twists[n, 0] - m.torsion[n, 2]
        first, second = m.twists[n, 0], m.twists[n, 1]
        for i in range(3):
            x[87 + i] = k.axes[m.twists[n, 2], i]
            rate += x[87 + i] * (k.sections[second, 9 + i] - k.sections[first, 9 + i])
        torque = stiffness * turned + damping * rate
        k.twists[n, 1], k.twists[n, 2], k.twists[n, 3] = torque, 0.5 * stiffness * turned**2, damping * rate**2
        push(m, k, second, x, 84, -torque)
        push(m, k, first, x, 84, torque)
    for n in range(len(m.bushings)):
        cushion(m, k, n)
        first, second = m.bushings[n, 0], m.bushings[n, 1]
        for i in range(6):
            x[84 + i] = 0.0
        for i in range(3):
            for j in range(3):
                x[84 + i] += k.axes[m.bushings[n, 2] + j, i] * k.bushings[n, FORCE + j]
                x[87 + i] += k.axes[m.bushings[n, 2] + j, i] * k.bushings[n, MOMENT + j]
        push(m, k, second, x, 84, -1.0)
        less(k.sections[second], k.sections[first], x, 0)
        add_cross(x, 0, x, 84, x, 87)
        push(m, k, first, x, 84, 1.0)
