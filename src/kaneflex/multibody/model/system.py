"""A scene bound to the module of its laws, in the plane or in space: engine, mechanism, and the layout of the state."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from kaneflex.fem.links import Link
from kaneflex.mechanism.joints import course, drive_reaction, reactions
from kaneflex.mechanism.planar import whole_turns
from kaneflex.mechanism.spatial_frame import AXES
from kaneflex.multibody.dynamics.arrays import Columns, Work
from kaneflex.multibody.engine import Engine
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.codes import DONE, ON_LOOPS, check
from kaneflex.multibody.model.shapes import Shapes
from kaneflex.multibody.model.state import Choice, State
from kaneflex.multibody.model.tree_layout import BALL, COORDINATE, KIND, SIGN, SPEED, Layout, leading

COMPONENTS = tuple(f"{part}_{axis}" for part in ("force", "moment") for axis in "xyz")
"""Components of a joint's force and moment in space, global."""
_UNITS = *3 * ("N",), *3 * ("N m",)
BODY = 3
"""Coordinates x, y, phi of every body in the plane, before its modal ones."""
_STEP = 1e-30
"""Complex step [s] that gives rates: so small that it changes no position."""
_MOTION = (
    tuple(zip(("x", "y", "phi", "v_x", "v_y", "omega", "a_x", "a_y", "epsilon"),
              ("m", "m", "rad", "m/s", "m/s", "rad/s", "m/s^2", "m/s^2", "rad/s^2"), strict=True)),
    tuple((f"{part}{axis}", unit) for part, unit, axes in (
        ("", "m", "xyz"), ("axes_", "1", AXES), ("v_", "m/s", "xyz"), ("omega_", "rad/s", "xyz"),
        ("a_", "m/s^2", "xyz"), ("epsilon_", "rad/s^2", "xyz")) for axis in axes),
)  # fmt: skip
"""Names and units of the scalars of a body's start and axes, in the plane and in space, in the order of the record."""


class Scalar(NamedTuple):
    """Scalar of a motion: its unit, its meaning, and its column of the record."""

    unit: str
    meaning: str
    column: int


