"""Determinacy: statically indeterminate reactions of redundant constraints, and freedoms without inertia.

Rows of the joints that close loops act on the speeds of the tree by the transposed Jacobian of the rows. A linear
combination of rows that acts on nothing can be added to the reactions without changing the motion: its members, and
the reactions of the tree's joints that balance it, are indeterminate.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.multibody.model.state import Choice, State
from kaneflex.scene.quantities import Address
from kaneflex.scene.sensors import DRIVE_KINDS, SECTION_KINDS, Sensor
from kaneflex.support.errors import SceneError

if TYPE_CHECKING:
    from kaneflex.mechanism.position_analysis import Placement
    from kaneflex.multibody.engine import Engine
    from kaneflex.multibody.model.system import System

_RANK, _NOTHING = 1e-9, 1e-7
"""Share of the largest singular value below which a combination of rows acts on nothing, and of the largest reaction
below which it has no share in one."""
_MASSLESS = 1e-13
"""Inertia of a freedom, as a share of its own without others or of all bodies', below which it counts as zero."""


def undetermined(system: System, states: Iterable[State]) -> frozenset[str]:
    """Names of a system's ``constraints`` with statically indeterminate reactions in some of the states."""
    found, size = set[str](), system.mechanism.size
    for state in states:
        found |= with_shares(system.reactions, without_work(system, state), size, system.in_space)
    return frozenset(found)


def without_work(system: System, state: State) -> np.ndarray:
    """Forces of the joints and drives, as the record has them, by each self-equilibrated combination of the cuts' rows
    at a state, (combinations, forces); ``work`` then has the state.

    A combination of rows that acts on no free coordinate is balanced by the joints of the tree.
    """
    engine, forces = system.engine, system.record.forces
    engine.set(state)
    engine.openings(state.t)
    multipliers = self_equilibrated(engine.jacobian[:, engine.open_speeds]).T / engine.work.row_measure
    if not len(multipliers):
        return np.zeros((0, len(forces)))
    rows, columns = np.tile(engine.row(state.t), (1 + len(multipliers), 1)), engine.columns
    rows[:, columns["u"]] = rows[:, columns["du"]] = rows[:, columns["reactions"]] = 0.0
    first = columns["reactions"].start
    rows[1:, first : first + multipliers.shape[1]] = multipliers
    exerted = engine.unfold(rows)[:, forces]
    return exerted[1:] - exerted[0]


def self_equilibrated(rows: np.ndarray) -> np.ndarray:
    """Orthonormal combinations of rows (m, n) that act on nothing, (m, combinations); of the transposed Jacobian, its
    free motions. Raises SceneError for rows that are not finite."""
    if not np.isfinite(rows).all():
        raise SceneError("bodies", None, "lengths or distances are too large to be computed with", "Check their units")
    sums, sizes, _ = np.linalg.svd(rows)
    return sums[:, int((sizes > _RANK * sizes.max(initial=0.0)).sum()) :]


def with_shares(reactions: Sequence[Sequence[str]], forces: np.ndarray, size: float, in_space: bool) -> set[str]:
    """Names of the reactions that have a share in self-equilibrated forces (combinations, n); ``reactions``: name and
    unit of each.

    In space a force or a moment counts with all its components, as those without a share depend on the position.
    """
    names, units = ([each[k] for each in reactions] for k in range(2))
    shares = abs(forces) * [size if unit == "N" else 1.0 for unit in units]
    has = (shares > _NOTHING * shares.max(axis=1, initial=0.0, keepdims=True)).any(axis=0)
    parts = [name[:-2] if in_space and name[-2] == "_" else name for name in names]
    found = {part for part, one in zip(parts, has, strict=True) if one}
    return {name for name, part in zip(names, parts, strict=True) if part in found}


