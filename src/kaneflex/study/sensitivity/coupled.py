"""The slope of a coupled motion: the steps that the run has taken, differentiated.

The steps keep their share of the run and their number: how the control of their error would answer to the parameter is
no part of the derivative.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from types import ModuleType

import numpy as np

from kaneflex.mechanism.floating_frames import shape_counts
from kaneflex.multibody.binding import Progress, find_coupled_tangent_module
from kaneflex.multibody.model import Model
from kaneflex.multibody.run import Method
from kaneflex.multibody.step_derivatives import alpha_slopes, compile_slopes, gauss_slopes
from kaneflex.multibody.step_replay import Steps, every_step, first_rates
from kaneflex.multibody.system import CoupledSystem
from kaneflex.response.sensors import measure
from kaneflex.scene import with_settings
from kaneflex.scene.options import acting
from kaneflex.solve.coupled import as_solution, beginning, method_of
from kaneflex.solve.solution import Solution
from kaneflex.study.sensitivity.varied import SHARES, STEP, Varied, slope_of
from kaneflex.support.errors import SceneError

_TURN = 2 * np.pi * STEP
"""Angle by which a neighbour's bodies may have turned away, or their frames' straight paths leave the circle."""
_MOST = 20_000_000
"""Numbers of slopes that are kept at a time: 160 megabytes."""


@dataclass(frozen=True, eq=False)
class CoupledPath:
    """The steps of a coupled run, and what their slopes are computed by.

    Attributes
    ----------
    solution : Solution
    method : Method
    steps : Steps
        Every one that the integrator took.
    tangents : ModuleType
        The module of the slopes of the coupled equations.
    """

    solution: Solution
    method: Method
    steps: Steps
    tangents: ModuleType

    @property
    def neighbour_step(self) -> float:
        """Relative step from neighbour to neighbour: at most STEP, and less for a mechanism that turns many times."""
        system, q = self.solution.model.coupled, self.steps.q
        turned = max(np.ptp(q[:, k + 2]) for k in system.start.values())
        return min(STEP, _TURN / float(turned)) if turned else STEP

    def slopes(self, p_slopes: np.ndarray, stretches: np.ndarray, first: np.ndarray) -> np.ndarray:
        """Slopes of q, v, a and lambda at every step's end, (n_steps + 1, directions, 3 n + m).

        ``first`` (directions, 2 n) are those of q and v at the start, which are put onto the constraints.
        """
        system, steps = self.solution.model.coupled, self.steps
        module, n = system.module, system.size
        loop = {"gauss": gauss_slopes, "generalised-alpha": alpha_slopes}[self.method.integrator]
        how = self.method.tolerance * system.measure(self.method.length)
        if loop is alpha_slopes:
            how = self.method.weights
        table = np.zeros((len(steps.times), len(stretches), 3 * n + len(system.constraints)))
        table[0, :, : 2 * n] = first
        states = (np.ascontiguousarray(part) for part in (steps.q, steps.v, steps.a, steps.multipliers))
        compile_slopes(self.method.integrator)
        done = loop(
            module.equations, module.constraints, module.tangent, self.tangents.residual_slope,
            self.tangents.closing_slope, system.parameters, p_slopes, stretches, how, steps.times, *states, table,
        )  # fmt: skip
        assert done, "the run has been there"
        return table

    @cached_property
    def monodromy(self) -> np.ndarray:
        """How q and v at the end of a cycle follow those at its start, (2 n, 2 n)."""
        system = self.solution.model.coupled
        size = 2 * system.size
        some = max(1, _MOST // (len(self.steps.times) * (3 * system.size + len(system.constraints))))
        columns = []
        for k in range(0, size, some):
            first = np.eye(size)[k : k + some]
            none = np.zeros((len(first), len(system.parameters)))
            columns.append(self.slopes(none, np.zeros(len(first)), first)[-1, :, :size])
        return np.concatenate(columns).T


def coupled_path(solution: Solution, progress: Progress = lambda stage: None) -> CoupledPath:
    """The steps of a finished coupled run, retraced."""
    model, trajectory = solution.model, solution.coupled.trajectory
    scene, method = acting(with_settings(model.scene, ()), model.options), method_of(model)
    tangents, _ = find_coupled_tangent_module(scene, shape_counts(scene), progress)
    _compile(model.coupled, tangents)
    return CoupledPath(solution, method, every_step(model.coupled, trajectory, method), tangents)


def _compile(system: CoupledSystem, tangents: ModuleType) -> None:
    """Call both kernels once: compiled, they can be handed to the loops."""
    p, q, multipliers = system.parameters, np.zeros(system.size), np.zeros(len(system.constraints))
    out = np.zeros(system.size + len(multipliers))
    tangents.residual_slope(0.0, 0.0, q, q, q, multipliers, p, np.zeros(len(p)), out)
    tangents.closing_slope(0.0, 0.0, q, q, p, np.zeros(len(p)), multipliers, multipliers.copy())


def coupled_slopes(path: CoupledPath, varied: Varied) -> dict[str, np.ndarray]:
    """p dy/dp of every sensor at the stored times: read from each neighbour, with the motion moved along its slope.

    Raises
    ------
    SceneError
        If a periodic run could be periodic in other ways, too.
    """
    trajectory, system = path.solution.coupled.trajectory, varied.model.coupled
    n, tau = system.size, np.array([varied.stretch])
    p_slopes = varied.slope(lambda model: model.coupled.parameters)[None]
    if varied.model.options.start == "periodic":
        first = _periodic_start(path, varied, p_slopes, tau)
    else:
        first = _closed(path, p_slopes[0], varied.slope(_start))
    found = path.slopes(p_slopes, tau, first[None])[path.steps.rows, 0]
    parts = np.split(found, [n, 2 * n, 3 * n], axis=1)
    read = []
    for share, model in zip(SHARES, varied.neighbours, strict=True):
        step = share * varied.step
        moved = {
            key: getattr(trajectory, key) + step * part
            for key, part in zip(("q", "v", "a", "multipliers"), parts, strict=True)
        }
        times = trajectory.times * (model.step / varied.model.step)
        read.append(measure(as_solution(model, replace(trajectory, times=times, **moved), 0.0)))
    return {sensor: slope_of([series[sensor].values for series in read], varied.step) for sensor in read[0]}


def _start(model: Model) -> np.ndarray:
    """q and v from which a model's run starts, (2 n,)."""
    q, v = beginning(model)
    return np.concatenate([q, first_rates(model.coupled, q, v)])


