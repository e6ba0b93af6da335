"""Determinacy: statically indeterminate reactions of redundant constraints, and freedoms without inertia.

Rows of the joints that close loops act on the speeds of the tree by the transposed Jacobian of the rows. A linear
combination of rows that acts on nothing can be added to the reactions without changing the motion: its members, and
the reactions of the tree's joints that balance it, are indeterminate.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.mechanism.parts import Joint
from kaneflex.mechanism.position_analysis import Placement
from kaneflex.multibody.model import layout as at
from kaneflex.scene import Scene
from kaneflex.scene.quantities import Address
from kaneflex.scene.sensors import DRIVE_KINDS, SECTION_KINDS, Sensor
from kaneflex.support.errors import SceneError

if TYPE_CHECKING:
    from kaneflex.multibody.model.state import State
    from kaneflex.multibody.model.system import CoupledSystem

_RANK, _NOTHING = 1e-9, 1e-7
"""Share of the largest singular value below which a combination of rows acts on nothing, and of the largest reaction
below which it has no share in one."""
_MASSLESS, _LENT = 1e-14, 1e-12
"""Share of the inertia of all bodies at a distance of the mechanism's size that counts as zero, and of the largest
inertia of a speed that counts as none."""


def _moved(arm: np.ndarray) -> np.ndarray:
    """Twist of a point by that of another one, ``arm`` away."""
    return np.array([[1.0, 0.0, -arm[1]], [0.0, 1.0, arm[0]], [0.0, 0.0, 1.0]])


def undetermined(system: CoupledSystem, state: State) -> tuple[str, ...]:
    """Names of a planar system's ``constraints`` with statically indeterminate reactions at a state.

    A combination of the cuts' rows that acts on no free coordinate is balanced by the joints of the tree.
    """
    engine, size, choice = system.engine, system.mechanism.size, system.choose(state)
    engine.openings(state.t)
    free, count = np.concatenate([choice.dependent, choice.independent]), engine.count(at.JOINT_ROWS)
    units = np.where(engine.sides[:count, :2].any(axis=1), size, 1.0)
    J = engine.numbers(at.GRADIENT, count * engine.size).reshape(count, engine.size) * engine.measure / units[:, None]
    combinations = self_equilibrated(J[:, free]).T
    rows = np.tile(engine.row(state.t), (1 + len(combinations), 1))
    first = engine.columns["reactions"].start
    rows[:, engine.columns["reactions"]] = 0.0
    rows[1:, first : first + count] = combinations / units
    exerted = system.unfold(rows).reactions * [size if unit == "N" else 1.0 for _, unit, _ in system.reactions]
    changes = abs(exerted[1:] - exerted[0]).max(axis=0, initial=0.0)
    open_rows = changes > _NOTHING * changes.max(initial=0.0)
    return tuple(name for name, is_open in zip(system.constraints, open_rows, strict=True) if is_open)


def self_equilibrated(rows: np.ndarray) -> np.ndarray:
    """Orthonormal combinations of rows (m, n) that act on nothing, (m, combinations); of the transposed Jacobian, its
    free motions."""
    sums, sizes, _ = np.linalg.svd(rows)
    return sums[:, int((sizes > _RANK * sizes.max(initial=0.0)).sum()) :]


def self_equilibrated_names(wrenches: Mapping[str, np.ndarray], drives: Mapping[str, np.ndarray]) -> set[str]:
    """Names of the forces, moments and drive forces that self-equilibrated multipliers exert: JOINT.force_x, ....

    A force or a moment counts with all its components, as those without a share depend on the position. ``wrenches``:
    force and moment of every joint (6,).
    """
    least = _NOTHING * max(abs(values).max(initial=0.0) for values in (*wrenches.values(), *drives.values()))
    found = {f"{name}.drive" for name, value in drives.items() if abs(value).max(initial=0.0) > least}
    for name, wrench in wrenches.items():
        for part, values in (("force", wrench[:3]), ("moment", wrench[3:])):
            if abs(values).max() > least:
                found |= {f"{name}.{part}_{axis}" for axis in "xyz"}
    return found


def _of_body(scene: Scene, sensor: Sensor) -> Iterator[str]:
    """All reactions of the joints of a section's body."""
    assert isinstance(sensor.target, Address)
    for name, joint in scene.joints.items():
        if sensor.target.body in (end.body for end in joint.addresses):
            yield f"{name}."


def check_sensors(
    scene: Scene, open_rows: Collection[str], sections: Callable[[Scene, Sensor], Iterator[str]] | None = _of_body
) -> None:
    """Check that no sensor reads a statically indeterminate reaction, JOINT.force_x and the like.

    ``sections``: reactions that a section force depends on, by the beginnings of their names.

    Raises
    ------
    SceneError
        Names the sensor, the reaction, and the redundant joints.
    """
    for name, sensor in scene.sensors.items():
        of_section = sections is not None and sensor.kind in SECTION_KINDS and isinstance(sensor.target, Address)
        parts = tuple(sections(scene, sensor) if sections and of_section else _of_joint(sensor))
        read = [row for row in sorted(open_rows) if row.startswith(parts)]
        if read:
            joints = ", ".join(dict.fromkeys(row.rpartition(".")[0] for row in sorted(open_rows)))
            raise SceneError(
                f"sensors.{name}.{sensor.kind}", str(sensor.target),
                f"{joints} have redundant constraints: {', '.join(read)} is statically indeterminate between rigid "
                "bodies",
                "Leave out the sensor or one of these joints, give one of the bodies a beam, or take a spherical joint "
                "instead of a revolute one",
            )  # fmt: skip


