"""Where compiled recursions find what they walk: the columns and places of a mechanism's tables.

A function of compiled code takes seven words an array, and a tuple of thirty arrays would cost more to hand over than
most of these functions compute. So all numbers, of the mechanism and of the motion, lie in one array, whose places the
plan names; and what is whole numbers, in three tables. Compiled code is handed one word, the address of their
addresses: no index is looked at twice, and whole numbers, which it never writes, need not be read again after a store.
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
"""What the compiler may do to a sum without changing the order of its terms."""
OUTER = {"error_model": "numpy", "fastmath": _AS_WRITTEN | {"reassoc"}}
ENTRY = OUTER | {"_nrt": False, "no_cpython_wrapper": True, "no_rewrites": True, "pipeline_class": Inner}
"""What those are made with that Python calls, by their addresses: see :mod:`kaneflex.multibody.library`."""
OPTIONS = ENTRY | {"no_cfunc_wrapper": True}
"""What compiled functions are made with that others call: they allocate nothing, so nothing is counted."""
IN_ORDER = OPTIONS | {"fastmath": _AS_WRITTEN}
"""The same, with sums in the order of their text: of numbers that were just written one by one, which several at once
would wait for."""

SEC, FRAME_SIZE, ROW_SIZE, SPRING_SIZE, CONTACT_SIZE, HINGE_SIZE = 9, 11, 9, 6, 44, 8
"""Numbers of a section (x, y, theta and two rates), a frame (x, y, phi, cos, sin, then two rates of x, y, phi), a cut's
row (residual, two rates, Jacobian by the two twists), a spring (see :mod:`kaneflex.generated.joints`), a contact (see
:mod:`kaneflex.multibody.contacts`), and a factorised joint: what it moves along at its section (3), the articulated
inertia times that (3), 1 over what resists its coordinate, and whether there is one."""

(
    KIND, BLOCK, FIRST, DOF, JOINT, MODAL, SHAPES, PARENT, INBOARD, COURSE_OF, SECTIONS, LAST, ROW, SQUARE, NUMBERS,
    DAMPED,
) = range(16)  # fmt: skip
"""Columns of ``bodies``, in the order of the tree: how far behind those of the first kind of bodies, the first pair of
shape counts, its kernels are; where its block of numbers begins; its joint's first coordinate, their count, the joint's
kind; its first modal coordinate and their count; the section that it hangs on and its own there; the course that
prescribes its joint, or -1; its first section and the one after its last; where its rows begin in forces over all
bodies' speeds, and its square in matrices; its joint's numbers: sign, angle, and direction in the parent section's
axes; where its shapes' damping matrix begins."""
OWNER, POINT, JACOBIAN = range(3)
"""Columns of ``sections``: the body, or -1; where its block of numbers begins; where its W begins."""
WHAT, AT, ON, COURSE_AT, ROW_AT, NUMBERS_AT = range(6)
LAW = COURSE_AT
"""Columns of ``acts`` (cuts, holds, drives, loads, springs, contacts): its kind; two sections; a cut's course or -1,
a drive's coordinate or -1, 0 or -1 for a spring at a joint of the tree or elsewhere, a contact's law; a cut's first
row, a hold's or a contact's row; its numbers: a cut's direction and angle, a drive's or a load's direction, a
spring's k, c, free length or angle, a contact's (:mod:`kaneflex.generated.contact`), a hold's
(:mod:`kaneflex.multibody.holds`)."""

