"""Compiled functions as shared libraries from a C compiler, which takes an eighth of numba's time.

The C is printed from the functions that numba compiles where there is no C compiler. A library depends on its sources
and on the platform; it uses few of the processor's instructions. Python calls it without importing numba.
"""

from __future__ import annotations

import ctypes
import hashlib
import sysconfig
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from kaneflex.support.numba_cache import ensure_cache_folder

PACKAGE = Path(__file__).parents[1]
_PRINTERS = "kaneflex.derive.printers"
"""By name, as they are of a higher layer."""
_MADE = list[Any]()
"""Functions of numba's whose addresses are in use: their code may go with them."""
Functions = Callable[[], Iterable[tuple[Any, Sequence[Any]]]]
"""Functions with the numba types of their arguments."""
_FLAGS = ("-O2", "-ffp-contract=fast", "-fno-math-errno")
"""Products may be fused with sums, as by numba, but no sum is reordered."""
FAST = "-O3", "-fassociative-math", "-fno-signed-zeros", "-fno-trapping-math", "-freciprocal-math"
"""Sums may be reordered, but comparisons with NaN stay false: tests for runaway motions rely on them."""
_DIGITS = 16
"""Digits of a digest in a file's name."""
_VECTORS = ("-mavx2", "-mfma")
"""Instructions since 2013 (Haswell) that make a step in space up to a tenth faster."""
_HEAD = "".join(f"#include <{name}.h>\n" for name in ("complex", "math", "stdbool", "stdint", "stdlib"))
_TABLE = """
extern const int64_t count;
extern void (*const entries[])(void);
const int64_t count = {count};
void (*const entries[])(void) = {{
{listed}
}};
"""


def c_addresses(
    name: str, sources: Sequence[Path], functions: Functions, flags: Sequence[str] = ()
) -> list[int]:
    """Addresses of functions, in their order, which are printed from ``sources``; none without a C compiler.

    The library is built once and kept in the cache folder, in place of that of other sources. ``flags``: more of the
    compiler's.
    """
    flags = (*_flags(), *flags)
    file, folder = f"{name}-{_digest(sources, flags)}.so", ensure_cache_folder()
    for place in (PACKAGE / "support" / file, folder / file):
        if found := _read(place):
            return found
    for old in folder.glob(f"{name}-{'?' * _DIGITS}.so"):
        with suppress(OSError):  # in use
            old.unlink()
    return _read(folder / file) if _built(folder / file, functions, flags) else []


def addresses_of(module: str, names: Sequence[str], parts: Sequence[str] = (), flags: Sequence[str] = ()) -> list[int]:
    """Addresses of functions of a module of kaneflex, from the C compiler, or else from numba.

    The module has their type, SIGNATURE; ``parts``: other modules that they are made of.
    """

    def functions() -> list[tuple[Any, Sequence[Any]]]:
        found = import_module(f"kaneflex.{module}")
        return [(getattr(found, name), found.SIGNATURE.args) for name in names]

    files = [PACKAGE.joinpath(*each.split(".")).with_suffix(".py") for each in (module, *parts)]
    if found := c_addresses(module.rpartition(".")[2], files, functions, flags):
        return found
    signature = import_module(f"kaneflex.{module}").SIGNATURE
    return [address_by_numba(function, signature, cache=True, error_model="numpy") for function, _ in functions()]


def address_by_numba(function: Any, signature: Any, **options: Any) -> int:
    """Address of a compiled function for callers of C's conventions; it is valid until the process ends."""
    from numba import cfunc

    made = cfunc(signature, **options)(function.py_func)
    _MADE.append(made)
    return int(made.address)


def _built(file: Path, functions: Functions, flags: Sequence[str]) -> bool:
    """True if the C compiler has written the library; a warning says why not."""
    from kaneflex.support.c_compiler import CompilerError, c_compiler, shared_library
    from kaneflex.support.errors import OutputError
    from kaneflex.support.files import write_bytes  # only here: a kept library needs none of it
    from kaneflex.support.terminal import log_warning

    command = c_compiler()
    if not command:
        return False
    try:
        write_bytes(file, shared_library(command, {"library.c": _printed(functions)}, flags))
    except (CompilerError, OutputError) as error:
        log_warning(f"{command[0]} can't build {file.name}; numba compiles it, which takes longer: {error}")
        return False
    return True


def _read(file: Path) -> list[int]:
    if file.is_file():
        with suppress(OSError, ValueError):  # of another system, or damaged
            library = ctypes.CDLL(str(file))
            count = ctypes.c_int64.in_dll(library, "count").value
            return [*(ctypes.c_size_t * count).in_dll(library, "entries")]
    return []


def _flags() -> tuple[str, ...]:
    """Flags of the C compiler for this processor."""
    known: set[str] = set()
    with suppress(OSError), Path("/proc/cpuinfo").open(encoding="utf-8") as file:  # Linux only
        known = next(({*line.split()} for line in file if line.startswith("flags")), known)
    return _FLAGS + _VECTORS * ({"avx2", "fma"} <= known)


def _digest(sources: Sequence[Path], flags: Sequence[str]) -> str:
    """Digest of all that a library is made of."""
    found = hashlib.sha256(repr((flags, sysconfig.get_platform())).encode())
    printers = Path(str(import_module(_PRINTERS).__file__)).parent
    for file in (*sources, *sorted(printers.glob("c_*.py"))):
        found.update(file.read_bytes())
    return found.hexdigest()[:_DIGITS]


def _printed(functions: Functions) -> str:
    """C of a library, with a table of its entries."""
    printer = import_module(f"{_PRINTERS}.c_printer").Printer()
    listed = [f"    (void (*)(void)){printer.function(each, given)[0]}" for each, given in functions()]
    return _HEAD + printer.text() + _TABLE.format(count=len(listed), listed=",\n".join(listed))


def by_address(value: Any) -> Any:
    """Address of an array, or of what has one; other values unchanged."""
    if not isinstance(value, np.ndarray):
        return getattr(value, "address", value)
    assert value.flags.c_contiguous
    if value.size and value.flags.writeable:
        return ctypes.addressof(ctypes.c_char.from_buffer(value.data))  # three times as fast as .ctypes.data
    return value.ctypes.data
