"""Compiled kinematics and dynamics of a tree of bodies: from coordinates to residuals of the equations of motion.

The outward pass places each body's inboard section relative to the section of its parent; the body's shapes lead from
there to its frame and its other sections. Bodies exchange only the nine numbers of a section, so the work is
proportional to their number (Kane's equations of order n, Rosenthal 1990).
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.generated import body
from kaneflex.generated import joints as laws
from kaneflex.multibody.dynamics.forces import rest_rows
from kaneflex.multibody.dynamics.interactions import act, push, react
from kaneflex.support.inner import once
from kaneflex.multibody.model.layout import (
    ACCEL, AT, BLOCK, BODIES, COURSE, COURSE_AT, CUT, CUTS, DEMAND, FIRST, FORCE, FRAME, FRAME_SIZE, FREE, GRAVITY,
    HOLDS, INBOARD, JOINT, JOINTS, LAST, LOCAL, MODAL, NUMBERS, NUMBERS_AT, ON, OPTIONS, PARENT, POINT, PRISMATIC, RATE,
    REVOLUTE, RIGID, ROW, ROW_AT, ROW_SIZE, SEC, SECTION, SECTIONS, SHAPES, SPEEDS, TURN, WELD, WHAT, Y, apart, shifted,
    turned,
)  # fmt: skip


@njit(**OPTIONS)
def deform(m):
    """Positions of the bodies' points in their frames."""
    apart()
    plan, w = m.plan, m.w
    for b in range(plan[BODIES]):
        if m.bodies[b, SHAPES]:
            for n in range(m.bodies[b, SECTIONS], m.bodies[b, LAST]):
                body.deform(
                    w, m.sections[n, POINT], shifted(w, plan[Y]), shifted(w, plan[RATE]),
                    shifted(w, plan[ACCEL]), m.bodies[b, MODAL], w, plan[LOCAL] + SEC * n,
                )  # fmt: skip


@once
@njit(**OPTIONS)
def place(m, first):
    """Positions of all sections and frames of the bodies from the ``first`` one on; the others are known."""
    apart()
    plan, w = m.plan, m.w
    sec = plan[SECTION]
    for b in range(first, plan[BODIES]):
        parent, inboard = m.bodies[b, PARENT], m.bodies[b, INBOARD]
        up, own, local = sec + SEC * parent, sec + SEC * inboard, plan[LOCAL] + SEC * inboard
        i, j, kind = plan[Y] + m.bodies[b, FIRST], m.bodies[b, NUMBERS], m.bodies[b, JOINT]
        x, z, theta = w[up], w[up + 1], w[up + 2] + w[j + 1]
        if kind == REVOLUTE:
            theta += w[j] * w[i]
        elif kind == PRISMATIC:
            d_x, d_y = turned(w, w[up + 2], j + 2)
            x += w[i] * d_x
            z += w[i] * d_y
        elif kind == FREE:
            x, z, theta = w[i], w[i + 1], w[i + 2]
        w[own], w[own + 1], w[own + 2] = x, z, theta
        phi, f = theta - w[local + 2], plan[FRAME] + FRAME_SIZE * b
        if phi != w[f + 2]:  # unchanged for bodies in guides, and outside the loops that an iteration corrects
            w[f + 3], w[f + 4] = math.cos(phi), math.sin(phi)
        c, s = w[f + 3], w[f + 4]
        x -= c * w[local] - s * w[local + 1]
        z -= s * w[local] + c * w[local + 1]
        w[f], w[f + 1], w[f + 2] = x, z, phi
        for n in range(m.bodies[b, SECTIONS], m.bodies[b, LAST]):
            if n != inboard:
                k, local, share = sec + SEC * n, plan[LOCAL] + SEC * n, w[m.sections[n, POINT]]
                w[k] = share * x + c * w[local] - s * w[local + 1]
                w[k + 1] = share * z + s * w[local] + c * w[local + 1]
                w[k + 2] = phi + w[local + 2]


