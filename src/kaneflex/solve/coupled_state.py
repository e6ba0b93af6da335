"""Initial state of a coupled run, taken from another run or its results."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.support.arguments import takes
from kaneflex.support.errors import Fault, SceneError
from kaneflex.support.labelled import read_labelled

if TYPE_CHECKING:
    from kaneflex.multibody.model.bound_model import Model
    from kaneflex.multibody.model.system import CoupledSystem
    from kaneflex.solve.run_result import RunResult

_OF_STATE = ("state", "last_state", "last_rate")
CONTINUE = "Continue with the lengths and drives of that run"
OPEN = 1e-3
"""Change of a given state by closing the joints that is accepted: a share of the mechanism's size, or rad."""


@dataclass(frozen=True, eq=False)
class State:
    """All coordinates of a coupled system at one time, of a ball in space the components of its unit quaternion.

    Attributes
    ----------
    source : str
        Origin, for messages.
    t : float
        Time [s].
    names : tuple of str
        Coordinates of the coupled system's bodies; in space those of its joints and shapes, then the angles of joints
        that close loops, which only count turns.
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
        q, v = self.ordered([name for name, _ in system.coordinates])
        check_closed(openings(system, self.t, q, length), "after", self.source, CONTINUE)
        return q, v

    def ordered(self, wanted: Sequence[str], others: Collection[str] = ()) -> tuple[np.ndarray, np.ndarray]:
        """q and v of the wanted coordinates. Raises SceneError if one is missing, or there are more than ``others``."""
        strange = sorted(({*wanted} ^ {*self.names}) - {*others})
        if strange:
            owner = "state" if strange[0] in wanted else "scene"
            raise SceneError(
                "after", self.source, f"the {owner} has no coordinate {strange[0]}",
                "Continue with the scene and number of modes of that run",
            )  # fmt: skip
        order = [self.names.index(name) for name in wanted]
        return self.q[order], self.v[order]


def openings(system: CoupledSystem, t: float, q: np.ndarray, length: float) -> Iterator[tuple[str, float, float]]:
    """Joints of a planar system, by how much q opens them at t [s] [m or rad], and the unit of that."""
    for name, gap in system.gaps(t, q).items():
        joint, _, part = name.rpartition(".")
        slides = part == "drive" and system.mechanism.joints[joint].kind == "prismatic"
        yield joint, gap, length if slides or part not in ("moment", "drive") else 1.0


def check_closed(gaps: Iterable[tuple[str, float, float]], key: str, source: str, cure: str) -> None:
    """Raise SceneError (of ``key``, ``source`` and ``cure``) if a state opens a joint."""
    for joint, gap, unit in gaps:
        if not abs(gap) <= OPEN * unit:
            raise SceneError(key, source, f"the state opens joint {joint} by {gap:.3g} (m or rad)", cure)


def last_state(solution: RunResult) -> State:
    """Last state of a coupled solution. Raises SceneError if there is none."""
    from kaneflex.solve.initial import start_coordinates

    model = solution.model
    if model.options.dynamics != "coupled":
        raise _none(repr(solution))
    t = float(solution.times[-1])
    names, (q, v) = start_coordinates(model), (part[:, -1] for part in solution.motion.taken(np.array([-1])).state)
    if model.in_space is not None:
        names, q, v = with_turns(names, q, v, model.in_space.turned(t))
    return State(repr(solution), t, names, q, v)


def first_state(model: Model) -> State | None:
    """State from which a run in space continues another one; None if it starts as the scene does."""
    from kaneflex.multibody.model.spatial_rates import rates_of
    from kaneflex.solve.initial import start_coordinates

    if model.in_space is None or model.in_space.curve.turned is None:
        return None
    start, turned = model.in_space.curve.start, model.in_space.curve.turned
    rates = rates_of(model.in_space.module.system, start.q[None], start.u[None])[0]
    turns = {name: (angle, 0.0) for name, angle in turned.items()}
    return State(repr(model), start.t, *with_turns(start_coordinates(model), start.q, rates, turns))


def with_turns(
    names: tuple[str, ...], q: np.ndarray, v: np.ndarray, turned: Mapping[str, tuple[float, float]]
) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Names, coordinates and rates of a state, with the angles of joints that close loops, and their rates."""
    angles, rates = np.array([*turned.values()]).reshape(-1, 2).T
    return (*names, *(f"{name}.angle" for name in turned)), np.append(q, angles), np.append(v, rates)


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
