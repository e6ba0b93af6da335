"""What modal data of a file tell beside motions: stresses and section forces at named places, by each shape."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from kaneflex.support.errors import Fault

STRESSES = {3: ("xx", "yy", "xy"), 6: ("xx", "yy", "zz", "xy", "yz", "zx")}
"""Components of stress in the body's axes by their number; in the plane three or six, in space six."""


@dataclass(frozen=True, eq=False)
class Recovery:
    """Numbers at ``places``, by their names, for one of each shape: ``rows`` (n_places, n_components, n_shapes)."""

    places: tuple[str, ...] = ()
    rows: np.ndarray = field(default_factory=lambda: np.zeros((0, 6, 0)))

    def at(self, place: str, modal: np.ndarray) -> np.ndarray:
        """Components at a place by modal coordinates (n_shapes, n_times) [m], (n_components, n_times).

        What the shapes store is all that is known of the deformation, so they are as good as these (mode displacement
        method), best where forces enter by shapes of their own.
        """
        return self.rows[self.places.index(place)] @ modal

    def stresses_at(self, place: str, modal: np.ndarray) -> dict[str, np.ndarray]:
        """Components of STRESSES and von Mises' stress, "mises", at one of the stress points [Pa]."""
        found = self.at(place, modal)
        s = dict.fromkeys(STRESSES[6], np.zeros(modal.shape[1])) | dict(zip(STRESSES[len(found)], found, strict=True))
        apart = (s["xx"] - s["yy"]) ** 2 + (s["yy"] - s["zz"]) ** 2 + (s["zz"] - s["xx"]) ** 2
        s["mises"] = np.sqrt(apart / 2 + 3 * (s["xy"] ** 2 + s["yz"] ** 2 + s["zx"] ** 2))
        return s


NONE = Recovery()


@dataclass(frozen=True)
class Recovered:
    """The two arrays of a recovery in a file: ``planar`` are its possible numbers of components in the plane, which are
    six in space, and ``of_points`` says whether its places are some of the points."""

    names: str
    rows: str
    planar: tuple[int, ...]
    unit: str
    of_points: bool

    def read(self, found: Mapping[str, np.ndarray], points: tuple[str, ...], shapes: int, spatial: bool) -> Recovery:
        """What a file has of it, which may be nothing. Raises Fault."""
        if self.names not in found and self.rows not in found:
            return NONE
        for name in (self.names, self.rows):
            if name not in found:
                raise Fault(f"the file has no array {name}", f"Give {self.rows} and {self.names}, or neither")
        places = tuple(str(name) for name in np.atleast_1d(found[self.names]))
        if len(set(places)) < len(places):
            raise Fault(f"{self.names} = {', '.join(places)} has a name twice", "Give each its own")
        if self.of_points and (unknown := [name for name in places if name not in points]):
            raise Fault(f"{self.names}: there is no point {unknown[0]}", f"Name some of {', '.join(points)}")
        rows = found[self.rows]
        counts = (6,) if spatial else self.planar
        count = rows.shape[1] if rows.ndim == 3 and rows.shape[1] in counts else counts[-1]
        return Recovery(places, finite_array(self.rows, rows, (len(places), count, shapes), self.unit))

    def written(self, recovery: Recovery) -> dict[str, np.ndarray]:
        """What a file has of it."""
        return {self.names: np.array(recovery.places), self.rows: recovery.rows} if recovery.places else {}


STRESS = Recovered("stress_points", "stress", (3, 6), "Pa/m", of_points=False)
SECTION = Recovered("sections", "section_forces", (3,), "N/m", of_points=True)
"""N, V, M in the plane; N, V_y, V_z, T, M_y, M_z in space: what the part beyond a section exerts."""


def finite_array(name: str, array: np.ndarray, shape: tuple[int, ...], unit: str, cure: str = "") -> np.ndarray:
    """An array of a file as finite numbers of its shape. Raises Fault."""
    if array.shape != shape:
        raise Fault(f"{name} has the shape {array.shape}, not {shape}", cure or f"Give a number for each, in {unit}")
    if array.dtype.kind not in "fiu" or not np.isfinite(array).all():
        raise Fault(f"{name} holds what is no finite number", f"Give it in {unit}")
    return array.astype(float)
