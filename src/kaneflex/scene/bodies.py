"""Bodies of a scene file, with all defaults filled in."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

from pydantic import Field, field_validator, model_validator

from kaneflex.scene.beams import Beam
from kaneflex.scene.quantities import BodyInertia, Point, PositiveLength, PositiveMass, Vector
from kaneflex.scene.sections import Profile
from kaneflex.scene.table import SceneTable, late
from kaneflex.support.errors import Fault

if TYPE_CHECKING:
    from kaneflex.scene.modal_data import ModalData
    from kaneflex.scene.poses import Free, Pose, Rotation
else:
    Free, Pose, Rotation = late("kaneflex.scene.poses", "Free", "Pose", "Rotation")

_SAME_MASS = 1e-6  # relative difference permitted between a beam's mass and rho A length if both are given


def _modal(path: object) -> ModalData | None:
    """Modal data in a file, if one is named."""
    if not isinstance(path, str):
        return None
    from kaneflex.scene.modal_data import read_modal_data

    return read_modal_data(path)


def _default_length(data: dict) -> float | None:
    modal = _modal(data.get("modal_data"))
    return modal.length if modal else None


def _by_default(data: dict) -> tuple[float, tuple[float, ...], float | tuple[float, ...]]:
    """Mass, centre and inertia of a body: those of its modal data or its beam, else of a uniform bar."""
    modal, beam, length, mass = (data.get(key) for key in ("modal_data", "beam", "length", "mass"))
    if (known := _modal(modal)) is not None:
        return known.rigid
    length, mass = length or 0.0, mass or 0.0
    if beam is None or not length or not (beam.has_area or mass):
        return mass, (length / 2, 0.0), mass * length**2 / 12
    profile = beam.profile(length, mass)
    whole, rotary = profile.inertia(length), profile.rotary_inertia(length)
    if not profile.varying:
        return whole.mass, (length / 2, 0.0), (mass or whole.mass) * length**2 / 12 + rotary
    return whole.mass, (whole.first / whole.mass, 0.0), whole.second - whole.first**2 / whole.mass + rotary


class Body(SceneTable):
    """Body; rigid unless it has a `beam` or `modal_data`. Its frame starts at `start`, with `end` on its x axis.

    length in m; mass in kg (default: 0, or rho A length of its beam); centre of mass in m in the body's axes
    (default: half the length); inertia in kg m^2 about the centre of mass (default: uniform bar), in space
    [J_x, J_y, J_z] or [J_x, J_y, J_z, J_xy, J_yz, J_zx] in the body's axes; further named points in m. In space
    `rotation` is the orientation at zero joint coordinates, close to the one in which its loops close at the start.
    """

    like: str | None = Field(default=None, description="another body of this scene to start from")
    modal_data: str | None = Field(default=None, description="npz file of a link's modal data")
    length: PositiveLength | None = Field(default_factory=_default_length)
    beam: Beam | None = None
    mass: PositiveMass = Field(default_factory=lambda data: _by_default(data)[0])
    centre: Point = Field(default_factory=lambda data: _by_default(data)[1])
    inertia: BodyInertia = Field(default_factory=lambda data: _by_default(data)[2])
    rotation: Rotation | None = None
    pose: Pose | None = None
    free: Free | None = None
    points: dict[str, Point] = Field(default={})

    @field_validator("modal_data")
    @classmethod
    def _readable(cls, path: str | None) -> str | None:
        _modal(path)
        return path

    @model_validator(mode="after")
    def _modal_data_fit(self) -> Body:
        if self.modal is None:
            return self
        for field in ("beam", "mass", "centre", "inertia", "pose"):
            self.refuse((field,), "cannot be combined with modal_data", f"Leave {field} or modal_data out")
        if abs(self.length - self.modal.length) > _SAME_MASS * self.length:
            reason = f"modal_data is of a link of {self.modal.length:.6g} m"
            raise Fault(reason, "Leave length out", below="length")
        return self

    @model_validator(mode="after")
    def _beam_fits(self) -> Body:
        for name in self.points:
            if name in self._own_points():
                raise Fault("every body has this point", "Choose another name", below=f"points.{name}")
        if self.beam is None:
            return self
        if self.length is None:
            raise Fault("an elastic body without length", "Give its length", below="length")
        for field in ("centre", "inertia"):
            self.refuse((field,), "a uniform beam gives it already", f"Leave {field} out")
        if self.mass == 0:
            raise Fault("neither the body's mass nor the beam's A", "Give one of them", below="beam")
        for name, segment in self.beam.segments.items():
            if segment.to is not None and segment.to >= self.length:
                reason = "the segment reaches the body's end"
                raise Fault(reason, "Leave out `to` and later segments", below=f"beam.segments.{name}.to")
        if self.beam.has_area:
            expected = self.beam.profile(self.length, self.mass).inertia(self.length).mass
            if abs(self.mass - expected) > _SAME_MASS * expected:
                reason = f"the beam's rho A length is {expected:.6g} kg"
                cure = "Give either mass or A" if self.beam.A is not None else "Leave mass out: sections give it"
                raise Fault(reason, cure, below="mass")
        return self

    def _own_points(self) -> dict[str, tuple[float, float]]:
        points = {"start": (0.0, 0.0)}
        if self.length is not None:
            points |= {"mid": (self.length / 2, 0.0), "end": (self.length, 0.0)}
        return points

    @cached_property
    def points_all(self) -> dict[str, Vector]:
        """All named points in m in the body's axes: the standard ones, those of modal data and those given."""
        own, modal = self._own_points(), self.modal
        imported = zip(modal.points, modal.places.tolist(), strict=True) if modal is not None else ()
        return own | {name: tuple(place) for name, place in imported if name not in own} | self.points

    @cached_property
    def points_named(self) -> dict[str, Vector]:
        """Named points in m beyond those that every body has."""
        return {name: place for name, place in self.points_all.items() if name not in self._own_points()}

    @property
    def elastic(self) -> bool:
        return self.beam is not None

    @property
    def deforms(self) -> bool:
        """True if the body has a beam or modal data."""
        return self.beam is not None or self.modal is not None

    @property
    def says_a_file(self) -> bool:
        return self.modal_data is not None

    @cached_property
    def modal(self) -> ModalData | None:
        """Modal data of the link; None for a beam or a rigid body."""
        return _modal(self.modal_data)

    @cached_property
    def profile(self) -> Profile:
        """Profile of the beam along its length, scaled to the body's mass; elastic bodies only."""
        return self.beam.profile(self.length, self.mass).of_mass(self.mass)

    @cached_property
    def first_element(self) -> dict[str, float]:
        """Parameters of the beam's first element; elastic bodies only."""
        return self.profile.element(0.0, self.length / self.beam.elements)

    def without(self, *, rotary: bool, shear: bool) -> Body:
        """Body with a simpler beam theory, see :meth:`Beam.without`; its inertia follows."""
        if self.beam is None or self.beam.without(rotary=rotary, shear=shear) == self.beam:
            return self
        given = {name: getattr(self, name) for name in self.model_fields_set}
        return Body(**given | {"beam": self.beam.without(rotary=rotary, shear=shear)})

    @property
    def rho_A(self) -> float:
        """Mass per length in kg/m, the mean if the section varies; elastic bodies only."""
        return self.mass / self.length

    @property
    def E_A(self) -> float:
        """Axial stiffness in N, the mean if the section varies; elastic bodies only."""
        return self.profile.element(0.0, self.length)["E_A"]

    @property
    def E_I(self) -> float:
        """Bending stiffness in N m^2, the mean if the section varies; elastic bodies only."""
        return self.profile.element(0.0, self.length)["E_I"]
