"""Numbers of bodies and their sections for the kernels of ``kaneflex.generated``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from kaneflex.fem.spatial_bodies import second_moments
from kaneflex.generated.shapes import KINDS, POINT
from kaneflex.mechanism.mechanism import NumericMechanism
from kaneflex.mechanism.spatial import SpatialMechanism
from kaneflex.multibody.model.shapes import ShapeMoments, Shapes, in_reading_order
from kaneflex.multibody.model.tree_layout import Deformable, Flexible, Names
from kaneflex.scene.modal_data import ModalData, planar_arrays, spatial_modal_data

Arrays = Mapping[str, Any]
_LIGHT = 1e-9
"""Ratio of principal moments of inertia below which the smaller one counts as none."""


@dataclass(frozen=True, eq=False)
class Blocks:
    """Numbers of a mechanism's bodies in the plane and their sections.

    Attributes
    ----------
    flexible : mapping
        Shapes of the deforming bodies: of links, or of modal data from a file.
    """

    d: ClassVar[int] = 3
    mechanism: NumericMechanism
    flexible: Flexible

    def body(self, name: str, shapes: Deformable | None = None) -> np.ndarray:
        """Numbers of a body."""
        if shapes is None:
            return body_numbers(self.mechanism, name)
        data = link_data(shapes) if isinstance(shapes, Shapes) else self.mechanism.deforming[name].modal
        assert data is not None  # or the body had no shapes
        moments = dict(data.arrays)
        for lumped in self.mechanism.masses.values():  # of rotary inertia alone
            if lumped.point.body == name:
                J, psi = lumped.inertia, data.arrays["psi"][data.points.index(lumped.point.name)]
                more = {"inertia": J, "inertia_psi": J * psi, "inertia_psi_psi": J * np.outer(psi, psi)}
                moments |= {key: moments[key] + each for key, each in more.items()}
        return shaped_numbers(moments)

    def is_light(self, numbers: np.ndarray | None) -> bool:
        """True if a body with these numbers has no mass, or no inertia about some axis."""
        if numbers is None or numbers[0] <= 0.0:
            return True
        mass, x, y, inertia = numbers[:4]
        return bool(inertia <= _LIGHT * (inertia + mass * (x * x + y * y)))

    def station(self, shapes: Deformable, rows: np.ndarray, G: np.ndarray) -> np.ndarray:
        """Numbers of a section by the rows u, v, theta of its body's shapes (3, count), and G (3, count, count)."""
        return point_numbers(shapes.counts[0], rows, G[0])

    def names(self, body: str, shapes: Deformable) -> tuple[Names, Names]:
        """Speeds and coordinates of the shapes of a body."""
        kinds = zip(("axial", "transverse"), shapes.counts, strict=True)
        names = [(f"{body}.{kind}_{k}", "m") for kind, count in kinds for k in range(count)]
        return names, names


@dataclass(frozen=True, eq=False)
class SpatialBlocks:
    """Numbers of the bodies in space and their sections, by the names of :class:`Blocks`."""

    d: ClassVar[int] = 6
    mechanism: SpatialMechanism
    flexible: Flexible

    def body(self, name: str, shapes: Deformable | None) -> np.ndarray | None:
        """Numbers of a body; None if it has neither mass nor inertia."""
        body = self.mechanism.bodies[name]
        if not (body.mass or np.any(body.inertia)):
            return None
        own = np.zeros(0) if shapes is None else shapes.numbers()
        return np.concatenate([[body.mass], body.centre, body.inertia, own])

    def is_light(self, numbers: np.ndarray | None) -> bool:
        return numbers is None or bool(numbers[0] <= 0.0 or min(numbers[4:7]) <= _LIGHT * max(numbers[4:7]))

    def station(self, shapes: Deformable, rows: np.ndarray, G: np.ndarray) -> np.ndarray:
        """Rows of the shapes, and the columns of G that are not zero."""
        i, j = np.nonzero(np.tril(G.any(axis=0)))
        return np.concatenate([np.ravel(rows), [len(i)], np.column_stack([i, j, G[:, i, j].T]).ravel()])

    def names(self, body: str, shapes: Deformable) -> tuple[Names, Names]:
        units = ["rad" if twists else "m" for twists in shapes.twisting]
        return ([(f"{body}.shapes.{k}", unit) for k, unit in enumerate(units)],
                [(f"{body}.shape_{k}", unit) for k, unit in enumerate(units)])  # fmt: skip


