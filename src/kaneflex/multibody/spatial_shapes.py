"""Shapes of elastic links in space, and the sums over their slices that the equations of a deforming body take.

A link's finite elements fall into four kinds of motion that know nothing of each other: stretch, bending in either
plane, twist. Shapes are found of each kind by itself: static ones of the points where something acts, and modes with
these points held (Craig & Bampton 1968).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, permutations

import numpy as np
from scipy.linalg import eigh

from kaneflex.fem.spatial_links import SpatialLink
from kaneflex.generated.spatial_shapes import PAIR, SINGLE
from kaneflex.mechanism.floating_frames import axial_modes
from kaneflex.mechanism.spatial import Side, spatial_mechanism_of
from kaneflex.multibody.spatial_damping import against_axes, shape_damping
from kaneflex.scene import Scene
from kaneflex.support.spatial_contract import SPATIAL_NODE

_KINDS = {("u",): 1, ("v", "theta_z"): 2, ("w", "theta_y"): 2, ("theta_x",): 1}
"""A node's coordinates of each kind, with how many of a free link's shapes deform nothing."""
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
        Zero where the link's axes are held; of free axes without momentum.
    held : float or None
        Distance from the start at which the axes go along with the section [m], None: with the link in the mean.
    freed : str
        Those of x, y, z about which the axes turn with the link in the mean although they are held.
    """

    scene: Scene
    link: SpatialLink
    basis: np.ndarray
    held: float | None
    freed: str = ""

    @property
    def count(self) -> int:
        return self.basis.shape[1]

    @property
    def twisting(self) -> np.ndarray:
        """Whether each shape is one of twist, (count,): its coordinate is an angle [rad]."""
        return np.asarray(~self.basis.reshape(-1, 6, self.count)[:, :3].any(axis=(0, 1)))

    def station(self, x: float) -> np.ndarray:
        """N, psi (3, count), and H (count, count) x [m] from the start, one after the other."""
        rows, H = self.at(x)
        return np.concatenate([rows[:6].ravel(), H.ravel()])

    def spread(self, rises: bool) -> tuple[float, np.ndarray]:
        """The mean of such numbers, and of x, by a weight that falls linearly to zero at the end, or rises from there
        at the start."""
        x, _, _, rows, H, lengths = self._slices
        weight = lengths * (x if rises else self.link.nodes[-1] - x)
        weight /= weight.sum()
        mean = np.einsum("g,gaj->aj", weight, rows[:, :6]), np.einsum("g,gjk->jk", weight, H - self._start)
        return float(weight @ x), np.concatenate([part.ravel() for part in mean])

    @cached_property
    def turn(self) -> np.ndarray:
        """How far each shape turns the axes of the planar model about the body's x, y, z, (3, count) [rad/m]."""
        M = self.link.part.matrices["M"].at({}).toarray()
        return (self.basis - against_axes(self.scene, self.link, self.basis, M))[3:6]

    def at(self, x: float) -> tuple[np.ndarray, np.ndarray]:
        """Rows u, v, w, theta_x, theta_y, theta_z, v', w' of the shapes, (8, count), and H (count, count) [1/m]."""
        return self._rows(x), self._shortening(x) - self._start

    def numbers(self) -> np.ndarray:
        """Those of :mod:`kaneflex.generated.spatial_shapes`: SINGLE of every shape, PAIR of every two."""
        x, dm, (I_y, I_z), rows, H, _ = self._slices
        H = H - self._start
        N, psi = rows[:, :3], rows[:, 3:6].copy()
        profile = self.scene.bodies[self.link.name].spatial_profile
        if not profile.rotary:  # then a section does not turn against its axes by bending
            psi[:, 1:] = 0.0
        one = [np.einsum("g,gaj->ja", weight, of) for weight, of in ((dm, N), (dm * x, N), (I_y, psi), (I_z, psi))]
        two = [np.einsum("g,gaj,gbl->jlab", weight, of, of).reshape(self.count, self.count, 9)
               for weight, of in ((dm, N), (I_y, psi), (I_z, psi))]  # fmt: skip
        shortening = [np.einsum("g,gjl->jl", weight, H)[..., None] for weight in (dm, dm * x)]
        inside = [matrix[..., None] for matrix in (self.stiffness, self.damping)]
        pairs = np.concatenate([two[0], *shortening, *two[1:], *inside], axis=2)
        singles = np.concatenate(one, axis=1)
        assert singles.shape[1] == len(SINGLE) and pairs.shape[2] == len(PAIR)
        return np.concatenate([singles.ravel(), pairs.ravel(), self.cubic.ravel()])

    @cached_property
    def stiffness(self) -> np.ndarray:
        """Of the modal coordinates [N/m], diagonal."""
        K = self.link.part.matrices["K_s"].at({}).toarray()
        return np.diag(np.diag(self.basis.T @ K @ self.basis))

    @cached_property
    def omega(self) -> np.ndarray:
        """Circular frequency of each shape, its axes held [rad/s]."""
        M = self.link.part.matrices["M"].at({}).toarray()
        return np.sqrt(np.diag(self.stiffness) / np.diag(self.basis.T @ M @ self.basis))

    @cached_property
    def damping(self) -> np.ndarray:
        """Of the modal coordinates [N s/m]."""
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
        return self.link.shape(e, local) @ self.basis[6 * e : 6 * e + 12]

    @cached_property
    def _slices(self) -> tuple[np.ndarray, ...]:
        """Places of the slices [m], their masses, rotary inertias about y and z (2, n), rows (n, 8, count), H from
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
        """The same over the first part of an element."""
        found, length, of = np.zeros((self.count, self.count)), self.link.length_of(e), self.link.parameters
        own = self.basis[6 * e : 6 * e + 12]
        for share, weight in zip((1.0 + _GAUSS[0]) / 2, _GAUSS[1] / 2, strict=True):
            slopes = self.link._shape_at(e, local * share)[6:8] @ own
            found += weight * local * slopes.T @ slopes
        twist = (own[9] - own[3]) / length
        return found + local * of["I_p_A"][e] * np.outer(twist, twist)

    @cached_property
    def _before(self) -> list[np.ndarray]:
        """The same from the start to every node."""
        found = [np.zeros((self.count, self.count))]
        for e in range(len(self.link.nodes) - 1):
            found.append(found[-1] + self._over(e, self.link.length_of(e)))
        return found

    @cached_property
    def _start(self) -> np.ndarray:
        """The same where the shortening begins: at the point that holds the axes, else in the mean of the mass."""
        if self.held is not None:
            return self._shortening(self.held)
        _, dm, _, _, H, _ = self._slices
        return np.einsum("g,gjl->jl", dm / dm.sum(), H)


def _product(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    return np.einsum("i,j,k->ijk", a, b, c)


def spatial_shapes(
    scene: Scene, link: SpatialLink, modes: int, held: float | None, freed: str = ""
) -> SpatialShapes:
    """Static shapes of the points where joints and loads act, and ``modes`` modes of bending in either plane, fewer of
    stretch and twist, with these points held.

    ``held``: where the link's axes go along with its section [m]. About axes ``freed`` that its joint there lets it
    turn about, they follow its mean turn: without momentum its shapes can't take the place of that turn (Buckens),
    which would leave it next to no inertia of its own.
    """
    first = None if held is None else link.node_at(held)
    joints, pushed = points_of(scene, link.name)
    turned, kept = ({node for node in map(link.node_at, places) if node not in (first, None)}
                    for places in (joints, [*joints, *pushed]))  # fmt: skip
    if held is None and not turned:
        turned, kept = {0}, kept | {0}  # what is left of its motions deforms nothing
    K, M = (link.part.matrices[name].at({}).toarray() for name in ("K_s", "M"))
    twisted = held in _torques(scene, link.name) or sum(place == held for place in joints) > 1
    found = []
    for kind, rigid in _KINDS.items():
        places = [SPATIAL_NODE.index(name) for name in kind]
        loose = [k for k in places if k >= 3 and "xyz"[k - 3] in freed]
        rows = np.array([6 * n + k for n in range(len(link.nodes)) for k in places if n != first or k in loose])
        static = [6 * node + k for node in sorted(kept) for k in places if k < 3 or node in turned]
        static += [6 * first + k for k in loose if first is not None and twisted]
        wanted = modes if len(places) == 2 else axial_modes(modes, len(link.nodes) - 1, len(kept) + 1)
        still = rigid if held is None else len(loose)
        own = _of_kind(K, M, rows, static, wanted + (len(loose) if not static else 0))
        found.append(own[:, still:])
    return SpatialShapes(scene, link, np.hstack(found), held, freed)


def points_of(scene: Scene, body: str) -> tuple[list[float], list[float]]:
    """Distances from a body's start [m] at which joints, and at which loads act."""
    mechanism = spatial_mechanism_of(scene)
    sides: Sequence[Side] = [side for joint in mechanism.joints.values() for side in joint.sides]
    loads = [load.at for load in mechanism.loads.values() if load.at is not None]
    return ([float(side.at[0]) for side in sides if side.body == body],
            [float(side.at[0]) for side in loads if side.body == body])  # fmt: skip


