"""A scene bound to the module of its laws: tables of the engine, parameters, and the layout of the state."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import ModuleType

import numpy as np

from kaneflex.fem.links import Link, link_of_scene
from kaneflex.mechanism.floating_frames import link_modes, mesh, most_modes
from kaneflex.mechanism.joints import course, drive_reaction, reactions
from kaneflex.mechanism.mechanism import NumericMechanism, mechanism_of
from kaneflex.mechanism.planar import whole_turns
from kaneflex.multibody.dynamics.arrays import Columns
from kaneflex.multibody.engine import Engine
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.assembly import build_engine
from kaneflex.multibody.model.body_parameters import Blocks
from kaneflex.multibody.model.module_loading import bind_parameters, element_of, find_laws_module
from kaneflex.multibody.model.shape_bases import alike, link_shapes, spanned
from kaneflex.multibody.model.shape_families import check_family
from kaneflex.multibody.model.shapes import Shapes
from kaneflex.multibody.model.state import Choice, State
from kaneflex.multibody.model.tree_layout import SIGN
from kaneflex.scene import Scene
from kaneflex.support.errors import SceneError

BODY = 3
"""Coordinates x, y, phi of every body, before its modal ones."""
_STEP = 1e-30
"""Complex step [s] that gives rates: so small that it changes no position."""


@dataclass(frozen=True, eq=False)
class CoupledSystem:
    """Coupled equations of a scene with its numbers.

    States have the coordinates of the engine: of the joints of a tree, and of shapes. Motions read from them have the
    frames and shapes of the bodies: q, v (size,) in the order of ``coordinates``.

    Attributes
    ----------
    module : ModuleType
        Generated: courses of drives and sizes of loads.
    engine : Engine
    mechanism : NumericMechanism
    links, shapes : mapping of str
        Finite elements and modal coordinates of every elastic link.
    counts : mapping of str
        Body -> numbers of its axial and transverse shapes.
    undetermined : tuple of str
        Names among ``constraints`` of statically indeterminate reactions, which are NaN.
    """

    module: ModuleType
    engine: Engine
    mechanism: NumericMechanism
    links: Mapping[str, Link]
    shapes: Mapping[str, Shapes]
    counts: Mapping[str, tuple[int, ...]]
    undetermined: tuple[str, ...] = ()

    @property
    def freedom(self) -> str:
        """Entry of the scene that lets the mechanism move by forces."""
        return f"drives.{self.mechanism.free_joints[0]}"

    @property
    def size(self) -> int:
        """Coordinates of all bodies."""
        return len(self.coordinates)

    @cached_property
    def coordinates(self) -> tuple[tuple[str, str], ...]:
        """Name and unit of every body's coordinates: its frame's x, y, phi, then its shapes."""
        found: list[tuple[str, str]] = []
        for body in self.counts:
            found += [(f"{body}.x", "m"), (f"{body}.y", "m"), (f"{body}.phi", "rad")]
            found += [self.engine.layout.positions[k] for k in self.engine.amplitudes(body)[0]]
        return tuple(found)

    @cached_property
    def reactions(self) -> tuple[tuple[str, str, str], ...]:
        """Name, unit and meaning of joint forces, then of forces and torques of prescribed drives."""
        joints = self.mechanism.joints
        found = [row for joint in joints.values() for row in reactions(joint)]
        driven = [name for name, drive in self.mechanism.drives.items() if not drive.free]
        return (*found, *(drive_reaction(joints[name]) for name in driven))

    @property
    def constraints(self) -> tuple[str, ...]:
        """Names of the reactions."""
        return tuple(name for name, *_ in self.reactions)

    @cached_property
    def start(self) -> dict[str, int]:
        """Body -> first place of its coordinates in q."""
        found, offset = {}, 0
        for name, (axial, transverse) in self.counts.items():
            found[name] = offset
            offset += BODY + axial + transverse
        return found

    def modal(self, body: str) -> slice:
        """Places of a body's modal coordinates in q."""
        first = self.start[body] + BODY
        return slice(first, first + sum(self.counts[body]))

    @cached_property
    def record(self) -> Columns:
        """Columns of the record, as ``coordinates`` and ``constraints`` name them."""
        layout, kept, place = self.engine.layout, self.engine.numbered, dict[str, int]()
        for k, (name, joint) in enumerate(self.mechanism.joints.items()):
            names = [*(row for row, *_ in reactions(joint)), f"{name}.drive"]
            own = kept.exerted[0, k] if name in layout.tree else kept.multipliers[0, layout.cuts[name]]
            place |= dict(zip(names, own.tolist(), strict=False))
        return self.engine.recorded(self.start, [np.array([place[name] for name in self.constraints], int)])

    def undeformed(self, times: np.ndarray, q: np.ndarray, v: np.ndarray) -> list[State]:
        """States at ``times`` [s] by frames x, y, phi of undeformed bodies, and their rates, (n_times, 3 bodies);
        loops are not closed."""
        engine, layout, joints = self.engine, self.engine.layout, self.mechanism.joints
        found, moved = np.zeros((len(times), engine.size), complex), q + 1j * _STEP * v
        poses = {body: moved[:, BODY * k : BODY * k + BODY].T for k, body in enumerate(self.start)}
        for body, name, fields in zip(layout.node_of, layout.inboard, engine.tables.bodies, strict=True):
            own = slice(fields[at.FIRST], fields[at.FIRST] + fields[at.DOF])
            if name is None:
                found[:, own] = poses[body].T
            elif fields[at.DOF]:
                found[:, own.start] = course(joints[name], poses)
        each = zip(times.tolist(), found.real.copy(), found.imag / _STEP, strict=True)
        return [State(t, y, u, 0.0 * u, engine.sizes.copy(), engine.choice) for t, y, u in each]

    def frames(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        """Frames and shapes of the bodies with their rates at a state, (size,) each; loops are not closed, and drives
        have their courses up to whole turns."""
        engine, turned = self.engine, dict[str, float]()
        engine.set(state)
        found, of = self.unfold(engine.row(state.t)[None])[0], self.record
        q = found[of.q]
        lost = np.where(engine.turns, whole_turns(state.q - engine.motion[0]), 0.0)  # drives now have their courses
        index, signs = [*engine.layout.node_of], engine.parts["frames"][:, SIGN]
        for body, fields, sign in zip(index, engine.tables.bodies, signs, strict=True):
            own = lost[fields[at.FIRST] : fields[at.FIRST] + fields[at.DOF]].sum()
            base = fields[at.PARENT_BODY]
            turned[body] = (turned[index[base]] if base >= 0 else 0.0) + sign * own
            q[self.start[body] + 2] += turned[body]
        return q, found[of.v]

    def project(self, t: float, q: np.ndarray, u: np.ndarray, choice: Choice) -> State:
        """State at t [s] near coordinates q of the tree with the independent ones of the speeds u; contacts are closed
        where their sides overlap.

        Raises
        ------
        ArithmeticError
            If a loop does not close, or the state is singular.
        """
        engine = self.engine
        engine.choose_speeds(choice)
        engine.part()
        engine.motion[0][:], engine.motion[1][:] = q, u
        if not engine.project(t):
            raise ArithmeticError(f"the loops don't close near t = {t:.6g} s")
        return engine.state(t, choice)

    def unfold(self, rows: np.ndarray) -> np.ndarray:
        """Records, see :class:`kaneflex.multibody.dynamics.arrays.Instants`, of rows of the engine with closed loops,
        (n_times, kept)."""
        found = self.engine.unfold(rows)
        found[:, self.record.forces[[name in self.undetermined for name in self.constraints]]] = np.nan
        return found

    def states(self, rows: np.ndarray, held: Sequence[int] = ()) -> np.ndarray:
        """Rows of the engine on the constraints, see :meth:`kaneflex.multibody.engine.Engine.states`.

        Raises ArithmeticError at a singular state.
        """
        found = self.engine.states(rows, held)
        if found is None:
            raise ArithmeticError("the constraints of a state determine neither accelerations nor reactions")
        return found


def build_system(scene: Scene, progress: Callable[[str], None]) -> tuple[CoupledSystem, float]:
    """Find or derive the module of a scene's laws, and bind its numbers.

    Returns the system and the seconds spent on deriving its module.
    """
    for name, body in scene.bodies.items():
        if body.elastic:
            check_modes(scene, name)
    module, seconds = find_laws_module(scene, progress)
    return bound_system(scene, module), seconds


def bound_system(
    scene: Scene, module: ModuleType, like: CoupledSystem | None = None, frozen: bool = False
) -> CoupledSystem:
    """System of a scene with its module.

    ``like``: system of a scene that differs in numbers only, and whose links' shapes have the same signs and scales;
    ``frozen`` keeps the space spanned by them.
    """
    stretching, element, links, shapes = with_stretch(scene), element_of(scene), dict[str, Link](), dict[str, Shapes]()
    for name, body in scene.bodies.items():
        if body.elastic:
            link = link_of_scene(stretching, name, body.beam.elements, element)
            kept = None if like is None or not frozen else spanned(scene, like.shapes[name], link)
            found = kept or link_shapes(scene, link, link_modes(scene, name))
            links[name], shapes[name] = link, found if like is None else alike(found, like.shapes[name])
    mechanism = mechanism_of(scene)
    counts = {name: shapes[name].counts if name in shapes else (0, 0) if body.modal is None else body.modal.counts
              for name, body in scene.bodies.items()}  # fmt: skip
    engine = build_engine(mechanism, module, Blocks(scene, counts, shapes), bind_parameters(scene, module))
    return CoupledSystem(module, engine, mechanism, links, shapes, counts)


def rigid_system(scene: Scene, module: ModuleType) -> CoupledSystem:
    """System of a scene with its module whose bodies are all rigid."""
    mechanism, counts = mechanism_of(scene), dict.fromkeys(scene.bodies, (0, 0))
    engine = build_engine(mechanism, module, Blocks(scene, counts, {}), bind_parameters(scene, module))
    return CoupledSystem(module, engine, mechanism, {}, {}, counts)


def check_modes(scene: Scene, name: str) -> None:
    """Check that a link's elements have the requested modes, before deriving equations."""
    modes, limit = link_modes(scene, name), most_modes(scene, name)
    check_family(scene, name, len(mesh(scene, name, scene.bodies[name].beam.elements)) - 1)
    if modes > limit:
        raise SceneError(
            "solve.modes", modes, f"the coupled equations take up to {limit} fixed-interface modes of {name}",
            "Use fewer modes, or more elements",
        )  # fmt: skip


def with_stretch(scene: Scene) -> Scene:
    """Scene with axially flexible beams: their finite elements have all coordinates, whatever shapes are kept."""
    bodies = {
        name: body.model_copy(update={"beam": body.beam.model_copy(update={"axially_rigid": False})})
        if body.elastic
        else body
        for name, body in scene.bodies.items()
    }
    return scene.seen(bodies=bodies)
