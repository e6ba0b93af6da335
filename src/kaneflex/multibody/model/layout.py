"""Tables of a mechanism for compiled recursions: columns and places.

Compiled code passes an array as seven words, and a tuple of thirty arrays would cost more than most of these functions
compute. So all floating-point numbers, of the mechanism and of the motion, are in one array, whose places the plan
contains; integers are in three tables. Compiled code receives one word, the address of their addresses: indices need no
check for negative values, and constant integers need not be read again after a store.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np

CONTACT_SIZE = 44
"""Numbers of a unilateral or frictional row, see :mod:`kaneflex.multibody.unilateral.rows`."""

SHAPES, DOF, FIRST, MODAL, PARENT_BODY, OUTBOARD, COUPLING, SQUARE = range(8)
"""Columns of ``bodies``, in the order of the tree: number of shapes n, and of coordinates of the joint; first
coordinate of the joint, and of the shapes; the parent, or -1; first row in ``phi`` of the section of the parent that
the body hangs on, or -1 where no shape moves it; first row in ``E``; place in ``L``. See
:mod:`kaneflex.multibody.dynamics.articulated`."""
WHAT, AT, ON, COURSE_AT, ROW_AT, NUMBERS_AT = range(6)
LAW = COURSE_AT
"""Columns of ``acts`` (cuts, frictions, drives, loads, springs, contacts): its kind; two sections, the first that of
the ground for a force; a cut's course or -1, a drive's coordinate or -1, a load's number, the coordinate of a spring at
a joint of the tree or -1, a contact's law; a cut's first row, a friction's or a contact's row, the section that turns a
following force, in space the axis of a load or a spring; its numbers: a cut's direction and angle, a drive's or a
load's direction, a spring's k, c, free length or angle, a contact's (:mod:`kaneflex.generated.contact`), a friction's
(:mod:`kaneflex.multibody.unilateral.rows`). Forces and moments of loads follow, of which a distributed load has two."""

WELD, REVOLUTE, PRISMATIC, TURN, SLIDE, ALONG, ACROSS = range(7)
"""Kinds of joints in the tree; cuts have the first three, and drives of cut joints TURN and SLIDE, as drives have;
frictions these two, or ALONG a contact's face, in space with a second row ACROSS the slip."""
FORCE_ALONG, FOLLOWER, STRAIGHT, BUSHING, ALONG_AXIS, TORQUE, TORSIONAL, ABOUT_AXIS = range(8)
"""Kinds of loads: along a global direction, along one that turns with a section, TORQUE between two sections; in space
directions have the axes of bodies, and are all FORCE_ALONG. Kinds of springs: STRAIGHT and TORSIONAL, and six rows of a
bushing in space, along and about its axes, the first one BUSHING. From TORQUE on they are moments."""
CIRCLES, FLANK, SWITCH = 1, 2, -1
"""Kinds of contacts: circles, in space spheres, and flanks, by their number in
:data:`kaneflex.generated.contact.KINDS`; switches, which touch nothing but are treated alike: arguments of loads' laws,
which change at their zeros. The sections of a switch are the ground's, its number among the switches is in ROW_AT."""
OPEN, CLOSED, STICKING, SLIPPING, RELEASED, FLOWING, BENDING = range(7)
"""MODE of a unilateral or frictional row: without force; closed contact; friction that sticks, or slips; closed contact
that would pull; friction by a function of the state; friction of bristles. MEMORY belongs to it: the approach speed of
a closed or released contact's law, the position where friction sticks, its direction of slip (1 or -1), the deflection
of bristles, the side of a switch."""
MODE_SIZE = 2
"""Numbers of a row in a row of the integration: MODE and MEMORY."""
ABOVE, BELOW, STAYS = 1.0, -1.0, 0.0
"""MEMORY of a switch: the laws' side of zero, or that it stays at zero."""
(
    GAP, GAP_RATE, GAP_ACCEL,  # gap, or position of a friction [m or rad], with two rates
    # Of friction: normal force, largest holding force, previous force, and largest g of bristles since the sides touch.
    NORMAL, LIMIT, BEFORE, FIRMEST,
    # Force and stored energy; mode, what belongs to it, and its change at the end of this step.
    FORCE, STORED, MODE, MEMORY, DUE,
    # Of a contact: error allowed in its gap, k and c of the factors, effective mass along its normal.
    ALLOWED, STIFF, VISCOUS, RESISTING_MASS,
    # Of the current impact: its time, approach speed, impulse, peak force, previous loss and place.
    SINCE, APPROACH, IMPULSE, PEAK, LOST_BEFORE, BEGAN_X, BEGAN_Y, BEGAN_Z,
    NODES,  # first number of the step's nodes: of a contact each has gap, rate, force and the force's sign
) = range(25)  # fmt: skip
"""Numbers of a row."""
(
    # Rates before and after, impulse, rounding error of its rate, and 1 if its mode is to be found.
    OLD, NEW, STRUCK, ROUNDED, MAY,
    ALONE, BOUNCE, MET,  # of a contact: acceleration without contacts, least rate after the impact, and 1 if it touches
    # 1 if it does not bounce, and if it was at rest; a negligible rate, and the rounding error of its acceleration.
    STICKS, RESTED_BEFORE, QUIET, UNSURE,
) = range(NODES + 8, NODES + 20)  # fmt: skip
"""Numbers of a row at an impact, in place of its nodes."""
MODE_BEFORE, MEMORY_BEFORE = STICKS, QUIET
"""Numbers of a friction at an impact in place of these: its mode and MEMORY before."""
PLACE, SLIP, SLIP_RATE = GAP, GAP_RATE, GAP_ACCEL
BY_SPEED, DECAY, BY_PRESS, JAMS = ALLOWED, RESISTING_MASS, SINCE, APPROACH
"""Numbers of a friction in place of these: position along its row, speed and acceleration there; derivatives of the
bristles' rate by speed, by deflection (negative) and by normal force; time when it first jammed. For bristles a node
has speed, g, deflection, force."""
BREAKAWAY = FIRMEST
"""Numbers of sticking friction, which has no bristles: the force at which it slips."""
RESULTS, FORCE_AT, STORED_AT = 7, 2, 4
"""Number of a row's results (:func:`kaneflex.multibody.unilateral.frictions.record`), and places of its force and its
stored energy; its gap is the first one."""
(
    # Error allowed in a gap as a share of its depth, size of the mechanism [m], step [s] before contacts closed.
    PRECISION, EXTENT, FLIGHT,
    # A change in search: steps before and after it, the next trial, its contact and kind.
    LOW, HIGH, TRIAL, TARGET, FOUND_AT,
    LAST_CHANGE, IN_A_ROW,  # time of the last change, and number of changes at that instant
    # One more than the number of a switch that its load's law would hold at zero; 1 if other contacts rest than before.
    HELD, RESTED,
    TRIES, AIM,  # number of searches for a change; predicted step [s] to the next contact of rigid sides
    SHARED,  # first of the rows' gradients
) = range(15)  # fmt: skip
"""Numbers that all contacts share."""
AXIS_AT, COORDINATE_AT = 8, 9
"""Numbers of a contact in space after those of its law: the axis along which it pushes, and for flanks the coordinate
of their joint."""
ZERO_BAND, LARGEST = STIFF, ALLOWED
"""Numbers of a switch: tolerance of zero, and its largest distance from zero."""
SHUT, SHIFT = STIFF, VISCOUS
"""Numbers of a contact by Newton's law: 1 if dependent coordinates keep it closed; shift of its gap after a separation
without speed. ALLOWED is the force [N] that counts as zero."""
WHEN, REACH, LEAST, CHANGE_POINT = range(4)
"""Numbers of change points: time of the next or last one; time [s] from there until the loops are regular again, 0 if
unknown; least pivot of the cuts' derivatives at the end of the last step, 0 if that was too close. Then
interpolation data."""
IMPACT_SIZE, MOST_IMPACTS = 11, 256
"""Numbers of a completed impact: contact, its begin and end, approach speed, separation speed, impulse, peak force,
energy lost, x, y and z of its begin; number of impacts after which Python must collect them. Their count precedes
them."""

