"""Runs of a coupled model's neighbours in the steps of the model's own run, in the plane and in space.

Fixed steps keep the step size control out of the differences: the number of steps and their shares of the run are those
of the model's run.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.state import State
from kaneflex.multibody.time.linearisation import Equations, prepare
from kaneflex.multibody.time.shooting import Cycles
from kaneflex.solve.coupled import as_result, beginning, method_of
from kaneflex.solve.run_result import RunResult
from kaneflex.solve.simulation import solve
from kaneflex.solve.solution import Solution
from kaneflex.support.errors import SceneError

SHARES = (-2, -1, 1, 2)
"""Neighbours' positions in relative steps of the parameter."""
_SOLVED = 1e-12
"""Tolerance of each step as a share of the mechanism's size: far below the differences between neighbours."""
_APART = 1e-2
"""Step of the differences along a state of the cycle's start, as a share of its range within the cycle."""
_SINGULAR = 1e14
"""Condition number beyond which the periodic solution is not isolated."""


def solver_of(solution: Solution) -> Callable[[Model], RunResult]:
    """Solver of the neighbours of a run: in its steps if the run chose these."""
    model = solution.model
    return Replay(solution) if model.options.dynamics == "coupled" else solve


def slope(values: Sequence[np.ndarray], step: float) -> np.ndarray:
    """Derivative p dx/dp from the values at the neighbours, in the order of SHARES."""
    lowest, low, high, highest = values
    return (8.0 * (high - low) - (highest - lowest)) / (12.0 * step)


@dataclass(frozen=True, eq=False)
class Replay:
    """Solver of a run's neighbours in the steps of the run."""

    solution: Solution

    def __call__(self, model: Model) -> RunResult:
        """Run of a neighbour; if its first cycle is not completed, that cycle.

        For periodic runs, one Newton step with the monodromy matrix of the own run moves the start of the cycle to the
        neighbour's periodic solution. Its error is the same for all neighbours to second order of their distance.

        Raises
        ------
        SceneError
            If the periodic solution is not isolated.
        """
        cycles, start = self.cycles(model), self.first(model)
        if model.options.start == "periodic":
            start = cycles.moved(start, self._deformed)
            cycle = cycles.run(start)
            if not cycles.completed(cycle):
                return as_result(model, cycle, 0.0)
            if not np.linalg.cond(self._returning) < _SINGULAR:
                raise SceneError(
                    "solve.start", "periodic", "the periodic motion is not isolated: others exist nearby",
                    "Add damping, or start from zero or quasistatic",
                )  # fmt: skip
            start = cycles.moved(start, -np.linalg.solve(self._returning, cycles.missed(cycle)))
        return as_result(model, cycles.run(start), 0.0)

    @cached_property
    def own(self) -> Any:
        """The run of the model itself, as a cycle."""
        return self.solution.trajectory

    def first(self, model: Model) -> State:
        """Start of a model's run; of a periodic one that of the undeformed mechanism."""
        return replace(beginning(model), t=float(self.own.times[0]), choice=self._equations.choice)

    def cycles(self, model: Model) -> Cycles:
        """Cycles of a model in the steps of the own run, by the same independent coordinates."""
        stretch, method = model.step / self.solution.model.step, replace(method_of(model), tolerance=_SOLVED)
        equations = replace(self._equations, system=model.coupled_system)
        return Cycles(equations, self.own.times * stretch, method, ends=self.own.curve.ends * stretch)

    @cached_property
    def _equations(self) -> Equations:
        own, system = self.own, self.solution.model.coupled
        if system is None:
            return Equations(own.curve.system, own.curve.start.choice)
        return prepare(system, next(own.curve.states(own.times[:1])))[0]

    @cached_property
    def _cycles(self) -> Cycles:
        return self.cycles(self.solution.model)

    @cached_property
    def _start(self) -> Any:
        return next(iter(self._cycles.states(self.own, 2)))

    @cached_property
    def _deformed(self) -> np.ndarray:
        """Start of the own run less that of the undeformed mechanism, (2 k,)."""
        return self._cycles.apart(self.first(self.solution.model), self._start)[0]

    @cached_property
    def _returning(self) -> np.ndarray:
        """Derivative of the change over a cycle with respect to the start, (2 k, 2 k): the monodromy matrix minus the
        identity."""
        cycles, columns = self._cycles, []
        for unit in np.diag(cycles.sizes(self.own)):
            starts = (cycles.moved(self._start, share * _APART * unit) for share in SHARES)
            gaps = [cycles.missed(cycles.run(start)) for start in starts]
            columns.append(slope(gaps, _APART) / unit.max())
        return np.array(columns).T
