"""Cycles of mechanisms in the plane and in space."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from kaneflex.integrate.outcome import Outcome
from kaneflex.mechanism.planar import whole_turns
from kaneflex.multibody.model.state import State
from kaneflex.multibody.time.dense_output import between
from kaneflex.multibody.time.planar_linear import PlanarEquations
from kaneflex.multibody.time.run import Method, integrate
from kaneflex.multibody.time.shooting import LOOKS, Cycles
from kaneflex.multibody.time.spatial_forward import Run
from kaneflex.multibody.time.spatial_linear import SpatialEquations
from kaneflex.multibody.time.trajectory import CoupledTrajectory
from kaneflex.scene.options import Options
from kaneflex.support.errors import SceneError


class PlanarCycles(Cycles[CoupledTrajectory]):
    """Cycles over ``times`` [s], by the coordinates of the equations; ``ends``: given ends of their steps [s]."""

    equations: PlanarEquations

    def __init__(
        self, equations: PlanarEquations, times: np.ndarray, method: Method, closer: float = 1.0,
        ends: np.ndarray | None = None,
    ) -> None:  # fmt: skip
        self.times, self.method, self.ends, engine = times, method, ends, equations.engine
        super().__init__(float(times[-1] - times[0]), method.tolerance, equations, closer)
        self.touches = bool(len(engine.contacts) or len(engine.holds))

    def run(self, start: State) -> CoupledTrajectory:
        return integrate(self.equations.system, start, self.times, self.method, ends=self.ends)

    def completed(self, cycle: CoupledTrajectory) -> bool:
        return cycle.outcome is Outcome.COMPLETED

    def states(self, cycle: CoupledTrajectory, count: int) -> Iterator[State]:
        rows = np.linspace(0, len(cycle.times) - 1, count).round().astype(int)
        return self.equations.engine.states_of(cycle.rows[rows], self.equations.choice)

    def along(self, cycle: CoupledTrajectory, shares: np.ndarray) -> Iterator[State]:
        equations, path = self.equations, between(self.equations.system, cycle, self.times[0] + shares * self.period)
        for state in equations.engine.states_of(path.rows, equations.choice):
            yield equations.system.project(state.t, state.q, state.u, equations.choice)

    def deformation(self, cycle: CoupledTrajectory) -> float:
        engine = self.equations.engine
        return float(abs(cycle.rows[:, engine.columns["q"]][:, engine.shapes]).max(initial=0.0))

    def end(self, cycle: CoupledTrajectory) -> State:
        engine = self.equations.engine
        start, end = engine.states_of(cycle.rows[[0, -1]], self.equations.choice)
        turns = engine.turns & ~engine.shapes
        end.q[turns] -= whole_turns(end.q[turns] - start.q[turns])
        return replace(end, t=start.t)


class SpatialCycles(Cycles[Run]):
    """Cycles over the duration of ``options`` from ``begin`` [s] on, by the coordinates of the equations.

    ``turned`` and ``ends``, given ends of the steps [s]: see :class:`kaneflex.multibody.time.spatial_forward.Run`.
    """

    equations: SpatialEquations

    def __init__(
        self, equations: SpatialEquations, options: Options, closer: float = 1.0, begin: float = 0.0,
        turned: Mapping[str, float] | None = None, ends: np.ndarray | None = None,
    ) -> None:  # fmt: skip
        self.options, self.begin, self.turned, self.ends = options, begin, turned, ends
        super().__init__(options.duration, options.tolerance, equations, closer)
        self.touches = bool(len(equations.system.engine.contacts))

    def run(self, start: State) -> Run:
        run = Run(self.equations.system, self.options, start, turned=self.turned, given=self.ends)
        try:
            run.go()
        except SceneError as stopped:
            run.stopped = stopped
        return run

    def completed(self, cycle: Run) -> bool:
        return cycle.stopped is None

    def states(self, cycle: Run, count: int) -> Iterator[State]:
        return self.along(cycle, np.linspace(0.0, 1.0, count))

    def along(self, cycle: Run, shares: np.ndarray) -> Iterator[State]:
        return map(cycle, (self.begin + shares * self.period).tolist())

    def deformation(self, cycle: Run) -> float:
        shapes = self.equations.system.modal_coordinates
        return float(max(abs(state.q[shapes]).max(initial=0.0) for state in self.states(cycle, LOOKS)))

    def end(self, cycle: Run) -> State:
        return self.equations.system.project(self.begin, cycle.end.q, cycle.end.u, self.equations.choice)
