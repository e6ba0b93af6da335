"""Data of a planar model in one file: coordinates, masses, loads and joints at points of bodies and nodes of links."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, TypeAlias

import numpy as np

from kaneflex.mechanism.affine import as_array
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.rigid_bodies import FIXED, carried_bodies
from kaneflex.multibody.model.bound_model import Model
from kaneflex.scene.quantities import Address

Pair: TypeAlias = tuple[float, float]
Site: TypeAlias = tuple[str, int]
"""A link and its node; a rigid body has one, at its start."""


def pair(values: Sequence[float] | None) -> Pair:
    """Two components of a planar vector; whole numbers without decimals."""
    assert values is not None
    x, y = (int(value) if float(value).is_integer() else float(value) for value in values)
    return x, y


class Points:
    """Points of a model with elastic links."""

    def __init__(self, model: Model) -> None:
        assert model.frame is not None and model.interfaces is not None  # there are elastic links
        self.model, self.scene, self.links = model, model.scene, model.links
        self.frame, self.interfaces = model.frame, model.interfaces

    def at(self, address: Address) -> Pair:
        return pair(self.scene.point(address))

    def node(self, address: Address) -> int | None:
        return self.links[address.body].node_at(self.at(address)[0]) if address.body in self.links else 0

    def site(self, address: Address) -> Site:
        node = self.node(address)
        assert node is not None  # masses, loads and joints are at nodes
        return address.body, node

    def guided(self) -> dict[str, tuple[str, Pair, int]]:
        """Guided body -> body that carries the guide, direction in its axes, element of z."""
        found = {}
        for (body, _), joint, _ in carried_bodies(mechanism_of(self.scene)):
            guide = self.scene.joints[joint]
            column = int(np.flatnonzero(as_array(self.frame.bodies[body].pattern()).sum(axis=0))[0])
            found[body] = guide.addresses[0].body, pair(guide.direction), column
        return found

    def own(self) -> dict[str, tuple[list[int], list[int]]]:
        """Link -> rows of its coordinates q that are elements of z, and these elements."""
        found = {}
        for name, L in self.frame.maps.items():
            place = self.model.parts[name].place
            displaced = [row for link, node in self.interfaces.displaced
                         if link == name and node is not None for row in place[node][:2]]  # fmt: skip
            constant = as_array(L.terms.get((), np.zeros(L.shape))).copy()
            constant[displaced] = 0.0
            rows, columns = np.nonzero(constant)
            found[name] = rows.tolist(), columns.tolist()
        return found

    def joined(self) -> dict[Site, str | list[int]]:
        """Node at a joint -> guided body that moves it, or elements of z that displace it in global axes."""
        found: dict[Site, str | list[int]] = {}
        for (name, node), owner in self.interfaces.displaced.items():
            assert node is not None  # of a link
            if owner[1] is None and owner != FIXED:
                found[name, node] = owner[0]
            elif owner != FIXED:
                cosines = as_array(self.frame.maps[name].terms[(f"{name}.c",)])
                rows = self.model.parts[name].place[node][:2]
                found[name, node] = [int(np.flatnonzero(cosines[row])[0]) for row in rows]
        return found

    def _weighty(self) -> Iterator[tuple[str, Any, Site, Pair]]:
        """Path of a mass, the mass, and its place."""
        for name, body in self.scene.bodies.items():
            if not body.elastic and (body.mass or body.inertia):
                yield f"bodies.{name}", body, (name, 0), pair(body.centre)
        for name, mass in self.scene.masses.items():
            yield f"masses.{name}", mass, self.site(mass.at), self.at(mass.at)

    def masses(self) -> list[tuple[str, int, str, Pair]]:
        """Body, node, path of the numbers, position."""
        return [(*site, path, at) for path, _, site, at in self._weighty()]

    def weights(self) -> Iterator[tuple[str, float, str]]:
        """Path of a mass or inertia, its value, and the unit."""
        for path, each, *_ in self._weighty():
            yield f"{path}.mass", float(each.mass), "kg"
            yield f"{path}.inertia", float(each.inertia), "kg m^2"

    def forces(self) -> dict[str, tuple[str, int, Pair, str, Pair]]:
        """Load -> body, node, position, body whose axes its direction refers to, direction."""
        found = {}
        for name, load in self.scene.forces.items():
            assert load.force_on is not None
            axes = "ground" if load.axes == "global" else load.force_on.body
            found[name] = *self.site(load.force_on), self.at(load.force_on), axes, pair(load.direction)
        return found

    def joints(self) -> dict[str, tuple[object, ...]]:
        """Joint -> body in whose axes a direction is, this direction, the kinds of reactions, and for each side its
        sign, its site, and the body and position of the point of application."""
        found: dict[str, tuple[object, ...]] = {}
        for name, joint in self.scene.joints.items():
            slides, driven = joint.kind == "prismatic", name in self.scene.drives
            turns = joint.kind == "revolute" and not driven
            kinds = ["along"] * (driven or not slides) + ["across"] + ["moment"] * (not turns)
            axes = (joint.addresses[0].body, pair(joint.direction)) if slides else ("ground", (1, 0))
            sides = []
            for sign, address in zip((-1, 1), joint.addresses, strict=True):
                point = joint.addresses[1] if slides else address
                if address.body != "ground":
                    sides.append((sign, self.site(address), point.body, self.at(point)))
            found[name] = *axes, tuple(kinds), *sides
        return found
