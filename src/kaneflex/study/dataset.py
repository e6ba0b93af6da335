"""Finished points of a sweep as labelled arrays, written as netCDF."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from kaneflex.study.plan import Plan
from kaneflex.study.records import STATISTICS
from kaneflex.study.store import Store
from kaneflex.study.study import Value, number_and_unit
from kaneflex.support.labelled import Labelled


def labelled(plan: Plan, store: Store) -> Labelled:
    """Dataset of the finished points.

    Returns
    -------
    Labelled
        Dimensions ``point`` and ``statistic`` (min, max, rms, mean); along ``point`` a coordinate for each parameter,
        named by its path, in the study's unit. A variable for each sensor in SI, NaN where a point was not completed;
        ``outcome`` and ``reason`` describe how it ended. With series also ``NAME_series`` over ``point`` and
        ``instant``, at the times ``time`` [s], padded with NaN to the longest.
    """
    import kaneflex

    points = sorted(store.finished)
    records = list(store.records(points))
    variables: dict[str, tuple] = {
        "outcome": ("point", np.array([record.outcome for record in records])),
        "reason": ("point", np.array([record.reason for record in records])),
    }
    none = (np.nan,) * len(STATISTICS)
    for name, about in _labels(store).items():
        values = np.array([record.statistics.get(name, none) for record in records])
        variables[name] = (("point", "statistic"), values, about)
    if plan.series:
        variables |= _series(store, points)
    coordinates = {"point": ("point", np.array(points)), "statistic": ("statistic", np.array(STATISTICS))}
    for path in plan.points[0]:
        values, about = column([point[path] for point in plan.points.values()])
        coordinates[path] = ("point", values[points], {"long_name": path} | about)
    about = {"source": f"kaneflex {kaneflex.__version__}", "scene": plan.scene.name, "study": plan.digest}
    return Labelled(variables, coordinates, about)


def _labels(store: Store) -> dict[str, dict[str, str]]:
    """Sensor -> attributes, sorted by name, so that the order in which points finished does not matter."""
    return {name: dict(zip(("units", "long_name"), store.labels[name], strict=True)) for name in sorted(store.labels)}


def _series(store: Store, points: Sequence[int]) -> dict[str, tuple]:
    found, variables = [store.series(point) for point in points], dict[str, tuple]()
    instants = max(len(entry.get("", ())) for entry in found)
    if not instants:
        return variables  # netCDF can't hold a dimension without length
    for name, about in {"": {"units": "s", "long_name": "time"}, **_labels(store)}.items():
        block = np.full((len(found), instants), np.nan)
        for row, entry in zip(block, found, strict=True):
            values = entry.get(name, ())
            row[: len(values)] = values
        variables[f"{name}_series" if name else "time"] = ("point", "instant"), block, about
    return variables


def column(values: Sequence[Value]) -> tuple[np.ndarray, dict[str, str]]:
    """Values of a parameter as an array, with their common unit; as texts if the units differ."""
    parts = [number_and_unit(value) for value in values]
    units = {unit for _, unit in filter(None, parts)}
    if None in parts or len(units) > 1:
        same = len({type(value) for value in values}) == 1
        return np.array(values if same else [str(value) for value in values]), {}
    if all(isinstance(value, int) for value in values):
        return np.array(values), {}
    (unit,) = units or {""}
    return np.array([number for number, _ in parts]), {"units": unit} if unit else {}


def write_netcdf(plan: Plan, store: Store, path: Path) -> None:
    """Write :func:`labelled` of all points as one netCDF file."""
    partial = path.with_name(f".{path.name}.partial")
    labelled(plan, store).to_netcdf(partial)
    partial.replace(path)
