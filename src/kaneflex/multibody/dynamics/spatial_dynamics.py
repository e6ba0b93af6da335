"""Compiled dynamics of a mechanism in space: loop closure, accelerations, reactions.

A *choice* names independent rows of the cuts, and divides the speeds into dependent, prescribed and independent ones,
as many of these as degrees of freedom (Kane & Levinson 1985, sec. 2.13: nonholonomic partial velocities, as loops are
eliminated here at the level of speeds). All coordinates are integrated; the loops are closed at every step.
"""

from __future__ import annotations

import math

from numba import njit
from numba.types import CPointer, int64

from kaneflex.multibody.compile.values import after, copy_vectors
from kaneflex.multibody.dynamics import dense_lu
from kaneflex.multibody.dynamics.algebra import force_at, joined, minus, plus
from kaneflex.multibody.dynamics.constrained import ALL, HARD, LENT, REAL_ROWS, factorise_rows, solve_rows
from kaneflex.multibody.dynamics.spatial_forces import demand, inertias, momenta, push
from kaneflex.multibody.dynamics.spatial_kinematics import accelerate, directions, geometry, move, place
from kaneflex.multibody.dynamics.spatial_work import BODIES, CUTS, NODES, PHI, ROWS, SHAPES_OF_ALL, SPEEDS, SQUARES
from kaneflex.multibody.model.layout import OPTIONS, Fixed, Handed, N, apart, larger
from kaneflex.multibody.model.spatial_layout import (
    BALL,
    COINCIDE,
    COORDINATE,
    COUNT,
    FIRST,
    KIND,
    PARENT,
    ROW,
    SECOND,
    SHAPES,
    SLIDE,
    SPEED,
    TURN,
    WHAT,
)  # fmt: skip
from kaneflex.support.inner import once

_MOST = 30
"""Newton steps to close a loop; from the last instant it takes two or three."""
_CLOSED = 1e-13
"""Last Newton step, in rad or sizes of the mechanism, up to which a loop counts as closed."""
_LARGEST = 0.3
"""Largest Newton step: the linearisation is poor beyond it."""

KEPT_ROWS, PRESCRIBED, INDEPENDENT, LENDING = range(4)
"""Places of a choice's ``counts``: rows, which are as many as dependent speeds; prescribed and independent speeds;
speeds with virtual inertia."""
CHOICE = Handed(
    "Choice of speeds", counts=Fixed(1), rows=Fixed(1), dependent=Fixed(1), prescribed=Fixed(1), independent=Fixed(1),
    lending=Fixed(1), lent=N, measure=N, row_measure=N, room=N, transposed=N, step=N, momentum=N, basis=N,
    pivots=CPointer(int64), mass=REAL_ROWS,
)  # fmt: skip
"""Numbers of the independent rows of the cuts and of dependent, prescribed and independent speeds; virtual inertia of
all speeds, and which have some; the measures of speeds and of rows (1 rad, or the mechanism's size); factors of J by
dependent speeds, and of its transpose, with a right-hand side; a step, momenta, the basis and pivots; factors of the
mass matrix."""


@njit(**OPTIONS)
def advance(m, q, step):
    """Move the coordinates by a step of the speeds: a ball turns by the rotation vector in its axes."""
    apart()
    for n in range(m.counts[NODES]):
        kind, k, s = m.nodes[n, KIND], m.nodes[n, COORDINATE], m.nodes[n, SPEED]
        if kind == BALL:
            x, y, z = step[s], step[s + 1], step[s + 2]
            angle = math.sqrt(x * x + y * y + z * z)
            share = 0.5 if angle < 1e-8 else math.sin(0.5 * angle) / angle
            _compose(q, k, math.cos(0.5 * angle), share * x, share * y, share * z)
        elif kind == TURN or kind == SLIDE:
            q[k] += step[s]
        elif kind == SHAPES:
            for i in range(m.nodes[n, COUNT]):
                q[k + i] += step[s + i]


@njit(**OPTIONS)
def _compose(q, k, w, x, y, z):
    """The quaternion at q[k] times another, of unit length again."""
    apart()
    a, b, c, d = q[k], q[k + 1], q[k + 2], q[k + 3]
    w, x, y, z = (
        a * w - b * x - c * y - d * z, a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x, a * z + b * y - c * x + d * w,
    )  # fmt: skip
    length = math.sqrt(w * w + x * x + y * y + z * z)
    q[k], q[k + 1], q[k + 2], q[k + 3] = w / length, x / length, y / length, z / length


@njit(**OPTIONS)
def coordinate_rates(m, q, u, out):
    """q' of the speeds: of a ball 1/2 q (0, omega)."""
    apart()
    for n in range(m.counts[NODES]):
        kind, k, s = m.nodes[n, KIND], m.nodes[n, COORDINATE], m.nodes[n, SPEED]
        if kind == BALL:
            a, b, c, d = q[k], q[k + 1], q[k + 2], q[k + 3]
            x, y, z = u[s], u[s + 1], u[s + 2]
            out[k], out[k + 1] = -0.5 * (b * x + c * y + d * z), 0.5 * (a * x + c * z - d * y)
            out[k + 2], out[k + 3] = 0.5 * (a * y + d * x - b * z), 0.5 * (a * z + b * y - c * x)
        elif kind == TURN or kind == SLIDE:
            out[k] = u[s]
        elif kind == SHAPES:
            for i in range(m.nodes[n, COUNT]):
                out[k + i] = u[s + i]


