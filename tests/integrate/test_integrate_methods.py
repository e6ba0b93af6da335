"""Order, stability, damping and conservation of the integrators, each measured, on the engine, too."""

from types import SimpleNamespace

import numpy as np
import pytest
from integrate_cases import affine, constant, solved_by_scipy
from machines import pendulum
from runs import alike, model, run, solved
from scipy_motion import jacobian

from kaneflex import UserError, scene_of
from kaneflex.integrate import stepping
from kaneflex.integrate.methods import METHODS
from kaneflex.integrate.run import Run, integrate
from kaneflex.integrate.system import Outcome
from kaneflex.solve.simulation import solve

COMPILED = ("newmark", "generalised-alpha", "gauss", "radau")


class Manufactured:
    """Band matrices (n = 6, w = 2) that vary in time, skew C included, and F such that z(t) is known.

    Scalars: 1, cos t, sin 2t for M, C, K, then one for each component of F.
    """

    n, w = 6, 2

    def __init__(self, half_bandwidth=2):
        random = np.random.default_rng(7)
        band = np.abs(np.subtract.outer(range(self.n), range(self.n))) <= self.w
        draw = [np.where(band, random.normal(size=(self.n, self.n)), 0.0) for _ in range(5)]
        one = np.eye(self.n)
        self.M = [4.0 * one + 0.1 * (draw[0] + draw[0].T), 0.1 * (draw[1] + draw[1].T), None]
        self.C = [0.3 * one, None, draw[2] - draw[2].T]
        self.K = [30.0 * one + draw[3] + draw[3].T, draw[4] + draw[4].T, 2.0 * one]
        self.phase = random.uniform(0.0, 6.0, self.n)
        force = np.hstack((np.zeros((self.n, 3)), np.eye(self.n)))
        self.system = affine(self.n, half_bandwidth, {"M": self.M, "C": self.C, "K": self.K}, force)

    def motion(self, times):
        """z, v, a, shape (n_times, n): two harmonics with different phases."""
        one, two = np.add.outer(times, self.phase), np.add.outer(2.0 * times, -self.phase)
        z = np.sin(one) + 0.2 * np.cos(two)
        v = np.cos(one) - 0.4 * np.sin(two)
        return z, v, -np.sin(one) - 0.8 * np.cos(two)

    def table(self, times):
        s = np.stack((np.ones_like(times), np.cos(times), np.sin(2.0 * times)), axis=1)
        at = [
            sum(np.multiply.outer(s[:, k], m) for k, m in enumerate(matrices) if m is not None)
            for matrices in (self.M, self.C, self.K)
        ]
        z, v, a = self.motion(times)
        force = sum(np.einsum("tij,tj->ti", m, x) for m, x in zip(at, (a, v, z), strict=True))
        return np.hstack((s, force))


def error_of(case, method, steps, until=3.0, **options):
    z, v, _ = case.motion(np.zeros(1))
    run = integrate(Run(case.system, case.table, 0.0, until / steps, steps, method, start=(z[0], v[0]), **options))
    assert run.outcome is Outcome.COMPLETED
    exact = case.motion(run.times)
    return [np.abs(got - want).max() for got, want in zip((run.z, run.v, run.a), exact, strict=True)]


@pytest.mark.parametrize("method", COMPILED)
def test_measured_order(method):
    order = METHODS[method].order
    coarse, fine = error_of(Manufactured(), method, 120), error_of(Manufactured(), method, 240)
    for before, after in zip(coarse, fine, strict=True):  # z, v and a alike
        assert np.log2(before / after) == pytest.approx(order, abs=0.15)


