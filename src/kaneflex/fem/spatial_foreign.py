"""Modal data in space of another program's finite elements: Craig and Bampton's shapes, and their sums over the mass.

Shapes are the static ones of the displacements and turns of each point and modes with the points held, without momentum
of the whole body (Craig & Bampton 1968; Buckens). To the second order a particle moves as that of a beam in the mean
does: this line shortens by bending, and its sections move their fibres by turning. That is what a slender body asks
for; of a compact one it is small.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import block_diag
from scipy.sparse import bmat, csc_array, diags_array

from kaneflex.fem.craig_bampton import DEGREE, grown, reduced, splines
from kaneflex.fem.foreign import TURNS, Foreign, rigid_motions
from kaneflex.fem.recovery import with_recovery
from kaneflex.scene.modal_data import CROSS, ModalData, spatial_modal_data

_BESIDE = 1e-3
"""Length, as a share of the link's, by which rotations of nodes are multiplied for comparison with displacements."""


def spatial_foreign_data(link: Foreign, modes: int, rigid: bool = True, damping: float = 0.0) -> ModalData:
    """Modal data of a body in space, with its points, its sections and their forces.

    Parameters
    ----------
    modes : int
        Number of modes with all points fixed, of any kind.
    rigid : bool
        True: the nodes of a point move as one body; False: the point moves as their mean.
    damping : float
        Damping ratio of every shape.

    Raises
    ------
    Fault
        If the mesh has fewer modes, or a point's rotation is not determined.
    """
    found, d = reduced(link, "any", modes, rigid), link.motions
    moved = found.shapes.reshape(len(link.nodes), d, -1)
    shapes = moved[:, :3]
    m = csc_array(sum(link.M[a::d, a::d] for a in range(3)) / 3)  # of the particles, the same in all directions
    r, carried = link.nodes, np.asarray(m.sum(axis=0)).ravel()
    weighed = np.stack([m @ shapes[:, a] for a in range(3)])  # component, node, shape
    sections = MeanSections.of(link, m, moved)
    second = np.concatenate([carried[None], carried * r.T])  # weights of 1, x, y, z
    G = np.stack([sections.second(r, weights) for weights in second])
    whole = {
        "mass": carried.sum(), "mass_r": carried @ r, "mass_r_r": r.T @ (m @ r),
        "mass_N": weighed.sum(axis=1), "mass_r_N": np.einsum("na,bnj->abj", r, weighed),
        "mass_N_N": np.einsum("naj,bnk->abjk", shapes, weighed), "mass_G": G[0], "mass_r_G": G[1:],
        "stiffness": found.stiffness, "damping": np.diag(2.0 * damping * np.sqrt(found.stiffness * found.mass)),
        "cubic": np.zeros((len(found.stiffness),) * 3),
    }  # fmt: skip
    if d == TURNS:
        whole |= _turning(link, found.shapes, whole)
    points, at_points = _points(link, moved, sections)
    return with_recovery(link, found.shapes, spatial_modal_data(link.length, points, whole | at_points))


