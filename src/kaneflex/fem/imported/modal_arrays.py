"""Modal data of another program's finite elements: sums over the mass of Craig and Bampton's shapes.

Particles replace a beam's sections: the rotation psi of a section is the -u / Y of its fibres, so that the integrals
of X psi dJ become those of -Y u, and a shape's kinetic energy is that of all of its displacements. To the second order
a particle moves as that of a beam in the mean does: this line shortens by bending, and in space its sections move their
fibres by turning. A slender body needs that; for a compact one it is small.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import block_diag
from scipy.sparse import bmat, csc_array, diags_array

from kaneflex.fem.imported.craig_bampton import reduced
from kaneflex.fem.imported.elements import TURNS, ImportedMesh, Motion, rigid_motions
from kaneflex.fem.imported.recovery import IN_PLANE, padded, with_recovery
from kaneflex.scene.modal_data import CROSS, ModalData, checked_data, planar_arrays, spatial_modal_data

DEGREE, _PIECES = 5, 12
"""Degree of the spline of the mean line."""
_BESIDE = 1e-3
"""Length, as a share of the link's, by which rotations of nodes are multiplied for comparison with displacements."""


def imported_data(link: ImportedMesh, modes: int, rigid: bool = True, damping: float = 0.0) -> ModalData:
    """Modal data of a body, with its points, its sections and their forces.

    Parameters
    ----------
    modes : int
        Number of modes with all points fixed: in the plane of transverse ones, with half as many axial ones; in space
        of any kind.
    rigid : bool
        True: the nodes of a point move as one body; False: the point moves as their mean.
    damping : float
        Damping ratio of every mode of the free link.

    Raises
    ------
    Fault
        If the mesh has fewer modes, a planar one isn't symmetric, or a point's rotation is not determined.
    """
    counts: dict[Motion, int] = {"any": modes} if link.spatial else {"axial": (modes + 1) // 2, "transverse": modes}
    each = [reduced(link, motion, count, rigid) for motion, count in counts.items()]
    shapes = np.hstack([one.shapes for one in each])
    mass, stiffness = (np.concatenate([getattr(one, of) for one in each]) for of in ("mass", "stiffness"))
    moved = padded(shapes.reshape(len(link.nodes), link.motions, -1), range(link.motions), max(3, link.motions))
    r, N = padded(link.nodes, range(link.axes), 3), moved[:, :3]
    particles = csc_array(sum(link.M[a :: link.motions, a :: link.motions] for a in range(link.axes)) / link.axes)
    sections = MeanSections.of(link, r, particles, moved)
    carried = np.asarray(particles.sum(axis=0)).ravel()
    weighed = np.stack([particles @ N[:, a] for a in range(3)])  # component, node, shape
    whole = {
        "mass": carried.sum(), "mass_r": carried @ r, "mass_r_r": r.T @ (particles @ r),
        "mass_N": weighed.sum(axis=1), "mass_r_N": np.einsum("na,bnj->abj", r, weighed),
        "mass_N_N": np.einsum("naj,bnk->abjk", N, weighed),
        "stiffness": stiffness, "damping": np.diag(2.0 * damping * np.sqrt(stiffness * mass)),
    }  # fmt: skip
    if link.motions == TURNS:
        whole |= _turning(link, shapes, whole)
    names, at_points = _points(link, r, shapes, sections)
    if link.spatial:
        G = np.stack([sections.second(r, weights) for weights in np.concatenate([carried[None], carried * r.T])])
        whole |= {"mass_G": G[0], "mass_r_G": G[1:], "cubic": np.zeros((len(mass),) * 3)}
        at_points["G"] = np.stack([sections.second(place[None], np.ones(1)) for place in at_points["r"]])
        return with_recovery(link, shapes, spatial_modal_data(link.length, names, whole | at_points))
    axial = len(each[0].mass)
    shorter = shortening(sections.slope(axial), r[:, 0], carried, at_points["r"][:, 0])
    arrays = planar_arrays(whole | at_points, np.diag(mass), axial, shorter) | {"mass_s": np.zeros(axial)}
    return with_recovery(link, shapes, checked_data(ModalData(link.length, tuple(names), arrays).file))


def _turning(link: ImportedMesh, shapes: np.ndarray, of_particles: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
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
    link: ImportedMesh, r: np.ndarray, shapes: np.ndarray, sections: MeanSections
) -> tuple[list[str], dict[str, np.ndarray]]:
    """Points of the body, and of its sections on the mean line, with their places r, and N and psi of the shapes
    (n_nodes d, n); ``r`` (n_nodes, 3): of the nodes."""
    places, N, psi = {}, [], []
    for name, at in link.points.items():
        places[name] = r[at].mean(axis=0)
        rows = (link.held(name, "any") if link.spatial else _planar_rows(link, name)) @ shapes
        N.append(rows[:3])  # a node alone turns as the sections do
        psi.append(rows[3:] if len(rows) == 6 else sections.turns(places[name][:1])[:, 0])
    for name, x in link.sections.items():
        places[name] = np.array([x, 0.0, 0.0])
        N.append(np.stack([part(x) for part in sections.line]))
        psi.append(sections.turns(places[name][:1])[:, 0])
    return list(places), {"r": np.array(list(places.values())), "N": np.array(N), "psi": np.array(psi)}


def _planar_rows(link: ImportedMesh, point: str) -> np.ndarray:
    """Rows (3 or 6, n_nodes d) of a point's displacement and rotation in the plane; a single node has no rotation."""
    rows = padded(np.array(link.means(point))[None], IN_PLANE, 6)[0]
    return rows[:3] if len(link.points[point]) == 1 else rows


def splines(x: np.ndarray) -> tuple[np.ndarray, csc_array]:
    """Knots along a link, and the splines' values (n_nodes, n_splines) at the distances x [m] of nodes."""
    first, last = x.min(), x.max()
    knots = np.concatenate([[first] * DEGREE, np.linspace(first, last, _PIECES + 1), [last] * DEGREE])
    return knots, BSpline.design_matrix(np.clip(x, first, last), knots, DEGREE).tocsc()


def shortening(slope: BSpline, x: np.ndarray, carried: np.ndarray, places: np.ndarray) -> dict[str, np.ndarray]:
    """Arrays of what bending shortens a link in the plane by: integral of w_j' w_k' up to each place, minus its mean
    over the masses ``carried`` [kg] at x [m], (n_nodes,)."""
    mean = grown((slope,), x, carried) / carried.sum()
    H = [grown((slope,), places[k : k + 1], np.ones(1)) - mean for k in range(len(places))]
    first = carried * x
    return {"H": np.stack(H), "mass_H": 0.0 * mean, "mass_X_H": grown((slope,), x, first) - first.sum() * mean}


@dataclass(frozen=True, eq=False)
class MeanSections:
    """Mean motion of the sections of a link: splines over X by least squares over its mass.

    line : u, v, w of each shape; turning : theta_x, theta_y, theta_z, in the plane by the line's slope; each of them of
    (n_places, n).
    """

    line: tuple[BSpline, BSpline, BSpline]
    turning: tuple[BSpline, BSpline, BSpline]
    ends: tuple[float, float]

    @classmethod
    def of(cls, link: ImportedMesh, r: np.ndarray, m: csc_array, shapes: np.ndarray) -> MeanSections:
        """Mean motion of the shapes (n_nodes, 3 or 6, n) of nodes at r (n_nodes, 3); ``m`` (n_nodes, n_nodes) [kg] is
        the mass of the particles.

        A particle at (X, Y, Z) goes along with its section: u - Y theta_z + Z theta_y, v - Z theta_x, w + Y theta_x.
        Where nodes turn they do as their section does, which counts little beside that and alone on a line of nodes.
        """
        (x, y, z), count = r.T, 6 if link.spatial else 3
        knots, at = splines(x)
        in_y, in_z = diags_array(y) @ at, diags_array(z) @ at
        none = csc_array(at.shape)
        rows = [[at, none, none, none, in_z, -in_y], [none, at, none, -in_z, none, none],
                [none, none, at, in_y, none, none]]  # fmt: skip
        fields = bmat([row[:count] for row in rows], format="csr")
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
        found = np.split(np.linalg.lstsq(square, side, rcond=1e-12)[0], count)
        u, v, w, *turns = (BSpline(knots, part, DEGREE) for part in found)
        return cls((u, v, w), tuple(turns) or (w, w, v.derivative()), (float(x.min()), float(x.max())))

    def slope(self, first: int) -> BSpline:
        """theta_z of the shapes from ``first`` on."""
        return BSpline(self.turning[2].t, self.turning[2].c[:, first:], self.turning[2].k)

    def turns(self, x: np.ndarray) -> np.ndarray:
        """theta_x, theta_y, theta_z of each shape, (3, n_places, n)."""
        return np.stack([part(np.clip(x, *self.ends)) for part in self.turning])

    def second(self, r: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """G (3, n, n) [1/m] of particles at r (n_places, 3), summed with weights (n_places,).

        The line shortens by the integral of v' v' + w' w' from the link's first section. For the
        displacement of a fibre at Y, Z of a turned section see :attr:`kaneflex.multibody.model.shapes.Shapes.moments`.
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


def grown(slopes: Iterable[BSpline], x: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Integral of s_j s_k from a link's first section up to each place x [m], summed with weights (n_places,): (n, n)
    [1/m], summed over the slopes s of lines of DEGREE.

    Gauss's rule of DEGREE points is exact between neighbours among knots and places.
    """
    at, shares = np.polynomial.legendre.leggauss(DEGREE)
    each = []
    for slope in slopes:
        first, last = slope.t[0], slope.t[-1]
        bounds, up_to = np.unique(np.clip(np.concatenate([x, slope.t]), first, last), return_inverse=True)
        half = np.diff(bounds) / 2
        fine = (bounds[:-1] + half)[:, None] + half[:, None] * at
        ends_at = np.bincount(up_to[: len(x)], weights, len(bounds))
        beyond = ends_at[::-1].cumsum()[::-1][1:]  # of the places that a piece lies before
        found = slope(fine.ravel())
        each.append((found * ((beyond * half)[:, None] * shares).reshape(-1, 1)).T @ found)
    return np.sum(each, axis=0)
