"""Small elastic displacements about the rigid motion, for all presets but ``coupled``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, reduce
from typing import TYPE_CHECKING, cast

import numpy as np

from kaneflex.mechanism.body_frame import Rates
from kaneflex.mechanism.planar import GROUND
from kaneflex.mechanism.rigid_bodies import Site
from kaneflex.response.deformation import Deformation, attached_forces, deform, demanded, follow
from kaneflex.response.foreshortening import Displaced, displaced
from kaneflex.response.motion import Motion, Section, displacement_of_arm
from kaneflex.response.reactions import Solver, consistent_reactions, spatial_reactions

if TYPE_CHECKING:
    from kaneflex.fem.spatial_map import SpatialMap
    from kaneflex.multibody.model.spatial_elastic import DeformingKinematics


@dataclass(frozen=True, eq=False)
class ElasticMotion(Motion):
    """Rigid motion with elastic coordinates z, z', z'' about it, each (n, n_times)."""

    coordinates: Rates
    solver: Solver | None = field(default=None, kw_only=True)

    @property
    def has_rigid_forces(self) -> bool:
        """True if rigid forces are determined: not in a structure at rest, whose supports may be redundant."""
        return not self.model.scene.is_frame

    def taken(self, instants: np.ndarray) -> ElasticMotion:
        rigid = self.rigid.taken(instants)
        coordinates = tuple(part[:, instants] for part in self.coordinates)
        return replace(self, rigid=rigid, coordinates=coordinates, whole=self.whole or self)

    def displacement(self, body: str, at: tuple[float, ...] = (0.0, 0.0)) -> Rates:
        model = self.model
        if body in model.links:
            return displacement_of_arm(self._displaced.links[body].at(at[0]), (0.0, *at[1:]))
        if model.frame is None or body not in model.frame.bodies:
            return self._still()
        moved = follow(model, self.rigid, self._displaced.coordinates, model.frame.bodies[body])
        return displacement_of_arm(self._in_axes(body, moved) if self.rigid.freedoms == 3 else moved, at)

    def nodes(self, link: str, rate: int = 0) -> np.ndarray:
        """Same as :meth:`Motion.nodes`; ``rate`` 1: velocities."""
        found = self._deformed[link]
        return (found.q, found.q_rate)[rate]

    def reaction(self, name: str) -> np.ndarray:
        """Joint reaction; that of the rigid mechanism if the equations don't balance at every instant."""
        return self._exerted[name] if self.model.links and self.model.balances else super().reaction(name)

    def spring_tension(self, name: str) -> np.ndarray:
        spring, placed = self.model.scene.springs[name], self.model.sprung.get(name)
        if placed is None or not placed.L.terms:
            return super().spring_tension(name)
        material = self.model.options._replace(geometric=False)
        force = demanded(self.model, self.rigid, self.coordinates, placed, material)
        directed = spring.torsional_at is not None or spring.length or spring.damping
        return force[0] if directed else reduce(np.hypot, force[1:])

    def section(self, link: str, x: float, after: bool = False) -> Section:
        if link not in self.model.links:
            return super().section(link, x, after)
        return self._displaced.links[link].section(x, after)

    @cached_property
    def _deformed(self) -> Mapping[str, Deformation]:
        return {name: deform(self.model, self.rigid, self.coordinates, name, lambda: self._attached)
                for name in self.model.links}  # fmt: skip

    @cached_property
    def _attached(self) -> Mapping[Site, np.ndarray]:
        """Forces that all but links needs at its sites."""
        return attached_forces(self.model, self.rigid, self.coordinates)

    @cached_property
    def _displaced(self) -> Displaced:
        return displaced(self.model, self.rigid, self.coordinates, self._deformed, self.solver)

    @cached_property
    def _exerted(self) -> dict[str, np.ndarray]:
        """Forces of joints and drives, by the names of the rigid motion."""
        model, rigid, moved = self.model, self.rigid, self._displaced.links
        if rigid.freedoms == 3:
            return consistent_reactions(model, rigid, self._attached, moved, self.solver)
        needed: list[tuple[Site | str, np.ndarray]] = [*self._attached.items()]
        needed += [(site, self._deformed[site[0]].at_nodes[site[1]]) for site in model.interfaces.displaced]
        needed += [(name, demanded(model, rigid, self.coordinates, model.sprung[name]))
                   for name in self._map.joined.springs]  # fmt: skip
        return spatial_reactions(self._map, rigid, needed, self.solver)

    def change_of(self, name: str, freedom: str) -> Rates:
        """Change of the coordinate of a joint in space ("angle" or "position") by deformation, with rates, (n_times,)
        each."""
        from kaneflex.fem.spatial_joined import product

        joined, found = self._map.joined, np.zeros((3, len(self.times)))
        joint = joined.mechanism.joints[name]
        row = [move for move, _ in joint.moves].index(freedom) - len(joint.moves)
        for c, side in zip(joined.coefficients(self.rigid, joint, freedoms=True), joint.sides, strict=True):
            if side.body != GROUND:
                d = np.array(self.displacement(side.body, side.at)).transpose(0, 2, 1)[..., None]
                found = found + product(c[:, :, row, None], d)[:, :, 0, 0]
        return found[0], found[1], found[2]

    @property
    def _map(self) -> SpatialMap:
        """Map of the coordinates of a mechanism in space."""
        return cast("DeformingKinematics", self.model.motion).deforming.map
