"""Sensors in a drawing: diamonds with numbers, and a list of them."""

from __future__ import annotations

from textwrap import wrap

import numpy as np
from matplotlib.axes import Axes

from kaneflex.plots.labels import Labels
from kaneflex.plots.standing import Standing
from kaneflex.plots.style import PALETTE
from kaneflex.scene import Scene
from kaneflex.scene.quantities import Address
from kaneflex.scene.sensors import CONTACT_KINDS, FRICTION_KINDS

SENSOR = PALETTE[2]
_LINE = 44
"""Characters in a line of the list of sensors."""


def sensors_by_place(scene: Scene, stand: Standing) -> list[tuple[str, np.ndarray, list[str]]]:
    """Places at which sensors measure: (address or joint, place [mm], names), in the scene's order."""
    found: dict[str, tuple[np.ndarray, list[str]]] = {}
    for name, sensor in scene.sensors.items():
        target = sensor.target
        if sensor.kind in ("spring_force", "spring_torque"):
            spring = scene.springs[target]
            ends = spring.ends or spring.bushing or scene.joints[spring.torsional_at].addresses
            middle = np.mean([stand.at(end) for end in ends], axis=0)
            found.setdefault(f"spring {target}", (middle, []))[1].append(name)
            continue
        if sensor.stress is not None:  # modal data don't say where it is
            middle = stand.at(Address(sensor.stress.body, "mid"))
            found.setdefault(f"stress {target}", (middle, []))[1].append(name)
            continue
        if sensor.kind in (*CONTACT_KINDS, *FRICTION_KINDS) and str(target) in scene.contacts:
            side = scene.contacts[str(target)].sides[1]
            found.setdefault(f"contact {target}", (stand.at(side), []))[1].append(name)
            continue
        if not isinstance(target, str) and target.body in scene.loose:
            side = scene.loose[target.body].sides[1]
            found.setdefault(target.body, (stand.at(side), []))[1].append(name)
            continue
        joint = target if isinstance(target, str) else target.body if target.body in scene.joints else None
        address = scene.joints[joint].addresses[1] if joint is not None else target
        key = joint if joint is not None else str(target)
        found.setdefault(key, (stand.at(address), []))[1].append(name)
    return [(key, at, names) for key, (at, names) in found.items()]


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
