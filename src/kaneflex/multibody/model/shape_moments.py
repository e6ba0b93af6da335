"""Moments of a body's shapes: sums over its mass in Kane's equations of a body that deforms in space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np

from kaneflex.generated.spatial_shapes import CUBIC, KINDS, MOMENTS, PAIR, SINGLE
from kaneflex.support.contract import AXES


@dataclass(frozen=True, eq=False)
class ShapeMoments:
    """Integrals over the mass dm, of particles at r = (x, y, z) that shapes move by N q + 1/2 G q q in the body's axes.

    Attributes
    ----------
    N : ndarray (3, count)
        Of N dm [kg].
    r_N : ndarray (3, 3, count)
        Of r N dm [kg m], the components of r first.
    N_N : ndarray (3, 3, count, count)
        Of N_j N_k dm [kg], components first.
    G : ndarray (3, count, count)
        Of G dm [kg/m].
    r_G : ndarray (3, 3, count, count)
        Of r G dm [kg].
    line : tuple or None
        Of a straight beam along x that is pinned: place of the pin [m], and integral of its squared distance [kg m^2];
        None of other bodies.
    """

    N: np.ndarray
    r_N: np.ndarray
    N_N: np.ndarray
    G: np.ndarray
    r_G: np.ndarray
    line: tuple[float, float] | None = None

    def numbers(
        self, counts: Sequence[int], stiffness: np.ndarray, damping: np.ndarray, cubic: np.ndarray
    ) -> np.ndarray:
        """Parameters of :mod:`kaneflex.generated.spatial_shapes`.

        ``counts``: shapes of each kind but the last one. With the stiffness [N/m] and the damping [N s/m] of the modal
        coordinates, (count, count), and ``cubic`` (count, count, count), half of the third derivatives of the strain
        energy.
        """
        count = self.N.shape[1]
        ends = np.cumsum([0, *counts, count - sum(counts)])
        of_kind = {kind: np.arange(*ends[k : k + 2]) for k, kind in enumerate(KINDS)}
        Q, scale = self._shortening
        single, pair = self._sums | {"Q": Q, "K": np.diag(stiffness)}, self._growth | {"scale": scale, "C": damping}
        found = [np.array(counts, float)]
        for kind, shapes in of_kind.items():
            for j in shapes:
                found.append(np.array([single[name][j] for name in SINGLE[kind]]))
                for other, others in of_kind.items():
                    found += [np.array([pair[name][j, others] for name in PAIR.get(kind + other, ())]).T.ravel()]
        found.append(2.0 * cubic[np.ix_(*(of_kind[kind] for kind in CUBIC))].ravel())
        orders = {3: 2.0, 2: 1.0, 1: 1 / 3}  # by how many of the three shapes differ
        products = [(*of, orders[len({*of})] * cubic[of]) for of in combinations_with_replacement(of_kind["g"], 3)
                    if cubic[of]]  # fmt: skip
        return np.concatenate([*found, [len(products)], np.ravel(products)])

    @property
    def _sums(self) -> dict[str, np.ndarray]:
        """Sums of every shape by their names, (count,)."""
        return _named("P", self.N) | _named("H", _cross(self.r_N)) | _named("J", _inertia(self.r_N))

    @property
    def _shortening(self) -> tuple[np.ndarray, np.ndarray]:
        """Integrals of a pinned beam's shapes times the distance xi from the pin, (count,), and factors of xi that
        fit G_x best, (count, count)."""
        if self.line is None:
            return np.zeros(self.N.shape[1]), np.zeros(self.G.shape[1:])
        at, square = self.line
        return (self.r_N[0] - at * self.N).sum(axis=0), (self.r_G[0, 0] - at * self.G[0]) / square

    @property
    def _growth(self) -> dict[str, np.ndarray]:
        """Sums of every two shapes by their names, (count, count)."""
        X = -_cross(self.N_N)  # of N_k x N_j
        found = _named("P", self.G) | _named("H", _cross(self.r_G) + X) | _named("X", X)
        return found | _named("J", _inertia(self.N_N + self.r_G)) | {"M": np.einsum("aajk->jk", self.N_N)}


def _cross(of: np.ndarray) -> np.ndarray:
    """Sums of a x b from those of a b^T, components first."""
    return np.stack([of[1, 2] - of[2, 1], of[2, 0] - of[0, 2], of[0, 1] - of[1, 0]])


def _inertia(of: np.ndarray) -> np.ndarray:
    """Sums of (a.b) 1 - sym(a b^T) from those of a b^T, components MOMENTS first."""
    trace = of[0, 0] + of[1, 1] + of[2, 2]
    return np.stack([trace * (i == j) - (of[i, j] + of[j, i]) / 2 for i, j in map(_place, MOMENTS)])


def _place(axes: str) -> tuple[int, int]:
    return AXES.index(axes[0]), AXES.index(axes[1])


def _named(letter: str, of: np.ndarray) -> dict[str, np.ndarray]:
    """Components by their names."""
    return {f"{letter}_{axes}": each for axes, each in zip(AXES if len(of) == 3 else MOMENTS, of, strict=True)}
