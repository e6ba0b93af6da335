"""Contact lines of elastic links: straight tangents at their address, valid near it only."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.mechanism.planar import BodyPoint
from kaneflex.scene.contacts import Contact
from kaneflex.support.errors import SceneError

if TYPE_CHECKING:
    from kaneflex.multibody.model.bound_model import Model
    from kaneflex.solve.run_result import RunResult

_SHARE = 0.01
"""Distance of a contact line from the link's axis that is accepted, as a share of the link's deflection."""
_NEAR = 0.05
"""Distance from the address, as a share of the link's length L, within which the line is that close: a constant
curvature k leaves k s^2/2 between tangent and axis at a distance s, and deflects the link by k L^2/8; 4 (s/L)^2 =
0.01."""
_TOUCHING = 1e-3
"""Gap at the start, as a share of the link's length, that counts as contact."""


def check_lines(model: Model) -> None:
    """Raise SceneError if a side touches the straight line of an elastic link far from the line's address at the start;
    the model needs no equations."""
    scene, first = model.scene, model.motion.at(0.0)
    for name, contact in _lines(model):
        line, point = contact.sides
        length = scene.bodies[line.body].length or 1.0
        start, end = (first.frame(side.body).place(scene.point(side)) for side in (line, point))
        (x, y), (n_x, n_y) = first.frame(line.body).to_body(end - start)[:, 0].tolist(), contact.direction
        along = (n_y * x - n_x * y) * n_y
        if abs(n_x * x + n_y * y - contact.reach) < _TOUCHING * length and abs(along) > _NEAR * length:
            raise SceneError(
                contact.entry(name), str(line),
                f"{line.body} is elastic, and its contact line is valid near this point only; {point.body} touches it "
                f"{1e3 * abs(along):.4g} mm away",
                f"Choose the point of {line.body} where it touches, or weld a rigid body there as the line",
            )  # fmt: skip


def off_their_lines(solution: RunResult) -> Iterator[str]:
    """Warnings of contacts that act where the axis of their elastic link leaves its straight line."""
    motion, scene = solution.motion, solution.model.scene
    for name, contact in _lines(solution.model):
        line, point = contact.sides
        pushed = np.flatnonzero(motion.contact(name)[1] > 0.0)
        if not len(pushed):
            continue
        taken = motion.scalars.taken(pushed)
        frame, _ = taken.section_frame(BodyPoint(line.body, line.point, scene.point(line)))
        touched = taken.moving_place(point.body, scene.point(point))[0][:2]
        (x, y), (n_x, n_y) = frame.to_body(touched - frame.origin), contact.direction
        along, places = n_y * x - n_x * y, solution.model.links[line.body].nodes
        nodes = (taken.moving_place(line.body, (float(x), 0.0))[0][:2] - frame.origin for x in places)
        above = np.array([n_x * u + n_y * v for u, v in map(frame.to_body, nodes)])
        foot = scene.point(line)[0] + contact.direction[1] * along
        off = np.array([np.interp(x, places, each) for x, each in zip(foot, above.T, strict=True)])
        off *= abs(contact.direction[1])  # a line across a section is exact, since sections stay plane
        bent = abs(motion.nodes(line.body)[1::3]).max()
        k = int(abs(off).argmax())
        if abs(off[k]) > _SHARE * bent:
            yield (
                f"the line of {contact.stands(name)} is the tangent of {line.body} at {line}; at t = "
                f"{taken.times[k]:.6g} s {point.body} touches it {1e3 * abs(along[k]):.4g} mm from there, where the "
                f"bent axis is {1e3 * abs(off[k]):.3g} mm off this tangent (largest deflection "
                f"{1e3 * bent:.3g} mm); choose the point where it touches, or weld a rigid body there as the line"
            )


def _lines(model: Model) -> Iterator[tuple[str, Contact]]:
    """Contacts whose line is on an elastic link."""
    for name, contact in model.scene.contacts.items():
        body = model.scene.bodies.get(contact.sides[0].body)
        if contact.kind == "point-line" and body is not None and body.elastic:
            yield name, contact
