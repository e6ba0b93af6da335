"""Quasi-static solution K(t) z = F(t) at each instant, for mechanisms with fast modes, paper (107), (117); and the
initial state that follows from it, ``start = "quasistatic"``, for every preset.

Quasi-static displacements z(t) balance the loads and the inertia of the rigid motion at each instant. A run starts
with their rates z', and with displacements that make the initial accelerations equal to z'': no vibration is excited.
Otherwise the initial residual of loads and stiffness would excite vibrations.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.mechanism.affine import as_array, entries
from kaneflex.multibody.model.bound_model import Model
from kaneflex.response.deformation import relieved
from kaneflex.support.errors import SceneError

if TYPE_CHECKING:
    from kaneflex.multibody.model.state import State
    from kaneflex.multibody.time.linearisation import Equations

_DEPENDENT = 1e-9  # singular value below which unit conditions count as dependent
_RIGID = 64 * np.finfo(float).eps  # share of the largest stiffness that counts as rounding
LARGEST_DENSE = 64
"""Coordinates up to which all instants are solved as one stack of dense matrices; beyond, one banded solve each."""
_CHUNK = 4_000_000  # numbers in one batch of dense matrices: 32 MB
_POINTS, _HALVINGS = 7, 25
"""Instants of an interval for the initial rates, and number of intervals, down to about 1e-7 of the run."""
_SCATTER = 4.0
"""Ratio of changes that differ by rounding only; intervals of twice the length change them about 40 times as much."""
_CHORDS, _ROUNDING = 40, 1e-9
"""Largest number of chord steps to equilibrium, and step length, relative to the coordinate's scale,
below which stagnation counts as rounding: second rates need all digits."""

Answers = Callable[[np.ndarray], np.ndarray]
"""Instants [s] -> z (n_times, n) in quasi-static equilibrium; NaN if none is found."""


def quasistatic(
    model: Model, times: np.ndarray, periodic: bool, progress: Callable[[float], None] | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Solve K z = F without inertia and without damping.

    Rigid-body modes R (K_s R = 0) are handled by inertia relief: K z = F - M r with their accelerations r = R (R^T M
    R)^-1 R^T F, and R^T M z = 0.

    Parameters
    ----------
    times : ndarray (n_times,)
        Equidistant instants [s]; with ``periodic`` the last one repeats the first.

    Returns
    -------
    z, v, a : ndarray (n_times, n)
        Displacements, and their first and second time derivatives by central differences of fourth order, with r.
    """
    rigid = model.motion.at(times)
    z = solutions(model, times, rigid.column_of(model.kept["F"]).T, progress)
    step = times[1] - times[0]
    v = rate_of(z, step, periodic)
    return z, v, rate_of(v, step, periodic) + relieved(model, rigid, z.T).T


