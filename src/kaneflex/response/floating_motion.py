"""Coupled motion in the floating frames, and its scalars by the names that a rigid motion has for its bodies.

Functions that read a rigid motion by its scalars, such as joint and spring forces, thus also read a coupled one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Self

import numpy as np

from kaneflex.mechanism import springs
from kaneflex.mechanism.body_frame import Rates, acceleration, rotate, velocity
from kaneflex.mechanism.contacts import apart
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.parts import floating_coordinates
from kaneflex.mechanism.planar import cross, whole_turns, wrapped
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.multibody.model.system import BODY, CoupledSystem
from kaneflex.multibody.unilateral.dry_friction import STUCK
from kaneflex.response.motion import Motion
from kaneflex.scene.quantities import Address

if TYPE_CHECKING:
    from kaneflex.multibody.time.trajectory import CoupledTrajectory

@dataclass(frozen=True, eq=False)
class FloatingScalars(RigidMotion):
    """Scalars of the floating frames, reactions and loads of a coupled motion."""

    coupled: FloatingMotion

    def __getitem__(self, name: str) -> np.ndarray:
        owner, _, key = name.rpartition(".")
        own = self.coupled.system
        if name in self.coupled.reactions:
            return self.coupled.reactions[name]
        if owner in self.coupled.model.scene.springs:
            return self._spring(owner, key)
        if owner in self.coupled.model.scene.contacts:
            return self._contact(owner)[key]
        if owner in own.start and key in _FRAME:
            order, row = _FRAME[key]
            return self.coupled.body(owner)[order][row]
        if owner in own.start and key in ("c", "s"):
            return (np.cos if key == "c" else np.sin)(self.coupled.body(owner)[0][2])
        body, _, link = owner.rpartition(".")
        if link == "link" and key in ("a_x", "a_y"):
            gravity = np.array(self.coupled.model.scene.gravity)[:, None]
            specific_force = self.frame(body).acceleration((0.0, 0.0)) - gravity
            return self.frame(body).to_body(specific_force)["xy".index(key[-1])]
        size = self.coupled.load_sizes[name] if name in self.coupled.load_sizes else self.coupled.rigid[name]
        return size + self.coupled.shift.get(name, 0.0)

    def _spring(self, name: str, key: str) -> np.ndarray:
        """Torque of a torsional spring, tension of another one, or a component of its force on its second point."""
        tension = self.coupled.spring_tension(name)
        if key in ("torque", "tension"):
            return tension
        start, end = (self.coupled.joined(address)[0][:2] for address in self.coupled.model.scene.springs[name].between)
        gap = end - start
        length = np.hypot(*gap)
        return -tension * np.divide(gap["xy".index(key[-1])], length, out=np.zeros_like(length), where=length > 0)

    def _contact(self, name: str) -> dict[str, np.ndarray]:
        """Global force of a contact on its second side, and its moments on both sides about their points."""
        record, contact = self.coupled.trajectory.contacts, mechanism_of(self.coupled.model.scene).contacts[name]
        force = np.zeros(len(self.times)) if record is None else record.force[:, record.names.index(name)]
        if contact.kind == "angle":
            turn, none = contact.direction[0] * force, np.zeros(len(self.times))
            return {"force_x": none, "force_y": none, "moment": -turn, "moment_second": turn}
        (x, y, angle), second = (self.coupled.moving_place(side.body, side.at)[0] for side in contact.sides)
        gap = second[0] - x, second[1] - y
        direction = rotate(np.cos(angle), np.sin(angle), contact.direction)
        _, normal = apart(contact.kind, gap, np.hypot(*gap) + np.finfo(float).tiny, direction, contact.reach)
        own = self.coupled.reactions.get(f"{name}.friction", 0.0 * force)
        push = force * normal[0] - own * normal[1], force * normal[1] + own * normal[0]
        arm = contact.radius * own  # friction acts at the contact point on the second side's circle
        return {"force_x": push[0], "force_y": push[1], "moment": arm - cross(gap, push), "moment_second": -arm}


_FRAME = {
    "x": (0, 0), "y": (0, 1), "v_x": (1, 0), "v_y": (1, 1), "omega": (1, 2), "a_x": (2, 0), "a_y": (2, 1),
    "epsilon": (2, 2),
}  # fmt: skip
"""Scalar of a body's frame -> order of the rate, row."""


