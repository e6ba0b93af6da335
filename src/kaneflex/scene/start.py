"""The state that a run starts from, where a scene gives it."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, ValidationError, WithJsonSchema

from kaneflex.scene.merge import merged
from kaneflex.scene.quantities import either
from kaneflex.scene.table import SceneTable
from kaneflex.support.errors import Fault, within
from kaneflex.support.reading import read_text
from kaneflex.support.units import ANGLE, ANGULAR_SPEED, LENGTH, SPEED, Dimension

STARTS = ("zero", "quasistatic", "periodic")
_TABLES = "Give tables displacements and velocities, as solution.state() has them"


def _one_of(*dimensions: Dimension) -> Any:
    """A quantity of one of these kinds, as it is written: which of them it must be is known with its coordinate."""

    def check(value: object) -> object:
        either(value, *dimensions)
        return value

    units = " or ".join(dimension.unit for dimension in dimensions)
    schema = {"type": ["number", "string"], "description": f"in {units}; or a string with a unit"}
    return Annotated[float | str, BeforeValidator(check), WithJsonSchema(schema)]


class Start(SceneTable):
    """Coordinates of the elastic mechanism at t = 0 and their rates, by name; those that are not given are zero.

    Under preset coupled they are those of all bodies, and what is not given is as the rigid mechanism has it. Those of
    a file stand in the tables, too, unless these give them otherwise.
    """

    file: str | None = Field(default=None, description="JSON or TOML file of the two tables, relative to the scene")
    displacements: dict[str, _one_of(LENGTH, ANGLE)] = Field(default={})
    velocities: dict[str, _one_of(SPEED, ANGULAR_SPEED)] = Field(default={})


def start_of(value: object) -> object:
    """A word, or a table as a Start, with what its file says. Raises Fault, or pydantic's error with the place."""
    if isinstance(value, Start) or (isinstance(value, str) and value in STARTS):
        return value
    if isinstance(value, dict):
        if isinstance(value.get("file"), str):
            with within("file"):
                value = merged(_of_file(Path(value["file"])), value)
        return Start.model_validate(value)
    raise Fault("must be 'zero', 'quasistatic', 'periodic' or a table of a state", "Write one of these")


def _of_file(path: Path) -> dict[str, Any]:
    """The tables of a state's file. Raises Fault: unreadable, neither JSON nor TOML, something else in it."""
    try:
        text = read_text(path)
        found = json.loads(text) if path.suffix == ".json" else tomllib.loads(text)
        state = Start.model_validate(found)
    except Fault:
        raise
    except FileNotFoundError:
        raise Fault("no such file", "Give the path of a state's file, relative to the scene") from None
    except ValidationError as error:
        first = error.errors()[0]
        fault = first.get("ctx", {}).get("error")
        reason, cure = (fault.reason, fault.cure) if isinstance(fault, Fault) else (first["msg"].lower(), _TABLES)
        raise Fault(f"{'.'.join(map(str, first['loc'])) or 'the file'}: {reason}", cure) from None
    except (ValueError, RecursionError) as error:  # JSON's and TOML's own
        kind = "JSON" if path.suffix == ".json" else "TOML"
        raise Fault(f"not {kind}: {error}", _TABLES) from None
    if state.file is not None:
        raise Fault("names a file in its turn", _TABLES)
    return found
