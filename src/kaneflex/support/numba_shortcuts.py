"""Changes of numba for shorter compilation: answers are stored, and functions within others are linked once."""

from __future__ import annotations

from functools import cache
from inspect import unwrap
from typing import Any

from llvmlite.binding import ffi
from numba.core import base, codegen, targetconfig, utils


def use() -> None:
    """Store the answers that numba computes anew thousands of times."""
    ffi.lib._lock._cblist.clear()  # events that measure how long LLVM is locked, two for each call of LLVM
    library: Any = codegen.JITCodeLibrary
    library.add_linking_library = _link_parts
    context: Any = base.BaseContext
    context.get_abi_sizeof = _by(lambda self, kind: (self.target_data, str(kind)), context.get_abi_sizeof)
    context.refresh = _if_registered(context.refresh)
    flags: Any = targetconfig.TargetConfig
    flags.__hash__ = lambda self: hash(tuple(sorted(self.options)))  # numba's, without reading each value
    equal = flags.__eq__
    flags.__eq__ = lambda self, other: self._values == getattr(other, "_values", None) or equal(self, other)
    generator: Any = codegen.CPUCodegen
    generator._check_llvm_bugs = cache(generator._check_llvm_bugs)
    ordered: Any = utils.order_by_target_specificity
    utils.order_by_target_specificity = _by(lambda target, of, *_: (target, tuple(of)), ordered)
    base._has_loc = _by(lambda function: getattr(unwrap(function), "__code__", function), base._has_loc)


def _by(key: Any, find: Any) -> Any:
    """``find`` with its results stored by a key of its arguments."""
    found: dict[Any, Any] = {}

    def asked(*args, **named):
        if (name := key(*args)) not in found:
            found[name] = find(*args, **named)
        return found[name]

    return asked


def _if_registered(refresh: Any) -> Any:
    """``BaseContext.refresh`` of numba, which reads all lists of implementations, only where one of them has grown."""

    def known(context: Any) -> list[Any]:
        return [*context._registries, *context.typing_context._registries]

    def refreshed(self: Any) -> None:
        lists, count = vars(self).get("_read", ((), -1))
        if count != sum(map(len, lists)) + len(known(self)):
            refresh(self)
            lists = [items for registry in known(self) for items in vars(registry).values() if type(items) is list]
            self._read = lists, sum(map(len, lists)) + len(known(self))

    return refreshed


class PartLibrary(codegen.JITCodeLibrary):
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
