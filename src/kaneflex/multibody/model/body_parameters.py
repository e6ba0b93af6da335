"""Numbers of planar bodies and their sections for the kernels of ``kaneflex.generated.body``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from kaneflex.generated.body import BODY, POINT
from kaneflex.multibody.model.inertia_integrals import body_data, body_moments
from kaneflex.multibody.model.shapes import Shapes
from kaneflex.multibody.model.tree_layout import Flexible, Place
from kaneflex.scene import Scene
from kaneflex.scene.modal_data import ARRAYS, POINT_ARRAYS, ModalData

Arrays = Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Blocks:
    """Numbers of a scene's bodies and their sections.

    Attributes
    ----------
    counts : mapping
        Body -> numbers of axial and transverse shapes, by default none.
    shapes : mapping
        Shapes of links; other elastic bodies have modal data from a file.
    """

    scene: Scene
    counts: Mapping[str, Sequence[int]]
    shapes: Mapping[str, Shapes]

    @cached_property
    def _data(self) -> dict[str, ModalData | None]:
        return {name: body_data(self.scene, name, self.shapes) for name in self.scene.bodies}

    def _counts(self, body: str) -> Sequence[int]:
        return self.counts.get(body, (0, 0))

    def body(self, name: str) -> np.ndarray:
        """Numbers of a body."""
        return body_block(self._moments(name), *self._counts(name))

    def elastic(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Stiffness and damping matrices of the shapes of a body, (count, count)."""
        found, count = self._moments(name), sum(self._counts(name))
        if not count:
            return np.zeros((0, 0)), np.zeros((0, 0))
        return np.diag(found["stiffness"]), found["damping"]

    def _moments(self, name: str) -> dict[str, np.ndarray]:
        return body_moments(self.scene, name, self._data[name])

    @cached_property
    def flexible(self) -> Flexible:
        """Bodies that deform with their shapes, wherever these are held."""
        found: dict[str, Any] = {}
        for name, counts in self.counts.items():
            if any(counts):
                data, link = self.scene.bodies[name].modal, self.shapes.get(name)
                found[name] = PointShapes(data) if data is not None else link
        return {name: partial(_as_given, shapes) for name, shapes in found.items()}

    def station(self, body: str, rows: np.ndarray, G: np.ndarray) -> np.ndarray:
        """Numbers of a section by the rows u, v, theta of its body's shapes (3, count), and G (3, count, count)."""
        axial, transverse = self._counts(body)
        s, w = slice(axial), slice(axial, None)
        return point_block({"s": rows[0, s], "w": rows[1, w], "psi": rows[2, w], "H": -G[0, w, w]}, axial, transverse)


def _as_given(shapes: Any, held: Place | None, freed: str) -> Any:
    """Shapes of a body, wherever they are held."""
    return shapes


@dataclass(frozen=True, eq=False)
class PointShapes:
    """Shapes of a planar body with modal data, which its points have."""

    data: ModalData

    @property
    def count(self) -> int:
        return sum(self.data.counts)

    def carrier(self, at: Sequence[float]) -> Place:
        """The point itself."""
        return tuple(at)

    def at(self, place: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
        """Rows u, v and theta of the shapes, (3, count), and G (3, count, count)."""
        k = self.data.at((place[0], 0.0))
        s, w, psi, H = (self.data.arrays[key][k] for key in ("s", "w", "psi", "H"))
        across, none = slice(len(s), None), np.zeros(len(s))
        G = np.zeros((3, len(s) + len(w), len(s) + len(w)))
        G[0, across, across] = -H
        return np.array([[*s, *(0.0 * w)], [*none, *w], [*none, *psi]]), G


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
