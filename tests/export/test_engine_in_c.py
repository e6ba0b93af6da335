"""The engine as C, printed from the functions that numba compiles, one by one; in space by runs in test_coupled_c."""

import ctypes
import sys
from inspect import signature

import numpy as np
from numba import njit, types
from numba.types import CPointer, complex128, float64, int64
from runs import model
from test_c import HEADS, SHARED, built

from kaneflex.derive.printers.c_printer import Printer
from kaneflex.export.coupled_in_c import begun
from kaneflex.multibody.compile import entries as of_library
from kaneflex.multibody.compile import library
from kaneflex.multibody.compile.mechanisms import HANDED, typed
from kaneflex.multibody.compile.types import ENTRY, OUTER
from kaneflex.multibody.compile.values import Vectors
from kaneflex.multibody.dynamics import entries as of_instants
from kaneflex.multibody.engine import kernel_addresses
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.time import collocation
from kaneflex.multibody.time.coefficients import RADAU

SCENE = "four-bar-motor"
NUMBERS = {"b": 2, "n": 4, "act": 2, "count": 3}
"""Whole numbers by the names of arguments: a body on another one, a node or section of a body, a load; else 0 or 1."""
ROOMS = ("body", "joints", "layout", "dense_lu", "articulated", "kinematics", "deformation", "axes", "wrenches")
"""Modules whose functions every run compares; numba compiles the others in half a minute."""
WHOLE_RUNS = ("integrate", "add_compliance", "prepare_next_step", "settle")
"""Functions that take as many steps as rounding lets them, or serve contacts, which the scene does not have, or space:
runs in C are compared with Python's in test_coupled_c."""
C_TYPES = {int64: ctypes.c_int64, float64: ctypes.c_double, types.boolean: ctypes.c_bool}


def arguments(kinds, letters="ab"):
    """Names of arguments by their places; of complex numbers two, which are passed as real numbers."""
    names = [[f"{each}{k}" for each in letters[: 1 + (kind == complex128)]] for k, kind in enumerate(kinds)]
    return [name for pair in names for name in pair], names


def stores(returned, part, parts):
    """Statements that store what a function returned, ``found``, in ``out``."""
    several = isinstance(returned, types.BaseTuple)
    values = [part.format(k) for k in range(len(returned.types))] if several else ["found"]
    if (returned.types[0] if several else returned) == complex128:
        values = [each.format(value) for value in values for each in parts]
    return [] if returned == types.void else [f"out[{k}] = 1.0 * {value}" for k, value in enumerate(values)]


def in_numba(function, kinds, returned):
    """A function that numba compiles with an entry from C, and its type; numbers are returned in an array."""
    heads, names = arguments(kinds)
    given = ", ".join(f"complex({', '.join(pair)})" if len(pair) > 1 else pair[0] for pair in names)
    lines = [f"found = called({given})", *stores(returned, "found[{}]", ("{}.real", "{}.imag"))]
    space = {"called": function}
    exec(f"def wrapped({', '.join(['m', *heads, 'out'])}):\n    " + "\n    ".join(lines), space)
    flat = [each for kind in kinds for each in ([float64] * 2 if kind == complex128 else [kind])]
    return njit(**ENTRY)(space["wrapped"]), types.void(HANDED[at.Kind.PLAIN], *flat, CPointer(float64))


def in_c(printer, name, kinds, returned):
    """The same in C."""
    _, names = arguments(kinds)
    heads = [f"double {pair[0]}, double {pair[1]}" if len(pair) > 1 else printer.declared(kind, pair[0])
             for kind, pair in zip(kinds, names, strict=True)]  # fmt: skip
    given = ", ".join(f"CMPLX({', '.join(pair)})" if len(pair) > 1 else pair[0] for pair in names)
    found = "" if returned == types.void else f"const {printer.declared(returned, 'found')} = "
    lines = [f"{found}{name}({given})", "(void)m, (void)out"]
    lines += stores(returned, "found._{}", ("creal({})", "cimag({})"))
    head = f"void wrapped_{name}({', '.join(['void *m', *heads, 'double *out'])})"
    return f"{head};\n{head}\n{{\n    " + ";\n    ".join(lines) + ";\n}\n"


def printed(run):
    """The printer with all functions, and each one's name -> the compiled function, types, returned type.

    Those of vectors and records are compared with all that calls them.
    """
    printer = Printer(run.engine.kernels)
    by_function = typed(of_library.PLANE, HANDED[at.Kind.PLAIN])
    for entry in (of_instants.project, collocation.integrate, of_instants.unfold):
        printer.function(entry, by_function[entry].args)
    rooms = ("kaneflex.multibody.", "kaneflex.generated.")
    known = [each for name, of in [*sys.modules.items()] if name.startswith(rooms) for each in vars(of).values()]
    known += [each.where[0] for each in known if isinstance(getattr(each, "where", None), tuple)]
    known += run.engine.kernels
    compiled = {each.py_func: each for each in known if hasattr(each, "py_func")}
    text = printer.text()
    made = {name: (compiled[key[0]], key[1], returned) for key, (name, returned) in printer.functions.items()
            if key[0] in compiled and f" {name}(" in text
            and not any(isinstance(each, types.BaseTuple | Vectors) for each in key[1])
            and not isinstance(returned, types.BaseNamedTuple)}  # fmt: skip
    return printer, made


