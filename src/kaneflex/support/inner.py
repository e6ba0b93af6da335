"""Compilation of functions that only other compiled functions call."""

from __future__ import annotations

from numba.core import types
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import LoweringPass, register_pass
from numba.core.typed_passes import InlineOverloads, NativeLowering
from numba.core.untyped_passes import InlineClosureLikes

from kaneflex.support import quick_compiling, shipped_kernels


@register_pass(mutates_CFG=False, analysis_only=False)
class _Registered(LoweringPass):
    """Let other functions call this one, which has no machine code of its own."""

    _name = "registered_for_callers"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state) -> bool:
        from kaneflex.support.numba_shortcuts import PartLibrary  # which a process that compiles nothing never needs

        state.library.__class__ = PartLibrary
        name = list[object]().append  # numba wants a builtin of its own for every function, and never calls it
        state["cr"] = state["cr"]._replace(cfunc=name)
        state.targetctx.insert_user_function(name, state["cr"].fndesc, [state.library])
        return True


class Inner(CompilerBase):
    """Compiler of numba without its last stage.

    By default numba optimises every function separately, with its callees, and makes machine code that nobody calls.
    """

    def define_pipelines(self):
        self.state.flags = self.state.flags.copy()
        self.state.flags.no_compile = True
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state, "inner")
        passes.passes = [(each, about) for each, about in passes.passes if each not in _NOT_NEEDED]
        passes.add_pass_after(_Registered, NativeLowering)
        passes.finalize()
        return [passes]


PART = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "no_rewrites": True, "pipeline_class": Inner}
"""Options of a function that only compiled functions call: it is optimised with them and not by itself."""


def once(dispatcher):
    """Compile a function once for all integers; by default numba compiles it for every constant integer argument."""
    of_types = dispatcher.get_call_template
    dispatcher.get_call_template = lambda args, kws: of_types(tuple(map(types.unliteral, args)), kws)
    return dispatcher


_NOT_NEEDED = (InlineClosureLikes, InlineOverloads)
"""Compiler pass for nested functions, which are not used."""


shipped_kernels.use()
quick_compiling.use()
