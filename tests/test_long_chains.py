"""The loop for long chains of narrow band makes the steps of the loop for any matrices."""

import numpy as np
import pytest
from integrate_cases import affine
from runs import model

from kaneflex.integrate import stepping
from kaneflex.integrate.by_steps import cycle_map, set_up
from kaneflex.integrate.outcome import Outcome
from kaneflex.integrate.run import Run, integrate

ALWAYS, NEVER = 1, 10**9
METHODS = ("newmark", "generalised-alpha")


def banded_system(n, half_bandwidth, seed=0):
    """Matrices of random bands, and their table: 1 and three harmonics; one touches the last rows alone."""
    random = np.random.default_rng(seed)
    band = np.abs(np.subtract.outer(range(n), range(n))) <= half_bandwidth
    draw = [np.where(band, random.normal(size=(n, n)), 0.0) for _ in range(6)]
    at_end = np.arange(n) >= n - 2
    last = np.where(np.outer(at_end, at_end), 5.0 * draw[5], 0.0)
    one = np.eye(n)
    terms = {
        "M": [8.0 * one + 0.1 * (draw[0] + draw[0].T), 0.1 * draw[1], None, 0.1 * last],
        "C": [one, None, draw[2] - draw[2].T, None],
        "K": [80.0 * one + draw[3] + draw[3].T, 3.0 * draw[4], None, last],
    }
    force = random.normal(size=(n, 4)) * np.array([1.0, 0.0, 3.0, 0.0])
    force[: n // 2, 3] = 1.0
    return affine(n, half_bandwidth, terms, force), table


def table(times):
    return np.stack((np.ones_like(times), np.cos(times), np.sin(2.0 * times), np.cos(3.0 * times)), axis=1)


def both(monkeypatch, solve):
    """What `solve` makes of the loop for chains, and of the one for any matrices."""
    found = []
    monkeypatch.setattr(stepping, "_FULL", np.inf)
    for shortest in (ALWAYS, NEVER):
        monkeypatch.setattr(stepping, "_LONG", shortest)
        found.append(solve())
    return found


def agree(found, expected, within=1e-10):
    assert found.outcome is expected.outcome
    assert found.times == pytest.approx(expected.times)
    for name in "zva":
        one, other = getattr(found, name), getattr(expected, name)
        assert one.shape == other.shape
        assert np.abs(one - other).max() <= within * np.abs(other).max(), name


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("n", "half_bandwidth"), [(15, 0), (16, 2), (48, 5), (49, 1), (53, 5), (54, 5), (101, 3)])
def test_the_same_steps(monkeypatch, method, n, half_bandwidth):
    """Sizes on both sides of a slice; a cycle of 13 steps is read again; one step in 3 is stored."""
    system, scalars = banded_system(n, half_bandwidth, seed=n)
    start = tuple(np.random.default_rng(n).normal(size=(2, n)))
    options = {"start": start, "period_steps": 13, "every": 3}
    found, expected = both(
        monkeypatch, lambda: integrate(Run(system, scalars, 0.0, 2.0 * np.pi / 13, 40, method, **options))
    )
    assert len(found.times) == 14
    agree(found, expected)


def test_the_engine(monkeypatch):
    """A step takes 55 periods of the fastest vibration, and rounding grows by that, squared."""
    engine = model("engine", "rod.elements=16")
    found, expected = both(
        monkeypatch, lambda: integrate(Run(engine.system, engine.scalars, 0.0, engine.step, 720, "generalised-alpha"))
    )
    agree(found, expected, within=1e-8)


@pytest.mark.parametrize("method", METHODS)
def test_columns_share_a_factorisation(monkeypatch, method):
    """Every unit state over 7 steps, too few for stretches: the monodromy matrix and what the loads add."""
    system, scalars = banded_system(26, 5)
    found, expected = both(monkeypatch, lambda: cycle_map(system, scalars, 0.3, 2.0 * np.pi, 7, method))
    for name in ("monodromy", "forced"):
        one, other = getattr(found, name), getattr(expected, name)
        assert np.abs(one - other).max() <= 1e-10 * np.abs(other).max()


@pytest.mark.parametrize("row", [0, 23, 24, 30])
def test_a_vanishing_pivot_is_singular(monkeypatch, row):
    """M + h^2 / 4 K of one coordinate, whose parts cancel, but for rounding, from one step on."""
    n, step = 31, 0.1
    kept = np.diag(np.arange(n) != row).astype(float)
    gone = np.eye(n) - kept
    terms = {"M": [np.eye(n), None], "C": [None, None], "K": [kept, -(1.0 + 3e-15) * 4.0 / step**2 * gone]}
    system = affine(n, 5, terms, np.ones((n, 2)))

    def scalars(times):
        return np.stack((np.ones_like(times), np.where(times > 0.95, 1.0, 0.5)), axis=1)

    found, expected = both(monkeypatch, lambda: integrate(Run(system, scalars, 0.0, step, 20)))
    assert found.outcome is Outcome.SINGULAR
    assert found.message == expected.message
    agree(found, expected)


def test_a_runaway_is_stopped(monkeypatch):
    falling = affine(30, 0, {"M": [np.eye(30)], "C": [None], "K": [-1e4 * np.eye(30)]}, np.ones((30, 1)))
    run = Run(falling, lambda times: table(times)[:, :1], 0.0, 0.01, 5000)
    found, expected = both(monkeypatch, lambda: integrate(run))
    assert found.outcome is Outcome.UNSTABLE
    assert found.message == expected.message
    agree(found, expected)


@pytest.mark.parametrize(
    ("n", "half_bandwidth", "method", "own"),
    [(60, 5, "newmark", True), (60, 6, "newmark", False), (12, 5, "newmark", False), (60, 5, "gauss", False)],
)
def test_who_takes_the_loop_for_chains(monkeypatch, n, half_bandwidth, method, own):
    taken = []
    loop = stepping._BANDED
    monkeypatch.setattr(stepping, "_BANDED", lambda *args: taken.append(args) or loop(*args))
    integrate(Run(*banded_system(n, half_bandwidth), 0.0, 0.1, 2, method))
    assert bool(taken) == own


def test_many_scalars_with_few_rows_each_go_faster_in_the_loop_for_any_matrices():
    """As those of open chains of links: runs of eight rows would hold zeros mostly."""
    own = [np.diag(np.arange(60) // 3 == k).astype(float) for k in range(20)]
    system = affine(60, 5, {"M": own, "C": own, "K": own}, np.ones((60, 20)))
    setup = set_up(Run(system, lambda times: np.ones((len(times), 20)), 0.0, 0.1, 1, "newmark"))
    assert setup.banded is None
