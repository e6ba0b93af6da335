"""Selection of instants of a run that preserves the extremes of plotted curves."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

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
