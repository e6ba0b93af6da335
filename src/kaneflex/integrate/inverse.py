"""Inverses of small matrices in lanes, written out: no loop, no addresses to calculate, few numbers leave registers."""

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from kaneflex.integrate.conventions import FASTMATH, LANES
from kaneflex.integrate.lanes import VECTOR, address
from kaneflex.integrate.matrices import SMALLEST_PIVOT

_FLAGS = sorted(FASTMATH)


@intrinsic
def invert(typing, order, matrix, scale, good):
    """The inverse in place, by Gauss-Jordan elimination without pivoting (Press et al. 2007, section 2.1).

    order: a tuple of as many numbers, of which none matters: compiled code knows how many
    matrix: entry (i, j) in slot LANES * j + i
    scale: of each row, sum of the absolute values of what was added up in the diagonal
    good: one number, 1.0 where no pivot vanishes, else 0.0
    """
    n = len(order)

    def lower(context, builder, sig, args):
        shape = ir.FunctionType(VECTOR, [VECTOR])
        size = cgutils.get_or_insert_function(builder.module, shape, f"llvm.fabs.v{LANES}f64")

        def pointer(which, slot):
            return address(context, builder, (sig.args[which], types.intp), args[which], ir.IntType(64)(slot))

        def times(a, b):
            return builder.fmul(a, b, flags=_FLAGS)

        m = [[builder.load(pointer(1, LANES * j + i), align=8) for j in range(n)] for i in range(n)]
        one, smallest = ir.Constant(VECTOR, [1.0] * LANES), ir.Constant(VECTOR, [SMALLEST_PIVOT] * LANES)
        regular = ir.Constant(ir.VectorType(ir.IntType(1), LANES), [1] * LANES)
        for k in range(n):
            others = [i for i in range(n) if i != k]
            least = times(smallest, builder.load(pointer(2, k), align=8))
            regular = builder.and_(regular, builder.fcmp_ordered("<", least, builder.call(size, [m[k][k]])))
            reciprocal = builder.fdiv(one, m[k][k], flags=_FLAGS)
            for j in others:
                m[k][j] = times(m[k][j], reciprocal)
                for i in others:
                    m[i][j] = builder.fsub(m[i][j], times(m[i][k], m[k][j]), flags=_FLAGS)
            for i in others:
                m[i][k] = times(builder.fneg(m[i][k]), reciprocal)
            m[k][k] = reciprocal
        for i in range(n):
            for j in range(n):
                builder.store(m[i][j], pointer(1, LANES * j + i), align=8)
        builder.store(builder.uitofp(regular, VECTOR), pointer(3, 0), align=8)
        return context.get_dummy_value()

    return types.void(order, matrix, scale, good), lower
