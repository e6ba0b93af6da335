"""Shapes of elastic links in space, and the sums over their slices in the equations of a deforming body.

A link's finite elements have four uncoupled kinds of motion: stretch, bending in either plane, twist. Shapes are found
for each kind: static ones of the points with joints or loads, and modes with these points held (Craig & Bampton 1968).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, permutations

import numpy as np
from scipy.linalg import eigh

from kaneflex.fem.modes import lowest_modes
from kaneflex.fem.spatial_links import SpatialLink
from kaneflex.mechanism.affine import Matrix, as_array, solve
from kaneflex.mechanism.floating_frames import axial_modes
from kaneflex.mechanism.spatial import Side, spatial_mechanism_of
from kaneflex.multibody.model.shape_moments import ShapeMoments
from kaneflex.multibody.model.spatial_damping import against_axes, shape_damping
from kaneflex.multibody.model.spatial_layout import Place
from kaneflex.scene import Scene
from kaneflex.support.spatial_contract import SPATIAL_NODE

_KINDS = {("u",): 1, ("v", "theta_z"): 2, ("w", "theta_y"): 2, ("theta_x",): 1}
"""A node's coordinates of each kind, with the number of rigid-body motions of a free link."""
_NEAR = 0.99
"""Component of a joint's axis along one of the body's above which hardly any torque acts about that."""
_EQUAL = 1e-6  # relative distance of squared frequencies that are one's
_MORE = 4  # modes found beyond those requested, for those equal to the last one
_GAUSS = np.polynomial.legendre.leggauss(5)  # exact for two cubics times a mass that grows linearly


