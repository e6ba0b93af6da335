"""The coupled equations linearised about the steady deformation of one instant.

With the constraints' Jacobian G and its rates, small motions about q(t) satisfy G x'' + 2 G' x' + G'' x = 0. x = N y
with G N = 0 takes the modal coordinates, and of the bodies' own as many as joints are free, so that N' and N'' follow
from G' and G'':

    M_y = N^T M N,   C_y = N^T (C N + 2 M N'),   K_y = N^T (K N + C N' + M N'')

where C and K are derivatives of the whole balance M q'' - f - G^T lambda at the instant's accelerations and reactions:
geometric stiffening is in them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from kaneflex.integrate.outcome import Outcome
from kaneflex.multibody.run import CoupledTrajectory, rigid_state
from kaneflex.multibody.system import BODY, CoupledSystem

_DIFFERENCE = 1e-6
"""Step of central differences of sensors, in sizes of the mechanism and rad, and a second of rates."""


@dataclass(frozen=True, eq=False)
class Kernels:
    """All matrices of the coupled kernels at one state."""

    M: np.ndarray
    f: np.ndarray
    g: np.ndarray
    g_t: np.ndarray
    G: np.ndarray
    gamma: np.ndarray
    K: np.ndarray
    C: np.ndarray


def kernels(system: CoupledSystem, t: float, q, v, a, multipliers) -> Kernels:
    """The equations, the constraints and the tangent at a state with its accelerations and multipliers."""
    n, m, p = system.size, len(system.constraints), system.parameters
    found = Kernels(
        np.zeros((n, n)), np.zeros(n), np.zeros(m), np.zeros(m), np.zeros((m, n)), np.zeros(m), np.zeros((n + m, n)),
        np.zeros((n + m, n)),
    )  # fmt: skip
    system.module.equations(t, q, v, p, found.M, found.f)
    system.module.constraints(t, q, v, p, found.g, found.g_t, found.G, found.gamma)
    system.module.tangent(t, q, v, a, multipliers, p, found.K, found.C)
    return found


@dataclass(frozen=True, eq=False)
class Instant:
    """A state with its accelerations and multipliers."""

    t: float
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    multipliers: np.ndarray


def settled(system: CoupledSystem, rigid, q: np.ndarray, size: float) -> Instant | None:
    """The state that is deformed as the rigid motion asks for: the balance with its accelerations, by Newton's method.

    Joints that are free take the accelerations that the balance leaves them. None where 50 steps find no balance.
    """
    t, v = float(rigid.times[0]), rigid_state(system, rigid)[1]
    a, multipliers, q = np.zeros(system.size), np.zeros(len(system.constraints)), q.copy()
    for name, k in system.start.items():
        a[k : k + BODY] = [rigid[f"{name}.{key}"][0] for key in ("a_x", "a_y", "epsilon")]
    n, m = system.size, len(multipliers)
    for _ in range(50):
        at = kernels(system, t, q, v, a, multipliers)
        Z = _free_directions(system, at.G)
        square = np.block([
            [at.K[:n], -at.G.T, at.M @ Z],
            [at.G, np.zeros((m, m + Z.shape[1]))],
            [Z.T @ at.M, np.zeros((Z.shape[1], m + Z.shape[1]))],
        ])  # fmt: skip
        balance = at.M @ a - at.f - at.G.T @ multipliers
        step = np.linalg.solve(square, -np.concatenate([balance, at.g, np.zeros(Z.shape[1])]))
        q, multipliers, a = q + step[:n], multipliers + step[n : n + m], a + Z @ step[n + m :]
        if abs(step[:n]).max() < 1e-12 * size:
            at = kernels(system, t, q, v, a, multipliers)
            v = v - np.linalg.lstsq(at.G, at.G @ v + at.g_t, rcond=None)[0]
            return Instant(t, q, v, a, multipliers)
    return None


def _free_directions(system: CoupledSystem, G: np.ndarray) -> np.ndarray:
    """Motions of the undeformed bodies that the constraints allow, one a column (n, free joints)."""
    rigid = system.rigid_rows
    _, sizes, rows = np.linalg.svd(G[:, rigid])
    rank = int((sizes > 1e-9 * sizes.max(initial=1.0)).sum())
    Z = np.zeros((system.size, len(rigid) - rank))
    Z[rigid] = rows[rank:].T
    return Z


@dataclass(frozen=True, eq=False)
class Reduction:
    """Independent coordinates and x = N y with its rates."""

    rows: np.ndarray
    N: np.ndarray
    N_rate: np.ndarray
    N_accel: np.ndarray
    dependent: np.ndarray
    inverse: np.ndarray


def reduction(system: CoupledSystem, at: Kernels) -> Reduction:
    """The modal coordinates and, of the bodies' own, those that the constraints determine worst."""
    n, m = system.size, len(at.g)
    rigid = system.rigid_rows
    _, _, order = qr(at.G[:, rigid], pivoting=True)
    dependent = rigid[order[:m]]
    rows = np.setdiff1d(np.arange(n), dependent)
    inverse = np.linalg.inv(at.G[:, dependent])
    G_rate, G_accel = at.C[n:] / 2, at.K[n:]
    N, N_rate, N_accel = np.zeros((3, n, len(rows)))
    N[rows] = np.eye(len(rows))
    N[dependent] = -inverse @ at.G[:, rows]
    N_rate[dependent] = -inverse @ (G_rate @ N)
    N_accel[dependent] = -inverse @ (G_accel @ N + 2 * G_rate @ N_rate)
    return Reduction(rows, N, N_rate, N_accel, dependent, inverse)


