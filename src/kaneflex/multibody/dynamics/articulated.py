"""Linear equations (M + h C + h^2 K) x = r of a tree of bodies, with work proportional to the number of bodies.

The inward pass eliminates the shapes of every body and the freedoms of its joint, one after the other, and hands the
rest to the parent: articulated inertias (Featherstone 1983; 2008, ch. 7), with shapes as further joints. The outward
pass substitutes back. One text for the plane and space (vectors of D = 3 or 6 numbers), and for real and complex h.
Vectors are global. A body's inertia I (D, D) belongs to the twist of its origin, E (n, D) couples its shapes to it, and
L (n, n) is the shapes' own.

Functions take a record of arrays. I, E and L become factors, with U and D of the joints. The tree's geometry when it is
factorised: S, axes of the joints at the bodies' origins; phi, twists of the outboard sections for the shapes; places of
these sections from the parent's origin, and arms from there to the bodies' origins. x and y are forces, then speeds, of
bodies and of coordinates.
"""

from __future__ import annotations

from collections import namedtuple

from numba import njit

from kaneflex.multibody.compile.types import IN_ORDER, OPTIONS, magnitude, no_inline_vectorised
from kaneflex.multibody.compile.values import after, inline, numbers_of, width
from kaneflex.multibody.dynamics.algebra import add_product, axpy, dot, force_at, plus, scaled, times, twist_at
from kaneflex.multibody.model.layout import COUPLING, DOF, FIRST, MODAL, OUTBOARD, PARENT_BODY, SHAPES, SQUARE

Body = namedtuple("Body", "n f I E L S U D push modal")
Section = namedtuple("Section", "n I E L phi place modal")


@njit(**OPTIONS)
def body_arrays(a, b):
    """Matrices and axes of a body."""
    inline()
    d, n, push = width(a.S), a.bodies[b, SHAPES], a.bodies[b, FIRST]
    return Body(n, a.bodies[b, DOF], after(a.I, d * b), after(a.E, a.bodies[b, COUPLING]),
                after(a.L, a.bodies[b, SQUARE]), after(a.S, push), after(a.U, push), after(a.D, push), push,
                a.bodies[b, MODAL])  # fmt: skip


@njit(**OPTIONS)
def carrier_of(a, b):
    """Section that carries a body, with the matrices of the parent."""
    inline()
    up, out = a.bodies[b, PARENT_BODY], a.bodies[b, OUTBOARD]
    n = a.bodies[up, SHAPES] if out >= 0 else 0
    return Section(n, after(a.I, width(a.S) * up), after(a.E, a.bodies[up, COUPLING]),
                   after(a.L, a.bodies[up, SQUARE]), after(a.phi, out if out >= 0 else 0), a.place[b],
                   a.bodies[up, MODAL])  # fmt: skip


@njit(**IN_ORDER)
def _factorise_shapes(L, n):
    """L D L^T of the lower triangle in place, 1/D on the diagonal; False: a pivot vanishes."""
    no_inline_vectorised()
    for i in range(n):
        row = n * i
        for j in range(i):
            total = L[row + j]
            for k in range(j):
                total -= L[row + k] * L[n * j + k]
            L[row + j] = total
        pivot = L[row + i]
        for j in range(i):
            share = L[row + j] * L[n * j + j]
            pivot -= share * L[row + j]
            L[row + j] = share
        if not magnitude(pivot) > 0.0 or not magnitude(pivot) < 1e300:
            return False
        L[row + i] = 1.0 / pivot
    return True


@njit(**IN_ORDER)
def _condense(b):
    """Eliminate a body's shapes; rows of E become their response to a unit twist."""
    no_inline_vectorised()
    I, E, L, n = b.I, b.E, b.L, b.n
    if not _factorise_shapes(L, n):
        return False
    for i in range(n):
        e = E[i]
        for j in range(i):
            e = axpy(-L[n * i + j], E[j], e)
        E[i] = e
    for i in range(n):
        e = E[i]
        add_product(I, -L[n * i + i], e, e)
        E[i] = scaled(L[n * i + i], e)
    for i in range(n - 1, -1, -1):
        e = E[i]
        for j in range(i):
            E[j] = axpy(-L[n * i + j], e, E[j])
    return True


@njit(**IN_ORDER)
def _release(b, free):
    """Eliminate the freedoms of a body's joint, one after the other; D begins with the coordinates' own inertia."""
    no_inline_vectorised()
    for j in range(b.f):
        felt = times(b.I, b.S[j])
        b.U[j] = felt
        if free[b.push + j] == 0:
            continue
        pivot = b.D[j] + dot(felt, b.S[j])
        if not magnitude(pivot) > 0.0 or not magnitude(pivot) < 1e300:
            return False
        b.D[j] = 1.0 / pivot
        add_product(b.I, -b.D[j], felt, felt)
    return True


