"""Forces on the links at their points, and the section forces of rigid links."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from kaneflex.mechanism.body_frame import normal
from kaneflex.mechanism.planar import cross
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.scene import Scene
from kaneflex.scene.quantities import Address
from kaneflex.scene.sections import Inertia

Forces = tuple[np.ndarray, np.ndarray]
"""Force (2, n_times) and moment (n_times,) at a point."""


class LinkForces:
    """Forces on the links of a scene in the rigid motion ``rigid``, by the names of its scalars."""

    def __init__(self, scene: Scene, rigid: RigidMotion):
        self.scene, self.rigid, self.steps = scene, rigid, len(rigid.times)
        self._known: dict[str, list[tuple[float, np.ndarray, np.ndarray]]] = {}

    def section(self, name: str, x: float, after: bool = False) -> np.ndarray:
        """Section forces of the rigid link at x, from the equilibrium of the part before x under inertia, weight and
        loads: N, V, M, in space N, V_y, V_z, T, M_y, M_z; (3 or 6, n_times).

        ``after``: whether forces at x count as before the section; at the start they do, at the end they don't. Signs
        as in `Deformation.section`.
        """
        body, before = self.scene.bodies[name], self.scene.bodies[name].profile.inertia(x)
        assert body.beam is not None and body.length is not None  # only beams have sections
        specific_force, omega, epsilon = carried(self.scene, self.rigid, name)
        grows, along = growing(omega, epsilon), np.eye(len(specific_force))[0]
        force = before.mass * specific_force + before.first * grows
        first, second = before.first - x * before.mass, before.second - x * before.first  # about x
        moment = moment_of(along, first * specific_force + second * grows)
        moment = moment + _of_sections(before, body.beam.rotary, omega, epsilon)
        for start, rise in spread_loads(self.scene, self.rigid, name):
            # int_0^x q and int_0^x (x - X) q of the linear profile
            force = force - (start * x + rise * x**2 / 2)
            moment = moment + moment_of(along, start * x**2 / 2 + rise * x**3 / 6)
        for at, push, about_start in self._acting(name):
            if at < x or at == 0.0 or (after and at == x < body.length):
                force = force - push
                moment = moment - about_start + x * moment_of(along, push)
        return np.vstack([force, moment])

    def _acting(self, name: str) -> list[tuple[float, np.ndarray, np.ndarray]]:
        """Distance [m], force and moment about the link's start of all that acts at its points, in its axes."""
        if name not in self._known:
            self._known[name] = list(self._in_plane(name) if self.rigid.freedoms == 3 else self._in_space(name))
        return self._known[name]

    def _in_plane(self, name: str) -> Iterator[tuple[float, np.ndarray, np.ndarray]]:
        for point, at in self.scene.bodies[name].points_all.items():
            force, moment = self.forces_at(Address(name, point))
            yield at[0], force, moment_of(np.array(at), force) + moment

    def _in_space(self, name: str) -> Iterator[tuple[float, np.ndarray, np.ndarray]]:
        from kaneflex.mechanism.spatial import spatial_mechanism_of
        from kaneflex.mechanism.spatial_wrenches import wrenches_on

        for each in wrenches_on(spatial_mechanism_of(self.scene), self.rigid, name):
            if each.by not in self.scene.spreads:
                yield each.on[0], each.force, each.moment + moment_of(each.at, each.force)

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
        between = {name: spring.ends for name, spring in self.scene.springs.items()}  # none of a torsional one
        between |= {name: contact.sides for name, contact in self.scene.contacts.items()}
        for name, ends in between.items():
            for end, sign in zip(ends, (-1.0, 1.0), strict=False):
                if end == address:
                    force = force + sign * np.array([self.rigid[f"{name}.force_x"], self.rigid[f"{name}.force_y"]])
        for name, contact in self.scene.contacts.items():
            for side, key in zip(contact.sides, ("moment", "moment_second"), strict=True):
                if side == address:
                    moment = moment + self.rigid[f"{name}.{key}"]
        for name, (at, on_second) in self.scene.joint_torques.items():
            for side, sign in zip(self.scene.joints[at].addresses, (-on_second, on_second), strict=True):
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


def carried(scene: Scene, rigid: RigidMotion, link: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Acceleration of a link's start less gravity, angular velocity and acceleration, in its axes."""
    if rigid.freedoms == 3:
        specific_force = np.array([rigid[f"{link}.link.a_x"], rigid[f"{link}.link.a_y"]])
        return specific_force, rigid[f"{link}.omega"], rigid[f"{link}.epsilon"]
    if f"{link}.link.a_x" in rigid:
        a, omega, epsilon = (np.array([rigid[f"{link}.link.{kind}_{axis}"] for axis in "xyz"])
                             for kind in ("a", "omega", "epsilon"))  # fmt: skip
        return a, omega, epsilon
    frame, gravity = rigid.frame(link), np.reshape(scene.vector(scene.gravity), (3, 1))
    of = frame.acceleration(np.zeros(3)) - gravity, frame.omega, frame.epsilon
    return frame.to_body(of[0]), frame.to_body(of[1]), frame.to_body(of[2])


def growing(omega: np.ndarray, epsilon: np.ndarray) -> np.ndarray:
    """Gradient (epsilon~ + omega~ omega~) e_x of the acceleration along a link, in its axes."""
    if omega.ndim == 1:
        return np.array([-(omega**2), epsilon])
    return np.array([
        -(omega[1] ** 2 + omega[2] ** 2), epsilon[2] + omega[0] * omega[1], omega[0] * omega[2] - epsilon[1]
    ])  # fmt: skip


def _of_sections(before: Inertia, rotary: bool, omega: np.ndarray, epsilon: np.ndarray) -> np.ndarray:
    """Moment that turns the sections themselves; in space those of a beam without rotary inertia turn about x only."""
    if omega.ndim == 1:
        return rotary * before.about_z * epsilon
    about_y, about_z = before.about_y, before.about_z
    own = np.array([[about_y + about_z], [about_y * rotary], [about_z * rotary]])
    return own * epsilon + moment_of(omega, own * omega)


def moment_of(arm: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Moment of a force at an arm: arm x force, in the plane about z."""
    if len(force) == 2:
        return np.asarray(cross(arm, force))
    from kaneflex.mechanism import spatial_frame

    return spatial_frame.cross(arm, force)


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
