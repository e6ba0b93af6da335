"""Checked kernels: they compute what the others do, and refuse what the others would read beyond."""

import doctest

import numpy as np
import pytest
from runs import model

import kaneflex
from kaneflex.generated import beam_timoshenko, engine
from kaneflex.support import checking


def test_checked_kernels_compute_the_same():
    safe, p, s = kaneflex.checked(engine), np.array([1.1, 3e7, 1500.0, 0.03, 0.06]), np.linspace(1.0, 2.0, 5)
    assert safe.PARAMETERS is engine.PARAMETERS
    for name, more in (("M", ()), ("K_g", (s,)), ("F", (s,))):
        shape = {"F": (6,)}.get(name, (6, 6))
        found, plain = np.zeros(shape), np.zeros(shape)
        getattr(safe, name)(p, *more, found)
        getattr(engine, name)(p, *more, plain)
        assert (found == plain).all() and found.any()
    motion = model("engine").motion
    out = np.zeros((3, len(engine.SCALARS)))
    safe.tabulate(np.array([0.0, 0.01, 0.02]), motion.parameters, out)
    assert (out == motion.table(np.array([0.0, 0.01, 0.02]))).all()


def test_every_kernel_of_a_module_is_checked():
    for module in (engine, beam_timoshenko, model("four-bar").module, model("elastic-pendulum").coupled.module):
        safe = kaneflex.checked(module)
        kernels = [name for name, value in vars(module).items() if hasattr(value, "py_func")]
        plain = {name.rstrip("_0123456789") for name in kernels if getattr(safe, name) is getattr(module, name)}
        assert plain <= {"table", "table_rate", "table_curvature"}


@pytest.mark.parametrize(("kernel", "arguments", "message"), [
    ("K_s", (np.zeros(4), np.zeros((6, 6))), r"K_s: p has shape \(4,\), at least \(5,\) is required"),
    ("K_s", (np.zeros(5), np.zeros((5, 6))), r"K_s: out has shape \(5, 6\), \(6, 6\) is required"),
    ("K_g", (np.zeros(5), np.zeros(4), np.zeros((6, 6))), r"K_g: s has shape \(4,\)"),
    ("F", (np.zeros(5), np.zeros(5), np.zeros((6, 1))), r"F: out has shape \(6, 1\), \(6,\) is required"),
    ("M", ([1.0] * 5, np.zeros((6, 6))), "M: p is a list, an array of float64 is required"),
    ("M", (np.zeros(5, np.float32), np.zeros((6, 6))), "M: p is an array of float32"),
    ("motion", (0.0, np.zeros(19), np.zeros(9)), r"motion: s has shape \(9,\)"),
    ("motion", (0.0, np.full(19, 30.0), np.zeros(33)), "does not hold the whole table of loads.gas.table"),
    ("tabulate", (np.zeros(3), np.zeros(19), np.zeros((2, 33))), "out has 2 rows for 3 times"),
    ("element_matrices", (np.zeros((3, 4)), np.zeros((1, 5)), np.zeros((3, 1, 6, 6, 6))), r"p has shape \(3, 4\)"),
    ("element_matrices", (np.zeros((3, 5)), np.zeros((1, 5)), np.zeros((2, 1, 6, 6, 6))), "out has 2 rows for 3 p"),
    ("element_matrices", (np.zeros((3, 5)), np.zeros((2, 5)), np.zeros((3, 1, 6, 6, 6))), "out has 1 rows for 2 s"),
])  # fmt: skip
def test_what_would_be_read_beyond_its_end_is_refused(kernel, arguments, message):
    with pytest.raises((TypeError, ValueError), match=message):
        getattr(kaneflex.checked(engine), kernel)(*arguments)


def test_the_docstrings_example():
    assert doctest.testmod(checking).failed == 0
