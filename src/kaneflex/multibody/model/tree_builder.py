"""Rows of the tables of a mechanism in space in construction: nodes, stations, sections, axes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np

from kaneflex.mechanism.planar import GROUND
from kaneflex.mechanism.spatial import Side, SpatialMechanism
from kaneflex.multibody.model.spatial_layout import (
    AT, AXIS, BALL, BODY, COORDINATE, COUNT, PLACE, ROTATION, SHAPES, SHIFT, SLIDE, SPEED, STATION, Axis,
    Deformable, Flexible, Place, carried,
)  # fmt: skip


class TreeBuilder:
    """Rows of the tables in construction."""

    def __init__(self, mechanism: SpatialMechanism, flexible: Flexible) -> None:
        self.mechanism, self.flexible = mechanism, flexible
        self.shapes: dict[str, Deformable] = {}
        self.stations: dict[tuple[str, Place], int] = {}
        self.nodes: list[list[int]] = []
        self.numbers: list[np.ndarray] = []
        self.p: list[np.ndarray] = []
        self.sections: list[tuple[int, np.ndarray]] = [(-1, np.zeros(3))]
        self.axes: list[tuple[int, np.ndarray]] = []
        self.node_of = {GROUND: -1}
        self.speeds: list[tuple[str, str]] = []
        self.positions: list[tuple[str, str]] = []

    def node(self, kind: int, parent: int, names: Sequence[str], rotation=None, place=None, axis=None) -> int:
        """Add a node; ``names`` are those of its speeds, without shapes."""
        row = np.zeros(18)
        row[ROTATION:PLACE] = np.eye(3).ravel() if rotation is None else np.ravel(rotation)
        row[PLACE:AXIS] = 0.0 if place is None else place
        row[AXIS:SHIFT] = 0.0 if axis is None else axis
        self.nodes.append([kind, parent, len(self.positions), len(self.speeds), -1, 0, -1, -1, -1, 1])
        self.numbers.append(row)
        found = [(name, "m" if kind == SLIDE else "rad") for name in names]
        self.speeds += found
        owner = found[0][0].rpartition(".")[0] if found else ""
        self.positions += [(f"{owner}.quaternion_{part}", "1") for part in "wxyz"] if kind == BALL else found
        return len(self.nodes) - 1

    def body(self, name: str, node: int, at: Sequence[float], freed: str = "") -> None:
        """Add the body of the last node of a chain, joined at a point in its axes.

        ``freed``: its axes, like "z", about which its section there turns relative to its floating axes.
        """
        self.numbers[node][SHIFT:] = at
        if name in self.flexible:
            node = self.deforming(name, node, None if name in self.mechanism.floating else tuple(map(float, at)), freed)
        self.node_of[name] = node
        body = self.mechanism.bodies[name]
        if body.mass or np.any(body.inertia):
            shapes = self.shapes[name].numbers() if name in self.shapes else np.zeros(0)
            self.nodes[node][BODY] = self.stored(np.concatenate([[body.mass], body.centre, body.inertia, shapes]))

    def deforming(self, name: str, frame: int, held: Place | None, freed: str) -> int:
        """Add the node of a body's axes and modal coordinates, joined at the place of its axes that is held."""
        shapes = self.shapes[name] = self.flexible[name](held, freed)
        node = self.node(SHAPES, frame, ())
        self.nodes[node][COUNT] = shapes.count
        units = ["rad" if twists else "m" for twists in shapes.twisting]
        self.speeds += [(f"{name}.shapes.{k}", unit) for k, unit in enumerate(units)]
        self.positions += [(f"{name}.shape_{k}", unit) for k, unit in enumerate(units)]
        if held is not None:
            place = shapes.carrier(held)
            self.stations[name, place] = frame  # its section there
            self.numbers[frame][SHIFT:] -= place
            self.numbers[node][SHIFT:] = place
            if any(part.any() for part in shapes.at(place)):
                self.nodes[node][AT] = self.stored(_of_station(*shapes.at(place)))
        return node

    def stored(self, numbers: np.ndarray) -> int:
        """Append numbers to p; returns their place."""
        self.p.append(numbers)
        return sum(map(len, self.p)) - len(numbers)

    def on(self, side: Side) -> tuple[int, np.ndarray]:
        """Node that carries a point of a body, and its place in that node's axes; on a deforming body a station."""
        if side.body in self.shapes:
            shapes = self.shapes[side.body]
            place = shapes.carrier(side.at)
            if (side.body, place) not in self.stations:
                self.stations[side.body, place] = self.station(side.body, place, shapes.at(place))
        return carried(self, side)

    def station(self, body: str, place: Place, numbers: Sequence[np.ndarray]) -> int:
        """Add the node of a place of a deforming body."""
        frame = self.node_of[body]
        node = self.node(STATION, frame, (), place=place)
        self.nodes[node][COORDINATE : SPEED + 1] = self.nodes[frame][COORDINATE : SPEED + 1]
        self.nodes[node][COUNT] = self.shapes[body].count
        self.nodes[node][AT] = self.stored(_of_station(*numbers))
        return node

    def section(self, side: Side) -> int:
        """Add the section at a point of a body; returns its number."""
        self.sections.append(self.on(side))
        return len(self.sections) - 1

    def mean(self, body: str, rises: bool) -> int:
        """Add the mean section of a body, weighted by a load along it that falls or rises; returns its number.

        Shapes are affine in the mean, so the load's power equals that of its resultant there.
        """
        link = cast(Axis, self.shapes[body])  # loads are spread along axes only
        share, x, rows, G = link.spread(*((0.0, 1.0) if rises else (1.0, 0.0)))
        self.sections.append((self.station(body, (x / share, 0.0, 0.0), (rows / share, G / share)), np.zeros(3)))
        return len(self.sections) - 1

    def axis(self, side: Side, vector: np.ndarray) -> int:
        """Add an axis in a body's axes that turns with the section at a point; returns its number."""
        self.axes.append((self.on(side)[0], np.asarray(vector, float)))
        return len(self.axes) - 1


def _of_station(rows: np.ndarray, G: np.ndarray) -> np.ndarray:
    """Numbers of a station: its rows of the shapes, and the columns of G that are not zero."""
    i, j = np.nonzero(np.tril(G.any(axis=0)))
    return np.concatenate([np.ravel(rows), [len(i)], np.column_stack([i, j, G[:, i, j].T]).ravel()])


def whole(rows: Sequence, columns: int) -> np.ndarray:
    """Rows of integers as an array."""
    return np.array(rows, int).reshape(-1, columns)
