"""Compiled functions that Python calls without importing numba, which takes a fifth of a second of processor time.

The first process that calls a function lets numba compile it, or read it from its cache, and keeps the machine code a
second time, as numba's cache can't be read without numba. Later processes hand it to LLVM and call it with numba's own
entry from Python (``_dynfunc``), which unpacks the arrays. It is used only for arguments of exactly the types that it
was compiled for, on the same processor, with the same versions, and until its file, or one beside it that it is made
of, changes. Anything else goes to numba.
"""

from __future__ import annotations

import builtins
import ctypes
import functools
import hashlib
import importlib
import marshal
import os
import struct
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib.machinery import PathFinder
from importlib.util import find_spec, module_from_spec
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np

from kaneflex.support.errors import OutputError
from kaneflex.support.files import write_bytes
from kaneflex.support.numba_cache import ensure_cache_folder

PACKAGE = Path(__file__).parents[1]
_C, _FORTRAN = 0x1, 0x2
_LAYOUT = _C | _FORTRAN | 0x100 | 0x400
"""Flags of an array that are part of its type for numba: C order, else Fortran's, aligned, writeable (ndarraytypes.h).
"""
_NUMBERS = (float, bool, np.float64, np.int64, np.uint64)
_LARGEST = 2**63
"""Magnitude from which numba takes an integer for an unsigned one."""
_LOCK = threading.RLock()


class Kernel:
    """A function of a module that numba compiles, called from its machine code; the module is imported only for numba.

    Parameters
    ----------
    module : str
        Below ``kaneflex``, like ``"integrate.instants"``.
    name : str
    sources : callable, optional
        Files that it is made of, if not its own and those beside it.
    """

    def __init__(self, module: str, name: str, sources: Callable[[], Sequence[Path]] | None = None) -> None:
        self._file, self._name = str(PACKAGE.joinpath(*module.split(".")).with_suffix(".py")), name
        self._sources = sources or (lambda: [*Path(self._file).parent.glob("*.py")])
        self._make: Callable[[], Any] = lambda: getattr(importlib.import_module(f"kaneflex.{module}"), name)
        self._entries: dict[object, Any] = {}

    @functools.cached_property
    def dispatcher(self) -> Any:
        """The function as numba compiles it."""
        with _LOCK:
            return self._make()

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Call the function; by numba where that is imported anyway, for it finds the types faster."""
        if "numba" not in sys.modules and not named:
            entry = self._entry(_kinds(arguments))
            if entry is not None:
                return entry(*arguments)
        overloads = getattr(self.dispatcher, "overloads", ())
        known = len(overloads)
        found = self.dispatcher(*arguments, **named)
        if len(overloads) > known and not named:
            self._keep(_kinds(arguments), tuple(map(self.dispatcher.typeof_pyval, arguments)))
        return found

    def address(self, signature: str) -> int:
        """Address of the function for other compiled code; ``signature``: of numba's types."""
        if "numba" not in sys.modules and (found := self._entry(signature)) is not None:
            return int(found)
        address, of = _compiled_address(self.dispatcher, signature)
        self._keep(signature, of)
        return address

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # asked by copy, pickle and inspect
            raise AttributeError(name)
        return getattr(self.dispatcher, name)

    def __reduce__(self) -> Any:
        return self.dispatcher.__reduce__()

    @property
    def _numba_type_(self) -> Any:
        """The type by which other compiled functions call this one."""
        return self.dispatcher._numba_type_

    def _place(self, kinds: object) -> Path:
        named = hashlib.sha256(repr((self._file, self._name, kinds)).encode()).hexdigest()[:16]
        return ensure_cache_folder() / f"{Path(self._file).stem}.{self._name}-{named}.machine"

    def _entry(self, kinds: object) -> Any:
        """The kept machine code for arguments of these types; None where there is none."""
        if kinds is None:
            return None
        if kinds not in self._entries:
            with _LOCK:
                try:
                    data = self._place(kinds).read_bytes()
                    if not data.startswith(_state(*self._sources())):
                        raise ValueError("of another state")
                    code, *symbols = marshal.loads(data[32:])
                    found = _placed(code, symbols[0]) if isinstance(kinds, str) else _linked(code, *symbols)
                    self._entries[kinds] = found
                except (OSError, ValueError, RuntimeError, EOFError, TypeError):  # nothing kept, damaged or stale
                    self._entries[kinds] = None
        return self._entries[kinds]

    def _keep(self, kinds: object, types: Any) -> None:
        """Keep the machine code that numba has in its cache for arguments of these types, or for this signature."""
        if kinds is None:
            return
        cache, known = self.dispatcher._cache, getattr(types, "args", types) in self.dispatcher.overloads
        if not known or not hasattr(cache, "_cache_file"):  # converted, or not cached
            return
        kept = cache._cache_file.load(cache._index_key(types, self.dispatcher.targetctx.codegen()))
        if kept is None:
            return
        (_, kind, (code, _)), described, own, *_, enclosed = kept
        if kind != "object" or any(each.consts for each in (own, *enclosed)) or not _links(code):
            return  # refers to objects of Python, or to functions in C that are unknown without numba
        symbol = described.llvm_func_name if isinstance(kinds, str) else described.llvm_cpython_wrapper_name
        place, data = self._place(kinds), _state(*self._sources()) + marshal.dumps((code, symbol, own.env_name), 2)
        if not place.is_file() or place.read_bytes() != data:
            with suppress(OutputError):
                write_bytes(place, data)


