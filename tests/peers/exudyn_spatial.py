"""A scene in space as items of an Exudyn system: bodies and beams with Euler parameters, joints by multipliers.

Beams: geometrically exact, with displacements and rotations interpolated together on SE(3), as in Sonneville, Cardona &
Bruls (2014), Computer Methods in Applied Mechanics and Engineering 268.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.numbers import mesh
from kaneflex.mechanism.planar import GROUND
from kaneflex.mechanism.spatial import Side, SpatialBody, SpatialJoint, across
from kaneflex.mechanism.spatial_frame import AXES, SpatialFrame, slide_of, turn_of
from kaneflex.scene.sections import properties_of
from kaneflex_peers.buildable import stiffness_damping

if TYPE_CHECKING:
    from kaneflex.multibody.model.bound_model import Model
    from kaneflex.multibody.model.system import System
    from kaneflex.solve.curves import Resolution

_HELD = {
    "revolute": (1, 1, 1, 0, 1, 1),
    "prismatic": (0, 1, 1, 1, 1, 1),
    "cylindrical": (0, 1, 1, 0, 1, 1),
    "universal": (1, 1, 1, 1, 0, 0),
    "spherical": (1, 1, 1, 0, 0, 0),
    "weld": (1, 1, 1, 1, 1, 1),
}
"""Constrained translations and rotations of a joint along and about the axes of its frame, whose x is the joint's
axis; a universal joint has its first axis along y and its second along z."""

OF_BODIES = {
    "": "Position", "v_": "Velocity", "a_": "Acceleration", "axes_": "RotationMatrix", "omega_": "AngularVelocity",
    "epsilon_": "AngularAcceleration",
}  # fmt: skip
"""Exudyn's variables by what a rigid motion's names of them begin with."""


@dataclass(frozen=True, eq=False)
class Chain:
    """Beam elements of an elastic link: ``places`` [m] of its nodes along it, (elements + 1,)."""

    places: np.ndarray
    nodes: list[int]
    elements: list[int]

    def node_at(self, x: float) -> int:
        """Number of the node at x [m]; every named point has one."""
        return int(np.argmin(abs(self.places - x)))


@dataclass(frozen=True, eq=False)
class Built:
    """A scene's items in an Exudyn system.

    Attributes
    ----------
    exudyn : module
    system : MainSystem
    bodies, joints, springs : mapping of str to int
        Rigid bodies, the ground among them.
    links : mapping of str to Chain
    held : mapping of str to tuple of int
        Which translations and rotations of a joint's frame are held, drives' among them.
    frames : mapping of str to ndarray
        Axes of each joint's frame, global, at the start, columns of (3, 3).
    """

    exudyn: ModuleType
    system: Any
    bodies: dict[str, int]
    joints: dict[str, int]
    springs: dict[str, int]
    held: dict[str, tuple[int, ...]]
    frames: dict[str, np.ndarray]
    links: dict[str, Chain]

    def carrier(self, body: str, at: Sequence[float]) -> str:
        """Name of the body that carries a point in :class:`Bodies`: a rigid body, or an elastic link's node there."""
        return f"{body}@{self.links[body].node_at(at[0])}" if body in self.links else body

    @property
    def notes(self) -> tuple[str, ...]:
        """Differences from the scene."""
        rigid = "rigid bodies with Euler parameters, joints by multipliers at index 3, generalised-alpha"
        if not self.links:
            return (rigid,)
        count = max(len(chain.elements) for chain in self.links.values())
        return rigid, f"{count} geometrically exact beam elements a link, with shear and rotary inertia"


def build(exudyn: ModuleType, model: Model, resolution: Resolution) -> Built:
    """Build a scene in space in a new system, at the positions and speeds of the rigid mechanism at t = 0."""
    import exudyn.utilities  # whose functions become methods of a system

    built = Built(exudyn, exudyn.SystemContainer().AddSystem(), {}, {}, {}, {}, {}, {})
    builder = _Builder(built, model)
    for name, body in builder.mechanism.bodies.items():
        beam = model.scene.bodies[name].beam if name in model.scene.bodies else None  # a lumped mass is a body, too
        if beam is None:
            builder.body(name, body)
        else:
            builder.link(name, resolution.elements or max(8, 2 * beam.elements))
    for joint in builder.mechanism.joints.values():
        builder.joint(joint)
    for name in builder.mechanism.loads:
        builder.load(name)
    for name in builder.mechanism.springs:
        builder.spring(name)
    for name in builder.mechanism.contacts:
        builder.contact(name)
    return built


