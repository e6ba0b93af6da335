"""Springs with dampers: between two points, at a revolute joint, or in space as bushings with six stiffnesses."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import ValidationInfo, field_validator, model_validator

from kaneflex.scene.parts import IN_THE_PLANE
from kaneflex.scene.quantities import Address, AddressPair, Angle, NonNegativeLength, not_negative, written
from kaneflex.scene.table import SceneTable, the_one_given
from kaneflex.support.errors import Fault
from kaneflex.support.units import DAMPING, STIFFNESS, TORSIONAL_DAMPING, TORSIONAL_STIFFNESS

Stiffness = Annotated[Any, written("a stiffness, N/m or N m/rad; for a bushing three of each", "array")]
DampingConstant = Annotated[Any, written("a damping, N s/m or N m s/rad; for a bushing three of each", "array")]
"""Numbers; six for a bushing."""


class Spring(SceneTable):
    """Linear spring and damper in parallel: `stiffness` (N/m) and `damping` (N s/m) along the line `between` two
    points, unstretched at its free `length` (m); or `torsional_at` a revolute joint, N m/rad and N m s/rad,
    unstretched at the `angle` (rad) of the second body relative to the first. In space also a `bushing` between two
    points, with three of each along x, y, z of the first body, and three about these.
    """

    between: AddressPair | None = None
    torsional_at: str | None = None
    bushing: AddressPair | None = None
    stiffness: Stiffness = 0.0
    damping: DampingConstant = 0.0
    length: NonNegativeLength = 0.0
    angle: Angle = 0.0

    @field_validator("stiffness", "damping", mode="before")
    @classmethod
    def _in_its_dimension(cls, value: object, info: ValidationInfo) -> float | tuple[float, ...]:
        linear, torsional = {
            "stiffness": (STIFFNESS, TORSIONAL_STIFFNESS),
            "damping": (DAMPING, TORSIONAL_DAMPING),
        }[info.field_name]
        if info.data.get("bushing"):
            if not isinstance(value, (list, tuple)) or len(value) != 6:
                cure = f"Write three along x, y, z and three about them, like '{linear.example}', '{torsional.example}'"
                raise Fault("a bushing has six, and only scenes in space have bushings", f"{cure}. {IN_THE_PLANE}")
            return tuple(not_negative(each, linear if k < 3 else torsional) for k, each in enumerate(value))
        return not_negative(value, torsional if info.data.get("torsional_at") else linear)

    @model_validator(mode="after")
    def _consistent(self) -> Spring:
        kind = the_one_given(self, ("between", "torsional_at", "bushing"))
        strange = {"between": ("angle",), "torsional_at": ("length",), "bushing": ("length", "angle")}[kind]
        self.refuse(strange, f"does not apply to {kind}")
        if not any((*self.stiffnesses, *self.dampings)):
            raise Fault("stiffness and damping are missing", "Give at least one of them")
        if self.ends and self.ends[0].body == self.ends[1].body:
            raise Fault("both ends are on the same body", "Name points of two bodies", below=kind)
        return self

    @property
    def ends(self) -> tuple[Address, ...]:
        """Points that the spring joins; none for a torsional spring."""
        return self.between or self.bushing or ()

    @property
    def stiffnesses(self) -> tuple[float, ...]:
        """One, or a bushing's six."""
        return self._each(self.stiffness)

    @property
    def dampings(self) -> tuple[float, ...]:
        """One, or a bushing's six."""
        return self._each(self.damping)

    def _each(self, given: float | tuple[float, ...]) -> tuple[float, ...]:
        return given if isinstance(given, tuple) else (given,) * (1 if self.bushing is None else 6)