class _Decorated(Kernel):
    """A function that :func:`njit` decorates."""

    def __init__(self, function: FunctionType, options: dict[str, Any]) -> None:
        self._file, self._name = function.__code__.co_filename, function.__name__
        # Of a generated module the digests of its parts stand in it, of others `made_of` has the files.
        self._sources = lambda: [Path(self._file), *map(Path, getattr(function, "parts", ()))]
        self._make = lambda: _compiled(function, options)
        self._entries = {}
        self.py_func = function
        functools.update_wrapper(self, function)


def njit(**options: Any) -> Callable[[FunctionType], Any]:
    """numba's decorator, which imports numba only when the function has to be compiled."""

    def decorated(function: FunctionType) -> Any:
        within = "<locals>" in function.__qualname__  # one text, but another function each time
        return _compiled(function, options) if within else _Decorated(function, options)

    return decorated


def address_of(function: Any, signature: str) -> int:
    """Address of a function that numba compiles for other compiled code."""
    return function.address(signature) if isinstance(function, Kernel) else _compiled_address(function, signature)[0]


def _compiled_address(function: Any, signature: str) -> tuple[int, Any]:
    """Address of a function that numba compiles for a signature, and this as numba has it."""
    from numba import types

    of = eval(signature, vars(types))
    made = function.get_compile_result(of)
    return made.library.get_pointer_to_function(made.fndesc.llvm_func_name), of


def _compiled(function: FunctionType, options: dict[str, Any]) -> Any:
    import numba

    importlib.import_module("kaneflex.support.inner")  # how kaneflex has numba compile
    return numba.njit(**options)(function)


def _kinds(arguments: tuple[Any, ...]) -> object:
    """Types of all arguments; None where only numba knows one."""
    try:
        return tuple(map(_kind, arguments))
    except TypeError:
        return None


def _kind(value: Any) -> object:
    """Type of an argument as numba tells them apart; raises TypeError for one that only numba knows."""
    kind = type(value)
    if kind is np.ndarray and value.dtype.kind in "biufc":
        flags = value.flags.num & _LAYOUT
        return value.dtype.str, value.ndim, flags & ~_FORTRAN if flags & _C else flags
    if kind in _NUMBERS or (kind is int and abs(value) < _LARGEST):
        return kind.__name__
    if isinstance(value, tuple):
        return (kind.__qualname__, *map(_kind, value))
    raise TypeError


