"""Forward mode: slopes of programs, of tables and of whole motions against differences of what they differentiate."""

import math
import os
import subprocess
import sys

import numpy as np
import pytest
import sympy as sm
from numba import njit
from runs import model
from test_program import INPUTS, evaluated, random_program

from kaneflex.derive import generate_tangent
from kaneflex.derive.emit import SLOPE_LOOKUPS, TABLE_LOOKUPS, Kernel, print_kernel
from kaneflex.derive.generate import calls
from kaneflex.derive.laws import law_expression
from kaneflex.derive.lookups import T, table, table_curvature, table_rate
from kaneflex.derive.program import Program, share
from kaneflex.derive.tangent import slope, slopes
from kaneflex.multibody.binding import find_tangent_module
from kaneflex.scene import read_scene
from kaneflex.scene.laws import FUNCTIONS
from kaneflex.scene.tables import Table


@pytest.mark.parametrize("seed", range(4))
def test_slopes_of_programs(seed):
    program = random_program(seed)
    rng = np.random.default_rng(seed)
    at = dict(zip(INPUTS, rng.uniform(0.5, 1.5, 3), strict=True))
    along = dict(zip(INPUTS, rng.uniform(-1.0, 1.0, 3), strict=True))
    small = sm.Float("1e-8", 30)

    def moved(sign):
        return evaluated(program, {symbol: sm.Float(value, 30) + sign * small * along[symbol]
                                   for symbol, value in at.items()})  # fmt: skip

    differences = (np.array(moved(1)) - np.array(moved(-1))) / 2e-8
    derivative = share(slopes(program, "slopes", ()))
    found = evaluated(derivative, at | {slope(symbol): value for symbol, value in along.items()})
    slots = [slot for slot, _ in derivative.outputs]
    whole = [found[slots.index(slot)] if slot in slots else 0.0 for slot, _ in program.outputs]
    np.testing.assert_allclose(whole, differences, rtol=1e-6, atol=1e-6)


def test_what_does_not_vary_has_no_slope():
    x, y = sm.symbols("x y")
    program = Program("f", (x, y), ((sm.Symbol("u"), sm.sin(y)),), (("out[0]", x * sm.Symbol("u")), ("out[1]", y)))
    (output,) = slopes(program, "df", [y]).outputs
    assert output == ("out[0]", slope(x) * sm.Symbol("u"))


def compiled(program: Program, arguments: tuple[str, ...], reads) -> object:
    """The printed function of a program with the lookups that it calls beside it."""
    options = {"error_model": "numpy"}
    names = {"math": math, "njit": njit, "OPTIONS": options}
    lookups = TABLE_LOOKUPS | SLOPE_LOOKUPS
    text = "\n\n".join(look for name, look in lookups.items() if calls(program, name))
    text += "\n\n" + print_kernel(Kernel(share(program), arguments, tuple(reads), "For a test."))
    exec(compile(text, "printed", "exec"), names)
    return names[program.name]


