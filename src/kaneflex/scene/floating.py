"""How the floating frame of an elastic link hangs on it, and how many shapes the coupled equations give the link.

Both follow from where joints, loads and masses act, before any number of the beam is known.
"""

from __future__ import annotations

from dataclasses import dataclass

from kaneflex.carried import prescribed_bodies
from kaneflex.scene.quantities import Address
from kaneflex.scene.scene import Scene

DEFAULT_MODES = 3
"""Fixed-interface modes of a link where the scene asks for no number of its own."""
_SAME = 1e-9
"""Points closer than this share of a link's length are one."""


@dataclass
class Station:
    """A point of a link's axis at which joints, loads or masses act.

    Attributes
    ----------
    x : float
        Distance from the link's start [m].
    joined, turned, clamped : bool
        Whether a joint is there; whether something can turn the section; whether something prescribes its turn.
    """

    x: float
    joined: bool = False
    turned: bool = False
    clamped: bool = False


def stations(scene: Scene, link: str) -> list[Station]:
    """The stations of a link from its start to its end."""
    found: list[Station] = []
    length = scene.bodies[link].length
    placed = prescribed_bodies(scene)

    def at(address: Address) -> Station:
        x = scene.point(address)[0]
        for station in found:
            if abs(station.x - x) <= _SAME * length:
                return station
        found.append(Station(x))
        return found[-1]

    torques = {load.torque_at for load in scene.torques.values()}
    torques |= {spring.torsional_at for spring in scene.springs.values()}
    for name, joint in scene.joints.items():
        driven = name in scene.drives and scene.drives[name].kind != "free"
        stiff = joint.kind != "revolute" or driven
        for own, other in (joint.addresses, joint.addresses[::-1]):
            if own.body == link:
                station = at(own)
                station.joined = True
                station.turned |= stiff or name in torques
                station.clamped |= stiff and other.body in placed
    for load in scene.forces.values():
        if load.force_on.body == link:
            at(load.force_on)
    for spring in scene.springs.values():
        for end in spring.ends:
            if end.body == link:
                at(end)
    for mass in scene.masses.values():
        if mass.at.body == link:
            at(mass.at).turned |= bool(mass.inertia)
    return sorted(found, key=lambda station: station.x)


def frame_of(stations_of_link: list[Station]) -> str:
    """What the x axis of a link's floating frame does.

    "tangent" touches the link at its start, "chord" passes through its farthest joint, "mean" leaves the bending no
    moment of momentum about the start (Buckens). A link that turns freely must not have a frame that its shapes could
    turn on the spot: its mass would be lost.
    """
    joined = [station for station in stations_of_link if station.joined]
    if not joined or joined[0].x > 0 or joined[0].clamped:
        return "tangent"
    return "chord" if len(joined) > 1 else "mean"


def modes_of(scene: Scene) -> int:
    """Fixed-interface modes of each link in the coupled equations."""
    return DEFAULT_MODES if scene.solve.modes == "all" else scene.solve.modes


def shape_counts(scene: Scene) -> dict[str, tuple[int, int]]:
    """Elastic link -> its numbers of axial and of transverse shapes."""
    return {
        name: _counts(scene, name, modes_of(scene)) if body.elastic else body.modal.counts
        for name, body in scene.bodies.items()
        if body.elastic or body.modal is not None
    }


def _counts(scene: Scene, name: str, modes: int) -> tuple[int, int]:
    found = stations(scene, name)
    frame = frame_of(found)
    away = [station for station in found if station.x > 0]
    held = len(away) + sum(station.turned for station in away)
    held += frame != "tangent" and any(station.turned for station in found if station.x == 0)
    held -= frame == "chord"
    axial = 0 if scene.bodies[name].beam.axially_rigid else len(away) + 1
    # A mean frame makes the turn of the undeformed link itself: one of the static shapes, where there are any.
    return axial, held + modes - (frame == "mean" and held > 0)


def shapes_given(scene: Scene) -> tuple[str, ...]:
    """Coordinates of the shapes that bodies with modal data bring along, as the coupled equations name them."""
    return tuple(
        f"{name}.{kind}_{k}"
        for name, body in scene.bodies.items()
        if body.modal is not None
        for kind, count in zip(("axial", "transverse"), body.modal.counts, strict=True)
        for k in range(count)
    )
