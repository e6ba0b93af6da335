"""What a scene's laws must satisfy before anything is derived: they are read, and sampled over the run."""

from __future__ import annotations

import numpy as np

from kaneflex.scene.drives import Drive
from kaneflex.scene.laws import parse_law, sample_times
from kaneflex.scene.parts import Load
from kaneflex.scene.scene import Scene
from kaneflex.scene.tables import evaluate_block
from kaneflex.support.errors import Fault


def check_drive_law(scene: Scene, drive: Drive) -> None:
    """Raise Fault unless a drive's law is one, without kinks, and has values over the run."""
    law = parse_law(drive.law, ("t",))
    kink = law.kinks()
    if kink is not None:
        reason = f"{kink} has kinks, where the speed would jump within no time"
        raise Fault(reason, "Write a law whose speed is continuous, like sqrt(x**2 + small**2) for abs(x)")
    if scene.horizon is not None:
        law.check_values({"t": sample_times(scene.horizon)})


def check_load_law(scene: Scene, load: Load) -> None:
    """Raise Fault unless a load's law is one and has values wherever its joints' motion is known before the run.

    A law of a free joint's motion is tried where the joint starts; what depends on the speed of a spin-up, a law or a
    table is sampled with the derived motion (`kaneflex.solve.law_checks.check_finite`).
    """
    law = parse_law(load.law, scene.law_names())
    for name in scene.joints:
        if f"{name}_speed" in scene.joints and law.uses(f"{name}_speed"):
            reason = f"{name}_speed is a joint, and the speed of joint {name}"
            raise Fault(reason, "Give the joint another name")
    free = law.uses_any([name for name, drive in scene.drives.items() if drive.free])
    if scene.horizon is None and not free:
        return
    times = np.zeros(1) if free else sample_times(scene.horizon)
    known = {"t": times}
    for name, drive in scene.drives.items():
        known |= _motion(name, drive, times)
    if all(name in known for name in scene.law_names() if law.uses(name)):
        law.check_values(known)


def _motion(name: str, drive: Drive, times: np.ndarray) -> dict[str, np.ndarray | float]:
    """What is known of a drive's coordinate [rad or m] and speed at `times` (n,) before the run, by a law's names."""
    try:
        match drive.kind:
            case "free":
                return {name: drive.start, f"{name}_speed": drive.initial_speed}
            case "constant speed":
                return {name: drive.start + drive.speed * times, f"{name}_speed": drive.speed}
            case "law":
                return {name: parse_law(drive.law, ("t",)).on_arrays({"t": times})}
            case "table":
                return {name: evaluate_block(drive.curve(), times)}
    except Fault:
        pass  # named where the drive is checked
    return {}
