"""Coupled motion of deforming bodies in space: their axes, and their shapes in these."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import cast

import numpy as np

from kaneflex.mechanism.body_frame import Rates
from kaneflex.mechanism.planar import GROUND
from kaneflex.mechanism.spatial import Side
from kaneflex.multibody.model.coordinate_rates import rates_of
from kaneflex.multibody.model.spatial_coupled import CoupledKinematics
from kaneflex.multibody.time.spatial_motion import SpatialMotion
from kaneflex.response.motion import Motion, Section
from kaneflex.response.section_forces import LinkForces
from kaneflex.response.spatial_dalembert import SpatialBalance
from kaneflex.scene.quantities import Address


@dataclass(frozen=True, eq=False)
class SpatialCoupledMotion(Motion):
    """Coupled motion in space. ``rigid`` holds the body axes in which shapes are measured; displacements of sensors
    are relative to the rigid mechanism, see :meth:`from_rigid`."""

    @property
    def coordinates(self) -> Rates:  # type: ignore[override]
        """Amplitudes of all shapes."""
        none = np.zeros((0, len(self.times)))
        parts = [(none, none, none), *map(self.modal, self._moving.system.layout.shapes)]
        return cast(Rates, tuple(np.concatenate(part) for part in zip(*parts, strict=True)))

    @property
    def state(self) -> tuple[np.ndarray, np.ndarray]:
        system, curve = self._moving.system, cast(CoupledKinematics, self._moving.motion).curve
        found = system.instants(curve.rows(self.times))
        return found.q.T, rates_of(system.engine, found.q, found.u).T

    def modal(self, body: str) -> Rates:
        return self._moving.modal(body)

    def taken(self, instants: np.ndarray) -> SpatialCoupledMotion:
        return replace(self, rigid=self.rigid.taken(instants), whole=self.whole or self)

    def displacement(self, body: str, at: tuple[float, ...] = (0.0, 0.0, 0.0)) -> Rates:
        """Displacement of a point in its body's axes, and its section's rotation relative to them, whose rates are
        angular velocities."""
        if body not in self._moving.system.layout.shapes:
            return self._still()
        found = self._moving.deformed(Side(body, at))
        angles = rotation_vector(found.turned)
        return cast(Rates, tuple(
            np.vstack([moved, turned])
            for moved, turned in zip(found.moved, (angles, *found.turning), strict=True)
        ))  # fmt: skip

    def from_rigid(self, address: Address, displacement: Callable[[Address], Rates]) -> np.ndarray:
        body, at = address.body, self.model.scene.point(address)
        frame, (section, side) = self.beside.frame(body), self._moving.section_frame(Side(body, at))
        apart = frame.to_body(section.place(side.at) - frame.place(np.asarray(at)))
        turned = np.einsum("jit,jkt->ikt", frame.axes, section.axes)
        return np.vstack([apart, rotation_vector(turned)])

    def seen_from(self, body: str, vector: np.ndarray) -> np.ndarray:
        deforms = body != GROUND and self.model.scene.bodies[body].deforms
        return (self.beside if deforms else self.rigid).frame(body).to_body(vector)

    @cached_property
    def beside(self) -> SpatialMotion:  # type: ignore[override]
        """Rigid mechanism at these instants."""
        return cast(CoupledKinematics, self._moving.motion).rigid.at(self.times)

    def reaction(self, name: str) -> np.ndarray:
        return self.rigid[name]

    def spring_tension(self, name: str) -> np.ndarray:
        between = self.model.scene.springs[name].torsional_at is None
        return self.rigid[f"{name}.{'tension' if between else 'torque'}"]

    def section(self, link: str, x: float, after: bool = False) -> Section:
        return self._elastic_section(link, x, after) if link in self._balances else self.rigid_section(link, x, after)

    def _elastic_section(self, link: str, x: float, after: bool) -> Section:
        return self._balances[link].section(x, after)

    @cached_property
    def _balances(self) -> dict[str, SpatialBalance]:
        moving = self._moving
        forces = LinkForces(moving.system.scene, moving, moving.section_frame)
        bodies = moving.system.layout.shapes
        return {body: SpatialBalance(moving, body, partial(forces.wrenches, body)) for body in bodies}

    @property
    def _moving(self) -> SpatialMotion:
        return cast(SpatialMotion, self.rigid)


def rotation_vector(turned: np.ndarray) -> np.ndarray:
    """Rotation vectors [rad] of rotation matrices (3, 3, n), (3, n), with angles up to pi."""
    from scipy.spatial.transform import Rotation

    found = np.full((3, turned.shape[2]), np.nan)
    known = np.isfinite(turned).all(axis=(0, 1))
    if known.any():
        found[:, known] = Rotation.from_matrix(turned[:, :, known].transpose(2, 0, 1)).as_rotvec().T
    return found
