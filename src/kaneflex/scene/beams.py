"""Beams, as a scene file gives them: material, section, theory and mesh."""

from __future__ import annotations

from typing import Literal, NamedTuple

from pydantic import Field, model_validator

from kaneflex.errors import Fault, nearest
from kaneflex.scene.profile import Piece, Profile
from kaneflex.scene.quantities import (
    NonNegativeRatio,
    PositiveArea,
    PositiveDensity,
    PositiveLength,
    PositiveModulus,
    PositiveSecondMoment,
    WholeNumber,
)
from kaneflex.scene.sections import SectionNumbers, Shape, ShearCoefficient
from kaneflex.scene.table import SceneTable


class Material(NamedTuple):
    """Young's modulus E in Pa, density rho in kg/m^3 and Poisson's ratio nu."""

    E: float
    rho: float
    nu: float


MATERIALS = {
    "steel": Material(2.1e11, 7850.0, 0.3),
    "aluminium": Material(7.0e10, 2700.0, 0.33),
    "titanium": Material(1.1e11, 4500.0, 0.34),
}


def _of_material(field: str):
    def default(data: dict) -> float | None:
        material = data.get("material")
        return getattr(MATERIALS[material], field) if material in MATERIALS else None

    return default


class Sectioned(SceneTable):
    """A section by area `A` and second moment `I`, or by its shape: `section`, at the far end `taper`.

    Between the two the shape's dimensions change linearly. `kappa` is the shear coefficient; a shape has its own.
    """

    A: PositiveArea | None = None
    I: PositiveSecondMoment | None = None
    section: Shape | None = None
    taper: Shape | None = None
    kappa: ShearCoefficient | None = None

    @model_validator(mode="after")
    def _one_section(self) -> Sectioned:
        for field in ("A", "I"):
            if self.section is not None and getattr(self, field) is not None:
                raise Fault("the shape of the section has its own", f"Leave {field} out", below=field)
        if self.taper is not None and self.section is None:
            raise Fault("no section to start from", "Give section, too, with the same shape", below="taper")
        if self.taper is not None and self.taper.kind != self.section.kind:
            reason = f"a {self.section.kind} does not become a {self.taper.kind}"
            raise Fault(reason, "Give both ends the same shape", below="taper")
        return self

    def piece(self, start: float, stop: float, nu: float | None, area: float | None = None) -> Piece:
        """The stretch of beam from start to stop [m]; `area` stands for an `A` that is left out."""
        if self.section is None:

            def given(A: float, I: float) -> SectionNumbers:
                return SectionNumbers(A, I, self.kappa)

            dimensions = (self.A if self.A is not None else area, self.I)
            return Piece(start, stop, given, dimensions, dimensions)

        def shaped(*dimensions: float) -> SectionNumbers:
            numbers = self.section.numbers_of(dimensions, nu)
            return numbers if self.kappa is None else numbers._replace(kappa=self.kappa)

        last = self.section if self.taper is None else self.taper
        return Piece(start, stop, shaped, self.section.dimensions, last.dimensions)


class Segment(Sectioned):
    """A stretch of a beam up to the distance `to` from the body's start; the last one ends where the body ends."""

    to: PositiveLength | None = None

    @model_validator(mode="after")
    def _whole_section(self) -> Segment:
        if self.section is None and (self.A is None or self.I is None):
            raise Fault("no section", "Give section, or both A and I")
        return self