class _Builder:
    """Adds a scene's parts to an Exudyn system."""

    def __init__(self, built: Built, model: Model):
        import exudyn.itemInterface as items

        self.items, self.built, self.system = items, built, built.system
        self.model, self.scene, self.mechanism = model, model.scene, mechanism_of(model.scene)
        self.start = model.motion.at(0.0)
        self.state = _State(built, model.motion.module.system)
        self.built.bodies[GROUND] = self.system.AddObject(items.ObjectGround())

    def _vector(self, body: str, key: str) -> np.ndarray:
        return np.array([float(self.start[f"{body}.{key}_{axis}"][0]) for axis in "xyz"])

    def _stands(self, body: str) -> np.ndarray:
        """Axes of a body at the start, (3, 3)."""
        return SpatialFrame(self.start, body).axes[..., 0]

    def _place(self, side: Side) -> np.ndarray:
        return self.start.frame(side.body).place(side.at)[:, 0]

    def body(self, name: str, body: SpatialBody) -> None:
        turning, arm = self._vector(name, "omega"), self._stands(name) @ body.centre
        self.built.bodies[name] = self.system.CreateRigidBody(
            referencePosition=self._place(Side(name, tuple(body.centre))),
            referenceRotationMatrix=self._stands(name), initialAngularVelocity=turning,
            initialVelocity=self._vector(name, "v") + np.cross(turning, arm), gravity=[*self.mechanism.gravity],
            inertia=self.built.exudyn.utilities.RigidBodyInertia(mass=body.mass, inertiaTensor=body.about_centre),
        )  # fmt: skip

    def link(self, name: str, count: int) -> None:
        utilities = self.built.exudyn.utilities
        body = self.scene.bodies[name]
        places = mesh(mechanism_of(self.scene), name, count, [at[0] for at in body.points_all.values()])
        stands, turning = self._stands(name), self._vector(name, "omega")
        turned = utilities.RotationMatrix2EulerParameters(stands)
        turns = utilities.AngularVelocity2EulerParameters_t(turning, turned)
        nodes = []
        for x in places:
            velocity = self._vector(name, "v") + np.cross(turning, x * stands[:, 0])
            nodes.append(self.system.AddNode(self.items.NodeRigidBodyEP(
                referenceCoordinates=[*self._place(Side(name, (x, 0.0, 0.0))), *turned],
                initialVelocities=[*velocity, *turns],
            )))  # fmt: skip
        elements = []
        for pair, (start, stop) in zip(pairwise(nodes), pairwise(places), strict=True):
            section, length = self._section(name, 0.5 * (start + stop)), stop - start
            elements.append(self.system.AddObject(self.items.ObjectBeamGeometricallyExact(
                nodeNumbers=list(pair), length=length, sectionData=section
            )))  # fmt: skip
            if stiffness_damping(self.scene):
                self._damp(length, pair, np.array(section.stiffnessMatrix))
        self.built.links[name] = Chain(places, nodes, elements)
        if self.mechanism.gravity.any():
            for element in elements:
                marker = self.system.AddMarker(self.items.MarkerBodyMass(bodyNumber=element))
                self.system.AddLoad(self.items.LoadMassProportional(
                    markerNumber=marker, loadVector=[*self.mechanism.gravity]
                ))  # fmt: skip

    def _section(self, name: str, x: float) -> Any:
        """Section at x [m] for Exudyn's beams, which always have shear and rotary inertia."""
        piece = self.scene.bodies[name].profile.piece_at(x)
        section, (E, rho, G, _) = piece.at(x), piece.made_of
        assert E is not None and rho is not None  # checked with the scene
        known = section._replace(k_y=section.k_y or 1.0, k_z=section.k_z or 1.0)
        p = properties_of(known, E, G, rho, shear=True)
        found = self.built.exudyn.BeamSection()
        found.massPerLength = p.rho_A
        found.inertia = np.diag([p.rho_I_y + p.rho_I_z, p.rho_I_y, p.rho_I_z])
        found.stiffnessMatrix = np.diag([p.E_A, p.G_A_y, p.G_A_z, p.G_J, p.E_I_y, p.E_I_z])
        return found

    def _damp(self, length: float, nodes: tuple[int, int], stiffness: np.ndarray) -> None:
        """Add damping of an element's stretch, twist and bending, which Exudyn's beams lack, by the relative
        velocities of its two nodes."""
        beta = stiffness_damping(self.scene) / length
        markers = [self.system.AddMarker(self.items.MarkerNodeRigid(nodeNumber=node)) for node in nodes]
        self.system.AddObject(self.items.ObjectConnectorSpringDamper(
            markerNumbers=markers, stiffness=0.0, damping=beta * stiffness[0, 0], referenceLength=length
        ))  # fmt: skip
        turning = np.diag([0.0, 0.0, 0.0, *np.diag(stiffness)[3:]])
        self.system.AddObject(self.items.ObjectConnectorRigidBodySpringDamper(
            markerNumbers=markers, stiffness=np.zeros((6, 6)), damping=beta * turning
        ))  # fmt: skip

    def _marker(self, side: Side, axes: np.ndarray | None = None) -> int:
        """A marker at a point of a body; ``axes``: its own in the body's, (3, 3)."""
        stands = self._transform(side, np.eye(3) if axes is None else axes)
        if side.body in self.built.links:
            chain = self.built.links[side.body]
            node = chain.nodes[chain.node_at(side.at[0])]
            return self.system.AddMarker(self.items.MarkerNodeRigid(nodeNumber=node, localHT=stands))
        return self.system.AddMarker(
            self.items.MarkerBodyRigid(bodyNumber=self.built.bodies[side.body], localHT=stands)
        )

    def _transform(self, side: Side, axes: np.ndarray, on: Side | None = None) -> np.ndarray:
        """Axes and position on a body for Exudyn: relative to its centre of mass, on a link to the node at ``on``, by
        default at the point itself."""
        begins = np.zeros(3)
        if side.body in self.built.links:
            chain = self.built.links[side.body]
            begins[0] = chain.places[chain.node_at((on or side).at[0])]
        elif side.body != GROUND:
            begins = self.mechanism.bodies[side.body].centre
        return self.built.exudyn.HT(axes, np.array(side.at) - begins)

    def joint(self, joint: SpatialJoint) -> None:
        """Add a joint with coincident frames at the start; a prescribed freedom follows its drive's course."""
        axes = self._frame(joint)
        held, offset = list(_HELD[joint.kind]), {}
        drive = self.scene.drives.get(joint.name)
        if drive is not None and drive.kind != "free":
            moving = held.index(0)
            held[moving] = 1
            offset = {"offsetUserFunction": self._course(joint, moving, axes)}
        markers = [self._marker(side, self._stands(side.body).T @ axes) for side in joint.sides]
        self.built.held[joint.name], self.built.frames[joint.name] = tuple(held), axes
        self.built.joints[joint.name] = self.system.AddObject(self.items.ObjectJointGeneric(
            markerNumbers=markers, constrainedAxes=held, **offset
        ))  # fmt: skip

    def _frame(self, joint: SpatialJoint) -> np.ndarray:
        """Axes of a joint frame at the start."""
        first = self._stands(joint.sides[0].body)
        if joint.kind == "universal":
            body = joint.sides[1].body
            rest = self.mechanism.rest_axes
            turned = self._stands(body) @ rest(body).T @ rest(joint.sides[0].body)
            y, z = first @ joint.axes[0], turned @ joint.axes[1]
            return np.column_stack([np.cross(y, z), y, z])
        if not joint.axes:
            return first
        x = first @ joint.axes[0]
        return np.column_stack([x, *across(x)])

    def _course(self, joint: SpatialJoint, moving: int, axes: np.ndarray) -> Callable[..., list[float]]:
        """Course of a drive for Exudyn: a rotation about the frame's x since the start. A translation moves the marker
        on the first body along its guide instead, as an offset gives the guide's force no lever arm."""
        system = self.model.motion.module.system
        drive, start = system.driven.index(joint.name), float(self.start[f"{joint.name}.angle"][0])
        first = joint.sides[0]
        stands = self._stands(first.body).T @ axes

        def turned(there: object, t: float, item: int, parameters: object) -> list[float]:
            return [0.0, 0.0, 0.0, float(system.courses(t)[drive, 0]) - start, 0.0, 0.0]

        def slid(there: Any, t: float, item: int, parameters: object) -> list[float]:
            moved = Side(first.body, tuple(first.at + float(system.courses(t)[drive, 0]) * joint.axes[0]))
            marker = there.GetObjectParameter(item, "markerNumbers")[0]
            there.SetMarkerParameter(marker, "localHT", self._transform(moved, stands, first))
            return [0.0] * 6

        return turned if moving == 3 else slid

    def load(self, name: str) -> None:
        load, number = self.mechanism.loads[name], list(self.mechanism.loads).index(name)

        def size(t: float) -> float:
            return float(self.state.sizes(t)[number])

        for at, share in load.parts:
            push = share * np.array(load.direction)
            self.system.AddLoad(self.items.LoadForceVector(
                markerNumber=self._marker(at), bodyFixed=load.in_body,
                loadVectorUserFunction=lambda system, t, vector, push=push: [*(size(t) * push)],
            ))  # fmt: skip
        if load.joint is None:
            return
        joint = self.mechanism.joints[str(load.joint)]
        for side, sign in zip(joint.sides, (-1.0, 1.0), strict=True):
            if side.body != GROUND:
                axis = self._stands(side.body).T @ self._stands(joint.sides[0].body) @ joint.axes[0]
                self.system.AddLoad(self.items.LoadTorqueVector(
                    markerNumber=self._marker(side), bodyFixed=True,
                    loadVectorUserFunction=lambda system, t, vector, axis=sign * axis: [*(size(t) * axis)],
                ))  # fmt: skip

    def spring(self, name: str) -> None:
        spring = self.mechanism.springs[name]
        if spring.is_bushing:
            stand = np.eye(3), self.mechanism.relative(spring).T
            self.built.springs[name] = self.system.AddObject(self.items.ObjectConnectorRigidBodySpringDamper(
                markerNumbers=[self._marker(side, own) for side, own in zip(spring.sides, stand, strict=True)],
                stiffness=np.diag(spring.stiffness), damping=np.diag(spring.damping),
            ))  # fmt: skip
            return
        stiffness, damping, free = spring.stiffness, spring.damping, spring.free
        if spring.joint is None:
            self.built.springs[name] = self.system.AddObject(self.items.ObjectConnectorSpringDamper(
                markerNumbers=[self._marker(side) for side in spring.sides],
                stiffness=stiffness, damping=damping, referenceLength=free,
            ))  # fmt: skip
            return
        joint = self.mechanism.joints[spring.joint]
        axis = self._stands(joint.sides[0].body) @ joint.axes[0]
        axes = np.column_stack([*across(axis), axis])  # a spring's turns are about its markers' z
        self.built.springs[name] = self.system.AddObject(self.items.ObjectConnectorTorsionalSpringDamper(
            markerNumbers=[self._marker(side, self._stands(side.body).T @ axes) for side in joint.sides],
            stiffness=stiffness, damping=damping, offset=free - float(self.start[f"{spring.joint}.angle"][0]),
        ))  # fmt: skip

    def contact(self, name: str) -> None:
        """Add a contact of spheres, or of a ball in its socket, by Hertz's law or Hunt and Crossley's."""
        contact = self.mechanism.contacts[name]
        hollow = contact.kind == "circle-in-circle"  # the second side's sphere, in that of the first
        outer = contact.radius + contact.reach if hollow else contact.reach - contact.radius
        lossy = contact.law == "hunt-crossley"
        data = self.items.NodeGenericData(initialCoordinates=[0.0, 0.0, 0.0, 0.0], numberOfDataCoordinates=4)
        self.system.AddObject(self.items.ObjectContactSphereSphere(
            markerNumbers=[self._marker(contact.second), self._marker(contact.first)],
            nodeNumber=self.system.AddNode(data), spheresRadii=[contact.radius, outer], isHollowSphere1=hollow,
            contactStiffness=contact.stiffness, contactStiffnessExponent=contact.exponent,
            restitutionCoefficient=contact.restitution if lossy else 1.0, impactModel=int(lossy),
        ))  # fmt: skip


