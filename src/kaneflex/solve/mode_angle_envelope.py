"""Dependence of the paper's frozen model on the crank angle at which it is frozen."""

from __future__ import annotations

import numpy as np

from kaneflex.multibody.model.bound_model import Model
from kaneflex.scene.sensors import DRIVE_KINDS
from kaneflex.solve.summary_tables import PeakSpread

ANGLES = 12
"""Crank angles, equally spaced over a turn, at which the model is frozen."""
_RIGID_KINDS = ("joint_force", *DRIVE_KINDS, "spring_force", "spring_torque")


def mode_angle_spread(model: Model) -> dict[str, PeakSpread]:
    """Smallest and largest peak of each sensor over the mode angle.

    The decoupled equations (143) use the mass and stiffness at one crank angle, which the paper does not state; a
    single result of this model is of little use without its spread.

    Returns
    -------
    dict
        Sensor -> smallest and largest max |y| over the ANGLES mode angles that the first drive reaches, in the
        sensor's SI unit; empty if the equations are not frozen.
    """
    from kaneflex.multibody.model.building import build_model, stands_at
    from kaneflex.solve.simulation import solve

    peaks: dict[str, list[float]] = {}
    if model.options.dynamics != "frozen":
        return {}
    for k in range(ANGLES):
        angle = 2 * np.pi * k / ANGLES
        if stands_at(model, angle) is None:  # a drive may not reach every angle
            continue
        options = model.options._replace(mode_angle=angle)
        solution = solve(build_model(model.scene, options, model.motion))
        for name, sensor in model.scene.sensors.items():
            if sensor.kind not in _RIGID_KINDS:
                peaks.setdefault(name, []).append(float(abs(solution.series[name].values).max()))
    return {name: PeakSpread(smallest=min(values), largest=max(values)) for name, values in peaks.items()}