class Beam(Sectioned):
    """A planar beam along the body's length: one section, tapered or not, or `segments` with a section each.

    `E`, `rho` and Poisson's ratio `nu` come from `material` unless given; `G` stands for E/(2 (1 + nu)). `A` may be
    left out where the body's mass is given. `theory`: Euler-Bernoulli, with the sections' rotary inertia Rayleigh,
    with shear besides Timoshenko. An `axially_rigid` beam does not stretch. `shapes` are those of preset coupled.
    """

    material: str | None = None
    E: PositiveModulus = Field(default_factory=_of_material("E"), description="Young's modulus")
    rho: PositiveDensity = Field(default_factory=_of_material("rho"), description="density")
    nu: NonNegativeRatio = Field(default_factory=_of_material("nu"), description="Poisson's ratio")
    G: PositiveModulus | None = Field(default=None, description="shear modulus")
    segments: dict[str, Segment] = Field(default={})
    theory: Literal["euler-bernoulli", "rayleigh", "timoshenko"] = "euler-bernoulli"
    axially_rigid: bool = False
    elements: WholeNumber = 4
    shapes: Literal["craig-bampton", "sine", "clamped-free", "polynomial"] = "craig-bampton"

    @model_validator(mode="after")
    def _has_material(self) -> Beam:
        if self.material is not None and self.material not in MATERIALS:
            raise Fault("unknown material", nearest(self.material, MATERIALS), below="material")
        if self.E is None or self.rho is None:
            raise Fault("neither a material nor both E and rho", f"Give material, one of {', '.join(MATERIALS)}")
        if self.nu is not None and self.nu > 0.5:
            raise Fault("no solid has a Poisson's ratio above 0.5", "Write one like 0.3", below="nu")
        if self.G is not None and "nu" in self.model_fields_set:
            raise Fault("nu and G exclude each other", "Give one of them", below="G")
        return self

    @model_validator(mode="after")
    def _has_section(self) -> Beam:
        if not self.segments:
            if self.section is None and self.I is None:
                raise Fault("missing", "Give I, or a section by its shape", below="I")
            return self
        for field in ("A", "I", "section", "taper", "kappa"):
            if getattr(self, field) is not None:
                raise Fault("every segment has its own", f"Leave {field} out, or the segments", below=field)
        reached = 0.0
        *inner, last = self.segments
        for name in inner:
            to = self.segments[name].to
            if to is None or to <= reached:
                reason = "a segment ends behind the one before it"
                raise Fault(reason, "Give the distance from the body's start", below=f"segments.{name}.to")
            reached = to
        if self.segments[last].to is not None:
            raise Fault("the last segment ends with the body", "Leave to out", below=f"segments.{last}.to")
        return self

    @model_validator(mode="after")
    def _shears(self) -> Beam:
        if self.theory != "timoshenko":
            return self
        if self.nu is None and self.G is None:
            raise Fault("a Timoshenko beam needs a shear modulus", "Give nu or G", below="theory")
        for part in (self, *self.segments.values()):
            if part.section is None and part.kappa is None and part.I is not None:
                cure = "Give kappa, or a section by its shape"
                raise Fault("a Timoshenko beam needs a shear coefficient", cure, below="theory")
        return self

    @property
    def poisson(self) -> float | None:
        """Poisson's ratio, where it or the shear modulus is known."""
        return self.nu if self.G is None else self.E / (2 * self.G) - 1

    @property
    def has_area(self) -> bool:
        """Whether the beam's mass follows from its sections."""
        return self.A is not None or self.section is not None or bool(self.segments)

    @property
    def rotary(self) -> bool:
        """Whether the theory knows the rotary inertia of the sections."""
        return self.theory != "euler-bernoulli"

    def profile(self, length: float, mass: float) -> Profile:
        """What the beam is made of along its length [m]; where there is no area it follows from the mass [kg]."""
        nu = self.poisson
        pieces, start = [], 0.0
        for segment in self.segments.values():
            stop = length if segment.to is None else segment.to
            pieces.append(segment.piece(start, stop, nu))
            start = stop
        area = mass / (self.rho * length)
        pieces = pieces or [self.piece(0.0, length, nu, area)]
        G = self.G if self.G is not None or nu is None else self.E / (2 * (1 + nu))
        return Profile(tuple(pieces), self.E, self.rho, G, self.rotary, self.theory == "timoshenko")

    def structure(self) -> dict[str, str | bool]:
        """What the equations depend on beyond those of a uniform Euler-Bernoulli beam."""
        found: dict[str, str | bool] = {}
        if self.rotary:
            found["theory"] = self.theory
        if self.segments or self.taper is not None:
            found["varying"] = True
        return found
