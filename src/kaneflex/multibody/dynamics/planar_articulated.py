"""Linear equations (M + h C + h^2 K) x = r of a tree of bodies, with work proportional to the number of bodies.

The inward pass eliminates every body's shapes and its joint's coordinate, which leaves a 3 x 3 matrix at the section of
the parent (articulated inertia of Featherstone 1983, with shapes as further joints); the outward pass substitutes back.
C and K are local to shapes and joints. h may be complex: the same code factorises the matrices of all collocation
stages. Rows of the matrices belong to a body's frame (x, y, phi) and its shapes.
"""

from __future__ import annotations

from numba import njit

from kaneflex.generated import body
from kaneflex.multibody.model.layout import (
    BLOCK, BODIES, COLUMNS, COORDINATES, COURSE_OF, DAMPING, DOF, FIRST, FRAME, FRAME_SIZE, FREE, HINGES, HINGE_SIZE,
    IN_ORDER, INBOARD, JACOBIAN, JOINT, LAST, MASS, MIDDLE, MODAL, NUMBERS, OPTIONS, OWNER, PARENT,
    POINT, PRISMATIC, PUSH, REVOLUTE, ROW, SEC, SECTIONS, SHAPES, SQUARE, SQUARES, STIFFNESS, W, Y, apart,
    magnitude, turned,
)  # fmt: skip


@njit(**OPTIONS)
def assemble(m):
    """Mass matrices of all bodies, and W of all sections: their twists by the speeds of frame and shapes."""
    apart()
    plan, w = m.plan, m.w
    for b in range(plan[BODIES]):
        f, i = plan[FRAME] + FRAME_SIZE * b, plan[Y] + m.bodies[b, MODAL]
        c, s = w[f + 3], w[f + 4]
        body.inertia(w, m.bodies[b, BLOCK], w, i, c, s, w, plan[MASS] + m.bodies[b, SQUARE])
        for n in range(m.bodies[b, SECTIONS], m.bodies[b, LAST]):
            at = m.sections[n, JACOBIAN]
            body.jacobian(w, m.sections[n, POINT], w, i, c, s, w, plan[W] + at)


@njit(**OPTIONS)
def factorise(m, h, A):
    """Factors of M + h C + h^2 K in A, real or complex, with MASS, W and MIDDLE; False: a pivot vanishes."""
    apart()
    plan, w = m.plan, m.w
    count, squares = plan[BODIES], plan[SQUARES]
    for b in range(count):
        ao, n, i = squares + m.bodies[b, SQUARE], 3 + m.bodies[b, SHAPES], m.bodies[b, MODAL]
        for k in range(n * n):
            A[ao + k] = w[plan[MASS] + m.bodies[b, SQUARE] + k]
        for j in range(n - 3):
            A[ao + (n + 1) * (3 + j)] += h * (w[plan[DAMPING] + i + j] + h * w[plan[STIFFNESS] + i + j])
    for b in range(count - 1, -1, -1):
        ao, n = squares + m.bodies[b, SQUARE], 3 + m.bodies[b, SHAPES]
        own, up = m.bodies[b, INBOARD], m.bodies[b, PARENT]
        if not _condense(A, ao, n, w, plan[W] + m.sections[own, JACOBIAN]):
            return False
        g, kind, first = plan[HINGES] + HINGE_SIZE * b, m.bodies[b, JOINT], m.bodies[b, FIRST]
        A[g + 7] = 0.0
        if kind == FREE:
            if not _small(A, ao, n):
                return False
            continue
        if kind == REVOLUTE or kind == PRISMATIC:
            d_x, d_y, d_t = 0.0, 0.0, w[m.bodies[b, NUMBERS]]
            if kind == PRISMATIC:
                d_x, d_y = turned(w, w[plan[MIDDLE] + SEC * up + 2], m.bodies[b, NUMBERS] + 2)
                d_t = 0.0
            A[g], A[g + 1], A[g + 2] = d_x, d_y, d_t
            for k in range(3):
                A[g + 3 + k] = A[ao + n * k] * d_x + A[ao + n * k + 1] * d_y + A[ao + n * k + 2] * d_t
            if m.bodies[b, COURSE_OF] < 0:
                d = d_x * A[g + 3] + d_y * A[g + 4] + d_t * A[g + 5]
                d += h * (w[plan[DAMPING] + first] + h * w[plan[STIFFNESS] + first])
                if not magnitude(d) > 0.0 or not magnitude(d) < 1e300:
                    return False
                A[g + 6], A[g + 7] = 1.0 / d, 1.0
        if m.sections[up, OWNER] >= 0:
            _hand_over(m, b, A)
    return True


