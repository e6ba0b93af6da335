"""The parts of a mechanism over any kind of number: what derivation and run have in common.

Where equations are derived a number is a symbol, or exactly 0, 1 or -1; where they run it is a float in SI.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from kaneflex.mechanism.planar import BodyPoint, Number, Vector

ROWS = {"revolute": ("force_x", "force_y"), "weld": ("force_x", "force_y", "moment"), "prismatic": ("normal", "moment")}
"""Kind of a joint -> its constraints in their order, by what their multipliers are."""


def floating_coordinates(body: str) -> tuple[str, str, str]:
    """Names of a body's coordinates where joints let it move freely."""
    return f"{body}.x", f"{body}.y", f"{body}.phi"


@dataclass(frozen=True)
class Body:
    """A body: mass [kg], mass centre [m], inertia about it [kg m^2]; a pose where it stands still.

    ``free``: the pose [m, m, rad] at first of one that joints let move freely in the plane; known by numbers alone.
    """

    name: str
    elastic: bool
    mass: Number
    centre: Vector
    inertia: Number
    pose: tuple[Number, Number, Number] | None = None
    free: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class Joint:
    """A joint between a point of the first body and a point of the second.

    Attributes
    ----------
    direction : tuple
        That of a guide, fixed in the first body.
    closes_loop : bool
        Whether the joints before it connect its bodies already.
    branch : number
        1 or -1: which of the two ways in which a dyad closes.
    angle : number
        Of a weld: that of the second body against the first [rad].
    near : mapping
        Body -> rough angle [rad], which tells the assemblies of a loop apart; known by numbers alone.
    """

    name: str
    kind: str
    first: BodyPoint
    second: BodyPoint
    direction: Vector = (1, 0)
    closes_loop: bool = False
    branch: Number = 1
    angle: Number = 0
    near: Mapping[str, float] = field(default_factory=dict)

    @property
    def sides(self) -> tuple[BodyPoint, BodyPoint]:
        return self.first, self.second

    @property
    def bodies(self) -> tuple[str, str]:
        return self.first.body, self.second.body

    @property
    def rows(self) -> tuple[str, ...]:
        """Its constraints in the plane, by what their multipliers are."""
        return ROWS[self.kind]

    @property
    def slides(self) -> bool:
        """Whether its coordinate is that of a guide [m], and no angle [rad]."""
        return self.kind == "prismatic"

    @property
    def start_name(self) -> str:
        """What a drive's coordinate at t = 0 is called in the scene."""
        return "position" if self.slides else "angle"

    @property
    def written_branch(self) -> str:
        return "+" if self.branch > 0 else "-"

    def written(self, value: float) -> str:
        """A coordinate [rad or m] for messages, like "90 deg" or "12.5 mm"."""
        return f"{1e3 * value:.6g} mm" if self.slides else f"{math.degrees(value):.6g} deg"


@dataclass(frozen=True)
class Drive:
    """Motion of a joint: "constant speed", "spin up", "law" (in t), "table" (against t), or "free": by the forces."""

    kind: str
    law: str | None

    @property
    def free(self) -> bool:
        return self.kind == "free"


@dataclass(frozen=True)
class Mass:
    """A lumped mass [kg] with its inertia [kg m^2], fixed to a point of a body."""

    name: str
    point: BodyPoint
    mass: Number
    inertia: Number


@dataclass(frozen=True)
class Load:
    """A force [N] on a point along a direction fixed in global or in body axes, or a torque [N m] at a joint.

    One that is spread along a body [N/m] has a ``spread`` instead of a point: the body's start and end, and the factors
    there, between which it changes linearly.
    """

    name: str
    point: BodyPoint | None
    direction: Vector | None
    axes: str | None
    joint: str | None
    kind: str
    against: str | None
    law: str | None
    spread: tuple[BodyPoint, BodyPoint, Number, Number] | None = None

    @property
    def unit(self) -> str:
        return "N m" if self.joint is not None else "N" if self.spread is None else "N/m"

    def pushes(self) -> tuple[tuple[BodyPoint, Number], ...]:
        """The point forces that a force is statically the same as: where, and the share of its size; none of a torque.

        One that is spread linearly is that of l (2 p_0 + p_1) / 6 and l (p_0 + 2 p_1) / 6 at the body's ends.
        """
        if self.spread is None:
            return () if self.point is None else ((self.point, 1),)
        start, end, first, last = self.spread
        return (start, end.at[0] * (2 * first + last) / 6), (end, end.at[0] * (first + 2 * last) / 6)


