"""Moments of a body's shapes: the sums over its mass that Kane's equations of a body that deforms in space take."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kaneflex.generated.spatial_shapes import PAIR, SINGLE


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
    """

    N: np.ndarray
    r_N: np.ndarray
    N_N: np.ndarray
    G: np.ndarray
    r_G: np.ndarray

    def numbers(self, stiffness: np.ndarray, damping: np.ndarray, cubic: np.ndarray) -> np.ndarray:
        """Parameters of :mod:`kaneflex.generated.spatial_shapes`, with the stiffness [N/m] and the damping [N s/m] of
        the modal coordinates, (count, count), and ``cubic`` (count, count, count)."""
        count = self.N.shape[1]
        singles = np.concatenate([self.N, self.r_N.reshape(9, count)])
        square = (-1, count, count)
        pairs = np.concatenate([
            self.N_N.reshape(square), self.G, self.r_G.reshape(square), stiffness[None], damping[None],
        ])  # fmt: skip
        assert len(singles) == len(SINGLE) and len(pairs) == len(PAIR)
        third = np.argwhere(cubic)
        thirds = np.column_stack([third, cubic[tuple(third.T)]])
        return np.concatenate([singles.T.ravel(), pairs.transpose(1, 2, 0).ravel(), [len(third)], thirds.ravel()])