@njit(**OPTIONS)
def close(m, c):
    """Close the loops by the dependent coordinates (Newton's method); True if it converges.

    The factors of J remain available.
    """
    apart()
    count, A, step, speeds = c.counts[KEPT_ROWS], c.room, c.step, m.counts[SPEEDS]
    for s in range(speeds):
        step[s] = 0.0
    for turn in range(_MOST):
        place(m)
        directions(m)
        for i in range(count):
            for j in range(count):
                A[count * i + j] = m.J[speeds * c.rows[i] + c.dependent[j]]
        if not dense_lu.factorise(A, 0, count, c.pivots, 0):
            return False
        if count == 0:
            return True
        first = count * count
        for i in range(count):
            A[first + i] = -m.rows[5 * c.rows[i]][0]
        dense_lu.substitute(A, 0, count, c.pivots, 0, first)
        largest = 0.0
        for i in range(count):
            largest = larger(largest, abs(A[first + i]) / c.measure[c.dependent[i]])
        if not largest < 1e6:
            return False
        if largest < _CLOSED or (turn > 4 and largest < 100.0 * _CLOSED):
            return True
        shorter = _LARGEST / larger(_LARGEST, largest)
        for i in range(count):
            step[c.dependent[i]] = shorter * A[first + i]
        advance(m, m.q, step)
    return False


@once
@njit(**OPTIONS)
def tie(m, c, u, rate):
    """Fill dependent entries of u, so that the independent rows' rates vanish: J u = 0 with u's other entries (``rate``
    1), or J u + c = 0 with c the second rates of the rows (2), to which these already contribute."""
    apart()
    count, A, speeds = c.counts[KEPT_ROWS], c.room, m.counts[SPEEDS]
    first = count * count
    for i in range(count):
        row, J = c.rows[i], after(m.J, speeds * c.rows[i])
        A[first + i] = -m.rows[5 * row][2] if rate == 2 else 0.0
        if rate == 1:
            for n in range(c.counts[PRESCRIBED]):
                A[first + i] -= J[c.prescribed[n]] * u[c.prescribed[n]]
            for n in range(c.counts[INDEPENDENT]):
                A[first + i] -= J[c.independent[n]] * u[c.independent[n]]
    dense_lu.substitute(A, 0, count, c.pivots, 0, first)
    for i in range(count):
        u[c.dependent[i]] = A[first + i]


@njit(**OPTIONS)
def basis(m, c):
    """Basis B of u = B u_independent + prescribed terms, (independent, speeds): row j is u for a unit of the j-th."""
    apart()
    A, count, speeds = c.room, c.counts[KEPT_ROWS], m.counts[SPEEDS]
    first = count * count
    for j in range(c.counts[INDEPENDENT]):
        B = after(c.basis, speeds * j)
        for s in range(speeds):
            B[s] = 0.0
        B[c.independent[j]] = 1.0
        for i in range(count):
            A[first + i] = -m.J[speeds * c.rows[i] + c.independent[j]]
        dense_lu.substitute(A, 0, count, c.pivots, 0, first)
        for i in range(count):
            B[c.dependent[i]] = A[first + i]


@njit(**OPTIONS)
def react(m, c, h):
    """Multipliers of the kept rows that take off the generalised forces h of the dependent speeds, behind the factors
    of the transposed J; False: singular."""
    apart()
    count, A, speeds = c.counts[KEPT_ROWS], c.transposed, m.counts[SPEEDS]
    for i in range(count):
        for j in range(count):
            A[count * i + j] = m.J[speeds * c.rows[j] + c.dependent[i]]
        A[count * count + i] = h[c.dependent[i]]
    if not dense_lu.factorise(A, 0, count, c.pivots, count):
        return False
    dense_lu.substitute(A, 0, count, c.pivots, count, count * count)
    return True


@njit(**OPTIONS)
def reduced(m, c, h, out):
    """Generalised forces of the independent speeds: B h."""
    apart()
    count, speeds = c.counts[KEPT_ROWS], m.counts[SPEEDS]
    react(m, c, h)
    for e in range(c.counts[INDEPENDENT]):
        s = c.independent[e]
        out[e] = h[s]
        for i in range(count):
            out[e] -= c.transposed[count * count + i] * m.J[speeds * c.rows[i] + s]


@njit(**OPTIONS)
def missed(m, c, with_mass, out):
    """Residual B h of the equations of the independent speeds by given rates of these and of prescribed ones, with
    closed loops and dependent speeds. Fills the rates of dependent speeds, and the inertias where wanted."""
    apart()
    move(m)
    for n in range(c.counts[KEPT_ROWS]):
        m.du[c.dependent[n]] = 0.0
    accelerate(m)
    if c.counts[KEPT_ROWS]:
        tie(m, c, m.du, 2)
        accelerate(m)
    demand(m)
    reduced(m, c, m.h, out)
    if with_mass:
        inertias(m)
        geometry(m)


