"""Numbers of a mechanism in the plane or in space, what acts on it, and the nodes of its elastic links."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from kaneflex.mechanism.parts import Load
from kaneflex.mechanism.planar import GROUND
from kaneflex.scene.quantities import Address
from kaneflex.scene.scene import Scene

if TYPE_CHECKING:
    from kaneflex.mechanism.friction import Friction
    from kaneflex.scene import bodies, drives
    from kaneflex.scene.beams import Damping
    from kaneflex.scene.clearances import LooseJoint
    from kaneflex.scene.poses import Free

SAME = 1e-9
"""Distance below which points coincide, as a share of a link's length."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Numbers:
    """Numbers of a mechanism in the plane or in space, by the names of the scene's entries, in SI.

    ``size``: longest reach from a body's start [m], to compare lengths with; ``horizon``: duration of a run [s];
    ``frees``: initial states of free bodies; ``frictions``: by joint or contact; ``deforming``: bodies with a beam or
    modal data; ``points``: of bodies, in their axes, and of the ground; ``loose``: joints with a clearance, which
    contacts replace; ``backlash``: its middle at joints [rad]; ``shared``: joints at which elastic bodies share their
    rotation.
    """

    size: float
    horizon: float | None
    drives: Mapping[str, drives.Drive]
    frees: Mapping[str, Free]
    frictions: Mapping[str, Friction]
    deforming: Mapping[str, bodies.Body]
    points: Mapping[str, Mapping[str, tuple[float, ...]]]
    loose: Mapping[str, LooseJoint]
    backlash: Mapping[str, float]
    shared: frozenset[str]
    damping: Damping | None

    def point(self, address: Address) -> Any:
        """Position of a point [m] in its body's axes; for a fixed point in global axes."""
        return self.points[address.body][address.point]

    def turns_at(self: Any, name: str) -> bool:
        """True if the joint of this name is a pin, so that its friction is a torque."""
        return name in self.joints and self.joints[name].kind == "revolute"

    def written_coordinate(self: Any, joint: str, value: float) -> str:
        """Text of the coordinate of a joint [rad or m], like "90 deg" or "12.5 mm"."""
        slides = self.joints[joint].kind == "prismatic"
        scaled = round(1e3 * value if slides else math.degrees(value), 7) + 0.0  # rounding errors of zero are zero
        return f"{scaled:.6g} mm" if slides else f"{scaled:.6g} deg"

    def written(self, drives: Mapping[str, float]) -> str:
        """Text of coordinates of drives [rad or m], like "main = 90 deg, bore = 12.5 mm"."""
        return ", ".join(f"{name} = {self.written_coordinate(name, float(value))}" for name, value in drives.items())

    def address(self, side: Any) -> Address:
        """Name of a body's point, the first one there."""
        return Address(side.body, next(name for name, at in self.points[side.body].items() if at == side.at))

    @property
    def floating(self) -> tuple[str, ...]:
        """Free bodies."""
        return tuple(self.frees)

    @property
    def free_joints(self) -> tuple[str, ...]:
        """Joints with a free drive."""
        return tuple(name for name, drive in self.drives.items() if drive.kind == "free")

    @property
    def free(self) -> tuple[str, ...]:
        """Free joints and free bodies."""
        return self.free_joints + self.floating

    @property
    def prescribed(self) -> tuple[str, ...]:
        """Joints with a prescribed coordinate."""
        return tuple(name for name, drive in self.drives.items() if drive.kind != "free")

    def acting_on(self: Any, body: str) -> Iterator[Any]:
        """Points of a body at which joints, springs, contacts, point loads and lumped masses act."""
        sides = [side for of in (self.joints, self.springs, self.contacts) for each in of.values()
                 for side in getattr(each, "ends", each.sides)]  # fmt: skip
        sides += [load.point for load in self.loads.values() if load.point is not None]
        return (side for side in (*sides, *(mass.point for mass in self.masses.values())) if side.body == body)


def given_numbers(scene: Scene, reach: list[float]) -> dict[str, Any]:
    """Fields of :class:`Numbers`; ``reach``: distances of the joints from their bodies' starts [m]."""
    size = max([*reach, *(body.length or 0.0 for body in scene.bodies.values())]) or _way(scene) or 1.0
    joints, vector = scene.joints.items(), scene.vector
    points = {name: body.points_all for name, body in scene.bodies.items()}
    points[GROUND] = {"origin": (0.0, 0.0), **scene.ground}
    return {
        "size": float(size), "horizon": scene.horizon, "drives": scene.drives, "frees": scene.floating,
        "frictions": {name: _friction(held) for name, held in scene.frictions.items()},
        "deforming": {name: body for name, body in scene.bodies.items() if body.deforms},
        "points": {name: {point: vector(at) for point, at in own.items()} for name, own in points.items()},
        "loose": scene.loose,
        "backlash": {name: joint.clearance.middle for name, joint in joints
                     if joint.clearance is not None and joint.has_backlash},
        "shared": frozenset(name for name, joint in joints if joint.rotation == "shared"), "damping": scene.damping,
    }  # fmt: skip


