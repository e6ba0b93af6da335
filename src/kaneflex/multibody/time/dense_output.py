"""Motion of a run between its stored instants, in space between the ends of its steps, and energies of states."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from operator import attrgetter
from typing import Any

import numpy as np

from kaneflex.mechanism.energy import Energy
from kaneflex.mechanism.spatial_frame import rotation_rates
from kaneflex.multibody.dynamics.arrays import Instants
from kaneflex.multibody.engine import Engine
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.state import Choice, State
from kaneflex.multibody.model.system import System
from kaneflex.multibody.time.trajectory import CoupledTrajectory
from kaneflex.multibody.unilateral.results import RowRecord

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
    """Curve in space through rows of the integration: their coordinates, rates and accelerations determine quintics.

    A ball's quintic is that of the rotation vector from its axes at the beginning of the step.
    """

    engine: Engine
    rows: np.ndarray

    @cached_property
    def _ends(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Coordinates y, rates and accelerations at the beginning and the end of each step, (2 steps, n) each."""
        y, v, a = (np.repeat(self.rows[:, self.engine.columns[name]], 2, axis=0)[1:-1] for name in ("q", "u", "du"))
        for _, s, turned in self._balls():
            own = slice(s, s + 3)
            y[1::2, own] = (turned[:-1].inv() * turned[1:]).as_rotvec()
            v[1::2, own], a[1::2, own] = rates_of_turns(y[1::2, own], v[1::2, own], a[1::2, own])
        return y, v, a

    def _balls(self) -> Iterator[tuple[int, int, Any]]:
        """First coordinate and speed of every ball, and its axes at all rows."""
        if not len(self.engine.balls):  # the import takes longer than many runs
            return
        from scipy.spatial.transform import Rotation

        quaternions = self.rows[:, self.engine.columns["quaternions"]].reshape(len(self.rows), -1, 4)
        for n, (k, s) in enumerate(self.engine.balls.tolist()):
            yield k, s, Rotation.from_quat(np.roll(quaternions[:, n], -1, axis=1))

    def __call__(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates q and speeds u at ``times`` [s], (n_times, .) each."""
        knots, (own, speeds) = self.rows[:, 0], self.engine.own.T
        pieces = Pieces.of(knots, np.searchsorted(knots, times, side="right") - 1, times)
        y, u = Pieces(2 * pieces.k, pieces.share, pieces.length).quintic(*self._ends)
        q = np.zeros((len(times), len(own) + 4 * len(self.engine.balls)))
        q[:, own] = y[:, speeds]
        for k, s, turned in self._balls():
            theta = y[:, s : s + 3]
            q[:, k : k + 4] = np.roll((turned[pieces.k] * type(turned).from_rotvec(theta)).as_quat(), 1, axis=1)
            u[:, s : s + 3] = np.linalg.solve(rotation_rates(theta), u[:, s : s + 3, None])[:, :, 0]
        return q, u


def rates_of_turns(theta: np.ndarray, omega: np.ndarray, alpha: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rates theta' and theta'' of rotation vectors by angular velocities and accelerations in their axes, (n, 3)."""
    rate = np.einsum("tij,tj->ti", rotation_rates(theta), omega)
    ahead = rotation_rates(theta + 1j * _STEP * rate), omega + 1j * _STEP * alpha
    return rate, np.einsum("tij,tj->ti", *ahead).imag / _STEP


def balance(found: Instants, dissipated: np.ndarray, supplied: np.ndarray) -> Energy:
    """Energies of states; accumulated ones are given."""
    kinetic, strain, _, weight = found.energies.T
    return Energy(kinetic, strain, weight, dissipated, supplied)


def states(
    system: Any, trajectory: CoupledTrajectory, choice: Choice, times: np.ndarray
) -> Iterator[State]:
    """States of a system at instants within its run [s]; ``choice``: theirs in the plane."""
    if trajectory.curve is not None:
        return map(trajectory.curve, times.tolist())
    return system.engine.states_of(between(system, trajectory, times).rows, choice)


def between(system: Any, trajectory: CoupledTrajectory, times: np.ndarray) -> CoupledTrajectory:
    """Motion at other instants within the run (dense output); in space it is read from the run, and energies stay those
    of the stored instants.

    q by the quintic through q, q', q'' of the stored instants and of changes between them, projected onto the
    constraints; accelerations and reactions from the equations. Where changes are no longer stored, closed contacts
    have the approach speed of the neighbouring stored instants, else the one that leads to their depth.
    """
    path, engine, energy = _with_changes(trajectory), system.engine, trajectory.energy
    k = np.searchsorted(path.times, times, side="right") - 1
    piece = Pieces.of(path.times, k, times)
    if trajectory.curve is not None:
        rows, record = times[:, None], trajectory.curve.record(times)
    else:
        of, rows = engine.columns, np.zeros((len(times), path.rows.shape[1]))
        rows[:, 0], rows[:, of["modes"]] = times, _modes(system, path, piece, k, times)
        rows[:, of["q"]], rows[:, of["u"]] = piece.quintic(*(path.rows[:, of[name]] for name in ("q", "u", "du")))
        rows = system.states(rows)
        record = system.unfold(rows)
        done = np.column_stack([path.energy.dissipated, path.energy.supplied])
        dissipated, supplied = piece.cubic(done, np.column_stack([path.loss, path.power]))[0].T
        energy = balance(engine.instants(record), dissipated, supplied)
    contacts, frictions, held = path.contacts, path.frictions, len(engine.holds)
    touching = engine.instants(record).touching
    if contacts is not None:
        gaps = touching[:, held : held + len(contacts.names)]
        contacts = RowRecord.of(contacts.names, gaps, piece.line(contacts.lost), contacts.impacts)
    if frictions is not None:
        lost, own = piece.line(frictions.lost), slice(held - len(frictions.names), held)
        frictions = RowRecord.of(frictions.names, touching[:, own], lost, jams=frictions.jams)
    return replace(trajectory, rows=rows, record=record, energy=energy, contacts=contacts, frictions=frictions)


def _modes(
    system: System, path: CoupledTrajectory, piece: Pieces, k: np.ndarray, times: np.ndarray
) -> np.ndarray:
    """Modes of contacts and frictions at ``times`` [s], whose last knots are ``k``."""
    modes, rows = path.rows[:, system.engine.columns["modes"]], len(system.engine.rows)
    before, after = (modes[np.minimum(n, len(modes) - 1)].reshape(len(times), rows, at.MODE_SIZE) for n in (k, k + 1))
    on = (path.times[k] == times)[:, None]
    found = np.where(((before[:, :, 0] != at.OPEN) | on)[:, :, None], before, after)
    between = piece.line(modes).reshape(found.shape)
    bends = found[:, :, 0] == at.BENDING
    found[bends, 1] = between[bends, 1]
    rigid = np.zeros(rows, bool)
    first = len(system.engine.holds)
    rigid[first : first + len(system.mechanism.contacts)] = [
        contact.law == "newton" for contact in system.mechanism.contacts.values()
    ]
    found[~on & ((before[:, :, 0] == at.OPEN) | (after[:, :, 0] == at.OPEN)) & rigid, 0] = at.OPEN
    return found.reshape(len(times), -1)


def _with_changes(trajectory: CoupledTrajectory) -> CoupledTrajectory:
    """Stored instants and states before and after the changes between them, in order of time."""
    changes = trajectory.changes
    if changes is None:
        return trajectory
    both, count = (trajectory, changes), len(trajectory.times)
    times = np.concatenate([each.times for each in both])
    side = np.concatenate([np.ones(count), 2.0 * (np.arange(len(changes.times)) % 2)])  # before, stored, after
    order = np.lexsort((side, times))

    def merged(key: str) -> np.ndarray:
        return np.concatenate([attrgetter(key)(each) for each in both])[order]

    zero, contacts, frictions = np.zeros(len(times)), trajectory.contacts, trajectory.frictions
    return replace(
        trajectory, rows=merged("rows"), record=merged("record"),
        energy=Energy(zero, zero, zero, merged("energy.dissipated"), merged("energy.supplied")),
        contacts=contacts and replace(contacts, lost=merged("contacts.lost")),
        frictions=frictions and replace(frictions, lost=merged("frictions.lost")),
    )  # fmt: skip
