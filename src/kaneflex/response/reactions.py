"""Joint reactions and drive torques consistent with the elastic motion.

Every interface node of an elastic link and every rigid body is in equilibrium: the residual of its equations is
balanced by the joints. The unknown joint forces follow from these equations; for a rigid model they are the multipliers
of the ``motion`` kernel.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from kaneflex.fem.assembly import Site
from kaneflex.mechanism.body_frame import normal
from kaneflex.mechanism.planar import GROUND, Vector, cross
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.multibody.model.bound_model import Model
from kaneflex.response.deformation import Deformation
from kaneflex.scene.parts import Joint
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
    model: Model, rigid: RigidMotion, attached: Mapping[Site, np.ndarray], deformed: Mapping[str, Deformation],
    solver: Solver | None = None,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Solve the equilibrium of all interface nodes and rigid bodies for the reactions.

    ``attached``: forces of all but links, see :func:`kaneflex.response.deformation.attached_forces`.

    Returns
    -------
    dict
        Name of the reaction, as in the motion's scalars -> series (n_times,); forces act on the second body.
    """
    names = [row for rows in reaction_rows(model).values() for row in rows]
    # consistent, but more equations than unknowns: moments are divided by a length to weigh alike
    rows, right = _Balances(model, rigid, names, deformed).assemble(attached)
    solved = least_squares(rows, right, solver or normal_equations)
    return {name: solved[k] for k, name in enumerate(names)}


class _Balances:
    """Equations 'sum of joint forces = residual' with the coefficients of the joint forces, at all times."""

    def __init__(self, model: Model, rigid: RigidMotion, names: list[str], deformed: Mapping[str, Deformation]):
        self.model, self.rigid, self.deformed = model, rigid, deformed
        self.index = {name: k for k, name in enumerate(names)}
        self.scale = 1.0 / max(body.length for body in model.scene.bodies.values() if body.length)

    def assemble(self, attached: Mapping[Site, np.ndarray]) -> tuple[list[Row], np.ndarray]:
        """Coefficients of the reactions, and residuals (n_balances, n_times)."""
        bodies = self.model.scene.bodies
        sites = [(name, node) for name in bodies for node in (self._nodes(name) if name in self.deformed else [None])]
        rows: list[Row] = [{} for _ in range(3 * len(sites))]
        residual = np.zeros((len(rows), len(self.rigid.times)), self.rigid.values.dtype)
        for k, (name, node) in enumerate(sites):
            for row, reaction, value in self._of_joints(name, node):
                scaled = value * self.scale if row == 2 else value
                rows[3 * k + row][reaction] = rows[3 * k + row].get(reaction, 0.0) + scaled
            if node is not None:
                local = self.deformed[name].at_nodes[node]
                residual[3 * k : 3 * k + 3] = *self.rigid.frame(name).to_global(local[:2]), local[2]
            residual[3 * k : 3 * k + 3] += attached.get((name, node), 0.0)
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
