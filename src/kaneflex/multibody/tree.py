"""Compiled kinematics and dynamics of a tree of bodies: from coordinates to what the motion asks for.

Outwards: a joint places its body's inboard section against the section that the body hangs on, the body's shapes lead
from there to its frame and on to its other sections. The nine numbers of a section are all that bodies have to know of
each other, so that the work grows with their number and no faster (Kane's equations of order n, Rosenthal 1990).
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.generated import contact as touching
from kaneflex.generated import joints as laws
from kaneflex.mechanism.contacts import NEWTON
from kaneflex.multibody import holds
from kaneflex.multibody.tables import (
    ABOVE, ACCEL, ACTS, AT, BEGUN_AT, BELOW, BLOCK, BODIES, CONTACT, CONTACTS, CONTACT_SIZE, COURSE, COURSES, COURSE_AT,
    COURSE_OF, CUT, CUTS, CUT_ROWS, DEFORM, DEMAND, DRIVES, ELASTIC, FIRST, FOLLOWER, FORCE, FRAME, FRAME_SIZE, FREE,
    GAP, GAP_RATE, GRAVITY, HOLDS, INBOARD, INPUT, INVERSE, JOINT, JOINTS, KIND, LAST, LAW, LOADS, LOCAL, LOSING,
    MAGNITUDES, MODAL, NORMAL_TURN, NORMAL_X, NORMAL_Y, NOW, NUMBERS, NUMBERS_AT, ON, OPTIONS, OWNER, PARENT, PLACE_X,
    PLACE_Y, POINT, PRISMATIC, PUSHED, PUSH_NOW, RATE, REVOLUTE, RIGID, ROOM, ROW, ROW_AT, ROW_SIZE, SEC,
    SECTION, SECTIONS,
    SHAPES, SIZE, SPEEDS, SPRING, SPRINGS, SPRING_SIZE, STAYS, SUMS, SWITCH, TORQUE, TORSIONAL, TURN, WELD, WHAT, WORKS,
    X, Y, apart, kernel, of_contacts, shifted,
)  # fmt: skip


@njit(**OPTIONS)
def turned(w, theta, k):
    """Global components of the direction at ``k``, fixed in axes at the angle theta."""
    c, s = math.cos(theta), math.sin(theta)
    return c * w[k] - s * w[k + 1], s * w[k] + c * w[k + 1]


@njit(**OPTIONS)
def courses(m):
    """How many drives prescribe a course."""
    plan = m.plan
    acting = plan[SPRINGS] - plan[LOADS] + plan[DRIVES] - plan[HOLDS] + plan[ACTS] - plan[CONTACTS]
    return plan[WORKS] - 1 - acting


@njit(**OPTIONS)
def prescribe(m, t):
    """The coordinates that drives prescribe, with their rates."""
    apart()
    plan, w = m.plan, m.w
    kernel(m.kernels, COURSES)(t, m.p, w, plan[COURSE])
    loads = plan[SPRINGS] - plan[LOADS]
    for k in range(courses(m)):
        w[plan[COURSE] + 3 * k + 2] += w[plan[INPUT] + loads + k]
    for b in range(plan[BODIES]):
        if m.bodies[b, COURSE_OF] >= 0:
            k, i = plan[COURSE] + 3 * m.bodies[b, COURSE_OF], m.bodies[b, FIRST]
            w[plan[Y] + i], w[plan[RATE] + i], w[plan[ACCEL] + i] = w[k], w[k + 1], w[k + 2]


@njit(**OPTIONS)
def deform(m):
    """Where the bodies' points are in their frames."""
    apart()
    plan, w = m.plan, m.w
    for b in range(plan[BODIES]):
        if m.bodies[b, SHAPES]:
            for n in range(m.bodies[b, SECTIONS], m.bodies[b, LAST]):
                kernel(m.kernels, DEFORM)(
                    m.bodies[b, KIND], w, m.sections[n, POINT], shifted(w, plan[Y]), shifted(w, plan[RATE]),
                    shifted(w, plan[ACCEL]), m.bodies[b, MODAL], w, plan[LOCAL] + SEC * n,
                )  # fmt: skip


@njit(**OPTIONS)
def place(m):
    """Positions of all sections and frames."""
    apart()
    plan, w = m.plan, m.w
    sec = plan[SECTION]
    for b in range(plan[BODIES]):
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
        c, s = math.cos(phi), math.sin(phi)
        x -= c * w[local] - s * w[local + 1]
        z -= s * w[local] + c * w[local + 1]
        w[f], w[f + 1], w[f + 2], w[f + 3], w[f + 4] = x, z, phi, c, s
        for n in range(m.bodies[b, SECTIONS], m.bodies[b, LAST]):
            if n != inboard:
                k, local, share = sec + SEC * n, plan[LOCAL] + SEC * n, w[m.sections[n, POINT]]
                w[k] = share * x + c * w[local] - s * w[local + 1]
                w[k + 1] = share * z + s * w[local] + c * w[local + 1]
                w[k + 2] = phi + w[local + 2]


