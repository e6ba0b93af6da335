"""Beams of a scene file: material, section, theory and mesh; damping of elastic bodies."""

from __future__ import annotations

from functools import cached_property, partial
from typing import TYPE_CHECKING, Literal, NamedTuple

from pydantic import Field, StrictBool, model_validator

from kaneflex.scene.quantities import (
    FrequencyPair,
    NonNegativeRatio,
    NonNegativeViscosity,
    PositiveArea,
    PositiveDensity,
    PositiveLength,
    PositiveModulus,
    PositiveSecondMoment,
    Ratios,
    WholeNumber,
)
from kaneflex.scene.sections import Constants, Piece, Profile, SectionNumbers, ShearCoefficient
from kaneflex.scene.table import SceneTable, first_given, late, the_one_given
from kaneflex.support.errors import Fault, nearest

if TYPE_CHECKING:
    from kaneflex.scene.shapes import Shape
else:
    (Shape,) = late("kaneflex.scene.shapes", "Shape")

_THEORIES = {
    "euler-bernoulli": (False, False),
    "rayleigh": (True, False),
    "shear": (False, True),
    "timoshenko": (True, True),
}
"""Theory -> (has rotary inertia, has shear); names as in Han, Benaroya & Wei (1999), J. Sound Vib. 225."""


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


class Made(SceneTable):
    """Material by name, by its constants, or both.

    `E`, `rho` and Poisson's ratio `nu` come from `material` unless given; the default of `G` is E/(2 (1 + nu)).
    """

    material: str | None = None
    E: PositiveModulus = Field(default_factory=_of_material("E"), description="Young's modulus")
    rho: PositiveDensity = Field(default_factory=_of_material("rho"), description="density")
    nu: NonNegativeRatio = Field(default_factory=_of_material("nu"), description="Poisson's ratio")
    G: PositiveModulus | None = Field(default=None, description="shear modulus")

    @model_validator(mode="after")
    def _is_a_material(self) -> Made:
        if self.material is not None and self.material not in MATERIALS:
            raise Fault("unknown material", nearest(self.material, MATERIALS), below="material")
        if self.nu is not None and self.nu > 0.5:
            raise Fault("no solid has a Poisson's ratio above 0.5", "Write one like 0.3", below="nu")
        if self.G is not None and "nu" in self.model_fields_set:
            raise Fault("nu and G exclude each other", "Give one of them", below="G")
        return self

    def constants(self, beam: Made | None = None) -> Constants:
        """Constants of a segment; missing ones are the beam's, where G and nu count as one."""
        E = self.E if self.E is not None or beam is None else beam.E
        rho = self.rho if self.rho is not None or beam is None else beam.rho
        elastic = self if beam is None or self.G is not None or self.nu is not None else beam
        if elastic.G is not None:
            return Constants(E, rho, elastic.G, None if E is None else E / (2 * elastic.G) - 1)
        G = None if E is None or elastic.nu is None else E / (2 * (1 + elastic.nu))
        return Constants(E, rho, G, elastic.nu)


