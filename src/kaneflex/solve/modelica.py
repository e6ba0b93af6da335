"""A state space as a Modelica model, which any tool of that language makes a part of its own."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from kaneflex.solve.statespace import StateSpace


def modelica(system: StateSpace, name: str) -> str:
    """The text of a model x' = A x + B u, y = C x + D u.

    Inputs and outputs are variables by their own names in quotes, as Modelica writes what is no identifier (Modelica
    Language Specification 3.6, section 2.3.1); an output that is called like an input has ``sensor`` behind its name.

    Parameters
    ----------
    system : StateSpace
    name : str
        Of the model; what no identifier has becomes an underscore.
    """
    inputs, outputs = list(map(_quoted, system.inputs)), []
    for each in system.outputs:
        outputs.append(_quoted(f"{each} sensor" if each in system.inputs else each))
    model = re.sub(r"\W", "_", name, flags=re.ASCII)
    model = model if model[:1].isalpha() else f"model_{model}"
    drives = "".join(f", {drive} at {value!r}" for drive, value in system.drives.items())
    lines = [f'model {model} "A mechanism linear about t = {system.t!r} s{drives}; SI units; by kaneflex"']
    for kind, names, units in (("input", inputs, system.input_units), ("output", outputs, system.output_units)):
        lines += [f'  {kind} Real {each}(unit = "{_unit(unit)}");' for each, unit in zip(names, units, strict=True)]
    lines += [f"  Real x[{len(system.A)}](each start = 0.0)", f'    "{", ".join(system.states)}";', "protected"]
    for key in "ABCD":
        matrix = getattr(system, key)
        if matrix.size:
            entries = ",\n    ".join("{" + ", ".join(map(repr, row)) + "}" for row in matrix.tolist())
            lines.append(f"  constant Real {key}[{matrix.shape[0]}, {matrix.shape[1]}] = {{\n    {entries}}};")
    by_inputs = [f" + {key} * u" if inputs else "" for key in "BD"]
    if inputs:
        lines.append(f"  Real u[{len(inputs)}] = {{{', '.join(inputs)}}};")
    if outputs:
        lines.append(f"  Real y[{len(outputs)}] = C * x{by_inputs[1]};")
    lines += ["equation", f"  der(x) = A * x{by_inputs[0]};"]
    lines += [f"  {each} = y[{k}];" for k, each in enumerate(outputs, start=1)]
    return "\n".join([*lines, f"end {model};", ""])


def _quoted(name: str) -> str:
    backslash = "\\"
    return "'" + name.replace(backslash, 2 * backslash).replace("'", backslash + "'") + "'"


def _unit(unit: str) -> str:
    """As Modelica writes it: N.m, m/s2."""
    return unit.replace(" ", ".").replace("^", "")
