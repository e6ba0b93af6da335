r"""Print the equations of a module as LaTeX: the same programs and terms that emit prints as numba, in the same order.

The document needs plain LaTeX with amsmath. Long right-hand sides are broken at the signs between their terms.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import sympy as sm
from sympy.printing.latex import LatexPrinter

from kaneflex.contract import FORMAT
from kaneflex.derive.beam import Element, Term
from kaneflex.derive.generate import Equations, Progress, derive_equations, lower
from kaneflex.derive.motion import Scalar
from kaneflex.derive.program import Program

_WIDTH = 84
"""Characters of a line of an equation, roughly as wide as the text."""
_ROWS = 38
"""Rows of a table that fit on a page."""
_GREEK = {"omega", "epsilon", "gamma", "tau", "phi", "rho"}
_WORDS = {
    "length": r"\ell", "mass": "m", "inertia": "J", "force": "F", "moment": "M", "normal": "N", "drive": "T",
    "coordinate": r"\theta", "rate": r"\dot\theta", "acceleration": r"\ddot\theta", "speed": r"\Omega",
    "centre": "r", "gravity": "g", "direction": "d",
}  # fmt: skip
"""Words of names that have a letter of their own; the others are written out."""
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
    equations = derive_equations(scene.structure())
    progress("programs")
    programs = [kernel.program for kernel, _ in lower(equations)]
    progress("LaTeX")
    return latex_document(equations, programs, scene.name, scene.structure_hash())


def latex_document(equations: Equations, programs: Sequence[Program], scene: str, structure: str) -> str:
    r"""A LaTeX document of a structure's equations.

    Parameters
    ----------
    equations : Equations
    programs : sequence of Program
        As the module's kernels hold them, subexpressions shared; printed are ``motion`` and, where joints are free,
        ``inverse``. The element's kernels are sums of its terms, which are printed as matrices.
    scene, structure : str
        The scene's name, and the hash of its structure.
    """
    chosen = [program for program in programs if program.name in ("motion", "inverse")]
    names = SymbolNames(equations, chosen)
    parts = [_parameters(equations, names)]
    for program in chosen:
        parts.append(_SECTION[program.name])
        parts.append(align(program, names, _targets(equations, program)))
    parts.append(_scalars(equations))
    if equations.element is not None:
        parts.append(_element(equations.element))
    return _DOCUMENT.format(scene=_escaped(scene), structure=structure, format=FORMAT, body="\n\n".join(parts))


def align(program: Program, names: Callable[[sm.Symbol], str], targets: Sequence[str]) -> str:
    """The assignments of a program and then its outputs, ``targets`` on their left, as one align environment."""
    printer = EquationPrinter(names)
    rows = [(printer.doprint(symbol), expression) for symbol, expression in program.assignments]
    rows += [(target, expression) for target, (_, expression) in zip(targets, program.outputs, strict=True)]
    lines = [f"{left} &= {broken(printer.doprint(expression))}" for left, expression in rows]
    return "\\begin{align*}\n" + " \\\\\n".join(lines) + "\n\\end{align*}"


def broken(text: str) -> str:
    """A right-hand side on as many lines as it needs, broken before a sign outside of all braces."""
    pieces, depth, start = [], 0, 0
    for match in re.finditer(r"[{}]| [+-] ", text):
        if match[0] in "{}":
            depth += 1 if match[0] == "{" else -1
        elif depth == 0:
            pieces.append(text[start : match.start()])
            start = match.start()
    pieces.append(text[start:])
    lines = [pieces[0]]
    for piece in pieces[1:]:
        if _length(lines[-1] + piece) > _WIDTH:
            lines.append(piece)
        else:
            lines[-1] += piece
    return " \\\\\n&\\quad".join(lines)


def _length(text: str) -> int:
    """Characters that are seen, roughly."""
    return len(re.sub(r"\\[a-z]*(rm|bf|left|right|frac|bigl|bigr|quad)|[{}_^\\ ]", "", text))


class EquationPrinter(LatexPrinter):
    """LaTeX of scalar equations: names from a table, every digit of a number, brackets that lines can break in."""

    def __init__(self, names: Callable[[sm.Symbol], str]):
        super().__init__({"fold_short_frac": False})
        self._name = names

    def _print_Symbol(self, expr: sm.Symbol, style: str = "plain") -> str:
        return self._name(expr)

    def _print_Float(self, expr: sm.Float) -> str:
        mantissa, _, exponent = repr(float(expr)).partition("e")
        return rf"({mantissa} \cdot 10^{{{int(exponent)}}})" if exponent else mantissa

    def _add_parens(self, s: str) -> str:
        return rf"\bigl({s}\bigr)"


class SymbolNames:
    """LaTeX of every symbol of the rigid stage, no two alike.

    A name is taken apart at the body, joint or load that it belongs to: ``v_x_rod`` is v with the subscripts x, rod.
    Where two symbols would look alike both are printed as they are called in the module.
    """

    def __init__(self, equations: Equations, programs: Iterable[Program]):
        mechanism = equations.mechanism
        owners = {*mechanism.bodies, *mechanism.joints, *mechanism.masses, *mechanism.loads, "ground"}
        self._owners = sorted(owners, key=lambda name: (-len(name), name))
        symbols = {symbol for symbol, _ in mechanism.parameters.values()}
        for program in programs:
            symbols |= {*program.inputs, *(symbol for symbol, _ in program.assignments)}
        nice = {symbol: self._nice(symbol.name) for symbol in symbols}
        taken = [*nice.values()]
        self._latex = {
            symbol: text if taken.count(text) == 1 else rf"\mathtt{{{_escaped(symbol.name)}}}"
            for symbol, text in nice.items()
        }

    def __call__(self, symbol: sm.Symbol) -> str:
        return self._latex[symbol]

    def _nice(self, name: str) -> str:
        plain = name.rstrip("_")
        primes = "'" * (len(name) - len(plain))
        if numbered := re.fullmatch(r"w(\d+)", plain):
            return f"w_{{{numbered[1]}}}"
        for owner in self._owners:
            if plain == owner:
                return rf"\mathrm{{{_escaped(owner)}}}" + primes
            if plain.endswith(f"_{owner}"):
                return _subscripted(plain.removesuffix(f"_{owner}").split("_"), owner, primes)
            if plain.startswith(f"{owner}_"):
                return _subscripted(plain.removeprefix(f"{owner}_").split("_"), owner, primes)
        return _subscripted(plain.split("_"), None, primes)


def _subscripted(words: list[str], owner: str | None, primes: str) -> str:
    """The first word as the letter, the others and the owner as its subscripts."""
    raised = primes
    if words[0] == "link" and len(words) > 1:
        words, raised = words[1:], rf"^{{\mathrm{{link}}{primes}}}"
    first = words[0]
    if first in _WORDS:
        letter = _WORDS[first]
    elif first in _GREEK:
        letter = f"\\{first}"
    else:
        letter = first if len(first) == 1 else rf"\mathrm{{{_escaped(first)}}}"
    below = [word if len(word) == 1 else rf"\mathrm{{{_escaped(word)}}}" for word in words[1:]]
    if owner is not None:
        below.append(rf"\mathrm{{{_escaped(owner)}}}")
    return f"{letter}{raised}" + (f"_{{{', '.join(below)}}}" if below else "")


def _targets(equations: Equations, program: Program) -> list[str]:
    """What stands on the left of a program's outputs: names of the motion's scalars, or the free joints' torques."""
    if program.name == "motion":
        return [rf"\mathtt{{{_escaped(scalar.name)}}}" for scalar in _stored(equations)]
    free = [name for name, drive in equations.mechanism.drives.items() if drive.kind == "free"]
    return [rf"T_{{\mathrm{{{_escaped(name)}}}}}" for name in free]


