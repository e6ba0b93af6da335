"""The spectral solver: closed forms, motions made up, time steps as the other opinion, and what it says of itself."""

import re

import numpy as np
import pytest
from runs import solved
from scipy.linalg import expm
from scipy.sparse import csr_array

import kaneflex
from kaneflex import load, simulate, with_settings
from kaneflex.integrate.by_steps import cycle_map
from kaneflex.integrate.grid import Grid, rates
from kaneflex.integrate.grid import dense as dense_of
from kaneflex.integrate.run import Run, integrate, monodromy
from kaneflex.integrate.spectral import at_instants, corrected, periodic_orbit
from kaneflex.integrate.system import AffineSystem, Outcome
from kaneflex.solve.one_way_run import run_of

W = 3.0
PERIOD = 2 * np.pi / W


def dense(n, matrices, n_scalars):
    """Matrices by name and scalar, M[k] (n, n), as an affine system reads them."""

    def slots(name):
        found = np.zeros((n * (2 * n - 1), n_scalars))
        for k, matrix in matrices[name].items():
            for i in range(n):
                for j in range(n):
                    found[i * (2 * n - 1) + j - i + n - 1, k] = np.asarray(matrix)[i, j]
        return csr_array(found)

    F = np.zeros((n, n_scalars))
    for k, column in matrices["F"].items():
        F[:, k] = column
    return AffineSystem(n, n - 1, *(slots(name) for name in "MCK"), csr_array(F))


def made_up(shift=0.0):
    """Two coordinates, all matrices moving, gyroscopic and circulatory; and the motion that F was made for."""

    def motion(t):
        c, s = np.cos, np.sin
        z = np.stack([s(W * t) + 0.3 * c(3 * W * t), np.exp(c(W * t))])
        v = np.stack([W * c(W * t) - 0.9 * W * s(3 * W * t), -W * s(W * t) * z[1]])
        a = np.stack([-W * W * (s(W * t) + 2.7 * c(3 * W * t)), W * W * (s(W * t) ** 2 - c(W * t)) * z[1]])
        return z, v, a

    M = {0: [[2, 0.3], [0.3, 1]], 1: [[0.2, 0], [0, -0.1]]}
    C = {0: [[0.4, 2], [-2, 0.3]], 2: [[0.1, 0], [0, 0.2]]}
    K = {0: [[40 + shift, -5], [-5, 60]], 1: [[6, 3], [-1, 9]]}

    def table(t):
        scalars = np.stack([np.ones_like(t), np.cos(W * t), np.sin(2 * W * t)])
        at = [np.einsum("kt,kij->tij", scalars[list(of)], np.array(list(of.values()), float)) for of in (M, C, K)]
        F = sum(np.einsum("tij,jt->it", matrix, x) for matrix, x in zip(at, reversed(motion(t)), strict=True))
        return np.concatenate([scalars, F]).T

    F = {3: [1, 0], 4: [0, 1]}
    return dense(2, {"M": M, "C": C, "K": K, "F": F}, 5), table, motion


@pytest.mark.parametrize("shift", [0.0, -80.0], ids=["by Cholesky's factor", "by the mean, K indefinite"])
def test_a_motion_made_up_is_found_to_rounding(shift):
    system, table, motion = made_up(shift)
    orbit = periodic_orbit(system, table, 0.4, PERIOD, 1e-12)
    assert orbit.reason == "" and orbit.error < 1e-12
    for found, expected in zip(orbit.at(150), motion(0.4 + PERIOD / 150 * np.arange(150)), strict=True):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * abs(expected).max())


@pytest.mark.parametrize("n", [1, 2, 3])
def test_a_motion_is_carried_to_a_finer_grid(n):
    """Also its highest harmonic, of which the coarse instants see the cosine alone."""

    def at(count):
        t = np.arange(count) / count
        return np.array([0.3 + np.cos(2 * np.pi * (3 * t - 0.1 * i)) + i * np.cos(64 * np.pi * t) for i in range(n)])

    np.testing.assert_allclose(at_instants(at(64), 96), at(96), rtol=0, atol=1e-13)