def _turning(link: Foreign, shapes: np.ndarray, of_particles: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Sums over the mass where nodes turn, as far as the whole mass matrix knows them.

    It knows momentum, moment of momentum and energy. What else the equations take are sums of the particles at the
    nodes: how r and N go together where no turn is in that, and N N but for its trace.
    """
    whole = rigid_motions(link.nodes, link.motions, spatial=True).reshape(6, -1).T
    carried = link.M @ whole
    P, Q, E = whole.T @ carried, carried.T @ shapes, shapes.T @ (link.M @ shapes)
    J, r_N, N_N = P[3:, 3:], of_particles["mass_r_N"], of_particles["mass_N_N"]
    lacking = Q[3:] - np.einsum("cab,abj->cj", CROSS, r_N)  # of the moment of momentum
    short = E - np.einsum("aajk->jk", N_N)
    return {
        "mass": P[0, 0], "mass_r": 0.5 * np.einsum("cab,bc->a", CROSS, P[:3, 3:]),
        "mass_r_r": 0.5 * np.trace(J) * np.eye(3) - J, "mass_N": Q[:3],
        "mass_r_N": r_N + 0.5 * np.einsum("cab,cj->abj", CROSS, lacking),
        "mass_N_N": N_N + np.einsum("ab,jk->abjk", np.eye(3), short) / 3,
    }  # fmt: skip


def _points(
    link: Foreign, shapes: np.ndarray, sections: MeanSections
) -> tuple[list[str], dict[str, np.ndarray]]:
    """Points of the body, and of its sections on the mean line, with their SPATIAL_POINT_ARRAYS.

    ``shapes`` (n_nodes, d, n).
    """
    places, N, psi = {}, [], []
    for name, at in link.points.items():
        places[name] = link.nodes[at].mean(axis=0)
        rows = link.held(name, "any") @ shapes.reshape(-1, shapes.shape[2])
        N.append(rows[:3])  # a node alone turns as the sections do
        psi.append(rows[3:] if len(rows) == 6 else sections.turns(places[name][:1])[:, 0])
    for name, x in link.sections.items():
        places[name] = np.array([x, 0.0, 0.0])
        N.append(np.stack([part(x) for part in sections.line]))
        psi.append(sections.turns(places[name][:1])[:, 0])
    r = np.array(list(places.values()))
    G = np.array([sections.second(r[k : k + 1], np.ones(1)) for k in range(len(r))])
    return list(places), {"r": r, "N": np.array(N), "psi": np.array(psi), "G": G}


@dataclass(frozen=True, eq=False)
class MeanSections:
    """Mean motion of the sections of a link: splines over X by least squares over its mass.

    line : u, v, w of each shape; turning : theta_x, theta_y, theta_z; each of them of (n_places, n).
    """

    line: tuple[BSpline, BSpline, BSpline]
    turning: tuple[BSpline, BSpline, BSpline]
    ends: tuple[float, float]

    @classmethod
    def of(cls, link: Foreign, m: csc_array, shapes: np.ndarray) -> MeanSections:
        """Mean motion of the shapes (n_nodes, d, n); ``m`` (n_nodes, n_nodes) [kg] is the mass of the particles.

        A particle at (X, Y, Z) goes along with its section: u - Y theta_z + Z theta_y, v - Z theta_x, w + Y theta_x.
        Where nodes turn they do as their section does, which counts little beside that and alone on a line of nodes.
        """
        x, y, z = link.nodes.T
        knots, at = splines(x)
        in_y, in_z = diags_array(y) @ at, diags_array(z) @ at
        none = csc_array(at.shape)
        fields = bmat([
            [at, none, none, none, in_z, -in_y],
            [none, at, none, -in_z, none, none],
            [none, none, at, in_y, none, none],
        ], format="csr")
        parts = [fields[a * len(x) : (a + 1) * len(x)] for a in range(3)]
        square = sum((part.T @ (m @ part)).toarray() for part in parts)
        side = sum(part.T @ (m @ shapes[:, a]) for a, part in enumerate(parts))
        if link.turning.any():
            carried = (_BESIDE * link.length) ** 2 * np.asarray(m.sum(axis=0)).ravel() * link.turning
            turned = at.T @ diags_array(carried)
            own = (turned @ at).toarray()
            square += block_diag(*[np.zeros_like(own)] * 3, *[own] * 3)
            side += np.concatenate([np.zeros((3 * len(own), shapes.shape[2])),
                                    *(turned @ shapes[:, 3 + a] for a in range(3))])  # fmt: skip
        found = np.split(np.linalg.lstsq(square, side, rcond=1e-12)[0], 6)
        u, v, w, *turns = (BSpline(knots, part, DEGREE) for part in found)
        return cls((u, v, w), tuple(turns), (float(x.min()), float(x.max())))

    def turns(self, x: np.ndarray) -> np.ndarray:
        """theta_x, theta_y, theta_z of each shape, (3, n_places, n)."""
        return np.stack([part(np.clip(x, *self.ends)) for part in self.turning])

    def second(self, r: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """G (3, n, n) [1/m] of particles at r (n_places, 3), summed with weights (n_places,).

        The line shortens by the integral of v' v' + w' w' from the link's first section; of what a fibre at Y, Z of a
        turned section moves by see :attr:`kaneflex.multibody.model.shapes.Shapes.moments`.
        """
        x, y, z = r.T
        turns = self.turns(x)

        def summed(a: int, b: int, weights: np.ndarray) -> np.ndarray:
            one = (turns[a] * weights[:, None]).T @ turns[b]
            return 0.5 * (one + one.T)

        in_y, in_z = weights * y, weights * z
        shorter = grown([part.derivative() for part in self.line[1:]], x, weights)
        return np.stack([
            2.0 * (summed(0, 1, in_y) + summed(0, 2, in_z)) - shorter,
            summed(1, 2, in_z) - summed(0, 0, in_y) - summed(2, 2, in_y),
            summed(1, 2, in_y) - summed(0, 0, in_z) - summed(1, 1, in_z),
        ])  # fmt: skip
