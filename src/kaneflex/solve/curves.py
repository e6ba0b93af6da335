"""What one model says of a scene's sensors, whoever computed it: what models are compared by."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Curves:
    """What one model says of a scene's sensors.

    Attributes
    ----------
    times : ndarray
        Instants [s], shape (n_times,), ascending.
    values : mapping of str to ndarray
        Sensors in SI, each of shape (n_times,).
    missing : mapping of str to str
        Sensors that the model can't give, with the reason.
    notes : tuple of str
        How the model differs from the scene as it is written, and what to know before trusting it.
    seconds : float
        Wall time of solving; compiling and building come before it.
    undersampled : tuple of str
        What comes and goes between two of the model's steps, in words; only where models are weighed.
    """

    times: np.ndarray
    values: Mapping[str, np.ndarray]
    missing: Mapping[str, str]
    notes: tuple[str, ...] = ()
    seconds: float = 0.0
    undersampled: tuple[str, ...] = ()


@dataclass(frozen=True)
class Resolution:
    """How fine another program computes.

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
