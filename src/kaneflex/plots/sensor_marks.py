"""Sensors in a drawing: diamonds with numbers, and a list of them."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import wrap

import numpy as np
from matplotlib.axes import Axes

from kaneflex.plots.labels import Labels
from kaneflex.plots.standing import Standing
from kaneflex.plots.style import PALETTE
from kaneflex.scene import Scene
from kaneflex.scene.quantities import Address
from kaneflex.scene.sensors import CONTACT_KINDS, FRICTION_KINDS, SPRING_KINDS, Sensor

SENSOR = PALETTE[2]
_LINE = 44
"""Characters in a line of the list of sensors."""


def sensors_by_place(scene: Scene, stand: Standing) -> list[tuple[str, np.ndarray, list[str]]]:
    """Places at which sensors measure: (address or joint, place [mm], names), in the scene's order."""
    found: dict[str, tuple[np.ndarray, list[str]]] = {}
    for name, sensor in scene.sensors.items():
        key, ends = _measured_at(scene, sensor)
        found.setdefault(key, (np.mean([stand.at(end) for end in ends], axis=0), []))[1].append(name)
    return [(key, at, names) for key, (at, names) in found.items()]


def _measured_at(scene: Scene, sensor: Sensor) -> tuple[str, Sequence[Address]]:
    """Key of the place of a sensor, and the points in the middle of which it lies."""
    target = sensor.target
    if sensor.kind in SPRING_KINDS:
        spring = scene.springs[str(target)]
        return f"spring {target}", spring.ends or scene.joints[str(spring.torsional_at)].addresses
    if sensor.stress is not None:  # modal data don't say where it is
        return f"stress {target}", (Address(sensor.stress.body, "mid"),)
    if sensor.kind in (*CONTACT_KINDS, *FRICTION_KINDS) and str(target) in scene.contacts:
        return f"contact {target}", scene.contacts[str(target)].sides[1:]
    if isinstance(target, Address) and target.body in scene.loose:
        return target.body, scene.loose[target.body].sides[1:]
    joint = target if isinstance(target, str) else target.body
    if isinstance(target, Address) and joint not in scene.joints:
        return str(target), (target,)
    return joint, scene.joints[joint].addresses[1:]


def mark_sensors(axes: Axes, labels: Labels, sensors: list[tuple[str, np.ndarray, list[str]]]) -> None:
    """A diamond at every place and the numbers of its entries in the list."""
    numbers: dict[tuple[float, ...], list[str]] = {}
    for k, (_, at, _) in enumerate(sensors, 1):
        numbers.setdefault(tuple(np.round(at, 6)), []).append(str(k))
    for at, here in numbers.items():
        axes.plot(*at, marker="D", markersize=5.5, color=SENSOR, markeredgecolor="white", zorder=5)
        labels.add(", ".join(here), np.array(at), SENSOR, weight="bold", size=8)


def listed(sensors: list[tuple[str, np.ndarray, list[str]]]) -> str:
    """The sensors by number, in lines."""
    lines = ["sensors"] if sensors else []
    for k, (place, _, names) in enumerate(sensors, 1):
        lines += wrap(f"{k}  {place}: {', '.join(names)}", _LINE, subsequent_indent="    ")
    return "\n".join(lines)
