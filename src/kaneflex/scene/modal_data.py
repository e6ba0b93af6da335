"""Modal data of a body from a file, in the plane or in space: arrays and their checks."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from pathlib import Path

import numpy as np

from kaneflex.scene.recovery import NONE, SECTION, STRESS, Recovery, finite_array
from kaneflex.support.errors import Fault
from kaneflex.support.files import check_file, check_size, write_bytes

FORMAT = 1
"""Version of the file format."""
ARRAYS: dict[str, tuple[str, str]] = {
    "mass": ("", "kg"),
    "mass_X": ("", "kg m"),
    "mass_X_X": ("", "kg m^2"),
    "inertia": ("", "kg m^2"),
    "mass_s": ("s", "kg"),
    "mass_w": ("w", "kg"),
    "mass_X_s": ("s", "kg m"),
    "mass_X_w": ("w", "kg m"),
    "mass_s_s": ("ss", "kg"),
    "mass_w_w": ("ww", "kg"),
    "mass_s_w": ("sw", "kg"),
    "mass_H": ("ww", "kg/m"),
    "mass_X_H": ("ww", "kg"),
    "inertia_psi": ("w", "kg m"),
    "inertia_psi_psi": ("ww", "kg"),
    "stiffness": ("a", "N/m"),
    "damping": ("aa", "N s/m"),
}
"""Array -> its axes (s axial shapes, w transverse ones, a all), unit."""
POINT_ARRAYS: dict[str, tuple[str, str]] = {
    "X": ("", "m"),
    "s": ("s", "1"),
    "w": ("w", "1"),
    "psi": ("w", "1/m"),
    "H": ("ww", "1/m"),
}
"""Arrays of the points, which are the first axis."""

SPATIAL_ARRAYS: dict[str, tuple[str, str]] = {
    "mass": ("", "kg"),
    "mass_r": ("c", "kg m"),
    "mass_r_r": ("cc", "kg m^2"),
    "mass_N": ("cn", "kg"),
    "mass_r_N": ("ccn", "kg m"),
    "mass_N_N": ("ccnn", "kg"),
    "mass_G": ("cnn", "kg/m"),
    "mass_r_G": ("ccnn", "kg"),
    "stiffness": ("n", "N/m"),
    "damping": ("nn", "N s/m"),
    "cubic": ("nnn", "N/m^2"),
}
"""Spatial arrays: axes (c components x, y, z, n shapes), unit."""
SPATIAL_POINT_ARRAYS: dict[str, tuple[str, str]] = {
    "r": ("c", "m"),
    "N": ("cn", "1"),
    "psi": ("cn", "1/m"),
    "G": ("cnn", "1/m"),
}
"""Spatial arrays of the points, which are the first axis."""
CROSS = np.array([np.cross(row, np.eye(3)) for row in np.eye(3)]).transpose(2, 0, 1)
"""Levi-Civita symbol of cross products: (a x b)_i = CROSS_ijk a_j b_k."""
_BOTH_ALIKE = ("mass_N_N",)
"""Arrays that are symmetric under exchange of components and shapes together."""
_SAME = 1e-9
"""Relative tolerance for equal numbers of a file."""
_EXPORT = "Compare it with a file of kaneflex modes --export"


@dataclass(frozen=True, eq=False)
class ModalData:
    """Arrays of a body by the names of ARRAYS and, points first, POINT_ARRAYS (SI), with the length [m] and points; in
    space by those of SPATIAL_ARRAYS and SPATIAL_POINT_ARRAYS.

    ``stresses`` [Pa/m] have their own places, ``sections`` [N/m, N m/m] are at some of the points; in the plane axial
    shapes come first.
    """

    length: float
    points: tuple[str, ...]
    arrays: Mapping[str, np.ndarray]
    stresses: Recovery = NONE
    sections: Recovery = NONE

    @property
    def dimension(self) -> int:
        """Dimension: 2 in the plane, 3 in space."""
        return 3 if "mass_N" in self.arrays else 2

    @property
    def counts(self) -> tuple[int, ...]:
        """Numbers of axial and of transverse shapes."""
        return len(self.arrays["mass_s"]), len(self.arrays["mass_w"])

    @property
    def rotary(self) -> bool:
        """True if the sections have rotary inertia."""
        return any(self.arrays[name].any() for name in ("inertia", "inertia_psi", "inertia_psi_psi"))

    @property
    def rigid(self) -> tuple[float, tuple[float, ...], float | tuple[float, ...]]:
        """Mass [kg], position of its centre [m], moment of inertia about it [kg m^2] (in space six), as in a scene.
        """
        mass = float(self.arrays["mass"])
        if self.dimension == 3:
            centre = self.arrays["mass_r"] / mass
            J = inertia_tensor(self.arrays["mass_r_r"] - mass * np.outer(centre, centre))
            return mass, tuple(centre.tolist()), tuple(J[[0, 1, 2, 0, 1, 2], [0, 1, 2, 1, 2, 0]].tolist())
        first = float(self.arrays["mass_X"])
        about = float(self.arrays["mass_X_X"] + self.arrays["inertia"]) - first**2 / mass
        return mass, (first / mass, 0.0), about

    @property
    def places(self) -> np.ndarray:
        """Positions of the points, (n_points, dimension) [m]."""
        if self.dimension == 3:
            return self.arrays["r"]
        return np.column_stack([self.arrays["X"], np.zeros(len(self.points))])

    @property
    def file(self) -> dict[str, np.ndarray]:
        """Content of the file, by name."""
        head = {"format": np.array(FORMAT), "length": np.array(self.length), "points": np.array(self.points)}
        recovery = STRESS.written(self.stresses) | SECTION.written(self.sections)
        return head | ({"dimension": np.array(3)} if self.dimension == 3 else {}) | dict(self.arrays) | recovery

    def save(self, path: Path) -> None:
        """Write the file atomically. Raises OutputError."""
        content = io.BytesIO()
        np.savez(content, allow_pickle=False, **self.file)
        write_bytes(path, content.getvalue())

    def at(self, place: Sequence[float]) -> int | None:
        """Name of the point at a position [m], if any."""
        found = np.flatnonzero(abs(self.places - place).max(axis=1) <= _SAME * self.length)
        return int(found[0]) if len(found) else None


def inertia_tensor(second: np.ndarray) -> np.ndarray:
    """Inertia tensor from a body's second moments, both (3, 3) [kg m^2]."""
    return np.trace(second) * np.eye(3) - second


