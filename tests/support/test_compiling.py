"""Compilation by numba: kernels and parts are compiled with their callers."""

import pickle
from types import FunctionType

import numba
import numpy as np
import pytest

from kaneflex import read_scene
from kaneflex.generated.tables import table
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.position_analysis import place
from kaneflex.multibody import engine
from kaneflex.multibody.model.assembly import build_system
from kaneflex.multibody.model.layout import Kind
from kaneflex.multibody.time.rigid_reference import rigid_reference
from kaneflex.support.inner import PART


def test_a_kernel_that_compiled_code_calls_is_compiled_with_it_and_not_by_itself():
    """By itself it is compiled when Python calls it."""
    kernel = numba.njit(table.py_func)
    block = np.array([1.0, 0.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0])

    @numba.njit
    def doubled(x, p):
        return 2.0 * kernel(x, p, 0)

    expected = 2.0 + 0.4 * (3.0 + 0.4 * (4.0 + 0.4 * 5.0))
    assert doubled(0.4, block) == pytest.approx(2.0 * expected)
    assert not kernel.overloads
    assert kernel(0.4, block, 0) == pytest.approx(expected)
    assert len(kernel.overloads) == 1


def test_functions_without_a_module_are_compiled_beside_kernels():
    """As those of sympy.lambdify are."""
    made = FunctionType((lambda x: 2.0 * x).__code__, {"__name__": None})
    doubled = numba.njit(made)

    @numba.njit
    def summed(x):
        return doubled(x) + 1.0

    assert made.__module__ is None and summed(1.5) == 4.0


def test_parts_are_linked_once_by_what_encloses_them():
    """A part that calls others holds its own code alone; int() is a function that numba compiles and links, too."""

    @numba.njit(**PART)
    def floored(x):
        return int(x) + 1

    @numba.njit(**PART)
    def doubled(x):
        return 2 * floored(x)

    @numba.njit
    def both(x):
        return doubled(x) + floored(x + 0.5)

    assert both(3.7) == 13
    (part,) = doubled.overloads.values()
    assert len(list(part.library.get_defined_functions())) == 1


def test_a_rigid_reference_has_no_library_of_its_own(monkeypatch):
    """It uses that of its mechanism, though it has none of the contacts: a second one takes as long to compile."""
    scene = read_scene("slider-crank-clearance")
    system, _ = build_system(scene, lambda stage: None, 3)
    asked, library = [], engine.library
    monkeypatch.setattr(engine, "library", lambda kind, integrates: asked.append(kind) or library(kind, integrates))
    rigid = rigid_reference(system, place(mechanism_of(scene))).module.system
    for each in (system.engine, rigid.engine, pickle.loads(pickle.dumps(rigid.engine))):
        each._library  # noqa: B018 - which asks for the library
    assert len(asked) == 3
    assert set(asked) == {Kind.CONTACTS}
