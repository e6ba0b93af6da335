"""Initial state of a coupled run, taken from another run or its results."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.support.arguments import takes
from kaneflex.support.errors import Fault, SceneError
from kaneflex.support.labelled import read_labelled

if TYPE_CHECKING:
    from kaneflex.multibody.model.system import CoupledSystem
    from kaneflex.solve.run_result import RunResult

_OF_STATE = ("state", "last_state", "last_rate")
_OPEN = 1e-3
"""Share of the longest body, or rad, by which a state may open joints."""


@dataclass(frozen=True, eq=False)
class State:
    """All coordinates of a coupled system at one time.

    Attributes
    ----------
    source : str
        Origin, for messages.
    t : float
        Time [s].
    names : tuple of str
        Coordinates of the coupled system's bodies.
    q, v : ndarray (n,)
        Coordinates [m or rad] and their rates.
    """

    source: str
    t: float
    names: tuple[str, ...]
    q: np.ndarray
    v: np.ndarray

    def fitted(self, system: CoupledSystem, length: float) -> tuple[np.ndarray, np.ndarray]:
        """q and v in a system's order.

        Raises SceneError if the system has other coordinates, or the state opens its joints.
        """
        wanted = [name for name, _ in system.coordinates]
        strange = sorted({*wanted} ^ {*self.names})
        if strange:
            owner = "state" if strange[0] in wanted else "scene"
            raise SceneError(
                "after", self.source, f"the {owner} has no coordinate {strange[0]}",
                "Continue with the scene and number of modes of that run",
            )  # fmt: skip
        order = [self.names.index(name) for name in wanted]
        q, v = self.q[order], self.v[order]
        check_closed(
            system, self.t, q, length, "after", self.source,
            "Continue with the lengths and drives of that run",
        )  # fmt: skip
        return q, v


def check_closed(
    system: CoupledSystem, t: float, q: np.ndarray, length: float, key: str, source: str, cure: str
) -> None:
    """Raise SceneError (of ``key``, ``source`` and ``cure``) if q opens the joints at the time t [s]."""
    for name, gap in system.gaps(t, q).items():
        if abs(gap) > _OPEN * (1.0 if name.endswith(("moment", "drive")) else length):
            opens = f"the state opens joint {name.rpartition('.')[0]} by {gap:.3g} (m or rad)"
            raise SceneError(key, source, opens, cure)


def last_state(solution: RunResult) -> State:
    """Last state of a coupled solution. Raises SceneError if there is none."""
    if solution.model.coupled is None:
        raise _none(repr(solution))
    trajectory = solution.trajectory
    names = tuple(name for name, _ in solution.model.coupled.coordinates)
    return State(repr(solution), float(trajectory.times[-1]), names, trajectory.q[-1], trajectory.v[-1])


@takes(path="path")
def read_state(path: Path | str) -> State:
    """Last state of a run, from its folder or its ``results.nc``.

    Raises
    ------
    SceneError
        If there are no results, or not of a coupled run.
    """
    path = Path(path)
    cure = "Give the folder of a run of preset coupled, or its results.nc"
    try:
        found = read_labelled(path / "results.nc" if path.is_dir() else path, ("time", *_OF_STATE))
    except Fault as fault:
        raise SceneError("after", str(path), f"its results can't be read: {fault.reason}", cure) from fault
    if not any(name in found.variables for name in _OF_STATE):
        raise _none(str(path))
    each = (found.variables[name][1] if name in found.variables else np.zeros(0) for name in (*_OF_STATE, "time"))
    names, q, v, times = each
    numbers = all(each.dtype.kind == "f" for each in (q, v, times)) and names.shape == q.shape == v.shape and times.size
    if not numbers or not np.isfinite([times[-1], *q, *v]).all():
        raise SceneError("after", str(path), "its last state is incomplete or damaged", cure)
    return State(str(path), float(times[-1]), tuple(map(str, names)), q, v)


def _none(source: str) -> SceneError:
    cure = "Continue from a run of preset coupled"
    return SceneError("after", source, "it has no state: only coupled runs can be continued", cure)
