"""Stresses of a beam link by each of its shapes, at the outermost fibres of its points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kaneflex.fem.links import Link
from kaneflex.multibody.shapes import Shapes
from kaneflex.response.stresses import section_at
from kaneflex.scene import Scene
from kaneflex.scene.modal_data import ModalData


def recovering(scene: Scene, link: Link, shapes: Shapes, data: ModalData) -> ModalData:
    """A planar link's data with `POINT_upper` and `POINT_lower` at the edges +y and -y of every point on a node.

    Normal stress by Navier's hypothesis, N/A - y M/I; edges bear no shear. The section is that before the point, of the
    start that after it. Points whose section has no shape have no stresses.
    """
    names, rows = [], []
    forces = (link.part.matrices["K_s"].at({}) @ shapes.all).reshape(len(link.nodes), 3, -1)
    for point, x in zip(data.points, data.arrays["X"].tolist(), strict=True):
        section = section_at(scene.bodies[link.name], x)
        if section is None:
            continue
        outline, numbers = section
        N, M = _carried(link.nodes, forces, x)
        for edge, y in (("upper", outline.y.max()), ("lower", outline.y.min())):
            normal = N / numbers.A - y * M / numbers.I_z
            names.append(f"{point}_{edge}")
            rows.append([normal, 0.0 * normal, 0.0 * normal])
    return replace(data, stress_points=tuple(names), stress=np.array(rows)) if names else data


def _carried(nodes: np.ndarray, forces: np.ndarray, x: float) -> tuple[np.ndarray, np.ndarray]:
    """N [N/m] and M [N m/m] of each shape at x, by the nodal forces (n_nodes, 3, n_shapes) before it that hold it."""
    before = nodes < x if x > nodes[0] else nodes == nodes[0]
    along, across, moment = forces[before].transpose(1, 0, 2)
    return -along.sum(axis=0), (x - nodes[before]) @ across - moment.sum(axis=0)
