"""Bodies and their beams, as a scene file gives them and with every default filled in."""

from __future__ import annotations

from typing import NamedTuple

from pydantic import BaseModel, ConfigDict, Field, model_validator

from kaneflex.errors import Fault, nearest
from kaneflex.scene.quantities import (
    Angle,
    Inertia,
    Point,
    PositiveArea,
    PositiveDensity,
    PositiveLength,
    PositiveMass,
    PositiveModulus,
    PositiveSecondMoment,
    WholeNumber,
)

_SAME_MASS = 1e-6  # relative; mass and A of one beam may both be given if they agree this closely


class Material(NamedTuple):
    """Young's modulus E in Pa and density rho in kg/m^3."""

    E: float
    rho: float


MATERIALS = {
    "steel": Material(2.1e11, 7850.0),
    "aluminium": Material(7.0e10, 2700.0),
    "titanium": Material(1.1e11, 4500.0),
}


class SceneTable(BaseModel):
    """Base of every table of a scene file: frozen, and no key that it does not know."""

    model_config = ConfigDict(frozen=True, extra="forbid", ser_json_inf_nan="constants")


def _of_material(field: str):
    def default(data: dict) -> float | None:
        material = data.get("material")
        return getattr(MATERIALS[material], field) if material in MATERIALS else None

    return default


class Beam(SceneTable):
    """A planar Euler-Bernoulli beam with a uniform section along the body's length.

    `E` and `rho` come from `material` unless given; `A` may be left out where the body's mass is given.
    """

    material: str | None = None
    E: PositiveModulus = Field(default_factory=_of_material("E"), description="Young's modulus")
    rho: PositiveDensity = Field(default_factory=_of_material("rho"), description="density")
    A: PositiveArea | None = None
    I: PositiveSecondMoment
    elements: WholeNumber = 4

    @model_validator(mode="after")
    def _has_material(self) -> Beam:
        if self.material is not None and self.material not in MATERIALS:
            raise Fault("unknown material", nearest(self.material, MATERIALS), below="material")
        if self.E is None or self.rho is None:
            raise Fault(
                "neither a material nor both E and rho", f"Give material, one of {', '.join(MATERIALS)}"
            )
        return self


def _default_mass(data: dict) -> float:
    beam, length = data.get("beam"), data.get("length")
    return beam.rho * beam.A * length if beam and beam.A and length else 0.0


def _default_centre(data: dict) -> tuple[float, float]:
    return ((data.get("length") or 0.0) / 2, 0.0)


def _default_inertia(data: dict) -> float:
    return data["mass"] * (data.get("length") or 0.0) ** 2 / 12


class Pose(SceneTable):
    """Where a body of a structure that doesn't move stands: global position of its start (m) and its angle (rad)."""

    at: Point = (0.0, 0.0)
    angle: Angle = 0.0


class Body(SceneTable):
    """A body; rigid unless it has a `beam`. Its frame starts at `start`, with `end` on its x axis.

    length in m; mass in kg (left out: massless, or rho A length of its beam); centre of mass in m in the
    body's axes (half the length); inertia in kg m^2 about the centre of mass (uniform bar); further named
    points in m.
    """

    like: str | None = Field(default=None, description="another body of this scene to start from")
    length: PositiveLength | None = None
    beam: Beam | None = None
    mass: PositiveMass = Field(default_factory=_default_mass)
    centre: Point = Field(default_factory=_default_centre)
    inertia: Inertia = Field(default_factory=_default_inertia)
    pose: Pose | None = None
    points: dict[str, Point] = Field(default={})

    @model_validator(mode="after")
    def _beam_fits(self) -> Body:
        for name in self.points:
            if name in self._own_points():
                raise Fault(
                    "every body has this point already", "Choose another name", below=f"points.{name}"
                )
        if self.beam is None:
            return self
        if self.length is None:
            raise Fault("an elastic body without length", "Give its length", below="length")
        for field in ("centre", "inertia"):
            if field in self.model_fields_set:
                raise Fault("a uniform beam has its own", f"Leave {field} out", below=field)
        if self.mass == 0:
            raise Fault("neither the body's mass nor the beam's A", "Give one of them", below="beam")
        if self.beam.A is not None:
            expected = self.beam.rho * self.beam.A * self.length
            if abs(self.mass - expected) > _SAME_MASS * expected:
                reason = f"the beam's rho A length is {expected:.6g} kg"
                raise Fault(reason, "Give either mass or A", below="mass")
        return self

    def _own_points(self) -> dict[str, tuple[float, float]]:
        points = {"start": (0.0, 0.0)}
        if self.length is not None:
            points |= {"mid": (self.length / 2, 0.0), "end": (self.length, 0.0)}
        return points

    @property
    def points_all(self) -> dict[str, tuple[float, float]]:
        """Every named point, own and given, in m in the body's axes."""
        return self._own_points() | self.points

    @property
    def elastic(self) -> bool:
        return self.beam is not None

    @property
    def rho_A(self) -> float:
        """Mass per length in kg/m; elastic bodies only."""
        return self.mass / self.length

    @property
    def E_A(self) -> float:
        """Axial stiffness in N; elastic bodies only."""
        area = self.beam.A if self.beam.A is not None else self.mass / (self.beam.rho * self.length)
        return self.beam.E * area

    @property
    def E_I(self) -> float:
        """Bending stiffness in N m^2; elastic bodies only."""
        return self.beam.E * self.beam.I
