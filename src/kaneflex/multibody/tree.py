"""Compiled kinematics and dynamics of a tree of bodies: from coordinates to what the motion takes.

Outwards: a joint places its body's inboard section against the section that the body hangs on, the body's shapes lead
from there to its frame and on to its other sections. Nine numbers a section (x, y, theta and two rates, global) and
eleven a frame (x, y, phi, cos, sin, then two rates of x, y, phi) are all that bodies have to know of each other, so that
the work grows with their number and no faster (Kane's equations of order n, Rosenthal 1990).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit, types
from numba.types import FunctionType, UniTuple, float64, int64, void

from kaneflex.generated import joints as laws
from kaneflex.multibody.topology import (
    AT, BLOCK, COURSE, CUT_COURSE, CUT_ROW, DOF, FIRST, FOLLOWER, FREE, INBOARD, JACOBIAN, JOINT, KIND, LAST, MODAL, ON,
    OWNER, PARENT, POINT, PRISMATIC, REVOLUTE, ROW, SECTIONS, SHAPES, SLIDE, TORQUE, TURN, WELD, Tree,
)  # fmt: skip

OUTER = {"error_model": "numpy", "fastmath": {"nsz", "arcp", "contract", "afn", "reassoc"}}
OPTIONS = OUTER | {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
V, TABLE = float64[::1], int64[:, ::1]
MATRIX = float64[:, ::1]
SEC, FRAME = 9, 11
"""Numbers of a section, and of a body's frame."""


DEFORM, PUSH, JACOBIANS, INVERSE, INERTIA, ENERGY, COURSES, MAGNITUDES = range(8)
"""Places in a structure's kernels: those of its bodies by the kind of their counts, its courses, its loads' sizes."""

KERNELS = types.Tuple(
    (
        FunctionType(void(int64, V, int64, V, V, V, int64, V, int64)),
        FunctionType(void(int64, V, int64, V, int64, *(float64,) * 5, V, int64)),
        FunctionType(void(int64, V, int64, V, int64, float64, float64, V, int64)),
        FunctionType(void(int64, V, int64, V, V, V, int64, *(float64,) * 6, V, int64)),
        FunctionType(void(int64, V, int64, V, int64, float64, float64, V, int64)),
        FunctionType(UniTuple(float64, 2)(int64, V, int64, V, V, int64, *(float64,) * 5, V)),
        FunctionType(void(float64, V, V)),
        FunctionType(void(float64, V, V, V)),
    )
)
_TREE = dict.fromkeys(("bodies", "sections", "cuts", "drives", "loads", "springs"), TABLE)
_TREE |= dict.fromkeys(("joints", "guides", "slides", "directions", "rates"), MATRIX)
TREE = types.NamedTuple([_TREE.get(name, V) for name in Tree._fields], Tree)


class Work(NamedTuple):
    """Room for one instant: sections, points in their bodies' axes, frames, forces over all bodies' speeds, courses,
    coordinates and rates of drives, sizes of loads, cut rows (nine numbers each), springs (six each)."""

    sec: np.ndarray
    local: np.ndarray
    frame: np.ndarray
    force: np.ndarray
    course: np.ndarray
    x: np.ndarray
    size: np.ndarray
    cut: np.ndarray
    spring: np.ndarray


WORK = types.NamedUniTuple(V, len(Work._fields), Work)


