"""Assembly of a scene's system: its mechanism, the shapes of its elastic bodies, tables, and the engine."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from functools import partial
from types import ModuleType
from typing import Any

import numpy as np

from kaneflex.fem.links import make_link
from kaneflex.mechanism.floating_frames import link_modes, most_modes
from kaneflex.mechanism.mechanism import NumericMechanism, mechanism_of
from kaneflex.mechanism.numbers import mesh
from kaneflex.mechanism.parts import Body, Joint
from kaneflex.mechanism.planar import BodyPoint
from kaneflex.mechanism.spatial import SpatialMechanism
from kaneflex.multibody.dynamics.arrays import Instants
from kaneflex.multibody.engine import Engine
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.body_parameters import Blocks, SpatialBlocks
from kaneflex.multibody.model.layout import Kind
from kaneflex.multibody.model.module_loading import bind_parameters, element_of, find_laws_module
from kaneflex.multibody.model.shape_bases import alike, check_family, link_shapes, spanned, spatial_shapes
from kaneflex.multibody.model.shapes import Shapes
from kaneflex.multibody.model.system import System, has_slopes
from kaneflex.multibody.model.topology import build_tables
from kaneflex.multibody.model.tree_builder import AnyMechanism, Numbers, TreeBuilder
from kaneflex.multibody.model.tree_layout import BALL, COORDINATE, COUNT, KIND, ROW_OF, SHIFT, SPEED, Flexible, Place
from kaneflex.scene import Scene
from kaneflex.scene.options import limits_modes
from kaneflex.support.errors import SceneError

PLANE = 3
"""D of a mechanism in the plane."""
Views = dict[str, tuple[int, tuple[int, ...]]]
"""Places in the numbers w, and shapes, of arrays by their names."""


def build_system(
    scene: Scene, progress: Callable[[str], None], modes: int | None = None, elements: int | None = None
) -> tuple[System, float]:
    """Find or derive the module of a scene's laws, and bind its numbers; for rigid bodies without ``modes``, else see
    :func:`bound_system`.

    Returns the system and the seconds spent on deriving its module.
    """
    mechanism, limited = mechanism_of(scene), limits_modes(scene.solve)
    for name, body in mechanism.deforming.items() if mechanism.d == 3 else ():
        if modes is not None and body.elastic:
            check_modes(mechanism, name, modes, limited)
    module, seconds = find_laws_module(scene, progress)
    of = mechanism, module, bind_parameters(scene, module)
    return rigid_system(*of) if modes is None else bound_system(*of, modes, limited, elements), seconds


def bound_system(
    mechanism: AnyMechanism, module: ModuleType, p: np.ndarray, modes: int, limited: bool = False,
    elements: int | None = None, like: System | None = None, frozen: bool = False,
) -> System:  # fmt: skip
    """System of a mechanism with deforming bodies, its module of laws, and this one's parameters.

    ``modes``: of each link, in the plane ``limited`` to those that its elements have; ``elements``: of each link, by
    default its own; ``like``: system of a scene that differs in numbers only, and whose links' shapes have the same
    signs and scales; ``frozen`` keeps the space spanned by them.
    """
    space = isinstance(mechanism, SpatialMechanism)

    def shapes(name: str, held: Place | None, freed: str) -> Any:
        body, before = mechanism.deforming[name], None if like is None else like.shapes.get(name)
        if body.modal is not None:  # a local import lets others start faster
            from kaneflex.multibody.model.held_shapes import HeldShapes, held_shapes

            return held_shapes(body.modal, held, freed) if space else HeldShapes.in_plane(body.modal)
        assert body.beam is not None
        element = None if space else element_of(mechanism.deforming.values())
        link = make_link(mechanism, name, elements or body.beam.elements, element, stretches=not space)
        if frozen and before is not None:
            return alike(spanned(before, link, held[0] if space and held else None), before)
        if isinstance(mechanism, SpatialMechanism):
            found = spatial_shapes(link, modes, held, freed)
        else:
            found = link_shapes(link, link_modes(mechanism, name, modes, limited))
        return found if before is None else alike(found, before)

    return _system(mechanism, module, p, {name: partial(shapes, name) for name in mechanism.deforming})


def rigid_system(
    mechanism: AnyMechanism, module: ModuleType, p: np.ndarray, coupled: bool = False, rubs: bool = True
) -> System:
    """System of a mechanism whose bodies are all rigid, with its module of laws and this one's parameters.

    ``coupled``: see :class:`System`; ``rubs``: with friction.
    """
    return _system(mechanism, module, p, {}, coupled, rubs)


def _system(
    mechanism: AnyMechanism, module: ModuleType, p: np.ndarray, flexible: Flexible, coupled: bool = True,
    rubs: bool = True,
) -> System:  # fmt: skip
    """System with the shapes of its deforming bodies."""
    space, switches = isinstance(mechanism, SpatialMechanism), len(getattr(module, "SWITCHES", ()))
    in_laws = (*mechanism.drives, *mechanism.observed)
    integrates = coupled or not space or bool(mechanism.free_joints or mechanism.floating)
    blocks: Any = SpatialBlocks if space else Blocks
    whole = mechanism if space or not flexible else with_apart_masses(mechanism)
    built = build_tables(blocks(whole, flexible), in_laws, mechanism.prescribed, switches, rubs)
    kind = _kind(mechanism, switches, coupled or (integrates and has_slopes(mechanism, in_laws)))
    engine = engine_of(built, module, p, kind=kind, integrates=integrates)
    made = [(name, built.made[name]) for name in flexible]
    links = {name: each for name, each in made if isinstance(each, Shapes)}
    return System(module, mechanism, engine, links, coupled)


def with_apart_masses(mechanism: NumericMechanism) -> NumericMechanism:
    """Mechanism with rigid bodies, held by welds, in place of the lumped masses of deforming bodies, as in space: their
    inertia is that of their own motion, of which the numbers of a deforming body leave out squares of its shortening.
    Rotary inertia without mass stays.
    """
    bodies, joints, masses = dict(mechanism.bodies), dict(mechanism.joints), dict(mechanism.masses)
    for name, mass in mechanism.masses.items():
        if mass.mass and mass.point.body in mechanism.deforming:
            body = f"masses.{name}"
            bodies[body] = Body(body, False, mass.mass, (0.0, 0.0), mass.inertia)
            joints[body] = Joint(body, "weld", mass.point, BodyPoint(body, "start", (0.0, 0.0)))
            del masses[name]
    return replace(mechanism, bodies=bodies, joints=joints, masses=masses)


def _kind(mechanism: AnyMechanism, switches: int, stiff: bool) -> Kind:
    """Kind of a mechanism, also of the one whose joints with friction do not close loops; ``stiff``: with derivatives
    of springs, loads or shapes in the matrix of a step."""
    strikes = any(contact.law == "newton" for contact in mechanism.contacts.values())
    if isinstance(mechanism, SpatialMechanism):
        if strikes:
            return Kind.IMPACT_SPACE
        if mechanism.frictions or mechanism.contacts:
            return Kind.FRICTION_SPACE if mechanism.frictions else Kind.CONTACT_SPACE
        return Kind.SWITCHED_SPACE if switches else Kind.SPACE if stiff else Kind.RIGID_SPACE
    if mechanism.frictions:
        return Kind.FRICTIONS
    if strikes:
        return Kind.IMPACTS
    return Kind.CONTACTS if mechanism.contacts or switches else Kind.PLAIN


def check_modes(mechanism: NumericMechanism, name: str, asked: int, limited: bool) -> None:
    """Check that a link's elements have the requested modes, before deriving equations."""
    modes, limit = link_modes(mechanism, name, asked, limited), most_modes(mechanism, name)
    nodes = mesh(mechanism, name, mechanism.deforming[name].beam.elements)
    check_family(mechanism, name, len(nodes) - 1, modes)
    if modes > limit:
        raise SceneError(
            "solve.modes", modes, f"the coupled equations take up to {limit} fixed-interface modes of {name}",
            "Use fewer modes, or more elements",
        )  # fmt: skip