def symmetrised(array: np.ndarray, axes: str, name: str = "") -> np.ndarray:
    """Symmetrised array, free of rounding errors; points come before its axes."""
    for exchanges in _mirrors(name, axes):
        array = (array + _mirrored(array, exchanges)) / 2
    return array


def spatial_modal_data(length: float, points: Sequence[str], arrays: Mapping[str, np.ndarray]) -> ModalData:
    """Modal data of a body in space by the names of SPATIAL_ARRAYS and SPATIAL_POINT_ARRAYS, symmetric up to rounding.

    Raises Fault as :func:`read_modal_data` does."""
    both = SPATIAL_ARRAYS | SPATIAL_POINT_ARRAYS
    found = {name: symmetrised(np.asarray(array, float), both[name][0], name) for name, array in arrays.items()}
    return checked_data(ModalData(length, tuple(points), found).file)


def planar_arrays(
    of: Mapping[str, np.ndarray], energy: np.ndarray, axial: int, shorter: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Arrays of a link in the plane, whose axial shapes come first, by those in space; symmetric up to rounding.

    ``energy`` (n, n): mass matrix of the shapes [kg], which may know more than the sums of particles; ``shorter``: H,
    mass_H and mass_X_H.
    """
    s, w, both = slice(axial), slice(axial, None), ARRAYS | POINT_ARRAYS
    N, r_N, N_N = (of[f"mass_{name}"] for name in ("N", "r_N", "N_N"))
    found = {
        "mass": of["mass"], "mass_X": of["mass_r"][0], "mass_X_X": of["mass_r_r"][0, 0],
        "inertia": of["mass_r_r"][1, 1], "mass_s": N[0, s], "mass_w": N[1, w],
        "mass_X_s": r_N[0, 0, s] + r_N[1, 1, s], "mass_X_w": r_N[0, 1, w], "mass_s_s": energy[s, s],
        "mass_w_w": N_N[1, 1, w, w], "mass_s_w": N_N[0, 1, s, w] - N_N[1, 0, s, w],
        "inertia_psi": -r_N[1, 0, w], "inertia_psi_psi": energy[w, w] - N_N[1, 1, w, w],
        "stiffness": of["stiffness"], "damping": of["damping"], **shorter,
        "X": of["r"][:, 0], "s": of["N"][:, 0, s], "w": of["N"][:, 1, w], "psi": of["psi"][:, 2, w],
    }  # fmt: skip
    return {name: symmetrised(np.asarray(array, float), both[name][0]) for name, array in found.items()}


def _mirrors(name: str, axes: str) -> list[list[tuple[int, int]]]:
    """Exchanges of axes, counted from the last, under which an array is symmetric: of any two shapes, or of two
    components without shapes."""
    if name in _BOTH_ALIKE:
        return [[(-1, -2), (-3, -4)]]
    those = axes if axes.strip("c") == "" else axes.replace("c", " ")
    pairs = combinations([k - len(axes) for k, axis in enumerate(those) if axis != " "], 2)
    return [[(j, k)] for j, k in pairs if axes[j] == axes[k]]


def _mirrored(array: np.ndarray, exchanges: Sequence[tuple[int, int]]) -> np.ndarray:
    for j, k in exchanges:
        array = array.swapaxes(j, k)
    return array


def read_modal_data(path: str) -> ModalData:
    """Read modal data of a file.

    Raises
    ------
    Fault
        If an array is missing, of the wrong shape, not finite, or not valid as mass, stiffness or damping.
    """
    try:
        check_file(Path(path))
        state = Path(path).stat()
    except OSError as error:
        raise Fault(f"cannot be read: {error.strerror}", "Give an npz file of arrays") from None
    return _read(path, state.st_mtime_ns, state.st_size)


@lru_cache
def _read(path: str, _changed: int, _size: int) -> ModalData:
    """File read once for each modification time, since every default of a body needs it."""
    return checked_data(_arrays(path))


def checked_data(found: Mapping[str, np.ndarray]) -> ModalData:
    """Modal data from a file's arrays. Raises Fault as :func:`read_modal_data` does."""
    spatial = found.get("dimension", 2) == 3
    whole, of_points = (SPATIAL_ARRAYS, SPATIAL_POINT_ARRAYS) if spatial else (ARRAYS, POINT_ARRAYS)
    for name in ("format", "length", "points", *whole, *of_points):
        if name not in found:
            raise Fault(f"the file has no array {name}", _EXPORT)
    if found["format"] != FORMAT:
        raise Fault(f"format = {found['format']}: this version reads format {FORMAT}", "Export the file again")
    points = tuple(str(name) for name in np.atleast_1d(found["points"]))
    if spatial:
        sizes = {"c": 3, "n": np.size(found["stiffness"])}
    else:
        sizes = {"s": np.size(found["mass_s"]), "w": np.size(found["mass_w"])}
        sizes["a"] = sizes["s"] + sizes["w"]
    arrays = {}
    for name, (axes, unit) in (whole | of_points).items():
        shape = ((len(points),) if name in of_points else ()) + tuple(sizes[axis] for axis in axes)
        arrays[name] = _checked(name, found[name], shape, axes, unit)
    length = float(_checked("length", found["length"], (), "", "m"))
    recovered = (kind.read(found, points, np.size(found["stiffness"]), spatial) for kind in (STRESS, SECTION))
    data = ModalData(length, points, arrays, *recovered)
    _check_physics(data)
    return data


def _arrays(path: str) -> dict[str, np.ndarray]:
    """Arrays of an npz file, up to a bounded unpacked size: a small archive can hold gigabytes of zeros."""
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
    """Array of finite numbers with the required shape and symmetry."""
    array = finite_array(name, array, shape, unit, _EXPORT)
    for exchanges in _mirrors(name, axes):
        mirrored = _mirrored(array, exchanges)
        if abs(array - mirrored).max(initial=0.0) > _SAME * abs(array).max(initial=0.0):
            worst = np.unravel_index(abs(array - mirrored).argmax(), array.shape)
            reason = f"{name}{[int(k) for k in worst]} = {array[worst]:.6g} is not symmetric to {mirrored[worst]:.6g}"
            raise Fault(reason, "Give a symmetric array")
        array = (array + mirrored) / 2
    return array


def _check_physics(data: ModalData) -> None:
    a = data.arrays
    for name, value in (("length", data.length), ("mass", a["mass"]), *(("stiffness", k) for k in a["stiffness"])):
        if value <= 0:
            raise Fault(f"{name} = {value:.6g} is not above zero", "Give a positive value")
    for name, matrix in (_spatial_energies if data.dimension == 3 else _planar_energies)(a).items():
        scale = np.sqrt(abs(np.diag(matrix)))
        lowest = np.linalg.eigvalsh(matrix / np.outer(scale, scale))[0] if scale.all() else 0.0
        if lowest <= 0:
            reason = f"{name} with the body's mass and first moments is not positive definite: {lowest:.3g}"
            raise Fault(reason, "Give independent shapes without rigid-body motions")
    damping = a["damping"]
    if len(damping) and np.linalg.eigvalsh(damping)[0] < -_SAME * abs(damping).max():
        raise Fault(f"damping has the eigenvalue {np.linalg.eigvalsh(damping)[0]:.3g}", "Give non-negative damping")


def _spatial_energies(a: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Check that the mass matrix of the body's translations, rotations and shapes is positive definite."""
    if not a["stiffness"].size:
        raise Fault("stiffness is empty: there are no shapes", "Give at least one")
    turned = np.einsum("cab,abj->cj", CROSS, a["mass_r_N"])
    lever = np.einsum("acd,d->ac", CROSS, a["mass_r"])  # e_c x r
    return {"mass_N_N": np.block([
        [a["mass"] * np.eye(3), lever, a["mass_N"]],
        [lever.T, inertia_tensor(a["mass_r_r"]), turned],
        [a["mass_N"].T, turned.T, np.einsum("aajk->jk", a["mass_N_N"])],
    ])}  # fmt: skip


def _planar_energies(a: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Check the mass matrices of the link's rigid motion and shapes, along and across its axis."""
    s, w = len(a["mass_s"]), len(a["mass_w"])
    if not w:
        raise Fault("mass_w is empty: there are no transverse shapes", "Give at least one")
    if a["damping"][:s, s:].any():
        raise Fault("damping couples axial and transverse shapes", "Set these entries to zero")
    along = np.block([[a["mass"].reshape(1, 1), a["mass_s"][None]], [a["mass_s"][:, None], a["mass_s_s"]]])
    turn = (a["mass_X_w"] + a["inertia_psi"])[:, None]
    across = np.block([
        [a["mass"].reshape(1, 1), a["mass_X"].reshape(1, 1), a["mass_w"][None]],
        [a["mass_X"].reshape(1, 1), (a["mass_X_X"] + a["inertia"]).reshape(1, 1), turn.T],
        [a["mass_w"][:, None], turn, a["mass_w_w"] + a["inertia_psi_psi"]],
    ])  # fmt: skip
    return {"mass_s_s": along, "mass_w_w": across}