(
    # Counts: bodies, coordinates, reactions (of the cuts, then of contacts), rows of cuts and frictions, rows of cuts.
    BODIES, COORDINATES, REACTIONS, CUT_ROWS, JOINT_ROWS,
    RIGID, WORKS, KEPT,  # contacts with reactions (all if some are by Newton's law), works, kept rows
    # 1 if shapes are among the dependent coordinates; number of nodes, the first ones, that no dependent one moves.
    BENDS, LED,
    VIRTUAL,  # number of coordinates with virtual inertia, each a row of the factors
    CUTS, FRICTIONS, DRIVES, LOADS, SPRINGS, CONTACTS, ACTS,  # first places in ``acts``, and the end
    # Counted by compiled code: rows of the factors beside the kept ones, and loads and springs with slopes there.
    YIELDING, SLOPED,
    # 1 if the step is near a change point; 1 if the residuals of the stages are forces, 0 if accelerations, in space.
    PASSING, BY_FORCES,
    # Places in ``w``.
    Y, RATE, ACCEL,  # motion: coordinates, rates, accelerations
    # Courses; drives' coordinates and two rates, then sides of switches; loads' sizes, springs, sums of a cut's row.
    COURSE, X, SIZE, SPRING, SUMS,
    NOW, DEMAND, POWER,  # reactions, residuals of coordinates, powers
    # Unit of every coordinate; errors allowed in it, its rate and its acceleration.
    MEASURE, SCALE, RATE_SCALE, ACCEL_SCALE,
    INPUT,  # additions to the loads' sizes, then to prescribed accelerations
    GRADIENT, LOOP, SIDE,  # gradient of the kept rows, its dependent square, their right-hand side
    # Places in ``plan``: pivots of that square, number of every kept row, cut or contact of every row, dependent
    # coordinate of every kept row.
    LOOP_PIVOTS, ROW_OF, CUT_OF, DEPENDENT,
    # Places in ``w``: contacts, after the frictions' numbers; shared numbers of contacts; of change points; impacts.
    CONTACT, TOUCH, CROSSING, IMPACTS,
    DECIDES,  # what rigid contacts exert now (``codes.NOTHING`` and others)
    # Place in ``plan``: coordinates with virtual inertia, then contacts and frictions (below zero) in the factors.
    FACTOR_ROWS,
    # Places in ``w``, of the middle of a step: matrices I, E and L of the bodies at their inboard sections.
    INERTIAS, COUPLINGS, MASSES,
    # Axes of joints, twists of sections by shapes, places and arms of bodies (:mod:`kaneflex.multibody.dynamics.tree`).
    AXES, PHI, PLACES, ARMS,
    MIDDLE, MIDDLE_CUT,  # arms of sections, and of cut rows
    # Of the stages: accelerations, reactions, powers, rates of courses, accelerations of frictions.
    STAGE_A, STAGE_R, STAGE_P, STAGE_C, STAGE_F,
    LAST_A, LAST_R, RESISTING,  # accelerations and reactions of the last step; residuals of the stages
    # Gradients of joints' coordinates and springs, and partial velocities of loads; slopes of loads and springs; sizes
    # of loads elsewhere (:mod:`kaneflex.multibody.dynamics.load_derivatives`).
    WAYS, SLOPES, VARIED,
    # Places in factors: I, E, L, U and D of the tree, twists of its bodies, working space.
    TREE_I, TREE_E, TREE_L, TREE_U, TREE_D, TREE_X, TREE_WORK,
    COLUMNS,  # coordinates by unit reactions of the kept rows, and in the row after these the solution
    SCHUR, REACTION, WANTED,  # the reactions' effect on the rows; reactions; required accelerations of frictions
    # Responses to a unit of each load and spring with slopes, their matrix, their forces.
    SLOPE_COLUMNS, SLOPE_SQUARE, SLOPE_FORCES,
    # Places in ``plan``: 1 for every coordinate that no course prescribes; pivots of either factors.
    FREED, PIVOTS, PAIR_PIVOTS,
    WITH_SLOPES, SLOPE_PIVOTS, SLOPE_PAIR_PIVOTS,  # loads and springs with slopes, and the pivots of their matrices
    PRESCRIBED,  # coordinate that each course prescribes, -1 if it is that of a cut
    # In space: place in ``w`` of residuals of the stages as reactions; places in factors of accelerations and reactions
    # given for the right-hand side; place in ``plan`` of pivots of the stages' mass matrices, and number of their rows.
    RESISTING_R, GIVEN, GIVEN_REACTION, MASS_PIVOTS, MASS_ROWS,
    PUSHES, PUSHED,  # forces and moments of loads in ``acts``: the first one, and their end
    PLAN,  # number of places
) = range(100)  # fmt: skip
"""Places of ``plan``: counts, places in ``acts``, ``w`` and factors, and places in ``plan`` itself."""


