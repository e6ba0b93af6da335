"""Nodes of elastic links: at their ends, where forces act, and between."""

from __future__ import annotations

from collections.abc import Collection
from itertools import pairwise

import numpy as np

from kaneflex.scene import Scene

SAME = 1e-9
"""Distance below which points coincide, as a share of a link's length."""


def forced_points(scene: Scene, link: str) -> dict[str, float]:
    """Points between a link's ends where joints, loads, springs or masses act: name -> distance from the start [m]."""
    inner = sorted({address.point for address in scene.acting_on(link)} - {"start", "end"})
    return {point: scene.bodies[link].points_all[point][0] for point in inner}


def mesh(scene: Scene, link: str, elements: int, also: Collection[float] = ()) -> np.ndarray:
    """Nodes at the ends, at points with a force, between segments and at ``also`` [m], ``elements`` of nearly equal
    length in all."""
    length, borders = scene.bodies[link].length, scene.bodies[link].profile.borders
    assert length is not None
    stops = _apart({0.0, length, *forced_points(scene, link).values(), *borders, *also}, length)
    counts = [max(1, round(elements * (b - a) / length)) for a, b in pairwise(stops)]
    spans = [np.linspace(a, b, n + 1)[:-1] for (a, b), n in zip(pairwise(stops), counts, strict=True)]
    return np.concatenate([*spans, [length]])


def _apart(stops: Collection[float], length: float) -> list[float]:
    """Sorted stops; of coinciding stops the first."""
    ordered = sorted(stops)
    return [x for k, x in enumerate(ordered) if k == 0 or x - ordered[k - 1] > SAME * length]
