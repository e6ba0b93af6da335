"""Linear equations of a tree of bodies, leaf by leaf: (M + h C + h^2 K) x = r with work that grows as the bodies do.

Inwards every body's shapes and its joint's coordinate are eliminated, so that its parent feels it as a 3 x 3 matrix at
the section that it hangs on (the articulated inertia of Featherstone 1983, with shapes as further joints); outwards the
answers come back. C and K are local to shapes and joints, and h may be complex: the same lines factorise what every
stage of a collocation method asks for. Rows of the matrices are of a body's frame (x, y, phi) and its shapes.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.multibody.topology import (
    BLOCK, DOF, FIRST, FREE, INBOARD, JACOBIAN, JOINT, KIND, LAST, MODAL, OWNER, PARENT, PRISMATIC, REVOLUTE, ROW,
    SECTIONS, SHAPES, SQUARE, COURSE, POINT,
)  # fmt: skip
from kaneflex.multibody.tree import FRAME, INERTIA, JACOBIANS, OPTIONS, SEC

HINGE = 8
"""Numbers of a joint: what it moves along at its section (3), the articulated inertia times that (3), 1 over what
resists the coordinate itself, and whether there is one."""


@njit(**OPTIONS)
def assemble(tree, kernels, y, work, mass, jacobians):
    """Mass matrices of all bodies, and of all sections W: their twists by the speeds of frame and shapes."""
    for b in range(tree.bodies.shape[0]):
        c, s = work.frame[FRAME * b + 3], work.frame[FRAME * b + 4]
        kind, i = tree.bodies[b, KIND], tree.bodies[b, MODAL]
        kernels[INERTIA](kind, tree.blocks, tree.bodies[b, BLOCK], y, i, c, s, mass, tree.bodies[b, SQUARE])
        for n in range(tree.bodies[b, SECTIONS], tree.bodies[b, LAST]):
            kernels[JACOBIANS](
                kind, tree.blocks, tree.sections[n, POINT], y, i, c, s, jacobians, tree.sections[n, JACOBIAN]
            )


@njit(**OPTIONS)
def factorise(tree, work, mass, jacobians, h, A, hinges):
    """Factors of M + h C + h^2 K in A (squares of all bodies) and ``hinges``. False where a pivot vanishes."""
    count = tree.bodies.shape[0]
    for b in range(count):
        ao, n, i = tree.bodies[b, SQUARE], 3 + tree.bodies[b, SHAPES], tree.bodies[b, MODAL]
        for k in range(n * n):
            A[ao + k] = mass[ao + k]
        for j in range(n - 3):
            A[ao + (n + 1) * (3 + j)] += h * (tree.damping[i + j] + h * tree.stiffness[i + j])
    for b in range(count - 1, -1, -1):
        ao, n = tree.bodies[b, SQUARE], 3 + tree.bodies[b, SHAPES]
        own, up = tree.bodies[b, INBOARD], tree.bodies[b, PARENT]
        if not _condense(A, ao, n, jacobians, tree.sections[own, JACOBIAN]):
            return False
        g = HINGE * b
        hinges[g + 7] = 0.0
        kind, first = tree.bodies[b, JOINT], tree.bodies[b, FIRST]
        if kind == FREE:
            if not _small(A, ao, n):
                return False
            continue
        if (kind == REVOLUTE or kind == PRISMATIC) and tree.bodies[b, COURSE] < 0:
            d_x, d_y, d_t = 0.0, 0.0, tree.joints[b, 0]
            if kind == PRISMATIC:
                c, s = math.cos(work.sec[SEC * up + 2]), math.sin(work.sec[SEC * up + 2])
                d_x, d_y = c * tree.joints[b, 2] - s * tree.joints[b, 3], s * tree.joints[b, 2] + c * tree.joints[b, 3]
                d_t = 0.0
            hinges[g], hinges[g + 1], hinges[g + 2] = d_x, d_y, d_t
            for k in range(3):
                hinges[g + 3 + k] = A[ao + n * k] * d_x + A[ao + n * k + 1] * d_y + A[ao + n * k + 2] * d_t
            d = d_x * hinges[g + 3] + d_y * hinges[g + 4] + d_t * hinges[g + 5]
            d += h * (tree.damping[first] + h * tree.stiffness[first])
            if not abs(d) > 0.0 or not abs(d) < 1e300:
                return False
            hinges[g + 6], hinges[g + 7] = 1.0 / d, 1.0
        if tree.sections[up, OWNER] >= 0:
            _hand_over(tree, work, b, jacobians, A, hinges)
    return True


@njit(**OPTIONS)
def _condense(A, ao, n, jacobians, w):
    """A body's square over its inboard section's twist in place of its frame's, its shapes eliminated: L D L^T of
    theirs with 1/D on the diagonal, rows 0..2 beyond column 3 the answer of the shapes to the twist."""
    x, z = jacobians[w + 2], jacobians[w + n + 2]
    for j in range(n):  # columns, then rows of the rotation
        A[ao + n * j + 2] -= x * A[ao + n * j] + z * A[ao + n * j + 1]
    for j in range(n):
        A[ao + 2 * n + j] -= x * A[ao + j] + z * A[ao + n + j]
    for i in range(3, n):
        f_0, f_1, f_2 = jacobians[w + i], jacobians[w + n + i], jacobians[w + 2 * n + i]
        if f_0 != 0.0 or f_1 != 0.0 or f_2 != 0.0:
            for j in range(3, n):
                A[ao + n * i + j] -= f_0 * A[ao + j] + f_1 * A[ao + n + j] + f_2 * A[ao + 2 * n + j]
    for j in range(3, n):
        f_0, f_1, f_2 = jacobians[w + j], jacobians[w + n + j], jacobians[w + 2 * n + j]
        if f_0 != 0.0 or f_1 != 0.0 or f_2 != 0.0:
            for k in range(3):
                A[ao + n * k + j] -= A[ao + n * k] * f_0 + A[ao + n * k + 1] * f_1 + A[ao + n * k + 2] * f_2
    for i in range(3, n):
        f_0, f_1, f_2 = jacobians[w + i], jacobians[w + n + i], jacobians[w + 2 * n + i]
        for j in range(3, n):
            e_0, e_1, e_2 = A[ao + i], A[ao + n + i], A[ao + 2 * n + i]
            A[ao + n * i + j] -= (
                e_0 * jacobians[w + j] + e_1 * jacobians[w + n + j] + e_2 * jacobians[w + 2 * n + j]
            )
    for i in range(3, n):
        row = ao + n * i
        for j in range(3, i):
            column, total = ao + n * j, A[row + j]
            for k in range(3, j):
                total -= A[row + k] * A[column + k]
            A[row + j] = total  # L D, to be divided when the row is done
        d = A[row + i]
        for j in range(3, i):
            scaled = A[row + j] * A[ao + n * j + j]
            d -= scaled * A[row + j]
            A[row + j] = scaled
        if not abs(d) > 0.0 or not abs(d) < 1e300:
            return False
        A[row + i] = 1.0 / d
    for k in range(3):
        row = ao + n * k
        for i in range(3, n):
            total = A[row + i]
            for j in range(3, i):
                total -= A[ao + n * i + j] * A[row + j]
            A[row + i] = total
    for i in range(3, n):
        d, e_0, e_1, e_2 = A[ao + n * i + i], A[ao + i], A[ao + n + i], A[ao + 2 * n + i]
        A[ao] -= e_0 * d * e_0
        A[ao + 1] -= e_0 * d * e_1
        A[ao + 2] -= e_0 * d * e_2
        A[ao + n + 1] -= e_1 * d * e_1
        A[ao + n + 2] -= e_1 * d * e_2
        A[ao + 2 * n + 2] -= e_2 * d * e_2
    A[ao + n], A[ao + 2 * n], A[ao + 2 * n + 1] = A[ao + 1], A[ao + 2], A[ao + n + 2]
    for k in range(3):
        row = ao + n * k
        for i in range(3, n):
            A[row + i] *= A[ao + n * i + i]
        for i in range(n - 1, 2, -1):
            answer = A[row + i]
            for j in range(3, i):
                A[row + j] -= A[ao + n * i + j] * answer
    return True


@njit(**OPTIONS)
def _small(A, ao, n):
    """L D L^T of the leading 3 x 3 in place, 1/D on the diagonal."""
    for i in range(3):
        d = A[ao + n * i + i]
        for j in range(i):
            total = A[ao + n * i + j]
            for k in range(j):
                total -= A[ao + n * i + k] * A[ao + n * j + k]
            A[ao + n * i + j] = total
        for j in range(i):
            scaled = A[ao + n * i + j] * A[ao + n * j + j]
            d -= scaled * A[ao + n * i + j]
            A[ao + n * i + j] = scaled
        if not abs(d) > 0.0 or not abs(d) < 1e300:
            return False
        A[ao + n * i + i] = 1.0 / d
    return True


@njit(**OPTIONS)
def _hand_over(tree, work, b, jacobians, A, hinges):
    """Add a body's articulated inertia, less what its joint gives way, to the square of the body that it hangs on."""
    ao, n, g = tree.bodies[b, SQUARE], 3 + tree.bodies[b, SHAPES], HINGE * b
    up, own = SEC * tree.bodies[b, PARENT], SEC * tree.bodies[b, INBOARD]
    soft = hinges[g + 6] * hinges[g + 7]
    h_0, h_1, h_2 = hinges[g + 3], hinges[g + 4], hinges[g + 5]
    if hinges[g + 7] == 0.0:
        h_0, h_1, h_2 = 0.0 * soft, 0.0 * soft, 0.0 * soft
    i_00, i_01, i_02 = A[ao] - soft * h_0 * h_0, A[ao + 1] - soft * h_0 * h_1, A[ao + 2] - soft * h_0 * h_2
    i_11, i_12 = A[ao + n + 1] - soft * h_1 * h_1, A[ao + n + 2] - soft * h_1 * h_2
    i_22 = A[ao + 2 * n + 2] - soft * h_2 * h_2
    x, z = work.sec[own] - work.sec[up], work.sec[own + 1] - work.sec[up + 1]
    i_22 += z * z * i_00 - 2.0 * x * z * i_01 + x * x * i_11 - 2.0 * z * i_02 + 2.0 * x * i_12
    i_02, i_12 = i_02 - z * i_00 + x * i_01, i_12 - z * i_01 + x * i_11
    parent = tree.sections[tree.bodies[b, PARENT], OWNER]
    po, m, w = tree.bodies[parent, SQUARE], 3 + tree.bodies[parent, SHAPES], tree.sections[tree.bodies[b, PARENT], JACOBIAN]
    for i in range(m):
        f_0, f_1, f_2 = jacobians[w + i], jacobians[w + m + i], jacobians[w + 2 * m + i]
        if f_0 != 0.0 or f_1 != 0.0 or f_2 != 0.0:
            e_0 = f_0 * i_00 + f_1 * i_01 + f_2 * i_02
            e_1 = f_0 * i_01 + f_1 * i_11 + f_2 * i_12
            e_2 = f_0 * i_02 + f_1 * i_12 + f_2 * i_22
            for j in range(m):
                A[po + m * i + j] += e_0 * jacobians[w + j] + e_1 * jacobians[w + m + j] + e_2 * jacobians[w + 2 * m + j]


