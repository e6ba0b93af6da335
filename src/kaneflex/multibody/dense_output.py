"""The motion of a run between its stored instants, and the energies of states."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.mechanism.energy import Energy
from kaneflex.multibody import rubbing
from kaneflex.multibody.system import CoupledSystem, Unfolded

if TYPE_CHECKING:
    from kaneflex.multibody.trajectory import CoupledTrajectory


def balance(found: Unfolded, dissipated: np.ndarray, supplied: np.ndarray) -> tuple[Energy, np.ndarray, np.ndarray]:
    """Energies at some states, and the powers lost and supplied there; what was since the start is known already."""
    kinetic, strain, _, weight = found.sums.T
    energy = Energy(kinetic, strain, weight, dissipated, supplied)
    return energy, found.sums[:, 2], found.powers[:, 1:].sum(axis=1)


def between(system: CoupledSystem, trajectory: CoupledTrajectory, times: np.ndarray) -> CoupledTrajectory:
    """The motion at other instants within the run (dense output).

    q by the quintic through q, q', q'' of the stored instants, put onto the constraints; accelerations and reactions
    from the equations there. Of an impact it knows what is stored, and no more: contacts that are closed count as begun
    as at the stored instants beside it, else at the speed that would bring them as deep.
    """
    from scipy.interpolate import BPoly, CubicHermiteSpline

    knots = trajectory.times
    curve = BPoly.from_derivatives(knots, np.stack([trajectory.q, trajectory.v, trajectory.a], axis=1))
    begun = None
    if trajectory.standing is not None:
        k = np.searchsorted(knots, times, side="right") - 1
        before, after = (trajectory.standing[np.minimum(n, len(knots) - 1)] for n in (k, k + 1))
        begun = np.where((before != 0.0) | (knots[k] == times)[:, None], before, after)
        held, width = len(system.engine.holds), len(before[0])
        bends = np.array([each.law == "lugre" for each in system.mechanism.frictions.values()], bool)
        columns = width - len(bends) + np.flatnonzero(bends)
        share = ((times - knots[k]) / np.diff(knots)[np.minimum(k, len(knots) - 2)])[:, None]
        begun[:, columns] = (before + share * (after - before))[:, columns]
        rigid = np.zeros(width, bool)
        rigid[held : held + len(system.mechanism.contacts)] = [
            contact.law == "newton" for contact in system.mechanism.contacts.values()
        ]
        parted = (knots[k] != times)[:, None] & ((before == 0.0) | (after == 0.0)) & rigid
        begun[parted] = 0.0
    found = system.states(times, curve(times), curve.derivative()(times), begun)
    dissipated = CubicHermiteSpline(knots, trajectory.energy.dissipated, trajectory.loss)(times)
    supplied = CubicHermiteSpline(knots, trajectory.energy.supplied, trajectory.power)(times)
    energy, loss, power = balance(found, dissipated, supplied)
    contacts, standing = trajectory.contacts, begun
    if contacts is not None:
        lost = np.array([np.interp(times, knots, part) for part in contacts.lost.T]).reshape(-1, len(times)).T
        gap, force = (found.gaps[:, : len(contacts.names), k] for k in (0, 1))
        contacts = replace(contacts, gap=gap, force=force, lost=lost, begun=found.gaps[:, :, 4])
    frictions = trajectory.frictions
    if frictions is not None:
        lost = np.array([np.interp(times, knots, part) for part in frictions.lost.T]).reshape(-1, len(times)).T
        frictions = rubbing.FrictionRecord.of(frictions.names, found.frictions, lost, frictions.jams)
    return replace(
        trajectory, times=times, q=found.q, v=found.v, a=found.a, multipliers=found.reactions, energy=energy, loss=loss,
        power=power, contacts=contacts, frictions=frictions, standing=standing,
    )  # fmt: skip
