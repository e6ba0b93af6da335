"""Rates of the coordinates of a mechanism, and its speeds from them.

A joint's coordinate and a shape's amplitude have their speed as rate. A ball has a unit quaternion p with the rate
p' = p omega / 2, where omega is its angular velocity in its own axes.
"""

from __future__ import annotations

import numpy as np

from kaneflex.multibody.engine import Engine


def rates_of(engine: Engine, q: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Rates q' (n_times, coordinates) of coordinates q with speeds u."""
    found, (own, speeds) = np.zeros(q.shape), engine.own.T
    found[:, own] = u[:, speeds]
    for k, s in engine.balls.tolist():
        w, p, omega = q[:, k, None], q[:, k + 1 : k + 4], u[:, s : s + 3]
        found[:, k] = -0.5 * (p * omega).sum(axis=1)
        found[:, k + 1 : k + 4] = 0.5 * (w * omega + np.cross(p, omega))
    return found


def speeds_of(engine: Engine, q: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """Speeds u (n_times, speeds) of coordinates q with rates q'."""
    found, (own, speeds) = np.zeros((len(q), engine.size)), engine.own.T
    found[:, speeds] = rates[:, own]
    for k, s in engine.balls.tolist():
        w, p = q[:, k, None], q[:, k + 1 : k + 4]
        turned = w * rates[:, k + 1 : k + 4] - rates[:, k, None] * p
        found[:, s : s + 3] = 2.0 * (turned - np.cross(p, rates[:, k + 1 : k + 4]))
    return found
