"""Small elastic displacements about the rigid motion, for all presets but ``coupled``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import cast

import numpy as np

from kaneflex.mechanism.body_frame import Rates
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.multibody.model import Model
from kaneflex.response.deformation import Deformation, deform, follow
from kaneflex.response.foreshortening import Displaced, displaced
from kaneflex.response.least_squares import Solver
from kaneflex.response.motion import Motion, Section, beside_axis
from kaneflex.response.reactions import consistent_reactions, spring_tension


def elastic_motion(
    model: Model, rigid: RigidMotion, coordinates: Rates, whole: Motion | None = None
) -> ElasticMotion:
    """Motion of a model of a one-way preset, in the plane or in space."""
    if model.scene.is_spatial:
        from kaneflex.response.spatial_elastic_motion import SpatialElasticMotion

        return SpatialElasticMotion(model, rigid, coordinates, whole=whole)
    return ElasticMotion(model, rigid, coordinates, whole=whole)


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

    def displacement(self, body: str, at: tuple[float, float] = (0.0, 0.0)) -> Rates:
        model = self.model
        if body in model.links:
            return beside_axis(self._displaced.links[body].at(at[0]), at[1])
        if model.frame is None or body not in model.frame.bodies:
            return self._still()
        moved = follow(model, self.rigid, self._displaced.coordinates, model.frame.body_point(body, at))
        return self._in_axes(body, moved)

    def nodes(self, link: str, rate: int = 0) -> np.ndarray:
        """Same as :meth:`Motion.nodes`; ``rate`` 1: velocities."""
        found = self._deformed[link]
        return (found.q, found.q_rate)[rate]

    def reaction(self, name: str) -> np.ndarray:
        """Joint reaction; that of the rigid mechanism if the equations don't balance at every instant."""
        return self._reactions[name] if self.model.balances else self.rigid[name]

    def spring_tension(self, name: str) -> np.ndarray:
        return spring_tension(self.model, self.rigid, self.coordinates, name)

    def _elastic_section(self, link: str, x: float, after: bool) -> Section:
        return cast(Section, self._displaced.links[link].section(x, after))

    @cached_property
    def _deformed(self) -> Mapping[str, Deformation]:
        return {name: deform(self.model, self.rigid, self.coordinates, name) for name in self.model.links}

    @cached_property
    def _displaced(self) -> Displaced:
        return displaced(self.model, self.rigid, self.coordinates, self._deformed, self.solver)

    @cached_property
    def _reactions(self) -> dict[str, np.ndarray]:
        return consistent_reactions(self.model, self.rigid, self.coordinates, self._displaced.links, self.solver)
