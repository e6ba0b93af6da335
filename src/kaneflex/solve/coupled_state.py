"""A state of a coupled system that a run can start from: that of another run, read back from its results."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.support.errors import SceneError

if TYPE_CHECKING:
    from kaneflex.multibody.system import CoupledSystem
    from kaneflex.solve.solution import Solution

_OPEN = 1e-3
"""Share of the longest body, or rad, by which a state may miss the joints that it is given to."""


@dataclass(frozen=True, eq=False)
class State:
    """All coordinates of a coupled system at one time.

    Attributes
    ----------
    source : str
        What it was taken from, for messages.
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

        Raises SceneError if the system has other coordinates, or if its joints are not where the state has them.
        """
        wanted = [name for name, _ in system.coordinates]
        strange = sorted({*wanted} ^ {*self.names})
        if strange:
            owner = "the scene" if strange[0] in wanted else "the state"
            raise SceneError(
                "after", self.source, f"{strange[0]} is a coordinate of {owner} alone",
                "Continue with the scene and the number of modes that the state comes from",
            )  # fmt: skip
        order = [self.names.index(name) for name in wanted]
        q, v = self.q[order], self.v[order]
        check_closed(
            system, self.t, q, length, "after", self.source,
            "Continue with the lengths and drives that the state comes from",
        )  # fmt: skip
        return q, v


def check_closed(
    system: CoupledSystem, t: float, q: np.ndarray, length: float, key: str, source: str, cure: str
) -> None:
    """Raise SceneError (key, source and cure are its own) if the joints at the time t [s] are not where q has them."""
    for name, gap in system.gaps(t, q).items():
        if abs(gap) > _OPEN * (1.0 if name.endswith(("moment", "drive")) else length):
            opens = f"its state opens {name.rpartition('.')[0]} by {gap:.3g} (m or rad)"
            raise SceneError(key, source, opens, cure)


def last_state(solution: Solution) -> State:
    """The last state of a coupled solution. Raises SceneError for a solution that has none."""
    if solution.model.coupled is None:
        raise _none(repr(solution))
    trajectory = solution.trajectory
    names = tuple(name for name, _ in solution.model.coupled.coordinates)
    return State(repr(solution), float(trajectory.times[-1]), names, trajectory.q[-1], trajectory.v[-1])


def read_state(path: Path | str) -> State:
    """The last state of a run, from its folder or its ``results.nc``.

    Raises
    ------
    SceneError
        If there are no results, or they are not those of a coupled run.
    """
    import xarray

    path = Path(path)
    file = path / "results.nc" if path.is_dir() else path
    try:
        with xarray.open_dataset(file, engine="scipy") as found:
            if "state" not in found.coords:
                raise _none(str(path))
            names = tuple(str(name) for name in found["state"].values)
            t, q, v = float(found["time"][-1]), found["last_state"].values.copy(), found["last_rate"].values.copy()
    except (OSError, ValueError, TypeError) as error:
        if isinstance(error, SceneError):
            raise
        cure = "Name the folder of a run of preset coupled, or its results.nc"
        raise SceneError("after", str(path), "no results can be read there", cure) from error
    return State(str(path), t, names, q, v)


def _none(source: str) -> SceneError:
    cure = "Continue from a run of preset coupled"
    return SceneError("after", source, "holds no state: only coupled runs can be continued", cure)