def solutions(
    model: Model, times: np.ndarray, load: np.ndarray, progress: Callable[[float], None] | None = None
) -> np.ndarray:
    """Solution z of K z = load at each instant [s], both (n_times, n); with inertia relief as in :func:`quasistatic`.

    Raises SceneError if K is singular.
    """
    z = np.zeros_like(load)
    size = model.reduced.size
    batch = max(1, _CHUNK // max(size * size, 1))
    relief = mechanism_modes(model, times[0])
    for first in range(0, len(times), batch):
        rows = slice(first, first + batch)
        try:
            z[rows] = _solutions_at(model, times[rows], load[rows], relief)
        except np.linalg.LinAlgError:
            reason = "the stiffness matrix is numerically singular: the links' stiffnesses differ too much"
            cure = "Give the links sections of similar sizes, or make the stiff one rigid"
            raise SceneError("solve.preset", model.options.preset, reason, cure) from None
        if progress is not None:
            progress(min(1.0, (first + batch) / len(times)))
    return z


def _solutions_at(model: Model, times: np.ndarray, load: np.ndarray, relief: int) -> np.ndarray:
    if model.reduced.size > LARGEST_DENSE and not relief:
        return solve_banded_at(model, times, load)
    rigid = model.motion.at(times)
    stiffness = rigid.matrices(model.kept["K"])
    if not relief:
        return np.linalg.solve(stiffness, load[:, :, None])[..., 0]
    elastic, mass = rigid.matrices(model.reduced.K_s), rigid.matrices(model.kept["M"])
    return _relieved(elastic, stiffness, mass, load, relief)


def solve_banded_at(model: Model, times: np.ndarray, load: np.ndarray) -> np.ndarray:
    """Banded solves, one per instant: the cost grows linearly with the number of elements."""
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
        # LAPACK's layout: entry (i, j) at row w + i - j, column j
        band[(w + rows - columns)[inside], columns[inside]] = values[inside]
        answer[k] = solve_banded((w, w), band, load[k])
    return answer


def mechanism_modes(model: Model, t: float) -> int:
    """Number of rigid-body modes at an instant: motions that K_s does not oppose.

    In them every link moves rigidly, by (u, v, theta) of its start, consistent with L z at joints and springs, and
    springs keep their length or angle. The rank of these conditions depends on geometry only, not on stiffnesses and
    their rounding.
    """
    rigid, links = model.motion.at(t), model.links
    length = max(link.length for link in links.values())
    held = set(model.interfaces.displaced)
    for spring in model.scene.springs.values():
        ends = (end for end in spring.ends if end.body in links)
        held |= {(end.body, links[end.body].node_at(model.scene.point(end)[0])) for end in ends}
    rows, shapes = [], []
    n = next(iter(links.values())).dofs
    for k, (name, part) in enumerate(model.parts.items()):
        moved = rigid.first(model.frame.maps[name])
        for node in (node for node in part.place if (name, node) in held):
            carried = links[name].rigid_motion(links[name].nodes[node] / length)
            for of_node, row in enumerate(part.place[node]):
                if row is not None:
                    rows.append(moved[[row]] * (1.0 if of_node < n // 2 + n % 2 else length))
                    shapes.append(np.pad(-carried[of_node], (n * k, n * (len(links) - k - 1))))
    stiff = [rigid.first(L)[[row]] for part, L, _ in model.sprung.values() if L.terms
             for row in np.flatnonzero(part.matrices["K_s"].value({}).diagonal())]  # fmt: skip
    rows, shapes = rows + stiff, shapes + [np.zeros(n * len(links))] * len(stiff)
    bodies = map(rigid.first, model.frame.bodies.values())
    if not rows:  # unconnected free links
        return n * len(links)
    columns = np.unique(np.concatenate([part.nonzero()[1] for part in (*rows, *bodies)]))
    conditions = np.hstack([np.vstack([as_array(row) for row in rows])[:, columns], np.array(shapes)])
    sizes = np.linalg.norm(conditions, axis=0)
    conditions /= np.where(sizes > 0.0, sizes, 1.0)
    return conditions.shape[1] - int(np.linalg.matrix_rank(conditions, tol=_DEPENDENT))


def lost_digits(model: Model, t: float) -> float:
    """Relative rounding error of K z = F: machine epsilon over the least pivot of the scaled K_s.

    The last pivots of a Cholesky factorisation are the stiffness that restrains the mechanism as a whole.
    """
    from scipy.linalg import LinAlgError, cholesky_banded

    stiffness = model.motion.at(t).first(model.reduced.K_s)
    size, diagonal = stiffness.shape[0], stiffness.diagonal()
    rows, columns, values = entries(stiffness)
    if not diagonal.min() > 0.0:
        return 1.0
    scaled = values / np.sqrt(diagonal[rows] * diagonal[columns])
    upper = columns >= rows
    width = int((columns - rows).max(initial=0))
    band = np.zeros((width + 1, size))
    band[width + rows[upper] - columns[upper], columns[upper]] = scaled[upper]
    try:
        pivots = cholesky_banded(band)[-1] ** 2
    except LinAlgError:
        return 1.0
    return float(np.finfo(float).eps / pivots.min())


def _relieved(
    elastic: np.ndarray, stiffness: np.ndarray, mass: np.ndarray, load: np.ndarray, modes: int
) -> np.ndarray:
    """Solution of K z = F in the M-orthogonal complement of the rigid-body modes R of K_s, by an orthonormal basis."""
    from scipy.linalg import eigh

    answer = np.zeros_like(load)
    for k in range(len(load)):
        diagonal = elastic[k].diagonal()
        scale = 1 / np.sqrt(np.where(diagonal > _RIGID * diagonal.max(), diagonal, diagonal.max()))
        shapes = eigh(scale[:, None] * elastic[k] * scale)[1]
        R = scale[:, None] * shapes[:, :modes]
        basis = np.linalg.qr(mass[k] @ R, mode="complete")[0][:, R.shape[1] :]
        answer[k] = basis @ np.linalg.solve(basis.T @ stiffness[k] @ basis, basis.T @ load[k])
    return answer


def rate_of(values: np.ndarray, step: float, periodic: bool) -> np.ndarray:
    """Central differences of fourth order; at the ends of a motion without period one-sided ones of second order."""
    if not periodic:
        inner = np.gradient(values, step, axis=0, edge_order=min(2, len(values) - 1))
        if len(values) > 4:
            inner[2:-2] = (values[:-4] - 8 * values[1:-3] + 8 * values[3:-1] - values[4:]) / (12 * step)
        return inner
    body = np.pad(values[:-1], ((2, 3), (0, 0)), mode="wrap")
    return (body[:-4] - 8 * body[1:-3] + 8 * body[3:-1] - body[4:]) / (12 * step)


# ---- initial state ------------------------------------------------------------------------------------------------


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
        z[moving] = solutions(model, times[moving], model.motion.at(times[moving]).column_of(model.kept["F"]).T)
        return z

    v, a = first_rates(balanced, inertia, model.options.duration)
    return solutions(model, first, (load - inertia @ a - damping @ v)[None])[0], v


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