@dataclass(frozen=True, eq=False)
class Linear:
    """M_y y'' + C_y y' + K_y y = sum of inputs, with what leads back to all coordinates."""

    instant: Instant
    basis: Reduction
    names: tuple[str, ...]
    M: np.ndarray
    C: np.ndarray
    K: np.ndarray


def linear(system: CoupledSystem, instant: Instant) -> Linear:
    """The linear equations about an instant, in independent coordinates."""
    n = system.size
    at = kernels(system, instant.t, instant.q, instant.v, instant.a, instant.multipliers)
    basis = reduction(system, at)
    N, C, K = basis.N, at.C[:n], at.K[:n]
    names = tuple(system.module.COORDINATES[row][0] for row in basis.rows)
    return Linear(
        instant, basis, names, N.T @ at.M @ N, N.T @ (C @ N + 2 * at.M @ basis.N_rate),
        N.T @ (K @ N + C @ basis.N_rate + at.M @ basis.N_accel),
    )  # fmt: skip


def probes(system: CoupledSystem, found: Linear, pushes: Mapping[str, np.ndarray], size: float):
    """States about the instant, and by how much of which variable they differ from it.

    Returns a trajectory of pairs (+, -) for every coordinate, every rate and every input, and the amounts. An input is
    a vector (n + m,): a generalised force, then what it adds to the constraints' accelerations.
    """
    n, m, count = system.size, len(system.constraints), len(found.names)
    base, basis = found.instant, found.basis
    measure = system.measure(size)[basis.rows]
    rate = max(1.0, abs(base.v / system.measure(size)).max())
    rows, amounts = [], []

    def add(q: np.ndarray, v: np.ndarray, push: np.ndarray) -> None:
        at = kernels(system, base.t, q, v, base.a, base.multipliers)
        square = np.block([[at.M, -at.G.T], [at.G, np.zeros((m, m))]])
        x = np.linalg.solve(square, np.concatenate([at.f, -at.gamma]) + push)
        rows.append((q, v, x[:n], x[n:]))

    still = np.zeros(n + m)
    for k in range(count):
        h = _DIFFERENCE * measure[k]
        for sign in (h, -h):
            q = closed(system, base.t, base.q + sign * basis.N[:, k], basis)
            add(q, base.v + sign * basis.N_rate[:, k], still)
        amounts.append(2 * h)
    for k in range(count):
        h = _DIFFERENCE * measure[k] * rate
        for sign in (h, -h):
            add(base.q, base.v + sign * basis.N[:, k], still)
        amounts.append(2 * h)
    for push in pushes.values():
        for sign in (1.0, -1.0):
            add(base.q, base.v, sign * push)
        amounts.append(2.0)
    q, v, a, multipliers = (np.array(part) for part in zip(*rows, strict=True))
    # Instants so close to each other that nothing depends on their difference: a free joint's course needs an order.
    times = base.t + 1e-9 * np.arange(len(q))
    none = np.zeros(len(q))
    energy, loss, power = energies(system, times, q, v, multipliers, none, none)
    trajectory = CoupledTrajectory(
        times, q, v, a, multipliers, energy, loss, power, 0, 0, (0.0, 0.0), Outcome.COMPLETED, "", 0.0
    )
    return trajectory, np.array(amounts)


def closed(system: CoupledSystem, t: float, q: np.ndarray, basis: Reduction) -> np.ndarray:
    """q with its dependent coordinates put onto the constraints."""
    q, m = q.copy(), len(system.constraints)
    for _ in range(3):
        g, g_t, G, gamma = np.zeros(m), np.zeros(m), np.zeros((m, system.size)), np.zeros(m)
        system.module.constraints(t, q, np.zeros(system.size), system.parameters, g, g_t, G, gamma)
        q[basis.dependent] -= np.linalg.solve(G[:, basis.dependent], g)
    return q
