"""Coefficients of the three-stage collocation methods Radau IIA and Gauss."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np


class Table(NamedTuple):
    """Coefficients of a collocation method: nodes, A, its square, weights b and b A, 1 if the last node is the end.

    ``real``, ``pair``: one eigenvalue of A each; ``into``, ``out``: the corresponding rows of T^-1 and columns of T,
    (2, 3) complex. All parts are arrays, since compiled code uses their addresses.
    """

    nodes: np.ndarray
    a_1: np.ndarray
    a_2: np.ndarray
    b_1: np.ndarray
    b_2: np.ndarray
    ends: np.ndarray
    real: np.ndarray
    pair: np.ndarray
    into: np.ndarray
    out: np.ndarray


def collocation_table(nodes: np.ndarray) -> Table:
    """Collocation method with three nodes in (0, 1]."""
    A, b = _integrals(nodes, nodes), _integrals(nodes, np.ones(1))[0]
    values, T = np.linalg.eig(A)
    order = [int(abs(values.imag).argmin()), int(values.imag.argmax())]
    into, out = np.linalg.inv(T)[order], T.T[order]
    return Table(
        nodes, A, A @ A, b, b @ A, np.array([float(nodes[2] == 1.0)]), values[order[:1]].real.copy(),
        values[order[1:]].astype(complex), np.ascontiguousarray(into, complex), np.ascontiguousarray(out, complex),
    )  # fmt: skip


def _integrals(nodes: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Integrals from 0 to x (n,) of the nodes' Lagrange polynomials, (n, 3)."""
    powers = np.arange(1, 4)
    return (x[:, None] ** powers / powers) @ np.linalg.inv(np.vander(nodes, increasing=True))


_ROOT = math.sqrt(6.0)
RADAU = collocation_table(np.array([(4.0 - _ROOT) / 10.0, (4.0 + _ROOT) / 10.0, 1.0]))
GAUSS = collocation_table(np.array([0.5 - math.sqrt(0.15), 0.5, 0.5 + math.sqrt(0.15)]))
