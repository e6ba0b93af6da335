"""Measured order of convergence of every integrator on the engine itself: its motion, its gas, its elastic rod."""

import numpy as np
import pytest
from runs import alike, model, run

from kaneflex.integrate.methods import METHODS
from kaneflex.solve.simulation import solve

ENGINE = ("engine", "rod.elements=2")
PAPER = ("engine-paper",)
FINEST = {"engine": ("solve.integrator=radau", "solve.steps=11520"), "engine-paper": ("solve.steps=23040",)}


def error(scene: tuple[str, ...], method: str, steps: int, what: str) -> float:
    """Relative rms error of z, v or a over the run, against a far finer one."""
    exact = run(*scene, *FINEST[scene[0]]).trajectory
    found = run(*scene, f"solve.integrator={method}", f"solve.steps={steps}").trajectory
    every = (len(exact.times) - 1) // steps
    assert found.times == pytest.approx(exact.times[::every])
    expected = getattr(exact, what)[::every]
    return np.linalg.norm(getattr(found, what) - expected) / np.linalg.norm(expected)


@pytest.mark.parametrize("what", ["z", "v"])
@pytest.mark.parametrize(
    ("method", "steps"), [("newmark", 2880), ("generalised-alpha", 2880), ("gauss", 720), ("radau", 360)], ids=str
)
def test_measured_order_on_the_engine(method, steps, what):
    """Periodic cycle, coefficients that change with the crank angle, pressure from a table: steps halved twice."""
    errors = [error(ENGINE, method, steps * 2**k, what) for k in range(3)]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    tolerance = {"gauss": 0.1, "radau": 0.4}.get(method, 0.02)  # stiff modes: rates of radau towards order 3
    assert orders == pytest.approx([METHODS[method].order] * 2, abs=tolerance)


@pytest.mark.parametrize("what", ["z", "v"])
def test_measured_order_of_exact_modes(what):
    """Only the load's course within a step is interpolated, linearly: order two."""
    errors = [error(PAPER, "exact-modal", steps, what) for steps in (1440, 2880, 5760)]
    assert np.log2(np.divide(errors[:-1], errors[1:])) == pytest.approx([2, 2], abs=0.15)


def test_radau_in_480_steps_beats_gauss_in_720_and_the_second_order_methods_in_5760():
    radau = error(ENGINE, "radau", 480, "z")
    assert radau < 1e-5
    for method, steps in (("newmark", 5760), ("generalised-alpha", 5760), ("gauss", 720)):
        assert error(ENGINE, method, steps, "z") > radau


def test_methods_agree_on_what_is_measured():
    """Sensors, to 2e-4 of their largest value, at 11520 steps."""
    finest = run(*ENGINE, *FINEST["engine"]).series
    for method in ("newmark", "generalised-alpha"):
        series = run(*ENGINE, f"solve.integrator={method}", "solve.steps=11520").series
        for name in ("tip_axial", "mid_transverse", "rod_force_piston", "crank_torque"):
            scale = np.abs(finest[name].values).max()
            assert np.abs(series[name].values - finest[name].values).max() < 2e-4 * scale, name


@pytest.mark.parametrize("method", ["newmark", "generalised-alpha", "gauss", "radau"])
def test_cycle_closes(method):
    """A periodic start comes back to itself, and nothing grows."""
    trajectory = run(*ENGINE, f"solve.integrator={method}", "solve.steps=1440").trajectory
    for series in (trajectory.z, trajectory.v):
        assert series[-1] == pytest.approx(series[0], abs=1e-9 * np.abs(series).max())
    assert np.abs(trajectory.multipliers).max() < 1


def test_scipy_gives_a_second_opinion():
    """From rest over a fortieth of a cycle, where solve_ivp is still affordable."""
    short = ("engine-transient", "rod.elements=1", "solve.duration=0.0005 s", "solve.steps=400")
    ours, theirs = (run(*short, f"solve.integrator={method}").trajectory for method in ("radau", "scipy"))
    assert ours.z == pytest.approx(theirs.z, abs=1e-6 * np.abs(theirs.z).max())


def test_an_instability_of_the_steps_is_not_one_of_the_machine():
    """The four-bar at a thousandth of its speed, in default steps: nothing but a slow response, as the statics say."""
    slow = ("four-bar", "main.speed=0.3 rpm")
    found, static = (run(*slow, f"solve.preset={preset}").series for preset in ("stiffened", "quasistatic"))
    alike(found, static, 1e-3, ("coupler_force", "crank_torque"))
    grown = solve(model("engine-elastic-crank", "crank.elements=8", "solve.integrator=newmark")).trajectory
    assert grown.message.startswith("unstable steps: with newmark") and "use integrator radau" in grown.message
