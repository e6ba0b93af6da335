"""The numbers of bodies and of their points as the kernels of ``kaneflex.generated.body`` read them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from kaneflex.scene.modal_data import ARRAYS, POINT_ARRAYS
from kaneflex.support.contract import BODY_BLOCK, POINT_BLOCK, Slot, block_shapes

_RIGID = ("mass", "mass_X", "mass_Y", "mass_X_X", "mass_Y_Y", "inertia")
"""Moments of a body without shapes; one with shapes lies on its own axis, and has no Y."""


def body_block(numbers: Mapping[str, float], body: str, axial: int, transverse: int) -> np.ndarray:
    """BODY_BLOCK of a body with so many shapes, by the paths of :func:`inertia_integrals.body_numbers` (SI)."""
    path = f"bodies.{body}"
    if axial + transverse == 0:
        arrays = {name: np.array(numbers[f"{path}.{name}"]) for name in _RIGID}
    else:
        arrays = _arrays(numbers, path, ARRAYS, axial, transverse) | {"mass_Y": np.zeros(()), "mass_Y_Y": np.zeros(())}
    return fill_block(BODY_BLOCK, arrays, axial, transverse)


def point_block(numbers: Mapping[str, float], body: str, point: str, axial: int, transverse: int) -> np.ndarray:
    """POINT_BLOCK of a named point of a body with shapes."""
    found = _arrays(numbers, f"bodies.{body}.points.{point}", POINT_ARRAYS, axial, transverse)
    return fill_block(POINT_BLOCK, found | {"share": np.ones(()), "Y": np.zeros(())}, axial, transverse)


def rigid_point(at: tuple[float, float]) -> np.ndarray:
    """POINT_BLOCK of a point of a body without shapes: along and across from its start [m]."""
    return np.array([1.0, *at])


def spread_block(numbers: Mapping[str, float], load: str, axial: int, transverse: int) -> np.ndarray:
    """POINT_BLOCK of a load spread over a body; it turns no section, whatever psi is."""
    path = f"loads.{load}"
    sums = {name: entry for name, entry in POINT_ARRAYS.items() if name != "psi"}
    found = _arrays(numbers, path, sums, axial, transverse)
    found |= {"share": np.array(numbers[f"{path}.share"]), "Y": np.zeros(()), "psi": np.zeros(transverse)}
    return fill_block(POINT_BLOCK, found, axial, transverse)


def _arrays(
    numbers: Mapping[str, float], path: str, arrays: Mapping[str, tuple[str, str, str]], axial: int, transverse: int
) -> dict[str, np.ndarray]:
    """Arrays of the numbers under a path."""
    counts = {"s": axial, "w": transverse, "a": axial + transverse}
    return {
        name: packed(numbers, f"{path}.{pattern if axes else name}", [counts[axis] for axis in axes], axes)
        for name, (axes, pattern, _) in arrays.items()
    }


def packed(numbers: Mapping[str, float], pattern: str, shape: list[int], axes: str) -> np.ndarray:
    """Numbers by their names as an array; of a symmetric one the names hold the upper triangle."""
    symmetric = len(axes) == 2 and axes[0] == axes[1]
    found = np.zeros(shape)
    for index in np.ndindex(*shape):
        found[index] = numbers[pattern.format(*(sorted(index) if symmetric else index))]
    return found


def fill_block(block: Sequence[Slot], arrays: Mapping[str, np.ndarray], axial: int, transverse: int) -> np.ndarray:
    """A block of the arrays that its slots are made of, by their names; what no shape has needs none."""
    filled = []
    for slot, shape in zip(block, block_shapes(block, axial, transverse).values(), strict=True):
        if 0 not in shape:
            values = sum(arrays[name] for name in slot.of) - sum(arrays[name] for name in slot.less)
            filled.append(np.broadcast_to(values, shape).ravel())
    return np.concatenate(filled)
