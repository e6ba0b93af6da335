"""Methods of integration, as data."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.support.errors import UserError, nearest

if TYPE_CHECKING:
    from kaneflex.integrate.system import AffineSystem


@dataclass(frozen=True)
class Method:
    """Method of integration.

    order: of convergence in the step; None if the method chooses its steps itself
    description: one line with the source
    nodes: positions at which a step reads the table, in steps from its start, besides its end
    state_vectors: vectors that go from step to step: 2 for z and v, 3 with the method's own accelerations
    stepper: name of its compiled loop in `kaneflex.integrate.steppers`, or None
    coefficients: of (system, first row of the table, step, rho_infinity), what that loop takes
    still: of those coefficients, the ones of a step of no length: z and v stay, the true accelerations are found
    varying: whether M, C and K may vary in time
    stages: of the loop `collocation`; 0 where there are none
    """

    name: str
    order: int | None
    description: str
    nodes: tuple[float, ...]
    state_vectors: int
    stepper: str | None
    coefficients: Callable[[AffineSystem, np.ndarray, float, float], object] | None
    still: Callable[[np.ndarray], np.ndarray] | None
    varying: bool = False
    stages: int = 0


def newmark_weights(step: float, alpha_m: float, alpha_f: float, beta: float, gamma: float) -> tuple[float, ...]:
    """Weights of the loop `newmark`: see there."""
    kappa, squared = (1.0 - alpha_f) / (1.0 - alpha_m), step * step
    known = (step, alpha_f / (1.0 - alpha_m), -alpha_m / (1.0 - alpha_m), kappa)
    weights = (gamma * step * kappa, beta * squared * kappa)
    return (*known, *weights, (1.0 - gamma) * step, gamma * step, (0.5 - beta) * squared, beta * squared)


def _generalised_alpha(system: AffineSystem, row: np.ndarray, step: float, rho_infinity: float) -> tuple[float, ...]:
    # Chung and Hulbert 1993, eqs. (17), (18), (25)
    if not 0.0 <= rho_infinity <= 1.0:
        raise UserError(
            "rho_infinity", rho_infinity, "the spectral radius at infinite frequency must be between 0 and 1",
            "Give 1 for no damping of the highest frequencies, 0 for full damping in one step",
        )  # fmt: skip
    alpha_m = (2.0 * rho_infinity - 1.0) / (rho_infinity + 1.0)
    alpha_f = rho_infinity / (rho_infinity + 1.0)
    surplus = 1.0 - alpha_m + alpha_f
    return newmark_weights(step, alpha_m, alpha_f, beta=0.25 * surplus**2, gamma=0.5 - alpha_m + alpha_f)


def tableau(stages: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients a_sr and b_r of the collocation method with nodes c_s (Hairer and Wanner 1996, section IV.5).

    They integrate 1, t, t^2 ... exactly from 0 to c_s, and to 1.
    """
    c, powers = np.array(stages), np.arange(len(stages))
    inverse = np.linalg.inv(c[:, None] ** powers)
    return (c[:, None] ** (powers + 1) / (powers + 1)) @ inverse, 1.0 / (powers + 1) @ inverse


def _collocation(*stages: float) -> Callable[[AffineSystem, np.ndarray, float, float], np.ndarray]:
    """Coefficients of the loop `collocation` with these nodes: see there."""
    a, b = tableau(stages)

    def coefficients(system: AffineSystem, row: np.ndarray, step: float, rho_infinity: float) -> np.ndarray:
        parts = step * np.array(stages), step * a, step**2 * a @ a, step * b, step**2 * b @ a
        return np.concatenate(([step], *(part.ravel() for part in parts)))

    return coefficients


def _still(*ones: int) -> Callable[[np.ndarray], np.ndarray]:
    """These coefficients are one, all others zero."""

    def still(coefficients: np.ndarray) -> np.ndarray:
        found = np.zeros_like(coefficients)
        found[list(ones)] = 1.0
        return found

    return still


def _still_modal(coefficients: np.ndarray) -> np.ndarray:
    found = _still(0, 5)(coefficients)  # z_1 = z_0, v_1 = v_0
    found[8:] = coefficients[8:]
    return found


def _exact_modal(system: AffineSystem, row: np.ndarray, step: float, rho_infinity: float) -> np.ndarray:
    from kaneflex.integrate.modal import transition  # scipy.linalg only where it is used

    return transition(system, row, step)


_GAUSS = (0.5 - math.sqrt(3.0) / 6.0, 0.5 + math.sqrt(3.0) / 6.0)
_RADAU = (0.4 - math.sqrt(6.0) / 10.0, 0.4 + math.sqrt(6.0) / 10.0, 1.0)  # the last one is the end of the step

METHODS = {
    method.name: method
    for method in (
        Method(
            "radau", 5, "three-stage Radau IIA (Hairer and Wanner 1996): order 5, damps unresolved vibrations",
            (0.0, *_RADAU[:2]), 2, "collocation", _collocation(*_RADAU), _still(), True, stages=3,
        ),
        Method(
            "newmark", 2, "Newmark, average acceleration (Newmark 1959): no numerical damping",
            (0.0,), 2, "newmark", lambda system, row, step, rho: newmark_weights(step, 0.0, 0.0, 0.25, 0.5),
            _still(3), True,
        ),
        Method(
            "generalised-alpha", 2, "Chung and Hulbert 1993: damps the highest frequencies, by rho_infinity",
            (0.0,), 3, "newmark", _generalised_alpha, _still(2), True,
        ),
        Method(
            "gauss", 4, "two-stage Gauss-Legendre (Hairer and Wanner 1996): order 4, no numerical damping",
            (0.0, *_GAUSS), 2, "collocation", _collocation(*_GAUSS), _still(), True, stages=2,
        ),
        Method(
            "exact-modal", 2, "decoupled modes, constant coefficients: exact for loads linear within a step",
            (0.0,), 2, "exact_modal", _exact_modal, _still_modal,
        ),
        Method(
            "spectral", None, "Fourier collocation over a cycle: periodic motions, with as many harmonics as needed",
            (0.0,), 2, None, None, None,
        ),
    )
}  # fmt: skip
"""Methods by name."""


def method_named(name: str) -> Method:
    """Method of this name. Raises UserError if there is none."""
    if name not in METHODS:
        raise UserError("integrator", name, "unknown integrator", nearest(name, METHODS))
    return METHODS[name]
