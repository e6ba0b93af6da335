"""Joint reactions and drive torques consistent with the elastic motion.

Every interface node of an elastic link and every rigid body is in equilibrium: the residual of its equations is
balanced by the joints. The unknown joint forces follow from these equations; for a rigid model they are the multipliers
of the ``motion`` kernel.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.mechanism.joints import derivatives_of
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.parts import Joint
from kaneflex.mechanism.planar import GROUND, Number, Pose
from kaneflex.mechanism.rigid_bodies import Site
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.multibody.model.bound_model import Model
from kaneflex.response.deformation import Deformation

if TYPE_CHECKING:
    from kaneflex.fem.spatial_map import SpatialMap

Row = dict[int, float | np.ndarray]
"""Unknown -> its coefficient in an equation, constant or (n_times,)."""
Solver = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Function of A (n_times, n_rows, n) and b (n_times, n_rows) that returns x (n_times, n) with least |A x - b|."""


def by_reflections(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve by A = Q R, which does not square the condition number: a :data:`Solver`."""
    Q, R = np.linalg.qr(matrix)
    return np.linalg.solve(R, Q.transpose(0, 2, 1) @ right[..., None])[..., 0]


def least_squares(
    rows: Sequence[Row], right: np.ndarray, solver: Solver = by_reflections
) -> dict[int, np.ndarray]:
    """Unknowns x, (n_times,) each, with the least sum of squares of ``rows`` x - ``right``, (n_rows, n_times).

    An unknown that occurs in one equation only satisfies it exactly: both are eliminated first. For a chain of bodies
    this leaves little or nothing.
    """
    left, found = dict(enumerate(rows)), []
    while (pivot := _alone(left)) is not None:
        found.append((*pivot, left.pop(pivot[0])))
    solved = _together(left, right, solver)
    for row, unknown, coefficients in reversed(found):
        rest = right[row] - sum(a * solved[k] for k, a in coefficients.items() if k != unknown)
        solved[unknown] = rest / coefficients[unknown]
    return solved


def _alone(left: dict[int, Row]) -> tuple[int, int] | None:
    """An equation and an unknown that occurs in no other one, with a constant nonzero coefficient."""
    places: dict[int, list[int]] = {}
    for row, coefficients in left.items():
        for unknown in coefficients:
            places.setdefault(unknown, []).append(row)
    for unknown, where in places.items():
        value = left[where[0]][unknown]
        if len(where) == 1 and np.ndim(value) == 0 and value:
            return where[0], unknown
    return None


def _together(left: Mapping[int, Row], right: np.ndarray, solver: Solver) -> dict[int, np.ndarray]:
    """Least-squares solution of the remaining equations."""
    unknowns = sorted({unknown for coefficients in left.values() for unknown in coefficients})
    if not unknowns:
        return {}
    matrix = np.zeros((right.shape[1], len(left), len(unknowns)), right.dtype)
    for row, coefficients in enumerate(left.values()):
        for unknown, value in coefficients.items():
            matrix[:, row, unknowns.index(unknown)] = value
    return dict(zip(unknowns, solver(matrix, right[list(left)].T).T, strict=True))


def consistent_reactions(
    model: Model, rigid: RigidMotion, attached: Mapping[Site, np.ndarray], deformed: Mapping[str, Deformation],
    solver: Solver | None = None,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Solve the equilibrium of all interface nodes and rigid bodies for the reactions.

    ``attached``: forces of all but links, see :func:`kaneflex.response.deformation.attached_forces`.

    Returns
    -------
    dict
        Name of the reaction, as in the motion's scalars -> series (n_times,); forces act on the second body.
    """
    joints, drives = mechanism_of(model.scene).joints, model.scene.drives
    names = [f"{name}.{row}" for name, joint in joints.items() for row in joint.rows]
    names += [f"{name}.drive" for name in drives]
    sites: list[Site] = [(name, None) for name in model.scene.bodies if name not in deformed]
    sites += model.interfaces.displaced
    rows: list[Row] = [{} for _ in range(3 * len(sites))]
    right = np.zeros((len(rows), len(rigid.times)), rigid.values.dtype)
    # consistent, but more equations than unknowns: moments are divided by a length to weigh alike
    scale = 1.0 / max(body.length for body in model.scene.bodies.values() if body.length)
    for k, (name, node) in enumerate(sites):
        if node is not None:
            local = deformed[name].at_nodes[node]
            right[3 * k : 3 * k + 3] = *rigid.frame(name).to_global(local[:2]), local[2]
        right[3 * k : 3 * k + 3] += attached.get((name, node), 0.0)
    right[2::3] *= scale
    for name, joint in joints.items():
        own = [names.index(f"{name}.{row}") for row in (*joint.rows, *["drive"] * (name in drives))]
        for site, exerted in _exerted(rigid, deformed, joint, name in drives):
            for row, values in enumerate(exerted, 3 * sites.index(site)):
                weight = scale if row % 3 == 2 else 1.0
                rows[row] |= {k: weight * value for k, value in zip(own, values, strict=True) if np.any(value)}
    solved = least_squares(rows, right, solver or by_reflections)
    return {name: solved[k] for k, name in enumerate(names)}


def _exerted(
    rigid: RigidMotion, deformed: Mapping[str, Deformation], joint: Joint, driven: bool
) -> Iterator[tuple[Site, list[list[Number]]]]:
    """Global force x, y and moment by each of a joint's unit reactions on its sites, about these."""
    axes, sites, sides = {GROUND: Pose(0.0, 0.0, 1.0, 0.0)}, dict[str, Site](), []
    for side in joint.sides:
        if side.body != GROUND:
            frame, link = rigid.frame(side.body), deformed.get(side.body)
            x, y = frame.origin
            axes[side.body] = Pose(x, y, frame.c, frame.s)
            sites[side.body] = side.body, None if link is None else link.link.node_at(side.at[0])
            if link is not None:
                axes[side.body], side = axes[side.body].section(side.at), replace(side, at=(0.0, 0.0))
        sides.append(side)
    for body, exerted in derivatives_of(replace(joint, first=sides[0], second=sides[1]), axes, driven, sites):
        yield sites[body], exerted


def spatial_reactions(
    found: SpatialMap, rigid: RigidMotion, needed: Iterable[tuple[Site | str, np.ndarray]], solver: Solver | None
) -> dict[str, np.ndarray]:
    """The same in space, by multipliers of the rows of the joints; ``needed``: forces at sites, and of springs by name.

    Redundant rows exert nothing; indeterminate reactions are reported when the scene is loaded.
    """
    joined = found.joined
    residual = np.zeros((len(rigid.times), joined.size), rigid.values.dtype)
    parting = joined.parting(rigid)[0]
    for at, force in needed:
        if isinstance(at, str):
            first = joined.first[at] - joined.size
            residual[:, joined.tied] += np.einsum("tki,kt->ti", parting[:, first : first + 4], force)
        else:
            residual[:, joined.columns(at)] += force.T
    J, rows, scale = joined.rows(rigid, orders=1)[0], found.rows, joined.measure[joined.tied]
    multipliers = np.zeros_like(J[:, :, 0])
    solve = solver or by_reflections
    multipliers[:, rows] = solve((J[:, rows] * scale).transpose(0, 2, 1), residual[:, joined.tied] * scale)
    exerted: dict[str, np.ndarray] = {}
    for name, own in joined.where.items():
        wrench, drive = joined.exerted(rigid, name, multipliers[:, own])
        parts = [f"{name}.{kind}_{axis}" for kind in ("force", "moment") for axis in "xyz"]
        exerted |= dict(zip(parts, wrench, strict=True))
        # a drive that leaves the elastic rotation free exerts nothing
        exerted[f"{name}.drive"] = np.zeros(len(rigid.times)) if drive is None else drive
    return exerted
