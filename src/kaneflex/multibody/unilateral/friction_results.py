"""Forces, speeds and losses of friction over time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

STUCK = 2.0
"""Mode of stuck friction."""


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
        Energy [J] dissipated since the start.
    bristles : ndarray (n_times, n_frictions)
        Deflection of the bristles of law lugre [m, in a pin rad]; 0 of others.
    jams : ndarray (n_frictions,)
        First time [s] at which friction jammed its contact: rigid sides would have no consistent contact force, or
        several (Painleve's paradox); NaN without jamming.
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
    def of(cls, names: tuple[str, ...], states: np.ndarray, lost: np.ndarray, jams: np.ndarray) -> FrictionRecord:
        """Record from the engine's series of each friction, (n_times, n_frictions, 5), its losses, and first jams."""
        force, speed, pressed, mode, bristles = states.transpose(2, 0, 1)
        return cls(names, force, speed, pressed, mode, lost, bristles, jams)

    def taken(self, instants: np.ndarray) -> FrictionRecord:
        """The same at some of the stored instants."""
        keys = ("force", "speed", "pressed", "mode", "lost", "bristles")
        return replace(self, **{key: getattr(self, key)[instants] for key in keys})
