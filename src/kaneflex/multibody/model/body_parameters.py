"""Numbers of bodies and their sections, in the plane for the kernels of ``kaneflex.generated.body``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from kaneflex.generated.body import BODY, POINT
from kaneflex.mechanism.mechanism import NumericMechanism
from kaneflex.mechanism.spatial import SpatialMechanism
from kaneflex.multibody.model.inertia_integrals import body_moments, link_data
from kaneflex.multibody.model.shapes import Shapes
from kaneflex.multibody.model.tree_layout import Deformable, Flexible, Names
from kaneflex.scene.modal_data import ARRAYS, POINT_ARRAYS

Arrays = Mapping[str, Any]
_LIGHT = 1e-9
"""Ratio of principal moments of inertia below which the smaller one counts as none."""


@dataclass(frozen=True, eq=False)
class Blocks:
    """Numbers of a mechanism's bodies in the plane and their sections.

    Attributes
    ----------
    flexible : mapping
        Shapes of the deforming bodies: of links, or of modal data from a file.
    """

    d: ClassVar[int] = 3
    mechanism: NumericMechanism
    flexible: Flexible

    def body(self, name: str, shapes: Deformable | None = None) -> np.ndarray:
        """Numbers of a body."""
        given = self.mechanism.deforming.get(name)
        data = link_data(shapes) if isinstance(shapes, Shapes) else given and given.modal
        return body_block(body_moments(self.mechanism, name, data), *_counts(shapes))

    def is_light(self, numbers: np.ndarray | None) -> bool:
        """True if a body with these numbers has no mass, or no inertia about some axis."""
        if numbers is None or numbers[0] <= 0.0:
            return True
        mass, x, y, second = numbers[:4]
        return bool(second - (x * x + y * y) / mass <= _LIGHT * second)

    def station(self, shapes: Deformable, rows: np.ndarray, G: np.ndarray) -> np.ndarray:
        """Numbers of a section by the rows u, v, theta of its body's shapes (3, count), and G (3, count, count)."""
        axial, transverse = _counts(shapes)
        s, w = slice(axial), slice(axial, None)
        return point_block({"s": rows[0, s], "w": rows[1, w], "psi": rows[2, w], "H": -G[0, w, w]}, axial, transverse)

    def names(self, body: str, shapes: Deformable) -> tuple[Names, Names]:
        """Speeds and coordinates of the shapes of a body."""
        kinds = zip(("axial", "transverse"), _counts(shapes), strict=True)
        names = [(f"{body}.{kind}_{k}", "m") for kind, count in kinds for k in range(count)]
        return names, names


@dataclass(frozen=True, eq=False)
class SpatialBlocks:
    """Numbers of the bodies in space and their sections, by the names of :class:`Blocks`."""

    d: ClassVar[int] = 6
    mechanism: SpatialMechanism
    flexible: Flexible

    def body(self, name: str, shapes: Deformable | None) -> np.ndarray | None:
        """Numbers of a body; None if it has neither mass nor inertia."""
        body = self.mechanism.bodies[name]
        if not (body.mass or np.any(body.inertia)):
            return None
        own = np.zeros(0) if shapes is None else shapes.numbers()
        return np.concatenate([[body.mass], body.centre, body.inertia, own])

    def is_light(self, numbers: np.ndarray | None) -> bool:
        return numbers is None or bool(numbers[0] <= 0.0 or min(numbers[4:7]) <= _LIGHT * max(numbers[4:7]))

    def station(self, shapes: Deformable, rows: np.ndarray, G: np.ndarray) -> np.ndarray:
        """Rows of the shapes, and the columns of G that are not zero."""
        i, j = np.nonzero(np.tril(G.any(axis=0)))
        return np.concatenate([np.ravel(rows), [len(i)], np.column_stack([i, j, G[:, i, j].T]).ravel()])

    def names(self, body: str, shapes: Deformable) -> tuple[Names, Names]:
        units = ["rad" if twists else "m" for twists in shapes.twisting]
        return ([(f"{body}.shapes.{k}", unit) for k, unit in enumerate(units)],
                [(f"{body}.shape_{k}", unit) for k, unit in enumerate(units)])  # fmt: skip


def _counts(shapes: Deformable | None) -> tuple[int, int]:
    """Numbers of axial and transverse shapes of a body."""
    axial, transverse = (0, 0) if shapes is None else shapes.counts
    return axial, transverse


def body_block(moments: Arrays, axial: int, transverse: int) -> np.ndarray:
    """Numbers of a body from :func:`inertia_integrals.body_moments`, for these numbers of shapes."""
    return _in_reading_order(BODY, {"mass_Y": 0.0, "mass_Y_Y": 0.0, **moments}, axial, transverse)


def point_block(shapes: Arrays, axial: int, transverse: int) -> np.ndarray:
    """Numbers of a point from its POINT_ARRAYS, without rotation psi if it has none; rigid bodies have none."""
    return _in_reading_order(POINT, {"psi": 0.0, **shapes}, axial, transverse)


def _in_reading_order(table: Mapping[str, Any], arrays: Arrays, axial: int, transverse: int) -> np.ndarray:
    """Numbers in the order in which the kernels read them, by BODY or POINT."""
    ends = {"u": slice(axial), "v": slice(axial, axial + transverse)}
    lengths = {"s": axial, "w": transverse, "a": axial + transverse}

    def sums(kinds: str) -> np.ndarray:
        """Numbers of all shapes of a kind or all pairs of two, their last axis those of one."""
        found = [sum(sign * part(name, kinds) for name, sign in terms.items()) for terms in table.get(kinds, ())]
        return np.stack(found, axis=-1) if found else np.zeros((*(lengths["a"],) * len(kinds), 0))

    def part(name: str, kinds: str) -> np.ndarray:
        axes = _AXES.get(name, "")
        whole = np.broadcast_to(arrays[name], [lengths[axis] for axis in axes])
        if "a" in axes:
            return whole[tuple(ends[kind] for kind in kinds)]
        return whole.T if (axes, kinds) == ("sw", "vu") else whole

    shapes, found = [kind for kind in "uv" if ends[kind].stop > (ends[kind].start or 0)], [sums("")]
    found.append(np.array([axial, axial + transverse], float))
    for a in shapes:
        single, pairs = sums(a), [sums(a + b) for b in shapes]
        for j in range(len(single)):
            found += [single[j], *(pair[j].ravel() for pair in pairs)]
    return np.concatenate(found)


_AXES = {name: axes for name, (axes, *_) in (ARRAYS | POINT_ARRAYS).items()}
