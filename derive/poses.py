"""Where a body stands, in symbols."""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sm

from kaneflex.derive.mechanism import BodyPoint, Vector


@dataclass(frozen=True)
class Pose:
    """Global position of a body's start and the direction cosines of its x axis."""

    x: sm.Expr
    y: sm.Expr
    c: sm.Expr
    s: sm.Expr

    def turn(self, vector: Vector) -> Vector:
        return self.c * vector[0] - self.s * vector[1], self.s * vector[0] + self.c * vector[1]

    def place(self, point: BodyPoint) -> Vector:
        dx, dy = self.turn(point.at)
        return self.x + dx, self.y + dy
