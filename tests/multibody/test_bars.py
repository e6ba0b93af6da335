"""Chains of rigid bars on pins with torsional springs, which the one engine moves under preset coupled."""

import numpy as np
import pytest
from chains import bars
from rigid_bars import hanging_chain
from runs import solved, starts_of

from kaneflex.integrate.system import Outcome


@pytest.fixture(scope="module")
def long_chain(tmp_path_factory):
    return solved(bars(40, tmp_path_factory.mktemp("bars"), duration=0.2))


def test_four_bars_move_as_lagranges_equations_say(tmp_path):
    solution = solved(bars(4, tmp_path))
    angles, _ = hanging_chain(4, 1.0, 1.0, 0.5, np.radians(-30.0), 9.81, solution.times)
    ends = 0.25 * np.array([np.cos(angles).sum(axis=0), np.sin(angles).sum(axis=0)])
    assert solution.outcome is Outcome.COMPLETED
    for sensor, end in zip(("tip_x", "tip_y"), ends, strict=True):
        assert solution.series[sensor].values == pytest.approx(end, abs=2e-6)


def test_forty_bars_move_as_lagranges_equations_say(long_chain):
    angles, _ = hanging_chain(40, 1.0, 1.0, 0.5, np.radians(-30.0), 9.81, long_chain.times)
    assert long_chain.series["tip_x"].values == pytest.approx(np.cos(angles).sum(axis=0) / 40, abs=1e-5)


def test_forty_bars_keep_their_energy(long_chain):
    energy = long_chain.trajectory.energy
    total = energy.kinetic + energy.strain + energy.weight
    assert abs(total - total[0]).max() < 1e-7 * energy.kinetic.max()


def test_what_holds_forty_bars_is_what_their_mass_centre_asks_for(long_chain):
    """The support's force by the second derivative of the mass centre: m x'' of every bar."""
    t, pull = long_chain.trajectory, 0.0
    for k in starts_of(long_chain.model.coupled).values():
        phi, omega, epsilon = t.q[:, k + 2], t.v[:, k + 2], t.a[:, k + 2]
        pull = pull + 0.025 * (t.a[:, k] - 0.0125 * (np.sin(phi) * epsilon + np.cos(phi) * omega**2))
    assert long_chain.series["pull"].values == pytest.approx(pull, abs=1e-8 * abs(pull).max())


def test_damped_bars_lose_what_their_dampers_take(tmp_path):
    energy = solved(bars(4, tmp_path, damping=0.2)).trajectory.energy
    balance = energy.kinetic + energy.strain + energy.weight + energy.dissipated
    assert energy.dissipated[-1] > 0.01 * energy.kinetic.max()
    assert abs(balance - balance[0]).max() < 1e-6 * energy.kinetic.max()
