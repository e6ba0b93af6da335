"""Export of a state space as a Modelica model."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from kaneflex.support.escaping import modelica_name, modelica_string

if TYPE_CHECKING:
    from kaneflex.solve.statespace import StateSpace

_KEYWORDS = """
    algorithm and annotation assert block break class connect connector constant constrainedby der discrete each else
    elseif elsewhen encapsulated end enumeration equation expandable extends external false final flow for function if
    import impure in initial inner input loop model not operator or outer output package parameter partial protected
    public pure record redeclare replaceable return stream then true type when while within
""".split()
"""Reserved words (Modelica Language Specification 3.6, section 2.3.3)."""


def modelica(system: StateSpace, name: str) -> str:
    """Text of a Modelica model x' = A x + B u, y = C x + D u.

    Inputs and outputs keep their names as quoted identifiers (Modelica Language Specification 3.6, section 2.3.1); an
    output with the name of an input gets the suffix ``sensor``.

    Parameters
    ----------
    system : StateSpace
    name : str
        Of the model; characters not allowed become underscores.
    """
    inputs, outputs = list(map(modelica_name, system.inputs)), []
    for each in system.outputs:
        outputs.append(modelica_name(f"{each} sensor" if each in system.inputs else each))
    model = re.sub(r"\W", "_", name, flags=re.ASCII)
    model = model if model[:1].isalpha() and model not in _KEYWORDS else f"model_{model}"
    drives = "".join(f", {drive} at {value!r}" for drive, value in system.drives.items())
    about = modelica_string(f"A mechanism linear about t = {system.t!r} s{drives}; SI units; by kaneflex")
    lines = [f"model {model} {about}"]
    for kind, names, units in (("input", inputs, system.input_units), ("output", outputs, system.output_units)):
        quoted = (modelica_string(_unit(unit)) for unit in units)
        lines += [f"  {kind} Real {each}(unit = {unit});" for each, unit in zip(names, quoted, strict=True)]
    states = modelica_string(", ".join(system.states))
    lines += [f"  Real x[{len(system.A)}](each start = 0.0)", f"    {states};", "protected"]
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


def _unit(unit: str) -> str:
    """Unit in Modelica's spelling: N.m, m/s2."""
    return unit.replace(" ", ".").replace("^", "")
