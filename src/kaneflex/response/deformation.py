"""Displacements and section forces anywhere on an elastic link, from a solution's coordinates."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Self

import numpy as np

from kaneflex.fem.assembly import in_own_axes, load_on_link, spin_or_euler
from kaneflex.fem.coordinate_map import Placed
from kaneflex.fem.links import Link, Part, node_coordinates
from kaneflex.mechanism.affine import Affine, Monomial, as_array, solve
from kaneflex.mechanism.body_frame import Rates
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.rigid_bodies import Site
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.mechanism.wrenches import moment_of
from kaneflex.multibody.model.bound_model import Model, keep_terms
from kaneflex.response.section_forces import carried, spread_loads
from kaneflex.scene.options import Options

_GAUSS = np.polynomial.legendre.leggauss(3)  # exact for v'^2 of a cubic
_HELD = 1e-6
"""Share of the largest load up to which a difference of loads and stiffness is rounding."""


@dataclass(frozen=True, eq=False)
class Deformation:
    """Nodal coordinates q, q', q'' of one link over time, in link axes; arrays (dofs n_nodes, n_times).

    ``attached``: function that returns the forces at all sites, see :func:`attached_forces`. ``balanced``:
    the rates in the equations, if these are others: none in quasi-static ones. ``shortened``: nodal displacements that
    foreshortening causes, without those of the bent axis itself. ``residuals``: of all elements, (elements, 6,
    n_times), if known.
    """

    model: Model
    link: Link
    rigid: RigidMotion
    q: np.ndarray
    q_rate: np.ndarray
    q_accel: np.ndarray
    attached: Callable[[], Mapping[Site, np.ndarray]]
    balanced: tuple[np.ndarray, np.ndarray] | None = None
    shortened: Rates | None = None
    residuals: np.ndarray | None = None

    def at(self, x: float) -> Rates:
        """Displacements (u, v, theta) and first and second rates at distance x [m] from the start; each (dofs,
        n_times).

        With foreshortening, u includes -1/2 int_0^x v'^2 (Kane, Ryan, Banerjee 1987), and all of them the motion that
        closes the joints, see :mod:`kaneflex.response.foreshortening`.
        """
        e, local = self.link.locate(x)
        n = self.link.dofs
        shape, rows = self.link.shape(e, local)[:n], slice(n * e, n * (e + 2))
        d, d_rate, d_accel = (shape @ series[rows] for series in (self.q, self.q_rate, self.q_accel))
        if self.shortened is None:
            return d, d_rate, d_accel
        closing = (shape @ series[rows] for series in self.shortened)
        d, d_rate, d_accel = (part + more for part, more in zip((d, d_rate, d_accel), closing, strict=True))
        for part, shortening in zip((d, d_rate, d_accel), self.foreshortening(x), strict=True):
            part[0] -= shortening
        return d, d_rate, d_accel

    def closed_by(self, shortened: Rates) -> Self:
        """The same with the nodal displacements of foreshortening, which don't change the foreshortening itself."""
        found = replace(self, shortened=shortened)
        vars(found)["_shortened_at_nodes"] = self._shortened_at_nodes
        return found

    def foreshortening(self, x: float) -> np.ndarray:
        """Shortening 1/2 int_0^x v'^2 and its rates, (3, n_times)."""
        node, (e, local) = self.link.node_at(x), self.link.locate(x)
        if node is not None:
            return self._shortened_at_nodes[node]
        return self._shortened_at_nodes[e] + self._shortened(slice(e, e + 1), np.array([local]))[0]

    @cached_property
    def _shortened_at_nodes(self) -> np.ndarray:
        """Foreshortening of all elements before each node, (n_nodes, 3, n_times)."""
        found = np.zeros((len(self.link.nodes), 3, self.q.shape[1]), self.q.dtype)
        np.cumsum(self._shortened(slice(0, len(found) - 1), np.diff(self.link.nodes)), axis=0, out=found[1:])
        return found

    def _shortened(self, elements: slice, reach: np.ndarray) -> np.ndarray:
        """Shortening 1/2 int v'^2 of elements up to `reach` [m] from their starts, and its rates, (elements, 3,
        n_times)."""
        points, weights = _GAUSS
        of = {name: numbers[elements, None] for name, numbers in self.link.parameters.items()}
        slopes = self.link.functions(0.5 * reach[:, None] * (1 + points), of)[..., self.link.slopes, :]
        total = 0.0
        for plane in range(slopes.shape[2]):
            s, s_rate, s_accel = (slopes[:, :, plane] @ self._of_elements(part, elements)
                                  for part in (self.q, self.q_rate, self.q_accel))  # fmt: skip
            squares = np.stack([0.5 * s**2, s * s_rate, s_rate**2 + s * s_accel], axis=1)
            total = total + weights @ squares
        return 0.5 * reach[:, None, None] * total

    def unbalanced(self) -> np.ndarray:
        """Forces of the elements less the point loads on the part's coordinates, (size, n_times)."""
        total = np.zeros((self.link.part.size, self.q.shape[1]), self.q.dtype)
        for node, rows in self.link.part.place.items():  # one by one: nodes may share a row
            total[list(rows)] += self.at_nodes[node]
        return total

    @cached_property
    def at_nodes(self) -> np.ndarray:
        """Forces of the elements less the point loads at each node, link axes, (n_nodes, dofs, n_times)."""
        return self._summed(self.end_forces)

    def _summed(self, forces: np.ndarray) -> np.ndarray:
        """Sum of forces at the elements' ends less the point loads at each node, (n_nodes, dofs, n_times)."""
        coordinates, place = node_coordinates(self.link.name, len(self.link.nodes), False, self.link.names)
        unloaded = Part(self.link.name, coordinates, {"F": Affine.zero(len(coordinates), 1)}, place)
        loads = self.rigid.column_of(load_on_link(unloaded, self.link).matrices["F"])
        total = -loads.reshape(len(place), self.link.dofs, -1)
        for e, at_ends in enumerate(forces):
            total[e : e + 2] += at_ends.reshape(2, self.link.dofs, -1)
        return total

    def section(self, x: float, after: bool = False) -> np.ndarray:
        """Axial force N [N, tension positive], shear force V [N], bending moment M = E I v'' [N m] at x: (3, n_times).

        At a node from the equilibrium of the adjacent elements; between nodes interpolated, with the exact contribution
        of the rigid body's inertia load. At a load they jump: ``after`` selects the side.
        """
        e, local = self.link.locate(x)
        left, right = self._ends(e)
        if self.link.node_at(x) is not None and e > 0 and local < 0.5 * self.link.length_of(e):
            return self._at_node(x, after, self._ends(e - 1)[1], left)
        length = self.link.length_of(e)
        share = local / length
        found = left + (right - left) * share
        if self.model.balances and 0.0 < local < length:  # the rigid link's loads between the nodes, less their chord
            found += self._needed(e, local) - share * self._needed(e, length)
        return found

    def _at_node(self, x: float, after: bool, before: np.ndarray, behind: np.ndarray) -> np.ndarray:
        """Section forces at a node from both adjacent elements, on one side of a load.

        Without a load they are equal up to the residual of a reduction: the mean.
        """
        node = self.link.node_at(x)
        if any(self.link.node_at(at) == node for at in self.model.scene.acted_on(self.link.name)):
            return (behind if after else before).copy()
        return 0.5 * (before + behind)

    def _needed(self, e: int, reach: float) -> np.ndarray:
        """Force, and moment about its end, that an element of the rigid link needs up to `reach` [m] from its node."""
        from kaneflex.response.momentum import MassIntegrals, Slices, rate_of_momentum

        mechanism, name, end = mechanism_of(self.model.scene), self.link.name, self.link.nodes[e] + reach
        moved = carried(mechanism, self.rigid, name)
        along = np.eye(len(moved[0]))[:, :1]
        part = MassIntegrals.of(Slices.up_to(end, self.link, e, lambda x: x * along))
        one, still = np.ones((1, self.q.shape[1])), np.zeros((1, self.q.shape[1]))
        found = rate_of_momentum(part, (one, still, still), moved, spread_loads(mechanism, self.rigid, name))
        found[len(along) :] -= moment_of(end * along, found[: len(along)])
        return found

    def _ends(self, e: int) -> tuple[np.ndarray, np.ndarray]:
        """Section forces inside the first and the second end of an element."""
        f, n = self.end_forces[e], self.link.dofs
        return -f[:n], f[n:]

    @cached_property
    def end_forces(self) -> np.ndarray:
        """Forces and moments on each element at its nodes, link axes, (elements, 2 dofs, n_times).

        The residual f = M q'' + C q' + K q - F of the element's equations with the terms kept by the run; K_s q only
        for the paper's frozen model. An axially rigid element also transmits axial forces.
        """
        every = slice(0, len(self.link.nodes) - 1)
        total = self.residuals_of(every) if self.residuals is None else self.residuals.copy()
        (first, *_), (second, *_), *_ = self.link.part.place.values()
        if first == second and self.model.balances:  # one axial displacement of all nodes
            tension = self._passed_on(total)
            total[:, 0] -= tension
            total[:, 3] += tension
        return total

    def _passed_on(self, residuals: np.ndarray) -> np.ndarray:
        """Tension of each element of an axially rigid link in addition to its residual, (elements, n_times).

        From the free ends to the node at the joint, every node is in equilibrium with element forces, loads and all
        that is fixed to it.
        """
        held = (node for name, node in self.model.interfaces.displaced if name == self.link.name)
        along, joint = self._summed(residuals)[:, 0], next(held, len(residuals))
        for (name, node), force in self.attached().items():
            if name == self.link.name:
                along[node] += self.rigid.frame(name).to_body(force[:2])[0]
        return np.concatenate([np.cumsum(along[:joint], 0), -np.cumsum(along[:joint:-1], 0)[::-1]])

    def residuals_of(self, elements: slice) -> np.ndarray:
        """Residual M q'' + C q' + K q - F of some elements, (elements, 6, n_times)."""
        q_rate, q_accel = self.balanced or (self.q_rate, self.q_accel)
        total = self.forces_of({"M": q_accel, "C": q_rate, "K": self.q}, elements)
        for (key, monomial), blocks in self._terms.items():
            if key == "F":
                total -= self.rigid.monomial(monomial) * blocks[elements]
        return total

    def forces_of(self, series: Mapping[str, np.ndarray], elements: slice) -> np.ndarray:
        """Sum of the matrices named by ``series`` times these nodal coordinates, (elements, 6, n_times)."""
        own = {key: self._of_elements(part, elements) for key, part in series.items()}
        total = np.zeros_like(next(iter(own.values())))
        for (key, monomial), blocks in self._terms.items():
            if key in own:
                part = blocks[elements] @ own[key]
                total += np.multiply(part, self.rigid.monomial(monomial), out=part) if monomial else part
        return total

    def _of_elements(self, coordinates: np.ndarray, elements: slice) -> np.ndarray:
        """Coordinates of the two nodes of some elements, (elements, 2 dofs, n_times)."""
        n = self.link.dofs
        return coordinates[n * np.arange(elements.start, elements.stop)[:, None] + np.arange(2 * n)]

    @cached_property
    def _terms(self) -> Mapping[tuple[str, Monomial], np.ndarray]:
        """Kept terms of M, C, K and F of the elements, material damping included; (elements, 6, 6 or 1) each."""
        kept = tuple(self._keeps(key, monomial) for key, monomial, _ in self.link.element_terms)
        return self.link.sums(kept, *self.model.rayleigh)

    def _keeps(self, key: str, monomial: Monomial) -> bool:
        options = self.model.options
        if not self.model.balances:  # matrices of another angle: only strains are valid
            return key == "K_s"
        if key == "K_d":
            return options.euler if spin_or_euler(monomial) == "euler" else options.spin
        return {"C_s": options.damping, "C_d": options.gyroscopic, "K_g": options.geometric}.get(key, True)


