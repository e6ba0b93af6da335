"""Working arrays of an integration of deforming bodies in space, and its stored steps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kaneflex.multibody.coefficients import RADAU, Table
from kaneflex.multibody.spatial_dynamics import Choice
from kaneflex.multibody.spatial_tables import COORDINATE, COUNT, KIND, SHAPES, SLIDE, SPEED, TURN, Layout, Tables

WANTED, LENGTH, LONGEST, GROWTH, ROW, OUTCOME, EVALUATIONS = range(7)
"""Entries of ``control``: next step, last one or 0, longest one [s]; largest dependent speed per independent one
before another choice is requested; next of the times that end a step; outcome of the piece; number of evaluations."""


class Steps(NamedTuple):
    """An integration with one choice of speeds: n coordinates, s speeds, f of them independent.

    Attributes
    ----------
    table : Table
    control : ndarray (7,)
    t : ndarray (1,)
        Current time [s].
    q, u, du : ndarray (n,), (s,), (s,)
    works : ndarray (2,)
        Dissipated by dampers, supplied by loads and prescribed drives [J].
    scale : ndarray (s,)
        Errors allowed, as displacements.
    K, C : ndarray (s, s)
        Stiffness and damping of the shapes.
    coordinate : ndarray (s,)
        Coordinate whose rate a speed is, or -1.
    A, D, powers : ndarray (3, s), (3, n), (3, 2)
        Of the stages: accelerations, rates of the coordinates, powers.
    old : ndarray (n,)
        Rates of a stage before.
    r, defect : ndarray (3, f), (f,)
        Residuals of the stages' equations, and defect of the polynomial at its start.
    M, stiff, damped : ndarray (f, f)
        Reduced.
    drives : ndarray (f,)
        Power of the prescribed drives by accelerations of the independent speeds.
    masses : ndarray (3, f f + f)
        Factors of M of every stage where its iteration began, and right-hand sides.
    real, pair : ndarray (f f + f,)
        Factors and right-hand sides.
    pivots : ndarray (2 f,)
    sizes : ndarray (n_loads,)
        Sizes of the loads at neighbouring states.
    """

    table: Table
    control: np.ndarray
    t: np.ndarray
    q: np.ndarray
    u: np.ndarray
    du: np.ndarray
    works: np.ndarray
    scale: np.ndarray
    K: np.ndarray
    C: np.ndarray
    coordinate: np.ndarray
    A: np.ndarray
    D: np.ndarray
    powers: np.ndarray
    old: np.ndarray
    r: np.ndarray
    defect: np.ndarray
    M: np.ndarray
    stiff: np.ndarray
    damped: np.ndarray
    drives: np.ndarray
    masses: np.ndarray
    real: np.ndarray
    pair: np.ndarray
    pivots: np.ndarray
    sizes: np.ndarray


def steps_of(m: Tables, layout: Layout, choice: Choice, coordinates: int, scale: np.ndarray, loads: int) -> Steps:
    """Arrays for an integration with these errors allowed and number of loads."""
    s, f = len(scale), len(choice.independent)
    coordinate, (K, C) = np.full(s, -1), np.zeros((2, s, s))
    for row in m.nodes.tolist():
        count = 1 if row[KIND] in (TURN, SLIDE) else row[COUNT] if row[KIND] == SHAPES else 0
        own = slice(row[SPEED], row[SPEED] + count)
        coordinate[own] = np.arange(row[COORDINATE], row[COORDINATE] + count)
    for body, shapes in layout.shapes.items():
        first = m.nodes[layout.node_of[body], SPEED]
        own = slice(first, first + shapes.count)
        K[own, own], C[own, own] = shapes.stiffness, shapes.damping
    control, t, q, u, du, works = (np.zeros(size) for size in (7, 1, coordinates, s, s, 2))
    A, D, powers, r = (np.zeros((3, size)) for size in (s, coordinates, 2, f))
    M, stiff, damped = np.zeros((3, f, f))
    real, pair = np.zeros(f * f + f), np.zeros(f * f + f, complex)
    return Steps(
        RADAU, control, t, q, u, du, works, scale, K, C, coordinate, A, D, powers, np.zeros(coordinates), r,
        np.zeros(f), M, stiff, damped, np.zeros(f), np.zeros((3, f * f + f)), real, pair, np.zeros(2 * f, np.int64),
        np.zeros(loads),
    )  # fmt: skip


def step_size(coordinates: int, speeds: int) -> int:
    """Length of a stored step: begin and end, initial coordinates and speeds, final works, and the stages' rates of
    coordinates and accelerations."""
    return 4 + 4 * (coordinates + speeds)
