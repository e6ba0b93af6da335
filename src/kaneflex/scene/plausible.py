"""What a scene may say, but hardly means."""

from __future__ import annotations

from kaneflex.scene.scene import Scene, written

_LONG = 10.0
"""Length [m] of a link beyond which a plain number is taken to be one of millimetres by mistake."""


def implausible(scene: Scene) -> tuple[str, ...]:
    """Warnings of links longer than 10 m whose length is written without a unit: plain numbers are in SI."""
    found = []
    for name, body in scene.bodies.items():
        wrote = written(scene.raw, ("bodies", name, "length"))
        if isinstance(wrote, int | float) and body.length is not None and body.length > _LONG:
            found.append(
                f"bodies.{name}.length = {wrote:g} is {wrote:g} m, since a plain number is in SI: write '{wrote:g} mm' "
                f"if that is meant, and '{wrote:g} m' otherwise"
            )
    return tuple(found)