WELD, REVOLUTE, PRISMATIC, FREE, TURN, SLIDE, ALONG = range(7)
"""Kinds of joints in the tree; cuts have the first three, and drives of cut joints TURN and SLIDE, as drives have;
holds these two, or ALONG a contact's face."""
FORCE_ALONG, FOLLOWER, TORQUE = range(3)
"""Kinds of loads: along a global direction, along one that turns with the second section, between two sections."""
STRAIGHT, TORSIONAL = range(2)
"""Kinds of springs."""
FLANK, SWITCH = 2, -1
"""Kinds of contacts: of flanks, by its number in :data:`kaneflex.generated.contact.KINDS`, and of what stands among
them and touches nothing: an argument of loads' laws, which change where it passes zero. Its sections are the ground's,
its number among its like is in ROW_AT."""
ABOVE, BELOW, STAYS = 0.0, -1.0, -2.0
"""BEGUN_AT of a switch: the side of zero on which the laws are, or whether it stays at zero."""
(
    GAP, GAP_RATE, NORMAL_X, NORMAL_Y, PLACE_X, PLACE_Y, SLIDING, NORMAL_TURN, PUSH_NOW, ELASTIC, LOSING,
    BEGUN_AT, ALLOWED, STIFF, VISCOUS, RESISTING_MASS, SINCE, APPROACH, IMPULSE, PEAK, LOST_BEFORE, DUE,
    BEGAN_X, BEGAN_Y, NODES,
) = range(25)  # fmt: skip
"""Numbers of a contact: what :func:`kaneflex.generated.contact.gap` stores; its force, stored energy and loss; whether
it is closed, and the approach speed of its law (see :mod:`kaneflex.multibody.contacts`); the error allowed in its gap;
k and c of the factors; the mass that resists along its normal; of the impact that goes on its instant, approach speed,
impulse, peak force and what was lost before; how it changes at the end of this step; where the impact began; then a
step's nodes."""
(
    PLACE, SLIP, SLIP_RATE, NORMAL, LIMIT, HOLDING, SPEED_SIZE, BEFORE, FIRMEST,
    MODE, STUCK_AT, SLOPE, BY_SPEED, DECAY, BY_PRESS, JAMS,
) = *range(9), *range(BEGUN_AT, BEGUN_AT + 7)  # fmt: skip
"""Numbers of a hold (:mod:`kaneflex.multibody.holds`): where it is along its row, its speed and acceleration there;
what presses it on, the largest force that holds it, the one that it exerts; how large the speeds are whose difference
its own is; the force that it exerted before; the largest g of bristles since its sides touch; whether it slips or
sticks; where it stuck, or how far its bristles are bent; what damps it; of the rate of bristles its derivatives by
speed, by how they are bent (against it) and by what presses; when it first pressed its sides into each other. As of
contacts, DUE and NODES follow; of bristles a node has speed, g, how they are bent, force."""
BORE = FIRMEST
"""Of a hold that sticks, which has no bristles: the force that it exerted where it is to let go."""
(
    PRECISION, EXTENT, FLIGHT, LOW, HIGH, TRIAL, TARGET, FOUND_AT, LAST_CHANGE, IN_A_ROW, HELD, RESTED, TRIES, AIM,
    SHARED,
) = range(15)  # fmt: skip
"""Numbers that contacts share: the error allowed in a gap as a share of how deep it becomes, the size of the mechanism
[m], the step [s] before they closed; a change that is looked for: steps before and after it, the one to try, its
contact and kind; when the last one was, and how many at one instant; one more than the number of the switch that its
load's law would hold at zero; whether others rest than before; how often a change was looked for; the step
[s] after which the next rigid sides meet, as things go; then every contact's gradient."""
ROOM, LARGEST = STIFF, ALLOWED
"""Of a switch: how far from zero it may be where it stays there, and the largest distance that it had."""
SHUT, SHIFT = STIFF, VISCOUS
"""Of a contact by Newton's law: whether dependent coordinates keep it closed; what is added to its gap where it left
another side without a speed. ALLOWED is the force [N] of it that is as good as none."""
WHEN, REACH, LEAST, PASSED, CHANGE_POINT = range(5)
"""Of change points: when the next one comes, or the last one came; the time [s] in which the motion leads from there to
where the loops are regular again, 0 where that is unknown; the least pivot of the cuts' derivatives where the last step
ended, 0 where it was too close; when the last one was passed. Then room for what is interpolated there."""
IMPACT_SIZE, MOST_IMPACTS = 10, 256
"""Numbers of an impact that is over: contact, its begin and end, approach speed, separation speed, impulse, peak force,
energy lost, x and y where it began; after how many Python is to take them. Their count is before them."""

