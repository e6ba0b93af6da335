"""Motion of a run between its stored instants, and energies of states."""

from __future__ import annotations

from dataclasses import replace
from operator import attrgetter
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.mechanism.energy import Energy
from kaneflex.multibody.model.system import CoupledSystem, Unfolded
from kaneflex.multibody.time.hermite import Pieces
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
    path, engine = _with_changes(trajectory), system.engine
    of, knots = engine.columns, path.times
    k = np.searchsorted(knots, times, side="right") - 1
    piece = Pieces.of(knots, k, times)
    rows = np.zeros((len(times), path.rows.shape[1]))
    rows[:, 0], rows[:, of["modes"]] = times, _modes(system, path, piece, k, times)
    rows[:, of["q"]], rows[:, of["u"]] = piece.quintic(*(path.rows[:, of[name]] for name in ("q", "u", "du")))
    rows = system.states(rows)
    found = system.unfold(rows)
    dissipated = piece.cubic(path.energy.dissipated, path.loss)
    supplied = piece.cubic(path.energy.supplied, path.power)
    energy, loss, power = balance(found, dissipated, supplied)
    contacts = path.contacts
    if contacts is not None:
        lost = piece.line(contacts.lost)
        gap, force = (found.gaps[:, : len(contacts.names), k] for k in (0, 1))
        contacts = replace(contacts, gap=gap, force=force, lost=lost, begun=found.gaps[:, :, 4])
    frictions = path.frictions
    if frictions is not None:
        lost = piece.line(frictions.lost)
        frictions = friction_results.FrictionRecord.of(frictions.names, found.frictions, lost, frictions.jams)
    return replace(
        trajectory, rows=rows, q=found.q, v=found.v, a=found.a, multipliers=found.reactions, energy=energy, loss=loss,
        power=power, contacts=contacts, frictions=frictions,
    )  # fmt: skip


def _modes(
    system: CoupledSystem, path: CoupledTrajectory, piece: Pieces, k: np.ndarray, times: np.ndarray
) -> np.ndarray:
    """Modes of contacts and holds at ``times`` [s], whose last knots are ``k``."""
    modes, held = path.rows[:, system.engine.columns["modes"]], len(system.engine.holds)
    before, after = (modes[np.minimum(n, len(modes) - 1)] for n in (k, k + 1))
    on = (path.times[k] == times)[:, None]
    found = np.where((before != 0.0) | on, before, after)
    bends = np.array([each.law == "lugre" for each in system.mechanism.frictions.values()], bool)
    columns = modes.shape[1] - len(bends) + np.flatnonzero(bends)
    found[:, columns] = piece.line(modes)[:, columns]
    rigid = np.zeros(modes.shape[1], bool)
    rigid[held : held + len(system.mechanism.contacts)] = [
        contact.law == "newton" for contact in system.mechanism.contacts.values()
    ]
    found[~on & ((before == 0.0) | (after == 0.0)) & rigid] = 0.0
    return found


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
        trajectory, rows=merged("rows"), loss=merged("loss"), power=merged("power"),
        energy=Energy(zero, zero, zero, merged("energy.dissipated"), merged("energy.supplied")),
        contacts=contacts and replace(contacts, lost=merged("contacts.lost")),
        frictions=frictions and replace(frictions, lost=merged("frictions.lost")),
    )  # fmt: skip
