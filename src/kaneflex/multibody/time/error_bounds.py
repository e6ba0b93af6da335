"""Errors that a step may have: of displacements, and of speeds and accelerations by their largest values so far."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kaneflex.multibody.engine import Engine
from kaneflex.multibody.model import layout as at

_STILL = 1e-3
"""Share of the error allowed of a coordinate: what moves it by less between two stored instants may be rounding."""
_ROUNDED = 1e-10
"""Share of the largest speed or acceleration of both kinds, lengths and angles, that may be rounding: at least a
thousand times as much as in the closed loops of a slider-crank."""
_OF_A_DEPTH = 30.0
"""Error allowed in a contact's gap, in tolerances of a run times an impact's depth."""


@dataclass(frozen=True)
class Method:
    """Method of integration.

    Attributes
    ----------
    integrator : str
        "radau" or "gauss".
    tolerance : float
        Error allowed of what ten periods of a vibration accumulate, as a share of ``length`` [m] for displacements and
        in rad for angles; a vibration smaller than that is not resolved. See
        :mod:`kaneflex.multibody.time.collocation`.
    bounded : tuple of str
        What else the tolerance bounds, as a share of its largest value so far: "speeds"; "reactions", through the
        accelerations from which they follow.
    entry : str
        Entry of the scene that gives the tolerance.
    """

    integrator: str
    tolerance: float
    length: float
    bounded: tuple[str, ...] = ()
    entry: str = "solve.tolerance"


class ErrorBounds:
    """Errors allowed in a run of an engine, in the plane or in space.

    ``longest``: time between two stored instants [s]; ``scale``: errors allowed of the coordinates [m or rad].
    """

    def __init__(self, engine: Engine, method: Method, longest: float) -> None:
        self.engine, self.method, self.longest = engine, method, longest
        self.unit = np.where(engine.turns, 1.0, method.length)
        self.scale = method.tolerance * self.unit
        self.largest = np.zeros((2, engine.size))

    def begin(self) -> None:
        """Prepare an integration: nothing is known of an earlier one."""
        engine, method = self.engine, self.method
        engine.numbers(at.SCALE, engine.size)[:] = self.scale
        shared = engine.numbers(at.TOUCH, at.SHARED)
        shared[:] = 0.0
        shared[at.PRECISION], shared[at.EXTENT] = min(_OF_A_DEPTH * method.tolerance, 1e-4), method.length
        engine.numbers(at.CROSSING, at.CHANGE_POINT)[:] = -math.inf, 0.0, 0.0
        self.update(np.zeros((0, 1 + 3 * engine.size)))

    def update(self, rows: np.ndarray) -> None:
        """Update the errors allowed of speeds and accelerations, by their kinds, from further rows of the run.

        They have none as long as all are so small that they may be rounding.
        """
        engine, n = self.engine, self.engine.size
        for k, (name, scale) in enumerate((("speeds", at.RATE_SCALE), ("reactions", at.ACCEL_SCALE))):
            if name in self.method.bounded:
                each = abs(rows[:, 1 + (1 + k) * n : 1 + (2 + k) * n]).max(axis=0, initial=0.0)
                for kind in (engine.turns, ~engine.turns):
                    self.largest[k, kind] = max(self.largest[k, kind].max(initial=0.0), each[kind].max(initial=0.0))
            reach = (self.largest[k] / self.unit).max(initial=0.0)
            moves = reach * self.longest ** (k + 1) > _STILL * self.method.tolerance
            allowed = np.maximum(self.method.tolerance * self.largest[k], _ROUNDED * reach * self.unit)
            engine.numbers(scale, n)[:] = allowed if moves else math.inf
