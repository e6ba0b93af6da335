"""What the frictions of a run did: forces, speeds and losses over time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

STUCK = 2.0
"""Mode of what neither slides nor turns."""


@dataclass(frozen=True, eq=False)
class FrictionRecord:
    """The frictions of a run at its stored instants.

    Attributes
    ----------
    names : tuple of str
        Their joints and contacts.
    force : ndarray (n_times, n_frictions)
        On the second side [N], in a pin on the second body [N m]: along a guide's direction, or a contact's normal
        turned by 90 deg.
    speed : ndarray (n_times, n_frictions)
        Of the second side past the first, along the same [m/s or rad/s].
    pressed : ndarray (n_times, n_frictions)
        What presses the sides together: a contact's force [N], a pin's reaction times its radius [N m], the sum of what
        a guide's faces bear [N].
    mode : ndarray (n_times, n_frictions)
        1 or -1 where it slips that way, 2 where it is stuck, 3 where its force is a function of the state, 4 where
        bristles have it, 0 where the sides are apart.
    lost : ndarray (n_times, n_frictions)
        Energy [J] that each has lost since the start.
    bristles : ndarray (n_times, n_frictions)
        How far those of law lugre are bent [m, in a pin rad]; 0 of others.
    jams : ndarray (n_frictions,)
        When each first pressed the sides of its contact into each other, so that between rigid ones no force would
        agree with it, or several would (Painleve's paradox) [s]; no number where it never did.
    """

    names: tuple[str, ...]
    force: np.ndarray
    speed: np.ndarray
    pressed: np.ndarray
    mode: np.ndarray
    lost: np.ndarray
    bristles: np.ndarray
    jams: np.ndarray

    @classmethod
    def of(cls, names: tuple[str, ...], told: np.ndarray, lost: np.ndarray, jams: np.ndarray) -> FrictionRecord:
        """From what the engine tells of each, (n_times, n_frictions, 5), what it lost, and when it first jammed."""
        force, speed, pressed, mode, bristles = told.transpose(2, 0, 1)
        return cls(names, force, speed, pressed, mode, lost, bristles, jams)

    def taken(self, instants: np.ndarray) -> FrictionRecord:
        """The same at some of the stored instants."""
        keys = ("force", "speed", "pressed", "mode", "lost", "bristles")
        return replace(self, **{key: getattr(self, key)[instants] for key in keys})
