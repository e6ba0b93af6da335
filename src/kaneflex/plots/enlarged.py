"""The enlargement of a deformation in a picture, and its limits: bodies do not pass through each other."""

from __future__ import annotations

import math
from itertools import combinations
from typing import NamedTuple

import numpy as np

from kaneflex.plots.mechanism import outline, rigid_outline, scenery
from kaneflex.plots.outlines import Outline, Scenery
from kaneflex.plots.style import readable, round_down
from kaneflex.plots.view import View

_DRAWN = 0.1
"""Largest displacement as drawn, in sizes of the mechanism, before the factor is rounded down."""
_BENT = 0.25
"""The same in lengths of the link."""
_APART = 0.02
"""Largest gap that an enlargement may open between two sides of a joint, in sizes of the mechanism."""
_NOTHING = 1e-9
"""Displacement that counts as zero, in sizes of the mechanism (thermal expansion of steel by 0.0001 K)."""
_RUN = 90
"""Number of instants of the undeformed motion that are examined for crossing bodies."""


class Enlarged(NamedTuple):
    """A mechanism as it is drawn: undeformed, and with its deformation enlarged; ``factor`` is None of rigid ones."""

    fixed: Scenery
    still: Outline
    moved: Outline
    factor: float | None
    largest: float

    @property
    def visible(self) -> bool:
        """True where a deformation is drawn."""
        return self.factor is not None and self.largest > _NOTHING * self.fixed.size

    @property
    def title(self) -> str:
        """A statement of the enlargement."""
        if self.factor is None:
            return "rigid mechanism"
        if not self.visible:
            size, unit = readable("m", np.array(self.largest))
            most = f"{size * self.largest:.2g} {unit}"
            return f"no visible deformation (at most {most})" if self.largest else "no deformation"
        return f"deformation {times(self.factor)}"


def times(factor: float) -> str:
    """An enlargement in words."""
    if factor == 1.0:
        return "in true size"
    power = math.floor(math.log10(factor) + 1e-9)
    plain = f"{factor:g}"
    number = plain if power < 5 else f"{factor / 10.0**power:.0f} \u00d7 10$^{{{power}}}$"
    return f"enlarged {number} times"


def enlarged(shown: View) -> Enlarged:
    """The mechanism at all instants of a view, its deformation enlarged by one factor, 1, 2 or 5 times a power of ten.

    No point is drawn farther from its undeformed place than a tenth of the mechanism or a quarter of its link; the
    factor is reduced until no body crosses another that it does not cross undeformed, and no joint opens.
    """
    solution, scene = shown.solution, shown.solution.model.scene
    fixed = scenery(solution)
    still = rigid_outline(scene, shown.rigid, fixed)
    if not solution.model.links:  # shapes of coupled bodies without a mesh here are drawn in true size
        coupled = solution.model.options.dynamics == "coupled" and any(body.deforms for body in scene.bodies.values())
        moved = outline(shown.motion, fixed, float(coupled))
        return Enlarged(fixed, still, moved, 1.0 if coupled else None, still.farthest(moved))
    sizes = {name: float(np.linalg.norm(shown.displaced(name, link.nodes), axis=1).max())
             for name, link in solution.model.links.items()}  # fmt: skip
    largest = max(sizes.values())
    if largest <= _NOTHING * fixed.size:
        return Enlarged(fixed, still, still, 1.0, largest)
    room = min(_BENT * shown.lengths[name] / size for name, size in sizes.items() if size)
    farthest = max(largest, still.farthest(outline(shown.motion, fixed, 1.0)))
    factor = max(1.0, round_down(min(room, _DRAWN * fixed.size / farthest)))
    while True:
        moved = outline(shown.motion, fixed, factor)
        if factor <= 1.0 or not (_opens(shown, fixed, factor) or _passes(shown, fixed, moved)):
            return Enlarged(fixed, still, moved, factor, largest)
        factor = max(1.0, round_down(0.9 * factor))


def _opens(shown: View, fixed: Scenery, factor: float) -> bool:
    """True where the two sides of a pin with a clearance are drawn apart."""
    scene, motion = shown.solution.model.scene, shown.motion
    for joint in scene.loose.values():
        if joint.direction is None:
            gap = [shown.rigid.frame(side.body).place(np.reshape(scene.point(side), (2, 1)) + factor * (
                motion.displacement(side.body, scene.point(side))[0][:2] if side.body != "ground" else 0.0))
                for side in joint.sides]  # fmt: skip
            if np.hypot(*(gap[1] - gap[0])).max() > _APART * fixed.size:
                return True
    return False


def _passes(shown: View, fixed: Scenery, moved: Outline) -> bool:
    """True where bodies in the plane cross that no joint connects and that never cross undeformed.

    In space lines that cross in a picture need not meet.
    """
    scene, rigid = shown.solution.model.scene, shown.solution.rigid
    if not fixed.flat:
        return False
    joined = [{side.body for side in joint.addresses} for joint in scene.joints.values()]
    joined += [{side.body for side in joint.sides} for joint in scene.loose.values()]
    run = rigid_outline(scene, rigid.taken(np.arange(0, len(rigid.times), len(rigid.times) // _RUN + 1)), fixed)
    now, undeformed = _lines(shown, moved), _lines(shown, run)
    return any(
        _cross(now[one], now[other]) and not _cross(undeformed[one], undeformed[other])
        for one, other in combinations(now, 2) if {one, other} not in joined
    )  # fmt: skip


def _lines(shown: View, of: Outline) -> dict[str, list[np.ndarray]]:
    """Lines of each body, its block on a guide included, (n_times, n_points, 2) each [m]."""
    scene = shown.solution.model.scene
    found: dict[str, list[np.ndarray]] = {name: [] for name in scene.bodies}
    for name, line in (of.links | of.bars).items():  # type: ignore[operator]
        found[name.partition(" ")[0]].append(line)
    for joint, box in of.boxes.items():
        sides = scene.joints[joint].addresses if joint in scene.joints else scene.loose[joint].sides
        if sides[1].body in found:
            found[sides[1].body].append(box)
    return found


def _cross(one: list[np.ndarray], other: list[np.ndarray]) -> bool:
    """True where lines of two bodies cross at any instant."""
    for first in one:
        p, r = first[:, :-1, None], np.diff(first, axis=1)[:, :, None]
        for second in other:
            q, s = second[:, None, :-1], np.diff(second, axis=1)[:, None]
            with np.errstate(divide="ignore", invalid="ignore"):
                across = r[..., 0] * s[..., 1] - r[..., 1] * s[..., 0]
                t = ((q - p)[..., 0] * s[..., 1] - (q - p)[..., 1] * s[..., 0]) / across
                u = ((q - p)[..., 0] * r[..., 1] - (q - p)[..., 1] * r[..., 0]) / across
                if ((t > 0.0) & (t < 1.0) & (u > 0.0) & (u < 1.0)).any():
                    return True
    return False


def caption_at(shown: View, k: int) -> str:
    """Place of the first drive, and the time."""
    drive = next(iter(shown.solution.model.scene.drives), None)
    time = f"t = {1e3 * shown.times[k]:.2f} ms" if shown.times[-1] < 0.5 else f"t = {shown.times[k]:.2f} s"
    if drive is None:
        return time
    scene, coordinate = shown.solution.model.scene, float(shown.rigid[f"{drive}.angle"][k])
    at = f"{1e3 * coordinate:.1f} mm" if scene.slides(drive) else f"{math.degrees(coordinate):.0f} deg"
    return f"{drive} = {at}, {time}"