@dataclass(frozen=True, eq=False)
class FloatingMotion(Motion):
    """Coupled motion in the floating frames: positions, reactions, and forces of contacts, friction and springs.

    ``shift``: increments of loads, by name (n_times,).
    """

    trajectory: CoupledTrajectory
    shift: Mapping[str, np.ndarray] = field(default_factory=dict)

    @property
    def system(self) -> CoupledSystem:
        assert self.model.coupled is not None
        return self.model.coupled

    @cached_property
    def floating(self) -> FloatingScalars:
        """Motion of the floating frames as a rigid motion."""
        return FloatingScalars(self.rigid.motion, self.rigid.times, np.zeros((len(self.times), 0)), self)

    @cached_property
    def load_sizes(self) -> dict[str, np.ndarray]:
        """Magnitudes of loads whose laws use joints without drive, which the rigid motion lacks."""
        mechanism, states = self.system.mechanism, list[np.ndarray]()
        for name in (*mechanism.drives, *mechanism.observed) if mechanism.observed else ():
            states += self.coordinate(name)
        if not states:
            return {}
        return dict(zip(mechanism.loads, self.system.load_sizes(self.times, np.column_stack(states)).T, strict=True))

    def coordinate(self, joint: str) -> Rates:
        """Coordinate of a joint between the deformed bodies [rad, or m along its guide] with its rates; or of a freely
        moving body."""
        body, _, part = joint.partition(".")
        if part:
            k, found = self.system.start[body] + floating_coordinates(body).index(joint), self.trajectory
            return found.q[:, k], found.v[:, k], found.a[:, k]
        kind, direction = self.model.scene.joints[joint].kind, self.model.scene.joints[joint].direction
        first, second = (self.joined(address) for address in self.model.scene.joints[joint].addresses)
        gap, gap_rate, gap_accel = (end - start for start, end in zip(first, second, strict=True))
        if kind != "prismatic":
            return gap[2], gap_rate[2], gap_accel[2]
        angle, omega, epsilon = (part[2] for part in first)
        t = rotate(np.cos(angle), np.sin(angle), direction)
        gap, gap_rate, gap_accel = (part[:2] for part in (gap, gap_rate, gap_accel))
        seen = gap, velocity(-omega, gap, gap_rate), acceleration(-omega, -epsilon, gap, gap_rate, gap_accel)
        return tuple((t * part).sum(axis=0) for part in seen)

    def slide(self, joint: str) -> np.ndarray:
        return self.coordinate(joint)[0]

    def seen_from(self, body: str, vector: np.ndarray) -> np.ndarray:
        carried = body != "ground" and not self.model.scene.bodies[body].deforms
        return (self.floating if carried else self.rigid).frame(body).to_body(vector)

    @cached_property
    def quiet(self) -> Self:
        """The same states with accelerations and reactions without axial vibration of the links.

        Axial shapes are not accelerated, as far as the joints allow: the axial force is then that of the remaining
        motion, up to the squared ratio of frequencies. If masses differ too much for a solution, or links then bend
        violently beside sticking friction or resting contacts, the motion is unchanged.
        """
        t, engine = self.trajectory, self.system.engine
        names = (name.rpartition(".")[2] for name, _ in engine.layout.coordinates)
        still = [k for k, name in enumerate(names) if engine.shapes[k] and name.startswith("axial")]
        if not still:
            return self
        try:
            found = self.system.unfold(self.system.states(t.rows, still))
        except ArithmeticError:
            return self
        across = [k for k, (name, _) in enumerate(self.system.coordinates) if ".transverse_" in name]
        violent = (abs(found.a[:, across]) > abs(t.a[:, across]).max(axis=0)).any(axis=1)
        kept = (self._locked & violent)[:, None]
        a, multipliers = np.where(kept, t.a, found.a), np.where(kept, t.multipliers, found.reactions)
        return replace(self, trajectory=replace(t, a=a, multipliers=multipliers))

    @property
    def _locked(self) -> np.ndarray:
        """True at instants with sticking friction, or rigid sides at rest on each other, (n_times,).

        Such a constraint may lock the loops of the rigid bodies: a link stretches then as they move on, and without
        axial acceleration it would have to bend violently instead.
        """
        engine, contacts = self.system.engine, self.system.mechanism.contacts.values()
        modes, count = self.trajectory.rows[:, engine.columns["modes"]], len(engine.holds)
        rigid = count + np.flatnonzero([contact.law == "newton" for contact in contacts])
        return (modes[:, :count] == STUCK).any(axis=1) | (modes[:, rigid] != 0.0).any(axis=1)

    def body(self, name: str) -> Rates:
        """Position x, y [m] and angle phi [rad] of a body's frame with rates, (3, n_times) each."""
        k = self.system.start[name]
        t = self.trajectory
        return tuple(part[:, k : k + BODY].T for part in (t.q, t.v, t.a))

    def modal(self, name: str) -> Rates:
        """Modal coordinates of a body with rates, (n, n_times) each."""
        rows = self.system.modal(name)
        t = self.trajectory
        return tuple(part[:, rows].T for part in (t.q, t.v, t.a))

    def nodes(self, link: str) -> np.ndarray:
        return self.system.shapes[link].basis @ self.modal(link)[0]

    def moving_place(self, body: str, at: tuple[float, float] = (0.0, 0.0)) -> Rates:
        """Global position x, y [m] and section angle [rad] of a point, including deformation, with rates; (3, n_times)
        each.

        For an elastic link, the point of the axis at distance ``at[0]``; for modal data, one of its points.
        """
        if body == "ground":
            still = np.zeros((3, len(self.times)))
            return still + np.array([[at[0]], [at[1]], [0.0]]), still, still
        p = [np.reshape(at, (2, 1)) + np.zeros((2, len(self.times))), np.zeros((2, 1)), np.zeros((2, 1))]
        turn = [0.0, 0.0, 0.0]
        section = self._section_shapes(body, at[0])
        if section is not None:
            d = self._deformed(body, *section)
            p, turn = [part + of[:2] for part, of in zip(p, d, strict=True)], [of[2] for of in d]
        frame, phi = self.floating.frame(body), [part[2] for part in self.body(body)]
        moved = (frame.place(p[0]), frame.velocity(*p[:2]), frame.acceleration(*p))
        return tuple(np.vstack([part, angle + own]) for part, angle, own in zip(moved, phi, turn, strict=True))

    def point(self, body: str, at: tuple[float, float] = (0.0, 0.0)) -> Rates:
        """Same for any point of a body: off the axis of an elastic link, it turns with the section."""
        if body not in self.system.links or not at[1]:
            return self.moving_place(body, at)
        moved = self.moving_place(body, (at[0], 0.0))
        (_, _, angle), (_, _, omega), (_, _, epsilon) = moved
        arm = rotate(np.cos(angle), np.sin(angle), (0.0, at[1]))
        arms = arm, velocity(omega, arm), acceleration(omega, epsilon, arm)
        return tuple(part + np.array([*own, 0.0 * angle]) for part, own in zip(moved, arms, strict=True))

    def place(self, body: str, at: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
        """Global position of a point in this motion, known even where the rigid mechanism does not close."""
        return self.point(body, at)[0][:2]

    def angle(self, body: str, at: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
        """Angle of a body at a point in this motion, with the full turns that sensors leave out."""
        return self.point(body, at)[0][2] - (self._turns_left_out[body] if body != "ground" else 0.0)

    def _deformed(self, body: str, rows: np.ndarray, H: np.ndarray) -> Rates:
        """Displacements u, v, theta in the floating frame for shapes ``rows`` (3, n) and shortening H (n_w, n_w)."""
        modal = self.modal(body)
        d, d_rate, d_accel = (rows @ part for part in modal)
        a, a_rate, a_accel = (part[rows.shape[1] - len(H) :] for part in modal)
        d[0] -= 0.5 * _form(a, H, a)
        d_rate[0] -= _form(a, H, a_rate)
        d_accel[0] -= _form(a_rate, H, a_rate) + _form(a, H, a_accel)
        return d, d_rate, d_accel

    def _section_shapes(self, body: str, x: float) -> tuple[np.ndarray, np.ndarray] | None:
        """Shapes u, v, theta (3, n) and shortening H (n_w, n_w) at a point of a body; None if it is rigid."""
        own, modal = self.system.modal(body), self.model.scene.bodies[body].modal
        if body in self.system.links:
            shapes = self.system.shapes[body]
            (rows, G), across = shapes.at((x,)), slice(shapes.counts[0], None)
            return rows, -G[0, across, across]
        if own.start == own.stop or modal is None:
            return None
        k = modal.at((x, 0.0))
        s, w, psi = (modal.arrays[key][k] for key in ("s", "w", "psi"))
        none = np.zeros(len(s))
        return np.array([[*s, *(0.0 * w)], [*none, *w], [*none, *psi]]), modal.arrays["H"][k]

    @property
    def _turns_left_out(self) -> Mapping[str, float]:
        """Body -> initial full turns [rad] that sensors leave out, to start within half a turn of zero."""
        angles = {name: float(pose[2]) for name, pose in self.model.module.start.poses.items()}
        return {name: float(whole_turns(each - math.atan2(math.sin(each), math.cos(each))))
                for name, each in angles.items()}  # fmt: skip

    def joined(self, address: Address) -> Rates:
        """Position and section angle of a point of a body or the ground with rates, (3, n_times) each."""
        return self.moving_place(address.body, self.model.scene.point(address))

    # ---- forces -----------------------------------------------------------------------------------------------

    def reaction(self, name: str) -> np.ndarray:
        return self.reactions[name]

    @cached_property
    def reactions(self) -> dict[str, np.ndarray]:
        """Reactions of all joints and forces or torques of drives, zero for free ones; series (n_times,)."""
        found = dict(zip(self.system.constraints, self.trajectory.multipliers.T, strict=True))
        none = np.zeros(len(self.times))
        rubbing = {f"{name}.friction": self.friction(name) for name in self.model.scene.frictions}
        return {f"{name}.drive": none for name in self.model.scene.drives} | found | rubbing

    def contact(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        record = self.trajectory.contacts
        if record is None:  # single states have no contact record
            return np.full(len(self.times), np.nan), np.full(len(self.times), np.nan)
        k = record.names.index(name)
        return record.gap[:, k], record.force[:, k]

    def clearance(self, name: str) -> np.ndarray:
        loose = self.model.scene.loose[name]
        first, second = (self.joined(side)[0] for side in loose.sides)
        x, y, angle = second - first
        if loose.direction is None:
            return np.array([x, y, angle])
        along = rotate(np.cos(first[2]), np.sin(first[2]), loose.direction)
        tilt = wrapped(angle)  # bodies may start full turns apart
        return np.array([along[0] * x + along[1] * y, along[0] * y - along[1] * x, tilt])

    def friction(self, name: str) -> np.ndarray:
        record = self.trajectory.frictions
        if record is None:
            return np.full(len(self.times), np.nan)
        return record.force[:, record.names.index(name)]

    def spring_tension(self, name: str) -> np.ndarray:
        spring = mechanism_of(self.model.scene).springs[name]
        first, second = (self.moving_place(side.body, side.at) for side in spring.sides)
        gap, gap_rate, _ = (end - start for start, end in zip(first, second, strict=True))
        if not spring.ends:
            return springs.tension(spring, gap[2], gap_rate[2])
        length = np.hypot(gap[0], gap[1])
        # coincident points have a length, but no direction
        rate = springs.rate_of_length(gap[:2], gap_rate[:2], length) if spring.damping else 0.0
        return springs.tension(spring, length, rate)


def _form(a: np.ndarray, H: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Bilinear form a^T H b at all times."""
    return (a * (H @ b)).sum(axis=0)
