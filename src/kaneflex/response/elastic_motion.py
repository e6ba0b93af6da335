"""Small elastic displacements about the rigid motion, for all presets but ``coupled``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, reduce
from typing import TYPE_CHECKING, cast

import numpy as np

from kaneflex.fem.assembly import Site
from kaneflex.mechanism.body_frame import Rates
from kaneflex.mechanism.planar import GROUND
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.multibody.model.bound_model import Model
from kaneflex.response.deformation import Deformation, attached_forces, deform, demanded, follow
from kaneflex.response.foreshortening import Displaced, displaced
from kaneflex.response.motion import Motion, Section, beside
from kaneflex.response.reactions import Solver, by_reflections, consistent_reactions

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
            return beside(self._displaced.links[body].at(at[0]), (0.0, *at[1:]))
        if model.frame is None or body not in model.frame.bodies:
            return self._still()
        moved = follow(model, self.rigid, self._displaced.coordinates, model.frame.bodies[body])
        return beside(self._in_axes(body, moved) if self.rigid.freedoms == 3 else moved, at)

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
        material = replace(self.model.options, geometric=False)
        force = demanded(self.model, self.rigid, self.coordinates, placed, material)
        directed = spring.torsional_at is not None or spring.length or spring.damping
        return force[0] if directed else reduce(np.hypot, force[1:])

    def _elastic_section(self, link: str, x: float, after: bool) -> Section:
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
        return consistent_reactions(self.model, self.rigid, self._attached, self._displaced.links, self.solver)


@dataclass(frozen=True, eq=False)
class SpatialElasticMotion(ElasticMotion):
    """Rigid motion in space with elastic coordinates about it; displacements have six components."""

    def change_of(self, name: str, freedom: str) -> Rates:
        """Change of a joint's coordinate ("angle" or "position") by deformation, with rates, (n_times,) each."""
        from kaneflex.fem.spatial_rates import product

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
        return cast("DeformingKinematics", self.model.motion).deforming.map

    @cached_property
    def _exerted(self) -> dict[str, np.ndarray]:
        """Forces of joints and drives.

        Multipliers balance every joint's node and every rigid body, whose own equations have their sum as residual.
        Redundant rows exert nothing; indeterminate reactions are reported when the scene is loaded.
        """
        joined, rigid, model = self._map.joined, self.rigid, self.model
        residual = np.zeros((len(rigid.times), joined.size), rigid.values.dtype)
        for name, node in model.interfaces.displaced:
            residual[:, joined.columns((name, node))] = self._deformed[name].at_nodes[node].T
        for site, force in self._attached.items():
            residual[:, joined.columns(site)] += force.T
        parting = joined.parting(rigid)[0]
        for name in joined.springs:
            first = joined.first[name] - joined.size
            force = demanded(model, rigid, self.coordinates, model.sprung[name])
            residual[:, joined.tied] += np.einsum("tki,kt->ti", parting[:, first : first + 4], force)
        J, where = joined.rows(rigid)
        rows, tied = self._map.rows, joined.tied
        scale = joined.measure[tied]
        solve = self.solver or by_reflections
        found = np.zeros_like(J[0][:, :, 0])
        found[:, rows] = solve((J[0][:, rows] * scale).transpose(0, 2, 1), residual[:, tied] * scale)
        exerted: dict[str, np.ndarray] = {}
        for name, own in where.items():
            wrench, drive = joined.exerted(rigid, name, found[:, own])
            parts = [f"{name}.{kind}_{axis}" for kind in ("force", "moment") for axis in "xyz"]
            exerted |= dict(zip(parts, wrench, strict=True))
            # a drive that leaves the elastic rotation free exerts nothing
            exerted[f"{name}.drive"] = np.zeros(len(rigid.times)) if drive is None else drive
        return exerted


def elastic_motion(
    model: Model, rigid: RigidMotion, coordinates: Rates, whole: Motion | None = None
) -> ElasticMotion:
    """Motion of a model of a one-way preset, in the plane or in space."""
    kind = SpatialElasticMotion if model.scene.is_spatial else ElasticMotion
    return kind(model, rigid, coordinates, whole=whole)