@njit(**OPTIONS)
def move(m):
    """Velocities of all sections and frames, whose positions are known."""
    apart()
    plan, w = m.plan, m.w
    sec = plan[SECTION]
    for b in range(plan[BODIES]):
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


@njit(**OPTIONS)
def accelerate(m):
    """Accelerations of all sections and frames, whose velocities are known."""
    apart()
    plan, w = m.plan, m.w
    sec = plan[SECTION]
    for b in range(plan[BODIES]):
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


@of_contacts(None)
@njit(**OPTIONS)
def rest_rows(m):
    """The rows of contacts that rest by Newton's law: gap, its rate and acceleration, and their Jacobians."""
    apart()
    plan, w = m.plan, m.w
    for n in range(plan[CONTACTS], plan[ACTS]):
        if rests(m, n):
            k, row = meet(m, n), plan[CUT] + ROW_SIZE * m.acts[n, ROW_AT]
            w[row], w[row + 1], w[row + 2] = w[k + GAP], w[k + GAP_RATE], acceleration(m, n)
            lean(m, n)


@njit(**OPTIONS)
def acceleration(m, n):
    """g'' of a contact [m/s^2]."""
    first, second = m.plan[SECTION] + SEC * m.acts[n, AT], m.plan[SECTION] + SEC * m.acts[n, ON]
    return touching.gap_acceleration(m.acts[n, WHAT], m.w, first, second, m.w, m.acts[n, NUMBERS_AT])


@njit(**OPTIONS)
def rests(m, n):
    """Whether a contact rests by Newton's law."""
    return m.acts[n, LAW] == NEWTON and m.w[m.plan[CONTACT] + CONTACT_SIZE * (n - m.plan[CONTACTS]) + BEGUN_AT] != 0.0


@njit(**OPTIONS)
def lean(m, n):
    """A contact's row by the twists of its sections, where it has been met."""
    w, plan = m.w, m.plan
    k = plan[CONTACT] + CONTACT_SIZE * (n - plan[CONTACTS])
    x, z = w[k + NORMAL_X], w[k + NORMAL_Y]
    for side in range(2):
        section, sign = plan[SECTION] + SEC * m.acts[n, AT + side], 2.0 * side - 1.0
        j = plan[CUT] + ROW_SIZE * m.acts[n, ROW_AT] + 3 + 3 * side
        w[j], w[j + 1] = sign * x, sign * z
        arm = (w[k + PLACE_X] - w[section]) * z - (w[k + PLACE_Y] - w[section + 1]) * x
        w[j + 2] = sign * (arm + w[k + NORMAL_TURN])


@njit(**OPTIONS)
def load_sizes(m, t):
    """Coordinates of the joints that laws know with their rates, and the sizes of the loads, which depend on them."""
    apart()
    plan, w, acts = m.plan, m.w, m.acts
    sec = shifted(w, plan[SECTION])
    for n in range(plan[DRIVES], plan[LOADS]):
        k, i = plan[X] + 2 * (n - plan[DRIVES]), acts[n, COURSE_AT]
        second_rate = plan[X] + 2 * (plan[LOADS] - plan[DRIVES]) + n - plan[DRIVES]
        first, second, j, row = acts[n, AT], acts[n, ON], acts[n, NUMBERS_AT], plan[SUMS]
        if i >= 0:
            w[k], w[k + 1], w[second_rate] = w[plan[Y] + i], w[plan[RATE] + i], w[plan[ACCEL] + i]
            continue
        if acts[n, WHAT] == TURN:
            laws.turn(sec, first, second, w[j], w[j + 1], 0.0, w, row)
        else:
            laws.slide(sec, first, second, w[j], w[j + 1], 0.0, w, row)
        w[k], w[k + 1], w[second_rate] = w[row], w[row + 1], w[row + 2]
    if plan[LOADS] < plan[SPRINGS]:
        take_sides(m)
        kernel(m.kernels, MAGNITUDES)(t, w, plan[X], m.p, w, plan[SIZE])
        for k in range(plan[SPRINGS] - plan[LOADS]):
            w[plan[SIZE] + k] += w[plan[INPUT] + k]


