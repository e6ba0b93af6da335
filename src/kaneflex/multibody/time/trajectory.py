"""Motion of a run at its stored instants with its outcome, and between the ends of its steps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from kaneflex.integrate.system import Outcome
from kaneflex.mechanism.energy import Energy
from kaneflex.mechanism.planar import whole_turns
from kaneflex.mechanism.spatial_frame import rotation_rates
from kaneflex.multibody.dynamics.arrays import Columns
from kaneflex.multibody.engine import Engine
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.codes import NEAR_STATES, REASONS
from kaneflex.multibody.model.state import Choice, State
from kaneflex.multibody.model.system import System
from kaneflex.multibody.time.curves import Curve
from kaneflex.multibody.unilateral.results import Impact, RowRecord
from kaneflex.support.errors import SceneError


@dataclass(frozen=True, eq=False)
class CoupledTrajectory:
    """Motion of a coupled system at the stored instants.

    Attributes
    ----------
    rows : ndarray (n_times, row)
        Rows of the engine, see ``Engine.columns``, whose loops are closed.
    record : ndarray (n_times, kept)
        Motion of the bodies, reactions, energies and powers there, see
        :class:`kaneflex.multibody.dynamics.arrays.Instants`.
    of : Columns
        Its columns by the coordinates of the bodies.
    energy : Energy
        Zero where it is not known.
    steps, rejected : int
        Accepted and rejected steps.
    contacts, frictions : RowRecord or None
        Gaps, forces and losses at the stored instants, and the impacts until the last; none of states by themselves.
    floquet : ndarray or None
        Floquet multipliers of a cycle, by decreasing modulus, if requested.
    curve : Run or None
        The run, see :class:`kaneflex.multibody.time.trajectory.RunCurve`; none of states by themselves.
    """

    rows: np.ndarray
    record: np.ndarray
    of: Columns
    energy: Energy
    steps: int = 0
    rejected: int = 0
    outcome: Outcome = Outcome.COMPLETED
    message: str = Outcome.COMPLETED.value
    ns_per_step: float = 0.0
    contacts: RowRecord | None = None
    frictions: RowRecord | None = None
    floquet: np.ndarray | None = None
    curve: Any = None

    @cached_property
    def times(self) -> np.ndarray:
        """Stored instants [s], (n_times,)."""
        return self.rows[:, 0].copy()

    @cached_property
    def q(self) -> np.ndarray:
        """Frames and shapes of the bodies, (n_times, n)."""
        return self.record[:, self.of.q]

    @cached_property
    def v(self) -> np.ndarray:
        """Their rates, (n_times, .)."""
        return self.record[:, self.of.v]

    @cached_property
    def a(self) -> np.ndarray:
        """Their accelerations, (n_times, .)."""
        return self.record[:, self.of.a]

    @cached_property
    def multipliers(self) -> np.ndarray:
        """Joint reactions, and forces or torques of prescribed drives, in the plane as the system's ``constraints``
        names them, (n_times, m)."""
        return self.record[:, self.of.forces]


def by_themselves(system: Any, rows: np.ndarray, record: np.ndarray | None = None) -> CoupledTrajectory:
    """Rows without a run, whose loops are closed, or near states with this record: energies, contacts and frictions are
    unknown."""
    zero, record = np.zeros(len(rows)), system.unfold(rows) if record is None else record
    return CoupledTrajectory(rows, record, system.record, Energy(zero, zero, zero, zero, zero))


CURE = "Shorten the duration, or change loads or start so that no loop locks"
"""Advice if a motion can't continue."""
_STEP = 1e-30
"""Complex step [s] for second rates of rotation vectors."""


