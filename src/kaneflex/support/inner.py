"""Compilation by numba of functions that only other compiled functions call.

numba optimises every function separately, with its callees. Here a part is compiled with its callers only.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from numba.core import types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import LoweringPass, register_pass
from numba.core.dispatcher import Dispatcher
from numba.core.typed_passes import NativeLowering
from numba.extending import intrinsic


class PartLibrary(JITCodeLibrary):
    """LLVM code of one function alone; the function that encloses it links, optimises and compiles it."""

    def finalize(self) -> None:
        self._finalized = True


def _link_parts(library: Any, called: Any) -> None:
    """Add to a library what it calls and, where that is a part, what the part calls.

    LLVM skips what nothing calls yet, so callers come first. numba's own method links every part again in each caller.
    """
    called._ensure_finalized()
    if called not in library._linking_libraries:
        needed = dict.fromkeys([called, *(called._linking_libraries if isinstance(called, PartLibrary) else ())])
        library._linking_libraries = [each for each in library._linking_libraries if each not in needed] + [*needed]


@register_pass(mutates_CFG=False, analysis_only=False)
class _Registered(LoweringPass):
    """Let other functions call this one, which has no machine code of its own."""

    _name = "registered_for_callers"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state) -> bool:
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
        passes.add_pass_after(_Registered, NativeLowering)
        passes.finalize()
        return [passes]


PART = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "no_rewrites": True, "pipeline_class": Inner}
"""Options of a function that only compiled functions call: it is optimised with them and not by itself."""


@intrinsic
def shifted(typing, address, k):
    """Address of the k-th number from there."""

    def read(context, builder, sig, args):
        return builder.gep(args[0], [args[1]])

    return address(address, types.intp), read


def once(dispatcher):
    """Compile a function once for all integers; by default numba compiles it for every constant integer argument."""
    of_types = dispatcher.get_call_template
    dispatcher.get_call_template = lambda args, kws: of_types(tuple(map(types.unliteral, args)), kws)
    return dispatcher


def _compile_parts_within_callers(dispatcher: Any) -> None:
    """Compile generated kernels as parts of the compiled functions that call them.

    By default a kernel is also optimised and cached separately, with an entry for Python: twice the work. A kernel
    that Python calls is compiled for Python then.
    """

    @cache
    def part(kernel: Any) -> Any:
        if not (kernel.py_func.__module__ or "").startswith(("kaneflex.generated.", "kaneflex_")):
            return kernel
        options = kernel.targetoptions | PART
        return type(kernel)(kernel.py_func, pipeline_class=options.pop("pipeline_class"), targetoptions=options)

    for name in ("get_call_template", "get_overload"):
        find = getattr(dispatcher, name)
        setattr(dispatcher, name, lambda kernel, *types, find=find: find(part(kernel), *types))


_compile_parts_within_callers(Dispatcher)
JITCodeLibrary.add_linking_library = _link_parts