@njit(**OPTIONS)
def solve(tree, work, jacobians, A, hinges, x, dy):
    """Solve with the factors: x has forces over all bodies' speeds and is left with these speeds; dy, the coordinates'.

    Where a drive prescribes a coordinate it has none.
    """
    count = tree.bodies.shape[0]
    for b in range(count - 1, -1, -1):
        ao, n, r, g = tree.bodies[b, SQUARE], 3 + tree.bodies[b, SHAPES], tree.bodies[b, ROW], HINGE * b
        w = tree.sections[tree.bodies[b, INBOARD], JACOBIAN]
        x[r + 2] -= jacobians[w + 2] * x[r] + jacobians[w + n + 2] * x[r + 1]
        f_0, f_1, f_2 = x[r], x[r + 1], x[r + 2]
        e_0, e_1, e_2 = f_0, f_1, f_2
        for j in range(3, n):
            x[r + j] -= jacobians[w + j] * f_0 + jacobians[w + n + j] * f_1 + jacobians[w + 2 * n + j] * f_2
            e_0 -= A[ao + j] * x[r + j]
            e_1 -= A[ao + n + j] * x[r + j]
            e_2 -= A[ao + 2 * n + j] * x[r + j]
        x[r], x[r + 1], x[r + 2] = e_0, e_1, e_2
        if tree.bodies[b, JOINT] == FREE:
            continue
        if hinges[g + 7] != 0.0:
            push = hinges[g] * e_0 + hinges[g + 1] * e_1 + hinges[g + 2] * e_2
            dy[tree.bodies[b, FIRST]] = push
            push = push * hinges[g + 6]
            e_0 -= push * hinges[g + 3]
            e_1 -= push * hinges[g + 4]
            e_2 -= push * hinges[g + 5]
        parent = tree.sections[tree.bodies[b, PARENT], OWNER]
        if parent >= 0:
            up, own = SEC * tree.bodies[b, PARENT], SEC * tree.bodies[b, INBOARD]
            e_2 += (work.sec[own] - work.sec[up]) * e_1 - (work.sec[own + 1] - work.sec[up + 1]) * e_0
            q, m, v = tree.bodies[parent, ROW], 3 + tree.bodies[parent, SHAPES], tree.sections[tree.bodies[b, PARENT], JACOBIAN]
            for j in range(m):
                x[q + j] += jacobians[v + j] * e_0 + jacobians[v + m + j] * e_1 + jacobians[v + 2 * m + j] * e_2
    for b in range(count):
        ao, n, r, g = tree.bodies[b, SQUARE], 3 + tree.bodies[b, SHAPES], tree.bodies[b, ROW], HINGE * b
        first, kind = tree.bodies[b, FIRST], tree.bodies[b, JOINT]
        parent = tree.sections[tree.bodies[b, PARENT], OWNER]
        v_0, v_1, v_2 = 0.0 * x[r], 0.0 * x[r], 0.0 * x[r]
        if kind == FREE:
            v_0, v_1, v_2 = _small_solve(A, ao, n, x, r)
            dy[first], dy[first + 1], dy[first + 2] = v_0, v_1, v_2
        else:
            if parent >= 0:
                q, m, v = tree.bodies[parent, ROW], 3 + tree.bodies[parent, SHAPES], tree.sections[tree.bodies[b, PARENT], JACOBIAN]
                for j in range(m):
                    v_0 += jacobians[v + j] * x[q + j]
                    v_1 += jacobians[v + m + j] * x[q + j]
                    v_2 += jacobians[v + 2 * m + j] * x[q + j]
                up, own = SEC * tree.bodies[b, PARENT], SEC * tree.bodies[b, INBOARD]
                v_0 -= (work.sec[own + 1] - work.sec[up + 1]) * v_2
                v_1 += (work.sec[own] - work.sec[up]) * v_2
            if hinges[g + 7] != 0.0:
                rate = dy[first] - hinges[g + 3] * v_0 - hinges[g + 4] * v_1 - hinges[g + 5] * v_2
                rate = rate * hinges[g + 6]
                dy[first] = rate
                v_0 += hinges[g] * rate
                v_1 += hinges[g + 1] * rate
                v_2 += hinges[g + 2] * rate
            elif tree.bodies[b, DOF] == 1:
                dy[first] = 0.0
        _shapes(A, ao, n, x, r, v_0, v_1, v_2)
        w, i = tree.sections[tree.bodies[b, INBOARD], JACOBIAN], tree.bodies[b, MODAL]
        for j in range(3, n):
            dy[i + j - 3] = x[r + j]
            v_0 -= jacobians[w + j] * x[r + j]
            v_1 -= jacobians[w + n + j] * x[r + j]
            v_2 -= jacobians[w + 2 * n + j] * x[r + j]
        x[r], x[r + 1], x[r + 2] = v_0 - jacobians[w + 2] * v_2, v_1 - jacobians[w + n + 2] * v_2, v_2


