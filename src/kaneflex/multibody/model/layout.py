"""Tables of a mechanism for compiled recursions: columns and places.

Compiled code passes an array as seven words, and a tuple of thirty arrays would cost more than most of these functions
compute. So all floating-point numbers, of the mechanism and of the motion, are in one array, whose places the plan
contains; integers are in three tables. Compiled code receives one word, the address of their addresses: indices need no
check for negative values, and constant integers need not be read again after a store.
"""

from __future__ import annotations

import math
import operator
from typing import NamedTuple

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.imputils import lower_getattr_generic
from numba.core.typing.templates import AbstractTemplate, AttributeTemplate, infer_getattr, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model
from numba.types import CPointer, FunctionType, UniTuple, complex128, float64, int64, void

from kaneflex.support.inner import Inner

_AS_WRITTEN = {"nsz", "arcp", "contract", "afn"}
"""Compiler flags for sums that keep the order of terms."""
OUTER = {"error_model": "numpy", "fastmath": _AS_WRITTEN | {"reassoc"}}
ENTRY = OUTER | {"_nrt": False, "no_cpython_wrapper": True, "no_rewrites": True, "pipeline_class": Inner}
"""Numba options of functions that Python calls by their addresses: see :mod:`kaneflex.multibody.compile.library`."""
OPTIONS = ENTRY | {"no_cfunc_wrapper": True}
"""Numba options of functions called by compiled code: they allocate nothing, so nothing is reference-counted."""
IN_ORDER = OPTIONS | {"fastmath": _AS_WRITTEN}
"""Numba options with sums in textual order, for numbers just written one by one: vectorised reading would stall."""

CONTACT_SIZE = 46
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

WELD, REVOLUTE, PRISMATIC, TURN, SLIDE, ALONG = range(6)
"""Kinds of joints in the tree; cuts have the first three, and drives of cut joints TURN and SLIDE, as drives have;
holds these two, or ALONG a contact's face."""
FORCE_ALONG, FOLLOWER, STRAIGHT, BUSHING, ALONG_AXIS, TORQUE, TORSIONAL, ABOUT_AXIS = range(8)
"""Kinds of loads: along a global direction, along one that turns with a section, TORQUE between two sections; in space
directions have the axes of bodies, and are all FORCE_ALONG. Kinds of springs: STRAIGHT and TORSIONAL, and six rows of a
bushing in space, along and about its axes, the first one BUSHING. From TORQUE on they are moments."""
FLANK, SWITCH = 2, -1
"""Kinds of contacts: flanks, by their number in :data:`kaneflex.generated.contact.KINDS`; switches, which touch
nothing but are treated alike: arguments of loads' laws, which change at their zeros. The sections of a switch are
the ground's, its number among the switches is in ROW_AT."""
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
    GAP, GAP_RATE, GAP_ACCEL, NORMAL, LIMIT, SPEED_SIZE, BEFORE, FIRMEST, FORCE, STORED, LOSING,
    MODE, MEMORY, DUE, ALLOWED, STIFF, VISCOUS, RESISTING_MASS, SINCE, APPROACH, IMPULSE, PEAK, LOST_BEFORE,
    BEGAN_X, BEGAN_Y, BEGAN_Z, NODES,
) = range(27)  # fmt: skip
"""Numbers of a row: gap with two rates; normal force, largest holding force, size of the speeds whose difference is its
own, previous force, and largest g of bristles since its sides touch, all of friction; force, stored energy and loss;
mode and what belongs to it; its change at the end of this step; of a contact the error allowed in its gap, k and c of
the factors, the effective mass along its normal, and of the current impact its time, approach speed, impulse, peak
force, previous loss and place; then a step's nodes."""
PLACE, SLIP, SLIP_RATE = GAP, GAP_RATE, GAP_ACCEL
BY_SPEED, DECAY, BY_PRESS, JAMS = ALLOWED, RESISTING_MASS, SINCE, APPROACH
"""Numbers of a friction in place of these: position along its row, speed and acceleration there; derivatives of the
bristles' rate by speed, by deflection (negative) and by normal force; time when it first jammed. Of bristles a node has
speed, g, deflection, force."""
BORE = FIRMEST
"""Numbers of sticking friction, which has no bristles: the force at which it slips."""
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
WHEN, REACH, LEAST, PASSED, CHANGE_POINT = range(5)
"""Numbers of change points: time of the next or last one; time [s] from there until the loops are regular again, 0 if
unknown; least pivot of the cuts' derivatives at the end of the last step, 0 if that was too close; time when the
last one was passed. Then interpolation data."""
IMPACT_SIZE, MOST_IMPACTS = 11, 256
"""Numbers of a completed impact: contact, its begin and end, approach speed, separation speed, impulse, peak force,
energy lost, x, y and z of its begin; number of impacts after which Python must collect them. Their count precedes
them."""

