"""A run says which of its forces and accelerations its steps leave in doubt, and by how much."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from runs import model, run

from kaneflex.response.sensors import Series
from kaneflex.solve import one_way_run, validity
from kaneflex.solve.simulation import solve


@pytest.fixture(autouse=True)
def patient(monkeypatch):
    """A run that compiles on a busy machine takes longer than what another one may cost."""
    monkeypatch.setattr(validity, "LONGEST_SECOND", 600.0)


def said(solution):
    """(sensor, share of its peak) of the warning that forces or accelerations part; None where there is none."""
    found = (re.search(r"^(\w+) .* differs by (\S+) of its peak", text) for text in solution.warnings)
    return next(((match[1], float(match[2])) for match in found if match), None)


def wrong(solution, sensor, finer):
    """Largest error of a sensor as a share of its peak, by a run whose steps are a fraction of the solution's."""
    true = finer.series[sensor].values
    true = true[:: (len(true) - 1) // (len(solution.times) - 1)]
    return abs(solution.series[sensor].values - true).max() / abs(true).max()


def test_axial_vibrations_from_rest_that_die_too_soon_are_named():
    """Of some ten steps a period: no single step is wrong by much, thousands of them are."""
    own, finer, finest = (run("slider-crank-150", f"solve.steps={n}") for n in (4000, 12000, 24000))
    sensor, share = said(own)
    error = wrong(own, sensor, finest)
    assert sensor == "crank_torque" and error > 0.03
    assert error / 2.0 < share < 2.0 * error
    assert said(finer) is None
    assert max(wrong(finer, name, finest) for name in ("rod_force", "crank_torque")) < 0.01


def test_a_run_that_stores_not_every_step_is_looked_at_too(monkeypatch):
    monkeypatch.setattr(one_way_run, "MAX_STORED", 2500)
    long = solve(model("slider-crank-150", "solve.steps=4000"))
    assert len(long.times) == 2001
    assert said(long) is not None


def test_the_first_two_instants_of_a_start_from_rest_are_no_news():
    """A shock excites every mode; what is wrong for longer than two steps in ten thousand is 0.4 % of the peak."""
    assert said(run("engine-transient")) is None


def test_what_is_zero_but_for_rounding_is_not_in_doubt():
    def read(*noise):
        return {"force": Series(np.array([0.0, 1e3, 2e3]), "N", ""), "side": Series(np.array(noise), "N", "")}

    times = np.arange(3.0)
    one, other = (SimpleNamespace(times=times, series=read(*noise)) for noise in ((0, 1e-13, 0), (0, 0, -3e-13)))
    assert validity._differences(one, other)["side"].max() < 1e-9
    far = SimpleNamespace(times=times, series=read(0, 20, 0))
    assert validity._differences(one, far)["side"].max() == pytest.approx(1e4)


def test_a_slow_coupled_run_leaves_no_vibration_in_its_accelerations():
    """1.4e-9 m, its tolerance, at the rod's frequencies would be as much as the piston's acceleration at 60 rpm."""
    coupled, slow = (run("engine", "main.speed=60 rpm", f"solve.preset={name}") for name in ("coupled", "quasistatic"))
    assert said(coupled) is None
    assert wrong(coupled, "rod_mid_acceleration_x", slow) < 1e-3
    assert wrong(coupled, "crank_pin_force_y", slow) < 1e-4
    assert said(run("engine", "solve.preset=coupled")) is None
