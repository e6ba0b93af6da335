"""Joint forces in space, and which of them are statically indeterminate because of redundant constraints."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from kaneflex.multibody.model.determinacy import self_equilibrated, self_equilibrated_names
from kaneflex.multibody.model.spatial_system import SpatialSystem
from kaneflex.multibody.model.state import State

COMPONENTS = tuple(f"{part}_{axis}" for part in ("force", "moment") for axis in "xyz")
"""Components of a joint's force and moment, global."""


def open_reactions(system: SpatialSystem, states: Iterable[State]) -> frozenset[str]:
    """Names of the forces and moments of joints and drives that are statically indeterminate in some of the states."""
    found: set[str] = set()
    for state in states:
        for multipliers in without_work(system, state):
            wrenches = system.passed_on(multipliers)
            along = system.work.J[:, system.engine.prescribed].T @ multipliers
            found |= self_equilibrated_names(wrenches, dict(zip(system.driven, along, strict=True)))
    return frozenset(found)


def without_work(system: SpatialSystem, state: State) -> Iterator[np.ndarray]:
    """Self-equilibrated multipliers of redundant rows; ``work`` then has the state."""
    for combination in self_equilibrated(system.jacobian(state.q)[:, system.engine.open_speeds]).T:
        yield combination / system.row_measure
