"""Joint forces in space, and which of them are statically indeterminate because of redundant constraints."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from kaneflex.mechanism.spatial_frame import cross
from kaneflex.multibody.dynamics.arrays import Instants
from kaneflex.multibody.model.determinacy import self_equilibrated, self_equilibrated_names
from kaneflex.multibody.model.spatial_system import SpatialSystem
from kaneflex.multibody.model.state import State
from kaneflex.support.kept import Kept

COMPONENTS = tuple(f"{part}_{axis}" for part in ("force", "moment") for axis in "xyz")
"""Components of a joint's force and moment, global."""


_TABLES: Kept[SpatialSystem, tuple[np.ndarray, np.ndarray]] = Kept()


def joint_tables(system: SpatialSystem) -> tuple[np.ndarray, np.ndarray]:
    """Rows of all joints, (n, 5), see :mod:`kaneflex.multibody.dynamics.spatial_unfolding`, and the places of their
    second points in the axes of the nodes that carry these, (n, 3)."""
    layout, rows, places = system.layout, list[tuple[int, ...]](), list[np.ndarray]()
    for name, joint in system.mechanism.joints.items():
        nodes, sign = layout.tree.get(name, ((-1,), 1))
        of_cut = layout.cuts.get(name, slice(0, 0))
        on, place = layout.on(joint.sides[1])
        rows.append((nodes[-1], sign, on, of_cut.start, of_cut.stop))
        places.append(place)
    return np.array(rows, np.int64).reshape(-1, 5), np.array(places, float).reshape(-1, 3)


def joint_wrenches(system: SpatialSystem, found: Instants) -> dict[str, np.ndarray]:
    """Force and moment, global, of every joint on its second body at its second point, (n_instants, 6)."""
    table, places = _TABLES.of(system, lambda: joint_tables(system))
    nodes, signs, on, *of_cut = table.T
    arms, held = found.r[:, nodes] - places, on >= 0
    turned = (found.R[:, on[held]] @ places[held][:, :, None])[..., 0]
    arms[:, held] = found.r[:, nodes[held]] - found.r[:, on[held]] - turned
    wrenches = np.where(nodes < 0, 0, signs)[:, None] * found.wrenches[:, nodes]
    wrenches[..., 3:] += cross(arms.T, wrenches[..., :3].T).T
    for k, rows in enumerate(map(slice, *of_cut)):
        wrenches[:, k] += (found.multipliers[:, None, rows] @ found.rows[:, rows, 9:15])[:, 0]
    return dict(zip(system.mechanism.joints, wrenches.swapaxes(0, 1), strict=True))


def open_reactions(system: SpatialSystem, states: Iterable[State]) -> frozenset[str]:
    """Names of the forces and moments of joints and drives that are statically indeterminate in some of the states."""
    found: set[str] = set()
    for state in states:
        for multipliers in without_work(system, state):
            wrenches = {name: each[0] for name, each in joint_wrenches(system, system.passed_on(multipliers)).items()}
            along = system.work.J[:, system.engine.prescribed].T @ multipliers
            found |= self_equilibrated_names(wrenches, dict(zip(system.driven, along, strict=True)))
    return frozenset(found)


def without_work(system: SpatialSystem, state: State) -> Iterator[np.ndarray]:
    """Self-equilibrated multipliers of redundant rows; ``work`` then has the state."""
    for combination in self_equilibrated(system.jacobian(state.q)[:, system.engine.open_speeds]).T:
        yield combination / system.row_measure
