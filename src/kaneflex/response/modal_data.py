"""Modal data of links as arrays for other programs, as in the coupled equations."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from kaneflex.multibody.model.inertia_integrals import link_data
from kaneflex.multibody.model.module_loading import find_spatial_module
from kaneflex.multibody.model.shapes import Shapes
from kaneflex.multibody.model.spatial_coupled import build_coupled_system
from kaneflex.multibody.model.system import build_system
from kaneflex.response.stress_recovery import recovering
from kaneflex.scene import Scene
from kaneflex.scene.modal_data import ModalData
from kaneflex.scene.options import modes_of, resolve_options
from kaneflex.support.atomic_output import refuse_existing


def links_data(scene: Scene, progress: Callable[[str], None]) -> dict[str, ModalData]:
    """Modal data of every elastic link of a scene, in the plane or in space."""
    if scene.is_spatial:
        module, _ = find_spatial_module(scene, progress)
        options = replace(resolve_options(scene), modes=modes_of(scene))
        shapes = build_coupled_system(scene, module, options).layout.shapes
    else:
        shapes = build_system(scene, progress)[0].shapes
    of = {name: each for name, each in shapes.items() if isinstance(each, Shapes)}
    return {name: recovering(scene, each.link, each.basis, link_data(each)) for name, each in of.items()}


def export(links: Mapping[str, ModalData], folder: Path, force: bool) -> list[Path]:
    """Write BODY.npz for every link into a folder, which is made if needed.

    Raises
    ------
    OutputError
        If a file exists without ``force``, or can't be written.
    """
    paths = {name: folder / f"{name}.npz" for name in links}
    for path in paths.values():
        refuse_existing(path, force, "modal-data")
    for name, path in paths.items():
        links[name].save(path)
    return list(paths.values())
