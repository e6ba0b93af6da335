"""Least, greatest, mean and root mean square of a series over time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np


class Statistics(NamedTuple):
    """What is kept of a series over time; `at_min` and `at_max` are indices."""

    min: float
    max: float
    rms: float
    mean: float
    at_min: int
    at_max: int


def statistics(values: np.ndarray, times: np.ndarray) -> Statistics:
    """Of values at times [s], both (n_times,), of which there is at least one."""
    indices = np.arange(len(values))
    there = np.isfinite(values)  # where it has no value a warning says so
    if not there.all() and there.any():
        indices, values, times = indices[there], values[there], times[there]
    lowest, highest = int(np.argmin(values)), int(np.argmax(values))
    least, most = float(values[lowest]), float(values[highest])
    largest = max(abs(least), abs(most)) or 1.0
    # scaled, because the values of an unstable run may be too large to be squared
    square, mean = mean_over_time(np.array([(values / largest) ** 2, values]), times)
    rms = largest * math.sqrt(square)
    return Statistics(least, most, rms, float(mean), int(indices[lowest]), int(indices[highest]))


def statistics_of_all(series: Mapping[str, np.ndarray], times: np.ndarray) -> dict[str, Statistics]:
    """:func:`statistics` of every series, of those that have a value at all times in one go."""
    whole = {name: values for name, values in series.items() if np.isfinite(values).all()}
    found = {name: statistics(values, times) for name, values in series.items() if name not in whole}
    if whole:
        block = np.array(list(whole.values()))
        lowest, highest = block.argmin(axis=1), block.argmax(axis=1)
        rows = np.arange(len(block))
        least, most = block[rows, lowest], block[rows, highest]
        largest = np.maximum(abs(least), abs(most))
        largest[largest == 0.0] = 1.0
        rms = largest * np.sqrt(mean_over_time((block / largest[:, None]) ** 2, times))
        columns = (least, most, rms, mean_over_time(block, times), lowest, highest)
        found |= {
            name: Statistics(*row) for name, *row in zip(whole, *(column.tolist() for column in columns), strict=True)
        }
    return found


def mean_over_time(values: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Mean of series (..., n_times) over time by the trapezoidal rule, which counts a cycle's two equal ends once."""
    if len(times) == 1:
        return values[..., 0]
    middles = 0.5 * (values[..., 1:] + values[..., :-1])
    return middles @ np.diff(times) / (times[-1] - times[0])
