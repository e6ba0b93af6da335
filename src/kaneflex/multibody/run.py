"""From a coupled system to its trajectory: initial state, integration with progress, energy balance."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from kaneflex.integrate.outcome import Outcome
from kaneflex.mechanism.energy import Energy
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.multibody import instant, stepping
from kaneflex.multibody.system import BODY, CoupledSystem

_PIECE, _FEW, _QUICK = 100, 10, 0.2
"""Between two reports of progress, at each of which a run can be interrupted: stored instants at most, steps at first
where an event is looked for, and about how long as many steps as are then tried may take [s]."""
FIRST_PASSES = 5
"""Projections that put the first state onto the constraints: it may be undeformed, or deformed to the first order."""


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
    loss, power : ndarray (n_times,)
        Rates of what is dissipated and of what is supplied [W].
    steps, rejected : int
        Steps that were taken, and those that were tried in vain.
    drift : (float, float)
        Largest residual of position [m or rad] and of velocity before a projection.
    ends : ndarray (steps,)
        Instants [s] at which the steps of a whole run under the control of their error ended.
    """

    times: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    multipliers: np.ndarray
    energy: Energy
    loss: np.ndarray
    power: np.ndarray
    steps: int
    rejected: int
    drift: tuple[float, float]
    outcome: Outcome
    message: str
    ns_per_step: float
    ends: np.ndarray = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class Method:
    """How to integrate.

    Attributes
    ----------
    integrator : str
        "gauss" (steps by error control), "generalised-alpha" (one step from instant to instant) or "scipy" (Radau).
    tolerance : float
        Error allowed of what ten periods of a vibration accumulate, as a share of ``length`` [m] for displacements and
        in rad for angles; a vibration smaller than that is not resolved. See :mod:`kaneflex.multibody.stepping`.
    rho_infinity : float
        Spectral radius of generalised-alpha at infinite frequency.
    """

    integrator: str
    tolerance: float
    length: float
    rho_infinity: float

    @property
    def weights(self) -> np.ndarray:
        """alpha_m, alpha_f, beta, gamma of generalised-alpha (Chung & Hulbert 1993, eqs. (17), (18), (25))."""
        rho = self.rho_infinity
        alpha_m, alpha_f = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
        surplus = 1.0 - alpha_m + alpha_f
        return np.array([alpha_m, alpha_f, 0.25 * surplus**2, surplus - 0.5])


def rigid_state(system: CoupledSystem, rigid: RigidMotion) -> tuple[np.ndarray, np.ndarray]:
    """q and v of the undeformed bodies at the first time of a rigid motion."""
    q, v = np.zeros(system.size), np.zeros(system.size)
    for name, k in system.start.items():
        c, s = rigid[f"{name}.c"][0], rigid[f"{name}.s"][0]
        q[k : k + BODY] = rigid[f"{name}.x"][0], rigid[f"{name}.y"][0], np.arctan2(s, c)
        v[k : k + BODY] = rigid[f"{name}.v_x"][0], rigid[f"{name}.v_y"][0], rigid[f"{name}.omega"][0]
    return q, v


Stop = Callable[[CoupledTrajectory], bool]
"""Asked of every piece of a run, its first instant being the last one of the piece before: whether to stop there."""


def integrate(
    system: CoupledSystem,
    q: np.ndarray,
    v: np.ndarray,
    times: np.ndarray,
    method: Method,
    progress: Callable[[float], None] | None = None,
    stop: Stop | None = None,
    ends: np.ndarray | None = None,
) -> CoupledTrajectory:
    """Integrate from q, v at times[0] and give the motion at ``times`` [s], as far as it goes.

    ``ends`` [s], with all ``times`` among them, are those of the steps to take where they are not left to "gauss".
    """
    run = _Run(system, q, v, times, method, np.zeros(0) if ends is None else ends)
    started = time.perf_counter()
    outcome, message = run.go(progress, stop)
    seconds = time.perf_counter() - started
    ended = (outcome, message, 1e9 * seconds / max(1.0, run.counts[0] + run.counts[1]))
    return replace(run.trajectory(slice(0, run.filled + 1), *ended), ends=np.concatenate([np.zeros(0), *run.ends]))


def first_step(accelerations: np.ndarray, scale: np.ndarray, longest: float) -> float:
    """A first step [s] that alone would move things by ten errors; the estimate takes over from there."""
    largest = (abs(accelerations) / scale).max()
    return min(math.sqrt(20.0 / largest) if largest > 0 else math.inf, longest)


