"""Where points of deformed bodies are: what joints, loads and drives of the coupled equations are written in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import sympy as sm

from kaneflex.derive.mechanism import Parameters
from kaneflex.mechanism.planar import GROUND, BodyPoint, Pose, Vector, pose_at


@dataclass(frozen=True)
class CoupledBody:
    """A body's equations in its own symbols; ``moves``: whether its start does in its frame."""

    name: str
    axial: int
    transverse: int
    moves: bool
    q: tuple[sm.Symbol, ...]
    v: tuple[sm.Symbol, ...]
    mass: sm.Matrix
    forcing: sm.Matrix
    weight: sm.Expr
    strain: sm.Expr
    dissipated: sm.Expr


class Places:
    """Points of the deformed bodies; ``number`` hands out the parameters of their shapes."""

    def __init__(self, bodies: Mapping[str, CoupledBody], number: Parameters) -> None:
        self._bodies, self._number = bodies, number

    def angle(self, point: BodyPoint) -> sm.Expr:
        """Rotation of the section at a point: phi + psi_k a_k."""
        if point.body == GROUND:
            return sm.S.Zero
        body = self._bodies[point.body]
        bent = body.q[3 + body.axial :]
        psi = f"bodies.{point.body}.points.{point.name}.psi"
        return body.q[2] + sum((self._number(f"{psi}_{k}", "1/m") * a for k, a in enumerate(bent)), sm.S.Zero)

    def place(self, point: BodyPoint) -> Vector:
        """Global position of a point; its start is the origin of a body's axes before it deforms."""
        along, across = point.at
        if point.body == GROUND:
            return along, across
        body = self._bodies[point.body]
        if len(body.q) > 3 and (body.moves or point.name != "start"):
            along, across = self._inside(body, f"bodies.{body.name}.points.{point.name}")
        return pose_at(*body.q[:3], sm.cos, sm.sin).place((along, across))

    def section(self, point: BodyPoint) -> Pose:
        """How the section at a point stands: where the point is, and the section's angle."""
        return pose_at(*self.place(point), self.angle(point), sm.cos, sm.sin)

    def _inside(self, body: CoupledBody, path: str, power: int = 0) -> Vector:
        """Coordinates of a point in its body's axes by its numbers' ``path``; ``power`` more metres in their units."""
        _, _, _, *modal = body.q
        stretched, bent = modal[: body.axial], modal[body.axial :]

        def shape(name: str, metres: int) -> sm.Symbol:
            unit = {-1: "1/m", 0: "1", 1: "m", 2: "m^2"}[metres + power]
            return self._number(f"{path}.{name}", unit)

        along = shape("X", 1) + sum((shape(f"s_{k}", 0) * b for k, b in enumerate(stretched)), sm.S.Zero)
        across = sum((shape(f"w_{k}", 0) * a for k, a in enumerate(bent)), sm.S.Zero)
        for j, a in enumerate(bent):
            along -= shape(f"H_{j}_{j}", -1) * a**2 / 2
            for k in range(j + 1, len(bent)):
                along -= shape(f"H_{j}_{k}", -1) * a * bent[k]
        return along, across

    def spread(self, load: str, body: str) -> Vector:
        """The places of all slices of a body, summed with the profile of a load: int p(X) (place) dX [m^2]."""
        own = self._bodies[body]
        x, y, phi, *_ = own.q
        share = self._number(f"loads.{load}.share", "m")
        inside = self._inside(own, f"loads.{load}", power=1)
        return pose_at(share * x, share * y, phi, sm.cos, sm.sin).place(inside)
