"""Linearised constraints J q = 0 of joints in space, and elimination of dependent coordinates.

Relative to the rigid motion every joint constrains the small displacements and rotations of its two points by the rows
J(t) q = 0 of its elementary constraints, those of ``kaneflex.mechanism.spatial``; a drive also constrains its joint's
degree of freedom. Some coordinates are chosen as dependent, and

    J L = 0,   J L' = -J' L,   J L'' = -J'' L - 2 J' L'

with a unit matrix in the others' rows of L. J and its rates follow from the rotation of the bodies.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import cast

import numpy as np

from kaneflex.fem.links import Link, Part
from kaneflex.mechanism.planar import GROUND
from kaneflex.mechanism.rigid_bodies import Site
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.mechanism.spatial import Side, SpatialJoint, SpatialMechanism
from kaneflex.mechanism.spatial_frame import SpatialFrame, at_point, skew
from kaneflex.support.errors import SceneError

ZERO = 1e-10
"""Coefficient, in rad or sizes of the mechanism, that counts as zero."""
_NEAR = 0.9
"""Share of the largest pivot above which candidates count as equal, for the same choice on every machine."""
_LEAST = 1e-4
"""Smallest share of a coordinate's column, at any instant, that those of the dependent ones don't explain: below it
displacements of dependent coordinates grow without bound."""

APART = ("along", "x", "y", "z")
"""Relative displacements of a spring's ends by the deformation: along the spring, and along global axes [m]."""
Rates3 = np.ndarray
"""A quantity and its first two rates, (3, n_times, ...)."""


def held_nodes(mechanism: SpatialMechanism, link: Link) -> dict[int, list[str]]:
    """Nodes of an elastic link at joints and springs -> names of these.

    Raises
    ------
    SceneError
        If a joint lies off the link's axis.
    """
    found: dict[int, list[str]] = {}
    ends: list[tuple[str, tuple[Side, ...]]] = [(name, joint.sides) for name, joint in mechanism.joints.items()]
    for name, sides in ends + [(name, spring.sides) for name, spring in mechanism.springs.items()]:
        for side in sides:
            if side.body == link.name:
                found.setdefault(link.node_of_joint(side.at, list(side.at)), []).append(name)
    return found


