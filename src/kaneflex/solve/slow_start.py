"""Quasi-static initial state, ``start = "quasistatic"``, for every preset.

Quasi-static displacements z(t) balance the loads and the inertia of the rigid motion at each instant. The run starts
with their rates z', and with displacements that make the initial accelerations equal to z'': no vibration is excited.
Otherwise the initial residual of loads and stiffness would excite vibrations.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.state import State
from kaneflex.multibody.time.linearisation import Equations
from kaneflex.solve.quasistatic import answers
from kaneflex.support.errors import SceneError

_POINTS, _HALVINGS = 7, 25
"""Instants of an interval for the initial rates, and number of intervals, down to about 1e-7 of the run."""
_SCATTER = 4.0
"""Ratio of changes that differ by rounding only; intervals of twice the length change them about 40 times as much."""
_CHORDS, _ROUNDING = 40, 1e-9
"""Largest number of chord steps to equilibrium, and step length, relative to the coordinate's scale,
below which stagnation counts as rounding: second rates need all digits."""

Answers = Callable[[np.ndarray], np.ndarray]
"""Instants [s] -> z (n_times, n) in quasi-static equilibrium; NaN if none is found."""


def slow_start(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Quasi-static initial z, v of one-way equations, (n,).

    The quasi-static rates, and the solution with inertia and damping among the loads: K z = F - M z'' - C z'.
    """
    first = np.zeros(1)
    row = model.scalars(first)[0]
    inertia, damping, load = (model.system.dense(name, row) for name in "MCF")

    def balanced(times: np.ndarray) -> np.ndarray:
        z = np.full((len(times), len(load)), np.nan)
        moving = np.isfinite(model.scalars(times)).all(axis=1)  # unused indeterminate reactions are nan
        z[moving] = answers(model, times[moving], model.motion.at(times[moving]).column_of(model.kept["F"]).T)
        return z

    v, a = first_rates(balanced, inertia, model.options.duration)
    return answers(model, first, (load - inertia @ a - damping @ v)[None])[0], v


def first_rates(balanced: Answers, inertia: np.ndarray, duration: float) -> tuple[np.ndarray, np.ndarray]:
    """Initial z', z'' (n,) of quasi-static displacements, from instants of the run only, where its laws are defined.

    Derivatives of the polynomial through Chebyshev points of an interval at the start. Short intervals amplify
    rounding, long ones exceed the polynomial's reach: of intervals from the whole run down, each half the previous one,
    the longest is chosen where halving changes the accelerations least, in the energy norm, up to the scatter of
    rounding. So neighbours of a scene take the same one.
    """
    order = np.arange(_POINTS)
    points = -np.cos(np.pi * order / order[-1])
    # derivatives of T_n at -1: (-1)^(n + 1) n^2 and (-1)^n (n^4 - n^2) / 3
    slopes = -((-1.0) ** order) * np.array([order**2, (order**2 - order**4) / 3.0])
    weights = slopes @ np.linalg.inv(np.polynomial.chebyshev.chebvander(points, order[-1]))
    spans = duration * 0.5 ** np.arange(_HALVINGS)
    times, places = np.unique(0.5 * spans[:, None] * (1.0 + points), return_inverse=True)
    z = balanced(times)[places.reshape(len(spans), -1)]
    known = np.isfinite(z).all(axis=(1, 2))
    spans, z = spans[known], z[known]
    v, a = np.einsum("dp,spn->dsn", weights, z)
    v, a = 2.0 / spans[:, None] * v, (2.0 / spans[:, None]) ** 2 * a
    changes = np.diff(a, axis=0)
    squares = np.einsum("sn,nm,sm->s", changes, inertia, changes)
    taken = int((squares <= _SCATTER**2 * squares.min()).argmax())
    return v[taken], a[taken]


def slow_state(equations: Equations, base: State, duration: float) -> State:
    """Quasi-static initial state of coupled equations from an instant of undeformed bodies; free joints keep their
    speeds and accelerations.

    Raises SceneError if no equilibrium is found.
    """
    try:
        still = equations.equilibrium(base)
        if still is not None:
            shapes = equations.shapes
            path, inertia = _followed(equations, still), equations.mass(still)[np.ix_(shapes, shapes)]
            still = equations.equilibrium(base, first_rates(lambda t: path(t)[:, shapes], inertia, duration))
    except (ArithmeticError, np.linalg.LinAlgError):
        still = None
    if still is None:
        raise SceneError(
            "solve.start", "quasistatic", "no static equilibrium is found at the start, even in load steps",
            "Start from zero, with damping, or give fewer solve.modes",
        )  # fmt: skip
    return still


def _followed(equations: Equations, still: State) -> Answers:
    """Equilibria, as deviations (n_times, n) from the first one, as far as steps with its tangent converge."""
    residual, slope, measure = equations.followed(still)

    def balanced(times: np.ndarray) -> np.ndarray:
        out, start = np.full((len(times), len(slope)), np.nan), np.zeros(len(slope))
        for first in range(0, len(times), _POINTS):
            rows = slice(first, first + _POINTS)
            found = _chords(residual, times[rows], start, slope, measure)
            if found is None:
                break
            out[rows], start = found, found[-1]
        return out

    return balanced


def _chords(
    residual: Callable[[np.ndarray, np.ndarray], np.ndarray], times: np.ndarray, near: np.ndarray, slope: np.ndarray,
    measure: np.ndarray,
) -> np.ndarray | None:  # fmt: skip
    """Equilibria z (n_times, n) by Newton's method with one tangent for all instants; None if not converged."""
    z, last = np.tile(near, (len(times), 1)), np.inf
    for _ in range(_CHORDS):
        try:
            step = -np.linalg.solve(slope, residual(times, z).T).T
        except (ArithmeticError, np.linalg.LinAlgError):
            return None
        z, size = z + step, (abs(step) / measure).max(initial=0.0)
        if last < _ROUNDING and size >= 0.5 * last:
            return z
        if not size < 2.0 * last:
            return None
        last = size
    return None
