"""Displacements and section forces anywhere on an elastic link, from a solution's coordinates."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from kaneflex.affine import Affine, Monomial
from kaneflex.assembly import load_on_link, spin_or_euler
from kaneflex.links import Link
from kaneflex.model import Model, RigidMotion

_GAUSS = np.polynomial.legendre.leggauss(3)  # exact for v'^2 of a cubic


def shape_functions(x: float, length: float) -> np.ndarray:
    """Rows u, v, theta = v' over (u1, v1, theta1, u2, v2, theta2), paper (49)-(55); x from the first node [m]."""
    s = x / length
    return np.array([
        [1 - s, 0, 0, s, 0, 0],
        [0, 1 - 3 * s**2 + 2 * s**3, x * (1 - s) ** 2, 0, 3 * s**2 - 2 * s**3, x * (s**2 - s)],
        [0, 6 * (s**2 - s) / length, 1 - 4 * s + 3 * s**2, 0, 6 * (s - s**2) / length, 3 * s**2 - 2 * s],
    ])  # fmt: skip


@dataclass(frozen=True, eq=False)
class Deformation:
    """One link's nodal coordinates q, q', q'' over time, in link axes; arrays (3 n_nodes, n_times)."""

    model: Model
    link: Link
    rigid: RigidMotion
    q: np.ndarray
    q_rate: np.ndarray
    q_accel: np.ndarray

    def at(self, x: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(u, v, theta) and first and second rates at distance x [m] from the start; each (3, n_times).

        Under the geometric term u holds the foreshortening -1/2 int_0^x v'^2 as well (Kane, Ryan, Banerjee 1987).
        """
        e, local = self._locate(x)
        shape = shape_functions(local, self._element_length(e))
        rows = slice(3 * e, 3 * e + 6)
        d, d_rate, d_accel = (shape @ series[rows] for series in (self.q, self.q_rate, self.q_accel))
        if self.model.options.foreshortening:
            shortening = self._foreshortening(x)
            d[0] -= shortening[0]
            d_rate[0] -= shortening[1]
            d_accel[0] -= shortening[2]
        return d, d_rate, d_accel

    def _locate(self, x: float) -> tuple[int, float]:
        nodes = self.link.nodes
        e = int(np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, len(nodes) - 2))
        return e, x - nodes[e]

    def _element_length(self, e: int) -> float:
        return float(self.link.nodes[e + 1] - self.link.nodes[e])

    def _foreshortening(self, x: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """1/2 int_0^x v'^2 and its rates."""
        total = [np.zeros(self.q.shape[1]) for _ in range(3)]
        last, local = self._locate(x)
        for e in range(last + 1):
            length = self._element_length(e)
            reach = length if e < last else local
            rows = slice(3 * e, 3 * e + 6)
            for point, weight in zip(*_GAUSS, strict=True):
                slope_row = shape_functions(0.5 * reach * (1 + point), length)[2]
                s, s_rate, s_accel = (slope_row @ series[rows] for series in (self.q, self.q_rate, self.q_accel))
                w = 0.5 * reach * weight
                total[0] += 0.5 * w * s**2
                total[1] += w * s * s_rate
                total[2] += w * (s_rate**2 + s * s_accel)
        return tuple(total)

    def section(self, x: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Axial force N [N, tension positive], shear force V [N] and bending moment M = E I v'' [N m] at x.

        At a node from the equilibrium of the elements beside it; between nodes interpolated with the exact share of
        the rigid body's own inertia load on the element.
        """
        e, local = self._locate(x)
        left, right = self._ends(e)
        if self.link.node_at(x) is not None and e > 0 and local < 0.5 * self._element_length(e):
            return tuple(0.5 * (before + after) for before, after in zip(self._ends(e - 1)[1], left, strict=True))
        length = self._element_length(e)
        s = local / length
        N, V, M = (a + (b - a) * s for a, b in zip(left, right, strict=True))
        rho_A, rigid, name = self.link.rho_A, self.rigid, self.link.name
        if self.model.options.dynamics == "frozen":
            return N, V, M
        bubble = local * (length - local)
        omega, epsilon = rigid[f"{name}.omega"], rigid[f"{name}.epsilon"]
        # Transverse inertia load p0 + p1 x of the rigid link on this element.
        p1 = -rho_A * epsilon
        p0 = -rho_A * rigid[f"{name}.link.a_y"] + p1 * self.link.nodes[e]
        N = N + 0.5 * rho_A * omega**2 * bubble
        V = V + 0.5 * p1 * bubble
        M = M - 0.5 * p0 * bubble - p1 / 6 * bubble * (length + local)
        return N, V, M

    def _ends(self, e: int) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
        """(N, V, M) inside the first and the second end of an element."""
        f = self.end_forces(e)
        return (-f[0], -f[1], -f[2]), (f[3], f[4], f[5])

    def end_forces(self, e: int) -> np.ndarray:
        """Forces and moments on an element at its nodes, link axes, shape (6, n_times).

        The residual f = M q'' + C q' + K q - F of the element's own equations, with the terms that the run kept;
        K_s q alone for the frozen model of the paper.
        """
        rows = slice(3 * e, 3 * e + 6)
        series = {"M": self.q_accel[rows], "C": self.q_rate[rows], "K": self.q[rows]}
        total = np.zeros((6, self.q.shape[1]))
        for key, monomial, blocks in self.link.element_terms:
            if not self._keeps(key, monomial):
                continue
            factor = self.rigid.monomial(monomial)
            if key == "F":
                total -= factor * blocks[e]
            else:
                total += factor * (blocks[e] @ series[key[0]])
        if self._keeps("C_s", ()) and self._rayleigh is not None:
            alpha, beta = self._rayleigh
            for key, monomial, blocks in self.link.element_terms:
                weight = {"M": alpha, "K_s": beta}.get(key, 0.0)
                if weight and not monomial:
                    total += weight * (blocks[e] @ series["C"])
        return total

    @cached_property
    def _rayleigh(self) -> tuple[float, float] | None:
        from kaneflex.building import rayleigh_coefficients

        damping = self.model.scene.damping
        if damping is None or damping.kind != "rayleigh":
            return None
        return rayleigh_coefficients(damping.rayleigh.ratio, *damping.rayleigh.at)

    def _keeps(self, key: str, monomial: Monomial) -> bool:
        options = self.model.options
        if options.dynamics == "frozen":  # matrices of another angle balance nothing: only the strains are meant
            return key == "K_s"
        if key == "K_d":
            return options.euler if spin_or_euler(monomial) == "euler" else options.spin
        dynamic = options.dynamics != "quasistatic"
        return {
            "M": dynamic, "C_s": options.damping, "C_d": options.gyroscopic, "K_g": options.geometric,
        }.get(key, True)  # fmt: skip


Rates = tuple[np.ndarray, np.ndarray, np.ndarray]


def follow(model: Model, rigid: RigidMotion, coordinates: Rates, L: Affine) -> Rates:
    """q = L z, q' = L z' + L' z, q'' = L z'' + 2 L' z' + L'' z; each (rows of L, n_times)."""
    z, v, a = coordinates
    q, q_rate, q_accel = rigid.apply(L, z), rigid.apply(L, v), rigid.apply(L, a)
    if model.options.convective:
        rate = L.rate()
        q_rate += rigid.apply(rate, z)
        q_accel += 2.0 * rigid.apply(rate, v) + rigid.apply(rate.rate(), z)
    return q, q_rate, q_accel


def deform(model: Model, rigid: RigidMotion, coordinates: Rates, name: str) -> Deformation:
    """The deformation of one link, reduced coordinates expanded."""
    series = follow(model, rigid, coordinates, model.frame.maps[name])
    if name not in model.bases:
        return Deformation(model, model.links[name], rigid, *series)
    expanded = (model.bases[name] @ part for part in series)
    return _with_static_share(Deformation(model, model.links[name], rigid, *expanded))


def _with_static_share(found: Deformation) -> Deformation:
    """What the modes that a reduction left out add statically: the mode-acceleration method (Craig 1981, ch. 15).

    Without them the link's inner equations keep a residual r, which no joint would carry; K_s^-1 r balances it.
    """
    from scipy.sparse.linalg import splu

    link, model = found.link, found.model
    unloaded = replace(link.part, matrices={"F": Affine.zero(link.part.size, 1)})
    residual = -found.rigid.column_of(load_on_link(model.scene, unloaded, link).matrices["F"])
    for e in range(len(link.nodes) - 1):
        residual[3 * e : 3 * e + 6] += found.end_forces(e)
    kept = set(model.parts[link.name].coordinates)
    inner = np.array([row for row, label in enumerate(link.part.coordinates) if label not in kept])
    stiffness = link.part.matrices["K_s"].at({})[inner][:, inner]
    q = found.q.copy()
    q[inner] -= splu(stiffness.tocsc()).solve(residual[inner])
    return replace(found, q=q)