def follow(model: Model, rigid: RigidMotion, coordinates: Rates, L: Affine, inertial: bool = True) -> Rates:
    """Part coordinates q = L z, q' = L z' + L' z, q'' = L z'' + 2 L' z' + L'' z; each (rows of L, n_times).

    ``inertial``: whether q'' is needed; the motion has no L'' of springs.
    """
    z, v, _ = coordinates
    q, q_rate, q_accel = rigid.apply_each(L, coordinates)
    if model.options.convective and not model.scene.is_frame:
        of_z, of_v = rigid.apply_each(L.rate, (z, v))
        q_rate += of_z
        if inertial:
            q_accel += 2.0 * of_v + rigid.apply(L.rate.rate, z)
    return q, q_rate, q_accel


def as_balanced(
    model: Model, rigid: RigidMotion, coordinates: Rates, L: Affine, inertial: bool = True
) -> Rates:
    """Coordinates q, q', q'' as in the model's equations: quasi-static ones have no rates in the axes of the bodies,
    but the accelerations of :func:`relieved`."""
    if model.options.dynamics != "quasistatic":
        return follow(model, rigid, coordinates, L, inertial)
    z, basis = coordinates[0], model.modal_basis
    q = rigid.apply(L, z)
    r = relieved(model, rigid, z if basis is None else np.linalg.lstsq(basis, z, rcond=None)[0])
    return q, np.zeros_like(q), rigid.apply(L, r if basis is None else basis @ r)


