"""LANES numbers in one vector register: what compiled code reads, writes and calculates with eight at a time.

numba's types and LLVM's instructions stay in this file.
"""

import operator

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

from kaneflex.integrate.conventions import FASTMATH, LANES
from kaneflex.support.inner import PART

VECTOR = ir.VectorType(ir.DoubleType(), LANES)
_INT = ir.IntType(32)
ZERO, ONE = np.uint64(0), np.uint64(1)
"""Unsigned numbers, which numba need not test for a negative index; with a signed number they become a float."""
compiled = njit(error_model="numpy", fastmath=FASTMATH, _nrt=False, **PART)
"""Decorator of parts that are compiled into the functions that call them."""


class _Lanes(types.Type):
    """LANES numbers in a register: numba's type of them."""


_lanes = _Lanes("Lanes")


@register_model(_Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, VECTOR)


def _broadcast(context, builder, kind, value):
    """A number in every lane."""
    if kind == _lanes:
        return value
    undefined = ir.Constant(VECTOR, ir.Undefined)
    first = builder.insert_element(undefined, context.cast(builder, value, kind, types.float64), _INT(0))
    return builder.shuffle_vector(first, undefined, ir.Constant(ir.VectorType(_INT, LANES), [0] * LANES))


def _make_operator(function, instruction):
    """An operator between lanes, and between lanes and a number."""

    @infer_global(function)
    class _Template(AbstractTemplate):
        def generic(self, args, kws):
            known = all(isinstance(kind, _Lanes | types.Number) for kind in args)
            return signature(_lanes, *args) if _lanes in args and known else None

    def lower(context, builder, sig, args):
        spread = (_broadcast(context, builder, kind, value) for kind, value in zip(sig.args, args, strict=True))
        return getattr(builder, instruction)(*spread, flags=sorted(FASTMATH))

    for kinds in ((_Lanes, _Lanes), (_Lanes, types.Number), (types.Number, _Lanes)):
        lower_builtin(function, *kinds)(lower)


for _functions, _instruction in (
    ((operator.add, operator.iadd), "fadd"), ((operator.sub, operator.isub), "fsub"),
    ((operator.mul, operator.imul), "fmul"), ((operator.truediv,), "fdiv"),
):  # fmt: skip
    for _function in _functions:
        _make_operator(_function, _instruction)


def address(context, builder, kinds, array, place):
    """Address of the lanes of a contiguous array at an index, or (row, index)."""
    kind, where = kinds
    values = context.make_array(kind)(context, builder, array)
    if isinstance(where, types.BaseTuple):
        row, index = (builder.extract_value(place, k) for k in range(2))
        place = builder.add(builder.mul(row, builder.extract_value(values.shape, 1)), index)
    start = builder.gep(values.data, [builder.mul(place, place.type(LANES))])
    return builder.bitcast(start, ir.PointerType(VECTOR))


@intrinsic
def load(typing, array, place):
    """Lanes ``array[place]``; the array has one axis more than the place."""

    def lower(context, builder, sig, args):
        return builder.load(address(context, builder, sig.args, *args), align=8)

    return _lanes(array, place), lower


@intrinsic
def store(typing, array, place, value):
    """``array[place] = value``; a number goes into every lane."""

    def lower(context, builder, sig, args):
        *where, number = args
        *kinds, kind = sig.args
        number = _broadcast(context, builder, kind, number)
        builder.store(number, address(context, builder, kinds, *where), align=8)
        return context.get_dummy_value()

    return types.void(array, place, value), lower


@intrinsic
def lane_sum(typing, lanes):
    """The sum over the lanes."""

    def lower(context, builder, sig, args):
        number = ir.DoubleType()
        shape = ir.FunctionType(number, [number, VECTOR])
        add = cgutils.get_or_insert_function(builder.module, shape, f"llvm.vector.reduce.fadd.v{LANES}f64")
        return builder.call(add, [number(-0.0), *args], fastmath=sorted(FASTMATH))

    return types.float64(lanes), lower


def _shuffle(builder, one, other, order):
    """Lanes of two registers: those of the other one are counted from LANES on."""
    return builder.shuffle_vector(one, other, ir.Constant(ir.VectorType(_INT, LANES), order))


def _butterfly(half):
    """Sums and differences of the lanes that are `half` apart."""
    order = [k ^ half for k in range(LANES)]
    signs = ir.Constant(VECTOR, [-1.0 if k & half else 1.0 for k in range(LANES)])

    @intrinsic
    def butterfly(typing, lanes):
        def lower(context, builder, sig, args):
            flags, there = sorted(FASTMATH), _shuffle(builder, args[0], args[0], order)
            return builder.fadd(builder.fmul(signs, args[0], flags=flags), there, flags=flags)

        return lanes(lanes), lower

    return butterfly


butterfly_4, butterfly_2, butterfly_1 = (_butterfly(half) for half in (4, 2, 1))


@intrinsic
def mirrored(typing, first, others):
    """Lane 0 of `first`; in the other lanes those of `others` that hold the harmonics LANES - r, see `fourier`."""

    def lower(context, builder, sig, args):
        return _shuffle(builder, *args, [0, *(LANES + k for k in (1, 3, 2, 7, 6, 5, 4))])

    return first(first, others), lower


@intrinsic
def stay_apart(typing):
    """The function in which this stands is not compiled into each that calls it, which would take LLVM long."""

    def lower(context, builder, sig, args):
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return types.void(), lower


def _unary(name):
    """LLVM intrinsic `name` of a number, in each lane."""

    def lower(context, builder, sig, args):
        which = f"llvm.{name}.v{LANES}f64" if sig.args[0] == _lanes else f"llvm.{name}.f64"
        shape = ir.FunctionType(args[0].type, [args[0].type])
        return builder.call(cgutils.get_or_insert_function(builder.module, shape, which), args)

    return lower


@intrinsic
def absolute(typing, number):
    """The absolute value, in each lane."""
    return number(number), _unary("fabs")


@intrinsic
def root(typing, number):
    """The square root, in each lane."""
    return number(number), _unary("sqrt")


@intrinsic
def less(typing, small, large):
    """1.0 in each lane where `small` is less, else, also where one is no number, 0.0."""

    def lower(context, builder, sig, args):
        pair = (_broadcast(context, builder, kind, value) for kind, value in zip(sig.args, args, strict=True))
        return builder.uitofp(builder.fcmp_ordered("<", *pair), VECTOR)

    return _lanes(small, large), lower


@intrinsic
def everywhere(typing, true):
    """True if the condition holds in every lane."""

    def lower(context, builder, sig, args):
        zero = ir.Constant(VECTOR, [0.0] * LANES)
        mask = builder.bitcast(builder.fcmp_ordered("!=", args[0], zero), ir.IntType(LANES))
        return builder.icmp_unsigned("==", mask, mask.type(2**LANES - 1))

    return types.boolean(true), lower
