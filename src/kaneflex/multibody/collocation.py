"""Compiled integration of a tree of bodies with closed loops, by collocation at three points.

The stages' accelerations are the unknowns of a simplified Newton iteration: with A = T diag(mu) T^-1 of the method the
equations of three stages fall apart into a real and a complex one of a single stage,

    (M + h mu C + h^2 mu^2 K) x = r        (Hairer & Wanner 1996, IV.8, for second-order equations),

whose C and K are those of shapes and springs at joints: constant, local, and all that is stiff. So factors serve the
whole step, gyroscopic and geometric terms are left to the iteration, and no derivative of the equations is needed.

Radau IIA (order 5, its last stage is the step's end, vibrations that a step doesn't resolve die away) and Gauss (order
6, no numerical damping) are two tables of the same loop.

The step follows the defect of the collocation polynomial at its start: what M a - f is there for the polynomial's own
acceleration, as a displacement e = h^2 (M + h mu C + h^2 mu^2 K)^-1 (defect). Of a vibration w that the step resolves it
is (w h)^5/60 of the amplitude, twice what ten of its periods accumulate, for a step is wrong by (w h)^6/7200; of one
that it doesn't it is the amplitude itself, several times.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit, types
from numba.types import complex128, float64, int64

from kaneflex.multibody.loops import LOOPS, follow, reactions_of, solve_closed
from kaneflex.multibody.recursion import HINGE, assemble, factorise
from kaneflex.multibody.topology import BLOCK, COURSE, FIRST, INBOARD, JOINT, KIND, MODAL, OWNER, PARENT, ROW
from kaneflex.multibody.tree import ENERGY, FRAME, KERNELS, MATRIX, OPTIONS, OUTER, SEC, TREE, V, WORK, resist

DONE, TOO_SMALL, SINGULAR, NO_CONVERGENCE, PAUSED = 0, 1, 2, 3, 4
"""How a piece of the integration ended: at its end, with a vanishing step, at a singular state, in a fixed step whose
equations Newton's method does not solve, after as many steps as it may try."""
Z, ZM = complex128[::1], complex128[:, ::1]


class Table(NamedTuple):
    """Coefficients of a collocation method: nodes, A, its square, weights b and b A, 1 where the last node is the end.

    ``real``, ``pair``: an eigenvalue of A each; ``into``, ``out``: rows of T^-1 and columns of T that belong to them,
    (2, 3) complex.
    """

    nodes: np.ndarray
    a_1: np.ndarray
    a_2: np.ndarray
    b_1: np.ndarray
    b_2: np.ndarray
    ends: float
    real: float
    pair: complex
    into: np.ndarray
    out: np.ndarray


TABLE = types.NamedTuple([V, MATRIX, MATRIX, V, V, float64, float64, complex128, ZM, ZM], Table)


def collocation_table(nodes: np.ndarray) -> Table:
    """The collocation method with three nodes in (0, 1]."""
    powers = np.arange(1, 4)
    inverse = np.linalg.inv(np.vander(nodes, increasing=True))
    A, b = (nodes[:, None] ** powers / powers) @ inverse, (1 / powers) @ inverse
    values, T = np.linalg.eig(A)
    order = [int(abs(values.imag).argmin()), int(values.imag.argmax())]
    into, out = np.linalg.inv(T)[order], T.T[order]
    return Table(
        nodes, A, A @ A, b, b @ A, float(nodes[2] == 1.0), float(values[order[0]].real), complex(values[order[1]]),
        np.ascontiguousarray(into, complex), np.ascontiguousarray(out, complex),
    )  # fmt: skip


_ROOT = math.sqrt(6.0)
RADAU = collocation_table(np.array([(4.0 - _ROOT) / 10.0, (4.0 + _ROOT) / 10.0, 1.0]))
GAUSS = collocation_table(np.array([0.5 - math.sqrt(0.15), 0.5, 0.5 + math.sqrt(0.15)]))


@njit(**OPTIONS)
def reactions(tree, work, out):
    """What every body's inboard joint exerts on it: force and moment at its inboard section, three numbers a body."""
    count = tree.bodies.shape[0]
    for b in range(count):
        for j in range(3):
            out[3 * b + j] = work.force[tree.bodies[b, ROW] + j]
    for b in range(count - 1, -1, -1):
        own, up, f = SEC * tree.bodies[b, INBOARD], tree.bodies[b, PARENT], FRAME * b
        x, z = out[3 * b], out[3 * b + 1]
        out[3 * b + 2] += (work.frame[f] - work.sec[own]) * z - (work.frame[f + 1] - work.sec[own + 1]) * x
        parent = tree.sections[up, OWNER]
        if parent >= 0:
            g = FRAME * parent
            out[3 * parent] += x
            out[3 * parent + 1] += z
            out[3 * parent + 2] += out[3 * b + 2] + (work.sec[own] - work.frame[g]) * z - (
                work.sec[own + 1] - work.frame[g + 1]
            ) * x


