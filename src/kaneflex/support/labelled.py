"""Labelled arrays as plain data, as an xarray dataset, and as netCDF files written without importing xarray.

Importing xarray (with pandas, and Dask and pint if installed) takes longer than solving the scene engine.
"""

from __future__ import annotations

import csv
import struct
import sys
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from kaneflex.support.errors import Fault, installed, naming
from kaneflex.support.files import check_file

if TYPE_CHECKING:
    import xarray
    from scipy.io import netcdf_file

Entry = tuple[str | tuple[str, ...], np.ndarray] | tuple[str | tuple[str, ...], np.ndarray, Mapping[str, Any]]
"""Arguments of xarray.Variable: dimensions, values and optional attributes."""


Variable = tuple[tuple[str, ...], np.ndarray, Mapping[str, str | float]]
"""Variable: names of its dimensions, values in one of the types of netCDF 3, attributes."""
_TYPES = {"i1": 1, "S1": 2, "i2": 3, "i4": 4, "f4": 5, "f8": 6}
_CHARACTERS, _DOUBLE, _DIMENSIONS, _VARIABLES, _ATTRIBUTES = 2, 6, 10, 11, 12
_LARGEST = 2**32 - 1
"""Size written into the header for a variable of this many bytes or more."""


class Labelled(NamedTuple):
    """Arguments of xarray.Dataset: variables and coordinates by name, and global attributes."""

    variables: Mapping[str, Entry]
    coordinates: Mapping[str, Entry]
    attributes: Mapping[str, Any]

    def dataset(self) -> xarray.Dataset:
        """Dataset of xarray. Raises SceneError if xarray is not installed."""
        with needing_xarray("dataset"):
            import xarray
        return xarray.Dataset(*self)

    def to_csv(self, path: Path, along: str) -> None:
        """Write the entries along one dimension as CSV: one column per entry, units in the header, all digits.

        The dimension's own coordinate comes first, then the other coordinates, then the variables.
        """
        entries = {**self.coordinates, **self.variables}
        columns = {name: entry for name, entry in entries.items() if entry[0] in (along, (along,))}
        columns = {along: columns.pop(along)} | columns
        units = {name: entry[2].get("units", "1") if len(entry) == 3 else "1" for name, entry in columns.items()}
        heads = [f"{name} [{unit}]" for name, unit in units.items()]
        with path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(heads)
            writer.writerows(zip(*(np.asarray(values).tolist() for _, values, *_ in columns.values()), strict=True))

    def to_netcdf(self, path: Path) -> None:
        """Write netCDF 3 (64-bit offset), which ``xarray.open_dataset`` reads with scipy alone.

        The file equals the one that xarray writes of :meth:`dataset`, except that integers beyond 32 bits, which
        netCDF 3 does not have, become doubles.
        """
        entries = {**self.variables, **self.coordinates}
        dims = {name: (entry[0],) if isinstance(entry[0], str) else tuple(entry[0]) for name, entry in entries.items()}
        auxiliary = sorted(name for name in self.coordinates if dims[name] != (name,))
        # CF-1.11, section 5: coordinates of a variable in addition to those of its dimensions
        beside = {
            name: [other for other in auxiliary if set(dims[other]) <= set(dims[name])] for name in self.variables
        }
        variables = {}
        for name, (_, values, *about) in entries.items():
            own, typed, coded = _encoded(dims[name], np.asarray(values))
            variables[name] = own, typed, {**coded, **dict(*about), **_coordinates(beside.get(name, ()))}
        without = sorted({*auxiliary}.difference(*beside.values()))
        write_netcdf(path, variables, {**self.attributes, **_coordinates(without)})


@contextmanager
def needing_xarray(asked: str) -> Iterator[None]:
    """Raise a SceneError that names the requested entry if xarray is not installed."""
    with naming(asked, None), installed("xarray", "tables", "xarray", "pandas"):
        yield


def read_dataset(path: Path, names: Collection[str] = ()) -> xarray.Dataset:
    """Read a dataset, or its variables of these names, with xarray.

    Raises Fault for a damaged file or another format; SceneError if xarray is not installed.
    """
    with needing_xarray("dataset"):
        import xarray
    with _reading(path), xarray.open_dataset(path, engine="scipy") as found:
        return (found[[name for name in names if name in found.variables]] if names else found).load()


