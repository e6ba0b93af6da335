"""What a scene may say, but hardly means."""

from __future__ import annotations

import numpy as np

from kaneflex.scene.scene import Scene, given_value
from kaneflex.scene.tables import largest_of_block, overshoot_of_block

_LONG = 10.0
"""Length [m] of a link beyond which a plain number is taken to be one of millimetres by mistake."""
_BEYOND_ROWS = 0.02
"""How far a table's curve may go beyond the two rows beside it, as a share of its largest value, without a warning."""


def implausible(scene: Scene) -> tuple[str, ...]:
    """Warnings of what is read from the scene alone: lengths without a unit, and tables' curves where no row is."""
    return (*_long_links(scene), *_overshooting_tables(scene))


def _long_links(scene: Scene) -> list[str]:
    """Warnings of links longer than 10 m whose length is written without a unit: plain numbers are in SI."""
    found, raw = [], scene.raw
    for name, body in scene.bodies.items():
        given = given_value(raw, ("bodies", name, "length"))
        if isinstance(given, int | float) and body.length is not None and body.length > _LONG:
            found.append(
                f"bodies.{name}.length = {given:g} is {given:g} m, since a plain number is in SI: write '{given:g} mm' "
                f"if that is meant, and '{given:g} m' otherwise"
            )
    return found


def _overshooting_tables(scene: Scene) -> list[str]:
    """Warnings of tables whose smooth curve leaves the interval between two neighbouring rows."""
    tables = {f"loads.{name}": (load, load.si_unit) for name, load in scene.loads.items() if load.kind == "table"}
    for name, drive in scene.drives.items():
        if drive.kind == "table":
            tables[f"drives.{name}"] = (drive, "m" if scene.slides(name) else "rad")
    found = []
    for key, (reader, unit) in tables.items():
        curve = reader.curve()
        in_time = getattr(reader, "against", "t") == "t"
        beyond = overshoot_of_block(curve)
        if beyond.size > _BEYOND_ROWS * largest_of_block(curve):
            x, x_unit = (beyond.x, "s") if in_time else (np.degrees(beyond.x), "deg")
            first, last = beyond.rows
            found.append(
                f"{key}: its {reader.interpolation} goes to {beyond.value:.4g} {unit} at {x:.4g} {x_unit}, between "
                f"rows of {first:.4g} and {last:.4g} {unit}; give more rows, or interpolation = 'pchip', which stays "
                "between"
            )
    return found
