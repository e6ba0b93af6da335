"""Elastic links in space as chains of finite elements, in the axes of their own floating frame.

x runs along the link, y and z are the principal axes of its sections.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any

import numpy as np

from kaneflex.fem.element_terms import spatial_shape_functions
from kaneflex.fem.links import SAME, Link, build_link, terms_of_link
from kaneflex.mechanism.floating_frames import forced_points, mesh
from kaneflex.mechanism.spatial_frame import at_point
from kaneflex.scene import Scene
from kaneflex.support.contract import SPATIAL_NODE, beam_module


class SpatialLink(Link):
    """An elastic link in space, with y and z along the principal axes of its sections; element matrices are 12 x 12."""

    dofs = 6
    names = SPATIAL_NODE
    slopes = slice(6, 8)
    shortening = slice(6, 9)
    motions = (0, 1, 2, 3, 4, 5)
    densities = ("rho_A", "rho_I_z", "rho_I_y")

    def rigid_motion(self, x: float) -> np.ndarray:
        return at_point(np.array([x, 0.0, 0.0]))

    @staticmethod
    def functions(x: Any, of: Mapping[str, Any]) -> np.ndarray:
        """Rows u, v, w, theta_x, theta_y, theta_z, v', w', and the twist by which an axial force stiffens torsion (that
        times the radius of gyration, after Wagner), (..., 9, 12)."""
        growth = of["E_I_z_rise"] / of["E_I_z"], of["E_I_y_rise"] / of["E_I_y"]
        return spatial_shape_functions(x, of["length"], (of["phi_y"], of["phi_z"]), growth, of["I_p_A"] ** 0.5)


def link_of_scene(scene: Scene, name: str, elements: int) -> Link:
    """Link of an elastic body in space.

    Beyond a node where joints or loads act the axial force is higher by ``name.link.jump_NODE``.
    """
    profile, nodes = scene.bodies[name].profile, mesh(scene, name, elements)
    beam = beam_module(profile.rotary, profile.shear, profile.varying)
    parameters, module = profile.elements(nodes), import_module(f"kaneflex.generated.spatial_{beam}")
    beyond = {str(node): nodes[node] for node in jumps(scene, name, nodes)}
    terms = terms_of_link(scene, name, parameters, module, SpatialLink)
    return build_link(SpatialLink, name, nodes, parameters, terms, beyond)


def jumps(scene: Scene, name: str, nodes: np.ndarray) -> tuple[int, ...]:
    """Nodes between a link's ends at which joints or loads act."""
    places = set(forced_points(scene, name).values())
    return tuple(k for k, x in enumerate(nodes[1:-1], 1) if any(abs(x - at) <= SAME * nodes[-1] for at in places))