@once
@njit(**OPTIONS)
def fill(m, c, f, h):
    """Fill matrices and constraints of a tree with M + h C + h^2 K of its shapes, after ``inertias`` and ``geometry``;
    other rows may follow."""
    apart()
    tree, speeds, rows = f.tree, m.counts[SPEEDS], f.rows
    for b in range(m.counts[BODIES]):
        tree.place[b], tree.arm[b] = m.place[b], m.arm[b]
    copy_vectors(m.I, tree.I, 6 * m.counts[BODIES])
    copy_vectors(m.E, tree.E, m.counts[SHAPES_OF_ALL])
    copy_vectors(m.phi, tree.phi, m.counts[PHI])
    copy_vectors(m.joint_axes, tree.S, speeds)
    for k in range(m.counts[SQUARES]):
        tree.L[k] = m.L[k] + h * (m.C[k] + h * m.K[k])
    for s in range(speeds):
        tree.D[s] = c.lent[s]
    rows[HARD] = c.counts[KEPT_ROWS]
    rows[LENT] = rows[ALL] = c.counts[KEPT_ROWS] + c.counts[LENDING]
    for i in range(rows[LENT]):
        for s in range(speeds):
            f.a[speeds * i + s] = m.J[speeds * c.rows[i] + s] if i < rows[HARD] else 0.0
            f.b[speeds * i + s] = 0.0
        if i >= rows[HARD]:
            s = c.lending[i - rows[HARD]]
            f.a[speeds * i + s], f.b[speeds * i + s] = 1.0, -c.lent[s]


@njit(**OPTIONS)
def solve_reduced(m, c, f, r):
    """Accelerations of all speeds at the tree's y, from generalised forces r of the independent ones."""
    apart()
    y = f.tree.y
    for s in range(m.counts[SPEEDS]):
        y[s] = 0.0
    for e in range(c.counts[INDEPENDENT]):
        y[c.independent[e]] = r[e]
    solve_rows(f)


@njit(**OPTIONS)
def accelerations(m, c):
    """Accelerations du at closed loops (``close``) and consistent speeds (``tie``), from the prescribed rates in it.

    False if the mass matrix is singular.
    """
    apart()
    for n in range(c.counts[INDEPENDENT]):
        m.du[c.independent[n]] = 0.0
    missed(m, c, True, c.step)
    if c.counts[INDEPENDENT] == 0:
        return True
    fill(m, c, c.mass, 0.0)
    if not factorise_rows(c.mass, 0.0):
        return False
    solve_reduced(m, c, c.mass, c.step)
    x, y = c.step, c.mass.tree.y
    for s in range(m.counts[SPEEDS]):
        x[s] = -y[s] if c.mass.tree.free[s] != 0 else 0.0
        m.du[s] += x[s]
    if c.counts[PRESCRIBED]:  # h belongs to the accelerations again: drives exert the rest of it
        momenta(m, x, c.momentum)
        for s in range(m.counts[SPEEDS]):
            m.h[s] += c.momentum[s]
    return True


@njit(**OPTIONS)
def exerted(m, c):
    """Forces of joints after ``accelerations``: multipliers of the cuts' rows, zero for redundant ones; wrenches of the
    nodes; along every speed generalised forces beyond loads, springs and cuts: of drives, along prescribed ones.
    """
    apart()
    demand(m)
    count, speeds = c.counts[KEPT_ROWS], m.counts[SPEEDS]
    if not react(m, c, m.h):
        return False
    for row in range(m.counts[ROWS]):
        m.multipliers[row] = 0.0
    for i in range(count):
        m.multipliers[c.rows[i]] = c.transposed[count * count + i]
    for s in range(speeds):
        m.along[s] = m.h[s]
        for i in range(count):
            m.along[s] -= m.J[speeds * c.rows[i] + s] * c.transposed[count * count + i]
    pass_on(m)
    return True


@njit(**OPTIONS)
def pass_on(m):
    """Wrenches of the tree's joints from the bodies' residuals at F and the cuts' multipliers."""
    apart()
    for c in range(m.counts[CUTS]):
        for j in range(m.cuts[c, ROW], m.cuts[c, ROW] + (3 if m.cuts[c, WHAT] == COINCIDE else 1)):
            push(m, m.cuts[c, FIRST], joined(m.rows[5 * j + 1], m.rows[5 * j + 2]), m.multipliers[j])
            push(m, m.cuts[c, SECOND], joined(m.rows[5 * j + 3], m.rows[5 * j + 4]), m.multipliers[j])
    for n in range(m.counts[NODES]):
        m.wrenches[n] = m.F[n]
    for n in range(m.counts[NODES] - 1, -1, -1):
        parent = m.nodes[n, PARENT]
        if parent >= 0:
            passed = force_at(m.wrenches[n], minus(m.r[n], m.r[parent]))
            m.wrenches[parent] = plus(m.wrenches[parent], passed)
