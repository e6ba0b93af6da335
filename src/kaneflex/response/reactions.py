"""Joint reactions and drive torques consistent with the elastic motion.

Every interface node of an elastic link and every rigid body is in equilibrium: the residual of its equations is
balanced by the joints. The unknown joint forces follow from these equations; for a rigid model they are the multipliers
of the ``motion`` kernel.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from kaneflex.fem.assembly import Placed
from kaneflex.mechanism.affine import Affine
from kaneflex.mechanism.body_frame import Rates, normal
from kaneflex.mechanism.planar import GROUND, Vector, cross
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.multibody.model.bound_model import Model
from kaneflex.response.deformation import Deformation, as_balanced
from kaneflex.scene.parts import Joint, Load
from kaneflex.scene.quantities import Address

Row = dict[int, float | np.ndarray]
"""Unknown -> its coefficient in an equation, constant or (n_times,)."""
Solver = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Function of A (n_times, n_rows, n) and b (n_times, n_rows) that returns x (n_times, n) with least |A x - b|."""


def normal_equations(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve A^T A x = A^T b at every instant: a :data:`Solver`."""
    turned = matrix.transpose(0, 2, 1)
    return np.linalg.solve(turned @ matrix, turned @ right[..., None])[..., 0]


def by_reflections(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve by A = Q R, which does not square the condition number: a :data:`Solver`."""
    Q, R = np.linalg.qr(matrix)
    return np.linalg.solve(R, Q.transpose(0, 2, 1) @ right[..., None])[..., 0]


def least_squares(
    rows: Sequence[Row], right: np.ndarray, solver: Solver = normal_equations
) -> dict[int, np.ndarray]:
    """Unknowns x, (n_times,) each, with the least sum of squares of ``rows`` x - ``right``, (n_rows, n_times).

    An unknown that occurs in one equation only satisfies it exactly: both are eliminated first. For a chain of bodies
    this leaves little or nothing.
    """
    left, found = dict(enumerate(rows)), []
    while (pivot := _alone(left)) is not None:
        found.append((*pivot, left.pop(pivot[0])))
    solved = _together(left, right, solver)
    for row, unknown, coefficients in reversed(found):
        rest = right[row] - sum(a * solved[k] for k, a in coefficients.items() if k != unknown)
        solved[unknown] = rest / coefficients[unknown]
    return solved


def _alone(left: dict[int, Row]) -> tuple[int, int] | None:
    """An equation and an unknown that occurs in no other one, with a constant nonzero coefficient."""
    places: dict[int, list[int]] = {}
    for row, coefficients in left.items():
        for unknown in coefficients:
            places.setdefault(unknown, []).append(row)
    for unknown, where in places.items():
        value = left[where[0]][unknown]
        if len(where) == 1 and np.ndim(value) == 0 and value:
            return where[0], unknown
    return None


def _together(left: Mapping[int, Row], right: np.ndarray, solver: Solver) -> dict[int, np.ndarray]:
    """Least-squares solution of the remaining equations."""
    unknowns = sorted({unknown for coefficients in left.values() for unknown in coefficients})
    if not unknowns:
        return {}
    matrix = np.zeros((right.shape[1], len(left), len(unknowns)), right.dtype)
    for row, coefficients in enumerate(left.values()):
        for unknown, value in coefficients.items():
            matrix[:, row, unknowns.index(unknown)] = value
    return dict(zip(unknowns, solver(matrix, right[list(left)].T).T, strict=True))


def reaction_rows(model: Model) -> dict[str, tuple[str, ...]]:
    """Joint or drive -> names of its reactions in the motion's scalars."""
    rows = {}
    for name, joint in model.scene.joints.items():
        kinds = {"revolute": ("force_x", "force_y"), "weld": ("force_x", "force_y", "moment")}
        rows[name] = tuple(f"{name}.{row}" for row in kinds.get(joint.kind, ("normal", "moment")))
    for name in model.scene.drives:
        rows[f"{name}.drive"] = (f"{name}.drive",)
    return rows


def consistent_reactions(
    model: Model, rigid: RigidMotion, coordinates: Rates, deformed: Mapping[str, Deformation],
    solver: Solver | None = None,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Solve the equilibrium of all interface nodes and rigid bodies for the reactions.

    Returns
    -------
    dict
        Name of the reaction, as in the motion's scalars -> series (n_times,); forces act on the second body.
    """
    names = [row for rows in reaction_rows(model).values() for row in rows]
    # consistent, but more equations than unknowns: moments are divided by a length to weigh alike
    rows, right = _Balances(model, rigid, names, coordinates, deformed).assemble()
    solved = least_squares(rows, right, solver or normal_equations)
    return {name: solved[k] for k, name in enumerate(names)}


class _Balances:
    """Equations 'sum of joint forces = residual' with the coefficients of the joint forces, at all times."""

    def __init__(self, model: Model, rigid: RigidMotion, names: list[str], coordinates: Rates, deformed):
        self.model, self.rigid, self.coordinates, self.deformed = model, rigid, coordinates, deformed
        self.index = {name: k for k, name in enumerate(names)}
        self.steps, self.dtype = len(rigid.times), rigid.values.dtype
        lengths = [body.length for body in model.scene.bodies.values() if body.length]
        self.scale = 1.0 / max(lengths)

    def assemble(self) -> tuple[list[Row], np.ndarray]:
        """Coefficients of the reactions, and residuals (n_balances, n_times)."""
        bodies = self.model.scene.bodies
        sites = [(name, node) for name in bodies for node in (self._nodes(name) if name in self.deformed else [None])]
        rows: list[Row] = [{} for _ in range(3 * len(sites))]
        residual = np.empty((len(rows), self.steps), self.dtype)
        for k, (name, node) in enumerate(sites):
            for row, reaction, value in self._of_joints(name, node):
                scaled = value * self.scale if row == 2 else value
                rows[3 * k + row][reaction] = rows[3 * k + row].get(reaction, 0.0) + scaled
            found = self._rigid_residual(name) if node is None else self._node_residual(name, node)
            residual[3 * k : 3 * k + 3] = found
        residual[2::3] *= self.scale
        return rows, residual

    def _nodes(self, link: str) -> list[int]:
        return [node for name, node in self.model.interfaces.displaced if name == link]

    def _of_joints(self, body: str, node: int | None) -> Iterator[tuple[int, int, float | np.ndarray]]:
        """Coefficients of reactions in the equilibrium of a body or node: rows 0, 1 the global force, 2 the moment
        about its start."""
        for name, joint in self.model.scene.joints.items():
            for address, sign in zip(joint.addresses, (-1.0, 1.0), strict=True):
                if address.body == body and (node is None or self._node(address) == node):
                    for row, reaction, value in self._of_joint(name, joint, address, node):
                        yield row, self.index[f"{name}.{reaction}"], sign * value

    def _node(self, address: Address) -> int | None:
        return self.deformed[address.body].link.node_at(self.model.scene.point(address)[0])

    def _of_joint(
        self, name: str, joint: Joint, address: Address, node: int | None
    ) -> Iterator[tuple[int, str, float | np.ndarray]]:
        """Coefficients of a joint's reactions on its second side, by their names."""
        driven, pushes = name in self.model.scene.drives, {"force_x": (1.0, 0.0), "force_y": (0.0, 1.0)}
        if joint.kind == "prismatic":
            t = self._guide(joint)
            pushes = {"normal": normal(t)} | ({"drive": t} if driven else {})
        elif driven:
            yield 2, "drive", 1.0
        if joint.kind != "revolute":
            yield 2, "moment", 1.0
        arm = None if node is not None else self._arm(joint, address)
        for reaction, direction in pushes.items():
            yield from ((row, reaction, part) for row, part in enumerate(direction) if np.any(part))
            if arm is not None:
                yield 2, reaction, cross(arm, direction)

    def _guide(self, joint: Joint) -> Vector:
        """Global direction of a guide, which turns with the body that carries it."""
        carrier = joint.addresses[0].body
        return joint.direction if carrier == GROUND else self.rigid.frame(carrier).to_global(joint.direction)

    def _arm(self, joint: Joint, address: Address) -> Vector | None:
        """Arm of a joint's force on a rigid body, from the body's start, global components, each (n_times,).

        None for the start itself.
        """
        # a guide's force acts at the point of the sliding body
        touches = joint.addresses[1] if joint.kind == "prismatic" else address
        if touches.body == address.body and self.model.scene.point(touches) == (0.0, 0.0):
            return None
        arm = self.rigid.frame(touches.body).to_global(self.model.scene.point(touches))
        return arm + self.rigid.frame(touches.body).origin - self.rigid.frame(address.body).origin

    def _node_residual(self, link: str, node: int) -> np.ndarray:
        """Global force and moment of the joints on a node, (3, n_times)."""
        deformation = self.deformed[link]
        elements = len(deformation.link.nodes) - 1
        local = np.zeros((3, self.steps), self.dtype)
        if node < elements:
            local += deformation.end_forces(node)[:3]
        if node > 0:
            local += deformation.end_forces(node - 1)[3:]
        total = np.vstack([self.rigid.frame(link).to_global(local), local[2]])
        for name, load in self.model.scene.forces.items():
            if load.force_on.body == link and self._node(load.force_on) == node:
                total[:2] -= self._load(name, load, link)
        total[2] -= self._torque(link, node)
        for name, spring in self.model.scene.springs.items():
            for end, sign in zip(spring.ends, (-1.0, 1.0), strict=False):  # a torsional spring has no ends
                if end.body == link and self._node(end) == node:
                    total[:2] -= sign * self._spring(name)
        for mass in self.model.scene.masses.values():
            if mass.at.body == link and self._node(mass.at) == node:
                motion = self.model.frame.link_point(link, self.model.parts[link], node)
                total += self._inertia(link, mass.mass, mass.inertia, mass.at, motion)
        return total

    def _inertia(
        self, body: str, mass: float, inertia: float, at: Address | tuple, motion: Affine | None
    ) -> np.ndarray:
        """Inertia m (a - g) and J epsilon of a mass fixed to a body, with its elastic motion; (3, n_times).

        The elastic motion includes Rayleigh's damping of the mass, alpha m times its velocity in the body's axes.
        """
        scene, rigid, frame = self.model.scene, self.rigid, self.rigid.frame(body)
        acceleration = frame.acceleration(scene.point(at) if isinstance(at, Address) else at)
        total = np.vstack([acceleration - np.array(scene.gravity)[:, None], frame.epsilon])
        if motion is not None:
            (x, y, _), rate, accel = as_balanced(self.model, rigid, self.coordinates, motion)
            options, across, along = self.model.options, np.array([-y, x, 0.0 * x]), np.array([x, y, 0.0 * x])
            if options.dynamics == "quasistatic":
                accel = options.euler * frame.epsilon * across - options.spin * frame.omega**2 * along
            total += accel + self.model.rayleigh[0] * (rate - frame.omega * across)
        return np.array([[mass], [mass], [inertia]]) * total

    def _rigid_residual(self, body: str) -> np.ndarray:
        """Inertia minus loads of a rigid body, moments about its start, (3, n_times).

        If deformation rotates the body by theta, the forces keep their direction and the arms rotate: each force F at
        the arm a adds -theta a . F to the moments.
        """
        scene, frame, axes = self.model.scene, self.model.frame, self.rigid.frame(body)
        data = scene.bodies[body]
        carried = body in frame.bodies
        fixed = [(data.mass, data.inertia, data.centre)]
        fixed += [(m.mass, m.inertia, scene.point(m.at)) for m in scene.masses.values() if m.at.body == body]
        total = np.zeros((3, self.steps), self.dtype)
        work = np.zeros(self.steps, self.dtype)  # sum of a . F over all forces on the body
        for mass, inertia, at in fixed:
            motion = frame.body_point(body, at) if carried else None
            push = self._inertia(body, mass, inertia, at, motion)
            arm = axes.to_global(at)
            total += push
            total[2] += cross(arm, push)
            still = self._inertia(body, mass, inertia, at, None)  # K_g has the forces of the rigid motion
            work -= arm[0] * still[0] + arm[1] * still[1]
        for name, load, address, share in scene.pushes(body):
            push, arm = share * self._load(name, load, body), axes.to_global(scene.point(address))
            total -= np.array([*push, cross(arm, push)])
            work += arm[0] * push[0] + arm[1] * push[1]
        for name, spring in scene.springs.items():
            for end, sign in zip(spring.ends, (-1.0, 1.0), strict=False):  # a torsional spring has no ends
                if end.body == body:
                    push, arm = sign * self._spring(name), axes.to_global(scene.point(end))
                    total -= np.array([*push, cross(arm, push)])
                    work += sign * (arm[0] * self.rigid[f"{name}.force_x"] + arm[1] * self.rigid[f"{name}.force_y"])
        total[2] -= self._torque(body, None)
        if carried and self.model.options.geometric:
            turn = self.rigid.apply(frame.bodies[body], self.coordinates[0])[2]
            total[2] += turn * (work + self._joint_work(body))
        return total

    def _torque(self, body: str, node: int | None) -> np.ndarray:
        """Sum of the torques of loads and springs on a rigid body, or on a node of a link."""
        total = np.zeros(self.steps, self.dtype)
        scene = self.model.scene
        for name, (joint, on_second) in scene.joint_torques.items():
            for address, sign in zip(scene.joints[joint].addresses, (-on_second, on_second), strict=True):
                if address.body == body and (node is None or self._node(address) == node):
                    spring = name.removesuffix(".torque")
                    total += sign * (-self._spring(spring)[0] if spring in scene.springs else self.rigid[name])
        return total

    def _spring(self, name: str) -> np.ndarray:
        return spring_force(self.model, self.rigid, self.coordinates, name)

    def _joint_work(self, body: str) -> np.ndarray:
        """Sum of a . F over the rigid mechanism's joint forces on a body."""
        total = np.zeros(self.steps, self.dtype)
        for name, joint in self.model.scene.joints.items():
            for address, sign in zip(joint.addresses, (-1.0, 1.0), strict=True):
                if address.body == body and joint.kind != "prismatic":
                    arm = self.rigid.frame(body).to_global(self.model.scene.point(address))
                    total += sign * (arm[0] * self.rigid[f"{name}.force_x"] + arm[1] * self.rigid[f"{name}.force_y"])
        return total

    def _load(self, name: str, load: Load, body: str) -> np.ndarray:
        """Global vector of a load, (2, n_times)."""
        axes = self.rigid.frame("ground" if load.axes == "global" else body)
        return self.rigid[name] * axes.to_global(load.direction)


def spring_force(model: Model, rigid: RigidMotion, coordinates: Rates, name: str) -> np.ndarray:
    """Force on a planar spring's second point, global (2, n_times), or torque on the second body (1, n_times)."""
    spring, placed = model.scene.springs[name], placed_spring(model, name)
    if placed is None:
        if spring.torsional_at is not None:
            return -rigid[f"{name}.torque"][None]
        return np.array([rigid[f"{name}.force_x"], rigid[f"{name}.force_y"]])
    force = spring_push(model, rigid, coordinates, placed)
    if spring.torsional_at is not None:
        return force
    if spring.length or spring.damping:
        force[1:] += rigid.frame(name).to_global(np.array([force[0], np.zeros_like(force[0])]))
    return force[1:]


def placed_spring(model: Model, name: str) -> Placed | None:
    """Planar spring with its map L; None if deformation does not move its ends."""
    if model.frame is None:
        return None
    from kaneflex.fem.springs import place_spring

    part, L = place_spring(model.scene, model.links, model.parts, model.frame, name)
    return (part, L) if L.terms else None


def spring_push(
    model: Model, rigid: RigidMotion, coordinates: Rates, placed: Placed, geometric: bool = True
) -> np.ndarray:
    """Generalised force on the coordinates of a spring's part, (size, n_times)."""
    (part, L), (z, z_rate, _), options = placed, coordinates, model.options
    apart, own = rigid.apply(L, z), part.matrices
    force = rigid.column_of(own["F"]) - rigid.apply(own["K_s"], apart)
    if geometric and options.geometric:
        force -= rigid.apply(own["K_g"], apart)
    if options.damping:
        rate = rigid.apply(L, z_rate) + (rigid.apply(L.rate, z) if options.convective else 0.0)
        force -= rigid.apply(own["C_s"], rate)
    return force
