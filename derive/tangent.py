"""Forward mode on a Program: the slopes of its outputs along one direction of its inputs.

Every assignment x = f(u, v) brings x' = df/du u' + df/dv v' behind it (Griewank & Walther 2008, ch. 3). What a scene's
``motion`` and element kernels become in this way stands in a module beside the scene's own, with the same slots.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import Any

import sympy as sm

from kaneflex.derive import emit
from kaneflex.derive.beam import Element, Term
from kaneflex.derive.generate import calls, element_of, required_terms, term_kernel, version
from kaneflex.derive.lookups import SLOPES, T
from kaneflex.derive.mechanism import SymbolicMechanism, read_structure
from kaneflex.derive.motion import Motion, derive_motion
from kaneflex.derive.names import Names
from kaneflex.derive.program import Program, share
from kaneflex.support.contract import COURSES, FORMAT

Progress = Callable[[str], None]

_FIXED = ("table", "branch", "side", *COURSES)
"""Last words of the parameters that are no quantities: where a table begins, which branch."""
_DIAGNOSES = (".gap", ".closure")
"""Last words of the scalars that only tell whether a loop closes: a gap of zero has no slope."""


def slope(symbol: sm.Symbol) -> sm.Symbol:
    """What stands for the slope of an input or of an assigned symbol."""
    return sm.Symbol(f"{symbol}__slope")


def slopes(program: Program, name: str, fixed: Collection[sm.Symbol]) -> Program:
    """The program of the outputs' slopes; inputs are those of the program, then their slopes but for the ``fixed``."""
    varied = [symbol for symbol in program.inputs if symbol not in fixed]
    known = {symbol: slope(symbol) for symbol in varied}
    assignments = []
    for symbol, expression in program.assignments:
        assignments.append((symbol, expression))
        value = _directional(expression, known)
        if value != 0:
            known[symbol] = slope(symbol)
            assignments.append((known[symbol], value))
    outputs = [(slot, _directional(expression, known)) for slot, expression in program.outputs]
    inputs = (*program.inputs, *(slope(symbol) for symbol in varied))
    return Program(name, inputs, tuple(assignments), tuple((slot, value) for slot, value in outputs if value != 0))


def _directional(expression: sm.Expr, known: dict[sm.Symbol, sm.Symbol]) -> sm.Expr:
    """sum df/dx x' over what varies; a lookup has besides the slope of its own table."""
    used = sorted(expression.free_symbols & set(known), key=str)
    real = {symbol: sm.Dummy(str(symbol), real=True) for symbol in expression.free_symbols}
    back = {dummy: symbol for symbol, dummy in real.items()}
    inner = expression.xreplace(real)
    total = sum((inner.diff(real[symbol]) * known[symbol] for symbol in used), sm.S.Zero)
    for call in sorted(inner.atoms(*SLOPES), key=str):
        own = sm.Dummy("lookup", real=True)
        total += inner.xreplace({call: own}).diff(own).xreplace({own: call}) * SLOPES[call.func](*call.args)
    total = total.replace(sm.Heaviside, lambda x, *_: sm.Piecewise((1, x > 0), (0, True)))
    return total.xreplace(back)


def generate_tangent(scene: Any, structure: str, progress: Progress = lambda stage: None) -> str:
    """Text of the module of the slopes of a scene's motion, under the structure hash of that module."""
    progress("slopes of the motion and the elements")
    description = scene.structure()
    mechanism = read_structure(description)
    motion = derive_motion(mechanism)
    kernels = [_motion_kernel(mechanism, motion)]
    elements = []
    if motion.links:
        element = required_terms(element_of(description, mechanism.viscous), motion)
        kernels += [_term_kernel(term, element) for term in element.terms]
        elements = [_dispatch(element)]
    progress("module text")
    return slopes_text(mechanism.names, structure, kernels, [TABULATE, *elements], "--slopes")


