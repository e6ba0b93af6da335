"""Module of a structure's laws: motion of its drives and sizes of its loads.

Kernels of bodies, joints and springs are printed once for all structures (``generated/joints.py``,
``generated/shapes.py``, ``generated/spatial.py``, ``generated/spatial_shapes.py``); the solver gets them as numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import sympy as sm

from kaneflex.derive.equations.law_expression import Switches
from kaneflex.derive.equations.mechanism import SymbolicMechanism, read_structure
from kaneflex.derive.equations.motion import drive_courses, load_size
from kaneflex.derive.ir.functions import T
from kaneflex.derive.ir.names import Names
from kaneflex.derive.ir.program import Assignment, Steps
from kaneflex.derive.laws.joints import change
from kaneflex.derive.printers import functions_text, module_text
from kaneflex.derive.printers import numba_printer as emit
from kaneflex.scene.structure import laws_hash, laws_of


def generate_laws(scene: Any, progress: Callable[[str], None] = lambda stage: None) -> str:
    """Text of the module of a scene's drives and loads; equal laws give equal text."""
    progress("courses and loads")
    mechanism, switches = read_structure(laws_of(scene)), Switches()
    kernels, parameters = _courses_and_loads(mechanism, switches)
    progress("module text")
    return module_text.module(
        "Drives and loads of a mechanism",
        ["Courses of its drives and sizes of its loads, for the engine of all structures.", "", module_text.CHECKED],
        [*_tables(mechanism, switches, parameters), module_text.operations_table(emit.operations(kernels))],
        *_printed(kernels, mechanism.names),
        structure=laws_hash(scene),
        made="kaneflex derive SCENE --preset coupled -o FILE.py",
    )


def _courses_and_loads(
    mechanism: SymbolicMechanism, switches: Switches
) -> tuple[list[emit.Printed], dict[str, tuple[sm.Symbol, str]]]:
    """Kernels of a structure's drives and loads, and the parameters that they read."""
    parts = {"courses": _courses(mechanism), "magnitudes": _magnitudes(mechanism, switches)}
    values = [sm.sympify(value) for of, steps in parts.values() for value in (*of, *dict(steps).values())]
    read = set().union(*(value.free_symbols for value in values))
    parameters = {path: entry for path, entry in mechanism.parameters.items() if entry[0] in read}
    numbers = emit.places((symbol for symbol, _ in parameters.values()), "p")
    reads = {"courses": numbers, "magnitudes": (*emit.places(_inputs(mechanism, switches), "x", "i"), *numbers)}
    docs = _DOCS | ({"magnitudes": _SWITCHED} if mechanism.observed or switches.sides else {})
    kernels = (
        emit.kernel(name, _ARGUMENTS[name], reads[name], of, docs[name], steps, out="k")
        for name, (of, steps) in parts.items()
    )
    return list(kernels), parameters


def _courses(mechanism: SymbolicMechanism) -> tuple[list[sm.Expr], list[Assignment]]:
    """Coordinate, speed and acceleration of every prescribed drive, and the assignments before them."""
    prescribed = [name for name, drive in mechanism.drives.items() if not drive.free]
    steps = Steps(symbol for symbol, _ in mechanism.parameters.values())
    found = drive_courses(mechanism, prescribed, steps).values()
    return [value for drive in found for value in (drive.angle, drive.speed, drive.acceleration)], steps.assignments


def _magnitudes(mechanism: SymbolicMechanism, switches: Switches) -> tuple[list[sm.Expr], list[Assignment]]:
    """Size of every load, by the time and the joints' coordinates and speeds; then the arguments of its switches, with
    their rates.

    A law whose value or slope jumps stays on the given side of each of its ``switches``.
    """
    values, states = [], _states(mechanism)
    for load in mechanism.loads.values():
        switches.load = load.name
        values.append(load_size(mechanism, load, {name: of[:2] for name, of in states.items()}, switches.functions))
    rates = {T: sm.S.One} | {of: rate for each in states.values() for of, rate in pairwise(each)}
    for argument in switches.sides:
        values += [argument, change(argument, rates)]
    return values, []


def _states(mechanism: SymbolicMechanism) -> dict[str, tuple[sm.Symbol, ...]]:
    """Coordinate, speed and acceleration of each joint that loads may depend on."""
    names, letters = (*mechanism.drives, *mechanism.observed), ("coordinate", "rate", "acceleration")
    return {name: tuple(sm.Symbol(f"{name}_{letter}") for letter in letters) for name in names}


def _inputs(mechanism: SymbolicMechanism, switches: Switches) -> list[sm.Symbol]:
    """Entries of x: coordinates and speeds, then accelerations, then sides, in the order of their numbers."""
    states = _states(mechanism).values()
    return [*(each for of in states for each in of[:2]), *(of[2] for of in states), *switches.sides.values()]


_DOCS = {
    "courses": "Coordinate, speed and acceleration of every prescribed drive at t [s], three numbers each.",
    "magnitudes": "Size of every load at t [s]; x: coordinate and speed of every drive, in the order of DRIVES.",
}
_SWITCHED = """Size of every load at t [s], then of SWITCHES what changes them where it passes zero, with its rate.

x: coordinate and speed of every drive, then joint, in the order of DRIVES and OBSERVED; their accelerations; which
side of zero the loads count as of each of SWITCHES: 1 above, -1 below, 0 where it stays at zero."""
_ARGUMENTS = {"courses": ("t", "p", "out", "k"), "magnitudes": ("t", "x", "i", "p", "out", "k")}


def _printed(kernels: Sequence[emit.Printed], names: Names) -> tuple[list[str], list[str]]:
    """Functions of a structure's kernels, and imports: kernels that do nothing, functions that the others call."""
    idle = [f"no_{kernel.program.name} as {kernel.program.name}" for kernel, raw in kernels if not raw.outputs]
    own = [(kernel, raw) for kernel, raw in kernels if raw.outputs]
    imports = [module_text.import_names("laws", idle)] if idle else []
    lookups = functions_text.import_lookups([raw for _, raw in own])
    return emit.print_kernels((kernel for kernel, _ in own), names), [*imports, *lookups]


def _tables(
    mechanism: SymbolicMechanism, switches: Switches, parameters: Mapping[str, tuple[sm.Symbol, str]]
) -> list[str]:
    """Tables of the inputs and outputs of courses and magnitudes."""
    named, drives = mechanism.names.apply, {name: drive.kind for name, drive in mechanism.drives.items()}
    read = named(tuple((path, unit) for path, (_, unit) in parameters.items()))
    switched = "loads that change where magnitudes' next pass zero"
    return [
        module_text.literal("PARAMETERS", read, "p: path, unit"),
        module_text.literal("TABLES", named(mechanism.tables), "what has a table in p, which begins at <path>.table"),
        module_text.literal("DRIVES", named(drives), "kinds; all but the free ones are in courses"),
        module_text.literal("LOADS", named(tuple(mechanism.loads)), "in the order of magnitudes"),
        module_text.literal("OBSERVED", named(tuple(mechanism.observed)), "joints that laws know beside them"),
        *([module_text.literal("SWITCHES", named(tuple(switches.of)), switched)] if switches.of else []),
    ]
