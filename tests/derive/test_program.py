"""Programs: sharing, pruning and counting change no value; what is printed computes what was derived."""

import ast
import math
import re

import numpy as np
import pytest
import sympy as sm

from kaneflex import scene_of
from kaneflex.derive.equations.law_expression import law_expression
from kaneflex.derive.equations.linear import StructurallySingular, determinant, solve_blocks
from kaneflex.derive.generate import derive_equations
from kaneflex.derive.ir.program import (
    Program,
    Steps,
    expanded_operation_count,
    named,
    operation_count,
    prune,
    share,
)
from kaneflex.derive.printers import functions_text
from kaneflex.derive.printers.bracketed import bracketed
from kaneflex.derive.printers.numba_printer import Kernel, NumbaPrinter, print_kernel
from kaneflex.generated import laws
from kaneflex.scene.law_parser import parse_law
from kaneflex.scene.laws import FUNCTIONS, ON_ARRAYS
from kaneflex.scene.structure import structure_of

a, b, c, x, y, z = sm.symbols("a b c x y z")
INPUTS = (a, b, c)


def evaluated(program: Program, values: dict[sm.Symbol, float]) -> list[float]:
    """The outputs, assignment by assignment, in 30 digits."""
    known = {symbol: sm.Float(value, 30) for symbol, value in values.items()}
    for symbol, expression in program.assignments:
        known[symbol] = expression.xreplace(known).evalf(30)
    return [float(expression.xreplace(known).evalf(30)) for _, expression in program.outputs]


def random_program(seed: int) -> Program:
    """Assignments and outputs that share subexpressions, products, sums, powers and functions."""
    rng = np.random.default_rng(seed)
    known, assignments = list(INPUTS), []

    def expression() -> sm.Expr:
        u, v, w = (known[k] for k in rng.integers(0, len(known), 3))
        return [
            u * v + w,
            (u + v) ** 2 * w,
            sm.sin(u + v) - sm.cos(u + v) * w,
            u * v / (2 + w**2),
            sm.Rational(3, 7) * u - v**3 + sm.sqrt(1 + w**2),
            u,  # an alias
            sm.Integer(2),
        ][rng.integers(0, 7)]

    for k in range(12):
        symbol = sm.Symbol(f"s_{k}")
        assignments.append((symbol, expression()))
        known.append(symbol)
    return Program("random", INPUTS, tuple(assignments), tuple((f"out[{k}]", expression()) for k in range(5)))


VALUES = {a: 0.731, b: -1.213, c: 0.417}


@pytest.mark.parametrize("seed", range(12))
def test_sharing_and_pruning_keep_every_output(seed):
    program = random_program(seed)
    expected = evaluated(program, VALUES)
    for other in (share(program), prune(program), share(share(program)), prune(share(program))):
        assert [slot for slot, _ in other.outputs] == [slot for slot, _ in program.outputs]
        assert evaluated(other, VALUES) == pytest.approx(expected, rel=1e-14, abs=1e-14)
    assert operation_count(share(program)) <= operation_count(prune(program)) <= operation_count(program)


def test_sharing_finds_what_assignments_and_outputs_have_in_common():
    program = Program("p", INPUTS, ((x, sm.sin(a * b) + 1),), (("out[0]", x * sm.sin(a * b)), ("out[1]", a * b)))
    shared = share(program)
    assert sum(expression.has(sm.sin) for _, expression in (*shared.assignments, *shared.outputs)) == 1
    assert operation_count(program) == 2 + 1 + 2 + 1 + 1 and operation_count(shared) == 4


def test_sharing_keeps_the_names_that_theory_gave():
    program = Program("p", INPUTS, ((x, a * b + c), (y, (a * b) ** 2)), (("out[0]", x + y),))
    assert {x, y} <= {symbol for symbol, _ in share(program).assignments}


