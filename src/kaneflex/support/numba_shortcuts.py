"""Changes of numba for shorter compilation: answers are stored, and functions within others are linked once."""

from __future__ import annotations

from functools import cache
from inspect import unwrap
from typing import Any

from llvmlite.binding import ffi
from numba.core import base, codegen, postproc, ssa, targetconfig, transforms, utils


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
    assignments: Any = ssa
    _rewrite_where_mentioned(assignments)
    processor: Any = postproc.PostProcessor
    processor.run = _with_lifetimes_for_deletions(processor.run)


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


def _rewrite_where_mentioned(ssa: Any) -> None:
    """Give variables that are assigned several times new names only in the blocks that mention them.

    numba goes through all statements of a function twice for each such variable, and through those of a block for each
    use: the loops of a body's shapes have more than 100 such variables in as many blocks.
    """
    violators, rewrite, mentioned = ssa._find_defs_violators, ssa._run_block_rewrite, dict[str, set[int]]()

    def find_defs_violators(blocks, cfg):
        mentioned.clear()
        for label, block in blocks.items():
            for name in {each.name for statement in block.body for each in statement.list_vars()}:
                mentioned.setdefault(name, set()).add(label)
        return violators(blocks, cfg)

    def run_block_rewrite(blocks, states, handler):
        labels = mentioned[states["varname"]]
        return blocks | rewrite({label: block for label, block in blocks.items() if label in labels}, states, handler)

    def stmt_index(self, defstmt, block, stop=-1):
        if getattr(self, "_of", None) is not block:
            self._of, self._places = block, {id(statement): k for k, statement in enumerate(block.body)}
        end = len(block.body)
        place = self._places.get(id(defstmt), end)
        return place if place < (stop if stop >= 0 else end + stop) else end

    ssa._find_defs_violators, ssa._run_block_rewrite = find_defs_violators, run_block_rewrite
    ssa._FixSSAVars._stmt_index = stmt_index


def _with_lifetimes_for_deletions(run: Any) -> Any:
    """``PostProcessor.run`` of numba without lifetimes of variables until it deletes some, as it finds them three times
    before. Other packages may use them elsewhere."""

    def process(self: Any, emit_dels: bool = False, extend_lifetimes: bool = False) -> None:
        of = self.func_ir
        if emit_dels or not of.func_id.modname.startswith("kaneflex"):
            run(self, emit_dels, extend_lifetimes)
        else:
            of.blocks, of.generator_info = transforms.canonicalize_cfg(of.blocks), None

    return process


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
