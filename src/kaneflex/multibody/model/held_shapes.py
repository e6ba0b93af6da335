"""Modal data of bodies: their shapes in the axes of a mechanism.

In space a file has its shapes in axes of its own. A mechanism needs axes that follow the body at its joint in the
tree, or in the mean: these move by t_j q_j and turn by w_j q_j in the file's axes, so that

    N_j' = N_j - t_j - w_j x r

    G_jk' = G_jk - w_j x N_k' - w_k x N_j' - (w_j x (w_k x r) + w_k x (w_j x r)) / 2 - t_jk

describe the same motions to the second order; t_jk makes G' vanish at that place, or in the mean. The strain energy
depends on the modal coordinates alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kaneflex.multibody.model.shapes import ShapeMoments
from kaneflex.multibody.model.tree_layout import Place
from kaneflex.scene.modal_data import CROSS, ModalData


@dataclass(frozen=True, eq=False)
class HeldShapes:
    """Shapes of a body's modal data in its axes, :class:`kaneflex.multibody.model.tree_layout.Deformable`.

    ``moments`` in space, and of the points of the data ``rows``, N and psi (n_points, 3 or 6, count), and ``G``
    (n_points, 3, count, count).
    """

    data: ModalData
    moments: ShapeMoments | None
    rows: np.ndarray
    G: np.ndarray

    @classmethod
    def in_plane(cls, data: ModalData) -> HeldShapes:
        """Shapes of a planar body, whose file has them in the axes of the link."""
        a, (axial, transverse), points = data.arrays, data.counts, len(data.points)
        count, across = axial + transverse, slice(axial, None)
        rows, G = np.zeros((points, 3, count)), np.zeros((points, 3, count, count))
        rows[:, 0, :axial], rows[:, 1, across], rows[:, 2, across] = a["s"], a["w"], a["psi"]
        G[:, 0, across, across] = -a["H"]
        return cls(data, None, rows, G)

    @property
    def count(self) -> int:
        return self.rows.shape[2]

    @property
    def counts(self) -> tuple[int, ...]:
        """Shapes of each kind of a link: in space none."""
        return self.data.counts if self.moments is None else (0, 0, 0, 0)

    @cached_property
    def twisting(self) -> np.ndarray:
        """True for each shape that displaces none of the points and rotates some."""
        N, psi = self.data.arrays["N"], self.data.arrays["psi"]
        return np.asarray(~N.any(axis=(0, 1)) & psi.any(axis=(0, 1)))

    @cached_property
    def stiffness(self) -> np.ndarray:
        return np.diag(self.data.arrays["stiffness"])

    @property
    def damping(self) -> np.ndarray:
        return self.data.arrays["damping"]

    def numbers(self) -> np.ndarray:
        assert self.moments is not None  # in space
        return self.moments.numbers(self.counts, self.stiffness, self.damping, self.data.arrays["cubic"])

    def carrier(self, at: Place) -> Place:
        """Nearest point of the data."""
        return (*self.data.places[self._point(at)].tolist(), *at[self.data.dimension :])

    def at(self, place: Place) -> tuple[np.ndarray, np.ndarray]:
        k = self._point(place)
        return self.rows[k], self.G[k]

    def _point(self, place: Place) -> int:
        found = self.data.at(place[: self.data.dimension])
        assert found is not None  # checked with the scene
        return found


def held_shapes(data: ModalData, held: Place | None, freed: str = "") -> HeldShapes:
    """Shapes of modal data with zero displacement and rotation at a place, except about axes in ``freed``, like "z" or
    "xyz", about which they have no angular momentum; without a place they have no momentum at all (Buckens 1972)."""
    a = data.arrays
    m, S, E, count = float(a["mass"]), a["mass_r"], a["mass_r_r"], len(a["stiffness"])
    # Translations along and turns about x, y, z as further shapes A + B r.
    A, B = np.hstack([np.eye(3), np.zeros((3, 3))]), np.concatenate([np.zeros((3, 3, 3)), CROSS.transpose(1, 0, 2)])
    B = B.transpose(1, 2, 0)  # component, component of r, shape
    N = np.hstack([a["mass_N"], m * A + np.einsum("bdj,d->bj", B, S)])
    of_r = np.einsum("a,bj->abj", S, A) + np.einsum("bdj,ad->abj", B, E)
    r_N = np.concatenate([a["mass_r_N"], of_r], axis=2)
    mixed = np.einsum("aj,bk->abjk", a["mass_N"], A) + np.einsum("bdk,daj->abjk", B, a["mass_r_N"])
    rigid = np.einsum("aj,bk->abjk", A, N[:, count:]) + np.einsum("adj,dbk->abjk", B, of_r)
    N_N = np.block([[a["mass_N_N"], mixed], [mixed.transpose(1, 0, 3, 2), rigid]])
    moved = np.einsum("bdj,pd->pbj", B, a["r"]) + A
    rows = np.concatenate([
        np.concatenate([a["N"], moved], axis=2),
        np.concatenate([a["psi"], np.broadcast_to(np.eye(3, 6, 3), moved.shape)], axis=2),
    ], axis=1)  # fmt: skip

    point = None if held is None else data.at(held)
    r_P = np.zeros(3) if point is None else a["r"][point]
    momentum = np.einsum("cab,abj->cj", CROSS, r_N - np.einsum("a,bj->abj", r_P, N))
    wanted = np.vstack([N, momentum]) if point is None else rows[point].copy()
    for k in map("xyz".index, freed if point is not None else ""):
        wanted[3 + k] = momentum[k]
    taken = np.linalg.solve(wanted[:, count:], wanted[:, :count])
    kept, w = np.vstack([np.eye(count), -taken]), taken[3:]

    N, r_N, N_N, rows = N @ kept, r_N @ kept, kept.T @ N_N @ kept, rows @ kept
    W = np.einsum("bcd,cj->bdj", CROSS, w)
    twice = _symmetric(np.einsum("bdj,dek->bejk", W, W)) / 2

    def second(G: np.ndarray, N: np.ndarray, r: np.ndarray) -> np.ndarray:
        """Second-order term G' without t_jk, from G, N' and r at a point or summed; leading axes are kept."""
        turned = _symmetric(np.einsum("bdj,...dk->...bjk", W, N))
        return G - turned - np.einsum("bejk,...e->...bjk", twice, r)

    G, r_G = second(a["mass_G"], N, S), second(a["mass_r_G"], r_N, E)
    at_points = second(a["G"], rows[:, :3], a["r"])
    origin = G / m if point is None else at_points[point]
    moments = ShapeMoments(N, r_N, N_N, G - m * origin, r_G - np.einsum("a,bjk->abjk", S, origin))
    return HeldShapes(data, moments, rows, at_points - origin)


def _symmetric(array: np.ndarray) -> np.ndarray:
    """An array plus itself with the two shapes exchanged."""
    return array + np.swapaxes(array, -1, -2)
