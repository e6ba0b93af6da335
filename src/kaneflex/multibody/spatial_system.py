"""A scene in space bound to its numbers: where it starts, which speeds are independent, how it accelerates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from types import ModuleType

import numpy as np

from kaneflex.mechanism.spatial import SpatialMechanism, spatial_mechanism_of
from kaneflex.multibody.binding import bind_parameters
from kaneflex.multibody.spatial_dynamics import (
    ACCELERATE,
    BASIS,
    CLOSE,
    DEMAND,
    EXERT,
    PASS_ON,
    PLACE,
    RATES,
    Choice,
    compute,
)  # fmt: skip
from kaneflex.multibody.spatial_engine import Work, work_of
from kaneflex.multibody.spatial_tables import (
    BALL,
    COORDINATE,
    COORDINATES,
    KIND,
    ROWS,
    SPEED,
    SPEEDS,
    TURN,
    WHAT,
    Layout,
    Tables,
    build_tables,
)  # fmt: skip
from kaneflex.scene import Scene
from kaneflex.support.errors import SceneError

_RANK = 1e-9
"""Pivot of a row or speed, as a share of the largest, below which it follows from the others."""


@dataclass(frozen=True, eq=False)
class SpatialSystem:
    """The equations of a mechanism in space with its numbers.

    Attributes
    ----------
    scene : Scene
    module : ModuleType
        Generated: ``courses`` of drives and ``magnitudes`` of loads.
    parameters : ndarray
        Their argument p.
    mechanism : SpatialMechanism
    tables : Tables
    layout : Layout
    """

    scene: Scene
    module: ModuleType
    parameters: np.ndarray
    mechanism: SpatialMechanism
    tables: Tables
    layout: Layout

    def compile(self) -> None:
        """Compile all that computes, so that it is seen and timed apart from computing."""
        self.place(self.at_zero)
        self.courses(0.0)
        self.sizes(0.0, self.at_zero, np.zeros(self.speeds))

    def place(self, q: np.ndarray) -> None:
        """Places, axes and partial velocities in ``work``."""
        self._compute(PLACE, q=q)

    def close(self, q: np.ndarray, choice: Choice) -> bool:
        """Close the loops by the dependent coordinates, in place; whether they close."""
        return self._compute(CLOSE, choice, q)

    def accelerate(self, choice: Choice, u: np.ndarray, du: np.ndarray, sizes: np.ndarray) -> bool:
        """Dependent speeds in u and all rates in du, where the loops are closed; False at a singular place."""
        return self._compute(ACCELERATE, choice, u=u, du=du, sizes=sizes)

    def exerted(self, choice: Choice, sizes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Multipliers of the rows, wrenches of the nodes' joints, and what is exerted along every speed."""
        found = np.zeros(self.row_count), np.zeros((len(self.tables.nodes), 6)), np.zeros(self.speeds)
        self._compute(EXERT, choice, sizes=sizes, exerts=found)
        return found

    def kinetic(self, u: np.ndarray, sizes: np.ndarray) -> float:
        """Kinetic energy [J] in the motion of ``work``."""
        self._compute(DEMAND, sizes=sizes)
        return float(0.5 * u @ self.work.M @ u)

    def coordinate_rates(self, q: np.ndarray, u: np.ndarray) -> np.ndarray:
        """q' of speeds."""
        out = np.zeros(self.coordinates)
        self._compute(RATES, q=q, u=u, exerts=(self._none, np.zeros((0, 6)), out))
        return out

    def basis(self, choice: Choice) -> np.ndarray:
        """Speeds for a unit of each independent one, (independent, speeds), where the loops are closed."""
        self._compute(BASIS, choice)
        return choice.basis

    def _compute(self, what, choice=None, q=None, u=None, du=None, sizes=None, exerts=None) -> bool:
        none = self._none
        given = (none if each is None else each for each in (q, u, du, sizes))
        exerts = (none, np.zeros((0, 6)), none) if exerts is None else exerts
        return compute(what, self.tables, choice or self._no_choice, self.work, *given, *exerts)

    @cached_property
    def _none(self) -> np.ndarray:
        return np.zeros(0)

    @cached_property
    def _no_choice(self) -> Choice:
        return self._choice(*(np.zeros(0, int) for _ in range(3)))

    def _choice(self, rows: np.ndarray, dependent: np.ndarray, independent: np.ndarray) -> Choice:
        """Of so many rows and speeds, with room for them."""
        d, f = len(dependent), len(independent)
        rows, dependent, independent = (np.ascontiguousarray(part, np.int64) for part in (rows, dependent, independent))
        room = np.zeros(d * d + d + f * f + f), np.zeros(self.speeds), np.zeros((f, self.speeds))
        pivots = np.zeros(d + f, np.int64)
        return Choice(rows, dependent, self._driven_speeds, independent, self.measure, *room, pivots)

    @property
    def speeds(self) -> int:
        return len(self.layout.speeds)

    @cached_property
    def coordinates(self) -> int:
        """Coordinates of the tree, four a ball."""
        return int(sum(COORDINATES[kind] for kind in self.tables.nodes[:, KIND]))

    @cached_property
    def row_count(self) -> int:
        return int(sum(ROWS[what] for what in self.tables.cuts[:, WHAT]))

    @cached_property
    def work(self) -> Work:
        """Room in which this system computes."""
        return work_of(self.tables, self.speeds, self.row_count)

    @cached_property
    def driven(self) -> tuple[str, ...]:
        """Joints whose courses are prescribed, in the order of the module's."""
        return tuple(name for name, drive in self.scene.drives.items() if drive.kind != "free")

    @cached_property
    def known_joints(self) -> tuple[str, ...]:
        """Joints whose coordinates and speeds laws may know."""
        return (*self.scene.drives, *self.scene.observed)

    def node(self, joint: str) -> int:
        """Number of the node that has a joint's one coordinate; of a cylindrical one its slide."""
        nodes, _ = self.layout.tree[joint]
        return nodes[0] if self.mechanism.joints[joint].kind != "cylindrical" else self._sliding(nodes)

    def _sliding(self, nodes: Sequence[int]) -> int:
        return next(node for node in nodes if self.tables.nodes[node, KIND] != TURN)

    def columns(self, names: Sequence[str], what: int) -> np.ndarray:
        """Where the first coordinates (COORDINATE) or speeds (SPEED) of joints are."""
        return np.array([self.tables.nodes[self.node(name), what] for name in names], int)

    def speeds_of(self, owner: str) -> list[int]:
        """Numbers of the speeds of a joint of the tree, or of a body that moves freely."""
        return [k for k, name in enumerate(self.layout.speeds) if name.rpartition(".")[0] == owner]

    @cached_property
    def measure(self) -> np.ndarray:
        """What counts as one in each speed: 1 rad, or the mechanism's size."""
        found = np.ones(self.speeds)
        for kind, *_, speed, _ in self.tables.nodes.tolist():
            if SPEEDS[kind] == 1 and kind != TURN:
                found[speed] = self.mechanism.size
        return found

    @cached_property
    def row_measure(self) -> np.ndarray:
        found: list[float] = []
        for what in self.tables.cuts[:, WHAT].tolist():
            found += [1.0 if what == 1 else self.mechanism.size] * ROWS[what]
        return np.array(found)

    def courses(self, t: float) -> np.ndarray:
        """Coordinate, speed and acceleration of every prescribed drive, (drives, 3)."""
        out = np.zeros(3 * len(self.driven))
        self.module.courses(t, self.parameters, out, 0)
        return out.reshape(-1, 3)

    def sizes(self, t: float, q: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Sizes of all loads [N or N m], those of forces before those of torques."""
        loads = self.mechanism.loads
        if not loads:
            return np.zeros(0)
        x, out = np.zeros(3 * len(self.known_joints)), np.zeros(len(loads))
        single = [name for name in self.known_joints if self.mechanism.joints[name].freedoms == 1]
        for k, name in enumerate(self.known_joints):
            if name in single:
                node = self.tables.nodes[self.node(name)]
                x[2 * k], x[2 * k + 1] = q[node[COORDINATE]], u[node[SPEED]]
        self.module.magnitudes(t, x, 0, self.parameters, out, 0)
        return out[self._forces_first]

    @cached_property
    def _forces_first(self) -> np.ndarray:
        turning = [load.joint is not None for load in self.mechanism.loads.values()]
        return np.argsort(turning, kind="stable")

    def set_drives(self, t: float, q: np.ndarray, u: np.ndarray, du: np.ndarray) -> None:
        """Put prescribed drives where they are at t [s], with their rates."""
        course = self.courses(t)
        q[self._driven_coordinates], u[self._driven_speeds], du[self._driven_speeds] = course.T

    @cached_property
    def _driven_coordinates(self) -> np.ndarray:
        return self.columns(self.driven, COORDINATE)

    @cached_property
    def _driven_speeds(self) -> np.ndarray:
        return self.columns(self.driven, SPEED)

    @cached_property
    def at_zero(self) -> np.ndarray:
        """Coordinates where all joints stand at zero and free bodies where the scene says."""
        q = np.zeros(self.coordinates)
        nodes = self.tables.nodes
        q[nodes[nodes[:, KIND] == BALL, COORDINATE]] = 1.0
        for name, drive in self.scene.drives.items():
            if drive.kind == "free" and self.mechanism.joints[name].freedoms == 1:
                q[self.columns([name], COORDINATE)] = drive.start
        for body in self.mechanism.floating:
            first = self.speeds_of(body)[0]
            place = nodes[:, COORDINATE][nodes[:, SPEED] == first][0]
            q[place : place + 3] = self.scene.vector(self.scene.floating[body].at)
        return q

    def given_speeds(self) -> dict[int, float]:
        """Speeds that the scene gives of what is free, by their numbers."""
        found: dict[int, float] = {}
        for name, drive in self.scene.drives.items():
            if drive.kind == "free":
                own = self.speeds_of(name)
                values = (drive.initial_speed,) if len(own) == 1 else drive.angular_velocity
                found |= dict(zip(own, values or (), strict=False))
        for body in self.mechanism.floating:
            free, R = self.scene.floating[body], self.mechanism.bodies[body].rotation
            turn = R.T @ np.zeros(3) if free.angular_velocity is None else R.T @ np.asarray(free.angular_velocity)
            found |= dict(zip(self.speeds_of(body), [*self.scene.vector(free.velocity), *turn], strict=True))
        return found

    def named(self) -> list[int]:
        """Speeds of what the scene leaves to the forces by name."""
        free = [name for name, drive in self.scene.drives.items() if drive.kind == "free"]
        return [k for name in (*free, *self.mechanism.floating) for k in self.speeds_of(name)]

    def choose(self, q: np.ndarray, prefer: bool = False) -> Choice:
        """Rows and speeds by pivoted QR where the mechanism stands; ``prefer``: named speeds are independent."""
        from scipy.linalg import qr

        k = self.work
        self.place(q)
        open_speeds = np.setdiff1d(np.arange(self.speeds), self._driven_speeds)
        J = k.J * self.measure / self.row_measure[:, None]
        kept = np.zeros(0, int)
        dependent = np.zeros(0, int)
        if len(J) and len(open_speeds):
            _, r, order = qr(J[:, open_speeds].T, pivoting=True, mode="economic")
            kept = np.sort(order[: _rank(r)])
            weight = np.ones(len(open_speeds))
            if prefer:
                weight[np.isin(open_speeds, self.named())] = 1e-3
                weight[np.isin(open_speeds, list(self.given_speeds()))] = 1e-6
            _, r, order = qr(J[np.ix_(kept, open_speeds)] * weight, pivoting=True, mode="economic")
            dependent = open_speeds[order[: len(kept)]]
        independent = np.setdiff1d(open_speeds, dependent)
        return self._choice(kept, dependent, independent)

    def check_closing(self, q: np.ndarray) -> None:
        """All rows must hold, those that follow from others, too."""
        self.place(q)
        off = abs(self.work.rows[:, 0]) / self.row_measure
        if len(off) and off.max() > 1e-7:
            joint = next(name for name, rows in self.layout.cuts.items() if rows.start <= off.argmax() < rows.stop)
            raise SceneError(
                f"joints.{joint}", None, "the loop that it closes can't close where the drives start",
                "Check lengths and axes, and give the bodies rotations near to how they stand",
            )  # fmt: skip

    def undetermined(self, q: np.ndarray) -> set[str]:
        """Names of reactions that no equation determines: more rows hold a motion than it needs."""
        from scipy.linalg import null_space

        k = self.work
        self.place(q)
        open_speeds = np.setdiff1d(np.arange(self.speeds), self._driven_speeds)
        J = k.J * self.measure / self.row_measure[:, None]
        found: set[str] = set()
        if not len(J):
            return found
        for combination in null_space(J[:, open_speeds].T, rcond=_RANK).T:
            multipliers = combination / self.row_measure
            wrenches = np.zeros((len(self.tables.nodes), 6))
            k.F[:] = 0.0  # no body asks for anything
            self._compute(PASS_ON, exerts=(multipliers, wrenches, self._none))
            largest = max(abs(wrenches).max(), abs(multipliers).max())
            for joint, values in self.joint_wrenches(wrenches, multipliers).items():
                names = [*(f"force_{axis}" for axis in "xyz"), *(f"moment_{axis}" for axis in "xyz")]
                found |= {f"{joint}.{name}" for name, value in zip(names, values, strict=True)
                          if abs(value) > 1e-7 * largest}  # fmt: skip
            along = k.J[:, self._driven_speeds].T @ multipliers
            found |= {f"{name}.drive" for name, value in zip(self.driven, along, strict=True)
                      if abs(value) > 1e-7 * largest}  # fmt: skip
        return found

    def joint_wrenches(self, wrenches: np.ndarray, multipliers: np.ndarray) -> dict[str, np.ndarray]:
        """Force and moment, global, of every joint on its second body at its second point, where ``work`` stands."""
        k, found = self.work, {}
        for name, joint in self.mechanism.joints.items():
            if name in self.layout.tree:
                nodes, sign = self.layout.tree[name]
                force, moment = wrenches[nodes[-1], :3], wrenches[nodes[-1], 3:]
                body = joint.sides[1].body
                on = self.layout.node_of.get(body, -1)
                at = np.asarray(joint.sides[1].at, float)
                point = at if on < 0 else k.r[on] + k.R[on] @ at
                arm = k.r[nodes[-1]] - point
                found[name] = sign * np.concatenate([force, moment + np.cross(arm, force)])
            else:
                rows = self.layout.cuts[name]
                found[name] = multipliers[rows] @ k.rows[rows, 9:15]
        return found


def _rank(r: np.ndarray) -> int:
    pivots = abs(np.diag(r))
    return int((pivots > _RANK * pivots.max(initial=0.0)).sum())


def build_spatial_system(scene: Scene, module: ModuleType) -> SpatialSystem:
    """Bind a scene to its module."""
    mechanism = spatial_mechanism_of(scene)
    tables, layout = build_tables(mechanism)
    for name in (*scene.drives, *scene.observed, *(s.joint for s in mechanism.springs.values() if s.joint)):
        if name in layout.cuts:
            raise SceneError(
                f"joints.{name}", None, "it closes a loop whose other joints' coordinates are asked for, too",
                "Ask for one coordinate less in this loop: drives, laws, springs and sensors of joints",
            )  # fmt: skip
    return SpatialSystem(scene, module, bind_parameters(scene, module), mechanism, tables, layout)
