"""Result of a run: motion of the mechanism's coordinates, and every sensor as a series."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Self

import numpy as np

from kaneflex.integrate.system import Outcome, Trajectory
from kaneflex.response.elastic_motion import ElasticMotion
from kaneflex.response.time_statistics import Statistics, statistics_of_all
from kaneflex.support.errors import SceneError
from kaneflex.support.units import LARGEST

if TYPE_CHECKING:
    from collections.abc import Iterator, KeysView

    from kaneflex.mechanism.body_frame import Rates
    from kaneflex.mechanism.energy import Energy
    from kaneflex.mechanism.rigid_motion import RigidMotion
    from kaneflex.multibody.model.bound_model import Model
    from kaneflex.multibody.time.trajectory import CoupledTrajectory
    from kaneflex.multibody.unilateral.results import Impact
    from kaneflex.response.motion import Motion
    from kaneflex.response.sensors import Series
    from kaneflex.response.stresses import LinkStresses
    from kaneflex.solve.initial import SavedState

MOST_FREQUENCIES = 50
"""Largest number of natural frequencies of a run; more would take longer than the run."""
_OF_A_STEP, _IN_SPACE, _OF_A_TANGENT, _OF_A_BAND = 2.5e-6, 5e-7, 1e-7, 5e-8
"""Seconds on one core of a server of 2023, within a factor of three over 16 runs of shipped scenes: per coupled step in
the plane and coordinate; in space per evaluation and speed, and for the tangent of a cycle per squared number of these;
per one-way step and operation of a band factorisation, n (w + 1)^2."""


@dataclass(frozen=True, eq=False)
class RunResult:
    """Motion and sensors of a run; :class:`kaneflex.solve.solution.Solution` adds warnings and error estimates.

    Attributes
    ----------
    model : Model
    trajectory : Trajectory or CoupledTrajectory
        Integrated coordinates at the stored times; CoupledTrajectory under preset ``coupled``.
    seconds : float
        Wall time of the run.
    whole : RunResult or None
        The complete run, if this is a part of it made by :meth:`at`.
    """

    model: Model
    trajectory: Trajectory | CoupledTrajectory
    seconds: float
    whole: RunResult | None = None

    def __repr__(self) -> str:
        return f"Solution({self.model.in_short}, {self.outcome.name.lower()}, {len(self.times)} instants)"

    def __iter__(self) -> Iterator[str]:
        """Names of the sensors."""
        return iter(self.series)

    def __len__(self) -> int:
        """Number of sensors."""
        return len(self.series)

    def __bool__(self) -> bool:
        """True, even for a solution without sensors."""
        return True

    def keys(self) -> KeysView[str]:
        """Names of the sensors, including ``NAME_rigid``, so that ``dict(solution)`` has their series."""
        return self.series.keys()

    @property
    def times(self) -> np.ndarray:
        """Stored instants [s], shape (n_times,)."""
        return self.trajectory.times

    @property
    def outcome(self) -> Outcome:
        """Outcome of the run."""
        return self.trajectory.outcome

    @property
    def message(self) -> str:
        """Outcome of the run in words, with time and reason if it stopped early."""
        return self.trajectory.message

    @property
    def energy(self) -> Energy | None:
        """Energies [J] at the steps and the error of their balance, for free joints or preset ``coupled``; else None,
        as the drives' motion is not integrated."""
        own = self.trajectory
        return self.model.energy if isinstance(own, Trajectory) else own.energy

    @property
    def multipliers(self) -> np.ndarray | None:
        """Floquet multipliers of a periodic motion (2 n,), by decreasing modulus; None if not known."""
        own = self.trajectory
        return own.multipliers if isinstance(own, Trajectory) else own.floquet

    @cached_property
    def frequencies(self) -> tuple[float, ...]:
        """Natural frequencies at ``solve.mode_angle`` [Hz], ascending, at most MOST_FREQUENCIES."""
        return natural_frequencies(self.model)

    @cached_property
    def rigid(self) -> RigidMotion:
        """Rigid motion at the stored times; in space under preset ``coupled`` that of the bodies that deform."""
        own, coupled = self.trajectory, self.model.coupled_in_space
        if coupled is None or isinstance(own, Trajectory):
            return self.model.motion.at(self.times)
        return coupled.at(self.times, own.record)

    @property
    def motion(self) -> Motion:
        """Motion for sensors, events and pictures; it caches its results, so request it once."""
        whole = None if self.whole is None else self.whole.motion
        if self.model.options.dynamics == "coupled":
            from kaneflex.response.coupled_motion import coupled_motion

            return coupled_motion(self.model, self.rigid, self.trajectory, whole)
        series = (self.trajectory.z.T, self.trajectory.v.T, self.trajectory.a.T)
        basis = self.model.modal_basis
        coordinates = series if basis is None else tuple(basis @ part for part in series)
        return ElasticMotion(self.model, self.rigid, coordinates, whole=whole)

    @cached_property
    def coordinates(self) -> Rates:
        """Coordinates z, z', z'' of the mechanism, each (n, n_times); for coupled runs amplitudes of the shapes."""
        return self.motion.coordinates

    def state(self, instant: int = -1) -> dict[str, dict[str, float]]:
        """Coordinates and rates at a stored instant, by default the last one, in the form of ``solve.start``.

        Parameters
        ----------
        instant : int
            Index in ``times``.

        Returns
        -------
        dict
            ``displacements`` and ``velocities``: coordinate -> number in SI.
        """
        from kaneflex.solve.initial import STATE, start_coordinates

        names, moved = start_coordinates(self.model), self.motion.state
        # too small for a scene, and for a run the same as zero
        numbers = ([0.0 if abs(x) < 1.0 / LARGEST else float(x) for x in part[:, instant]] for part in moved)
        return {key: dict(zip(names, part, strict=True)) for key, part in zip(STATE, numbers, strict=True)}

    def last_state(self) -> SavedState:
        """Last state of a coupled run. Raises SceneError if there is none."""
        from kaneflex.solve.initial import SavedState, no_state, start_coordinates, with_turns

        model = self.model
        if model.options.dynamics != "coupled":
            raise no_state(repr(self))
        t = float(self.times[-1])
        names, (q, v) = start_coordinates(model), (part[:, -1] for part in self.motion.taken(np.array([-1])).state)
        if model.in_space is not None:
            names, q, v = with_turns(names, q, v, model.in_space.turned(t))
        return SavedState(repr(self), t, names, q, v)

    def at(self, times: np.ndarray) -> Self:
        """The same motion at other instants within the run (dense output).

        Coordinates follow the quintic through the stored displacements, velocities and accelerations, under preset
        ``coupled`` through those of all steps; they are then projected onto the constraints, and accelerations and
        reactions are computed again.

        Parameters
        ----------
        times : array_like (n_times,)
            Instants [s] from the first to the last stored one.

        Raises
        ------
        ValueError
            For instants outside the run.
        """
        times = np.atleast_1d(np.asarray(times, dtype=float))
        first, last = (self.times[0], self.times[-1]) if len(self.times) > 1 else (np.nan, np.nan)
        if not ((times >= first) & (times <= last)).all():
            asked = f"{times.min():.9g} to {times.max():.9g} s"
            raise ValueError(f"instants from {asked} are outside the run, {first:.9g} to {last:.9g} s")
        own = self.trajectory
        if isinstance(own, Trajectory):
            return replace(self, trajectory=own.at(times), whole=self)
        return replace(self, trajectory=own.curve.between(own, times), whole=self)

    @property
    def impacts(self) -> tuple[Impact, ...]:
        """Impacts of contacts, by their ends; those that last at the end of the run come last."""
        record = getattr(self.trajectory, "contacts", None)
        return () if record is None else record.impacts

    @cached_property
    def series(self) -> dict[str, Series]:
        """Values of every sensor with unit and meaning, companions ``NAME_rigid`` included.

        Raises SceneError if a completed run has a value that is not finite. Under preset coupled the mechanism may pass
        positions where its rigid reference does not close; readings relative to that are NaN.
        """
        from kaneflex.response.sensors import measure

        measured = measure(self.motion)
        strict = self.outcome is Outcome.COMPLETED and self.model.coupled is None
        for name, series in measured.items() if strict else ():
            lost = ~np.isfinite(series.values)
            if lost.any():
                raise SceneError(
                    f"sensors.{name.removesuffix('_rigid')}", None,
                    f"it has no finite value at t = {self.times[lost.argmax()]:.6g} s",
                    "Check the numbers that make it so large, or leave the sensor out",
                )  # fmt: skip
        return measured

    @cached_property
    def stresses(self) -> dict[str, LinkStresses]:
        """Stresses of every elastic link with section shapes, at the stored times."""
        beams = [body.beam for body in self.model.scene.bodies.values() if body.beam is not None]
        if all(part.section is None for beam in beams for part in beam.sections.values()):
            return {}
        from kaneflex.response.stresses import stresses_of

        return stresses_of(self.motion)

    def keep(self, measured: dict[str, Series]) -> None:
        """Store series read elsewhere as :attr:`series`; all values must be finite."""
        vars(self)["series"] = measured

    def statistics(self, name: str) -> Statistics:
        """Minimum, maximum, mean and root mean square of a series of :attr:`series` over the stored times.

        The maximum of a contact's force or torque includes the peaks of impacts between stored times. Its time is that
        of the largest stored value of the impact, or the one nearest to its beginning if none was stored. Raises
        ValueError if the run stopped before its first instant.
        """
        if not len(self.times):
            raise ValueError(f"{name} has no values: {self.message}")
        found = self._statistics[name]
        if not self.impacts:
            return found
        sensor = self.model.scene.sensors.get(name)
        contact = sensor and (sensor.contact_force or sensor.contact_torque)
        own = [impact for impact in self.impacts if impact.contact == contact]
        hardest = max(own, key=lambda impact: impact.peak, default=None)
        if hardest is None or hardest.peak <= found.max:
            return found
        return found._replace(max=hardest.peak, at_max=peak_at(hardest, self.times, self.series[name].values))

    @cached_property
    def _statistics(self) -> dict[str, Statistics]:
        """Statistics of every series, without impacts."""
        return statistics_of_all({name: each.values for name, each in self.series.items()}, self.times)

    @property
    def drive_angles(self) -> dict[str, np.ndarray]:
        """Coordinate of each drive at the stored times [rad or m]."""
        return {drive: self.rigid[f"{drive}.angle"] for drive in self.model.scene.drives}


