"""Initial state of a mechanism in space, and the choice of its independent speeds, from the scene and the rank of its
constraints."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from kaneflex.mechanism.closure import changed_speed
from kaneflex.mechanism.planar import GROUND
from kaneflex.mechanism.spatial import SpatialJoint
from kaneflex.mechanism.springs import points_meet
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.assembly import rigid_system
from kaneflex.multibody.model.codes import GIVEN, NAMED
from kaneflex.multibody.model.determinacy import check_inertia, self_equilibrated
from kaneflex.multibody.model.state import Choice, State
from kaneflex.multibody.model.system import System
from kaneflex.multibody.model.tree_layout import COORDINATE
from kaneflex.scene.parts import START_SPEEDS
from kaneflex.support.errors import SceneError

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


def start_of(system: System) -> State:
    """Initial state: drives at their initial positions, loops closed, speeds as given.

    Raises
    ------
    SceneError
        If a loop can't close, drives contradict the loops, a freedom is not named, or has no inertia.
    """
    if len(system.engine.frictions):
        return _in_loops(system)
    q = system.at_zero.copy()
    q[system.columns(system.driven, COORDINATE)] = system.courses(0.0)[:, 0]
    choice = choose(system, q, prefer=True)
    _check_drives(system, choice)
    if not system.close(q, choice):
        system.close(q, choose(system, q))
    _check_closing(system, q)
    _check_free(system, q)
    _check_springs(system)
    choice = choose(system, q, prefer=True)
    _check_named(system, choice)
    given, u = given_speeds(system), np.zeros(system.engine.size)
    for k in choice.independent:
        u[k] = given.get(int(k), 0.0)
    try:
        state = system.project(0.0, q, u, choice)
    except ArithmeticError as reason:
        check_inertia(system.engine, choice, system.mechanism.floating, system.mechanism.drives)
        raise SceneError(
            "drives", None, f"at the start {reason}", "Start at another position, or check the laws of loads"
        ) from None
    check_inertia(system.engine, choice, system.mechanism.floating, system.mechanism.drives)
    _check_speeds(system, state)
    return state


def _in_loops(system: System) -> State:
    """The same with joints with friction, which close loops, from the state where they are joints of the tree."""
    from scipy.spatial.transform import Rotation

    other = rigid_system(system.mechanism, system.module, system.parameters, coupled=system.coupled, rubs=False)
    state, work, (own, known) = start_of(other), other.work, (system.layout, other.layout)
    positions = dict(zip((name for name, _ in known.positions), state.q.tolist(), strict=True))
    speeds = dict(zip(known.speeds, state.u.tolist(), strict=True))
    for body, node in known.node_of.items():
        turned = Rotation.from_matrix(system.mechanism.bodies[body].rotation.T @ work.R[node]).as_quat()
        placed = zip("xyz", work.r[node].tolist(), strict=True)
        turns = zip("xyzw", turned.tolist(), strict=True)
        positions |= {f"{body}.{axis}": each for axis, each in placed}
        positions |= {f"{body}.quaternion_{part}": each for part, each in turns}
        v, omega = work.twist[node, :3], work.R[node].T @ work.twist[node, 3:]
        speeds |= {f"{body}.{axis}": each for axis, each in zip("xyz", v.tolist(), strict=True)}
        speeds |= {f"{body}.omega_{axis}": each for axis, each in zip("xyz", omega.tolist(), strict=True)}
    q = np.array([positions.get(name, 0.0) for name, _ in own.positions])
    u = np.array([speeds.get(name, 0.0) for name in own.speeds])
    choice = choose(system, q, prefer=True)
    try:
        return system.project(state.t, q, u, choice)
    except ArithmeticError as reason:
        cure = "Start at another position, or check the laws of loads"
        raise SceneError("drives", None, f"at the start {reason}", cure) from None


def _key(system: System, owner: str) -> str:
    """Entry of the scene for the initial state of a free joint or body."""
    return f"bodies.{owner}.free" if owner in system.mechanism.floating else f"drives.{owner}"


def _check_drives(system: System, choice: Choice) -> None:
    """Check that prescribed drives are independent of the loops."""
    J = system.engine.jacobian
    if system.driven and np.linalg.matrix_rank(J, _RANK * abs(J).max(initial=1.0)) > len(choice.rows):
        raise SceneError(
            f"drives.{system.driven[-1]}", None, "the loops and the other drives already determine its motion",
            "Leave one drive out, or set free = true",
        )  # fmt: skip


def _check_closing(system: System, q: np.ndarray) -> None:
    """Check that redundant rows hold, too."""
    system.place(q)
    gaps, measure = abs(system.work.rows[: len(system.work.row_measure), 0]), system.work.row_measure
    if (gaps > 1e-7 * measure).any():
        worst = int((gaps / measure).argmax())
        joint = next(name for name, rows in system.layout.cuts.items() if rows.start <= worst < rows.stop)
        unit, factor = ("mm", 1e3) if measure[worst] != 1.0 else ("deg", 180.0 / np.pi)
        unit, factor = ("m or rad", 1.0) if system.mechanism.size == 1.0 else (unit, factor)
        raise SceneError(
            f"joints.{joint}", None, "the loop that it closes can't close where the drives start: "
            f"a gap of {factor * gaps[worst]:.3g} {unit} remains",
            "Check lengths and axes, and give the bodies rotations near the initial position",
        )  # fmt: skip


def _check_free(system: System, q: np.ndarray) -> None:
    """Check that free joints start at their given coordinates."""
    for name, drive in system.mechanism.drives.items():
        field = next((field for field in ("angle", "position") if field in drive.model_fields_set), None)
        if drive.kind != "free" or field is None:
            continue
        found = float(q[system.columns([name], COORDINATE)[0]])
        if abs(found - drive.start) > 1e-9 * max(1.0, abs(drive.start)):
            raise SceneError(
                f"drives.{name}.{field}", drive.start, f"the loops don't close at this position, but at {found:.9g}",
                "Give that position, or leave the entry out",
            )  # fmt: skip


def _check_springs(system: System) -> None:
    """Check that springs with a direction have one, at the position of ``work``."""
    springs = {name: spring for name, spring in system.mechanism.springs.items()
               if spring.joint is None and not spring.is_bushing}  # fmt: skip
    acts, (first, end) = system.engine.tables.acts, map(system.engine.count, (at.SPRINGS, at.CONTACTS))
    straight = (row for row in acts[first:end] if row[at.WHAT] == at.STRAIGHT)
    for (name, spring), (_, first, second, *_) in zip(springs.items(), straight, strict=True):
        apart = np.linalg.norm(system.work.sections[second, :3] - system.work.sections[first, :3])
        if spring.is_directed and apart < 1e-9 * system.mechanism.size:
            raise points_meet(name, [*map(system.mechanism.address, spring.sides)], " at the start")


def _check_named(system: System, choice: Choice) -> None:
    """Check that every freedom is driven or free."""
    named = np.array(named_speeds(system), int)
    free = system.mechanism.free_joints
    if free and not len(choice.independent):
        raise SceneError(
            f"drives.{free[0]}", "free", "joints and drives leave the mechanism no degree of freedom",
            "Leave a joint or a drive out, or check their axes",
        )  # fmt: skip
    held = np.concatenate([system.engine.prescribed, named])
    selected = np.zeros((len(held), system.engine.size))
    selected[np.arange(len(held)), held] = 1.0
    left = self_equilibrated(np.vstack([system.work.J[choice.rows] * system.engine.measure, selected]).T)
    if left.shape[1]:
        moving = [system.layout.speeds[k] for k in np.flatnonzero(abs(left).max(axis=1) > 1e-6)]
        joints = list(dict.fromkeys(name.rpartition(".")[0] for name in moving))
        count = "1 degree of freedom has" if left.shape[1] == 1 else f"{left.shape[1]} degrees of freedom have"
        raise SceneError(
            "drives", None, f"{count} no drive, at {', '.join(joints)}",
            f"Drive a joint, or let it move freely, like drives.{joints[0]} = {{free = true}}",
        )  # fmt: skip


def _check_speeds(system: System, state: State) -> None:
    """Check that given initial speeds are consistent."""
    for k, wanted in given_speeds(system).items():
        if abs(state.u[k] - wanted) > 1e-9 * (abs(state.u).max() + abs(wanted)):
            owner = system.layout.speeds[k].rpartition(".")[0]
            joint = system.mechanism.joints.get(owner)
            field = START_SPEEDS.get(joint.kind, "initial_speed") if joint else "velocity"
            raise changed_speed(f"{_key(system, owner)}.{field}", float(wanted), state.u[k])
