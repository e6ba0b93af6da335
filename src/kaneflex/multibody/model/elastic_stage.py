"""The elastic stage before it is assembled: parts and their connections."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from kaneflex.fem.assembly import Placed
from kaneflex.fem.coordinate_map import Frame
from kaneflex.fem.interface_coordinates import Interfaces
from kaneflex.fem.links import Link, Part
from kaneflex.mechanism.rigid_motion import RigidKinematics
from kaneflex.scene.options import Options
from kaneflex.support.errors import SceneError


@dataclass(frozen=True, eq=False)
class Stage:
    """Elastic stage of a mechanism in the plane or in space.

    Attributes
    ----------
    motion : RigidKinematics
        Rigid motion, with all scalars of the parts.
    links, parts, bases, interfaces, frame
        As :class:`kaneflex.multibody.model.bound_model.Model` has them.
    placed, sprung : list of (Part, L)
        What is assembled; ``sprung`` are springs, with dampers of their own.
    """

    motion: RigidKinematics
    links: Mapping[str, Link]
    parts: Mapping[str, Part]
    bases: Mapping[str, np.ndarray]
    interfaces: Interfaces
    frame: Frame
    placed: list[Placed]
    sprung: list[Placed]
    warnings: tuple[str, ...] = ()


def count_of_modes(options: Options, link: str, limit: int) -> int:
    """Number of fixed-interface modes to keep of a link with ``limit`` ones; SceneError if more are requested."""
    count = limit if options.modes == "all" else int(options.modes)
    if count > limit:
        raise SceneError(
            "solve.modes", options.modes, f"{link} has {limit} fixed-interface modes",
            "Use fewer modes, or more elements",
        )  # fmt: skip
    return count
