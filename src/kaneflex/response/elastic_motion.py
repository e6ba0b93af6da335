"""Small elastic displacements about the rigid motion, for all presets but ``coupled``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, reduce
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from kaneflex.fem.assembly import ElasticEquations, Placed
from kaneflex.fem.links import Part, with_rayleigh
from kaneflex.mechanism.affine import Affine
from kaneflex.mechanism.body_frame import Rates
from kaneflex.mechanism.planar import GROUND
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.multibody.model.bound_model import Model, keep_terms
from kaneflex.response.deformation import Deformation, as_balanced, deform, follow
from kaneflex.response.foreshortening import Displaced, displaced
from kaneflex.response.motion import Motion, Section, beside
from kaneflex.response.reactions import Solver, by_reflections, consistent_reactions, placed_spring, spring_push

if TYPE_CHECKING:
    from kaneflex.fem.coordinate_map import Frame
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
        return self._carried(model.frame, body, at)

    def _carried(self, frame: Frame, body: str, at: Any) -> Rates:
        """Displacement of a point of a carried rigid body."""
        moved = follow(self.model, self.rigid, self._displaced.coordinates, frame.body_point(body, at))
        return self._in_axes(body, moved)

    def nodes(self, link: str, rate: int = 0) -> np.ndarray:
        """Same as :meth:`Motion.nodes`; ``rate`` 1: velocities."""
        found = self._deformed[link]
        return (found.q, found.q_rate)[rate]

    def reaction(self, name: str) -> np.ndarray:
        """Joint reaction; that of the rigid mechanism if the equations don't balance at every instant."""
        return self._reactions[name] if self.model.balances else self.rigid[name]

    def spring_tension(self, name: str) -> np.ndarray:
        spring, placed = self.model.scene.springs[name], self._placed_spring(name)
        if placed is None:
            return self.rigid[f"{name}.{'tension' if spring.torsional_at is None else 'torque'}"]
        force = spring_push(self.model, self.rigid, self.coordinates, placed, geometric=False)
        directed = spring.torsional_at is not None or spring.length or spring.damping
        return -force[0] if directed else reduce(np.hypot, force[1:])

    def _placed_spring(self, name: str) -> Placed | None:
        """Spring as a part with its map L; None if its ends do not move by deformation."""
        return placed_spring(self.model, name)

    def _elastic_section(self, link: str, x: float, after: bool) -> Section:
        return self._displaced.links[link].section(x, after)

    @cached_property
    def _deformed(self) -> Mapping[str, Deformation]:
        return {name: deform(self.model, self.rigid, self.coordinates, name) for name in self.model.links}

    @cached_property
    def _displaced(self) -> Displaced:
        return displaced(self.model, self.rigid, self.coordinates, self._deformed, self.solver)

    @cached_property
    def _reactions(self) -> dict[str, np.ndarray]:
        return consistent_reactions(self.model, self.rigid, self.coordinates, self._displaced.links, self.solver)


