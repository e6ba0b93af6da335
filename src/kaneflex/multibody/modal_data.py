"""A link's modal data as arrays: what the coupled equations take of it, written for other programs."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from kaneflex.fem.links import Link
from kaneflex.multibody.inertia_integrals import link_data
from kaneflex.multibody.system import CoupledSystem
from kaneflex.scene import Scene
from kaneflex.support.atomic_output import refuse_existing


def modal_data(scene: Scene, link: Link, system: CoupledSystem) -> dict[str, np.ndarray]:
    """Arrays of one link, SI, without the scene's lumped masses.

    Returns
    -------
    dict
        "format", "length" [m], "points" (names), every name of ARRAYS, and of POINT_ARRAYS with the points first.
    """
    return link_data(scene, link, system.shapes[link.name]).file


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
        link_data(scene, system.links[name], system.shapes[name]).save(path)
    return list(paths.values())
