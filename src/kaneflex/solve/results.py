"""Results as labelled arrays in SI, drives' angles in degrees."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kaneflex.support.labelled import Entry, Labelled

if TYPE_CHECKING:
    from kaneflex.solve.run_result import RunResult


def labelled(solution: RunResult) -> Labelled:
    """All sensors of a solution as labelled arrays.

    Parameters
    ----------
    solution : RunResult

    Returns
    -------
    Labelled
        Dimension ``time`` [s]; coordinate ``drive_angle_<drive>`` [degree] for each drive, continued over cycles, or
        ``drive_position_<drive>`` [m] of a guide; a variable for each sensor, and ``NAME_rigid`` for forces, with CF
        ``units`` and ``long_name``. Coupled runs also have dimension ``state``, the names of its coordinates, with
        ``last_state`` and ``last_rate`` at the last time; those with contacts dimensions ``contact`` and ``impact``,
        those with friction ``friction``, see :mod:`kaneflex.solve.touching`.

        Attributes describe the scene and the outcome; none depends on the machine or the clock.
    """
    import kaneflex

    model = solution.model
    coordinates: dict[str, Entry] = {"time": ("time", solution.times, {"units": "s", "long_name": "time", "axis": "T"})}
    for drive, angle in solution.drive_angles.items():
        if model.scene.slides(drive):
            attributes = {"units": "m", "long_name": f"position of the drive {drive}"}
            coordinates[f"drive_position_{drive}"] = ("time", angle, attributes)
            continue
        attributes = {"units": "degree", "long_name": f"angle of the drive {drive}"}
        coordinates[f"drive_angle_{drive}"] = ("time", np.degrees(angle), attributes)
    variables: dict[str, Entry] = {
        name: ("time", series.values, {"units": series.unit, "long_name": series.meaning})
        for name, series in solution.series.items()
    }
    if model.options.dynamics == "coupled" and len(solution.times):
        coordinates["state"], more = _last_state(solution)
        variables |= more
    if model.coupled is not None and len(solution.times):
        from kaneflex.solve.touching import labelled_contacts, labelled_frictions

        for names, found in (labelled_contacts(solution), labelled_frictions(solution)):
            coordinates |= names
            variables |= found
    about = {
        "Conventions": "CF-1.11",
        "title": model.scene.description or model.scene.name,
        "source": f"kaneflex {kaneflex.__version__}",
        "scene": model.scene.name,
        "structure": model.motion.module.STRUCTURE,
        "preset": model.options.preset,
        "outcome": solution.outcome.name.lower(),
    }
    return Labelled(variables, coordinates, about)


def _last_state(solution: RunResult) -> tuple[tuple, dict[str, tuple]]:
    """Names of the coordinates, and their last values and rates, from which another run can continue."""
    from kaneflex.solve.coupled_state import last_state

    state = last_state(solution)
    about = {"long_name": "coordinates at the last time", "units": "1", "comment": "m; rad where a name ends in phi"}
    return ("state", np.array(state.names), {"long_name": "coordinates of all bodies"}), {
        "last_state": ("state", state.q, about),
        "last_rate": ("state", state.v, about | {"long_name": "their rates at the last time"}),
    }
