"""Elastic links as chains of finite elements, in the axes of their own floating frame: x along the link, in space y and
z along the principal axes of its sections."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib import import_module
from types import MappingProxyType, ModuleType
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from kaneflex.fem.element_terms import chain, shape_functions, spatial_shape_functions, terms_of_elements
from kaneflex.mechanism.affine import Affine, Matrix, Monomial, as_array, solve
from kaneflex.mechanism.numbers import forced_points, mesh
from kaneflex.support.contract import SPATIAL_NODE, beam_module
from kaneflex.support.errors import SceneError

if TYPE_CHECKING:
    from kaneflex.mechanism.parts import Load
    from kaneflex.scene.bodies import Body

SAME = 1e-9
"""Distance below which points coincide, as a share of a link's length."""

GAUSS = np.polynomial.legendre.leggauss(5)
"""Quadrature over an element, exact for products of two cubics with a mass that grows linearly."""


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
    turns : str or None
        Body with which a part in global axes turns.
    """

    name: str
    coordinates: tuple[str, ...]
    matrices: Mapping[str, Affine]
    place: Mapping[int, tuple[Any, ...]]
    turns: str | None = None

    @property
    def size(self) -> int:
        return len(self.coordinates)


@dataclass(frozen=True)
class Link:
    """Elastic link: its mesh, its section and its finite-element matrices in link axes.

    Attributes
    ----------
    mechanism : NumericMechanism or SpatialMechanism
        With the body of this ``name``.
    nodes : ndarray (elements + 1,)
        Distances from the link's start [m].
    parameters : mapping of str to ndarray (elements,)
        Parameters of every element, by the names in ``kaneflex.derive.elements.parameters``.
    element_terms : tuple of (key, monomial, ndarray (elements, 6, 6 or 1))
        Each term's matrix of every element, for the forces at the elements' ends.
    part : Part
        The assembled link, coordinates u, v, theta of each node in turn; one u for all nodes if it does not stretch.
    dofs, names : int, tuple of str
        Coordinates of a node and their names: axial and transverse displacement [m], rotation [rad].
    slopes, shortening : slice
        Rows of :meth:`shape` that are the axis' slopes, and those whose squares shorten the axis.
    motions : tuple of int
        Places of the node's coordinates among those of a node in space.
    densities : tuple of str
        Parameters: mass per length, rotary inertia of the fibres at y, in space also of those at z.
    """

    mechanism: Any
    name: str
    nodes: np.ndarray
    parameters: Mapping[str, np.ndarray]
    element_terms: tuple[tuple[str, Monomial, np.ndarray], ...]
    part: Part
    dofs: ClassVar[int] = 3
    slopes: ClassVar[slice] = slice(3, 4)
    shortening: ClassVar[slice] = slopes
    names: ClassVar[tuple[str, ...]] = ("u", "v", "theta")
    motions: ClassVar[tuple[int, ...]] = (0, 1, 5)
    densities: ClassVar[tuple[str, ...]] = ("rho_A", "rho_I")

    @property
    def body(self) -> Body:
        body: Body = self.mechanism.deforming[self.name]
        return body

    @property
    def length(self) -> float:
        return float(self.nodes[-1])

    def node_at(self, x: float) -> int | None:
        """Index of the node at distance x [m] from the start; None without one."""
        index = int(np.argmin(abs(self.nodes - x)))
        return index if abs(self.nodes[index] - x) <= SAME * self.length else None

    def node_of_joint(self, at: Sequence[float], written: object) -> int:
        """Node at a point of the link, ``written`` as in the scene; raises SceneError for a point off its axis."""
        node = None if any(at[1:]) else self.node_at(at[0])
        if node is None:
            raise SceneError(
                f"bodies.{self.name}", written, "a joint on an elastic body must lie on its axis",
                "Move the point onto the axis, between start and end",
            )  # fmt: skip
        return node

    def locate(self, x: float) -> tuple[int, float]:
        """Element at distance x [m] from the start, and the distance from its own start [m]."""
        e = min(max(int(np.searchsorted(self.nodes, x, side="right")) - 1, 0), len(self.nodes) - 2)
        return e, x - self.nodes[e]

    def length_of(self, e: int) -> float:
        """Length of an element [m]."""
        return float(self.nodes[e + 1] - self.nodes[e])

    def shape(self, e: int, local: float) -> np.ndarray:
        """Rows u, v, theta, v' of an element's shape functions at ``local`` [m] from its start, (4, 6)."""
        return self.functions(local, {name: float(numbers[e]) for name, numbers in self.parameters.items()})

    @staticmethod
    def functions(x: Any, of: Mapping[str, Any]) -> np.ndarray:
        """Rows of :meth:`shape` at x [m] from the start of an element with these parameters, or of many."""
        return shape_functions(x, of["length"], of["phi_s"], of["E_I_rise"] / of["E_I"])

    @cached_property
    def gauss(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Places from the link's start [m] and weights [m] of the quadrature over each element, (elements, 5), and rows
        of :meth:`shape` there, (elements, 5, rows, columns)."""
        return at_gauss(self.functions, self.parameters)

    def at_points(self, name: str) -> np.ndarray:
        """Parameter that grows linearly over an element, at the points of :attr:`gauss`, (elements, 5)."""
        return self.parameters[name][:, None] + 0.5 * self.parameters[f"{name}_rise"][:, None] * GAUSS[0]

    def sums(self, kept: tuple[bool, ...], alpha: float, beta: float) -> Mapping[tuple[str, Monomial], np.ndarray]:
        """Sums of the element terms in use by "M", "C", "K" or "F" and monomial, with alpha M + beta K_s in C;
        (elements, 6, 6 or 1) each."""
        found: dict[tuple[str, Monomial], np.ndarray] = {}
        for (key, monomial, blocks), is_kept in zip(self.element_terms, kept, strict=True):
            weight = 0.0 if monomial else {"M": alpha, "K_s": beta}.get(key, 0.0)
            for name, factor in ((key[0], float(is_kept)), ("C", weight)):
                if factor:
                    found[name, monomial] = found.get((name, monomial), 0.0) + factor * blocks
        return found

    def rigid_motion(self, x: float) -> np.ndarray:
        """Displacements and rotations at x in rigid motions of the link, by those of its start, (dofs, dofs)."""
        return np.array([[1.0, 0.0, 0.0], [0.0, 1.0, x], [0.0, 0.0, 1.0]])

    def at_nodes(self, coordinates: np.ndarray) -> np.ndarray:
        """Displacements and rotations of each node in turn, (dofs n_nodes, n_times), from the part's coordinates."""
        return coordinates[[row for rows in self.part.place.values() for row in rows]]