class Bodies:
    """Motions of Exudyn's bodies by the names of a rigid motion; ``times`` [s].

    A node of an elastic link counts as a body, whose start is that of the link if it were straight.
    """

    def __init__(self, times: np.ndarray):
        self.times, self.values = times, dict[str, np.ndarray]()

    def __getitem__(self, name: str) -> np.ndarray:
        return self.values[name]

    def put(self, body: str, found: Callable[[str], np.ndarray], at: float = 0.0) -> None:
        """Store Exudyn's results of a body at x = ``at`` [m], by the names of Exudyn's variables, (3 or 9, n_times)."""
        for head, variable in OF_BODIES.items():
            names = AXES if variable == "RotationMatrix" else "xyz"
            self.values |= {f"{body}.{head}{name}": row for name, row in zip(names, found(variable), strict=True)}
        if at:
            frame, start = SpatialFrame(self, body), (-at, 0.0, 0.0)
            moved = {"": frame.place(start), "v_": frame.velocity(start), "a_": frame.acceleration(start)}
            for head, rows in moved.items():
                self.values |= {f"{body}.{head}{axis}": row for axis, row in zip("xyz", rows, strict=True)}


class _State(Bodies):
    """States of Exudyn's bodies at the current instant of its run."""

    def __init__(self, built: Built, system: System):
        super().__init__(np.zeros(1))
        self.built, self.system, self.mechanism = built, system, system.mechanism
        self.angles: dict[str, float] = {}

    def sizes(self, t: float) -> np.ndarray:
        """Sizes of all loads [N or N m] at the current coordinates of joints."""
        known = [self._coordinate(name) for name in self.system.scalar_joints]
        coordinates, speeds = (np.array([pair[k] for pair in known]) for k in (0, 1))
        return self.system.magnitudes_at(np.array([t]), coordinates[None], speeds[None])[0]

    def _coordinate(self, name: str) -> tuple[float, float]:
        """Coordinate of a joint and its rate, with turns counted between calls."""
        joint = self.mechanism.joints[name]
        first, second = (self._frame(side) for side in joint.sides)
        if joint.kind == "prismatic":
            slide, speed, _ = slide_of(joint, first, second)
            return float(slide[0]), float(speed[0])
        (angle,), (rate,), _ = turn_of(joint, first, second, self.mechanism.relative(joint))
        turns = round((self.angles.get(name, 0.0) - angle) / (2.0 * np.pi))
        self.angles[name] = float(angle) + 2.0 * np.pi * turns
        return self.angles[name], float(rate)

    def _frame(self, side: Side) -> SpatialFrame:
        body, kinds, system = side.body, self.built.exudyn.OutputVariableType, self.built.system
        carrier = self.built.carrier(body, side.at)

        def found(variable: str) -> np.ndarray:
            if variable.endswith("Acceleration"):  # no law asks for it
                return np.zeros((3, 1))
            if body in self.built.links:
                chain = self.built.links[body]
                output = system.GetNodeOutput(chain.nodes[chain.node_at(side.at[0])], getattr(kinds, variable))
            else:
                start = -self.mechanism.bodies[body].centre
                number = self.built.bodies[body]
                output = system.GetObjectOutputBody(number, getattr(kinds, variable), localPosition=start)
            return np.ravel(output)[:, None]

        if body in self.built.links:
            chain = self.built.links[body]
            self.put(carrier, found, chain.places[chain.node_at(side.at[0])])
        elif body != GROUND:
            self.put(carrier, found)
        return SpatialFrame(self, carrier)
