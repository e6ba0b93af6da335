"""LaTeX of the compiled equations: whole, in order, and equal in value to what the kernels compute."""

import math
import re
import subprocess
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import sympy as sm
from command_line import cli, refused
from interpreted import every_kernel
from runs import model

from kaneflex.derive.elements.beam import Term
from kaneflex.derive.elements.parameters import LINK_SCALARS
from kaneflex.derive.elements.plane import monomial
from kaneflex.derive.generate import derive_equations, lower
from kaneflex.derive.latex import latex_document, printed_matrix
from kaneflex.derive.printers.latex_printer import EquationPrinter, SymbolNames, broken, escaped, seen_length
from kaneflex.scene import read_scene
from kaneflex.scene.structure import structure_hash, structure_of
from kaneflex.scene.tables import evaluate_block

SCENES = ("engine", "four-bar", "double-pendulum")


@cache
def derived(name: str):
    scene = read_scene(name)
    equations = derive_equations(structure_of(scene))
    ((kernel, _),) = lower(equations)
    return equations, kernel.program, latex_document(equations, kernel.program, scene.name, structure_hash(scene))


def printed_program(name: str):
    equations, program, _ = derived(name)
    return program, SymbolNames(equations.mechanism, [program])


def rows(text: str) -> list[tuple[str, str]]:
    """(left, right) of every equation of the align environments, broken lines put together."""
    found = []
    for body in re.findall(r"\\begin\{align\*\}\n(.*?)\n\\end\{align\*\}", text, flags=re.DOTALL):
        for line in body.replace(" \\\\\n&\\quad", "").split(" \\\\\n"):
            left, right = line.split(" &= ")
            found.append((left, right))
    return found


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", SCENES)
def test_the_document_is_well_formed(name):
    text = derived(name)[2]
    opened: list[str] = []
    for kind, environment in re.findall(r"\\(begin|end)\{([a-z*]+)\}", text):
        if kind == "begin":
            opened.append(environment)
        else:
            assert opened.pop() == environment
    assert opened == []
    depth = 0
    for brace in re.findall(r"(?<!\\)[{}]", text):
        depth += 1 if brace == "{" else -1
        assert depth >= 0
    assert depth == 0
    for line in text.splitlines():
        assert line.count(r"\left") == line.count(r"\right"), line
        assert len(re.findall(r"(?<!\\)\$", line)) % 2 == 0, line
    assert "None" not in text and "Symbol" not in text
    assert text.isascii()
    assert re.findall(r"\\usepackage\{(.*?)\}", text) == ["amsmath"]


@pytest.mark.parametrize("name", SCENES)
def test_every_assignment_and_output_stands_there_in_the_modules_order(name):
    program, names = printed_program(name)
    equations, _, text = derived(name)
    lefts = [left for left, _ in rows(text)]
    expected = [names(symbol) for symbol, _ in program.assignments]
    expected += [rf"\mathtt{{{escaped(scalar)}}}" for scalar, *_ in model(name).module.SCALARS]
    if equations.beam:
        expected += [rf"\mathbf{{{letter}}}" for letter in "MCKF"]
    assert lefts == expected
    named = equations.mechanism.names.apply
    for path, unit in [(path, unit) for path, (_, unit) in equations.mechanism.parameters.items()]:
        assert rf"\texttt{{{escaped(named(path))}}}" in text, (path, unit)


@pytest.mark.parametrize("name", SCENES)
def test_no_two_symbols_look_alike(name):
    program, names = printed_program(name)
    symbols = {*program.inputs, *(symbol for symbol, _ in program.assignments)}
    assert len({names(symbol) for symbol in symbols}) == len(symbols)


def test_names_that_would_look_alike_are_printed_as_in_the_module():
    equations, motion, _ = derived("engine")
    rod = equations.mechanism.names.number["body", "rod"]
    clash = [sm.Symbol(f"mass_{rod}"), sm.Symbol(f"{rod}_mass"), sm.Symbol(f"x_{rod}")]
    program = type(motion)("motion", tuple(clash), (), ())
    names = SymbolNames(equations.mechanism, [program])
    assert [names(symbol) for symbol in clash] == [r"\mathtt{mass\_rod}", r"\mathtt{rod\_mass}", r"x_{\mathrm{rod}}"]


