"""What should make a user doubt a result that came out without an error."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kaneflex.deformation import deform
from kaneflex.links import Link
from kaneflex.options import FIXED_STEP
from kaneflex.sampling import unseen
from kaneflex.solution import Solution
from kaneflex.stability.lost import lost_stiffness

FEWEST_STEPS = 10
"""Steps in a period of the lowest mode below which a run is said to be coarse."""
LARGEST_BEND = 0.1
"""Bending in a floating frame, as a share of a link's length, beyond which coupled equations are in doubt."""
LARGEST_ERROR = 0.01
"""Error allowed in a coupled run's steps, as a share of its largest deformation, beyond which that is in doubt."""
LARGEST_GAP = 1e-4
"""Share of the energy turned over that a run with free joints may lose or gain without a word."""
LARGEST_STRETCH = 0.05
"""Change of a link's length, as a share of it, beyond which small-displacement theory is in doubt."""
LARGEST_DEFLECTION = 0.05
"""Transverse displacement, as a share of a link's length, beyond which small-displacement theory is in doubt."""


def doubts(solution: Solution, frequencies: Sequence[float]) -> list[str]:
    """Warnings about a finished run: a step too long for its lowest mode, deflections too large for the theory."""
    model = solution.model
    found = []
    lowest = next((frequency for frequency in frequencies if frequency > 0.0), None)
    if lowest is not None and (model.options.dynamics == "dynamic" or solution.coupled is not None):
        found.extend(_coarse(solution, lowest))
    found.extend(unseen(model))
    if solution.coupled is not None:
        return [*found, *_of_coupled(solution)]
    if model.energy is not None and model.energy.drift > LARGEST_GAP:
        found.append(
            f"the energy balance of the rigid mechanism does not close: {model.energy.drift:.2g} of the energy turned "
            f"over is missing or too much; lower solve.forward.tolerance from {model.options.forward_tolerance:g}"
        )
    if len(solution.times):
        found.extend(lost_stiffness(model, solution.times))
    for name, link in model.links.items() if len(solution.times) else ():
        q = deform(model, solution.rigid, solution.coordinates, name).q
        found.extend(_stretched(name, link, q))
        largest = abs(q[1::3]).max()
        if largest > LARGEST_DEFLECTION * link.length:
            found.append(
                f"{name} moves across its axis by {largest / link.length:.0%} of its length: displacements are "
                "taken as small, so compare with a geometrically exact model"
            )
    return found


def _coarse(solution: Solution, lowest: float) -> list[str]:
    """A warning where a period of the lowest mode [Hz] has few steps, or few of the instants that are stored."""
    model = solution.model
    per_period = 1.0 / (lowest * model.step)
    if per_period >= FEWEST_STEPS:
        return []
    wanted = int(model.options.steps * FEWEST_STEPS / per_period) + 1
    if solution.coupled is not None and model.options.integrator != FIXED_STEP:
        return [
            f"{per_period:.2g} stored instants in a period of the lowest mode ({lowest:.4g} Hz): the run follows free "
            "vibrations between them, but neither its results nor their extremes show them; give solve.steps = "
            f"{wanted} or more"
        ]
    return [
        f"{per_period:.2g} steps in a period of the lowest mode ({lowest:.4g} Hz): free vibrations are not "
        f"resolved; give solve.steps = {wanted} or more, unless only the slow response matters"
    ]


def _of_coupled(solution: Solution) -> list[str]:
    """An energy balance that doesn't close, and bending that the second-order kinematics no longer describe."""
    motion, found = solution.coupled, []
    drift = motion.trajectory.energy.drift
    if drift > LARGEST_GAP:
        options = solution.model.options
        tighter = "" if options.integrator == FIXED_STEP else f"lower solve.tolerance from {options.tolerance:g}, or "
        found.append(
            f"the energy balance does not close: {drift:.2g} of the energy turned over is missing or too much; "
            f"{tighter}ask for more steps"
        )
    found.extend(_loose(solution))
    for name, series in solution.series.items():
        lost = ~np.isfinite(series.values)
        if lost.any():
            found.append(
                f"{name} has no value at {lost.sum()} of {len(lost)} instants, first at t = "
                f"{solution.times[lost.argmax()]:.6g} s: the deformed mechanism is then where the rigid one, which it "
                "is measured against, doesn't close"
            )
    for name, link in solution.model.links.items():
        found.extend(_stretched(name, link, motion.nodes(name)[0]))
        largest = abs(motion.nodes(name)[0][1::3]).max(initial=0.0)
        if largest > LARGEST_BEND * link.length:
            found.append(
                f"{name} bends out of its own axis by {largest / link.length:.0%} of its length: its shortening is "
                "complete to the second order only, so compare with a geometrically exact model"
            )
    return found


def _loose(solution: Solution) -> list[str]:
    """A warning where the error allowed in coupled steps is no small part of the largest deformation."""
    from kaneflex.coupled.simulation import longest

    model, motion = solution.model, solution.coupled
    if model.options.integrator == FIXED_STEP or motion.trajectory.steps == 0:
        return []
    allowed = model.options.tolerance * longest(model.scene)
    moved = (np.delete(motion.nodes(name)[0], np.s_[2::3], axis=0) for name in model.links)
    largest = max((abs(series).max() for series in moved), default=0.0)
    if allowed <= LARGEST_ERROR * largest or largest == 0.0:
        return []
    wanted = 0.1 * LARGEST_ERROR * largest / longest(model.scene)
    return [
        f"solve.tolerance = {model.options.tolerance:g} allows errors of {allowed:.2g} m where no link deforms by more "
        f"than {largest:.2g} m; lower it to {wanted:.0e} for the deformation and its forces"
    ]


def _stretched(name: str, link: Link, q: np.ndarray) -> list[str]:
    """A warning where a link's nodal coordinates, shape (3 n_nodes, n_times), change its length by far."""
    share = abs(q[-3] - q[0]).max(initial=0.0) / link.length
    if share <= LARGEST_STRETCH:
        return []
    return [
        f"{name} stretches by {share:.2g} of its length: strains are taken as small, so its forces and frequencies "
        "mean little"
    ]
