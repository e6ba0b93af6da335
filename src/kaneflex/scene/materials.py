"""Materials of beams in a scene file: by name, or by their constants."""

from __future__ import annotations

from typing import NamedTuple

from pydantic import Field, model_validator

from kaneflex.scene.quantities import NonNegativeRatio, PositiveDensity, PositiveModulus
from kaneflex.scene.table import SceneTable
from kaneflex.support.errors import Fault, nearest


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


class Constants(NamedTuple):
    """Young's modulus E [Pa], density rho [kg/m^3], shear modulus G [Pa] and Poisson's ratio nu; None if unknown."""

    E: float | None
    rho: float | None
    G: float | None
    nu: float | None


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
