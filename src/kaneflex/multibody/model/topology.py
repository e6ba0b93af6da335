"""Tables of a planar mechanism from its spanning tree of bodies and the joints that close its loops."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from kaneflex.mechanism.mechanism import NumericMechanism
from kaneflex.mechanism.parts import Joint
from kaneflex.mechanism.planar import GROUND
from kaneflex.multibody.model.body_parameters import Blocks
from kaneflex.multibody.model.interactions import Branch, list_acts, side_of, virtual_inertias
from kaneflex.multibody.model.tree_builder import ORIGIN, Built, Names, TreeBuilder
from kaneflex.multibody.model.tree_layout import FIXED, FREE, SLIDE, TURN


class PlanarBuilder(TreeBuilder):
    """Rows of the tables of a planar mechanism in construction."""

    d = 3

    def __init__(self, blocks: Blocks) -> None:
        super().__init__(blocks.flexible)
        self.blocks = blocks

    def numbers_of_body(self, name: str) -> np.ndarray:
        return self.blocks.body(name)

    def numbers_of_station(self, body: str, rows: np.ndarray, G: np.ndarray) -> np.ndarray:
        return self.blocks.station(body, rows, G)

    def shape_names(self, body: str) -> tuple[Names, Names]:
        kinds = zip(("axial", "transverse"), self.blocks.counts[body], strict=True)
        names = [(f"{body}.{kind}_{k}", "m") for kind, count in kinds for k in range(count)]
        return names, names


def build_tables(mechanism: NumericMechanism, blocks: Blocks, switches: int = 0) -> Built:
    """Tables of a mechanism at rest with open loops; ``switches``: number of switches of loads' laws."""
    builder, order, drives = PlanarBuilder(blocks), _order(mechanism), mechanism.drives
    for body, joint, child in order:
        if joint is None:
            names = [(f"{body}.{part}", unit) for part, unit in (("x", "m"), ("y", "m"), ("phi", "rad"))]
            builder.body(body, builder.node(FREE, -1, names), ORIGIN, ORIGIN)
        else:
            _hang(builder, joint, child)
    prescribed = sorted((name for name, drive in drives.items() if not drive.free),
                        key=lambda name: drives[name].kind == "given")  # fmt: skip
    virtual = virtual_inertias(builder, mechanism, order)
    found = list_acts(builder, mechanism, prescribed, switches)
    driven = [builder.speed(name) if name in builder.tree else -1 for name in prescribed]
    elastic = [blocks.elastic(body) for body, *_ in order]
    rigid = any(contact.law == "newton" for contact in mechanism.contacts.values())
    light = any(mass <= 0.0 or second <= 0.0 for mass, _, _, second, *_ in builder.own.values())
    seconds = {name: side_of(joint.sides[1]) for name, joint in mechanism.joints.items()}
    return Built(
        builder.tables(found, mechanism.gravity, seconds), builder.layout(found.cuts, prescribed), builder.w, driven,
        found.angles, mechanism.size, switches, [K for K, _ in elastic], [C for _, C in elastic], rigid, virtual, light,
    )  # fmt: skip


def _hang(builder: PlanarBuilder, joint: Joint, child: int) -> None:
    """Add the node of a joint of the tree, and its outer body."""
    inner, outer = side_of(joint.sides[1 - child]), side_of(joint.sides[child])
    sign, angle, x, y = _tree_joint(joint, child)
    (parent, at), c, s = builder.on(inner), math.cos(angle), math.sin(angle)
    kind, axis, names = {
        "weld": (FIXED, ORIGIN, []),
        "revolute": (TURN, (0.0, 0.0, sign), [(f"{joint.name}.angle", "rad")]),
        "prismatic": (SLIDE, (c * x + s * y, c * y - s * x, 0.0), [(f"{joint.name}.position", "m")]),
    }[joint.kind]
    node = builder.node(kind, parent, names, place=(at[0], at[1], angle), axis=axis)
    builder.tree[joint.name] = (node,), 1 if child == 1 else -1
    builder.body(outer.body, node, outer.at, outer.at)


def _from(base: str, joints: Sequence[Joint], openness: Callable[[Joint], int]) -> list[tuple[str, Joint, int]]:
    """Bodies at the other ends of the joints of a body or of the ground, ordered by the joints' freedoms."""
    near = sorted((joint for joint in joints if base in joint.bodies), key=openness)
    sides = [1 if joint.first.body == base else 0 for joint in near]
    return [(joint.sides[child].body, joint, child) for joint, child in zip(near, sides, strict=True)]


def _order(mechanism: NumericMechanism) -> list[Branch]:
    """Bodies in the order of the tree, each with its branch.

    From the ground outwards, over the joints with the fewest freedoms first: prescribed ones and welds, pins, guides. A
    group without a joint to the ground is attached by a free joint at its body with a given position. A massless body
    at a free joint carries the next one if possible, as no leaf of a tree may be massless. Joints with friction become
    cuts: their reactions, on which friction depends, are then unknowns.
    """
    joints = [joint for name, joint in mechanism.joints.items() if name not in mechanism.frictions]
    lumped = {mass.point.body for mass in mechanism.masses.values()}

    def openness(joint: Joint) -> int:
        drive = mechanism.drives.get(joint.name)
        if joint.kind == "weld" or (drive is not None and not drive.free):
            return 0
        return 1 if drive is not None else 2

    def light(name: str) -> bool:
        body = mechanism.bodies[name]
        return not (body.elastic or body.mass or body.inertia or name in lumped)

    found: list[Branch] = []
    reached = [GROUND]
    waiting = list(mechanism.bodies)
    while waiting:
        for base in reached:  # grows while it is gone through: breadth first
            todo = _from(base, joints, openness)
            for body, joint, child in todo:  # grows, too, beyond bodies without mass
                if body in waiting:
                    waiting.remove(body)
                    reached.append(body)
                    found.append((body, joint, child))
                    if openness(joint) and light(body):
                        onwards = [branch for branch in _from(body, joints, openness) if branch[0] in waiting]
                        todo += sorted(onwards, key=lambda branch: light(branch[0]))[:1]
        if waiting:
            body = next((name for name in waiting if mechanism.bodies[name].free is not None), waiting[0])
            waiting.remove(body)
            found.append((body, None, 0))
            reached = [body]
    return found


def _tree_joint(joint: Joint, child: int) -> tuple[float, ...]:
    """Sign of the coordinate, angle and direction of the child's section in the parent's.

    If the child is the joint's first body, all are relative to the second: the direction turns back by the angle.
    """
    sign = 1.0 if child == 1 else -1.0
    angle = sign * float(joint.angle) if joint.kind != "revolute" else 0.0
    x, y = joint.direction
    if child == 0:
        c, s = math.cos(joint.angle), math.sin(joint.angle)
        x, y = -(c * x + s * y), -(c * y - s * x)
    return sign, angle, float(x), float(y)
