"""Generated kernels over arrays give each number what the compiled ones give it alone."""

import itertools
import math

import numpy as np
import pytest

from kaneflex import load, read_scene, with_settings
from kaneflex.generated import laws, tables
from kaneflex.scene.tables import Table
from kaneflex.support.array_kernels import on_arrays
from kaneflex.support.units import ANGLE, FORCE

NUMBERS = (-2.0, -0.0, 0.0, 0.3, 1.0, 4.0, math.nan)


@pytest.mark.parametrize("name", ["sign", "smaller", "larger", "clamped", "within", "chosen", "around"])
def test_functions_of_laws(name):
    kernel = getattr(laws, name)
    given = np.array([*itertools.product(NUMBERS, repeat=kernel.py_func.__code__.co_argcount)])
    np.testing.assert_allclose(on_arrays(kernel)(*given.T), [kernel(*each) for each in given], rtol=1e-15)


@pytest.mark.parametrize("period", [None, 3.0])
@pytest.mark.parametrize("name", ["table", "table_rate", "table_curvature"])
def test_lookups_in_tables(name, period):
    """Within its rows, at them and beyond, behind other numbers."""
    rows = Table(np.array([1.0, 1.5, 2.5, 3.2, 4.0]), np.array([2.0, -1.0, 0.5, 3.0, 2.0]), ANGLE, FORCE)
    p = np.array([math.nan, math.nan, *rows.coefficients(period)])
    x, kernel = np.array([-7.0, 0.3, 1.0, 1.2, 2.5, 3.9, 4.0, 4.1, 12.0]), getattr(tables, name)
    np.testing.assert_allclose(on_arrays(kernel)(x, p, 2), [kernel(each, p, 2) for each in x], rtol=1e-12)


LAW = "max(sin(main), 0) + abs(t - 0.01) + step(t, 0, 0, 0.01, 1)"
PUSH = f'loads={{push={{force_on="piston", direction=[-1, 0], law="{LAW}"}}}}'


@pytest.mark.parametrize("scene", [["engine"], ["four-bar"], ["quick-return"], ["engine", PUSH]])
def test_a_motion_is_that_of_the_compiled_kernel(scene):
    name, *settings = scene
    motion = load(with_settings(read_scene(name), settings)).motion
    times = np.linspace(0.0, 0.02, 37)
    expected = np.zeros((len(times), len(motion.column)))
    motion.module.tabulate(times, motion.parameters, expected)
    sizes = abs(expected).max(axis=0) + 1e-9 * abs(expected).max()
    assert (abs(motion.table(times) - expected) <= 1e-12 * sizes).all()


def test_what_is_no_number_comes_through():
    """A loop that cannot close has no place."""
    motion = load(read_scene("engine")).motion
    p = motion.parameters.copy()
    p[[path for path, _ in motion.module.PARAMETERS].index("bodies.rod.length")] = 0.01
    broken = type(motion)(motion.module, p).at(np.linspace(0.0, 0.02, 37))
    assert np.isnan(broken["piston.x"]).any() and np.isfinite(broken["main.angle"]).all()
