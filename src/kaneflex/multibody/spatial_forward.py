"""Forward dynamics in space: Kane's independent speeds with all coordinates, integrated by scipy.

The right-hand side closes the loops before it asks for accelerations, so that dependent coordinates among the states
are no more than where Newton's method starts, and nothing drifts. Where the dependent speeds grow fast beside the
independent ones, as near a dead centre, the next step begins with another choice of these.
"""

from __future__ import annotations

import bisect
from collections.abc import Callable

import numpy as np

from kaneflex.mechanism.energy import Energy
from kaneflex.multibody.spatial_motion import SpatialKinematics, SpatialModule, State
from kaneflex.multibody.spatial_system import SpatialSystem
from kaneflex.scene.options import Options
from kaneflex.support.errors import SceneError

_GROWTH = 10.0
"""Largest dependent speed per independent one, in their measures, beyond which others are tried."""
_ABSOLUTE = 1e-2
"""Absolute tolerance, in rad, sizes of the mechanism and their rates, as a share of the relative one."""
_MOST = 5_000_000
"""Evaluations of the accelerations in a run."""


def integrate(
    system: SpatialSystem, start: State, module: SpatialModule, options: Options
) -> tuple[SpatialKinematics, Energy]:
    """The motion from a start over the duration of ``options``, by its method and tolerance, and its energy.

    Raises
    ------
    SceneError
        If the motion can't go on, or takes too many evaluations; it names the time.
    """
    run = _Run(system, options)
    run.go(start)
    motion = SpatialKinematics(module, system.parameters, run.state)
    return motion, run.energy(motion)


class _Run:
    """Steps of one integration and the curves between them."""

    def __init__(self, system: SpatialSystem, options: Options) -> None:
        self.system, self.options, self.evaluations = system, options, 0
        self.ends: list[float] = []
        self.curves: list[tuple[Callable[[float], np.ndarray], State]] = []
        self.works = [np.zeros(2)]

    def go(self, start: State) -> None:
        """Integrate to the end of the run."""
        import scipy.integrate

        options, system, state = self.options, self.system, start
        tolerance, n, first = options.forward_tolerance, self.system.coordinates, None
        while state.t < options.duration:
            y = np.concatenate([state.q, state.u[state.choice.independent], self.works[-1]])
            scale = np.concatenate([np.ones(n), system.measure[state.choice.independent], [np.inf, np.inf]])
            solver = getattr(scipy.integrate, options.forward_method)(
                self._rates_of(state), state.t, y, options.duration, rtol=tolerance,
                atol=_ABSOLUTE * tolerance * scale, first_step=first,
            )  # fmt: skip
            state = self._steps(solver, state)
            left = options.duration - state.t
            first = min(solver.step_size, left) if left > 0.0 else None

    def _steps(self, solver, state: State) -> State:
        """Step with one choice of speeds until another is better, or the end; the state there."""
        while solver.status == "running":
            before = solver.t
            try:
                with np.errstate(all="ignore"):
                    message = solver.step()
            except (ValueError, np.linalg.LinAlgError):
                message = "the rates are not finite there"
            if solver.status == "failed" or message is not None or not np.isfinite(solver.y).all():
                raise self._stopped(before, message or "the rates are not finite there")
            if self.evaluations > _MOST:
                raise self._stopped(solver.t, f"{self.evaluations} evaluations bring it no further")
            self.ends.append(solver.t)
            self.curves.append((solver.dense_output(), state))
            self.works.append(solver.y[-2:].copy())
            choice = self._better(solver.y, state)
            if choice is not None:
                found = self._at(solver.t, solver.y, state)
                return State(found.t, found.q, found.u, found.du, choice)
        return self._at(solver.t, solver.y, state)

    def _better(self, y: np.ndarray, state: State):
        """Another choice of independent speeds, where the dependent ones have grown fast beside these."""
        system, choice = self.system, state.choice
        if not len(choice.dependent) or not len(choice.independent):
            return None
        q = y[: system.coordinates].copy()
        if not system.close(q, choice):
            return None
        grown = _largest(system, choice)
        if grown < _GROWTH:
            return None
        other = system.choose(q)
        system.close(q, other)
        return other if _largest(system, other) < 0.5 * grown else None

    def _rates_of(self, state: State) -> Callable[[float, np.ndarray], np.ndarray]:
        system, choice, n = self.system, state.choice, self.system.coordinates

        def rates(t: float, y: np.ndarray) -> np.ndarray:
            self.evaluations += 1
            found = self._at(t, y, state)
            out, system_work = np.zeros(len(y)), system.work
            out[:n] = system.coordinate_rates(found.q, found.u)
            out[n : n + len(choice.independent)] = found.du[choice.independent]
            out[-2:] = self._powers(found, system_work)
            return out

        return rates

    def _powers(self, found: State, k) -> tuple[float, float]:
        """Dissipated by dampers, supplied by loads and prescribed drives [W], where ``_at`` was."""
        system, tables = self.system, self.system.tables
        lost = k.springs[:, 6].sum() + k.twists[:, 3].sum()
        given, sizes = 0.0, self.sizes
        for size, (section, _, axis) in zip(sizes, tables.forces.tolist(), strict=False):
            given += size * (k.axes[axis] @ k.sections[section, 3:6])
        for size, (first, second, axis) in zip(sizes[len(tables.forces) :], tables.torques.tolist(), strict=True):
            given += size * (k.axes[axis] @ (k.sections[second, 9:12] - k.sections[first, 9:12]))
        if len(found.choice.prescribed):
            _, _, along = system.exerted(found.choice, sizes)
            given += along[found.choice.prescribed] @ found.u[found.choice.prescribed]
        return lost, given

    def _at(self, t: float, y: np.ndarray, like: State) -> State:
        """The state that an integrator's numbers stand for, its loops closed, its rates known."""
        system, choice = self.system, like.choice
        q, u, du = y[: system.coordinates].copy(), np.zeros(system.speeds), np.zeros(system.speeds)
        system.set_drives(t, q, u, du)
        u[choice.independent] = y[system.coordinates : -2]
        if not system.close(q, choice):
            raise ValueError("a loop does not close")
        self.sizes = system.sizes(t, q, u)
        if not system.accelerate(choice, u, du, self.sizes):
            raise ValueError("bodies without mass could move anyhow")
        return State(t, q, u, du, choice)

    def state(self, t: float) -> State:
        """The state at a time of the run [s]."""
        k = min(bisect.bisect_left(self.ends, t), len(self.ends) - 1)
        curve, like = self.curves[k]
        return self._at(t, curve(t), like)

    def energy(self, motion: SpatialKinematics) -> Energy:
        """At the ends of the steps."""
        times = np.array([0.0, *self.ends])
        found = motion.at(times)
        works = np.array(self.works).T
        return Energy(*(found[f"{name} energy"] for name in ("kinetic", "strain", "weight")), *works)

    def _stopped(self, t: float, message: str) -> SceneError:
        free = next((name for name, drive in self.system.scene.drives.items() if drive.kind == "free"), None)
        key = f"bodies.{self.system.mechanism.floating[0]}.free" if free is None else f"drives.{free}"
        return SceneError(
            key, None, f"the motion can't go on after t = {t:.6g} s: {message.rstrip('.')}",
            "Shorten the duration, or change loads or start so that no loop locks",
        )  # fmt: skip


def _largest(system: SpatialSystem, choice) -> float:
    """Largest entry of the basis, in the measures of the speeds."""
    found = system.basis(choice) / system.measure
    return float(abs(found * system.measure[choice.independent][:, None]).max(initial=0.0))
