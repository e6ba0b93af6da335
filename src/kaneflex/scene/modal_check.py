"""What a scene may ask of links that have modal data instead of a beam."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from kaneflex.scene.modal_data import ModalData
from kaneflex.scene.quantities import Address
from kaneflex.scene.recovery import STRESSES
from kaneflex.scene.scene import Scene
from kaneflex.scene.sensors import POINT_KINDS, Sensor
from kaneflex.support.errors import Problem


def modal_problems(scene: Scene) -> Iterator[Problem]:
    """Points that a file lacks, and damping that it has already; in the plane beams besides, guides and springs."""
    links = {name: body.modal for name, body in scene.bodies.items() if body.modal is not None}
    if not links:
        return
    beams = [name for name, body in scene.bodies.items() if body.elastic]
    if scene.damping is not None and not (scene.is_spatial and beams):
        reason = "links by modal data have their damping in the file"
        yield Problem("damping", None, reason, "Leave the table out")
    if "modes" in scene.solve.model_fields_set and not beams:
        reason = "links by modal data have the shapes of their file"
        yield Problem("solve.modes", scene.solve.modes, reason, "Leave it out, and export or import with fewer")
    if not scene.is_spatial:
        yield from _planar_only(scene, beams, tuple(links))
    for key, address in _addresses(scene):
        if address.body not in links or address.point not in scene.bodies[address.body].points_all:
            continue
        modal, file = links[address.body], Path(str(scene.bodies[address.body].modal_data)).name
        if address.point not in modal.points:
            reason = f"{file} has no such point: its points are {', '.join(modal.points)}"
            yield Problem(key, str(address), reason, "Add it to the file's arrays, or name another point")
            continue
        own, here = modal.places[modal.points.index(address.point)], scene.point(address)
        if modal.at(here) != modal.at(own):
            there, given = (", ".join(f"{x:.6g}" for x in place) for place in (own, here))
            reason = f"in {file} it lies at ({there}) m, here at ({given}) m"
            yield Problem(key, str(address), reason, "Give the point the file's place")


def stress_problems(scene: Scene, key: str, sensor: Sensor) -> Iterator[Problem]:
    """A stress needs shapes that move, and a file that recovers it there."""
    address = sensor.target
    assert isinstance(address, Address)
    key, body = f"{key}.stress", scene.bodies.get(address.body)
    modal = body.modal if body else None
    if body is None or modal is None:
        named = f"{address.body} has no modal data" if body else "there is no such body"
        yield Problem(key, str(address), named, "Name a body with modal data; a beam's sections have strains")
    elif address.point not in modal.stresses.places:
        known = f"its stress points are {', '.join(modal.stresses.places)}" if modal.stresses.places else "it has none"
        reason = f"{Path(str(body.modal_data)).name} has no such stress point: {known}"
        yield Problem(key, str(address), reason, "Name one of them, or add the file's arrays stress_points and stress")
    elif sensor.component not in ("mises", *STRESSES[modal.stresses.rows.shape[1]]):
        reason = f"the file has {', '.join(STRESSES[modal.stresses.rows.shape[1]])}"
        yield Problem(f"{key.rpartition('.')[0]}.component", sensor.component, reason, "Give one of these, or mises")
    elif scene.solve.preset == "rigid":
        yield Problem(key, str(address), "rigid bodies have no stresses", "Take preset coupled, or leave it out")


def section_problems(scene: Scene, key: str, sensor: Sensor, modal: ModalData) -> Iterator[Problem]:
    """Section forces need shapes that move, and a file that recovers them there; strains, sections besides."""
    address = sensor.target
    assert isinstance(address, Address)
    recovered = modal.sections.places
    if sensor.kind == "strain":
        reason = "modal data don't know the area and the moment of inertia of a section"
        yield Problem(key, str(address), reason, "Measure a stress, or the section's forces")
    elif address.point not in recovered:
        file, known = Path(str(scene.bodies[address.body].modal_data)).name, ", ".join(recovered)
        reason = f"{file} has no section forces there" + (f": it has those at {known}" if known else ", nor anywhere")
        cure = "Name a section of the import, like --section waist=0.07, or add arrays sections and section_forces"
        yield Problem(key, str(address), reason, cure)
    elif scene.solve.preset == "rigid":
        yield Problem(key, str(address), "rigid bodies by modal data have none", "Take preset coupled, or leave it out")


def _planar_only(scene: Scene, beams: Sequence[str], links: Sequence[str]) -> Iterator[Problem]:
    """What only bodies in space with modal data may have: company of beams, springs and guides."""
    for name in beams:
        reason = f"{links[0]} has modal data: in this version a scene has either these or beams"
        yield Problem(f"bodies.{name}.beam", None, reason, "Export this link, too, and give its modal data")
    for name, spring in scene.springs.items():
        for end in spring.ends:
            if end.body in links:
                reason = f"{end.body} has modal data: a spring on elastic bodies is not available in this version"
                yield Problem(f"springs.{name}.between", str(end), reason, "Attach it to a rigid body or to the ground")
    for name, joint in scene.joints.items():
        slid = [address.body for address in joint.addresses if joint.kind == "prismatic" and address.body in links]
        if slid:
            reason = f"{slid[0]} has modal data and would slide through its own deformation"
            yield Problem(f"joints.{name}.prismatic", slid[0], reason, "Let the guide hold a rigid body")


def _addresses(scene: Scene) -> Iterator[tuple[str, Address]]:
    """Every address of a point whose deformation is needed, with its key."""
    for name, joint in scene.joints.items():
        for address in joint.addresses:
            yield f"joints.{name}.{joint.kind}", address
    for name, load in scene.forces.items():
        yield f"loads.{name}.force_on", load.force_on
    for name, spring in scene.springs.items() if scene.is_spatial else ():
        for end in spring.ends:
            yield f"springs.{name}.between", end
    for name, mass in scene.masses.items():
        yield f"masses.{name}.at", mass.at
    for name, sensor in scene.sensors.items():
        if sensor.kind not in POINT_KINDS or sensor.target.body not in scene.bodies:
            continue
        yield f"sensors.{name}.{sensor.kind}", sensor.target
        for end in {"chord": ("start", "end"), "start": ("start",)}.get(sensor.relative_to, ()):
            yield f"sensors.{name}.relative_to", Address(sensor.target.body, end)
