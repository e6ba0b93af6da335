"""The points of a study, in a fixed order: the last parameter varies fastest, samples faster than lists."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from kaneflex.study.study import Axis, Sample, Study, Value, number_and_unit

Point = dict[str, Value]
"""Path of an entry of the scene -> its value."""
_ROUNDING = 1e-9
"""What equal spacing may leave of whole numbers."""


def points_of(study: Study) -> list[Point]:
    """Every point of a study: combinations of its lists and ranges, at each the listed points and the samples.

    Samples are drawn in the unit cube of all sampled parameters at once (scipy.stats.qmc), then scaled.
    """
    axes = [
        [{path: value} for value in _values(axis)] for path, axis in study.parameters.items() if not axis.sampled
    ]
    if study.points:
        axes.append([dict(point) for point in study.points])
    sampled = {path: axis for path, axis in study.parameters.items() if axis.sampled}
    if study.sample is not None:
        axes.append(_samples(sampled, study.sample))
    order = list(study.parameters) + [path for point in study.points[:1] for path in point]
    found = []
    for parts in itertools.product(*axes):
        together = {path: value for part in parts for path, value in part.items()}
        found.append({path: together[path] for path in order})
    return found


def _values(axis: Axis) -> Sequence[Value]:
    if axis.values is not None:
        return axis.values
    share = np.linspace(0.0, 1.0, axis.count)
    return _between(axis, share)


def _samples(axes: dict[str, Axis], sample: Sample) -> list[Point]:
    from scipy.stats import qmc

    if sample.method == "random":
        cube = np.random.default_rng(sample.seed).random((sample.count, len(axes)))
    else:
        sampler = {"sobol": qmc.Sobol, "latin-hypercube": qmc.LatinHypercube}[sample.method]
        cube = sampler(len(axes), rng=sample.seed).random(sample.count)
    columns = {path: _between(axis, cube[:, k]) for k, (path, axis) in enumerate(axes.items())}
    return [{path: column[k] for path, column in columns.items()} for k in range(sample.count)]


def _between(axis: Axis, share: np.ndarray) -> list[Value]:
    """Values at shares of the way from one end to the other, in the ends' unit; the ends themselves are exact.

    Whole numbers stay whole between two plain ones where every value is: numbers of elements must be.
    """
    first, last = axis.ends
    (a, unit), (b, _) = number_and_unit(first), number_and_unit(last)
    if axis.scale == "log":
        numbers = np.exp(np.log(a) * (1.0 - share) + np.log(b) * share)
    else:
        numbers = a * (1.0 - share) + b * share
    numbers = np.where(share == 0.0, a, np.where(share == 1.0, b, numbers)).tolist()
    if unit:
        return [f"{number!r} {unit}" for number in numbers]
    whole = [round(number) for number in numbers]
    near = all(abs(number - near) < _ROUNDING for number, near in zip(numbers, whole, strict=True))
    if isinstance(first, int) and isinstance(last, int) and near:
        return whole
    return numbers
