"""K(t) z = F(t) at each instant: the answer of a mechanism whose modes are all fast, paper (107), (117)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse import csr_array

from kaneflex.affine import Affine
from kaneflex.model import Model, RigidMotion
from kaneflex.modes import lowest_modes

_RIGID = 1e-13  # squared frequency of a mechanism mode over the highest one; 1e-12 is met with 500 elements
_CHUNK = 4_000_000  # numbers in one batch of dense matrices: 32 MB


def quasistatic(
    model: Model, times: np.ndarray, periodic: bool, progress: Callable[[float], None] | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Solve K z = F without inertia and without damping.

    Mechanism modes R (K_s R = 0) are left to inertia relief: K z = F - M R (R^T M R)^-1 R^T F with R^T M z = 0.

    Parameters
    ----------
    times : ndarray (n_times,)
        Equidistant instants [s]; with ``periodic`` the last one repeats the first.

    Returns
    -------
    z, v, a : ndarray (n_times, n)
        Displacements, and their first and second time derivatives by central differences of fourth order.
    """
    load = model.motion.at(times).column_of(model.kept["F"]).T
    z = answers(model, times, load, progress)
    step = times[1] - times[0]
    v = _derivative(z, step, periodic)
    return z, v, _derivative(v, step, periodic)


def answers(
    model: Model, times: np.ndarray, load: np.ndarray, progress: Callable[[float], None] | None = None
) -> np.ndarray:
    """z of K z = load at each instant [s], both of shape (n_times, n); with inertia relief as :func:`quasistatic`."""
    z = np.zeros_like(load)
    size = model.reduced.size
    batch = max(1, _CHUNK // max(size * size, 1))
    relief = _has_mechanism_modes(model, times[0])
    for first in range(0, len(times), batch):
        rows = slice(first, first + batch)
        if size > 64 and not relief:
            z[rows] = _solve_banded(model, times[rows], load[rows])
        else:
            rigid = model.motion.at(times[rows])
            stiffness = _dense(model.kept["K"], rigid)
            if relief:
                elastic, mass = _dense(model.reduced.K_s, rigid), _dense(model.kept["M"], rigid)
                z[rows] = _relieved(elastic, stiffness, mass, load[rows])
            else:
                z[rows] = np.linalg.solve(stiffness, load[rows, :, None])[..., 0]
        if progress is not None:
            progress(min(1.0, (first + batch) / len(times)))
    return z


def _dense(affine: Affine, rigid: RigidMotion) -> np.ndarray:
    """Matrices at all times, shape (n_times, n, n)."""
    total = np.zeros((len(rigid.times), *affine.shape))
    for monomial, matrix in affine.terms.items():
        total += rigid.monomial(monomial)[:, None, None] * matrix.toarray()
    return total


def _solve_banded(model: Model, times: np.ndarray, load: np.ndarray) -> np.ndarray:
    """One banded solve an instant: the cost grows with the number of elements, not with its cube."""
    from scipy.linalg import solve_banded

    system = model.system
    w, n = system.half_bandwidth, system.n
    scalars = model.scalars(times)
    answer = np.zeros_like(load)
    rows = np.arange(n)[:, None]
    columns = rows + np.arange(-w, w + 1)[None, :]
    inside = (columns >= 0) & (columns < n)
    for k in range(len(times)):
        values = (system.K @ scalars[k]).reshape(n, 2 * w + 1)
        band = np.zeros((2 * w + 1, n))
        # LAPACK's layout: entry (i, j) at row w + i - j, column j.
        band[(w + rows - columns)[inside], columns[inside]] = values[inside]
        answer[k] = solve_banded((w, w), band, load[k])
    return answer


def _has_mechanism_modes(model: Model, t: float) -> bool:
    """Whether K_s alone leaves the mechanism a motion."""
    rigid = model.motion.at(t)
    stiffness, mass = (
        affine.at({name: rigid[name][0] for names in affine.terms for name in names})
        for affine in (model.reduced.K_s, model.reduced.M)
    )
    # K_s + shift M is never singular, and raises every squared frequency by the shift.
    shift = 10 * _RIGID * float((stiffness.diagonal() / mass.diagonal()).max())
    omega, _ = lowest_modes(csr_array(stiffness + shift * mass), mass, 1)
    return bool(omega[0] ** 2 < 1.1 * shift)


def _relieved(elastic: np.ndarray, stiffness: np.ndarray, mass: np.ndarray, load: np.ndarray) -> np.ndarray:
    """K z = F in the space that is M-orthogonal to the mechanism modes: the other modes of K_s span it."""
    from scipy.linalg import eigh

    answer = np.zeros_like(load)
    for k in range(len(load)):
        squares, shapes = eigh(elastic[k], mass[k])
        basis = shapes[:, squares > _RIGID * squares[-1]]
        answer[k] = basis @ np.linalg.solve(basis.T @ stiffness[k] @ basis, basis.T @ load[k])
    return answer


def _derivative(values: np.ndarray, step: float, periodic: bool) -> np.ndarray:
    """Central differences of fourth order; second order, one-sided, at the ends of a motion without period."""
    if not periodic:
        inner = np.gradient(values, step, axis=0, edge_order=2)
        if len(values) > 4:
            inner[2:-2] = (values[:-4] - 8 * values[1:-3] + 8 * values[3:-1] - values[4:]) / (12 * step)
        return inner
    body = values[:-1]
    rate = (np.roll(body, 2, 0) - 8 * np.roll(body, 1, 0) + 8 * np.roll(body, -1, 0) - np.roll(body, -2, 0)) / (
        12 * step
    )
    return np.concatenate([rate, rate[:1]])