class Joined:
    """The coordinates of all parts, and the rows that joints make of them.

    ``parts`` are those of elastic links, reduced or not, and of rigid bodies; ``held``: joints whose freedoms a drive
    holds, or that share their rotation. ``labels`` name besides how far the ends of springs part, see :data:`APART`.
    """

    def __init__(
        self, mechanism: SpatialMechanism, links: Mapping[str, Link], parts: Mapping[str, Part], held: Iterable[str]
    ) -> None:
        self.mechanism, self.links, self.parts, self.held = mechanism, links, parts, frozenset(held)
        self.first: dict[str, int] = {}
        self.labels: list[str] = []
        for name, part in parts.items():
            self.first[name] = len(self.labels)
            self.labels += part.coordinates
        self.size = len(self.labels)
        self.springs = [name for name, spring in mechanism.springs.items() if spring.joint is None]
        for name in self.springs:
            self.first[name] = len(self.labels)
            self.labels += [f"{name}.{kind}" for kind in APART]
        self.measures = np.array([_unit(label, mechanism.size) for label in self.labels])
        self.measure = self.measures[: self.size]

    def size_of(self, name: str) -> int:
        """Rows of a part, or of a spring."""
        return self.parts[name].size if name in self.parts else len(APART)

    def point(self, side: Side) -> tuple[np.ndarray, np.ndarray] | None:
        """Displacement and rotation of a joint's point in its body's axes: six of the coordinates, and the matrix
        (6, 6) before them; None on the ground."""
        if side.body == GROUND:
            return None
        return self.columns(self.site(side)), np.eye(6) if side.body in self.links else at_point(np.asarray(side.at))

    def site(self, side: Side) -> Site:
        """Node of a link at a joint's point, or the start of its rigid body."""
        link = self.links.get(side.body)
        return side.body, None if link is None else link.node_of_joint(side.at, list(side.at))

    def columns(self, site: Site) -> np.ndarray:
        """Indices of the six coordinates of a site."""
        body, node = site
        return self.first[body] + np.array(self.parts[body].place[node or 0])

    @cached_property
    def tied(self) -> np.ndarray:
        """Indices of coordinates at points of joints or springs, in order; no others enter the rows."""
        sides = [side for joint in self.mechanism.joints.values() for side in joint.sides]
        sides += [side for name in self.springs for side in self.mechanism.springs[name].sides]
        points = map(self.point, sides)
        return np.unique(np.concatenate([np.zeros(0, int), *(point[0] for point in points if point is not None)]))

    def places(self, columns: np.ndarray) -> np.ndarray:
        """Indices of some coordinates within :attr:`tied`."""
        return np.searchsorted(self.tied, columns)

    def rows(self, motion: RigidMotion, joints: Collection[str] | None = None, orders: int = 3) -> np.ndarray:
        """J and its rates at the instants of a motion, (orders, n_times, rows, tied).

        ``joints``: those whose rows are included, in their order, by default all.
        """
        names = [*self.where] if joints is None else joints
        turned = {side.body: turning(motion, side.body) for name in names for side in self.mechanism.joints[name].sides}
        ends = np.cumsum([0, *(self.where[name].stop - self.where[name].start for name in names)])
        J = np.zeros((orders, len(motion.times), ends[-1], len(self.tied)), motion.values.dtype)
        for name, first, last in zip(names, ends[:-1], ends[1:], strict=True):
            joint = self.mechanism.joints[name]
            for each, side in zip(self.coefficients(motion, joint, turned), joint.sides, strict=True):
                point = self.point(side)
                if point is not None:
                    of_body = each[:orders] if side.body in self.links else each[:orders] @ point[1]
                    J[:, :, first:last, self.places(point[0])] = of_body
        return J

    @cached_property
    def where(self) -> dict[str, slice]:
        """Joint -> its rows."""
        found, count = {}, 0
        for name, joint in self.mechanism.joints.items():
            of_joint = 3 if joint.across is None else len(joint.across)
            of_joint += len(joint.parallel) + len(self._held(joint))
            found[name] = slice(count, count := count + of_joint)
        return found

    @property
    def row_count(self) -> int:
        return max((own.stop for own in self.where.values()), default=0)

    def coefficients(
        self, motion: RigidMotion, joint: SpatialJoint, turned: Mapping[str, Rates3] | None = None,
        freedoms: bool = False,
    ) -> tuple[Rates3, Rates3]:
        """Rows of a joint before displacement and rotation of its first point and of its second, each in its body's
        axes, (3, n_times, rows, 6); those of a drive come last, with ``freedoms`` also where there is none.

        R has the second body's axes in the first's, g goes from the first point to the second. A row of a displacement
        along d is -d, d x g and R^T d. One of a rotation about c is -c and R^T c. All are in the first's axes.
        """
        turned = turned or {side.body: turning(motion, side.body) for side in joint.sides}
        R_1, R_2 = (turned[side.body] for side in joint.sides)
        R, turn = product(R_1.swapaxes(2, 3), R_2), np.zeros(())
        own, other = (self.mechanism.rest_axes(side.body) for side in joint.sides)
        slides = np.eye(3) if joint.across is None else joint.across
        held = joint.moves if freedoms else self._held(joint)
        count = len(slides) + len(joint.parallel) + len(held)
        d, c = np.zeros((count, 3)), np.zeros((*R.shape[:2], count, 3), R.dtype)
        d[: len(slides)] = slides
        for k, (axis, of_second) in enumerate(joint.parallel, len(slides)):
            c[:, :, k] = R @ (other.T @ own @ of_second) @ skew(axis).T
        for k, (what, axis) in enumerate(held, count - len(held)):
            (d if what == "position" else c[0])[..., k, :] = axis
        if joint.slides:  # else the points coincide
            (first, one), (second, two) = ((motion.frame(side.body), side.at) for side in joint.sides)
            turn = d @ skew(np.stack([part.T for part in first.apart(one, second, two)]))
        still = np.zeros_like(c)
        still[0] = -d
        return np.concatenate([still, turn - c], axis=-1), np.concatenate([d @ R, product(c, R)], axis=-1)

    def parting(self, motion: RigidMotion) -> Rates3:
        """Relative displacements of springs' ends by the coordinates, :data:`APART` of each, (3, n_times, rows, tied).

        The direction of a spring turns with its rigid points, one that needs none has none.
        """
        shape = (3, len(motion.times), len(self.measures) - self.size, len(self.tied))
        found = np.zeros(shape, motion.values.dtype)
        unit = np.zeros((3, len(motion.times), 3, 3))
        unit[0] = np.eye(3)
        for name in self.springs:
            spring = self.mechanism.springs[name]
            first, rows = self.first[name] - self.size, np.zeros((3, len(motion.times), 4, 3), found.dtype)
            rows[:, :, 1:] = unit
            if spring.is_directed:
                rows[:, :, 0] = direction_of(place_of(motion, spring.sides[1]) - place_of(motion, spring.sides[0]))
            for side, sign in zip(spring.sides, (-1.0, 1.0), strict=True):
                point = self.point(side)
                if point is not None:
                    moved = product(rows, turning(motion, side.body)) @ point[1][:3]
                    found[:, :, first : first + 4, self.places(point[0])] += sign * moved
        return found

    def _held(self, joint: SpatialJoint) -> list[tuple[str, np.ndarray]]:
        """Degrees of freedom of a joint that are held in addition, by axes of its first body."""
        if joint.name not in self.held:
            return []
        if joint.kind in ("spherical", "universal"):
            return [("angle", axis) for axis in np.eye(3)]
        return joint.moves

    def exerted(self, motion: RigidMotion, name: str, multipliers: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """Global force and moment of a joint on its second body, at its second point, (6, n_times), by multipliers of
        its rows (n_times, rows); and its drive's force or torque along its one freedom, None where it has none."""
        joint = self.mechanism.joints[name]
        second = self.coefficients(motion, joint)[1][0]
        local = np.einsum("tri,tr->it", second, multipliers)
        frame, held = motion.frame(joint.sides[1].body), self._held(joint)
        wrench = np.vstack([frame.to_global(local[:3]), frame.to_global(local[3:])])
        return wrench, multipliers[:, -1] if len(held) == 1 else None

    def choose(self, motion: RigidMotion, still: np.ndarray | None = None) -> Choice:
        """Rows and dependent coordinates that serve at all instants of a motion; ``still``: which don't move at all.

        Raises
        ------
        SceneError
            If none do: the links pass a position where they do not determine that of the mechanism.
        """
        J = self._scaled_rows(motion)
        if still is not None:
            J[:, :, still[self.tied]] = 0.0
        used = np.flatnonzero(abs(J).max(axis=(0, 2), initial=0.0) > ZERO)
        furthest, left = _apart_at_all(J[:, used])
        if left.any():
            raise SceneError(
                "joints", ", ".join(self._named(used[left])), "the mechanism passes a dead centre, where these joints "
                "do not determine the positions of elastic bodies",
                "Limit the drives' range, or change the joints",
            )  # fmt: skip
        furthest = np.sort(furthest)
        if len(used) > len(furthest):
            enough = np.sort(_apart_at_all(J[:, used][..., furthest].transpose(0, 2, 1))[0])
            if len(enough) == len(furthest):  # else no rows serve at all instants: all of them do
                used = used[enough]
        dependent = self.tied[furthest]
        independent = np.setdiff1d(np.arange(self.size), dependent)
        return Choice(used, dependent, independent if still is None else independent[~still[independent]])

    def independent_rows(self, motion: RigidMotion) -> np.ndarray:
        """Rows from which all others follow, as many at all instants of a motion."""
        return np.sort(_apart_at_all(self._scaled_rows(motion).transpose(0, 2, 1))[0])

    def _scaled_rows(self, motion: RigidMotion) -> np.ndarray:
        """The rows at the instants of a motion, (n_times, rows, tied), each by its largest entry."""
        J = self.rows(motion, orders=1)[0] * self.measure[self.tied]
        return J / abs(J).max(axis=(0, 2), initial=1e-300)[:, None]

    def _named(self, rows: np.ndarray) -> list[str]:
        """Names of the joints with some of the rows."""
        return [name for name, own in self.where.items() if ((rows >= own.start) & (rows < own.stop)).any()]

    def tied_maps(self, motion: RigidMotion, choice: Choice, columns: np.ndarray) -> Rates3:
        """Map L and its rates at the instants of a motion: rows of tied coordinates, then springs' ends; columns of
        these independent coordinates, (3, n_times, rows, columns)."""
        following, given = self.places(choice.dependent), self.places(choice.independent[columns])
        joints = self._named(choice.rows)
        J, kept = self.rows(motion, joints), [row for name in joints for row in np.r_[self.where[name]]]
        rows = np.searchsorted(kept, choice.rows)
        L = np.zeros((3, len(motion.times), len(self.tied), len(columns)))
        L[0][:, given, np.arange(len(given))] = 1.0
        own, others = (J[:, :, rows[:, None], each] for each in (following, given))
        back = -(np.linalg.inv if len(rows) == len(following) else np.linalg.pinv)(own[0])
        L_0 = back @ others[0]
        L_1 = back @ (others[1] + own[1] @ L_0)
        L[:, :, following] = np.stack([L_0, L_1, back @ (others[2] + own[2] @ L_0 + 2.0 * own[1] @ L_1)])
        return np.concatenate([L, product(self.parting(motion), L)], axis=2) if self.springs else L


@dataclass(frozen=True, eq=False)
class Choice:
    """Choice of dependent coordinates, and of rows that determine them by the independent ones."""

    rows: np.ndarray
    dependent: np.ndarray
    independent: np.ndarray


def _apart_at_all(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Most independent columns of the matrices A (n_times, m, n) at all instants, as many as their rank; and mask of
    the rows, (m,), outside their span.

    Gram-Schmidt process with pivoting: the next column is that with the largest least norm over the instants; of
    nearly equal ones the last, as bodies are given from the ground outwards.
    """
    A, found = A.copy(), list[int]()
    while len(found) < A.shape[1]:
        size = np.linalg.norm(A, axis=1)
        least = size.min(axis=0)
        if least.max(initial=0.0) < _LEAST:
            break
        column = int(np.flatnonzero(least >= _NEAR * least.max())[-1])
        found.append(column)
        along = A[:, :, column] / size[:, column, None]
        for _ in range(2):  # the second time for what rounding left of it
            A -= along[:, :, None] * np.einsum("ti,tij->tj", along, A)[:, None, :]
        A[:, :, found] = 0.0
    return np.array(found, int), abs(A).max(axis=(0, 2), initial=0.0) > ZERO


def _unit(label: str, size: float) -> float:
    """Scale of a coordinate: the mechanism's size, or 1 rad."""
    return 1.0 if label.rpartition(".")[2].startswith("theta") else size


# ---- rates over the instants of a motion --------------------------------------------------------------------------


def turning(motion: RigidMotion, body: str) -> Rates3:
    """Axes of a body and their rates, (3, n_times, 3, 3)."""
    frame = cast(SpatialFrame, motion.frame(body))
    R = np.moveaxis(frame.axes, 2, 0)
    spin, turn = skew(frame.omega.T), skew(frame.epsilon.T)
    return np.stack([R, spin @ R, (turn + spin @ spin) @ R])


def place_of(motion: RigidMotion, side: Side) -> Rates3:
    """A point of a body, its velocity and acceleration, (3, n_times, 3)."""
    frame = motion.frame(side.body)
    return np.stack([frame.place(side.at).T, frame.velocity(side.at).T, frame.acceleration(side.at).T])


def direction_of(d: Rates3) -> Rates3:
    """d / |d| and its rates."""
    length = np.hypot(np.hypot(d[0, :, 0], d[0, :, 1]), d[0, :, 2])[:, None]

    def along(vector: np.ndarray) -> np.ndarray:
        return (e * vector).sum(axis=1)[:, None]

    e = d[0] / length
    rate = along(d[1])
    e_rate = (d[1] - e * rate) / length
    accel = along(d[2]) + (e_rate * d[1]).sum(axis=1)[:, None]
    return np.stack([e, e_rate, (d[2] - 2.0 * e_rate * rate - e * accel) / length])


def product(a: Rates3, b: Rates3) -> Rates3:
    """a b and its rates, of matrices."""
    return np.stack([a[0] @ b[0], a[1] @ b[0] + a[0] @ b[1], a[2] @ b[0] + 2.0 * a[1] @ b[1] + a[0] @ b[2]])
