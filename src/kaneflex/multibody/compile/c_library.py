"""The compiled engine's functions as a shared library from a C compiler, which takes an eighth of numba's time.

The C is printed from the functions that numba compiles where there is no C compiler. A library depends on its sources
and on the platform; of the processor's instructions it uses few.
"""

from __future__ import annotations

import ctypes
import hashlib
import sysconfig
from collections.abc import Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path

from kaneflex.multibody.model.layout import Kind
from kaneflex.support.machine_code import PACKAGE
from kaneflex.support.numba_cache import ensure_cache_folder

_FLAGS = ("-O2", "-ffp-contract=fast", "-fno-math-errno")
"""Products may be fused with sums, as by numba, but no sum is reordered."""
_VECTORS = ("-mavx2", "-mfma")
"""Instructions since 2013 (Haswell) that make a step in space up to a tenth faster."""
_HEAD = "".join(f"#include <{name}.h>\n" for name in ("complex", "math", "stdbool", "stdint", "stdlib"))
_TABLE = """
extern void (*const entries[])(void);
void (*const entries[])(void) = {{
{listed}
}};
"""


def c_addresses(name: str, kind: Kind, entries: Mapping[str, str], sources: Sequence[Path]) -> list[int]:
    """Addresses of the functions of a kind of mechanism, which are printed from ``sources``; none without a C compiler.

    The library is built once and kept in the cache folder, in place of that of other sources.
    """
    file, folder = f"engine-{name}-{_digest(sources)}.so", ensure_cache_folder()
    for place in (PACKAGE / "support" / file, folder / file):
        if found := _read(place, entries):
            return found
    for old in folder.glob(f"engine-{name}-*.so"):
        with suppress(OSError):  # in use
            old.unlink()
    return _read(folder / file, entries) if _built(folder / file, kind, entries) else []


def _built(file: Path, kind: Kind, entries: Mapping[str, str]) -> bool:
    """True if the C compiler has written the library; a warning says why not."""
    from kaneflex.support.c_compiler import CompilerError, c_compiler, shared_library
    from kaneflex.support.errors import OutputError
    from kaneflex.support.files import write_bytes  # only here: a kept library needs none of it
    from kaneflex.support.terminal import log_warning

    command = c_compiler()
    if not command:
        return False
    try:
        write_bytes(file, shared_library(command, {"engine.c": _printed(kind, entries)}, _flags()))
    except (CompilerError, OutputError) as error:
        log_warning(f"{command[0]} can't build the engine; numba compiles it, which takes longer: {error}")
        return False
    return True


def _read(file: Path, entries: Mapping[str, str]) -> list[int]:
    if file.is_file():
        with suppress(OSError, ValueError):  # of another system, or damaged
            return [*(ctypes.c_size_t * len(entries)).in_dll(ctypes.CDLL(str(file)), "entries")]
    return []


def _flags() -> tuple[str, ...]:
    """Flags of the C compiler for this processor."""
    known: set[str] = set()
    with suppress(OSError), Path("/proc/cpuinfo").open(encoding="utf-8") as file:  # Linux only
        known = next(({*line.split()} for line in file if line.startswith("flags")), known)
    return _FLAGS + _VECTORS * ({"avx2", "fma"} <= known)


def _digest(sources: Sequence[Path]) -> str:
    """Digest of all that a library is made of."""
    found = hashlib.sha256(repr((_flags(), sysconfig.get_platform())).encode())
    printers = Path(str(import_module("kaneflex.derive.printers").__file__)).parent
    for file in (*sources, *sorted(printers.glob("c_*.py"))):
        found.update(file.read_bytes())
    return found.hexdigest()[:16]


def _printed(kind: Kind, entries: Mapping[str, str]) -> str:
    """C of a library, with a table of its entries."""
    from kaneflex.derive.printers.c_printer import Printer
    from kaneflex.multibody.compile.mechanisms import HANDED, typed

    printer = Printer()
    names = [printer.function(each, of.args)[0] for each, of in typed(entries, HANDED[kind]).items()]
    listed = ",\n".join(f"    (void (*)(void)){name}" for name in names)
    return _HEAD + printer.text() + _TABLE.format(listed=listed)
