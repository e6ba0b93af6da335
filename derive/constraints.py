"""The constraints of joints and drives in symbols: holonomic residuals whose multipliers are the reactions."""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sm

from kaneflex.mechanism.joints import coordinate, residuals
from kaneflex.mechanism.parts import Joint
from kaneflex.mechanism.planar import Pose

_REACTIONS = {
    "force_x": ("N", "force {on}, global x"),
    "force_y": ("N", "force {on}, global y"),
    "normal": ("N", "force {on}, normal to the guide"),
    "moment": ("N m", "moment {on}"),
}
"""Row of a joint -> unit and meaning of its multiplier."""


@dataclass(frozen=True)
class Constraint:
    """A scalar equation residual(q, t) = 0 of a joint or a drive; its multiplier is a reaction with unit and meaning.

    ``rate`` and ``acceleration`` are the residual's partial derivatives in time, where q does not hold the time.
    """

    name: str
    unit: str
    meaning: str
    residual: sm.Expr
    rate: sm.Expr = sm.S.Zero
    acceleration: sm.Expr = sm.S.Zero

    @property
    def multiplier(self) -> sm.Symbol:
        return multiplier(self.name)


def multiplier(name: str) -> sm.Symbol:
    """The symbol of a reaction "<joint>.<row>"."""
    return sm.Symbol(name.replace(".", "_"))


def joint_constraints(joint: Joint, first: Pose, second: Pose) -> list[Constraint]:
    """What a joint demands of the two sections that it holds; a positive multiplier acts on the second body."""
    on, found = f"on {joint.second.body} by {joint.first.body}", []
    for row, residual in zip(joint.rows, residuals(joint, first, second), strict=True):
        unit, meaning = _REACTIONS[row]
        found.append(Constraint(f"{joint.name}.{row}", unit, meaning.format(on=on), residual))
    return found


def drive_constraint(
    joint: Joint, first: Pose, second: Pose, angle: sm.Expr, speed: sm.Expr = sm.S.Zero, acceleration=sm.S.Zero
) -> Constraint:
    """What a drive demands of its joint, whose coordinate is to be ``angle`` with these rates."""
    unit, meaning = ("N", "force") if joint.slides else ("N m", "torque")
    residual = coordinate(joint, first, second) - angle
    return Constraint(f"{joint.name}.drive", unit, f"{meaning} of the drive", residual, -speed, -acceleration)
