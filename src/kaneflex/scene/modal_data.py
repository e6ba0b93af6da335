"""A link's modal data from elsewhere: the arrays of a file, checked."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from kaneflex.support.atomic_output import write_bytes
from kaneflex.support.errors import Fault
from kaneflex.support.reading import check_file, check_size

FORMAT = 1
"""Number of the file's format."""
ARRAYS: dict[str, tuple[str, str, str]] = {
    "mass": ("", "{}", "kg"),
    "mass_X": ("", "{}", "kg m"),
    "mass_X_X": ("", "{}", "kg m^2"),
    "inertia": ("", "{}", "kg m^2"),
    "mass_s": ("s", "mass_s_{}", "kg"),
    "mass_w": ("w", "mass_w_{}", "kg"),
    "mass_X_s": ("s", "mass_X_s_{}", "kg m"),
    "mass_X_w": ("w", "mass_X_w_{}", "kg m"),
    "mass_s_s": ("ss", "mass_s_{}_s_{}", "kg"),
    "mass_w_w": ("ww", "mass_w_{}_w_{}", "kg"),
    "mass_s_w": ("sw", "mass_s_{}_w_{}", "kg"),
    "mass_H": ("ww", "mass_H_{}_{}", "kg/m"),
    "mass_X_H": ("ww", "mass_X_H_{}_{}", "kg"),
    "inertia_psi": ("w", "inertia_psi_{}", "kg m"),
    "inertia_psi_psi": ("ww", "inertia_psi_{}_psi_{}", "kg"),
    "stiffness": ("a", "stiffness_{}", "N/m"),
    "damping": ("aa", "damping_{}_{}", "N s/m"),
}
"""Array -> its axes (s axial shapes, w transverse ones, a all), symbols of its numbers in the equations, unit."""
POINT_ARRAYS: dict[str, tuple[str, str, str]] = {
    "X": ("", "X", "m"),
    "s": ("s", "s_{}", "1"),
    "w": ("w", "w_{}", "1"),
    "psi": ("w", "psi_{}", "1/m"),
    "H": ("ww", "H_{}_{}", "1/m"),
}
"""The same of what each point has: the points are the first axis."""


_SAME = 1e-9
"""Relative difference up to which numbers of a file are the same."""
_EXPORT = "Compare the file with what kaneflex modes --export writes"


@dataclass(frozen=True, eq=False)
class ModalData:
    """Arrays of a link by the names of ARRAYS and, points first, POINT_ARRAYS (SI), with the length [m] and points."""

    length: float
    points: tuple[str, ...]
    arrays: Mapping[str, np.ndarray]

    @property
    def counts(self) -> tuple[int, ...]:
        """Numbers of axial and of transverse shapes, and 1 where the start moves in the link's frame."""
        start = self.arrays["X"] == 0
        moves = any(self.arrays[name][start].any() for name in ("s", "w", "H"))
        return len(self.arrays["mass_s"]), len(self.arrays["mass_w"]), *(1,) * moves

    @property
    def rotary(self) -> bool:
        """Whether the sections have rotary inertia."""
        return any(self.arrays[name].any() for name in ("inertia", "inertia_psi", "inertia_psi_psi"))

    @property
    def rigid(self) -> tuple[float, float, float]:
        """Mass [kg], distance of its centre from the start [m], moment of inertia about it [kg m^2]."""
        mass, first = float(self.arrays["mass"]), float(self.arrays["mass_X"])
        return mass, first / mass, float(self.arrays["mass_X_X"] + self.arrays["inertia"]) - first**2 / mass

    @property
    def file(self) -> dict[str, np.ndarray]:
        """All that its file holds, by name."""
        head = {"format": np.array(FORMAT), "length": np.array(self.length), "points": np.array(self.points)}
        return head | dict(self.arrays)

    def save(self, path: Path) -> None:
        """Write the file, whole or not at all. Raises OutputError."""
        content = io.BytesIO()
        np.savez(content, allow_pickle=False, **self.file)
        write_bytes(path, content.getvalue())

    def at(self, x: float) -> int | None:
        """Which of the points is at the distance x [m] from the start, if one is."""
        found = np.flatnonzero(abs(self.arrays["X"] - x) <= _SAME * self.length)
        return int(found[0]) if len(found) else None

    def at_point(self, point: str) -> dict[str, np.ndarray]:
        """POINT_ARRAYS of one of the points."""
        k = self.points.index(point)
        return {name: self.arrays[name][k] for name in POINT_ARRAYS}


def symmetrised(array: np.ndarray, axes: str) -> np.ndarray:
    """An array without what its rounding has made of its symmetry; points come before its axes."""
    return (array + np.swapaxes(array, -1, -2)) / 2 if _symmetric(axes) else array


def _symmetric(axes: str) -> bool:
    return len(axes) == 2 and axes[0] == axes[1]


def read_modal_data(path: str) -> ModalData:
    """The modal data of a file.

    Raises
    ------
    Fault
        It names the array that is missing, of the wrong shape, not finite, or no mass, stiffness or damping, and how.
    """
    try:
        check_file(Path(path))
        state = Path(path).stat()
    except OSError as error:
        raise Fault(f"cannot be read: {error.strerror}", "Give an npz file of arrays") from None
    return _read(path, state.st_mtime_ns, state.st_size)


