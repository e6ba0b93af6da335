"""Text of a coupled module: what of a structure the one engine can't know before it meets it.

The bodies' kernels are printed for any numbers of shapes (``generated/body.py``), those of joints and springs once
(``generated/joints.py``). A structure's own are which bodies there are and how many shapes they have, how its drives
move, and sizes of its loads.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import sympy as sm

from kaneflex.derive import lookups_numba, module_text
from kaneflex.derive.generate import beam_of, element_tables, import_element, operations_table, table_paths
from kaneflex.derive.laws import Switches
from kaneflex.derive.links import forced_points
from kaneflex.derive.lookups import T
from kaneflex.derive.mechanism import SymbolicMechanism, read_structure
from kaneflex.derive.motion import drive_courses, load_size
from kaneflex.derive.names import Names
from kaneflex.derive.printers import numba_printer as emit
from kaneflex.derive.program import Assignment
from kaneflex.derive.steps import Steps
from kaneflex.scene.structure import structure_of
from kaneflex.support.contract import ELEMENT_KERNELS

Progress = Callable[[str], None]
Shapes = Mapping[str, tuple[int, ...]]
"""Link with shapes -> numbers of its axial and transverse ones, and 1 where its start moves in its frame."""

@dataclass(frozen=True)
class Topology:
    """Bodies with their numbers of shapes, by the mechanism's numbers of them.

    ``bodies`` maps a body to its axial and transverse shapes and to 1 where its start moves in its frame.
    """

    mechanism: SymbolicMechanism
    bodies: dict[str, tuple[int, int, int]]

    @property
    def jumps(self) -> tuple[tuple[str, str, str], ...]:
        """Forces on links between their ends: by what the axial force grows there."""
        return tuple(
            (f"{body}.link.jump_{point}", "N", f"growth of the axial force at {point}")
            for body, (axial, transverse, _) in self.bodies.items()
            if axial + transverse
            for point in sorted(forced_points(self.mechanism, body) - {"start", "end"})
        )


def generate_coupled(
    scene: Any, counts: Shapes, structure: str, progress: Progress = lambda stage: None
) -> str:
    """Text of the coupled module of a scene with so many shapes of each link that has some."""
    progress("courses and loads")
    description = structure_of(scene)
    mechanism = read_structure(description)
    number = mechanism.names.number
    shapes = {number["body", name]: count for name, count in counts.items()}
    topology = Topology(mechanism, {name: (*shapes.get(name, ()), 0, 0, 0)[:3] for name in mechanism.bodies})
    switches = Switches()
    kernels, parameters = courses_and_loads(mechanism, switches)
    progress("module text")
    beam = beam_of(description) if counts else ""
    names = mechanism.names
    functions, imports = printed(kernels, names)
    return module_text.module(
        "A structure's part in the coupled equations",
        _ABOUT,
        [
            *_tables(topology, beam, names.told(tuple(switches.of))),
            *laws_tables(mechanism, parameters),
            operations_table(emit.operations(kernels), beam),
        ],
        functions,
        [*([import_element(beam, ["TERMS", *ELEMENT_KERNELS])] if beam else []), *imports],
        structure=structure,
        made="kaneflex derive SCENE --preset coupled -o FILE.py",
    )


def courses_and_loads(
    mechanism: SymbolicMechanism, switches: Switches
) -> tuple[list[emit.Printed], dict[str, tuple[sm.Symbol, str]]]:
    """Kernels of a structure's own in the coupled equations, and the parameters that they read."""
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
    """Coordinate, speed and acceleration of every prescribed drive, and what they are written in."""
    prescribed = [name for name, drive in mechanism.drives.items() if not drive.free]
    steps = Steps(symbol for symbol, _ in mechanism.parameters.values())
    found = drive_courses(mechanism, prescribed, steps).values()
    return [value for drive in found for value in (drive.angle, drive.speed, drive.acceleration)], steps.assignments


def _magnitudes(mechanism: SymbolicMechanism, switches: Switches) -> tuple[list[sm.Expr], list[Assignment]]:
    """Size of every load, by the time and the joints' coordinates and speeds; then the arguments of its switches, with
    their rates.

    A law whose value or slope jumps stays on the given side of each of its ``switches``.
    """
    states = {name: _state(name) for name in (*mechanism.drives, *mechanism.observed)}
    values = []
    for load in mechanism.loads.values():
        switches.load = load.name
        values.append(load_size(mechanism, load, states, switches.functions))
    for argument in switches.sides:
        values += [argument, _rate(argument, states)]
    return values, []


