"""Events: instants at which a sensor crosses a value."""

from __future__ import annotations

from typing import Literal

from pydantic import StrictBool

from kaneflex.scene.table import SceneTable


class Event(SceneTable):
    """Crossing of `value` by a `sensor`, `up`, `down` or in `both` directions. With `stop` the run ends there.

    `value` is in the sensor's SI unit, or text with a unit.
    """

    sensor: str
    value: float | str = 0.0
    direction: Literal["up", "down", "both"] = "both"
    stop: StrictBool = False
