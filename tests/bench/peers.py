"""The kernels' tasks in several ways: our own, hand-written C, SymPy's lambdify, PyDy's Cython.

Each takes a task and returns a candidate; PyDy is imported when it is asked for.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import sympy as sm
from numba import njit

from bench.compiled import FLAGS, HERE, compile_c, pointer
from bench.tasks import Task
from kaneflex.generated import slider_crank_150 as generated

Outputs = dict[str, np.ndarray]


@dataclass(frozen=True)
class Candidate:
    """One way to do a task.

    outputs : the matrices of the k-th sample.
    once : one evaluation, called from Python as its users call it.
    many : so many evaluations in one compiled loop, with the samples in turn; None where there is no such way.
    """

    name: str
    outputs: Callable[[int], Outputs]
    once: Callable[[], object]
    many: Callable[[int], object] | None
    differs: str = ""


def zeros(task: Task) -> Outputs:
    """Arrays for a task's matrices; a column is flat."""
    return {name: np.zeros(matrix.rows if matrix.cols == 1 else matrix.shape) for name, matrix in task.matrices.items()}


def _filled(task: Task, evaluate: Callable[..., object]) -> Callable[[int], Outputs]:
    """``outputs`` of what stores into arrays: evaluate(*inputs, *arrays)."""

    def outputs(k: int) -> Outputs:
        found = zeros(task)
        evaluate(*task.sample(k), *found.values())
        return found

    return outputs


@njit
def _element(p, s, M, K_s, K_d, K_g, C, F):
    generated.M(p, M)
    generated.K_s(p, K_s)
    generated.K_d(p, s, K_d)
    generated.K_g(p, s, K_g)
    generated.C(p, s, C)
    generated.F(p, s, F)


@njit
def _element_many(n, values, p, s, M, K_s, K_d, K_g, C, F):
    # not by _element: numba passes a call inside a call its arrays by memory, which takes twice as long as the kernels
    for i in range(n):
        p[3] = values[i & 15]
        s[0] = values[i & 15]
        generated.M(p, M)
        generated.K_s(p, K_s)
        generated.K_d(p, s, K_d)
        generated.K_g(p, s, K_g)
        generated.C(p, s, C)
        generated.F(p, s, F)


@njit
def _motion_many(n, values, p, s):
    for i in range(n):
        generated.motion(values[i & 15], p, s)


def generated_kernels(task: Task) -> Candidate:
    inputs, out = task.sample(0), zeros(task).values()
    if task.name == "beam element":
        return Candidate(
            "kaneflex", _filled(task, _element), lambda: _element(*inputs, *out),
            lambda n: _element_many(n, task.values, *inputs, *out), "zeros not stored",
        )  # fmt: skip
    (_, p), (s,) = inputs, out
    return Candidate(
        "kaneflex", _filled(task, lambda t, p, s: generated.motion(t[0], p, s)),
        lambda: generated.motion(0.01, p, s), lambda n: _motion_many(n, task.values, p, s), "zeros not stored",
    )  # fmt: skip


def library(folder: Path, compiler: str) -> ctypes.CDLL:
    """Of kernels.c, which finds the motion's parameters and scalars by the names that the module gives them."""
    tables = (generated.PARAMETERS, generated.SCALARS)
    enums = [f"enum {{ {', '.join(name.replace('.', '_') for name, *_ in table)} }};\n" for table in tables]
    (folder / "places.h").write_text("".join(enums), encoding="utf-8")
    return compile_c(HERE / "kernels.c", folder, compiler, f"-I{folder}")


