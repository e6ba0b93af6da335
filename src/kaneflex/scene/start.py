"""The state that a run starts from, where a scene gives it."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator, Field, WithJsonSchema

from kaneflex.scene.table import SceneTable
from kaneflex.support.errors import Fault
from kaneflex.support.units import ANGLE, ANGULAR_SPEED, LENGTH, SPEED, Dimension, to_si

STARTS = ("zero", "quasistatic", "periodic")


def _one_of(*dimensions: Dimension) -> Any:
    """A quantity of one of these kinds, as it is written: which of them it must be is known with its coordinate."""

    def check(value: object) -> object:
        faults = []
        for dimension in dimensions:
            try:
                to_si(value, dimension)
            except Fault as fault:
                faults.append(fault)
            else:
                return value
        raise faults[0]

    units = " or ".join(dimension.unit for dimension in dimensions)
    schema = {"type": ["number", "string"], "description": f"in {units}; or a string with a unit"}
    return Annotated[float | str, BeforeValidator(check), WithJsonSchema(schema)]


class Start(SceneTable):
    """Coordinates of the elastic mechanism at t = 0 and their rates, by name; those that are not given are zero.

    Under preset coupled they are those of all bodies, and what is not given is as the rigid mechanism has it.
    """

    displacements: dict[str, _one_of(LENGTH, ANGLE)] = Field(default={})
    velocities: dict[str, _one_of(SPEED, ANGULAR_SPEED)] = Field(default={})


def start_of(value: object) -> object:
    """A word, or a table as a Start. Raises Fault, or pydantic's error with the place within the table."""
    if isinstance(value, Start) or (isinstance(value, str) and value in STARTS):
        return value
    if isinstance(value, dict):
        return Start.model_validate(value)
    raise Fault("must be 'zero', 'quasistatic', 'periodic' or a table of a state", "Correct it")
