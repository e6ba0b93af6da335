"""The elastic stage of a mechanism in space: its parts, their connections, and their motion scalars."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kaneflex.fem.assembly import (
    parts_of_links,
    pushed_nodes,
    sparse_part,
    spring_part,
    torsion_part,
    with_pushes,
)
from kaneflex.fem.coordinate_map import Frame, Interfaces, Placed
from kaneflex.fem.links import Link, Part, jumps, make_link, spread_scalar
from kaneflex.fem.spatial_bodies import ARMS, PAIRS, rigid_part
from kaneflex.fem.spatial_joined import Joined, held_nodes
from kaneflex.fem.spatial_map import SpatialMap, map_of
from kaneflex.mechanism.affine import Affine
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.rigid_bodies import Tie
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.mechanism.spatial import SpatialMechanism
from kaneflex.mechanism.wrenches import Wrench, wrenches_on
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.determinacy import self_equilibrated, with_shares, without_work
from kaneflex.multibody.model.system import COMPONENTS
from kaneflex.multibody.time.spatial_motion import SpatialKinematics, SpatialMotion
from kaneflex.scene.options import Options
from kaneflex.support.contract import AXES, SPATIAL_LINK_SCALARS
from kaneflex.support.errors import SceneError

_SAMPLES = 33
"""Instants of a run that determine the varying entries of L and check the dependent coordinates."""
_NONE = 1e-7
"""Share of the largest force below which one by self-equilibrated multipliers counts as zero."""
_LEFT_OUT = (
    "constraints are redundant: some of the forces on rigid {bodies} are statically indeterminate, and their effect on "
    "the stiffness of small rotations is neglected"
)
_ON_RIGID = {f"{kind}_{axis}": 3 * k + i for k, kind in enumerate(("push", "turn")) for i, axis in enumerate(AXES)}
"""Loads on a rigid body -> their rows."""
_PARALLEL = 1e-12
"""Sine of an angle between an axis and another, or a plane, that counts as parallel."""
_IRREGULAR = 0.381966
"""Place of irregular instants between two even ones, unlikely to be special positions."""


@dataclass(frozen=True, eq=False)
class Deforming:
    """Scalars ``BODY.link.NAME`` of a rigid motion for the elastic stage, beside frames.

    For an elastic link SPATIAL_LINK_SCALARS, jumps of its axial force, and loads on its nodes; for a rigid body the
    same accelerations, ARMS, and its loads. ``map`` has the parts' coordinates.
    """

    mechanism: SpatialMechanism
    links: Mapping[str, Link]
    parts: Mapping[str, Part]
    map: SpatialMap

    def scalars(self, motion: RigidMotion) -> tuple[tuple[str, str, str], ...]:
        """Name, unit and meaning, by any instants of a motion."""
        return (*((name, unit, meaning) for name, unit, meaning, _ in self._rows(motion)), *self.map.scalars)

    def table(self, motion: RigidMotion) -> np.ndarray:
        """The scalars at the instants of a motion, (n_times, n)."""
        return np.hstack([np.array([row for *_, row in self._rows(motion)]).T, self.map.table(motion)])

    def _rows(self, motion: RigidMotion) -> Iterator[tuple[str, str, str, np.ndarray]]:
        """Scalars that do not belong to ``map``: name, unit, meaning, and values at the instants of a motion."""
        mechanism, still = self.mechanism, np.zeros((3, len(motion.times)))
        for name in self.parts:
            frame, head, acting = motion.frame(name), f"{name}.link", list(wrenches_on(mechanism, motion, name))
            moving = frame.omega, frame.epsilon, frame.acceleration(np.zeros(3)) - mechanism.gravity[:, None]
            rows = np.concatenate(list(map(frame.to_body, moving)))
            for (each, unit, meaning), row in zip(SPATIAL_LINK_SCALARS, rows, strict=False):
                yield f"{head}.{each}", unit, meaning, row
            if name not in self.links:
                yield from self._of_rigid(name, rows[6:], motion, acting)
                continue
            link, spread = self.links[name], spread_on(mechanism, name)
            acting = [each for each in acting if each.by not in spread]
            at = [link.node_at(each.on[0]) for each in acting]
            for node in (0, *map(int, jumps(mechanism, name, link.nodes))):
                pulls = [each.force[0] for each, own in zip(acting, at, strict=True) if own == node]
                of = (f"{head}.jump_{node}", "N", f"by which the axial force is higher beyond node {node}")
                each, unit, meaning = SPATIAL_LINK_SCALARS[-1]
                yield *(of if node else (f"{head}.{each}", unit, meaning)), -sum(pulls, still[0])
            for node in pushed_nodes(link):
                pushes = [each.force for each, own in zip(acting, at, strict=True)
                          if own == node and each.by in mechanism.loads]  # fmt: skip
                yield from _by_axes(f"{head}.push_{node}", "N", f"of loads on node {node}", sum(pushes, still))
            for by in spread:
                direction = np.outer(mechanism.loads[by].direction, motion[by])
                direction = direction if mechanism.loads[by].in_body else frame.to_body(direction)
                for axis, row in zip(AXES, direction, strict=True):
                    yield spread_scalar(name, by, axis), "N/m", f"of {by} along the link", row
        for name in self.map.joined.springs:
            spring = mechanism.springs[name]
            first, second = (motion.frame(side.body).place(side.at) for side in spring.sides)
            if spring.is_directed:
                length = np.linalg.norm(second - first, axis=0)
                yield f"{name}.pull", "N/m", "tension by length", motion[f"{name}.tension"] / length
            else:
                force = -spring.stiffness * (second - first)
                yield from _by_axes(f"{name}.force", "N", "on the second point, global", force)

    def _of_rigid(
        self, name: str, specific_force: np.ndarray, motion: RigidMotion, acting: Sequence[Wrench]
    ) -> Iterator[tuple[str, str, str, np.ndarray]]:
        """The same of loads on a rigid body."""
        mechanism, body, frame = self.mechanism, self.mechanism.bodies[name], motion.frame(name)
        weight = -body.mass * frame.to_body(frame.acceleration(body.centre) - mechanism.gravity[:, None])
        arms = np.einsum("it,j->ijt", weight, body.centre)
        arms += sum(np.einsum("it,jt->ijt", each.force, each.at) for each in acting)
        for each, (i, j) in zip(ARMS, (map("xyz".index, pair) for pair in PAIRS), strict=True):
            yield f"{name}.link.{each}", "N m", "of all that acts at arms from the start", (arms[i, j] + arms[j, i]) / 2
        given = [each for each in acting if each.by in mechanism.loads and mechanism.loads[each.by].joint is None]
        still = np.zeros_like(specific_force)
        turns = (each.moment + np.cross(each.at, each.force, axis=0) for each in given)
        yield from _by_axes(f"{name}.link.push", "N", "of loads", sum((each.force for each in given), still))
        yield from _by_axes(f"{name}.link.turn", "N m", "of the same, about the start", sum(turns, still))


def _by_axes(head: str, unit: str, meaning: str, rows: np.ndarray) -> Iterator[tuple[str, str, str, np.ndarray]]:
    """Components of a vector as scalars."""
    for axis, row in zip(AXES, rows, strict=True):
        yield f"{head}_{axis}", unit, meaning, row


@dataclass(frozen=True, eq=False)
class DeformingKinematics(SpatialKinematics):
    """Rigid motion of a mechanism in space with the scalars of its elastic stage."""

    deforming: Deforming

    def at(self, times: np.ndarray | float, record: np.ndarray | None = None) -> SpatialMotion:
        rigid = self.rigid_only.at(times)
        out = np.hstack([rigid.values, self.deforming.table(rigid)])
        out[:, [self.column[name] for name in self.module.CONSTANTS]] = 0.0
        out[:, [self.column[name] for name in self.module.open_reactions if name in self.column]] = np.nan
        return SpatialMotion(self, rigid.times, out)


def with_elastic_parts(model: Model, frozen: Mapping[str, np.ndarray]) -> Model:
    """Model with the meshed links, coordinates and scalars of a mechanism in space; ``frozen``: bases to reduce to.

    Raises
    ------
    SceneError
        For entries that elastic bodies in space do not support, and for undetermined motions.
    """
    options, motion = model.options, model.in_space
    assert motion is not None
    mechanism, own = motion.module.system.mechanism, mechanism_of(model.scene)  # whose elements may differ
    for name, spring in mechanism.springs.items():
        if spring.is_bushing:
            reason = "with elastic bodies only preset coupled supports bushings"
            raise SceneError(f"springs.{name}.bushing", None, reason, "Use preset coupled, or rigid")
    motion = SpatialKinematics(replace(motion.module, more=()), motion.parameters, motion.curve)
    links = {name: make_link(own, name, options.elements or body.beam.elements)
             for name, body in own.deforming.items() if body.beam is not None}  # fmt: skip
    held = {name: held_nodes(mechanism, link) for name, link in links.items()}
    ties = tuple(Tie((name, node), on[0]) for name, at in held.items() for node, on in at.items())
    own = {tie.site: tie.site for tie in ties}
    interfaces = Interfaces(ties, frozenset(tie.joint for tie in ties), own, own, {})
    elastic, bases = parts_of_links(options, links, interfaces, frozen)
    parts = {name: elastic[name] if name in links else _loaded(mechanism, name) for name in mechanism.bodies}
    held_too = [name for name, drive in mechanism.drives.items()
                if drive.rotation == "held" or not any(side.body in links for side in mechanism.joints[name].sides)]
    held_too += [name for name in mechanism.joints if name in mechanism.shared]
    times = np.append(0.0, options.duration * (np.arange(_SAMPLES) + _IRREGULAR) / _SAMPLES)
    times = times[:1] if motion.is_start else times
    found = map_of(Joined(mechanism, links, parts, held_too), motion.at(times))
    maps = {name: found.of(name) for name in parts}
    moving = {name for name in parts if name in links or maps[name].terms}
    deforming = Deforming(mechanism, links, parts, found)
    whole = Affine.constant(np.eye(6))
    placed = [Placed(part, maps[name], () if name in links else (((name, None), whole),))
              for name, part in parts.items()]  # fmt: skip
    placed += [found.place(sparse_part(name, 1, F=Affine.term((name,), [[1.0]])), load.joint)
               for name, load in mechanism.loads.items() if load.joint is not None]  # fmt: skip
    springs = [found.place(torsion_part(name, spring.stiffness, spring.damping), spring.joint)
               for name, spring in mechanism.springs.items() if spring.joint is not None]  # fmt: skip
    for name in found.joined.springs:
        of = mechanism.springs[name]
        springs.append(Placed(spring_part(name, of.stiffness, of.damping, of.is_directed, "xyz"), found.of(name)))
    frame = Frame(found.coordinates, {name: maps[name] for name in links},
                  {name: maps[name] for name in parts if name in moving and name not in links})  # fmt: skip
    scalars = deforming.scalars(motion.at(times[:1]))
    lost = _open_scalars(deforming, [name for name, *_ in scalars], motion, times[:: _SAMPLES // 8])
    arms = frozenset(name for name in lost if name.rpartition(".")[2] in ARMS)
    _check_pulls(lost - arms, options)
    stiffened = sorted({name.partition(".")[0] for name in arms} & moving)
    warnings = (_LEFT_OUT.format(bodies=", ".join(stiffened)),) if stiffened and options.geometric else ()
    absent = dict.fromkeys([*_absent(mechanism), *arms], 0.0)
    lost = motion.module.open_reactions | (lost - arms)
    module = replace(motion.module, more=scalars, CONSTANTS=absent, open_reactions=lost)
    moved = DeformingKinematics(module, motion.parameters, motion.curve, deforming)
    return replace(model, motion=moved, links=links, parts={name: parts[name] for name in links}, bases=bases,
                   interfaces=interfaces, frame=frame, placed=tuple(placed),
                   sprung={each.part.name: each for each in springs}, warnings=warnings)  # fmt: skip


def _loaded(mechanism: SpatialMechanism, name: str) -> Part:
    """Rigid body with rows for the loads on it, if there are any."""
    pushed = any(side.body == name for load in mechanism.loads.values() for side, _ in load.pushes)
    return with_pushes(rigid_part(name, mechanism.bodies[name]), _ON_RIGID if pushed else {})


def _absent(mechanism: SpatialMechanism) -> Iterator[str]:
    """Scalars that are zero by structure: arms on lumped masses, and, if the joints let all bodies move in parallel
    planes only, motion across these."""
    yield from (f"{name}.link.{each}" for name in mechanism.lumped for each in ARMS)
    moves = [(kind, mechanism.rest_axes(joint.sides[0].body) @ axis)
             for joint in mechanism.joints.values() for kind, axis in joint.moves]  # fmt: skip
    normal = next((axis for kind, axis in moves if kind == "angle"), np.zeros(3))
    across = {"angle": np.eye(3) - np.outer(normal, normal), "position": normal}
    level = all(kind in across and abs(across[kind] @ axis).max() < _PARALLEL for kind, axis in moves)
    heavy = abs(normal @ mechanism.gravity) > _PARALLEL * np.linalg.norm(mechanism.gravity)
    for body in mechanism.bodies if level and not mechanism.floating else ():
        turns = abs(mechanism.rest_axes(body).T @ normal) > _PARALLEL
        still = {"omega": ~turns, "epsilon": ~turns, "a": turns & (turns.sum() == 1) & ~heavy}
        yield from (f"{body}.link.{kind}_{AXES[k]}" for kind, mask in still.items() for k in np.flatnonzero(mask))


def spread_on(mechanism: SpatialMechanism, link: str) -> list[str]:
    """Loads that are spread along a link."""
    return [name for name, load in mechanism.loads.items()
            if load.spread is not None and load.spread[0].body == link]  # fmt: skip


def _open_scalars(
    deforming: Deforming, names: Sequence[str], motion: SpatialKinematics, times: np.ndarray
) -> frozenset[str]:
    """Names of statically indeterminate ones among the scalars, which self-equilibrated multipliers change."""
    system, found = motion.module.system, set[str]()
    joints = len(deforming.mechanism.joints)
    columns = [motion.column[name] for name in system.constraints[: 6 * joints]]
    unit = np.tile(np.repeat([1.0, 1.0 / deforming.mechanism.size], 3), joints)
    for t in times:
        forces = without_work(system, motion.curve(float(t)))[:, : 6 * joints]
        if len(forces):
            here = motion.at(np.full(2 * len(forces), t))  # an instant for each, and for its opposite
            here.values[::2, columns], here.values[1::2, columns] = forces, -forces
            table, largest = deforming.table(here), abs(forces * unit).max(axis=1, keepdims=True)
            changed = (abs(table[::2] - table[1::2]) > _NONE * largest).any(axis=0)
            found |= {name for name, one in zip(names, changed, strict=True) if one}
    return frozenset(found)


def _check_pulls(lost: Collection[str], options: Options) -> None:
    """Check that forces of geometric stiffness are statically determinate."""
    concerned = sorted({name.partition(".")[0] for name in lost})
    if concerned and options.geometric:
        raise SceneError(
            f"bodies.{concerned[0]}", None, "constraints are redundant: the forces in the geometric stiffness of "
            "this body are statically indeterminate",
            "Use preset linear, leave out solve.terms.geometric, or remove redundant constraints, for example by a "
            "spherical joint in place of a revolute one",
        )  # fmt: skip


def undetermined(found: SpatialMap, motion: SpatialMotion) -> frozenset[str]:
    """Names of the forces and moments of joints and drives that are statically indeterminate at some instants of a
    motion.

    As :func:`kaneflex.multibody.model.determinacy.undetermined`, for a mechanism whose links deform.
    """
    joined, names, units = found.joined, set[str](), {name: unit for name, unit, _ in motion.system.reactions}
    J, where = joined.rows(motion), joined.where
    for instant in range(len(motion.times)):
        here, at = J[0, instant] * joined.measure[joined.tied], motion.taken(np.array([instant]))
        scale = abs(here).max(axis=1, initial=1e-300)
        for combination in self_equilibrated(here / scale[:, None]).T:
            forces = dict[str, float]()
            for name, own in where.items():
                wrench, drive = joined.exerted(at, name, (combination / scale)[None, own])
                parts = [*wrench.ravel().tolist(), *([] if drive is None else drive.ravel().tolist())]
                forces |= zip((f"{name}.{part}" for part in (*COMPONENTS, "drive")), parts, strict=False)
            reactions = [(name, units.get(name, "N")) for name in forces]
            names |= with_shares(reactions, np.array([[*forces.values()]]), motion.mechanism.size, True)
    return frozenset(names)
