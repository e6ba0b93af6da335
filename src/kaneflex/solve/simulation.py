"""Solution of a model over its duration, by the method of its preset."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

from kaneflex.integrate.system import Outcome
from kaneflex.multibody.model.bound_model import Model
from kaneflex.scene.read import SceneLike
from kaneflex.solve.loading import model_from
from kaneflex.solve.one_way_run import Progress, run_one_way
from kaneflex.solve.solution import Solution
from kaneflex.support.arguments import takes
from kaneflex.support.errors import ValidityWarning, refuse

if TYPE_CHECKING:
    from kaneflex.solve.initial import SavedState


@takes(model="model", progress="function", after="state")
def simulate(
    model: SceneLike, progress: Progress | None = None, after: Solution | SavedState | None = None
) -> Solution:
    """Solve a model over one cycle or the scene's duration, by integration or at each instant.

    Parameters
    ----------
    model : Model, Solution, Scene or path
    progress : callable, optional
        Called with the finished share of the work, 0 to 1.
    after : Solution or SavedState, optional
        Run whose last state is the start, under preset ``coupled``: see :func:`kaneflex.read_state`.

    Returns
    -------
    Solution
        Also of a run that stopped early: its ``outcome`` and ``message`` give time and reason.

    Warns
    -----
    ValidityWarning
        Each of the solution's ``warnings``, and the ``message`` of a run that stopped early.

    Raises
    ------
    SceneError
        If the requested start is not possible, or ``after`` does not fit the model.
    """
    solution = solve(model_from(model), progress, after)
    stopped = () if solution.outcome is Outcome.COMPLETED else (solution.message,)
    for text in (*stopped, *solution.warnings):
        warnings.warn(text, ValidityWarning, stacklevel=3)  # skips the frame of the argument check
    return solution


def solve(model: Model, progress: Progress | None = None, after: Solution | SavedState | None = None) -> Solution:
    """Like :func:`simulate`, without issuing the warnings."""
    if after is not None:
        after = after.last_state() if isinstance(after, Solution) else after
        refuse(
            (model.options.dynamics != "coupled", "solve.preset", model.options.preset,
             "only coupled runs can be continued", "Choose preset coupled"),
            (model.options.start == "given", "after", after.source, "the scene also gives an initial state",
             "Leave solve.start out"),
        )  # fmt: skip
    if model.options.dynamics != "coupled":
        return Solution.of(run_one_way(model, progress))
    from kaneflex.solve.coupled import simulate_coupled

    return Solution.of(simulate_coupled(model, progress, after))