@njit(**OPTIONS)
def _small_solve(A, ao, n, x, r):
    x_0 = x[r]
    x_1 = x[r + 1] - A[ao + n] * x_0
    x_2 = x[r + 2] - A[ao + 2 * n] * x_0 - A[ao + 2 * n + 1] * x_1
    x_2 = x_2 * A[ao + 2 * n + 2]
    x_1 = x_1 * A[ao + n + 1] - A[ao + 2 * n + 1] * x_2
    x_0 = x_0 * A[ao] - A[ao + n] * x_1 - A[ao + 2 * n] * x_2
    return x_0, x_1, x_2


@njit(**OPTIONS)
def _shapes(A, ao, n, x, r, v_0, v_1, v_2):
    """Rates of a body's shapes, whose forces x has, with the twist of its inboard section."""
    for i in range(3, n):
        total = x[r + i]
        for j in range(3, i):
            total -= A[ao + n * i + j] * x[r + j]
        x[r + i] = total
    for i in range(3, n):
        x[r + i] *= A[ao + n * i + i]
    for i in range(n - 1, 2, -1):
        answer = x[r + i]
        for j in range(3, i):
            x[r + j] -= A[ao + n * i + j] * answer
    for j in range(3, n):
        x[r + j] -= A[ao + j] * v_0 + A[ao + n + j] * v_1 + A[ao + 2 * n + j] * v_2


@njit(**OPTIONS)
def section_twist(tree, jacobians, n, x):
    """Twist of a section from all bodies' speeds."""
    b = tree.sections[n, OWNER]
    t_0, t_1, t_2 = 0.0 * x[0], 0.0 * x[0], 0.0 * x[0]
    if b >= 0:
        r, m, w = tree.bodies[b, ROW], 3 + tree.bodies[b, SHAPES], tree.sections[n, JACOBIAN]
        for j in range(m):
            t_0 += jacobians[w + j] * x[r + j]
            t_1 += jacobians[w + m + j] * x[r + j]
            t_2 += jacobians[w + 2 * m + j] * x[r + j]
    return t_0, t_1, t_2


@njit(**OPTIONS)
def section_force(tree, jacobians, n, f_0, f_1, f_2, x):
    """Add a section's force and moment to forces over all bodies' speeds."""
    b = tree.sections[n, OWNER]
    if b >= 0:
        r, m, w = tree.bodies[b, ROW], 3 + tree.bodies[b, SHAPES], tree.sections[n, JACOBIAN]
        for j in range(m):
            x[r + j] += jacobians[w + j] * f_0 + jacobians[w + m + j] * f_1 + jacobians[w + 2 * m + j] * f_2
