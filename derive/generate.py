"""The pipeline on one page: structure -> equations -> programs -> module text."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import sympy as sm
from sympy.core.function import AppliedUndef

from kaneflex.derive import emit
from kaneflex.derive.beam import Element, Term, beam_element
from kaneflex.derive.mechanism import SymbolicMechanism, read_structure
from kaneflex.derive.motion import Inverse, Motion, derive_inverse, derive_motion
from kaneflex.derive.program import Program, share
from kaneflex.support.contract import ELEMENT_KERNELS, FORMAT, LINK_SCALARS

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Equations:
    """The rigid motion of a structure and the affine terms of its elastic links.

    ``element`` is None where nothing is elastic: then no element kernel is emitted. ``inverse`` is the program of the
    free joints' inverse dynamics with its states, None where no joint is free.
    """

    mechanism: SymbolicMechanism
    motion: Motion
    element: Element | None
    inverse: Inverse | None


def derive_equations(structure: dict[str, Any]) -> Equations:
    """Kane's equations of the rigid mechanism and of one differential particle of an elastic link."""
    mechanism = read_structure(structure)
    motion = derive_motion(mechanism)
    element = required_terms(element_of(structure, mechanism.viscous), motion) if motion.links else None
    return Equations(mechanism, motion, element, derive_inverse(mechanism))


def element_of(structure: dict[str, Any], viscous: bool) -> Element:
    """The leanest element that serves every elastic link; the simpler theories are its limits, by their parameters."""
    theories = {body.get("theory") for body in structure["bodies"].values()}
    shear = "timoshenko" in theories
    varying = any(body.get("varying") for body in structure["bodies"].values())
    element = beam_element(rotary=shear or "rayleigh" in theories, shear=shear, varying=varying, with_frame=False)
    return replace(element, terms=tuple(term for term in element.terms if viscous or term.group != "damping"))


def required_terms(element: Element, motion: Motion) -> Element:
    """The element without the terms that no link of this motion can excite.

    A link that turns at constant speed has no epsilon, one that starts at a fixed pivot no a_x, a_y without gravity:
    what is zero for every link multiplies nothing, and is neither emitted nor evaluated.
    """
    zero = {
        symbol
        for k, (_, symbol, *_) in enumerate(element.scalars)
        if all(scalars[k].value == 0 for scalars in motion.links.values())
    }
    if any(".link.jump_" in scalar.name and scalar.value != 0 for scalar in motion.scalars):
        zero -= {symbol for name, symbol, *_ in element.scalars if name == "P_0"}  # it weighs the jumps as well
    return replace(element, terms=tuple(term for term in element.terms if not term.scalar.free_symbols & zero))


def generate(scene: Any, progress: Progress = lambda stage: None) -> str:
    """Text of the module for a scene's structure; equal structures give equal text.

    Parameters
    ----------
    scene : Scene
    progress : callable
        Called with the name of each stage as it begins.
    """
    progress("Kane's equations")
    equations = derive_equations(scene.structure())
    progress("programs")
    kernels = lower(equations)
    progress("module text")
    return print_module(equations, kernels, scene.structure_hash())


def generate_pruned(
    scene: Any, without: Sequence[str], structure: str, progress: Progress = lambda stage: None
) -> str:
    """Text of the module without some groups of terms of the elastic links; ``structure`` names what is left.

    Without "elastic" nothing deforms: of the links the scalars of the motion remain, which their rigid forces need.
    """
    progress("Kane's equations")
    equations = derive_equations(scene.structure())
    if "elastic" in without:
        equations = replace(equations, element=None)
    elif equations.element is not None:
        terms = tuple(term for term in equations.element.terms if term.group not in without)
        equations = replace(equations, element=replace(equations.element, terms=terms))
    progress("programs")
    kernels = lower(equations)
    progress("module text")
    return print_module(equations, kernels, structure, without)


def lower(equations: Equations) -> list[tuple[emit.Kernel, Program]]:
    """Kernels with shared subexpressions, each beside its raw program (for the count of what sharing saved)."""
    motion, raw = _motion_kernel(equations)
    kernels = [(motion, raw)]
    if equations.inverse is not None:
        kernels.append(_inverse_kernel(equations))
    if equations.element is not None:
        element = equations.element
        kernels += [_element_kernel(name, element) for name in ELEMENT_KERNELS if _sum(element, name) is not None]
        kernels += [term_kernel(term, element) for term in element.terms]
        if _sum(element, "F") is not None:
            kernels.append(_force_kernel(equations))
    return kernels


