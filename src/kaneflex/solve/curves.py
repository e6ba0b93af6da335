"""Sensor curves of a model, from kaneflex or another program, for comparisons."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Curves:
    """Sensor curves of one model.

    Attributes
    ----------
    times : ndarray
        Instants [s], shape (n_times,), ascending.
    values : mapping of str to ndarray
        Sensors in SI, each of shape (n_times,).
    missing : mapping of str to str
        Sensors that the model can't give, with the reason.
    notes : tuple of str
        Differences of the model from the scene as written, and warnings.
    seconds : float
        Wall time of the solution, without compilation and set-up.
    undersampled : tuple of str
        Loads that the model's steps do not resolve, in words; only for model comparisons.
    """

    times: np.ndarray
    values: Mapping[str, np.ndarray]
    missing: Mapping[str, str]
    notes: tuple[str, ...] = ()
    seconds: float = 0.0
    undersampled: tuple[str, ...] = ()


@dataclass(frozen=True)
class Resolution:
    """Mesh and steps of another program.

    Attributes
    ----------
    elements : int or None
        Elements of each elastic link; None takes twice the scene's, at least 8.
    steps : int or None
        Steps per cycle or run; None takes four times the scene's.
    """

    elements: int | None = None
    steps: int | None = None


FINE_ENOUGH = Resolution()
