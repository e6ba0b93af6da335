"""Statically indeterminate reactions of redundant constraints.

All joints' rows act on all bodies' speeds, including those of shapes, by the transposed Jacobian of the rows. A linear
combination of rows that acts on nothing can be added to the reactions without changing the motion: its members are
indeterminate.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kaneflex.mechanism.joints import coordinate, residuals
from kaneflex.mechanism.planar import Pose, pose_at
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.system import BODY, CoupledSystem
from kaneflex.scene import Scene
from kaneflex.scene.quantities import Address
from kaneflex.support.errors import SceneError

_STEP = 1e-30
"""Imaginary step: f(x + i h) = f(x) + i h f'(x) to machine precision (Squire & Trapp 1998, SIAM Review 40)."""
_NOTHING = 1e-7
"""Share of the largest singular value below which a combination of rows acts on nothing, and of a combination below
which a row is not a member."""


def jacobian(system: CoupledSystem, q: np.ndarray, free: Sequence[str] = ()) -> np.ndarray:
    """Derivatives of all ``reactions`` rows of a system with respect to the speeds of all bodies at a state q (size,).

    Then those of the coordinates of ``free`` drives.
    """
    system.fold(q, np.zeros_like(q))
    engine, mechanism = system.engine, system.mechanism
    engine.openings(0.0)  # computes W of the sections
    tables, sections, owners = engine.tables, engine.sections, engine.layout.bodies

    def share(key: tuple[str, str]) -> tuple[slice, np.ndarray] | None:
        k = engine.layout.sections[key]
        owner, _, first = tables.sections[k]
        if owner < 0:
            return None
        start, width = system.start[owners[owner]], BODY + int(tables.bodies[owner, at.SHAPES])
        first += engine.count(at.W_NOW)
        return slice(start, start + width), tables.w[first : first + 3 * width].reshape(3, width)

    row_of = {name: k for k, name in enumerate([*system.constraints, *(f"{name}.drive" for name in free)])}
    found = np.zeros((len(row_of), system.size))
    for joint in mechanism.joints.values():
        keys = [(side.body, side.name) for side in joint.sides]
        poses: list[Pose] = [pose_at(*sections[engine.layout.sections[key], :3].tolist()) for key in keys]
        names = [f"{joint.name}.{row}" for row in joint.rows]
        driven = f"{joint.name}.drive" in row_of
        for side, key in enumerate(keys):
            part = share(key)
            for k, moved in enumerate(poses[side].nudged(1j * _STEP)):
                both = (moved, poses[1]) if side == 0 else (poses[0], moved)
                values = (*residuals(joint, *both), *([coordinate(joint, *both)] * driven))
                for name, value in zip([*names, *[f"{joint.name}.drive"] * driven], values, strict=True):
                    if part is not None:
                        found[row_of[name], part[0]] += np.imag(value) / _STEP * part[1][k]
    return found


def undetermined(system: CoupledSystem, q: np.ndarray) -> tuple[str, ...]:
    """Names of a system's ``constraints`` with statically indeterminate reactions at a state."""
    rows = jacobian(system, q) * np.where([unit == "rad" for _, unit in system.coordinates], 1.0, system.mechanism.size)
    rows /= np.maximum(np.linalg.norm(rows, axis=1), 1e-300)[:, None]
    sums, sizes, _ = np.linalg.svd(rows)
    rank = int((sizes > _NOTHING * sizes.max(initial=0.0)).sum())
    open_rows = abs(sums[:, rank:]).max(axis=1, initial=0.0) > _NOTHING
    return tuple(name for name, is_open in zip(system.constraints, open_rows, strict=True) if is_open)


def check_sensors(scene: Scene, open_rows: tuple[str, ...]) -> None:
    """Raise SceneError if a sensor reads a statically indeterminate reaction.

    Raises
    ------
    SceneError
        Names the sensor, the reaction, and the redundant joints.
    """
    for name, sensor in scene.sensors.items():
        if sensor.kind in ("axial_force", "bending_moment", "shear_force", "strain"):
            assert isinstance(sensor.target, Address)
            body = sensor.target.body
            held = {row: scene.joints[row.rpartition(".")[0]] for row in open_rows}
            read = [row for row, joint in held.items() if body in (end.body for end in joint.addresses)]
        elif sensor.kind in ("joint_force", "drive_torque", "drive_force"):
            read = [row for row in open_rows if row.rpartition(".")[0] == sensor.target]
            if sensor.kind != "joint_force":
                read = [row for row in read if row.endswith(".drive")]
            elif sensor.component == "angle":
                read = [row for row in read if row.endswith(".moment")]
            else:
                own = f".force_{sensor.component}" if sensor.axes == "global" else ".force"
                read = [row for row in read if own in row or row.endswith(".normal")]
        else:
            continue
        if read:
            joints = list(dict.fromkeys(row.rpartition(".")[0] for row in open_rows))
            raise SceneError(
                f"sensors.{name}", str(sensor.target),
                f"{', '.join(joints)} have redundant constraints: "
                f"{', '.join(read)} is statically indeterminate between rigid bodies",
                "Leave out the sensor or one of these joints, or give one of the bodies a beam",
            )  # fmt: skip
