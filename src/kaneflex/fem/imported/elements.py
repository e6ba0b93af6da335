"""Finite elements of a body from another program: matrices, nodes, and their motions in the plane or in space.

The matrices are those of the free link: two or three translations per node, in space with or without rotations, in
the order of the nodes. A planar link must be symmetric about that plane and about its axis, as beams are. Then its
motions separate into axial (u even and v odd in Y) and transverse ones (u odd and v even), both with w odd in Z.
Deviations of the matrices from the symmetry are averaged, which is a Ritz approximation like the mesh itself.

In space a body may have any form: all its motions are one kind.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.sparse import coo_array, csc_array, eye_array, hstack
from scipy.spatial import cKDTree

from kaneflex.scene.modal_data import CROSS
from kaneflex.support.errors import Fault

OPPOSITE = 1e-6
"""Tolerance for mirror images of nodes, and for ends off the plane, as a share of the link's length."""
TURNS = 6
"""Motions of a node with rotations."""
ALIKE = 1e-6
"""Share of the largest displacement that counts as rounding error."""
_SPEEDS, _DENSEST = (300.0, 20e3), 25e3
"""Plausible speeds of longitudinal waves without contraction, from foam to diamond [m/s]; densities [kg/m^3]."""
_PARITY = {"axial": ((1, 1), (-1, 1), (1, -1)), "transverse": ((-1, 1), (1, 1), (-1, -1))}
"""Signs of u, v, w under the mirrors Y -> -Y and Z -> -Z."""

_WHOLE = (*(f"along {axis}" for axis in "xyz"), *(f"about {axis}" for axis in "xyz"))
"""Names of the rigid motions in space."""

Motion = Literal["axial", "transverse", "any"]
"""Kinds of motion that don't mix: two in the plane, one in space."""


@dataclass(frozen=True, eq=False)
class Stresses:
    """Stresses at ``places`` [Pa] by displacements: ``matrix`` (6 n_places, n_nodes d), or 3 n_places where d is two.
    """

    places: tuple[str, ...]
    matrix: csc_array


