"""Shape functions, and numerical terms of many elements: the constant matrix of each product of motion scalars.

They come from a generated module of planar or spatial elements and its TERMS.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from types import ModuleType

import numpy as np

from kaneflex.mechanism.affine import Affine, Matrix, Monomial, from_entries
from kaneflex.support.array_kernels import Numbers, on_arrays


def shape_functions(x: Numbers, length: Numbers, phi_s: Numbers = 0.0, growth: Numbers = 0.0) -> np.ndarray:
    """Rows u, v, theta, v' over (u1, v1, theta1, u2, v2, theta2), (..., 4, 6); x from the first node [m].

    Paper (49)-(55), where theta = v'; with phi_s = 12 E I/(kappa G A length^2) those of a Timoshenko beam under
    loads at its nodes (Przemieniecki 1968): v' - theta is the shear strain -phi_s length^2 d3v/dx3 / 12. Its theta
    bows where E I grows over the element, by `growth` of its mean. Arrays give the rows of as many places.
    """
    s, b = x / length, 1.0 / (1.0 + phi_s)
    c = 1.0 - b
    shear, bow = c * s * (1 - s) * length / 2, c * growth / 12
    hump, bend, mean = length * (3 * s**2 - 2 * s**3 - s) * bow, 6 * (s - s**2) * bow, c / length
    v = (b * (1 - 3 * s**2 + 2 * s**3) + c * (1 - s), b * x * (1 - s) ** 2 + shear - hump,
         b * (3 * s**2 - 2 * s**3) + c * s, b * x * (s**2 - s) - shear + hump)  # fmt: skip
    theta = (6 * b * (s**2 - s) / length, b * (1 - 4 * s + 3 * s**2) + c * (1 - s) - bend,
             6 * b * (s - s**2) / length, b * (3 * s**2 - 2 * s) + c * s + bend)  # fmt: skip
    strain = -mean, -c / 2 + bow, mean, -c / 2 - bow
    found = np.zeros((*np.shape(s), 4, 6))
    found[..., 0, 0], found[..., 0, 3] = 1 - s, s
    for k, j in enumerate((1, 2, 4, 5)):
        found[..., 1, j], found[..., 2, j], found[..., 3, j] = v[k], theta[k], theta[k] + strain[k]
    return found


def spatial_shape_functions(
    x: Numbers, length: Numbers, phi: tuple[Numbers, Numbers] = (0.0, 0.0),
    growth: tuple[Numbers, Numbers] = (0.0, 0.0), twist: Numbers = 0.0,
) -> np.ndarray:  # fmt: skip
    """Rows u, v, w, theta_x, theta_y, theta_z, v', w', twist theta_x' over u, v, w, theta_x, theta_y, theta_z of both
    nodes, (..., 9, 12).

    phi and growth: of the x-y plane, then of the x-z plane, where theta_y = -w' without shear.
    """
    found = np.zeros((*np.shape(x / length), 9, 12))
    first = shape_functions(x, length, phi[0], growth[0])
    second = shape_functions(x, length, phi[1], growth[1])[..., 1:, :] * _SIGNS
    found[..., _Y_PLANE[0], _Y_PLANE[1]] = first
    found[..., _Z_PLANE[0], _Z_PLANE[1]] = second
    found[..., 3, [3, 9]] = first[..., 0, [0, 3]]
    found[..., 8, 9] = twist / length
    found[..., 8, 3] = -found[..., 8, 9]
    return found


_Y_PLANE = np.ix_((0, 1, 5, 6), (0, 1, 5, 6, 7, 11))
_Z_PLANE = np.ix_((2, 4, 7), (0, 2, 4, 6, 8, 10))
"""Rows, and the planar element's coordinates u, v, theta, in each plane of bending."""
_SIGNS = np.array([[1, 1, -1, 1, 1, -1], [-1, -1, 1, -1, -1, 1], [1, 1, -1, 1, 1, -1]])
"""Signs of v, theta, v' by these in the x-z plane, where theta_y = -w'."""


MATRIX_OF_GROUP = {
    "inertia": "M", "gyroscopic": "C_d", "elastic": "K_s", "spin": "K_d", "euler": "K_d", "geometric": "K_g",
    "damping": "C_s", "load": "F",
}  # fmt: skip
"""Matrix of M q'' + (C_s + C_d) q' + (K_s + K_d + K_g) q = F that a term of the generated module belongs to."""

Parameters = Mapping[str, np.ndarray]
"""Parameters of elements by their names in the contract, (elements,) each."""


