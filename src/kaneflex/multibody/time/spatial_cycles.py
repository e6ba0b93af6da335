"""Cycles of a mechanism in space by the coordinates y of :mod:`kaneflex.multibody.time.spatial_linear`."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from kaneflex.mechanism.planar import whole_turns
from kaneflex.multibody.model.spatial_layout import BALL, COORDINATE, KIND, SLIDE, SPEED, TURN
from kaneflex.multibody.model.spatial_system import SpatialSystem, State
from kaneflex.multibody.time.shooting import LOOKS, Cycles
from kaneflex.multibody.time.spatial_forward import Run
from kaneflex.multibody.time.spatial_linear import SpatialEquations
from kaneflex.scene.options import Options
from kaneflex.support.errors import SceneError


class SpatialCycles(Cycles[State, Run]):
    """Cycles of a system over the duration of ``options``, with the choice of speeds of the first ``start``."""

    def __init__(self, system: SpatialSystem, options: Options, start: State, closer: float = 1.0) -> None:
        self.system, self.options, self.choice, which = system, options, start.choice, start.choice.independent
        shapes = np.isin(which, system.modal_speeds)
        super().__init__(options.duration, options.tolerance, system.measure[which], shapes, closer)

    def run(self, start: State) -> Run:
        run = Run(self.system, self.options, start)
        try:
            run.go()
        except SceneError as stopped:
            run.stopped = stopped
        return run

    def completed(self, cycle: Run) -> bool:
        return cycle.stopped is None

    def states(self, cycle: Run, count: int) -> Iterator[State]:
        return map(cycle, np.linspace(0.0, self.period, count).tolist())

    def apart(self, start: State, *others: State) -> np.ndarray:
        which, (_, W), found = self.choice.independent, self._moving(start), []
        for other in others:
            y = self._turned(start.q, other.q)[which]
            found.append(np.concatenate([y, (other.u - start.u)[which] - W @ y]))
        return np.array(found)

    def moved(self, start: State, x: np.ndarray) -> State:
        which, (N, W), (y, rate) = self.choice.independent, self._moving(start), np.split(x, 2)
        u = start.u.copy()
        u[which] += rate + W @ y
        return self.system.project(0.0, self.system.advanced(start.q, (y @ N)[None])[0], u, self.choice)

    def deformation(self, cycle: Run) -> float:
        shapes = self.system.modal_coordinates
        return float(max(abs(state.q[shapes]).max(initial=0.0) for state in self.states(cycle, LOOKS)))

    def matrices(self, cycle: Run, shares: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        for here in map(cycle, (shares * self.period).tolist()):
            yield SpatialEquations(self.system, self.choice).matrices(here)

    def end(self, cycle: Run) -> State:
        return self.system.project(0.0, cycle.end.q, cycle.end.u, self.choice)

    def _moving(self, start: State) -> tuple[np.ndarray, np.ndarray]:
        """N and W of :mod:`kaneflex.multibody.time.spatial_linear` at a state."""
        self.system.project(start.t, start.q, start.u, self.choice)
        return SpatialEquations(self.system, self.choice).spinning(start)

    def _turned(self, q: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Difference of coordinates as a step of all speeds, without whole turns, (speeds,)."""
        from scipy.spatial.transform import Rotation

        found = np.zeros(self.system.speeds)
        for kind, k, s in self.system.tables.nodes[:, [KIND, COORDINATE, SPEED]].tolist():
            if kind == BALL:
                first, second = (Rotation.from_quat(np.roll(each[k : k + 4], -1)) for each in (q, other))
                found[s : s + 3] = (first.inv() * second).as_rotvec()
            elif kind in (TURN, SLIDE):
                found[s] = other[k] - q[k]
                found[s] -= whole_turns(found[s]) * (kind == TURN)
        found[self.system.modal_speeds] = (other - q)[self.system.modal_coordinates]
        return found