def check_bearings(system: System, state: State) -> None:
    """Check that friction depends on no statically indeterminate reaction. Raises SceneError."""
    mechanism = system.mechanism
    for forces in without_work(system, state) if mechanism.frictions else ():
        unit, joints = np.repeat([1.0, 1.0 / mechanism.size], 3), mechanism.joints
        wrenches = dict(zip(joints, forces[: 6 * len(joints)].reshape(-1, 6), strict=True))
        least = _NOTHING * max(abs(unit * wrench).max() for wrench in wrenches.values())
        for name, friction in mechanism.frictions.items():
            if name not in mechanism.joints:
                continue  # of a contact
            joint, arm = mechanism.joints[name], friction.arm
            on = system.layout.node_of.get(joint.sides[0].body)
            along = joint.axes[0] if on is None else system.work.R[on] @ joint.axes[0]
            force, moment = (part - along * (along @ part) for part in np.split(unit * wrenches[name], 2))
            borne = force if not (joint.slides and arm) else np.append(force, moment)
            if (friction.mu or friction.mu_static) and abs(borne).max() > least:
                raise SceneError(
                    f"joints.{name}.friction", None,
                    "redundant constraints leave the reaction across the joint's axis statically indeterminate, "
                    "and with it the friction",
                    "Use joints with more freedoms in its loop, like spherical ones, or give a preload alone",
                )  # fmt: skip


def _of_body(system: System, sensor: Sensor) -> Iterator[str]:
    """All reactions of the joints of a section's body."""
    assert isinstance(sensor.target, Address)
    for name, joint in system.mechanism.joints.items():
        if sensor.target.body in (side.body for side in joint.sides):
            yield f"{name}."


def check_sensors(
    system: System, sensors: Mapping[str, Sensor], open_rows: Collection[str],
    sections: Callable[[System, Sensor], Iterator[str]] | None = _of_body
) -> None:
    """Check that no sensor reads a statically indeterminate reaction, JOINT.force_x and the like.

    ``sections``: reactions that a section force depends on, by the beginnings of their names.

    Raises
    ------
    SceneError
        Names the sensor, the reaction, and the redundant joints.
    """
    for name, sensor in sensors.items():
        of_section = sections is not None and sensor.kind in SECTION_KINDS and isinstance(sensor.target, Address)
        parts = tuple(sections(system, sensor) if sections and of_section else _of_joint(sensor))
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


def check_freedoms(system: System, placement: Placement) -> None:
    """Check that every freedom of a planar mechanism moves some inertia at the start of its bodies."""
    mechanism = system.mechanism
    q = np.concatenate([placement.poses[body] for body in mechanism.bodies])[None]
    (state,) = system.undeformed(np.zeros(1), q, 0.0 * q)
    check_inertia(system.engine, system.engine.chosen_at(state), mechanism.floating, mechanism.drives)


def check_inertia(engine: Engine, choice: Choice, owners: Collection[str], drives: Collection[str]) -> None:
    """Check that every freedom of the joints moves some inertia, at the current position of an engine.

    ``owners``: bodies that move freely; ``drives``: joints with a drive.
    """
    joints = ~engine.shapes[choice.independent]
    if not joints.any():
        return
    B, M = engine.basis(choice)[joints], engine.mass()
    unit = engine.measure[choice.independent[joints]][:, None]
    reduced, least = (unit * B) @ M @ (unit * B).T, _MASSLESS * engine.masses.sum() * engine.measure.max() ** 2
    if not np.isfinite(reduced).all():  # the run reports loads without values
        return
    own = 1.0 / np.sqrt(np.maximum(reduced.diagonal(), max(least, 1e-300)))
    inertia, motions = np.linalg.eigh(reduced * np.outer(own, own))
    if inertia[0] > _MASSLESS:
        return
    moving = abs((motions[:, 0] * own @ (unit * B)) / engine.measure)
    name = engine.layout.speeds[int(moving.argmax())]
    owner = name.rpartition(".")[0]
    table = "drives" if owner in drives else "joints" if owner in engine.layout.tree else "bodies"
    key = f"bodies.{owner}.free" if owner in owners else f"{table}.{owner}"
    raise SceneError(
        key, None, f"the mass matrix is singular: {name} carries no inertia",
        "Give the bodies that move with it a mass and an inertia, however small, or prescribe it",
    )  # fmt: skip
