"""Elastic links in space as chains of finite elements, in the axes of their own floating frame.

x runs along the link, y and z are the principal axes of its sections. A node has u, v, w, theta_x, theta_y, theta_z.
What becomes of a link's matrices, reduction and assembly, does not ask how many coordinates its nodes have.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import ModuleType
from typing import Any

import numpy as np

from kaneflex.fem.element_terms import chain, spatial_shape_functions, terms_of_elements
from kaneflex.fem.links import Link, Part, node_coordinates, spread_terms
from kaneflex.fem.spatial_bodies import at_point
from kaneflex.mechanism.affine import Monomial
from kaneflex.mechanism.floating_frames import forced_points, mesh
from kaneflex.scene import Scene
from kaneflex.support.spatial_contract import SPATIAL_NODE, spatial_beam_module


class SpatialLink(Link):
    """An elastic link in space; element matrices are 12 x 12, and nodes have the coordinates of SPATIAL_NODE."""

    dofs = 6
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


def link_of_scene(scene: Scene, name: str, elements: int) -> SpatialLink:
    """The link of an elastic body, its mesh that of :func:`kaneflex.fem.links.mesh`.

    Beyond a node where joints or loads act the axial force is higher by ``name.link.jump_NODE``.
    """
    from importlib import import_module

    body, nodes = scene.bodies[name], mesh(scene, name, elements)
    profile = body.profile
    module = import_module(f"kaneflex.generated.{spatial_beam_module(profile.rotary, profile.shear, profile.varying)}")
    viscous = None if scene.damping is None else scene.damping.viscous
    mu = None if viscous is None else viscous.mu
    parameters = profile.elements(nodes)
    also = list[tuple[str, Monomial, np.ndarray]]()
    for load, _, F, K_g in spread_terms(scene, name, parameters, SpatialLink):
        also += [("F", (spread_scalar(name, load, axis),), of_axis) for axis, of_axis in zip("xyz", F, strict=True)]
        also.append(("K_g", (spread_scalar(name, load, "x"),), K_g))
    return build_spatial_link(name, nodes, parameters, module, mu, jumps(scene, name, nodes), also)


def spread_scalar(link: str, load: str, axis: str) -> str:
    """Name of the scalar of a distributed load per length, in the link's axes [N/m], without its profile."""
    return f"{link}.link.{load}_{axis}"


def jumps(scene: Scene, name: str, nodes: np.ndarray) -> tuple[int, ...]:
    """Nodes between a link's ends at which joints or loads act."""
    places = set(forced_points(scene, name).values())
    return tuple(k for k, x in enumerate(nodes[1:-1], 1) if any(abs(x - place) <= 1e-9 * nodes[-1] for place in places))


def build_spatial_link(
    name: str, nodes: np.ndarray, parameters: Mapping[str, np.ndarray], module: ModuleType, mu: float | None = None,
    jumps: tuple[int, ...] = (), also: Iterable[tuple[str, Monomial, np.ndarray]] = (),
) -> SpatialLink:  # fmt: skip
    """Assemble a link's constant matrices from the element kernels of a module of ``SPATIAL_BEAMS``.

    Parameters
    ----------
    name : str
        The body's; the scalars of its motion are called ``name.link.omega_x`` and so on.
    nodes : ndarray (elements + 1,)
        Distances from the link's start [m], ascending from 0.
    parameters : mapping of str to ndarray (elements,)
        See :func:`kaneflex.scene.sections.element_parameters`.
    module : ModuleType
        Like ``kaneflex.generated.spatial_beam_timoshenko``. Sections that vary ask for a ``_varying`` one.
    mu : float, optional
        Damping by a force for each length and velocity [N s/m^2].
    jumps : tuple of int
        Nodes beyond which the axial force is higher by a scalar of the motion.
    also : iterable of (key, monomial, ndarray (elements, 12, 12 or 1))
        Terms of loads along the link.
    """
    terms = [(*key, blocks) for key, blocks in terms_of_elements(module, parameters, f"{name}.link.{{}}".format, mu)]
    pulled = next(blocks for key, monomial, blocks in terms if (key, monomial) == ("K_g", (f"{name}.link.P_0",)))
    for node in jumps:
        beyond = np.arange(len(nodes) - 1) >= node
        terms.append(("K_g", (f"{name}.link.jump_{node}",), pulled * beyond[:, None, None]))
    terms += also
    coordinates, place = node_coordinates(name, len(nodes), axially_rigid=False, dofs=SPATIAL_NODE)
    matrices = chain((((key, monomial), blocks) for key, monomial, blocks in terms), place, len(coordinates))
    return SpatialLink(name, nodes, parameters, tuple(terms), Part(name, coordinates, matrices, place))