@once
@njit(**OPTIONS)
def move(m, first):
    """Velocities of these sections and frames, whose positions are known."""
    apart()
    plan, w = m.plan, m.w
    sec = plan[SECTION]
    for b in range(first, plan[BODIES]):
        parent, inboard = m.bodies[b, PARENT], m.bodies[b, INBOARD]
        up, own, local = sec + SEC * parent, sec + SEC * inboard, plan[LOCAL] + SEC * inboard
        i, j, kind = plan[RATE] + m.bodies[b, FIRST], m.bodies[b, NUMBERS], m.bodies[b, JOINT]
        omega = w[up + 5]
        v_x, v_y = w[up + 3] - omega * (w[own + 1] - w[up + 1]), w[up + 4] + omega * (w[own] - w[up])
        if kind == REVOLUTE:
            omega += w[j] * w[i]
        elif kind == PRISMATIC:
            d_x, d_y = turned(w, w[up + 2], j + 2)
            v_x += w[i] * d_x
            v_y += w[i] * d_y
        elif kind == FREE:
            v_x, v_y, omega = w[i], w[i + 1], w[i + 2]
        w[own + 3], w[own + 4], w[own + 5] = v_x, v_y, omega
        omega -= w[local + 5]
        f = plan[FRAME] + FRAME_SIZE * b
        x, z, c, s = w[f], w[f + 1], w[f + 3], w[f + 4]
        v_x -= c * w[local + 3] - s * w[local + 4] - omega * (w[own + 1] - z)
        v_y -= s * w[local + 3] + c * w[local + 4] + omega * (w[own] - x)
        w[f + 5], w[f + 6], w[f + 7] = v_x, v_y, omega
        for n in range(m.bodies[b, SECTIONS], m.bodies[b, LAST]):
            if n != inboard:
                k, local, share = sec + SEC * n, plan[LOCAL] + SEC * n, w[m.sections[n, POINT]]
                w[k + 3] = share * v_x - omega * (w[k + 1] - share * z) + c * w[local + 3] - s * w[local + 4]
                w[k + 4] = share * v_y + omega * (w[k] - share * x) + s * w[local + 3] + c * w[local + 4]
                w[k + 5] = omega + w[local + 5]


@once
@njit(**OPTIONS)
def accelerate(m, first):
    """Accelerations of these sections and frames, whose velocities are known."""
    apart()
    plan, w = m.plan, m.w
    sec = plan[SECTION]
    for b in range(first, plan[BODIES]):
        parent, inboard = m.bodies[b, PARENT], m.bodies[b, INBOARD]
        up, own, local = sec + SEC * parent, sec + SEC * inboard, plan[LOCAL] + SEC * inboard
        i, j, kind = m.bodies[b, FIRST], m.bodies[b, NUMBERS], m.bodies[b, JOINT]
        omega, epsilon, arm_x, arm_y = w[up + 5], w[up + 8], w[own] - w[up], w[own + 1] - w[up + 1]
        a_x = w[up + 6] - epsilon * arm_y - omega * omega * arm_x
        a_y = w[up + 7] + epsilon * arm_x - omega * omega * arm_y
        q_1, q_2 = w[plan[RATE] + i], w[plan[ACCEL] + i]
        if kind == REVOLUTE:
            epsilon += w[j] * q_2
        elif kind == PRISMATIC:
            d_x, d_y = turned(w, w[up + 2], j + 2)
            a_x += q_2 * d_x - 2.0 * omega * q_1 * d_y
            a_y += q_2 * d_y + 2.0 * omega * q_1 * d_x
        elif kind == FREE:
            a_x, a_y, epsilon = q_2, w[plan[ACCEL] + i + 1], w[plan[ACCEL] + i + 2]
        w[own + 6], w[own + 7], w[own + 8] = a_x, a_y, epsilon
        epsilon -= w[local + 8]
        f = plan[FRAME] + FRAME_SIZE * b
        x, z, c, s, omega = w[f], w[f + 1], w[f + 3], w[f + 4], w[f + 7]
        arm_x, arm_y = w[own] - x, w[own + 1] - z
        along, across = w[local + 6] - 2.0 * omega * w[local + 4], w[local + 7] + 2.0 * omega * w[local + 3]
        a_x -= c * along - s * across - epsilon * arm_y - omega * omega * arm_x
        a_y -= s * along + c * across + epsilon * arm_x - omega * omega * arm_y
        w[f + 8], w[f + 9], w[f + 10] = a_x, a_y, epsilon
        for n in range(m.bodies[b, SECTIONS], m.bodies[b, LAST]):
            if n != inboard:
                k, local, share = sec + SEC * n, plan[LOCAL] + SEC * n, w[m.sections[n, POINT]]
                arm_x, arm_y = w[k] - share * x, w[k + 1] - share * z
                along = w[local + 6] - 2.0 * omega * w[local + 4]
                across = w[local + 7] + 2.0 * omega * w[local + 3]
                w[k + 6] = share * a_x - epsilon * arm_y - omega * omega * arm_x + c * along - s * across
                w[k + 7] = share * a_y + epsilon * arm_x - omega * omega * arm_y + s * along + c * across
                w[k + 8] = epsilon + w[local + 8]