@of_contacts(None)
@njit(**OPTIONS)
def take_sides(m):
    """Have the laws of loads on the sides of zero on which what switches them counts."""
    apart()
    plan, w = m.plan, m.w
    first = plan[X] + 3 * (plan[LOADS] - plan[DRIVES])
    for n in range(plan[CONTACTS], plan[ACTS]):
        if m.acts[n, WHAT] == SWITCH:
            side = w[plan[CONTACT] + CONTACT_SIZE * (n - plan[CONTACTS]) + BEGUN_AT]
            w[first + m.acts[n, ROW_AT]] = 1.0 if side == ABOVE else (-1.0 if side == BELOW else 0.0)


@of_contacts(None)
@njit(**OPTIONS)
def meet_switch(m, n, k):
    """Fill in a switch: as a gap that falls through zero where its loads' laws are to change.

    The gap is how far it is from zero on its side; of one that stays there how much room it has left.
    """
    plan, w = m.plan, m.w
    j, side = plan[SIZE] + plan[SPRINGS] - plan[LOADS] + 2 * m.acts[n, ROW_AT], w[k + BEGUN_AT]
    value, rate = w[j], w[j + 1]
    if rate - rate != 0.0:  # no number, as where an argument has none on one side
        rate = 0.0
    if side == BELOW:
        value, rate = -value, -rate
    elif side == STAYS:
        rate = -rate if value > 0.0 else rate
        value = w[k + ROOM] - abs(value)
    w[k + GAP], w[k + GAP_RATE] = value, rate
    w[k + NORMAL_X] = w[k + NORMAL_Y] = 0.0


@njit(**OPTIONS)
def push(m, n, x, z, turn):
    """Take a force and a moment on a section off what the motion of its body asks for."""
    apart()
    b = m.sections[n, OWNER]
    if b >= 0:
        w, f = m.w, m.plan[FRAME] + FRAME_SIZE * b
        kernel(m.kernels, PUSHED)(
            m.bodies[b, KIND], w, m.sections[n, POINT], w, m.plan[Y] + m.bodies[b, MODAL], w[f + 3], w[f + 4],
            -x, -z, -turn, w, m.plan[FORCE] + m.bodies[b, ROW],
        )  # fmt: skip


@njit(**OPTIONS)
def load_direction(m, n):
    """Global direction of a load."""
    w, j = m.w, m.acts[n, NUMBERS_AT]
    if m.acts[n, WHAT] == FOLLOWER:
        return turned(w, w[m.plan[SECTION] + SEC * m.acts[n, ON] + 2], j)
    return w[j], w[j + 1]


@njit(**OPTIONS)
def act(m, t):
    """Loads and springs, taken off what the motion asks for."""
    apart()
    plan, w, acts = m.plan, m.w, m.acts
    load_sizes(m, t)
    for n in range(plan[LOADS], plan[SPRINGS]):
        size = w[plan[SIZE] + n - plan[LOADS]]
        if acts[n, WHAT] == TORQUE:
            push(m, acts[n, AT], 0.0, 0.0, -size)
            push(m, acts[n, ON], 0.0, 0.0, size)
        else:
            x, z = load_direction(m, n)
            push(m, acts[n, AT], size * x, size * z, 0.0)
    sec = shifted(w, plan[SECTION])
    for n in range(plan[SPRINGS], plan[CONTACTS]):
        first, second, j = acts[n, AT], acts[n, ON], acts[n, NUMBERS_AT]
        k = plan[SPRING] + SPRING_SIZE * (n - plan[SPRINGS])
        if acts[n, WHAT] == TORSIONAL:
            laws.twist(sec, first, second, w[j], w[j + 1], w[j + 2], w, k)
            push(m, first, 0.0, 0.0, w[k + 1])
            push(m, second, 0.0, 0.0, -w[k + 1])
        else:
            laws.pull(sec, first, second, w[j], w[j + 1], w[j + 2], w, k)
            push(m, first, -w[k + 2], -w[k + 3], 0.0)
            push(m, second, w[k + 2], w[k + 3], 0.0)
    for n in range(plan[CONTACTS], plan[ACTS]):
        press(m, n)
    holds.exert(m)


@njit(**OPTIONS)
def press(m, n):
    """A contact where its sections are, and what it exerts on them if it is closed."""
    apart()
    plan, w = m.plan, m.w
    k = meet(m, n)
    if w[k + PUSH_NOW] != 0.0:
        x, z = w[k + PUSH_NOW] * w[k + NORMAL_X], w[k + PUSH_NOW] * w[k + NORMAL_Y]
        for side in range(2):
            at, sign = plan[SECTION] + SEC * m.acts[n, AT + side], 2.0 * side - 1.0
            turn = (w[k + PLACE_X] - w[at]) * z - (w[k + PLACE_Y] - w[at + 1]) * x
            turn += w[k + PUSH_NOW] * w[k + NORMAL_TURN]
            push(m, m.acts[n, AT + side], sign * x, sign * z, sign * turn)


