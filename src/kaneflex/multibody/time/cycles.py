"""Cycles of mechanisms in the plane and in space."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from kaneflex.integrate.outcome import Outcome
from kaneflex.multibody.model.state import State
from kaneflex.multibody.time.dense_output import between
from kaneflex.multibody.time.run import integrate
from kaneflex.multibody.time.shooting import Cycles
from kaneflex.multibody.time.spatial_forward import SpatialRun
from kaneflex.multibody.time.trajectory import CoupledTrajectory
from kaneflex.support.errors import SceneError


class PlanarCycles(Cycles[CoupledTrajectory]):
    """Cycles as the motion at instants."""

    def run(self, start: State) -> CoupledTrajectory:
        return integrate(self.equations.system, start, self.times, self.method, ends=self.ends)

    def completed(self, cycle: CoupledTrajectory) -> bool:
        return cycle.outcome is Outcome.COMPLETED

    def at(self, cycle: CoupledTrajectory, times: np.ndarray) -> Iterator[State]:
        path = between(self.equations.system, cycle, times)
        return self.equations.engine.states_of(path.rows, self.equations.choice)


class SpatialCycles(Cycles[SpatialRun]):
    """Cycles as curves between the ends of their steps."""

    def run(self, start: State) -> SpatialRun:
        run = SpatialRun(self.equations.system, start, self.times, self.method, self.ends)
        try:
            run.go()
        except SceneError as stopped:
            run.stopped = stopped
        return run

    def completed(self, cycle: SpatialRun) -> bool:
        return cycle.stopped is None

    def at(self, cycle: SpatialRun, times: np.ndarray) -> Iterator[State]:
        return map(cycle, times.tolist())
