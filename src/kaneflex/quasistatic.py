"""K(t) z = F(t) at each instant: the answer of a mechanism whose modes are all fast, paper (107), (117)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse import coo_array

from kaneflex.affine import Affine, as_array
from kaneflex.model import Model, RigidMotion

_RIGID = 64 * np.finfo(float).eps  # a coordinate: share of its stiffness that eliminating the others leaves by rounding
LARGEST_DENSE = 64
"""Coordinates up to which all instants are solved as one stack of dense matrices; beyond, by bands, one by one."""
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
    v = rate_of(z, step, periodic)
    return z, v, rate_of(v, step, periodic)


def slow_start(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """z, v at the first instant, shapes (n,), of a motion as slow as the rigid one: nothing vibrates.

    The quasi-static answer with its rates, and its inertia and damping among the loads: K z = F - M z'' - C z'. Without
    them the first accelerations, what is left of loads and stiffness, would be those of a small deformation let go.
    """
    times = model.step * np.arange(-4, 5)
    _, v, a = quasistatic(model, times, periodic=False)
    row = model.scalars(times[4:5])[0]
    inertia, damping, load = (model.system.dense(name, row) for name in "MCF")
    return answers(model, times[4:5], (load - inertia @ a[4] - damping @ v[4])[None])[0], v[4]


def answers(
    model: Model, times: np.ndarray, load: np.ndarray, progress: Callable[[float], None] | None = None
) -> np.ndarray:
    """z of K z = load at each instant [s], both of shape (n_times, n); with inertia relief as :func:`quasistatic`."""
    z = np.zeros_like(load)
    size = model.reduced.size
    batch = max(1, _CHUNK // max(size * size, 1))
    relief = has_mechanism_modes(model, times[0])
    for first in range(0, len(times), batch):
        rows = slice(first, first + batch)
        if size > LARGEST_DENSE and not relief:
            z[rows] = solve_banded_at(model, times[rows], load[rows])
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
        total += rigid.monomial(monomial)[:, None, None] * as_array(matrix)
    return total


def solve_banded_at(model: Model, times: np.ndarray, load: np.ndarray) -> np.ndarray:
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


def has_mechanism_modes(model: Model, t: float) -> bool:
    """Whether K_s alone leaves the mechanism a motion.

    Then eliminating one coordinate after the other (Cholesky) leaves nothing of the last one's stiffness but rounding.
    Frequencies don't tell: a fine mesh or a slender link has lowest ones that look like nothing beside its highest.
    """
    from scipy.linalg import LinAlgError, cholesky_banded

    rigid = model.motion.at(t)
    names = {name for monomial in model.reduced.K_s.terms for name in monomial}
    stiffness = coo_array(model.reduced.K_s.at({name: rigid[name][0] for name in names}))
    size, diagonal = stiffness.shape[0], stiffness.diagonal()
    if not diagonal.min() > 0.0:
        return True
    scaled = stiffness.data / np.sqrt(diagonal[stiffness.row] * diagonal[stiffness.col])
    upper = stiffness.col >= stiffness.row
    width = int((stiffness.col - stiffness.row).max(initial=0))
    band = np.zeros((width + 1, size))
    band[width + stiffness.row[upper] - stiffness.col[upper], stiffness.col[upper]] = scaled[upper]
    try:
        pivots = cholesky_banded(band)[-1] ** 2
    except LinAlgError:
        return True
    return bool(pivots.min() < _RIGID * size)


def _relieved(elastic: np.ndarray, stiffness: np.ndarray, mass: np.ndarray, load: np.ndarray) -> np.ndarray:
    """K z = F in the space that is M-orthogonal to the mechanism modes R of K_s: an orthonormal basis spans it."""
    from scipy.linalg import eigh

    answer = np.zeros_like(load)
    for k in range(len(load)):
        diagonal = elastic[k].diagonal()
        scale = 1 / np.sqrt(np.where(diagonal > _RIGID * diagonal.max(), diagonal, diagonal.max()))
        shares, shapes = eigh(scale[:, None] * elastic[k] * scale)
        R = scale[:, None] * shapes[:, shares < _RIGID * len(scale)]
        basis = np.linalg.qr(mass[k] @ R, mode="complete")[0][:, R.shape[1] :]
        answer[k] = basis @ np.linalg.solve(basis.T @ stiffness[k] @ basis, basis.T @ load[k])
    return answer


def rate_of(values: np.ndarray, step: float, periodic: bool) -> np.ndarray:
    """Central differences of fourth order; second order, one-sided, at the ends of a motion without period."""
    if not periodic:
        inner = np.gradient(values, step, axis=0, edge_order=min(2, len(values) - 1))
        if len(values) > 4:
            inner[2:-2] = (values[:-4] - 8 * values[1:-3] + 8 * values[3:-1] - values[4:]) / (12 * step)
        return inner
    body = values[:-1]
    rate = (np.roll(body, 2, 0) - 8 * np.roll(body, 1, 0) + 8 * np.roll(body, -1, 0) - np.roll(body, -2, 0)) / (
        12 * step
    )
    return np.concatenate([rate, rate[:1]])