@functools.cache
def _state(*sources: Path) -> bytes:
    """Digest of what machine code depends on beside its types: versions, processor, settings, and its sources."""
    from llvmlite import __version__, binding

    files = [*sources, Path(str(_numba().origin))]
    stamps = sorted((file.name, file.stat().st_mtime_ns, file.stat().st_size) for file in files)
    settings = sorted(item for item in os.environ.items() if item[0].startswith("NUMBA_"))
    processor = binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten()
    return hashlib.sha256(repr((sys.version, __version__, processor, settings, stamps)).encode()).digest()


@functools.cache
def _numba() -> Any:
    found = find_spec("numba")
    assert found is not None and found.submodule_search_locations
    return found


@functools.cache
def _extension(name: str) -> Any:
    """A module of numba's that is written in C, without the packages around it."""
    (root,) = _numba().submodule_search_locations
    spec = PathFinder.find_spec(name, [str(Path(root, *name.split(".")[1:-1]))])
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    sys.modules.pop(name, None)  # numba imports it itself
    return module


@functools.cache
def _symbols() -> dict[str, int]:
    """Addresses of numba's functions in C, and of what else machine code refers to, by their names."""
    runtime = _extension("numba.core.runtime._nrt_python")
    runtime.memsys_use_cpython_allocator()
    found = {name if name.startswith("_") else f"NRT_{name}": at for name, at in runtime.c_helpers.items()}
    for helpers in (_extension("numba._helperlib").c_helpers, _extension("numba._dynfunc").c_helpers):
        found |= {f"numba_{name}": at for name, at in helpers.items()}
    found |= {f"PyExc_{name}": id(kind) for name, kind in vars(builtins).items() if isinstance(kind, type)}
    return found | {"_Py_NoneStruct": id(None)}


def _links(code: bytes) -> bool:
    """True for an object file in ELF, as on Linux, that refers to nothing else; LLVM would end the process."""
    from llvmlite.binding import ObjectFileRef

    if not code.startswith(_ELF_64):
        return False
    parts = {part.name(): part.data() for part in ObjectFileRef.from_data(code).sections()}
    names, process = parts[b".strtab"], ctypes.CDLL(None)
    entries = struct.iter_unpack("<IBBHQQ", parts[b".symtab"])  # Elf64_Sym: name, info, other, section, value, size
    outside = {names[at : names.index(b"\0", at)].decode() for at, _, _, section, *_ in entries if at and section == 0}
    return all(name in _symbols() or hasattr(process, name) for name in outside)


_ELF_64 = b"\x7fELF\x02\x01"
"""First bytes of a file of 64 bits, little-endian (System V ABI, chapter 4)."""


@functools.cache
def _linker() -> Any:
    """LLVM's linker in memory."""
    from llvmlite import binding

    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    for name, at in _symbols().items():
        binding.add_symbol(name, at)
    machine = binding.Target.from_default_triple().create_target_machine(jit=True, codemodel="jitdefault")
    return binding.create_mcjit_compiler(binding.parse_assembly(""), machine)


def _placed(code: bytes, symbol: str) -> int:
    """Address of a function in machine code."""
    from llvmlite.binding import ObjectFileRef

    engine = _linker()
    engine.add_object_file(ObjectFileRef.from_data(code))
    engine.finalize_object()
    address = int(engine.get_function_address(symbol))
    if not address:
        raise ValueError(f"no function {symbol}")
    return address


def _linked(code: bytes, wrapper: str, environment: str) -> Any:
    """Machine code as a function that Python calls."""
    address, engine, entries = _placed(code, wrapper), _linker(), _extension("numba._dynfunc")
    own = entries.Environment({})
    ctypes.c_void_p.from_address(engine.get_global_value_address(environment)).value = id(own)
    return entries.make_function(sys, wrapper, "", address, own, (engine, own))
