"""A scene bound to its coupled module: kernels, numbers, and how the state is laid out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import ModuleType

import numpy as np

from kaneflex.fem.links import Link, build_link, mesh
from kaneflex.mechanism.floating_frames import frame_of, modes_of, shape_counts, stations
from kaneflex.multibody.binding import bind_parameters, find_coupled_module
from kaneflex.multibody.inertia_integrals import body_numbers
from kaneflex.multibody.shape_families import check_family
from kaneflex.multibody.shapes import Shapes, alike, link_shapes, spanned
from kaneflex.scene import Scene
from kaneflex.support.errors import SceneError

MOST_MODES = 12
"""Modes of a link beyond which deriving its equations would take minutes."""
BODY = 3
"""Coordinates x, y, phi of every body, before its modal ones."""
_RANK = 1e-9
"""Share of a unit vector below which a direction counts as none."""


@dataclass(frozen=True, eq=False)
class CoupledSystem:
    """The coupled equations of a scene with its numbers.

    Attributes
    ----------
    module : ModuleType
        Generated kernels ``equations``, ``constraints``, ``tangent`` and ``energy``.
    parameters : ndarray
        Their argument p.
    links, shapes : mapping of str
        Finite elements and modal coordinates of every elastic link.
    """

    module: ModuleType
    parameters: np.ndarray
    links: Mapping[str, Link]
    shapes: Mapping[str, Shapes]

    @property
    def size(self) -> int:
        """Coordinates of all bodies."""
        return len(self.module.COORDINATES)

    @property
    def constraints(self) -> tuple[str, ...]:
        """Names of the multipliers: joint reactions, then forces and torques of prescribed drives."""
        return tuple(name for name, *_ in self.module.CONSTRAINTS)

    @cached_property
    def start(self) -> dict[str, int]:
        """Body -> where its coordinates begin in q."""
        found, offset = {}, 0
        for name, (axial, transverse) in self.module.BODIES.items():
            found[name] = offset
            offset += BODY + axial + transverse
        return found

    def modal(self, body: str) -> slice:
        """Where a body's modal coordinates are in q."""
        first = self.start[body] + BODY
        return slice(first, first + sum(self.module.BODIES[body]))

    def compile(self) -> None:
        """Call every kernel once, so that compiling is seen and timed apart from computing."""
        n, m = self.size, len(self.constraints)
        q, v, a, multipliers = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(m)
        self.module.equations(0.0, q, v, self.parameters, np.zeros((n, n)), np.zeros(n))
        self.module.constraints(0.0, q, v, self.parameters, np.zeros(m), np.zeros(m), np.zeros((m, n)), np.zeros(m))
        self.module.tangent(0.0, q, v, a, multipliers, self.parameters, np.zeros((n + m, n)), np.zeros((n + m, n)))
        self.module.energy(0.0, q, v, self.parameters, np.zeros(3 + len(self.module.LOADS)))

    def measure(self, length: float) -> np.ndarray:
        """What counts as one in each coordinate: ``length`` [m], or 1 rad."""
        return np.where([unit == "rad" for _, unit in self.module.COORDINATES], 1.0, length)

    def accelerations(
        self, t: float, q: np.ndarray, v: np.ndarray, still: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """q'', the multipliers and the constraints' partial rates in time, of a state that satisfies them.

        Coordinates ``still`` are not accelerated, as far as the constraints don't accelerate them.
        Raises LinAlgError where the constraints determine neither.
        """
        n, m = self.size, len(self.constraints)
        M, f = np.zeros((n, n)), np.zeros(n)
        g, g_t, G, gamma = np.zeros(m), np.zeros(m), np.zeros((m, n)), np.zeros(m)
        self.module.equations(t, q, v, self.parameters, M, f)
        self.module.constraints(t, q, v, self.parameters, g, g_t, G, gamma)
        rows = G if still is None else np.vstack([G, _left_free(G, still)])
        square = np.block([[M, -rows.T], [rows, np.zeros((len(rows),) * 2)]])
        x = np.linalg.solve(square, np.concatenate([f, -gamma, np.zeros(len(rows) - m)]))
        return x[:n], x[n : n + m], g_t

    @cached_property
    def rigid_rows(self) -> np.ndarray:
        """Where x, y, phi of the bodies are in q."""
        return np.array([k + j for k in self.start.values() for j in range(BODY)])


def _left_free(G: np.ndarray, still: np.ndarray) -> np.ndarray:
    """Combinations of some coordinates (rows, n) that no constraint of G (m, n) determines."""
    sizes = np.linalg.norm(G, axis=1, keepdims=True)
    _, strength, directions = np.linalg.svd(G / np.where(sizes, sizes, 1.0))
    free = directions[int((strength > _RANK).sum()) :]
    mixed, reach, _ = np.linalg.svd(free[:, still].T)
    count = int((reach > _RANK).sum())
    found = np.zeros((count, G.shape[1]))
    found[:, still] = mixed[:, :count].T
    return found


def build_system(scene: Scene, progress: Callable[[str], None]) -> tuple[CoupledSystem, float]:
    """Find or derive the coupled module of a scene, and bind its numbers.

    Returns the system and the seconds spent on deriving its module.
    """
    counts = shape_counts(scene)
    beams = [name for name in counts if scene.bodies[name].elastic]
    for name in beams:
        check_modes(scene, name)
    module, seconds = find_coupled_module(scene, counts, progress)
    stretching = with_stretch(scene)
    links = {name: build_link(stretching, name, module, scene.bodies[name].beam.elements) for name in beams}
    shapes = {name: link_shapes(scene, link, modes_of(scene)) for name, link in links.items()}
    numbers = body_numbers(scene, module, links, shapes)
    return CoupledSystem(module, bind_parameters(scene, module, numbers), links, shapes), seconds


def neighbour_system(system: CoupledSystem, scene: Scene, frozen: bool) -> CoupledSystem:
    """The system of a scene that differs in numbers alone; ``frozen`` where its shapes keep the space they span."""
    stretching = with_stretch(scene)
    links = {
        name: build_link(stretching, name, system.module, scene.bodies[name].beam.elements) for name in system.links
    }
    shapes = {}
    for name, link in links.items():
        found = spanned(system.shapes[name], link) if frozen else link_shapes(scene, link, modes_of(scene))
        shapes[name] = alike(found, system.shapes[name])
    numbers = body_numbers(scene, system.module, links, shapes)
    return CoupledSystem(system.module, bind_parameters(scene, system.module, numbers), links, shapes)


def check_modes(scene: Scene, name: str) -> None:
    """A link's elements must have the modes that the scene asks for, before equations with as many are derived."""
    nodes = len(mesh(scene, name, scene.bodies[name].beam.elements))
    modes, static = modes_of(scene), shape_counts(scene)[name][1] - modes_of(scene)
    check_family(scene, name, nodes - 1)
    frame = frame_of(stations(scene, name)).kind
    limit = min(2 * nodes - (1 if frame == "mean" else 2) - (frame == "mean") - static, MOST_MODES)
    if modes > limit:
        raise SceneError(
            "solve.modes", modes, f"the coupled equations take up to {limit} fixed-interface modes of {name}",
            "Ask for fewer modes" + ("" if limit == MOST_MODES else ", or give the link more elements"),
        )  # fmt: skip


def with_stretch(scene: Scene) -> Scene:
    """The scene with every beam free to stretch: its finite elements have all coordinates, whatever shapes are kept."""
    bodies = {
        name: body.model_copy(update={"beam": body.beam.model_copy(update={"axially_rigid": False})})
        if body.elastic
        else body
        for name, body in scene.bodies.items()
    }
    return scene.seen(bodies=bodies)
