"""How those functions are compiled that only other compiled functions call, and how numba does that faster."""

from __future__ import annotations

import gc
import operator
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from numba.core import types
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import LoweringPass, register_pass
from numba.core.errors import NumbaExperimentalFeatureWarning
from numba.core.registry import cpu_target
from numba.core.typed_passes import InlineOverloads, NativeLowering
from numba.core.untyped_passes import InlineClosureLikes


@register_pass(mutates_CFG=False, analysis_only=False)
class _Registered(LoweringPass):
    """Let other functions call this one, for which no machine code of its own was made."""

    _name = "registered_for_callers"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state) -> bool:
        state.library._optimize_final_module = _with_the_caller
        state.library._finalize_final_module = partial(setattr, state.library, "_finalized", True)
        name = list[object]().append  # numba wants a builtin of its own for every function, and never calls it
        state["cr"] = state["cr"]._replace(cfunc=name)
        state.targetctx.insert_user_function(name, state["cr"].fndesc, [state.library])
        return True


class Inner(CompilerBase):
    """numba's compiler without its last stage.

    numba optimises every function by itself, with all that it calls, and makes machine code of it that nothing enters.
    """

    def define_pipelines(self):
        self.state.flags = self.state.flags.copy()
        self.state.flags.no_compile = True
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state, "inner")
        passes.passes = [(each, about) for each, about in passes.passes if each not in _NOT_NEEDED]
        passes.add_pass_after(_Registered, NativeLowering)
        passes.finalize()
        return [passes]


def once(dispatcher):
    """Compile a function once for all integers, where numba does so for every constant that a caller gives it."""
    of_types = dispatcher.get_call_template
    dispatcher.get_call_template = lambda args, kws: of_types(tuple(map(types.unliteral, args)), kws)
    return dispatcher


_NOT_NEEDED = (InlineClosureLikes, InlineOverloads)
"""Passes for functions within functions, of which there are none."""


def _with_the_caller() -> None:
    """Optimised, and made machine code of, is what encloses this."""


@contextmanager
def compiling() -> Iterator[None]:
    """While numba compiles: what it does over and over is done less often, and function types are used without a word.

    A compiler makes objects that live as long as it does: the collector of garbage would go through all of them again
    and again, a fifth of the time.
    """
    context = cpu_target.typing_context
    context.refresh()  # before it is the first time numba knows no operators
    for each in _OPERATORS:
        _remember(context.resolve_value_type(each))
    often = gc.get_threshold()
    gc.set_threshold(*_SELDOM if often[0] else often)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NumbaExperimentalFeatureWarning)
            yield
    finally:
        gc.set_threshold(*often)


_SELDOM = 50_000, 20, 100
"""Objects more after which the youngest are gone through, and so on: as seldom, and no more memory is taken."""
_OPERATORS = (
    operator.add, operator.sub, operator.mul, operator.truediv, operator.neg, operator.iadd, operator.isub,
    operator.imul, operator.lt, operator.le, operator.gt, operator.ge, operator.eq, operator.ne, bool,
)  # fmt: skip


def _remember(function: Any) -> None:
    """Have numba find once what an operator is of numbers of these types, where it would at every place in a text."""
    if "get_call_type" in vars(function) or any(each.prefer_literal for each in function.templates):
        return
    find, found = function.get_call_type, {}

    def get_call_type(context, args, kws):
        if kws or not all(isinstance(arg, (types.Number, types.Boolean)) for arg in args):
            return find(context, args, kws)
        if args not in found:
            found[args] = find(context, args, kws)
        return found[args]

    function.get_call_type = get_call_type