# Compiled in one piece, as `solve` is: what their loops share are places and lengths, more than a loop has lines.
@njit(**IN_ORDER)
def _condense(A, ao, n, jacobians, w):
    """A body's square over its inboard section's twist in place of its frame's, its shapes eliminated: L D L^T of
    theirs with 1/D on the diagonal, rows 0..2 beyond column 3 the answer of the shapes to the twist."""
    apart()
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
            A[ao + n * i + j] -= e_0 * jacobians[w + j] + e_1 * jacobians[w + n + j] + e_2 * jacobians[w + 2 * n + j]
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
        if not magnitude(d) > 0.0 or not magnitude(d) < 1e300:
            return False
        A[row + i] = 1.0 / d
    for i in range(3, n):
        row, e_0, e_1, e_2 = ao + n * i, A[ao + i], A[ao + n + i], A[ao + 2 * n + i]
        for j in range(3, i):
            known = A[row + j]
            e_0 -= known * A[ao + j]
            e_1 -= known * A[ao + n + j]
            e_2 -= known * A[ao + 2 * n + j]
        A[ao + i], A[ao + n + i], A[ao + 2 * n + i] = e_0, e_1, e_2
    for i in range(3, n):
        d, e_0, e_1, e_2 = A[ao + n * i + i], A[ao + i], A[ao + n + i], A[ao + 2 * n + i]
        A[ao] -= e_0 * d * e_0
        A[ao + 1] -= e_0 * d * e_1
        A[ao + 2] -= e_0 * d * e_2
        A[ao + n + 1] -= e_1 * d * e_1
        A[ao + n + 2] -= e_1 * d * e_2
        A[ao + 2 * n + 2] -= e_2 * d * e_2
    A[ao + n], A[ao + 2 * n], A[ao + 2 * n + 1] = A[ao + 1], A[ao + 2], A[ao + n + 2]
    for i in range(3, n):
        d = A[ao + n * i + i]
        A[ao + i] *= d
        A[ao + n + i] *= d
        A[ao + 2 * n + i] *= d
    for i in range(n - 1, 2, -1):
        row, e_0, e_1, e_2 = ao + n * i, A[ao + i], A[ao + n + i], A[ao + 2 * n + i]
        for j in range(3, i):
            known = A[row + j]
            A[ao + j] -= known * e_0
            A[ao + n + j] -= known * e_1
            A[ao + 2 * n + j] -= known * e_2
    return True


@njit(**OPTIONS)
def _small(A, ao, n):
    """L D L^T of the leading 3 x 3 in place, 1/D on the diagonal."""
    apart()
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
        if not magnitude(d) > 0.0 or not magnitude(d) < 1e300:
            return False
        A[ao + n * i + i] = 1.0 / d
    return True