@njit(**OPTIONS)
def meet(m, n):
    """Where a contact's numbers are, filled in: gap and what follows from it; nothing is stored or exerted apart.

    A contact that lets go, which a negative BEGUN_AT says, pushes no more, and loses what it has stored. One that rests
    by Newton's law pushes as its row says, whose reaction is an unknown.
    """
    plan, w, sec = m.plan, m.w, m.plan[SECTION]
    k, j, law = plan[CONTACT] + CONTACT_SIZE * (n - plan[CONTACTS]), m.acts[n, NUMBERS_AT], m.acts[n, LAW]
    w[k + PUSH_NOW] = w[k + ELASTIC] = w[k + LOSING] = 0.0
    if m.acts[n, WHAT] == SWITCH:
        meet_switch(m, n, k)
        return k
    touching.gap(m.acts[n, WHAT], w, sec + SEC * m.acts[n, AT], sec + SEC * m.acts[n, ON], w, j, w, k)
    begun_at, gap, rate = w[k + BEGUN_AT], w[k + GAP], w[k + GAP_RATE]
    if law == NEWTON:
        if begun_at != 0.0:
            w[k + PUSH_NOW] = w[plan[NOW] + m.acts[n, ROW_AT]]
    elif begun_at != 0.0:
        if begun_at > 0.0:
            w[k + PUSH_NOW] = touching.normal_force(law, w, j, begun_at, gap, rate)
        w[k + ELASTIC] = touching.stored(w, j, gap)
        w[k + LOSING] = (touching.elastic(w, j, gap) - w[k + PUSH_NOW]) * rate
    return k


@njit(**OPTIONS)
def resist(m, t):
    """What the motion asks for beyond loads, springs, the cuts' reactions and the holds': zero where the equations
    hold.

    M a - f over the speeds of all frames and shapes, at FORCE; the tables have the motion, the cut rows and the
    reactions.
    """
    apart()
    plan, w, acts = m.plan, m.w, m.acts
    for k in range(plan[SPEEDS]):
        w[plan[FORCE] + k] = 0.0
    for b in range(plan[BODIES]):
        f = plan[FRAME] + FRAME_SIZE * b
        kernel(m.kernels, INVERSE)(
            m.bodies[b, KIND], w, m.bodies[b, BLOCK], shifted(w, plan[Y]), shifted(w, plan[RATE]),
            shifted(w, plan[ACCEL]), m.bodies[b, MODAL], w[f + 3], w[f + 4], w[f + 7], w[f + 8] - w[plan[GRAVITY]],
            w[f + 9] - w[plan[GRAVITY] + 1], w[f + 10], w, plan[FORCE] + m.bodies[b, ROW],
        )  # fmt: skip
    act(m, t)
    for n in range(plan[CUTS], plan[DRIVES]):
        end = acts[n + 1, ROW_AT] if n + 1 < plan[DRIVES] else plan[CUT_ROWS]
        for row in range(acts[n, ROW_AT], end):
            size = w[plan[NOW] + row]
            for side in range(2):
                j = plan[CUT] + ROW_SIZE * row + 3 + 3 * side
                push(m, acts[n, AT + side], size * w[j], size * w[j + 1], size * w[j + 2])


@njit(**OPTIONS)
def demand(m, t):
    """What every coordinate of the tree asks for, at DEMAND: :func:`resist` along the partial velocities as they are.

    Inwards, what an inboard joint exerts (at JOINTS: force and moment at the body's section) is taken off its body,
    whose shapes keep what they ask for themselves, and falls to the body that it hangs on.
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
            push(m, inboard, x, z, turn)
            n = plan[DEMAND] + m.bodies[b, MODAL]
            for l in range(m.bodies[b, SHAPES]):
                w[n + l] = w[r + 3 + l]
        push(m, parent, -x, -z, -turn - (w[own] - w[up]) * z + (w[own + 1] - w[up + 1]) * x)
        if kind == REVOLUTE:
            w[i] = w[j] * turn
        elif kind == PRISMATIC:
            d_x, d_y = turned(w, w[up + 2], j + 2)
            w[i] = d_x * x + d_y * z
        elif kind == FREE:
            w[i], w[i + 1], w[i + 2] = x, z, turn
