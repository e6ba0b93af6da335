"""The pipeline on one page: structure -> equations -> programs -> module text."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from kaneflex.derive.elements.beam import Element, beam_element
from kaneflex.derive.elements.parameters import BEAMS, ELEMENT_TERMS, LINK_SCALARS
from kaneflex.derive.elements.plane import TermRow, element_kernel, in_letters, monomial
from kaneflex.derive.equations.mechanism import SymbolicMechanism, read_structure
from kaneflex.derive.equations.motion import Motion, derive_motion
from kaneflex.derive.ir.program import share
from kaneflex.derive.printers import functions_text, module_text, rows
from kaneflex.derive.printers import numba_printer as emit
from kaneflex.derive.printers.bracketed import bracketed
from kaneflex.scene.structure import structure_hash, structure_of
from kaneflex.support.contract import ELEMENT_KERNELS, beam_module

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Equations:
    """The rigid motion of a structure, and what its elastic links require of their element.

    Attributes
    ----------
    mechanism : SymbolicMechanism
    motion : Motion
    beam : str
        The module of the element, one of ``parameters.BEAMS``; empty where nothing is elastic.
    theory : dict
        Options of ``beam_element`` that the elastic links require; those of ``beam`` may include more.
    terms : tuple of rows of ``parameters.ELEMENT_TERMS``
        What the motion can excite.
    """

    mechanism: SymbolicMechanism
    motion: Motion
    beam: str
    theory: Mapping[str, bool]
    terms: tuple[TermRow, ...]

    def element(self, theory: Mapping[str, bool]) -> Element:
        """An element in symbols with the terms of this motion."""
        element = beam_element(**theory)
        required = {(group, factors) for _, group, _, factors in self.terms}
        terms = (term for term in element.terms if (term.group, monomial(term.scalar)) in required)
        return replace(element, terms=tuple(terms))


def derive_equations(structure: dict[str, Any]) -> Equations:
    """Kane's equations of the rigid mechanism, and which terms of their element its elastic links require."""
    mechanism = read_structure(structure)
    motion = derive_motion(mechanism)
    theory = theory_of(structure)
    beam = beam_module(**theory) if motion.links else ""
    return Equations(mechanism, motion, beam, theory, required_terms(mechanism, motion))


def theory_of(structure: Mapping[str, Any]) -> dict[str, bool]:
    """Theory that serves every elastic link; the simpler ones are its limits, by their parameters."""
    theories = {body.get("theory") for body in structure["bodies"].values()}
    shear = "timoshenko" in theories
    varying = any(body.get("varying") for body in structure["bodies"].values())
    return {"rotary": shear or "rayleigh" in theories, "shear": shear, "varying": varying}


def required_terms(mechanism: SymbolicMechanism, motion: Motion) -> tuple[TermRow, ...]:
    """The affine form without the terms that no link of this motion can excite, and without damping where none is.

    A link that turns at constant speed has no epsilon, one that starts at a fixed pivot no a_x, a_y without gravity:
    what is zero for every link multiplies nothing, and is not evaluated.
    """
    if not motion.links:
        return ()
    zero = {
        name
        for k, (name, *_) in enumerate(LINK_SCALARS)
        if all(scalars[k].value == 0 for scalars in motion.links.values())
    }
    if any(".link.jump_" in scalar.name and scalar.value != 0 for scalar in motion.scalars):
        zero -= {"P_0"}  # it weighs the jumps as well
    damped = mechanism.viscous
    return tuple(row for row in ELEMENT_TERMS if not zero & set(row[3]) and (damped or row[1] != "damping"))


def generate(scene: Any, progress: Progress = lambda stage: None) -> str:
    """Text of the module for a scene's structure; equal structures give equal text.

    Parameters
    ----------
    scene : Scene
    progress : callable
        Called with the name of each stage as it begins.
    """
    return generate_pruned(scene, (), structure_hash(scene), progress)


def generate_pruned(
    scene: Any, without: Sequence[str], structure: str, progress: Progress = lambda stage: None
) -> str:
    """Text of the module without some groups of terms of the elastic links; ``structure`` names what is left.

    Without "elastic" nothing deforms: of the links the scalars of the motion remain, which their rigid forces need.
    """
    progress("Kane's equations")
    equations = derive_equations(structure_of(scene))
    if "elastic" in without:
        equations = replace(equations, beam="", terms=())
    else:
        equations = replace(equations, terms=tuple(row for row in equations.terms if row[1] not in without))
    progress("programs")
    kernels = lower(equations) + _halves(equations, without)
    progress("module text")
    return print_module(equations, kernels, structure, without)


def _halves(equations: Equations, without: Sequence[str]) -> list[emit.Printed]:
    """The kernels of which some groups of terms are left out and others stay: no element's module has them."""
    groups = {kernel: {row[1] for row in ELEMENT_TERMS if row[2] == kernel} for kernel in ELEMENT_KERNELS}
    kept = {row[2] for row in equations.terms}
    split = [kernel for kernel in ELEMENT_KERNELS if kernel in kept and groups[kernel] & set(without)]
    element = equations.element(BEAMS[equations.beam]) if split else None
    return [element_kernel(kernel, element) for kernel in split]


