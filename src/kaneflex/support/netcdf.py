"""Writer of netCDF 3 files with 64-bit offsets: a header, then the numbers of one variable after the other, big-endian.

Format: NetCDF Classic and 64-bit Offset Format, Unidata (OGC 10-092r3). Reading is left to xarray and scipy, whose
import takes longer than solving the scene engine.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

Variable = tuple[tuple[str, ...], np.ndarray, Mapping[str, str | float]]
"""Variable: names of its dimensions, values in one of the types of netCDF 3, attributes."""
_TYPES = {"i1": 1, "S1": 2, "i2": 3, "i4": 4, "f4": 5, "f8": 6}
_CHARACTERS, _DOUBLE, _DIMENSIONS, _VARIABLES, _ATTRIBUTES = 2, 6, 10, 11, 12
_LARGEST = 2**32 - 1
"""Size written into the header for a variable of this many bytes or more."""


def write_netcdf(path: Path, variables: Mapping[str, Variable], attributes: Mapping[str, str | float]) -> None:
    """Write variables and global attributes. Variables that share a dimension have the same length along it."""
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
