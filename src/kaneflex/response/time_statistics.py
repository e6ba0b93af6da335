"""Statistics of a series over time, instants that preserve its extremes; loads and motion that steps do not resolve."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from kaneflex.multibody.model.bound_model import Model
from kaneflex.scene.options import Options
from kaneflex.scene.parts import Load
from kaneflex.scene.quantities import MOST
from kaneflex.support.weak_cache import WeakCache


class Statistics(NamedTuple):
    """Statistics of a series over time; `at_min` and `at_max` are indices."""

    min: float
    max: float
    rms: float
    mean: float
    at_min: int
    at_max: int

    @property
    def peak(self) -> float:
        """Largest absolute value."""
        return max(-self.min, self.max)

    def changes(self, other: Statistics) -> tuple[float, float]:
        """Change of the peak to that of another series, and the relative change of the rms times the peak."""
        by_rms = abs(other.rms - self.rms) * self.peak / self.rms if self.rms else other.peak
        return abs(other.peak - self.peak), by_rms


def statistics(values: np.ndarray, times: np.ndarray) -> Statistics:
    """Statistics of values at times [s], both (n_times,), at least one; infinite ones count only if all are."""
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
_FINEST, _OF_BODIES = 256, 8
"""Largest number of instants checked within a step, and about that at which speeds of bodies are: mechanisms move more
smoothly than loads may change, and placing their bodies takes longer."""
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


_found: WeakCache[Model, list[str]] = WeakCache()


def between_steps(model: Model) -> list[str]:
    """Warnings of loads or speeds that the steps don't resolve, and of drives that turn far within a step.

    Checked are all rows of the loads' tables, and instants spread over the steps. Preset coupled chooses its own steps
    and detects jumps, but may miss pulses between two stored instants; where its joints are free, loads are checked
    over time only.
    """
    return _found.of(model, lambda: _between_steps(model))


def _between_steps(model: Model) -> list[str]:
    options, scene = model.options, model.scene
    within = int(np.clip(_SAMPLES // options.steps, 2, _FINEST))
    steps = min(options.steps, _SAMPLES // within)
    if options.dynamics == "coupled" and (scene.floating or scene.free_joints):
        return [*_pulses(model, steps, within)]
    motion = model.motion if model.in_space is None else model.in_space.rigid_only
    seen = motion.at(motion.begin + model.step * np.arange(steps + 1))
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
    rows = [
        _instants_of_rows(load, seen.times if load.against == "t" else seen[f"{load.against}.angle"], seen.times)
        if load.kind == "table" and load.against in ("t", *scene.drives) else np.zeros(0)
        for load in scene.loads.values() if load.kind != "value"
    ]  # fmt: skip
    if all(len(each) for each in rows):  # the extremes of tables are near their rows
        within = min(within, _OF_BODIES)
    spread = np.linspace(seen.times[0], seen.times[-1], within * steps + 1)
    instants = np.sort(np.concatenate((spread, *rows)), kind="stable")  # merges sorted
    rigid = motion.acting(instants, seen)
    fewer = rigid.taken(np.arange(0, len(instants), max(1, within // _OF_BODIES)))
    fastest = max((abs(fewer[name]).max() for name in speeds.values()), default=0.0)  # smaller ones may be rounding
    for thing, name in (varying | speeds).items():
        checked, largest = (fewer, fastest) if thing in speeds else (rigid, abs(rigid[name]).max())
        found += _unseen(options, thing, checked.times, checked[name], seen.times, seen[name], largest)
    return found


def _pulses(model: Model, steps: int, within: int) -> Iterator[str]:
    """Warnings of loads of a run with free joints, over time, where these joints stand as at the start."""
    from kaneflex.scene.law_check import start_motion
    from kaneflex.scene.tables import evaluate_block

    scene, seen = model.scene, model.motion.begin + model.step * np.arange(steps + 1)
    spread = np.linspace(seen[0], seen[-1], within * steps + 1)
    for name, load in scene.loads.items():
        if load.kind == "table" and load.against == "t":
            times = np.sort(np.concatenate((spread, _instants_of_rows(load, seen, seen))), kind="stable")
            block = load.curve()
            values, ends = (evaluate_block(block, at - load.offset) for at in (times, seen))
        elif load.kind == "law" and (law := scene.argument(name)) is not None and law.uses("t"):
            times, known = spread, [start_motion(scene, at) for at in (spread, seen)]
            if any(law.uses(used) and used not in known[0] for used in scene.law_names()):
                continue  # a coordinate that the run finds
            values, ends = map(law.on_arrays, known)
        else:
            continue
        if np.isfinite(values).all():
            yield from _unseen(model.options, f"loads.{name}", times, values, seen, ends, abs(values).max())


def _unseen(
    options: Options, thing: str, times: np.ndarray, values: np.ndarray, seen: np.ndarray, ends: np.ndarray,
    largest: float,
) -> Iterator[str]:  # fmt: skip
    """Warning if values (n,) differ from the straight line between those at the steps, or under preset coupled exceed
    both ends, by a share of the largest."""
    straight = np.interp(times, seen, ends)
    if options.dynamics == "coupled":
        before = np.clip(np.searchsorted(seen, times, "right") - 1, 0, len(seen) - 2)
        both = ends[before], ends[before + 1]
        straight = np.clip(values, np.minimum(*both), np.maximum(*both))
    missed = abs(values - straight)
    share, t = missed.max() / max(largest, np.finfo(float).tiny), times[int(missed.argmax())]
    if share > _UNSEEN:
        yield (
            f"{thing} is not resolved: within a step, at t = {t:.4g} s, it differs by {share:.0%} of its largest value "
            f"from the line between its ends: use more than solve.steps = {options.steps}"
        )


def _instants_of_rows(load: Load, x: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Instants [s] at which a load's table is read at its rows, for abscissae x at times [s], both (n,); none if x
    returns."""
    x = x - load.offset
    way = np.sign(x[-1] - x[0])
    if not (np.diff(x) * way > 0).all():
        return np.zeros(0)
    rows = load.read_table().x
    if load.period is not None:
        first, last = np.floor((x.min() - rows[0]) / load.period), (x.max() - rows[0]) / load.period
        rounds = first + np.arange(min(np.ceil(last - first), _SAMPLES // len(rows)))
        rows = np.add.outer(load.period * rounds, rows).ravel()
    rows = rows[(rows >= x.min()) & (rows <= x.max())]
    return np.interp(way * rows, way * x, times)


MISSED = 0.05
"""Share of a curve's span that may lie beyond the selected instants: eight samples of a sine's period miss up to (1 -
cos(pi / 8)) / 2 = 4 % of it."""
_ROUNDING = 1e-9
"""Share of the largest value below which a curve's span counts as rounding."""


def thinned(curves: np.ndarray, most: int) -> tuple[np.ndarray, int]:
    """Instants for plotting: evenly spaced ones if these show all curves, else extremes of intervals.

    Parameters
    ----------
    curves : ndarray (n_curves, n_times)
        Values that are not finite count as missing.
    most : int
        Number of instants, without the extremes of the whole run.

    Returns
    -------
    ndarray of int
        Indices of instants, ascending, including the first, the last and the extremes of every curve.
    int
        Number of equal intervals whose extremes are included; 0 if evenly spaced instants are sufficient.
    """
    count = curves.shape[1]
    if count <= most:
        return np.arange(count), 0
    curves, even = _filled(curves), _evenly(count, most)
    whole = _extremes(curves, 1)
    lost = curves[missed(curves, even) > MISSED]
    if not len(lost):
        return np.union1d(even, whole), 0
    parts = max(1, most // 2)
    while parts > 1 and len(_extremes(lost, parts)) > most:
        parts = max(1, 2 * parts // 3)
    chosen = np.union1d(_extremes(lost, parts), whole)
    return np.union1d(chosen, _evenly(count, max(2, most - len(chosen)))), parts


def envelope(curves: np.ndarray, parts: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Middle instants of equal intervals, and the least and greatest value of every curve in them.

    Parameters
    ----------
    curves : ndarray (n_curves, n_times)
    parts : int

    Returns
    -------
    ndarray of int (parts,)
    ndarray, ndarray (n_curves, parts)
    """
    ends = _ends(curves.shape[1], parts)
    lower, upper = (ufunc.reduceat(curves, ends[:-1], axis=1) for ufunc in (np.minimum, np.maximum))
    return (ends[:-1] + ends[1:]) // 2, lower, upper


def frames(curves: np.ndarray, count: int, periodic: bool) -> np.ndarray:
    """Indices of evenly spaced instants of an animation, the nearest ones moved to extremes that would be missed.

    The last instant of a periodic run is left out, as it equals the first.
    """
    total = curves.shape[1]
    even = np.unique(np.linspace(0, total - 1, count, endpoint=not periodic).round().astype(int))
    curves, free = _filled(curves), np.arange(1, len(even) - 1)  # first and last frame are kept
    for at in _extremes(curves[missed(curves, even) > MISSED], 1):
        if at not in even and len(free):
            nearest = free[abs(even[free] - at).argmin()]
            even[nearest], free = at, free[free != nearest]
    return np.sort(even)


def missed(curves: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Share of its span by which each curve exceeds its values at both ends of an interval between selected instants.

    Parameters
    ----------
    curves : ndarray (n_curves, n_times)
        Finite.
    at : ndarray of int
        Indices of the chosen instants, rising from 0.

    Returns
    -------
    ndarray (n_curves,)
    """
    ends = curves[:, at], curves[:, np.append(at[1:], curves.shape[1] - 1)]
    above = np.maximum.reduceat(curves, at, axis=1) - np.maximum(*ends)
    below = np.minimum(*ends) - np.minimum.reduceat(curves, at, axis=1)
    span = np.ptp(curves, axis=1)
    span[span <= _ROUNDING * abs(curves).max(axis=1)] = np.inf
    return np.maximum(above, below).max(axis=1) / span


def _extremes(curves: np.ndarray, parts: int) -> np.ndarray:
    """Indices of the least and greatest value of every curve in each of some equal parts of the run."""
    ends = _ends(curves.shape[1], parts)
    found = [first + pick(curves[:, first:last], axis=1)
             for first, last in pairwise(ends) for pick in (np.argmin, np.argmax)]  # fmt: skip
    return np.unique(found)


def _ends(count: int, parts: int) -> np.ndarray:
    """Start indices of equal intervals of a run and, one beyond the last instant, their end."""
    return np.unique(np.linspace(0, count, parts + 1).round().astype(int))


def _evenly(count: int, most: int) -> np.ndarray:
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))


def _filled(curves: np.ndarray) -> np.ndarray:
    """Curves with missing values replaced by the mean of the finite ones."""
    there = np.isfinite(curves)
    if there.all():
        return curves
    means = np.where(there, curves, 0.0).sum(axis=1) / np.maximum(there.sum(axis=1), 1)
    return np.where(there, curves, means[:, None])
