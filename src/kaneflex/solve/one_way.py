"""How a scene comes to the linear equations of a one-way preset, for those who ask for these of any other one."""

from __future__ import annotations

from kaneflex.fem.mobility import check_determined, elastic_coordinates
from kaneflex.mechanism.closure_continuation import check_free
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.scene import Scene, with_settings
from kaneflex.scene.options import resolve_options
from kaneflex.solve.repeated_motion import check_cycle
from kaneflex.support.errors import SceneError

_PRESET = "stiffened"


def one_way_cure(scene: Scene, asked: str, integrated: bool) -> str:
    """A preset whose equations can be had in C, or why none of them takes the scene and what to take instead.

    ``asked``: what wants them; ``integrated``: whether it takes none but those that are integrated.
    """
    try:
        other = with_settings(scene, [f"solve.preset={_PRESET}"])
        dynamics = resolve_options(other).dynamics
        if scene.is_spatial:
            check_cycle(other, asked)
        elif dynamics != "rigid":
            check_determined(mechanism_of(other))
            check_free(other)
            elastic_coordinates(other)
    except SceneError as refusal:
        if refusal.key.startswith("solve."):
            return f"Take --preset {_PRESET}, and see to {refusal.key} under it: {refusal.cure}"
        key = "" if refusal.key == asked else f"{refusal.key}: "
        return f"None takes this scene: {key}{refusal.reason}. Take results.csv of a run instead"
    if integrated and dynamics == "rigid":
        return "Give a body a beam: rigid ones have no equations of what bends"
    return f"Take another preset, like --preset {_PRESET}"
