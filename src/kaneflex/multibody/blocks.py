"""The numbers of bodies and of their points as the kernels of ``kaneflex.generated.body`` read them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from kaneflex.support.contract import BODY_BLOCK, POINT_BLOCK, Slot, block_shapes

Arrays = Mapping[str, np.ndarray]


def body_block(moments: Arrays, axial: int, transverse: int) -> np.ndarray:
    """BODY_BLOCK of a body with so many shapes, of its :func:`inertia_integrals.body_moments`."""
    return _filled(BODY_BLOCK, {"mass_Y": 0.0, "mass_Y_Y": 0.0, **moments}, axial, transverse)


def point_block(shapes: Arrays, axial: int, transverse: int) -> np.ndarray:
    """POINT_BLOCK of a point: its POINT_ARRAYS (of a rigid body X and Y alone), or what a load spread over it sums.

    A load that is spread turns no section, and has no psi.
    """
    none = {"share": 1.0, "Y": 0.0, "psi": 0.0}
    return _filled(POINT_BLOCK, {**none, **shapes}, axial, transverse)


def _filled(block: Sequence[Slot], arrays: Arrays, axial: int, transverse: int) -> np.ndarray:
    """A block of the arrays that its slots are made of, by their names; what no shape has needs none."""
    filled = []
    for slot, shape in zip(block, block_shapes(block, axial, transverse).values(), strict=True):
        if 0 not in shape:
            values = sum(arrays[name] for name in slot.of) - sum(arrays[name] for name in slot.less)
            filled.append(np.broadcast_to(values, shape).ravel())
    return np.concatenate(filled)
