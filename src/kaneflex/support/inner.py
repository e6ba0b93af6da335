"""Compilation by numba of functions that only other compiled functions call, and faster compilation of all functions.

Compiled functions are the same, but repeated work is done once, or less often. Half of numba's own work is the search
for the signature of each operator: it tries all known implementations until one matches. In addition, garbage
collection repeatedly searches objects that live as long as the compiler.

A compiled function of kaneflex is read from numba's cache without preparing numba to compile, which takes longer than
reading ten functions. The compiler is prepared when it first compiles.
"""

from __future__ import annotations

import gc
from functools import cache
from typing import Any

from numba.core import types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import LoweringPass, register_pass
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


@cache
def _use() -> None:
    """Make numba compile this way from now on; once per process."""
    from numba.core import caching, event

    event.register("numba:compile", _while_compiling(event.Listener))
    cache_of_functions: Any = caching.FunctionCache
    cache_of_functions.load_overload = _reading_only(cache_of_functions.load_overload)


@cache
def prepare() -> None:
    """Prepare numba before the first function that a process compiles."""
    from numba import types
    from numba.core.dispatcher import Dispatcher

    library: Any = JITCodeLibrary
    library.add_linking_library = _link_parts
    function: Any = types.Function
    function.get_call_type = _remembering(function.get_call_type)
    _compile_parts_within_callers(Dispatcher)


def _reading_only(load: Any) -> Any:
    """Replace numba's ``load(cache, sig, context)`` of a compiled function by one without ``context.refresh()``.

    The refresh imports and registers everything that numba can compile. A compiled function needs only the symbols
    of numba's runtime, and its caller the type of functions by address, which only the refresh registers. Functions
    of other packages may need more and are read as numba reads them.
    """
    import numba.experimental.function_type  # noqa: F401
    from numba.core.runtime import rtsys

    def load_overload(self, sig, context):
        if not (self._py_func.__module__ or "").startswith("kaneflex"):  # that of a lambdified function is None
            return load(self, sig, context)
        rtsys.initialize(context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, context)

    return load_overload


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


def _remembering(find: Any) -> Any:
    """Cache numba's ``find(function, context, args, kws)``, its search for a signature, for numbers, arrays and tuples.

    Only numba's own implementations are cached, by the function's key: functions compiled for a call depend on more
    than types. Each hit stores the key again, as a search does, since another search may have overwritten it.
    """
    from numba import types

    found: dict[Any, Any] = {}

    def plain(kind: Any) -> bool:
        if isinstance(kind, types.BaseTuple):
            return all(map(plain, kind))
        return isinstance(kind, types.Number | types.Boolean | types.Array)

    def get_call_type(self, context, args, kws):
        if kws or not all(map(plain, args)):
            return find(self, context, args, kws)
        asked = context, self, tuple(args)
        signature = found.get(asked)
        if signature is not None:
            self._impl_keys[signature.args] = self.typing_key
            return signature
        signature = find(self, context, args, kws)
        if self._impl_keys[signature.args] is self.typing_key:
            found[asked] = signature
        return signature

    return get_call_type


def _while_compiling(listener: Any) -> Any:
    """Make a listener that prepares numba, and raises the thresholds of garbage collection while numba compiles."""

    class WhileCompiling(listener):
        deep = 0

        def on_start(self, event: Any) -> None:
            prepare()
            if self.deep == 0:
                self.often = gc.get_threshold()
                gc.set_threshold(*_SELDOM if self.often[0] else self.often)
            self.deep += 1

        def on_end(self, event: Any) -> None:
            self.deep -= 1
            if self.deep == 0:
                gc.set_threshold(*self.often)

    return WhileCompiling()


_SELDOM = 50_000, 20, 100
"""Thresholds of garbage collection (new objects for each generation) that do not increase the memory in use."""


_use()
