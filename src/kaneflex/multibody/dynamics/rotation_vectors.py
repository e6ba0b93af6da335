"""Rotation vectors and quaternions of balls, in compiled code; there are none in the plane."""

from __future__ import annotations

import math

from numba import njit

from kaneflex.multibody.compile.types import OPTIONS, no_inline
from kaneflex.multibody.compile.values import inline
from kaneflex.multibody.dynamics.algebra import axpy, cross, dot, plus, scaled
from kaneflex.multibody.dynamics.arrays import BALLS
from kaneflex.multibody.model.layout import COORDINATES, LAST_A

_TERMS = 16
"""Terms of power series: those left out are below rounding up to an angle of a turn."""
FARTHEST = 2.0
"""Largest rotation of a ball in a step [rad]: at a full turn its rotation vector is singular."""


@njit(**OPTIONS)
def rate_coefficients(theta):
    """Coefficients b, c of a rotation vector's rate, and of their own rates.

    In its axes the angular velocity is omega = theta' - b theta x theta' + c theta x (theta x theta') with b = (1 - cos
    |theta|) / |theta|^2, c = (|theta| - sin |theta|) / |theta|^3 (Sola, Deray & Atchuthan 2018, arXiv:1812.01537, eq.
    143); the rates of b and c are the other two times theta . theta'. By their power series, to rounding up to a turn.
    """
    no_inline()
    square, b, c, b_rate, c_rate = dot(theta, theta), 1.0, 1.0, 0.0, 0.0
    for k in range(_TERMS, 0, -1):
        r_b = 1.0 / ((2.0 * k + 1.0) * (2.0 * k + 2.0))
        r_c = 1.0 / ((2.0 * k + 2.0) * (2.0 * k + 3.0))
        b_rate, c_rate = -r_b * (b + square * b_rate), -r_c * (c + square * c_rate)
        b, c = 1.0 - r_b * square * b, 1.0 - r_c * square * c
    return b / 2.0, c / 6.0, b_rate, c_rate / 3.0


@njit(**OPTIONS)
def spun(theta, b, c, x):
    """x - b theta x x + c theta x (theta x x)."""
    inline()
    first_ = cross(theta, x)
    return axpy(c, cross(theta, first_), axpy(-b, first_, x))


@njit(**OPTIONS)
def spin(m, s):
    """Angular velocity of a ball relative to its parent in its axes, and its rate by these axes; its speeds begin at
    s."""
    no_inline()
    theta, rate = (m.y[s], m.y[s + 1], m.y[s + 2]), (m.u[s], m.u[s + 1], m.u[s + 2])
    b, c, b_rate, c_rate = rate_coefficients(theta)
    along_, turned_ = dot(theta, rate), cross(theta, rate)
    faster = axpy(c, cross(rate, turned_), scaled(-b_rate * along_, turned_))
    faster = axpy(c_rate * along_, cross(theta, turned_), faster)
    accelerated = spun(theta, b, c, (m.du[s], m.du[s + 1], m.du[s + 2]))
    return spun(theta, b, c, rate), plus(accelerated, faster)


@njit(**OPTIONS)
def compose(q, k, x, y, z):
    """The quaternion at q[k] times that of a rotation vector, of unit length again."""
    no_inline()
    angle = math.sqrt(x * x + y * y + z * z)
    share = math.sin(0.5 * angle) / angle if angle > 0.0 else 0.5
    w, x, y, z = math.cos(0.5 * angle), share * x, share * y, share * z
    a, b, c, d = q[k], q[k + 1], q[k + 2], q[k + 3]
    w, x, y, z = (
        a * w - b * x - c * y - d * z, a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x, a * z + b * y - c * x + d * w,
    )  # fmt: skip
    length = math.sqrt(w * w + x * x + y * y + z * z)
    q[k], q[k + 1], q[k + 2], q[k + 3] = w / length, x / length, y / length, z / length


@njit(**OPTIONS)
def rebase(m):
    """Make the current axes of balls those of their quaternions, where speeds are angular velocities in these axes;
    True if one has turned since."""
    no_inline()
    turned = False
    for n in range(m.counts[BALLS]):
        k, s = m.balls[n, 0], m.balls[n, 1]
        if m.y[s] != 0.0 or m.y[s + 1] != 0.0 or m.y[s + 2] != 0.0:
            turned = True
            omega, faster = spin(m, s)
            compose(m.q, k, m.y[s], m.y[s + 1], m.y[s + 2])
            for j in range(3):
                m.y[s + j], m.u[s + j], m.du[s + j] = 0.0, omega[j], faster[j]
    return turned


@njit(**OPTIONS)
def note_turns(m, i):
    """Store the angular accelerations of balls in stage i; False: one has turned too far in the step."""
    no_inline()
    for n in range(m.counts[BALLS]):
        s = m.balls[n, 1]
        if m.y[s] ** 2 + m.y[s + 1] ** 2 + m.y[s + 2] ** 2 > FARTHEST**2:
            return False
        faster = spin(m, s)[1]
        for j in range(3):
            m.alpha[m.plan[COORDINATES] * i + s + j] = faster[j]
    return True


@njit(**OPTIONS)
def settle(m):
    """Begin the next step where the axes of balls are those of their quaternions; the last step's accelerations, from
    which its first guess comes, are those in these axes."""
    rebase(m)
    n = m.plan[COORDINATES]
    for ball in range(m.counts[BALLS]):
        for i in range(3):
            for s in range(m.balls[ball, 1], m.balls[ball, 1] + 3):
                m.w[m.plan[LAST_A] + n * i + s] = m.alpha[n * i + s]
