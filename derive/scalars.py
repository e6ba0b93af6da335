"""Scalars of the motion: what the rigid stage hands to the elastic stage and to the sensors."""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sm


@dataclass(frozen=True)
class Scalar:
    """One scalar of the motion: name, unit, meaning, and its expression (a number where the scene fixes it)."""

    name: str
    unit: str
    meaning: str
    value: sm.Expr
