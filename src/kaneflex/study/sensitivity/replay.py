"""The runs of a coupled model's neighbours, in the steps that the model's own run has taken.

How the control of the steps' error would answer to the parameter is so no part of a difference between them: the steps
keep their number and their shares of the run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from kaneflex.integrate.outcome import Outcome
from kaneflex.multibody import tables as at
from kaneflex.multibody.model import Model
from kaneflex.multibody.run import CoupledTrajectory, integrate
from kaneflex.solve.coupled import as_solution, beginning, method_of
from kaneflex.solve.solution import Solution
from kaneflex.study.sensitivity.neighbours import SHARES, slope
from kaneflex.study.sensitivity.parameters import Parameter
from kaneflex.support.errors import SceneError

State = tuple[np.ndarray, np.ndarray]
"""q and v, (n,) each."""
_SOLVED = 1e-12
"""Share of the mechanism's size to which each step is solved: what is left must be small beside the differences."""
_APART = 1e-2
"""Step of the differences along a state of the cycle's start, as a share of how far it moves within the cycle."""
_SINGULAR = 1e14
"""Condition beyond which other states than the found one return, too."""


@dataclass(frozen=True, eq=False)
class Replay:
    """A finished coupled run, which neighbours take again."""

    solution: Solution

    def runs(self, parameter: Parameter, models: Sequence[Model], step: float) -> list[Solution]:
        """The runs of neighbours, in the order of SHARES; where one does not complete its first cycle, that one alone.

        Raises
        ------
        SceneError
            If the run could be periodic in other ways, too.
        """
        starts = [beginning(model) for model in models]
        if self.solution.model.options.start == "periodic":
            starts = [self._beside(start) for start in starts]
            cycles = [self._run(model, *start) for model, start in zip(models, starts, strict=True)]
            broken = [k for k, cycle in enumerate(cycles) if cycle.outcome is not Outcome.COMPLETED]
            if broken:
                return [as_solution(models[broken[0]], cycles[broken[0]], 0.0)]
            if not np.linalg.cond(self._returning) < _SINGULAR:
                raise SceneError(
                    parameter.name, parameter.value, "the periodic run is not the only one nearby",
                    "Damp the motion, or start from zero or quasistatic",
                )  # fmt: skip
            x = np.linalg.solve(self._returning, slope([*map(self._gap, models, cycles)], step))
            starts = [
                self._moved(model, start, -share * step * x)
                for share, model, start in zip(SHARES, models, starts, strict=True)
            ]
        return [
            as_solution(model, self._run(model, *start), 0.0) for model, start in zip(models, starts, strict=True)
        ]

    @property
    def _own(self) -> CoupledTrajectory:
        return self.solution.trajectory

    def _run(self, model: Model, q: np.ndarray, v: np.ndarray) -> CoupledTrajectory:
        """The run of a model from q and v, which are put onto the constraints."""
        stretch = model.step / self.solution.model.step
        method = replace(method_of(model), tolerance=_SOLVED)
        return integrate(model.coupled, q, v, self._own.times * stretch, method, ends=self._own.ends * stretch)

    def _beside(self, rigid: State) -> State:
        """The start of the run's cycle, moved by what the undeformed bodies of a neighbour stand elsewhere."""
        q, v = beginning(self.solution.model)
        return self._own.q[0] + rigid[0] - q, self._own.v[0] + rigid[1] - v

    @cached_property
    def _free(self) -> np.ndarray:
        """Independent coordinates of the engine at the start of the run."""
        own, engine = self._own, self.solution.model.coupled.engine
        self.solution.model.coupled.fold(own.q[0], own.v[0])
        engine.choose(float(own.times[0]))
        held = {*engine.dependent.tolist(), *engine.prescribed}
        return np.array([k for k in range(engine.size) if k not in held], int)

    def _coordinates(self, model: Model, q: np.ndarray, v: np.ndarray) -> State:
        """The independent coordinates of a state, and their rates."""
        model.coupled.fold(q, v)
        y, rate, *_ = model.coupled.engine.motion
        return y[self._free].copy(), rate[self._free].copy()

    def _moved(self, model: Model, start: State, x: np.ndarray) -> State:
        """A state moved along its independent coordinates and their rates, x (2 k,)."""
        system, t = model.coupled, float(self._own.times[0])
        system.fold(*start)
        engine = system.engine
        engine.choose(t)
        y, rate, *_ = engine.motion
        move, faster = np.split(x, 2)
        y[self._free] += move
        rate[self._free] += faster
        engine.settle(t)
        found = system.unfold(engine.row(t)[None])
        return found.q[0], found.v[0]

    def _gap(self, model: Model, cycle: CoupledTrajectory) -> np.ndarray:
        """By what the independent coordinates and their rates differ from those at the start, after a cycle, (2 k,).

        A joint that has turned on by whole turns stands where it stood.
        """
        engine = model.coupled.engine
        y, v = (b - a for a, b in zip(
            self._coordinates(model, cycle.q[0], cycle.v[0]), self._coordinates(model, cycle.q[-1], cycle.v[-1]),
            strict=True,
        ))  # fmt: skip
        turns = np.array([engine.layout.coordinates[k][1] == "rad" for k in self._free])
        y[turns] -= 2.0 * np.pi * np.round(y[turns] / (2.0 * np.pi))
        return np.concatenate([y, v])

    @cached_property
    def _returning(self) -> np.ndarray:
        """How that gap follows the start of the cycle, (2 k, 2 k): the monodromy matrix less one."""
        own, model = self._own, self.solution.model
        engine = model.coupled.engine
        size = engine.numbers(at.MEASURE, engine.size)[self._free]
        courses = [self._coordinates(model, q, v) for q, v in zip(own.q, own.v, strict=True)]
        y, rate = (np.array(part) for part in zip(*courses, strict=True))
        moves = np.minimum(np.ptp(y, axis=0), size), np.ptp(rate, axis=0)
        units = np.concatenate([np.where(part > 0.0, part, size) for part in moves])
        columns = []
        for k, unit in enumerate(units):
            x = np.zeros(len(units))
            x[k] = _APART * unit
            starts = (self._moved(model, (own.q[0], own.v[0]), share * x) for share in SHARES)
            gaps = [self._gap(model, self._run(model, *start)) for start in starts]
            columns.append(slope(gaps, _APART) / unit)
        return np.array(columns).T
