r"""Print the equations of a module as LaTeX: the same programs and terms that emit prints as numba, in the same order.

The document needs plain LaTeX with amsmath. Long right-hand sides are broken at the signs between their terms.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any

import sympy as sm

from kaneflex.derive.elements.beam import Element, Term
from kaneflex.derive.generate import Equations, Progress, derive_equations, lower
from kaneflex.derive.ir.program import Program
from kaneflex.derive.printers.latex_printer import (
    EquationPrinter,
    SymbolNames,
    broken,
    escaped,
    seen_length,
    subscripted,
)
from kaneflex.scene.structure import structure_hash, structure_of
from kaneflex.support.contract import FORMAT

_WIDE, _WIDEST = 60, 110
"""Characters in a matrix's row from which on it is printed small, and entry by entry."""
_ROWS = 38
"""Rows of a table that fit on a page."""
_OF_ELEMENT = {
    "rho_A": r"(\rho A)", "E_A": "(EA)", "E_I": "(EI)", "rho_I": r"(\rho I)", "length": r"\ell", "phi_s": r"\varphi_s",
}  # fmt: skip
_MATRIX = {"M": r"\mathbf{M}", "C": r"\mathbf{C}", "K": r"\mathbf{K}", "F": r"\mathbf{F}"}


def latex(scene: Any, progress: Progress = lambda stage: None) -> str:
    """A LaTeX document of the equations of a scene, derived as its module is; the same structure, the same text.

    Parameters
    ----------
    scene : Scene
    progress : callable
        Called with the name of each stage as it begins.
    """
    progress("Kane's equations")
    equations = derive_equations(structure_of(scene))
    progress("programs")
    ((kernel, _),) = lower(equations)
    progress("LaTeX")
    return latex_document(equations, kernel.program, scene.name, structure_hash(scene))


def latex_document(equations: Equations, program: Program, scene: str, structure: str) -> str:
    r"""A LaTeX document of a structure's equations.

    Parameters
    ----------
    equations : Equations
    program : Program
        The rigid motion as the module's kernel holds it, subexpressions shared. The element's kernels are sums of its
        terms, which are printed as matrices.
    scene, structure : str
        The scene's name, and the hash of its structure.
    """
    names = SymbolNames(equations.mechanism, [program])
    parts = [_parameters(equations, names), _SECTION["motion"], align(program, names, _targets(equations))]
    parts.append(_scalars(equations))
    if equations.beam:
        parts.append(_element(equations.element(equations.theory)))
    return _DOCUMENT.format(scene=escaped(scene), structure=structure, format=FORMAT, body="\n\n".join(parts))


def align(program: Program, names: Callable[[sm.Symbol], str], targets: Sequence[str]) -> str:
    """The assignments of a program and then its outputs, ``targets`` on their left, as one align environment."""
    printer = EquationPrinter(names)
    rows = [(printer.doprint(symbol), expression) for symbol, expression in program.assignments]
    rows += [(target, expression) for target, (_, expression) in zip(targets, program.outputs, strict=True)]
    return _aligned([f"{left} &= {broken(printer.doprint(expression))}" for left, expression in rows])


def _targets(equations: Equations) -> list[str]:
    """Left-hand sides of the outputs: names of the motion's scalars."""
    names = equations.mechanism.names
    return [rf"\mathtt{{{escaped(names.text(scalar.name))}}}" for scalar in equations.motion.stored]


def _parameters(equations: Equations, names: SymbolNames) -> str:
    rows = [
        (f"${names(symbol)}$", rf"\texttt{{{escaped(equations.mechanism.names.text(path))}}}", _unit(unit))
        for path, (symbol, unit) in equations.mechanism.parameters.items()
    ]
    return "\\section*{Parameters}\n" + _table(("symbol", "number of the scene", "unit"), rows)


def _scalars(equations: Equations) -> str:
    names = equations.mechanism.names
    rows = [
        (rf"\texttt{{{escaped(names.text(scalar.name))}}}", _unit(scalar.unit), escaped(names.text(scalar.meaning)))
        for scalar in equations.motion.stored
    ]
    fixed = [scalar for scalar in equations.motion.scalars if scalar.value.is_number]
    text = "\\section*{Scalars of the motion}\n" + _table(("scalar", "unit", "meaning"), rows)
    if fixed:
        values = ", ".join(rf"\texttt{{{escaped(names.text(s.name))}}} $= {sm.latex(s.value)}$" for s in fixed)
        text += f"\n\n{{\\raggedright The structure fixes {values}.\\par}}"
    return text


def _element(element: Element) -> str:
    """The affine equation of one element, and every constant matrix of it."""
    letters = {symbol: _OF_ELEMENT.get(name) for name, symbol, *_ in (*element.parameters, *element.scalars)}

    def name_of(symbol: sm.Symbol) -> str:
        return letters.get(symbol) or subscripted(symbol.name.split("_"), None, "")

    printer = EquationPrinter(name_of)
    entries = [*element.parameters, *element.scalars]
    rows = [(f"${name_of(symbol)}$", _unit(unit), escaped(meaning)) for _, symbol, unit, meaning in entries]
    sums = [_sum(printer, target, element.terms) for target in "MCKF"]
    matrices = [printed_matrix(printer, term) for term in element.terms]
    table = _table(("symbol", "unit", "meaning"), rows)
    return "\n\n".join([_SECTION["element"], _aligned(sums), table, *matrices])


