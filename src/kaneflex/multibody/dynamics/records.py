"""Records of instants: motion of the bodies, joint forces, energies and powers, from the state of a mechanism."""

from __future__ import annotations

from numba import njit

from kaneflex.multibody.compile.types import OPTIONS, no_inline
from kaneflex.multibody.compile.values import by_size, copy
from kaneflex.multibody.dynamics import powers
from kaneflex.multibody.dynamics.algebra import axpy, force_at, minus, plus, scaled
from kaneflex.multibody.dynamics.arrays import JOINTS, KEPT, OWN
from kaneflex.multibody.dynamics.axes import to_global
from kaneflex.multibody.dynamics.inverse_dynamics import demand
from kaneflex.multibody.dynamics.wrenches import row_wrench
from kaneflex.multibody.model.layout import COORDINATES
from kaneflex.multibody.model.tree_layout import CARRIER, FIRST_ROW, KIND, LAST_NODE, LAST_ROW, SIDE, SLIDE, SPEED
from kaneflex.multibody.unilateral.frictions import friction_of, record
from kaneflex.multibody.unilateral.rows import row_at


@njit(**OPTIONS)
def give_coordinates(m):
    """Set the coordinates q of all nodes but balls to those of their speeds."""
    for n in range(m.counts[OWN]):
        m.q[m.own[n, 0]] = m.y[m.own[n, 1]]


@njit(**OPTIONS)
def store_record(m, t, row):
    """Store the record of the current instant, see :class:`kaneflex.multibody.dynamics.arrays.Instants`: forces along
    the speeds and of joints, energies, powers, results of rows."""
    no_inline()
    demand(m, t)
    powers.powers(m)
    copy(m.h, m.along, m.plan[COORDINATES])
    joint_forces(m)
    powers.energies(m)
    record(m)
    copy(m.kept, row, m.counts[KEPT])


@njit(**OPTIONS)
def joint_forces(m):
    """Forces and moments that the joints exert, from the wrenches of the nodes and the reactions of the cuts."""
    no_inline()
    for n in range(m.counts[JOINTS]):
        m.exerted[n] = _joint_force(m, n)


@njit(**OPTIONS)
def _joint_force(m, joint):
    """Force of a joint of the tree on its second body, by the joint's rows, then along its coordinate; zero for other
    joints.

    If the outer body is the first one, its normal force has the guide's arm besides.
    """
    n = m.joints[joint, LAST_NODE]
    if n < 0:
        return 0.0, 0.0, 0.0
    x, z, turn = force_at(m.wrenches[n], minus(m.r[n], m.P[n]))
    sign = float(m.joints[joint, SIDE])
    if m.nodes[n, KIND] != SLIDE:
        return sign * x, sign * z, sign * turn
    d_x, d_y, _ = m.S[m.nodes[n, SPEED]]
    normal, along = d_x * z - d_y * x, d_x * x + d_y * z
    if sign < 0.0:  # with exchanged sides the direction is reversed: n . F and d . F keep their signs
        turn = -turn - normal * m.y[m.nodes[n, SPEED]]
    return normal, turn, along


@njit(**OPTIONS)
def _joint_wrench(m, joint):
    """Force and moment of a joint on its second body at its second point."""
    n, on, wrench = m.joints[joint, LAST_NODE], m.joints[joint, CARRIER], (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    first_row, last_row = m.joints[joint, FIRST_ROW], m.joints[joint, LAST_ROW]
    if n >= 0:
        place = m.points[joint]
        if on >= 0:
            place = plus(m.r[on], to_global(m, on, place))
        wrench = force_at(scaled(float(m.joints[joint, SIDE]), m.wrenches[n]), minus(m.r[n], place))
    for r in range(first_row, last_row):
        wrench = axpy(m.multipliers[r], row_wrench(m, r, 1), wrench)
    n = friction_of(m, first_row) if first_row < last_row else 0
    return wrench if n == 0 else axpy(m.multipliers[row_at(m, n)], row_wrench(m, row_at(m, n), 1), wrench)


_joint_force = by_size(_joint_force, _joint_wrench)