@pytest.mark.parametrize("method", ["newmark", "generalised-alpha"])
def test_newmark_steps_are_those_of_the_formulas(method):
    """Arnold and Bruels 2007, section 2, with dense matrices in NumPy."""
    case, step, rho = Manufactured(), 0.05, 0.6
    alpha_m, alpha_f = ((2 * rho - 1) / (rho + 1), rho / (rho + 1)) if method == "generalised-alpha" else (0.0, 0.0)
    gamma = 0.5 - alpha_m + alpha_f
    beta = 0.25 * (0.5 + gamma) ** 2
    z, v, _ = (each[0] for each in case.motion(np.zeros(1)))
    run = integrate(Run(case.system, case.table, 0.0, step, 20, method, start=(z, v), rho_infinity=rho))
    at = [[case.system.dense(name, row) for name in "MCKF"] for row in case.table(run.times)]
    M, C, K, F = at[0]
    q = a = np.linalg.solve(M, F - C @ v - K @ z)
    for k, (M, C, K, F) in enumerate(at[1:], 1):
        known, kappa = (alpha_f * q - alpha_m * a) / (1 - alpha_m), (1 - alpha_f) / (1 - alpha_m)
        z = z + step * v + step**2 * ((0.5 - beta) * a + beta * known)
        v = v + step * ((1 - gamma) * a + gamma * known)
        matrix = M + gamma * step * kappa * C + beta * step**2 * kappa * K
        q = np.linalg.solve(matrix, F - C @ v - K @ z)
        z, v, a = z + beta * step**2 * kappa * q, v + gamma * step * kappa * q, known + kappa * q
        for found, wanted in ((run.z[k], z), (run.v[k], v), (run.a[k], q)):
            np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-11 * np.abs(wanted).max())


def test_the_time_of_a_step_is_that_of_the_loop_by_the_steps(monkeypatch):
    """By a clock that goes on by a millisecond whenever it is read: two readings for 20 steps make 50 us a step."""
    readings, case, none = iter(range(1000)), Manufactured(), np.zeros(6)
    monkeypatch.setattr(stepping, "time", SimpleNamespace(perf_counter=lambda: 1e-3 * next(readings)))
    run = Run(case.system, case.table, 0.0, 0.01, 20, "newmark", start=(none, none))
    assert integrate(run).ns_per_step == pytest.approx(5e4)


@pytest.mark.parametrize("method", COMPILED)
def test_banded_and_dense_storage_agree_to_rounding(method):
    case, dense = Manufactured(), Manufactured(half_bandwidth=5)
    z, v, _ = case.motion(np.zeros(1))
    runs = [integrate(Run(c.system, c.table, 0.0, 0.02, 150, method, start=(z[0], v[0]))) for c in (case, dense)]
    np.testing.assert_allclose(runs[0].z, runs[1].z, rtol=0, atol=1e-13)
    np.testing.assert_allclose(runs[0].a, runs[1].a, rtol=0, atol=1e-11)


@pytest.mark.parametrize("method", COMPILED)
def test_output_satisfies_the_equation_of_motion(method):
    case = Manufactured()
    run = integrate(Run(case.system, case.table, 0.0, 0.2, 40, method))
    rows = case.table(run.times)
    for k, row in enumerate(rows):
        mass, damping, stiffness, force = (case.system.dense(name, row) for name in "MCKF")
        residual = mass @ run.a[k] + damping @ run.v[k] + stiffness @ run.z[k] - force
        assert np.abs(residual).max() < 1e-11 * np.abs(force).max()


def test_scipy_agrees():
    case = Manufactured()
    z, v, _ = case.motion(np.zeros(1))
    reference = integrate(Run(case.system, case.table, 0.0, 0.01, 100, "gauss", start=(z[0], v[0])))
    for name in ("DOP853", "Radau"):
        other = solved_by_scipy(case.system, case.table, reference.times[::10], (z[0], v[0]), name)
        np.testing.assert_allclose(other, reference.z[::10], rtol=0, atol=1e-8)