def room(tree: Tree, courses: int) -> Work:
    """Room for a tree, with what never changes filled in."""
    rows = int(tree.bodies[-1, ROW] + 3 + tree.bodies[-1, SHAPES])
    cuts = int(tree.cuts[-1, CUT_ROW] + 3) if len(tree.cuts) else 0
    counts = (len(tree.sections) * SEC, len(tree.sections) * SEC, len(tree.bodies) * FRAME, rows, 3 * courses,
              2 * len(tree.drives), len(tree.loads), 9 * cuts, 6 * len(tree.springs))  # fmt: skip
    work = Work(*map(np.zeros, counts))
    for k in range(len(tree.fixed) // 3):
        work.sec[SEC * k : SEC * k + 3] = tree.fixed[3 * k : 3 * k + 3]
    for k, (owner, point, _) in enumerate(tree.sections):
        if owner >= 0:
            work.local[SEC * k : SEC * k + 2] = tree.blocks[point + 1 : point + 3]
    return work


@njit(**OPTIONS)
def prescribe(tree, kernels, p, t, y, v, a, work):
    """The coordinates that drives prescribe, with their rates."""
    kernels[COURSES](t, p, work.course)
    for b in range(tree.bodies.shape[0]):
        k = tree.bodies[b, COURSE]
        if k >= 0:
            i = tree.bodies[b, FIRST]
            y[i], v[i], a[i] = work.course[3 * k], work.course[3 * k + 1], work.course[3 * k + 2]


@njit(**OPTIONS)
def deform(tree, kernels, y, v, a, work):
    """Where the bodies' points are in their frames."""
    for b in range(tree.bodies.shape[0]):
        if tree.bodies[b, SHAPES]:
            for k in range(tree.bodies[b, SECTIONS], tree.bodies[b, LAST]):
                kernels[DEFORM](
                    tree.bodies[b, KIND], tree.blocks, tree.sections[k, POINT], y, v, a, tree.bodies[b, MODAL],
                    work.local, SEC * k,
                )  # fmt: skip


@njit(**OPTIONS)
def place(tree, y, work):
    """Positions of all sections and frames."""
    sec, local, frame = work.sec, work.local, work.frame
    for b in range(tree.bodies.shape[0]):
        up, own, i = SEC * tree.bodies[b, PARENT], SEC * tree.bodies[b, INBOARD], tree.bodies[b, FIRST]
        x, z, theta = sec[up], sec[up + 1], sec[up + 2] + tree.joints[b, 1]
        kind = tree.bodies[b, JOINT]
        if kind == REVOLUTE:
            theta += tree.joints[b, 0] * y[i]
        elif kind == PRISMATIC:
            c, s = math.cos(sec[up + 2]), math.sin(sec[up + 2])
            x += y[i] * (c * tree.joints[b, 2] - s * tree.joints[b, 3])
            z += y[i] * (s * tree.joints[b, 2] + c * tree.joints[b, 3])
        elif kind == FREE:
            x, z, theta = y[i], y[i + 1], y[i + 2]
        sec[own], sec[own + 1], sec[own + 2] = x, z, theta
        phi = theta - local[own + 2]
        c, s = math.cos(phi), math.sin(phi)
        f = FRAME * b
        x -= c * local[own] - s * local[own + 1]
        z -= s * local[own] + c * local[own + 1]
        frame[f], frame[f + 1], frame[f + 2], frame[f + 3], frame[f + 4] = x, z, phi, c, s
        for n in range(tree.bodies[b, SECTIONS], tree.bodies[b, LAST]):
            k = SEC * n
            if k != own:
                share = tree.blocks[tree.sections[n, POINT]]
                sec[k] = share * x + c * local[k] - s * local[k + 1]
                sec[k + 1] = share * z + s * local[k] + c * local[k + 1]
                sec[k + 2] = phi + local[k + 2]


@njit(**OPTIONS)
def move(tree, v, work):
    """Velocities of all sections and frames, whose positions are known."""
    sec, local, frame = work.sec, work.local, work.frame
    for b in range(tree.bodies.shape[0]):
        up, own, i = SEC * tree.bodies[b, PARENT], SEC * tree.bodies[b, INBOARD], tree.bodies[b, FIRST]
        omega = sec[up + 5]
        arm_x, arm_y = sec[own] - sec[up], sec[own + 1] - sec[up + 1]
        v_x, v_y = sec[up + 3] - omega * arm_y, sec[up + 4] + omega * arm_x
        kind = tree.bodies[b, JOINT]
        if kind == REVOLUTE:
            omega += tree.joints[b, 0] * v[i]
        elif kind == PRISMATIC:
            c, s = math.cos(sec[up + 2]), math.sin(sec[up + 2])
            v_x += v[i] * (c * tree.joints[b, 2] - s * tree.joints[b, 3])
            v_y += v[i] * (s * tree.joints[b, 2] + c * tree.joints[b, 3])
        elif kind == FREE:
            v_x, v_y, omega = v[i], v[i + 1], v[i + 2]
        sec[own + 3], sec[own + 4], sec[own + 5] = v_x, v_y, omega
        omega -= local[own + 5]
        f = FRAME * b
        x, z, c, s = frame[f], frame[f + 1], frame[f + 3], frame[f + 4]
        v_x -= c * local[own + 3] - s * local[own + 4] - omega * (sec[own + 1] - z)
        v_y -= s * local[own + 3] + c * local[own + 4] + omega * (sec[own] - x)
        frame[f + 5], frame[f + 6], frame[f + 7] = v_x, v_y, omega
        for n in range(tree.bodies[b, SECTIONS], tree.bodies[b, LAST]):
            k = SEC * n
            if k != own:
                share = tree.blocks[tree.sections[n, POINT]]
                arm_x, arm_y = sec[k] - share * x, sec[k + 1] - share * z
                sec[k + 3] = share * v_x - omega * arm_y + c * local[k + 3] - s * local[k + 4]
                sec[k + 4] = share * v_y + omega * arm_x + s * local[k + 3] + c * local[k + 4]
                sec[k + 5] = omega + local[k + 5]


@njit(**OPTIONS)
def accelerate(tree, v, a, work):
    """Accelerations of all sections and frames, whose velocities are known."""
    sec, local, frame = work.sec, work.local, work.frame
    for b in range(tree.bodies.shape[0]):
        up, own, i = SEC * tree.bodies[b, PARENT], SEC * tree.bodies[b, INBOARD], tree.bodies[b, FIRST]
        omega, epsilon = sec[up + 5], sec[up + 8]
        arm_x, arm_y = sec[own] - sec[up], sec[own + 1] - sec[up + 1]
        a_x = sec[up + 6] - epsilon * arm_y - omega * omega * arm_x
        a_y = sec[up + 7] + epsilon * arm_x - omega * omega * arm_y
        kind = tree.bodies[b, JOINT]
        if kind == REVOLUTE:
            epsilon += tree.joints[b, 0] * a[i]
        elif kind == PRISMATIC:
            c, s = math.cos(sec[up + 2]), math.sin(sec[up + 2])
            u_x, u_y = c * tree.joints[b, 2] - s * tree.joints[b, 3], s * tree.joints[b, 2] + c * tree.joints[b, 3]
            a_x += a[i] * u_x - 2.0 * omega * v[i] * u_y
            a_y += a[i] * u_y + 2.0 * omega * v[i] * u_x
        elif kind == FREE:
            a_x, a_y, epsilon = a[i], a[i + 1], a[i + 2]
        sec[own + 6], sec[own + 7], sec[own + 8] = a_x, a_y, epsilon
        epsilon -= local[own + 8]
        f = FRAME * b
        x, z, c, s, omega = frame[f], frame[f + 1], frame[f + 3], frame[f + 4], frame[f + 7]
        arm_x, arm_y = sec[own] - x, sec[own + 1] - z
        along, across = local[own + 6] - 2.0 * omega * local[own + 4], local[own + 7] + 2.0 * omega * local[own + 3]
        a_x -= c * along - s * across - epsilon * arm_y - omega * omega * arm_x
        a_y -= s * along + c * across + epsilon * arm_x - omega * omega * arm_y
        frame[f + 8], frame[f + 9], frame[f + 10] = a_x, a_y, epsilon
        for n in range(tree.bodies[b, SECTIONS], tree.bodies[b, LAST]):
            k = SEC * n
            if k != own:
                share = tree.blocks[tree.sections[n, POINT]]
                arm_x, arm_y = sec[k] - share * x, sec[k + 1] - share * z
                along = local[k + 6] - 2.0 * omega * local[k + 4]
                across = local[k + 7] + 2.0 * omega * local[k + 3]
                sec[k + 6] = share * a_x - epsilon * arm_y - omega * omega * arm_x + c * along - s * across
                sec[k + 7] = share * a_y + epsilon * arm_x - omega * omega * arm_y + s * along + c * across
                sec[k + 8] = epsilon + local[k + 8]


@njit(**OPTIONS)
def cut_rows(tree, work):
    """Residuals of the cuts with their rates and Jacobians, nine numbers a row; those of drives less their courses."""
    for n in range(tree.cuts.shape[0]):
        kind, first, second = tree.cuts[n, 0], tree.cuts[n, AT], tree.cuts[n, ON]
        d_x, d_y, angle, k = tree.guides[n, 0], tree.guides[n, 1], tree.guides[n, 2], 9 * tree.cuts[n, CUT_ROW]
        if kind == REVOLUTE:
            laws.revolute(work.sec, first, second, d_x, d_y, angle, work.cut, k)
        elif kind == PRISMATIC:
            laws.prismatic(work.sec, first, second, d_x, d_y, angle, work.cut, k)
        elif kind == WELD:
            laws.weld(work.sec, first, second, d_x, d_y, angle, work.cut, k)
        elif kind == TURN:
            laws.turn(work.sec, first, second, d_x, d_y, angle, work.cut, k)
        else:
            laws.slide(work.sec, first, second, d_x, d_y, angle, work.cut, k)
        course = 3 * tree.cuts[n, CUT_COURSE]
        if course >= 0:
            work.cut[k] -= work.course[course]
            work.cut[k + 1] -= work.course[course + 1]
            work.cut[k + 2] -= work.course[course + 2]


@njit(**OPTIONS)
def load_sizes(tree, kernels, p, t, y, v, work):
    """Coordinates of the drives with their rates, and the sizes of the loads, which may depend on them."""
    for n in range(tree.drives.shape[0]):
        i = tree.drives[n, 0]
        if i >= 0:
            work.x[2 * n], work.x[2 * n + 1] = y[i], v[i]
            continue
        first, second = SEC * tree.drives[n, 2], SEC * tree.drives[n, 3]
        if tree.drives[n, 1] == TURN:
            work.x[2 * n] = work.sec[second + 2] - work.sec[first + 2]
            work.x[2 * n + 1] = work.sec[second + 5] - work.sec[first + 5]
            continue
        c, s = math.cos(work.sec[first + 2]), math.sin(work.sec[first + 2])
        u_x, u_y = c * tree.slides[n, 0] - s * tree.slides[n, 1], s * tree.slides[n, 0] + c * tree.slides[n, 1]
        g_x, g_y = work.sec[second] - work.sec[first], work.sec[second + 1] - work.sec[first + 1]
        r_x, r_y = work.sec[second + 3] - work.sec[first + 3], work.sec[second + 4] - work.sec[first + 4]
        work.x[2 * n] = u_x * g_x + u_y * g_y
        work.x[2 * n + 1] = u_x * r_x + u_y * r_y + work.sec[first + 5] * (u_x * g_y - u_y * g_x)
    if tree.loads.shape[0]:
        kernels[MAGNITUDES](t, work.x, p, work.size)


@njit(**OPTIONS)
def push(tree, kernels, y, n, x, z, turn, work):
    """Take a force and a moment on a section off what the motion of its body asks for."""
    b = tree.sections[n, OWNER]
    if b >= 0:
        f = FRAME * b
        kernels[PUSH](
            tree.bodies[b, KIND], tree.blocks, tree.sections[n, POINT], y, tree.bodies[b, MODAL], work.frame[f + 3],
            work.frame[f + 4], -x, -z, -turn, work.force, tree.bodies[b, ROW],
        )  # fmt: skip


@njit(**OPTIONS)
def load_direction(tree, n, work):
    """Global direction of a load."""
    x, z = tree.directions[n, 0], tree.directions[n, 1]
    if tree.loads[n, 0] == FOLLOWER:
        theta = work.sec[SEC * tree.loads[n, 2] + 2]
        c, s = math.cos(theta), math.sin(theta)
        return c * x - s * z, s * x + c * z
    return x, z


@njit(**OPTIONS)
def act(tree, kernels, p, t, y, v, work):
    """Loads and springs, taken off what the motion asks for."""
    load_sizes(tree, kernels, p, t, y, v, work)
    for n in range(tree.loads.shape[0]):
        size = work.size[n]
        if tree.loads[n, 0] == TORQUE:
            push(tree, kernels, y, tree.loads[n, 1], 0.0, 0.0, -size, work)
            push(tree, kernels, y, tree.loads[n, 2], 0.0, 0.0, size, work)
        else:
            x, z = load_direction(tree, n, work)
            push(tree, kernels, y, tree.loads[n, 1], size * x, size * z, 0.0, work)
    for n in range(tree.springs.shape[0]):
        first, second = tree.springs[n, 1], tree.springs[n, 2]
        k, c, free = tree.rates[n, 0], tree.rates[n, 1], tree.rates[n, 2]
        if tree.springs[n, 0]:
            laws.twist(work.sec, first, second, k, c, free, work.spring, 6 * n)
            torque = work.spring[6 * n + 1]
            push(tree, kernels, y, first, 0.0, 0.0, torque, work)
            push(tree, kernels, y, second, 0.0, 0.0, -torque, work)
        else:
            laws.pull(work.sec, first, second, k, c, free, work.spring, 6 * n)
            x, z = work.spring[6 * n + 2], work.spring[6 * n + 3]
            push(tree, kernels, y, first, -x, -z, 0.0, work)
            push(tree, kernels, y, second, x, z, 0.0, work)


@njit(**OPTIONS)
def resist(tree, kernels, p, t, y, v, a, multipliers, work):
    """What the motion asks for beyond loads, springs and the cuts' reactions: zero where the equations hold.

    M a - f over the speeds of all frames and shapes, in ``work.force``; ``work`` has the motion and the cut rows.
    """
    work.force[:] = 0.0
    for b in range(tree.bodies.shape[0]):
        f = FRAME * b
        kernels[INVERSE](
            tree.bodies[b, KIND], tree.blocks, tree.bodies[b, BLOCK], y, v, a, tree.bodies[b, MODAL],
            work.frame[f + 3], work.frame[f + 4], work.frame[f + 7], work.frame[f + 8] - tree.gravity[0],
            work.frame[f + 9] - tree.gravity[1], work.frame[f + 10], work.force, tree.bodies[b, ROW],
        )  # fmt: skip
    act(tree, kernels, p, t, y, v, work)
    for n in range(tree.cuts.shape[0]):
        last = tree.cuts[n + 1, CUT_ROW] if n + 1 < tree.cuts.shape[0] else multipliers.size
        for row in range(tree.cuts[n, CUT_ROW], last):
            k, size = 9 * row, multipliers[row]
            for side in range(2):
                j = k + 3 + 3 * side
                push(
                    tree, kernels, y, tree.cuts[n, AT + side], size * work.cut[j], size * work.cut[j + 1],
                    size * work.cut[j + 2], work,
                )  # fmt: skip
