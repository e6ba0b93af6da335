"""Neighbouring states of an instant, from which sensors are differentiated, in the plane and in space."""

from __future__ import annotations

import numpy as np

from kaneflex.multibody.model.codes import NEAR_STATES, check
from kaneflex.multibody.model.state import State
from kaneflex.multibody.model.system import System
from kaneflex.multibody.time.curves import Curve

_APART = 1e-15
"""Spacing of fictitious instants, which only order the neighbours, as a share of their time, or of 1 s: nothing else
changes between them."""


class Neighbours(Curve):
    """Neighbouring states of a motion at fictitious successive ``times`` [s].

    ``start``: state of the motion itself; ``given``: their coordinates, independent speeds and accelerations, and
    inputs, (k, coordinates + 2 speeds + inputs); ``states``: rows near them at the time of the motion.
    """

    def __init__(self, system: System, start: State, given: np.ndarray) -> None:
        self.system, self.start, engine = system, start, system.engine
        self.times = start.t + _APART * max(1.0, abs(start.t)) * np.arange(len(given))
        system.project(start.t, start.q, start.u, start.choice)
        q, u, _, inputs = np.split(given, len(start.q) + engine.size * np.arange(3), axis=1)
        self.states, records = engine.rows_of(np.full(len(given), start.t), q, u), list[np.ndarray]()
        for row, added in zip(self.states, inputs, strict=True):
            engine.additions[:] = added
            try:
                records.append(system.unfold(row[None], NEAR_STATES))
            finally:
                engine.additions[:] = 0.0
            check(int(engine.work.now[1]))
        self.records = np.concatenate(records)

    def rows(self, times: np.ndarray) -> np.ndarray:
        return self.records[np.minimum(np.searchsorted(self.times, times), len(self.times) - 1)]