def entries(run, compiler, folder, every):
    """Every function that is compared: types by argument, numba's entry and C's, which take the same arguments."""
    printer, functions = printed(run)
    text = HEADS + printer.text() + "\n".join(in_c(printer, name, *of[1:]) for name, of in functions.items())
    shared = ctypes.CDLL(str(built({"engine.c": text}, folder, compiler, *SHARED)))
    assert len(functions) > 120
    chosen = {name: of for name, of in functions.items() if of[0].__name__ not in WHOLE_RUNS
              and (every or of[0].py_func.__module__.rpartition(".")[2] in ROOMS)}  # fmt: skip
    numba = dict(in_numba(*of) for of in chosen.values())
    with of_library.compiling():
        read = library.entered(numba)
        found = njit(**OUTER)(lambda: read())()
    made = {}
    for (name, (function, kinds, _)), address, kind in zip(chosen.items(), found, numba.values(), strict=True):
        of_c = [C_TYPES.get(each, ctypes.c_void_p) for each in kind.args]
        printed_one = getattr(shared, f"wrapped_{name}")
        printed_one.restype, printed_one.argtypes = None, of_c
        by_name = dict(zip(signature(function.py_func).parameters, kinds, strict=True))
        made[name] = by_name, ctypes.CFUNCTYPE(None, *of_c)(address), printed_one
    return made


def memory(run, random):
    """Arrays of the engine with random numbers near a state, and arrays for other arguments."""
    engine = run.engine
    near = engine.tables.w * (1.0 + 1e-3 * random.normal(size=len(engine.tables.w)))
    for part in (at.RATE, at.ACCEL):  # at rest most of these functions find nothing
        near[engine.tables.plan[part] :][: engine.size] += 0.1 * random.normal(size=engine.size)
    real, pair = (random.normal(size=max(1, len(each))) + 2.0 for each in (engine.real, engine.pair))
    row = run.state * (1.0 + 1e-3 * random.normal(size=len(run.state)))
    spare = [np.concatenate([row, random.uniform(0.5, 1.5, 4000)]) for _ in range(8)]
    return [engine.tables.plan, near, real, pair * (1.0 + 0.3j), *spare, *(each * (1.0 - 0.2j) for each in spare[:4]),
            np.arange(4000), np.zeros(8)]  # fmt: skip


def called(run, function, kinds, arrays, kernels, given):
    """Arrays after a call, the last with what the function returned."""
    arrays, engine = [each.copy() for each in arrays], run.engine
    plan, w, real, pair, *spare, out = arrays
    own = {"plan": plan, "w": w, "pivots": plan, "kernels": kernels, "real": real, "pair": pair}
    own |= {name: w[first : first + np.prod(shape, dtype=int)] for name, (first, shape) in engine.views.items()}
    handle = at.Handle(*(engine.arrays | own).values())
    method, values = at.Handle(*RADAU), iter(given)
    free = {kind: iter([each for each in spare if each.dtype == dtype])
            for kind, dtype in ((float64, float), (complex128, complex), (int64, np.int64))}  # fmt: skip
    passed = [handle.address]
    for name, kind in kinds.items():
        value, step = float(next(values)), name in ("t", "h")
        if kind is HANDED[at.Kind.PLAIN]:
            passed.append(handle.address)
        elif hasattr(kind, "parts"):
            passed.append(method.address)
        elif isinstance(kind, CPointer):
            passed.append(next(free[kind.dtype]).ctypes.data)
        elif kind == complex128:
            passed += [value, float(next(values))]
        else:
            passed.append(value * 1e-3**step if kind == float64 else NUMBERS.get(name, int(value > 1.0)))
    function(*passed, out.ctypes.data)
    return arrays


def worst(expected, found, before):
    """Largest difference of a number, of the largest number that changed in its array."""
    most = 0.0
    for one, other, old in zip(expected, found, before, strict=True):
        changed = abs(one[(one != old) & np.isfinite(one)]).max(initial=0.0)
        off = ~((one == other) | (np.isnan(one) & np.isnan(other)))
        most = max(most, (abs(one[off] - other[off]) / (changed or 1.0)).max(initial=0.0))
    return most


def test_every_function_is_that_of_numba(compiler, exhaustive, tmp_path):
    run = begun(model(SCENE))
    made, random = entries(run, compiler, tmp_path, exhaustive), np.random.default_rng(7)
    pointers = np.array(kernel_addresses(run.engine.kernels, in_c=False))
    numbers = np.zeros(len(at.STRUCTURE_KERNELS), np.int64)
    off, changed = {}, 0
    for name, (kinds, numba, c) in made.items():
        for _ in range(3):
            before, given = memory(run, random), random.uniform(0.5, 1.5, 2 * len(kinds))
            expected = called(run, numba, kinds, before, pointers, given)
            found = called(run, c, kinds, before, numbers, given)
            changed += any((one != old).any() for one, old in zip(expected, before, strict=True))
            off[name] = max(off.get(name, 0.0), worst(expected, found, before))
    assert {name: error for name, error in off.items() if not error <= 1e-13} == {}
    # some do nothing here, like courses of no drive; more of all functions, as those of vectors are left out
    assert changed > (2.25 if exhaustive else 2.3) * len(made)
