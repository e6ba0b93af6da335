"""The finished points of a sweep as a Zarr store, block by block (extra ``zarr``)."""

from __future__ import annotations

import shutil
from pathlib import Path

from kaneflex.study.dataset import labelled, longest
from kaneflex.study.plan import Plan
from kaneflex.study.store import Store
from kaneflex.support.errors import SceneError

_POINTS = 1024
"""Points of a chunk, where there are no series."""
_BLOCK = 2**23
"""Numbers of a block of series: what is in memory at a time."""


def demand_zarr() -> None:
    """Raise SceneError where zarr is not installed."""
    try:
        import zarr  # noqa: F401
    except ModuleNotFoundError as error:
        if error.name != "zarr":
            raise
        cure = "Run: pip install 'kaneflex[zarr]', or take netcdf"
        raise SceneError("--format", "zarr", "zarr is not installed", cure) from None


def write_zarr(plan: Plan, store: Store, path: Path) -> None:
    """Write :func:`kaneflex.study.dataset.labelled` as Zarr, a block of points at a time, so that memory stays flat.

    Version 2 of the format: version 3 has no settled way to keep texts.
    """
    partial = path.with_name(f".{path.name}.partial")
    shutil.rmtree(partial, ignore_errors=True)
    points, instants = sorted(store.finished), longest(plan, store)
    size = max(1, min(_POINTS, _BLOCK // max(1, instants * len(store.labels))))
    for begin in range(0, len(points), size):
        block = labelled(plan, store, points[begin : begin + size], instants).dataset()
        for name in ("outcome", "reason", *plan.points[0]):
            if block[name].dtype.kind == "U":  # of the width of this block's longest
                block[name] = block[name].astype(object)
        if begin == 0:
            along = [name for name in block.variables if "point" in block[name].dims]
            chunks = {name: {"chunks": (size, *block[name].shape[1:])} for name in along}
            block.to_zarr(partial, zarr_format=2, consolidated=True, encoding=chunks)
        else:
            block.drop_vars("statistic").to_zarr(partial, append_dim="point", zarr_format=2, consolidated=True)
    partial.rename(path)
