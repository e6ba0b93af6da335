"""A link's modal data as arrays: what the coupled equations take of it, written for other programs."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from kaneflex.coupled.moments import link_numbers
from kaneflex.coupled.system import CoupledSystem
from kaneflex.links import Link
from kaneflex.scene import Scene
from kaneflex.writing import refuse_existing, write_bytes

FORMAT = 1
"""Number of the file's format."""
ARRAYS: dict[str, tuple[str, str, str]] = {
    "mass": ("", "{}", "kg"),
    "mass_X": ("", "{}", "kg m"),
    "mass_X_X": ("", "{}", "kg m^2"),
    "inertia": ("", "{}", "kg m^2"),
    "mass_s": ("s", "mass_s_{}", "kg"),
    "mass_w": ("w", "mass_w_{}", "kg"),
    "mass_X_s": ("s", "mass_X_s_{}", "kg m"),
    "mass_X_w": ("w", "mass_X_w_{}", "kg m"),
    "mass_s_s": ("ss", "mass_s_{}_s_{}", "kg"),
    "mass_w_w": ("ww", "mass_w_{}_w_{}", "kg"),
    "mass_s_w": ("sw", "mass_s_{}_w_{}", "kg"),
    "mass_H": ("ww", "mass_H_{}_{}", "kg/m"),
    "mass_X_H": ("ww", "mass_X_H_{}_{}", "kg"),
    "inertia_psi": ("w", "inertia_psi_{}", "kg m"),
    "inertia_psi_psi": ("ww", "inertia_psi_{}_psi_{}", "kg"),
    "stiffness": ("a", "stiffness_{}", "N/m"),
    "damping": ("aa", "damping_{}_{}", "N s/m"),
}
"""Array -> its axes (s axial shapes, w transverse ones, a all), its numbers' names in PARAMETERS, unit."""
POINT_ARRAYS: dict[str, tuple[str, str, str]] = {
    "X": ("", "X", "m"),
    "s": ("s", "s_{}", "1"),
    "w": ("w", "w_{}", "1"),
    "psi": ("w", "psi_{}", "1/m"),
    "H": ("ww", "H_{}_{}", "1/m"),
}
"""The same of what each point has: the points are the first axis."""


def modal_data(scene: Scene, link: Link, system: CoupledSystem) -> dict[str, np.ndarray]:
    """Arrays of one link, SI, without the scene's lumped masses.

    Returns
    -------
    dict
        "format", "length" [m], "points" (names), every name of ARRAYS, and of POINT_ARRAYS with the points first.
    """
    shapes = system.shapes[link.name]
    numbers = link_numbers(scene, link, shapes)
    sizes = {"s": shapes.axial.shape[1], "w": shapes.transverse.shape[1], "a": shapes.all.shape[1]}
    points = [name for name in scene.bodies[link.name].points_all if f"{name}.X" in numbers]
    found = {"format": np.array(FORMAT), "length": np.array(link.length), "points": np.array(points)}
    for name, (axes, pattern, _) in ARRAYS.items():
        found[name] = _packed(numbers, pattern if axes else name, [sizes[axis] for axis in axes], axes)
    for name, (axes, pattern, _) in POINT_ARRAYS.items():
        of_points = [_packed(numbers, f"{at}.{pattern}", [sizes[axis] for axis in axes], axes) for at in points]
        found[name] = np.array(of_points)
    return found


def _packed(numbers: Mapping[str, float], pattern: str, shape: list[int], axes: str) -> np.ndarray:
    """Numbers by their names as an array; of a symmetric one the names hold the upper triangle."""
    symmetric = len(axes) == 2 and axes[0] == axes[1]
    found = np.zeros(shape)
    for index in np.ndindex(*shape):
        found[index] = numbers[pattern.format(*(sorted(index) if symmetric else index))]
    return found


def unpacked(data: Mapping[str, np.ndarray]) -> dict[str, float]:
    """The numbers of a link by their names in PARAMETERS, from its arrays: the inverse of :func:`modal_data`."""
    found: dict[str, float] = {}
    for name, (axes, pattern, _) in ARRAYS.items():
        found |= _named(data[name], pattern if axes else name, axes)
    for k, point in enumerate(data["points"]):
        for name, (axes, pattern, _) in POINT_ARRAYS.items():
            found |= _named(data[name][k], f"{point}.{pattern}", axes)
    return found


def _named(array: np.ndarray, pattern: str, axes: str) -> dict[str, float]:
    symmetric = len(axes) == 2 and axes[0] == axes[1]
    return {
        pattern.format(*index): float(array[index])
        for index in np.ndindex(*array.shape)
        if not symmetric or index[0] <= index[1]
    }


def export(scene: Scene, system: CoupledSystem, folder: Path, force: bool) -> list[Path]:
    """Write BODY.npz for every elastic link of a scene into a folder, which is made if it is not there.

    Raises
    ------
    OutputError
        If a file is there and ``force`` is not given, or can't be written.
    """
    paths = {name: folder / f"{name}.npz" for name in system.links}
    for path in paths.values():
        refuse_existing(path, force, "modal-data")
    for name, path in paths.items():
        content = io.BytesIO()
        np.savez(content, **modal_data(scene, system.links[name], system))
        write_bytes(path, content.getvalue())
    return list(paths.values())
