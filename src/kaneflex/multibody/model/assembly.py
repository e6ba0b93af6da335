"""Engine of a mechanism from its tables, in the plane and in space."""

from __future__ import annotations

from typing import Any

import numpy as np

from kaneflex.mechanism.mechanism import NumericMechanism
from kaneflex.multibody.engine import Engine
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.body_parameters import Blocks
from kaneflex.multibody.model.places import Counts, assign, assign_rows
from kaneflex.multibody.model.topology import build_tables
from kaneflex.multibody.model.tree_builder import Built, Numbers
from kaneflex.multibody.model.tree_layout import BALL, COORDINATE, KIND, SHIFT, SPEED


def build_engine(mechanism: NumericMechanism, module: Any, blocks: Blocks, p: np.ndarray) -> Engine:
    """Engine of a planar mechanism with its structure's module and the module's parameters."""
    given = sorted((name for name, drive in mechanism.drives.items() if not drive.free),
                   key=lambda name: mechanism.drives[name].kind == "given")  # fmt: skip
    in_laws, switches = (*mechanism.drives, *mechanism.observed), len(getattr(module, "SWITCHES", ()))
    return engine_of(build_tables(mechanism, blocks, in_laws, given, switches), module, p)


def engine_of(built: Built, module: Any, p: np.ndarray, **more: Any) -> Engine:
    """Engine of a mechanism at rest, loops not closed; ``more``: further attributes."""
    t, layout, counts = built.tables, built.layout, Counts.of(built)
    numbers = Numbers()
    numbers.put(built.w.whole)
    plan, views, size = assign(counts, numbers)
    plan[at.MEASURE] = numbers.put([1.0 if unit == "rad" else built.size for _, unit in layout.coordinates])
    w = numbers.whole
    balls = t.nodes[t.nodes[:, KIND] == BALL][:, [COORDINATE, SPEED]] if counts.in_space else np.zeros((0, 2), int)
    of_balls = zip((counts.positions, counts.coordinates), balls.T, (4, 3), strict=True)
    own = np.column_stack([np.setdiff1d(np.arange(count), first[:, None] + np.arange(wide))
                           for count, first, wide in of_balls])  # fmt: skip
    parts = {name: part for name, part in t._asdict().items() if name not in ("bodies", "acts", "ranges")}
    parts |= {"balls": np.ascontiguousarray(balls), "own": own, "K": _square(built.K), "C": _square(built.C)}
    parts["weightless"] = np.zeros(counts.coordinates) if built.virtual is None else built.virtual
    parts |= {"counts": np.array([
        counts.nodes, counts.coordinates, counts.positions, counts.sections, counts.axes, counts.bodies,
        views["kept"][1][0], counts.twists, views["geometry"][0], len(balls), len(own),
        counts.joints,
    ])}  # fmt: skip
    assign_rows(plan, t.acts)
    of_joints = t.acts[t.ranges[4] : t.ranges[5]]
    of_joints = of_joints[of_joints[:, at.COURSE_AT] >= 0]
    springs = np.zeros((counts.coordinates, 2))
    np.add.at(springs, of_joints[:, at.COURSE_AT], w[of_joints[:, [at.NUMBERS_AT]] + np.arange(2)])
    parts |= dict(zip(("joint_stiffness", "joint_damping"), np.ascontiguousarray(springs.T), strict=True))
    kernels = tuple(getattr(module, name) for name in at.STRUCTURE_KERNELS)
    room, pairs = np.zeros(size), np.zeros(size, complex)
    p = np.ascontiguousarray(p, float)
    tables = at.Tables(plan, t.bodies, t.acts, w)
    engine = Engine(tables, layout, parts, views, kernels, p, room, pairs, light=built.light, **more)
    work = engine.work
    work.offset[:], work.row_measure[:] = t.numbers[:, SHIFT], np.where(built.angles, 1.0, built.size or 1.0)
    work.sections[t.on < 0, :3] = t.at[t.on < 0]
    if not counts.in_space:
        work.R[:, 0] = 1.0
    w[plan[at.TOUCH] + at.EXTENT] = built.size or 1.0
    return engine


def _square(matrices: Any) -> np.ndarray:
    """Matrices of all bodies, one number after the other."""
    return np.concatenate([np.zeros(0), *(np.ravel(each) for each in matrices)])