def test_what_is_shared_goes_by_the_first_name_that_theory_has_for_it():
    steps = ((x, a * b), (y, sm.sin(a * b)), (z, a * b))
    program = share(Program("p", INPUTS, steps, (("out[0]", y + z), ("out[1]", a * b), ("out[2]", sm.cos(y)))))
    assert program.assignments == ((x, a * b), (y, sm.sin(x)))
    assert [value for _, value in program.outputs] == [x + y, x, sm.cos(y)]


def test_a_negative_that_is_shared_has_no_name_but_theory_s():
    outputs = (("out[0]", c - a), ("out[1]", c - a * b))
    shared, _ = sm.cse([value for _, value in outputs], order="canonical")
    assert [value for _, value in shared] == [-c]  # SymPy's own sharing gives it one
    assert share(Program("p", INPUTS, (), outputs)).assignments == ()
    named = share(Program("p", INPUTS, ((x, -a * b),), (("out[0]", a * b), ("out[1]", x + c))))
    assert {x} <= {symbol for symbol, _ in named.assignments}


def test_entries_between_brackets_are_not_broken():
    entries = [f"{name}=-{k} / 'some - words'" for k, name in enumerate("abcdefgh")]
    first, *lines, last = bracketed("f(", entries, ")", 60).split("\n")
    assert (first, last) == ("f(", ")") and len(lines) > 3 and max(map(len, lines)) <= 60
    assert [entry for line in lines for entry in line.strip().removesuffix(",").split(", ")] == entries
    assert bracketed("f(", entries[:1], ")", 60) == f"f({entries[0]})"


def test_sharing_inlines_what_is_a_number_or_another_symbol():
    program = Program("p", INPUTS, ((x, -a), (y, sm.Integer(0)), (z, x)), (("out[0]", z * b + y),))
    assert share(program).assignments == ()
    assert share(program).outputs == (("out[0]", -a * b),)


def test_pruning_drops_what_no_output_needs():
    program = Program("p", INPUTS, ((x, a + b), (y, x * c), (z, a * c)), (("out[0]", z + 1),))
    assert prune(program).assignments == ((z, a * c),)


def test_order_is_executable_however_deep_the_chain():
    """Three thousand assignments, each using the one before: no recursion limit is met."""
    symbols = sm.symbols("s_0:3000")
    steps = [(symbols[0], a + b)]
    steps += [(symbols[k], symbols[k - 1] * a + b) for k in range(1, len(symbols))]
    program = Program("p", (a, b), tuple(steps), (("out[0]", symbols[-1] + a),))
    shared = share(program)
    assert [symbol for symbol, _ in shared.assignments] == [symbol for symbol, _ in steps]


@pytest.mark.parametrize(("assignments", "outputs", "message"), [
    (((x, y + 1), (y, a)), (), "x uses y before it is assigned"),
    (((x, z + y),), (), "x uses y, z before it is assigned"),
    ((), (("out[0]", x),), r"out\[0\] uses x before it is assigned"),
    (((x, a), (x, b)), (), "x is assigned twice"),
    (((a, b + 1),), (), "a is assigned twice"),
])  # fmt: skip
def test_a_program_that_cannot_be_executed_is_refused(assignments, outputs, message):
    with pytest.raises(ValueError, match=f"program p: {message}"):
        Program("p", INPUTS, assignments, outputs)


# ---- counting and printing --------------------------------------------------------------------------------------

EXPRESSIONS = [
    *(a**n for n in (-8, -3, -2, -1, 2, 3, 8, 9)),
    *(sm.Abs(a) ** sm.Rational(p, q) for p, q in ((1, 2), (-1, 2), (3, 2), (1, 3))), a / b, 1 / (a * b), -1 / a,
    -a / (b * c), a * b / c**2, sm.Rational(-3, 7) * a / b, sm.Rational(1, 3) + a, -((a + b) ** 2), (a - b) ** -2,
    (a + b) ** 3 / (a - c) ** 2, a / sm.sqrt(2 + b), sm.sqrt(2) * a + sm.pi * b, sm.Float(0.12345678901234567) * a,
    sm.sin(a + b) ** 2 * sm.cos(a) / sm.tan(c), sm.exp(-a) + sm.log(2 + b) - sm.tanh(c), a - b - c, -a - b,
    a * (b + c) - (b - c) * a, (-a) ** 3,
]


