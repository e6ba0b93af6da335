"""State space with named states, inputs and outputs, and its files: NumPy, MATLAB, Modelica."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from kaneflex.support.errors import OutputError
from kaneflex.support.escaping import visible
from kaneflex.support.files import write_bytes, write_text


@dataclass(frozen=True, eq=False)
class StateSpace:
    """Linear system in SI units; made by :func:`linearise`.

    Attributes
    ----------
    M, C_damping, K : ndarray (n, n)
        Mass, damping with gyroscopic terms, and stiffness with spin, Euler and geometric terms.
    A, B, C, D : ndarray (2 n, 2 n), (2 n, n_inputs), (n_outputs, 2 n), (n_outputs, n_inputs)
    states : tuple of str
        Coordinates, as ``model.reduced`` names them, then their rates, marked with a prime.
    inputs, outputs : tuple of str
        Loads by name, and NAME.acceleration of each joint whose motion is prescribed; sensors by name.
    input_units, output_units : tuple of str
    t : float
        Instant [s].
    drives : mapping of str to float
        Coordinate of each drive at the instant [rad or m].
    """

    M: np.ndarray
    C_damping: np.ndarray
    K: np.ndarray
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    input_units: tuple[str, ...]
    output_units: tuple[str, ...]
    t: float
    drives: Mapping[str, float]

    def __repr__(self) -> str:
        sizes = (f"{len(getattr(self, part))} {part}" for part in ("states", "inputs", "outputs"))
        return f"StateSpace({', '.join(sizes)}, t = {self.t:.6g} s)"

    @property
    def poles(self) -> np.ndarray:
        """Eigenvalues of A [1/s] whose imaginary part is not negative, by rising modulus."""
        values = np.linalg.eigvals(self.A)
        values = values[values.imag >= 0.0]
        return values[np.argsort(abs(values), kind="stable")]

    def frequency_response(self, frequencies: Sequence[float] | np.ndarray) -> np.ndarray:
        """Complex response of the outputs to harmonic inputs, G(i w) = C (i w - A)^-1 B + D.

        Parameters
        ----------
        frequencies : (n,)
            Frequencies [Hz].

        Returns
        -------
        ndarray (n, n_outputs, n_inputs)
            Complex amplitudes for unit inputs, in units of the outputs over those of the inputs.
        """
        one = np.eye(len(self.A))
        points = 2j * np.pi * np.asarray(frequencies, dtype=float)
        found = [self.C @ np.linalg.solve(s * one - self.A, self.B) + self.D for s in points]
        return np.array(found).reshape(len(points), *self.D.shape)

    def save(self, path: Path | str) -> None:
        """Write everything as NumPy .npz, MATLAB .mat or Modelica .mo, by the path's ending.

        The first two contain the names as arrays of strings; the third has A, B, C, D only, and a variable for each
        input and output.

        Raises
        ------
        OutputError
            For another ending, or a file that can't be written.
        """
        path, data = Path(path), io.BytesIO()
        check_file_kind(path)
        if path.suffix == ".mo":
            write_text(path, modelica(self, path.stem))
            return
        arrays = {name: getattr(self, name) for name in ("M", "C_damping", "K", "A", "B", "C", "D", "t")}
        names = {name: getattr(self, name) for name in ("states", "inputs", "outputs", "input_units", "output_units")}
        names["drives"] = tuple(self.drives)
        arrays["drive_angles"] = np.array([*self.drives.values()], dtype=float)
        if path.suffix == ".npz":
            np.savez(data, **arrays, **{name: np.array(texts, dtype=str) for name, texts in names.items()})
        else:
            from scipy.io import savemat

            # a cell array of strings, since MATLAB pads a matrix of characters
            savemat(data, arrays | {name: np.array(texts, dtype=object) for name, texts in names.items()})
        content = data.getvalue()
        if path.suffix == ".mat":  # its header text of 116 bytes without date and machine
            content = b"MATLAB 5.0 MAT-file, state space by kaneflex".ljust(116) + content[116:]
        write_bytes(path, content)


def check_file_kind(path: Path) -> None:
    """Raise OutputError unless a file is .npz, .mat or .mo."""
    if path.suffix not in (".npz", ".mat", ".mo"):
        raise OutputError(str(path), None, "unknown file type for matrices", "Use the ending .npz, .mat or .mo")


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


def modelica_string(text: str) -> str:
    """Modelica string literal (Modelica Language Specification 3.6, section 2.4.6)."""
    return f'"{_modelica(text, chr(34))}"'


def modelica_name(text: str) -> str:
    """Quoted Modelica identifier, for names that are not identifiers (ibid., section 2.3.1)."""
    return f"'{_modelica(text, chr(39))}'"


def _modelica(text: str, quote: str) -> str:
    return visible(text).replace("\\", "\\\\").replace(quote, f"\\{quote}")