def _stored(equations: Equations) -> list[Scalar]:
    """The scalars that ``motion`` stores, in the order of its outputs."""
    motion = equations.motion
    blocks = [scalar for block in motion.links.values() for scalar in block]
    return blocks + [scalar for scalar in motion.scalars if not scalar.value.is_number]


def _parameters(equations: Equations, names: SymbolNames) -> str:
    rows = [
        (f"${names(symbol)}$", rf"\texttt{{{_escaped(path)}}}", _unit(unit))
        for path, (symbol, unit) in equations.mechanism.parameters.items()
    ]
    return "\\section*{Parameters}\n" + _table(("symbol", "number of the scene", "unit"), "lll", rows)


def _scalars(equations: Equations) -> str:
    rows = [
        (rf"\texttt{{{_escaped(scalar.name)}}}", _unit(scalar.unit), _escaped(scalar.meaning))
        for scalar in _stored(equations)
    ]
    fixed = [scalar for scalar in equations.motion.scalars if scalar.value.is_number]
    text = "\\section*{Scalars of the motion}\n" + _table(("scalar", "unit", "meaning"), "lll", rows)
    if fixed:
        values = ", ".join(rf"\texttt{{{_escaped(s.name)}}} $= {sm.latex(s.value)}$" for s in fixed)
        text += f"\n\nThe structure fixes {values}."
    return text