def _sum(printer: EquationPrinter, target: str, terms: Sequence[Term]) -> str:
    """A matrix as the sum of its scalars times constant matrices."""
    parts = []
    for term in terms:
        if term.target == target:
            scalar = "" if term.scalar == 1 else printer.doprint(term.scalar) + r"\,"
            factor = r"\mu\," if term.group == "damping" else ""
            parts.append(f"{factor}{scalar}{_term_name(term)}")
    return f"{_MATRIX[target]} &= {broken(' + '.join(parts)) if parts else '0'}"


def _aligned(rows: Sequence[str]) -> str:
    return "\\begin{align*}\n" + " \\\\\n".join(rows) + "\n\\end{align*}"


def _term_name(term: Term) -> str:
    return rf"{_MATRIX[term.target]}_{{\mathrm{{{escaped(term.name.replace('_', ' '))}}}}}".replace(" ", r"\ ")


def printed_matrix(printer: EquationPrinter, term: Term) -> str:
    """A constant matrix with its common factor before it."""
    fractions = [sm.fraction(sm.together(entry)) for entry in term.matrix if entry != 0]
    factor = sm.gcd_list([above for above, _ in fractions]) / sm.lcm_list([below for _, below in fractions])
    inside = (term.matrix / factor).applyfunc(sm.expand)  # whole numbers and products of lengths
    rows = [[printer.doprint(entry) for entry in inside.row(k)] for k in range(inside.rows)]
    before = "" if factor == 1 else printer.doprint(factor) + r"\,"
    width = sum(max(map(seen_length, column)) for column in zip(*rows, strict=True))
    if width > _WIDEST:
        return _entries(term, before, rows)
    body = " \\\\\n".join(" & ".join(row) for row in rows)
    shown = f"\\[\n{_term_name(term)} = {before}\n\\begin{{pmatrix}}\n{body}\n\\end{{pmatrix}}\n\\]"
    return shown if width <= _WIDE else f"{{\\footnotesize\\setlength{{\\arraycolsep}}{{1.5pt}}\n{shown}}}"


def _entries(term: Term, before: str, rows: list[list[str]]) -> str:
    """A matrix that is too wide for a page, entry by entry; those that are missing are zero."""
    name = f"{_term_name(term)} = {before} \\mathbf{{A}}"
    places = ((f"A_{{{i + 1}{j + 1}}}", entry) for i, row in enumerate(rows) for j, entry in enumerate(row))
    lines = [f"{place} &= {broken(entry)}" for place, entry in places if entry != "0"]
    return f"\\[ {name} \\]\nwith the entries, all others being zero,\n{_aligned(lines)}"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Rows in as many tables as fit on pages."""
    tables = []
    for first in range(0, len(rows), _ROWS):
        lines = [" & ".join(head) + r" \\ \hline\noalign{\smallskip}"]
        lines += [" & ".join(row) + r" \\" for row in rows[first : first + _ROWS]]
        begin, end = rf"{{\small\begin{{tabular}}{{{'l' * len(head)}}}", r"\end{tabular}}\medskip"
        tables.append("\n".join([begin, *lines, end]))
    return "\n\n".join(tables)


def _unit(unit: str) -> str:
    upright = re.sub(r"\^(-?\d+)", r"^{\1}", unit).replace(" ", r"\,")
    return rf"$\mathrm{{{upright}}}$"


_SECTION = {
    "motion": r"""\section*{Rigid motion}
Positions in closed form, then velocities, accelerations and joint reactions, from Kane's equations with the
constraints' multipliers; $w_0, w_1, \dots$ are shared subexpressions. The course of a free joint is the one for which
its torque vanishes. The last rows are the scalars that the elastic stage reads.""",
    "element": r"""\section*{Elastic element}
One element of an elastic link in the link's axes, $q = (u_1, v_1, \theta_1, u_2, v_2, \theta_2)$:
\[ \mathbf{M}\,\ddot q + (\mathbf{C} + \mathbf{C}_s)\,\dot q + \mathbf{K}\,q = \mathbf{F} \]
with the material damping $\mathbf{C}_s$ of the scene, and""",
}

_DOCUMENT = r"""\documentclass[a4paper,10pt]{{article}}
\usepackage{{amsmath}}
\setlength{{\textwidth}}{{17cm}}
\setlength{{\oddsidemargin}}{{-0.5cm}}
\setlength{{\textheight}}{{24cm}}
\setlength{{\topmargin}}{{-1.5cm}}
\setlength{{\parindent}}{{0pt}}
\allowdisplaybreaks
\begin{{document}}
\title{{Equations of motion: {scene}}}
\author{{}}
\date{{}}
\maketitle
Structure \texttt{{{structure}}}, format {format}: the equations of the module that \texttt{{kaneflex derive}} writes,
in its order. All numbers are in SI units.

{body}

\end{{document}}
"""
