"""What should make a user doubt a result that came out without an error."""

from __future__ import annotations

from collections.abc import Sequence

from kaneflex.deformation import deform
from kaneflex.solution import Solution

FEWEST_STEPS = 10
"""Steps in a period of the lowest mode below which a run is said to be coarse."""
LARGEST_DEFLECTION = 0.05
"""Transverse displacement, as a share of a link's length, beyond which small-displacement theory is in doubt."""


def doubts(solution: Solution, frequencies: Sequence[float]) -> list[str]:
    """Warnings about a finished run: a step too long for its lowest mode, deflections too large for the theory."""
    model = solution.model
    found = []
    lowest = next((frequency for frequency in frequencies if frequency > 0.0), None)
    if lowest is not None and model.options.dynamics == "dynamic":
        per_period = 1.0 / (lowest * model.step)
        if per_period < FEWEST_STEPS:
            wanted = int(model.options.steps * FEWEST_STEPS / per_period) + 1
            found.append(
                f"{per_period:.2g} steps in a period of the lowest mode ({lowest:.4g} Hz): free vibrations are not "
                f"resolved; give solve.steps = {wanted} or more, unless only the slow response matters"
            )
    for name, link in model.links.items() if len(solution.times) else ():
        largest = abs(deform(model, solution.rigid, solution.coordinates, name).q[1::3]).max()
        if largest > LARGEST_DEFLECTION * link.length:
            found.append(
                f"{name} moves across its axis by {largest / link.length:.0%} of its length: displacements are "
                "taken as small, so compare with a geometrically exact model"
            )
    return found