def _closed(path: CoupledPath, p_slope: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Slopes (2 n,) at the start, those of q put onto the constraints by the bodies' frames alone.

    What the differences leave open is rounding. Shared with the deformation, it would load stiff links.
    """
    system, steps = path.solution.model.coupled, path.steps
    n, m = system.size, len(system.constraints)
    g, g_t, G, gamma, opened, rate = np.zeros(m), np.zeros(m), np.zeros((m, n)), np.zeros(m), np.zeros(m), np.zeros(m)
    q, v, p = steps.q[0], steps.v[0], system.parameters
    system.module.constraints(0.0, q, v, p, g, g_t, G, gamma)
    path.tangents.closing_slope(0.0, 0.0, q, v, p, p_slope, opened, rate)
    closed = first.copy()
    closed[system.rigid_rows] -= np.linalg.lstsq(G[:, system.rigid_rows], opened + G @ first[:n], rcond=None)[0]
    return closed


def _periodic_start(path: CoupledPath, varied: Varied, p_slopes: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """The slopes of q and v that return after a cycle, (2 n,)."""
    size = 2 * varied.model.coupled.size
    end = path.slopes(p_slopes, tau, np.zeros((1, size)))[-1, 0, :size]
    square = np.eye(size) - path.monodromy
    if not np.linalg.cond(square) < 1e14:
        raise SceneError(
            varied.parameter.name, varied.parameter.value, "the periodic run is not the only one nearby",
            "Damp the motion, or start from zero or quasistatic",
        )  # fmt: skip
    return np.linalg.solve(square, end)