def _torques(scene: Scene, body: str) -> set[float]:
    """Distances from a body's start [m] of joints at which a load is a torque."""
    mechanism = spatial_mechanism_of(scene)
    joints = [mechanism.joints[load.joint] for load in mechanism.loads.values() if load.joint is not None]
    return {float(side.at[0]) for joint in joints for side in joint.sides if side.body == body}


def _of_kind(K: np.ndarray, M: np.ndarray, rows: np.ndarray, static: list[int], modes: int) -> np.ndarray:
    """Shapes over all rows, by ascending frequency of the link held at its axes."""
    inner = np.setdiff1d(rows, static)
    count = min(modes, len(inner))
    basis = np.zeros((len(K), len(static) + count))
    basis[static, np.arange(len(static))] = 1.0
    if len(inner):
        held = np.array(static, int)
        basis[inner, : len(static)] = -np.linalg.solve(K[np.ix_(inner, inner)], K[np.ix_(inner, held)])
    if count:
        square = np.ix_(inner, inner)
        basis[inner, len(static) :] = eigh(K[square], M[square], subset_by_index=(0, count - 1))[1]
    if not basis.shape[1]:
        return basis
    basis = basis @ eigh(basis.T @ K @ basis, basis.T @ M @ basis)[1]
    moved = abs(basis).reshape(-1, 6, basis.shape[1])
    largest = np.where(moved[:, :3].max(axis=(0, 1)) > 0.0, moved[:, :3].max(axis=(0, 1)), moved[:, 3].max(axis=0))
    return basis / largest
