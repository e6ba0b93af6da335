"""Motion of a run between its stored instants, and energies of states."""

from __future__ import annotations

from dataclasses import dataclass, replace
from operator import attrgetter
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.mechanism.energy import Energy
from kaneflex.multibody.model.system import CoupledSystem, Unfolded
from kaneflex.multibody.unilateral import friction_results

if TYPE_CHECKING:
    from kaneflex.multibody.time.trajectory import CoupledTrajectory


def balance(found: Unfolded, dissipated: np.ndarray, supplied: np.ndarray) -> tuple[Energy, np.ndarray, np.ndarray]:
    """Energies of states, and the powers lost and supplied; accumulated energies are given."""
    kinetic, strain, _, weight = found.sums.T
    energy = Energy(kinetic, strain, weight, dissipated, supplied)
    return energy, found.sums[:, 2], found.powers[:, 1:].sum(axis=1)


def between(system: CoupledSystem, trajectory: CoupledTrajectory, times: np.ndarray) -> CoupledTrajectory:
    """Motion at other instants within the run (dense output).

    q by the quintic through q, q', q'' of the stored instants and of changes between them, projected onto the
    constraints; accelerations and reactions from the equations. Where changes are no longer stored, closed contacts
    have the approach speed of the neighbouring stored instants, else the one that leads to their depth.
    """
    path = _with_changes(trajectory)
    knots = path.times
    k = np.searchsorted(knots, times, side="right") - 1
    piece = _Piece.of(knots, k, times)
    q, v = piece.quintic(path.q, path.v, path.a)
    begun = None
    if path.standing is not None:
        before, after = (path.standing[np.minimum(n, len(knots) - 1)] for n in (k, k + 1))
        begun = np.where((before != 0.0) | (knots[k] == times)[:, None], before, after)
        held, width = len(system.engine.holds), len(before[0])
        bends = np.array([each.law == "lugre" for each in system.mechanism.frictions.values()], bool)
        columns = width - len(bends) + np.flatnonzero(bends)
        begun[:, columns] = piece.line(path.standing)[:, columns]
        rigid = np.zeros(width, bool)
        rigid[held : held + len(system.mechanism.contacts)] = [
            contact.law == "newton" for contact in system.mechanism.contacts.values()
        ]
        parted = (knots[k] != times)[:, None] & ((before == 0.0) | (after == 0.0)) & rigid
        begun[parted] = 0.0
    found = system.states(times, q, v, begun)
    dissipated = piece.cubic(path.energy.dissipated, path.loss)
    supplied = piece.cubic(path.energy.supplied, path.power)
    energy, loss, power = balance(found, dissipated, supplied)
    contacts, standing = path.contacts, begun
    if contacts is not None:
        lost = piece.line(contacts.lost)
        gap, force = (found.gaps[:, : len(contacts.names), k] for k in (0, 1))
        contacts = replace(contacts, gap=gap, force=force, lost=lost, begun=found.gaps[:, :, 4])
    frictions = path.frictions
    if frictions is not None:
        lost = piece.line(frictions.lost)
        frictions = friction_results.FrictionRecord.of(frictions.names, found.frictions, lost, frictions.jams)
    return replace(
        trajectory, times=times, q=found.q, v=found.v, a=found.a, multipliers=found.reactions, energy=energy, loss=loss,
        power=power, contacts=contacts, frictions=frictions, standing=standing,
    )  # fmt: skip


@dataclass(frozen=True)
class _Piece:
    """Indices k of the knots before some instants, their share of the interval, and its length."""

    k: np.ndarray
    share: np.ndarray
    length: np.ndarray

    @classmethod
    def of(cls, knots: np.ndarray, last: np.ndarray, times: np.ndarray) -> _Piece:
        """Pieces for instants; ``last``: last knot at or before each."""
        k = np.minimum(last, len(knots) - 2)
        length = knots[k + 1] - knots[k]
        share = np.divide(times - knots[k], length, out=np.ones(len(times)), where=length > 0.0)
        return cls(k, share[:, None], length[:, None])

    def line(self, values: np.ndarray) -> np.ndarray:
        before, after = values[self.k], values[self.k + 1]
        return before + self.share * (after - before)

    def cubic(self, values: np.ndarray, slopes: np.ndarray) -> np.ndarray:
        """Hermite cubic of one series."""
        s, h = self.share[:, 0], self.length[:, 0]
        first = (1.0 + 2.0 * s) * values[self.k] + s * h * slopes[self.k]
        last = (3.0 - 2.0 * s) * values[self.k + 1] + (s - 1.0) * h * slopes[self.k + 1]
        return (1.0 - s) ** 2 * first + s**2 * last

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
        trajectory, times=times[order], q=merged("q"), v=merged("v"), a=merged("a"), loss=merged("loss"),
        power=merged("power"), energy=Energy(zero, zero, zero, merged("energy.dissipated"), merged("energy.supplied")),
        contacts=contacts and replace(contacts, lost=merged("contacts.lost")),
        frictions=frictions and replace(frictions, lost=merged("frictions.lost")),
        standing=None if trajectory.standing is None else merged("standing"),
    )  # fmt: skip