class SpatialLink(Link):
    """An elastic link in space, with y and z along the principal axes of its sections; element matrices are 12 x 12."""

    dofs = 6
    names = SPATIAL_NODE
    slopes = slice(6, 8)
    shortening = slice(6, 9)
    motions = (0, 1, 2, 3, 4, 5)
    densities = ("rho_A", "rho_I_z", "rho_I_y")

    def rigid_motion(self, x: float) -> np.ndarray:
        found = np.eye(6)
        found[1, 5], found[2, 4] = x, -x
        return found

    @staticmethod
    def functions(x: Any, of: Mapping[str, Any]) -> np.ndarray:
        """Rows u, v, w, theta_x, theta_y, theta_z, v', w', and the twist by which an axial force stiffens torsion (that
        times the radius of gyration, after Wagner), (..., 9, 12)."""
        growth = of["E_I_z_rise"] / of["E_I_z"], of["E_I_y_rise"] / of["E_I_y"]
        return spatial_shape_functions(x, of["length"], (of["phi_y"], of["phi_z"]), growth, of["I_p_A"] ** 0.5)


def make_link(
    mechanism: Any, name: str, elements: int, module: ModuleType | None = None, stretches: bool = False
) -> Link:
    """Link of an elastic body: in the plane with the element kernels of the mechanism's ``module``, in space without.

    ``stretches``: with all axial coordinates, also of an axially rigid beam. In space the axial force is higher by
    ``name.link.jump_NODE`` beyond a node where joints or loads act.
    """
    body, nodes = mechanism.deforming[name], mesh(mechanism, name, elements)
    assert body.beam is not None  # as of any elastic body
    profile, kind = body.profile, Link
    if module is None:
        kind, parameters = SpatialLink, profile.elements(nodes)
        beam = beam_module(profile.rotary, profile.shear, profile.varying)
        module, beyond = import_module(f"kaneflex.generated.spatial_{beam}"), jumps(mechanism, name, nodes)
    else:
        parameters, known = profile.planar_elements(nodes), {scalar for scalar, *_ in module.SCALARS}
        # no jump where there is no axial load
        beyond = {k: x for k, x in forced_points(mechanism, name).items() if f"{name}.link.jump_{k}" in known}
    terms, rigid = terms_of_link(mechanism, name, parameters, module, kind), body.beam.axially_rigid and not stretches
    return build_link(mechanism, kind, name, nodes, parameters, terms, beyond, rigid)