def _matrices(
    module: ModuleType, kernel: str, parameters: Parameters, monomials: Sequence[Sequence[str]]
) -> np.ndarray:
    """Matrices of a kernel for some monomials of TERMS, (monomials, elements, n, n); for F loads (.., elements, n, 1).

    A kernel is linear in the monomials. With one scalar at 1 it gives the matrix of that scalar or its square (no entry
    has both). With two at 1, minus the result with one of them at -1, it gives twice the matrix of their product; all
    other terms are equal in both and cancel exactly.
    """
    names = [name for name, *_ in module.LINK_SCALARS]
    p = [parameters[name][:, None] for name, *_ in module.ELEMENT_PARAMETERS]
    mixed = [len(set(factors)) > 1 for factors in monomials]
    s = np.array([[float(name in factors) for factors in monomials] for name in names])
    turned = np.array([[-1.0 if factors[-1:] == (name,) else 1.0 for factors in monomials] for name in names])
    n = 12 if "a_z" in names else 6  # coordinates of an element
    found = np.zeros((2, n, 1 if kernel == "F" else n, len(p[0]), len(monomials)))
    for out, scalars in zip(found, (s, s * turned), strict=True):
        given = (p,) if kernel in ("M", "K_s") else (p, scalars[:, None])
        on_arrays(getattr(module, kernel))(*given, out[:, 0] if kernel == "F" else out)
    return np.where(mixed, (found[0] - found[1]) / 2, found[0]).transpose(3, 2, 0, 1)


def _of_unit_density(module: ModuleType, parameters: Parameters) -> np.ndarray:
    """Integral of N^T N dx (elements, n, n), from K_d's matrices of the squares of omega's components.

    With rho A = -1 and no rotary inertia each is the integral for the displacement across its axis: in the plane
    it is complete, in space their sum is twice the result.
    """
    turning = [(name, name) for name, *_ in module.LINK_SCALARS if name.startswith("omega")]
    none = np.zeros_like(parameters["rho_A"])
    unit = {name: none for name in parameters if name.startswith("rho_")} | {"rho_A": none - 1.0}
    return _matrices(module, "K_d", {**parameters, **unit}, turning).sum(axis=0) / max(1, len(turning) - 1)


def terms_of_elements(
    module: ModuleType, parameters: Parameters, called: Callable[[str], str], mu: float | None = None
) -> Iterator[tuple[tuple[str, Monomial], np.ndarray]]:
    """Every term of the module with its matrix for each element, (elements, n, n), of F (elements, n, 1).

    Keys are the matrix of the equations that it belongs to and its monomial, of scalars as they are ``called``.
    mu: damping by a force for each length and velocity [N s/m^2], None where there is none.
    """
    for kernel in dict.fromkeys(kernel for _, _, kernel, _ in module.TERMS):
        rows = [(group, factors) for _, group, of, factors in module.TERMS if of == kernel and group != "damping"]
        found = _matrices(module, kernel, parameters, [factors for _, factors in rows]) if rows else ()
        for (group, factors), blocks in zip(rows, found, strict=True):
            yield (MATRIX_OF_GROUP[group], tuple(called(factor) for factor in factors)), blocks
    if mu is not None and any(group == "damping" for _, group, *_ in module.TERMS):
        yield ("C_s", ()), mu * _of_unit_density(module, parameters)


def chain(
    terms: Iterable[tuple[tuple[str, Monomial], np.ndarray]], place: Mapping[int, Sequence[int]], size: int
) -> dict[str, Affine]:
    """Matrices M, C_s, C_d, K_s, K_d, K_g and F of a chain of elements; node i has the rows place[i]."""
    matrices = {key: Affine.zero(size, 1 if key == "F" else size) for key in set(MATRIX_OF_GROUP.values())}
    for (key, monomial), blocks in terms:
        matrices[key] += Affine.term(monomial, _overlapped(blocks, place, size))
    return matrices


def _overlapped(blocks: np.ndarray, place: Mapping[int, Sequence[int]], size: int) -> Matrix:
    """The elements' matrices, or vectors, added up where they share a node."""
    square = blocks.shape[2] > 1
    ends = np.array([(*place[e], *place[e + 1]) for e in range(len(blocks))])
    rows = np.broadcast_to(ends[:, :, None], blocks.shape)
    columns = np.broadcast_to(ends[:, None, :], blocks.shape) if square else np.zeros_like(rows)
    return from_entries((size, size if square else 1), rows, columns, blocks)
