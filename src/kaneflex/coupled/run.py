"""From a coupled system to its trajectory: initial state, integration with progress, energy balance."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from kaneflex.coupled import stepping
from kaneflex.coupled.system import BODY, CoupledSystem
from kaneflex.energy import Energy
from kaneflex.integrate.outcome import Outcome
from kaneflex.model import RigidMotion

_PIECE = 100
"""Stored instants between two reports of progress, at each of which a run can be interrupted."""


@dataclass(frozen=True, eq=False)
class CoupledTrajectory:
    """Motion of a coupled system at the stored instants.

    Attributes
    ----------
    times : ndarray (n_times,)
    q, v, a : ndarray (n_times, n)
        COORDINATES of the module with their rates; they satisfy the constraints.
    multipliers : ndarray (n_times, m)
        Joint reactions and forces or torques of prescribed drives, as CONSTRAINTS names them.
    energy : Energy
    steps, rejected : int
        Steps that were taken, and those that were tried in vain.
    drift : (float, float)
        Largest residual of position [m or rad] and of velocity before a projection.
    """

    times: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    multipliers: np.ndarray
    energy: Energy
    steps: int
    rejected: int
    drift: tuple[float, float]
    outcome: Outcome
    message: str
    ns_per_step: float


def rigid_state(system: CoupledSystem, rigid: RigidMotion) -> tuple[np.ndarray, np.ndarray]:
    """q and v of the undeformed bodies at the first time of a rigid motion."""
    q, v = np.zeros(system.size), np.zeros(system.size)
    for name, k in system.start.items():
        c, s = rigid[f"{name}.c"][0], rigid[f"{name}.s"][0]
        q[k : k + BODY] = rigid[f"{name}.x"][0], rigid[f"{name}.y"][0], np.arctan2(s, c)
        v[k : k + BODY] = rigid[f"{name}.v_x"][0], rigid[f"{name}.v_y"][0], rigid[f"{name}.omega"][0]
    return q, v


def integrate(
    system: CoupledSystem,
    q: np.ndarray,
    v: np.ndarray,
    times: np.ndarray,
    tolerance: float,
    length: float,
    progress: Callable[[float], None] | None = None,
) -> CoupledTrajectory:
    """Integrate from q, v at times[0] and give the motion at ``times`` [s].

    Parameters
    ----------
    tolerance : float
        Error allowed in a step, as a share of ``length`` [m] for displacements and in rad for angles.
    """
    started = time.perf_counter()
    run = _Run(system, q, v, times, tolerance, length)
    outcome, message = run.go(progress)
    seconds = time.perf_counter() - started
    steps, rejected = int(run.counts[0]), int(run.counts[1])
    rows = slice(0, run.filled + 1)
    parts = [part[rows] for part in (times, run.q, run.v, run.a, run.multipliers)]
    drift = (float(run.counts[3]), float(run.counts[4]))
    return CoupledTrajectory(
        *parts, run.energy(), steps, rejected, drift, outcome, message, 1e9 * seconds / max(1, steps + rejected)
    )


class _Run:
    """Tables of one integration, filled piece by piece."""

    def __init__(self, system: CoupledSystem, q, v, times: np.ndarray, tolerance: float, length: float) -> None:
        self.system, self.module, self.times = system, system.module, times
        stepping.compile_stepper()
        n, m, count = system.size, len(system.constraints), len(times)
        self.powers = 3 + len(self.module.LOADS)
        units = np.array([unit for _, unit in self.module.COORDINATES])
        self.scale = tolerance * np.where(units == "rad", 1.0, length)
        self.q, self.v, self.a = np.zeros((count, n)), np.zeros((count, n)), np.zeros((count, n))
        self.multipliers, self.works = np.zeros((count, m)), np.zeros((count, self.powers - 2 + m))
        self.counts, self.filled = np.zeros(5), 0
        self.q[0], self.v[0] = q, v
        self.settled = stepping.settle(
            self.module.equations, self.module.constraints, system.parameters, float(times[0]), self.q[0], self.v[0],
            self.a[0], self.multipliers[0], 5, np.zeros(2),
        )  # fmt: skip
        largest = (abs(self.a[0]) / self.scale).max()
        # A first step that alone would move things by a thousand errors; the estimate takes over from there.
        first = math.sqrt(2e3 / largest) if largest > 0 else math.inf
        self.step, self.longest = min(first, float(times[1] - times[0])), float(times[1] - times[0])

    def go(self, progress: Callable[[float], None] | None) -> tuple[Outcome, str]:
        """Integrate to the end, or to where the motion can't go on."""
        if not self.settled:
            return Outcome.SINGULAR, f"singular at the start: {_SINGULAR}"
        tables = (self.times, self.q, self.v, self.a, self.multipliers, self.works)
        while self.filled + 1 < len(self.times):
            rows = slice(self.filled, self.filled + 1 + _PIECE)
            state = np.array([self.step, self.longest, 0.0])
            ended = stepping.integrate(
                self.module.equations, self.module.constraints, self.module.tangent, self.module.energy,
                self.system.parameters, self.scale, state, *(table[rows] for table in tables), self.powers, self.counts,
            )  # fmt: skip
            self.step, self.filled = float(state[0]), self.filled + int(state[2])
            if ended != stepping.DONE:
                at = f"t = {self.times[self.filled]:.6g} s"
                if ended == stepping.SINGULAR:
                    return Outcome.SINGULAR, f"singular after {at}: {_SINGULAR}"
                return (
                    Outcome.UNSTABLE,
                    f"the motion can't go on after {at}: the step vanishes, as where a linkage locks",
                )
            if progress is not None:
                progress(self.filled / (len(self.times) - 1))
        return Outcome.COMPLETED, Outcome.COMPLETED.value

    def energy(self) -> Energy:
        """Energies at the instants that were reached."""
        count, n = self.filled + 1, self.system.size
        out, kinetic = np.zeros((count, self.powers)), np.zeros(count)
        M, f = np.zeros((n, n)), np.zeros(n)
        for i in range(count):
            M[:], f[:] = 0.0, 0.0
            state = (self.times[i], self.q[i], self.v[i], self.system.parameters)
            self.module.equations(*state, M, f)
            self.module.energy(*state, out[i])
            kinetic[i] = 0.5 * self.v[i] @ M @ self.v[i]
        works = self.works[:count]
        return Energy(kinetic, out[:, 1], out[:, 0], works[:, 0], works[:, 1:].sum(axis=1))


_SINGULAR = "the constraints there determine neither motion nor reactions, as in a linkage stretched to its limit"
