"""Floating frames of elastic links, and numbers of their modes in the coupled equations.

Both follow from the positions of joints, loads and masses, before any number of the beam is known.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from kaneflex.mechanism.mechanism import NumericMechanism
from kaneflex.mechanism.numbers import SAME, mesh
from kaneflex.mechanism.rigid_bodies import prescribed_bodies
from kaneflex.support.weak_cache import WeakCache

if TYPE_CHECKING:
    from kaneflex.scene.bodies import Body

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


_STATIONS: WeakCache[NumericMechanism, dict[str, list[Station]]] = WeakCache()


def stations(mechanism: NumericMechanism, link: str) -> list[Station]:
    """Stations of a link from its start to its end."""
    known = _STATIONS.of(mechanism, dict)
    if link not in known:
        known[link] = _stations(mechanism, link)
    return known[link]


def _stations(mechanism: NumericMechanism, link: str) -> list[Station]:
    found: list[Station] = []
    length, placed = mechanism.points[link]["end"][0], prescribed_bodies(mechanism)

    def at(x: float) -> Station:
        for station in found:
            if abs(station.x - x) <= SAME * length:
                return station
        found.append(Station(x))
        return found[-1]

    torques = {each.joint for of in (mechanism.loads, mechanism.springs) for each in of.values()}
    for name, joint in mechanism.joints.items():
        stiff = joint.kind != "revolute" or name in mechanism.prescribed
        for own, other in (joint.sides, joint.sides[::-1]):
            if own.body == link:
                station = at(own.at[0])
                station.joined = True
                station.turned |= stiff or name in torques or name in mechanism.backlash
                station.clamped |= stiff and other.body in placed
    for side in mechanism.acting_on(link):
        at(side.at[0])
    for mass in mechanism.masses.values():
        if mass.point.body == link:
            at(mass.point.at[0]).turned |= bool(mass.inertia)
    if not any(station.joined for station in found):
        at(0.0)
        at(length)
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


def most_modes(mechanism: NumericMechanism, name: str) -> int:
    """Number of fixed-interface modes that a link's elements have."""
    beam = mechanism.deforming[name].beam
    assert beam is not None
    found = stations(mechanism, name)
    frame = frame_of(found)
    away = [station for station in found if station.x not in (frame.at, frame.to)]
    static = len(away) + sum(station.turned for station in found if frame.kind != "tangent" or station in away)
    # a mean frame replaces one static shape, if there are any, by the rotation of the undeformed link
    return 2 * len(mesh(mechanism, name, beam.elements)) - 2 - static + (frame.kind == "mean" and static > 0)


def link_modes(mechanism: NumericMechanism, name: str, modes: int, limited: bool) -> int:
    """Number of fixed-interface modes of a link in the coupled equations, ``limited`` to those that its elements have.
    """
    beam = mechanism.deforming[name].beam
    if not limited:
        return modes
    assert beam is not None
    return min(modes, most_modes(mechanism, name) if beam.shapes == "craig-bampton" else beam.elements)


def axial_modes(modes: int, elements: int, stations_of_link: int) -> int:
    """Number of axial modes of a link: one per three bending modes (rounded up), at most what its elements have."""
    return min(-(-modes // 3), max(0, elements + 1 - stations_of_link))


def shapes_given(deforming: Mapping[str, Body]) -> tuple[str, ...]:
    """Names of the shape coordinates of bodies with modal data in the coupled equations."""
    return tuple(
        f"{name}.{kind}_{k}"
        for name, body in deforming.items()
        if body.modal is not None
        for kind, count in zip(("axial", "transverse"), body.modal.counts, strict=True)
        for k in range(count)
    )
