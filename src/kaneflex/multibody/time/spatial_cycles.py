"""Cycles of a mechanism in space: final states as functions of initial ones."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from kaneflex.mechanism.planar import whole_turns
from kaneflex.multibody.model.spatial_layout import BALL, COORDINATE, KIND, SLIDE, SPEED, TURN
from kaneflex.multibody.model.spatial_system import SpatialSystem, State
from kaneflex.multibody.time.linear_equations import state_matrix
from kaneflex.multibody.time.shooting import REPEATS, Cycles, propagated
from kaneflex.multibody.time.spatial_forward import Run
from kaneflex.multibody.time.spatial_linear import linear, neighbours, spinning
from kaneflex.scene.options import Options
from kaneflex.support.errors import SceneError


class SpatialCycles(Cycles[State, Run]):
    """Cycles of a system over the duration of ``options``, with the choice of speeds of the first ``start``.

    ``closer``: allowed change over a cycle, as a share of REPEATS; other than 1 for neighbours of a known cycle, whose
    stability is not determined.
    """

    def __init__(self, system: SpatialSystem, options: Options, start: State, closer: float = 1.0) -> None:
        self.system, self.options, self.choice, self.left = system, options, start.choice, closer * REPEATS
        self.judges = closer == 1.0

    def run(self, start: State) -> Run:
        run = Run(self.system, self.options, start)
        try:
            run.go()
        except SceneError as stopped:
            run.stopped = stopped
        return run

    def completed(self, cycle: Run) -> bool:
        return cycle.stopped is None

    def repeats(self, cycle: Run) -> bool:
        """Changes of deformations relative to their largest, of all else relative to its range; changes below the
        resolution of steps are ignored."""
        system, which = self.system, self.choice.independent
        missed, q = abs(self.missed(cycle)[: len(which)]), cycle.at_ends()
        shapes = np.isin(which, system.modal_speeds)
        size, least = system.mechanism.size, self.options.tolerance
        largest = max(self.left * abs(q[:, system.modal_coordinates]).max(initial=0.0), 0.1 * least * size)
        rigid = np.delete(np.ptp(q, axis=0), system.modal_coordinates).max(initial=0.0) / max(1.0, size)
        others = (missed[~shapes] / system.measure[which[~shapes]]).max(initial=0.0)
        return bool(missed[shapes].max(initial=0.0) <= largest and others <= max(self.left * rigid, 0.1 * least))

    def missed(self, cycle: Run) -> np.ndarray:
        """Change in y and y' of :mod:`kaneflex.multibody.time.spatial_linear` about the start."""
        which, (_, W) = self.choice.independent, self._moving(cycle.start)
        y = self._apart(cycle.start.q, cycle.end.q)[which]
        return np.concatenate([y, (cycle.end.u - cycle.start.u)[which] - W @ y])

    def monodromy(self, cycle: Run, pieces: int) -> np.ndarray:
        return propagated(self._pieces(cycle, pieces))

    def _pieces(self, cycle: Run, pieces: int) -> Iterator[tuple[float, np.ndarray]]:
        length = self.options.duration / pieces
        for k in range(pieces):
            here = cycle((k + 0.5) * length)
            base = State(here.t, here.q, here.u, here.du, here.sizes, self.choice)
            found = linear(neighbours(self.system, base, range(2 * len(self.choice.independent))))
            yield length, state_matrix(found.M, found.C, found.K)

    def moved(self, cycle: Run, x: np.ndarray) -> State:
        which, (N, W), (y, rate) = self.choice.independent, self._moving(cycle.start), np.split(x, 2)
        u = cycle.start.u.copy()
        u[which] += rate + W @ y
        return self.system.project(0.0, self.system.advanced(cycle.start.q, (y @ N)[None])[0], u, self.choice)

    def end(self, cycle: Run) -> State:
        return self.system.project(0.0, cycle.end.q, cycle.end.u, self.choice)

    def _moving(self, start: State) -> tuple[np.ndarray, np.ndarray]:
        """N and W of :mod:`kaneflex.multibody.time.spatial_linear` at a state."""
        return spinning(self.system, self.system.project(start.t, start.q, start.u, self.choice))

    def _apart(self, q: np.ndarray, other: np.ndarray) -> np.ndarray:
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
