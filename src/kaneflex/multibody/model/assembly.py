"""Assembly of a scene's system: its mechanism, the shapes of its elastic bodies, tables, and the engine."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from types import ModuleType
from typing import Any

import numpy as np

from kaneflex.fem.links import make_link
from kaneflex.mechanism.floating_frames import link_modes, most_modes
from kaneflex.mechanism.mechanism import NumericMechanism, mechanism_of
from kaneflex.mechanism.numbers import mesh
from kaneflex.mechanism.spatial import SpatialMechanism
from kaneflex.multibody.engine import Engine
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.body_parameters import Blocks, SpatialBlocks
from kaneflex.multibody.model.layout import Kind
from kaneflex.multibody.model.module_loading import bind_parameters, element_of, find_laws_module
from kaneflex.multibody.model.places import Counts, assign, assign_rows
from kaneflex.multibody.model.shape_bases import alike, link_shapes, spanned, spatial_shapes
from kaneflex.multibody.model.shape_families import check_family
from kaneflex.multibody.model.shapes import Shapes
from kaneflex.multibody.model.system import System, has_slopes
from kaneflex.multibody.model.topology import build_tables
from kaneflex.multibody.model.tree_builder import AnyMechanism, TreeBuilder
from kaneflex.multibody.model.tree_layout import (
    BALL,
    COORDINATE,
    KIND,
    SHIFT,
    SPEED,
    Deformable,
    Flexible,
    Place,
)  # fmt: skip
from kaneflex.scene import Scene
from kaneflex.scene.options import limits_modes
from kaneflex.support.errors import SceneError


def build_system(
    scene: Scene, progress: Callable[[str], None], modes: int | None = None, elements: int | None = None
) -> tuple[System, float]:
    """Find or derive the module of a scene's laws, and bind its numbers; of rigid bodies without ``modes``, else see
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

    flexible = {name: partial(shapes, name) for name in mechanism.deforming}
    if space:
        return _system(mechanism, module, p, flexible)
    made = {name: each(None, "") for name, each in flexible.items()}  # wherever the tree holds them
    held = {name: partial(_as_made, each) for name, each in made.items() if each.count}
    return _system(mechanism, module, p, held, made)


def rigid_system(
    mechanism: AnyMechanism, module: ModuleType, p: np.ndarray, coupled: bool = False, rubs: bool = True
) -> System:
    """System of a mechanism whose bodies are all rigid, with its module of laws and this one's parameters.

    ``coupled``: see :class:`System`; ``rubs``: with friction.
    """
    return _system(mechanism, module, p, {}, {}, coupled, rubs)


def _system(
    mechanism: AnyMechanism, module: ModuleType, p: np.ndarray, flexible: Flexible,
    made: Mapping[str, Deformable] | None = None, coupled: bool = True, rubs: bool = True,
) -> System:  # fmt: skip
    """System with the shapes of its deforming bodies; ``made``: those that do not depend on the tree."""
    space, switches = isinstance(mechanism, SpatialMechanism), len(getattr(module, "SWITCHES", ()))
    in_laws = (*mechanism.drives, *mechanism.observed)
    integrates = coupled or not space or bool(mechanism.free_joints or mechanism.floating)
    blocks: Any = SpatialBlocks if space else Blocks
    built = build_tables(blocks(mechanism, flexible), in_laws, mechanism.prescribed, switches, rubs)
    kind = _kind(mechanism, switches, coupled or (integrates and has_slopes(mechanism, in_laws)))
    engine = engine_of(built, module, p, kind=kind, integrates=integrates)
    shapes = engine.layout.shapes if made is None else made
    links = {name: each for name, each in shapes.items() if isinstance(each, Shapes)}
    return System(module, mechanism, engine, links, coupled)


def _as_made(shapes: Deformable, held: Place | None, freed: str) -> Deformable:
    """Shapes of a body, wherever they are held."""
    return shapes


def _kind(mechanism: AnyMechanism, switches: int, stiff: bool) -> Kind:
    """Kind of a mechanism, also of the one whose joints with friction do not close loops; ``stiff``: with derivatives
    of springs, loads or shapes in the matrix of a step."""
    if isinstance(mechanism, SpatialMechanism):
        if mechanism.frictions or mechanism.contacts:
            return Kind.HOLD_SPACE if mechanism.frictions else Kind.CONTACT_SPACE
        return Kind.SWITCHED_SPACE if switches else Kind.SPACE if stiff else Kind.RIGID_SPACE
    if mechanism.frictions:
        return Kind.HOLDS
    if any(contact.law == "newton" for contact in mechanism.contacts.values()):
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
    bodies, nodes, length = parts.pop("bodies"), parts["nodes"], built.of_bodies.mechanism.size
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
    work.row_measure[:] = np.where(built.cuts.angles, 1.0, length or 1.0)
    work.sections[on_ground, :3] = parts["at"][on_ground]
    if not counts.in_space:
        work.R[:, 0] = 1.0
    w[plan[at.TOUCH] + at.EXTENT] = length or 1.0
    return engine