@njit(**OPTIONS)
def _hand_over(m, b, A):
    """Add a body's articulated inertia, reduced by its joint's freedom, to the matrix of its parent."""
    apart()
    plan, w = m.plan, m.w
    ao, n, g = plan[SQUARES] + m.bodies[b, SQUARE], 3 + m.bodies[b, SHAPES], plan[HINGES] + HINGE_SIZE * b
    up, own = plan[MIDDLE] + SEC * m.bodies[b, PARENT], plan[MIDDLE] + SEC * m.bodies[b, INBOARD]
    i_00, i_01, i_02, i_11, i_12, i_22 = A[ao], A[ao + 1], A[ao + 2], A[ao + n + 1], A[ao + n + 2], A[ao + 2 * n + 2]
    if A[g + 7] != 0.0:
        soft, h_0, h_1, h_2 = A[g + 6], A[g + 3], A[g + 4], A[g + 5]
        i_00, i_01, i_02 = i_00 - soft * h_0 * h_0, i_01 - soft * h_0 * h_1, i_02 - soft * h_0 * h_2
        i_11, i_12, i_22 = i_11 - soft * h_1 * h_1, i_12 - soft * h_1 * h_2, i_22 - soft * h_2 * h_2
    x, z = w[own] - w[up], w[own + 1] - w[up + 1]
    i_22 += z * z * i_00 - 2.0 * x * z * i_01 + x * x * i_11 - 2.0 * z * i_02 + 2.0 * x * i_12
    i_02, i_12 = i_02 - z * i_00 + x * i_01, i_12 - z * i_01 + x * i_11
    parent = m.sections[m.bodies[b, PARENT], OWNER]
    po, size = plan[SQUARES] + m.bodies[parent, SQUARE], 3 + m.bodies[parent, SHAPES]
    v = plan[W] + m.sections[m.bodies[b, PARENT], JACOBIAN]
    for i in range(size):
        f_0, f_1, f_2 = w[v + i], w[v + size + i], w[v + 2 * size + i]
        if f_0 != 0.0 or f_1 != 0.0 or f_2 != 0.0:
            e_0 = f_0 * i_00 + f_1 * i_01 + f_2 * i_02
            e_1 = f_0 * i_01 + f_1 * i_11 + f_2 * i_12
            e_2 = f_0 * i_02 + f_1 * i_12 + f_2 * i_22
            for j in range(size):
                A[po + size * i + j] += e_0 * w[v + j] + e_1 * w[v + size + j] + e_2 * w[v + 2 * size + j]


@njit(**OPTIONS)
def solve(m, A, row):
    """Solve with the factors; the solution replaces the coordinates' forces in a row of COLUMNS.

    PUSH has forces over all bodies' speeds besides and receives these speeds. Prescribed coordinates stay unchanged;
    their entries receive the forces of their drives.
    """
    apart()
    plan, w = m.plan, m.w
    count, x, y = plan[BODIES], plan[PUSH], plan[COLUMNS] + row * plan[COORDINATES]
    for b in range(count - 1, -1, -1):
        ao, n, r = plan[SQUARES] + m.bodies[b, SQUARE], 3 + m.bodies[b, SHAPES], x + m.bodies[b, ROW]
        g, v = plan[HINGES] + HINGE_SIZE * b, plan[W] + m.sections[m.bodies[b, INBOARD], JACOBIAN]
        A[r + 2] -= w[v + 2] * A[r] + w[v + n + 2] * A[r + 1]
        f_0, f_1, f_2 = A[r], A[r + 1], A[r + 2]
        e_0, e_1, e_2 = f_0, f_1, f_2
        first, modal = y + m.bodies[b, FIRST], y + m.bodies[b, MODAL]
        for j in range(3, n):
            A[r + j] += A[modal + j - 3] - w[v + j] * f_0 - w[v + n + j] * f_1 - w[v + 2 * n + j] * f_2
            e_0 -= A[ao + j] * A[r + j]
            e_1 -= A[ao + n + j] * A[r + j]
            e_2 -= A[ao + 2 * n + j] * A[r + j]
        if m.bodies[b, JOINT] == FREE:
            A[r], A[r + 1], A[r + 2] = e_0 + A[first], e_1 + A[first + 1], e_2 + A[first + 2]
            continue
        if m.bodies[b, DOF] == 1:
            push = A[first] + A[g] * e_0 + A[g + 1] * e_1 + A[g + 2] * e_2
            A[first] = push
            if A[g + 7] != 0.0:
                push = push * A[g + 6]
                e_0 -= push * A[g + 3]
                e_1 -= push * A[g + 4]
                e_2 -= push * A[g + 5]
        parent = m.sections[m.bodies[b, PARENT], OWNER]
        if parent >= 0:
            up, own = plan[MIDDLE] + SEC * m.bodies[b, PARENT], plan[MIDDLE] + SEC * m.bodies[b, INBOARD]
            e_2 += (w[own] - w[up]) * e_1 - (w[own + 1] - w[up + 1]) * e_0
            add_force(m, A, m.bodies[b, PARENT], e_0, e_1, e_2)
    for b in range(count):
        ao, n, r = plan[SQUARES] + m.bodies[b, SQUARE], 3 + m.bodies[b, SHAPES], x + m.bodies[b, ROW]
        g, first = plan[HINGES] + HINGE_SIZE * b, y + m.bodies[b, FIRST]
        if m.bodies[b, JOINT] == FREE:
            v_0, v_1, v_2 = _small_solve(A, ao, n, r)
            A[first], A[first + 1], A[first + 2] = v_0, v_1, v_2
        else:
            v_0, v_1, v_2 = twist_of(m, A, m.bodies[b, PARENT])
            up, own = plan[MIDDLE] + SEC * m.bodies[b, PARENT], plan[MIDDLE] + SEC * m.bodies[b, INBOARD]
            v_0 -= (w[own + 1] - w[up + 1]) * v_2
            v_1 += (w[own] - w[up]) * v_2
            if m.bodies[b, DOF] == 1:
                push = A[first] - A[g + 3] * v_0 - A[g + 4] * v_1 - A[g + 5] * v_2
                A[first] = -push
                if A[g + 7] != 0.0:
                    rate = push * A[g + 6]
                    A[first] = rate
                    v_0 += A[g] * rate
                    v_1 += A[g + 1] * rate
                    v_2 += A[g + 2] * rate
        _shapes(A, ao, n, r, v_0, v_1, v_2)
        v, i = plan[W] + m.sections[m.bodies[b, INBOARD], JACOBIAN], y + m.bodies[b, MODAL]
        for j in range(3, n):
            A[i + j - 3] = A[r + j]
            v_0 -= w[v + j] * A[r + j]
            v_1 -= w[v + n + j] * A[r + j]
            v_2 -= w[v + 2 * n + j] * A[r + j]
        A[r], A[r + 1], A[r + 2] = v_0 - w[v + 2] * v_2, v_1 - w[v + n + 2] * v_2, v_2


