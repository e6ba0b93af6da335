"""Choice of the independent speeds of a mechanism in space, from the scene and the rank of its constraints."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from kaneflex.mechanism.planar import GROUND
from kaneflex.mechanism.spatial import SpatialJoint
from kaneflex.multibody.model.codes import GIVEN, NAMED
from kaneflex.multibody.model.state import Choice
from kaneflex.multibody.model.system import System

_RANK = 1e-9
"""Share of the largest singular value below which a row is redundant."""


def given_speeds(system: System) -> dict[int, float]:
    """Initial speeds of free joints and bodies from the scene, by their numbers, at the position of ``work``."""
    found: dict[int, float] = {}
    number = {name: k for k, name in enumerate(system.layout.speeds)}
    for name, drive in system.mechanism.drives.items():
        if drive.kind != "free":
            continue
        joint = system.mechanism.joints[name]
        if drive.angular_velocity is not None:
            found |= dict(zip(system.speeds_of(name), _as_ball(system, joint, drive.angular_velocity), strict=True))
        elif joint.kind != "spherical":
            values = (drive.initial_speed,) if joint.freedoms == 1 else drive.initial_speeds or ()
            given = {f"{name}.{move}": value for (move, _), value in zip(joint.moves, values, strict=False)}
            found |= {number[each]: value for each, value in given.items() if each in number}
    for body, free in system.mechanism.frees.items():
        R = system.mechanism.bodies[body].rotation
        turn = R.T @ np.zeros(3) if free.angular_velocity is None else R.T @ np.asarray(free.angular_velocity)
        found |= dict(zip(system.speeds_of(body), [*[*free.velocity, 0.0][:3], *turn], strict=True))
    return found


def _as_ball(system: System, joint: SpatialJoint, omega: Sequence[float] | np.ndarray) -> np.ndarray:
    """Speeds of a ball from the angular velocity of a joint's second body against its first, in the second's axes.

    Where the tree goes from the second body to the first it is the opposite, in the first's.
    """
    if system.layout.tree[joint.name][1] > 0:
        return np.asarray(omega)
    first, second = _standing(system, joint)
    return -first.T @ second @ np.asarray(omega)


def _standing(system: System, joint: SpatialJoint) -> list[np.ndarray]:
    """Axes of a joint's bodies at the position of ``work``."""
    return [system.work.R[system.layout.node_of[side.body]] if side.body != GROUND else np.eye(3)
            for side in joint.sides]  # fmt: skip


def named_speeds(system: System) -> list[int]:
    """Numbers of the speeds of free joints, free bodies and shapes."""
    free = *system.mechanism.free_joints, *system.mechanism.floating
    return [*(k for name in free for k in system.speeds_of(name)),
            *system.engine.modal[1].tolist()]  # fmt: skip


def least_singular_values(system: System, positions: Iterable[np.ndarray], speeds: np.ndarray) -> np.ndarray:
    """Smallest singular value, at each of some positions, of the constraints by speeds, in the measures of both,
    without redundant rows."""
    sizes = [np.linalg.svd(system.jacobian(q)[:, speeds], compute_uv=False) for q in positions]
    rank = max(int((each > _RANK * each[:1]).sum()) for each in sizes)
    return np.array([each[rank - 1] if rank else 0.0 for each in sizes])


def choose(system: System, q: np.ndarray, prefer: bool = False) -> Choice:
    """Independent rows and speeds at a position; ``prefer``: named speeds are independent."""
    system.place(q)
    level = system.engine.levels.copy()
    if prefer:
        for speeds, later in ((named_speeds(system), NAMED), (list(given_speeds(system)), GIVEN)):
            level[speeds] = np.maximum(level[speeds], later)
    return system.engine.chosen_by(level)[0]


def choose_for_all(system: System, positions: np.ndarray) -> Choice:
    """Choice that is regular at several positions, if there is one, by QR with common pivots for all of them.

    Joints' speeds come first, then the most compliant shapes, in units of equal strain energy. Each pivot is the column
    that is largest where it is smallest.
    """
    first, free, modal = choose(system, positions[0], prefer=True), system.engine.open_speeds, system.engine.modal[1]
    stiffness = np.concatenate([np.zeros(0), *(np.diag(each.stiffness) for each in system.layout.shapes.values())])
    stiffness = np.maximum(stiffness, 1e-12 * stiffness.max(initial=1e-300))
    unit = np.ones(system.engine.size)
    size = system.mechanism.size / system.engine.measure[modal]
    unit[modal] = 1e-4 * np.sqrt(stiffness.min(initial=1.0) / stiffness) * size
    J = np.array([system.jacobian(q)[first.rows] * unit for q in positions])[:, :, free]
    dependent = list[int]()
    for _ in first.rows:
        sizes = np.linalg.norm(J, axis=1)
        pivot = int(sizes.min(axis=0).argmax())
        dependent.append(int(free[pivot]))
        q = J[:, :, pivot] / np.maximum(sizes[:, pivot], 1e-300)[:, None]
        J -= q[:, :, None] * np.einsum("pr,prs->ps", q, J)[:, None, :]
    return system.engine.choice_of(first.rows, np.array(dependent, np.int64))


def choose_anew(system: System, q: np.ndarray, choice: Choice) -> Choice:
    """Other speeds at a position if they keep the rank; else the given choice: near a singular position fewer rows
    would leave a freedom unconstrained."""
    other = choose(system, q)
    return other if len(other.rows) == len(choice.rows) and other.differs(choice) else choice
