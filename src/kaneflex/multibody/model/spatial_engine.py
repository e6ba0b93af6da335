"""Engine of a mechanism in space: its arrays for compiled code."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from kaneflex.multibody.compile import spatial_library
from kaneflex.multibody.dynamics import spatial_entries
from kaneflex.multibody.dynamics.spatial_work import Work, arrays_of
from kaneflex.multibody.engine import Engine
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.layout import RIGID_SPACE, SPACE, STRUCTURE_KERNELS, SWITCHED_SPACE
from kaneflex.multibody.model.places import Counts, assign_rows
from kaneflex.multibody.model.spatial_layout import BALL, COORDINATE, COUNT, KIND, ROW_OF, SPEED, Tables
from kaneflex.multibody.model.state import Choice
from kaneflex.multibody.model.topology import Layout as PlanarLayout


@dataclass(frozen=True, eq=False)
class SpatialEngine(Engine):
    """Engine of a mechanism in space.

    Attributes
    ----------
    parts : mapping
        Arrays by their names in :data:`kaneflex.multibody.dynamics.spatial_work.SPACE`.
    work : Work
        Those that compiled functions fill.
    integrates : bool
        True if it uses the library that integrates motions.
    """

    parts: Mapping[str, np.ndarray] = field(default_factory=dict)
    work: Work = None  # type: ignore[assignment]
    integrates: bool = False

    def choose_speeds(self, choice: Choice) -> None:
        if self.chosen[0] is choice:
            return
        super().choose_speeds(choice)
        plan, speeds = self.tables.plan, np.flatnonzero(choice.virtual_inertia)
        plan[[at.BENDS, at.LED, at.YIELDING]] = 1, 0, len(speeds)
        plan[plan[at.TOUCHING] : plan[at.TOUCHING] + len(speeds)] = speeds
        self.parts["virtual_inertia"][:], self.work.now[2] = choice.virtual_inertia, len(choice.independent)

    @property
    def balls(self) -> np.ndarray:
        return self.parts["balls"]

    @property
    def own(self) -> np.ndarray:
        return self.parts["own"]

    @property
    def sections(self) -> np.ndarray:
        return self.work.sections

    @property
    def stiffness(self) -> np.ndarray:
        found, first = np.zeros((self.size, self.size)), 0
        for count, modal in self.tables.bodies[:, [at.SHAPES, at.MODAL]].tolist():
            own = slice(modal, modal + count)
            found[own, own] = self.parts["K"][first : (first := first + count**2)].reshape(count, count)
        return found

    @property
    def axes(self) -> np.ndarray:
        return self.work.axes

    @property
    def coordinates(self) -> np.ndarray:
        own, speeds = self.own.T
        self.work.q[own] = self.work.y[speeds]
        return self.work.q.copy()

    @property
    def sizes(self) -> np.ndarray:
        return self.work.sizes

    def advanced(self, q: np.ndarray, steps: np.ndarray) -> np.ndarray:
        out = np.tile(q, (len(steps), 1))
        self._call(spatial_entries.advance, np.ascontiguousarray(steps), len(steps), out)
        return out

    def row(self, t: float) -> np.ndarray:
        quaternions = self.work.q[self.balls[:, :1] + np.arange(4)].ravel()
        return np.concatenate([[t], *self.motion, self.standing, quaternions, np.zeros(self.count(at.WORKS))])

    def call(self, function: Any, *values: Any) -> Any:
        """Call an entry of :mod:`kaneflex.multibody.dynamics.spatial_entries`."""
        return self._call(function, *values)

    @cached_property
    def _entries(self) -> Mapping[Any, Callable[..., Any]]:  # type: ignore[override]
        return spatial_library.library(self.handed, self.integrates)

    @property
    def workspaces(self) -> Collection[str]:
        return {*vars(self.work), "mass_0", "mass_1", "mass_2"}

    @property
    def arrays(self) -> Mapping[str, np.ndarray]:
        every = {**super().arrays, **self.parts}
        return {name: every[name] for name in SPACE.parts}


def spatial_engine(system: Any) -> SpatialEngine:
    """Engine of a :class:`kaneflex.multibody.model.spatial_system.SpatialSystem`; at rest, loops not closed."""
    m, layout, counts = system.tables, system.layout, _counts(system)
    plan, w, work, places, size = arrays_of(m, counts, system.coordinates)
    in_order = sorted(layout.shapes.items(), key=lambda each: layout.node_of[each[0]])
    K, C = (np.concatenate([np.zeros(0), *(getattr(shapes, of).ravel() for _, shapes in in_order)])
            for of in ("stiffness", "damping"))  # fmt: skip
    for place, numbers in ((plan[at.MEASURE], system.measure), (places["springs"], _springs(m)), (plan[at.DAMPED], C)):
        w[place : place + len(numbers)] = numbers
    w[plan[at.TOUCH] + at.EXTENT] = system.mechanism.size or 1.0
    balls = m.nodes[m.nodes[:, KIND] == BALL][:, [COORDINATE, SPEED]]
    free = (np.arange(size) for size in (system.coordinates, system.speeds))
    own = np.column_stack([np.setdiff1d(every, first[:, None] + np.arange(wide))
                           for every, first, wide in zip(free, balls.T, (4, 3), strict=True)])  # fmt: skip
    real, *masses = (np.zeros(size) for _ in range(4))
    parts = m._asdict() | vars(work) | {
        "counts": None, "block": m.p, "axis_at": m.axes, "K": K, "twisting": m.springs[:, 3].copy(),
        "virtual_inertia": np.zeros(system.speeds), "row_measure": system.row_measure, "own": own,
        "balls": np.ascontiguousarray(balls),
        **{f"mass_{i}": each for i, each in enumerate(masses)},
    }  # fmt: skip
    parts["counts"] = np.array([
        len(m.nodes), system.speeds, system.coordinates, len(m.on), len(m.axis_on),
        len(m.bodies), len(work.kept), len(work.phi), places["geometry"], len(balls), len(own),
    ])  # fmt: skip
    del parts["p"], parts["bodies"]  # of the nodes; those of the engine have these names
    acts = _acts(system, places["springs"], counts.switches)
    assign_rows(plan, acts)
    tables = at.Tables(plan, m.bodies, np.zeros((0, 3), int), acts, w)
    kernels = tuple(getattr(system.module, name) for name in STRUCTURE_KERNELS)
    p = np.ascontiguousarray(system.parameters, float)
    units = np.where(system.turns, "rad", "m").tolist()
    names = PlanarLayout((), (), {}, (), tuple(zip(layout.speeds, units, strict=True)), ())
    stiff = system.coupled or (system.integrates and system.has_slopes)
    space, pair = SWITCHED_SPACE if counts.switches else SPACE if stiff else RIGID_SPACE, np.zeros(size, complex)
    return SpatialEngine(
        tables, names, kernels, p, real, pair, space, parts=parts, work=work, integrates=system.integrates
    )


def _counts(system: Any) -> Counts:
    m, shapes = system.tables, system.tables.bodies[:, at.SHAPES]
    cuts, joints, loads = len(m.cuts), len(system.known_joints), len(system.mechanism.loads)
    springs = len(m.springs) + 6 * len(m.bushings)
    twists, switches = m.nodes[m.nodes[:, ROW_OF] >= 0, COUNT], len(getattr(system.module, "SWITCHES", ()))
    return Counts(
        d=6, bodies=len(m.bodies), coordinates=system.speeds, sections=0, speeds=0, coupling=int(shapes.sum()),
        square=int((shapes**2).sum()), twists=int(twists.sum()), most=int(shapes.max(initial=0)),
        ranges=tuple(np.cumsum([0, cuts, 0, joints, loads, springs, switches]).tolist()), joint_rows=system.row_count,
        loads=loads, driven=system.driven_speeds.tolist(), switches=switches, rigid=False,
    )  # fmt: skip


def _springs(m: Tables) -> np.ndarray:
    """Stiffness, damping and free length of every row of a spring; of bushings along their axes, then about these."""
    bushings = m.cushions.reshape(-1, 2, 6).transpose(0, 2, 1).reshape(-1, 2)
    return np.concatenate([m.stiffness.ravel(), np.insert(bushings, 2, 0.0, axis=1).ravel()])


def _acts(system: Any, springs: int, switches: int) -> np.ndarray:
    """Cuts, joints in laws, loads, rows of springs, whose numbers begin at ``springs``, switches, forces of loads: see
    ``acts`` in :mod:`kaneflex.multibody.model.layout`."""
    m = system.tables
    found = m.cuts.tolist()
    for name in system.known_joints:
        slides = system.mechanism.joints[name].kind == "prismatic"
        speed = int(m.nodes[system.node(name), SPEED]) if name in system.told_joints else -1
        found.append((at.SLIDE if slides else at.TURN, 0, 0, speed, -1, -1))
    found += [(0, -1, -1, -1, -1, -1)] * len(system.mechanism.loads)
    rows = [(at.STRAIGHT if axis < 0 else at.TORSIONAL, *ends, axis) for *ends, axis, _ in m.springs.tolist()]
    rows += [(kind, *ends, axis + k) for *ends, axis, _ in m.bushings.tolist()
             for kinds in ((at.BUSHING, at.ALONG_AXIS, at.ALONG_AXIS), 3 * (at.ABOUT_AXIS,))
             for k, kind in enumerate(kinds)]  # fmt: skip
    found += [(*row[:3], -1, row[3], springs + 3 * k) for k, row in enumerate(rows)]
    found += [(at.SWITCH, 0, 0, 0, k, -1) for k in range(switches)]
    return np.array([*found, *m.pushes.tolist()], np.int64).reshape(-1, 6)