def engine_of(built: TreeBuilder, module: Any, p: np.ndarray, **more: Any) -> Engine:
    """Engine of a mechanism at rest, loops not closed; ``more``: further attributes."""
    parts, layout, acts, numbers = built.arrays(), built.layout, built.acts, built.w
    bodies, nodes, length = parts.pop("bodies"), parts["nodes"], built.mechanism.size
    counts = Counts(built, bodies)
    plan, views, size = assign(counts, built.courses, numbers)
    plan[at.MEASURE] = numbers.put([1.0 if unit == "rad" else length for _, unit in layout.coordinates])
    w = numbers.whole
    balls = nodes[nodes[:, KIND] == BALL][:, [COORDINATE, SPEED]] if counts.in_space else np.zeros((0, 2), int)
    of_balls = zip((counts.positions, counts.coordinates), balls.T, (4, 3), strict=True)
    own = np.column_stack([np.setdiff1d(np.arange(count), first[:, None] + np.arange(wide))
                           for count, first, wide in of_balls])  # fmt: skip
    parts |= {"balls": np.ascontiguousarray(balls), "own": own}
    parts["counts"] = np.array([
        counts.nodes, counts.coordinates, counts.positions, counts.sections, counts.axes, counts.bodies,
        views["kept"][1][0], counts.twists, views["geometry"][0], len(balls), len(own),
        counts.joints,
    ])  # fmt: skip
    assign_rows(plan, acts)
    of_joints = acts[built.ranges[4] : built.ranges[5]]
    of_joints = of_joints[of_joints[:, at.COURSE_AT] >= 0]
    springs = np.zeros((counts.coordinates, 2))
    np.add.at(springs, of_joints[:, at.COURSE_AT], w[of_joints[:, [at.NUMBERS_AT]] + np.arange(2)])
    parts |= dict(zip(("joint_stiffness", "joint_damping"), np.ascontiguousarray(springs.T), strict=True))
    kernels = tuple(getattr(module, name) for name in at.STRUCTURE_KERNELS)
    room, pairs = np.zeros(size), np.zeros(size, complex)
    p, tables = np.ascontiguousarray(p, float), at.Tables(plan, bodies, acts, w)
    engine = Engine(tables, layout, parts, views, kernels, p, room, pairs, light=built.is_light, **more)
    work, on_ground = engine.work, parts["on"] < 0
    work.offset[:] = parts["numbers"][:, SHIFT]
    work.row_measure[:] = np.where(built.angles, 1.0, length or 1.0)
    work.sections[on_ground, :3] = parts["at"][on_ground]
    if not counts.in_space:
        work.R[:, 0] = 1.0
    w[plan[at.TOUCH] + at.EXTENT] = length or 1.0
    return engine


