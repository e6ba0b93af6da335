"""Elastic links as chains of finite elements, in the axes of their own floating frame."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from types import ModuleType
from typing import Any, ClassVar

import numpy as np

from kaneflex.fem.element_terms import chain, terms_of_elements
from kaneflex.fem.shape_functions import shape_functions
from kaneflex.mechanism.affine import Affine, Monomial, as_array, solve
from kaneflex.mechanism.floating_frames import forced_points, mesh
from kaneflex.scene import Scene

_SAME = 1e-9
"""Distance below which points coincide, as a share of a link's length."""

DOFS = ("u", "v", "theta")
"""Coordinates of a node: axial and transverse displacement [m], rotation [rad]."""


@dataclass(frozen=True)
class Part:
    """Body of the elastic stage with its matrices in its own axes.

    Attributes
    ----------
    name : str
        Name of the body.
    coordinates : tuple of str
        Names of the local coordinates.
    matrices : mapping
        M, C_s, C_d, K_s, K_d, K_g (n x n) and F (n x 1), affine in the motion's scalars.
    place : mapping of int to tuple of int or None
        Node -> rows of u, v, theta, in space of u, v, w, theta_x, theta_y, theta_z; None for a rotation that a
        reduction has eliminated.
    """

    name: str
    coordinates: tuple[str, ...]
    matrices: Mapping[str, Affine]
    place: Mapping[int, tuple[Any, ...]]

    @property
    def size(self) -> int:
        return len(self.coordinates)


@dataclass(frozen=True)
class Link:
    """Elastic link: its mesh, its section and its finite-element matrices in link axes.

    Attributes
    ----------
    nodes : ndarray (elements + 1,)
        Distances from the link's start [m].
    parameters : mapping of str to ndarray (elements,)
        Parameters of every element, by the names in ``kaneflex.support.contract``.
    element_terms : tuple of (key, monomial, ndarray (elements, 6, 6 or 1))
        Each term's matrix of every element, for the forces at the elements' ends.
    part : Part
        The assembled link, coordinates u, v, theta of each node in turn; one u for all nodes if it does not stretch.
    """

    name: str
    nodes: np.ndarray
    parameters: Mapping[str, np.ndarray]
    element_terms: tuple[tuple[str, Monomial, np.ndarray], ...]
    part: Part
    dofs: ClassVar[int] = 3
    """Coordinates of a node."""
    slopes: ClassVar[slice] = slice(3, 4)
    """Rows of :meth:`shape` that are the axis' slopes."""

    @property
    def length(self) -> float:
        return float(self.nodes[-1])

    def node_at(self, x: float) -> int | None:
        """Index of the node at distance x [m] from the start, if there is one."""
        index = int(np.argmin(abs(self.nodes - x)))
        return index if abs(self.nodes[index] - x) <= _SAME * self.length else None

    def locate(self, x: float) -> tuple[int, float]:
        """The element at distance x [m] from the start, and how far behind its own start that is."""
        e = min(max(int(np.searchsorted(self.nodes, x, side="right")) - 1, 0), len(self.nodes) - 2)
        return e, x - self.nodes[e]

    def length_of(self, e: int) -> float:
        """Length of an element [m]."""
        return float(self.nodes[e + 1] - self.nodes[e])

    def shape(self, e: int, local: float) -> np.ndarray:
        """Rows u, v, theta, v' of an element's shape functions at ``local`` [m] from its start, (4, 6)."""
        if (e, local) not in self._shapes:
            self._shapes[e, local] = self._shape_at(e, local)
        return self._shapes[e, local]

    def _shape_at(self, e: int, local: float) -> np.ndarray:
        growth = self.parameters["E_I_rise"][e] / self.parameters["E_I"][e]
        return shape_functions(local, self.length_of(e), self.parameters["phi_s"][e], growth)

    @cached_property
    def _shapes(self) -> dict[tuple[int, float], np.ndarray]:
        """Cached results, since sensors share places, and the points of a study share a link."""
        return {}

    def sums(self, kept: tuple[bool, ...], alpha: float, beta: float) -> Mapping[tuple[str, Monomial], np.ndarray]:
        """Sums of the element terms in use by "M", "C", "K" or "F" and monomial, with alpha M + beta K_s in C;
        (elements, 6, 6 or 1) each."""
        if (kept, alpha, beta) not in self._sums:
            found: dict[tuple[str, Monomial], np.ndarray] = {}
            for (key, monomial, blocks), here in zip(self.element_terms, kept, strict=True):
                weight = 0.0 if monomial else {"M": alpha, "K_s": beta}.get(key, 0.0)
                for name, factor in ((key[0], float(here)), ("C", weight)):
                    if factor:
                        found[name, monomial] = found.get((name, monomial), 0.0) + factor * blocks
            self._sums[kept, alpha, beta] = found
        return self._sums[kept, alpha, beta]

    @cached_property
    def _sums(self) -> dict[tuple, Mapping[tuple[str, Monomial], np.ndarray]]:
        """Cached results, since the points of a study share a link."""
        return {}

    def rigid_motion(self, x: float) -> np.ndarray:
        """Displacements and rotations at x in rigid motions of the link, by those of its start, (dofs, dofs)."""
        return np.array([[1.0, 0.0, 0.0], [0.0, 1.0, x], [0.0, 0.0, 1.0]])

    def at_nodes(self, coordinates: np.ndarray) -> np.ndarray:
        """Displacements and rotations of each node in turn, (dofs n_nodes, n_times), from the part's coordinates."""
        return coordinates[[row for rows in self.part.place.values() for row in rows]]


