"""Rigid motion of a mechanism: scalars by name at any instants, tabulated by its module."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import ModuleType
from typing import Any, ClassVar, Self

import numpy as np

from kaneflex.mechanism.affine import Affine, Matrix, Monomial, as_array, numbered_entries
from kaneflex.mechanism.body_frame import BodyFrame
from kaneflex.support.array_kernels import on_arrays
from kaneflex.support.errors import SceneError
from kaneflex.support.sparse_rows import coefficients

_MANY = 200
"""Number of terms above which a matrix is summed entry by entry, since most entries have few terms."""


@dataclass(frozen=True, eq=False)
class RigidKinematics:
    """Rigid motion of a scene: its module's ``tabulate`` with the scene's numbers.

    ``parameters`` is the kernels' argument p: PARAMETERS of the module in SI, then the blocks of its tables.
    """

    module: ModuleType
    parameters: np.ndarray

    is_start = False
    """True before free joints are integrated: the motion is then known at its start only."""
    is_determined = False
    """True if drives alone determine the positions of a coupled mechanism's rigid bodies, without redundancy."""
    begin = 0.0
    """First instant of the run [s]."""

    @cached_property
    def column(self) -> dict[str, int]:
        return {name: k for k, (name, *_) in enumerate(self.module.SCALARS)}

    def ordered(self, monomials: Iterable[Monomial]) -> tuple[Monomial, ...]:
        """Products of scalars in the module's order, so that rounding does not depend on a scene's names."""
        place = {name: k for k, name in enumerate([*self.column, *self.module.CONSTANTS])}
        return tuple(sorted(monomials, key=lambda monomial: sorted(place[name] for name in monomial)))

    def table(self, times: np.ndarray) -> np.ndarray:
        """All scalars at ``times`` [s]: shape (n_times, n_scalars), in the order of the module's SCALARS."""
        return self.at(times).values

    def at(self, times: np.ndarray | float) -> RigidMotion:
        """Rigid motion at ``times`` [s], scalar by name."""
        times = np.atleast_1d(np.asarray(times, dtype=float))
        out = np.zeros((len(times), len(self.column)))
        on_arrays(self.module.tabulate)(times[None], self.parameters, out.T[None])
        return RigidMotion(self, times, out)

    def acting(self, times: np.ndarray, seen: RigidMotion) -> RigidMotion:
        """Motion at ``times`` [s], at least its loads and speeds of links; ``seen`` holds all of it at every step."""
        return self.at(times)