class Counts:
    """Counts of the tables of a mechanism: parts, interactions, and numbers of its arrays.

    ``d``: numbers of a twist; ``coordinates``, ``positions``: speeds, and coordinates of a state, which have
    quaternions of balls; ``twists``: rows of phi; ``coupling``, ``square``: rows of E and numbers of L; ``ranges``:
    first places in ``acts`` of cuts, frictions, drives, loads, springs and contacts, the end, and the end of the forces
    and moments of loads; ``touching``: contacts and switches; ``joint_rows``, ``cut_rows``, ``rows``: of the cuts, with
    those of frictions, and with contacts; ``virtual``: most coordinates with virtual inertia.
    """

    def __init__(self, built: TreeBuilder, bodies: np.ndarray) -> None:
        mechanism = built.mechanism
        self.d, self.in_space, self.row_size = built.d, built.d != PLANE, 3 + 2 * built.d
        self.shapes: list[int] = bodies[:, at.SHAPES].tolist()
        self.bodies, self.joints, self.nodes = len(bodies), len(mechanism.joints), len(built.nodes)
        self.sections, self.axes = len(built.carriers), len(built.axes)
        self.coordinates, self.positions = len(built.speeds), len(built.positions)
        self.coupling, self.square = sum(self.shapes), sum(count**2 for count in self.shapes)
        self.twists = sum(node[COUNT] for node in built.nodes if node[ROW_OF] >= 0)
        self.ranges = *built.ranges, len(built.acts)
        _, self.frictions, self.drives, self.loads, self.springs, self.touching, _ = np.diff(self.ranges).tolist()
        self.pulls, self.courses, self.switches = self.loads + self.springs, len(built.driven), built.switches
        self.joint_rows = len(built.angles)
        self.cut_rows = self.joint_rows + self.frictions
        self.rows = self.cut_rows + self.touching
        rigid = any(contact.law == "newton" for contact in mechanism.contacts.values())
        self.reactions = self.cut_rows + self.touching * rigid
        self.works = 1 + self.loads + self.courses + self.frictions + self.touching
        self.virtual = self.coordinates * built.is_light