class Tables(NamedTuple):
    """Tables of one mechanism: plan (int64), bodies, acts (int64, by row and column), w (float64)."""

    plan: np.ndarray
    bodies: np.ndarray
    acts: np.ndarray
    w: np.ndarray


COURSES, MAGNITUDES = range(2)
"""Places of a structure's kernels."""
STRUCTURE_KERNELS = {
    "courses": "void(float64, CPointer(float64), CPointer(float64), int64)",
    "magnitudes": "void(float64, CPointer(float64), int64, CPointer(float64), CPointer(float64), int64)",
}
"""Kernels of a structure and their signatures."""


class Kind(Enum):
    """Kind of mechanism, each with compiled functions of its own.

    RIGID_SPACE: without shapes, and without derivatives of springs and loads in the matrix of a step.
    """

    PLAIN = "Mechanism"
    CONTACTS = "Mechanism with contacts"
    IMPACTS = "Mechanism with impacts"
    FRICTIONS = "Mechanism with friction"
    SPACE = "Mechanism in space"
    RIGID_SPACE = "Mechanism in space without stiffness"
    SWITCHED_SPACE = "Mechanism in space with discontinuous loads"
    CONTACT_SPACE = "Mechanism in space with contacts"
    FRICTION_SPACE = "Mechanism in space with friction"
    IMPACT_SPACE = "Mechanism in space with impacts"

    @property
    def d(self) -> int:
        """Numbers of a twist: 3 in the plane, 6 in space."""
        return 6 if "space" in self.value else 3


class Handle:
    """Table of the addresses of arrays or other handles, and its own address; valid in this process only."""

    def __init__(self, *arrays: np.ndarray | Handle) -> None:
        self.arrays = arrays
        addresses = [each.address if isinstance(each, Handle) else each.ctypes.data for each in arrays]
        self._table = np.array(addresses, np.int64)
        self.address: int = self._table.ctypes.data
