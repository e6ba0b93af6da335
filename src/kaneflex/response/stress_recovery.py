"""Recovery data of beam links by shape: section forces, and stresses at section edges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kaneflex.fem.links import Link
from kaneflex.fem.recovery import IN_PLANE, padded, section_forces
from kaneflex.response.stresses import section_at
from kaneflex.scene import Scene
from kaneflex.scene.modal_data import ModalData
from kaneflex.scene.recovery import NONE, Recovery


def recovering(scene: Scene, link: Link, shapes: np.ndarray, data: ModalData) -> ModalData:
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
    return replace(data, sections=Recovery(data.points, rows), stresses=_at_edges(scene, link.name, data, rows))


def _at_edges(scene: Scene, name: str, data: ModalData, sections: np.ndarray) -> Recovery:
    """Stresses at `POINT_upper` and `POINT_lower`, the edges +y and -y of every point whose section shape is known.

    Normal stress by Navier's hypothesis, N/A - y M/I; edges have no shear. The section is the one before the point; at
    the start, after it.
    """
    names, rows = [], []
    for point, x, (N, _, M) in zip(data.points, data.arrays["X"].tolist(), sections, strict=True):
        section = section_at(scene.bodies[name], x)
        if section is None:
            continue
        outline, numbers = section
        for edge, y in (("upper", outline.y.max()), ("lower", outline.y.min())):
            normal = N / numbers.A - y * M / numbers.I_z
            names.append(f"{point}_{edge}")
            rows.append([normal, 0.0 * normal, 0.0 * normal])
    return Recovery(tuple(names), np.array(rows)) if names else NONE