def _of_joint(sensor: Sensor) -> Iterator[str]:
    """Reactions that a sensor reads, by the beginnings of their names."""
    if sensor.kind in DRIVE_KINDS:
        yield f"{sensor.target}.drive"
    elif sensor.kind == "joint_force" and sensor.component.startswith("angle"):
        yield f"{sensor.target}.moment"
    elif sensor.kind == "joint_force":
        yield f"{sensor.target}.force" + (f"_{sensor.component}" if sensor.axes == "global" else "")
        yield f"{sensor.target}.normal"


def check_weighty(system: CoupledSystem, placement: Placement) -> None:
    """Check that the articulated inertia along the freedoms of the tree's joints is positive, without cuts.

    Bodies count as rigid here: articulated inertias (Featherstone 1983), each by the twist of its body's start.

    Raises
    ------
    SceneError
        Naming the body whose mass or moment of inertia is missing.
    """
    tables, layout = system.engine.tables, system.engine.layout
    owners = tables.sections[:, at.OWNER]
    inertias = [_inertia(tables.w[k : k + 4], placement.poses[body][2])
                for k, body in zip(tables.bodies[:, at.BLOCK], layout.bodies, strict=True)]  # fmt: skip
    least, size = _MASSLESS * sum(each[0, 0] for each in inertias), system.mechanism.size or 1.0
    units = np.array([1.0, 1.0, size])
    for b in range(len(inertias) - 1, -1, -1):
        (hung, child), row, own = layout.inboard[b], tables.bodies[b], inertias[b]
        here, parent = placement.poses[layout.bodies[b]], owners[row[at.PARENT]]
        if hung is None:
            if np.linalg.eigvalsh(own / np.outer(units, units))[0] <= least:
                raise _missing(layout.bodies[b], own, None)
            continue
        joint = system.mechanism.joints[hung]
        if joint.kind != "weld" and tables.plan[tables.plan[at.FREED] + row[at.FIRST]]:
            axis = _axis(joint, child, placement, here)
            resists = own @ axis
            if axis @ resists <= least * (size if joint.kind == "revolute" else 1.0) ** 2:
                raise _missing(layout.bodies[b], own, joint)
            own = own - np.outer(resists, resists) / (axis @ resists)
        if parent >= 0:
            inertias[parent] = inertias[parent] + _seen(own, here - placement.poses[layout.bodies[parent]])


def _inertia(moments: np.ndarray, phi: float) -> np.ndarray:
    """Inertia of a twist (v_x, v_y of a body's start, omega) by its mass, first moments and second about its start."""
    turn = np.array([[np.cos(phi), -np.sin(phi)], [np.sin(phi), np.cos(phi)]])
    mass, (x, y), second = moments[0], turn @ moments[1:3], moments[3]
    return np.array([[mass, 0.0, -y], [0.0, mass, x], [-y, x, second]])


def _seen(inertia: np.ndarray, away: np.ndarray) -> np.ndarray:
    """Inertia by the twist of another point, from which the first one is ``away``."""
    return np.asarray(_moved(away).T @ inertia @ _moved(away))


def _axis(joint: Joint, child: int, placement: Placement, here: np.ndarray) -> np.ndarray:
    """Twist of a body's start along the freedom of a pin or a guide."""
    if joint.kind == "revolute":
        side = joint.sides[child]
        x, y = placement.pose(side.body).place(side.at)
        return np.array([y - here[1], here[0] - x, 1.0])
    return np.array([*placement.pose(joint.first.body).turn(joint.direction), 0.0])


def _missing(body: str, inertia: np.ndarray, joint: Joint | None) -> SceneError:
    massless = inertia[0, 0] <= 0.0 or (joint is not None and joint.kind == "prismatic")
    what = "mass" if massless else "inertia"
    does = "moves" if massless else "turns"
    where = f"at {joint.name}" if joint is not None else "freely"
    return SceneError(
        f"bodies.{body}.{what}", 0,
        f"{body} {does} {where}: the mass matrix of preset coupled is singular, as neither it nor the bodies that it "
        f"carries have a {'mass' if massless else 'moment of inertia'} along that freedom",
        "Give it one, however small, or a length and a mass" if not massless else "Give it one, however small",
    )  # fmt: skip


def virtual_inertia(
    dependent: np.ndarray, M: np.ndarray, measure: np.ndarray, bodies: np.ndarray, free: np.ndarray
) -> np.ndarray:
    """Virtual inertia of dependent speeds whose pivot in a recursion over the tree would vanish, (s,).

    M: mass matrix; free: mask of speeds without drives. The recursion eliminates the outermost body first, of each its
    shapes, then its joint.
    """
    inertia = np.zeros(len(measure))
    A = M * np.outer(measure, measure)
    most = A.diagonal().max(initial=0.0)
    for body in bodies[::-1]:
        joint = range(body[at.FIRST], body[at.FIRST] + body[at.DOF])
        shapes = range(body[at.MODAL], body[at.MODAL] + body[at.SHAPES])
        for s in filter(free.__getitem__, (*shapes, *joint)):
            if A[s, s] <= _LENT * most and s in dependent:
                inertia[s], A[s, s] = most / measure[s] ** 2, A[s, s] + most
            if A[s, s] > 0.0:
                A = A - np.outer(A[:, s], A[s]) / A[s, s]
    return inertia
