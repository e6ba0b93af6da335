"""Compiled kernels of a whole mechanism, for use in jitted loops.

>>> import kaneflex
>>> kernels = kaneflex.load(kaneflex.read_scene("engine")).kernels
>>> p, n = kernels.parameters, len(kernels.coordinates)
>>> stiffness = np.empty((n, n))
>>> kernels.K(1e-3, p, stiffness)  # or in any function under @njit: K(t, p, out)

All are sums of products of the motion's scalars, out = sum_k monomial_k(t) A_k. The scalars of a monomial and the
places of A_k are data in p, so one compiled kernel, cached on disk, serves every mechanism, and a loop over it is not
compiled again for another scene. Kernels allocate their own workspace, so several threads may share p.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numba import float64, njit, void
from numba.types import WrapperAddressProtocol

from kaneflex.mechanism.affine import Affine, Products, numbered_entries
from kaneflex.mechanism.rigid_motion import RigidKinematics
from kaneflex.support.inner import PART
from kaneflex.support.sparse_rows import coefficients

compiled = njit(cache=True, error_model="numpy")
part = njit(error_model="numpy", **PART)
_ABOUT = {
    "M": "Mass matrix at time t [s], out (n, n).",
    "C": "Damping and gyroscopic matrix at time t [s], out (n, n): material damping, dampers, 2 omega G, joint axes.",
    "K": "Stiffness K_s + K_d + K_c + K_g at time t [s], out (n, n).",
    "K_s": "Elastic stiffness at time t [s], out (n, n).",
    "K_d": "Spin and Euler stiffness at time t [s], out (n, n).",
    "K_c": "Share of the material damping that rotates with the links, at time t [s], out (n, n): part of K, not of C.",
    "K_g": "Geometric stiffness by the axial forces at time t [s], out (n, n).",
    "F": "Inertia, weight and all loads at time t [s], out (n,).",
    "positions": "Positions of the rigid mechanism's points at time t [s], out (points, 2): global x and y [m].",
    "inverse_dynamics": "Forces of the rigid mechanism's joints and drives at time t [s], out (forces,).",
}
"""Kernels that store one sum."""
SUMS = tuple(_ABOUT)
"""Sums in p, in the order of their heads in ``pattern``."""
_M, _C, _K, _F = (np.uint64(SUMS.index(name)) for name in "MCKF")
_MOTION = void(float64, float64[::1], float64[::1])
_HEAD = 5
"""Length of a sum's head in ``pattern``: numbers of monomials, scalars and slots; offsets there and in coefficients."""
# Indices are unsigned: numba tests signed ones for negative values, which takes as long as all else.
_ZERO, _ONE, _TWO, _THREE, _FOUR = (np.uint64(k) for k in range(5))


class MotionKernel(WrapperAddressProtocol):
    """Kernel ``motion`` of any module as a function argument of one type for compiled code.

    numba compiles a function that takes a jitted function again for each of them and in every process, but a function
    that takes an address only once.
    """

    def __init__(self, kernel: Any) -> None:
        self.kernel = kernel  # keeps the compiled code alive
        kernel.compile(_MOTION.args)
        found = kernel.get_compile_result(_MOTION)
        self._address = found.library.get_pointer_to_function(found.fndesc.llvm_cfunc_wrapper_name)

    def __wrapper_address__(self) -> int:
        return self._address

    def signature(self) -> object:
        """Type in numba of ``motion(t, p, s)``."""
        return _MOTION

    def __reduce__(self) -> tuple[object, ...]:
        return MotionKernel, (self.kernel,)


class Parameters(NamedTuple):
    """Argument p of the kernels here. Its arrays may be changed, but not their lengths.

    motion: the module's kernel of that name
    numbers: its own p, PARAMETERS of the module in SI, then the blocks of its tables
    pattern: number of scalars, most monomials of a sum, the heads of SUMS, then of each sum where its monomials end
        among their scalars, those scalars, the slots of out, where they end among the terms, the monomial of each term
    coefficients: of each sum the factor of each term
    """

    motion: MotionKernel
    numbers: np.ndarray
    pattern: np.ndarray
    coefficients: np.ndarray


@part
def _multiply(scalars, pattern, begin, count, monomials):
    """Monomials of the scalars; ``pattern`` holds, from ``begin`` on, the end of each, then its scalars."""
    first = begin + count
    place = first
    for k in range(count):
        end = first + pattern[begin + k]
        product = 1.0
        while place < end:
            product *= scalars[pattern[place]]
            place += _ONE
        monomials[k] = product


@part
def _scalars(t, p):
    """Scalars of the motion at time t. Monomials contain none that is zero by structure."""
    scalars = np.empty(p.pattern[_ZERO])
    p.motion(t, p.numbers, scalars)
    return scalars


@part
def _sum(p, scalars, which, monomials, out):
    """Fill a flat array: each number is the sum over its terms of coefficient x monomial."""
    pattern, coefficients = p.pattern, p.coefficients
    head = _TWO + np.uint64(_HEAD) * which
    begin, first = pattern[head + _THREE], pattern[head + _FOUR]
    _multiply(scalars, pattern, begin, pattern[head], monomials)
    count = pattern[head + _TWO]
    slots = begin + pattern[head] + pattern[head + _ONE]
    ends = slots + count
    terms = ends + count
    out[:] = 0.0
    k = _ZERO
    for slot in range(count):
        end = pattern[ends + slot]
        total = 0.0
        while k < end:
            total += coefficients[first + k] * monomials[pattern[terms + k]]
            k += _ONE
        out[pattern[slots + slot]] = total


