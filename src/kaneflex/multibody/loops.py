"""Loops of a mechanism: cuts closed by dependent coordinates, and what their reactions do to a tree's linear equations.

Every cut's rows are constraints between two sections. As many coordinates as there are rows follow from the others: the
motion is integrated in the independent ones alone, and where the loops are, in position, speed and acceleration, is
solved for on the bodies as they are deformed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit, types
from numba.types import int64

from kaneflex.multibody.dense_lu import factorise as lu
from kaneflex.multibody.dense_lu import substitute
from kaneflex.multibody.recursion import assemble, section_force, section_twist, solve
from kaneflex.multibody.topology import (
    AT, CUT_ROW, FIRST, FREE, INBOARD, JACOBIAN, JOINT, MODAL, ON, OWNER, PARENT, PRISMATIC, REVOLUTE, SHAPES,
)  # fmt: skip
from kaneflex.multibody.tree import (
    JACOBIANS, MATRIX, OPTIONS, SEC, V, accelerate, cut_rows, deform, move, place, prescribe,
)  # fmt: skip

CLOSED = 1e-10
"""Correction of a dependent coordinate, in rad or sizes of the mechanism, that is not worth another one."""


class Loops(NamedTuple):
    """How the loops are closed: rows of the cuts that are kept, the coordinates that follow from them, each row's cut,
    what counts as one in every coordinate [m or rad], whether shapes are among the dependent coordinates; room for
    gradients (rows, coordinates), the dependent square with its pivots and right-hand side."""

    rows: np.ndarray
    dependent: np.ndarray
    cuts: np.ndarray
    measure: np.ndarray
    bends: np.ndarray
    gradient: np.ndarray
    square: np.ndarray
    pivots: np.ndarray
    side: np.ndarray
    jacobians: np.ndarray


_I = int64[::1]
LOOPS = types.NamedTuple([_I, _I, _I, V, _I, MATRIX, MATRIX, _I, V, V], Loops)


@njit(**OPTIONS)
def gradient(tree, work, row, cut, jacobians, bends, out):
    """Derivatives of a cut's row by all coordinates of y, added to ``out``; by shapes only where asked."""
    for side in range(2):
        n, k = tree.cuts[cut, AT + side], 9 * row + 3 + 3 * side
        x, z, turn = work.cut[k], work.cut[k + 1], work.cut[k + 2]
        while tree.sections[n, OWNER] >= 0:
            b = tree.sections[n, OWNER]
            at, own = SEC * n, SEC * tree.bodies[b, INBOARD]
            moved = turn + (work.sec[at] - work.sec[own]) * z - (work.sec[at + 1] - work.sec[own + 1]) * x
            if bends:
                m, i = tree.bodies[b, SHAPES], tree.bodies[b, MODAL]
                w, v = tree.sections[n, JACOBIAN], tree.sections[tree.bodies[b, INBOARD], JACOBIAN]
                for j in range(m):
                    p, q = w + 3 + j, v + 3 + j
                    out[i + j] += jacobians[p] * x + jacobians[p + 3 + m] * z + jacobians[p + 2 * (3 + m)] * turn
                    out[i + j] -= jacobians[q] * x + jacobians[q + 3 + m] * z + jacobians[q + 2 * (3 + m)] * moved
            turn = moved
            first, kind = tree.bodies[b, FIRST], tree.bodies[b, JOINT]
            n = tree.bodies[b, PARENT]
            up = SEC * n
            if kind == REVOLUTE:
                out[first] += tree.joints[b, 0] * turn
            elif kind == PRISMATIC:
                c, s = math.cos(work.sec[up + 2]), math.sin(work.sec[up + 2])
                d_x, d_y = tree.joints[b, 2], tree.joints[b, 3]
                out[first] += x * (c * d_x - s * d_y) + z * (s * d_x + c * d_y)
            elif kind == FREE:
                out[first] += x
                out[first + 1] += z
                out[first + 2] += turn
                break
            turn += (work.sec[own] - work.sec[up]) * z - (work.sec[own + 1] - work.sec[up + 1]) * x


@njit(**OPTIONS)
def gradients(tree, kernels, y, loops, work):
    """Derivatives of the kept rows at the place that ``work`` has, and the factors of those by dependent coordinates."""
    count = loops.rows.size
    if loops.bends[0]:
        for b in range(tree.bodies.shape[0]):
            _jacobians(tree, kernels, y, b, work, loops.jacobians)
    loops.gradient[:, :] = 0.0
    for r in range(count):
        gradient(tree, work, loops.rows[r], loops.cuts[r], loops.jacobians, loops.bends[0], loops.gradient[r])
        for k in range(count):
            loops.square[r, k] = loops.gradient[r, loops.dependent[k]]
    return lu(loops.square, loops.pivots)


