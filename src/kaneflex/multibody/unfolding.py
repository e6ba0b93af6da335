"""Compiled ways between the tree's coordinates and those of the bodies, with energies and what joints exert."""

from __future__ import annotations

import math

from numba import njit
from numba.types import boolean, float64, int64, void

from kaneflex.generated import joints
from kaneflex.multibody import dense_lu, loops, powers, recursion, tables, tree
from kaneflex.multibody.loops import bent, factorise_closed, follow, gradient, middle, settle_now, solve_closed
from kaneflex.multibody.tables import (
    ACCEL, BODIES, COLUMNS, COORDINATES, CUT, CUTS, DEMAND, DRIVES, FIRST, FRAME, FRAME_SIZE, FREE, GRADIENT, INBOARD,
    JOINT, JOINTS, KEPT, KERNELS, LAST, LOCAL, MODAL, NOW, NUMBERS, OPTIONS, OUTER, PARENT, PIVOTS, POINT, POWER,
    PRISMATIC, RATE, REACTION, REACTIONS, REVOLUTE, ROW_AT, ROW_OF, SEC, SECTION, SECTIONS, SHAPES, SUMS, TABLES,
    WORKS, V, Y, apart, numbers, pointed, shifted,
)  # fmt: skip
from kaneflex.multibody.tree import cut_rows, deform, demand, place, prescribe, turned
from kaneflex.support.fingerprint import made_of

_made_of_parts = made_of(
    dense_lu.__file__, joints.__file__, loops.__file__, powers.__file__, recursion.__file__, tables.__file__,
    tree.__file__,
)  # fmt: skip


@njit(cache=True, **OUTER)
@_made_of_parts
def fold(tables_, deform_, push, jacobian, inverse, inertia, energy, courses, magnitudes, q, v):
    """Coordinates and rates of the tree from those of the bodies: x, y, phi, then shapes, body by body."""
    kernels = (deform_, push, jacobian, inverse, inertia, energy, courses, magnitudes)
    _fold(pointed(tables_), kernels, numbers(q), numbers(v))


@njit(**OPTIONS)
def _fold(m, kernels, q, v):
    """The same in compiled code."""
    apart()
    plan, w = m.plan, m.w
    k = 0
    for b in range(plan[BODIES]):
        f, i = plan[FRAME] + FRAME_SIZE * b, m.bodies[b, MODAL]
        w[f], w[f + 1], w[f + 2], w[f + 3], w[f + 4] = q[k], q[k + 1], q[k + 2], math.cos(q[k + 2]), math.sin(q[k + 2])
        w[f + 5], w[f + 6], w[f + 7] = v[k], v[k + 1], v[k + 2]
        for j in range(m.bodies[b, SHAPES]):
            w[plan[Y] + i + j], w[plan[RATE] + i + j] = q[k + 3 + j], v[k + 3 + j]
        k += 3 + m.bodies[b, SHAPES]
    deform(m, kernels)
    for b in range(plan[BODIES]):
        f = plan[FRAME] + FRAME_SIZE * b
        c, s, omega = w[f + 3], w[f + 4], w[f + 7]
        for n in range(m.bodies[b, SECTIONS], m.bodies[b, LAST]):
            k, l, share = plan[SECTION] + SEC * n, plan[LOCAL] + SEC * n, w[m.sections[n, POINT]]
            arm_x, arm_y = c * w[l] - s * w[l + 1], s * w[l] + c * w[l + 1]
            w[k], w[k + 1], w[k + 2] = share * w[f] + arm_x, share * w[f + 1] + arm_y, w[f + 2] + w[l + 2]
            w[k + 3] = share * w[f + 5] - omega * arm_y + c * w[l + 3] - s * w[l + 4]
            w[k + 4] = share * w[f + 6] + omega * arm_x + s * w[l + 3] + c * w[l + 4]
            w[k + 5] = omega + w[l + 5]
    for b in range(plan[BODIES]):
        up, own = plan[SECTION] + SEC * m.bodies[b, PARENT], plan[SECTION] + SEC * m.bodies[b, INBOARD]
        y, r, j = plan[Y] + m.bodies[b, FIRST], plan[RATE] + m.bodies[b, FIRST], m.bodies[b, NUMBERS]
        if m.bodies[b, JOINT] == REVOLUTE:
            w[y], w[r] = w[j] * (w[own + 2] - w[up + 2] - w[j + 1]), w[j] * (w[own + 5] - w[up + 5])
        elif m.bodies[b, JOINT] == PRISMATIC:
            d_x, d_y = turned(w, w[up + 2], j + 2)
            x, z = w[own] - w[up], w[own + 1] - w[up + 1]
            w[y] = d_x * x + d_y * z
            w[r] = d_x * (w[own + 3] - w[up + 3]) + d_y * (w[own + 4] - w[up + 4]) + w[up + 5] * (d_x * z - d_y * x)
        elif m.bodies[b, JOINT] == FREE:
            for i in range(3):
                w[y + i], w[r + i] = w[own + i], w[own + 3 + i]


