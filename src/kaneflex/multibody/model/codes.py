"""Codes of outcomes and choices, shared by compiled functions and Python."""

from __future__ import annotations

DONE, TOO_SMALL, SINGULAR, NO_CONVERGENCE, PAUSED, TURNED, CASCADE, RESTED, PARADOX, STRAYED = range(10)
"""Outcomes of a part of the integration: end reached; step too small; singular state; Newton's method fails in a fixed
step; step limit reached; change of the independent coordinates needed; endless sequence of contact changes; other
contacts at rest than before; no consistent stick or slip; loops closed on another branch."""
UNCLOSED, APART, MASSLESS, INFINITE, UNDECIDED, GROWN = range(1, 7)
"""Outcomes of an instant beside DONE; all but GROWN are failures."""
ON_LOOPS, NEAR_STATES, BESIDE, AHEAD = range(4)
"""Rows of the integration: with closed loops; near states; with independent coordinates and rates, and near dependent
coordinates; the same with dependent coordinates near those of the row before."""
REASONS = {
    UNCLOSED: "a loop does not close, or the position is singular",
    APART: "the loops close at the start only: redundant constraints are violated",
    MASSLESS: "the mass matrix is singular: a freedom carries no inertia",
    INFINITE: "the accelerations are not finite",
    UNDECIDED: "no combination of sticking and slipping is consistent with friction",
}
FIRST, NAMED, GIVEN, OF_SHAPE, PRESCRIBED = range(5)
"""Levels of coordinates: of joints to become dependent first, later, last; of shapes; of drives, never dependent."""
STIFF, DAMPED = 1.0, 2.0
"""Derivatives of loads and springs in the factors of a step: those by coordinates; those by speeds, too."""
FAR = 0.05
"""Largest step of a prescribed drive [rad, or sizes of the mechanism] in following loops."""
MOST_TURNED = 3.0
"""Largest rotation of a bushing [rad]: at half a turn the rotation vector jumps."""
NOTHING, FORCES, IMPULSES = range(3)
"""DECIDES: what rigid contacts exert while modes are decided; else they are constraints, or exert nothing."""


def check(outcome: int, *at: float) -> None:
    """Raise ArithmeticError for the failure of an instant."""
    if outcome != DONE:
        raise ArithmeticError(REASONS[outcome], *at)