@njit(**OPTIONS)
def _jacobians(tree, kernels, y, b, work, out):
    from_ = 11 * b
    for n in range(tree.bodies[b, 10], tree.bodies[b, 11]):
        kernels[JACOBIANS](
            tree.bodies[b, 0], tree.blocks, tree.sections[n, 1], y, tree.bodies[b, MODAL], work.frame[from_ + 3],
            work.frame[from_ + 4], out, tree.sections[n, JACOBIAN],
        )  # fmt: skip


@njit(**OPTIONS)
def close(tree, kernels, y, v, a, loops, work):
    """Put the dependent coordinates of y where the loops close (Newton); False where they don't."""
    if loops.rows.size == 0:
        deform(tree, kernels, y, v, a, work)
        place(tree, y, work)
        return True
    count, before = loops.rows.size, math.inf
    for turn in range(20):
        if turn == 0 or loops.bends[0]:
            deform(tree, kernels, y, v, a, work)
        place(tree, y, work)
        cut_rows(tree, work)
        if not gradients(tree, kernels, y, loops, work):
            return False
        for r in range(count):
            loops.side[r] = -work.cut[9 * loops.rows[r]]
        substitute(loops.square, loops.pivots, loops.side)
        size = 0.0
        for k in range(count):
            i = loops.dependent[k]
            y[i] += loops.side[k]
            size = max(size, abs(loops.side[k]) / loops.measure[i])
        if size < CLOSED:
            return True
        if not size < 1e3 or (turn > 8 and size > before):
            return False
        before = size
    return False


@njit(**OPTIONS)
def follow(tree, kernels, p, t, y, v, a, loops, work):
    """Everything moves as the independent coordinates say, with y, v, a of the others filled in.

    False where the loops don't close.
    """
    prescribe(tree, kernels, p, t, y, v, a, work)
    if not close(tree, kernels, y, v, a, loops, work):
        return False
    count = loops.rows.size
    for rate in range(1, 3):
        of = v if rate == 1 else a
        for k in range(count):
            of[loops.dependent[k]] = 0.0
        for turn in range(2 if count else 1):
            if loops.bends[0]:
                deform(tree, kernels, y, v, a, work)
            if rate == 1:
                move(tree, v, work)
            else:
                accelerate(tree, v, a, work)
            if turn == 0 and count:
                cut_rows(tree, work)
                for r in range(count):
                    loops.side[r] = -work.cut[9 * loops.rows[r] + rate]
                substitute(loops.square, loops.pivots, loops.side)
                for k in range(count):
                    of[loops.dependent[k]] = loops.side[k]
    return True


@njit(**OPTIONS)
def reactions_of(tree, loops, work, jacobians, A, hinges, force, columns, square, pivots):
    """What unit reactions of the kept rows do to the coordinates, (rows, coordinates), and the factors of what they do
    to the cuts (the Schur complement); False where reactions are not determined."""
    count = loops.rows.size
    for r in range(count):
        force[:] = 0.0
        cut, k = loops.cuts[r], 9 * loops.rows[r]
        for side in range(2):
            j = k + 3 + 3 * side
            section_force(
                tree, jacobians, tree.cuts[cut, AT + side], work.cut[j], work.cut[j + 1], work.cut[j + 2], force
            )
        solve(tree, work, jacobians, A, hinges, force, columns[r])
        for q in range(count):
            square[q, r] = opening(tree, loops, work, jacobians, q, force)
    return lu(square, pivots) if count else True


@njit(**OPTIONS)
def opening(tree, loops, work, jacobians, r, speeds):
    """Rate of a kept row by all bodies' speeds."""
    cut, k = loops.cuts[r], 9 * loops.rows[r]
    total = 0.0 * speeds[0]
    for side in range(2):
        t_0, t_1, t_2 = section_twist(tree, jacobians, tree.cuts[cut, AT + side], speeds)
        j = k + 3 + 3 * side
        total += work.cut[j] * t_0 + work.cut[j + 1] * t_1 + work.cut[j + 2] * t_2
    return total


@njit(**OPTIONS)
def solve_closed(tree, loops, work, jacobians, A, hinges, columns, square, pivots, force, dy, dl):
    """Coordinates dy and reactions dl of the kept rows that forces over all bodies' speeds bring about, loops closed."""
    solve(tree, work, jacobians, A, hinges, force, dy)
    count = loops.rows.size
    if count:
        for r in range(count):
            dl[r] = -opening(tree, loops, work, jacobians, r, force)
        substitute(square, pivots, dl)
        for r in range(count):
            for i in range(dy.size):
                dy[i] += columns[r, i] * dl[r]
