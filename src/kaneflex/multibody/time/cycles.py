"""Cycles of mechanisms in the plane and in space."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from kaneflex.integrate.outcome import Outcome
from kaneflex.multibody.model.state import State
from kaneflex.multibody.time.dense_output import between
from kaneflex.multibody.time.linearisation import Equations
from kaneflex.multibody.time.run import Method, integrate
from kaneflex.multibody.time.shooting import Cycles
from kaneflex.multibody.time.spatial_forward import Run
from kaneflex.multibody.time.trajectory import CoupledTrajectory
from kaneflex.scene.options import Options
from kaneflex.support.errors import SceneError


class PlanarCycles(Cycles[CoupledTrajectory]):
    """Cycles over ``times`` [s], by the coordinates of the equations; ``ends``: given ends of their steps [s]."""

    equations: Equations

    def __init__(
        self, equations: Equations, times: np.ndarray, method: Method, closer: float = 1.0,
        ends: np.ndarray | None = None,
    ) -> None:  # fmt: skip
        self.times, self.method, self.ends = times, method, ends
        super().__init__(equations, float(times[0]), float(times[-1] - times[0]), method.tolerance, closer)

    def run(self, start: State) -> CoupledTrajectory:
        return integrate(self.equations.system, start, self.times, self.method, ends=self.ends)

    def completed(self, cycle: CoupledTrajectory) -> bool:
        return cycle.outcome is Outcome.COMPLETED

    def at(self, cycle: CoupledTrajectory, times: np.ndarray) -> Iterator[State]:
        path = between(self.equations.system, cycle, times)
        return self.equations.engine.states_of(path.rows, self.equations.choice)


class SpatialCycles(Cycles[Run]):
    """Cycles over the duration of ``options`` from ``begin`` [s] on, by the coordinates of the equations.

    ``turned`` and ``ends``, given ends of the steps [s]: see :class:`kaneflex.multibody.time.spatial_forward.Run`.
    """

    equations: Equations

    def __init__(
        self, equations: Equations, options: Options, closer: float = 1.0, begin: float = 0.0,
        turned: Mapping[str, float] | None = None, ends: np.ndarray | None = None,
    ) -> None:  # fmt: skip
        self.options, self.turned, self.ends = options, turned, ends
        super().__init__(equations, begin, options.duration, options.tolerance, closer)

    def run(self, start: State) -> Run:
        run = Run(self.equations.system, self.options, start, turned=self.turned, given=self.ends)
        try:
            run.go()
        except SceneError as stopped:
            run.stopped = stopped
        return run

    def completed(self, cycle: Run) -> bool:
        return cycle.stopped is None

    def at(self, cycle: Run, times: np.ndarray) -> Iterator[State]:
        return map(cycle, times.tolist())