def not_integrated(t: float) -> SceneError:
    """Error for a motion of free joints after its start that no run has integrated."""
    return SceneError(
        "t", t, "a loaded model knows the motion of free joints at t = 0 only: a run integrates it",
        "Use the model of a run, simulate(model).model",
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class RigidMotion:
    """Scalars of the rigid motion at some times: ``motion["rod.omega"]`` has shape (n_times,)."""

    motion: RigidKinematics
    times: np.ndarray
    values: np.ndarray
    freedoms: ClassVar[int] = 3
    """Degrees of freedom of a free body."""

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self._series:
            column = self.motion.column.get(name)
            self._series[name] = (
                np.full(len(self.times), self.motion.module.CONSTANTS[name])
                if column is None
                else np.ascontiguousarray(self.values[:, column])
            )
        return self._series[name]

    def __contains__(self, name: str) -> bool:
        return name in self.motion.column or name in self.motion.module.CONSTANTS

    def taken(self, instants: np.ndarray) -> RigidMotion:
        """Motion at some of its instants."""
        return RigidMotion(self.motion, self.times[instants], self.values[instants])

    def magnitudes(self, period: float) -> dict[str, float]:
        """Largest scalar in each unit, as the scale of rounding errors.

        Points on shaft axes move only by rounding. Therefore rates are at least those of a vibration of the largest
        position, or of a radian, with the motion's period [s]; forces are at least moments over the largest position,
        and vice versa.
        """
        sizes, found = abs(self.values).max(axis=0).tolist(), dict[str, float]()
        for (_, unit, *_), size in zip(self.motion.module.SCALARS, sizes, strict=True):
            found[unit] = max(found.get(unit, 0.0), size)
        reach = found.get("m", 0.0)
        for of, size in (("m", reach), ("rad", 1.0)):
            for order, unit in enumerate((f"{of}/s", f"{of}/s^2"), start=1):
                found[unit] = max(found.get(unit, 0.0), size * (2.0 * np.pi / period) ** order)
        if reach > 0.0:
            found["N"] = max(found.get("N", 0.0), found.get("N m", 0.0) / reach)
            found["N m"] = max(found.get("N m", 0.0), found["N"] * reach)
        return found

    def frame(self, body: str) -> BodyFrame:
        """Axes of a body, or of the ground."""
        return BodyFrame(self, body)

    def section_frame(self, side: Any) -> tuple[Any, Any]:
        """Axes that a point of a body rotates with, and the point in these."""
        return self.frame(side.body), side

    def monomial(self, names: Monomial) -> np.ndarray:
        """Product of scalars, shape (n_times,)."""
        if names not in self._products:
            product = np.ones(len(self.times))
            for name in sorted(names, key=lambda name: self.motion.column.get(name, -1)):
                product = product * self[name]
            self._products[names] = product
        return self._products[names]

    @cached_property
    def _series(self) -> dict[str, np.ndarray]:
        """Requested scalars, each contiguous, which halves the time of all computations from them.
        """
        return {}

    @cached_property
    def _products(self) -> dict[Monomial, np.ndarray]:
        """Requested products: the matrices of a link, of its forces and of its frame share most of them."""
        return {}

    def apply(self, affine: Affine, vectors: np.ndarray) -> np.ndarray:
        """Product A(t) x(t) for vectors (columns, n_times); returns (rows, n_times)."""
        return self.apply_each(affine, (vectors,))[0]

    def apply_each(self, affine: Affine, vectors: Sequence[np.ndarray]) -> tuple[np.ndarray, ...]:
        """:meth:`apply` to several vectors at once."""
        side_by_side, shape = np.concatenate(vectors, axis=1), (affine.shape[0], len(vectors), len(self.times))
        total = np.zeros(shape, self.values.dtype)
        for monomial, matrix in affine.terms.items():
            part = (matrix @ side_by_side).reshape(shape)
            total += np.multiply(part, self.monomial(monomial), out=part) if monomial else part
        return tuple(total[:, k] for k in range(len(vectors)))

    def matrices(self, affine: Affine) -> np.ndarray:
        """Affine matrix at all times, (n_times, rows, columns)."""
        if len(affine.terms) > _MANY and self.values.dtype != object:
            found = numbered_entries(affine, affine.monomials)
            rows, columns = affine.shape
            shares = coefficients(found.rows * columns + found.columns, found, (rows * columns, len(affine.terms)))
            products = np.array([self.monomial(monomial) for monomial in affine.monomials])
            return np.ascontiguousarray((shares @ products).T).reshape(-1, rows, columns)
        total = np.zeros((len(self.times), *affine.shape), self.values.dtype)
        for monomial, matrix in affine.terms.items():
            total += self.monomial(monomial)[:, None, None] * as_array(matrix)
        return total

    def first(self, affine: Affine) -> Matrix:
        """Affine matrix at the first time."""
        return affine.value({name: float(self[name][0]) for monomial in affine.terms for name in monomial})

    def column_of(self, affine: Affine) -> np.ndarray:
        """Affine vector (rows x 1) at all times; returns (rows, n_times)."""
        return self.apply(affine, np.ones((1, len(self.times)), self.values.dtype))


class LaterMotion(RigidMotion):
    """Motion at some times that is tabulated on request."""

    def __init__(self, motion: Any, times: np.ndarray) -> None:
        self.__dict__.update(motion=motion, times=times)

    def taken(self, instants: np.ndarray) -> Self:
        return type(self)(self.motion, self.times[instants])

    @cached_property
    def values(self) -> np.ndarray:  # type: ignore[override]
        return self.motion.table(self.times)