class Sectioned(Made):
    """Material and section: by area `A` and second moment `I`, or by shapes `section` and, at the far end, `taper`.

    Dimensions of a shape vary linearly between the two ends; with `A_end` and `I_end` area and second moment do.
    `kappa` is the shear coefficient; a shape has its own. In space `I_y` (int z^2 dA, bending about y), `I_z`
    (int y^2 dA) and `J` (Saint-Venant's torsion constant) replace `I`; a shape's height lies along y.
    """

    A: PositiveArea | None = None
    I: PositiveSecondMoment | None = None
    I_y: PositiveSecondMoment | None = None
    I_z: PositiveSecondMoment | None = None
    J: PositiveSecondMoment | None = None
    A_end: PositiveArea | None = Field(default=None, description="A at the far end; linear in between")
    I_end: PositiveSecondMoment | None = Field(default=None, description="I at the far end; linear in between")
    section: Shape | None = None
    taper: Shape | None = None
    kappa: ShearCoefficient | None = None

    @model_validator(mode="after")
    def _one_section(self) -> Sectioned:
        for field in ("A", "I", *_IN_SPACE, "A_end", "I_end"):
            if self.section is not None and getattr(self, field) is not None:
                raise Fault("the section's shape gives it already", f"Leave {field} out", below=field)
        if any(given := [getattr(self, field) for field in _IN_SPACE]):
            own = "a section in space has I_y, I_z and J, one in the plane only I"
            if self.I is not None:
                beside = " and ".join(field for field, value in zip(_IN_SPACE, given, strict=True) if value)
                raise Fault(own, f"Leave I out in space, {beside} in the plane", below="I")
            if None in given:
                missing = _IN_SPACE[given.index(None)]
                raise Fault(f"missing: {own}", "Give all three in space, I in the plane", below=missing)
        for field in ("A", "I"):
            if getattr(self, f"{field}_end") is not None and getattr(self, field) is None:
                raise Fault(f"{field} is missing", f"Give {field}, too", below=f"{field}_end")
        if self.taper is not None and self.section is None:
            raise Fault("section is missing", "Give section, too, with the same shape", below="taper")
        if self.taper is not None and self.taper.kind != self.section.kind:
            reason = f"the taper from {self.section.kind} to {self.taper.kind} changes the shape"
            raise Fault(reason, "Give both ends the same shape", below="taper")
        return self

    @property
    def tapered(self) -> bool:
        """True if the section at the far end differs."""
        return not (self.taper is None and self.A_end is None and self.I_end is None)

    def piece(self, start: float, stop: float, made_of: Constants, area: float | None = None) -> Piece:
        """Piece of the beam from start to stop [m]; `area` replaces a missing `A`."""
        if self.section is not None:
            last = self.section if self.taper is None else self.taper
            shaped = partial(_shaped, self.section, made_of.nu, self.kappa)
            return Piece(start, stop, shaped, self.section.dimensions, last.dimensions, made_of, shape=self.section)
        A, I = self.A if self.A is not None else area, self.I if self.I_z is None else self.I_z
        assert A is not None and I is not None  # checked with the scene
        A_end, I_end = A if self.A_end is None else self.A_end, I if self.I_end is None else self.I_end
        I_y, J = self.I_y or 0.0, self.J or 0.0
        numbers = partial(SectionNumbers, k_y=self.kappa, k_z=self.kappa)
        return Piece(start, stop, numbers, (A, I_y, I, J), (A_end, I_y, I_end, J), made_of)


_IN_SPACE = ("I_y", "I_z", "J")


# At module level, so that a scene can be pickled and sent to other processes.


def _shaped(section: Shape, nu: float | None, kappa: float | None, *dimensions: float) -> SectionNumbers:
    numbers = section.numbers_of(dimensions, nu)
    return numbers if kappa is None else numbers._replace(k_y=kappa, k_z=kappa)


class Segment(Sectioned):
    """Segment of a beam up to the distance `to` from the body's start; the last one ends at the body's end.

    Material entries that are not given are the beam's.
    """

    to: PositiveLength | None = None

    @model_validator(mode="after")
    def _whole_section(self) -> Segment:
        if self.section is None and (self.A is None or (self.I is None and self.I_z is None)):
            raise Fault("no section", "Give section, or both A and I")
        return self


