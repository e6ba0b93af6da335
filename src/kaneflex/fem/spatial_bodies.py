"""Rigid body in space with small displacements, carried by elastic bodies.

Its coordinates are the displacement u, v, w [m] of its start and its rotation theta_x, theta_y, theta_z [rad], in its
axes as the rigid mechanism carries them: these move with the start's acceleration less gravity, a, with omega and
epsilon. A particle at p asks for what a slice of a beam does (``kaneflex.derive.elements.slice``); their sum knows the
body's mass, first moments m c and second moments P about its centre:

    M q'' + 2 sum_i omega_i G_i q' + Omega-terms q = F,   Omega = epsilon~ + omega~ omega~,  N = [1, -p~].

A force at an arm does work of the second order in the rotation, -1/2 theta^T (tr(T) 1 - sym T) theta with T = f p^T.
For the inertia of the body about its own centre that is what makes the tennis racket tumble; all that acts at arms from
the start, the inertia of the centre included, is its geometric stiffness. Moments count to the first order alone.
"""

from __future__ import annotations

from itertools import combinations_with_replacement

import numpy as np

from kaneflex.fem.element_terms import MATRIX_OF_GROUP
from kaneflex.fem.links import Part
from kaneflex.mechanism.affine import Affine
from kaneflex.mechanism.spatial import SpatialBody
from kaneflex.mechanism.spatial_frame import at_point, skew
from kaneflex.support.contract import AXES, SPATIAL_NODE

PAIRS = tuple(f"{i}{j}" for i, j in combinations_with_replacement(AXES, 2))
ARMS = tuple(f"arms_{pair}" for pair in PAIRS)
"""Additional scalars of a body's motion: the symmetric part of sum f p^T over forces f at p [N m]."""


def second_moments(body: SpatialBody) -> np.ndarray:
    """int s s^T dm about the centre of mass [kg m^2], (3, 3), of the inertia about it."""
    return 0.5 * np.trace(body.about_centre) * np.eye(3) - body.about_centre


def rigid_part(name: str, body: SpatialBody) -> Part:
    """M, C_d, K_d, K_g and F of a rigid body, with the scalars ``name.link.omega_x`` and so on, and :data:`ARMS`."""
    mass, c, P = body.mass, body.centre, second_moments(body)
    matrices = {key: Affine.zero(6, 1 if key == "F" else 6) for key in set(MATRIX_OF_GROUP.values())}
    matrices["M"] = Affine.constant(_moved(np.eye(3), mass, c, P))

    def scalar(*names: str) -> tuple[str, ...]:
        return tuple(f"{name}.link.{each}" for each in names)

    e = skew(np.eye(3))
    for k, axis in enumerate(AXES):
        matrices["C_d"] += Affine.term(scalar(f"omega_{axis}"), 2.0 * _moved(e[k], mass, c, P))
        load = -mass * np.concatenate([np.eye(3)[k], np.cross(c, np.eye(3)[k])])
        matrices["F"] += Affine.term(scalar(f"a_{axis}"), load[:, None])
        turning: dict[tuple[str, ...], np.ndarray] = {(f"epsilon_{axis}",): e[k]}
        for i, other in enumerate(AXES[k:], k):
            product = e[k] @ e[i] if i == k else e[k] @ e[i] + e[i] @ e[k]
            turning[f"omega_{axis}", f"omega_{other}"] = product
        for monomial, Omega in turning.items():
            own = np.zeros((6, 6))
            own[3:, 3:] = _arms_stiffness(-Omega @ P)
            matrices["K_d"] += Affine.term(scalar(*monomial), _moved(Omega, mass, c, P) + own)
            moment = Omega @ (P + mass * np.outer(c, c))
            about = np.array([moment[2, 1] - moment[1, 2], moment[0, 2] - moment[2, 0], moment[1, 0] - moment[0, 1]])
            load = -np.concatenate([mass * Omega @ c, about])
            matrices["F"] += Affine.term(scalar(*monomial), load[:, None])
    for pair in PAIRS:
        T, (i, j) = np.zeros((3, 3)), ("xyz".index(axis) for axis in pair)
        T[i, j] = T[j, i] = 1.0
        stiffness = np.zeros((6, 6))
        stiffness[3:, 3:] = _arms_stiffness(T)
        matrices["K_g"] += Affine.term(scalar(f"arms_{pair}"), stiffness)
    coordinates = tuple(f"{name}.{dof}" for dof in SPATIAL_NODE)
    return Part(name, coordinates, matrices, {0: tuple(range(6))})


def _moved(Omega: np.ndarray, mass: float, c: np.ndarray, P: np.ndarray) -> np.ndarray:
    """int N^T Omega N dm with N = [1, -p~], p = c + s, int s s^T dm = P."""
    at_centre = at_point(c)[:3]
    found = mass * at_centre.T @ Omega @ at_centre
    e = skew(np.eye(3))
    for i in range(3):
        for j in range(3):
            # p~^T Omega p~ = sum over s_i s_j of e_i~^T Omega e_j~
            found[3:, 3:] += P[i, j] * e[i].T @ Omega @ e[j]
    return found


def _arms_stiffness(T: np.ndarray) -> np.ndarray:
    """Before theta of forces f at p, T = sum f p^T."""
    return np.trace(T) * np.eye(3) - 0.5 * (T + T.T)
