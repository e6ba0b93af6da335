"""Types that compiled functions receive, numba's options for them, and their smallest functions."""

from __future__ import annotations

import math
import operator

from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.imputils import lower_getattr_generic
from numba.core.typing.templates import AbstractTemplate, AttributeTemplate, infer_getattr, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model
from numba.types import CPointer, FunctionType, UniTuple, complex128, float64, int64

from kaneflex.multibody.model.layout import STRUCTURE_KERNELS
from kaneflex.support.inner import Inner
from kaneflex.support.inner import shifted as shifted  # for the engine's functions

_AS_WRITTEN = {"nsz", "arcp", "contract", "afn"}
"""Compiler flags for sums that keep the order of terms."""
OUTER = {"error_model": "numpy", "fastmath": _AS_WRITTEN | {"reassoc"}}
ENTRY = OUTER | {"_nrt": False, "no_cpython_wrapper": True, "no_rewrites": True, "pipeline_class": Inner}
"""Numba options of functions that Python calls by their addresses: see :mod:`kaneflex.multibody.compile.library`."""
OPTIONS = ENTRY | {"no_cfunc_wrapper": True}
"""Numba options of functions called by compiled code: they allocate nothing, so nothing is reference-counted."""
IN_ORDER = OPTIONS | {"fastmath": _AS_WRITTEN}
"""Numba options with sums in textual order, for numbers just written one by one: vectorised reading would stall."""


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


def marked(*attributes):
    """Signature and code of an intrinsic that gives the calling function these attributes of LLVM's."""

    def mark(context, builder, sig, args):
        for each in attributes:
            builder.function.attributes.add(each)
        return context.get_dummy_value()

    return types.none(), mark


@intrinsic
def no_inline(typing):
    """Keep the calling function one piece of machine code, not inlined, with its loops as written.

    Unrolling and vectorising would take most of the compiler's time without gain for a few shapes per body.
    """
    return marked("noinline", "optsize")


@intrinsic
def no_inline_vectorised(typing):
    """As :func:`no_inline`, for functions with loops long enough to be vectorised."""
    return marked("noinline")


@intrinsic
def address(typing, array):
    """Address of an array's first number: reading from it needs no check for negative indices."""

    def read(context, builder, sig, args):
        return context.make_array(array)(context, builder, args[0]).data

    return CPointer(array.dtype)(array), read


N = CPointer(float64)
_BITS = 64
"""Bits of an address."""
_KERNELS = (*(FunctionType(eval(each, vars(types))) for each in STRUCTURE_KERNELS.values()),)


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


@njit(**OPTIONS)
def basis(c, x, i):
    """Lagrange polynomial i of three nodes at x."""
    j, k = (i + 1) % 3, (i + 2) % 3
    return (x - c[j]) * (x - c[k]) / ((c[i] - c[j]) * (c[i] - c[k]))
