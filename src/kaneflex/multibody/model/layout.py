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
"""Columns of ``acts`` (cuts, holds, drives, loads, springs, contacts): its kind; two sections, the first that of the
ground for a force; a cut's course or -1, a drive's coordinate or -1, a load's number, the coordinate of a spring at a
joint of the tree or -1, a contact's law; a cut's first row, a hold's or a contact's row, the section that turns a
following force, in space the axis of a load or a spring; its numbers: a cut's direction and angle, a drive's or a
load's direction, a spring's k, c, free length or angle, a contact's (:mod:`kaneflex.generated.contact`), a hold's
(:mod:`kaneflex.multibody.unilateral.rows`). Forces and moments of loads follow, of which a distributed load has two."""

WELD, REVOLUTE, PRISMATIC, TURN, SLIDE, ALONG, ACROSS = range(7)
"""Kinds of joints in the tree; cuts have the first three, and drives of cut joints TURN and SLIDE, as drives have;
holds these two, or ALONG a contact's face, in space with a second row ACROSS the slip."""
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
    GAP, GAP_RATE, GAP_ACCEL, NORMAL, LIMIT, BEFORE, FIRMEST, FORCE, STORED,
    MODE, MEMORY, DUE, ALLOWED, STIFF, VISCOUS, RESISTING_MASS, SINCE, APPROACH, IMPULSE, PEAK, LOST_BEFORE,
    BEGAN_X, BEGAN_Y, BEGAN_Z, NODES,
) = range(25)  # fmt: skip
"""Numbers of a row: gap with two rates; normal force, largest holding force, previous force, and largest g of bristles
since its sides touch, all of friction; force and stored energy; mode and what belongs to it; its change at the
end of this step; of a contact the error allowed in its gap, k and c of the factors, the effective mass along its
normal, and of the current impact its time, approach speed, impulse, peak force, previous loss and place; then a step's
nodes."""
OLD, NEW, STRUCK, ROUNDED, MAY, ALONE, BOUNCE, MET, STICKS, RESTED_BEFORE, QUIET, UNSURE = range(NODES + 8, NODES + 20)
MODE_BEFORE, MEMORY_BEFORE = STICKS, QUIET
"""Numbers of a row at an impact, in place of its nodes: rates before and after, impulse, rounding error of its rate, 1
if its mode is to be found; of a contact its acceleration without contacts, the least rate after the impact, 1 if it
touches, if it does not bounce, and if it was at rest, a negligible rate, and the rounding error of its acceleration; of
a friction mode and MEMORY before."""
PLACE, SLIP, SLIP_RATE = GAP, GAP_RATE, GAP_ACCEL
BY_SPEED, DECAY, BY_PRESS, JAMS = ALLOWED, RESISTING_MASS, SINCE, APPROACH
"""Numbers of a friction in place of these: position along its row, speed and acceleration there; derivatives of the
bristles' rate by speed, by deflection (negative) and by normal force; time when it first jammed. Of bristles a node has
speed, g, deflection, force."""
BORE = FIRMEST
"""Numbers of sticking friction, which has no bristles: the force at which it slips."""
RESULTS, FORCE_AT, STORED_AT = 7, 2, 4
"""Number of a row's results (:func:`kaneflex.multibody.unilateral.frictions.record`), and places of its force and its
stored energy; its gap is the first one."""
(
    PRECISION, EXTENT, FLIGHT, LOW, HIGH, TRIAL, TARGET, FOUND_AT, LAST_CHANGE, IN_A_ROW, HELD, RESTED, TRIES, AIM,
    SHARED,
) = range(15)  # fmt: skip
"""Numbers that contacts share: the error allowed in a gap as a share of its depth, the size of the mechanism [m], the
step [s] before they closed; a change in search: steps before and after it, the next trial, its contact and kind;
time of the last one, and their number at one instant; one more than the number of a switch that its load's law
would hold at zero; 1 if other contacts rest than before; number of searches for a change; the predicted step [s] to
the next contact of rigid sides; then every contact's gradient."""
AXIS_AT, COORDINATE_AT = 8, 9
"""Numbers of a contact in space after those of its law: the axis along which it pushes, and for flanks the coordinate
of their joint."""
ROOM, LARGEST = STIFF, ALLOWED
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
    BODIES, COORDINATES, REACTIONS, CUT_ROWS, JOINT_ROWS, RIGID, WORKS, KEPT, BENDS, LED, VIRTUAL,
    CUTS, HOLDS, DRIVES, LOADS, SPRINGS, CONTACTS, ACTS, YIELDING, SLOPED, PASSING, BY_FORCES,
    Y, RATE, ACCEL, COURSE, X, SIZE, SPRING, SUMS, NOW, DEMAND, POWER,
    MEASURE, SCALE, RATE_SCALE, ACCEL_SCALE, INPUT,
    GRADIENT, LOOP, SIDE, LOOP_PIVOTS, ROW_OF, CUT_OF, DEPENDENT,
    CONTACT, TOUCH, CROSSING, IMPACTS, DECIDES, TOUCHING,
    INERTIAS, COUPLINGS, MASSES, AXES, PHI, PLACES, ARMS, MIDDLE, MIDDLE_CUT, STAGE_A, STAGE_R, STAGE_P, STAGE_C,
    STAGE_H, LAST_A, LAST_R, RESISTING, WAYS, SLOPES, VARIED, TREE_I, TREE_E, TREE_L, TREE_U, TREE_D, TREE_X,
    TREE_ROOM, COLUMNS, SCHUR, REACTION, WANTED, SLOPE_COLUMNS, SLOPE_SQUARE, SLOPE_FORCES, FREED, PIVOTS, PAIR_PIVOTS,
    WITH_SLOPES, SLOPE_PIVOTS, SLOPE_PAIR_PIVOTS, PRESCRIBED, RESISTING_R, GIVEN, GIVEN_REACTION, MASS_PIVOTS,
    MASS_ROWS, PUSHES, PUSHED, PLAN,
) = range(100)  # fmt: skip
"""Places of ``plan``. Counts: bodies, coordinates, reactions (of rows of the cuts, then of
contacts), rows of cuts and holds, those of cuts alone, contacts with reactions (all if some are by Newton's law),
works, kept rows; 1 if shapes are among the dependent coordinates; number of nodes, the first ones, that no dependent
coordinate moves; number of coordinates with virtual inertia, each a row of the factors. First places in ``acts`` of
cuts, holds, drives, loads, springs and contacts, and the end; numbers of rows of the next factors beside the kept ones,
and of loads and springs there, counted by compiled code; 1 if the step is near a change point. Places in ``w``: the
motion (coordinates, rates, accelerations), sections, cut rows, courses, drives' coordinates and rates, loads' sizes,
springs, sums, reactions of the cuts, residuals of coordinates, powers. Unit of every coordinate, the errors allowed in
it, its rate and its acceleration; additions to the loads' sizes, then to prescribed accelerations; the gradient of the
kept rows, its dependent square, their right-hand side. Places in ``plan`` itself: that square's pivots, of every kept
row its number, of every row its cut or contact, of every kept row its dependent coordinate. In ``w`` again: contacts,
preceded by the holds' numbers, shared numbers of contacts, numbers of change points, completed impacts. In ``plan``:
what rigid contacts exert now (``codes.NOTHING`` and others); coordinates with virtual inertia, then contacts and holds
in the factors (holds by numbers below zero), and touching contacts. In ``w``, at the middle of a step: matrices I, E
and L of the bodies at their inboard sections, axes of joints, twists of sections by shapes, places and arms
(:mod:`kaneflex.multibody.dynamics.tree`), arms of sections and cut rows; stages' accelerations, reactions, powers and
rates of courses, accelerations of holds, accelerations and reactions of the last step, and residuals of its stages;
gradients of joints' coordinates and springs, partial velocities of loads, slopes of loads and springs, sizes of loads
elsewhere (:mod:`kaneflex.multibody.dynamics.load_derivatives`). In factors: I, E, L, U and D of the tree; twists of its
bodies; working space; coordinates by unit reactions of the kept rows, and in the last row the solution; the reactions'
effect on the cuts; reactions; required accelerations of holds; responses to a unit of each load and spring with slopes,
their matrix, their forces. In ``plan``: 1 for every coordinate that no course prescribes, the pivots of either factors,
those loads and springs, the pivots of their matrices, the coordinate that each course prescribes, or -1 if it is that
of a cut. In space: in ``w`` residuals of the stages as reactions, in factors accelerations and reactions given for the
right-hand side, in ``plan`` pivots of the stages' mass matrices, and the number of their rows. First forces and moments
of loads in ``acts``, and their end."""


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
    HOLDS = "Mechanism with holds"
    SPACE = "Mechanism in space"
    RIGID_SPACE = "Mechanism in space without stiffness"
    SWITCHED_SPACE = "Mechanism in space with discontinuous loads"
    CONTACT_SPACE = "Mechanism in space with contacts"
    HOLD_SPACE = "Mechanism in space with holds"
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
