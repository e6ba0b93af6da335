"""How far a model's sensors are from a reference's."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from kaneflex.scene import Scene
    from kaneflex.solve.curves import Curves

_NOTHING = 1e-9
"""Share of the largest peak that its unit may have, by all sensors and the loads, below which one shows rounding."""
_CLOSE = 1e-9
"""Share of a run by which the ends of two may differ through rounding."""


@dataclass(frozen=True)
class Difference:
    """One sensor of one model beside the reference, in SI.

    Attributes
    ----------
    sensor, model, unit : str
    peak, reference_peak : float
        Largest absolute values of the two.
    peak_difference : float
        Largest absolute difference at any instant.
    rms_difference : float
        Root of the mean square of the difference over time, by the trapezoidal rule.
    """

    sensor: str
    model: str
    unit: str
    peak: float
    reference_peak: float
    peak_difference: float
    rms_difference: float

    @property
    def peak_share(self) -> float | None:
        """The largest difference as a share of the reference's peak; None where that is zero."""
        return self.peak_difference / self.reference_peak if self.reference_peak else None

    @property
    def rms_share(self) -> float | None:
        """The rms difference as a share of the reference's peak; None where that is zero."""
        return self.rms_difference / self.reference_peak if self.reference_peak else None


def difference(
    sensor: str, model: str, unit: str, times: np.ndarray, values: np.ndarray, reference: np.ndarray, peak: float
) -> Difference:
    """Of two series over the same instants, (n_times,) each; ``peak`` is the reference's."""
    gap = values - reference
    mean_square = np.trapezoid(gap**2, times) / (times[-1] - times[0])
    own, most = float(abs(values).max()), float(abs(gap).max())
    return Difference(sensor, model, unit, own, peak, most, math.sqrt(mean_square))


def differences(
    scene: Scene, sensors: Sequence[str], model: str, curves: Curves, reference: Curves, period: float | None,
    between: bool = True,
) -> tuple[Difference, ...]:  # fmt: skip
    """The errors of a model, max|y - y_ref| and its rms over time beside max|y_ref|.

    Curves are read between their instants by straight lines, as results are drawn and compared: what a model has no
    instant for is an error of it.

    Parameters
    ----------
    sensors : sequence of str
        Those that are compared. One that shows nothing but rounding in the reference is left out.
    model : str
        Its name.
    period : float or None
        Cycle [s] that the reference repeats: a longer run is compared over its last cycle. None compares over what
        both cover, from the start.
    between : bool
        At the reference's instants, too. Without them only the model's own count: its equations, not how densely it is
        stored.
    """
    ours, theirs = _common_instants(curves, reference, period, between)
    floors = _floors(scene, reference)
    found = []
    for name in sensors:
        unit, peak = scene.sensors[name].unit, float(abs(reference.values[name]).max())
        if peak <= floors[unit]:
            continue
        own = np.interp(ours, curves.times, curves.values[name])
        its = np.interp(theirs, reference.times, reference.values[name])
        found.append(difference(name, model, unit, ours, own, its, peak))
    return tuple(found)


def _common_instants(
    curves: Curves, reference: Curves, period: float | None, between: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Where two models are compared [s]: ascending instants of the model, and those of the reference that go with them.

    Of one that repeats itself the model's last cycle goes with the reference's only one.
    """
    end = curves.times[-1]
    start = 0.0 if period is None else end - period
    until = min(end, reference.times[-1]) if period is None else end
    own = curves.times[(curves.times >= start - _CLOSE * end) & (curves.times <= until + _CLOSE * end)]
    others = reference.times[:0]
    if between and period is None:
        others = reference.times[reference.times <= until]
    elif between:
        others = end - np.remainder(end - reference.times, period)
    ours = np.union1d(own, others)
    return ours, ours if period is None else np.remainder(ours, period)


def worst(found: Sequence[Difference]) -> Difference:
    """The sensor with the largest error as a share of its reference's peak."""
    return max(found, key=lambda difference: difference.peak_share)


def _floors(scene: Scene, reference: Curves) -> dict[str, float]:
    """Unit of sensors -> what shows rounding in it: a moment beside forces on the mechanism's arms, too.

    Motions give their rates once a cycle or run, and no faster: what vibrates may well be small in itself.
    """
    peaks: dict[str, float] = defaultdict(float)
    for name, sensor in scene.sensors.items():
        peaks[sensor.unit] = max(peaks[sensor.unit], float(abs(reference.values[name]).max()))
    arm = max(body.length or 0.0 for body in scene.bodies.values()) or 1.0
    for load in scene.loads.values():
        if load.value is not None:
            reach = arm if load.spread_on is not None else 1.0 / arm if load.torque_at is not None else 1.0
            peaks["N"] = max(peaks["N"], reach * abs(load.value))
    rate = 2.0 * math.pi / (scene.period or scene.horizon)
    stiffest = max((body.beam.E for body in scene.bodies.values() if body.beam is not None), default=1.0)
    for unit, other, share in (
        ("N", "N m", 1.0 / arm), ("N m", "N", arm), ("Pa", "1", stiffest), ("1", "Pa", 1.0 / stiffest),
        ("m/s", "m", rate), ("m/s^2", "m/s", rate), ("rad/s", "rad", rate), ("rad/s^2", "rad/s", rate),
    ):  # fmt: skip
        peaks[unit] = max(peaks[unit], share * peaks[other])
    return {unit: _NOTHING * peak for unit, peak in peaks.items()}