def _motion_kernel(equations: Equations) -> tuple[emit.Kernel, Program]:
    parameters = tuple(symbol for symbol, _ in equations.mechanism.parameters.values())
    raw = equations.motion.program(parameters)
    doc = (
        "Scalars of the rigid motion at time t [s]: Kane's equations with the joint reactions as multipliers.\n\n"
        "p: PARAMETERS, then the blocks of the tables. s: zeros; every one of SCALARS is stored but those of CONSTANTS."
    )
    reads = tuple((symbol, f"p[{k}]") for k, symbol in enumerate(parameters))
    return emit.Kernel(share(raw), ("t", "p", "s"), reads, doc), raw


def _inverse_kernel(equations: Equations) -> tuple[emit.Kernel, Program]:
    raw, states = equations.inverse
    doc = (
        "Torque that each free joint would need at time t [s] for a state and its accelerations.\n\n"
        "p: PARAMETERS, then the blocks of the tables. y: coordinate, speed, acceleration of each joint of FREE."
    )
    parameters = [symbol for symbol, _ in equations.mechanism.parameters.values()]
    reads = [(symbol, f"y[{k}]") for k, (_, symbol) in enumerate(states)]
    reads += [(symbol, f"p[{k}]") for k, symbol in enumerate(parameters)]
    return emit.Kernel(share(raw), ("t", "y", "p", "out"), tuple(reads), doc), raw


_ELEMENT_DOCS = {
    "M": ("Mass matrix M = int rho A N^T N dx of one element, 6 x 6 [SI].", "M", ("inertia",)),
    "K_s": ("Elastic stiffness: E A / l and E I / l^3 blocks, 6 x 6 [SI].", "K", ("elastic",)),
    "K_d": ("Dynamic stiffness K_d = -omega^2 M + epsilon G, 6 x 6 [SI].", "K", ("spin", "euler")),
    "K_g": ("Geometric stiffness K_g = int P(X) H'^T H' dx, 6 x 6 [SI].", "K", ("geometric",)),
    "C": ("Gyroscopic matrix C_d = 2 omega G; the runtime adds material damping, 6 x 6 [SI].", "C", ("gyroscopic",)),
    "F": ("Inertia and weight F_d = -int rho A N^T (a - g + epsilon S r - omega^2 r) dx [SI].", "F", ("load",)),
}  # fmt: skip


_ROTARY_DOCS = {
    "M": "\n\nM holds the rotary inertia int rho I theta^T theta dx, too.",
    "K_d": "\n\nM here is that of translation alone.",
    "F": "\n\nIt holds the rotary inertia -epsilon int rho I theta^T dx, too.",
}


def _sum(element: Element, kernel: str) -> sm.Matrix | None:
    """What a composed kernel computes, or None where the scene requires none of its terms."""
    _, target, groups = _ELEMENT_DOCS[kernel]
    chosen = [term for term in element.terms if term.target == target and term.group in groups]
    if not chosen:
        return None
    return sum((term.scalar * term.matrix for term in chosen), sm.zeros(*chosen[0].matrix.shape))


def _stores(matrix: sm.Matrix) -> tuple[tuple[str, sm.Expr], ...]:
    def index(i: int, j: int) -> str:
        return f"out[{i}]" if matrix.cols == 1 else f"out[{i}, {j}]"

    return tuple(
        (index(i, j), matrix[i, j]) for i in range(matrix.rows) for j in range(matrix.cols) if matrix[i, j] != 0
    )


def _element_inputs(element: Element) -> tuple[tuple[sm.Symbol, str], ...]:
    parameters = [(symbol, f"p[{k}]") for k, (_, symbol, *_) in enumerate(element.parameters)]
    return tuple(parameters + [(symbol, f"s[{k}]") for k, (_, symbol, *_) in enumerate(element.scalars)])


def _element_kernel(name: str, element: Element) -> tuple[emit.Kernel, Program]:
    doc, *_ = _ELEMENT_DOCS[name]
    if element.has("rho_I"):
        doc += _ROTARY_DOCS.get(name, "")
    if element.has("phi_s") and name == "M":
        doc += "\nSo is the correction M_c for the element's answer to its own inertia; K_d and C are without it."
    inputs = _element_inputs(element)
    raw = Program(name, tuple(s for s, _ in inputs), (), _stores(_sum(element, name)))
    arguments = ("p", "out") if name in ("M", "K_s") else ("p", "s", "out")
    doc += "\n\np: ELEMENT_PARAMETERS of one element." + (" s: LINK_SCALARS." if "s" in arguments else "")
    return emit.Kernel(share(raw), arguments, inputs, doc + " out: zeros; structural zeros are not stored."), raw