@dataclass(frozen=True)
class Pieces:
    """Indices k of the knots before some instants, their share of the interval, and its length."""

    k: np.ndarray
    share: np.ndarray
    length: np.ndarray

    @classmethod
    def of(cls, knots: np.ndarray, last: np.ndarray, times: np.ndarray) -> Pieces:
        """Pieces for instants; ``last``: last knot at or before each."""
        k = np.clip(last, 0, len(knots) - 2)
        length = knots[k + 1] - knots[k]
        share = np.divide(times - knots[k], length, out=np.ones(len(times)), where=length > 0.0)
        return cls(k, share[:, None], length[:, None])

    def line(self, values: np.ndarray) -> np.ndarray:
        before, after = values[self.k], values[self.k + 1]
        return before + self.share * (after - before)

    def cubic(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Hermite cubic through q and its rate, with its slope."""
        s, h, k = self.share, self.length, self.k
        c_1 = h * v[k]
        off, off_rate = q[k + 1] - q[k] - c_1, h * v[k + 1] - c_1
        c_2, c_3 = 3.0 * off - off_rate, off_rate - 2.0 * off
        slope = c_1 + s * (2.0 * c_2 + s * 3.0 * c_3)
        return q[k] + s * (c_1 + s * (c_2 + s * c_3)), np.divide(slope, h, out=v[k + 1].copy(), where=h > 0.0)

    def quintic(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Hermite quintic through q and its two rates, with its slope."""
        s, h, k = self.share, self.length, self.k
        # Horner's scheme in s for the error of the first knot's Taylor polynomial at the second knot
        c_1, c_2 = h * v[k], 0.5 * h**2 * a[k]
        off = q[k + 1] - q[k] - c_1 - c_2
        off_rate, off_accel = h * v[k + 1] - c_1 - 2.0 * c_2, h**2 * a[k + 1] - 2.0 * c_2
        c_3 = 10.0 * off - 4.0 * off_rate + 0.5 * off_accel
        c_4 = -15.0 * off + 7.0 * off_rate - off_accel
        c_5 = 6.0 * off - 3.0 * off_rate + 0.5 * off_accel
        place = q[k] + s * (c_1 + s * (c_2 + s * (c_3 + s * (c_4 + s * c_5))))
        slope = c_1 + s * (2.0 * c_2 + s * (3.0 * c_3 + s * (4.0 * c_4 + s * 5.0 * c_5)))
        return place, np.divide(slope, h, out=v[k + 1].copy(), where=h > 0.0)


@dataclass(frozen=True, eq=False)
class Steps:
    """Curve through rows of the integration: their coordinates, rates and accelerations determine quintics.

    A ball's quintic is that of the rotation vector from its axes at the beginning of the step.
    """

    engine: Engine
    rows: np.ndarray

    @cached_property
    def _ends(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Coordinates y, rates and accelerations at the beginning and the end of each step, (2 steps, n) each."""
        y, v, a = (np.repeat(self.rows[:, self.engine.columns[name]], 2, axis=0)[1:-1] for name in ("q", "u", "du"))
        for s, turned in self._balls():
            own = slice(s, s + 3)
            y[1::2, own] = (turned[:-1].inv() * turned[1:]).as_rotvec()
            v[1::2, own], a[1::2, own] = rates_of_turns(y[1::2, own], v[1::2, own], a[1::2, own])
        return y, v, a

    def _balls(self) -> Iterator[tuple[int, Any]]:
        """First speed of every ball, and its axes at all rows."""
        if not len(self.engine.balls):  # the import takes longer than many runs
            return
        from scipy.spatial.transform import Rotation

        quaternions = self.rows[:, self.engine.columns["quaternions"]].reshape(len(self.rows), -1, 4)
        for n, s in enumerate(self.engine.balls[:, 1].tolist()):
            yield s, Rotation.from_quat(np.roll(quaternions[:, n], -1, axis=1))

    def __call__(self, times: np.ndarray) -> np.ndarray:
        """Rows near the states at ``times`` [s]: coordinates, speeds and modes."""
        knots, of, out = self.rows[:, 0], self.engine.columns, np.zeros((len(times), self.rows.shape[1]))
        last = np.searchsorted(knots, times, side="right") - 1
        pieces = Pieces.of(knots, last, times)
        y, u = Pieces(2 * pieces.k, pieces.share, pieces.length).quintic(*self._ends)
        for n, (s, turned) in enumerate(self._balls()):
            theta = y[:, s : s + 3].copy()
            placed = np.roll((turned[pieces.k] * type(turned).from_rotvec(theta)).as_quat(), 1, axis=1)
            out[:, of["quaternions"]][:, 4 * n : 4 * n + 4], y[:, s : s + 3] = placed, 0.0
            u[:, s : s + 3] = np.linalg.solve(rotation_rates(theta), u[:, s : s + 3, None])[:, :, 0]
        out[:, 0], out[:, of["q"]], out[:, of["u"]] = times, y, u
        modes = self.rows[:, of["modes"]]
        found = modes[np.minimum(last, len(modes) - 1)]
        bends = found[:, :: at.MODE_SIZE] == at.BENDING  # deflections of bristles change within a step
        found[:, 1 :: at.MODE_SIZE][bends] = pieces.line(modes[:, 1 :: at.MODE_SIZE])[bends]
        out[:, of["modes"]] = found
        return out

    def works(self, times: np.ndarray) -> np.ndarray:
        """Works at ``times`` [s], (n_times, n_works), by cubics."""
        pieces = Pieces.of(self.rows[:, 0], np.searchsorted(self.rows[:, 0], times, side="right") - 1, times)
        return pieces.cubic(self.rows[:, self.engine.columns["works"]], self._powers)[0]

    @cached_property
    def _powers(self) -> np.ndarray:
        """Powers at the rows, whose time integrals are the works, (n_rows, n_works)."""
        return self.engine.instants(self.engine.unfold(self.rows)).powers


def rates_of_turns(theta: np.ndarray, omega: np.ndarray, alpha: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rates theta' and theta'' of rotation vectors by angular velocities and accelerations in their axes, (n, 3)."""
    rate = np.einsum("tij,tj->ti", rotation_rates(theta), omega)
    ahead = rotation_rates(theta + 1j * _STEP * rate), omega + 1j * _STEP * alpha
    return rate, np.einsum("tij,tj->ti", *ahead).imag / _STEP


class RunCurve(Curve):
    """Motion of a run, in the plane or in space, at any of its instants.

    ``pieces``: for each call of compiled code rows at its first instant, at the ends of its steps and after changes of
    contacts and frictions, and its choice of speeds; ``times``: stored instants [s]; ``state``: last row; ``counts``:
    accepted and rejected steps, Newton iterations and factorisations; ``stored``: energies of contacts and frictions at
    the start.
    """

    whole = True
    system: System
    engine: Engine
    pieces: list[tuple[np.ndarray, Choice]]
    times: np.ndarray
    state: np.ndarray
    counts: np.ndarray
    stored: np.ndarray

    def __getstate__(self) -> dict[str, Any]:
        """Attributes that readers of the run need, without its system; see :meth:`of`."""
        return {name: getattr(self, name) for name in ("start", "turned", *RunCurve.__annotations__)
                if name not in ("system", "engine")}  # fmt: skip

    def of(self, system: System) -> Self:
        """The run, pickled and restored, of its system loaded again."""
        self.system, self.engine = system, system.engine
        return self

    @property
    def touching(self) -> tuple[str, ...]:
        """Contacts."""
        return tuple(self.system.mechanism.contacts)

    @property
    def ends(self) -> np.ndarray:
        """Ends of the steps [s]."""
        return np.unique(np.concatenate([rows[:, 0] for rows, _ in self.pieces]))[1:]

    @property
    def evaluations(self) -> int:
        """Evaluations of the accelerations."""
        return 3 * int(self.counts[2])

    def stopped(self, reason: str, cure: str) -> SceneError:
        """Error for a motion that can't continue."""
        return SceneError(self.system.freedom, None, reason, cure)

    def rows(self, times: np.ndarray) -> np.ndarray:
        return self.read(times)[1]

    def read(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows near the states at ``times`` [s], which are in their order, and their records."""
        engine, steps, parts = self.engine, self._steps_of(times), [self.state[None, :][:0]]
        records = [np.zeros((0, len(engine.work.kept)))]
        for k in np.unique(steps):
            parts.append(self._curves[k](times[steps == k]))
            engine.choose_speeds(self.pieces[k][1])
            records.append(self.system.unfold(parts[-1], NEAR_STATES))
            if len(records[-1]) < len(parts[-1]):
                t, outcome, _ = engine.work.now.tolist()
                raise self.stopped(f"the motion can't continue after t = {t:.6g} s: {REASONS[int(outcome)]}", CURE)
        return np.concatenate(parts), np.concatenate(records)

    def states(self, times: np.ndarray) -> Iterator[State]:
        """States at ``times`` [s], which are in their order."""
        found, steps = self.engine.instants(self.rows(times)), self._steps_of(times).tolist()
        parts = times.tolist(), found.q, found.u, found.du, found.sizes, (self.pieces[k][1] for k in steps)
        return (State(*each) for each in zip(*parts, strict=True))

    @cached_property
    def _curves(self) -> list[Steps]:
        return [Steps(self.engine, rows) for rows, _ in self.pieces]

    def _steps_of(self, times: np.ndarray) -> np.ndarray:
        """Numbers of the pieces in which times of the run [s] are. Raises SceneError for times before it, and after the
        end of one that stopped early."""
        for t in times[times < self.start.t].tolist():
            raise SceneError("t", t, f"the run starts at {self.start.t:.6g} s", "Choose an instant of the run")
        end, ends = float(self.state[0]), [rows[-1, 0] for rows, _ in self.pieces]
        for t in times[times > end].tolist() if end < self.times[-1] else ():
            raise SceneError("t", t, f"the run stopped at {end:.6g} s", "Choose an instant of the run")
        return np.minimum(np.searchsorted(ends, times, side="right"), len(self.pieces) - 1)

    def moved(
        self, rows: np.ndarray, record: np.ndarray, impacts: tuple[Impact, ...], jams: np.ndarray
    ) -> tuple[Energy, RowRecord, RowRecord]:
        """Energies, contacts and frictions at rows of the run with their records.

        ``impacts``: of the contacts; ``jams``: of the frictions, see :class:`RowRecord`.
        """
        found, held = self.engine.instants(record), len(self.engine.frictions)
        works = rows[:, self.engine.columns["works"]]
        touching, names = found.touching.copy(), tuple(self.system.mechanism.frictions)
        for k, name in enumerate(names, start=held - len(names)):
            if self.engine.in_space and len(rows) and self.system.mechanism.turns_at(name):
                touching[:, k, 0] = np.unwrap(touching[:, k, 0])  # whole turns of a pin since the instant before
                touching[:, k, 0] -= whole_turns(touching[0, k, 0])
        lost = works[:, works.shape[1] - touching.shape[1] :] - (touching[:, :, at.STORED_AT] - self.stored)
        shut, rubbing = slice(held, held + len(self.touching)), slice(held - len(names), held)
        contacts = RowRecord.of(self.touching, touching[:, shut], lost[:, shut], impacts)
        frictions = RowRecord.of(names, touching[:, rubbing], lost[:, rubbing], jams=jams)
        dissipated = works[:, 0] + contacts.lost.sum(axis=1) + frictions.lost.sum(axis=1)
        supplied = works[:, 1 : 1 + self.engine.inputs].sum(axis=1)
        kinetic, strain, weight = found.energies.T
        return Energy(kinetic, strain, weight, dissipated, supplied), contacts, frictions

    def between(self, trajectory: CoupledTrajectory, times: np.ndarray) -> CoupledTrajectory:
        """Motion of the run at other instants [s] (dense output): q by quintics through the ends of the steps,
        projected onto the constraints; accelerations and reactions from the equations."""
        order = np.argsort(times, kind="stable")
        (rows, record), steps, back = self.read(times[order]), self._steps_of(times[order]), np.argsort(order)
        for k in np.unique(steps):
            rows[steps == k, self.engine.columns["works"]] = self._curves[k].works(times[order][steps == k])
        contacts, frictions = trajectory.contacts, trajectory.frictions
        assert contacts is not None and frictions is not None  # of every run
        rows, record = rows[back], record[back]
        energy, *found = self.moved(rows, record, contacts.impacts, frictions.jams)
        return replace(trajectory, rows=rows, record=record, energy=energy, contacts=found[0], frictions=found[1])