def shaped_numbers(moments: Arrays) -> np.ndarray:
    """Numbers of a planar body and its shapes from its moments ARRAYS: a section moves its fibres at y by -y psi."""
    mass, first = moments["mass"], moments["mass_X"]
    rigid = mass, first / mass, 0.0, moments["mass_X_X"] + moments["inertia"] - first * first / mass
    s, w = slice(len(moments["mass_s"])), slice(len(moments["mass_s"]), None)
    count, rotary = len(moments["stiffness"]), moments["inertia_psi_psi"]
    N, r_N, N_N, G, r_G = (np.zeros((*(3,) * axes, *(count,) * shapes))
                           for axes, shapes in ((1, 1), (2, 1), (2, 2), (1, 2), (2, 2)))  # fmt: skip
    N[0, s], N[1, w] = moments["mass_s"], moments["mass_w"]
    r_N[0, 0, s], r_N[0, 1, w], r_N[1, 0, w] = moments["mass_X_s"], moments["mass_X_w"], -moments["inertia_psi"]
    N_N[0, 0, s, s], N_N[1, 1, w, w], N_N[0, 0, w, w] = moments["mass_s_s"], moments["mass_w_w"], rotary
    N_N[0, 1, s, w], N_N[1, 0, w, s] = moments["mass_s_w"], moments["mass_s_w"].T
    G[0, w, w], r_G[0, 0, w, w], r_G[1, 1, w, w] = -moments["mass_H"], -moments["mass_X_H"], -rotary
    found = ShapeMoments(N, r_N, N_N, G, r_G)
    return np.array([*rigid, *found.numbers([s.stop], np.diag(moments["stiffness"]), moments["damping"])])


def point_numbers(axial: int, rows: np.ndarray, shortening: np.ndarray) -> np.ndarray:
    """Numbers of a point on a planar body's axis: rows u, v, theta of its shapes (3, count), and G_x (count, count)."""
    single, pair, count = dict(zip(("x", "y", "turn"), rows, strict=True)), {"x": shortening}, rows.shape[1]
    of_kind = dict(zip(KINDS, (np.arange(axial), np.arange(axial, count)), strict=True))
    sums = {kinds: [(single if len(kinds) == 1 else pair)[name] for name in names] for kinds, names in POINT.items()}
    return np.concatenate([[axial], *in_reading_order(of_kind, sums)])


def body_numbers(mechanism: NumericMechanism, name: str) -> np.ndarray:
    """Mass [kg], mass centre [m] and inertia about it [kg m^2] of a rigid body in the plane with its lumped masses."""
    body = mechanism.bodies[name]
    lumped = [mass for mass in mechanism.masses.values() if mass.point.body == name]
    parts = [(body.mass, body.inertia, body.centre), *((mass.mass, mass.inertia, mass.point.at) for mass in lumped)]
    mass, inertia, at = (np.array(each, float) for each in zip(*parts, strict=True))
    centre = mass @ at / (mass.sum() or 1.0)
    return np.array([mass.sum(), *centre, inertia.sum() + mass @ ((at - centre) ** 2).sum(axis=1)])


def link_data(shapes: Shapes) -> ModalData:
    """Modal data of a link's finite elements without lumped masses, in its axes, with the points on its axis."""
    link, m = shapes.link, shapes.moments
    places = {name: at for name, at in link.mechanism.points[link.name].items() if not any(at[1:])}
    r, N, G = (np.array(each) for each in (list(places.values()), *zip(*map(shapes.at, places.values()), strict=True)))
    found = {
        "mass_N": m.N, "mass_r_N": m.r_N, "mass_N_N": m.N_N, "stiffness": np.diag(shapes.stiffness),
        "damping": shapes.damping, "r": r, "N": N[:, :3], "psi": N[:, -3:],
    }  # fmt: skip
    if link.dofs == 6:
        body = link.mechanism.bodies[link.name]
        return spatial_modal_data(link.length, tuple(places), found | {
            "mass": np.array(body.mass), "mass_r": body.mass * body.centre,
            "mass_r_r": second_moments(body) + body.mass * np.outer(body.centre, body.centre),
            "mass_G": m.G, "mass_r_G": m.r_G, "cubic": shapes.cubic, "G": G,
        })  # fmt: skip
    w, total = slice(shapes.counts[0], None), link.body.profile.inertia(link.length)
    rotary = np.array(link.body.profile.rotary_inertia(link.length))
    found |= {"mass": np.array(total.mass), "mass_r": np.array([total.first]),
              "mass_r_r": np.diag([total.second, rotary])}  # fmt: skip
    energy = shapes.basis.T @ link.part.matrices["M"].value({}) @ shapes.basis
    shorter = {"mass_H": -m.G[0, w, w], "mass_X_H": -m.r_G[0, 0, w, w], "H": -G[:, 0, w, w]}
    return ModalData(link.length, tuple(places), planar_arrays(found, energy, w.start, shorter))
