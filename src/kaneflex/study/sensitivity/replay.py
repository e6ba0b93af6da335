"""The runs of a coupled model's neighbours, in the steps that the model's own run has taken.

How the control of the steps' error would answer to the parameter is so no part of a difference between them: the steps
keep their number and their shares of the run.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from kaneflex.integrate.outcome import Outcome
from kaneflex.multibody import tables as at
from kaneflex.multibody.model import Model
from kaneflex.multibody.returning import Returning, returning
from kaneflex.multibody.run import integrate
from kaneflex.multibody.trajectory import CoupledTrajectory
from kaneflex.solve.coupled import as_solution, beginning, method_of
from kaneflex.solve.solution import Solution
from kaneflex.study.sensitivity.slopes import SHARES, slope
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

    def __call__(self, model: Model) -> Solution:
        """The run of a neighbour; of one that does not complete its first cycle, that one.

        The start of a cycle goes by Newton's method where the neighbour returns, with the run's own tangent: all
        neighbours' starts are off by as much, to the second order of their distance.

        Raises
        ------
        SceneError
            If the run could be periodic in other ways, too.
        """
        start = beginning(model)
        if self.solution.model.options.start == "periodic":
            start = self._beside(start)
            cycle = self._run(model, *start)
            if cycle.outcome is not Outcome.COMPLETED:
                return as_solution(model, cycle, 0.0)
            if not np.linalg.cond(self._returning) < _SINGULAR:
                raise SceneError(
                    "solve.start", "periodic", "the periodic run is not the only one nearby",
                    "Damp the motion, or start from zero or quasistatic",
                )  # fmt: skip
            start = self._cycle.moved(model.coupled, *start, -np.linalg.solve(self._returning, self._gap(model, cycle)))
        return as_solution(model, self._run(model, *start), 0.0)

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
    def _cycle(self) -> Returning:
        """The independent coordinates at the start of the run."""
        own = self._own
        return returning(self.solution.model.coupled, float(own.times[0]), own.q[0], own.v[0])

    def _gap(self, model: Model, cycle: CoupledTrajectory) -> np.ndarray:
        """By what the independent coordinates and their rates differ from those at the start, after a cycle, (2 k,)."""
        return self._cycle.missed(model.coupled, cycle)

    @cached_property
    def _returning(self) -> np.ndarray:
        """How that gap follows the start of the cycle, (2 k, 2 k): the monodromy matrix less one."""
        own, model = self._own, self.solution.model
        engine = model.coupled.engine
        size = engine.numbers(at.MEASURE, engine.size)[self._cycle.which]
        courses = np.array([self._cycle.coordinates(model.coupled, *state) for state in zip(own.q, own.v, strict=True)])
        y, rate = np.split(courses, 2, axis=1)
        moves = np.minimum(np.ptp(y, axis=0), size), np.ptp(rate, axis=0)
        units = np.concatenate([np.where(part > 0.0, part, size) for part in moves])
        columns = []
        for k, unit in enumerate(units):
            x = np.zeros(len(units))
            x[k] = _APART * unit
            starts = (self._cycle.moved(model.coupled, own.q[0], own.v[0], share * x) for share in SHARES)
            gaps = [self._gap(model, self._run(model, *start)) for start in starts]
            columns.append(slope(gaps, _APART) / unit)
        return np.array(columns).T
