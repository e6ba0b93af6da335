"""Solutions by scipy's methods, with progress and a limit, and the Jacobian that its implicit methods need."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from kaneflex.support.errors import UserError

IMPLICIT = ("Radau", "BDF", "LSODA")
"""Methods of scipy that use one."""
_NUDGE = float(np.sqrt(np.finfo(float).eps))
"""Share of a variable, or of its size, by which it is changed for a difference quotient."""

MOST_EVALUATIONS = 1_000_000
"""Evaluations of the rates in one solution: a minute or two of a second opinion."""

Rates = Callable[[float, np.ndarray], np.ndarray]
Progress = Callable[[float], None]


def solution(
    method: str, rates: Rates, span: tuple[float, float], first: np.ndarray, progress: Progress | None,
    before: list[int], **options: Any,
):  # fmt: skip
    """The solution over a span of time from ``first``, as scipy's ``OdeSolution``, and why it ended early, or nothing.

    progress: called with the share of the span after each step; before: one number, the evaluations so far, which goes
    on here; options: of the method.

    Raises
    ------
    UserError
        If it takes too many evaluations.
    """
    import scipy.integrate  # 0.7 s: only where it is used

    def counted(t: float, y: np.ndarray) -> np.ndarray:
        before[0] += 1
        if before[0] > MOST_EVALUATIONS:
            raise UserError(
                "solve.integrator", "scipy",
                f"{MOST_EVALUATIONS} evaluations bring it to t = {t:.4g} s of {span[1]:.4g} s: its steps follow the "
                "fastest vibrations",
                "Take radau or gauss, or shorten solve.duration",
            )  # fmt: skip
        return rates(t, y)

    if method in IMPLICIT:
        options["jac"] = jacobian_of(counted, options.pop("sizes", np.ones(len(first))))
    solver = getattr(scipy.integrate, method)(counted, span[0], first, span[1], **options)
    times, curves, message = [span[0]], [], None
    while solver.status == "running":
        message = solver.step()
        if solver.status == "failed":
            break
        times.append(solver.t)
        curves.append(solver.dense_output())
        if progress is not None:
            progress((solver.t - span[0]) / (span[1] - span[0]))
    return scipy.integrate.OdeSolution(times, curves) if curves else None, message


def jacobian_of(rates: Rates, sizes: np.ndarray) -> Callable[[float, np.ndarray], np.ndarray]:
    """The derivatives of ``rates`` at (t, y) by y, (n, n), from differences by shares of ``sizes`` (n,).

    scipy's own differences grow tenfold each time where the rates don't depend on a variable, as on an angle, a
    dependent coordinate or a work integral, until the rates are no numbers. A variable of size 0 counts as one of
    these.
    """

    def jacobian(t: float, y: np.ndarray) -> np.ndarray:
        here, found = rates(t, y), np.zeros((len(y), len(y)))
        for k in np.flatnonzero(sizes):
            for side in (1.0, -1.0):  # of a variable at the border of what is possible there is one
                moved = y.copy()
                moved[k] += side * _NUDGE * max(sizes[k], abs(y[k]))
                found[:, k] = (rates(t, moved) - here) / (moved[k] - y[k])
                if np.isfinite(found[:, k]).all():
                    break
        return found

    return jacobian
