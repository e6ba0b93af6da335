"""Minimum, maximum, mean and root mean square of a series over time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np


class Statistics(NamedTuple):
    """Statistics of a series over time; `at_min` and `at_max` are indices."""

    min: float
    max: float
    rms: float
    mean: float
    at_min: int
    at_max: int


def statistics(values: np.ndarray, times: np.ndarray) -> Statistics:
    """Statistics of values at times [s], both (n_times,), at least one; of the finite ones if there are any."""
    return statistics_of_all({"values": values}, times)["values"]


def statistics_of_all(series: Mapping[str, np.ndarray], times: np.ndarray) -> dict[str, Statistics]:
    """Statistics of every series, vectorised over those without missing values."""
    if not series:
        return {}
    found, whole, block = {}, list(series), np.array(list(series.values()))
    there = np.isfinite(block)  # missing values are reported by a warning
    if not there.all():
        whole = [name for name, own in zip(series, there, strict=True) if own.all() or not own.any()]
        for name in (name for name in series if name not in whole):
            indices = np.flatnonzero(np.isfinite(series[name]))
            own = statistics(series[name][indices], times[indices])
            found[name] = own._replace(at_min=int(indices[own.at_min]), at_max=int(indices[own.at_max]))
        if not whole:
            return found
        block = np.array([series[name] for name in whole])
    lowest, highest, rows = block.argmin(axis=1), block.argmax(axis=1), np.arange(len(block))
    least, most = block[rows, lowest], block[rows, highest]
    largest = np.maximum(abs(least), abs(most))
    largest[largest == 0.0] = 1.0
    # scaled, as squares of an unstable run's values may overflow
    rms = largest * np.sqrt(mean_over_time((block / largest[:, None]) ** 2, times))
    columns = (least, most, rms, mean_over_time(block, times), lowest, highest)
    each = zip(*(column.tolist() for column in columns), strict=True)
    return found | {name: Statistics(*row) for name, row in zip(whole, each, strict=True)}


def mean_over_time(values: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Mean of series (..., n_times) over time by the trapezoidal rule, which counts both equal ends of a cycle once."""
    if len(times) == 1:
        return values[..., 0]
    steps = np.diff(times, prepend=times[0], append=times[-1])
    return values @ ((steps[1:] + steps[:-1]) / (2.0 * (times[-1] - times[0])))