def _inputs(mechanism: SymbolicMechanism, switches: Switches) -> list[sm.Symbol]:
    """Entries of x: coordinates and speeds, then accelerations, then sides, in the order of their numbers."""
    names = (*mechanism.drives, *mechanism.observed)
    states = [symbol for name in names for symbol in _state(name)]
    return [*states, *(_acceleration(name) for name in names), *switches.sides.values()]


def _state(joint: str) -> tuple[sm.Symbol, sm.Symbol]:
    return sm.Symbol(f"{joint}_coordinate"), sm.Symbol(f"{joint}_rate")


def _acceleration(joint: str) -> sm.Symbol:
    return sm.Symbol(f"{joint}_acceleration")


def _rate(argument: sm.Expr, states: Mapping[str, tuple[sm.Symbol, sm.Symbol]]) -> sm.Expr:
    """d/dt of what depends on t, coordinates and speeds."""
    found = argument.diff(T)
    for name, (coordinate, speed) in states.items():
        found += argument.diff(coordinate) * speed + argument.diff(speed) * _acceleration(name)
    return found


_DOCS = {
    "courses": "Coordinate, speed and acceleration of every prescribed drive at t [s], three numbers each.",
    "magnitudes": "Size of every load at t [s]; x: coordinate and speed of every drive, in the order of DRIVES.",
}
_SWITCHED = """Size of every load at t [s], then of SWITCHES what changes them where it passes zero, with its rate.

x: coordinate and speed of every drive, then joint, in the order of DRIVES and OBSERVED; their accelerations; which
side of zero the loads count as of each of SWITCHES: 1 above, -1 below, 0 where it stays at zero."""
_ARGUMENTS = {"courses": ("t", "p", "out", "k"), "magnitudes": ("t", "x", "i", "p", "out", "k")}


def printed(kernels: Iterable[emit.Printed], names: Names) -> tuple[list[str], list[str]]:
    """The functions of a structure's kernels, and what it imports: those that do nothing, and what the others call."""
    idle = [f"no_{kernel.program.name} as {kernel.program.name}" for kernel, raw in kernels if not raw.outputs]
    own = [(kernel, raw) for kernel, raw in kernels if raw.outputs]
    imports = [module_text.import_names("laws", idle)] if idle else []
    lookups = lookups_numba.import_lookups([raw for _, raw in own])
    return emit.print_kernels((kernel for kernel, _ in own), names), [*imports, *lookups]


_ABOUT = (
    "Data of this structure for the engine of all structures: its bodies and joints, courses of its drives, and",
    "sizes of its loads.",
    "",
    module_text.CHECKED,
)


def _tables(topology: Topology, beam: str, switched: tuple[str, ...]) -> list[str]:
    mechanism, told = topology.mechanism, topology.mechanism.names.told
    drives = {name: drive.kind for name, drive in mechanism.drives.items()}
    joints = {
        joint.name: (joint.kind, *(f"{side.body}.{side.name}" for side in joint.sides), drives.get(joint.name, ""))
        for joint in mechanism.joints.values()
    }
    bodies = (f"{body!r}: {counts!r}" for body, counts in told(topology.bodies).items())
    observed, springs = (told(tuple(of)) for of in (mechanism.observed, mechanism.springs))
    return [
        module_text.table("BODIES", bodies, "axial, transverse shapes; 1 where its start moves in its frame", "{}"),
        module_text.literal("JOINTS", told(joints), "kind, first and second point, kind of the drive"),
        *([module_text.literal("OBSERVED", observed, "joints that laws know beside them")] * bool(observed)),
        *([module_text.literal("SWITCHES", switched, "loads that change where magnitudes' next pass zero")]
          * bool(switched)),
        module_text.literal("SPRINGS", springs, "between points and at joints"),
        module_text.literal("SCALARS", told(topology.jumps), "of the links beside LINK_SCALARS: name, unit, meaning"),
        *([] if beam else element_tables(beam)),
    ]


def laws_tables(mechanism: SymbolicMechanism, parameters: Mapping[str, tuple[sm.Symbol, str]]) -> list[str]:
    """Tables of the inputs and outputs of courses and magnitudes."""
    told, drives = mechanism.names.told, {name: drive.kind for name, drive in mechanism.drives.items()}
    read = told(tuple((path, unit) for path, (_, unit) in parameters.items()))
    return [
        module_text.literal("PARAMETERS", read, "p: path, unit"),
        module_text.literal(
            "TABLES", told(table_paths(mechanism)), "what has a table in p, which begins at <path>.table"
        ),
        module_text.literal("DRIVES", told(drives), "kinds; all but the free ones are in courses"),
        module_text.literal("LOADS", told(tuple(mechanism.loads)), "in the order of magnitudes"),
    ]
