"""Runs of several systems side by side: what each gives alone, whatever goes beside it, and those that break off."""

from dataclasses import replace

import numpy as np
import pytest
from integrate_cases import affine, constant, parametric

from kaneflex.integrate.batch import integrate_batch
from kaneflex.integrate.outcome import Outcome
from kaneflex.integrate.run import Run, integrate
from kaneflex.support.errors import UserError

COMPILED = ("newmark", "generalised-alpha", "gauss", "radau")
CYCLE = 2.0 * np.pi
STEPS = 60


def case(seed: int, **changes: object) -> Run:
    """Three coordinates, M, C and K periodic; band, number of scalars, step and zeros differ with the seed."""
    random = np.random.default_rng(seed)
    near = np.abs(np.subtract.outer(range(3), range(3))) <= 1 + seed % 2
    draw = [near * random.normal(size=(3, 3)) for _ in range(3)]
    more = [[np.eye(3) * 0.2, None, None], [0.01 * np.eye(3)]][seed % 2][: 1 + 2 * (seed % 3 == 0)]
    terms = {
        "M": [np.diag([3.0, 6.0, 4.5]), 0.1 * (draw[0] + draw[0].T), *(None for _ in more)],
        "C": [0.4 * np.eye(3), draw[1] - draw[1].T, *(None for _ in more)],
        "K": [np.diag([3.0, 20.0, 150.0]), 0.3 * draw[2], *more],
    }
    count = 2 + len(more)
    system = affine(3, 1 + seed % 2, terms, random.normal(size=(3, count)))
    rate = 1.0 + 0.1 * seed

    def table(times: np.ndarray) -> np.ndarray:
        return np.stack([np.cos(k * rate * times) for k in range(count)], axis=1)

    made = Run(system, table, 0.3, CYCLE / rate / STEPS, STEPS, "gauss", "periodic", STEPS)
    return replace(made, **changes)


def alone(run: Run):
    return integrate(run)


def assert_same(run: Run, found, tolerance: float = 1e-9) -> None:
    expected = alone(run)
    assert (found.outcome, found.message) == (expected.outcome, expected.message)
    np.testing.assert_array_equal(found.times, expected.times)
    for name in "zva":
        got, wanted = getattr(found, name), getattr(expected, name)
        np.testing.assert_allclose(got, wanted, rtol=0, atol=tolerance * np.abs(wanted).max())
    if expected.multipliers is None:
        assert found.multipliers is None
    else:
        np.testing.assert_allclose(np.abs(found.multipliers), np.abs(expected.multipliers), rtol=0, atol=1e-9)


@pytest.mark.parametrize("method", COMPILED)
@pytest.mark.parametrize("more", [{}, {"n_steps": 2 * STEPS + 3, "every": 4}], ids=["a cycle", "cycles"])
def test_periodic_motions_side_by_side_are_those_alone(method, more):
    runs = [case(seed, method=method, **more) for seed in range(11)]
    found = integrate_batch(runs)
    assert len({found[k].z[0, 0] for k in range(11)}) == 11
    for run, trajectory in zip(runs, found, strict=True):
        assert_same(run, trajectory)


@pytest.mark.parametrize("method", COMPILED)
@pytest.mark.parametrize("period_steps", [None, STEPS])
def test_motions_from_given_states_are_those_alone(method, period_steps, monkeypatch):
    monkeypatch.setattr("kaneflex.integrate.streams.LARGEST_PIECE", 8 * 3 * 4 * 17)
    random = np.random.default_rng(3)
    more = {"method": method, "period_steps": period_steps, "n_steps": 100, "every": 3}
    runs = [case(seed, start=(random.normal(size=3), random.normal(size=3)), **more) for seed in range(4)]
    runs.append(case(4, start="zero", **more))
    for run, trajectory in zip(runs, integrate_batch(runs), strict=True):
        assert_same(run, trajectory)


def test_what_goes_beside_a_run_changes_no_bit_of_it():
    runs = [case(seed) for seed in range(10)]
    together = integrate_batch(runs)
    for some in (runs[:1], runs[3:8], runs[::-1]):
        for run, trajectory in zip(some, integrate_batch(some), strict=True):
            for name in "zva":
                np.testing.assert_array_equal(getattr(trajectory, name), getattr(together[runs.index(run)], name))


