"""Differences of a model's sensors from those of a reference."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.response.time_statistics import mean_over_time, statistics
from kaneflex.support.errors import SceneError, nearest

if TYPE_CHECKING:
    from kaneflex.scene import Scene
    from kaneflex.solve.curves import Curves

ROUNDING = 1e-9
"""Share of the largest peak expected of a unit, from all sensors and loads, below which a curve is rounding error."""
_CLOSE = 1e-9
"""Share of a run by which two end times may differ through rounding."""


def check_names(known: Collection[str], sensors: Sequence[str] | None) -> None:
    """Raise SceneError if a sensor does not exist."""
    for name in sensors or ():
        if name not in known:
            raise SceneError("--sensors", name, "the scene has no such sensor", nearest(name, known))


def check_sensors(known: Collection[str], sensors: Sequence[str] | None = None) -> None:
    """Raise SceneError if a sensor does not exist, or the scene has none."""
    if not known:
        raise SceneError("sensors", None, "the scene has no sensors to compare", "Add a sensor to the scene")
    check_names(known, sensors)


@dataclass(frozen=True)
class Difference:
    """Difference of one sensor between a model and the reference, in SI.

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
    def error(self) -> float:
        """Largest difference as a share of the reference's peak; infinite if that is zero."""
        return self.peak_difference / self.reference_peak if self.reference_peak else math.inf

    @property
    def rms_error(self) -> float:
        """Rms difference as a share of the reference's peak; infinite if that is zero."""
        return self.rms_difference / self.reference_peak if self.reference_peak else math.inf


class Compared:
    """Extremes of a model's ``differences`` from another one, by sensor above rounding error."""

    differences: tuple[Difference, ...]

    @property
    def worst(self) -> Difference:
        """Sensor with the largest error as a share of its peak; there is at least one sensor."""
        return max(self.differences, key=lambda each: each.error)

    @property
    def error(self) -> float:
        """Largest error max|y - y_ref| / max|y_ref| of a sensor; infinite without differences."""
        return max((each.error for each in self.differences), default=math.inf)


def difference(
    sensor: str, model: str, unit: str, times: np.ndarray, values: np.ndarray, reference: np.ndarray, peak: float
) -> Difference:
    """Difference of two series at the same instants, (n_times,) each; ``peak`` is the reference's."""
    gap = values - reference
    own, most, rms = float(abs(values).max()), float(abs(gap).max()), math.sqrt(mean_over_time(gap**2, times))
    return Difference(sensor, model, unit, own, float(peak), most, rms)


def differences(
    scene: Scene, sensors: Sequence[str], model: str, curves: Curves, reference: Curves, between: bool = True
) -> tuple[Difference, ...]:
    """Differences of a model from a reference, max|y - y_ref| and the rms over time, with max|y_ref|.

    Curves are interpolated linearly, as results are plotted: coarse storage counts as an error of the model. With
    contacts the larger relative change of peak and rms counts: motions with impacts diverge, so that they can't be
    compared instant by instant.

    Parameters
    ----------
    sensors : sequence of str
        Compared sensors. Those that are only rounding error in the reference are left out.
    model : str
        Its name.
    between : bool
        Compare at the reference's instants, too. Without them the error excludes the interpolation of the model's
        stored values.
    """
    times = np.union1d(curves.times, reference.times) if between else curves.times
    times = times[times <= (1.0 + _CLOSE) * min(curves.times[-1], reference.times[-1])]
    floors, found = rounding_levels(scene, reference.values), []
    for name in sensors:
        unit, peak = scene.sensors[name].unit, float(abs(reference.values[name]).max())
        if peak <= floors[unit]:
            continue
        if scene.contacts:
            its, own = (statistics(each.values[name], each.times) for each in (reference, curves))
            changes = its.changes(own)
            found.append(Difference(name, model, unit, own.peak, peak, max(changes), changes[1]))
        else:
            own, its = (np.interp(times, each.times, each.values[name]) for each in (curves, reference))
            found.append(difference(name, model, unit, times, own, its, peak))
    return tuple(found)


def rounding_levels(scene: Scene, values: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Unit -> level of rounding error; moments are related to forces by the mechanism's longest arm.

    Rates are related to motions by one turn a cycle or run, not by higher frequencies: vibrations may be small.
    """
    peaks: dict[str, float] = defaultdict(float)
    for name in scene.sensors.keys() & values.keys():
        unit = scene.sensors[name].unit
        peaks[unit] = max(peaks[unit], float(abs(values[name]).max()))
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
    return {unit: ROUNDING * peak for unit, peak in peaks.items()}
