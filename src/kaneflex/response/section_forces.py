"""Forces on the links at their points, and the section forces of rigid links."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from kaneflex.mechanism.body_frame import acceleration
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.mechanism.wrenches import Wrench, moment_of, wrenches_on
from kaneflex.scene.sections import Inertia


class LinkForces:
    """Forces on the links of a mechanism in the rigid motion ``rigid``, by the names of its scalars."""

    def __init__(self, mechanism: Any, rigid: RigidMotion):
        self.mechanism, self.rigid = mechanism, rigid

    def section(self, name: str, x: float, after: bool = False) -> np.ndarray:
        """Section forces of the rigid link at x, from the equilibrium of the part before x under inertia, weight and
        loads: N, V, M, in space N, V_y, V_z, T, M_y, M_z; (3 or 6, n_times).

        ``after``: whether forces at x count as before the section; at the start they do, at the end they don't. Signs
        as in `Deformation.section`.
        """
        body = self.mechanism.deforming[name]
        before = body.profile.inertia(x)
        assert body.beam is not None and body.length is not None  # only beams have sections
        specific_force, omega, epsilon = carried(self.mechanism, self.rigid, name)
        along = np.eye(len(specific_force))[0]
        grows = acceleration(omega, epsilon, along[:, None])
        force = before.mass * specific_force + before.first * grows
        first, second = before.first - x * before.mass, before.second - x * before.first  # about x
        moment = moment_of(along, first * specific_force + second * grows)
        moment = moment + _of_sections(before, body.beam.rotary, omega, epsilon)
        for start, rise in spread_loads(self.mechanism, self.rigid, name):
            # int_0^x q and int_0^x (x - X) q of the linear profile
            force = force - (start * x + rise * x**2 / 2)
            moment = moment + moment_of(along, start * x**2 / 2 + rise * x**3 / 6)
        for each in self.wrenches(name):
            at, push = each.on[0], each.about_start
            if at < x or at == 0.0 or (after and at == x < body.length):
                force = force - push[: len(along)]
                moment = moment - push[len(along) :] + x * moment_of(along, push[: len(along)])
        return np.vstack([force, moment])

    def wrenches(self, link: str) -> Iterator[Wrench]:
        """All that acts at points of a link, lumped masses of the plane included; in space these are bodies."""
        mechanism, rigid = self.mechanism, self.rigid
        spread = {name for name, load in mechanism.loads.items() if load.spread is not None}
        yield from (each for each in wrenches_on(mechanism, rigid, link) if each.by not in spread)
        for name, mass in mechanism.masses.items():
            if mass.point.body == link:
                (axes, there), frame = rigid.section_frame(mass.point), rigid.frame(link)
                at = frame.to_body(axes.place(there.at) - frame.origin)
                specific_force = axes.acceleration(there.at) - np.array(mechanism.gravity)[:, None]
                force = -mass.mass * frame.to_body(specific_force)
                yield Wrench(name, mass.point.at, at, force, -mass.inertia * axes.epsilon)


def carried(mechanism: Any, rigid: RigidMotion, link: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Acceleration of a link's start less gravity, angular velocity and acceleration, in its axes."""
    if rigid.freedoms == 3:
        specific_force = np.array([rigid[f"{link}.link.a_x"], rigid[f"{link}.link.a_y"]])
        return specific_force, rigid[f"{link}.omega"], rigid[f"{link}.epsilon"]
    frame, gravity = rigid.frame(link), np.reshape(mechanism.gravity, (3, 1))
    of = frame.acceleration(np.zeros(3)) - gravity, frame.omega, frame.epsilon
    return frame.to_body(of[0]), frame.to_body(of[1]), frame.to_body(of[2])


def _of_sections(before: Inertia, rotary: bool, omega: np.ndarray, epsilon: np.ndarray) -> np.ndarray:
    """Moment that turns the sections themselves; in space those of a beam without rotary inertia turn about x only."""
    if omega.ndim == 1:
        return rotary * before.about_z * epsilon
    about_y, about_z = before.about_y, before.about_z
    own = np.array([[about_y + about_z], [about_y * rotary], [about_z * rotary]])
    return own * epsilon + moment_of(omega, own * omega)


def spread_loads(
    mechanism: Any, rigid: RigidMotion, link: str, carry: Callable[[np.ndarray], np.ndarray] = np.asarray
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Distributed loads of a link, in its axes: load at the start [N/m], and its slope [N/m^2]; (2 or 3, n_times).

    ``carry``: from the axes that loads in ``body`` axes follow to the link's.
    """
    for name, load in mechanism.loads.items():
        if load.spread is not None and load.spread[0].body == link:
            direction = np.outer(load.direction, rigid[name])
            push = carry(direction) if load.in_body else rigid.frame(link).to_body(direction)
            _, end, first, last = load.spread
            yield first * push, (last - first) / end.at[0] * push