@njit(**OPTIONS)
def cut_rows(m):
    """Residuals of the cuts with their rates and Jacobians; those of drives less their courses."""
    apart()
    plan, w, acts = m.plan, m.w, m.acts
    sec = shifted(w, plan[SECTION])
    for n in range(plan[CUTS], plan[HOLDS]):
        kind, first, second, j = acts[n, WHAT], acts[n, AT], acts[n, ON], acts[n, NUMBERS_AT]
        k = plan[CUT] + ROW_SIZE * acts[n, ROW_AT]
        if kind == REVOLUTE:
            laws.revolute(sec, first, second, w[j], w[j + 1], w[j + 2], w, k)
        elif kind == PRISMATIC:
            laws.prismatic(sec, first, second, w[j], w[j + 1], w[j + 2], w, k)
        elif kind == WELD:
            laws.weld(sec, first, second, w[j], w[j + 1], w[j + 2], w, k)
        elif kind == TURN:
            laws.turn(sec, first, second, w[j], w[j + 1], w[j + 2], w, k)
        else:
            laws.slide(sec, first, second, w[j], w[j + 1], w[j + 2], w, k)
        if acts[n, COURSE_AT] >= 0:
            course = plan[COURSE] + 3 * acts[n, COURSE_AT]
            w[k] -= w[course]
            w[k + 1] -= w[course + 1]
            w[k + 2] -= w[course + 2]
    if plan[RIGID]:
        rest_rows(m)


@njit(**OPTIONS)
def resist(m, t):
    """Residual of the equations of motion without the reactions of cuts and holds' rows: zero for solutions.

    M a - f over the speeds of all frames and shapes, at FORCE; the tables have the motion, the cut rows and the
    reactions.
    """
    apart()
    plan, w = m.plan, m.w
    for k in range(plan[SPEEDS]):
        w[plan[FORCE] + k] = 0.0
    for b in range(plan[BODIES]):
        f = plan[FRAME] + FRAME_SIZE * b
        body.inverse(
            w, m.bodies[b, BLOCK], shifted(w, plan[Y]), shifted(w, plan[RATE]),
            shifted(w, plan[ACCEL]), m.bodies[b, MODAL], w[f + 3], w[f + 4], w[f + 7], w[f + 8] - w[plan[GRAVITY]],
            w[f + 9] - w[plan[GRAVITY] + 1], w[f + 10], w, plan[FORCE] + m.bodies[b, ROW],
        )  # fmt: skip
    act(m, t)
    react(m)


@njit(**OPTIONS)
def demand(m, t):
    """Residual of :func:`resist` along every coordinate of the tree, at DEMAND.

    The inward pass takes the force of an inboard joint (at JOINTS: force and moment at the body's section) off its
    body, leaves the residuals of its shapes, and adds the force to the parent.
    """
    apart()
    resist(m, t)
    plan, w = m.plan, m.w
    for b in range(plan[BODIES] - 1, -1, -1):
        inboard, parent, i = m.bodies[b, INBOARD], m.bodies[b, PARENT], plan[DEMAND] + m.bodies[b, FIRST]
        r, f, own = plan[FORCE] + m.bodies[b, ROW], plan[FRAME] + FRAME_SIZE * b, plan[SECTION] + SEC * inboard
        up, k, j, kind = plan[SECTION] + SEC * parent, plan[JOINTS] + 3 * b, m.bodies[b, NUMBERS], m.bodies[b, JOINT]
        x, z, turn = w[r], w[r + 1], w[r + 2]
        turn += (w[f] - w[own]) * z - (w[f + 1] - w[own + 1]) * x
        w[k], w[k + 1], w[k + 2] = x, z, turn
        if m.bodies[b, SHAPES]:
            push(m, inboard, (x, z, turn))
            n = plan[DEMAND] + m.bodies[b, MODAL]
            for l in range(m.bodies[b, SHAPES]):
                w[n + l] = w[r + 3 + l]
        push(m, parent, (-x, -z, -turn - (w[own] - w[up]) * z + (w[own + 1] - w[up + 1]) * x))
        if kind == REVOLUTE:
            w[i] = w[j] * turn
        elif kind == PRISMATIC:
            d_x, d_y = turned(w, w[up + 2], j + 2)
            w[i] = d_x * x + d_y * z
        elif kind == FREE:
            w[i], w[i + 1], w[i + 2] = x, z, turn