def printed(expression: sm.Expr) -> str:
    return NumbaPrinter().doprint(expression)


@pytest.mark.parametrize("expression", EXPRESSIONS, ids=str)
def test_printed_expression_has_the_value(expression):
    numbers = {str(symbol): value for symbol, value in VALUES.items()}
    found = eval(printed(expression), {"math": math, "abs": abs}, numbers)  # our own text
    expected = float(expression.xreplace({s: sm.Float(repr(v), 30) for s, v in VALUES.items()}).evalf(30))
    assert found == pytest.approx(expected, rel=4e-16 * 16)
    assert isinstance(found, float)


@pytest.mark.parametrize("expression", EXPRESSIONS, ids=str)
def test_operations_are_counted_as_printed(expression):
    """Signs are free, and the base of a product (a + b)*(a + b) is computed once, as any compiler does."""
    nodes = ast.walk(ast.parse(printed(expression)))
    operations = {ast.dump(node) for node in nodes if isinstance(node, ast.BinOp | ast.Call)}
    assert operation_count(Program("p", INPUTS, (), (("out[0]", expression),))) == len(operations)


def test_every_digit_of_a_number_is_printed():
    for number in (0.12345678901234567, 1 / 3, math.sqrt(2), 1e-300, 6.62607015e-34):
        assert float(printed(sm.Float(number))) == number
    assert float(printed(sm.Rational(1, 3))) == 1 / 3
    assert "math.pi" in printed(sm.pi * a) or repr(math.pi) in printed(sm.pi * a)


def test_operations_written_out_count_what_is_used_twice_twice():
    program = Program("p", INPUTS, ((x, a * b), (y, x + c)), (("out[0]", y * x), ("out[1]", y)))
    assert operation_count(program) == 3
    assert expanded_operation_count(program) == (2 + 1 + 1) + 2


def test_a_printed_kernel_reads_what_it_uses_and_stores_what_is_not_zero():
    program = Program("p", (*INPUTS, z), ((x, a * b),), (("out[0]", x + c), ("out[1]", sm.S.Zero)))
    reads = tuple((symbol, f"p[{k}]") for k, symbol in enumerate((a, b, c, z)))
    text = print_kernel(Kernel(program, ("p", "out"), reads, "Doc."))
    assert "out[1]" not in text and not re.search(r"\bz\b", text)
    scope = {"njit": lambda **options: lambda function: function, "OPTIONS": {}, "math": math}
    exec(text, scope)  # our own text
    out = [0.0, 0.0]
    scope["p"]([2.0, 3.0, 4.0, 5.0], out)
    assert out == [10.0, 0.0]
    assert scope["p"].__doc__ == "Doc."


def test_a_matrix_is_stored_last_and_row_by_row():
    entries = {"out[0, 0]": a * b, "out[0, 1]": -c, "out[1, 0]": a * b, "out[1, 1]": -a * b}
    program = named(Program("p", INPUTS, (), tuple(entries.items())))
    text = print_kernel(Kernel(program, ("p", "out"), (), "Doc.", by_rows=True))
    *_, first, second = text.rstrip().splitlines()
    assert first.strip() == "out[0, 0], out[0, 1] = v0, -c"
    assert second.strip() == "out[1, 0], out[1, 1] = v0, v1"
    assert evaluated(program, VALUES) == pytest.approx([-0.886703, -0.417, -0.886703, 0.886703], rel=1e-12)