def term_kernel(term: Term, element: Element) -> tuple[emit.Kernel, Program]:
    inputs = _element_inputs(element)
    matrix = term.matrix
    stores = tuple(
        (f"out[{i}, {j}]", matrix[i, j]) for i in range(matrix.rows) for j in range(matrix.cols) if matrix[i, j] != 0
    )
    raw = Program(f"term_{term.name}", tuple(s for s, _ in inputs), (), stores)
    doc = f"Constant factor of ({term.scalar}) in {term.target}, group {term.group}."
    return emit.Kernel(share(raw), ("p", "out"), inputs, doc), raw


def _force_kernel(equations: Equations) -> tuple[emit.Kernel, Program]:
    """F composed with motion: each elastic link's element, its parameters behind the mechanism's own."""
    element, motion = equations.element, equations.motion
    parameters = [symbol for symbol, _ in equations.mechanism.parameters.values()]
    force = _sum(element, "F")
    stores, reads = [], [(symbol, f"p[{k}]") for k, symbol in enumerate(parameters)]
    for row, (link, scalars) in enumerate(motion.links.items()):
        own = {}
        for k, (name, symbol, *_) in enumerate(element.parameters):
            own[symbol] = sm.Symbol(f"{link}_element_{name}")
            reads.append((own[symbol], f"p[{len(parameters) + row * len(element.parameters) + k}]"))
        own |= {symbol: scalar.value for (_, symbol, *_), scalar in zip(element.scalars, scalars, strict=True)}
        stores += [(f"out[{row}, {i}]", force[i].xreplace(own)) for i in range(force.rows)]
    raw = Program("F_t", (sm.Symbol("t"), *(symbol for symbol, _ in reads)), motion.steps, tuple(stores))
    doc = (
        "F of one element of each elastic link at time t [s], composed with motion.\n\n"
        "p: PARAMETERS with every link's element. out: one row of 6 a link, in the order of LINKS."
    )
    return emit.Kernel(share(raw), ("t", "p", "out"), tuple(reads), doc), raw


def print_module(
    equations: Equations, kernels: list[tuple[emit.Kernel, Program]], structure: str, without: Sequence[str] = ()
) -> str:
    counts = emit.operations(kernels)
    blocks = [text for name, text in emit.TABLE_LOOKUPS.items() if any(calls(raw, name) for _, raw in kernels)]
    blocks += [*emit.print_kernels((kernel for kernel, _ in kernels), equations.mechanism.names), TABULATE]
    if equations.element is not None:
        blocks.append(print_dispatch(equations.element))
    return emit.MODULE.format(
        title="Equations of motion of a mechanism, generated by kaneflex. Do not edit.",
        about=_about(equations, structure, counts, without),
        format=FORMAT,
        structure=structure,
        tables="\n".join(_tables(equations, counts)),
        kernels="\n\n".join(blocks),
    )


def calls(program: Program, function: str) -> bool:
    everything = (*program.assignments, *program.outputs)
    return any(call.func.__name__ == function for _, e in everything for call in e.atoms(AppliedUndef))


def version() -> str:
    """SymPy's minor version, which the text of a module depends on."""
    return ".".join(sm.__version__.split(".")[:2])


def _about(
    equations: Equations, structure: str, counts: dict[str, tuple[int, int]], without: Sequence[str]
) -> str:
    width = max(len(name) for name in counts)
    rotary = []
    if equations.element is not None and equations.element.has("rho_I"):
        rotary = ["    Beside omega^2 stands the M of translation: rotary inertia neither softens nor stiffens."]
    options = "--tolerance SHARE -o FILE.py" if without else "-o FILE.py"
    lines = [
        f"Structure {structure}, format {FORMAT}, SymPy {version()}; made by: kaneflex derive SCENE {options}",
        "",
        *_in_letters(without),
        *rotary,
        "",
        "Operations of one call, written out -> with shared subexpressions:",
        *(f"    {name:<{width}}  {before:>6} -> {after}" for name, (before, after) in counts.items()),
        *emit.UNCHECKED,
    ]
    return "\n".join(lines)


