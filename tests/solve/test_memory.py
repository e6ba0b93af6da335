"""What a run needs is known before it starts, and a run that asks for more than the machine has is refused."""

import _thread
import gc
import signal
import threading
import time
import tracemalloc

import numpy as np
import pytest
from numba.core.runtime import _nrt_python, rtsys
from runs import model

from kaneflex import SceneError, load, read_scene, with_settings
from kaneflex.fem.spatial_map import map_of
from kaneflex.mechanism.affine import Affine, from_entries
from kaneflex.solve import run_checks
from kaneflex.solve.simulation import solve


@pytest.fixture(autouse=True)
def eight_gigabytes(monkeypatch):
    monkeypatch.setattr(run_checks, "installed", lambda: 8 * 2**30)


@pytest.mark.parametrize("preset", ["rigid", "quasistatic", "linear", "stiffened", "coupled"])
def test_a_thousand_million_instants(preset):
    """The one-way presets store few of them, but make a table of the whole cycle."""
    with pytest.raises(SceneError, match=r"^solve\.steps = 1000000000: the run needs [\d.e+]+ GiB, and"):
        load(with_settings(read_scene("engine"), [f"solve.preset={preset}", "solve.steps=1000000000"]))


def test_a_run_without_a_cycle_makes_its_table_piece_by_piece():
    settings = ["solve.steps=1000000000", "solve.start=zero", "solve.duration=1 s"]
    assert load(with_settings(read_scene("engine"), settings)).options.steps == 10**9


@pytest.mark.parametrize(("scene", "preset", "body", "elements"), [
    ("engine", "stiffened", "rod", 100_000), ("engine", "coupled", "rod", 1_000_000),
    ("elastic-pendulum", "coupled", "strip", 10_000), ("crankshaft-torsion", "linear", "journal_1", 2_000),
    ("robot-arm-elastic", "coupled", "upper_arm", 100_000),
])  # fmt: skip
def test_a_hundred_thousand_elements(scene, preset, body, elements):
    """A periodic start takes the 2 n unit states, links that turn in the mean the eigenvectors of a full matrix; all
    the assembled ones."""
    refusal = rf"^bodies\.{body}\.beam\.elements = {elements}: the run needs [\d.e+]+ GiB, .* Use fewer elements"
    with pytest.raises(SceneError, match=refusal):
        load(with_settings(read_scene(scene), [f"solve.preset={preset}", f"{body}.elements={elements}"]))


@pytest.mark.parametrize("integrator", ["radau", "gauss"])
def test_too_many_states_to_follow_over_a_cycle_are_refused_at_once(integrator):
    """6000 states of an unreduced rod took more than 130 s without a word; a few modes of it take no time."""
    settings = ("rod.elements=1000", f"solve.integrator={integrator}", "solve.errors=none")
    refusal = r"solve\.start = 'periodic': 3000 coordinates and 1440 steps would need 4e\+12 operations .*\. Set "
    with pytest.raises(SceneError, match=refusal + r"solve\.reduction"):
        solve(model("engine", *settings))
    reduced = ("solve.reduction=craig-bampton", "solve.modes=4", "solve.steps=360")
    assert solve(model("engine", *settings, *reduced)).outcome.value == "completed"


def test_four_hundred_elements_take_no_full_matrix():
    """Of the 1203 rows of the rod: 12 MB each, of which there were ten at once."""
    fine = with_settings(read_scene("engine"), ["solve.preset=coupled", "rod.elements=400"])
    assert peak(lambda: load(fine)) < 6e7


def test_what_is_proposed_is_taken(monkeypatch):
    """The motion of the rigid engine, 33 numbers an instant: half of the machine's memory."""
    monkeypatch.setattr(run_checks, "installed", lambda: 10_000_000)
    with pytest.raises(SceneError) as error:
        load(with_settings(read_scene("engine"), ["solve.preset=rigid", "solve.steps=100000"]))
    most = int(error.value.cure.split("at most ")[1].split()[0].replace(",", ""))
    found = load(with_settings(read_scene("engine"), ["solve.preset=rigid", f"solve.steps={most}"]))
    assert 8 * most * len(found.motion.column) == pytest.approx(5e6, rel=1e-3)


@pytest.mark.parametrize("steps", [1, 100])
def test_a_coupled_run_is_interrupted_at_once(steps):
    """Some ten thousand steps from one stored instant to the next, or four million to the only one."""
    settings = ("solve.tolerance=1e-13", "solve.duration=100 s", f"solve.steps={steps}")
    slow = model("elastic-pendulum", *settings)
    timer = threading.Timer(0.8, _thread.interrupt_main)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # processes that run tests may ignore Ctrl-C
    began = time.perf_counter()
    timer.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            solve(slow)
    finally:
        signal.signal(signal.SIGINT, before)
    assert time.perf_counter() - began < 0.8 + 2.0  # a second, on a machine that does nothing else


def peak(work):
    """Memory that something takes at most [bytes]."""
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_products_of_narrow_matrices_are_sparse():
    """Thirty rigid bodies on a link of a thousand coordinates: 8 MB each as full matrices."""
    entry = from_entries((6, 1000), [2], [3], [1.0])
    L = sum((Affine.term((f"l{k}",), entry) for k in range(30)), Affine.zero(6, 1000))
    assert peak(lambda: L.T @ L) < 2e7
    assert (L.T @ L).value({f"l{k}": 1.0 for k in range(30)})[3, 3] == 900.0


def test_the_map_of_joints_is_not_of_all_nodes():
    """A rod of 60 elements in space: L and its rates at 33 instants are 105 MB."""
    fine = model("spatial-slider-crank-elastic", "solve.preset=linear", "rod.elements=60")
    motion = fine.motion.rigid_only.at(np.linspace(0.0, fine.scene.horizon, 33))
    assert fine.equations.size > 350
    assert peak(lambda: map_of(fine.motion.deforming.map.joined, motion)) < 2e7


@pytest.mark.parametrize("scene", ["engine-torque", "engine"])
def test_compiled_functions_release_their_arrays(scene):
    """numba counts allocations that are not freed yet: a second run leaves no more of them than the first."""
    settings = ["solve.duration=10 ms", "solve.steps=100"] if scene == "engine-torque" else []
    kept = []
    _nrt_python.memsys_enable_stats()
    try:
        for _ in range(2):
            solve(load(with_settings(read_scene(scene), settings)))
            gc.collect()
            stats = rtsys.get_allocation_stats()
            kept.append(stats.alloc - stats.free)
    finally:
        _nrt_python.memsys_disable_stats()
    assert kept[1] <= kept[0]
