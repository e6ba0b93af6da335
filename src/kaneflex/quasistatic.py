"""K(t) z = F(t) at each instant: the answer of a mechanism whose modes are all fast, paper (107), (117)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from kaneflex.model import Model

_RIGID = 1e-9  # squared frequency of a mechanism mode, relative to the highest one
_CHUNK = 4_000_000  # numbers in one batch of dense matrices: 32 MB


def quasistatic(
    model: Model, times: np.ndarray, periodic: bool, progress: Callable[[float], None] | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Solve K z = F without inertia and without damping.

    Mechanism modes R (K R = 0) are left to inertia relief: K z = F - M R (R^T M R)^-1 R^T F with R^T M z = 0.

    Parameters
    ----------
    times : ndarray (n_times,)
        Equidistant instants [s]; with ``periodic`` the last one repeats the first.

    Returns
    -------
    z, v, a : ndarray (n_times, n)
        Displacements, and their first and second time derivatives by central differences of fourth order.
    """
    z = np.zeros((len(times), model.reduced.size))
    size = model.reduced.size
    batch = max(1, _CHUNK // max(size * size, 1))
    relief = _has_mechanism_modes(model, times[0])
    for first in range(0, len(times), batch):
        rows = slice(first, first + batch)
        rigid = model.motion.at(times[rows])
        load = rigid.column_of(model.kept["F"]).T
        if size > 64 and not relief:
            z[rows] = _solve_banded(model, times[rows], load)
        else:
            stiffness, mass = (_dense(model, name, rigid) for name in ("K", "M"))
            z[rows] = (
                _relieved(stiffness, mass, load) if relief else np.linalg.solve(stiffness, load[..., None])[..., 0]
            )
        if progress is not None:
            progress(min(1.0, (first + batch) / len(times)))
    step = times[1] - times[0]
    v = _derivative(z, step, periodic)
    return z, v, _derivative(v, step, periodic)


def _dense(model: Model, name: str, rigid) -> np.ndarray:
    """Matrices at all times, shape (n_times, n, n)."""
    size = model.reduced.size
    total = np.zeros((len(rigid.times), size, size))
    for monomial, matrix in model.kept[name].terms.items():
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
    if model.reduced.size > 400:
        return False
    rigid = model.motion.at(t)
    values = np.linalg.eigvals(np.linalg.solve(_dense(model, "M", rigid)[0], _elastic(model, rigid)))
    return bool(abs(values).min() < _RIGID * abs(values).max())


def _elastic(model: Model, rigid) -> np.ndarray:
    total = np.zeros((model.reduced.size,) * 2)
    for monomial, matrix in model.reduced.K_s.terms.items():
        total += rigid.monomial(monomial)[0] * matrix.toarray()
    return total


def _relieved(stiffness: np.ndarray, mass: np.ndarray, load: np.ndarray) -> np.ndarray:
    from scipy.linalg import eigh

    answer = np.zeros_like(load)
    for k in range(len(load)):
        squares, shapes = eigh(0.5 * (stiffness[k] + stiffness[k].T), mass[k])
        elastic = abs(squares) > _RIGID * abs(squares).max()
        # In mass-normalised modes inertia relief is leaving the mechanism modes out.
        amplitude = (shapes[:, elastic].T @ load[k]) / squares[elastic]
        answer[k] = shapes[:, elastic] @ amplitude
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