@dataclass(frozen=True, eq=False)
class ImportedMesh:
    """Finite elements in the axes of their link: X from its start to its end, Y across, Z along the normal that is
    given, out of the plane of motion.

    Attributes
    ----------
    M, K : csc_array (n_nodes d, n_nodes d)
        Mass [kg] and stiffness [N/m], d motions per node: two or three translations, or three and three rotations.
    nodes : ndarray (n_nodes, 2 or 3)
        Places from the start [m].
    points : mapping of str
        Name of each point -> the nodes that belong to it; `start` and `end` are among them.
    spatial : bool
        True if it moves in space.
    turn : ndarray (3, 3)
        The link's axes in those of the files, one a row.
    sections : mapping of str
        Name of each further point, which is on the mean line -> its distance from the start [m].
    stresses : Stresses or None
        Stresses, if the other program gives them.
    """

    M: csc_array
    K: csc_array
    nodes: np.ndarray
    points: Mapping[str, np.ndarray]
    spatial: bool = False
    turn: np.ndarray = field(default_factory=lambda: np.eye(3))
    sections: Mapping[str, float] = field(default_factory=dict)
    stresses: Stresses | None = None

    @property
    def motions(self) -> int:
        """Motions of a node: d."""
        return self.M.shape[0] // len(self.nodes)

    @property
    def axes(self) -> int:
        """Translations of a node: two or three."""
        return self.nodes.shape[1]

    @cached_property
    def turning(self) -> np.ndarray:
        """Flags of nodes with rotations about all axes, (n_nodes,): nodes of solid elements have none."""
        if self.motions < TURNS:
            return np.zeros(len(self.nodes), bool)
        return np.asarray((self.K.diagonal().reshape(-1, TURNS)[:, 3:] > 0.0).all(axis=1))

    def _still(self, *several: int) -> np.ndarray:
        """Motions of nodes to be filled in, (..., n_nodes, d)."""
        return np.zeros((*several, len(self.nodes), self.motions))

    def X(self, point: str) -> float:
        """Distance of a point from the start [m]."""
        return float(self.nodes[self.points[point], 0].mean())

    @property
    def length(self) -> float:
        """From start to end [m]."""
        return self.X("end")

    @property
    def whole(self) -> dict[str, np.ndarray]:
        """Rigid motions of the link (n_nodes d,) by name; rotations by one over its length."""
        found = rigid_motions(self.nodes, self.motions, self.spatial)
        shifts = len(found) // 2 + len(found) % 2
        found[shifts:] /= self.length
        names = _WHOLE if self.spatial else ("along its axis", "across", "turning")
        return dict(zip(names, found.reshape(len(found), -1), strict=True))

    def accelerations(self, motion: Motion) -> list[np.ndarray]:
        """Accelerations (n_nodes d,) of a link as a whole: along its axes, as much and growing from its
        start, and in space turning about its axis."""
        kept = {"axial": [0], "transverse": [1], "any": range(self.axes)}[motion]
        found = self._still(len(kept), 2)
        for moved, axis in zip(found, kept, strict=True):
            moved[0, :, axis], moved[1, :, axis] = 1.0, self.nodes[:, 0]
        about = [self.whole["about x"]] if motion == "any" else []
        return [*found.reshape(2 * len(kept), -1), *about]

    def field(self, u: np.ndarray | float, v: np.ndarray | float) -> np.ndarray:
        """Displacement (n_nodes d,) with components u along and v across, (n_nodes,) each."""
        found = self._still()
        found[:, 0], found[:, 1] = u, v
        return found.ravel()

    def means(self, point: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows (n_nodes d,) for the axial and transverse displacement of a point and its rotation.

        Means over its nodes, and the turn that fits them best: those of an interface by weighted averages (RBE3).
        """
        at = self.points[point]
        place = self.nodes[at, :2] - self.nodes[at, :2].mean(axis=0)
        along, across, turn = self._still(3)
        along[at, 0] = across[at, 1] = 1.0 / len(at)
        size = (place**2).sum()
        if size > 0.0:
            turn[at, 0], turn[at, 1] = -place[:, 1] / size, place[:, 0] / size
        return along.ravel(), across.ravel(), turn.ravel()

    @property
    def doubts(self) -> list[str]:
        """Warning of values outside the range of materials, mostly caused by a wrong unit.

        A link stretched by one over its length stores energy like a bar: E = k L / A, and E/rho = k L^2 / m.
        """
        stretched, along = self.field(self.nodes[:, 0], 0.0), self.field(1.0, 0.0)
        mass, found = float(along @ self.M @ along), []
        speed = math.sqrt(max(float(stretched @ (self.K @ stretched)), 0.0) / mass)
        if not _SPEEDS[0] < speed < _SPEEDS[1]:
            found.append(f"the speed of sound would be {speed:.3g} m/s, outside the range of materials")
        extents = np.ptp(self.nodes, axis=0)
        around, solid = float(np.prod(extents)), extents.min() > OPPOSITE * extents.max()
        if solid and self.axes == 3 and not mass < _DENSEST * around:
            found.append(f"the density would be at least {mass / around:.3g} kg/m^3, outside the range of materials")
        return found

    def held(self, point: str, motion: Motion) -> np.ndarray:
        """Constraint rows (m, n_nodes d) of a point: u, v, or in space its displacement and its rotation.

        A point of one node, or of nodes on a line, turns as these do in the mean where all of them turn. Raises Fault
        where nodes that don't turn lie on one line, which leaves a turn open.
        """
        if motion != "any":
            return self.means(point)[0 if motion == "axial" else 1][None]
        at = self.points[point]
        place = self.nodes[at] - self.nodes[at].mean(axis=0)
        found, share = self._still(6), np.isin(np.arange(len(self.nodes)), at) / len(at)
        found[[0, 1, 2], :, [0, 1, 2]] = share
        inertia = (place**2).sum() * np.eye(3) - place.T @ place
        on_line = np.linalg.eigvalsh(inertia)[0] <= ALIKE * (place**2).sum()
        if on_line and self.turning[at].all():
            found[[3, 4, 5], :, [3, 4, 5]] = share
            return found.reshape(6, -1)
        if len(at) == 1:  # which has no turn of its own
            return found[:3].reshape(3, -1)
        if on_line:
            raise Fault(f"the nodes of {point} lie on one line: its rotation is not determined", "Give nodes around it")
        lever = np.einsum("cab,na->cnb", CROSS, place)
        found[3:, at, :3] = np.linalg.solve(inertia, lever.reshape(3, -1)).reshape(lever.shape)
        return found.reshape(6, -1)

    def basis(self, motion: Motion, rigid: bool) -> csc_array:
        """Orthogonal displacements of that symmetry, (n_nodes d, m); ``rigid``: nodes of a point form a rigid body."""
        found = self._moving() if motion == "any" else self._symmetric(motion)
        if not rigid:
            return found
        held = np.zeros(len(self.nodes), bool)
        own = []
        for at in self.points.values():
            held[at] = True
            together = rigid_motions(self.nodes[at] - self.nodes[at].mean(axis=0), self.motions, motion == "any")
            for moved in together[{"axial": slice(1), "transverse": slice(1, 3), "any": slice(6)}[motion]]:
                one = self._still()
                one[at] = moved
                if (size := np.linalg.norm(one)) > 0.0:
                    own.append(one.ravel() / size)
        touched = np.asarray(abs(found)[np.repeat(held, self.motions)].sum(axis=0)).ravel() > 0.0
        loose = found[:, np.flatnonzero(~touched)]
        return csc_array(hstack([loose, coo_array(np.array(own).T)]))

    def _moving(self) -> csc_array:
        """Rows with stiffness: nodes of solid elements have no rotations."""
        there = np.asarray(abs(self.K).sum(axis=0)).ravel() > 0.0
        return csc_array(eye_array(len(there), format="csc")[:, np.flatnonzero(there)])

    def _symmetric(self, motion: Motion) -> csc_array:
        signs, count, d = _PARITY[motion], len(self.nodes), self.axes
        mirrors = [self._mirrored(1), self._mirrored(2) if d == 3 else np.arange(count)]
        least = np.minimum.reduce([np.arange(count), mirrors[0], mirrors[1], mirrors[0][mirrors[1]]])
        first = np.flatnonzero(least == np.arange(count))
        rows, columns, values = [], [], []
        for axis in range(d):
            in_y, in_z = signs[axis][0], signs[axis][1] if d == 3 else 1
            for image, sign in (
                (np.arange(count), 1), (mirrors[0], in_y), (mirrors[1], in_z), (mirrors[0][mirrors[1]], in_y * in_z)
            ):  # fmt: skip
                rows.append(d * image[first] + axis)
                columns.append(axis * len(first) + np.arange(len(first)))
                values.append(np.full(len(first), float(sign)))
        shape = (count * d, d * len(first))
        found = coo_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape).tocsc()
        sizes = np.sqrt(np.asarray(found.multiply(found).sum(axis=0)).ravel())
        kept = np.flatnonzero(sizes > 0.5)
        return csc_array(found[:, kept] / sizes[kept])

    def _mirrored(self, axis: int) -> np.ndarray:
        """Index of the mirror image of each node. Raises Fault if there is none."""
        flip = np.ones(self.axes)
        flip[axis] = -1.0
        away, image = cKDTree(self.nodes).query(self.nodes * flip)
        worst = int(away.argmax())
        if away[worst] > OPPOSITE * self.length:
            plane = "axis" if axis == 1 else "plane of motion"
            raise Fault(
                f"the link is not symmetric about its {plane}: there is no mirror image of the node at "
                f"{self._written(worst)}",
                "Give points and a normal in the symmetry planes, and a symmetric mesh",
            )
        if (twice := np.bincount(image) > 1).any():
            reason = f"several nodes are at {self._written(int(twice.argmax()))}: their mirror images are ambiguous"
            raise Fault(reason, "Merge them, or use --space")
        return np.asarray(image)

    def _written(self, node: int) -> str:
        return f"({', '.join(f'{1e3 * x:.6g}' for x in self.nodes[node])}) mm"


def rigid_motions(nodes: np.ndarray, motions: int, spatial: bool) -> np.ndarray:
    """Rigid motions of nodes (n, 2 or 3): displacements, then unit rotations about the origin, (3 or 6, n, motions)."""
    found = np.zeros((6 if spatial else 3, len(nodes), motions))
    if not spatial:
        found[0, :, 0] = found[1, :, 1] = 1.0
        found[2, :, 0], found[2, :, 1] = -nodes[:, 1], nodes[:, 0]
        return found
    for k, axis in enumerate(np.eye(3)):
        found[k, :, :3], found[3 + k, :, :3] = axis, np.cross(axis, nodes)
        found[3 + k, :, 3:] = axis[: motions - 3]
    return found
