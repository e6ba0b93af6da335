"""Elastic links in space as chains of finite elements, in the axes of their own floating frame.

x runs along the link, y and z are the principal axes of its sections. A node has u, v, w, theta_x, theta_y, theta_z.
What becomes of a link's matrices, reduction and assembly, does not ask how many coordinates its nodes have.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from itertools import pairwise
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from kaneflex.fem.element_terms import chain, terms_of_elements
from kaneflex.fem.links import GAUSS, Link, Part, node_coordinates, spread_terms
from kaneflex.fem.shape_functions import spatial_shape_functions
from kaneflex.fem.spatial_bodies import at_point
from kaneflex.mechanism.affine import Monomial
from kaneflex.mechanism.floating_frames import forced_points, mesh
from kaneflex.scene import Scene
from kaneflex.scene.sections import SpatialSectionNumbers
from kaneflex.support.spatial_contract import SPATIAL_NODE, spatial_beam_module

_VARYING = ("rho_A", "rho_I_y", "rho_I_z", "E_I_y", "E_I_z")


class SpatialProperties(NamedTuple):
    """Numbers of a beam's section in space.

    rho_A mass per length [kg/m], rho_I_y and rho_I_z rotary inertias per length [kg m]; E_A axial, E_I_y and E_I_z
    bending, G_J torsional stiffness [N, N m^2, N m^2]; G_A_y and G_A_z stiffnesses in shear along y and z [N], inf for
    theories without shear.
    """

    rho_A: float
    rho_I_y: float
    rho_I_z: float
    E_A: float
    E_I_y: float
    E_I_z: float
    G_J: float
    G_A_y: float = math.inf
    G_A_z: float = math.inf


def spatial_properties(
    section: SpatialSectionNumbers, E: float, G: float, rho: float, shear: bool = False
) -> SpatialProperties:
    """Numbers of a section of one material: E and G [Pa], rho [kg/m^3]; ``shear``: true if the theory includes it.

    Raises
    ------
    ValueError
        With shear, for a section with unknown shear coefficients.
    """
    A, I_y, I_z, J, k_y, k_z = section
    if not shear:
        return SpatialProperties(rho * A, rho * I_y, rho * I_z, E * A, E * I_y, E * I_z, G * J)
    if k_y is None or k_z is None:
        raise ValueError(f"k_y = {k_y}, k_z = {k_z}: shear needs both; give the material a Poisson's ratio")
    return SpatialProperties(rho * A, rho * I_y, rho * I_z, E * A, E * I_y, E * I_z, G * J, G * k_y * A, G * k_z * A)


def spatial_element_parameters_of(at: Callable[[float], SpatialProperties], nodes: np.ndarray) -> dict[str, np.ndarray]:
    """Parameters of a link's elements by their names in ``kaneflex.support.spatial_contract``, (elements,) each.

    A varying property is the linear function that is nearest to it in the mean square over the element, as in the
    plane; those that the element holds constant take their means. Sections must not jump but at nodes [m].
    """
    found: dict[str, list[float]] = {}
    mass = moment = 0.0
    for a, b in pairwise(nodes):
        shares, places = GAUSS[1] / 2, (a + b) / 2 + (b - a) / 2 * GAUSS[0]
        rows = [at(x) for x in places]
        values = {name: np.array([getattr(row, name) for row in rows]) for name in SpatialProperties._fields}
        mean = {name: float(shares @ of_places) for name, of_places in values.items()}
        rise = {f"{name}_rise": float(6 * (shares * GAUSS[0]) @ values[name]) for name in _VARYING}
        here = {name: mean[name] for name in SpatialProperties._fields[:7]} | rise
        here |= {"I_p_A": (mean["E_I_y"] + mean["E_I_z"]) / mean["E_A"], "length": b - a, "x_0": a}
        here |= {"phi_y": 12 * mean["E_I_z"] / (mean["G_A_y"] * (b - a) ** 2), "m_0": mass, "S_0": moment}
        here |= {"phi_z": 12 * mean["E_I_y"] / (mean["G_A_z"] * (b - a) ** 2)}
        mass += mean["rho_A"] * (b - a)
        moment += float((b - a) * shares @ (values["rho_A"] * places))
        for name, number in here.items():
            found.setdefault(name, []).append(number)
    return {name: np.array(numbers) for name, numbers in found.items()}


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
    profile = body.spatial_profile
    module = import_module(f"kaneflex.generated.{spatial_beam_module(profile.rotary, profile.shear, profile.varying)}")

    def at(x: float) -> SpatialProperties:
        section, made_of = profile.at(x)
        E, rho, G, _ = made_of
        assert E is not None and rho is not None and G is not None  # checked with the scene
        return spatial_properties(section, E, G, rho, profile.shear)

    viscous = None if scene.damping is None else scene.damping.viscous
    mu = None if viscous is None else viscous.mu
    parameters = spatial_element_parameters_of(at, nodes)
    also = list[tuple[str, Monomial, np.ndarray]]()
    for load, _, F, K_g in spread_terms(scene, name, parameters, SpatialLink):
        also += [("F", (spread_scalar(name, load, axis),), of_axis) for axis, of_axis in zip("xyz", F, strict=True)]
        also.append(("K_g", (spread_scalar(name, load, "x"),), K_g))
    return build_spatial_link(name, nodes, at, module, mu, jumps(scene, name, nodes), also)


def spread_scalar(link: str, load: str, axis: str) -> str:
    """Name of the scalar of a distributed load per length, in the link's axes [N/m], without its profile."""
    return f"{link}.link.{load}_{axis}"


