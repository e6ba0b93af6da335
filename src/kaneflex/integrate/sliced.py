"""Long chains as their own loop reads them: two strands, in slices.

A band is eliminated from both ends at once (a twisted factorisation): the *strands* go from the first row down and from
the last row up, and meet in a *core* of BAND or BAND + 1 rows, that both have at their ends. Numbered along their
strand, unknown 3 a + r is number r of node a, and a slice is NODES nodes in a row: what entries (i, i + d) of one r and
one d hold in a slice is a *run*, one vector register. Runs without an entry are left out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array

from kaneflex.integrate.strands import BAND, MARGIN, NODES, PER_NODE, ROWS, WIDTH
from kaneflex.integrate.system import AffineSystem, Layout, band_layout


class Runs(NamedTuple):
    """Runs in groups, group k from ``ends[k]`` to ``ends[k + 1]``: their numbers, and what each is multiplied by."""

    ends: np.ndarray
    what: np.ndarray
    values: np.ndarray  # shape (runs, NODES)


class Chain(NamedTuple):
    """A system of narrow band, for one method with one step.

    own, core: rows of a strand before the core, and of the core
    slices: of a strand
    stride, width: a vector has number r of node a at ``r * stride + MARGIN + a``, of the second strand ``PER_NODE *
        stride`` further on; the rest of its `width` is zero
    places: where a vector has its unknowns, shape (2, n): twice, where they belong to the core
    effective: M + c C + k K, a group for each (strand, slice, r, d); what: scalars
    sizes: absolute values of what is added up in its diagonal, a group for each (strand, slice, r); what: scalars
    unbalanced: F, -C and -K, a group for each (strand, slice, r), in pairs; what: where the number's partners start in
        the vector of `loads`, `speeds` and `displacements`
    loads, speeds, displacements: what that vector holds, rows (scalar, first number of the source, runs, first number
        there): scalar times load, times v, times z
    products: numbers in that vector
    middle: layout of the core's matrix
    """

    own: np.uint64
    core: np.uint64
    slices: np.uint64
    stride: np.uint64
    width: np.uint64
    places: np.ndarray
    effective: Runs
    sizes: Runs
    unbalanced: Runs
    loads: np.ndarray
    speeds: np.ndarray
    displacements: np.ndarray
    products: np.uint64
    middle: Layout


class _Strands(NamedTuple):
    """How n rows are divided."""

    n: int
    own: int
    core: int
    slices: int
    stride: int

    @classmethod
    def of(cls, n: int) -> _Strands:
        own = (n - BAND) // 2
        core = n - 2 * own
        slices = -(-(own + core) // ROWS)
        return cls(n, own, core, slices, slices * NODES + 2 * MARGIN)

    def places(self) -> np.ndarray:
        i = np.arange(self.n)
        both = []
        for strand, row in enumerate((i, self.n - 1 - i)):
            at = (strand * PER_NODE + row % PER_NODE) * self.stride + MARGIN + row // PER_NODE
            both.append(np.where(row < self.own + self.core, at, -1))
        return np.where(np.array(both) < 0, both[::-1], both).astype(np.uint64)  # of no second place, the first


class _Entries(NamedTuple):
    """Entries (i, i + d) of matrices, numbered along their strand: its number, i, d, scalar and value."""

    strand: np.ndarray
    i: np.ndarray
    d: np.ndarray
    scalar: np.ndarray
    value: np.ndarray

    @classmethod
    def of(cls, system: AffineSystem, name: str, strands: _Strands) -> _Entries:
        """Those of M, C or K; the core's own belong to the first strand."""
        found = coo_array(getattr(system, name))
        slot, scalar = found.coords
        width = 2 * system.half_bandwidth + 1
        i, d = slot // width, slot % width - system.half_bandwidth
        second = np.maximum(i, i + d) >= strands.own + strands.core
        return cls(
            second.astype(int), np.where(second, strands.n - 1 - i, i), np.where(second, -d, d), scalar, found.data
        )

    def times(self, weight: float) -> _Entries:
        return self._replace(value=weight * self.value)

    def in_diagonal(self) -> _Entries:
        return _Entries(*(each[self.d == 0] for each in self))

    def group(self, strands: _Strands) -> np.ndarray:
        """Number of (strand, slice, r)."""
        return (self.strand * strands.slices + self.i // ROWS) * PER_NODE + self.i % PER_NODE


def chain_of(system: AffineSystem, c_weight: float, k_weight: float) -> Chain:
    """The system, of a half bandwidth up to BAND and of at least 3 BAND rows, and M + c_weight C + k_weight K."""
    strands = _Strands.of(system.n)
    mass, damping, stiffness = (_Entries.of(system, name, strands) for name in "MCK")
    parts = (mass, damping.times(c_weight), stiffness.times(k_weight))
    effective = _Entries(*(np.concatenate(each) for each in zip(*parts, strict=True)))
    diagonal = effective.in_diagonal()
    groups = 2 * strands.slices * PER_NODE
    unbalanced, multiplied, products = _unbalanced(system, damping, stiffness, strands)
    slots = effective.group(strands) * WIDTH + effective.d + BAND
    return Chain(
        *(np.uint64(each) for each in (strands.own, strands.core, strands.slices, strands.stride)),
        np.uint64(2 * PER_NODE * strands.stride + MARGIN),
        strands.places(),
        _runs(groups * WIDTH, slots, effective.scalar, effective.i, effective.value),
        _runs(groups, diagonal.group(strands), diagonal.scalar, diagonal.i, np.abs(diagonal.value)),
        unbalanced,
        *multiplied,
        np.uint64(products),
        band_layout(strands.core, strands.core - 1),
    )


def _unbalanced(
    system: AffineSystem, damping: _Entries, stiffness: _Entries, strands: _Strands
) -> tuple[Runs, list[np.ndarray], int]:
    """Runs of F, -C and -K, what they are multiplied by, and how many numbers that is."""
    force = coo_array(system.F)
    i, scalar = force.coords
    second = i >= strands.own + strands.core
    forces = _Entries(second.astype(int), np.where(second, strands.n - 1 - i, i), 0 * i, scalar, force.data)
    kinds = np.unique(scalar)
    multiplied = [np.array([(k, 0, 1, NODES * m) for m, k in enumerate(kinds)], np.uint64).reshape(-1, 4)]
    rows = [(forces.group(strands), NODES * np.searchsorted(kinds, scalar), forces.i, forces.value)]
    place = NODES * kinds.size
    for each in (damping, stiffness):
        table, what = [], np.zeros(each.i.size, np.int64)
        j = each.i + each.d
        start = each.i // ROWS * NODES + j // PER_NODE - each.i // PER_NODE  # of the partners' run, in nodes
        kind = (each.scalar * 2 + each.strand) * PER_NODE + j % PER_NODE
        for one in np.unique(kind):
            own = kind == one
            first = start[own].min()
            runs = -(-(start[own].max() - first + NODES) // NODES)
            source = one % (2 * PER_NODE) * strands.stride + MARGIN + first
            table.append((one // (2 * PER_NODE), source, runs, place))
            what[own] = place + start[own] - first
            place += runs * NODES
        multiplied.append(np.array(table, np.uint64).reshape(-1, 4))
        rows.append((each.group(strands), what, each.i, -each.value))
    group, what, i, value = (np.concatenate(each) for each in zip(*rows, strict=True))
    return _runs(2 * strands.slices * PER_NODE, group, what, i, value, multiple=2), multiplied, place


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