def slopes_text(
    names: Names, structure: str, kernels: Sequence[tuple[emit.Kernel, Program]], more: Sequence[str], options: str
) -> str:
    """Text of a module of slopes: its kernels, the lookups that they call, and ``more`` functions behind them."""
    lookups = {**emit.TABLE_LOOKUPS, **emit.SLOPE_LOOKUPS}
    blocks = [text for name, text in lookups.items() if any(calls(raw, name) for _, raw in kernels)]
    counts = emit.operations(kernels)
    width = max(map(len, counts))
    about = [
        f"Structure {structure}, format {FORMAT}, SymPy {version()}",
        f"Made by: kaneflex derive SCENE {options} -o FILE.py",
        "",
        "The slope of x is its derivative along one direction of the parameters and of the time.",
        "Operations of one call, written out -> with shared subexpressions:",
        *(f"    {name:<{width}}  {before:>6} -> {after}" for name, (before, after) in counts.items()),
    ]
    return emit.MODULE.format(
        title="Slopes of the equations of a mechanism, generated by kaneflex. Do not edit.",
        about="\n".join(about),
        format=FORMAT,
        structure=structure,
        tables=emit.literal("OPERATIONS", counts, "kernel -> operations written out, with shared subexpressions"),
        kernels="\n\n".join([*blocks, *emit.print_kernels((kernel for kernel, _ in kernels), names), *more]),
    )


def _term_kernel(term: Term, element: Element) -> tuple[emit.Kernel, Program]:
    """The slope of one constant matrix of an element, along that of its parameters."""
    kernel, raw = term_kernel(term, element)
    parameters = [symbol for _, symbol, *_ in element.parameters]
    fixed = [symbol for symbol in raw.inputs if symbol not in parameters]
    derived = slopes(raw, f"{raw.name}_slope", fixed)
    reads = [*kernel.reads, *((slope(symbol), f"p_slope[{k}]") for k, symbol in enumerate(parameters))]
    doc = f"Slope of term_{term.name} along p_slope."
    return emit.Kernel(share(derived), ("p", "p_slope", "out"), tuple(reads), doc), derived


def _dispatch(element: Element) -> str:
    lines = ["@njit(**OPTIONS)", "def terms_slope(k, p, p_slope, out):"]
    lines.append('    """Slope of the k-th constant matrix of TERMS for one element, along p_slope; out: zeros."""')
    for k, term in enumerate(element.terms):
        lines += [f"    {'if' if k == 0 else 'elif'} k == {k}:", f"        term_{term.name}_slope(p, p_slope, out)"]
    return "\n".join(lines) + "\n"


def _motion_kernel(mechanism: SymbolicMechanism, motion: Motion) -> tuple[emit.Kernel, Program]:
    parameters = {path: symbol for path, (symbol, _) in mechanism.parameters.items()}
    program = motion.program(tuple(parameters.values()))
    outputs = [
        output
        for output, scalar in zip(program.outputs, motion.stored, strict=True)
        if not scalar.name.endswith(_DIAGNOSES)
    ]
    program = Program("motion", program.inputs, program.assignments, tuple(outputs))
    fixed = [symbol for path, symbol in parameters.items() if is_fixed(path)]
    raw = slopes(program, "motion_slope", fixed)
    reads = [(symbol, f"p[{k}]") for k, symbol in enumerate(parameters.values())]
    reads += [(slope(symbol), f"p_slope[{k}]") for k, symbol in enumerate(parameters.values()) if symbol not in fixed]
    reads.append((slope(T), "t_slope"))
    doc = (
        "Slopes of the scalars of the rigid motion at time t [s], which moves by t_slope.\n\n"
        "p: PARAMETERS of the scene's module, then the blocks of the tables; p_slope: their slopes. s: zeros, in the\n"
        "order of SCALARS; what has no slope by structure is not stored."
    )
    return emit.Kernel(share(raw), ("t", "t_slope", "p", "p_slope", "s"), tuple(reads), doc), raw


def is_fixed(path: str) -> bool:
    """Whether a parameter is no quantity that could have a slope."""
    last = path.rpartition(".")[2]
    return last in _FIXED or last.startswith("seed_")


TABULATE = '''@njit(**OPTIONS)
def tabulate_slopes(times, time_slopes, p, p_slope, out):
    """The slopes at many times: row i of out is for times[i] [s], which moves by time_slopes[i]."""
    for i in range(times.shape[0]):
        motion_slope(times[i], time_slopes[i], p, p_slope, out[i])
'''