@lru_cache
def _read(path: str, _changed: int, _size: int) -> ModalData:
    """A file as it was when it was last changed: every default of a body asks for it."""
    return checked_data(_arrays(path))


def checked_data(found: Mapping[str, np.ndarray]) -> ModalData:
    """Modal data of a file's arrays. Raises Fault as :func:`read_modal_data` does."""
    for name in ("format", "length", "points", *ARRAYS, *POINT_ARRAYS):
        if name not in found:
            raise Fault(f"the file has no array {name}", _EXPORT)
    if found["format"] != FORMAT:
        raise Fault(f"format = {found['format']}: this version reads format {FORMAT}", "Export the file anew")
    points = tuple(str(name) for name in np.atleast_1d(found["points"]))
    sizes = {"s": np.size(found["mass_s"]), "w": np.size(found["mass_w"])}
    sizes["a"] = sizes["s"] + sizes["w"]
    arrays = {}
    for name, (axes, _, unit) in (ARRAYS | POINT_ARRAYS).items():
        shape = ((len(points),) if name in POINT_ARRAYS else ()) + tuple(sizes[axis] for axis in axes)
        arrays[name] = _checked(name, found[name], shape, axes, unit)
    data = ModalData(float(_checked("length", found["length"], (), "", "m")), points, arrays)
    _check_physics(data)
    return data


def _arrays(path: str) -> dict[str, np.ndarray]:
    """The arrays of an npz file, which unpack to a bounded size: a small archive can hold gigabytes of zeros."""
    try:
        with zipfile.ZipFile(path) as archive:
            check_size(sum(member.file_size for member in archive.infolist()))
        with np.load(Path(path), allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except Fault:
        raise
    except (
        OSError, ValueError, AttributeError, EOFError, KeyError, SyntaxError, MemoryError, NotImplementedError,
        RuntimeError, OverflowError, TypeError, struct.error, zlib.error, zipfile.BadZipFile,
    ) as error:  # fmt: skip
        raise Fault(f"cannot be read: {error}", "Give an npz file of arrays") from None


def _checked(name: str, array: np.ndarray, shape: tuple[int, ...], axes: str, unit: str) -> np.ndarray:
    """An array of numbers of its shape, finite, and symmetric where it has to be."""
    if array.shape != shape:
        raise Fault(f"{name} has the shape {array.shape}, not {shape}", _EXPORT)
    if array.dtype.kind not in "fiu" or not np.isfinite(array).all():
        raise Fault(f"{name} holds what is no finite number", f"Give it in {unit}")
    mirrored = np.swapaxes(array, -1, -2) if _symmetric(axes) else array
    if abs(array - mirrored).max(initial=0.0) > _SAME * abs(array).max(initial=0.0):
        worst = np.unravel_index(abs(array - mirrored).argmax(), array.shape)
        reason = f"{name}{[int(k) for k in worst]} = {array[worst]:.6g} is not symmetric to {mirrored[worst]:.6g}"
        raise Fault(reason, "Give a symmetric array")
    return symmetrised(array.astype(float), axes)


def _check_physics(data: ModalData) -> None:
    a = data.arrays
    for name, value in (("length", data.length), ("mass", a["mass"]), *(("stiffness", k) for k in a["stiffness"])):
        if value <= 0:
            raise Fault(f"{name} = {value:.6g} is not above zero", "Give what resists")
    s, w, *_ = data.counts
    if not w:
        raise Fault("mass_w is empty: there is no transverse shape", "Give one at least")
    # Kinetic energy of the link as a rigid body along and across its axis, and of its shapes.
    along = np.block([[a["mass"].reshape(1, 1), a["mass_s"][None]], [a["mass_s"][:, None], a["mass_s_s"]]])
    turn = (a["mass_X_w"] + a["inertia_psi"])[:, None]
    across = np.block([
        [a["mass"].reshape(1, 1), a["mass_X"].reshape(1, 1), a["mass_w"][None]],
        [a["mass_X"].reshape(1, 1), (a["mass_X_X"] + a["inertia"]).reshape(1, 1), turn.T],
        [a["mass_w"][:, None], turn, a["mass_w_w"] + a["inertia_psi_psi"]],
    ])  # fmt: skip
    for name, matrix in (("mass_s_s", along), ("mass_w_w", across)):
        scale = np.sqrt(abs(np.diag(matrix)))
        lowest = np.linalg.eigvalsh(matrix / np.outer(scale, scale))[0] if scale.all() else 0.0
        if lowest <= 0:
            reason = f"{name} with the link's mass and first moments is not positive definite: {lowest:.3g}"
            raise Fault(reason, "Give independent shapes, none of them a motion of the whole link")
    damping = a["damping"]
    if damping[:s, s:].any():
        raise Fault("damping couples axial and transverse shapes", "Leave these entries at zero")
    if np.linalg.eigvalsh(damping)[0] < -_SAME * abs(damping).max():
        raise Fault(f"damping has the eigenvalue {np.linalg.eigvalsh(damping)[0]:.3g}", "Give damping that dissipates")


def modal_data_of(entries: Mapping[str, object]) -> ModalData | None:
    """The modal data that a body's entries name, if they do."""
    path = entries.get("modal_data")
    return read_modal_data(path) if isinstance(path, str) else None