def jumps(mechanism: Any, name: str, nodes: np.ndarray) -> dict[str, float]:
    """Nodes between a link's ends at which joints or loads act, by their numbers, and their places [m]."""
    places = set(forced_points(mechanism, name).values())
    return {str(k): x for k, x in enumerate(nodes[1:-1], 1) if any(abs(x - at) <= SAME * nodes[-1] for at in places)}


def build_link(
    mechanism: Any, kind: type[Link], name: str, nodes: np.ndarray, parameters: Mapping[str, np.ndarray],
    terms: Iterable[tuple[tuple[str, Monomial], np.ndarray]], jumps: Mapping[str, float] = MappingProxyType({}),
    axially_rigid: bool = False,
) -> Link:  # fmt: skip
    """Assemble the constant matrices of a link from the terms of its elements and of the loads along it.

    Every term is added into a sparse matrix of its own, so that the result has no more entries than the chain of
    elements, whatever its length.

    Parameters
    ----------
    name : str
        The body's; the scalars of its frame are called ``name.link.a_x`` and so on.
    nodes : ndarray (elements + 1,)
        Distances from the link's start [m], ascending from 0.
    terms : iterable of ((key, monomial), ndarray (elements, n, n or 1))
        See :func:`terms_of_link`.
    jumps : mapping of str to float
        Distance [m] beyond which the axial force is higher by the scalar ``name.link.jump_KEY`` of the motion.
    """
    sums: dict[tuple[str, Monomial], np.ndarray] = {}
    for key, blocks in terms:
        sums[key] = sums.get(key, 0.0) + blocks
    tensioned = sums.get(("K_g", (f"{name}.link.P_0",)))  # none in a module without the geometric stiffness
    for label, x in jumps.items() if tensioned is not None else ():
        # Beyond a force between the ends P increases by a constant: the matrix is that of P_0, from there on.
        beyond = nodes[:-1] > x - SAME * nodes[-1]
        sums["K_g", (f"{name}.link.jump_{label}",)] = tensioned * beyond[:, None, None]
    coordinates, place = node_coordinates(name, len(nodes), axially_rigid, kind.names)
    element_terms = tuple((key, monomial, blocks) for (key, monomial), blocks in sums.items())
    part = Part(name, coordinates, chain(sums.items(), place, len(coordinates)), place)
    return kind(mechanism, name, nodes, parameters, element_terms, part)


