"""Newmark's loop for small systems against the one for all: the same steps, to rounding."""

from types import SimpleNamespace

import numpy as np
import pytest
from integrate_cases import affine

from kaneflex.integrate import conventions, dense, steppers, stepping
from kaneflex.integrate.by_steps import set_up
from kaneflex.integrate.run import Run, integrate
from kaneflex.integrate.stepping import State, Stored

STEPS, EVERY, ENOUGH = 21, 3, 1e300


def system_of(n, band):
    """Random matrices of three scalars, of which the first one is constant."""
    random = np.random.default_rng(n)
    inside = np.abs(np.subtract.outer(range(n), range(n))) <= band
    M, C, K = ([np.where(inside, random.normal(size=(n, n)), 0.0) for _ in range(3)] for _ in range(3))
    M = [4.0 * np.eye(n), 0.1 * M[1], None]
    return affine(n, band, {"M": M, "C": C, "K": [30.0 * np.eye(n), *K[1:]]}, random.normal(size=(n, 3)))


def table(times):
    return np.stack((np.ones_like(times), np.cos(times), np.sin(2.0 * times)), axis=1)


def run_by(loop, system, method, columns=3, bound=ENOUGH, period=5):
    """Status, states and what was stored, after two calls, the second of which begins within eight steps."""
    setup = set_up(Run(system, table, 0.3, 0.05, STEPS, method, rho_infinity=0.6))
    system_read = ((0.0,) * system.n, system.packed) if loop is dense.newmark else (system.packed,)
    scalars, *_ = setup.stream.piece(0, period)
    random = np.random.default_rng(0)
    state = State(*(random.normal(size=(columns, system.n)) for _ in State._fields))
    load = np.linspace(0.0, 1.0, columns)[::-1].copy()
    stored = Stored.of(state, STEPS // EVERY + 1)
    done, ended = 0, []
    for steps in (7, STEPS - 7):
        rest = (setup.coefficients, load, state, done, EVERY, bound, stored)
        taken, status = loop(*system_read, scalars, period, done % period, steps, *rest)
        done += taken
        ended.append((taken, status))
        if status != conventions.COMPLETED:
            break
    return ended, state, stored


@pytest.mark.parametrize(("n", "band"), [(1, 0), (5, 4), (8, 7), (8, 2)])
@pytest.mark.parametrize("method", ["newmark", "generalised-alpha"])
def test_it_takes_the_steps_of_the_loop_for_all_systems(method, n, band):
    system = system_of(n, band)
    ended, state, stored = run_by(dense.newmark, system, method)
    wanted, state_wanted, stored_wanted = run_by(steppers.newmark, system, method)
    assert ended == wanted == [(7, conventions.COMPLETED), (STEPS - 7, conventions.COMPLETED)]
    for got, want in zip((*state, *stored), (*state_wanted, *stored_wanted), strict=True):
        np.testing.assert_allclose(got, want, rtol=0.0, atol=1e-11 * np.abs(want).max())


def test_it_ends_where_the_loop_for_all_systems_does():
    system = system_of(5, 4)
    _, state, _ = run_by(steppers.newmark, system, "newmark")
    bound = 0.9 * float(np.square(state.z).sum(axis=1).max())
    ended, *_ = run_by(dense.newmark, system, "newmark", bound=bound)
    assert ended == run_by(steppers.newmark, system, "newmark", bound=bound)[0]
    assert ended[-1][1] == conventions.UNBOUNDED
    nothing = affine(5, 4, {"M": [None] * 3, "C": [None] * 3, "K": [None] * 3}, np.ones((5, 3)))
    for loop in (dense.newmark, steppers.newmark):
        assert run_by(loop, nothing, "newmark")[0] == [(0, conventions.SINGULAR)]


def test_the_time_of_a_step_is_that_of_the_loop_by_the_steps(monkeypatch):
    """By a clock that goes on by a millisecond whenever it is read: two readings for 20 steps make 50 us a step."""
    readings = iter(range(1000))
    monkeypatch.setattr(stepping, "time", SimpleNamespace(perf_counter=lambda: 1e-3 * next(readings)))
    none = np.zeros(2)
    run = Run(system_of(2, 1), table, 0.0, 0.01, 20, "newmark", start=(none, none))
    assert integrate(run).ns_per_step == pytest.approx(5e4)
