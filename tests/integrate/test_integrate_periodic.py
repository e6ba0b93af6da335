"""Periodic motion and Floquet multipliers, and how a run says that it could not go on."""

import pickle
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from integrate_cases import affine, constant, parametric, solved_by_scipy

from kaneflex.integrate.by_steps import cycle_map, periodic_near, set_up
from kaneflex.integrate.methods import tableau
from kaneflex.integrate.periodic import _verdict
from kaneflex.integrate.run import Run, integrate
from kaneflex.integrate.system import Outcome
from kaneflex.support.errors import UserError

COMPILED = ("newmark", "generalised-alpha", "gauss", "radau")
CYCLE = 2.0 * np.pi


def coupled():
    """Four coordinates, M, C (skew part included) and K periodic, damped, forced."""
    random = np.random.default_rng(11)
    draw = [random.normal(size=(4, 4)) for _ in range(4)]
    system = affine(
        4, 3,
        {"M": [np.diag([1.0, 2.0, 1.5, 0.5]) * 3.0, 0.1 * (draw[0] + draw[0].T), None],
         "C": [0.4 * np.eye(4), None, draw[1] - draw[1].T],
         "K": [np.diag([3.0, 20.0, 150.0, 900.0]) + 0.3 * (draw[2] + draw[2].T), 0.5 * np.eye(4), draw[3]]},
        random.normal(size=(4, 3)),
    )  # fmt: skip
    return system, lambda t: np.stack((np.ones_like(t), np.cos(t), np.sin(2.0 * t)), axis=1)


@pytest.mark.parametrize("method", COMPILED)
def test_periodic_start_repeats_itself_and_equals_a_long_transient(method):
    system, table = coupled()
    steps = 200
    run = integrate(Run(system, table, 0.3, CYCLE / steps, 2 * steps, method, start="periodic", period_steps=steps))
    assert run.outcome is Outcome.COMPLETED
    for motion in (run.z, run.v, run.a):
        scale = np.abs(motion).max()
        np.testing.assert_allclose(motion[steps], motion[0], rtol=0, atol=1e-10 * scale)
        np.testing.assert_allclose(motion[-1], motion[0], rtol=0, atol=1e-10 * scale)
    cycles = 120
    long = integrate(Run(system, table, 0.3, CYCLE / steps, cycles * steps, method, period_steps=steps))
    last = long.z[(cycles - 1) * steps :]
    np.testing.assert_allclose(last, run.z[: steps + 1], rtol=0, atol=1e-9 * np.abs(run.z).max())


@pytest.mark.parametrize("method", ["newmark", "gauss", "radau"])
def test_a_periodic_state_is_found_from_one_near_it(method):
    system, table = coupled()
    exact = integrate(Run(system, table, 0.3, CYCLE / 200, 200, method, start="periodic", period_steps=200))
    near = (exact.z[0] + 0.3, exact.v[0] - 0.2)
    run = Run(system, table, 0.3, CYCLE / 200, 200, method, near, 200)
    found = periodic_near(run)
    assert found.outcome is Outcome.COMPLETED
    assert np.hstack((found.z, found.v)) == pytest.approx(np.hstack((exact.z, exact.v)), abs=1e-4)
    still = system.n * [0.0]
    assert periodic_near(replace(run, table=lambda t: 0.0 * table(t), start=(still, still))) is None


@pytest.mark.parametrize("method", ["newmark", "gauss", "radau"])
@pytest.mark.parametrize("n", [4, 13])
def test_the_map_of_a_cycle_moves_any_state_as_a_run_does(method, n):
    """2 n + 1 states go side by side, in one register and in several; the run has one."""
    random = np.random.default_rng(n)
    draw = [random.normal(size=(n, n)) for _ in range(2)]
    terms = {"M": [3.0 * np.eye(n), None], "C": [0.4 * np.eye(n), draw[0]], "K": [30.0 * np.eye(n), draw[1]]}
    system = affine(n, n - 1, terms, random.normal(size=(n, 2)))

    def table(t):
        return np.stack((np.ones_like(t), np.cos(t)), axis=1)

    z, v = random.normal(size=(2, n))
    cycle = cycle_map(system, table, 0.3, CYCLE, 27, method)
    run = integrate(Run(system, table, 0.3, CYCLE / 27, 27, method, start=(z, v)))
    scales = set_up(Run(system, table, 0.3, CYCLE / 27, 27, method)).scales
    scale = np.repeat(scales[:2], n)
    moved = (cycle.monodromy @ (scale * np.concatenate((z, v))) + cycle.forced) / scale
    np.testing.assert_allclose(moved, np.concatenate((run.z[-1], run.v[-1])), rtol=0, atol=1e-11 * abs(moved).max())