(
    BODIES, COORDINATES, SPEEDS, REACTIONS, CUT_ROWS, JOINT_ROWS, RIGID, WORKS, KEPT, BENDS, LED,
    CUTS, HOLDS, DRIVES, LOADS, SPRINGS, CONTACTS, ACTS, YIELDING, SLOPED, PASSING,
    Y, RATE, ACCEL, SECTION, LOCAL, FRAME, FORCE, CUT, COURSE, X, SIZE, SPRING, SUMS, NOW, JOINTS, DEMAND, POWER,
    GRAVITY, STIFFNESS, DAMPING, MEASURE, SCALE, RATE_SCALE, ACCEL_SCALE, INPUT,
    GRADIENT, LOOP, SIDE, W_NOW, LOOP_PIVOTS, ROW_OF, CUT_OF, DEPENDENT,
    CONTACT, TOUCH, CROSSING, IMPACTS, COMPLEMENT, TOUCHING,
    MASS, W, MIDDLE, MIDDLE_CUT, STAGE_A, STAGE_R, STAGE_P, STAGE_C, STAGE_H, LAST_A, LAST_R, RESISTING,
    WAYS, SLOPES, VARIED, SQUARES, HINGES, COLUMNS, SCHUR, PUSH, REACTION, WANTED, SLOPE_COLUMNS, SLOPE_SQUARE,
    SLOPE_FORCES, PIVOTS, PAIR_PIVOTS, WITH_SLOPES, SLOPE_PIVOTS, SLOPE_PAIR_PIVOTS, PLAN,
) = range(91)  # fmt: skip
"""Places of ``plan``. Counts: bodies, coordinates, speeds of all bodies, reactions (of rows of the cuts, then of
contacts), rows of cuts and holds, those of cuts alone, contacts with reactions (all where some are by Newton's law),
works, kept rows; whether shapes are among the dependent coordinates; how many bodies, the first ones, no dependent
coordinate moves. Where in ``acts`` cuts, holds, drives, loads, springs and contacts begin and end; how many contacts
and holds, and how many loads and springs, the factors to come know, which compiled code counts; whether the step is
beside a change point. Where in ``w`` lie: the motion (coordinates, rates, accelerations), sections, points in their
bodies' axes, frames, forces over all speeds, cut rows, courses, drives' coordinates and rates, loads' sizes, springs,
sums, reactions of the cuts, forces at inboard sections, what every coordinate asks for, powers; gravity, what holds and
damps every coordinate, what counts as one in it, the errors allowed in it, its rate and its acceleration; what is added
to the loads' sizes, then to prescribed accelerations; the gradient of the kept rows, its dependent square, their right-
hand side, W of the sections now. Where in ``plan`` itself: that square's pivots, and of every kept row its number, its
cut, its dependent coordinate. In ``w`` again: contacts, the holds' numbers before them, what all contacts share,
numbers of change points, impacts that are over, room for what rigid sides exert at one instant; in ``plan`` contacts
and holds that the factors know (holds by numbers below zero), or contacts that touch; in ``w`` mass matrices and W at
the middle of a step, with its sections and cut rows; stages' accelerations, reactions, powers and rates of courses,
accelerations of holds, accelerations and reactions of the last step, and what its stages ask for; gradients of joints'
coordinates and springs, partial velocities of loads, slopes of loads and springs, sizes of loads elsewhere
(:mod:`kaneflex.multibody.slopes`). In factors: squares of all bodies, joints, coordinates by unit reactions of the kept
rows and in the last row the answer, what the reactions do to the cuts, forces, reactions, accelerations that holds are
to have, what a unit of each load and spring with slopes brings about, their matrix, their forces; in ``plan``, the
pivots of either factors, those loads and springs, the pivots of their matrices."""


class Tables(NamedTuple):
    """Of one mechanism: plan (int64), bodies, sections, acts (int64, by row and column), w (float64)."""

    plan: np.ndarray
    bodies: np.ndarray
    sections: np.ndarray
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
    """What lies there, and is never written by compiled code."""
    found = builder.load(place)
    found.set_metadata("invariant.load", builder.module.add_metadata([]))
    return found


@intrinsic
def apart(typing):
    """Keep the calling function one piece of machine code, not copied into every caller, with its loops as they stand.

    Unrolled and vectorised they would take most of the compiler's time, and gain nothing with a few shapes a body.
    """

    def mark(context, builder, sig, args):
        builder.function.attributes.add("noinline")
        builder.function.attributes.add("optsize")
        return context.get_dummy_value()

    return types.none(), mark


@intrinsic
def together(typing):
    """As :func:`apart`, of a function whose loops are long enough to be vectorised."""

    def mark(context, builder, sig, args):
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return types.none(), mark


@intrinsic
def shifted(typing, address, k):
    """The address of the k-th number from there."""

    def read(context, builder, sig, args):
        return builder.gep(args[0], [args[1]])

    return address(address, types.intp), read


@intrinsic
def address(typing, array):
    """Where the numbers of an array begin: read from there, no index is tested for counting from the end."""

    def read(context, builder, sig, args):
        return context.make_array(array)(context, builder, args[0]).data

    return CPointer(array.dtype)(array), read


