"""Statistics of a series over time; loads and motion that the steps of a run do not resolve."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.multibody.model.bound_model import Model
from kaneflex.scene import Scene
from kaneflex.scene.options import Options
from kaneflex.scene.quantities import MOST
from kaneflex.support.kept import Kept


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


_SAMPLES = 60_000
"""Instants that are checked, spread over the steps."""
_FINEST = 256
"""Largest number of instants checked within a step."""
_UNSEEN = 0.2
"""Deviation of a load or angular speed from the straight line between two steps, as a share of its largest value, that
is reported."""
_TURN = 0.5
"""Angle [rad] per step of a drive that is accepted."""


def at_least(wanted: int, options: Options) -> str:
    """Advice for too few steps: the number needed, or a shorter run if that exceeds the limit."""
    if wanted <= MOST:
        return f"give solve.steps = {wanted} or more"
    return f"give solve.duration = {options.duration * MOST / wanted:.2g} s or less and more of solve.steps"


_found: Kept[Model, list[str]] = Kept()


def between_steps(model: Model) -> list[str]:
    """Warnings of loads or speeds that the steps don't resolve, and of drives that turn far within a step.

    Checked are all rows of the loads' tables, and instants spread over the steps. Preset coupled chooses its own steps
    and detects jumps, but may miss pulses between two stored instants.
    """
    return _found.of(model, lambda: _between_steps(model))


def _between_steps(model: Model) -> list[str]:
    options, scene = model.options, model.scene
    if options.dynamics == "coupled" and (scene.floating or scene.free_joints):
        return []  # the rigid mechanism moves differently
    within = int(np.clip(_SAMPLES // options.steps, 2, _FINEST))
    steps = min(options.steps, _SAMPLES // within)
    seen = model.motion.at(model.motion.begin + model.step * np.arange(steps + 1))
    found = []
    for name, drive in scene.drives.items():
        turned = abs(np.diff(seen[f"{name}.angle"])).max()
        if turned > _TURN and not scene.slides(name) and not drive.free:
            wanted = int(np.ceil(options.steps * turned / _TURN))
            found.append(
                f"{name} turns by {np.degrees(turned):.3g} deg in a step: motion in between is not resolved; "
                + at_least(wanted, options)
            )
    varying = {f"loads.{name}": name for name, load in scene.loads.items() if load.kind != "value"}
    speeds = {f"the speed of {name}": f"{name}.omega" for name in scene.bodies if f"{name}.omega" in seen}
    if not varying and not speeds:
        return found
    spread = np.linspace(seen.times[0], seen.times[-1], within * steps + 1)
    instants = np.sort(np.concatenate((spread, _instants_of_rows(scene, seen))), kind="stable")  # merges sorted
    rigid = model.motion.acting(instants, seen)
    fastest = max((abs(rigid[name]).max() for name in speeds.values()), default=0.0)  # smaller ones may be rounding
    for thing, name in (varying | speeds).items():
        values = rigid[name]
        straight = np.interp(rigid.times, seen.times, seen[name])
        if options.dynamics == "coupled":
            before = np.clip(np.searchsorted(seen.times, rigid.times, "right") - 1, 0, steps - 1)
            ends = seen[name][before], seen[name][before + 1]
            straight = np.clip(values, np.minimum(*ends), np.maximum(*ends))
        largest = fastest if thing in speeds else abs(values).max()
        share = abs(values - straight).max() / max(largest, np.finfo(float).tiny)
        if share > _UNSEEN:
            t = rigid.times[int(abs(values - straight).argmax())]
            found.append(
                f"{thing} changes and returns within a step, by {share:.0%} of its largest value at t = {t:.4g} s: "
                f"use more than solve.steps = {options.steps}"
            )
    return found


def _instants_of_rows(scene: Scene, seen: RigidMotion) -> np.ndarray:
    """Instants [s] at which the loads' tables are read at their rows, if their argument is monotonic."""
    found = [np.zeros(0)]
    for load in (load for load in scene.loads.values() if load.against in ("t", *scene.drives)):
        x = (seen.times if load.against == "t" else seen[f"{load.against}.angle"]) - load.offset
        way = np.sign(x[-1] - x[0])
        if not (np.diff(x) * way > 0).all():
            continue
        rows, times = load.read_table().x, seen.times
        if load.period is not None:
            first, last = np.floor((x.min() - rows[0]) / load.period), (x.max() - rows[0]) / load.period
            rounds = first + np.arange(min(np.ceil(last - first), _SAMPLES // len(rows)))
            rows = np.add.outer(load.period * rounds, rows).ravel()
        rows = rows[(rows >= x.min()) & (rows <= x.max())]
        found.append(np.interp(way * rows, way * x, times))
    return np.concatenate(found)
