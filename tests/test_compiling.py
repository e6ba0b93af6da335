"""While the engine is compiled: numba's operators are what they were, and garbage is collected afterwards as before."""

import gc
import itertools
import operator

import pytest
from numba import types
from numba.core.registry import cpu_target

from kaneflex.multibody.inner import compiling

KINDS = (
    types.boolean, types.int64, types.uint8, types.literal(3), types.literal(-1), types.float32, types.float64,
)  # fmt: skip


@pytest.mark.parametrize("often", [(700, 10, 10), (0, 10, 10)])
def test_garbage_is_collected_as_before(often):
    """Also where what is compiled is wrong, and where a program collects none."""
    before = gc.get_threshold()
    gc.set_threshold(*often)
    try:
        with pytest.raises(ArithmeticError), compiling():
            assert (gc.get_threshold()[0] > often[0]) == (often[0] > 0)
            raise ArithmeticError
        assert gc.get_threshold() == often
    finally:
        gc.set_threshold(*before)


@pytest.mark.parametrize("name", ["add", "sub", "mul", "truediv", "iadd", "eq", "ne", "lt", "ge"])
def test_a_remembered_operator_is_the_one_that_numba_finds(name):
    """For every two kinds of numbers, whichever came before, and for arrays, which are not remembered."""
    context, kinds = cpu_target.typing_context, [*KINDS, *[types.complex128] * (name not in ("lt", "ge"))]
    with compiling():
        found = context.resolve_value_type(getattr(operator, name))
        for _ in range(2):
            for pair in (*itertools.product(kinds, kinds), (types.float64[::1], types.float64)):
                own = type(found).get_call_type(found, context, pair, {})
                kept = found.get_call_type(context, pair, {})
                assert (kept.return_type, kept.args) == (own.return_type, own.args), pair
    assert "get_call_type" in vars(found)