@njit(**OPTIONS)
def powers(tree, kernels, y, v, work, joint, out):
    """Rates of works: dissipation, every load's, every prescribed drive's [W], from the state that ``work`` has."""
    out[:] = 0.0
    sums = np.zeros(3)
    for b in range(tree.bodies.shape[0]):
        f = FRAME * b
        kernels[ENERGY](
            tree.bodies[b, KIND], tree.blocks, tree.bodies[b, BLOCK], y, v, tree.bodies[b, MODAL],
            work.frame[f + 3], work.frame[f + 4], work.frame[f + 5], work.frame[f + 6], work.frame[f + 7], sums,
        )  # fmt: skip
    out[0] = sums[2]
    for n in range(tree.springs.shape[0]):
        out[0] += work.spring[6 * n + 5]
    load_powers(tree, work, out, 1)
    first = 1 + tree.loads.shape[0]
    reactions(tree, work, joint)
    for b in range(tree.bodies.shape[0]):
        k = tree.bodies[b, COURSE]
        if k >= 0:
            i, up = 3 * b, SEC * tree.bodies[b, PARENT]
            rate = work.course[3 * k + 1]
            if tree.bodies[b, JOINT] == 1:
                out[first + k] = tree.joints[b, 0] * joint[i + 2] * rate
            else:
                c, s = math.cos(work.sec[up + 2]), math.sin(work.sec[up + 2])
                d_x, d_y = tree.joints[b, 2], tree.joints[b, 3]
                out[first + k] = (joint[i] * (c * d_x - s * d_y) + joint[i + 1] * (s * d_x + c * d_y)) * rate


@njit(**OPTIONS)
def load_powers(tree, work, out, first):
    """Power of every load [W]."""
    for n in range(tree.loads.shape[0]):
        size, one, two = work.size[n], SEC * tree.loads[n, 1], SEC * tree.loads[n, 2]
        if tree.loads[n, 0] == 2:
            out[first + n] = size * (work.sec[two + 5] - work.sec[one + 5])
            continue
        x, z = tree.directions[n, 0], tree.directions[n, 1]
        if tree.loads[n, 0] == 1:
            c, s = math.cos(work.sec[two + 2]), math.sin(work.sec[two + 2])
            x, z = c * x - s * z, s * x + c * z
        out[first + n] = size * (x * work.sec[one + 3] + z * work.sec[one + 4])


@njit(cache=True, **OUTER)
def settle(tree, bent, pushed, twisted, asked, weighed, stored, steered, sized, p, loops, t, y, v, a, multipliers, work):
    """Accelerations and reactions of the cuts at a state whose independent coordinates and rates are given.

    y, v of the other coordinates are found; False at a singular state.
    """
    kernels = (bent, pushed, twisted, asked, weighed, stored, steered, sized)
    return _settle(tree, kernels, p, loops, t, y, v, a, multipliers, work)


@njit(**OPTIONS)
def _settle(tree, kernels, p, loops, t, y, v, a, multipliers, work):
    n, count, size = y.size, loops.rows.size, work.force.size
    last = tree.bodies.shape[0] - 1
    squares = tree.bodies[last, 13] + (3 + tree.bodies[last, 6]) ** 2
    mass, jacobians, A = np.zeros(squares), np.zeros(loops.jacobians.size), np.zeros(squares)
    hinges, columns, square = np.zeros(HINGE * (last + 1)), np.zeros((count, n)), np.zeros((count, count))
    pivots, force, dy, dl = np.zeros(count, np.int64), np.zeros(size), np.zeros(n), np.zeros(count)
    a[:] = 0.0
    multipliers[:] = 0.0
    if not follow(tree, kernels, p, t, y, v, a, loops, work):
        return False
    assemble(tree, kernels, y, work, mass, jacobians)
    if not factorise(tree, work, mass, jacobians, 0.0, A, hinges):
        return False
    if not reactions_of(tree, loops, work, jacobians, A, hinges, force, columns, square, pivots):
        return False
    for turn in range(2):
        resist(tree, kernels, p, t, y, v, a, multipliers, work)
        for i in range(size):
            force[i] = -work.force[i]
        solve_closed(tree, loops, work, jacobians, A, hinges, columns, square, pivots, force, dy, dl)
        for r in range(count):
            multipliers[loops.rows[r]] += dl[r]
        for i in range(n):
            a[i] += dy[i]
        if not follow(tree, kernels, p, t, y, v, a, loops, work):
            return False
    return True


