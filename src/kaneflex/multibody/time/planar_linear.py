"""Equations of a planar mechanism for linear models and equilibria."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.state import State
from kaneflex.multibody.model.system import CoupledSystem, Unfolded
from kaneflex.multibody.time.linearisation import Equations, pulled
from kaneflex.multibody.time.trajectory import CoupledTrajectory, by_themselves


def prepare(system: CoupledSystem, t: float, q: np.ndarray, v: np.ndarray) -> PlanarEquations:
    """Equations at a state of the bodies, with the coordinates of free drives independent if possible."""
    system.fold(q, v)
    engine = system.engine
    drives = engine.tables.acts[engine.count(at.DRIVES) : engine.count(at.LOADS), at.COURSE_AT]
    engine.choose(t, drives[drives >= 0].tolist())
    return PlanarEquations(system, engine.choice)


@dataclass(frozen=True, eq=False)
class PlanarEquations(Equations):
    """Equations of a planar system, whose tables keep the last instant."""

    system: CoupledSystem

    def now(self, t: float) -> State:
        """Instant of the tables."""
        return self.engine.state(t, self.choice)

    def at(self, t: float, q: np.ndarray, v: np.ndarray) -> State:
        """Instant at a state of the bodies."""
        self.system.fold(q, v)
        return self.now(t)

    def bodies(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        """q and v (size,) of the bodies at an instant."""
        self._on(state)
        found = self.system.unfold(self.engine.row(state.t)[None])
        return found.q[0], found.v[0]

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
    engine, states = system.engine, list[Unfolded]()
    inputs = engine.numbers(at.INPUT, engine.inputs)
    for row in given:
        q, u, _, inputs[:] = np.split(row, engine.size * np.arange(1, 4))
        try:
            system.project(base.t, q, u, base.choice)
            states.append(system.unfold(engine.row(base.t)[None]))
        finally:
            inputs[:] = 0.0
    every = Unfolded(**{name: np.concatenate([getattr(state, name) for state in states]) for name in vars(states[0])})
    # free courses need ascending times: instants so close that nothing else changes
    apart = 1e-15 * max(1.0, abs(base.t)) * bool(system.mechanism.free)
    return by_themselves(base.t + apart * np.arange(len(states)), every.q, every.v, every.a, every.reactions)
