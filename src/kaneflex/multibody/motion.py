"""A coupled trajectory as sensors and pictures read it.

Two views of one motion. *Relative to the rigid mechanism*, whose drives stand where they stand in the coupled motion:
the displacements of all points, in the coordinates z of the elastic equations, so that every sensor means the same
under every preset. *In the floating frames*: the frames' own motion and the small deformation in them, which section
forces follow from.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.multibody.model import Model
from kaneflex.multibody.run import CoupledTrajectory
from kaneflex.multibody.system import BODY, CoupledSystem
from kaneflex.scene.quantities import Address

_GAUSS = np.polynomial.legendre.leggauss(3)  # exact for w_j' w_k' of cubics
Rates = tuple[np.ndarray, np.ndarray, np.ndarray]
"""A quantity with its first and second rates, time along the last axis."""


@dataclass(frozen=True, eq=False)
class CoupledMotion:
    """Where everything is in a coupled trajectory; ``rigid`` is the rigid mechanism at the same instants and drives.

    ``shift`` is what loads have beyond their sizes there, by name (n_times,).
    """

    model: Model
    system: CoupledSystem
    trajectory: CoupledTrajectory
    rigid: RigidMotion
    shift: Mapping[str, np.ndarray] = field(default_factory=dict)

    @cached_property
    def reactions(self) -> dict[str, np.ndarray]:
        """Every joint reaction and every drive's force or torque; a free joint has none. Series (n_times,)."""
        found = dict(zip(self.system.constraints, self.trajectory.multipliers.T, strict=True))
        none = np.zeros(len(self.trajectory.times))
        return {f"{name}.drive": none for name in self.model.scene.drives} | found

    def floating(self) -> FloatingMotion:
        """The floating frames as a rigid motion."""
        return FloatingMotion(self.rigid.motion, self.rigid.times, self.rigid.values, self)

    @cached_property
    def quiet(self) -> CoupledMotion:
        """The same states with accelerations and reactions as if no link rang in tension.

        The axial shapes are not accelerated, as far as the joints leave it to them: there the axial force is what the
        rest of the motion asks for, to the square of its frequencies' ratio.
        """
        t, system = self.trajectory, self.system
        still = np.concatenate([np.arange(system.modal(b).start, system.modal(b).start + axial)
                                for b, (axial, _) in system.module.BODIES.items()]).astype(int)  # fmt: skip
        if not len(still):
            return self
        found = [system.accelerations(*state, still) for state in zip(t.times, t.q, t.v, strict=True)]
        a, multipliers = (np.array([each[k] for each in found]).reshape(part.shape)
                          for k, part in enumerate((t.a, t.multipliers)))  # fmt: skip
        return replace(self, trajectory=replace(t, a=a, multipliers=multipliers))

    def body(self, name: str) -> Rates:
        """x, y [m], phi [rad] of a body's frame, (3, n_times)."""
        k = self.system.start[name]
        t = self.trajectory
        return tuple(part[:, k : k + BODY].T for part in (t.q, t.v, t.a))

    def modal(self, name: str) -> Rates:
        """Modal coordinates of a body, (n, n_times)."""
        rows = self.system.modal(name)
        t = self.trajectory
        return tuple(part[:, rows].T for part in (t.q, t.v, t.a))

    def nodes(self, link: str) -> Rates:
        """u, v, theta of each node in the link's floating frame, without foreshortening; (3 n_nodes, n_times)."""
        shapes = self.system.shapes[link].all
        return tuple(shapes @ part for part in self.modal(link))

    @cached_property
    def _shortening(self) -> dict[str, np.ndarray]:
        """Link -> H at every node, (n_nodes, n_w, n_w)."""
        return {name: self.system.shapes[name].shortening(link) for name, link in self.system.links.items()}

    def place(self, body: str, at: tuple[float, float], node: int | None = None) -> Rates:
        """x, y [m] and angle [rad] of a point, global; of an elastic link's node its deformation included."""
        return self._placed(body, at, None if node is None else self._sections(body, node))

    def place_along(self, link: str, x: float) -> Rates:
        """The same of any point of an elastic link's axis, x [m] from its start."""
        own, shapes = self.system.links[link], self.system.shapes[link]
        e, local = own.locate(x)
        rows = slice(3 * e, 3 * e + 6)
        slopes = np.array([own.shape(e, 0.5 * local * (1 + point))[3] for point in _GAUSS[0]]) @ shapes.transverse[rows]
        H = self._shortening[link][e] + 0.5 * local * (slopes.T * _GAUSS[1]) @ slopes
        return self._placed(link, (x, 0.0), (own.shape(e, local)[:3] @ shapes.all[rows], H))

    def _placed(self, body: str, at: tuple[float, float], section: tuple[np.ndarray, np.ndarray] | None) -> Rates:
        """Where a point is whose section moves by shapes u, v, theta (3, n) and shortens by H (n_w, n_w)."""
        frame, frame_rate, frame_accel = self.body(body)
        zero = np.zeros((BODY, frame.shape[1]))
        d, d_rate, d_accel = zero, zero.copy(), zero.copy()
        if section is not None:
            rows, H = section
            modal = self.modal(body)
            d, d_rate, d_accel = (rows @ part for part in modal)
            a, a_rate, a_accel = (part[rows.shape[1] - len(H) :] for part in modal)
            d[0] -= 0.5 * _form(a, H, a)
            d_rate[0] -= _form(a, H, a_rate)
            d_accel[0] -= _form(a_rate, H, a_rate) + _form(a, H, a_accel)
        c, s = np.cos(frame[2]), np.sin(frame[2])
        omega, epsilon = frame_rate[2], frame_accel[2]
        x, y = at[0] + d[0], at[1] + d[1]
        v = np.array([d_rate[0] - omega * y, d_rate[1] + omega * x])
        a = np.array([
            d_accel[0] - 2 * omega * d_rate[1] - epsilon * y - omega**2 * x,
            d_accel[1] + 2 * omega * d_rate[0] + epsilon * x - omega**2 * y,
        ])  # fmt: skip

        def turned(vector: np.ndarray) -> np.ndarray:
            return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])

        return (
            np.vstack([frame[:2] + turned(np.array([x, y])), frame[2] + d[2]]),
            np.vstack([frame_rate[:2] + turned(v), omega + d_rate[2]]),
            np.vstack([frame_accel[:2] + turned(a), epsilon + d_accel[2]]),
        )

    def joined(self, address: Address) -> Rates:
        """Place and section angle of a point of a body or the ground, (3, n_times)."""
        at = self.model.scene.point(address)
        if address.body == "ground":
            still = np.zeros((3, len(self.trajectory.times)))
            return still + np.array([[at[0]], [at[1]], [0.0]]), still, still
        return self.place(address.body, at, self.node(address))

    def node(self, address: Address) -> int | None:
        """The node of a link's elements, or the point of its modal data, at an address; None on a rigid body."""
        x = self.model.scene.point(address)[0]
        if address.body in self.system.links:
            return self.system.links[address.body].node_at(x)
        modal = self.model.scene.bodies[address.body].modal
        return None if modal is None else modal.at(x)

    def _sections(self, body: str, node: int) -> tuple[np.ndarray, np.ndarray]:
        """Shapes u, v, theta (3, n) and shortening H (n_w, n_w) at a node of a link or a point of its modal data."""
        modal = self.model.scene.bodies[body].modal
        if modal is None:
            return self.system.shapes[body].all[3 * node : 3 * node + 3], self._shortening[body][node]
        s, w, psi = (modal.arrays[key][node] for key in ("s", "w", "psi"))
        none = np.zeros(len(s))
        return np.array([[*s, *(0.0 * w)], [*none, *w], [*none, *psi]]), modal.arrays["H"][node]

    def spring(self, name: str) -> np.ndarray:
        """Tension of a spring with its damper [N], or what a torsional one opposes to the joint's turning [N m]."""
        spring = self.model.scene.springs[name]
        torsional = spring.torsional_at is not None
        ends = self.model.scene.joints[spring.torsional_at].addresses if torsional else spring.between
        first, second = (self.joined(address) for address in ends)
        gap, gap_rate, _ = (there - here for here, there in zip(first, second, strict=True))
        if torsional:
            return spring.stiffness * (gap[2] - spring.angle) + spring.damping * gap_rate[2]
        length = np.hypot(gap[0], gap[1])
        tension = spring.stiffness * (length - spring.length)
        return tension + spring.damping * (gap[:2] * gap_rate[:2]).sum(axis=0) / length if spring.damping else tension

    def _rigid_place(self, body: str, at: tuple[float, float]) -> Rates:
        """The same of the rigid mechanism; its angle is that of the coupled one's frame but for a small difference."""
        r = self.rigid
        c, s, omega, epsilon = (r[f"{body}.{key}"] for key in ("c", "s", "omega", "epsilon"))
        x, y = c * at[0] - s * at[1], s * at[0] + c * at[1]
        phi = self.body(body)[0][2]
        angle = phi - np.arctan2(np.sin(phi) * c - np.cos(phi) * s, np.cos(phi) * c + np.sin(phi) * s)
        return (
            np.array([r[f"{body}.x"] + x, r[f"{body}.y"] + y, angle]),
            np.array([r[f"{body}.v_x"] - omega * y, r[f"{body}.v_y"] + omega * x, omega]),
            np.array([
                r[f"{body}.a_x"] - epsilon * y - omega**2 * x, r[f"{body}.a_y"] + epsilon * x - omega**2 * y, epsilon,
            ]),
        )  # fmt: skip

    def displacement(self, body: str, at: tuple[float, float], node: int | None = None) -> Rates:
        """Global displacement and rotation of a point against the rigid mechanism, (3, n_times)."""
        there, before = self.place(body, at, node), self._rigid_place(body, at)
        return tuple(new - old for new, old in zip(there, before, strict=True))

    def in_body_axes(self, body: str, rates: Rates) -> Rates:
        """Global displacements in the rigid body's axes: R^T d, and the rates of these components."""
        c, s, omega, epsilon = (self.rigid[f"{body}.{key}"] for key in ("c", "s", "omega", "epsilon"))
        d, d_rate, d_accel = rates

        def back(x: np.ndarray, y: np.ndarray) -> list[np.ndarray]:
            return [c * x + s * y, c * y - s * x]

        return (
            np.vstack([back(*d[:2]), d[2]]),
            np.vstack([back(d_rate[0] + omega * d[1], d_rate[1] - omega * d[0]), d_rate[2]]),
            np.vstack([
                back(
                    d_accel[0] + 2 * omega * d_rate[1] + epsilon * d[1] - omega**2 * d[0],
                    d_accel[1] - 2 * omega * d_rate[0] - epsilon * d[0] - omega**2 * d[1],
                ),
                d_accel[2],
            ]),
        )  # fmt: skip

    def coordinates(self) -> Rates:
        """z, z', z'' of the elastic equations' coordinates, (n, n_times)."""
        names = self.model.equations.coordinates
        rows: dict[str, Rates] = {}
        for name, link in self.system.links.items():
            for node, x in enumerate(link.nodes):
                local = self.in_body_axes(name, self.displacement(name, (x, 0.0), node))
                for k, dof in enumerate(("u", "v", "theta")):
                    rows[f"{name}.{node}.{dof}"] = tuple(part[k] for part in local)
        joints = self.model.interfaces.joint if self.model.interfaces is not None else {}
        for (link, node), group in (self.model.interfaces.displaced if joints else {}).items():
            moved = self.displacement(link, (self.system.links[link].nodes[node], 0.0), node)
            for k, axis in enumerate("xy"):
                rows[f"{joints[group]}.{axis}"] = tuple(part[k] for part in moved)
        for name in self.model.frame.bodies if self.model.frame is not None else ():
            rows |= self._carried_rows(name)
        steps = len(self.trajectory.times)
        return tuple(np.array([rows[name][order] for name in names]).reshape(len(names), steps) for order in range(3))

    def _carried_rows(self, name: str) -> dict[str, Rates]:
        """Displacement of a carried rigid body's start, its turn, and its slide along the guide that holds it."""
        moved = self.displacement(name, (0.0, 0.0))
        rows = {f"{name}.{key}": tuple(part[k] for part in moved) for k, key in enumerate(("x", "y", "turn"))}
        for joint in self.model.scene.joints.values():
            if joint.kind != "prismatic" or name not in (address.body for address in joint.addresses):
                continue
            carrier, t = joint.addresses[0].body, np.array(joint.direction)
            local = moved if carrier == "ground" else self.in_body_axes(carrier, moved)
            rows[f"{name}.slide"] = tuple(t @ part[:2] for part in local)
        return rows