@dataclass(frozen=True, eq=False)
class SpatialShapes:
    """Shapes of a link at its nodes, one a column, rows of SPATIAL_NODE of each node in turn.

    Attributes
    ----------
    scene : Scene
    link : SpatialLink
    basis : ndarray (6 n_nodes, count)
        Orthogonal with respect to mass and stiffness; the largest displacement of each is one, of twist the rotation.
        Zero where the link's axes are held, but for turns about freed ones; of free axes without momentum.
    held : float or None
        Distance from the start at which the axes go along with the section [m], None: with the link in the mean.
    most : int
        Modes of bending that its elements have in either plane, beside the static shapes.
    counts : tuple of int
        Shapes of stretch, of bending in either plane, and of twist, which follow each other in ``basis``.
    """

    scene: Scene
    link: SpatialLink
    basis: np.ndarray
    held: float | None
    most: int
    counts: tuple[int, ...]

    @property
    def count(self) -> int:
        return self.basis.shape[1]

    @property
    def twisting(self) -> np.ndarray:
        """True for shapes of twist, (count,): their coordinates are angles [rad]."""
        return np.asarray(~self.basis.reshape(-1, 6, self.count)[:, :3].any(axis=(0, 1)))

    def carrier(self, at: Place) -> Place:
        """Place on the axis whose section carries a point."""
        return float(at[0]), 0.0, 0.0

    def spread(self, rises: bool) -> tuple[Place, tuple[np.ndarray, np.ndarray]]:
        """Mean place, and mean of :meth:`at`, with a weight that falls linearly to zero at the end, or rises from zero
        at the start."""
        x, _, _, rows, H, lengths = self._slices
        weight = lengths * (x if rises else self.link.nodes[-1] - x)
        weight /= weight.sum()
        mean = np.einsum("g,gaj->aj", weight, rows), np.einsum("g,gjk->jk", weight, H - self._start)
        return (float(weight @ x), 0.0, 0.0), (mean[0], _along(-mean[1]))

    @cached_property
    def turn(self) -> np.ndarray:
        """Rotation of the axes of the planar model about the body's x, y, z by each shape, (3, count) [rad/m]."""
        M = self.link.part.matrices["M"].value({})
        return (self.basis - against_axes(self.scene, self.link, self.basis, M))[3:6]

    def at(self, place: Place) -> tuple[np.ndarray, np.ndarray]:
        """Rows u, v, w, theta_x, theta_y, theta_z of the shapes, (6, count), and G (3, count, count) [1/m]."""
        x = place[0]
        return self._rows(x), _along(self._start - self._shortening(x))

    def numbers(self) -> np.ndarray:
        """Parameters of :mod:`kaneflex.generated.spatial_shapes`."""
        return self.moments.numbers(self.counts, self.stiffness, self.damping, self.cubic)

    @cached_property
    def moments(self) -> ShapeMoments:
        """Sums over the slices, whose fibres at y and z of the section go along with it.

        A section that bends the shortest way by theta_y and theta_z and then turns by theta_x about itself moves these
        to the second order by

            y (theta_x theta_y, -(theta_x^2 + theta_z^2) / 2, theta_y theta_z / 2)
            z (theta_x theta_z, theta_y theta_z / 2, -(theta_x^2 + theta_y^2) / 2)
        """
        x, dm, inertias, rows, H, _ = self._slices
        N, psi = rows[:, :3], rows[:, 3:].copy()
        if not self.scene.bodies[self.link.name].spatial_profile.rotary:
            psi[:, 1:] = 0.0  # then a section does not turn against its axes by bending
        turned, still = psi.transpose(1, 0, 2), np.zeros_like(psi[:, 0])
        first = [np.stack(of, axis=1) for of in ((-turned[2], still, turned[0]), (turned[1], -turned[0], still))]
        xx, yy, zz, xy, xz, yz = (
            np.einsum("gj,gl->gjl", turned[a], turned[b]) for a, b in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
        )
        second = [np.stack([0.5 * (of + of.transpose(0, 2, 1)) for of in (a, b, c)], axis=1)
                  for a, b, c in ((2.0 * xy, -(xx + zz), yz), (2.0 * xz, yz, -(xx + yy)))]  # fmt: skip
        G = _along(-np.einsum("g,gjl->jl", dm, H - self._start))
        along = _along(-np.einsum("g,gjl->jl", dm * x, H - self._start))
        beside = list(zip(inertias[::-1], first, second, strict=True))  # of the fibres' y I_z, of their z I_y
        return ShapeMoments(
            np.einsum("g,gaj->aj", dm, N),
            np.stack([np.einsum("g,gaj->aj", w, of) for w, of in ((dm * x, N), *((w, of) for w, of, _ in beside))]),
            sum((np.einsum("g,gaj,gbl->abjl", w, of, of) for w, of, _ in beside),
                np.einsum("g,gaj,gbl->abjl", dm, N, N)),
            G, np.stack([along, *(np.einsum("g,gajl->ajl", w, of) for w, _, of in beside)]),
        )  # fmt: skip

    @cached_property
    def stiffness(self) -> np.ndarray:
        """Stiffness of the modal coordinates [N/m], diagonal."""
        K = self.link.part.matrices["K_s"].value({})
        return np.diag(np.diag(self.basis.T @ K @ self.basis))

    @cached_property
    def omega(self) -> np.ndarray:
        """Circular frequency of each shape, its axes held [rad/s]."""
        M = self.link.part.matrices["M"].value({})
        return np.sqrt(np.diag(self.stiffness) / np.diag(self.basis.T @ M @ self.basis))

    @cached_property
    def damping(self) -> np.ndarray:
        """Damping of the modal coordinates [N s/m]."""
        return shape_damping(self.scene, self.link, self.basis)

    @cached_property
    def cubic(self) -> np.ndarray:
        """Third derivatives of the strain energy by the modal coordinates, halved [N/m^2], (count, count, count).

        Of a section that bends by theta_y, theta_z the shortest way and then turns by theta_x, the curvatures are

            theta_x' - (theta_y theta_z' - theta_z theta_y') / 2
            theta_y' + theta_x theta_z'
            theta_z' - theta_x theta_y'

        to second order (Hodges & Dowell 1974, NASA TN D-7818): bending in one plane twists what bends in the other one.
        """
        profile, found = self.scene.bodies[self.link.name].spatial_profile, np.zeros((self.count,) * 3)
        for e, (a, b) in enumerate(pairwise(self.link.nodes)):
            own, far = self.basis[6 * e : 6 * e + 12], (b - a) / 4
            for point, weight in zip(*_GAUSS, strict=True):
                local = (b - a) * (1.0 + point) / 2
                x, y, z = self.link._shape_at(e, local)[3:6] @ own
                ends = [self.link._shape_at(e, local + side)[3:6] @ own for side in (far, -far)]
                x_s, y_s, z_s = (ends[0] - ends[1]) / (2.0 * far)  # exact, as rotations are quadratic
                section, made_of = profile.at(a + local)
                assert made_of.E is not None and made_of.G is not None  # checked with the scene
                bending, twist = made_of.E * (section.I_z - section.I_y), made_of.G * section.J
                found -= weight * (b - a) / 2 * (
                    0.5 * twist * (_product(x_s, y, z_s) - _product(x_s, z, y_s)) + bending * _product(x, y_s, z_s)
                )  # fmt: skip
        return np.sum([np.transpose(found, order) for order in permutations(range(3))], axis=0) / 2.0

    def _rows(self, x: float) -> np.ndarray:
        e, local = self.link.locate(x)
        return self.link.shape(e, local)[:6] @ self.basis[6 * e : 6 * e + 12]

    @cached_property
    def _slices(self) -> tuple[np.ndarray, ...]:
        """Places of the slices [m], their masses, rotary inertias about y and z (2, n), rows (n, 6, count), H from
        the start, and how long they are."""
        profile, x, weights = self.scene.bodies[self.link.name].spatial_profile, [], []
        for a, b in pairwise(self.link.nodes):
            x.append((a + b) / 2 + (b - a) / 2 * _GAUSS[0])
            weights.append((b - a) / 2 * _GAUSS[1])
        places, lengths = np.concatenate(x), np.concatenate(weights)
        rho, A, I_y, I_z = np.array([
            (made_of.rho, section.A, section.I_y, section.I_z) for section, made_of in map(profile.at, places)
        ]).T  # fmt: skip
        rows = np.array([self._rows(place) for place in places])
        H = np.array([self._shortening(place) for place in places])
        return places, rho * A * lengths, rho * lengths * np.array([I_y, I_z]), rows, H, lengths

    def _shortening(self, x: float) -> np.ndarray:
        """int v_j' v_k' + w_j' w_k' + I_p / A theta_x,j' theta_x,k' dx from the start to x [m]."""
        e, local = self.link.locate(x)
        return self._before[e] + self._over(e, local)

    def _over(self, e: int, local: float) -> np.ndarray:
        """Shortening over the first part of an element."""
        found, length, of = np.zeros((self.count, self.count)), self.link.length_of(e), self.link.parameters
        own = self.basis[6 * e : 6 * e + 12]
        for share, weight in zip((1.0 + _GAUSS[0]) / 2, _GAUSS[1] / 2, strict=True):
            slopes = self.link._shape_at(e, local * share)[6:8] @ own
            found += weight * local * slopes.T @ slopes
        twist = (own[9] - own[3]) / length
        return found + local * of["I_p_A"][e] * np.outer(twist, twist)

    @cached_property
    def _before(self) -> list[np.ndarray]:
        """Shortening from the start to every node."""
        found = [np.zeros((self.count, self.count))]
        for e in range(len(self.link.nodes) - 1):
            found.append(found[-1] + self._over(e, self.link.length_of(e)))
        return found

    @cached_property
    def _start(self) -> np.ndarray:
        """Reference of the shortening: at the point that holds the axes, else its mean over the mass."""
        if self.held is not None:
            return self._shortening(self.held)
        _, dm, _, _, H, _ = self._slices
        return np.einsum("g,gjl->jl", dm / dm.sum(), H)