def read_labelled(path: Path, names: Collection[str] = ()) -> Labelled:
    """Read a dataset, or its variables of these names; coordinates are among the variables.

    xarray is not needed. Raises Fault for a damaged file or another format.
    """
    from scipy.io import netcdf_file

    with _reading(path), netcdf_file(path, mmap=True) as file:
        return _read(file, names)


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Turn any exception of the libraries about a damaged file into a Fault."""
    try:
        check_file(path, sys.maxsize)
        yield
    except FileNotFoundError:
        raise Fault("the file does not exist", "Give the path of a readable file") from None
    except Fault:
        raise
    except Exception as error:
        message = next(iter(str(error).splitlines()), "") or type(error).__name__
        raise Fault(f"damaged or not a dataset: {message}", "Restore it from a copy, or write it again") from error


def _read(file: netcdf_file, names: Collection[str]) -> Labelled:
    """Copies of the variables' values, in the machine's byte order and with decoded texts, and global attributes."""
    entries: dict[str, Entry] = {}
    for name in names or file.variables:
        if name in file.variables:
            values, dims = np.ascontiguousarray(file.variables[name].data), file.variables[name].dimensions
            about = _texts(file.variables[name]._attributes)
            if values.dtype.kind == "S":
                texts = values.view(f"S{values.shape[-1]}")[..., 0]
                entries[name] = (dims[:-1], np.char.decode(texts, "utf-8"), about)
            else:
                own = bool if about.get("dtype") == "bool" else values.dtype.newbyteorder("=")
                entries[name] = (dims, values.astype(own), about)
    return Labelled(entries, {}, _texts(file._attributes))


def _texts(attributes: Mapping[str, Any]) -> dict[str, Any]:
    return {key: each.decode("utf-8") if isinstance(each, bytes) else each for key, each in attributes.items()}


def _encoded(dims: tuple[str, ...], values: np.ndarray) -> Variable:
    """Variable of netCDF 3, with attributes for the original type of its values."""
    if values.dtype.kind == "U":
        encoded = np.char.encode(values, "utf-8")
        length = encoded.dtype.itemsize
        values = encoded.view("S1").reshape(*values.shape, length)
        return (*dims, f"string{length}"), values, {"_Encoding": "utf-8"}
    if values.dtype.kind == "b":
        return dims, values.astype(np.int8), {"dtype": "bool"}
    if values.dtype.kind in "iu":
        narrow = values.astype(np.int32)
        values = narrow if np.array_equal(narrow, values) else values.astype(np.float64)
    return dims, values, {"_FillValue": np.nan} if values.dtype.kind == "f" else {}


def _coordinates(names: Collection[str]) -> dict[str, str]:
    return {"coordinates": " ".join(names)} if names else {}


def write_netcdf(path: Path, variables: Mapping[str, Variable], attributes: Mapping[str, str | float]) -> None:
    """Write netCDF 3 with 64-bit offsets (OGC 10-092r3): a header, then the numbers of one variable after the other.

    Variables that share a dimension have the same length along it.
    """
    lengths: dict[str, int] = {}
    for dims, values, _ in variables.values():
        lengths |= dict(zip(dims, values.shape, strict=True))
    data = [np.ascontiguousarray(values, values.dtype.newbyteorder(">")) for _, values, _ in variables.values()]
    numbers = {name: number for number, name in enumerate(lengths)}

    def header(begins: Iterable[int]) -> bytes:
        dimensions = [_text(name) + _int(length) for name, length in lengths.items()]
        described = [
            _text(name) + _int(len(dims), *map(numbers.__getitem__, dims)) + _attributes(about)
            + _int(_TYPES[values.dtype.str[1:]]) + struct.pack(">Iq", min(_padded(values.nbytes), _LARGEST), begin)
            for (name, (dims, _, about)), values, begin in zip(variables.items(), data, begins, strict=True)
        ]  # fmt: skip
        parts = _many(_DIMENSIONS, dimensions), _attributes(attributes), _many(_VARIABLES, described)
        return b"CDF\x02" + _int(0) + b"".join(parts)

    size = len(header([0] * len(data)))
    begins = np.cumsum([size, *(_padded(values.nbytes) for values in data)])[:-1].tolist()
    with path.open("wb") as file:
        file.write(header(begins))
        for values in data:
            file.write(values.tobytes().ljust(_padded(values.nbytes), b"\0"))


def _attributes(attributes: Mapping[str, str | float]) -> bytes:
    found = []
    for name, value in attributes.items():
        if isinstance(value, str):
            found.append(_text(name) + _int(_CHARACTERS) + _text(value))
        else:
            found.append(_text(name) + _int(_DOUBLE, 1) + struct.pack(">d", value))
    return _many(_ATTRIBUTES, found)


def _many(kind: int, members: list[bytes]) -> bytes:
    return _int(kind if members else 0, len(members)) + b"".join(members)


def _text(text: str) -> bytes:
    data = text.encode("utf-8")
    return _int(len(data)) + data.ljust(_padded(len(data)), b"\0")


def _int(*values: int) -> bytes:
    return struct.pack(f">{len(values)}i", *values)


def _padded(size: int) -> int:
    """Bytes up to the next multiple of four."""
    return size + -size % 4
