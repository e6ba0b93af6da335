"""Equations of a planar mechanism for linear models and equilibria."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.state import State
from kaneflex.multibody.model.system import CoupledSystem, Unfolded
from kaneflex.multibody.time.linearisation import Equations, pulled
from kaneflex.multibody.time.trajectory import CoupledTrajectory, by_themselves


def prepare(system: CoupledSystem, state: State) -> tuple[PlanarEquations, State]:
    """Equations at a state, with the coordinates of free drives independent if possible, and the state by these."""
    engine = system.engine
    engine.set(state)
    engine.choose(state.t, engine.free_drives)
    return PlanarEquations(system, engine.choice), replace(state, choice=engine.choice)


@dataclass(frozen=True, eq=False)
class PlanarEquations(Equations):
    """Equations of a planar system, whose tables keep the last instant."""

    system: CoupledSystem

    def _stiffness(self) -> np.ndarray:
        engine = self.engine
        return np.diag(np.where(engine.shapes, engine.numbers(at.STIFFNESS, engine.size), 0.0))

    def _springs(self, sections: np.ndarray, moved: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        engine = self.engine
        for fields in engine.tables.acts[engine.count(at.SPRINGS) : engine.count(at.CONTACTS)]:
            ends, numbers = fields[[at.AT, at.ON]], engine.tables.w[fields[at.NUMBERS_AT] :][:3]
            if fields[at.WHAT] == at.TORSIONAL:
                yield np.diff(moved[:, ends, 5]), numbers[:1]
            else:
                yield pulled(sections[:, :2], moved[:, :, 3:5], ends, numbers)


def probes(system: CoupledSystem, base: State, given: np.ndarray) -> CoupledTrajectory:
    """States near an instant by rows of coordinates, speeds, accelerations and inputs."""
    engine, rows, states = system.engine, list[np.ndarray](), list[Unfolded]()
    inputs = engine.numbers(at.INPUT, engine.inputs)
    # free courses need ascending times: instants so close that nothing else changes
    apart = 1e-15 * max(1.0, abs(base.t)) * bool(system.mechanism.free)
    for k, each in enumerate(given):
        q, u, _, inputs[:] = np.split(each, engine.size * np.arange(1, 4))
        try:
            system.project(base.t, q, u, base.choice)
            states.append(system.unfold(engine.row(base.t)[None]))
            rows.append(engine.row(base.t + k * apart))
        finally:
            inputs[:] = 0.0
    every = Unfolded(**{name: np.concatenate([getattr(state, name) for state in states]) for name in vars(states[0])})
    return by_themselves(np.array(rows), every)