@njit(cache=True, **OUTER)
@_made_of_parts
def unfold(
    tables_, deform_, push, jacobian, inverse, inertia, energy, courses, magnitudes, p, rows, q, v, a, exerted, sums,
    rates,
):  # fmt: skip
    """Motion of the bodies at every row (t, coordinates, rates, accelerations, reactions of the cuts), and its cost.

    exerted: of every body three numbers of its inboard joint, in the order of the joint's rows with a drive last, then
    the cuts' reactions; on the joint's second body. sums: kinetic energy, strain energy, dissipated power, potential
    energy of the weight. rates: powers of dissipation, loads, drives. False where a loop doesn't close.
    """
    m = pointed(tables_)
    plan, w = m.plan, m.w
    kernels = (deform_, push, jacobian, inverse, inertia, energy, courses, magnitudes)
    n = plan[COORDINATES]
    for row in range(rows.shape[0]):
        for i in range(n):
            w[plan[Y] + i], w[plan[RATE] + i] = rows[row, 1 + i], rows[row, 1 + n + i]
            w[plan[ACCEL] + i] = rows[row, 1 + 2 * n + i]
        for r in range(plan[REACTIONS]):
            w[plan[NOW] + r] = rows[row, 1 + 3 * n + r]
        if not follow(m, kernels, numbers(p), rows[row, 0]):
            return False
        demand(m, kernels, numbers(p), rows[row, 0])
        powers.powers(m)
        powers.energies(m, kernels)
        k = 0
        for b in range(plan[BODIES]):
            f, i, size = plan[FRAME] + FRAME_SIZE * b, m.bodies[b, MODAL], m.bodies[b, SHAPES]
            for j in range(3):
                q[row, k + j], v[row, k + j], a[row, k + j] = w[f + j], w[f + 5 + j], w[f + 8 + j]
            for j in range(size):
                q[row, k + 3 + j], v[row, k + 3 + j] = w[plan[Y] + i + j], w[plan[RATE] + i + j]
                a[row, k + 3 + j] = w[plan[ACCEL] + i + j]
            k += 3 + size
            exerted[row, 3 * b], exerted[row, 3 * b + 1], exerted[row, 3 * b + 2] = _exerted(m, b)
        for r in range(plan[REACTIONS]):
            exerted[row, 3 * plan[BODIES] + r] = w[plan[NOW] + r]
        for j in range(4):
            sums[row, j] = w[plan[SUMS] + j]
        for j in range(plan[WORKS]):
            rates[row, j] = w[plan[POWER] + j]
    return True


@njit(**OPTIONS)
def _held(m, kernels, p, t, A):
    """Accelerations and reactions where STIFFNESS is a mass that coordinates have besides; False: a singular state."""
    apart()
    plan, w = m.plan, m.w
    for i in range(plan[COORDINATES]):
        w[plan[ACCEL] + i] = 0.0
    for r in range(plan[REACTIONS]):
        w[plan[NOW] + r] = 0.0
    if not follow(m, kernels, p, t):
        return False
    middle(m, kernels)
    if not factorise_closed(m, 1.0, A, plan[PIVOTS]):
        return False
    demand(m, kernels, p, t)
    answer = plan[COLUMNS] + plan[KEPT] * plan[COORDINATES]
    for k in range(plan[COORDINATES]):
        A[answer + k] = -w[plan[DEMAND] + k]
    solve_closed(m, A, plan[PIVOTS])
    for r in range(plan[KEPT]):
        w[plan[NOW] + plan[plan[ROW_OF] + r]] = A[plan[REACTION] + r]
    for i in range(plan[COORDINATES]):
        w[plan[ACCEL] + i] += A[answer + i]
    return follow(m, kernels, p, t)


