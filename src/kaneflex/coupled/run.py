"""From a coupled system to its trajectory: initial state, integration with progress, dense output, energy balance."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from kaneflex.coupled import stepping
from kaneflex.coupled.system import BODY, CoupledSystem
from kaneflex.integrate.outcome import Outcome
from kaneflex.model import RigidMotion

_PIECE = 2000
"""Steps between two reports of progress, at each of which a run can be interrupted."""
_LONGEST = 8
"""Longest step, in intervals of the output: nothing that a table holds is stepped over."""


@dataclass(frozen=True, eq=False)
class Energy:
    """Energy of the mechanism at the stored instants [J], each of shape (n_times,).

    ``stored`` is kinetic, strain and potential energy together; ``dissipated`` by damping and ``supplied`` by loads and
    prescribed drives since the start.
    """

    kinetic: np.ndarray
    strain: np.ndarray
    weight: np.ndarray
    dissipated: np.ndarray
    supplied: np.ndarray

    @property
    def stored(self) -> np.ndarray:
        return self.kinetic + self.strain + self.weight

    @property
    def gap(self) -> np.ndarray:
        """Stored + dissipated - supplied, less what was stored at first: zero for an exact solution."""
        return self.stored - self.stored[0] + self.dissipated - self.supplied

    @property
    def drift(self) -> float:
        """Largest gap against the largest energy that was turned over."""
        turned = max(float(np.ptp(part)) for part in (self.kinetic, self.strain, self.weight, self.dissipated, self.supplied))
        return float(abs(self.gap).max()) / turned if turned else 0.0


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
    steps = _Steps(system, q, v, times, tolerance, length)
    outcome, message = steps.run(progress)
    seconds = time.perf_counter() - started
    reached = times[times <= steps.times[-1] * (1 + 1e-12)] if outcome is not Outcome.COMPLETED else times
    at = steps.dense(reached)
    return CoupledTrajectory(
        reached, *at, steps.energy(reached, *at[:2]), len(steps.times) - 1, int(steps.counts[1]),
        (float(steps.counts[3]), float(steps.counts[4])), outcome, message, 1e9 * seconds / max(1, len(steps.times) - 1),
    )  # fmt: skip


class _Steps:
    """The integrator's own steps, and what follows from them between the steps."""

    def __init__(self, system: CoupledSystem, q, v, times: np.ndarray, tolerance: float, length: float) -> None:
        self.system, self.module = system, system.module
        self.settle, self.integrate = stepping.compiled()
        self.kernels = (self.module.equations, self.module.constraints)
        n, m = system.size, len(system.constraints)
        self.powers = 3 + len(self.module.LOADS)
        self.scale = np.array([tolerance * (1.0 if unit == "rad" else length) for _, unit in self.module.COORDINATES])
        self.end, self.longest = float(times[-1]), _LONGEST * float(times[1] - times[0])
        self.counts = np.zeros(5)
        q, v, a, multipliers = q.copy(), v.copy(), np.zeros(n), np.zeros(m)
        self.settled = self.settle(*self.kernels, system.parameters, float(times[0]), q, v, a, multipliers, 5, np.zeros(2))
        self.times, self.q, self.v = np.array([times[0]]), q[None], v[None]
        self.a, self.multipliers = a[None], multipliers[None]
        self.works = np.zeros((1, self.powers - 2 + m))
        modal = abs(a[self._lengths()]).max(initial=0.0)
        # The first step moves nothing by more than a hundredth of a length; the estimate takes over from there.
        first = 0.1 * float(np.sqrt(length * tolerance**0.4 / modal)) if modal > 0 else self.longest
        self.step = min(first, self.longest)

    def _lengths(self) -> np.ndarray:
        return np.array([unit == "m" for _, unit in self.module.COORDINATES])

    def run(self, progress) -> tuple[Outcome, str]:
        if not self.settled:
            return Outcome.SINGULAR, f"singular at the start: {self._singular()}"
        tables = [[part] for part in (self.times, self.q, self.v, self.a, self.multipliers, self.works)]
        state = stepping.FULL
        while state == stepping.FULL:
            pieces = [np.zeros((_PIECE, *part[-1].shape[1:])) for part in tables]
            for piece, part in zip(pieces, tables, strict=True):
                piece[0] = part[-1][-1]
            step = np.array([self.step, 0.0])
            state = self.integrate(
                *self.kernels, self.module.tangent, self.module.energy, self.system.parameters, self.scale, step, self.end,
                self.longest, 0, self.powers, *pieces, self.counts,
            )  # fmt: skip
            self.step, last = float(step[0]), int(step[1])
            for piece, part in zip(pieces, tables, strict=True):
                part.append(piece[1 : last + 1].copy())
            if progress is not None:
                progress(min(1.0, float(tables[0][-1][-1] if last else tables[0][0][-1]) / self.end))
        self.times, self.q, self.v, self.a, self.multipliers, self.works = (np.concatenate(part) for part in tables)
        at = f"t = {self.times[-1]:.6g} s"
        if state == stepping.DONE:
            return Outcome.COMPLETED, Outcome.COMPLETED.value
        if state == stepping.SINGULAR:
            return Outcome.SINGULAR, f"singular at {at}: {self._singular()}"
        return Outcome.UNSTABLE, f"the motion can't go on at {at}: the step vanishes, as where a linkage locks"

    @staticmethod
    def _singular() -> str:
        return "the constraints there determine neither motion nor reactions, as in a linkage stretched to its limit"

    def dense(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """q, v, a and multipliers at times: the quintic through q, v, a of both ends of a step, then projected."""
        if len(self.times) == 1:
            return tuple(part[:1] for part in (self.q, self.v, self.a, self.multipliers))
        from scipy.interpolate import BPoly

        k = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.times) - 2)
        ends = np.stack([self.q, self.v, self.a], axis=1)
        q, v = np.empty((len(times), self.q.shape[1])), np.empty((len(times), self.q.shape[1]))
        for step in np.unique(k):
            rows = np.flatnonzero(k == step)
            quintic = BPoly.from_derivatives(self.times[step : step + 2], [*ends[step : step + 2]])
            q[rows], v[rows] = quintic(times[rows]), quintic.derivative()(times[rows])
        a, multipliers = np.zeros_like(q), np.zeros((len(times), self.multipliers.shape[1]))
        for i, t in enumerate(times):
            self.settle(*self.kernels, self.system.parameters, t, q[i], v[i], a[i], multipliers[i], 1, np.zeros(2))
        return q, v, a, multipliers

    def energy(self, times: np.ndarray, q: np.ndarray, v: np.ndarray) -> Energy:
        """Energies at times; the works of the steps are interpolated by their powers."""
        from scipy.interpolate import CubicHermiteSpline

        n = self.system.size
        out, kinetic = np.zeros((len(times), self.powers)), np.zeros(len(times))
        M, f = np.zeros((n, n)), np.zeros(n)
        for i, t in enumerate(times):
            M[:], f[:] = 0.0, 0.0
            self.module.equations(t, q[i], v[i], self.system.parameters, M, f)
            self.module.energy(t, q[i], v[i], self.system.parameters, out[i])
            kinetic[i] = 0.5 * v[i] @ M @ v[i]
        works = np.zeros((len(times), self.works.shape[1]))
        if len(self.times) > 1:
            powers = np.array([self._powers(k) for k in range(len(self.times))])
            works = CubicHermiteSpline(self.times, self.works, powers)(times)
        return Energy(kinetic, out[:, 1], out[:, 0], works[:, 0], works[:, 1:].sum(axis=1))

    def _powers(self, k: int) -> np.ndarray:
        """Dissipated power, power of every load and of every prescribed drive at a step [W]."""
        m = self.multipliers.shape[1]
        out, g, g_t, G, gamma = np.zeros(self.powers), np.zeros(m), np.zeros(m), np.zeros((m, self.q.shape[1])), np.zeros(m)
        t, q, v, p = self.times[k], self.q[k], self.v[k], self.system.parameters
        self.module.energy(t, q, v, p, out)
        self.module.constraints(t, q, v, p, g, g_t, G, gamma)
        return np.concatenate([out[2:], -self.multipliers[k] * g_t])
