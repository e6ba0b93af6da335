"""How far a model's sensors are from a reference's, each at the model's own instants."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from kaneflex.comparison import Curves, Difference
from kaneflex.scene import Scene

_NOTHING = 1e-9
"""Share of the largest peak of its unit below which a sensor shows rounding."""
_ALMOST = 1 + 1e-9


def differences(
    scene: Scene, sensors: Sequence[str], model: str, curves: Curves, reference: Curves, period: float | None
) -> tuple[Difference, ...]:
    """The errors of a model, max|y - y_ref| and its rms over time beside max|y_ref|.

    The reference is read between its instants by straight lines: it is the finer one.

    Parameters
    ----------
    sensors : sequence of str
        Those that are compared. One that shows nothing but rounding in the reference is left out.
    model : str
        Its name.
    period : float or None
        Cycle [s] that the reference repeats: a longer run is compared over its last cycle. None compares over what
        both cover, from the start.
    """
    end = curves.times[-1]
    if period is None:
        kept = curves.times <= min(end, reference.times[-1]) * _ALMOST
        at = curves.times[kept]
    else:
        kept = curves.times >= end - period * _ALMOST
        at = np.remainder(curves.times[kept], period)
    floors = _floors(scene, reference)
    found = []
    for name in sensors:
        unit, peak = scene.sensors[name].unit, float(abs(reference.values[name]).max())
        if peak <= floors[unit]:
            continue
        ours = curves.values[name][kept]
        gap, times = ours - np.interp(at, reference.times, reference.values[name]), curves.times[kept]
        mean_square = np.trapezoid(gap**2, times) / (times[-1] - times[0])
        peaks = (float(abs(ours).max()), peak, float(abs(gap).max()))
        found.append(Difference(name, model, unit, *peaks, math.sqrt(mean_square)))
    return tuple(found)


def worst(found: Sequence[Difference]) -> Difference:
    """The sensor with the largest error as a share of its reference's peak."""
    return max(found, key=lambda difference: difference.peak_share)


def _floors(scene: Scene, reference: Curves) -> dict[str, float]:
    peaks: dict[str, float] = {}
    for name, sensor in scene.sensors.items():
        peaks[sensor.unit] = max(peaks.get(sensor.unit, 0.0), float(abs(reference.values[name]).max()))
    return {unit: _NOTHING * peak for unit, peak in peaks.items()}
