"""Where points of deformed bodies are: what joints, loads and drives of the coupled equations are written in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import sympy as sm

from kaneflex.derive.mechanism import GROUND, BodyPoint, JointModel, Parameters, Vector


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
        x, y, phi, *modal = body.q
        if modal and (body.moves or point.name != "start"):
            along, across = self._inside(body, f"bodies.{body.name}.points.{point.name}")
        c, s = sm.cos(phi), sm.sin(phi)
        return x + c * along - s * across, y + s * along + c * across

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
        along, across = self._inside(own, f"loads.{load}", power=1)
        c, s = sm.cos(phi), sm.sin(phi)
        return share * x + c * along - s * across, share * y + s * along + c * across

    def direction(self, point: BodyPoint, inside: Vector) -> Vector:
        """Global components of a direction fixed in the section at a point."""
        angle = self.angle(point)
        c, s = sm.cos(angle), sm.sin(angle)
        return c * inside[0] - s * inside[1], s * inside[0] + c * inside[1]

    def gap(self, joint: JointModel) -> Vector:
        first, second = self.place(joint.first), self.place(joint.second)
        return second[0] - first[0], second[1] - first[1]

    def turn(self, joint: JointModel) -> sm.Expr:
        return self.angle(joint.second) - self.angle(joint.first)

    def coordinate(self, joint: JointModel) -> sm.Expr:
        """Coordinate of a joint: its angle [rad], or its slide along the guide [m]."""
        if joint.kind != "prismatic":
            return self.turn(joint)
        t, gap = self.direction(joint.first, joint.direction), self.gap(joint)
        return t[0] * gap[0] + t[1] * gap[1]