class Beam(Sectioned):
    """Beam along the body's length: one section, tapered or not, or `segments` with one section each.

    `A` may be omitted if the body's mass is given. `theory`: euler-bernoulli; rayleigh adds the sections' rotary
    inertia, shear adds shear, timoshenko adds both. An `axially_rigid` beam does not stretch. `shapes` apply to preset
    coupled. `yield_strength` serves only to print stresses as shares of it.
    """

    segments: dict[str, Segment] = Field(default={})
    theory: Literal["euler-bernoulli", "rayleigh", "shear", "timoshenko"] = "euler-bernoulli"
    axially_rigid: StrictBool = False
    elements: WholeNumber = 4
    shapes: Literal["craig-bampton", "sine", "clamped-free", "polynomial"] = "craig-bampton"
    yield_strength: PositiveModulus | None = Field(default=None, description="compared with the largest stress")

    @model_validator(mode="after")
    def _has_material(self) -> Beam:
        for below, made_of in self._constants().items():
            if made_of.E is None or made_of.rho is None:
                cure = f"Give material, one of {', '.join(MATERIALS)}"
                raise Fault("neither a material nor both E and rho", cure, below=below)
        return self

    @model_validator(mode="after")
    def _has_section(self) -> Beam:
        if not self.segments:
            if self.section is None and self.I is None and self.I_z is None:
                raise Fault("missing", "Give I, or a section by its shape", below="I")
            return self
        for field in ("A", "I", *_IN_SPACE, "A_end", "I_end", "section", "taper", "kappa"):
            if getattr(self, field) is not None:
                raise Fault("every segment gives its own", f"Leave {field} out, or the segments", below=field)
        reached = 0.0
        *inner, last = self.segments
        for name in inner:
            to = self.segments[name].to
            if to is None or to <= reached:
                reason = "a segment must end beyond the previous one"
                raise Fault(reason, "Give the distance from the body's start", below=f"segments.{name}.to")
            reached = to
        if self.segments[last].to is not None:
            raise Fault("the last segment ends at the body's end", "Leave out `to`", below=f"segments.{last}.to")
        return self

    @model_validator(mode="after")
    def _shears(self) -> Beam:
        if not self.shear:
            return self
        kind = f"a {self.theory.capitalize() if self.rotary else self.theory} beam"
        if any(made_of.G is None for made_of in self._constants().values()):
            raise Fault(f"{kind} needs a shear modulus", "Give nu or G", below="theory")
        for part in (self, *self.segments.values()):
            given = part.I is not None or part.I_z is not None
            if part.section is None and part.kappa is None and given:
                cure = "Give kappa, or a section by its shape"
                raise Fault(f"{kind} needs a shear coefficient", cure, below="theory")
        return self

    @property
    def sections(self) -> dict[str, Sectioned]:
        """Parts with a section of their own, by key in the body: the segments, or the whole beam."""
        return {f"beam.segments.{name}": segment for name, segment in self.segments.items()} or {"beam": self}

    def made_of(self, part: Sectioned) -> Constants:
        """Material of one of :attr:`sections`."""
        return self.constants() if part is self else part.constants(self)

    def _constants(self) -> dict[str | None, Constants]:
        """Materials of the segments by key, or of the whole beam."""
        if not self.segments:
            return {None: self.constants()}
        return {f"segments.{name}": segment.constants(self) for name, segment in self.segments.items()}

    @property
    def has_area(self) -> bool:
        """True if the beam's mass follows from its sections."""
        return self.A is not None or self.section is not None or bool(self.segments)

    @property
    def rotary(self) -> bool:
        """True if the theory includes rotary inertia of the sections."""
        return _THEORIES[self.theory][0]

    @property
    def shear(self) -> bool:
        """True if the theory includes shear of the sections."""
        return _THEORIES[self.theory][1]

    def without(self, *, rotary: bool, shear: bool) -> Beam:
        """Beam with the theory that omits rotary inertia, or shear."""
        kept = (self.rotary and not rotary, self.shear and not shear)
        theory = next(name for name, knows in _THEORIES.items() if knows == kept)
        return self.model_copy(update={"theory": theory})

    def profile(self, length: float, mass: float) -> Profile:
        """Profile of the beam along its length [m]; a missing area follows from the mass [kg]."""
        pieces, start = [], 0.0
        for segment in self.segments.values():
            stop = length if segment.to is None else segment.to
            pieces.append(segment.piece(start, stop, segment.constants(self)))
            start = stop
        if not pieces:
            made_of = self.constants()
            pieces = [self.piece(0.0, length, made_of, mass / (made_of.rho * length))]
        return Profile(tuple(pieces), self.rotary, self.shear)

    def structure(self) -> dict[str, str | bool]:
        """Features of the beam's equations beyond a uniform Euler-Bernoulli beam."""
        found: dict[str, str | bool] = {}
        if self.rotary or self.shear:
            found["theory"] = "timoshenko" if self.shear else self.theory  # rotary inertia is then zero
        if self.segments or self.tapered:
            found["varying"] = True
        return found


class Rayleigh(SceneTable):
    """Rayleigh damping C = alpha M + beta K with the damping `ratio` at the two frequencies `at` (Hz)."""

    ratio: NonNegativeRatio
    at: FrequencyPair


class ModalDamping(SceneTable):
    """Modal damping: one ratio for all modes, or one per mode, the last for the rest; or Adams' ratios by frequency."""

    ratio: Ratios


class Viscous(SceneTable):
    """Viscous damping as in the paper: `mu` is a force per length and velocity, N s/m^2."""

    mu: NonNegativeViscosity


class Damping(SceneTable):
    """Damping of the elastic bodies; exactly one of the three models."""

    rayleigh: Rayleigh | None = None
    modal: ModalDamping | None = None
    viscous: Viscous | None = None

    @model_validator(mode="after")
    def _exactly_one(self) -> Damping:
        the_one_given(self, ("rayleigh", "modal", "viscous"))
        return self

    @cached_property
    def kind(self) -> str:
        return first_given(self, ("rayleigh", "modal", "viscous"))
