"""Cycles of a planar mechanism by the independent coordinates of its tree."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from kaneflex.integrate.outcome import Outcome
from kaneflex.mechanism.planar import whole_turns
from kaneflex.multibody.model.system import CoupledSystem
from kaneflex.multibody.time.dense_output import between
from kaneflex.multibody.time.planar_linear import PlanarEquations
from kaneflex.multibody.time.run import Method, integrate
from kaneflex.multibody.time.shooting import Cycles
from kaneflex.multibody.time.trajectory import CoupledTrajectory

Start = tuple[np.ndarray, np.ndarray]
"""q and v (size,) of the bodies."""


class PlanarCycles(Cycles[Start, CoupledTrajectory]):
    """Cycles over ``times`` [s], by the coordinates ``which`` of the tree: by default those independent at a start."""

    def __init__(
        self, system: CoupledSystem, times: np.ndarray, method: Method, start: Start, closer: float = 1.0,
        which: np.ndarray | None = None,
    ) -> None:  # fmt: skip
        self.system, self.engine, self.times, self.method = system, system.engine, times, method
        system.compile()
        self._choose(start)
        self.which = self.engine.independent if which is None else which
        self.turns = self.engine.turns[self.which]
        measure, shapes = np.where(self.turns, 1.0, method.length), self.engine.shapes[self.which]
        super().__init__(float(times[-1] - times[0]), method.tolerance, measure, shapes, closer)
        self.touches = bool(len(self.engine.contacts) or len(self.engine.holds))

    def _choose(self, start: Start) -> None:
        self.system.fold(*start)
        self.engine.choose(float(self.times[0]))

    def run(self, start: Start) -> CoupledTrajectory:
        return integrate(self.system, *start, self.times, self.method)

    def completed(self, cycle: CoupledTrajectory) -> bool:
        return cycle.outcome is Outcome.COMPLETED

    def states(self, cycle: CoupledTrajectory, count: int) -> Iterator[Start]:
        rows = np.linspace(0, len(cycle.times) - 1, count).round().astype(int)
        return zip(cycle.q[rows], cycle.v[rows], strict=True)

    def apart(self, start: Start, *others: Start) -> np.ndarray:
        x = []
        for state in (start, *others):
            self.system.fold(*state)
            x.append(np.array(self.engine.motion[:2])[:, self.which])
        found = np.array(x[1:]) - x[0]
        found[:, 0, self.turns] -= whole_turns(found[:, 0, self.turns])
        return found.reshape(len(others), -1)

    def moved(self, start: Start, x: np.ndarray) -> Start:
        engine, t = self.engine, float(self.times[0])
        self._choose(start)
        for part, move in zip(engine.motion, np.split(x, 2), strict=False):
            part[self.which] += move
        found = self.system.unfold(engine.row(t)[None]) if engine.project(t) else None
        if found is None:
            raise ArithmeticError("the loops don't close at the start of the next cycle")
        return found.q[0], found.v[0]

    def deformation(self, cycle: CoupledTrajectory) -> float:
        return float(abs(cycle.q[:, list(self.system.shape_columns)]).max(initial=0.0))

    def matrices(
        self, cycle: CoupledTrajectory, shares: np.ndarray
    ) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        path = between(self.system, cycle, self.times[0] + shares * self.period)
        self._choose((cycle.q[0], cycle.v[0]))
        equations = PlanarEquations(self.engine)
        for t, *state in zip(path.times.tolist(), path.q, path.v, strict=True):
            self.system.fold(*state)
            self.engine.project(t)
            yield equations.matrices(equations.now(t))

    def end(self, cycle: CoupledTrajectory) -> Start:
        turns = np.array([k + 2 for k in self.system.start.values()])
        q = cycle.q[-1].copy()
        q[turns] -= whole_turns(q[turns] - cycle.q[0, turns])
        return q, cycle.v[-1].copy()