def test_a_cycle_of_held_equations_is_that_of_time_steps():
    """Gyroscopic and circulatory, and asymmetric: all 2 n multipliers, and with constant matrices the matrix itself."""
    system, table, _ = made_up()
    moved = monodromy(Grid.of(system, table(PERIOD / 64 * np.arange(64)), PERIOD))
    exact = cycle_map(system, table, 0.0, PERIOD, 4096)
    found, expected = (np.sort_complex(np.linalg.eigvals(each)) for each in (moved, exact.monodromy))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-4 * abs(expected).max())

    still = monodromy(Grid.of(system, table(np.zeros(64)), PERIOD))
    M, C, K = (system.dense(name, table(np.zeros(1))[0]) for name in "MCK")
    step = PERIOD / 256
    rate = np.block([[np.zeros((2, 2)), np.eye(2) / step], [-step * np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    np.testing.assert_allclose(still, expm(PERIOD * rate), rtol=0, atol=2e-8 * abs(still).max())


def test_a_cycle_is_that_of_the_means_of_its_pieces_and_computed_in_parts(monkeypatch):
    """A ripple of 64 waves a cycle is gone from the means of four instants; little memory takes the pieces in parts."""
    system, table, _ = made_up()
    times = PERIOD / 256 * np.arange(256)
    ripple = table(times)
    ripple[:, 1] += 0.5 * np.cos(64 * W * times)
    smooth, rippled = (monodromy(Grid.of(system, rows, PERIOD)) for rows in (table(times), ripple))
    np.testing.assert_allclose(rippled, smooth, rtol=0, atol=1e-12 * abs(smooth).max())
    monkeypatch.setattr("kaneflex.integrate.run._MEMORY", 1e3)
    parts = monodromy(Grid.of(system, table(times), PERIOD))
    np.testing.assert_allclose(parts, smooth, rtol=0, atol=1e-12 * abs(smooth).max())


def test_more_harmonics_than_instants_are_read_right():
    """256 of the grid, read at 36: a harmonic above 18 is what these instants see of it."""
    system, table, _ = made_up()

    def late(t):
        rows = table(t)
        rows[:, 3:] = np.stack([np.cos(40 * W * t), 0 * t], axis=1)
        return rows

    orbit = periodic_orbit(system, late, 0.0, PERIOD, 1e-10)
    few, many = orbit.at(36), orbit.at(720)
    for one, other in zip(few, many, strict=True):
        np.testing.assert_allclose(one, other[:, ::20], rtol=0, atol=1e-12 * abs(other).max())


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize(("name", "settings"), [
    ("quick-return", []), ("rotating-cantilever", []), ("engine", ["solve.modes=3"]), ("two-link-arm", []),
])  # fmt: skip
def test_time_steps_find_the_same(name, settings):
    """Radau in four times the scene's steps, which are accurate to 1e-8 and better."""
    scene = with_settings(kaneflex.read_scene(name), [*settings, "solve.start=periodic"])
    spectral = solved(scene)
    assert spectral.trajectory.solver.startswith("spectral: ")
    assert re.search(r" 1 correction; | ([02-9]|\d\d+) corrections; ", spectral.trajectory.solver)
    steps = 4 * spectral.model.options.steps
    stepped = solved(scene, "solve.integrator=radau", f"solve.steps={steps}")
    one, other = spectral.trajectory, stepped.trajectory
    assert abs(one.multipliers[0]) == pytest.approx(abs(other.multipliers[0]), rel=0.1, abs=2e-3)
    for found, expected, allowed in ((one.z, other.z, 5e-6), (one.v, other.v, 1e-4)):
        apart = np.sqrt(((found - expected[::4]) ** 2).mean() / (expected**2).mean())
        assert apart < allowed


def test_what_corrections_cannot_find_is_left_to_time_steps():
    """The four-bar's lowest modes come within the orders of its own motion."""
    scene = with_settings(kaneflex.read_scene("four-bar"), ["solve.steps=180"])
    found, steps = solved(scene), solved(scene, "solve.integrator=radau")
    assert found.trajectory.solver.startswith("radau with time steps, since corrections of the harmonics converge")
    assert np.array_equal(found.trajectory.z, steps.trajectory.z)


def test_a_cycle_that_repels_is_shown_and_called_unstable():
    """Mathieu's equation with a force: its forced motion exists beside a multiplier of -4.156."""
    scene = with_settings(kaneflex.read_scene("mathieu"), ["solve.start=periodic", "drives.clock.speed=2 rad/s"])
    with pytest.warns(kaneflex.ValidityWarning, match="exceeds one; the result is the unstable periodic motion"):
        found = simulate(load(scene))
    assert found.outcome is Outcome.UNSTABLE and len(found.times) == found.model.options.steps + 1
    assert found.trajectory.multipliers[0] == pytest.approx(-4.156, abs=1e-3)


def test_a_machine_that_hardly_moves_is_at_its_quasi_static_answer():
    """At 1e-9 rpm no step of a second resolves a vibration; time steps find no periodic state."""
    slow = ["drives.main.speed='1e-9 rpm'", "solve.steps=90", "damping=none"]
    spectral = solved(kaneflex.read_scene("engine"), *slow)
    static = solved(kaneflex.read_scene("engine"), *slow, "solve.preset=quasistatic")
    assert spectral.trajectory.solver.startswith("spectral")
    for name in ("tip_axial", "rod_force_piston", "crank_torque"):
        expected = static.series[name].values
        np.testing.assert_allclose(spectral.series[name].values, expected, rtol=0, atol=1e-5 * abs(expected).max())


def test_it_wants_a_cycle():
    system, table, _ = made_up()
    with pytest.raises(kaneflex.UserError, match="start = 'zero': the integrator spectral finds periodic motions"):
        integrate(Run(system, table, 0.0, PERIOD / 60, 60, "spectral"))
    settings = ["solve.integrator=spectral", "solve.start=zero"]
    with pytest.raises(kaneflex.SceneError, match=r"solve\.integrator = 'spectral': this integrator finds periodic"):
        load(with_settings(kaneflex.read_scene("engine"), settings))


def test_a_load_that_jumps_has_too_many_harmonics():
    system, table, _ = made_up()

    def jumping(t):
        rows = table(t)
        rows[:, 3] = np.sign(np.sin(W * t) + 0.1)
        return rows

    orbit = periodic_orbit(system, jumping, 0.0, PERIOD, 1e-8)
    assert "decay too slowly" in orbit.reason
    found = integrate(Run(system, jumping, 0.0, PERIOD / 90, 90, "spectral", "periodic", 90, tolerance=1e-8))
    assert found.solver.startswith("radau with time steps, since the harmonics") and found.outcome is Outcome.COMPLETED


@pytest.mark.parametrize(("tolerance", "grids"), [(6e-4, (64, 96, 128)), (2e-4, (64, 128)), (2e-5, (64, 256))])
def test_grids_grow_by_as_much_as_is_left_out(tolerance, grids):
    """Of cos x + cos(26 x)/1000 + cos(40 x)/1000: 64 instants see 1.4e-3 in their highest quarter, and 96 as much."""
    system = dense(1, {"M": {0: [[1.0]]}, "C": {0: [[1.0]]}, "K": {0: [[1e6]]}, "F": {1: [1.0]}}, 2)

    def table(t):
        x = W * t
        return np.stack([np.ones_like(t), 1e6 * (np.cos(x) + 1e-3 * (np.cos(26 * x) + np.cos(40 * x)))], axis=1)

    orbit = periodic_orbit(system, table, 0.0, PERIOD, tolerance)
    assert tuple(instants for instants, _ in orbit.grids) == grids and orbit.error < 1e-12


def at_instants_of(grid):
    """M, C and K (3, N, n, n), and Cholesky's factor of K (N, n, n)."""
    factor = np.pad(grid.factor, ((0, 0), (0, grid.factor.shape[1] - 1), (0, 0)))
    lower, diagonal = dense_of(factor), np.arange(grid.n)
    lower[:, diagonal, diagonal] **= -1.0
    return np.array([dense_of(each) for each in grid.matrices]), lower


@pytest.mark.parametrize("modes", [1, 2])
def test_the_tail_is_the_energys_share_in_the_highest_quarter(modes):
    """Of two coordinates, which are transformed side by side, and of three."""
    scene = with_settings(kaneflex.read_scene("engine"), ["solve.start=periodic", f"solve.modes={modes}"])
    run = run_of(load(scene))
    orbit = corrected(grid_of(run, 64), None, 1e-6)
    grid = orbit.grid
    y = np.einsum("tji,jt->it", at_instants_of(grid)[1], orbit.z)
    harmonics = abs(np.fft.rfft(grid.modes[0].T @ y, axis=1)) ** 2
    energies = (harmonics * (1.0 + grid.modes[1][0][:, None] * grid.frequencies**2)).sum(axis=0)
    assert len(y) == modes + 1
    assert orbit.tail == pytest.approx(np.sqrt(energies[24:].sum() / energies.sum()), rel=1e-9)


def grid_of(run, instants):
    """Equations of a run at so many instants of its cycle."""
    period = run.step * run.n_steps
    return Grid.of(run.system, run.table(run.t0 + period / instants * np.arange(instants)), period)


def contraction(grid):
    """Norm of I - P A in the energy's norm: A the equations at the instants in y, P the mean equations' answer."""
    n, N, (matrices, lower) = grid.n, grid.instants, at_instants_of(grid)
    y = np.eye(N * n).reshape(N, n, -1)
    z = np.linalg.solve(lower.transpose(0, 2, 1), y)
    moved = rates(np.moveaxis(z, 0, -1).reshape(-1, N), grid.omega)
    v, a = (np.moveaxis(rate.reshape(n, -1, N), -1, 0) for rate in moved)
    forces = sum(matrix @ part for matrix, part in zip(matrices, (a, v, z), strict=True))
    shapes, (mass, damping, stiffness) = grid.modes
    rest = np.fft.rfft(np.einsum("ik,til->tkl", shapes, np.linalg.solve(lower, forces)), axis=0)
    rate = 1j * grid.frequencies[:, None]
    answer = 1.0 / (mass * rate**2 + damping * np.where(np.arange(len(rate))[:, None] < N // 2, rate, 0.0) + stiffness)
    found = np.einsum("ik,tkl->til", shapes, np.fft.irfft(rest * answer[:, :, None], N, axis=0))
    return np.linalg.norm(np.eye(N * n) - found.reshape(N * n, -1), 2)


@pytest.mark.parametrize(
    ("name", "unresolved", "resolved"), [("engine", 0.023, 2.84), ("six-bar", 0.009, 0.559)], ids=["engine", "six-bar"]
)
def test_corrections_contract_in_every_norm_only_where_resonances_are_weak(name, unresolved, resolved):
    """Why no error is called certified: as docs/scene/solve.md, with two modes of a link, on 64 and 192 instants."""
    scene = with_settings(kaneflex.read_scene(name), ["solve.start=periodic", "solve.modes=2"])
    run = run_of(load(scene))
    for instants, expected in ((64, unresolved), (192, resolved)):
        assert contraction(grid_of(run, instants)) == pytest.approx(expected, rel=0.03)