def build_link(scene: Scene, name: str, module: ModuleType, elements: int) -> Link:
    """Assemble the constant matrices of a link from the element kernels of its module.

    Every term of the module is evaluated once per element and added into a sparse matrix of its own, so that the
    result has no more entries than the chain of elements, whatever its length.
    """
    body = scene.bodies[name]
    nodes = mesh(scene, name, elements)
    of_element = [body.profile.element(a, b - a) for a, b in pairwise(nodes)]
    parameters = {parameter: np.array([values[parameter] for values in of_element]) for parameter in of_element[0]}
    sums: dict[tuple[str, Monomial], np.ndarray] = {}
    viscous = None if scene.damping is None else scene.damping.viscous
    mu = None if viscous is None else viscous.mu
    for key, blocks in terms_of_elements(module, parameters, lambda factor: _scalar(name, factor), mu):
        sums[key] = sums.get(key, 0.0) + blocks
    known = {scalar for scalar, *_ in module.SCALARS}
    tensioned = sums.get(("K_g", (f"{name}.link.P_0",)))  # none in a module without the geometric stiffness
    for point, x in forced_points(scene, name).items():
        if tensioned is None or f"{name}.link.jump_{point}" not in known:  # no axial load there
            continue
        # Beyond a force between the ends P increases by a constant: the matrix is that of P_0, from there on.
        beyond = nodes[:-1] > x - _SAME * body.length
        key = "K_g", (f"{name}.link.jump_{point}",)
        sums[key] = tensioned * beyond[:, None, None]
    for key, blocks in _spread_terms(scene, name, nodes, parameters):
        sums[key] = sums.get(key, 0.0) + blocks
    coordinates, place = node_coordinates(name, len(nodes), body.beam.axially_rigid)
    element_terms = tuple((key, monomial, blocks) for (key, monomial), blocks in sums.items())
    part = Part(name, coordinates, chain(sums.items(), place, len(coordinates)), place)
    return Link(name, nodes, parameters, element_terms, part)


_GAUSS = np.polynomial.legendre.leggauss(4)
"""Quadrature that is exact for v'^2 of a cubic under an axial force that grows with the square of x."""


