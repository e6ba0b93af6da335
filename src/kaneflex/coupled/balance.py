"""Section forces of a link under preset coupled, in balance with all that acts on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kaneflex.deformation import Deformation


@dataclass(frozen=True, eq=False)
class Balanced(Deformation):
    """A deformation in the link's shapes, whose elements also bear the static share of the shapes that are missing.

    ``share`` (3 n_nodes, n_times) is K_s^-1 of what the shapes leave out of balance. Its forces are those of K_s alone:
    with those of K_g, which in a slender link are far larger, the balance that defines it would be lost again.
    """

    share: np.ndarray

    def _residual(self, e: int) -> np.ndarray:
        total = super()._residual(e)
        for key, monomial, blocks in self.link.element_terms:
            if key == "K_s" and not monomial:
                total -= blocks[e] @ self.share[3 * e : 3 * e + 6]
        return total