(
    BODIES, COORDINATES, SPEEDS, REACTIONS, CUT_ROWS, JOINT_ROWS, RIGID, WORKS, KEPT, BENDS, LED, VIRTUAL,
    CUTS, HOLDS, DRIVES, LOADS, SPRINGS, CONTACTS, ACTS, YIELDING, SLOPED, PASSING, BY_FORCES,
    Y, RATE, ACCEL, COURSE, X, SIZE, SPRING, SUMS, NOW, DEMAND, POWER,
    MEASURE, SCALE, RATE_SCALE, ACCEL_SCALE, INPUT,
    GRADIENT, LOOP, SIDE, LOOP_PIVOTS, ROW_OF, CUT_OF, DEPENDENT,
    CONTACT, TOUCH, CROSSING, IMPACTS, COMPLEMENT, TOUCHING,
    INERTIAS, COUPLINGS, MASSES, AXES, PHI, PLACES, ARMS, MIDDLE, MIDDLE_CUT, STAGE_A, STAGE_R, STAGE_P, STAGE_C,
    STAGE_H, LAST_A, LAST_R, RESISTING, WAYS, SLOPES, VARIED, TREE_I, TREE_E, TREE_L, TREE_U, TREE_D, TREE_X,
    TREE_ROOM, COLUMNS, SCHUR, REACTION, WANTED, SLOPE_COLUMNS, SLOPE_SQUARE, SLOPE_FORCES, FREED, PIVOTS, PAIR_PIVOTS,
    WITH_SLOPES, SLOPE_PIVOTS, SLOPE_PAIR_PIVOTS, PRESCRIBED, RESISTING_R, GIVEN, GIVEN_REACTION, MASS_PIVOTS,
    MASS_ROWS, PUSHES, PUSHED, PLAN,
) = range(101)  # fmt: skip
"""Places of ``plan``. Counts: bodies, coordinates, speeds of all bodies, reactions (of rows of the cuts, then of
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
preceded by the holds' numbers, shared numbers of contacts, numbers of change points, completed impacts, arrays for
rigid contacts at one instant. In ``plan``: coordinates with virtual inertia, then contacts and holds in the factors
(holds by numbers below zero), and touching contacts. In ``w``, at the middle of a step: matrices I, E and L of the
bodies at their inboard sections, axes of joints, twists of sections by shapes, places and arms
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


class Fixed(types.Type):
    """Whole numbers in rows of ``width`` that compiled code only reads, from their address: ``f[k]``, ``f[row, k]``."""

    def __init__(self, width: int) -> None:
        self.width = width
        super().__init__(f"Fixed({width})")


@register_model(Fixed)
class _FixedModel(models.PrimitiveModel):
    def __init__(self, manager, of) -> None:
        super().__init__(manager, of, ir.IntType(64).as_pointer())


@infer_global(operator.getitem)
class _FixedItem(AbstractTemplate):
    def generic(self, args, kws):
        fixed, k = args
        if not isinstance(fixed, Fixed):
            return None
        whole = types.intp if isinstance(k, types.Integer) else UniTuple(types.intp, 2)
        return signature(int64, fixed, whole)


@lower_builtin(operator.getitem, Fixed, types.Any)
def _fixed_item(context, builder, sig, args):
    address, k = args
    if sig.args[1] != types.intp:
        row, column = cgutils.unpack_tuple(builder, k)
        k = builder.add(builder.mul(row, ir.Constant(row.type, sig.args[0].width)), column)
    return _fixed_number(builder, builder.gep(address, [k]))


def _fixed_number(builder, place):
    """Load of a number that compiled code never writes."""
    found = builder.load(place)
    found.set_metadata("invariant.load", builder.module.add_metadata([]))
    return found


@intrinsic
def apart(typing):
    """Keep the calling function one piece of machine code, not inlined, with its loops as written.

    Unrolling and vectorising would take most of the compiler's time without gain for a few shapes per body.
    """

    def mark(context, builder, sig, args):
        builder.function.attributes.add("noinline")
        builder.function.attributes.add("optsize")
        return context.get_dummy_value()

    return types.none(), mark


@intrinsic
def together(typing):
    """As :func:`apart`, for functions with loops long enough to be vectorised."""

    def mark(context, builder, sig, args):
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return types.none(), mark


@intrinsic
def shifted(typing, address, k):
    """Address of the k-th number from there."""

    def read(context, builder, sig, args):
        return builder.gep(args[0], [args[1]])

    return address(address, types.intp), read


@intrinsic
def address(typing, array):
    """Address of an array's first number: reading from it needs no check for negative indices."""

    def read(context, builder, sig, args):
        return context.make_array(array)(context, builder, args[0]).data

    return CPointer(array.dtype)(array), read


