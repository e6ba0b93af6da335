"""Modal data of links as arrays for other programs, as in the coupled equations, with what recovers section forces, and
stresses at the edges of sections."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from kaneflex.fem.imported.recovery import IN_PLANE, padded, section_forces
from kaneflex.fem.links import Link
from kaneflex.multibody.model.assembly import build_system
from kaneflex.multibody.model.body_parameters import link_data
from kaneflex.response.stresses import section_at
from kaneflex.scene import Scene
from kaneflex.scene.bodies import Body
from kaneflex.scene.modal_data import ModalData
from kaneflex.scene.options import modes_of, resolve_options
from kaneflex.scene.recovery import NONE, Recovery
from kaneflex.support.files import refuse_existing


def links_data(scene: Scene, progress: Callable[[str], None]) -> dict[str, ModalData]:
    """Modal data of every elastic link of a scene, in the plane or in space."""
    elements = resolve_options(scene).elements if scene.is_spatial else None
    shapes = build_system(scene, progress, modes_of(scene.solve), elements)[0].shapes
    return {name: recovering(each.link, each.basis, link_data(each)) for name, each in shapes.items()}


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


def recovering(link: Link, shapes: np.ndarray, data: ModalData) -> ModalData:
    """Modal data of a link with section forces at its points and, in the plane, stresses at their edges.

    ``shapes`` (n_nodes c, n): at the nodes. All points must be nodes.
    """
    spatial = data.dimension == 3
    at_nodes = (link.part.matrices["K_s"].value({}) @ shapes).reshape(len(link.nodes), -1, shapes.shape[1])
    forces = at_nodes if spatial else padded(at_nodes, IN_PLANE, 6)
    nodes = padded(link.nodes[:, None], (0,), 3)
    rows = np.array([section_forces(nodes, forces, x) for x in data.places[:, 0].tolist()])
    if spatial:
        return replace(data, sections=Recovery(data.points, rows))
    rows = rows[:, list(IN_PLANE)]
    return replace(data, sections=Recovery(data.points, rows), stresses=_at_edges(link.body, data, rows))


def _at_edges(body: Body, data: ModalData, sections: np.ndarray) -> Recovery:
    """Stresses at `POINT_upper` and `POINT_lower`, the edges +y and -y of every point whose section shape is known.

    Normal stress by Navier's hypothesis, N/A - y M/I; edges have no shear. The section is the one before the point; at
    the start, after it.
    """
    names, rows = [], []
    for point, x, (N, _, M) in zip(data.points, data.arrays["X"].tolist(), sections, strict=True):
        section = section_at(body, x)
        if section is None:
            continue
        outline, numbers = section
        for edge, y in (("upper", outline.y.max()), ("lower", outline.y.min())):
            normal = N / numbers.A - y * M / numbers.I_z
            names.append(f"{point}_{edge}")
            rows.append([normal, 0.0 * normal, 0.0 * normal])
    return Recovery(tuple(names), np.array(rows)) if names else NONE