def relieved(model: Model, rigid: RigidMotion, z: np.ndarray) -> np.ndarray:
    """Accelerations of the rigid-body modes that nothing holds, in a quasi-static solution z by inertia relief, (n,
    n_times): M r = F - K z of the equations that were solved, zero where K z = F."""
    load = rigid.column_of(model.kept["F"])
    left, found = load - rigid.apply(model.kept["K"], z), np.zeros_like(load)
    moves = abs(left).max(axis=0, initial=0.0) > _HELD * abs(load).max(initial=0.0)
    for k in np.flatnonzero(moves).tolist():
        found[:, k] = np.linalg.solve(as_array(rigid.taken(np.array([k])).first(model.kept["M"])), left[:, k])
    return found


def demanded(
    model: Model, rigid: RigidMotion, coordinates: Rates, placed: Placed, options: Options | None = None
) -> np.ndarray:
    """Forces that a part needs, on its coordinates: inertia, damping and stiffness less its loads, (size, n_times).

    ``options``: of the terms to include, if not those of the model.
    """
    part, L, options = placed.part, placed.L, options or model.options
    own = keep_terms(in_own_axes(part, options.convective, options.dynamics == "quasistatic"), options)
    total = -rigid.column_of(own["F"])
    if L.terms:
        q, q_rate, q_accel = as_balanced(model, rigid, coordinates, L, bool(own["M"].terms))
        for key, series in (("M", q_accel), ("C", q_rate), ("K", q)):
            total += rigid.apply(own[key], series)
    return total