def lower(equations: Equations) -> list[emit.Printed]:
    """Kernels with shared subexpressions, each beside its raw program (for the count of what sharing saved)."""
    parameters = tuple(symbol for symbol, _ in equations.mechanism.parameters.values())
    numbers, raw = emit.places(parameters, "p"), equations.motion.program(parameters)
    return [(emit.Kernel(share(raw), ("t", "p", "s"), numbers, _MOTION), raw)]


_MOTION = """Scalars of the rigid motion at time t [s]: Kane's equations with the joint reactions as multipliers.

p: PARAMETERS, then the blocks of the tables. s: zeros; every one of SCALARS is stored but those of CONSTANTS."""


def print_module(
    equations: Equations, kernels: list[emit.Printed], structure: str, without: Sequence[str] = ()
) -> str:
    """Text of a module of these kernels; those of its element are imported, for users alone."""
    counts, names, beam = emit.operations(kernels), equations.mechanism.names, equations.beam
    used = {row[2] for row in equations.terms} - counts.keys()
    imported = tuple(kernel for kernel in ELEMENT_KERNELS if kernel in used)
    imports = [
        f"from kaneflex.generated import {beam} as beam",
        module_text.import_names(beam, ["ELEMENT_PARAMETERS", "LINK_SCALARS"]),
        *([module_text.import_names(beam, imported)] * bool(imported)),
    ] if beam else []  # fmt: skip
    of_element = f"{{name: beam.OPERATIONS[name] for name in {imported!r}}}"
    of_element = "beam.OPERATIONS" if imported == ELEMENT_KERNELS else of_element
    operations = module_text.operations_table(counts, f" | {of_element}" if beam and imported else "")
    tabulate = module_text.function(
        "tabulate(times, p, out)", "The scalars of the motion at many times: row i of out is s at times[i] [s].",
        ["for i in range(times.shape[0]):", "    motion(times[i], p, out[i])"],
    )  # fmt: skip
    return module_text.module(
        "Equations of motion of a mechanism",
        [*_in_letters(beam, without), module_text.CHECKED],
        [*_tables(equations), operations],
        [*emit.print_kernels((kernel for kernel, _ in kernels), names), tabulate],
        [*imports, *functions_text.import_lookups([raw for _, raw in kernels])],
        structure=structure,
        made=f"kaneflex derive SCENE {'--tolerance SHARE ' if without else ''}-o FILE.py",
    )


def _in_letters(beam: str, without: Sequence[str]) -> list[str]:
    """The equations of an elastic link, perhaps without some groups of terms."""
    if "elastic" in without:
        return ["The rigid motion alone: nothing deforms.", ""]
    if not beam:
        return []
    gone = [f"Without the terms {', '.join(without)}.", ""] if without else []
    return [*gone, f"In link axes, as {beam} has them: {in_letters(without)}", ""]


def _tables(equations: Equations) -> list[str]:
    mechanism, motion = equations.mechanism, equations.motion
    named, tables = mechanism.names.apply, mechanism.names.apply(mechanism.tables)
    parameters = [(path, unit) for path, (_, unit) in mechanism.parameters.items()]
    in_links = tuple(scalar for block in motion.links.values() for scalar in block)
    constants = {s.name: float(s.value) for s in (*in_links, *motion.scalars) if s.value.is_number}
    free = tuple(name for name, drive in mechanism.drives.items() if drive.kind == "free")
    links = {link: k * len(LINK_SCALARS) for k, link in enumerate(motion.links)}
    loops = named(tuple((loop.closing, loop.bodies, loop.turning, loop.sliding) for loop in motion.loops))
    closed = "closed by Newton's method: joint, bodies; whose angles, which slides have seeds"
    scalars = [(s.name, s.unit, s.meaning) for s in motion.stored]
    return [
        rows.parameters_table(
            named(parameters), named(list(links)) if equations.beam else (), "p: path of the number in the scene, unit"
        ),
        rows.scalars_table(named(scalars)),
        rows.constants_table(named(constants)),
        *element_tables(equations.beam, equations.terms),
        module_text.literal("TABLES", tables, "what has a table in p, which begins where <path>.table says"),
        module_text.literal("LINKS", named(links), "elastic link -> where its LINK_SCALARS begin in s"),
        module_text.literal("FREE", named(free), "joints left to the forces"),
        *([module_text.literal("LOOPS", loops, closed)] * bool(loops)),
    ]  # fmt: skip


def element_tables(beam: str, terms: Sequence[TermRow] = ()) -> list[str]:
    """Table TERMS of a module's element, and without elastic bodies empty tables in place of the imported ones."""
    comment = "terms of the elastic links: name, group, kernel, factors of the scalar"
    if beam:
        gone = [row[0] for row in ELEMENT_TERMS if row not in terms]
        text = bracketed("TERMS = rows.less(", ["beam.TERMS", *map(repr, gone)], ")")
        return [f"# {comment}\n{text}"]
    none = "nothing is elastic"
    return [module_text.literal(name, (), none) for name in ("LINK_SCALARS", "ELEMENT_PARAMETERS", "TERMS")]
