"""Recovery in modal data of a file: stresses and section forces at named places, for each shape."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from kaneflex.scene.sensors import STRESSES
from kaneflex.support.errors import Fault


@dataclass(frozen=True, eq=False)
class Recovery:
    """Values at named ``places`` for unit amplitude of each shape: ``rows`` (n_places, n_components, n_shapes)."""

    places: tuple[str, ...] = ()
    rows: np.ndarray = field(default_factory=lambda: np.zeros((0, 6, 0)))

    def at(self, place: str, modal: np.ndarray) -> np.ndarray:
        """Components at a place (n_components, n_times) from modal coordinates (n_shapes, n_times) [m].

        Mode displacement method: accuracy depends on the shapes, and is best if loads act on shapes of their own.
        """
        return self.rows[self.places.index(place)] @ modal

    def stresses_at(self, place: str, modal: np.ndarray) -> dict[str, np.ndarray]:
        """Stress components by the names of STRESSES, and von Mises' stress "mises", at a stress point [Pa]."""
        found = self.at(place, modal)
        s = dict.fromkeys(STRESSES[6], np.zeros(modal.shape[1])) | dict(zip(STRESSES[len(found)], found, strict=True))
        apart = (s["xx"] - s["yy"]) ** 2 + (s["yy"] - s["zz"]) ** 2 + (s["zz"] - s["xx"]) ** 2
        s["mises"] = np.sqrt(apart / 2 + 3 * (s["xy"] ** 2 + s["yz"] ** 2 + s["zx"] ** 2))
        return s


NONE = Recovery()


@dataclass(frozen=True)
class Recovered:
    """Two arrays of a recovery in a file: ``planar`` holds the possible numbers of components in the plane (in space
    six); ``of_points`` is true if its places are points of the body."""

    names: str
    rows: str
    planar: tuple[int, ...]
    unit: str
    of_points: bool

    def read(self, found: Mapping[str, np.ndarray], points: tuple[str, ...], shapes: int, spatial: bool) -> Recovery:
        """Recovery of a file; empty without its arrays. Raises Fault."""
        if self.names not in found and self.rows not in found:
            return NONE
        for name in (self.names, self.rows):
            if name not in found:
                raise Fault(f"the file has no array {name}", f"Give {self.rows} and {self.names}, or neither")
        places = tuple(str(name) for name in np.atleast_1d(found[self.names]))
        if len(set(places)) < len(places):
            raise Fault(f"{self.names} = {', '.join(places)} has a name twice", "Give each a different name")
        if self.of_points and (unknown := [name for name in places if name not in points]):
            raise Fault(f"{self.names}: there is no point {unknown[0]}", f"Name some of {', '.join(points)}")
        rows = found[self.rows]
        counts = (6,) if spatial else self.planar
        count = rows.shape[1] if rows.ndim == 3 and rows.shape[1] in counts else counts[-1]
        return Recovery(places, finite_array(self.rows, rows, (len(places), count, shapes), self.unit))

    def written(self, recovery: Recovery) -> dict[str, np.ndarray]:
        """Recovery of a file."""
        return {self.names: np.array(recovery.places), self.rows: recovery.rows} if recovery.places else {}


STRESS = Recovered("stress_points", "stress", (3, 6), "Pa/m", of_points=False)
SECTION = Recovered("sections", "section_forces", (3,), "N/m", of_points=True)
"""Section forces exerted by the part beyond: N, V, M in the plane; N, V_y, V_z, T, M_y, M_z in space."""


def finite_array(name: str, array: np.ndarray, shape: tuple[int, ...], unit: str, cure: str = "") -> np.ndarray:
    """Array of a file as finite numbers of the required shape. Raises Fault."""
    if array.shape != shape:
        raise Fault(f"{name} has the shape {array.shape}, not {shape}", cure or f"Give a number for each, in {unit}")
    if array.dtype.kind not in "fiu" or not np.isfinite(array).all():
        raise Fault(f"{name} contains numbers that are not finite", f"Give it in {unit}")
    return array.astype(float)