@njit(cache=True, **OUTER)
def integrate(
    tree, bent, pushed, twisted, asked, weighed, stored, steered, sized, p, loops, table, scale, control, here, given, times, ys, vs, accels, lambdas, works, counts, work
):
    """Fill rows 1, 2, ... of the tables at ``times`` [s], from ``here``; every one of them is the end of a step.

    scale: error allowed in each coordinate. control: [next step, longest step, steps to try at most, last row filled].
    here: where the motion stands, before row 1 in time, and is left: t, then y, v, a, multipliers and works as in a
    row of the tables. given: the ends [s] of the steps to take from there, with the ``times`` among them; empty where
    the control of the error chooses them. works: time integrals of the powers (dissipation, loads, drives). counts:
    accepted and rejected steps, Newton iterations, factorisations.

    Returns a status and the ends of the steps that were taken.
    """
    kernels = (bent, pushed, twisted, asked, weighed, stored, steered, sized)
    n, m, size, count = ys.shape[1], lambdas.shape[1], work.force.size, loops.rows.size
    last = tree.bodies.shape[0] - 1
    squares = tree.bodies[last, 13] + (3 + tree.bodies[last, 6]) ** 2
    mass, jacobians = np.zeros(squares), np.zeros(loops.jacobians.size)
    A, Ac = np.zeros(squares), np.zeros(squares, np.complex128)
    hinges, hinges_c = np.zeros(HINGE * (last + 1)), np.zeros(HINGE * (last + 1), np.complex128)
    columns, columns_c = np.zeros((count, n)), np.zeros((count, n), np.complex128)
    square, square_c = np.zeros((count, count)), np.zeros((count, count), np.complex128)
    pivots, pivots_c = np.zeros(count, np.int64), np.zeros(count, np.int64)
    force, force_c = np.zeros(size), np.zeros(size, np.complex128)
    dy, dy_c, dl, dl_c = np.zeros(n), np.zeros(n, np.complex128), np.zeros(count), np.zeros(count, np.complex128)
    resisting = np.zeros((3, size))
    stage_y, stage_v, stage_a, stage_l = np.zeros((3, n)), np.zeros((3, n)), np.zeros((3, n)), np.zeros((3, m))
    before_a, before_l = np.zeros((3, n)), np.zeros((3, m))
    y, v, a, multipliers = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(m)
    y_0, v_0, a_0 = here[1 : 1 + n], here[1 + n : 1 + 2 * n], here[1 + 2 * n : 1 + 3 * n]
    l_0, done = here[1 + 3 * n : 1 + 3 * n + m], here[1 + 3 * n + m :]
    rates, joint, added = np.zeros(done.size), np.zeros(3 * (last + 1)), np.zeros(done.size)
    c, weights = table.nodes, np.zeros(3)
    middle_sec, middle_cut = np.zeros(work.sec.size), np.zeros(work.cut.size)
    wanted, t, row, tried, taken, length = control[0], here[0], 0, 0, 0, 0.0
    replayed, ends = given.size > 0, np.empty(max(given.size, 2 * times.size))
    while row + 1 < times.size:
        control[0], control[3], here[0] = wanted, row, t
        if tried == control[2]:
            return PAUSED, ends[:taken]
        tried += 1
        if replayed:
            end = given[taken]
            h = end - t
        else:
            wanted = min(wanted, control[1])
            if wanted < 1e-12 * (times[times.size - 1] - times[0]):
                return TOO_SMALL, ends[:taken]
            # Steps of equal length up to the next instant: none is cut to a sliver.
            left = times[row + 1] - t
            h = left / math.ceil(left / wanted * (1.0 - 1e-9))
            end = times[row + 1] if h >= left * (1.0 - 1e-9) else t + h
        # Stages as the last step's polynomial goes on, or as the motion stands.
        for i in range(3):
            if length > 0.0:
                _basis(c, 1.0 + c[i] * h / length, weights)
            for k in range(n):
                if length > 0.0:
                    stage_a[i, k] = weights[0] * before_a[0, k] + weights[1] * before_a[1, k] + weights[2] * before_a[2, k]
                else:
                    stage_a[i, k] = a_0[k]
            for k in range(m):
                if length > 0.0:
                    stage_l[i, k] = weights[0] * before_l[0, k] + weights[1] * before_l[1, k] + weights[2] * before_l[2, k]
                else:
                    stage_l[i, k] = l_0[k]
        # Factors where the step is half way: nowhere in it is the mass then far from theirs.
        fine = True
        for k in range(n):
            y[k] = y_0[k] + 0.5 * h * v_0[k] + 0.125 * h * h * a_0[k]
            v[k], a[k] = 0.0, 0.0
        fine = follow(tree, kernels, p, t + 0.5 * h, y, v, a, loops, work)
        if fine:
            assemble(tree, kernels, y, work, mass, jacobians)
            counts[3] += 1
            fine = factorise(tree, work, mass, jacobians, h * table.real, A, hinges)
            fine = fine and factorise(tree, work, mass, jacobians, h * table.pair, Ac, hinges_c)
            fine = fine and reactions_of(tree, loops, work, jacobians, A, hinges, force, columns, square, pivots)
            fine = fine and reactions_of(
                tree, loops, work, jacobians, Ac, hinges_c, force_c, columns_c, square_c, pivots_c
            )
        copy(work.sec, middle_sec)
        copy(work.cut, middle_cut)
        converged, before = False, 0.0
        for iteration in range(30 if replayed else 10):
            if not fine:
                break
            counts[2] += 1
            for i in range(3):
                for k in range(n):
                    v[k] = v_0[k] + h * (
                        table.a_1[i, 0] * stage_a[0, k] + table.a_1[i, 1] * stage_a[1, k] + table.a_1[i, 2] * stage_a[2, k]
                    )
                    y[k] = y_0[k] + h * c[i] * v_0[k] + h * h * (
                        table.a_2[i, 0] * stage_a[0, k] + table.a_2[i, 1] * stage_a[1, k] + table.a_2[i, 2] * stage_a[2, k]
                    )
                for k in range(n):
                    a[k] = stage_a[i, k]
                at = t + h * c[i]
                if not follow(tree, kernels, p, at, y, v, a, loops, work):
                    fine = False
                    break
                for k in range(n):
                    stage_a[i, k] = a[k]
                for k in range(m):
                    multipliers[k] = stage_l[i, k]
                resist(tree, kernels, p, at, y, v, a, multipliers, work)
                for k in range(size):
                    resisting[i, k] = work.force[k]
            if not fine:
                break
            copy(middle_sec, work.sec)
            copy(middle_cut, work.cut)
            for k in range(size):
                total, total_c = 0.0, 0.0j
                for i in range(3):
                    total -= table.into[0, i].real * resisting[i, k]
                    total_c -= table.into[1, i] * resisting[i, k]
                force[k], force_c[k] = total, total_c
            solve_closed(tree, loops, work, jacobians, A, hinges, columns, square, pivots, force, dy, dl)
            solve_closed(
                tree, loops, work, jacobians, Ac, hinges_c, columns_c, square_c, pivots_c, force_c, dy_c, dl_c
            )
            change = 0.0
            for i in range(3):
                real, pair = table.out[0, i].real, table.out[1, i]
                for k in range(n):
                    d = real * dy[k] + 2.0 * (pair.real * dy_c[k].real - pair.imag * dy_c[k].imag)
                    stage_a[i, k] += d
                    change = max(change, h * h * abs(d) / scale[k])
                for r in range(count):
                    d = real * dl[r] + 2.0 * (pair.real * dl_c[r].real - pair.imag * dl_c[r].imag)
                    stage_l[i, loops.rows[r]] += d
            if not change < 1e200:
                break
            if iteration > 0:
                rate = change / before
                if replayed and rate >= 0.5 and change < 1.0:  # the scale is that of rounding
                    converged = True
                    break
                if rate >= 1.0 and change > 1e-3:
                    break
                if change * rate < 1e-3 * max(1.0 - rate, 0.0):
                    converged = True
                    break
            if change < 1e-6:
                converged = True
                break
            before = change
        if not converged:
            if replayed:
                return NO_CONVERGENCE, ends[:taken]
            counts[1] += 1
            wanted, length = 0.4 * h, 0.0
            continue
        if not replayed:
            # The polynomial's own acceleration at the start, and what the equations ask for there beside it.
            _basis(c, 0.0, weights)
            for k in range(n):
                y[k], v[k] = y_0[k], v_0[k]
                a[k] = weights[0] * stage_a[0, k] + weights[1] * stage_a[1, k] + weights[2] * stage_a[2, k]
            if not follow(tree, kernels, p, t, y, v, a, loops, work):
                return SINGULAR, ends[:taken]
            resist(tree, kernels, p, t, y, v, a, l_0, work)
            copy(middle_sec, work.sec)
            copy(middle_cut, work.cut)
            for k in range(size):
                force[k] = -0.5 * h * h * work.force[k]
            solve_closed(tree, loops, work, jacobians, A, hinges, columns, square, pivots, force, dy, dl)
            error = 1e-12
            for k in range(n):
                error = max(error, abs(dy[k]) / scale[k])
            growth = min(3.0, max(0.2, 0.9 * error ** (-0.2)))
            if not error <= 1.0:
                counts[1] += 1
                wanted, length = h * min(growth, 0.9), 0.0
                continue
            wanted = max(wanted, h * growth) if growth >= 1.0 else h * growth
        added[:] = 0.0
        for i in range(3):
            at = t + h * c[i]
            for k in range(n):
                v[k] = v_0[k] + h * (
                    table.a_1[i, 0] * stage_a[0, k] + table.a_1[i, 1] * stage_a[1, k] + table.a_1[i, 2] * stage_a[2, k]
                )
                y[k] = y_0[k] + h * c[i] * v_0[k] + h * h * (
                    table.a_2[i, 0] * stage_a[0, k] + table.a_2[i, 1] * stage_a[1, k] + table.a_2[i, 2] * stage_a[2, k]
                )
            for k in range(n):
                a[k] = stage_a[i, k]
            if not follow(tree, kernels, p, at, y, v, a, loops, work):
                return SINGULAR, ends[:taken]
            for k in range(m):
                multipliers[k] = stage_l[i, k]
            resist(tree, kernels, p, at, y, v, a, multipliers, work)
            powers(tree, kernels, y, v, work, joint, rates)
            for k in range(n):
                stage_a[i, k] = a[k]
            for k in range(done.size):
                added[k] += h * table.b_1[i] * rates[k]
        if table.ends == 0.0:
            for k in range(n):
                y[k] = y_0[k] + h * v_0[k]
                v[k] = v_0[k]
                for i in range(3):
                    y[k] += h * h * table.b_2[i] * stage_a[i, k]
                    v[k] += h * table.b_1[i] * stage_a[i, k]
            if not _settle(tree, kernels, p, loops, end, y, v, a, multipliers, work):
                return SINGULAR, ends[:taken]
        length = h
        for k in range(n):
            y_0[k], v_0[k], a_0[k] = y[k], v[k], a[k]
            for i in range(3):
                before_a[i, k] = stage_a[i, k]
        for k in range(m):
            l_0[k] = multipliers[k]
            for i in range(3):
                before_l[i, k] = stage_l[i, k]
        for k in range(done.size):
            done[k] += added[k]
        counts[0] += 1
        if taken == ends.size:
            more = np.empty(2 * taken)
            for k in range(taken):
                more[k] = ends[k]
            ends = more
        t, ends[taken] = end, end
        taken += 1
        if t == times[row + 1]:
            row += 1
            for k in range(n):
                ys[row, k], vs[row, k], accels[row, k] = y[k], v[k], a[k]
            for k in range(m):
                lambdas[row, k] = multipliers[k]
            for k in range(done.size):
                works[row, k] = done[k]
    control[0], control[3], here[0] = wanted, row, t
    return DONE, ends[:taken]


@njit(**OPTIONS)
def copy(of, into):
    for k in range(of.size):
        into[k] = of[k]


@njit(**OPTIONS)
def _basis(c, x, out):
    """Lagrange's polynomials of three nodes at x."""
    for i in range(3):
        out[i] = 1.0
        for j in range(3):
            if j != i:
                out[i] *= (x - c[j]) / (c[i] - c[j])


SIGNATURES = {
    settle: types.boolean(TREE, *KERNELS.types, V, LOOPS, float64, V, V, V, V, WORK),
    integrate: types.Tuple((int64, V))(
        TREE, *KERNELS.types, V, LOOPS, TABLE, V, V, V, V, V, MATRIX, MATRIX, MATRIX, MATRIX, MATRIX, V, WORK
    ),
}