@njit(**IN_ORDER)
def transport(I, r):
    """Inertia referred to another point, r away: X^T I X."""
    no_inline_vectorised()
    d, numbers = width(I), numbers_of(I)
    for _ in range(2):
        for k in range(d):
            I[k] = force_at(I[k], r)
        for k in range(d):
            for l in range(k):
                numbers[d * k + l], numbers[d * l + k] = numbers[d * l + k], numbers[d * k + l]


@njit(**IN_ORDER)
def _hand_over(I, arm, up, E):
    """Add an articulated inertia to the matrices of the parent at the section ``up``; E is working space."""
    no_inline_vectorised()
    transport(I, arm)
    for i in range(up.n):
        e = times(I, up.phi[i])
        E[i] = e
        for j in range(i + 1):
            up.L[up.n * i + j] += dot(E[j], up.phi[i])
        up.E[i] = plus(up.E[i], force_at(e, up.place))
    transport(I, up.place)
    for k in range(width(I)):
        up.I[k] = plus(up.I[k], I[k])


@njit(**OPTIONS)
def factorise(a):
    """Factorise the matrices in place, lower triangles of L, with the coordinates' own inertia in D; False: a pivot
    vanishes."""
    no_inline_vectorised()
    for b in range(a.counts[0] - 1, -1, -1):
        own = body_arrays(a, b)
        if not (_condense(own) and _release(own, a.free)):
            return False
        if a.bodies[b, PARENT_BODY] >= 0:
            _hand_over(own.I, a.arm[b], carrier_of(a, b), a.room)
    return True


@njit(**IN_ORDER)
def _inwards(b, free, y, force):
    """Force on the section that carries a body, from forces along shapes and joint (at y) and on the body."""
    no_inline_vectorised()
    for j in range(b.n):
        force = axpy(-y[b.modal + j], b.E[j], force)
    for j in range(b.f):
        share = y[b.push + j] + dot(force, b.S[j])
        y[b.push + j] = share
        if free[b.push + j] != 0:
            force = axpy(-share * b.D[j], b.U[j], force)
    return force


@njit(**IN_ORDER)
def _outwards(b, free, y, twist):
    """Rates of joint and shapes, and the body's twist, from that of the section that carries it. A coordinate that is
    not free keeps its rate of zero, and y receives the force that it takes."""
    no_inline_vectorised()
    for j in range(b.f - 1, -1, -1):
        rate = dot(twist, b.U[j]) - y[b.push + j]
        if free[b.push + j] != 0:
            rate = -rate * b.D[j]
            twist = axpy(rate, b.S[j], twist)
        y[b.push + j] = rate
    n, L, x = b.n, b.L, after(y, b.modal)
    for i in range(n):
        total = x[i]
        for j in range(i):
            total -= L[n * i + j] * x[j]
        x[i] = total
    for i in range(n):
        x[i] *= L[n * i + i]
    for i in range(n - 1, -1, -1):
        answer = x[i]
        for j in range(i):
            x[j] -= L[n * i + j] * answer
    for j in range(n):
        x[j] -= dot(twist, b.E[j])
    return twist


@njit(**OPTIONS)
def solve(a):
    """Solve with the factors: from forces of coordinates at y and of bodies at x, the rates of both in place."""
    no_inline_vectorised()
    x, y = a.x, a.y
    for b in range(a.counts[0] - 1, -1, -1):
        felt = _inwards(body_arrays(a, b), a.free, y, x[b])
        if a.bodies[b, PARENT_BODY] >= 0:
            up = carrier_of(a, b)
            felt = force_at(felt, a.arm[b])
            for j in range(up.n):
                y[up.modal + j] += dot(felt, up.phi[j])
            x[a.bodies[b, PARENT_BODY]] = plus(x[a.bodies[b, PARENT_BODY]], force_at(felt, up.place))
    for b in range(a.counts[0]):
        twist = scaled(0.0, x[b])
        if a.bodies[b, PARENT_BODY] >= 0:
            up = carrier_of(a, b)
            twist = twist_at(x[a.bodies[b, PARENT_BODY]], up.place)
            for j in range(up.n):
                twist = axpy(y[up.modal + j], up.phi[j], twist)
            twist = twist_at(twist, a.arm[b])
        x[b] = _outwards(body_arrays(a, b), a.free, y, twist)