def _in_letters(without: Sequence[str]) -> list[str]:
    """The equations of an elastic link in a module without some groups of terms."""
    if "elastic" in without:
        return ["The rigid motion alone: nothing deforms."]
    gone = [f"Without the terms {', '.join(without)}.", ""] if without else []
    letters = {"damping": " + C_s", "gyroscopic": " + 2 omega G"}
    damping = "".join(term for group, term in letters.items() if group not in without).removeprefix(" + ")
    letters = {"spin": " - omega^2 M", "euler": " + epsilon G", "geometric": " + K_g"}
    stiffness = "K_s" + "".join(term for group, term in letters.items() if group not in without)
    tension = "" if "geometric" in without else "; K_g = P_0 K_g0 + a_x K_g1 + omega^2 K_g2"
    return [
        *gone,
        "In link axes, with one scalar of the motion before each constant matrix:",
        "    M q''" + (f" + ({damping}) q'" if damping else "") + f" + ({stiffness}) q = F",
        f"    q = (u1, v1, theta1, u2, v2, theta2){tension}",
    ]


def _tables(equations: Equations, counts: dict[str, tuple[int, int]]) -> list[str]:
    mechanism, motion = equations.mechanism, equations.motion
    parameters = [(path, unit) for path, (_, unit) in mechanism.parameters.items()]
    names, tables = mechanism.names, table_paths(mechanism)
    in_links = tuple(scalar for block in motion.links.values() for scalar in block)
    constants = {s.name: float(s.value) for s in (*in_links, *motion.scalars) if s.value.is_number}
    rows, of_element = [], ()
    if equations.element is not None:
        of_element = tuple((name, unit, meaning) for name, _, unit, meaning in equations.element.parameters)
        for link in motion.links:
            parameters += [(f"bodies.{link}.element.{name}", unit) for name, unit, _ in of_element]
        rows = term_rows(equations.element)
    free = [name for name, drive in mechanism.drives.items() if drive.kind == "free"]
    links = {link: k * len(LINK_SCALARS) for k, link in enumerate(motion.links)}
    loops = names.told([(loop.closing, loop.bodies, loop.turning, loop.sliding) for loop in motion.loops])
    closed = [
        emit.literal("LOOPS", loops, "closed by Newton's method: joint, bodies; whose angles, which slides have seeds")
    ]
    scalars = [(s.name, s.unit, s.meaning) for s in motion.stored]
    return [
        emit.literal("PARAMETERS", names.told(parameters), "p: path of the number in the scene, unit"),
        emit.literal("TABLES", names.told(tables), "what has a table in p, which begins where <path>.table says"),
        emit.literal("SCALARS", names.told(scalars), "s: name, unit, meaning"),
        emit.literal("CONSTANTS", names.told(constants), "scalars that the structure fixes"),
        emit.literal("LINKS", names.told(links), "elastic link -> where its LINK_SCALARS begin in s"),
        emit.literal("LINK_SCALARS", LINK_SCALARS if motion.links else (), "s of the element kernels"),
        emit.literal("ELEMENT_PARAMETERS", of_element, "p of the element kernels"),
        emit.literal("TERMS", rows, "k-th constant matrix: name, group, matrix, factors of the scalar before it"),
        emit.literal("FREE", names.told(free), "joints left to the forces, in the order of y in the kernel inverse"),
        *(closed if loops else ()),
        emit.literal("OPERATIONS", counts, "kernel -> operations written out, operations with shared subexpressions"),
    ]  # fmt: skip


def table_paths(mechanism: SymbolicMechanism) -> list[str]:
    """Paths of the loads and drives that are tables."""
    readers = {"loads": mechanism.loads, "drives": mechanism.drives}
    return [f"{table}.{name}" for table, of in readers.items() for name, reader in of.items() if reader.kind == "table"]


def term_rows(element: Element) -> list[tuple[str, str, str, tuple[str, ...]]]:
    """TERMS of a module: name, group, matrix and factors of every constant matrix."""
    return [(term.name, term.group, term.target, _monomial(term.scalar)) for term in element.terms]


def _monomial(scalar: sm.Expr) -> tuple[str, ...]:
    """Factors of a term's scalar, repeated for powers: omega**2 -> ("omega", "omega")."""
    powers = sorted(scalar.as_powers_dict().items(), key=str)
    return tuple(str(base) for base, power in powers if base != 1 for _ in range(int(power)))


TABULATE = '''@njit(**OPTIONS)
def tabulate(times, p, out):
    """The scalars of the motion at many times: row i of out is s at times[i] [s]."""
    for i in range(times.shape[0]):
        motion(times[i], p, out[i])
'''


def print_dispatch(element: Element) -> str:
    lines = ["@njit(**OPTIONS)", "def terms(k, p, out):"]
    lines.append(
        '    """The k-th constant matrix of TERMS for one element: out 6 x 6, or 6 x 1 for F; zeroed by the caller."""'
    )
    for k, term in enumerate(element.terms):
        lines += [f"    {'if' if k == 0 else 'elif'} k == {k}:", f"        term_{term.name}(p, out)"]
    return "\n".join(lines) + "\n"
