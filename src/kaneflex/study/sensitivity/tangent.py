"""The slope of a motion: the discrete run itself, differentiated.

With x' = p dx/dp, M z'' + C z' + K z = F differentiates to the same equations of the slopes, driven by the motion
(direct differentiation; Haug & Arora 1979, sec. 4.1). Both are integrated as one system of twice the size, whose
coordinates stand side by side, z_1, its slope, z_2, its slope ...: every method that is linear in the state then takes
the derivative of its own step, and a periodic start is that of the slopes, too.

Slopes are taken at a fixed share of the run. Where the parameter stretches the run, T' = tau T, the time derivatives in
the equations stand for those by the share: M' - 2 tau M and C' - tau C take the places of M' and C'.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array

from kaneflex.integrate.outcome import Outcome, Trajectory
from kaneflex.integrate.periodic import Cycle
from kaneflex.integrate.run import cycle_map, integrate
from kaneflex.mechanism.affine import Affine
from kaneflex.multibody.model import Model, affine_system
from kaneflex.solve.quasistatic import mechanism_modes, quasistatic, rate_of, slow_start, solve_banded_at
from kaneflex.solve.simulation import storing
from kaneflex.solve.solution import Solution
from kaneflex.study.sensitivity.varied import Varied
from kaneflex.support.errors import SceneError

_SLOPE = "'"
"""Stands before the scalars of a product whose slope is meant."""


@dataclass(frozen=True, eq=False)
class Tangent:
    """Slopes of what was integrated at a solution's stored times, each of shape (n_times, n)."""

    z: np.ndarray
    v: np.ndarray
    a: np.ndarray


def own_cycle(model: Model) -> Cycle | None:
    """The cycle of a periodic run, which all its slopes share; None of any other run."""
    options = model.options
    if options.dynamics == "quasistatic" or options.start != "periodic":
        return None
    period = options.steps * model.step
    return cycle_map(
        model.system, model.scalars, 0.0, period, options.steps, options.integrator, options.rho_infinity
    )


def tangent(solution: Solution, varied: Varied, cycle: Cycle | None) -> Tangent:
    """The slopes of a finished run's displacements, velocities and accelerations, in coordinates of the model.

    ``cycle`` is the model's own, by :func:`own_cycle`.

    Raises
    ------
    SceneError
        If the quasi-static answer leaves mechanism modes to inertia relief, which is not differentiated.
    """
    model, tau = varied.model, varied.stretch
    if model.options.dynamics == "quasistatic":
        z = _of_quasistatic(varied, solution.times, solution.trajectory.z)
        return Tangent(z, *_rates_of_quasistatic(varied, solution.trajectory.v, z, model.options.cycles))
    run = integrated_pair(varied, cycle)
    return Tangent(
        run.z[:, 1::2], run.v[:, 1::2] - tau * solution.trajectory.v, run.a[:, 1::2] - 2 * tau * solution.trajectory.a
    )


