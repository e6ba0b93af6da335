"""Parameter blocks of bodies and points for the kernels of ``kaneflex.generated.body``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from kaneflex.generated.body import BODY, POINT
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.multibody.model.inertia_integrals import body_data, body_moments, mean_section
from kaneflex.multibody.model.shapes import Shapes
from kaneflex.scene import Scene
from kaneflex.scene.modal_data import ARRAYS, POINT_ARRAYS, ModalData

Arrays = Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Blocks:
    """Blocks of a scene's bodies, points and distributed loads.

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
        """Stiffness of every shape of a body, and their damping matrix."""
        found, count = self._moments(name), sum(self._counts(name))
        return found.get("stiffness", np.zeros(count)), found.get("damping", np.zeros((count, count)))

    def _moments(self, name: str) -> dict[str, np.ndarray]:
        return body_moments(self.scene, name, self._data[name])

    def point(self, body: str, point: str) -> tuple[tuple[float, float], np.ndarray]:
        """Place X, Y of a named point of a body [m], and its numbers; loads.NAME.0: mean section of the part of a
        distributed load that falls, loads.NAME.1: of the part that rises; contacts.NAME: a contact's corner."""
        found: Arrays
        data, (table, *rest) = self._data[body], point.split(".")
        if table == "loads":
            found = mean_section(self.scene, body, self.shapes.get(body), rises=rest[-1] == "1")
        elif table == "contacts":
            found = dict(zip("XY", mechanism_of(self.scene).contacts[rest[0]].second.at, strict=True))
        elif data is not None:
            found = data.at_point(point)
        else:
            found = dict(zip("XY", self.scene.bodies[body].points_all[point], strict=True))
        return (float(found["X"]), float(found.get("Y", 0.0))), point_block(found, *self._counts(body))


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