class _Run:
    """Tables of one integration, filled piece by piece."""

    def __init__(
        self, system: CoupledSystem, q: np.ndarray, v: np.ndarray, times: np.ndarray, method: Method, given: np.ndarray
    ) -> None:
        self.system, self.module, self.times, self.method = system, system.module, times, method
        self.given: np.ndarray = given
        self.ends: list[np.ndarray] = []
        stepping.compile_stepper(method.integrator)
        n, m, count = system.size, len(system.constraints), len(times)
        self.powers = 3 + len(self.module.LOADS)
        self.scale = method.tolerance * system.measure(method.length)
        self.q, self.v, self.a = np.zeros((count, n)), np.zeros((count, n)), np.zeros((count, n))
        self.multipliers, self.works = np.zeros((count, m)), np.zeros((count, self.powers - 2 + m))
        self.counts, self.filled = np.zeros(5), 0
        self.q[0], self.v[0] = q, v
        self.settled = self._settle(0, FIRST_PASSES)
        self.longest = float(times[1] - times[0])
        self.step = first_step(self.a[0], self.scale, self.longest)
        self.here = np.concatenate([times[:1], *(table[0] for table in self.tables[1:])])
        self.algorithmic = self.a[0].copy()

    @property
    def kernels(self) -> tuple:
        return self.module.equations, self.module.constraints, self.module.tangent, self.module.energy

    @property
    def tables(self) -> tuple[np.ndarray, ...]:
        return self.times, self.q, self.v, self.a, self.multipliers, self.works

    def _settle(self, row: int, passes: int) -> bool:
        """Put a row onto the constraints and find its accelerations and multipliers; False where it is singular."""
        drift = np.zeros(2)
        done = instant.settle(
            *self.kernels[:2], self.system.parameters, float(self.times[row]), self.q[row], self.v[row], self.a[row],
            self.multipliers[row], passes, drift,
        )  # fmt: skip
        if row:  # the first one may be undeformed, and off by what that leaves open
            self.counts[3:] = np.maximum(self.counts[3:], drift)
        return done

    def go(self, progress: Callable[[float], None] | None, stop: Stop | None) -> tuple[Outcome, str]:
        """Integrate to the end, or to where the motion can't go on."""
        if not self.settled:
            return Outcome.SINGULAR, f"singular at the start: {_SINGULAR}"
        advance = {"gauss": self._gauss, "generalised-alpha": self._alpha, "scipy": self._scipy}[self.method.integrator]
        most = _PIECE if self.method.integrator == "scipy" else 1 if stop is None else _FEW
        while self.filled + 1 < len(self.times):
            before, tried, began = self.filled, self.tried, time.perf_counter()
            ended = advance(slice(before, before + 1 + min(most, _PIECE)), most)
            seconds = time.perf_counter() - began
            if self.method.integrator != "scipy":  # which starts anew, and can be interrupted anywhere
                most = max(1, min(2 * most, int((self.tried - tried) * _QUICK / seconds)))
            if ended not in (stepping.DONE, stepping.PAUSED):
                outcome, words = _ENDED[ended]
                return outcome, words.format(at=f"t = {self.times[self.filled]:.6g} s")
            if progress is not None:
                came = max(self.times[self.filled], self.here[0])
                progress(float((came - self.times[0]) / (self.times[-1] - self.times[0])))
            filled = slice(before, self.filled + 1)
            if stop is not None and self.filled > before and stop(self.trajectory(filled)):
                break
        return Outcome.COMPLETED, Outcome.COMPLETED.value

    @property
    def tried(self) -> int:
        """Steps so far, those in vain included."""
        return int(self.counts[0] + self.counts[1])

    def _gauss(self, rows: slice, most: int) -> int:
        control, last = np.array([self.step, self.longest, most, 0.0]), self.times[rows][-1]
        given = self.given[slice(*np.searchsorted(self.given, (self.here[0], last), side="right"))]
        ended, ends = stepping.integrate(
            *self.kernels, self.system.parameters, self.scale, control, self.here, given,
            *(table[rows] for table in self.tables), self.powers, self.counts,
        )  # fmt: skip
        self.ends.append(ends)
        self.step, self.filled = float(control[0]), self.filled + int(control[3])
        return ended

    def _alpha(self, rows: slice, most: int) -> int:
        ended, last = stepping.generalised_alpha(
            *self.kernels, self.system.parameters, self.scale, self.method.weights, self.algorithmic,
            *(table[rows] for table in self.tables), self.powers, self.counts,
        )  # fmt: skip
        self.filled += last
        return ended

    def _scipy(self, rows: slice, most: int) -> int:
        """Through scipy's Radau, with works integrated beside the motion; every row is then settled."""
        from scipy.integrate import solve_ivp

        n, times = self.system.size, self.times[rows]

        def slope(t: float, x: np.ndarray) -> np.ndarray:
            a, multipliers, g_t = self.system.accelerations(t, x[:n], x[n : 2 * n])
            return np.concatenate([x[n : 2 * n], a, self._rates(t, x[:n], x[n : 2 * n], multipliers, g_t)[1]])

        first = np.concatenate([self.q[rows][0], self.v[rows][0], self.works[rows][0]])
        allowed = np.concatenate([self.scale, self.scale / self.longest, np.full(self.works.shape[1], math.inf)])
        try:
            found = solve_ivp(
                slope, (times[0], times[-1]), first, "Radau", times, rtol=self.method.tolerance, atol=allowed
            )
        except np.linalg.LinAlgError:
            return stepping.SINGULAR
        self.counts[0] += len(found.t) - 1
        for k, x in enumerate(found.y.T[1:], start=rows.start + 1):
            self.q[k], self.v[k], self.works[k] = x[:n], x[n : 2 * n], x[2 * n :]
            if not self._settle(k, 1):
                return stepping.SINGULAR
            self.filled = k
        return stepping.DONE if found.success else stepping.TOO_SMALL

    def _rates(self, t: float, q, v, multipliers, g_t) -> tuple[np.ndarray, np.ndarray]:
        """What ``energy`` says, and the rates of ``works``: dissipation, loads, constraints that move by themselves."""
        out = np.zeros(self.powers)
        self.module.energy(t, q, v, self.system.parameters, out)
        return out, np.concatenate([out[2:], -multipliers * g_t])

    def trajectory(
        self, rows: slice, outcome: Outcome = Outcome.COMPLETED, message: str = "", ns: float = 0.0
    ) -> CoupledTrajectory:
        """Rows of the tables with their energies."""
        steps, rejected = int(self.counts[0]), int(self.counts[1])
        drift = (float(self.counts[3]), float(self.counts[4]))
        times, q, v, a, multipliers, works = (table[rows] for table in self.tables)
        balance = energies(self.system, times, q, v, multipliers, works[:, 0], works[:, 1:].sum(axis=1))
        return CoupledTrajectory(times, q, v, a, multipliers, *balance, steps, rejected, drift, outcome, message, ns)