# ---- the value of what is printed --------------------------------------------------------------------------------


class Reader:
    """Evaluates the LaTeX that EquationPrinter writes: sums of products of names, numbers, fractions, roots, calls."""

    def __init__(self, values: dict[str, float], functions: dict):
        self.values, self.functions = values, functions
        longest_first = sorted(values, key=len, reverse=True)
        kinds = [r"\\operatorname\{[a-z]+\}", *map(re.escape, longest_first), r"\d+\.?\d*", r"\\[a-z]+", r"[-+(){}^,|]"]
        self.token = re.compile("|".join(kinds))

    def __call__(self, text: str) -> float:
        plain = re.sub(r"\\(bigl|bigr|left|right)(?=[()])|\\,|\\cdot", "", text)
        self.tokens = [*self.token.findall(plain)]
        assert "".join(self.tokens).replace(" ", "") == plain.replace(" ", ""), text
        value = self.sum()
        assert not self.tokens, text
        return value

    def take(self, wanted: str | None = None) -> str:
        token = self.tokens.pop(0)
        assert wanted in (None, token), (wanted, token, self.tokens)
        return token

    def sum(self) -> float:
        total, sign = 0.0, 1.0
        if self.tokens[0] == "-":
            self.take()
            sign = -1.0
        total += sign * self.product()
        while self.tokens and self.tokens[0] in "+-":
            sign = 1.0 if self.take() == "+" else -1.0
            total += sign * self.product()
        return total

    def product(self) -> float:
        value = self.power()
        while self.tokens and self.tokens[0] not in ("+", "-", ")", "}", ",", "|"):
            value *= self.power()
        return value

    def power(self) -> float:
        value = self.base()
        if self.tokens and self.tokens[0] == "^":
            self.take()
            value **= self.group()
        return value

    def group(self) -> float:
        self.take("{")
        value = self.sum()
        self.take("}")
        return value

    def base(self) -> float:
        token = self.take()
        if token in self.values:
            return self.values[token]
        if token[0].isdigit():
            return float(token)
        if token == "(":
            value = self.sum()
            self.take(")")
            return value
        if token == r"\frac":
            above = self.group()
            return above / self.group()
        if token == r"\sqrt":
            return math.sqrt(self.group())
        if token == r"\pi":
            return math.pi
        name = token[1:].removeprefix("operatorname{").removesuffix("}")
        braces = self.tokens[0] == "{"
        self.tokens = self.tokens[braces:]
        self.take("(")
        arguments = [self.sum()]
        while self.tokens[0] == ",":
            self.take()
            arguments.append(self.sum())
        self.take(")")
        self.tokens = self.tokens[braces:]
        return self.functions[name](*arguments)


def functions_of(parameters: np.ndarray) -> dict:
    def table(x: float, start: float) -> float:
        first = int(start)
        count = int(parameters[first])
        return float(evaluate_block(parameters[first : first + 3 + 5 * count], x))

    return {"sin": math.sin, "cos": math.cos, "min": min, "table": table}


@pytest.mark.parametrize("name", ["engine", "four-bar"])
def test_printed_motion_has_the_values_of_the_compiled_one(name):
    program, names = printed_program(name)
    motion = model(name).motion
    equations = derived(name)[0]
    at = 0.37 * read_scene(name).horizon
    values = {names(symbol): float(motion.parameters[k]) for k, (symbol, _) in
              enumerate(equations.mechanism.parameters.values())}  # fmt: skip
    values[names(sm.Symbol("t"))] = at
    printed = rows(derived(name)[2])[: len(program.assignments) + len(program.outputs)]
    for left, right in printed:
        values[left] = Reader(values, functions_of(motion.parameters))(right)
    outputs = [values[left] for left, _ in printed[len(program.assignments) :]]
    assert outputs == pytest.approx(motion.table(at)[0], rel=1e-9, abs=1e-9)


