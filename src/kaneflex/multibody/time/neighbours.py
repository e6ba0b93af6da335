"""Neighbouring states of an instant, from which sensors are differentiated, in the plane and in space."""

from __future__ import annotations

import numpy as np

from kaneflex.multibody.model.state import State
from kaneflex.multibody.model.system import System
from kaneflex.multibody.time.spatial_curves import Curve
from kaneflex.multibody.time.trajectory import CoupledTrajectory, by_themselves

_APART = 1e-15
"""Spacing of fictitious instants, which only order the neighbours, as a share of their time, or of 1 s: nothing else
changes between them."""


def instants(base: State, count: int) -> np.ndarray:
    """Fictitious ascending times of neighbours [s], (count,)."""
    return base.t + _APART * max(1.0, abs(base.t)) * np.arange(count)


def probes(system: System, base: State, given: np.ndarray) -> CoupledTrajectory:
    """States near an instant by rows of coordinates, speeds, accelerations and inputs."""
    engine, rows, records = system.engine, list[np.ndarray](), list[np.ndarray]()
    inputs = engine.additions
    # free courses need ascending times
    times = instants(base, len(given)) if system.mechanism.free else np.full(len(given), base.t)
    for t, each in zip(times.tolist(), given, strict=True):
        q, u, _, inputs[:] = np.split(each, engine.size * np.arange(1, 4))
        try:
            system.project(base.t, q, u, base.choice)
            records.append(system.unfold(engine.row(base.t)[None]))
            rows.append(engine.row(t))
        finally:
            inputs[:] = 0.0
    return by_themselves(system, np.array(rows), np.concatenate(records))


class Neighbours(Curve):
    """Neighbouring states of a motion in space at fictitious successive ``times`` [s].

    ``start``: state of the motion itself; ``given``: their coordinates, independent speeds and accelerations, and
    inputs, (k, coordinates + 2 speeds + inputs).
    """

    def __init__(self, system: System, start: State, given: np.ndarray) -> None:
        self.system, self.start, self.given, self.times = system, start, given, instants(start, len(given))

    def rows(self, times: np.ndarray) -> np.ndarray:
        out = np.zeros((len(times), len(self.system.work.kept)))
        given = self.given[np.minimum(np.searchsorted(self.times, times), len(self.given) - 1)]
        self.system.near(self.start.choice, np.full(len(out), self.start.t), given, out)
        return out