@pytest.mark.parametrize("method", COMPILED)
@pytest.mark.parametrize(("steps", "every"), [(203, 4), (7, 1), (9, 11)])
def test_a_periodic_run_repeats_its_cycle(method, steps, every):
    system, table = coupled()
    arguments = (system, table, 0.3, CYCLE / steps)
    run = integrate(Run(*arguments, 2 * steps + 3, method, start="periodic", period_steps=steps, every=every))
    cycle = integrate(Run(*arguments, steps, method, start="periodic", period_steps=steps))
    at = every * np.arange((2 * steps + 3) // every + 1)
    np.testing.assert_allclose(run.times, 0.3 + CYCLE / steps * at, rtol=1e-15)
    for found, expected in zip((run.z, run.v, run.a), (cycle.z, cycle.v, cycle.a), strict=True):
        np.testing.assert_array_equal(found, expected[at % steps])
        np.testing.assert_allclose(expected[-1], expected[0], rtol=0, atol=1e-10 * np.abs(expected).max())


def beside(damping):
    """The same four coordinates among two oscillators without loads, with a damping; and the mask of the four."""
    system, table = coupled()
    moving = np.array([True, False, True, True, False, True])
    place, terms = np.ix_(moving, moving), {}
    for name in "MCK":
        terms[name] = np.zeros((3, 6, 6))
        for one, own in zip(np.eye(3), terms[name], strict=True):
            own[place] = system.dense(name, one)
        terms[name][0][~moving, ~moving] = {"M": 1.0, "C": damping, "K": 0.3}[name]
    force = np.zeros((6, 3))
    force[moving] = system.F.toarray()
    return affine(6, 5, terms, force), table, moving


@pytest.mark.parametrize("method", [*COMPILED, "spectral"])
@pytest.mark.parametrize("start", ["zero", "given", "periodic"])
def test_coordinates_at_rest_beside_others_change_nothing(method, start):
    if method == "spectral" and start != "periodic":
        pytest.skip("finds periodic motions only")
    alone, (whole, table, moving) = coupled()[0], beside(1.5)
    z = np.linspace(0.1, 0.4, 4)
    inside, period = np.zeros(6), {"period_steps": 200, "method": method}
    inside[moving] = z
    starts = ((z, -z), (inside, -inside)) if start == "given" else (start, start)
    run, found = (integrate(Run(system, table, 0.3, CYCLE / 200, 300, start=own, **period))
                  for system, own in zip((alone, whole), starts, strict=True))  # fmt: skip
    for expected, own in zip((run.z, run.v, run.a), (found.z, found.v, found.a), strict=True):
        np.testing.assert_allclose(own[:, moving], expected, rtol=0, atol=1e-12 * abs(expected).max())
        assert not own[:, ~moving].any()
    assert (found.outcome, found.message) == (run.outcome, run.message)
    found = pickle.loads(pickle.dumps(found))
    if start == "periodic":
        rest = np.roots([1.0, 1.5, 0.3]) * CYCLE
        expected = sorted([*abs(run.multipliers), *np.exp(rest), *np.exp(rest)], reverse=True)
        assert abs(found.multipliers) == pytest.approx(expected, rel=0.02 if method == "spectral" else 2e-3, abs=1e-6)
    else:
        assert found.multipliers is None


def test_coordinates_at_rest_may_be_unstable():
    system, table, _ = beside(-0.1)
    run = integrate(Run(system, table, 0.3, CYCLE / 200, 200, "radau", start="periodic", period_steps=200))
    assert run.outcome is Outcome.UNSTABLE and "exceeds one" in run.message


def test_a_singular_step_in_a_cycle_is_named_with_its_time():
    """M vanishes at the middle of the cycle."""
    system, _ = coupled()
    run = integrate(Run(
        system, lambda t: np.stack([(t != 0.5) * 1.0] * 3, axis=1), 0.0, 0.125, 8, start="periodic", period_steps=8)
    )
    assert run.outcome is Outcome.SINGULAR and run.message.endswith("at t = 0.375 s, in the first cycle")


def test_multipliers_are_those_of_the_damping():
    """Liouville: their product is exp of minus the integral of the trace of M^-1 C; largest first."""
    system, table = parametric(1.3, 0.4, rate=0.05)
    run = integrate(Run(system, table, 0.0, CYCLE / 400, 1, "gauss", start="periodic", period_steps=400))
    assert run.multipliers.shape == (2,)
    assert np.prod(run.multipliers).real == pytest.approx(np.exp(-0.05 * CYCLE), rel=1e-7)
    assert abs(run.multipliers[0]) >= abs(run.multipliers[1])


# Characteristic values of y'' + (a - 2 q cos 2 x) y = 0 to 17 digits, computed with mpmath. With t = 2 x this
# is z'' + (a/4 - q/2 cos t) z = 0. Values with an even index belong to solutions of period pi in x, whose
# multiplier over a cycle of t is +1, those with an odd one to -1. (Zhang and Jin 1996, Computation of Special
# Functions, print b_4 = 12.986489953 for q = 25.) Rows: q, multiplier, a.
MATHIEU = [
    (1.0, 1, -0.45513860410741355), (1.0, -1, -0.11024881699209517), (1.0, -1, 1.8591080725143635),
    (1.0, 1, 3.9170247729984712), (5.0, 1, 2.0994604454866654), (5.0, 1, 7.4491097395291778),
    (10.0, -1, 7.9860691446816604), (25.0, 1, 12.986489952742460),
]  # fmt: skip


@pytest.mark.parametrize(("q", "multiplier", "a"), MATHIEU)
def test_mathieu_boundaries(q, multiplier, a):
    """On a boundary the trace of the monodromy matrix is +-2; a little to either side it is not."""

    def trace(value):
        system, table = parametric(value / 4.0, -q / 2.0)
        run = integrate(Run(system, table, 0.0, CYCLE / 4000, 1, "gauss", start="periodic", period_steps=4000))
        return run.multipliers.sum().real

    assert trace(a) == pytest.approx(2.0 * multiplier, abs=1e-7)
    sides = [multiplier * trace(a + delta) - 2.0 for delta in (-1e-3, 1e-3)]
    assert sides[0] * sides[1] < 0.0, "one side is stable, the other is not"


def test_parametric_instability_is_named_with_its_multiplier():
    system, table = parametric(0.25, 0.2, rate=0.01, force=1.0)
    run = integrate(Run(system, table, 0.0, CYCLE / 200, 200, "gauss", start="periodic", period_steps=200))
    assert run.outcome is Outcome.UNSTABLE
    # the motion repeats itself all the same, also by a method that knows nothing of cycles
    beside = solved_by_scipy(system, table, run.times, (run.z[0], run.v[0]))
    np.testing.assert_allclose(run.z[-1], run.z[0], rtol=1e-12)
    np.testing.assert_allclose(beside, run.z, rtol=0, atol=1e-5 * abs(run.z).max())
    assert abs(run.multipliers[0]) > 1.3 and f"{abs(run.multipliers[0]):.9g}" in run.message


def test_what_grows_beyond_rounding_over_a_cycle_has_no_periodic_state():
    """By exp(2 pi) its rest z = -1 is found all the same; by exp(8 pi) nothing would be left of it."""
    for stiffness, found in ((-1.0, -1.0), (-16.0, 0.0)):
        system, table = constant(np.eye(1), np.zeros((1, 1)), np.full((1, 1), stiffness), np.ones(1))
        run = integrate(Run(system, table, 0.0, CYCLE / 200, 200, "gauss", start="periodic", period_steps=200))
        assert run.outcome is Outcome.UNSTABLE and run.z.sum(axis=0) / 201 == pytest.approx(found)


@pytest.mark.parametrize("method", COMPILED)
def test_a_free_body_has_no_periodic_state(method):
    """Two masses and a spring between them: a double multiplier 1, which rounding splits."""
    mass, stiffness = np.array([[1.3, 0.1], [0.1, 1.1]]), 1e6 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    system, table = constant(mass, np.zeros((2, 2)), stiffness, np.ones(2))
    run = integrate(Run(system, table, 0.0, 2e-5, 1000, method, start="periodic", period_steps=1000))
    assert run.outcome is Outcome.NO_PERIODIC_STATE
    assert "no periodic state" in run.message and run.z.size == 0


def test_an_undamped_periodic_motion_is_called_neutral():
    system, table = parametric(0.6, 0.0, force=1.0)
    run = integrate(Run(system, table, 0.0, CYCLE / 300, 300, "gauss", start="periodic", period_steps=300))
    assert run.outcome is Outcome.COMPLETED and "neutrally stable" in run.message
    # z'' + 0.6 z = sin t has the periodic solution sin t / (0.6 - 1)
    np.testing.assert_allclose(run.z[:, 0], np.sin(run.times) / -0.4, atol=1e-6)


def test_exact_modal_periodic():
    system, table = constant(np.eye(2), np.diag([0.2, 3.0]), np.diag([9.0, 50.0]), np.array([1.0, 2.0]))
    run = integrate(Run(system, table, 0.0, 0.1, 20, "exact-modal", start="periodic", period_steps=20))
    np.testing.assert_allclose(run.z, np.tile([1.0 / 9.0, 2.0 / 50.0], (21, 1)), rtol=1e-12)
    assert np.abs(run.v).max() < 1e-13 and np.abs(run.a).max() < 1e-12


@pytest.mark.parametrize("method", ["newmark", "generalised-alpha", "gauss", "radau", "exact-modal"])
def test_a_cycle_is_read_again_from_its_start(method):
    """Two cycles and a half from rest, with the table of one and with that of all of them."""
    one = np.eye(2)
    push = np.array([[0.0, 1.0], [0.0, 0.4]])
    parts = {"M": [one, None], "C": [0.1 * one, None], "K": [np.diag([9.0, 50.0]), None]}
    system = affine(2, 0, parts, push)

    def table(times):
        return np.stack((np.ones_like(times), np.sin(np.pi * times) + (times % 2.0)), axis=1)

    begun = (np.zeros(2), np.zeros(2))
    again, straight = (
        integrate(Run(system, table, 0.0, 0.1, 50, method, start=begun, **more)) for more in ({"period_steps": 20}, {})
    )
    assert abs(straight.z[20:]).max() > 0.1
    np.testing.assert_allclose(again.z, straight.z, rtol=0, atol=1e-12)


@pytest.mark.parametrize("method", ["newmark", "generalised-alpha", "gauss", "radau", "exact-modal"])
def test_growth_stops_the_run_at_a_stated_time(method):
    """Negative damping: z grows as exp(5 t); the run must end before it overflows, with finite numbers."""
    system, table = constant(np.eye(1), np.full((1, 1), -10.0), np.full((1, 1), 100.0))
    run = integrate(Run(system, table, 0.0, 0.01, 100_000, method, start=(np.ones(1), np.zeros(1))))
    assert run.outcome is Outcome.UNSTABLE
    assert np.isfinite(run.z).all() and np.isfinite(run.v).all() and np.isfinite(run.a).all()
    assert run.times.size == run.z.shape[0] < 100_000
    stopped = float(run.message.split("t = ")[1].split(" s")[0])
    assert 5.0 < stopped < 20.0 and run.times[-1] == pytest.approx(stopped, abs=0.021)


def vanishing(method, rho=0.8):
    """h^2 k < 0 for which the first pivot of z'' + k z = F vanishes: -1 / (beta kappa), for Gauss -24."""
    if method == "gauss":
        return -24.0
    if method == "radau":
        a, _ = tableau(((4.0 - 6.0**0.5) / 10.0, (4.0 + 6.0**0.5) / 10.0, 1.0))
        return -1.0 / (a @ a)[0, 0]
    if method == "newmark":
        return -4.0
    alpha_m, alpha_f = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
    return -4.0 * (1.0 - alpha_m) / ((1.0 - alpha_f) * (1.0 - alpha_m + alpha_f) ** 2)


@pytest.mark.parametrize("method", COMPILED)
def test_singular_step_is_named_with_its_time(method):
    """The stiffness that does it is switched on during the fifth step."""
    one = np.eye(1)
    system = affine(1, 0, {"M": [one, None], "C": [None, None], "K": [None, one]}, np.array([[1.0, 0.0]]))

    def table(times):
        return np.stack((np.ones_like(times), np.where(times > 4.05, vanishing(method), 0.0)), axis=1)

    run = integrate(Run(system, table, 0.0, 1.0, 20, method))
    assert run.outcome is Outcome.SINGULAR
    assert "at t = 4 s, step 4 of 20" in run.message
    assert run.times[-1] < 5.0


@pytest.mark.parametrize("method", COMPILED)
def test_singular_mass_is_named_at_the_start(method):
    system, table = constant(np.diag([1.0, 0.0]), np.zeros((2, 2)), np.eye(2))
    for start in ("zero", "periodic"):
        run = integrate(Run(system, table, 0.5, 0.1, 5, method, start=start, period_steps=5))
        assert run.outcome is Outcome.SINGULAR and "M is singular" in run.message and run.z.size == 0


def test_a_cycle_is_asked_for_once_and_every_thins_the_output():
    system, table = coupled()
    asked = []

    def counting(times):
        asked.append(times.size)
        return table(times)

    full = integrate(Run(system, table, 0.0, CYCLE / 90, 450, "newmark", period_steps=90))
    thin = integrate(Run(system, counting, 0.0, CYCLE / 90, 450, "newmark", period_steps=90, every=7))
    assert asked == [1, 90]
    np.testing.assert_array_equal(thin.z, full.z[::7])
    np.testing.assert_array_equal(thin.a, full.a[::7])
    np.testing.assert_array_equal(thin.times, full.times[::7])


@pytest.mark.parametrize("method", COMPILED)
def test_pieces_change_nothing(method, monkeypatch):
    """A run in many calls of the compiled loop equals the run in one, with a cycle and without."""
    system, table = coupled()
    progress = []
    whole = integrate(Run(system, table, 0.0, CYCLE / 60, 300, method, every=3))
    monkeypatch.setattr("kaneflex.integrate.stepping._WORK_OF_A_CALL", 5e3)
    pieces = integrate(Run(system, table, 0.0, CYCLE / 60, 300, method, every=3), progress=progress.append)
    cycled = integrate(Run(system, table, 0.0, CYCLE / 60, 300, method, every=3, period_steps=60))
    np.testing.assert_array_equal(pieces.z, whole.z)
    np.testing.assert_allclose(cycled.z, whole.z, rtol=0, atol=1e-12 * np.abs(whole.z).max())
    assert len(progress) > 5 and progress[-1] == 1.0 and np.all(np.diff(progress) > 0.0)


def test_a_run_can_be_interrupted(monkeypatch):
    system, table = coupled()
    monkeypatch.setattr("kaneflex.integrate.stepping._WORK_OF_A_CALL", 1e4)

    def interrupt(fraction):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        integrate(Run(system, table, 0.0, 0.01, 10**9, "newmark", every=10**6), progress=interrupt)


@pytest.mark.parametrize(("arguments", "said"), [
    ({"method": "newmrak"}, "newmark"),
    ({"step": 0.0}, "step"),
    ({"step": float("nan")}, "step"),
    ({"n_steps": 0}, "at least one step"),
    ({"every": 0}, "at least one step"),
    ({"start": "periodic"}, "no cycle"),
    ({"start": "rest"}, "zero, periodic or a state"),
    ({"start": (np.zeros(3), np.zeros(4))}, "must be 4 finite numbers"),
    ({"start": (np.zeros(4), np.full(4, np.nan))}, "must be 4 finite numbers"),
    ({"method": "generalised-alpha", "rho_infinity": 1.2}, "rho_infinity"),
])  # fmt: skip
def test_arguments_that_cannot_be_used(arguments, said):
    system, table = coupled()
    given = {"t0": 0.0, "step": 0.1, "n_steps": 10, **arguments}
    with pytest.raises(UserError, match=said):
        integrate(Run(system, table, **given))


def test_a_table_with_nan_is_refused_with_the_time():
    system, table = coupled()

    def broken(times):
        rows = table(times)
        rows[times > 0.55, 1] = np.nan
        return rows

    with pytest.raises(UserError, match=r"scalar 1 of the motion = .*not a finite number at t = 0.6 s"):
        integrate(Run(system, broken, 0.0, 0.1, 10, "newmark"))


def test_shapes_are_checked():
    with pytest.raises(ValueError, match="half_bandwidth = 2"):
        affine(2, 2, {"M": [], "C": [], "K": []}, np.zeros((2, 1)))
    system, _ = coupled()
    with pytest.raises(ValueError, match=r"the table has shape \(10, 2\)"):
        integrate(Run(system, lambda t: np.ones((10, 2)), 0.0, 0.1, 10))


def test_import_leaves_scipy_integrate_alone():
    code = "import sys, kaneflex.integrate.by_steps; print('scipy.integrate' in sys.modules)"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert result.stdout.strip() == "False", result.stderr


@pytest.mark.parametrize(("multiplier", "modulus"), [(-1.5, ""), (0.9 + 1.2j, " of modulus 1.5")])
def test_modulus_is_said_of_complex_multipliers_only(multiplier, modulus):
    _, message = _verdict(np.array([multiplier, 0.5], dtype=complex), 0.0)
    assert f"{modulus} exceeds one" in message and ("modulus" in message) == bool(modulus)


def test_growth_that_rounding_explains_is_not_called_unstable():
    multipliers = np.array([1.00001, 0.5], dtype=complex)
    outcome, message = _verdict(multipliers, blur=1e-4)
    assert outcome is Outcome.NO_PERIODIC_STATE and "use integrator generalised-alpha" in message
    assert _verdict(multipliers, blur=1e-8)[0] is Outcome.UNSTABLE