N = CPointer(float64)
_BITS = 64
"""Bits of an address."""

COURSES, MAGNITUDES = range(2)
"""Places of a structure's kernels."""
STRUCTURE_KERNELS = {
    "courses": FunctionType(void(float64, N, N, int64)),
    "magnitudes": FunctionType(void(float64, N, int64, N, N, int64)),
}
_KERNELS = (*STRUCTURE_KERNELS.values(),)


@intrinsic(prefer_literal=True)
def kernel(typing, kernels, which):
    """One of a structure's kernels, to be called."""

    def read(context, builder, sig, args):
        found = _fixed_number(builder, builder.gep(args[0], [ir.Constant(ir.IntType(_BITS), which.literal_value)]))
        function = cgutils.create_struct_proxy(sig.return_type)(context, builder)
        function.jit_addr = builder.inttoptr(found, cgutils.voidptr_t)
        # Else every call would have a branch for functions that are not compiled yet.
        builder.assume(builder.icmp_unsigned("!=", function.jit_addr, cgutils.voidptr_t(None)))
        return function._getvalue()

    return _KERNELS[which.literal_value](kernels, which), read


class Handed(types.Type):
    """Type of a word passed to compiled code, the address of a table of addresses: attributes of these types.

    ``size``: D of a mechanism, 3 in the plane, 6 in space.
    """

    def __init__(self, name: str, size: int = 0, **parts: types.Type) -> None:
        self.parts, self.d = parts, size
        super().__init__(name)


@register_model(Handed)
class _HandedModel(models.PrimitiveModel):
    def __init__(self, manager, of) -> None:
        super().__init__(manager, of, ir.IntType(_BITS).as_pointer())


@infer_getattr
class _HandedParts(AttributeTemplate):
    key = Handed

    def generic_resolve(self, handed, name):
        return handed.parts.get(name)


@lower_getattr_generic(Handed)
def _part(context, builder, handed, value, name):
    place = builder.gep(value, [ir.Constant(ir.IntType(_BITS), list(handed.parts).index(name))])
    return builder.inttoptr(_fixed_number(builder, place), context.get_value_type(handed.parts[name]))


Z = CPointer(complex128)
PARTS = {
    "plan": Fixed(1), "bodies": Fixed(8), "acts": Fixed(6), "w": N, "pivots": CPointer(int64),
    "kernels": CPointer(int64), "p": N, "real": N, "pair": Z,
}  # fmt: skip
MECHANISM, CONTACT_MECHANISM, IMPACT_MECHANISM, HOLD_MECHANISM = (
    Handed(f"Mechanism{kind}", 3, **PARTS) for kind in ("", " with contacts", " with impacts", " with holds")
)
SPACE, RIGID_SPACE, SWITCHED_SPACE, CONTACT_SPACE, IMPACT_SPACE, HOLD_SPACE = (
    Handed(f"Mechanism in space{kind}", 6, **PARTS)
    for kind in (
        "", " without stiffness", " with discontinuous loads", " with contacts", " with impacts", " with holds",
    )
)  # fmt: skip
"""All numbers of a mechanism for compiled code, with those of :mod:`.arrays`. ``pivots``: the plan once
more, writable; ``kernels``: addresses of those of the structure, see :func:`kernel`; ``p``: the parameters of the
structure's module; ``real``, ``pair``: arrays for factors. RIGID_SPACE: without shapes, and without derivatives of
springs and loads in the matrix of a step."""


class Handle:
    """Table of the addresses of arrays or other handles, and its own address; valid in this process only."""

    def __init__(self, *arrays: np.ndarray | Handle) -> None:
        self.arrays = arrays
        addresses = [each.address if isinstance(each, Handle) else each.ctypes.data for each in arrays]
        self._table = np.array(addresses, np.int64)
        self.address: int = self._table.ctypes.data


@njit(**OPTIONS)
def magnitude(x):
    """|Re x| + |Im x|: tests for a vanishing pivot as well as the absolute value, without a root."""
    return abs(x.real) + abs(x.imag)


@njit(**OPTIONS)
def larger(a, b):
    """Larger of two numbers, NaN if one of them is. (numba's own takes seconds to compile.)"""
    return a if a >= b or a != a else b


@njit(**OPTIONS)
def smaller(a, b):
    """Smaller of two numbers in the same way."""
    return a if a <= b or a != a else b


@njit(**OPTIONS)
def turned(w, theta, k):
    """Global components of the direction at ``k``, fixed in axes at the angle theta: most are the ground's."""
    if theta == 0.0:
        return w[k], w[k + 1]
    c, s = math.cos(theta), math.sin(theta)
    return c * w[k] - s * w[k + 1], s * w[k] + c * w[k + 1]
