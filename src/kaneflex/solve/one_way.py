"""Advice for exports that need the linear equations of a one-way preset."""

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
    """Advice which preset has exportable equations, or why none has and what to use instead.

    ``asked``: entry that needs them; ``integrated``: whether they must be integrated ones.
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
            return f"Use --preset {_PRESET}, and change {refusal.key}: {refusal.cure}"
        key = "" if refusal.key == asked else f"{refusal.key}: "
        return f"No linear preset supports this scene: {key}{refusal.reason}. Use results.csv of a run instead"
    if integrated and dynamics == "rigid":
        return "Give a body a beam: rigid bodies have no elastic equations"
    return f"Use another preset, for example --preset {_PRESET}"
