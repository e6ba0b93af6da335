"""How numba compiles faster: what it does over and over meanwhile is done once, or less often.

What is compiled is the same. Half of numba's own work is finding out, at every place in a text, what an operator is of
its types, by asking all that numba knows of the operator until one answers; and the collector of garbage goes through
objects that live as long as the compiler does again and again.

A compiled function of kaneflex is read from numba's cache without preparing numba to compile, which takes longer than
reading ten of them. The compiler prepares itself when it has something to compile.
"""

from __future__ import annotations

import gc
from functools import cache
from typing import Any


@cache
def use() -> None:
    """Have numba compile so from now on: once in a process."""
    from numba.core import caching, event

    event.register("numba:compile", _while_compiling(event.Listener))
    cache_of_functions: Any = caching.FunctionCache
    cache_of_functions.load_overload = _reading_only(cache_of_functions.load_overload)


@cache
def prepare() -> None:
    """Change how numba compiles: before the first function that a process compiles."""
    from numba import types
    from numba.core.dispatcher import Dispatcher

    from kaneflex.support import numba_shortcuts  # only here: reading compiled functions needs none of it

    function: Any = types.Function
    function.get_call_type = _remembering(function.get_call_type)
    _compile_parts_within_callers(Dispatcher)
    numba_shortcuts.use()


def _reading_only(load: Any) -> Any:
    """``load(cache, sig, context)``, numba's reading of a compiled function, without ``context.refresh()``.

    The refresh imports and registers all that numba can compile. Of this a compiled function needs the symbols of
    numba's runtime alone, and its caller the type of functions by address, the one type that numba knows only then.
    Functions of other packages may need more and are read as numba reads them.
    """
    import numba.experimental.function_type  # noqa: F401
    from numba.core.runtime import rtsys

    def load_overload(self, sig, context):
        if not self._py_func.__module__.startswith("kaneflex"):
            return load(self, sig, context)
        rtsys.initialize(context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, context)

    return load_overload


def _compile_parts_within_callers(dispatcher: Any) -> None:
    """Have generated kernels that a compiled function calls compiled as parts of it, see :mod:`support.inner`.

    By itself a kernel is optimised and cached as well, and gets an entry from Python: twice the work, for nothing
    unless Python calls it, too. Then it is compiled for that.
    """
    from kaneflex.support.inner import PART

    @cache
    def part(kernel: Any) -> Any:
        if not kernel.py_func.__module__.startswith(("kaneflex.generated.", "kaneflex_")):
            return kernel
        options = kernel.targetoptions | PART
        return type(kernel)(kernel.py_func, pipeline_class=options.pop("pipeline_class"), targetoptions=options)

    for name in ("get_call_template", "get_overload"):
        find = getattr(dispatcher, name)
        setattr(dispatcher, name, lambda kernel, *types, find=find: find(part(kernel), *types))


def _remembering(find: Any) -> Any:
    """``find(function, context, args, kws)``, numba's search for a signature, once for numbers, arrays and tuples.

    Only what numba has of its own is remembered, by the function's own key: what it compiles for a call depends on more
    than types. The key is said anew, as a search does, for another search may have said another since.
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
    """A listener that prepares numba, and changes the collector's thresholds while numba compiles."""

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
"""Objects more after which the youngest are gone through, and so on: as seldom, and no more memory is taken."""
