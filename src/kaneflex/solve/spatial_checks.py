"""Checks of reactions in space: which of them are statically indeterminate because of redundant constraints."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace
from typing import TypeVar

import numpy as np

from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.spatial_elastic import DeformingKinematics, undetermined
from kaneflex.multibody.model.spatial_reactions import open_reactions
from kaneflex.multibody.time.spatial_motion import SpatialKinematics
from kaneflex.scene import Scene
from kaneflex.scene.options import Options
from kaneflex.scene.quantities import Address
from kaneflex.scene.sensors import DRIVE_KINDS, SECTION_KINDS, Sensor
from kaneflex.support.errors import SceneError

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
        check_spatial_sensors(motion.module.system.scene, lost, options.dynamics == "rigid")
    return replace(motion, module=replace(motion.module, open_reactions=lost))


def check_stage(model: Model) -> None:
    """Raise SceneError if a sensor reads a reaction that is statically indeterminate with deforming links."""
    motion = model.motion
    if isinstance(motion, DeformingKinematics):
        instants = motion.at(model.options.duration * (_ELSEWHERE[:1] if motion.is_start else _ELSEWHERE))
        check_spatial_sensors(model.scene, undetermined(motion.deforming.map, instants))


def check_spatial_sensors(scene: Scene, open_reactions: Collection[str], rigid: bool = False) -> None:
    """Raise SceneError, which names sensor and joint, if a sensor reads a statically indeterminate reaction; ``rigid``:
    section forces are those of rigid links."""
    for name, sensor in scene.sensors.items():
        for part in _reactions_read(scene, sensor, rigid):
            if any(each.startswith(part) for each in open_reactions):
                joint, _, kind = part.rpartition(".")
                raise SceneError(
                    f"sensors.{name}.{sensor.kind}", str(sensor.target), f"the {kind} of joint {joint} is statically "
                    "indeterminate: constraints are redundant, and rigid bodies don't determine it",
                    "Choose another sensor, or a spherical joint instead of a revolute one",
                )  # fmt: skip


def _reactions_read(scene: Scene, sensor: Sensor, rigid: bool) -> Iterator[str]:
    """Reactions that a sensor reads, as JOINT.force, JOINT.moment or JOINT.drive; of the section of a rigid link those
    of the joints before it."""
    if sensor.kind in DRIVE_KINDS:
        yield f"{sensor.target}.drive"
    elif sensor.kind == "joint_force":
        yield f"{sensor.target}.{'moment' if sensor.component.startswith('angle') else 'force'}"
    elif rigid and sensor.kind in SECTION_KINDS and isinstance(link := sensor.target, Address):
        x, after = scene.point(link)[0], sensor.cut == "after"
        for name, joint in scene.joints.items():
            on = [scene.point(side)[0] for side in joint.addresses if side.body == link.body]
            if any(at < x or at == 0.0 or (after and at == x) for at in on):
                yield from (f"{name}.force", f"{name}.moment")