@dataclass(frozen=True, eq=False)
class SpatialElasticMotion(ElasticMotion):
    """Rigid motion in space with elastic coordinates about it; displacements have six components."""

    def _carried(self, frame: Frame, body: str, at: Any) -> Rates:
        return beside(follow(self.model, self.rigid, self._displaced.coordinates, frame.bodies[body]), at)

    def reaction(self, name: str) -> np.ndarray:
        return self._exerted[name] if self.model.links else self.rigid[name]

    def _placed_spring(self, name: str) -> Placed | None:
        from kaneflex.fem.springs import torsion_part
        from kaneflex.multibody.model.spatial_elastic import part_of

        if not self.model.links:
            return None
        spring = self._map.joined.mechanism.springs[name]
        if spring.joint is None:
            return part_of(name, spring), self._ordered(self._map.of(name))
        return torsion_part(name, *spring.numbers[:2]), self._ordered(self._map.rotation(spring.joint))

    def change_of(self, name: str, freedom: str) -> Rates:
        """Change of a joint's coordinate ("angle" or "position") by deformation, with rates, (n_times,) each."""
        joined, none = self._map.joined, np.zeros(len(self.times))
        joint = joined.mechanism.joints[name]
        row = [move for move, _ in joint.moves].index(freedom) - len(joint.moves)
        found = [none, none, none]
        for c, side in zip(joined.coefficients(self.rigid, joint, freedoms=True), joint.sides, strict=True):
            if side.body != GROUND:
                c_0, c_1, c_2 = c[:, :, row].transpose(0, 2, 1)
                d, d_rate, d_accel = self.displacement(side.body, side.at)
                found[0] = found[0] + (c_0 * d).sum(axis=0)
                found[1] = found[1] + (c_1 * d + c_0 * d_rate).sum(axis=0)
                found[2] = found[2] + (c_2 * d + 2.0 * c_1 * d_rate + c_0 * d_accel).sum(axis=0)
        return found[0], found[1], found[2]

    @property
    def _map(self) -> SpatialMap:
        return cast("DeformingKinematics", self.model.motion).deforming.map

    def _ordered(self, L: Affine) -> Affine:
        """Matrix over the map's coordinates, reordered to the model's."""
        names = self._map.coordinates
        if self.model.frame is None or self.model.frame.coordinates == names:
            return L
        place = [names.index(name) for name in self.model.frame.coordinates]
        return L @ Affine.constant(np.eye(len(names))[:, place])

    @cached_property
    def _exerted(self) -> dict[str, np.ndarray]:
        """Forces of joints and drives, by the names of the rigid motion.

        Multipliers balance every joint's node and every rigid body, whose own equations have their sum as residual.
        Redundant rows exert nothing; indeterminate reactions are reported when the scene is loaded.
        """
        joined, rigid = self._map.joined, self.rigid
        residual = np.zeros((len(rigid.times), joined.size), rigid.values.dtype)
        for name, part in joined.parts.items():
            columns = slice(joined.first[name], joined.first[name] + part.size)
            if name in self.model.links:
                residual[:, columns] = self._of_link(name, part).T
            else:
                residual[:, columns] = self._of_body(name, part).T
        for name, (at, on_second) in self.model.scene.joint_torques.items():
            torque = on_second * self._torque(name)
            of = joined.mechanism.joints[at]
            for side, sign in zip(of.sides, (-1.0, 1.0), strict=True):
                point = joined.point(side)
                if point is not None:
                    stands = joined.mechanism.stands
                    axis = stands(side.body).T @ stands(of.sides[0].body) @ of.axes[0]
                    residual[:, point[0]] -= sign * torque[:, None] * (axis @ point[1][3:])
        parting = joined.parting(rigid)[0]
        for name in joined.springs:
            first = joined.first[name] - joined.size
            placed = self._placed_spring(name)
            assert placed is not None  # as links deform
            force = spring_push(self.model, rigid, self.coordinates, placed)
            residual[:, joined.tied] -= np.einsum("tki,kt->ti", parting[:, first : first + 4], force)
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

    def _torque(self, name: str) -> np.ndarray:
        """Torque of a load at a joint, or of a torsional spring against its joint's rotation."""
        spring = name.removesuffix(".torque")
        return self.spring_tension(spring) if spring in self.model.scene.springs else self.rigid[name]

    def _of_link(self, name: str, part: Part) -> np.ndarray:
        """Forces of the joints on a link's coordinates, (size, n_times), at the nodes of its part."""
        total, place = self._deformed[name].unbalanced(), self.model.links[name].part.place
        found = np.zeros((part.size, len(self.times)), total.dtype)
        for node, rows in part.place.items():
            found[list(rows)] = total[list(place[node])]
        return found

    def _of_body(self, name: str, part: Part) -> np.ndarray:
        """Forces of the joints on a rigid body's coordinates, (6, n_times)."""
        model, L = self.model, self._ordered(self._map.of(name))
        part = with_rayleigh(part, *model.rayleigh)
        own = keep_terms(ElasticEquations(part.coordinates, K_c=Affine.zero(6, 6), **part.matrices), model.options)
        q, q_rate, q_accel = as_balanced(model, self.rigid, self.coordinates, L)
        total = -self.rigid.column_of(own["F"])
        if not L.pattern().any():
            return total
        for key, series in (("M", q_accel), ("C", q_rate), ("K", q)):
            total += self.rigid.apply(own[key], series)
        return total


def elastic_motion(
    model: Model, rigid: RigidMotion, coordinates: Rates, whole: Motion | None = None
) -> ElasticMotion:
    """Motion of a model of a one-way preset, in the plane or in space."""
    kind = SpatialElasticMotion if model.scene.is_spatial else ElasticMotion
    return kind(model, rigid, coordinates, whole=whole)