def _rates_of_quasistatic(
    varied: Varied, v: np.ndarray, z: np.ndarray, periodic: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Slopes of velocities and accelerations that are differences of displacements over the step."""
    step, tau = varied.model.step, varied.stretch
    first = rate_of(z, step, periodic) - tau * v
    return first, rate_of(first, step, periodic) - tau * rate_of(v, step, periodic)


def _of_quasistatic(varied: Varied, times: np.ndarray, z: np.ndarray) -> np.ndarray:
    """K z' = F' - K' z at each instant; (n_times, n)."""
    model = varied.model
    if mechanism_modes(model, times[0]):
        raise SceneError(
            "solve.preset", model.options.preset, "mechanism modes are left to inertia relief, which has no derivative",
            "Take preset stiffened, or hold the mechanism",
        )  # fmt: skip
    return solve_banded_at(model, times, _unbalanced_slope(varied, times, {"K": z}))


def _unbalanced_slope(varied: Varied, times: np.ndarray, states: dict[str, np.ndarray]) -> np.ndarray:
    """F' - K' z - C' v - M' a at each instant, of those matrices whose ``states`` (n_times, n) are given."""
    model = varied.model
    load = np.zeros((len(times), model.reduced.size))
    values, slopes = _products(varied, times)
    columns = {"F": np.ones((1, len(times)))} | {key: -state.T for key, state in states.items()}
    for k, monomial in enumerate(varied.monomials):
        for key, column in columns.items():
            if monomial in model.kept[key].terms:
                load += (slopes[:, k] * (model.kept[key].terms[monomial] @ column)).T
            if monomial in varied.constants[key].terms:
                load += (values[:, k] * (varied.constants[key].terms[monomial] @ column)).T
    return load


def _products(varied: Varied, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The products of the motion's scalars and their slopes, (n_times, n_monomials) each."""
    motion = varied.model.motion
    scalars, rates = varied.scalars(times)
    constants = motion.module.CONSTANTS

    def factor(name: str) -> np.ndarray:
        return scalars[:, motion.column[name]] if name in motion.column else np.full(len(times), constants[name])

    values = np.ones((len(times), len(varied.monomials)))
    slopes = np.zeros_like(values)
    for k, monomial in enumerate(varied.monomials):
        for name in monomial:
            slope = rates[:, motion.column[name]] if name in motion.column else 0.0
            slopes[:, k] = slopes[:, k] * factor(name) + values[:, k] * slope
            values[:, k] *= factor(name)
    return values, slopes


def integrated_pair(varied: Varied, cycle: Cycle | None) -> Trajectory:
    """The run of motion and slopes side by side, by the model's own integrator."""
    model, options = varied.model, varied.model.options
    monomials = [*varied.monomials, *((_SLOPE, *monomial) for monomial in varied.monomials)]
    system = affine_system(_side_by_side(varied), monomials)
    start: object = cycle or options.start
    if options.start == "quasistatic":
        start = _quasistatic_start(varied)
    run = integrate(
        system,
        lambda times: np.hstack(_products(varied, times)),
        0.0,
        model.step,
        options.steps,
        options.integrator,
        start=start,
        period_steps=options.steps if options.cycles else None,
        every=storing(model),
        rho_infinity=options.rho_infinity,
    )
    if run.outcome is not Outcome.COMPLETED:
        raise SceneError(
            varied.parameter.name, varied.parameter.value, f"the slopes have no such run: {run.message}",
            "Damp the motion, or start from zero or quasistatic",
        )  # fmt: skip
    return run


def _side_by_side(varied: Varied) -> dict[str, Affine]:
    """M, C, K, F of motion and slopes: [[A, 0], [A', A]], coordinate by coordinate."""
    model, tau = varied.model, varied.stretch
    n = model.reduced.size
    place = np.arange(n)
    own, slope = (
        csr_array(coo_array((np.ones(n), (2 * place + k, place)), shape=(2 * n, n))) for k in (0, 1)
    )
    stretched = {"M": -2.0 * tau, "C": -tau}
    found = {}
    for key, kept in model.kept.items():
        column = key == "F"
        right = [csr_array(np.ones((1, 1))), csr_array((1, 1))] if column else [own.T, slope.T]
        total = Affine.zero(2 * n, 1 if column else 2 * n)
        for monomial, matrix in kept.terms.items():
            total += Affine.term(monomial, own @ matrix @ right[0] + slope @ matrix @ right[1])
            total += Affine((2 * n, total.shape[1]), {(_SLOPE, *monomial): csr_array(slope @ matrix @ right[0])})
            if key in stretched:
                total += Affine.term(monomial, stretched[key] * (slope @ matrix @ right[0]))
        for monomial, matrix in varied.constants[key].terms.items():
            total += Affine.term(monomial, slope @ matrix @ right[0])
        found[key] = total
    return found


def _quasistatic_start(varied: Varied) -> tuple[np.ndarray, np.ndarray]:
    """z, v of :func:`slow_start`, slopes beside the coordinates: K z' = F' - K' z - C' v - M' a - C v' - M a'.

    v and a are the rates of the quasi-static answer, and v' and a' those of its slope.
    """
    model, first = varied.model, slice(4, 5)
    times = model.step * np.arange(-4, 5)
    still, v, a = quasistatic(model, times, periodic=False)
    still_slope = _of_quasistatic(varied, times, still)
    v_slope, a_slope = _rates_of_quasistatic(varied, v, still_slope, periodic=False)
    z, _ = slow_start(model)
    load = _unbalanced_slope(varied, times[first], {"K": z[None], "C": v[first], "M": a[first]})
    row = model.scalars(times[first])[0]
    load -= model.system.dense("C", row) @ v_slope[4] + model.system.dense("M", row) @ a_slope[4]
    z_slope = solve_banded_at(model, times[first], load)[0]
    # the stretch leaves with the velocities: what is integrated are derivatives by the share of the run
    rate = v_slope[4] + varied.stretch * v[4]
    return tuple(np.stack(pair, axis=1).ravel() for pair in ((z, z_slope), (v[4], rate)))
