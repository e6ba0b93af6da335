"""Floating frames of elastic links, and numbers of their modes in the coupled equations.

Both follow from the positions of joints, loads and masses, before any number of the beam is known.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.meshes import SAME, mesh
from kaneflex.mechanism.rigid_bodies import prescribed_bodies
from kaneflex.scene.options import modes_of
from kaneflex.scene.quantities import Address
from kaneflex.scene.scene import Scene
from kaneflex.support.kept import Kept

IN_THE_MEAN = ("chord", "free")
"""Kinds of frames in which a link has no mean axial displacement, weighted by mass."""


@dataclass
class Station:
    """Point of a link's axis at which joints, loads or masses act, or a free end.

    Attributes
    ----------
    x : float
        Distance from the link's start [m].
    joined, turned, clamped : bool
        Flags: a joint acts; a moment can rotate the section; the rotation is prescribed.
    """

    x: float
    joined: bool = False
    turned: bool = False
    clamped: bool = False


_STATIONS: Kept[Scene, dict[str, list[Station]]] = Kept()


def stations(scene: Scene, link: str) -> list[Station]:
    """Stations of a link from its start to its end."""
    known = _STATIONS.of(scene, dict)
    if link not in known:
        known[link] = _stations(scene, link)
    return known[link]


def _stations(scene: Scene, link: str) -> list[Station]:
    found: list[Station] = []
    length = scene.bodies[link].length
    placed = prescribed_bodies(mechanism_of(scene))

    def at(address: Address) -> Station:
        x = scene.point(address)[0]
        for station in found:
            if abs(station.x - x) <= SAME * length:
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
                station.turned |= stiff or name in torques or joint.has_backlash
                station.clamped |= stiff and other.body in placed
    for address in scene.acting_on(link):
        at(address)
    for mass in scene.masses.values():
        if mass.at.body == link:
            at(mass.at).turned |= bool(mass.inertia)
    if not any(station.joined for station in found):
        at(Address(link, "start"))
        at(Address(link, "end"))
    return sorted(found, key=lambda station: station.x)


class Frame(NamedTuple):
    """Floating frame of a link.

    Attributes
    ----------
    kind : str
        Condition on its x axis: "tangent" to the link at a joint; "chord" through the first and the last joint; "mean":
        bending has no angular momentum about the only joint (Buckens); "free": neither angular nor linear momentum,
        for a link without joints.
    at : float
        Fixed point of the link in the frame [m from the start]: that joint. A chord and a free frame fix the mean
        axial displacement instead, independent of the direction of the link.
    to : float
        Last joint [m]; for a free link its end.
    """

    kind: str
    at: float
    to: float


def frame_of(stations_of_link: list[Station]) -> Frame:
    """Floating frame of a link by its joints, independent of which end is its start.

    Shapes must not be able to rotate the frame of a freely rotating link, or the mass matrix would be singular.
    """
    joined = [station for station in stations_of_link if station.joined]
    if not joined:
        return Frame("free", stations_of_link[0].x, stations_of_link[-1].x)
    clamped = [station for station in joined if station.clamped]
    if len(clamped) == 1:
        return Frame("tangent", clamped[0].x, clamped[0].x)
    return Frame("chord" if len(joined) > 1 else "mean", joined[0].x, joined[-1].x)


def most_modes(scene: Scene, name: str) -> int:
    """Number of fixed-interface modes that a link's elements have."""
    beam = scene.bodies[name].beam
    assert beam is not None
    found = stations(scene, name)
    frame = frame_of(found)
    away = [station for station in found if station.x not in (frame.at, frame.to)]
    static = len(away) + sum(station.turned for station in found if frame.kind != "tangent" or station in away)
    # a mean frame replaces one static shape, if there are any, by the rotation of the undeformed link
    return 2 * len(mesh(scene, name, beam.elements)) - 2 - static + (frame.kind == "mean" and static > 0)


def link_modes(scene: Scene, name: str) -> int:
    """Number of fixed-interface modes of a link in the coupled equations; at most the number that its elements have."""
    asked, beam = modes_of(scene), scene.bodies[name].beam
    assert beam is not None
    if scene.solve.modes != "all" and "modes" in scene.solve.model_fields_set:
        return asked
    return min(asked, most_modes(scene, name) if beam.shapes == "craig-bampton" else beam.elements)


def axial_modes(modes: int, elements: int, stations_of_link: int) -> int:
    """Number of axial modes of a link: one per three bending modes (rounded up), at most what its elements have."""
    return min(-(-modes // 3), max(0, elements + 1 - stations_of_link))


def shapes_given(scene: Scene) -> tuple[str, ...]:
    """Names of the shape coordinates of bodies with modal data in the coupled equations."""
    return tuple(
        f"{name}.{kind}_{k}"
        for name, body in scene.bodies.items()
        if body.modal is not None
        for kind, count in zip(("axial", "transverse"), body.modal.counts, strict=True)
        for k in range(count)
    )
