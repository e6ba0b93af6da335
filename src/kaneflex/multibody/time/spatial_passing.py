"""Steps of scipy's methods over singular positions of loops in space.

At a singular position the loops' constraints lose rank, and branches of the motion cross. The motion that keeps its
velocities is smooth, but at a distance d rounding causes errors of 1/d^3 in accelerations, which spoil a step with a
stage at a small distance. The next such instant is predicted from the least singular value of the constraints, which is
proportional to d. Steps are then chosen so that it lies between two stages, as far from both as possible.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from kaneflex.multibody.model.independent_speeds import least_singular_values
from kaneflex.multibody.model.spatial_engine import Choice
from kaneflex.multibody.model.spatial_system import SpatialSystem
from kaneflex.multibody.time.coefficients import RADAU

EXACT = 1e-10
"""Least relative tolerance of a step over a singular position: below it, rounding leads to ever shorter steps
(measured with four-bars of equal cranks)."""
_LOOKS = 33
"""Places in the next two steps at which the least singular value is evaluated."""
_SLOPE = 1e-3
"""Share of a step for the rate of that value by differences."""
_AHEAD = 3.0
"""Predicted number of steps until it vanishes, below which it is searched for."""
_SHORTER, _SHORT = 0.7, 0.8
"""Shares of the step allowed by the error: one that is rarely repeated, and the longest such."""


class Passing:
    """Prediction of the singular positions of a run.

    Attributes
    ----------
    step : float or None
        Next step [s] towards or over a singular position, if any.
    tolerance : float
        Of that step.
    """

    def __init__(self, system: SpatialSystem, method: str, tolerance: float) -> None:
        self.system, self.tolerance = system, tolerance
        self.step: float | None = None
        self._method, self._asked, self._usual, self._longest = method, tolerance, np.inf, 0.0
        self._passed: list[float] = []

    def foresee(self, solver: Any, choice: Choice, curve: Callable[[float], np.ndarray]) -> None:
        """Choose the next step of a solver, with the motion extrapolated along ``curve``."""
        self._usual = self._usual if self.step else float(solver.step_size)
        self._longest = max(self._longest, float(solver.step_size))
        loose = self.tolerance > self._asked  # a solver keeps its tolerance: another one continues
        self.step, self.tolerance = self._usual if loose else None, self._asked
        if not len(choice.rows) or not len(choice.independent):
            return
        t, h = float(solver.t), min(getattr(solver, "h_abs", self._usual), self._usual)
        when = self._ahead(choice, curve, t, h)
        gap = _gap(solver)
        if when is None:
            return
        if not self._passed or when - self._passed[-1] > h:
            self._passed.append(when)
        if gap is None:
            return
        exact, way = max(EXACT, self._asked), when - t
        h *= (exact / self._asked) ** (1.0 / (1 + getattr(solver, "error_estimator_order", 3)))
        if way < _SHORT * gap * h:
            self.step, self.tolerance = way / gap, exact
        elif way < (1.0 + gap * _SHORTER) * h:
            self.step = way - gap * _SHORTER * h

    def _ahead(self, choice: Choice, curve: Callable[[float], np.ndarray], t: float, h: float) -> float | None:
        """The next instant of a singular position within two steps h from t, all in s."""
        before, now = self._least(choice, curve, np.array([t - _SLOPE * h, t]))
        if not now <= _AHEAD / _SLOPE * (before - now):
            return None
        times = np.linspace(t, t + 2.0 * h, _LOOKS)
        least = self._least(choice, curve, times)
        k = int(least.argmin())
        if k in (0, _LOOKS - 1):
            return None
        k -= int(least[k - 1] < least[k + 1])
        return float(times[k] + (times[1] - times[0]) * least[k] / (least[k] + least[k + 1]))

    def _least(self, choice: Choice, curve: Callable[[float], np.ndarray], times: np.ndarray) -> np.ndarray:
        """Least singular value of the independent rows at some times [s]."""
        places = [curve(t)[: self.system.coordinates] for t in times.tolist()]
        if not np.isfinite(places).all():
            return np.full(len(times), np.nan)
        return least_singular_values(self.system, places, len(choice.rows))

    def at(self, t: float) -> str:
        """Message about a singular position near t [s]; empty if there is none."""
        near = [when for when in self._passed if abs(when - t) < self._longest]
        return f"{self._loops} pass a singular position at t = {near[-1]:.6g} s" if near else ""

    @property
    def _loops(self) -> str:
        return f"loops closed by {', '.join(self.system.layout.cuts)}"

    @property
    def warnings(self) -> list[str]:
        """Warnings about the accuracy of a run over such positions, if below the requested one."""
        if not self._passed or (self._asked >= EXACT and self._method != "LSODA"):
            return []
        said = f"{self._loops} pass singular positions, the first at t = {self._passed[0]:.6g} s: "
        if self._method == "LSODA":
            cure = "solve.forward.method = LSODA can be wrong there; use DOP853"
            return [f"{said}steps of {cure}"]
        return [f"{said}rounding limits accuracy to that of solve.forward.tolerance = {EXACT:g}, not {self._asked:g}"]


def _gap(solver: Any) -> float | None:
    """The middle of the widest gap between stages of a solver's step, as a share of it; None without stages."""
    if hasattr(solver, "C"):
        nodes = np.sort(np.concatenate([[0.0, 1.0], solver.C, getattr(solver, "C_EXTRA", [])]))
    elif hasattr(solver, "LU_complex"):  # scipy's Radau
        nodes = np.concatenate([[0.0], RADAU.nodes])
    else:
        return None
    k = int(np.diff(nodes).argmax())
    return float(0.5 * (nodes[k] + nodes[k + 1]))