def _element(element: Element) -> str:
    """The affine equation of one element, and every constant matrix of it."""
    letters = {symbol: _OF_ELEMENT.get(name) for name, symbol, *_ in (*element.parameters, *element.scalars)}

    def name_of(symbol: sm.Symbol) -> str:
        return letters.get(symbol) or _subscripted(symbol.name.split("_"), None, "")

    printer = EquationPrinter(name_of)
    entries = [*element.parameters, *element.scalars]
    rows = [(f"${name_of(symbol)}$", _unit(unit), _escaped(meaning)) for _, symbol, unit, meaning in entries]
    sums = [_sum(printer, target, element.terms) for target in "MCKF"]
    matrices = [_matrix(printer, term) for term in element.terms]
    return "\n\n".join([_SECTION["element"], _aligned(sums), _table(("symbol", "unit", "meaning"), "lll", rows), *matrices])


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
    return rf"{_MATRIX[term.target]}_{{\mathrm{{{_escaped(term.name.replace('_', ' '))}}}}}".replace(" ", r"\ ")


def _matrix(printer: EquationPrinter, term: Term) -> str:
    """A constant matrix with its common factor before it."""
    factor = sm.gcd_list([entry for entry in term.matrix if entry != 0])
    inside = (term.matrix / factor).applyfunc(sm.expand)
    body = " \\\\\n".join(" & ".join(printer.doprint(entry) for entry in inside.row(k)) for k in range(inside.rows))
    before = "" if factor == 1 else printer.doprint(factor) + r"\,"
    return f"\\[\n{_term_name(term)} = {before}\n\\begin{{pmatrix}}\n{body}\n\\end{{pmatrix}}\n\\]"


def _table(head: Sequence[str], columns: str, rows: Sequence[Sequence[str]]) -> str:
    """Rows in as many tables as fit on pages."""
    tables = []
    for first in range(0, len(rows), _ROWS):
        lines = [" & ".join(head) + r" \\ \hline", *(" & ".join(row) + r" \\" for row in rows[first : first + _ROWS])]
        tables.append("\\noindent\\begin{tabular}{" + columns + "}\n" + "\n".join(lines) + "\n\\end{tabular}")
    return "\n\n\\medskip\n".join(tables)


_SPECIAL = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}


def _escaped(text: str) -> str:
    return re.sub(r"[\\~^#$%&_{}]", lambda match: _SPECIAL.get(match[0], f"\\{match[0]}"), text)


def _unit(unit: str) -> str:
    upright = re.sub(r"\^(-?\d+)", r"^{\1}", unit).replace(" ", r"\,")
    return rf"$\mathrm{{{upright}}}$"


_SECTION = {
    "motion": r"""\section*{Rigid motion}
Positions in closed form, then velocities, accelerations and joint reactions, from Kane's equations with the constraints'
multipliers; $w_0, w_1, \dots$ are shared subexpressions. The last rows are the scalars that the elastic stage reads.""",
    "inverse": r"""\section*{Free joints}
The torque that each free joint would need for its coordinate, speed and acceleration, which are inputs here; it is
linear in the accelerations, and the motion is the one for which every such torque vanishes.""",
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
Structure \texttt{{{structure}}}, format {format}: the equations of the module that \texttt{{kaneflex derive}} writes, in its
order. All numbers are in SI units.

{body}

\end{{document}}
"""