@pytest.mark.parametrize("method", COMPILED)
@pytest.mark.parametrize("step", [1e-3, 1.0, 1e3, 1e6])
def test_unconditionally_stable(method, step):
    """No step makes a damped constant system grow: its energy never exceeds what it starts with."""
    random = np.random.default_rng(3)
    root = random.normal(size=(4, 4))
    stiffness = root @ root.T + np.diag([1.0, 1e2, 1e4, 1e6])
    skew = random.normal(size=(4, 4))
    system, table = constant(np.diag([1.0, 2.0, 3.0, 4.0]), 0.01 * np.eye(4) + skew - skew.T, stiffness)
    run = integrate(Run(system, table, 0.0, step, 400, method, start=(np.ones(4), np.zeros(4))))
    assert run.outcome is Outcome.COMPLETED
    assert np.abs(run.z[200:]).max() <= 40.0 * np.abs(run.z[0]).max()
    if method == "gauss":  # preserves the quadratic invariant, so decay is exact
        energy = 0.5 * np.einsum("ti,ij,tj->t", run.z, stiffness, run.z)
        energy += 0.5 * np.einsum("ti,i,ti->t", run.v, [1.0, 2.0, 3.0, 4.0], run.v)
        assert np.all(np.diff(energy) <= 1e-9 * energy[0])


def multipliers_of_one_step(method, step, **options):
    """Eigenvalues of one step of z'' + z = 0."""
    system, table = constant(np.eye(1), np.zeros((1, 1)), np.eye(1))
    run = integrate(Run(system, table, 0.0, step, 1, method, start="periodic", period_steps=1, **options))
    return run.multipliers


@pytest.mark.parametrize("rho", [0.0, 0.3, 0.8, 1.0])
def test_generalised_alpha_has_the_spectral_radius_asked_for(rho):
    """Chung and Hulbert 1993, section 3. A triple eigenvalue there: good to the cube root of rounding."""
    multipliers = multipliers_of_one_step("generalised-alpha", 1e5, rho_infinity=rho)
    np.testing.assert_allclose(np.abs(multipliers), rho, atol=1e-3)


def test_generalised_alpha_hardly_damps_what_it_resolves():
    assert 1.0 - 1e-6 < np.abs(multipliers_of_one_step("generalised-alpha", 0.05, rho_infinity=0.8)[0]) < 1.0


@pytest.mark.parametrize("method", ["newmark", "gauss"])
def test_energy_is_conserved(method):
    random = np.random.default_rng(5)
    root = random.normal(size=(3, 3))
    mass, stiffness = np.diag([1.0, 2.0, 0.5]), root @ root.T + np.eye(3)
    system, table = constant(mass, np.zeros((3, 3)), stiffness)
    run = integrate(Run(system, table, 0.0, 0.5, 4000, method, start=(np.ones(3), np.zeros(3))))
    energy = np.einsum("ti,ij,tj->t", run.z, stiffness, run.z) + np.einsum("ti,ij,tj->t", run.v, mass, run.v)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-11)


def modal():
    """Decoupled modes, one of each kind; scalars 1 and f(t), a piecewise linear force with knots every 0.1."""
    # underdamped, critical, overdamped, undamped, free, sliding with friction
    omega = np.array([50.0, 7.0, 3.0, 11.0, 0.0, 0.0])
    rate = np.array([2.0, 14.0, 180.0, 0.0, 0.0, 2.0])
    mass = np.array([1.0, 2.0, 0.5, 1e-3, 3.0, 1.0])
    terms = {"M": [np.diag(mass)], "C": [np.diag(rate * mass)], "K": [np.diag(omega**2 * mass)]}
    system = affine(6, 0, terms, np.stack((np.zeros(6), np.ones(6)), axis=1))
    knots = np.random.default_rng(2).normal(size=12)

    def table(times):
        return np.stack((np.ones_like(times), np.interp(times, 0.1 * np.arange(12), knots)), axis=1)

    return system, table


def test_exact_modal_is_exact_for_piecewise_linear_forces():
    """Steps of a knot give what steps a thousand times smaller of the fourth-order method give."""
    system, table = modal()
    start = (np.linspace(-1.0, 1.0, 6), np.linspace(2.0, 3.0, 6))
    exact = integrate(Run(system, table, 0.0, 0.1, 10, "exact-modal", start=start))
    fine = integrate(Run(system, table, 0.0, 0.1 / 1000, 10_000, "gauss", start=start, every=1000))
    for got, want in ((exact.z, fine.z), (exact.v, fine.v), (exact.a, fine.a)):
        assert np.all(np.abs(got - want) <= 1e-9 * np.abs(want).max(axis=0))


