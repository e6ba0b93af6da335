"""The kernels' tasks by CasADi, in its virtual machine and as the C that it generates."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import sympy as sm

from bench.compiled import HERE, compile_c, pointer
from bench.peers import Candidate, Outputs, zeros
from bench.tasks import Task


def _function(task: Task):
    """The task as a CasADi function of its groups, with the entries that are not zero by structure."""
    import casadi as ca

    groups = [ca.SX.sym(f"group_{k}", len(group)) for k, group in enumerate(task.groups)]
    scalars = [group[i] for group in groups for i in range(group.shape[0])]
    symbols = [symbol for group in task.groups for symbol in group]
    known = {"sin": ca.sin, "cos": ca.cos, "sqrt": ca.sqrt}
    outputs = []
    for matrix in task.matrices.values():
        entries = {(i, j): matrix[i, j] for i in range(matrix.rows) for j in range(matrix.cols) if matrix[i, j] != 0}
        values = sm.lambdify(symbols, list(entries.values()), modules=[known, "math"], cse=True)(*scalars)
        output = ca.SX(matrix.rows, matrix.cols)
        for place, value in zip(entries, values, strict=True):
            output[place] = value
        outputs.append(output)
    return ca.Function("task", groups, outputs, {"cse": True})


class _Buffer:
    """A CasADi function on memory of its own, so that nothing is converted at a call."""

    def __init__(self, function, columns: int = 1) -> None:
        self.function = function
        self.inputs = [np.zeros((columns, function.nnz_in(k) // columns)) for k in range(function.n_in())]
        self.results = [np.zeros(function.nnz_out(k)) for k in range(function.n_out())]
        self.buffer, self.trigger = function.buffer()
        for k, array in enumerate(self.inputs):
            self.buffer.set_arg(k, memoryview(array))
        for k, array in enumerate(self.results):
            self.buffer.set_res(k, memoryview(array))

    def fill(self, column: int, groups: tuple[np.ndarray, ...]) -> None:
        for array, group in zip(self.inputs, groups, strict=True):
            array[column] = group

    def dense(self, task: Task) -> Outputs:
        """The matrices of a function that is not mapped; CasADi stores columns, without structural zeros."""
        found = zeros(task)
        for k, (matrix, values) in enumerate(zip(found.values(), self.results, strict=True)):
            sparsity = self.function.sparsity_out(k)
            places = (sparsity.row(), sparsity.get_col()) if matrix.ndim == 2 else sparsity.row()
            matrix[places] = values
        return found


def _of_buffer(task: Task, function) -> Callable[[int], Outputs]:
    def outputs(k: int) -> Outputs:
        one = _Buffer(function)
        one.fill(0, task.sample(k))
        one.trigger()
        return one.dense(task)

    return outputs


def virtual_machine(task: Task) -> Candidate:
    function = _function(task)
    one, mapped = _Buffer(function), _Buffer(function.map(task.values.size), task.values.size)
    one.fill(0, task.sample(0))
    for k in range(task.values.size):
        mapped.fill(k, task.sample(k))

    def many(n: int) -> None:
        for _ in range(-(-n // task.values.size)):
            mapped.trigger()

    return Candidate(
        "CasADi, virtual machine", _of_buffer(task, function), lambda: one.trigger(), many,
        "mapped over the samples; zeros not stored",
    )  # fmt: skip


def compiled_c(task: Task, folder: Path, compiler: str) -> Candidate:
    """CasADi's own C, with the loop of casadi_loop.c around it."""
    import casadi as ca

    function = _function(task)
    stem = f"casadi_{task.name.replace(' ', '_').replace('-', '_')}"
    code = ca.CodeGenerator(f"{stem}.c")
    code.add(function)
    code.generate(f"{folder}{os.sep}")
    source = folder / f"{stem}_loop.c"
    source.write_text((HERE / "casadi_loop.c").read_text().replace("GENERATED", f"{stem}.c"))
    loop = compile_c(source, folder, compiler, f"-DVARIED={len(task.varied)}")
    external = ca.external("task", str(folder / f"{stem}_loop.so"))
    one = _Buffer(external)
    one.fill(0, task.sample(0))
    work = np.zeros(external.sz_w())
    arguments = (ctypes.c_void_p * external.sz_arg())(*(pointer(array).value for array in one.inputs))
    results = (ctypes.c_void_p * external.sz_res())(*(pointer(array).value for array in one.results))
    varied = (ctypes.c_void_p * len(task.varied))(*(one.inputs[g].ctypes.data + 8 * at for g, at in task.varied))
    rest = (pointer(task.values), varied, arguments, results, pointer(work))
    return Candidate(
        "CasADi, its C", _of_buffer(task, external), lambda: one.trigger(),
        lambda n: loop.many(ctypes.c_long(n), *rest), "zeros not stored",
    )  # fmt: skip


