"""Families of functions in place of a link's fixed-interface modes: sine, clamped-free, polynomial."""

from __future__ import annotations

import numpy as np

from kaneflex.mechanism.floating_frames import IN_THE_MEAN, Station, frame_of, stations
from kaneflex.mechanism.mechanism import NumericMechanism
from kaneflex.support.errors import SceneError

_SAME = 1e-9
"""Share of a link's length within which a point is its end."""


def check_family(mechanism: NumericMechanism, name: str, elements: int, modes: int) -> None:
    """Check that a link's family of shapes suits its theory and joints, and is resolved by its ``elements``.

    Raises
    ------
    SceneError
        It names the link's ``beam.shapes``.
    """
    beam, length = mechanism.deforming[name].beam, mechanism.deforming[name].length
    if beam.shapes == "craig-bampton":
        return
    if beam.theory == "timoshenko":
        reason, cure = "these functions have no shear, unlike a Timoshenko beam", "Use craig-bampton, or another theory"
    elif beam.shapes == "sine" and not _between_ends(stations(mechanism, name), length):
        reason = "sines vanish at both ends of the link, and one of them is not pinned"
        cure = "Use craig-bampton or polynomial"
    elif beam.shapes == "clamped-free" and not _held_at_an_end(stations(mechanism, name), length):
        reason, cure = "these shapes are clamped at one end, but this link is pinned", "Use craig-bampton or polynomial"
    elif modes > elements:
        reason = f"{modes} of them need at least {modes} elements, the link has {elements}"
        cure = f"Give bodies.{name}.beam.elements, or use fewer modes"
    else:
        return
    raise SceneError(f"bodies.{name}.beam.shapes", beam.shapes, reason, cure)


def _between_ends(found: list[Station], length: float) -> bool:
    """True if a link has joints at both ends."""
    frame = frame_of(found)
    return frame.kind in IN_THE_MEAN and frame.at < _SAME * length and frame.to > (1 - _SAME) * length


def _held_at_an_end(found: list[Station], length: float) -> bool:
    """True if a link touches its frame's axis at its start or its end."""
    frame = frame_of(found)
    return frame.kind == "tangent" and not _SAME * length < frame.at < (1 - _SAME) * length


def family(word: str, X: np.ndarray, constrained: list[int], count: int) -> np.ndarray:
    """The lowest ``count`` functions of a family at a link's nodes.

    Parameters
    ----------
    word : str
        "sine", "clamped-free" or "polynomial".
    X : ndarray (n_nodes,)
        Distances of the nodes from the start [m].
    constrained : list of int
        Rows that are to stay at zero: all of polynomials, which have no ends of their own; where the first of them is
        of the last node, that is the clamped end.

    Returns
    -------
    ndarray (3 n_nodes, count)
        Rows u = 0, v, theta = dv/dX of each node in turn: the elements' cubic between them interpolates the function.
    """
    length = X[-1]
    x = X / length
    found = np.zeros((3 * len(X), count))
    if word == "sine":
        k = np.pi * np.arange(1, count + 1)
        found[1::3], found[2::3] = np.sin(np.outer(x, k)), k * np.cos(np.outer(x, k)) / length
        return found
    if word == "clamped-free":
        sign, x = (-1.0, 1.0 - x) if constrained[0] == len(found) - 2 else (1.0, x)
        for k in range(count):
            found[1::3, k], slope = clamped_free(k, x)
            found[2::3, k] = sign * slope / length
        return found
    return _polynomials(x, length, constrained, count)


def clamped_free(k: int, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenfunction k = 0, 1, ... of a uniform clamped-free beam at x = X / L, with its slope (Blevins 1979, ch. 8).

    cosh bx - cos bx - sigma (sinh bx - sin bx), its growing part written with (1 - sigma) e^b, which does not cancel.
    """
    from scipy.optimize import brentq  # 0.3 s: only where these shapes are used

    b = brentq(lambda z: np.cos(z) + 1 / np.cosh(z), k * np.pi, (k + 1) * np.pi, xtol=1e-14)
    decay = np.exp(-b)
    sigma = (1 - decay**2 - 2 * decay * np.sin(b)) / (1 + decay**2 + 2 * decay * np.cos(b))
    grown = 2 * (decay + np.cos(b) + np.sin(b)) / (1 + decay**2 + 2 * decay * np.cos(b))  # (1 - sigma) e^b
    growing, falling = grown * np.exp(b * (x - 1)) / 2, (1 + sigma) * np.exp(-b * x) / 2
    c, s = np.cos(b * x), np.sin(b * x)
    return growing + falling - c + sigma * s, b * (growing - falling + s + sigma * c)


def _polynomials(x: np.ndarray, length: float, constrained: list[int], count: int) -> np.ndarray:
    """Polynomials of the lowest degrees that vanish in the constrained rows, out of Legendre's."""
    several = np.polynomial.legendre.Legendre.basis
    basis = np.zeros((3 * len(x), count + len(constrained)))
    for k in range(basis.shape[1]):
        function = several(k, domain=[0.0, 1.0])
        basis[1::3, k], basis[2::3, k] = function(x), function.deriv()(x) / length
    rows = basis[constrained] * np.where(np.array(constrained) % 3 == 2, length, 1.0)[:, None]
    return basis @ np.linalg.svd(rows)[2][len(constrained) :].T
