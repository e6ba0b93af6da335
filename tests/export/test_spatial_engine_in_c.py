"""The engine in space as C, printed from the functions that numba compiles, for a mechanism with a loop and a ball."""

import ctypes

import numpy as np
import pytest
from test_c import HEADS, SHARED, built

from kaneflex import load, scene_of
from kaneflex.derive.printers.c_printer import Printer
from kaneflex.multibody.compile.addresses import C_TYPES, by_address
from kaneflex.multibody.dynamics import reduction, spatial_entries
from kaneflex.multibody.dynamics.spatial_work import SPACE
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.spatial_initial_state import start_of
from kaneflex.multibody.time import collocation
from kaneflex.multibody.time.error_bounds import ErrorBounds, Method
from kaneflex.multibody.time.run import TABLES

ENTRIES = {
    "project": spatial_entries.project, "basis": reduction.basis, "reduced_demand": reduction.reduced_demand,
    "integrate": collocation.integrate,
}  # fmt: skip
SCENE = """
schema = 1
like = "spatial-slider-crank-elastic"
bodies.bob = {mass = 0.02, inertia = [2e-6, 2e-6, 1e-6], centre = [0.01, 0, -0.03]}
joints.hanger = {spherical = ["rod.end", "bob.start"]}
drives.hanger = {free = true}
solve = {preset = "coupled", modes = 2, start = "zero"}
"""
"""With a bob, as the tree goes through the universal joint and not through the rod's ball."""
STEPS = 40


@pytest.fixture(scope="module")
def system():
    coupled = load(scene_of(SCENE)).coupled_in_space
    found = coupled.module.system
    assert found.layout.cuts and len(found.engine.parts["balls"])
    return found


@pytest.fixture(scope="module")
def in_c(system, tmp_path_factory, compiler):
    """The entries in C, which take arrays by address as those of numba do."""
    printer = Printer(system.engine.kernels)
    kinds = {name: (SPACE, *spatial_entries.ENTRIES[entry].args[1:]) for name, entry in ENTRIES.items()}
    for name, entry in ENTRIES.items():
        printer.function(entry, kinds[name], "", name)
    text = HEADS + printer.text()
    shared = ctypes.CDLL(str(built({"engine.c": text}, tmp_path_factory.mktemp("space"), compiler, *SHARED)))
    made = {}
    for name, entry in ENTRIES.items():
        made[entry] = getattr(shared, name)
        made[entry].argtypes = [C_TYPES.get(kind, ctypes.c_void_p) for kind in kinds[name]]
        made[entry].restype = ctypes.c_int64
    return lambda entry, *values: made[entry](system.engine._handle.address, *map(by_address, values))


@pytest.fixture(scope="module")
def states(system):
    """A start, and coordinates, speeds, accelerations and inputs near it."""
    start, random = start_of(system), np.random.default_rng(7)
    q, u = np.tile(start.q, (4, 1)), np.tile(start.u, (4, 1))
    coordinates, speeds = system.engine.modal
    q[:, coordinates] = 1e-4 * random.normal(size=(4, len(coordinates)))
    u[:, speeds] = 1e-2 * random.normal(size=(4, len(speeds)))
    return start, np.hstack([q, u, random.normal(size=u.shape), np.zeros((4, system.engine.inputs))])


def agree(one, other, magnified=0.0):
    assert np.isfinite(one).all() and abs(one).max() > 0.0
    assert abs(one - other).max() <= 1e-12 * abs(one).max() + magnified


def test_states_and_reactions_are_those_of_numba(system, states, in_c):
    start, given = states
    engine, work, n, speeds = system.engine, system.work, len(system.state_coordinates), system.engine.size
    engine.choose_speeds(start.choice)
    for row in given:
        found = []
        for call in (engine.call, in_c):
            work.kept[:] = np.nan
            assert call(spatial_entries.project, 0.0, row[:n].copy(), row[n : n + speeds].copy()) == 0
            basis = np.zeros((len(start.choice.independent), speeds))
            call(reduction.basis, start.choice.independent, len(basis), basis)
            parts = "q", "u", "R", "r", "v", "omega", "a", "wrenches", "multipliers", "du", "e"
            inertia_forces = system.engine.mass() @ work.du
            found.append([basis, inertia_forces, *(getattr(work, name).copy() for name in parts)])
        *alike, rates, e = zip(*found, strict=True)
        for one, other in alike:
            agree(one, other)
        # shapes with little inertia magnify rounding of the forces, and sections turn with these shapes
        magnified = 2.0 * abs(rates[0] - rates[1]).max()
        assert magnified < 1e-11 * abs(rates[0]).max()
        agree(*e, magnified)


def test_residuals_are_those_of_numba(system, states, in_c):
    start, given = states
    independent, times, found = start.choice.independent, np.zeros(len(given)), []
    system.engine.choose_speeds(start.choice)
    for call in (system.engine.call, in_c):
        out = np.zeros((len(given), len(independent) + system.engine.size))
        done = call(
            reduction.reduced_demand, independent, len(independent), times, len(times), given, given.shape[1], out
        )  # fmt: skip
        assert done == len(given)
        found.append(out)
    agree(*found)


def test_steps_are_those_of_numba(system, states, in_c):
    """With the energy balance of the steps."""
    start, _ = states
    engine, found = system.engine, []
    times = np.linspace(0.0, 2e-3, 5)
    for call in (engine.call, in_c):
        system.project(0.0, start.q, start.u, start.choice)
        ErrorBounds(engine, Method("radau", 1e-6, system.mechanism.size), times[1]).begin()
        here, rows = engine.row(0.0), np.zeros((len(times) + 1, len(engine.row(0.0))))
        control, counts = np.array([1e-5, times[1], STEPS, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]), np.zeros(5)
        ends = np.zeros((STEPS + 1, 1))
        outcome = call(
            collocation.integrate, TABLES["radau"], control, here, here, 0, times, len(times), rows, counts, ends, 1
        )  # fmt: skip
        found.append([int(outcome), int(control[4]), here, rows[: int(control[3]) + 1]])
    (ended, taken, here, rows), (ended_in_c, taken_in_c, here_in_c, rows_in_c) = found
    assert ended == ended_in_c and taken == taken_in_c and taken > 4 and len(rows) == len(rows_in_c) > 1
    n = system.engine.size
    for part in (slice(1), slice(1, 1 + n), slice(1 + n, 1 + 2 * n), slice(-engine.count(at.WORKS), None)):
        agree(here[part], here_in_c[part])
        agree(rows[1:, part], rows_in_c[1:, part])