@pytest.mark.parametrize("period", [None, 2.0])
def test_slopes_of_tables(period):
    """Of value, rate and curvature, where the argument, the values, the breakpoints and the period move."""
    start = sm.Symbol("start")
    program = Program("read", (T, start), (), tuple(
        (f"out[{k}]", look(T, start)) for k, look in enumerate((table, table_rate, table_curvature))
    ))  # fmt: skip
    read = compiled(program, ("t", "p", "out"), [(start, "p[0]")])
    names = ("t", "t_slope", "p", "p_slope", "out")
    read_slope = compiled(slopes(program, "slope", [start]), names, [(start, "p[0]"), (slope(T), "t_slope")])
    rng = np.random.default_rng(3)
    knots = np.linspace(0.0, 2.0, 9)

    def block(share):
        values = np.sin(np.pi * knots) + share * np.cos(np.pi * knots) * knots * (2.0 - knots)
        stretch = 1.0 + 0.5 * share
        coefficients = Table(knots * stretch, values).coefficients(None if period is None else period * stretch)
        return np.concatenate([[1.0], coefficients])

    step = 1e-4
    p, p_slope = block(0.0), (block(step) - block(-step)) / (2 * step)
    for t in (knots[:-1] + rng.uniform(0.05, 0.2, 8)) + (0.0 if period is None else 6.0):
        out, low, high = np.zeros(3), np.zeros(3), np.zeros(3)
        read_slope(t, 0.3, p, p_slope, out)
        read(t - 0.3 * step, block(-step), low)
        read(t + 0.3 * step, block(step), high)
        np.testing.assert_allclose(out, (high - low) / (2 * step), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("function", FUNCTIONS)
def test_slopes_of_laws(function):
    program = Program("law", (T,), (), (("out[0]", law_expression(f"{function}(t) * t", {"t": T})),))
    law = compiled(program, ("t", "out"), [])
    derivative = compiled(slopes(program, "derivative", ()), ("t", "t_slope", "out"), [(slope(T), "t_slope")])
    for t in (0.7, 1.9) if function in ("log", "sqrt") else (-0.7, 1.2):
        found, low, high = np.zeros(1), np.zeros(1), np.zeros(1)
        derivative(t, 2.0, found)
        law(t - 1e-5, low)
        law(t + 1e-5, high)
        np.testing.assert_allclose(found, 2.0 * (high - low) / 2e-5, rtol=1e-8)


@pytest.mark.parametrize("scene", ["engine", "four-bar", "spin-up", "rotating-cantilever"])
def test_slopes_of_a_motion(scene):
    """The emitted slopes against differences of the emitted motion, along a direction in which every number moves."""
    found = model(scene)
    tangents, _ = find_tangent_module(found.scene, lambda stage: None)
    motion = found.motion
    rng = np.random.default_rng(5)
    along = np.zeros_like(motion.parameters)
    for k, (path, _) in enumerate(found.module.PARAMETERS):
        if path.rpartition(".")[2] not in ("table", "branch"):
            along[k] = 1e-2 * rng.uniform(-1.0, 1.0) * (motion.parameters[k] or 1.0)
    times = rng.uniform(0.0, found.scene.horizon, 20)
    step = 1e-3

    def table_at(share):
        out = np.zeros((len(times), len(motion.column)))
        found.module.tabulate(times + share * step * 1e-3 * times, motion.parameters + share * step * along, out)
        return out

    differences = (table_at(-2) - 8 * table_at(-1) + 8 * table_at(1) - table_at(2)) / (12 * step)
    slope_of = np.zeros_like(differences)
    tangents.tabulate_slopes(times, 1e-3 * times, motion.parameters, along, slope_of)
    diagnoses = [k for name, k in motion.column.items() if name.endswith((".closure", ".gap"))]
    differences[:, diagnoses] = 0.0
    sizes = np.maximum(abs(differences).max(axis=0), 1e-3 * abs(table_at(0)).max(axis=0)) + 1e-300
    np.testing.assert_allclose(slope_of / sizes, differences / sizes, rtol=0, atol=1e-6)


@pytest.mark.parametrize("scene", ["engine", "rotating-cantilever"])
def test_slopes_of_element_matrices(scene):
    found = model(scene)
    tangents, _ = find_tangent_module(found.scene, lambda stage: None)
    (link,) = found.links.values()
    p = np.array([link.parameters[name][1] for name, *_ in found.module.ELEMENT_PARAMETERS])
    along = np.random.default_rng(7).uniform(-1.0, 1.0, len(p)) * p
    for k, (name, _, target, _) in enumerate(found.module.TERMS):
        low, high, slope_of = (np.zeros((6, 1 if target == "F" else 6)) for _ in range(3))
        found.module.terms(k, p - 1e-5 * along, low)
        found.module.terms(k, p + 1e-5 * along, high)
        tangents.terms_slope(k, p, along, slope_of)
        size = abs(high).max()
        np.testing.assert_allclose(slope_of / size, (high - low) / 2e-5 / size, rtol=0, atol=1e-8, err_msg=name)


def test_bytes_do_not_hang_on_the_hash_seed():
    code = "import sys; from kaneflex.derive import generate_tangent; from kaneflex.scene import read_scene\n"
    code += "sys.stdout.reconfigure(newline=''); sys.stdout.write(generate_tangent(read_scene('spin-up'), 'x'))"
    here = generate_tangent(read_scene("spin-up"), "x")
    environment = {**os.environ, "PYTHONHASHSEED": "1"}
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, env=environment, check=True)
    assert ran.stdout.decode() == here
