"""Checks of links with modal data instead of a beam."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from kaneflex.scene.quantities import Address
from kaneflex.scene.scene import Scene
from kaneflex.scene.sensors import POINT_KINDS, STRESSES, Sensor
from kaneflex.support.errors import Problem

if TYPE_CHECKING:
    from kaneflex.scene.modal_data import ModalData


def modal_problems(scene: Scene) -> Iterator[Problem]:
    """Problems of links with modal data: points, damping and modes; in the plane also beams, guides and springs."""
    links = {name: body.modal for name, body in scene.bodies.items() if body.modal is not None}
    beams = [name for name, body in scene.bodies.items() if body.elastic]
    if scene.damping is not None and not (scene.is_spatial and beams):
        reason = "the file of modal data gives the damping"
        yield Problem("damping", None, reason, "Leave the table out")
    if "modes" in scene.solve.model_fields_set and not beams:
        reason = "the file of modal data gives the shapes"
        yield Problem("solve.modes", scene.solve.modes, reason, "Leave it out; for fewer shapes export or import again")
    if not scene.is_spatial:
        yield from _planar_only(scene, beams, tuple(links))
    for key, address in _addresses(scene):
        if address.body not in links or address.point not in scene.bodies[address.body].points_all:
            continue
        modal, file = links[address.body], Path(str(scene.bodies[address.body].modal_data)).name
        if address.point not in modal.points:
            reason = f"{file} does not have this point; its points are {', '.join(modal.points)}"
            yield Problem(key, str(address), reason, "Add it to the file's arrays, or name another point")
            continue
        own, given_place = modal.places[modal.points.index(address.point)], scene.point(address)
        if modal.at(given_place) != modal.at(own):
            there, given = (", ".join(f"{x:.6g}" for x in place) for place in (own, given_place))
            reason = f"in {file} it lies at ({there}) m, here at ({given}) m"
            yield Problem(key, str(address), reason, "Use the position in the file")


def stress_problems(scene: Scene, key: str, sensor: Sensor) -> Iterator[Problem]:
    """Problems of a stress sensor: it needs shapes that deform, and stress recovery in the file."""
    address = sensor.target
    assert isinstance(address, Address)
    key, body = f"{key}.stress", scene.bodies.get(address.body)
    modal = body.modal if body else None
    if body is None or modal is None:
        named = f"{address.body} has no modal data" if body else "there is no such body"
        yield Problem(key, str(address), named, "Name a body with modal data, or use strain for a beam")
    elif address.point not in modal.stresses.places:
        known = f"its stress points are {', '.join(modal.stresses.places)}" if modal.stresses.places else "it has none"
        reason = f"{Path(str(body.modal_data)).name} has no such stress point: {known}"
        yield Problem(key, str(address), reason, "Name one of them, or add the file's arrays stress_points and stress")
    elif sensor.component not in ("mises", *STRESSES[modal.stresses.rows.shape[1]]):
        reason = f"the file has {', '.join(STRESSES[modal.stresses.rows.shape[1]])}"
        yield Problem(f"{key.rpartition('.')[0]}.component", sensor.component, reason, "Give one of these, or mises")
    elif scene.solve.preset == "rigid":
        yield Problem(key, str(address), "rigid bodies have no stresses", "Use preset coupled, or leave it out")


def section_problems(scene: Scene, key: str, sensor: Sensor, modal: ModalData) -> Iterator[Problem]:
    """Problems of section forces: they need shapes that deform and recovery in the file; strains also need sections."""
    address = sensor.target
    assert isinstance(address, Address)
    recovered = modal.sections.places
    if sensor.kind == "strain":
        reason = "modal data do not contain area and second moment of a section"
        yield Problem(key, str(address), reason, "Measure a stress, or the section's forces")
    elif address.point not in recovered:
        file, known = Path(str(scene.bodies[address.body].modal_data)).name, ", ".join(recovered)
        reason = f"{file} has no section forces there" + (f": it has those at {known}" if known else " or anywhere")
        cure = "Name a section of the import, like --section waist=0.07, or add arrays sections and section_forces"
        yield Problem(key, str(address), reason, cure)
    elif scene.solve.preset == "rigid":
        reason = "under rigid modal data give no section forces"
        yield Problem(key, str(address), reason, "Use preset coupled or leave it out")


def _planar_only(scene: Scene, beams: Sequence[str], links: Sequence[str]) -> Iterator[Problem]:
    """Problems of beams, springs and guides in the plane together with modal data."""
    for name in beams:
        reason = f"{links[0]} has modal data: this version cannot combine modal data with beams"
        yield Problem(f"bodies.{name}.beam", None, reason, "Export this link, too, and use its modal data")
    for name, spring in scene.springs.items():
        for end in spring.ends:
            if end.body in links:
                reason = f"{end.body} has modal data: a spring on elastic bodies is not available in this version"
                yield Problem(f"springs.{name}.between", str(end), reason, "Attach it to a rigid body or to the ground")
    for name, joint in scene.joints.items():
        slid = [address.body for address in joint.addresses if joint.kind == "prismatic" and address.body in links]
        if slid:
            reason = f"{slid[0]} has modal data: a guide cannot hold a deforming body"
            yield Problem(f"joints.{name}.prismatic", slid[0], reason, "Let the guide hold a rigid body")


def _addresses(scene: Scene) -> Iterator[tuple[str, Address]]:
    """Addresses of points whose deformation is needed, with their keys."""
    apart = {contact.entry(name) for name, contact in scene.contacts.items()}
    apart |= {f"springs.{name}.between" for name in ({} if scene.is_spatial else scene.springs)}
    yield from ((entry, address) for entry, address in scene.acting if entry not in apart)
    for name, sensor in scene.sensors.items():
        if sensor.kind not in POINT_KINDS or sensor.target.body not in scene.bodies:
            continue
        yield f"sensors.{name}.{sensor.kind}", sensor.target
        for end in {"chord": ("start", "end"), "start": ("start",)}.get(sensor.relative_to, ()):
            yield f"sensors.{name}.relative_to", Address(sensor.target.body, end)