def hand_written(task: Task, hand: ctypes.CDLL) -> Candidate:
    many = hand.element_many if task.name == "beam element" else hand.motion_many
    inputs, out = task.sample(0), zeros(task)
    arrays = (task.values, *(inputs if task.name == "beam element" else inputs[1:]), *out.values())
    pointers = [pointer(array) for array in arrays]
    one = ctypes.c_long(1)

    def outputs(k: int) -> Outputs:
        found = zeros(task)
        values = task.values[k : k + 1].copy()
        arrays = (values, *(task.sample(k) if task.name == "beam element" else inputs[1:]), *found.values())
        many(one, *(pointer(array) for array in arrays))
        return found

    return Candidate(
        "hand-written C", outputs, lambda: many(one, *pointers), lambda n: many(ctypes.c_long(n), *pointers),
        "zeros not stored",
    )  # fmt: skip


def lambdified(task: Task, cse: bool) -> Candidate:
    symbols = [symbol for group in task.groups for symbol in group]
    function = sm.lambdify(symbols, tuple(task.matrices.values()), modules="numpy", cse=cse)
    arguments = task.arguments(0)
    return Candidate(
        f"lambdify{', cse' * cse}", _of_function(task, function), lambda: function(*arguments), None,
        "new dense arrays at every call",
    )  # fmt: skip


def lambdified_jitted(task: Task) -> Candidate:
    """Two loops, since numba takes the arguments one by one; zeros are an argument, since its lists are of one type."""
    zero = sm.Symbol("zero")
    filled = [matrix.applyfunc(lambda entry: zero if entry == 0 else entry) for matrix in task.matrices.values()]
    symbols = [symbol for group in task.groups for symbol in group]
    function = njit(sm.lambdify([*symbols, zero], tuple(filled), modules="numpy", cse=True))
    arguments = task.arguments(0)

    @njit
    def element_many(n, values, a):
        total = 0.0
        for i in range(n):
            x = values[i & 15]
            M, K_s, K_d, K_g, C, F = function(a[0], a[1], a[2], x, a[4], x, a[6], a[7], a[8], a[9], 0.0)
            total += M[0, 0] + K_s[0, 0] + K_d[0, 0] + K_g[1, 1] + C[0, 1] + F[0, 0]
        return total

    @njit
    def motion_many(n, values, a):
        total = 0.0
        for i in range(n):
            (s,) = function(values[i & 15], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8], a[9], a[10], 0.0)
            total += s[0, 0]
        return total

    many = element_many if task.name == "beam element" else motion_many
    return Candidate(
        "lambdify, cse, njit", _of_function(task, lambda *a: function(*a, 0.0)), lambda: function(*arguments, 0.0),
        lambda n: many(n, task.values, arguments), "new dense arrays at every call",
    )  # fmt: skip


def _of_function(task: Task, function: Callable) -> Callable[[int], Outputs]:
    def outputs(k: int) -> Outputs:
        arrays = function(*task.arguments(k))
        return {name: array.reshape(zeros(task)[name].shape) for name, array in zip(task.matrices, arrays, strict=True)}

    return outputs


def pydy_cython(task: Task, folder: Path) -> Candidate:
    from pydy.codegen.cython_code import CythonMatrixGenerator

    prefix = f"pydy_{task.name.replace(' ', '_').replace('-', '_')}"
    generator = CythonMatrixGenerator(task.groups, list(task.matrices.values()), prefix=prefix)
    with _environment(CFLAGS=" ".join(FLAGS)):
        evaluate = generator.compile(tmp_dir=str(folder))
    inputs, flat = task.sample(0), [np.zeros(matrix.rows * matrix.cols) for matrix in task.matrices.values()]

    def outputs(k: int) -> Outputs:
        arrays = evaluate(*task.sample(k), *(array.copy() for array in flat))
        if len(flat) == 1:  # it is then returned alone
            arrays = (arrays,)
        return dict(zip(task.matrices, arrays, strict=True))

    return Candidate("PyDy, Cython", outputs, lambda: evaluate(*inputs, *flat), None, "dense arrays")


@contextmanager
def _environment(**variables: str) -> Iterator[None]:
    before = dict(os.environ)
    os.environ.update(variables)
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)