def between(system: CoupledSystem, trajectory: CoupledTrajectory, times: np.ndarray) -> CoupledTrajectory:
    """The motion at other instants within the run (dense output).

    q by the quintic through q, q', q'' of the stored instants, put onto the constraints; accelerations and multipliers
    from the equations there.
    """
    from scipy.interpolate import BPoly, CubicHermiteSpline

    knots = trajectory.times
    stepping.compile_stepper()
    curve = BPoly.from_derivatives(knots, np.stack([trajectory.q, trajectory.v, trajectory.a], axis=1))
    q, v = curve(times), curve.derivative()(times)
    a, multipliers = np.zeros_like(q), np.zeros((len(times), len(system.constraints)))
    for k, t in enumerate(times):
        instant.settle(
            system.module.equations, system.module.constraints, system.parameters, float(t), q[k], v[k], a[k],
            multipliers[k], 1, np.zeros(2),
        )  # fmt: skip
    dissipated = CubicHermiteSpline(knots, trajectory.energy.dissipated, trajectory.loss)(times)
    supplied = CubicHermiteSpline(knots, trajectory.energy.supplied, trajectory.power)(times)
    energy, loss, power = energies(system, times, q, v, multipliers, dissipated, supplied)
    found = {"q": q, "v": v, "a": a, "multipliers": multipliers, "energy": energy, "loss": loss, "power": power}
    return replace(trajectory, times=times, **found)


def energies(
    system: CoupledSystem, times, q, v, multipliers, dissipated, supplied
) -> tuple[Energy, np.ndarray, np.ndarray]:
    """Energies at given states, and the powers lost and supplied there.

    What was dissipated and supplied since the start is known already.
    """
    count, module = len(times), system.module
    out, kinetic, power = np.zeros((count, 3 + len(module.LOADS))), np.zeros(count), np.zeros(count)
    stepping.compile_stepper()
    states = (np.ascontiguousarray(part) for part in (times, q, v, multipliers))
    instant.balance(
        module.equations, module.constraints, module.energy, system.parameters, *states, out, kinetic, power
    )
    return Energy(kinetic, out[:, 1], out[:, 0], dissipated, supplied), out[:, 2], power


_SINGULAR = "the constraints there determine neither motion nor reactions, as in a linkage stretched to its limit"
_ENDED = {
    stepping.TOO_SMALL: (
        Outcome.UNSTABLE, "the motion can't go on after {at}: the step vanishes, as where a linkage locks",
    ),
    stepping.SINGULAR: (Outcome.SINGULAR, f"singular after {{at}}: {_SINGULAR}"),
    stepping.NO_CONVERGENCE: (
        Outcome.UNSTABLE,
        "no step of this length leads on from {at}: ask for more steps, or for the integrator gauss, "
        "which chooses its own",
    ),
}  # fmt: skip
