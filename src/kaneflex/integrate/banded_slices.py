"""Storage of long chains for their loop: narrow bands in slices of eight nodes.

Unknown 3 a + r is number r of node a, and a slice is NODES nodes in a row: what entries (i, i + d) of one r and one d
hold in a slice is a *run*, one vector register. Runs without an entry are left out, so that only numbers that are not
zero are read, but for the ends of a link.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kaneflex.integrate.conventions import LANES
from kaneflex.integrate.system import AffineSystem
from kaneflex.support.sparse_rows import rows_of

NODES = LANES  # of a slice: consecutive ones, a number of each in a register
PER_NODE = 3  # displacements u, w and a rotation
BAND = 5  # largest |i - j|: neighbouring nodes
WIDTH = 2 * BAND + 1
ROWS = NODES * PER_NODE  # of a slice
MARGIN = 8  # zeros before and behind the nodes' numbers, which runs at the ends read


class Runs(NamedTuple):
    """Runs in groups, group k from ``ends[k]`` to ``ends[k + 1]``: their numbers, and what each is multiplied by."""

    ends: np.ndarray
    what: np.ndarray
    values: np.ndarray  # shape (runs, NODES)


class BandedSystem(NamedTuple):
    """A system of narrow band, n unknowns in so many slices, for one method with one step.

    A vector of it has its unknowns at ``r * stride + MARGIN + a``; the rest of its `width` is zero.

    effective: M + c C + k K, a group for each (slice, r, d); what: scalars
    sizes: absolute values of what is added up in its diagonal, a group for each (slice, r); what: scalars
    residual: F, -C and -K, a group for each (slice, r), in pairs; what: where the number's partners start in the
        vector of `loads`, `speeds` and `displacements`
    loads, speeds, displacements: what that vector holds, rows (scalar, first number of the source, runs, first number
        there): scalar times load, times v, times z
    products: numbers in that vector
    """

    n: np.uint64
    slices: np.uint64
    stride: np.uint64
    width: np.uint64
    effective: Runs
    sizes: Runs
    residual: Runs
    loads: np.ndarray
    speeds: np.ndarray
    displacements: np.ndarray
    products: np.uint64

    @property
    def numbers(self) -> int:
        """In all its runs, zeros that fill them up included: its work."""
        return self.effective.values.size + self.residual.values.size + int(self.products)


class _Entries(NamedTuple):
    """Entries (i, i + d) of the matrices that belong to scalars."""

    i: np.ndarray
    d: np.ndarray
    scalar: np.ndarray
    value: np.ndarray


def banded_system(system: AffineSystem, c_weight: float, k_weight: float) -> BandedSystem:
    """The system, of a half bandwidth up to BAND, and M + c_weight C + k_weight K."""
    mass, damping, stiffness = (_entries(system, name) for name in "MCK")
    slices = -(-system.n // ROWS)
    stride = slices * NODES + 2 * MARGIN
    summed = ((mass, 1.0), (damping, c_weight), (stiffness, k_weight))
    residual, multiplied, products = _residual(system, damping, stiffness, slices, stride)
    return BandedSystem(
        *(np.uint64(each) for each in (system.n, slices, stride, PER_NODE * stride + MARGIN)),
        *_summed(summed, slices),
        residual,
        *multiplied,
        np.uint64(products),
    )


def _entries(system: AffineSystem, name: str) -> _Entries:
    found = getattr(system, name)
    slot, scalar = rows_of(found), found.indices
    width = 2 * system.half_bandwidth + 1
    return _Entries(slot // width, slot % width - system.half_bandwidth, scalar, found.data)


def _summed(parts: tuple[tuple[_Entries, float], ...], slices: int) -> tuple[Runs, Runs]:
    """Runs of a weighted sum, and of the absolute values in its diagonal."""
    i, d, scalar, value = (np.concatenate(each) for each in zip(*(part for part, _ in parts), strict=True))
    value = np.concatenate([np.full(part.i.size, weight) for part, weight in parts]) * value
    place = i // ROWS * PER_NODE + i % PER_NODE
    whole = _runs(slices * PER_NODE * WIDTH, place * WIDTH + d + BAND, scalar, i, value)
    i, place, scalar, value = (each[d == 0] for each in (i, place, scalar, np.abs(value)))
    return whole, _runs(slices * PER_NODE, place, scalar, i, value)


def _residual(
    system: AffineSystem, damping: _Entries, stiffness: _Entries, slices: int, stride: int
) -> tuple[Runs, list[np.ndarray], int]:
    """Runs of F, -C and -K, what they are multiplied by, and how many numbers that is."""
    place, multiplied, rows = 0, [], []
    force = system.F
    i, scalar = rows_of(force), force.indices
    loads = np.unique(scalar)
    multiplied.append(np.array([(k, 0, 1, place + NODES * m) for m, k in enumerate(loads)], np.uint64).reshape(-1, 4))
    rows.append((i, NODES * np.searchsorted(loads, scalar), force.data))
    place += NODES * loads.size
    for each in (damping, stiffness):
        table, what = [], np.zeros(each.i.size, np.int64)
        j = each.i + each.d
        r = j % PER_NODE
        start = each.i // ROWS * NODES + j // PER_NODE - each.i // PER_NODE  # of the partners' run, in nodes
        key = each.scalar * PER_NODE + r
        for one in np.unique(key):
            own = key == one
            first = start[own].min()
            runs = -(-(start[own].max() - first + NODES) // NODES)
            table.append((one // PER_NODE, one % PER_NODE * stride + MARGIN + first, runs, place))
            what[own] = place + start[own] - first
            place += runs * NODES
        multiplied.append(np.array(table, np.uint64).reshape(-1, 4))
        rows.append((each.i, what, -each.value))
    i, what, value = (np.concatenate(each) for each in zip(*rows, strict=True))
    group = i // ROWS * PER_NODE + i % PER_NODE
    return _runs(slices * PER_NODE, group, what, i, value, multiple=2), multiplied, place


def _runs(
    groups: int, group: np.ndarray, what: np.ndarray, i: np.ndarray, value: np.ndarray, multiple: int = 1
) -> Runs:
    """Numbers in row i as runs: a run for each pair of group and `what`, groups filled up to a multiple by zeros."""
    several = what.max(initial=0) + 1
    pairs, run = np.unique(group * several + what, return_inverse=True)
    counts = np.bincount(pairs // several, minlength=groups)
    ends = np.concatenate(([0], np.cumsum(-(-counts // multiple) * multiple)))
    at = np.arange(pairs.size) + (ends[:-1] - np.cumsum(counts) + counts)[pairs // several]
    values, whats = np.zeros((ends[-1], NODES)), np.zeros(ends[-1], np.uint64)
    whats[at] = pairs % several
    np.add.at(values, (at[run], i // PER_NODE % NODES), value)
    return Runs(ends.astype(np.uint64), whats, values)