def jumps(scene: Scene, name: str, nodes: np.ndarray) -> tuple[int, ...]:
    """Nodes between a link's ends at which joints or loads act."""
    places = set(forced_points(scene, name).values())
    return tuple(k for k, x in enumerate(nodes[1:-1], 1) if any(abs(x - place) <= 1e-9 * nodes[-1] for place in places))


def build_spatial_link(
    name: str, nodes: np.ndarray, at: Callable[[float], SpatialProperties], module: ModuleType, mu: float | None = None,
    jumps: tuple[int, ...] = (), also: Iterable[tuple[str, Monomial, np.ndarray]] = (),
) -> SpatialLink:  # fmt: skip
    """Assemble a link's constant matrices from the element kernels of a module of ``SPATIAL_BEAMS``.

    Parameters
    ----------
    name : str
        The body's; the scalars of its motion are called ``name.link.omega_x`` and so on.
    nodes : ndarray (elements + 1,)
        Distances from the link's start [m], ascending from 0.
    at : callable
        Distance from the start [m] -> the section's properties there.
    module : ModuleType
        Like ``kaneflex.generated.spatial_beam_timoshenko``. Sections that vary ask for a ``_varying`` one.
    mu : float, optional
        Damping by a force for each length and velocity [N s/m^2].
    jumps : tuple of int
        Nodes beyond which the axial force is higher by a scalar of the motion.
    also : iterable of (key, monomial, ndarray (elements, 12, 12 or 1))
        Terms of loads along the link.
    """
    parameters = spatial_element_parameters_of(at, nodes)
    terms = [(*key, blocks) for key, blocks in terms_of_elements(module, parameters, f"{name}.link.{{}}".format, mu)]
    pulled = next(blocks for key, monomial, blocks in terms if (key, monomial) == ("K_g", (f"{name}.link.P_0",)))
    for node in jumps:
        beyond = np.arange(len(nodes) - 1) >= node
        terms.append(("K_g", (f"{name}.link.jump_{node}",), pulled * beyond[:, None, None]))
    terms += also
    coordinates, place = node_coordinates(name, len(nodes), axially_rigid=False, dofs=SPATIAL_NODE)
    matrices = chain((((key, monomial), blocks) for key, monomial, blocks in terms), place, len(coordinates))
    return SpatialLink(name, nodes, parameters, tuple(terms), Part(name, coordinates, matrices, place))