def _way(scene: Scene) -> float:
    """Size [m] of a mechanism whose bodies have no lengths.

    It is the largest distance between bodies and contacts of the ground at the start, and of contacts on their bodies;
    the position of the scene does not matter.
    """
    places = [body.free.at for body in scene.bodies.values() if body.free is not None]
    found = [abs(drive.start) for name, drive in scene.drives.items() if name in scene.joints and scene.slides(name)]
    for contact in scene.contacts.values():
        if contact.kind != "angle":
            found.append(abs(contact.reach))
            for side in contact.sides:
                if side.body == GROUND:
                    places.append(scene.point(side))
                else:
                    found.append(math.hypot(*scene.point(side)))
    return max([*found, *(math.dist(place, places[0]) for place in places)], default=0.0)


def _friction(held: Any) -> Friction:
    """Parameters of a friction; the default of its static coefficient is the kinetic one."""
    from kaneflex.mechanism.friction import Friction

    static = held.mu if held.mu_static is None else held.mu_static
    dry = held.mu, static, held.stribeck_speed or 0.0, held.stribeck_exponent, held.viscous, held.preload
    return Friction(held.law, *dry, held.arm, held.bristle_stiffness or 0.0, held.bristle_damping)


def acting_parts(
    scene: Scene, joints: Mapping[str, Any], side: Callable[[Address], Any], touched: Callable[..., Any]
) -> dict[str, Any]:
    """Loads, springs and contacts of a mechanism in the plane or in space.

    ``side``: point of an address; ``touched``: second side of a contact, by it, its name and the points of both sides.
    """
    loads, springs, contacts = dict[str, Load](), dict[str, Any](), dict[str, Any]()
    if scene.springs or scene.contacts:
        from kaneflex.mechanism.contacts import Contact
        from kaneflex.mechanism.springs import Spring
    for name, load in scene.loads.items():
        point = None if load.force_on is None else side(load.force_on)
        ends = [side(Address(load.spread_on, end)) for end in ("start", "end")] if load.spread_on else []
        of_kind = load.direction, load.axes, load.torque_at, load.kind, load.against, load.law
        loads[name] = Load(name, point, *of_kind, (ends[0], ends[1], *load.profile) if ends else None)
    for name, spring in scene.springs.items():
        free, at = spring.length if spring.torsional_at is None else spring.angle, spring.torsional_at
        one, other = map(side, spring.ends) if at is None else joints[at].sides
        stiffness = spring.stiffnesses if spring.bushing else spring.stiffness
        damping = spring.dampings if spring.bushing else spring.damping
        springs[name] = Spring(name, one, other, at, stiffness, damping, free)
    for name, contact in scene.contacts.items():
        one, other = map(side, contact.sides)
        keys = "reach", "radius", "stiffness", "exponent", "damping", "restitution"
        own: dict[str, Any] = {key: contact.number(key) for key in keys} | {"law": contact.law, "joint": contact.joint}
        contacts[name] = Contact(
            name, one, touched(contact, name, one, other), contact.kind, contact.direction, **own
        )
    return {"loads": loads, "springs": springs, "contacts": contacts}


def forced_points(mechanism: Any, link: str) -> dict[str, float]:
    """Points between a link's ends where joints, loads, springs or masses act: name -> distance from the start [m]."""
    forced = {side.at[0] for side in mechanism.acting_on(link)}
    named = {name: at[0] for name, at in sorted(mechanism.points[link].items()) if name not in ("start", "end")}
    return {name: x for name, x in named.items() if x in forced}


def mesh(mechanism: Any, link: str, elements: int, also: Collection[float] = ()) -> np.ndarray:
    """Nodes at the ends, at points with a force, between segments and at ``also`` [m], ``elements`` of nearly equal
    length in all."""
    length, borders = mechanism.deforming[link].length, mechanism.deforming[link].profile.borders
    stops = _apart({0.0, length, *forced_points(mechanism, link).values(), *borders, *also}, length)
    counts = [max(1, round(elements * (b - a) / length)) for a, b in pairwise(stops)]
    spans = [np.linspace(a, b, n + 1)[:-1] for (a, b), n in zip(pairwise(stops), counts, strict=True)]
    return np.concatenate([*spans, [length]])


def _apart(stops: Collection[float], length: float) -> list[float]:
    """Sorted stops; coinciding stops count as the first."""
    ordered = sorted(stops)
    return [x for k, x in enumerate(ordered) if k == 0 or x - ordered[k - 1] > SAME * length]