def _form(a: np.ndarray, H: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a^T H b at all times."""
    return np.einsum("it,ij,jt->t", a, H, b)


@dataclass(frozen=True, eq=False)
class FloatingMotion(RigidMotion):
    """Scalars of the floating frames, of the reactions and of the loads, by the names that a rigid motion has."""

    coupled: CoupledMotion

    def __getitem__(self, name: str) -> np.ndarray:
        owner, _, key = name.rpartition(".")
        own = self.coupled.system
        if name in self.coupled.reactions:
            return self.coupled.reactions[name]
        if owner in self.coupled.model.scene.springs:
            return self._spring(owner, key)
        if owner in own.start and key in _FRAME:
            order, row = _FRAME[key]
            return self.coupled.body(owner)[order][row]
        if owner in own.start and key in ("c", "s"):
            return (np.cos if key == "c" else np.sin)(self.coupled.body(owner)[0][2])
        body, _, link = owner.rpartition(".")
        if link == "link" and key in ("a_x", "a_y"):
            g_x, g_y = self.coupled.model.scene.gravity
            x, y = self[f"{body}.a_x"] - g_x, self[f"{body}.a_y"] - g_y
            c, s = self[f"{body}.c"], self[f"{body}.s"]
            return c * x + s * y if key == "a_x" else c * y - s * x
        return super().__getitem__(name) + self.coupled.shift.get(name, 0.0)

    def _spring(self, name: str, key: str) -> np.ndarray:
        """Torque of a torsional spring, or a component of the force on its second point."""
        tension = self.coupled.spring(name)
        if key == "torque":
            return tension
        start, end = (self.coupled.joined(address)[0][:2] for address in self.coupled.model.scene.springs[name].between)
        gap = end - start
        length = np.hypot(*gap)
        return -tension * np.divide(gap["xy".index(key[-1])], length, out=np.zeros_like(length), where=length > 0)


_FRAME = {
    "x": (0, 0), "y": (0, 1), "v_x": (1, 0), "v_y": (1, 1), "omega": (1, 2), "a_x": (2, 0), "a_y": (2, 1),
    "epsilon": (2, 2),
}  # fmt: skip
"""Scalar of a body's frame -> order of the rate, row."""
