"""Runs of a coupled model's neighbours in the steps of the model's own run.

Fixed steps keep the step size control out of the differences: the number of steps and their shares of the run are those
of the model's run.
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
"""Tolerance of each step as a share of the mechanism's size: far below the differences between neighbours."""
_APART = 1e-2
"""Step of the differences along a state of the cycle's start, as a share of its range within the cycle."""
_SINGULAR = 1e14
"""Condition number beyond which the periodic solution is not isolated."""


@dataclass(frozen=True, eq=False)
class Replay:
    """A finished coupled run, whose steps neighbours repeat."""

    solution: Solution

    def __call__(self, model: Model) -> Solution:
        """Run of a neighbour; if its first cycle is not completed, that cycle.

        For periodic runs, one Newton step with the monodromy matrix of the own run moves the start of the cycle to the
        neighbour's periodic solution. Its error is the same for all neighbours to second order of their distance.

        Raises
        ------
        SceneError
            If the periodic solution is not isolated.
        """
        start = beginning(model)
        if self.solution.model.options.start == "periodic":
            start = self._beside(start)
            cycle = self._run(model, *start)
            if cycle.outcome is not Outcome.COMPLETED:
                return as_solution(model, cycle, 0.0)
            if not np.linalg.cond(self._returning) < _SINGULAR:
                raise SceneError(
                    "solve.start", "periodic", "the periodic motion is not isolated: others exist nearby",
                    "Add damping, or start from zero or quasistatic",
                )  # fmt: skip
            start = self._cycle.moved(model.coupled, *start, -np.linalg.solve(self._returning, self._gap(model, cycle)))
        return as_solution(model, self._run(model, *start), 0.0)

    @property
    def _own(self) -> CoupledTrajectory:
        return self.solution.trajectory

    def _run(self, model: Model, q: np.ndarray, v: np.ndarray) -> CoupledTrajectory:
        """Run of a model from q and v, which are projected onto the constraints."""
        stretch = model.step / self.solution.model.step
        method = replace(method_of(model), tolerance=_SOLVED)
        return integrate(model.coupled, q, v, self._own.times * stretch, method, ends=self._own.ends * stretch)

    def _beside(self, rigid: State) -> State:
        """Start of the run's cycle, shifted by the difference of the two undeformed mechanisms' states."""
        q, v = beginning(self.solution.model)
        return self._own.q[0] + rigid[0] - q, self._own.v[0] + rigid[1] - v

    @cached_property
    def _cycle(self) -> Returning:
        """Independent coordinates at the start of the run."""
        own = self._own
        return returning(self.solution.model.coupled, float(own.times[0]), own.q[0], own.v[0])

    def _gap(self, model: Model, cycle: CoupledTrajectory) -> np.ndarray:
        """Independent coordinates and rates at the end of a cycle minus those at its start, (2 k,)."""
        return self._cycle.missed(model.coupled, cycle)

    @cached_property
    def _returning(self) -> np.ndarray:
        """Derivative of that gap with respect to the start, (2 k, 2 k): the monodromy matrix minus the identity."""
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
