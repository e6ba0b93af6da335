"""Compiled residual of the equations of motion as generalised forces of the independent coordinates.

It is N^T (M a - f), Kane's equations with the partial velocities N of the independent coordinates, and zero for
solutions. The reactions of the cuts balance the dependent coordinates of the tree.
"""

from __future__ import annotations

from numba import njit

from kaneflex.multibody.compile.values import width
from kaneflex.multibody.dynamics.inverse_dynamics import demand
from kaneflex.multibody.dynamics import rotation_vectors
from kaneflex.multibody.dynamics.loop_closure import follow, gradients, move_dependent, solve_loops
from kaneflex.multibody.dynamics.arrays import BALLS, OWN
from kaneflex.multibody.dynamics.arrays import COORDINATES as ALL_COORDINATES
from kaneflex.multibody.compile.types import ENTRY, OPTIONS, no_inline, shifted
from kaneflex.multibody.model.layout import COORDINATES, DEPENDENT, INPUT, KEPT, PASSING, REACTIONS, ROW_OF, SIDE


@njit(**OPTIONS)
def update_reactions(m):
    """Update the reactions of the cuts at NOW to balance the dependent coordinates; False: singular.

    At DEMAND the independent coordinates then have the whole residual.
    """
    no_inline()
    plan, w = m.plan, m.w
    n, count = plan[COORDINATES], plan[KEPT]
    if not gradients(m, True, True):
        return False
    for r in range(count):
        w[plan[SIDE] + r] = m.h[plan[plan[DEPENDENT] + r]]
    solve_loops(m)
    for r in range(count):
        size = w[plan[SIDE] + r]
        m.multipliers[plan[plan[ROW_OF] + r]] += size
        for i in range(n):
            m.h[i] -= size * m.J[n * r + i]
    return True


@njit(**OPTIONS)
def set_coordinates(m, q):
    """Set coordinates, those of balls as quaternions; returns their number."""
    no_inline()
    for n in range(m.counts[OWN]):
        m.y[m.own[n, 1]] = q[m.own[n, 0]]
    for n in range(m.counts[BALLS]):
        k, s = m.balls[n, 0], m.balls[n, 1]
        m.q[k], m.q[k + 1], m.q[k + 2], m.q[k + 3] = q[k], q[k + 1], q[k + 2], q[k + 3]
        m.y[s] = m.y[s + 1] = m.y[s + 2] = 0.0
    return m.counts[ALL_COORDINATES]


@njit(**OPTIONS)
def settled(m):
    """True if rates do not yet belong to the closed position: where a ball has turned, and always in the plane."""
    if width(m) == 6:
        return rotation_vectors.rebase(m)
    return True


@njit(**OPTIONS)
def set_state(m, given, width):
    """Set coordinates and speeds, and their rates and inputs if a row of that width has them; returns the number of
    inputs."""
    plan, w, n = m.plan, m.w, m.plan[COORDINATES]
    speeds = set_coordinates(m, given)
    added = width - speeds - 2 * n
    for i in range(n):
        m.u[i] = given[speeds + i]
        if width > speeds + n:
            m.du[i] = given[speeds + n + i]
    for k in range(added):
        w[plan[INPUT] + k] = given[speeds + 2 * n + k]
    return added


@njit(**ENTRY)
def reduced_demand(m, independent, free, times, count, given, width, out):
    """Generalised forces of the independent speeds, N = kg m/s^2 or N m, then all speeds, (count, free + n).

    given: rows of :func:`set_state`; accelerations of dependent speeds follow from the loops. The tables keep the last
    row, with the reactions of its cuts, and without inputs. Returns the number of rows done: the next one doesn't
    close.
    """
    plan, w, n = m.plan, m.w, m.plan[COORDINATES]
    added, done = 0, 0
    m.pivots[PASSING] = 1  # positions as exact as near change points, as derivatives are taken by differences
    for row in range(count):
        added = set_state(m, shifted(given, row * width), width)
        for r in range(plan[REACTIONS]):
            m.multipliers[r] = 0.0
        if not follow(m, times[row]) or (settled(m) and not follow(m, times[row])):
            break
        demand(m, times[row])
        if not update_reactions(m):
            break
        settled(m)
        here = shifted(out, row * (free + n))
        for k in range(free):
            here[k] = m.h[independent[k]]
        for i in range(n):
            here[free + i] = m.u[i]
        done += 1
    for k in range(added):
        w[plan[INPUT] + k] = 0.0
    return done


@njit(**ENTRY)
def basis(m, independent, count, out):
    """Speeds for a unit of each independent one, (count, n), where the loops are closed."""
    plan, n = m.plan, m.plan[COORDINATES]
    gradients(m, True, False)
    for j in range(count):
        B = shifted(out, n * j)
        for s in range(n):
            B[s] = 0.0
        B[independent[j]] = 1.0
        move_dependent(m, independent[j])
        for r in range(plan[KEPT]):
            B[plan[plan[DEPENDENT] + r]] = -m.w[plan[SIDE] + r]
