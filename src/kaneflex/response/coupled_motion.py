"""Motion of a coupled trajectory.

It has two descriptions. *In the floating frames*: motion of the frames and small deformation in them, from which
positions and section forces follow. *Relative to the rigid mechanism*, whose drives have the coordinates of the coupled
motion: displacements, so that sensors have the same meaning under every preset.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.mechanism import springs
from kaneflex.mechanism.body_frame import Rates, acceleration, rotate, velocity
from kaneflex.mechanism.energy import Energy
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.parts import floating_coordinates
from kaneflex.mechanism.planar import whole_turns, wrapped
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.multibody.counted_turns import left_out
from kaneflex.multibody.system import BODY, CoupledSystem
from kaneflex.response.dalembert import Balanced, balanced
from kaneflex.response.floating_scalars import FloatingScalars
from kaneflex.response.motion import Motion, Section, beside_axis
from kaneflex.scene.quantities import Address
from kaneflex.support.kept import Kept

if TYPE_CHECKING:
    from kaneflex.multibody.trajectory import CoupledTrajectory

_LEFT_OUT: Kept[object, Mapping[str, float]] = Kept()
"""Full turns that sensors of a rigid reference's bodies leave out."""


@dataclass(frozen=True, eq=False)
class CoupledMotion(Motion):
    """Motion of a coupled trajectory.

    ``shift``: increments of loads, by name (n_times,).
    """

    trajectory: CoupledTrajectory
    shift: Mapping[str, np.ndarray] = field(default_factory=dict)

    @property
    def system(self) -> CoupledSystem:
        assert self.model.coupled is not None
        return self.model.coupled

    @property
    def state(self) -> tuple[np.ndarray, np.ndarray]:
        return self.trajectory.q.T, self.trajectory.v.T

    @property
    def energy(self) -> Energy:
        return self.trajectory.energy

    @property
    def has_rigid_forces(self) -> bool:
        """True if rigid forces exist: not if free joints follow the deformation, as the rigid mechanism would then
        vibrate with them."""
        scene, twin = self.model.scene, self.model.module
        deforms = self.system.shape_columns and not (scene.contacts or scene.frictions)
        return bool(deforms) and not twin.FREE and twin.determined

    @cached_property
    def rigid_forces(self) -> RigidMotion:
        beside = self._beside({})
        sizes = self._load_sizes(beside)  # laws may use joints, whose coordinates are now known
        return (self._beside({name: sizes[name] - self.rigid[name] for name in sizes}) if sizes else beside).floating

    def _beside(self, shift: Mapping[str, np.ndarray]) -> CoupledMotion:
        """Rigid mechanism with increments of its loads."""
        twin = self.model.module
        trajectory = twin.trajectory(self.times, self.model.motion.parameters, shift)
        return CoupledMotion(replace(self.model, coupled=twin.rigid), self.rigid, trajectory, shift)

    @property
    def scalars(self) -> RigidMotion:
        return self.floating

    def taken(self, instants: np.ndarray) -> CoupledMotion:
        rigid = self.rigid.taken(instants)
        picked = {key: getattr(self.trajectory, key)[instants] for key in ("times", "q", "v", "a", "multipliers")}
        shift = {name: part[instants] for name, part in self.shift.items()}
        contacts = self.trajectory.contacts
        frictions, standing = self.trajectory.frictions, self.trajectory.standing
        trajectory = replace(
            self.trajectory, **picked, contacts=contacts and contacts.taken(instants),
            frictions=frictions and frictions.taken(instants),
            standing=None if standing is None else standing[instants],
        )  # fmt: skip
        return replace(self, rigid=rigid, trajectory=trajectory, shift=shift, whole=self.whole or self)

    # ---- in the floating frames -------------------------------------------------------------------------------

    @cached_property
    def floating(self) -> FloatingScalars:
        """Motion of the floating frames as a rigid motion."""
        return FloatingScalars(self.rigid.motion, self.rigid.times, np.zeros((len(self.times), 0)), self)

    @cached_property
    def load_sizes(self) -> dict[str, np.ndarray]:
        """Magnitudes of loads whose laws use joints without drive, which the rigid motion lacks."""
        return self._load_sizes(self)

    def _load_sizes(self, of: CoupledMotion) -> dict[str, np.ndarray]:
        """Magnitudes :attr:`load_sizes` with the joints of another motion, counting full turns as in this one."""
        mechanism, states = self.system.mechanism, []
        for name in (*mechanism.drives, *mechanism.observed) if mechanism.observed else ():
            place, *rates = of.coordinate(name)
            if of is not self and not mechanism.joints[name].slides:
                place = place + math.tau * np.round((self.coordinate(name)[0] - place) / math.tau)
            states += [place, *rates]
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
        gap, gap_rate, gap_accel = (there - here for here, there in zip(first, second, strict=True))
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
    def quiet(self) -> CoupledMotion:
        """The same states with accelerations and reactions without axial vibration of the links.

        Axial shapes are not accelerated, as far as the joints allow: the axial force is then that of the remaining
        motion, up to the squared ratio of frequencies. If masses differ too much for a solution, the motion is
        unchanged.
        """
        t, system = self.trajectory, self.system
        still = np.concatenate([np.arange(system.modal(b).start, system.modal(b).start + axial)
                                for b, (axial, *_) in system.module.BODIES.items()]).astype(int)  # fmt: skip
        if not len(still):
            return self
        try:
            found = system.held(t.times, t.q, t.v, still, t.standing)
        except ArithmeticError:
            return self
        return replace(self, trajectory=replace(t, a=found.a, multipliers=found.reactions))

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
        return self.system.shapes[link].all @ self.modal(link)[0]

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
        x, y = rotate(np.cos(angle), np.sin(angle), (0.0, at[1]))
        arms = (x, y), (-omega * y, omega * x), (-epsilon * y - omega**2 * x, epsilon * x - omega**2 * y)
        return tuple(part + np.array([*arm, 0.0 * x]) for part, arm in zip(moved, arms, strict=True))

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
            return self._along(body, x)
        if own.start == own.stop or modal is None:
            return None
        k = modal.at((x, 0.0))
        s, w, psi = (modal.arrays[key][k] for key in ("s", "w", "psi"))
        none = np.zeros(len(s))
        return np.array([[*s, *(0.0 * w)], [*none, *w], [*none, *psi]]), modal.arrays["H"][k]

    def _along(self, link: str, x: float) -> tuple[np.ndarray, np.ndarray]:
        return self.system.shapes[link].at(self.system.links[link], x, self._shortening[link])

    @cached_property
    def _shortening(self) -> dict[str, np.ndarray]:
        """Shortening matrices H of each link at every node, (n_nodes, n_w, n_w)."""
        return {name: self.system.shapes[name].shortening(link) for name, link in self.system.links.items()}

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
        gap, gap_rate, _ = (there - here for here, there in zip(first, second, strict=True))
        if not spring.ends:
            return springs.tension(spring, gap[2], gap_rate[2])
        length = np.hypot(gap[0], gap[1])
        # coincident points have a length, but no direction
        rate = springs.rate_of_length(gap[:2], gap_rate[:2], length) if spring.damping else 0.0
        return springs.tension(spring, length, rate)

    def _elastic_section(self, link: str, x: float, after: bool) -> Section:
        return self._balances[link].section(x, after)

    @cached_property
    def _balances(self) -> dict[str, Balanced]:
        return balanced(self)

    # ---- relative to the rigid mechanism ----------------------------------------------------------------------

    def displacement(self, body: str, at: tuple[float, float] = (0.0, 0.0)) -> Rates:
        frame = self.model.frame
        if body in self.system.links:
            return beside_axis(self._in_axes(body, self._moved(body, (at[0], 0.0))), at[1])
        if frame is None or body in frame.bodies or self.model.scene.bodies[body].modal is not None:
            return self._in_axes(body, self._moved(body, at))
        return self._still()

    def turned(self, body: str) -> np.ndarray:
        """Angle of the rigid motion with the turns counted by the run, including earlier ones."""
        frame = self.rigid.frame(body)
        angle = np.arctan2(frame.s, frame.c)
        return angle + whole_turns(self.body(body)[0][2] - self._turns_left_out[body] - angle)

    @property
    def _turns_left_out(self) -> Mapping[str, float]:
        twin = self.model.module
        return _LEFT_OUT.of(twin, lambda: left_out(self.model.scene, twin.start))

    def _moved(self, body: str, at: tuple[float, float]) -> Rates:
        """Global displacement and rotation of a point relative to the rigid mechanism with rates, (3, n_times) each."""
        frame = self.rigid.frame(body)
        moved = self.moving_place(body, at)
        before = frame.place(at), frame.velocity(at), frame.acceleration(at)
        phi, turned = self.body(body)[0][2], moved[0][2]
        c, s = frame.to_body((np.cos(phi), np.sin(phi)))
        angles = turned - phi + np.arctan2(s, c), moved[1][2] - frame.omega, moved[2][2] - frame.epsilon
        parts = [np.vstack([new[:2] - old, angle]) for new, old, angle in zip(moved, before, angles, strict=True)]
        for part in parts:
            part[self._held(body, at[0])] = 0.0
        return tuple(parts)

    def _held(self, body: str, x: float) -> list[int]:
        """Components among x, y and the angle that joints keep as in the rigid mechanism, up to rounding."""
        interfaces, link = self.model.interfaces, self.system.links.get(body)
        at = None if link is None else link.node_at(x)
        if interfaces is None or at is None or (body, at) not in interfaces.displaced:
            return []
        node = body, at
        fixed = interfaces.displaced[node] in interfaces.fixed
        clamped = interfaces.turned[node] in interfaces.clamped
        return [0, 1] * fixed + [2] * clamped

    @cached_property
    def coordinates(self) -> Rates:
        names = self.model.equations.coordinates
        rows: dict[str, Rates] = {}
        for name, link in self.system.links.items():
            for node, x in enumerate(link.nodes):
                local = self.displacement(name, (x, 0.0))
                for k, dof in enumerate(("u", "v", "theta")):
                    rows[f"{name}.{node}.{dof}"] = tuple(part[k] for part in local)
        joints = self.model.interfaces.joint if self.model.interfaces is not None else {}
        displaced = self.model.interfaces.displaced if self.model.interfaces is not None and joints else {}
        for (body, node), group in displaced.items():
            moved = self._moved(body, (self.system.links[body].nodes[node], 0.0))
            for k, axis in enumerate("xy"):
                rows[f"{joints[group]}.{axis}"] = tuple(part[k] for part in moved)
        for name in self.model.frame.bodies if self.model.frame is not None else ():
            rows |= self._carried_rows(name)
        found = (np.array([rows[name][order] for name in names]) for order in range(3))
        return tuple(part.reshape(len(names), len(self.times)) for part in found)

    def _carried_rows(self, name: str) -> dict[str, Rates]:
        """Displacement of a carried rigid body's start, its rotation, and its slide along its guide."""
        moved = self._moved(name, (0.0, 0.0))
        rows = {f"{name}.{key}": tuple(part[k] for part in moved) for k, key in enumerate(("x", "y", "turn"))}
        for joint in self.model.scene.joints.values():
            if joint.kind == "prismatic" and name in (address.body for address in joint.addresses):
                local = self._in_axes(joint.addresses[0].body, moved)
                rows[f"{name}.slide"] = tuple(np.array(joint.direction) @ part[:2] for part in local)
        return rows


def _form(a: np.ndarray, H: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Bilinear form a^T H b at all times."""
    return (a * (H @ b)).sum(axis=0)
