"""Places of a mechanism's numbers in its tables, from their counts, in the plane and in space."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields

import numpy as np

from kaneflex.multibody.dynamics.arrays import Instants
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.tree_builder import Numbers, TreeBuilder
from kaneflex.multibody.model.tree_layout import COUNT, ROW_OF

PLANE = 3
"""D of a mechanism in the plane."""
Views = dict[str, tuple[int, tuple[int, ...]]]
"""Places in the numbers w, and shapes, of arrays by their names."""


class Counts:
    """Counts of the tables of a mechanism: parts, interactions, and numbers of its arrays.

    ``d``: numbers of a twist; ``coordinates``, ``positions``: speeds, and coordinates of a state, which have
    quaternions of balls; ``twists``: rows of phi; ``coupling``, ``square``: rows of E and numbers of L; ``ranges``:
    first places in ``acts`` of cuts, holds, drives, loads, springs and contacts, the end, and the end of the forces and
    moments of loads; ``touching``: contacts and switches; ``joint_rows``, ``cut_rows``, ``rows``: of the cuts, with
    those of holds, and with contacts; ``virtual``: most coordinates with virtual inertia.
    """

    def __init__(self, built: TreeBuilder, bodies: np.ndarray) -> None:
        mechanism, cuts = built.of_bodies.mechanism, built.cuts
        self.d, self.in_space, self.row_size = built.d, built.d != PLANE, 3 + 2 * built.d
        self.shapes: list[int] = bodies[:, at.SHAPES].tolist()
        self.bodies, self.joints, self.nodes = len(bodies), len(mechanism.joints), len(built.nodes)
        self.sections, self.axes = len(built.carriers), len(built.axes)
        self.coordinates, self.positions = len(built.speeds), len(built.positions)
        self.coupling, self.square = sum(self.shapes), sum(count**2 for count in self.shapes)
        self.twists = sum(node[COUNT] for node in built.nodes if node[ROW_OF] >= 0)
        self.ranges = *built.ranges, len(built.acts)
        _, self.holds, self.drives, self.loads, self.springs, self.touching, _ = np.diff(self.ranges).tolist()
        self.pulls, self.courses, self.switches = self.loads + self.springs, len(built.driven), built.switches
        self.joint_rows = len(cuts.angles)
        self.cut_rows = self.joint_rows + self.holds
        self.rows = self.cut_rows + self.touching
        rigid = any(contact.law == "newton" for contact in mechanism.contacts.values())
        self.reactions = self.cut_rows + self.touching * rigid
        self.works = 1 + self.loads + self.courses + self.holds + self.touching
        self.virtual = self.coordinates * built.is_light


def assign(c: Counts, driven: Sequence[int], numbers: Numbers) -> tuple[np.ndarray, Views, int]:
    """Plan with counts and places, with room in ``numbers``; arrays there; length of the arrays of factors.

    ``driven``: the coordinate that each course prescribes, or -1 for that of a cut.
    """
    plan = np.zeros(at.PLAN, np.int64)
    plan[[at.BODIES, at.COORDINATES, at.WORKS]] = c.bodies, c.coordinates, c.works
    plan[[at.REACTIONS, at.CUT_ROWS, at.JOINT_ROWS]] = c.reactions, c.cut_rows, c.joint_rows
    plan[at.RIGID] = c.reactions - c.cut_rows
    plan[[at.CUTS, at.HOLDS, at.DRIVES, at.LOADS, at.SPRINGS, at.CONTACTS, at.ACTS]] = c.ranges[:-1]
    plan[[at.PUSHES, at.PUSHED]] = c.ranges[-2:]
    for what, count in _of_motion(c).items():
        plan[what] = numbers.room(count)
    plan[at.CONTACT] += at.CONTACT_SIZE * c.holds
    n, d, pulls, rows = c.coordinates, c.d, c.pulls, c.rows + c.virtual
    plan[at.MASS_ROWS] = rows
    size = _in_turn(plan, 0, {
        at.TREE_I: d * d * c.bodies, at.TREE_E: d * c.coupling, at.TREE_L: c.square, at.TREE_U: d * n, at.TREE_D: n,
        at.TREE_X: d * c.bodies, at.TREE_ROOM: d * max(c.shapes, default=0), at.COLUMNS: (rows + 1) * n,
        at.SCHUR: rows**2, at.REACTION: 2 * rows, at.WANTED: 2 * c.holds + c.touching,
        at.SLOPE_COLUMNS: (n + rows) * pulls,
        at.SLOPE_SQUARE: pulls**2, at.SLOPE_FORCES: pulls, at.GIVEN: n * c.in_space,
        at.GIVEN_REACTION: c.reactions * c.in_space,
    })  # fmt: skip
    of_rows = dict.fromkeys((at.LOOP_PIVOTS, at.ROW_OF, at.DEPENDENT), c.reactions)
    of_rows |= {at.FREED: n, at.PRESCRIBED: c.courses, at.MASS_PIVOTS: 3 * rows * c.in_space}
    of_rows[at.TOUCHING] = c.touching + c.holds + c.virtual
    of_rows |= dict.fromkeys((at.PIVOTS, at.PAIR_PIVOTS, at.CUT_OF), rows)
    of_rows |= dict.fromkeys((at.WITH_SLOPES, at.SLOPE_PIVOTS, at.SLOPE_PAIR_PIVOTS), pulls)
    plan = np.append(plan, np.zeros(_in_turn(plan, at.PLAN, of_rows) - at.PLAN, np.int64))
    plan[plan[at.FREED] : plan[at.FREED] + n] = 1
    for k in filter(lambda each: each >= 0, driven):
        plan[plan[at.FREED] + k] = 0
    plan[plan[at.PRESCRIBED] : plan[at.PRESCRIBED] + c.courses] = driven
    return plan, _views(c, plan, size, numbers), size


def _views(c: Counts, plan: np.ndarray, size: int, numbers: Numbers) -> Views:
    """Arrays in w by their names: those that are stored of an instant, see :class:`Instants`, then others.

    ``size``: length of the arrays of factors.
    """
    n, d, b, s, in_space = c.nodes, c.d, c.bodies, c.coordinates, int(c.in_space)
    stored = {
        "q": (c.positions,), "u": (s,), "du": (s,), "R": (n, 3, 3) if in_space else (n, 3), "r": (n, 3),
        **dict.fromkeys(("twist", "rate"), (n, d)), "exerted": (c.joints, d), "multipliers": (c.reactions,),
        "along": (s,), "springs": (c.springs, 5 + d // 3), "energies": (3,), "powers": (c.works,),
        "touching": (c.holds + c.touching, at.RESULTS), "sizes": (c.loads,),
    }  # fmt: skip
    views, first = Views(), numbers.size
    for each in fields(Instants):
        views[each.name] = numbers.room(math.prod(stored[each.name])), stored[each.name]
    views["kept"] = first, (numbers.size - first,)
    numbers.room(2 * c.switches)  # of loads' laws: they follow the sizes
    at_plan = {
        "y": (at.Y, (s,)), "J": (at.GRADIENT, (c.reactions, s)), "h": (at.DEMAND, (s,)),
        "I": (at.INERTIAS, (d * b, d)), "E": (at.COUPLINGS, (c.coupling, d)), "L": (at.MASSES, (c.square,)),
    }  # fmt: skip
    views |= {name: (int(plan[what]), shape) for name, (what, shape) in at_plan.items()}
    more = {
        **dict.fromkeys(("P", "moved", "offset"), (n, 3)), **dict.fromkeys(("wrenches", "slow"), (n, d)),
        "rows": (c.rows, c.row_size), "bent": (n * in_space, 3, 3), "S": (s, d),
        "phi": (c.twists, d), "sections": (c.sections, c.row_size), "axes": (c.axes, 3),
        "M": (s, s), "F": (n, d), "alpha": (3 * s * in_space,),
        "x": (max(64, (6 + max(c.shapes, default=0)) ** 2) * in_space,), "now": (3,), "virtual_inertia": (s,),
        "row_measure": (c.joint_rows,), **{f"mass_{k}": (size * in_space,) for k in range(3)},
        "geometry": (4 * (6 * (s + c.twists + b) + 3 * c.sections + c.row_size * c.rows) * in_space,),
    }  # fmt: skip
    views |= {name: (numbers.room(math.prod(shape)), shape) for name, shape in more.items()}
    for what, name in {at.RATE: "u", at.ACCEL: "du", at.NOW: "multipliers", at.SPRING: "springs",
                       at.SIZE: "sizes", at.POWER: "powers"}.items():  # fmt: skip
        plan[what] = views[name][0]
    return views | {"x3": views["x"]}


def assign_rows(plan: np.ndarray, acts: np.ndarray) -> None:
    """Set the interaction of every row: a cut or hold, then every contact."""
    of_cuts = np.searchsorted(acts[: plan[at.DRIVES], at.ROW_AT], np.arange(plan[at.CUT_ROWS]), side="right") - 1
    found = np.concatenate([of_cuts, np.arange(plan[at.CONTACTS], plan[at.ACTS])])
    plan[plan[at.CUT_OF] : plan[at.CUT_OF] + len(found)] = found


def _of_motion(c: Counts) -> dict[int, int]:
    """Numbers of the motion at each place of the plan, without those of :func:`_views`."""
    n, d, reactions, works, joints, pulls = c.coordinates, c.d, c.reactions, c.works, c.drives, c.pulls
    sections = c.sections * (not c.in_space)
    return {
        at.Y: n, at.COURSE: 3 * c.courses, at.X: 3 * joints + c.switches, at.INPUT: c.loads + c.courses,
        at.SUMS: c.row_size, at.DEMAND: n, at.SCALE: n, at.RATE_SCALE: n,
        at.ACCEL_SCALE: n, at.GRADIENT: reactions * n,
        at.LOOP: reactions**2, at.SIDE: reactions,
        at.INERTIAS: d * d * c.bodies, at.COUPLINGS: d * c.coupling, at.MASSES: c.square, at.AXES: d * n,
        at.PHI: d * c.twists, at.PLACES: 3 * c.bodies, at.ARMS: 3 * c.bodies,
        at.MIDDLE: 3 * sections, at.MIDDLE_CUT: c.row_size * c.rows, at.STAGE_A: 3 * n,
        at.STAGE_R: 3 * reactions, at.STAGE_P: 3 * works, at.STAGE_C: 3 * c.courses, at.LAST_A: 3 * n,
        at.LAST_R: 3 * reactions, at.RESISTING: 3 * n,
        at.STAGE_H: 3 * c.holds, at.RESISTING_R: 3 * reactions * c.in_space,
        at.CONTACT: at.CONTACT_SIZE * (c.holds + c.touching),
        at.WAYS: n * (joints + pulls), at.SLOPES: 2 * (joints + 1) * pulls, at.VARIED: c.loads + 2 * c.switches,
        at.CROSSING: at.CHANGE_POINT + 3 * n + (3 + n) * reactions,
        at.TOUCH: at.SHARED + n * (c.touching + c.holds),
        at.IMPACTS: 1 + at.IMPACT_SIZE * (at.MOST_IMPACTS + c.touching) * (c.touching > 0),
    }  # fmt: skip


def _in_turn(plan: np.ndarray, first: int, counts: Mapping[int, int]) -> int:
    """Assign consecutive places from the first; returns the place after them."""
    for what, count in counts.items():
        plan[what], first = first, first + count
    return first
