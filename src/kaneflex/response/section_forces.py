"""Forces on the links at their points, and the section forces of rigid links."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from kaneflex.mechanism.body_frame import normal
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.scene import Scene
from kaneflex.scene.quantities import Address

Forces = tuple[np.ndarray, np.ndarray]
"""Force (2, n_times) and moment (n_times,) at a point."""


class LinkForces:
    """Forces on the links of a scene in the rigid motion ``rigid``, by the names of its scalars."""

    def __init__(self, scene: Scene, rigid: RigidMotion):
        self.scene, self.rigid, self.steps = scene, rigid, len(rigid.times)

    def section(self, name: str, x: float, after: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Section forces N, V, M of the rigid link at x, from the equilibrium of the part before x.

        ``after``: whether forces at x count as before the section; at the start they do, at the end they don't. The
        inertia part of N is (a_x - g_x) m - omega^2 S, as in P(x), with mass m and first moment S of the part before x;
        signs as in `Deformation.section`.
        """
        rigid, profile = self.rigid, self.scene.bodies[name].profile
        before = profile.inertia(x)
        a_x, a_y = rigid[f"{name}.link.a_x"], rigid[f"{name}.link.a_y"]
        omega, epsilon = rigid[f"{name}.omega"], rigid[f"{name}.epsilon"]
        N = a_x * before.mass - omega**2 * before.first
        V = a_y * before.mass + epsilon * before.first
        M = epsilon * (before.second + profile.rotary_inertia(x)) + a_y * before.first - x * V
        for point, (at, _) in self.scene.bodies[name].points_all.items():
            if at < x or point == "start" or (after and at == x and point != "end"):
                force, moment = self.forces_at(Address(name, point))
                N, V, M = N - force[0], V - force[1], M + (x - at) * force[1] - moment
        for first, rise in spread_loads(self.scene, rigid, name):
            # int_0^x q and int_0^x (x - X) q of the linear profile
            total, arm = first * x + rise * x**2 / 2, first * x**2 / 2 + rise * x**3 / 6
            N, V, M = N - total[0], V - total[1], M + arm[1]
        return N, V, M

    def forces_at(self, address: Address) -> Forces:
        """Force (2, n_times) in link axes and moment on a rigid link at one of its points."""
        link = address.body
        force, moment = np.zeros((2, self.steps)), np.zeros(self.steps)
        for name, joint in self.scene.joints.items():
            if address not in joint.addresses:
                continue
            sign = 1.0 if joint.addresses[1] == address else -1.0
            force = force + sign * joint_force(self.scene, self.rigid, name, self.rigid.__getitem__)
            if joint.kind != "revolute":
                moment = moment + sign * self.rigid[f"{name}.moment"]
            elif name in self.scene.drives:
                moment = moment + sign * self.rigid[f"{name}.drive"]
            if joint.kind == "revolute" and joint.friction is not None:
                moment = moment + sign * self.rigid[f"{name}.friction"]
        for name, load in self.scene.forces.items():
            if load.force_on == address:
                pushing = self.rigid.frame("ground" if load.axes == "global" else link)
                force = force + self.rigid[name] * pushing.to_global(load.direction)
        for name, spring in self.scene.springs.items():
            for end, sign in zip(spring.ends, (-1.0, 1.0), strict=False):  # a torsional spring has no ends
                if end == address:
                    force = force + sign * np.array([self.rigid[f"{name}.force_x"], self.rigid[f"{name}.force_y"]])
        for name, contact in self.scene.contacts.items():
            for side, sign in zip(contact.sides, (-1.0, 1.0), strict=True):
                if side == address:
                    force = force + sign * np.array([self.rigid[f"{name}.force_x"], self.rigid[f"{name}.force_y"]])
            for side, key in zip(contact.sides, ("moment", "moment_second"), strict=True):
                if side == address:
                    moment = moment + self.rigid[f"{name}.{key}"]
        for name, (joint, on_second) in self.scene.joint_torques.items():
            for side, sign in zip(self.scene.joints[joint].addresses, (-on_second, on_second), strict=True):
                if side == address:
                    moment = moment + sign * self.rigid[name]
        for mass in self.scene.masses.values():
            if mass.at == address:
                specific_force = self.specific_force(address)
                force = force - mass.mass * specific_force[:2]
                moment = moment - mass.inertia * specific_force[2]
        return self.rigid.frame(link).to_body(force), moment

    def specific_force(self, address: Address) -> np.ndarray:
        """Acceleration a - g of a point of the rigid mechanism, global, and angular acceleration, (3, n_times)."""
        frame = self.rigid.frame(address.body)
        specific_force = frame.acceleration(self.scene.point(address)) - np.array(self.scene.gravity)[:, None]
        return np.vstack([specific_force, frame.epsilon])


def spread_loads(
    scene: Scene, rigid: RigidMotion, link: str, carry: Callable[[np.ndarray], np.ndarray] = np.asarray
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Distributed loads of a link, in its axes: load at the start [N/m], and its slope [N/m^2]; (2 or 3, n_times).

    ``carry``: from the axes that loads in ``body`` axes follow to the link's.
    """
    for name, load in scene.spreads.items():
        if load.spread_on == link:
            direction = np.outer(load.direction, rigid[name])
            push = carry(direction) if load.axes == "body" else rigid.frame(link).to_body(direction)
            first, last = load.profile
            yield first * push, (last - first) / scene.bodies[link].length * push


def joint_force(scene: Scene, rigid: RigidMotion, name: str, reaction: Callable[[str], np.ndarray]) -> np.ndarray:
    """Global force of a joint on its second body, (2, n_times), from its reactions by name."""
    joint = scene.joints[name]
    if joint.kind != "prismatic":
        return np.array([reaction(f"{name}.force_x"), reaction(f"{name}.force_y")])
    t = rigid.frame(joint.addresses[0].body).to_global(joint.direction)
    force = reaction(f"{name}.normal") * normal(t)
    if joint.friction is not None:
        force = force + reaction(f"{name}.friction") * t
    return force + reaction(f"{name}.drive") * t if name in scene.drives else force