@dataclass(frozen=True)
class Spring:
    """A spring with a damper between two points [N/m, N s/m] or at a revolute joint [N m/rad, N m s/rad].

    ``free`` is the free length [m], or the free angle [rad] of the joint's second body against the first.
    """

    name: str
    first: BodyPoint
    second: BodyPoint
    joint: str | None
    stiffness: Number
    damping: Number
    free: Number

    @property
    def sides(self) -> tuple[BodyPoint, BodyPoint]:
        return self.first, self.second

    @property
    def ends(self) -> tuple[BodyPoint, ...]:
        """The two points that it joins; none where it is torsional."""
        return self.sides if self.joint is None else ()


@dataclass(frozen=True)
class Contact:
    """Two sides that touch at times, and then push each other apart (:mod:`kaneflex.mechanism.contacts`).

    Attributes
    ----------
    kind : str
        "point-line", "circle-circle" or "circle-in-circle": the second side in the first; "angle": two flanks that
        turn, where lengths are angles [rad], forces torques [N m].
    direction : tuple
        Unit normal of a line, in the first body's axes, to where the second side may be; of circles (0, 0); of flanks
        (1, 0) or (-1, 0), the way in which the second body is turned.
    reach : number
        How far along it from the first point the second may come [m]; of circles the sum, or difference, of radii.
    radius : number
        That of the second side's circle [m], 0 of a point, or where it is of no account.
    stiffness, exponent : number
        K [N/m^n] and n of K d^n.
    damping : number
        c of Kelvin-Voigt [N s/m].
    restitution : number
        That which is asked for.
    law : str
        One of ``contacts.LAWS``; known by numbers alone.
    joint : str or None
        The joint with a clearance that it belongs to; known by numbers alone.
    """

    name: str
    first: BodyPoint
    second: BodyPoint
    kind: str
    direction: Vector
    reach: Number
    radius: Number
    stiffness: Number
    exponent: Number
    damping: Number
    restitution: Number
    law: str = ""
    joint: str | None = None

    @property
    def sides(self) -> tuple[BodyPoint, BodyPoint]:
        return self.first, self.second


@dataclass(frozen=True)
class Friction:
    """What resists sliding at a contact, in a pin or along a guide (:mod:`kaneflex.mechanism.friction`).

    Attributes
    ----------
    law : str
        One of ``friction.LAWS``.
    mu, mu_static : float
        Kinetic and static coefficient.
    speed, exponent : float
        At which Stribeck's excess of the static over the kinetic one has gone to 1/e [m/s or rad/s]; of its
        exponential.
    viscous : float
        Force [N s/m] or torque [N m s/rad] by the speed.
    preload : float
        Dry friction without any normal force [N or N m].
    arm : float
        Of a pin its radius [m]; of a guide 2 over the block's length [1/m], 0 where moments press nothing on.
    stiffness, damping : float
        Of bristles [N/m or N m/rad, N s/m or N m s/rad].
    """

    law: str
    mu: float
    mu_static: float
    speed: float = 0.0
    exponent: float = 2.0
    viscous: float = 0.0
    preload: float = 0.0
    arm: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0


@dataclass(frozen=True)
class Mechanism:
    """Bodies, joints and what acts on them.

    Attributes
    ----------
    observed : tuple of str
        Joints without a drive whose coordinates or speeds the laws of loads know.
    gravity : tuple
        Acceleration [m/s^2], global.
    frame : bool
        Whether the bodies stand still in given poses, and only deform.
    viscous : bool
        Whether a force per length and velocity damps the links.
    """

    bodies: Mapping[str, Body]
    joints: Mapping[str, Joint]
    masses: Mapping[str, Mass]
    drives: Mapping[str, Drive]
    loads: Mapping[str, Load]
    springs: Mapping[str, Spring]
    contacts: Mapping[str, Contact]
    observed: tuple[str, ...]
    gravity: Vector
    frame: bool
    viscous: bool

    @property
    def floating(self) -> tuple[str, ...]:
        """Bodies that joints let move freely in the plane."""
        return tuple(name for name, body in self.bodies.items() if body.free is not None)

    @property
    def free(self) -> tuple[str, ...]:
        """Joints left to the forces, then the coordinates of bodies that move freely."""
        joints = tuple(name for name, drive in self.drives.items() if drive.free)
        return joints + tuple(name for body in self.floating for name in floating_coordinates(body))

    @property
    def loop_joints(self) -> tuple[str, ...]:
        """Joints that close a loop: those whose two bodies the joints before them already connect."""
        return tuple(name for name, joint in self.joints.items() if joint.closes_loop)