def test_printed_matrices_have_the_values_of_the_compiled_kernels():
    module = model("engine").module
    text = derived("engine")[2]
    equations = derived("engine")[0]
    element = equations.element(equations.theory)
    p = np.array([1.3, 0.7, 2.9, 0.41, 0.23])
    values = dict(zip([r"(\rho A)", "(EA)", "(EI)", r"\ell", "x_{0}"], p, strict=True))
    reader = Reader(values, {})
    compiled = [every_kernel(module, p, unit) for unit in np.eye(6, 5, -1)]
    scalars = ["", *(name for name, *_ in LINK_SCALARS)]
    left = {}
    for _, group, kernel, factors in module.TERMS:
        matrix = compiled[scalars.index("".join(factors[:1]))][kernel]
        left[group, factors] = (matrix[:, None] if kernel == "F" else matrix).copy()
    for entry in element.terms:
        term, target = entry.name, entry.target
        name = rf"\mathbf{{{target}}}_{{\mathrm{{{term}}}}}".replace("_", r"\ ").replace(r"}\ {", "}_{")
        before, body = re.search(
            rf"{re.escape(name)} = (.*?)\n\\begin\{{pmatrix\}}\n(.*?)\n\\end\{{pmatrix\}}", text, flags=re.DOTALL
        ).groups()
        factor = reader(before) if before else 1.0
        found = np.array([[factor * reader(entry) for entry in row.split(" & ")] for row in body.split(" \\\\\n")])
        left[entry.group, monomial(entry.scalar)] -= found
    assert len(element.terms) > len(module.TERMS) > 10
    for term, rest in left.items():
        assert abs(rest).max() < 1e-14, term


def test_matrices_are_printed_in_whole_numbers():
    text = derived("engine")[2]
    mass = re.search(r"\\mathbf\{M\}_\{\\mathrm\{mass\}\} = (.*?)\\end\{pmatrix\}", text, flags=re.DOTALL)[1]
    assert mass.startswith(r"\frac{\ell \, (\rho A)}{420}")
    assert r"0 & 156 & 22 \, \ell & 0 & 54 & - 13 \, \ell" in mass


def test_a_matrix_too_wide_for_a_page_is_printed_entry_by_entry():
    symbols = sm.symbols("a:40")
    wide = sm.ImmutableMatrix(2, 2, [sum(symbols), 0, symbols[0], 1])
    text = printed_matrix(EquationPrinter(str), Term("wide", "spin", "K", sm.S.One, wide))
    assert "pmatrix" not in text
    found = dict(rows(text))
    assert list(found) == ["A_{11}", "A_{21}", "A_{22}"]
    assert sorted(found["A_{11}"].split(" + ")) == sorted(map(str, symbols))
    assert (found["A_{21}"], found["A_{22}"]) == ("a0", "1")


def test_numbers_keep_every_digit_and_long_sums_are_broken():
    x = sm.Symbol("x")
    printer = EquationPrinter(str)
    assert printer.doprint(sm.Float(0.1 + 0.2) * x) == r"0.30000000000000004 \, x"
    assert printer.doprint(sm.Float(1.5e-9)) == r"(1.5 \cdot 10^{-9})"
    symbols = sm.symbols("a:60")
    text = printer.doprint(3 * x * sum(s * x for s in symbols) + sm.sin(sum(symbols)))
    lines = broken(text).split(" \\\\\n&\\quad")
    assert len(lines) > 2
    outside = [line for line in lines if r"\sin" not in line]
    assert outside and max(map(seen_length, outside)) <= 90
    assert "".join(lines).replace(r"\bigl(", "(").replace(r"\bigr)", ")") == text.replace(r"\left(", "(").replace(
        r"\right)", ")"
    )


# ---- command line ------------------------------------------------------------------------------------------------


def test_command_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shown = cli("equations", "engine")
    assert shown.exit_code == 0 and shown.stdout == derived("engine")[2]
    written = cli("equations", "engine", "-o", "engine.tex")
    assert written.exit_code == 0 and Path("engine.tex").read_text() == shown.stdout
    refused(cli("equations", "engine", "-o", "engine.tex"), "the file exists", "--force")
    refused(cli("equations", "engin"), "scene = 'engin'")
    assert [path.name for path in Path().iterdir()] == ["engine.tex"]


def test_the_document_compiles(tmp_path, pdflatex):
    for name in ("engine-torque", "spin-up"):
        (tmp_path / f"{name}.tex").write_text(derived(name)[2])
        command = [pdflatex, "-interaction=nonstopmode", "-halt-on-error", f"{name}.tex"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120)
        assert done.returncode == 0, done.stdout[-2000:]
