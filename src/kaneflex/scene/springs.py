"""Springs with dampers: between two points, or at a revolute joint."""

from __future__ import annotations

from typing import Annotated

from pydantic import ValidationInfo, WithJsonSchema, field_validator, model_validator

from kaneflex.scene.quantities import Address, AddressPair, Angle, NonNegativeLength
from kaneflex.scene.table import SceneTable, the_one_given
from kaneflex.support.errors import Fault
from kaneflex.support.units import DAMPING, STIFFNESS, TORSIONAL_DAMPING, TORSIONAL_STIFFNESS, to_si

Stiffness = Annotated[
    float, WithJsonSchema({"type": ["number", "string"], "description": "a stiffness, N/m or N m/rad"})
]
DampingConstant = Annotated[
    float, WithJsonSchema({"type": ["number", "string"], "description": "a damping, N s/m or N m s/rad"})
]


class Spring(SceneTable):
    """A linear spring with a linear damper beside it: `stiffness` (N/m) and `damping` (N s/m) along the line
    `between` two points, unstretched at its free `length` (m); or `torsional_at` a revolute joint, N m/rad
    and N m s/rad, at rest at the `angle` (rad) of the second body against the first.
    """

    between: AddressPair | None = None
    torsional_at: str | None = None
    stiffness: Stiffness = 0.0
    damping: DampingConstant = 0.0
    length: NonNegativeLength = 0.0
    angle: Angle = 0.0

    @field_validator("stiffness", "damping", mode="before")
    @classmethod
    def _in_its_dimension(cls, value: object, info: ValidationInfo) -> float:
        linear, torsional = {
            "stiffness": (STIFFNESS, TORSIONAL_STIFFNESS),
            "damping": (DAMPING, TORSIONAL_DAMPING),
        }[info.field_name]
        dimension = torsional if info.data.get("torsional_at") else linear
        number = to_si(value, dimension)
        if number < 0:
            raise Fault(f"{dimension.name} must not be negative", f"Write one like '{dimension.example}'")
        return number

    @model_validator(mode="after")
    def _consistent(self) -> Spring:
        kind = the_one_given(self, ("between", "torsional_at"))
        stranger = "angle" if kind == "between" else "length"
        if stranger in self.model_fields_set:
            raise Fault(f"has no meaning for {kind}", "Leave it out", below=stranger)
        if self.stiffness == 0 and self.damping == 0:
            raise Fault("neither stiffness nor damping", "Give at least one of them")
        if kind == "between" and self.between[0].body == self.between[1].body:
            raise Fault("both ends are on the same body", "Name points of two bodies", below="between")
        return self

    @property
    def ends(self) -> tuple[Address, ...]:
        """The two points that it joins; none where it is torsional."""
        return self.between or ()