def test_generalised_alpha_takes_another_damping_in_each_lane():
    runs = [case(1, method="generalised-alpha", rho_infinity=rho) for rho in (0.1, 0.5, 0.9)]
    for run, trajectory in zip(runs, integrate_batch(runs), strict=True):
        assert_same(run, trajectory)


def with_mathieu(modulation: float) -> Run:
    system, table = parametric(1.0, modulation, rate=0.01, force=1.0)
    return Run(system, table, 0.0, CYCLE / STEPS, STEPS, "newmark", "periodic", STEPS)


def test_an_unstable_run_is_left_to_itself_and_the_others_go_on():
    runs = [with_mathieu(modulation) for modulation in (0.01, 0.9, 0.02)]
    assert [alone(run).outcome for run in runs] == [Outcome.COMPLETED, Outcome.UNSTABLE, Outcome.COMPLETED]
    first, second, third = integrate_batch(runs)
    assert second is None
    assert_same(runs[0], first)
    assert_same(runs[2], third)


@pytest.mark.parametrize("method", COMPILED)
def test_a_run_that_breaks_off_disturbs_no_other(method):
    calm, table = constant(np.eye(2), 0.1 * np.eye(2), np.diag([4.0, 9.0]), [1.0, 2.0])
    growing, _ = constant(np.eye(2), -40.0 * np.eye(2), np.diag([4.0, 9.0]), [1.0, 2.0])
    massless, _ = constant(np.diag([1.0, 0.0]), np.zeros((2, 2)), np.diag([1.0, 0.0]), [1.0, 0.0])
    runs = [Run(system, table, 0.0, 0.01, 400, method) for system in (calm, growing, massless, calm)]
    outcomes = [alone(run).outcome for run in runs]
    assert outcomes == [Outcome.COMPLETED, Outcome.UNSTABLE, Outcome.SINGULAR, Outcome.COMPLETED]
    found = integrate_batch(runs)
    assert found[1] is None and found[2] is None
    assert_same(runs[0], found[0])
    np.testing.assert_array_equal(found[0].z, found[3].z)


def test_a_table_that_ends_and_arguments_of_no_use_are_left_to_integrate():
    good = case(2, start="zero", period_steps=None)

    def lost(times: np.ndarray) -> np.ndarray:
        return np.where(times[:, None] > 1.0, np.nan, good.table(times))

    runs = [good, replace(good, table=lost), replace(good, step=-1.0), replace(good, start=(np.zeros(9), np.zeros(9)))]
    runs += [replace(good, method="exact-modal"), replace(good, method="scipy")]
    found = integrate_batch(runs)
    assert [trajectory is None for trajectory in found] == [False, True, True, True, True, True]
    assert_same(good, found[0])
    with pytest.raises(UserError, match="not a finite number"):
        alone(runs[1])


def test_runs_of_other_lengths_methods_and_sizes_share_no_lanes_and_are_all_integrated():
    one, table = constant(np.eye(1), 0.1 * np.eye(1), np.eye(1), [1.0])
    runs = [case(0), case(1, method="newmark"), case(2, n_steps=2 * STEPS), case(3, start="zero")]
    runs.append(Run(one, table, 0.0, 0.1, STEPS, "gauss"))
    for run, trajectory in zip(runs, integrate_batch(runs), strict=True):
        assert_same(run, trajectory)


def test_a_long_run_and_one_of_many_coordinates_are_left_to_integrate():
    n = 60
    system, table = constant(np.eye(n), 0.1 * np.eye(n), np.diag(np.arange(1.0, n + 1.0)), np.ones(n))
    wide = Run(system, table, 0.0, 0.1, STEPS, "newmark", "periodic", STEPS)
    long = case(1, start="zero", period_steps=None, n_steps=10**6)
    found = integrate_batch([wide, long, replace(wide, start="zero"), replace(long, n_steps=10)])
    assert [trajectory is None for trajectory in found] == [True, True, False, False]
