"""The benchmarks compare like with like: every candidate that is timed computes the same numbers."""

from dataclasses import replace

import numpy as np
import pytest
from bench import casadi_peers, peers
from bench.interleave import interleave, repeated
from bench.ivp_runs import jitted_slope, lambdified_slope
from bench.kernels import AGREEMENT, check_agreement, disagreement, single_kernels
from bench.rows import Row, Target
from bench.tasks import element_task, motion_task

from kaneflex.loading import load
from kaneflex.scene import read_scene, with_settings

TASKS = {"element": element_task, "motion": motion_task}


@pytest.fixture(scope="module")
def hand(compiler, tmp_path_factory):
    return peers.library(tmp_path_factory.mktemp("hand"), compiler)


@pytest.mark.parametrize("name", TASKS)
def test_hand_written_c_and_lambdify_agree_with_the_generated_kernels(name, hand):
    task = TASKS[name]()
    ours = peers.generated_kernels(task)
    for other in (peers.hand_written(task, hand), peers.lambdified(task, False), peers.lambdified(task, True)):
        assert disagreement(task, ours, other) < AGREEMENT


def test_what_is_called_in_a_loop_is_what_was_found_to_agree(hand):
    """The loops leave the last sample's numbers in the arrays; n = 16 ends with the sixteenth."""
    task = element_task()
    p, s = task.sample(0)
    arrays = peers.zeros(task)
    peers._element_many(16, task.values, p, s, *arrays.values())
    expected = peers.hand_written(task, hand).outputs(15)
    for name, matrix in expected.items():
        np.testing.assert_allclose(arrays[name], matrix, rtol=0.0, atol=AGREEMENT * abs(matrix).max())


@pytest.mark.parametrize("name", TASKS)
def test_casadi_agrees(name, compiler, tmp_path, peer):
    peer("casadi")
    task = TASKS[name]()
    ours = peers.generated_kernels(task)
    for other in (casadi_peers.virtual_machine(task), casadi_peers.compiled_c(task, tmp_path, compiler)):
        assert disagreement(task, ours, other) < AGREEMENT


def test_a_candidate_that_computes_something_else_is_not_timed():
    task = element_task()
    ours = peers.lambdified(task, True)

    def wrong(k):
        found = ours.outputs(k)
        found["K_g"][1, 1] *= 1.0 + 1e-11
        return found

    check_agreement(task, [ours, ours])
    with pytest.raises(ValueError, match="beam element: other differs from lambdify, cse by"):
        check_agreement(task, [ours, replace(ours, name="other", outputs=wrong)])


def test_candidates_take_turns():
    order = []
    timed = {name: lambda name=name: order.append(name) or float(len(order)) for name in "ab"}
    times = interleave(timed, 3)
    assert order == ["a", "b"] * 4  # the first turn is for compiling and is not counted
    assert (times["a"].median, times["a"].low, times["a"].high, times["a"].rounds) == (5.0, 4.0, 6.0, 3)


def test_a_call_is_repeated_until_the_clock_sees_it():
    calls = []
    repeated(lambda n: calls.append(n) or sum(range(100 * n)), at_least=1e-3)()
    assert calls[0] == 1 and calls[-1] == calls[-2] >= 32


def test_verdicts_of_targets():
    low, high = Target(1.15, 0.9), Target(100.0, 400.0, at_least=True)
    assert [low.verdict(ratio) for ratio in (0.9, 1.15, 1.16)] == ["dream", "met", "missed"]
    assert [high.verdict(ratio) for ratio in (400.0, 100.0, 99.0)] == ["dream", "met", "missed"]
    assert Row("task", "peer", None, 2.0).verdict() is None


def test_single_kernels_are_compared_with_c(hand):
    found = list(single_kernels(hand, 1, 0.0))
    assert [row.candidate for row in found] == ["hand-written C", "kaneflex"] * 6
    assert all(row.time.median > 0.0 for row in found)
    assert [row.ratio is None for row in found] == [True, False] * 6


def test_right_hand_sides_of_solve_ivp_are_the_equations_that_are_integrated():
    """Lambdified and jitted slopes against the model's own matrices, at a state and time of no symmetry."""
    model = load(with_settings(read_scene("engine"), ["solve.start=zero", "solve.modes=2"]))
    n, t = model.system.n, 0.0031
    x = np.random.default_rng(7).normal(size=2 * n)
    (row,) = model.scalars(np.array([t]))
    M, C, K, F = (model.system.dense(name, row) for name in "MCKF")
    expected = np.concatenate((x[n:], np.linalg.solve(M, F - C @ x[n:] - K @ x[:n])))
    for slope in (jitted_slope(model), lambdified_slope(model)):
        np.testing.assert_allclose(slope(t, x), expected, rtol=1e-11)
