"""Compiled dynamics of a mechanism in space: loop closure, elimination of dependent speeds, reactions.

A *choice* names independent rows of the cuts, and divides the speeds into dependent, prescribed and independent ones,
as many of these as degrees of freedom (Kane & Levinson 1985, sec. 2.13: nonholonomic partial velocities, as loops are
eliminated here at the level of speeds). All coordinates are integrated; the loops are closed at every step.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from kaneflex.multibody import dense_lu
from kaneflex.multibody.spatial_forces import demand, push
from kaneflex.multibody.spatial_kinematics import accelerate, move, partials, place
from kaneflex.multibody.spatial_tables import (
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
from kaneflex.multibody.spatial_vectors import add_cross
from kaneflex.multibody.tables import OPTIONS, apart, larger, together
from kaneflex.support.inner import once

_MOST = 30
"""Newton steps to close a loop; from the last instant it takes two or three."""
_CLOSED = 1e-13
"""Last Newton step, in rad or sizes of the mechanism, up to which a loop counts as closed."""
_LARGEST = 0.3
"""Largest Newton step: the linearisation is poor beyond it."""


class Choice(NamedTuple):
    """Numbers of the independent rows of the cuts and of dependent, prescribed and independent speeds; the measures of
    speeds and of rows (1 rad, or the mechanism's size); room for factors, a step, the basis and pivots."""

    rows: np.ndarray
    dependent: np.ndarray
    prescribed: np.ndarray
    independent: np.ndarray
    measure: np.ndarray
    row_measure: np.ndarray
    room: np.ndarray
    step: np.ndarray
    basis: np.ndarray
    pivots: np.ndarray


@njit(**OPTIONS)
def advance(m, q, step):
    """Move the coordinates by a step of the speeds: a ball turns by the rotation vector in its axes."""
    apart()
    for n in range(len(m.nodes)):
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
    for n in range(len(m.nodes)):
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
def _fill(k, choice, A):
    """Factorise J of the independent rows by the dependent speeds in A; False: singular."""
    apart()
    count = len(choice.dependent)
    for i in range(count):
        for j in range(count):
            A[count * i + j] = k.J[choice.rows[i], choice.dependent[j]]
    return dense_lu.factorise(A, 0, count, choice.pivots, 0)


@njit(**OPTIONS)
def close(m, q, k, choice):
    """Close the loops by the dependent coordinates (Newton's method); True if it converges.

    The factors of J remain available.
    """
    apart()
    count, A, step = len(choice.dependent), choice.room, choice.step
    for s in range(len(step)):
        step[s] = 0.0
    for turn in range(_MOST):
        place(m, q, k)
        partials(m, k)
        if not _fill(k, choice, A):
            return False
        if count == 0:
            return True
        first = count * count
        for i in range(count):
            A[first + i] = -k.rows[choice.rows[i], 0]
        dense_lu.substitute(A, 0, count, choice.pivots, 0, first)
        largest = 0.0
        for i in range(count):
            largest = larger(largest, abs(A[first + i]) / choice.measure[choice.dependent[i]])
        if not largest < 1e6:
            return False
        if largest < _CLOSED or (turn > 4 and largest < 100.0 * _CLOSED):
            return True
        shorter = _LARGEST / larger(_LARGEST, largest)
        for i in range(count):
            step[choice.dependent[i]] = shorter * A[first + i]
        advance(m, q, step)
    return False


@once
@njit(**OPTIONS)
def tie(k, choice, u, column, less):
    """Fill dependent entries of u to satisfy J u + c = 0 in the independent rows, c a column of the rows (-1: none).

    ``less``: all other entries count in c already.
    """
    apart()
    count, A = len(choice.dependent), choice.room
    first = count * count
    for i in range(count):
        row = choice.rows[i]
        A[first + i] = -k.rows[row, column] if column >= 0 else 0.0
        for n in range(0 if less else len(choice.prescribed)):
            A[first + i] -= k.J[row, choice.prescribed[n]] * u[choice.prescribed[n]]
        for n in range(0 if less else len(choice.independent)):
            A[first + i] -= k.J[row, choice.independent[n]] * u[choice.independent[n]]
    dense_lu.substitute(A, 0, count, choice.pivots, 0, first)
    for i in range(count):
        u[choice.dependent[i]] = A[first + i]


@njit(**OPTIONS)
def basis(k, choice):
    """Basis B of u = B u_independent + prescribed terms, (independent, speeds): row j is u for a unit of the j-th."""
    apart()
    B, A, count = choice.basis, choice.room, len(choice.dependent)
    first = count * count
    for j in range(len(choice.independent)):
        for s in range(B.shape[1]):
            B[j, s] = 0.0
        B[j, choice.independent[j]] = 1.0
        for i in range(count):
            A[first + i] = -k.J[choice.rows[i], choice.independent[j]]
        dense_lu.substitute(A, 0, count, choice.pivots, 0, first)
        for i in range(count):
            B[j, choice.dependent[i]] = A[first + i]


@once
@njit(**OPTIONS)
def weigh(b, full, out):
    """Product out = b full of a vector and a matrix of all speeds."""
    together()
    for t in range(len(out)):
        out[t] = 0.0
    for s in range(len(b)):
        share = b[s]
        if share != 0.0:
            for t in range(len(out)):
                out[t] += share * full[s, t]


@njit(**OPTIONS)
def accelerations(m, k, choice, u, du, sizes):
    """Accelerations du at closed loops (``close``) and consistent speeds (``tie``), from the prescribed rates in it.

    Kane's equations of the independent speeds: B (M B^T x + h) = 0, h with prescribed and quadratic terms. False if the
    mass matrix is singular or not positive definite: shapes of the first order can remove more inertia than there is.
    """
    apart()
    move(m, u, k)
    for n in range(len(choice.dependent)):
        du[choice.dependent[n]] = 0.0
    for n in range(len(choice.independent)):
        du[choice.independent[n]] = 0.0
    accelerate(m, u, du, k)
    free, speeds = len(choice.independent), len(u)
    if free:
        demand(m, k, sizes, True)
        basis(k, choice)
    if len(choice.dependent):
        tie(k, choice, du, 2, True)
    if free == 0:
        return True
    for s in range(speeds):
        for n in range(len(choice.dependent)):
            k.h[s] += k.M[s, choice.dependent[n]] * du[choice.dependent[n]]
    B, A = choice.basis, choice.room
    at = len(choice.dependent) ** 2 + len(choice.dependent)
    x = at + free * free
    for i in range(free):
        asked = 0.0
        for s in range(speeds):
            asked -= B[i, s] * k.h[s]
        A[x + i] = asked
        weigh(B[i], k.M, choice.step)
        for j in range(i + 1):
            mass = 0.0
            for s in range(speeds):
                mass += choice.step[s] * B[j, s]
            A[at + free * i + j] = mass
    if not dense_lu.factorise_definite(A, at, free):
        return False
    dense_lu.substitute_definite(A, at, free, x)
    for s in range(speeds):
        choice.step[s] = 0.0
    for i in range(free):
        for s in range(speeds):
            choice.step[s] += A[x + i] * B[i, s]
    for s in range(speeds):
        du[s] += choice.step[s]
        for n in range(speeds):
            k.h[s] += k.M[s, n] * choice.step[n]
    return True


@njit(**OPTIONS)
def missed(m, k, choice, u, du, sizes, with_mass, out):
    """Residual -B h of the equations of the independent speeds by given rates of these and of prescribed ones, with
    closed loops and dependent speeds. Fills the rates of dependent speeds, and M where wanted."""
    apart()
    move(m, u, k)
    for n in range(len(choice.dependent)):
        du[choice.dependent[n]] = 0.0
    accelerate(m, u, du, k)
    if len(choice.dependent):
        tie(k, choice, du, 2, True)
        accelerate(m, u, du, k)
    demand(m, k, sizes, with_mass)
    if len(choice.dependent) or with_mass:
        basis(k, choice)
    for e in range(len(choice.independent)):
        out[e] = -k.h[choice.independent[e]]
        for n in range(len(choice.dependent)):
            out[e] -= choice.basis[e, choice.dependent[n]] * k.h[choice.dependent[n]]


@njit(**OPTIONS)
def exerted(m, k, choice, sizes, multipliers, wrenches, drives):
    """Forces of joints after ``accelerations``.

    multipliers (n_rows,): of the cuts' rows, zero for redundant ones; wrenches (n_nodes, 6): force and moment about its
    origin that a node's joint exerts on it; drives (n_speeds,): generalised forces along every speed beyond loads,
    springs and cuts: of drives, along prescribed ones.
    """
    apart()
    demand(m, k, sizes, False)
    count, A = len(choice.dependent), choice.room
    first = count * count
    for i in range(count):
        for j in range(count):
            A[count * i + j] = k.J[choice.rows[j], choice.dependent[i]]
        A[first + i] = k.h[choice.dependent[i]]
    if not dense_lu.factorise(A, 0, count, choice.pivots, 0):
        return False
    dense_lu.substitute(A, 0, count, choice.pivots, 0, first)
    for row in range(len(multipliers)):
        multipliers[row] = 0.0
    for i in range(count):
        multipliers[choice.rows[i]] = A[first + i]
    for s in range(len(drives)):
        drives[s] = k.h[s]
        for i in range(count):
            drives[s] -= k.J[choice.rows[i], s] * A[first + i]
    pass_on(m, k, multipliers, wrenches)
    return _fill(k, choice, A)


@njit(**OPTIONS)
def pass_on(m, k, multipliers, wrenches):
    """Wrenches of the tree's joints from the bodies' residuals at F and the cuts' multipliers."""
    apart()
    for c in range(len(m.cuts)):
        for j in range(m.cuts[c, ROW], m.cuts[c, ROW] + (3 if m.cuts[c, WHAT] == COINCIDE else 1)):
            push(m, k, m.cuts[c, FIRST], k.rows[j], 3, multipliers[j])
            push(m, k, m.cuts[c, SECOND], k.rows[j], 9, multipliers[j])
    for n in range(len(m.nodes)):
        for i in range(6):
            wrenches[n, i] = k.F[n, i]
    for n in range(len(m.nodes) - 1, -1, -1):
        parent = m.nodes[n, PARENT]
        if parent >= 0:
            for i in range(3):
                k.x[i] = k.r[n, i] - k.r[parent, i]
            for i in range(6):
                wrenches[parent, i] += wrenches[n, i]
            add_cross(k.x, 0, wrenches[n], 0, wrenches[parent], 3)
