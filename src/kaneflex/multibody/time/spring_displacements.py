"""Relative displacements of springs in small motions, in the plane and in space."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from kaneflex.mechanism.spatial import SpatialMechanism
from kaneflex.mechanism.spatial_frame import rotation_rates
from kaneflex.multibody.engine import Engine
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.codes import MOST_TURNED


def displacements(
    engine: Engine, sections: np.ndarray, moved: np.ndarray
) -> Iterator[tuple[np.ndarray, np.ndarray]]:  # fmt: skip
    """Relative displacements (n, parts) of every spring in unit motions, and their stiffnesses (parts,).

    ``sections``: the engine's at an instant; ``moved``: their change in unit motions, (n, sections, .).
    """
    in_plane = engine.kind.d == 3
    flat = 2 if in_plane else 3
    places, (v, omega, _) = sections[:, :flat], np.split(moved[:, :, 3:], [flat, engine.kind.d], axis=2)
    axes = np.ones((1, 1)) if in_plane else engine.work.axes
    springs = engine.tables.acts[engine.count(at.SPRINGS) : engine.count(at.CONTACTS)]
    for kind, first, second, _, axis, place in springs.tolist():
        numbers = engine.tables.w[place:]
        if kind == at.STRAIGHT:
            yield _pulled(places, v, (first, second), numbers[:3])
        elif kind == at.TORSIONAL:
            yield (omega[:, second] - omega[:, first]) @ axes[axis][:, None], numbers[:1]
        elif kind == at.BUSHING:  # the first of its six rows
            from scipy.spatial.transform import Rotation  # takes long: only where it is used

            E, other = axes[axis : axis + 3], axes[axis + 3 : axis + 6]
            phi = Rotation.from_matrix(E @ other.T).as_rotvec()
            slid = v[:, second] - v[:, first] - np.cross(omega[:, first], places[second] - places[first])
            turned = (omega[:, second] - omega[:, first]) @ E.T @ rotation_rates(phi)
            yield np.hstack([slid @ E.T, turned]), numbers[:18:3]


def _pulled(
    places: np.ndarray, v: np.ndarray, ends: Sequence[int], numbers: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Relative displacements (n, parts) of a spring's ends in unit motions ``v`` (n, sections, 2 or 3), along its line
    if it has a length or a damper, with their stiffnesses; numbers: stiffness, damping, length."""
    (first, second), (stiffness, damping, length) = ends, numbers
    parts, apart = v[:, second] - v[:, first], places[second] - places[first]
    if damping or length:
        parts = parts @ (apart / np.linalg.norm(apart))[:, None]
    return parts, np.full(parts.shape[1], stiffness)


def overturned(mechanism: SpatialMechanism, rows: np.ndarray) -> tuple[str, str] | None:
    """First bushing with too large a rotation, by springs of one or many instants, (..., n_springs, 7), and a
    message."""
    names = [name for name, spring in mechanism.springs.items() if spring.is_bushing]
    angles = rows[..., -6 * len(names) :: 6, 0].reshape(-1, len(names)).max(axis=0, initial=0.0) if names else ()
    for name, angle in zip(names, angles, strict=True):
        if angle > MOST_TURNED:
            return name, f"bushing {name} is rotated by {math.degrees(angle):.0f} deg, too close to half a turn"
    return None
