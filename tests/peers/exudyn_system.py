"""A scene's parts as items of an Exudyn system."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from kaneflex.mechanism.body_frame import applied, normal, turning
from kaneflex.scene.quantities import Address
from kaneflex_peers.buildable import lumped, stiffness_damping, torque_by_speed

if TYPE_CHECKING:
    from kaneflex.multibody.model.bound_model import Model
    from kaneflex.solve.curves import Resolution


@dataclass(frozen=True, eq=False)
class Built:
    """A scene's items in an Exudyn system.

    Attributes
    ----------
    exudyn : module
    system : MainSystem
    nodes : mapping of str to list of int
        Of each body: one of a rigid body, elements + 1 of an elastic link.
    elements : mapping of str to list of int
        Of each elastic link.
    centres : mapping of str to pair of float
        Centre of mass of each rigid body with its lumped masses [m].
    joints, drives : mapping of str to int
    """

    exudyn: ModuleType
    system: Any
    nodes: dict[str, list[int]]
    elements: dict[str, list[int]]
    centres: dict[str, tuple[float, float]]
    joints: dict[str, int]
    drives: dict[str, int]

    @property
    def notes(self) -> tuple[str, ...]:
        """Differences from the scene."""
        count = max(map(len, self.elements.values()), default=0)
        return (f"{count} ANCF cable elements a link, nonlinear, joints at index 3, generalised-alpha",)


def build(exudyn: ModuleType, model: Model, resolution: Resolution) -> Built:
    """Build a scene in a new system, at the positions and speeds of the rigid mechanism at t = 0."""
    system = exudyn.SystemContainer().AddSystem()
    built = Built(exudyn, system, {}, {}, {}, {}, {})
    builder = _Builder(built, model)
    for name, body in model.scene.bodies.items():
        if body.elastic:
            builder.link(name, resolution.elements or max(8, 2 * body.beam.elements))
        else:
            builder.rigid_body(name)
    for name in model.scene.joints:
        builder.joint(name)
    for name in model.scene.drives:
        builder.drive(name)
    for name in model.scene.forces:
        builder.force(name)
    for name in model.scene.torques:
        builder.torque(name)
    return built


class _Builder:
    """Adds a scene's parts to an Exudyn system, at the places and speeds of the rigid mechanism at t = 0."""

    def __init__(self, built: Built, model: Model):
        import exudyn.itemInterface as items

        self.items, self.built, self.system = items, built, built.system
        self.model, self.scene = model, model.scene
        self.start = model.motion.at(0.0)
        self.ground = self.system.AddObject(items.ObjectGround())

    def _now(self, body: str, *keys: str) -> list[float]:
        return [float(self.start[f"{body}.{key}"][0]) for key in keys]

    def _state(self, body: str, x: float, y: float) -> tuple[np.ndarray, np.ndarray]:
        """Global place and velocity of a body's point."""
        frame = self.start.frame(body)
        return frame.place((x, y))[:, 0], frame.velocity((x, y))[:, 0]

    def rigid_body(self, name: str) -> None:
        mass, centre, inertia = lumped(self.scene, name)
        place, velocity = self._state(name, *centre)
        c, s, omega = self._now(name, "c", "s", "omega")
        coordinates, rates = [*place, math.atan2(s, c)], [*velocity, omega]
        node = self.system.AddNode(
            self.items.NodeRigidBody2D(referenceCoordinates=coordinates, initialVelocities=rates)
        )
        body = self.system.AddObject(self.items.ObjectRigidBody2D(mass=mass, inertia=inertia, nodeNumber=node))
        self.built.nodes[name], self.built.elements[name], self.built.centres[name] = [node], [body], centre
        self._weigh(body)

    def link(self, name: str, count: int) -> None:
        body = self.scene.bodies[name]
        c, s, omega = self._now(name, "c", "s", "omega")
        nodes = []
        for x in np.linspace(0.0, body.length, count + 1):
            place, velocity = self._state(name, x, 0.0)
            # a node's slope (c, s) is a unit vector that turns with the body
            nodes.append(self.system.AddNode(self.items.NodePoint2DSlope1(
                referenceCoordinates=[*place, c, s], initialVelocities=[*velocity, -omega * s, omega * c]
            )))  # fmt: skip
        beta = stiffness_damping(self.scene)
        elements = [
            self.system.AddObject(self.items.ObjectANCFCable2D(
                length=body.length / count, massPerLength=body.rho_A, nodeNumbers=list(pair),
                bendingStiffness=body.E_I, axialStiffness=body.E_A,
                bendingDamping=beta * body.E_I, axialDamping=beta * body.E_A, useReducedOrderIntegration=1,
            ))
            for pair in pairwise(nodes)
        ]  # fmt: skip
        self.built.nodes[name], self.built.elements[name] = nodes, elements
        for element in elements:
            self._weigh(element)
        for mass in self.scene.masses.values():
            if mass.at.body == name:
                self._point_mass(mass.at, mass.mass)

    def _weigh(self, body: int) -> None:
        if any(self.scene.gravity):
            marker = self.system.AddMarker(self.items.MarkerBodyMass(bodyNumber=body))
            load = self.items.LoadMassProportional(markerNumber=marker, loadVector=[*self.scene.gravity, 0.0])
            self.system.AddLoad(load)

    def _point_mass(self, at: Address, mass: float) -> None:
        """Add a mass point pinned to an elastic link."""
        place, velocity = self._state(at.body, *self.scene.point(at))
        node = self.system.AddNode(self.items.NodePoint2D(referenceCoordinates=[*place], initialVelocities=[*velocity]))
        body = self.system.AddObject(self.items.ObjectMassPoint2D(mass=mass, nodeNumber=node))
        marker = self.system.AddMarker(self.items.MarkerNodePosition(nodeNumber=node))
        self.system.AddObject(self.items.ObjectJointRevolute2D(markerNumbers=[self._marker(at), marker]))
        self._weigh(body)

    def _marker(self, at: Address) -> int:
        """Marker of a point that rotates with its body."""
        x, y = self.scene.point(at)
        if at.body == "ground":
            body = self.ground
        elif self.scene.bodies[at.body].elastic:
            elements, length = self.built.elements[at.body], self.scene.bodies[at.body].length
            # of a node the element behind it, also where rounding puts the point just before the node
            index = min(int(x / length * len(elements) + 1e-9), len(elements) - 1)
            body, x = elements[index], x - index * length / len(elements)
        else:
            (body,) = self.built.elements[at.body]
            x, y = x - self.built.centres[at.body][0], y - self.built.centres[at.body][1]
        return self.system.AddMarker(self.items.MarkerBodyRigid(bodyNumber=body, localPosition=[x, y, 0.0]))

    def joint(self, name: str) -> None:
        joint = self.scene.joints[name]
        markers = [self._marker(side) for side in joint.addresses]
        if joint.kind == "revolute":
            item = self.items.ObjectJointRevolute2D(markerNumbers=markers)
        else:
            first, second = (side.body for side in joint.addresses)
            angle = self._angle(first) - self._angle(second)
            across = normal(applied(turning(angle), joint.direction))
            item = self.items.ObjectJointPrismatic2D(
                markerNumbers=markers, axisMarker0=[*joint.direction, 0.0], normalMarker1=[*across, 0.0]
            )
        self.built.joints[name] = self.system.AddObject(item)

    def _angle(self, body: str) -> float:
        if body == "ground":
            return 0.0
        c, s = self._now(body, "c", "s")
        return math.atan2(s, c)

    def drive(self, name: str) -> None:
        """Add a prescribed rotation relative to the ground: of a rigid body, or of a massless hub that clamps a link's
        start."""
        if self.scene.drives[name].kind == "free":
            return
        first, second = self.scene.joints[name].addresses
        at, sign = (second, 1.0) if first.body == "ground" else (first, -1.0)
        (node, *_) = self.built.nodes[at.body]
        if self.scene.bodies[at.body].elastic:
            node = self._hub(at)
        ground = self.system.AddNode(self.items.NodePointGround())
        markers = [
            self.system.AddMarker(self.items.MarkerNodeCoordinate(nodeNumber=ground, coordinate=0)),
            self.system.AddMarker(self.items.MarkerNodeCoordinate(nodeNumber=node, coordinate=2)),  # x, y, angle
        ]
        self.built.drives[name] = self.system.AddObject(
            self.items.ObjectConnectorCoordinate(markerNumbers=markers, offsetUserFunction=self._turned(name, sign))
        )

    def _hub(self, at: Address) -> int:
        place, velocity = self._state(at.body, *self.scene.point(at))
        (omega,) = self._now(at.body, "omega")
        node = self.system.AddNode(self.items.NodeRigidBody2D(
            referenceCoordinates=[*place, self._angle(at.body)], initialVelocities=[*velocity, omega]
        ))  # fmt: skip
        hub = self.system.AddObject(self.items.ObjectRigidBody2D(mass=0.0, inertia=0.0, nodeNumber=node))
        marker = self.system.AddMarker(self.items.MarkerBodyRigid(bodyNumber=hub))
        clamp = self.items.ObjectJointGeneric(
            markerNumbers=[marker, self._marker(at)], constrainedAxes=[1, 1, 0, 0, 0, 1]
        )
        self.system.AddObject(clamp)
        return node

    def _turned(self, name: str, sign: float) -> Callable[..., float]:
        """Rotation of a drive since t = 0 as a function for Exudyn, from the scene's own kernel."""
        motion, start = self.model.motion, float(self.start[f"{name}.angle"][0])
        if self.scene.drives[name].kind == "constant speed":
            rate = sign * self.scene.drives[name].speed
            return lambda mbs, t, item, offset: rate * t
        return lambda mbs, t, item, offset: sign * (float(motion.at(t)[f"{name}.angle"][0]) - start)

    def force(self, name: str) -> None:
        load = self.scene.forces[name]
        x, y = load.direction
        # a table finer than the scene's steps: Exudyn asks for the size at times of its own
        times = np.linspace(0.0, self.scene.horizon, 20 * self.model.options.steps + 1)
        sizes = self.model.motion.at(times)[name]
        period = times[-1] * (1 + 1e-12)  # an end that rounding puts just behind the horizon is the end

        def push(mbs: object, t: float, vector: object) -> list[float]:
            size = float(np.interp(t % period, times, sizes))
            return [size * x, size * y, 0.0]

        item = self.items.LoadForceVector(markerNumber=self._marker(load.force_on), loadVectorUserFunction=push)
        self.system.AddLoad(item)

    def torque(self, name: str) -> None:
        """Add a torque T_0 + c omega at a joint as a damper with an own torque, which both count as resistances."""
        found = torque_by_speed(self.scene, name)
        assert found is not None  # `check_buildable` has looked
        markers = [self._marker(side) for side in self.scene.joints[self.scene.loads[name].torque_at].addresses]
        self.system.AddObject(self.items.ObjectConnectorTorsionalSpringDamper(
            markerNumbers=markers, damping=-found[1], torque=-found[0]
        ))  # fmt: skip
