"""Checks of reactions in space: which of them are statically indeterminate because of redundant constraints."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TypeVar

import numpy as np

from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.determinacy import check_sensors
from kaneflex.multibody.model.spatial_elastic import DeformingKinematics, undetermined
from kaneflex.multibody.model.spatial_reactions import open_reactions
from kaneflex.multibody.time.spatial_motion import SpatialKinematics
from kaneflex.scene import Scene
from kaneflex.scene.options import Options
from kaneflex.scene.quantities import Address
from kaneflex.scene.sensors import Sensor

Moving = TypeVar("Moving", bound=SpatialKinematics)
_ELSEWHERE = np.concatenate([[0.0], (np.arange(8) + 0.381966) / 8.0])
"""Shares of a run at which reactions are checked: its start, and others away from aligned positions."""


def with_open_reactions(motion: Moving, options: Options) -> Moving:
    """Motion that knows its statically indeterminate reactions, at its start and elsewhere in the run.

    Raises SceneError if bodies are rigid or coupled, and a sensor reads one.
    """
    times = options.duration * (_ELSEWHERE[:1] if motion.is_start else _ELSEWHERE)
    lost = open_reactions(motion.module.system, map(motion.curve, times.tolist()))
    if options.dynamics in ("rigid", "coupled"):
        check_sensors(motion.module.system.scene, lost, _before if options.dynamics == "rigid" else None)
    return replace(motion, module=replace(motion.module, open_reactions=lost))


def check_stage(model: Model) -> None:
    """Raise SceneError if a sensor reads a reaction that is statically indeterminate with deforming links."""
    motion = model.motion
    if isinstance(motion, DeformingKinematics):
        instants = motion.at(model.options.duration * (_ELSEWHERE[:1] if motion.is_start else _ELSEWHERE))
        check_sensors(model.scene, undetermined(motion.deforming.map, instants), None)


def _before(scene: Scene, sensor: Sensor) -> Iterator[str]:
    """Reactions of the joints before a section of a rigid link, which its forces balance."""
    assert isinstance(sensor.target, Address)
    x, after = scene.point(sensor.target)[0], sensor.cut == "after"
    for name, joint in scene.joints.items():
        on = [scene.point(side)[0] for side in joint.addresses if side.body == sensor.target.body]
        if any(at < x or at == 0.0 or (after and at == x) for at in on):
            yield from (f"{name}.force", f"{name}.moment")