def _along(x: np.ndarray) -> np.ndarray:
    """Numbers of every two shapes (count, count) as the x of vectors, (3, count, count)."""
    return np.stack([x, np.zeros_like(x), np.zeros_like(x)])


def _product(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    return np.einsum("i,j,k->ijk", a, b, c)


def spatial_shapes(scene: Scene, link: SpatialLink, modes: int, held: Place | None, freed: str = "") -> SpatialShapes:
    """Static shapes of the points with joints and loads, and ``modes`` modes of bending in either plane, fewer of
    stretch and twist, with these points held.

    ``held``: the place whose section the link's axes follow. About those of them in ``freed``, like "z" or "xyz", they
    follow its mean rotation instead: shapes without angular momentum can't represent that rotation (Buckens 1972),
    which would leave it almost no inertia of its own.
    """
    x = None if held is None else held[0]
    first = None if x is None else link.node_at(x)
    joints, pushed = points_of(scene, link.name)
    turned, kept = ({node for node in map(link.node_at, places) if node not in (first, None)}
                    for places in (joints, [*joints, *pushed]))  # fmt: skip
    if held is None and not turned:
        turned, kept = {0}, kept | {0}  # the remaining motions don't deform it
    K, M = (link.part.matrices[name].value({}) for name in ("K_s", "M"))
    turning, twisted = ({SPATIAL_NODE.index(f"theta_{axis}") for axis in axes}
                        for axes in (freed, _twisted(scene, link.name, x)))  # fmt: skip
    found, most = [], 6 * len(link.nodes)
    for kind, rigid in _KINDS.items():
        places = [SPATIAL_NODE.index(name) for name in kind]
        loose = [k for k in places if k in turning]
        rows = np.array([6 * n + k for n in range(len(link.nodes)) for k in places if n != first or k in loose])
        static = [6 * node + k for node in sorted(kept) for k in places if k < 3 or node in turned]
        static += [6 * first + k for k in loose if first is not None and k in twisted]
        wanted = modes if len(places) == 2 else axial_modes(modes, len(link.nodes) - 1, len(kept) + 1)
        still = rigid if held is None else len(loose)
        if len(places) == 2:
            most = min(most, len(rows) - len(static))
        own = _of_kind(K, M, rows, static, wanted + (len(loose) if not static else 0))
        found.append(own[:, still:])
    return SpatialShapes(scene, link, np.hstack(found), x, most, tuple(own.shape[1] for own in found))


def points_of(scene: Scene, body: str) -> tuple[list[float], list[float]]:
    """Distances from a body's start [m] at which joints, and at which loads act."""
    mechanism = spatial_mechanism_of(scene)
    sides: Sequence[Side] = [side for joint in mechanism.joints.values() for side in joint.sides]
    loads = [load.at for load in mechanism.loads.values() if load.at is not None]
    return ([float(side.at[0]) for side in sides if side.body == body],
            [float(side.at[0]) for side in loads if side.body == body])  # fmt: skip


def _twisted(scene: Scene, body: str, x: float | None) -> str:
    """Axes of the body about which a torque can act on the section at x [m]: joints there act about all but their axes
    that are fixed in the body; a torque or a spring at a joint there, or several joints, about any."""
    mechanism, found = spatial_mechanism_of(scene), set[str]()
    here = {name: (joint, joint.sides.index(side)) for name, joint in mechanism.joints.items()
            for side in joint.sides if side.body == body and side.at[0] == x}  # fmt: skip
    turned = {load.joint for load in mechanism.loads.values()} | {each.joint for each in mechanism.springs.values()}
    if len(here) > 1 or here.keys() & turned:
        return "xyz"
    for joint, number in here.values():
        if joint.axes:
            carried = joint.axes[number if len(joint.axes) > 1 else 0]
            own = mechanism.stands(body).T @ mechanism.stands(joint.sides[0].body) @ carried
            found |= {axis for axis, along in zip("xyz", own, strict=True) if abs(along) < _NEAR}
    return "".join(sorted(found))


def _static(K: Matrix, rows: np.ndarray, static: list[int]) -> np.ndarray:
    """Shapes with one of the static rows equal to one, the others to zero, and equilibrium in the remaining rows."""
    inner, held = np.setdiff1d(rows, static), np.array(static, int)
    shapes = np.zeros((K.shape[0], len(static)))
    shapes[static, np.arange(len(static))] = 1.0
    if len(inner) and static:  # what turns freely is singular without
        shapes[inner] = -solve(K[inner][:, inner], as_array(K[inner][:, held]))
    return shapes


def _of_kind(K: Matrix, M: Matrix, rows: np.ndarray, static: list[int], modes: int) -> np.ndarray:
    """Shapes over all rows, by ascending frequency of the link held at its axes."""
    inner = np.setdiff1d(rows, static)
    modal = np.zeros((K.shape[0], 0))
    if modes and len(inner):
        own = [matrix[inner][:, inner] for matrix in (K, M)]
        if static:
            omega, found = lowest_modes(own[0], own[1], min(modes + _MORE, len(inner)))
            squares = omega**2
        else:  # where what turns freely is singular
            squares, found = eigh(*map(as_array, own))
        modal = np.zeros((K.shape[0], _whole(squares, modes)))
        modal[inner] = found[:, : modal.shape[1]]
    return _by_frequency(K, M, np.hstack([_static(K, rows, static), modal]))


def _by_frequency(K: Matrix, M: Matrix, basis: np.ndarray) -> np.ndarray:
    """Orthogonal shapes that span the same space, of ascending frequency; the largest displacement of each is one."""
    if not basis.shape[1]:
        return basis
    basis = basis @ eigh(basis.T @ K @ basis, basis.T @ M @ basis)[1]
    moved = abs(basis).reshape(-1, 6, basis.shape[1])
    largest = np.where(moved[:, :3].max(axis=(0, 1)) > 0.0, moved[:, :3].max(axis=(0, 1)), moved[:, 3].max(axis=0))
    return basis / largest


def _whole(squares: np.ndarray, count: int) -> int:
    """Number of modes: the first ``count`` of ascending squared frequencies, and those equal to the last of them.

    Any mixture of modes with equal frequencies, as of two spans of equal length, is a mode: only all of them together
    are independent of which end of the link is called its start.
    """
    last = min(count, len(squares)) - 1
    return int(np.searchsorted(squares, squares[last] + _EQUAL * abs(squares[last]), side="right"))
