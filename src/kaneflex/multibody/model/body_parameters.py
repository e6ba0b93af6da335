"""Parameter blocks of bodies and points for the kernels of ``kaneflex.generated.body``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.multibody.model.inertia_integrals import body_data, body_moments, spread_shapes
from kaneflex.multibody.model.shapes import Shapes
from kaneflex.scene import Scene
from kaneflex.scene.modal_data import ModalData
from kaneflex.support.contract import BODY_BLOCK, POINT_BLOCK, Slot, block_shapes

Arrays = Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Blocks:
    """Blocks of a scene's bodies, points and distributed loads.

    Attributes
    ----------
    counts : mapping
        Body -> numbers of axial and transverse shapes; without rigid bodies.
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
        return self.counts.get(body, (0, 0))[:2]

    def body(self, name: str) -> np.ndarray:
        """Block BODY_BLOCK of a body."""
        return body_block(body_moments(self.scene, name, self._data[name]), *self._counts(name))

    def point(self, body: str, point: str) -> np.ndarray:
        """Block POINT_BLOCK of a named point of a body; loads.NAME: a distributed load, contacts.NAME: a contact's
        corner."""
        found: Arrays
        data, (table, _, name) = self._data[body], point.partition(".")
        if table == "loads":
            found = spread_shapes(self.scene, name, self.shapes.get(body))
        elif table == "contacts":
            found = dict(zip("XY", mechanism_of(self.scene).contacts[name].second.at, strict=True))
        elif data is not None:
            found = data.at_point(point)
        else:
            found = dict(zip("XY", self.scene.bodies[body].points_all[point], strict=True))
        return point_block(found, *self._counts(body))


def body_block(moments: Arrays, axial: int, transverse: int) -> np.ndarray:
    """Block BODY_BLOCK from :func:`inertia_integrals.body_moments`, for these numbers of shapes."""
    return _filled(BODY_BLOCK, {"mass_Y": 0.0, "mass_Y_Y": 0.0, **moments}, axial, transverse)


def point_block(shapes: Arrays, axial: int, transverse: int) -> np.ndarray:
    """Block POINT_BLOCK from a point's POINT_ARRAYS (X and Y only for a rigid body), or from sums of a distributed
    load.

    A distributed load turns no section and has no psi.
    """
    none = {"share": 1.0, "Y": 0.0, "psi": 0.0}
    return _filled(POINT_BLOCK, {**none, **shapes}, axial, transverse)


def _filled(block: Sequence[Slot], arrays: Arrays, axial: int, transverse: int) -> np.ndarray:
    """Block from the arrays of its slots; arrays without shapes are not needed."""
    filled = []
    for slot, shape in zip(block, block_shapes(block, axial, transverse).values(), strict=True):
        if 0 not in shape:
            values = sum(arrays[name] for name in slot.of) - sum(arrays[name] for name in slot.less)
            filled.append(np.broadcast_to(values, shape).ravel())
    return np.concatenate(filled)
