"""Vectors as values in compiled code, and functions chosen by the types of their arguments.

A twist or a wrench has D numbers, 3 in the plane and 6 in space. Compiled code loads and stores it whole, as a tuple: a
tuple is D registers, so no loop is unrolled and no stores alias.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from typing import Any

from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model
from numba.types import CPointer, UniTuple

from kaneflex.multibody.compile.types import IN_ORDER, marked


class Vectors(types.Type):
    """Address of vectors of d numbers: ``v[j]`` is a tuple, ``v[j] = tuple`` stores it."""

    def __init__(self, dtype: types.Type, d: int) -> None:
        self.dtype, self.d = dtype, d
        super().__init__(f"Vectors({dtype}, {d})")


@register_model(Vectors)
class _VectorsModel(models.PrimitiveModel):
    def __init__(self, manager, of) -> None:
        super().__init__(manager, of, manager.lookup(of.dtype).get_data_type().as_pointer())


@infer_global(operator.getitem)
class _Get(AbstractTemplate):
    def generic(self, args, kws):
        v, k = args
        if isinstance(v, Vectors) and isinstance(k, types.Integer):
            return signature(UniTuple(v.dtype, v.d), v, types.intp)
        return None


@infer_global(operator.setitem)
class _Set(AbstractTemplate):
    def generic(self, args, kws):
        v, k, _ = args
        if isinstance(v, Vectors) and isinstance(k, types.Integer):
            return signature(types.none, v, types.intp, UniTuple(v.dtype, v.d))
        return None


def _places(builder, kind, v, k):
    """Addresses of the numbers of the k-th vector."""
    first = builder.gep(v, [builder.mul(k, ir.Constant(k.type, kind.d))])
    return [builder.gep(first, [ir.Constant(k.type, i)]) for i in range(kind.d)]


@lower_builtin(operator.getitem, Vectors, types.Integer)
def _load(context, builder, sig, args):
    kind = sig.args[0]
    found = [context.unpack_value(builder, kind.dtype, place) for place in _places(builder, kind, *args)]
    return context.make_tuple(builder, sig.return_type, found)


@lower_builtin(operator.setitem, Vectors, types.Integer, UniTuple)
def _store(context, builder, sig, args):
    kind = sig.args[0]
    for place, value in zip(_places(builder, kind, *args[:2]), cgutils.unpack_tuple(builder, args[2]), strict=True):
        context.pack_value(builder, kind.dtype, value, place)
    return context.get_dummy_value()


@intrinsic
def after(typing, v, k):
    """The vectors, or numbers, from the k-th one on."""
    step = getattr(v, "d", 1)

    def move(context, builder, sig, args):
        return builder.gep(args[0], [builder.mul(args[1], ir.Constant(args[1].type, step))])

    return v(v, types.intp), move


@intrinsic
def numbers_of(typing, v):
    """Numbers of vectors, one vector after the other."""
    return CPointer(v.dtype)(v), lambda context, builder, sig, args: args[0]


@intrinsic
def vectors(typing, numbers):
    """Numbers from an address on as vectors of three."""
    return Vectors(numbers.dtype, 3)(numbers), lambda context, builder, sig, args: args[0]


@intrinsic
def twists(typing, m, numbers):
    """Numbers from an address on as twists or wrenches of a mechanism."""
    return Vectors(numbers.dtype, m.d)(m, numbers), lambda context, builder, sig, args: args[1]


@intrinsic
def width(typing, of):
    """D of vectors or of a mechanism, as a constant."""
    d = size_of(of)
    return types.intp(of), lambda context, builder, sig, args: ir.Constant(ir.IntType(64), d)


@intrinsic
def inline(typing):
    """Copy the calling function into its callers, for a few operations on values or a record of addresses."""
    return marked("alwaysinline")


def size_of(kind: types.Type) -> int:
    """D of the type of vectors or of one vector; 0 for other types."""
    return getattr(kind, "d", 0) or (kind.count if isinstance(kind, UniTuple) else 0)


def chosen(choose: Callable[[Sequence[types.Type]], Any], like: Any) -> Any:
    """One name for several compiled functions: the one that ``choose`` returns for the types of the arguments.

    ``like``: one of them; it becomes that name, and is compiled for its own types as before.
    """
    template, overload = like.get_call_template, like.get_overload

    def template_of(args, kws):
        function = choose(args)
        return (template if function is like else function.get_call_template)(args, kws)

    def overload_of(sig):
        args = sig.args if hasattr(sig, "args") else sig
        function = choose(args)
        return (overload if function is like else function.get_overload)(sig)

    like.get_call_template, like.get_overload = template_of, overload_of
    like.choose = choose  # for the C printer
    return like


def by_size(plane: Any, space: Any) -> Any:
    """One name for a function of vectors, or of a mechanism, in the plane and one in space."""
    return chosen(lambda args: plane if max(map(size_of, args)) == 3 else space, plane)


@njit(**IN_ORDER)
def row_length(m):
    """Numbers of a cut's row: residual, two rates, Jacobian by two twists."""
    inline()
    return 3 + 2 * width(m)


@njit(**IN_ORDER)
def copy(of, out, count):
    """Copy numbers or vectors, real ones also into complex ones."""
    inline()
    for k in range(count):
        out[k] = of[k]