N = CPointer(float64)
_BITS = 64
"""Of an address."""

COURSES, MAGNITUDES, DEFORM, PUSHED, JACOBIANS, INVERSE, INERTIA, ENERGY = range(8)
"""Places of kernels: of a structure's own, then of a body's, which follow there for every kind of body."""
STRUCTURE_KERNELS = {
    "courses": FunctionType(void(float64, N, N, int64)),
    "magnitudes": FunctionType(void(float64, N, int64, N, N, int64)),
}
BODY_KERNELS = {
    "deform": FunctionType(void(N, int64, N, N, N, int64, N, int64)),
    "push": FunctionType(void(N, int64, N, int64, *(float64,) * 5, N, int64)),
    "jacobian": FunctionType(void(N, int64, N, int64, float64, float64, N, int64)),
    "inverse": FunctionType(void(N, int64, N, N, N, int64, *(float64,) * 6, N, int64)),
    "inertia": FunctionType(void(N, int64, N, int64, float64, float64, N, int64)),
    "energy": FunctionType(UniTuple(float64, 2)(N, int64, N, N, int64, *(float64,) * 5, N)),
}
"""What ``kernels(axial, transverse)`` of :mod:`kaneflex.generated.body` makes of a body with so many shapes."""
_KERNELS = *STRUCTURE_KERNELS.values(), *BODY_KERNELS.values()


@intrinsic(prefer_literal=True)
def kernel(typing, kernels, which):
    """One of a structure's kernels, or of a body's (:func:`of_body`), to be called."""

    def read(context, builder, sig, args):
        found = _fixed_number(builder, builder.gep(args[0], [ir.Constant(ir.IntType(_BITS), which.literal_value)]))
        function = cgutils.create_struct_proxy(sig.return_type)(context, builder)
        function.jit_addr = builder.inttoptr(found, cgutils.voidptr_t)
        # Else every call would have a branch for functions that are not compiled yet.
        builder.assume(builder.icmp_unsigned("!=", function.jit_addr, cgutils.voidptr_t(None)))
        return function._getvalue()

    return _KERNELS[which.literal_value](kernels, which), read


class Handed(types.Type):
    """What compiled code is handed as one word, the address of a table of addresses: attributes of these types."""

    def __init__(self, name: str, **parts: types.Type) -> None:
        self.parts = parts
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
_PARTS = {
    "plan": Fixed(1), "bodies": Fixed(16), "sections": Fixed(3), "acts": Fixed(6), "w": N, "pivots": CPointer(int64),
    "kernels": CPointer(int64), "p": N, "real": N, "pair": Z,
}  # fmt: skip
MECHANISM, CONTACT_MECHANISM, HOLD_MECHANISM = (
    Handed(name, **_PARTS) for name in ("Mechanism", "Mechanism with contacts", "Mechanism with holds")
)
"""All that compiled code knows of a mechanism. ``pivots``: the plan once more, to be written; ``kernels``: addresses of
those of the structure and of its kinds of bodies, see :func:`kernel`; ``p``: the parameters of the structure's module;
``real``, ``pair``: room for factors."""


class Handle:
    """Arrays by their addresses in one table, and the address of that: of this process alone."""

    def __init__(self, *arrays: np.ndarray) -> None:
        self.arrays = arrays
        self._table = np.array([array.ctypes.data for array in arrays], np.int64)
        self.address = self._table.ctypes.data


@njit(**OPTIONS)
def of_body(m, b):
    """The kernels of a body's kind."""
    return shifted(m.kernels, m.bodies[b, KIND])


@njit(**OPTIONS)
def magnitude(x):
    """|Re x| + |Im x|: tells whether a pivot vanishes as well as the absolute value does, and takes no root."""
    return abs(x.real) + abs(x.imag)


@njit(**OPTIONS)
def larger(a, b):
    """The larger of two numbers, and not a number where one of them is none. (numba's own takes seconds to compile.)"""
    return a if a >= b or a != a else b


@njit(**OPTIONS)
def smaller(a, b):
    """The smaller of two numbers in the same way."""
    return a if a <= b or a != a else b


@njit(**OPTIONS)
def turned(w, theta, k):
    """Global components of the direction at ``k``, fixed in axes at the angle theta: most are the ground's."""
    if theta == 0.0:
        return w[k], w[k + 1]
    c, s = math.cos(theta), math.sin(theta)
    return c * w[k] - s * w[k + 1], s * w[k] + c * w[k + 1]
