"""What joints exert in space, and what of it no equation determines: more rows hold a motion than it needs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from kaneflex.multibody.spatial_system import SpatialSystem, State
from kaneflex.support.kept import Kept

COMPONENTS = tuple(f"{part}_{axis}" for part in ("force", "moment") for axis in "xyz")
"""Of what a joint exerts, global."""
_NONE = 1e-7
"""Share of the largest below which a force that multipliers of no work exert counts as none."""


class _TreeJoints(NamedTuple):
    """Of every joint of the tree its last node, 1 or -1 (seen from its second body), and its second point: on which
    node (-1: the ground), and where in that node's axes, (n, 3)."""

    nodes: np.ndarray
    signs: np.ndarray
    on: np.ndarray
    at: np.ndarray


_TREE: Kept[SpatialSystem, _TreeJoints] = Kept()


def _tree_joints(system: SpatialSystem) -> _TreeJoints:
    layout = system.layout
    second = [system.mechanism.joints[name].sides[1] for name in layout.tree]
    return _TreeJoints(
        np.array([nodes[-1] for nodes, _ in layout.tree.values()], int),
        np.array([sign for _, sign in layout.tree.values()], float),
        np.array([layout.node_of.get(side.body, -1) for side in second], int),
        np.array([side.at for side in second], float).reshape(-1, 3),
    )


def joint_wrenches(system: SpatialSystem, wrenches: np.ndarray, multipliers: np.ndarray) -> dict[str, np.ndarray]:
    """Force and moment, global, of every joint on its second body at its second point, (6,), where ``work`` stands.

    ``wrenches`` (n_nodes, 6) and ``multipliers`` (n_rows,) as :meth:`SpatialSystem.exerted` gives them.
    """
    k, layout = system.work, system.layout
    of = _TREE.of(system, lambda: _tree_joints(system))
    wrench = of.signs[:, None] * wrenches[of.nodes]
    standing = of.on >= 0
    point = of.at.copy()
    point[standing] = k.r[of.on[standing]] + np.einsum("nij,nj->ni", k.R[of.on[standing]], of.at[standing])
    (x, y, z), (f_x, f_y, f_z) = (k.r[of.nodes] - point).T, wrench[:, :3].T
    wrench[:, 3:] += np.stack([y * f_z - z * f_y, z * f_x - x * f_z, x * f_y - y * f_x], axis=1)
    found = dict(zip(layout.tree, wrench, strict=True))
    found |= {name: multipliers[rows] @ k.rows[rows, 9:15] for name, rows in layout.cuts.items()}
    return {name: found[name] for name in system.mechanism.joints}


def open_reactions(system: SpatialSystem, states: Iterable[State]) -> frozenset[str]:
    """Names of the forces and moments of joints and drives that no equation determines at some of the states.

    A force or a moment is open with all its components: which of them an instant's combination of multipliers leaves
    out is how the mechanism stands there.
    """
    found: set[str] = set()
    for state in states:
        for multipliers in without_work(system, state):
            found |= _exerted_by(system, multipliers)
    return frozenset(found)


def without_work(system: SpatialSystem, state: State) -> Iterator[np.ndarray]:
    """Multipliers of the rows that move nothing, where more of them hold the mechanism than it needs; ``work`` then
    stands there."""
    from scipy.linalg import null_space

    J = system.jacobian(state.q)
    for combination in null_space(J[:, system.open_speeds].T, rcond=1e-9).T if len(J) else ():
        yield combination / system.row_measure


def _exerted_by(system: SpatialSystem, multipliers: np.ndarray) -> set[str]:
    """Names of what multipliers exert, where ``work`` stands."""
    wrenches = system.passed_on(multipliers)
    least = _NONE * max(abs(wrenches).max(), abs(multipliers).max())
    found: set[str] = set()
    for joint, values in joint_wrenches(system, wrenches, multipliers).items():
        for part, own in (("force", values[:3]), ("moment", values[3:])):
            if abs(own).max() > least:
                found |= {f"{joint}.{name}" for name in COMPONENTS if name.startswith(part)}
    along = system.work.J[:, system.driven_speeds].T @ multipliers
    return found | {f"{name}.drive" for name, value in zip(system.driven, along, strict=True) if abs(value) > least}