def attached_forces(model: Model, rigid: RigidMotion, coordinates: Rates) -> dict[Site, np.ndarray]:
    """Forces and moments that all but links needs at each of its sites, (dofs, n_times) each."""
    found: dict[Site, np.ndarray] = {}
    for placed in model.placed if model.balances else ():
        needed = demanded(model, rigid, coordinates, placed)
        for site, rows in placed.at:
            found[site] = found.get(site, 0.0) + rigid.apply(rows.T, needed)
    return found


def deform(
    model: Model, rigid: RigidMotion, coordinates: Rates, name: str,
    attached: Callable[[], Mapping[Site, np.ndarray]] | None = None,
) -> Deformation:  # fmt: skip
    """Deformation of one link, with reduced coordinates expanded; ``attached`` as of :class:`Deformation`."""
    L, link = model.frame.maps[name], model.links[name]
    series = follow(model, rigid, coordinates, L)
    if model.options.dynamics == "quasistatic":
        series += as_balanced(model, rigid, coordinates, L)[1:]
    if name in model.bases:
        series = tuple(model.bases[name] @ part for part in series)
    q, q_rate, q_accel, *balanced = (link.at_nodes(part) for part in series)
    attached = attached or partial(attached_forces, model, rigid, coordinates)
    found = Deformation(model, link, rigid, q, q_rate, q_accel, attached, tuple(balanced) or None)
    return found if name not in model.bases else _with_static_share(found)


def _with_static_share(found: Deformation) -> Deformation:
    """Add the static contribution of truncated modes: the mode-acceleration method (Craig 1981, ch. 15).

    Otherwise the link's inner equations keep a residual r, which no joint reacts; K_s^-1 r balances it.
    """
    link, model = found.link, found.model
    elements = slice(0, len(link.nodes) - 1)
    found = replace(found, residuals=found.residuals_of(elements))
    residual = found.unbalanced()
    kept = set(model.parts[link.name].coordinates)
    inner = np.array([row for row, label in enumerate(link.part.coordinates) if label not in kept], int)
    stiffness = link.part.matrices["K_s"].value({})[inner][:, inner]
    share = np.zeros_like(residual)
    share[inner] = solve(stiffness, residual[inner])
    moved = link.at_nodes(share)
    return replace(found, q=found.q - moved, residuals=found.residuals - found.forces_of({"K": moved}, elements))