def test_exact_modal_against_the_closed_form_at_huge_steps():
    """Free decay after one step of many periods: the closed forms of each kind of damping."""
    zeta, omega, step = np.array([0.02, 1.0, 3.0]), np.array([50.0, 0.7, 2.0]), 20.0
    system, table = constant(np.eye(3), np.diag(2 * zeta * omega), np.diag(omega**2))
    run = integrate(Run(system, table, 0.0, step, 1, "exact-modal", start=(np.ones(3), np.zeros(3))))
    ringing, creep = omega[0] * np.sqrt(1 - zeta[0] ** 2), omega[2] * np.sqrt(zeta[2] ** 2 - 1)
    slow, fast = creep - zeta[2] * omega[2], -creep - zeta[2] * omega[2]
    expected = [
        np.exp(-zeta[0] * omega[0] * step)
        * (np.cos(ringing * step) + zeta[0] * omega[0] / ringing * np.sin(ringing * step)),
        np.exp(-omega[1] * step) * (1 + omega[1] * step),
        (slow * np.exp(fast * step) - fast * np.exp(slow * step)) / (slow - fast),
    ]
    np.testing.assert_allclose(run.z[1], expected, rtol=1e-9, atol=1e-18)


def test_exact_modal_refuses_what_is_not_decoupled_or_not_constant():
    case = Manufactured()
    with pytest.raises(UserError, match="M couples its coordinates"):
        integrate(Run(case.system, case.table, 0.0, 0.1, 3, "exact-modal"))
    one = np.eye(1)
    system = affine(1, 0, {"M": [one, None], "C": [None, None], "K": [one, one]}, np.zeros((1, 2)))
    with pytest.raises(UserError, match="the matrices change in time"):
        integrate(Run(system, lambda t: np.stack((np.ones_like(t), t), axis=1), 0.0, 0.1, 3, "exact-modal"))


ENGINE = ("engine", "rod.elements=2")
FINEST = {"engine": ("solve.integrator=radau", "solve.steps=11520"), "engine-paper": ("solve.steps=23040",)}


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


def test_an_instability_of_the_steps_is_not_one_of_the_machine():
    """The four-bar at a thousandth of its speed, in default steps: nothing but a slow response, as the statics say."""
    slow = ("four-bar", "main.speed=0.3 rpm")
    found, static = (run(*slow, f"solve.preset={preset}").series for preset in ("stiffened", "quasistatic"))
    alike(found, static, 1e-3, ("coupler_force", "crank_torque"))
    grown = solve(model("engine-elastic-crank", "crank.elements=8", "solve.integrator=newmark")).trajectory
    assert grown.message.startswith("unstable steps: with newmark") and "use integrator radau" in grown.message


PLANE = pendulum(
    "mass = 1, inertia = 1", "free = true, initial_speed = 1", "wheel", "axle",
    loads='brake = {torque_at = "axle", law = "-axle_speed"}',
    sensors='angle = {position = "axle", component = "angle"}',
    solve={"preset": "rigid", "duration": "5 s", "steps": 20, "errors": "none"},
)


def test_a_wheel_that_a_brake_stops_gives_the_closed_form():
    """Its angle 1 - exp(-t), on which its rates don't depend."""
    found = solved(scene_of(PLANE), "solve.forward.tolerance=1e-8")
    assert found.series["angle"].values == pytest.approx(1.0 - np.exp(-found.times), abs=1e-6)


def test_differences_leave_alone_what_nothing_depends_on():
    rates = lambda t, y: np.array([y[1], -4.0 * y[0] * y[1], y[0]])  # noqa: E731
    found = jacobian(rates, 0.0, np.array([0.5, 2.0, 1e300]))
    assert found == pytest.approx(np.array([[0.0, 1.0, 0.0], [-8.0, -2.0, 0.0], [1.0, 0.0, 0.0]]), abs=1e-6)