def at_gauss(
    functions: Callable[..., np.ndarray], parameters: Mapping[str, np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Quadrature over elements with these parameters, see :attr:`Link.gauss`."""
    of = {name: numbers[:, None] for name, numbers in parameters.items()}
    local = 0.5 * of["length"] * (1.0 + GAUSS[0])
    return of["x_0"] + local, 0.5 * of["length"] * GAUSS[1], functions(local, of)


def spread_terms(
    mechanism: Any, name: str, parameters: Mapping[str, np.ndarray], link: type[Link]
) -> Iterator[tuple[str, Load, np.ndarray, np.ndarray]]:
    """Distributed loads of a link: name, load, and for unit loads along each axis the elements' nodal loads.

    The last one, (axes, elements, n, 1), is int N^T p dx with the element's own shape functions; then K_g (elements, n,
    n) of the axial force P(X) = -int_0^X p dX of a load along the link.
    """
    for load_name, load in mechanism.loads.items():
        if load.spread is not None and load.spread[0].body == name:
            X, weights, rows = at_gauss(link.functions, parameters)
            first, rise = load.spread[2], (load.spread[3] - load.spread[2]) / mechanism.deforming[name].length
            F = np.einsum("eg,egan->aen", weights * (first + rise * X), rows[:, :, : link.dofs // 3 + 1])
            slopes, pull = rows[:, :, link.shortening], weights * (first * X + rise * X**2 / 2)
            yield load_name, load, F[..., None], -np.einsum("eg,egan,egam->enm", pull, slopes, slopes)


def terms_of_link(
    mechanism: Any, link: str, parameters: Mapping[str, np.ndarray], module: ModuleType, kind: type[Link]
) -> Iterator[tuple[tuple[str, Monomial], np.ndarray]]:
    """Terms of a link's elements and of the loads distributed along it, with a matrix for each element.

    K_g holds the growth of the axial force by inertia and the load; a fixed structure has no known P_0, and no K_g.
    """
    viscous = None if mechanism.damping is None else mechanism.damping.viscous
    mu = None if viscous is None else viscous.mu
    for key, blocks in terms_of_elements(module, parameters, lambda factor: _scalar(link, factor), mu):
        if not (mechanism.frame and key[0] == "K_g"):
            yield key, blocks
    for name, load, F, K_g in spread_terms(mechanism, link, parameters, kind):
        x, y, *_ = load.direction or ()
        parts: dict[Monomial, tuple[float, ...]] = {(name,): (x, y)}
        if kind.dofs == 6:
            parts = {(spread_scalar(link, name, axis),): tuple(e) for axis, e in zip("xyz", np.eye(3), strict=True)}
        elif not load.in_body:
            parts = {(name, f"{link}.c"): (x, y), (name, f"{link}.s"): (y, -x)}
        for factors, components in parts.items():
            monomial = tuple(sorted(factors))
            yield ("F", monomial), sum(part * along for part, along in zip(components, F, strict=True))
            if components[0] and not mechanism.frame:
                yield ("K_g", monomial), components[0] * K_g


def spread_scalar(link: str, load: str, axis: str) -> str:
    """Name of the scalar of a distributed load per length in space, in the link's axes [N/m], without its profile."""
    return f"{link}.link.{load}_{axis}"


def _scalar(link: str, factor: str) -> str:
    """Scalars of the link: in the plane omega and epsilon are those of the body; others belong to the link's frame."""
    return f"{link}.{factor}" if factor in ("omega", "epsilon") else f"{link}.link.{factor}"


def node_coordinates(
    link: str, nodes: int, axially_rigid: bool, dofs: tuple[str, ...] = Link.names
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
    return replace(part, matrices=matrices)


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
        Another basis to reduce to, from a link with the same coordinates and held rows.

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
    static = static_shapes(stiffness, held, free)
    _, shapes = lowest_modes(stiffness[free][:, free], mass[free][:, free], min(modes, len(free)))
    dynamic = np.zeros((part.size, shapes.shape[1]))
    dynamic[free] = shapes
    return np.hstack([static, dynamic])


def static_shapes(stiffness: Matrix, held: list[int], free: np.ndarray, turns: bool = False) -> np.ndarray:
    """Shapes of unit displacements of the held rows, one at a time, with equilibrium in the free rows; ``turns`` allows
    rigid motions of these, the least of which is taken."""
    shapes = np.zeros((stiffness.shape[0], len(held)))
    shapes[held, np.arange(len(held))] = 1.0
    if held and len(free):  # what turns freely is singular without held rows
        inner, outer = stiffness[free][:, free], as_array(stiffness[free][:, held])
        shapes[free] = -np.linalg.lstsq(as_array(inner), outer, rcond=None)[0] if turns else -solve(inner, outer)
    return shapes
