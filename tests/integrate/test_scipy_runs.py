"""Runs by scipy's methods: progress, and a limit that names what to do."""

import numpy as np
import pytest
from machines import pendulum
from runs import solved

from kaneflex import UserError, load, read_scene, scene_of, with_settings
from kaneflex.integrate import by_scipy
from kaneflex.solve.simulation import solve

PLANE = pendulum(
    "mass = 1, inertia = 1", "free = true, initial_speed = 1", "wheel", "axle",
    loads='brake = {torque_at = "axle", law = "-axle_speed"}',
    sensors='angle = {position = "axle", component = "angle"}',
    solve={"preset": "rigid", "duration": "5 s", "steps": 20, "errors": "none"},
)


@pytest.mark.parametrize("method", ["DOP853", "RK45", "Radau", "LSODA"])
def test_every_method_in_the_plane_gives_the_closed_form(method):
    """A wheel that a brake stops: its angle 1 - exp(-t), on which its rates don't depend."""
    found = solved(scene_of(PLANE), f"solve.forward.method={method}", "solve.forward.tolerance=1e-8")
    assert found.series["angle"].values == pytest.approx(1.0 - np.exp(-found.times), abs=1e-6)


def test_differences_leave_alone_what_nothing_depends_on():
    jacobian = by_scipy.jacobian_of(lambda t, y: np.array([y[1], -4.0 * y[0] * y[1], y[0]]), np.array([1.0, 1.0, 0.0]))
    found = jacobian(0.0, np.array([0.5, 2.0, 1e300]))
    assert found == pytest.approx(np.array([[0.0, 1.0, 0.0], [-8.0, -2.0, 0.0], [1.0, 0.0, 0.0]]), abs=1e-6)


def test_a_second_opinion_reports_its_progress_and_ends(monkeypatch):
    settings = ["solve.start=zero", "solve.steps=20", "solve.integrator=scipy", "solve.errors=none"]
    model = load(with_settings(read_scene("four-bar"), settings))
    shares = []
    monkeypatch.setattr(by_scipy, "MOST_EVALUATIONS", 3000)
    with pytest.raises(UserError, match=r"solve\.integrator = 'scipy': 3000 evaluations reach only .* radau or"):
        solve(model, shares.append)
    assert len(shares) > 10 and shares == sorted(shares) and 0.0 < shares[0] < shares[-1] < 1.0