@compiled
def evaluate(t, p, which, out):
    """Sum with an index in SUMS at time t [s], as a flat array."""
    _sum(p, _scalars(t, p), which, np.empty(p.pattern[_ONE]), out)


def _kernel(name: str, about: str) -> Any:
    """Kernel of one of SUMS."""
    which = np.uint64(SUMS.index(name))

    def kernel(t, p, out):
        evaluate(t, p, which, out.reshape(out.size))

    kernel.__name__, kernel.__qualname__, kernel.__doc__ = name, name, about
    return compiled(kernel)


M, C, K, K_s, K_d, K_c, K_g, F, positions, inverse_dynamics = (_kernel(*each) for each in _ABOUT.items())


@compiled
def equations(t, p, M, C, K, F):
    """M, C, K, all (n, n), and F (n,) of M z'' + C z' + K z = F at time t [s], from one evaluation of the motion."""
    s, monomials = _scalars(t, p), np.empty(p.pattern[_ONE])
    _sum(p, s, _M, monomials, M.reshape(M.size))
    _sum(p, s, _C, monomials, C.reshape(C.size))
    _sum(p, s, _K, monomials, K.reshape(K.size))
    _sum(p, s, _F, monomials, F)


@dataclass(frozen=True, eq=False)
class Kernels:
    """Kernels of one model and their argument p. Made by :attr:`kaneflex.Model.kernels`.

    Each is ``kernel(t, p, out)`` and stores all of out; ``equations(t, p, M, C, K, F)`` computes four from one
    evaluation of the motion. Array sizes are not checked; :func:`kaneflex.checked` gives kernels that check them.

    Attributes
    ----------
    parameters : Parameters
        p.
    coordinates : tuple of str
        Names of the integrated coordinates, the rows of M, C, K and F.
    points : tuple of str
        BODY.POINT, the rows of ``positions``.
    forces : mapping of str to str
        Forces of the joints and torques of the drives, the rows of ``inverse_dynamics``: name -> unit.
    """

    parameters: Parameters
    coordinates: tuple[str, ...]
    points: tuple[str, ...]
    forces: Mapping[str, str]

    M, C, K, K_s, K_d, K_c, K_g, F = (staticmethod(each) for each in (M, C, K, K_s, K_d, K_c, K_g, F))
    equations, positions, inverse_dynamics = (staticmethod(each) for each in (equations, positions, inverse_dynamics))

    @property
    def shapes(self) -> dict[str, dict[str, tuple[int, ...]]]:
        """Shapes by kernel and argument."""
        n = len(self.coordinates)
        out: dict[str, tuple[int, ...]] = dict.fromkeys(SUMS, (n, n)) | {"F": (n,)}
        out |= {"positions": (len(self.points), 2), "inverse_dynamics": (len(self.forces),)}
        found = {name: {"out": shape} for name, shape in out.items()}
        return found | {"equations": {name: out[name] for name in "MCKF"}}


def bind(motion: RigidKinematics, sums: Mapping[str, Affine]) -> Parameters:
    """Argument p of some sums by their names in SUMS; the others are zero."""
    heads: list[tuple[int, ...]] = []
    pattern: list[np.ndarray] = [np.zeros(2 + _HEAD * len(SUMS))]
    numbers: list[np.ndarray] = []
    for name in SUMS:
        affine = sums.get(name, Affine.zero(0, 0)).fixed(motion.module.CONSTANTS)
        monomials = motion.ordered(affine.terms)
        products, found = Products.of(monomials, motion.column), numbered_entries(affine, monomials)
        slot = found.rows * affine.shape[1] + found.columns
        table = coefficients(slot, found, (affine.shape[0] * affine.shape[1], len(monomials)))
        used = np.flatnonzero(np.diff(table.indptr))
        places = sum(map(len, pattern)), sum(map(len, numbers))
        heads.append((len(monomials), len(products.pattern) - len(monomials), len(used), *places))
        pattern += [products.pattern, used, table.indptr[used + 1], table.indices]
        numbers.append(table.data)
    most = max(count for count, *_ in heads)
    pattern[0] = np.array([len(motion.column), most, *np.ravel(heads)])
    whole = np.concatenate([each.astype(np.uint64) for each in pattern])
    return Parameters(MotionKernel(motion.module.motion), motion.parameters, whole, np.concatenate(numbers))


def place_of_points(points: Mapping[str, tuple[str, tuple[float, float]]]) -> Affine:
    """Global x and y of points, given by body and position in its axes, as one column (2 points, 1)."""
    total = Affine.zero(2 * len(points), 1)
    for row, (body, (x, y)) in enumerate(points.values()):
        for scalar, at in (("x", (1.0, 0.0)), ("y", (0.0, 1.0)), ("c", (x, y)), ("s", (-y, x))):
            column = np.zeros((2 * len(points), 1))
            column[2 * row : 2 * row + 2, 0] = at
            total += Affine.term((f"{body}.{scalar}",), column)
    return total


def scalars_of(names: Sequence[str]) -> Affine:
    """Column of scalars of the motion (scalars, 1)."""
    total = Affine.zero(len(names), 1)
    for row, name in enumerate(names):
        total += Affine.term((name,), np.eye(len(names))[:, row : row + 1])
    return total