def assign(c: Counts, driven: Sequence[int], numbers: Numbers) -> tuple[np.ndarray, Views, int]:
    """Plan with counts and places, with room in ``numbers``; arrays there; length of the arrays of factors.

    ``driven``: the coordinate that each course prescribes, or -1 for that of a cut.
    """
    plan = np.zeros(at.PLAN, np.int64)
    plan[[at.BODIES, at.COORDINATES, at.WORKS]] = c.bodies, c.coordinates, c.works
    plan[[at.REACTIONS, at.CUT_ROWS, at.JOINT_ROWS]] = c.reactions, c.cut_rows, c.joint_rows
    plan[at.RIGID] = c.reactions - c.cut_rows
    plan[[at.CUTS, at.FRICTIONS, at.DRIVES, at.LOADS, at.SPRINGS, at.CONTACTS, at.ACTS]] = c.ranges[:-1]
    plan[[at.PUSHES, at.PUSHED]] = c.ranges[-2:]
    for what, count in _of_motion(c).items():
        plan[what] = numbers.room(count)
    plan[at.CONTACT] += at.CONTACT_SIZE * c.frictions
    n, d, pulls, rows = c.coordinates, c.d, c.pulls, c.rows + c.virtual
    plan[at.MASS_ROWS] = rows
    size = _in_turn(plan, 0, {
        at.TREE_I: d * d * c.bodies, at.TREE_E: d * c.coupling, at.TREE_L: c.square, at.TREE_U: d * n, at.TREE_D: n,
        at.TREE_X: d * c.bodies, at.TREE_WORK: d * max(c.shapes, default=0), at.COLUMNS: (rows + 1) * n,
        at.SCHUR: rows**2, at.REACTION: 2 * rows, at.WANTED: 2 * c.frictions + c.touching,
        at.SLOPE_COLUMNS: (n + rows) * pulls,
        at.SLOPE_SQUARE: pulls**2, at.SLOPE_FORCES: pulls, at.GIVEN: n * c.in_space,
        at.GIVEN_REACTION: c.reactions * c.in_space,
    })  # fmt: skip
    of_rows = dict.fromkeys((at.LOOP_PIVOTS, at.ROW_OF, at.DEPENDENT), c.reactions)
    of_rows |= {at.FREED: n, at.PRESCRIBED: c.courses, at.MASS_PIVOTS: 3 * rows * c.in_space}
    of_rows[at.FACTOR_ROWS] = c.touching + c.frictions + c.virtual
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
        "touching": (c.frictions + c.touching, at.RESULTS), "sizes": (c.loads,),
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
        "x": (max(64, (d + max(c.shapes, default=0)) ** 2),), "now": (3,), "virtual_inertia": (s,),
        "row_measure": (c.joint_rows,), **{f"mass_{k}": (size * in_space,) for k in range(3)},
        "geometry": (4 * (6 * (s + c.twists + b) + 6 * c.sections + c.row_size * c.rows) * in_space,),
    }  # fmt: skip
    views |= {name: (numbers.room(math.prod(shape)), shape) for name, shape in more.items()}
    for what, name in {at.RATE: "u", at.ACCEL: "du", at.NOW: "multipliers", at.SPRING: "springs",
                       at.SIZE: "sizes", at.POWER: "powers"}.items():  # fmt: skip
        plan[what] = views[name][0]
    return views | {"x3": views["x"]}


def assign_rows(plan: np.ndarray, acts: np.ndarray) -> None:
    """Set the interaction of every row: a cut or friction, then every contact."""
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
        at.MIDDLE: 6 * sections, at.MIDDLE_CUT: c.row_size * c.rows, at.STAGE_A: 3 * n,
        at.STAGE_R: 3 * reactions, at.STAGE_P: 3 * works, at.STAGE_C: 3 * c.courses, at.LAST_A: 3 * n,
        at.LAST_R: 3 * reactions, at.RESISTING: 3 * n,
        at.STAGE_F: 3 * c.frictions, at.RESISTING_R: 3 * reactions * c.in_space,
        at.CONTACT: at.CONTACT_SIZE * (c.frictions + c.touching),
        at.WAYS: n * (joints + pulls), at.SLOPES: 2 * (joints + 1) * pulls, at.VARIED: c.loads + 2 * c.switches,
        at.CROSSING: at.CHANGE_POINT + 3 * n + (3 + n) * reactions,
        at.TOUCH: at.SHARED + n * (c.touching + c.frictions),
        at.IMPACTS: 1 + at.IMPACT_SIZE * (at.MOST_IMPACTS + c.touching) * (c.touching > 0),
    }  # fmt: skip


def _in_turn(plan: np.ndarray, first: int, counts: Mapping[int, int]) -> int:
    """Assign consecutive places from the first; returns the place after them."""
    for what, count in counts.items():
        plan[what], first = first, first + count
    return first
