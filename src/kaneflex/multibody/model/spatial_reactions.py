"""Joint forces in space, and which of them are statically indeterminate because of redundant constraints."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from kaneflex.multibody.dynamics.spatial_work import Instants
from kaneflex.multibody.model.determinacy import self_equilibrated, self_equilibrated_names
from kaneflex.multibody.model.spatial_system import SpatialSystem
from kaneflex.multibody.model.state import State
from kaneflex.support.kept import Kept

COMPONENTS = tuple(f"{part}_{axis}" for part in ("force", "moment") for axis in "xyz")
"""Components of a joint's force and moment, global."""


class _TreeJoints(NamedTuple):
    """Joints of the tree: their last nodes, 1 or -1 (if traversed from the second body), and second points: node (-1:
    the ground), and place in that node's axes, (n, 3)."""

    nodes: np.ndarray
    signs: np.ndarray
    on: np.ndarray
    at: np.ndarray


_TREE: Kept[SpatialSystem, _TreeJoints] = Kept()


def _tree_joints(system: SpatialSystem) -> _TreeJoints:
    layout = system.layout
    second = [layout.on(system.mechanism.joints[name].sides[1]) for name in layout.tree]
    return _TreeJoints(
        np.array([nodes[-1] for nodes, _ in layout.tree.values()], int),
        np.array([sign for _, sign in layout.tree.values()], float),
        np.array([node for node, _ in second], int),
        np.array([at for _, at in second], float).reshape(-1, 3),
    )


def joint_wrenches(system: SpatialSystem, found: Instants) -> dict[str, np.ndarray]:
    """Force and moment, global, of every joint on its second body at its second point, (n_instants, 6)."""
    of = _TREE.of(system, lambda: _tree_joints(system))
    wrenches = of.signs[:, None] * found.wrenches[:, of.nodes]
    arms = found.r[:, of.nodes] - of.at
    held = of.on >= 0
    on = of.on[held]
    arms[:, held] = found.r[:, of.nodes[held]] - found.r[:, on] - (found.R[:, on] @ of.at[held][:, :, None])[..., 0]
    wrenches[..., 3:] += cross(arms, wrenches[..., :3])
    by_name = {name: wrenches[:, k] for k, name in enumerate(system.layout.tree)}
    for name, rows in system.layout.cuts.items():
        by_name[name] = by_name.get(name, 0.0) + (found.multipliers[:, None, rows] @ found.rows[:, rows, 9:15])[:, 0]
    return {name: by_name[name] for name in system.mechanism.joints}


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a x b along the last axis: NumPy's own takes several times as long."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., i] = a[..., j] * b[..., k] - a[..., k] * b[..., j]
    return out


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