@njit(**OPTIONS)
def _small_solve(A, ao, n, r):
    x_0 = A[r]
    x_1 = A[r + 1] - A[ao + n] * x_0
    x_2 = A[r + 2] - A[ao + 2 * n] * x_0 - A[ao + 2 * n + 1] * x_1
    x_2 = x_2 * A[ao + 2 * n + 2]
    x_1 = x_1 * A[ao + n + 1] - A[ao + 2 * n + 1] * x_2
    x_0 = x_0 * A[ao] - A[ao + n] * x_1 - A[ao + 2 * n] * x_2
    return x_0, x_1, x_2


@njit(**IN_ORDER)
def _shapes(A, ao, n, r, v_0, v_1, v_2):
    """Rates of a body's shapes, whose forces are at r, with the twist of its inboard section."""
    apart()
    for i in range(3, n):
        total = A[r + i]
        for j in range(3, i):
            total -= A[ao + n * i + j] * A[r + j]
        A[r + i] = total
    for i in range(3, n):
        A[r + i] *= A[ao + n * i + i]
    for i in range(n - 1, 2, -1):
        answer = A[r + i]
        for j in range(3, i):
            A[r + j] -= A[ao + n * i + j] * answer
    for j in range(3, n):
        A[r + j] -= A[ao + j] * v_0 + A[ao + n + j] * v_1 + A[ao + 2 * n + j] * v_2


@njit(**OPTIONS)
def twist_of(m, A, n):
    """Twist of a section from the speeds at PUSH."""
    w, b, r = m.w, m.sections[n, OWNER], m.plan[PUSH]
    t_0, t_1, t_2 = 0.0 * A[r], 0.0 * A[r], 0.0 * A[r]
    if b >= 0:
        r, size, v = r + m.bodies[b, ROW], 3 + m.bodies[b, SHAPES], m.plan[W] + m.sections[n, JACOBIAN]
        for j in range(size):
            t_0 += w[v + j] * A[r + j]
            t_1 += w[v + size + j] * A[r + j]
            t_2 += w[v + 2 * size + j] * A[r + j]
    return t_0, t_1, t_2


@njit(**OPTIONS)
def add_force(m, A, n, f_0, f_1, f_2):
    """Add a section's force and moment to the forces at PUSH."""
    w, b = m.w, m.sections[n, OWNER]
    if b >= 0:
        r, size, v = m.plan[PUSH] + m.bodies[b, ROW], 3 + m.bodies[b, SHAPES], m.plan[W] + m.sections[n, JACOBIAN]
        for j in range(size):
            A[r + j] += w[v + j] * f_0 + w[v + size + j] * f_1 + w[v + 2 * size + j] * f_2