def test_a_printed_kernel_reads_from_where_its_numbers_begin():
    reads = ((a, "p[k + 1]"), (x, "p[k + 2]"), (b, "p[k + 3]"), (c, "q[9 * i]"), (z, "q[9 * i + 1]"))
    program = Program("p", (*INPUTS, x, z), (), (("value", a + 10 * b + 100 * c),))
    text = print_kernel(Kernel(program, ("p", "k", "q", "i"), reads, "Doc.", returns=True))
    assert "a, b, c = p[k + 1], p[k + 3], q[9 * i]\n" in text
    scope = {"njit": lambda **options: lambda function: function, "OPTIONS": {}}
    exec(text, scope)  # our own text
    assert scope["p"]([0.0, 0.0, 0.0, 1.0, 0.0, 2.0], 2, [0.0] * 9 + [3.0], 1) == 321.0


# ---- linear systems ---------------------------------------------------------------------------------------------


def random_system(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A sparse regular matrix, rows and columns shuffled, with blocks of one to three unknowns; right-hand side."""
    rng = np.random.default_rng(seed)
    sizes = rng.integers(1, 4, 4)
    n = int(sizes.sum())
    matrix, first = np.zeros((n, n)), 0
    for size in sizes:
        block = slice(first, first + size)
        matrix[block, block] = rng.uniform(0.5, 2.0, (size, size)) + 3 * np.eye(size)
        if first:  # what was solved before enters sparsely
            matrix[block, :first] = np.where(rng.random((size, first)) < 0.3, rng.uniform(-1, 1, (size, first)), 0)
        first += size
    return matrix[rng.permutation(n)][:, rng.permutation(n)], rng.uniform(-1, 1, n)


@pytest.mark.parametrize("seed", range(10))
def test_linear_systems_are_solved(seed):
    matrix, right = random_system(seed)
    n = len(right)
    unknowns = sm.symbols(f"u_0:{n}")
    entries, equations = {}, []
    for i in range(n):
        row = -sm.Symbol(f"r_{i}")
        entries[sm.Symbol(f"r_{i}")] = right[i]
        for j in np.flatnonzero(matrix[i]):
            symbol = sm.Symbol(f"m_{i}_{j}")
            entries[symbol] = matrix[i, j]
            row += symbol * unknowns[j]
        equations.append((f"row {i}", row))
    steps = Steps()
    values = solve_blocks(equations, unknowns, steps)
    outputs = tuple((str(unknown), values[unknown]) for unknown in unknowns)
    program = Program("p", tuple(entries), tuple(steps.assignments), outputs)
    assert evaluated(program, entries) == pytest.approx(np.linalg.solve(matrix, right), rel=1e-12)


def test_blocks_are_solved_one_after_the_other():
    """A triangular system divides by its diagonal alone: no determinant of the whole appears."""
    equations = [("first", a * x - 1), ("second", b * y + x), ("third", c * z + y)]
    steps = Steps()
    solve_blocks(equations, [z, y, x], steps)
    assert [symbol for symbol, _ in steps.assignments] == [x, y, z]
    assert not any(str(symbol).startswith("inverse_det") for symbol, _ in steps.assignments)


@pytest.mark.parametrize("size", [1, 2, 3, 4])
def test_determinant(size):
    symbols = sm.Matrix(size, size, lambda i, j: sm.Symbol(f"m_{i}_{j}"))
    numbers = np.random.default_rng(size).uniform(-1, 1, (size, size))
    values = {symbols[i, j]: numbers[i, j] for i in range(size) for j in range(size)}
    assert float(determinant(symbols).xreplace(values)) == pytest.approx(np.linalg.det(numbers))
    assert not any(power.exp.is_negative for power in determinant(symbols).atoms(sm.Pow))


@pytest.mark.parametrize("sparsest", range(4))
def test_determinant_expanded_along_any_row(sparsest):
    """The row with the most zeros is taken; its signs alternate from its own place on."""
    numbers = np.random.default_rng(sparsest).uniform(-1, 1, (4, 4))
    numbers[sparsest, [0, 2]] = 0
    entries = {sm.Symbol(f"m_{i}_{j}"): numbers[i, j] for i in range(4) for j in range(4)}
    matrix = sm.Matrix(4, 4, lambda i, j: sm.Symbol(f"m_{i}_{j}") if numbers[i, j] else 0)
    assert float(determinant(matrix).xreplace(entries)) == pytest.approx(np.linalg.det(numbers))


def test_what_cannot_be_determined_is_named():
    with pytest.raises(StructurallySingular) as caught:
        solve_blocks([("one", x + a), ("two", x - b), ("three", x * c)], [x, y, z], Steps())
    assert set(caught.value.open_unknowns) == {"y", "z"}
    assert len(caught.value.spare_equations) == 2
    for name in ("y", "z", *caught.value.spare_equations):
        assert name in str(caught.value)


def test_more_unknowns_than_equations_are_refused():
    with pytest.raises(StructurallySingular, match="nothing determines y"):
        solve_blocks([("one", x + a)], [x, y], Steps())


# ---- steps and laws ---------------------------------------------------------------------------------------------


def test_steps_hand_numbers_and_symbols_on():
    steps = Steps()
    assert steps.assign(x, sm.Integer(0)) == 0
    assert steps.assign(y, -a) == -a
    assert steps.assign(z, a + b) == z
    assert steps.assignments == [(z, a + b)]


def test_a_name_that_is_taken_is_changed():
    steps = Steps([a])
    first, second = steps.assign(a, b + 1), steps.assign(a, b + 2)
    assert len({a, first, second}) == 3
    assert [symbol for symbol, _ in steps.assignments] == [first, second]


@pytest.mark.parametrize("function", FUNCTIONS)
def test_every_function_of_a_law_comes_through(function):
    """The printed SymPy expression against the same law on plain floats."""
    more = {2: ", 2 - main", 5: ", -1, main, 2, 4"}.get(max(FUNCTIONS[function]), "")
    law = f"3.7 * {function}(0.3 + main ** 2 / 14{more}) - main_speed / 11 + pi"
    names = {"main": sm.Symbol("main"), "main_speed": sm.Symbol("speed")}
    text = printed(law_expression(law, names))
    called = {name: getattr(laws, name).py_func for name in functions_text.LAW_FUNCTIONS}
    for angle, speed in ((0.4, 628.3), (-2.9, 1.0)):
        expected = parse_law(law, names).to(ON_ARRAYS, {"main": angle, "main_speed": speed, "pi": math.pi}, float)
        found = eval(text, {"math": math, **called}, {"main": angle, "speed": speed})
        assert found == pytest.approx(expected, rel=1e-14)


def test_a_load_by_law_is_derived_into_the_motion():
    """The load's magnitude in the motion's program, of the time and of the drive's angle and speed."""
    scene = scene_of("""
schema = 1
like = "engine"
loads.gas = "none"
loads.push = {force_on = "piston", direction = [-1, 0], law = "1e3 * exp(-t) * cos(2 * main) + 5 * main_speed"}
""")
    equations = derive_equations(structure_of(scene))
    motion, named = equations.motion, equations.mechanism.names.apply
    parameters = {named(path): symbol for path, (symbol, _) in equations.mechanism.parameters.items()}
    value = next(scalar.value for scalar in motion.scalars if named(scalar.name) == "push")
    symbols = tuple(parameters.values())
    whole = motion.program(symbols)
    program = prune(Program("push", whole.inputs, whole.assignments, (("push", value),)))
    speed, angle = (parameters[f"drives.main.{name}"] for name in ("speed", "angle"))
    numbers = dict.fromkeys(symbols, 1.0) | {speed: 628.3, angle: 0.2}
    t = 0.0123
    expected = 1e3 * math.exp(-t) * math.cos(2 * (0.2 + 628.3 * t)) + 5 * 628.3
    assert evaluated(program, {sm.Symbol("t"): t, **numbers}) == pytest.approx([expected], rel=1e-12)