def natural_frequencies(model: Model) -> tuple[float, ...]:
    """Natural frequencies at ``solve.mode_angle`` [Hz], ascending, at most MOST_FREQUENCIES."""
    from kaneflex.multibody.model.building import has_modes, reference_modes

    count = min(model.equations.size, MOST_FREQUENCIES) if has_modes(model) else 0
    omega = reference_modes(model, count)[0] if count else ()
    return tuple(float(value) / (2.0 * math.pi) for value in omega)


def nominal_seconds(solution: RunResult) -> float:
    """Nominal duration [s] of a run on that machine, without set-up."""
    model, run = solution.model, solution.trajectory
    if model.coupled is not None:
        engine, tried = model.coupled.engine, getattr(run, "steps", 0) + getattr(run, "rejected", 0)
        # the tangent of a cycle with contacts or friction takes four cycles per freedom
        differs = model.options.start == "periodic" and len(engine.contacts) + len(engine.frictions) > 0
        return _OF_A_STEP * tried * engine.size * (1 + 4 * model.solved_for * differs)
    if not isinstance(run, Trajectory):
        speeds = model.coupled_system.engine.size
        each = _IN_SPACE + _OF_A_TANGENT * speeds * (model.options.start == "periodic")
        return each * speeds * run.curve.evaluations
    return seconds_of_steps(model, model.options.steps) if model.reduced.size else 0.0


def seconds_of_steps(model: Model, steps: int) -> float:
    """Nominal duration [s] of ``steps`` steps of one-way equations."""
    return _OF_A_BAND * steps * model.system.n * (1 + model.system.half_bandwidth) ** 2


def peak_at(impact: Impact, times: np.ndarray, forces: np.ndarray) -> int:
    """Index of the largest stored force of an impact, or of the instant nearest to its beginning if none was stored."""
    during = (times >= impact.begin) & ~(times > impact.end) & (forces > 0.0)
    return int((np.where(during, forces, 0.0) if during.any() else -abs(times - impact.begin)).argmax())