def spread_sums(
    scene: Scene, name: str, nodes: np.ndarray, parameters: Mapping[str, np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodal loads and K_g of each element, for unit distributed loads along and across a link.

    (elements, 6, 1) twice, (elements, 6, 6): int u^T p dx, int v^T p dx and, of the load along the link, the geometric
    stiffness of P(X) = -int_0^X p dX, with the element's own shape functions.
    """
    load = scene.spreads[name]
    first, rise = load.profile[0], (load.profile[1] - load.profile[0]) / nodes[-1]
    count = len(nodes) - 1
    along, across, K_g = np.zeros((count, 6, 1)), np.zeros((count, 6, 1)), np.zeros((count, 6, 6))
    for e, (a, b) in enumerate(pairwise(nodes)):
        growth = parameters["E_I_rise"][e] / parameters["E_I"][e]
        for point, weight in zip(*_GAUSS, strict=True):
            x, w = 0.5 * (b - a) * (1 + point), 0.5 * (b - a) * weight
            u, v, _, slope = shape_functions(x, b - a, parameters["phi_s"][e], growth)
            X = a + x
            along[e] += w * (first + rise * X) * u[:, None]
            across[e] += w * (first + rise * X) * v[:, None]
            K_g[e] -= w * (first * X + rise * X**2 / 2) * np.outer(slope, slope)
    return along, across, K_g


def _spread_terms(
    scene: Scene, link: str, nodes: np.ndarray, parameters: Mapping[str, np.ndarray]
) -> Iterator[tuple[tuple[str, Monomial], np.ndarray]]:
    """Terms of the loads distributed along a link, with a matrix for each element.

    F holds int N^T q dx with the element's own shape functions; K_g the growth of the axial force that q's axial part
    brings, P(X) = P_0 - int_0^X q dX. A fixed structure has no known P_0, and no such growth.
    """
    for name, load in scene.spreads.items():
        if load.spread_on != link:
            continue
        along, across, K_g = spread_sums(scene, name, nodes, parameters)
        x, y = load.direction
        parts: dict[Monomial, tuple[float, float]] = {(name,): (x, y)}
        if load.axes == "global":
            parts = {(name, f"{link}.c"): (x, y), (name, f"{link}.s"): (y, -x)}
        for factors, (x, y) in parts.items():
            monomial = tuple(sorted(factors))
            yield ("F", monomial), x * along + y * across
            if x and not scene.is_frame:
                yield ("K_g", monomial), x * K_g


def _scalar(link: str, factor: str) -> str:
    """Scalars of the link: omega and epsilon are those of the body; the others belong to the link's frame."""
    return f"{link}.{factor}" if factor in ("omega", "epsilon") else f"{link}.link.{factor}"


def node_coordinates(
    link: str, nodes: int, axially_rigid: bool, dofs: tuple[str, ...] = DOFS
) -> tuple[tuple[str, ...], dict[int, tuple[int, ...]]]:
    """Names of a link's coordinates and the rows of each node's `dofs`; one u for all if it does not stretch."""
    n = len(dofs)
    if axially_rigid:
        others = tuple(f"{link}.{i}.{dof}" for i in range(nodes) for dof in dofs[1:])
        return (f"{link}.{dofs[0]}", *others), {i: (0, *range((n - 1) * i + 1, (n - 1) * i + n)) for i in range(nodes)}
    names = tuple(f"{link}.{i}.{dof}" for i in range(nodes) for dof in dofs)
    return names, {i: tuple(range(n * i, n * (i + 1))) for i in range(nodes)}


def with_rayleigh(part: Part, alpha: float, beta: float) -> Part:
    """Add C_s = alpha M + beta K_s, formed in the part's own axes (alpha [1/s], beta [s])."""
    matrices = dict(part.matrices)
    matrices["C_s"] = matrices["C_s"] + alpha * part.matrices["M"] + beta * part.matrices["K_s"]
    return Part(part.name, part.coordinates, matrices, part.place)


def craig_bampton(
    part: Part, held: Collection[int], modes: int, frozen: np.ndarray | None = None
) -> tuple[Part, np.ndarray]:
    """Reduce a link to its interface coordinates and its lowest fixed-interface modes (Craig & Bampton 1968).

    Parameters
    ----------
    part : Part
        Unreduced link.
    held : collection of int
        Local rows that other bodies share or fix; they stay coordinates of their own. Their static shapes hold the
        axial extension and the rotation of the chord.
    modes : int
        Fixed-interface modes to keep.
    frozen : ndarray (size, reduced size), optional
        A basis to reduce to instead, of a link with the same coordinates and held rows.

    Returns
    -------
    Part, ndarray (size, reduced size)
        The reduced link, and the basis B with q = B q_reduced.
    """
    held = sorted(held)
    basis = _basis(part, held, modes) if frozen is None else frozen
    matrices = {
        key: affine.projected(basis) if key == "F" else affine.congruent(basis) for key, affine in part.matrices.items()
    }
    names = [part.coordinates[row] for row in held]
    names += [f"{part.name}.mode_{k + 1}" for k in range(basis.shape[1] - len(held))]
    row_of = {row: k for k, row in enumerate(held)}
    # an interface node keeps its transverse displacement; some of its rotations may be eliminated
    place = {node: tuple(row_of.get(row) for row in rows) for node, rows in part.place.items() if rows[1] in row_of}
    return Part(part.name, tuple(names), matrices, place), basis


def _basis(part: Part, held: list[int], modes: int) -> np.ndarray:
    """Static shapes of the held rows, then the lowest fixed-interface modes."""
    from kaneflex.fem.modes import lowest_modes

    free = np.delete(np.arange(part.size), held)
    stiffness, mass = part.matrices["K_s"].value({}), part.matrices["M"].value({})
    static = np.zeros((part.size, len(held)))
    static[held, np.arange(len(held))] = 1.0
    if held:
        static[free] = -solve(stiffness[free][:, free], as_array(stiffness[free][:, held]))
    _, shapes = lowest_modes(stiffness[free][:, free], mass[free][:, free], min(modes, len(free)))
    dynamic = np.zeros((part.size, shapes.shape[1]))
    dynamic[free] = shapes
    return np.hstack([static, dynamic])