@njit(cache=True, **OUTER)
@_made_of_parts
def states(
    tables_, deform_, push, jacobian, inverse, inertia, energy, courses, magnitudes, p, times, q, v, first, held, room,
    rows,
):  # fmt: skip
    """Rows of states of the bodies, from the ``first`` one on, with their loops closed, accelerations and reactions.

    held: whether STIFFNESS is a mass that coordinates have besides. Returns the row that is singular, or their number.
    """
    m, A = pointed(tables_), numbers(room)
    plan, w = m.plan, m.w
    kernels = (deform_, push, jacobian, inverse, inertia, energy, courses, magnitudes)
    n = plan[COORDINATES]
    for row in range(first, times.size):
        _fold(m, kernels, shifted(numbers(q), row * q.shape[1]), shifted(numbers(v), row * v.shape[1]))
        if held:
            done = _held(m, kernels, numbers(p), times[row], A)
        else:
            done = settle_now(m, kernels, numbers(p), times[row], A)
        if not done:
            return row
        rows[row, 0] = times[row]
        for i in range(n):
            rows[row, 1 + i], rows[row, 1 + n + i] = w[plan[Y] + i], w[plan[RATE] + i]
            rows[row, 1 + 2 * n + i] = w[plan[ACCEL] + i]
        for r in range(plan[REACTIONS]):
            rows[row, 1 + 3 * n + r] = w[plan[NOW] + r]
    return times.size


@njit(**OPTIONS)
def _exerted(m, b):
    """What a body's inboard joint exerts on the joint's second body, by the joint's rows, then along its coordinate.

    ``NUMBERS`` has a sign of -1 where the body is the first one: then its normal force has the guide's arm besides.
    """
    plan, w = m.plan, m.w
    k, j = plan[JOINTS] + 3 * b, m.bodies[b, NUMBERS]
    x, z, turn, sign = w[k], w[k + 1], w[k + 2], w[j]
    if m.bodies[b, JOINT] != PRISMATIC:
        return sign * x, sign * z, sign * turn
    up, own = plan[SECTION] + SEC * m.bodies[b, PARENT], plan[SECTION] + SEC * m.bodies[b, INBOARD]
    d_x, d_y = turned(w, w[up + 2], j + 2)
    normal, along = d_x * z - d_y * x, d_x * x + d_y * z
    if sign < 0.0:  # the direction is turned round with the sides: n . F and d . F keep their signs
        arm = d_x * (w[own] - w[up]) + d_y * (w[own + 1] - w[up + 1])
        turn = -turn - normal * arm
    return normal, turn, along


@njit(cache=True, **OUTER)
@_made_of_parts
def openings(tables_, deform_, push, jacobian, inverse, inertia, energy, courses, magnitudes, p, t, out):
    """Residuals of all rows of the cuts where the coordinates put them; at GRADIENT their derivatives by all of y."""
    m = pointed(tables_)
    plan, w = m.plan, m.w
    kernels = (deform_, push, jacobian, inverse, inertia, energy, courses, magnitudes)
    prescribe(m, kernels, numbers(p), t)
    deform(m, kernels)
    place(m)
    cut_rows(m)
    bent(m, kernels)
    n = plan[COORDINATES]
    for i in range(plan[REACTIONS] * n):
        w[plan[GRADIENT] + i] = 0.0
    for cut in range(plan[CUTS], plan[DRIVES]):
        end = m.acts[cut + 1, ROW_AT] if cut + 1 < plan[DRIVES] else plan[REACTIONS]
        for row in range(m.acts[cut, ROW_AT], end):
            gradient(m, row, cut, True, plan[GRADIENT] + n * row)
            out[row] = w[plan[CUT] + 9 * row]


_STRUCTURE, MATRIX = (TABLES, *KERNELS), float64[:, ::1]
SIGNATURES = {
    fold: void(*_STRUCTURE, V, V),
    states: int64(*_STRUCTURE, V, V, MATRIX, MATRIX, int64, boolean, V, MATRIX),
    unfold: boolean(*_STRUCTURE, V, MATRIX, MATRIX, MATRIX, MATRIX, MATRIX, MATRIX, MATRIX),
    openings: void(*_STRUCTURE, V, float64, V),
}
"""What is compiled once for the mechanisms of all scenes, and for which arguments."""
