"""The constraints of joints and drives in symbols: holonomic residuals whose multipliers are the reactions."""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sm

from kaneflex.mechanism.joints import coordinate, drive_reaction, reactions, residuals
from kaneflex.mechanism.parts import Joint
from kaneflex.mechanism.planar import Pose


@dataclass(frozen=True)
class Constraint:
    """Scalar equation residual(q, t) = 0 of a joint or a drive; its multiplier is a reaction with unit and meaning."""

    name: str
    unit: str
    meaning: str
    residual: sm.Expr

    @property
    def multiplier(self) -> sm.Symbol:
        return multiplier(self.name)


def multiplier(name: str) -> sm.Symbol:
    """The symbol of a reaction "<joint>.<row>"."""
    return sm.Symbol(name.replace(".", "_"))


def joint_constraints(joint: Joint, first: Pose, second: Pose) -> list[Constraint]:
    """Constraints of a joint between its two sections; a positive multiplier acts on the second body."""
    named = zip(reactions(joint), residuals(joint, first, second), strict=True)
    return [Constraint(*reaction, residual) for reaction, residual in named]


def drive_constraint(joint: Joint, first: Pose, second: Pose, angle: sm.Expr) -> Constraint:
    """Constraint of a drive on its joint's coordinate, prescribed as ``angle``."""
    return Constraint(*drive_reaction(joint), coordinate(joint, first, second) - angle)