@dataclass(frozen=True, eq=False)
class System:
    """Equations of motion of a scene with its numbers.

    States have the coordinates of the engine: of the joints of a tree, and of shapes. In the plane, motions read from
    them have the frames x, y, phi and the amplitudes of the shapes of every body: q, v (size,).

    Attributes
    ----------
    module : ModuleType
        Generated: courses of drives and sizes of loads.
    mechanism : NumericMechanism or SpatialMechanism
    engine : Engine
    shapes : mapping of str
        Modal coordinates of every elastic link.
    coupled : bool
        True if it deforms, or belongs to a deforming one and shares its compiled functions.
    undetermined : frozenset of str
        In the plane names among ``constraints`` of statically indeterminate reactions, which are NaN.
    """

    module: ModuleType
    mechanism: Any
    engine: Engine
    shapes: Mapping[str, Shapes]
    coupled: bool
    undetermined: frozenset[str] = frozenset()

    @property
    def links(self) -> dict[str, Link]:
        """Finite elements of every elastic link."""
        return {name: each.link for name, each in self.shapes.items()}

    @property
    def layout(self) -> Layout:
        return self.engine.layout

    @property
    def work(self) -> Work:
        """Working arrays of this system."""
        return self.engine.work

    @property
    def parameters(self) -> np.ndarray:
        """Argument p of the module's kernels."""
        return self.engine.p

    @property
    def driven(self) -> tuple[str, ...]:
        """Joints whose courses are prescribed, in the order of the module's."""
        return self.layout.driven

    @property
    def freedom(self) -> str:
        """Entry of the scene that lets the mechanism move by forces."""
        free, floating = self.mechanism.free_joints, self.mechanism.floating
        return f"drives.{free[0]}" if free else f"bodies.{floating[0]}.free" if floating else "solve.preset"

    @property
    def in_space(self) -> bool:
        return self.engine.in_space

    def project(self, t: float, q: np.ndarray, u: np.ndarray, choice: Choice) -> State:
        """State at t [s] near coordinates q with the independent ones of the speeds u; ``work`` has it, too.

        Sets prescribed drives, closes loops, and determines dependent speeds, then loads and all rates. Contacts are
        closed where their sides overlap.

        Raises
        ------
        ArithmeticError
            If a loop does not close, or the rates are not determined; it says which.
        """
        engine = self.engine
        engine.choose_speeds(choice)
        if not self.in_space:
            engine.part()
        check(engine.call("project", t, np.ascontiguousarray(q), np.ascontiguousarray(u)))
        return engine.state(t, choice)

    def unfold(self, rows: np.ndarray, near: int = ON_LOOPS) -> np.ndarray:
        """Records of rows of the engine, see :meth:`kaneflex.multibody.engine.Engine.unfold`."""
        return self._determined(self.engine.unfold(rows, near))

    def nearby(self, rows: np.ndarray, held: Sequence[int] = ()) -> np.ndarray:
        """Records of states near rows of the engine, see :meth:`kaneflex.multibody.engine.Engine.nearby`."""
        return self._determined(self.engine.nearby(rows, held))

    def _determined(self, records: np.ndarray) -> np.ndarray:
        """Records whose statically indeterminate reactions are NaN, in place."""
        if self.undetermined:
            records[:, self.record.forces[[name in self.undetermined for name in self.constraints]]] = np.nan
        return records

    @cached_property
    def record(self) -> Columns:
        """Columns of the record: frames and shapes of the bodies, in the plane in the scene's order and forces as
        ``constraints`` names them, in space bodies in the order of the tree, forces and moments of the joints, and
        forces of the drives."""
        layout, kept, place = self.layout, self.engine.numbered, dict[str, int]()
        if self.in_space:
            forces = [kept.exerted.ravel(), kept.along[0, self.engine.prescribed]]
            return self.engine.recorded(layout.node_of, forces)
        for k, (name, joint) in enumerate(self.mechanism.joints.items()):
            names = [*(row for row, *_ in reactions(joint)), f"{name}.drive"]
            own = kept.exerted[0, k] if name in layout.tree else kept.multipliers[0, layout.cuts[name]]
            place |= dict(zip(names, own.tolist(), strict=False))
        return self.engine.recorded(self.mechanism.bodies, [np.array([place[name] for name in self.constraints], int)])

    @cached_property
    def reactions(self) -> tuple[tuple[str, str, str], ...]:
        """Name, unit and meaning of joint forces, then of forces and torques of prescribed drives."""
        joints = self.mechanism.joints
        if not self.in_space:
            found = [row for joint in joints.values() for row in reactions(joint)]
            return (*found, *(drive_reaction(joints[name]) for name in self.mechanism.prescribed))
        found = [(f"{name}.{part}", unit, f"{part[:-2]} on {joint.sides[1].body}, global")
                 for name, joint in joints.items() for part, unit in zip(COMPONENTS, _UNITS, strict=True)]  # fmt: skip
        drives = ((name, "N" if joints[name].kind == "prismatic" else "N m") for name in self.driven)
        return (*found, *((f"{name}.drive", unit, "what the drive exerts") for name, unit in drives))

    @property
    def constraints(self) -> tuple[str, ...]:
        """Names of the reactions."""
        return tuple(name for name, *_ in self.reactions)

    @cached_property
    def scalars(self) -> dict[str, Scalar]:
        """Scalars in the record by their names: of loads, bodies, joints, springs, contacts and friction."""
        return {name: Scalar(unit, meaning, int(column)) for name, unit, meaning, column in self._scalars()}

    def _scalars(self) -> Iterator[tuple[str, str, str, int]]:
        mechanism, kept, held = self.mechanism, self.engine.numbered, len(self.engine.frictions)
        for (name, load), column in zip(mechanism.loads.items(), kept.sizes[0], strict=True):
            yield name, load.unit, "magnitude of the load", column
        parts = (kept.r, kept.R, kept.twist, kept.rate) if self.in_space else (kept.r, kept.twist, kept.rate)
        for body in mechanism.bodies:
            columns = np.concatenate([part[0, self.layout.node_of[body]].ravel() for part in parts])
            for (name, unit), column in zip(_MOTION[self.in_space], columns, strict=True):
                yield f"{body}.{name}", unit, "of the body's start and axes, global", column
        for reaction, column in zip(self.reactions, self.record.forces, strict=True):
            yield *reaction, column
        rows = iter(kept.springs[0])
        for name, spring in sorted(mechanism.springs.items(), key=lambda each: each[1].is_bushing):  # as in the record
            for (part, unit), row in zip(spring.scalars, rows, strict=False):
                yield f"{name}.{part}", unit, "of the spring and its damper", row[1]
                for axis, column in zip("xy", row[2:4], strict=True) if spring.ends and not self.in_space else ():
                    yield f"{name}.force_{axis}", "N", "of the spring on its second point, global", column
        touching, own = kept.touching[0], held - len(mechanism.frictions)
        for (name, contact), row in zip(mechanism.contacts.items(), touching[held:], strict=False):
            units = ("rad", "N m") if contact.kind == "angle" else ("m", "N")
            yield f"{name}.gap", units[0], "of the contact", row[0]
            yield f"{name}.force", units[1], "of the contact", row[at.FORCE_AT]
        for name, row in zip(mechanism.frictions, touching[own:held], strict=True):
            unit = "N m" if mechanism.turns_at(name) else "N"
            yield f"{name}.friction", unit, "of friction on its second body", row[at.FORCE_AT]
        faces = [name for name in mechanism.frictions if name in mechanism.contacts]
        for name, row in zip(faces, touching[:own], strict=False):  # in space alone
            for axis, column in zip("xyz", row[:3], strict=True):
                yield f"{name}.friction_{axis}", "N", "of friction on its second body, global", column

    # ---- in the plane: frames of the bodies -----------------------------------------------------------------------

    @cached_property
    def free(self) -> dict[str, int]:
        """Numbers of the coordinates of free joints and free bodies in the tree, which has those without friction."""
        own = [name for name, _ in self.layout.coordinates]
        return {name: own.index(each) for name in self.mechanism.free
                for each in (name, f"{name}.angle", f"{name}.position") if each in own}  # fmt: skip

    def undeformed(self, times: np.ndarray, q: np.ndarray, v: np.ndarray) -> list[State]:
        """States at ``times`` [s] by frames x, y, phi of undeformed bodies, and their rates, (n_times, 3 bodies);
        loops are not closed."""
        engine = self.engine
        each = zip(times.tolist(), *self.coordinates_of(q, v), strict=True)
        return [State(t, y, u, 0.0 * u, engine.sizes.copy(), engine.choice) for t, y, u in each]

    def coordinates_of(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates of these states and their rates, (n_times, speeds) each."""
        engine, layout, joints = self.engine, self.layout, self.mechanism.joints
        found, moved = np.zeros((len(q), engine.size), complex), q + 1j * _STEP * v
        poses = {body: moved[:, BODY * k : BODY * k + BODY].T for k, body in enumerate(self.mechanism.bodies)}
        for body, name, fields in zip(layout.node_of, layout.inboard, engine.tables.bodies, strict=True):
            own = slice(fields[at.FIRST], fields[at.FIRST] + fields[at.DOF])
            if name is None:
                found[:, own] = poses[body].T
            elif fields[at.DOF]:
                found[:, own.start] = course(joints[name], poses)
        return found.real.copy(), found.imag / _STEP

    def poses(self, state: State) -> dict[str, np.ndarray]:
        """Frames x, y, phi of the bodies at a state, (3,) each; loops are not closed, and drives have their courses up
        to whole turns."""
        engine, turned = self.engine, dict[str, float]()
        engine.set(state)
        found = engine.instants(self.unfold(engine.row(state.t)[None])).r[0]
        lost = np.where(engine.turns, whole_turns(state.q - engine.motion[0]), 0.0)  # drives now have their courses
        index, signs = [*engine.layout.node_of], engine.parts["frames"][:, SIGN]
        for body, fields, sign in zip(index, engine.tables.bodies, signs, strict=True):
            own = lost[fields[at.FIRST] : fields[at.FIRST] + fields[at.DOF]].sum()
            base = fields[at.PARENT_BODY]
            turned[body] = (turned[index[base]] if base >= 0 else 0.0) + sign * own
        nodes = self.layout.node_of
        return {body: found[nodes[body]] + [0.0, 0.0, turned[body]] for body in self.mechanism.bodies}

    # ---- in space: positions near which records are computed ------------------------------------------------------

    def place(self, q: np.ndarray) -> None:
        """Positions, axes and directions in ``work``."""
        self.engine.call("place", np.ascontiguousarray(q))

    def close(self, q: np.ndarray, choice: Choice) -> bool:
        """Close the loops by the dependent coordinates, in place; True if they close."""
        self.engine.choose_speeds(choice)
        closes = self.engine.call("close", q)
        q[:] = self.work.q
        return bool(closes)

    def follow(self, begin: float, choice: Choice, times: np.ndarray, out: np.ndarray) -> tuple[int, float, int]:
        """Rows of :class:`Instants` at ascending ``times`` [s] from the position of ``work`` at ``begin`` [s], by
        :func:`kaneflex.multibody.dynamics.entries.follow`; returns their number, the time of ``work`` then, and
        its outcome."""
        self.engine.choose_speeds(choice)
        self.work.now[:2] = begin, DONE
        count = self.engine.call("follow", np.ascontiguousarray(times, float), len(times), out)
        t, outcome, _ = self.work.now.tolist()
        return count, t, int(outcome)

    @cached_property
    def known_joints(self) -> tuple[str, ...]:
        """Joints whose coordinates and speeds may occur in laws."""
        return (*self.mechanism.drives, *self.mechanism.observed)

    def node(self, joint: str) -> int:
        """Number of the node with a joint's first coordinate; for a cylindrical joint, its rotation."""
        return leading(self.engine.parts["nodes"], self.layout.tree[joint])

    def columns(self, names: Sequence[str], what: int) -> np.ndarray:
        """Places of the first coordinates (COORDINATE) or speeds (SPEED) of joints."""
        return np.array([self.engine.parts["nodes"][self.node(name), what] for name in names], int)

    def speeds_of(self, owner: str) -> list[int]:
        """Numbers of the speeds of a joint of the tree, or of a body that moves freely."""
        return [k for k, name in enumerate(self.layout.speeds) if name.rpartition(".")[0] == owner]

    def courses(self, t: float) -> np.ndarray:
        """Coordinate, speed and acceleration of every prescribed drive, (drives, 3)."""
        return self.engine.courses(np.array([t])).reshape(-1, 3)

    def magnitudes_at(self, times: np.ndarray, coordinates: np.ndarray, speeds: np.ndarray) -> np.ndarray:
        """Sizes of all loads at many instants, (n_times, loads)."""
        states = np.zeros((len(times), len(self.known_joints), 3))
        where = [self.known_joints.index(name) for name in self.scalar_joints]
        states[:, where, 0], states[:, where, 1] = coordinates, speeds
        return self.engine.magnitudes(times, states)

    @cached_property
    def scalar_joints(self) -> tuple[str, ...]:
        """Known joints with one coordinate."""
        return tuple(name for name in self.known_joints if self.mechanism.joints[name].freedoms == 1)

    @property
    def has_slopes(self) -> bool:
        """True if springs, or loads by the motion of joints, add to a step's matrix."""
        return has_slopes(self.mechanism, self.known_joints)

    @cached_property
    def at_zero(self) -> np.ndarray:
        """Coordinates with all joints at zero and free bodies at their given positions."""
        q = np.zeros(len(self.layout.positions))
        nodes = self.engine.parts["nodes"]
        q[nodes[nodes[:, KIND] == BALL, COORDINATE]] = 1.0
        for name, drive in self.mechanism.drives.items():
            if drive.kind == "free" and self.mechanism.joints[name].freedoms == 1 and name in self.layout.tree:
                q[self.columns([name], COORDINATE)[0]] = drive.start
        for body, free in self.mechanism.frees.items():
            first = self.speeds_of(body)[0]
            place = nodes[:, COORDINATE][nodes[:, SPEED] == first][0]
            q[place : place + 3] = [*free.at, 0.0][:3]
        return q

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Jacobian J of the rows by the speeds, both in their measures, at a position."""
        self.place(q)
        return self.engine.jacobian


def has_slopes(mechanism: Any, in_laws: Sequence[str]) -> bool:
    """True if springs, or loads by the motion of joints in laws, add to the matrix of a step in space."""
    sloped = any(mechanism.joints[name].kind in ("revolute", "prismatic") for name in in_laws)
    return bool(mechanism.springs or (mechanism.loads and sloped))
