"""Mutated finite elements: files of each format that is imported, with bytes, lines and numbers changed at random.

Whatever a file is, importing it ends in modal data of finite numbers or in the project's own error, in time.
`python tests/import_fuzz.py COUNT FIRST` imports COUNT of them from seed FIRST on and names those that do not.
"""

from __future__ import annotations

import itertools
import random
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from scene_fuzz import NUMBERS, broken, broken_text
from scipy.io import mmwrite
from scipy.sparse import coo_array, csc_array

from kaneflex.fem.imported.files import read_elements
from kaneflex.fem.imported.modal_arrays import imported_data
from kaneflex.support.errors import Fault

STRANGE = (*map(repr, NUMBERS), "1.0D+05", "1.0E", "--1", "1_0", "\N{FULLWIDTH DIGIT ONE}", "0x1", "1e999", "", "1 2")
SIZE = 5, 3, 3
"""Nodes along, across and through the lattice, ten millimetres apart."""


def lattice() -> tuple[np.ndarray, csc_array, csc_array]:
    """Places of the nodes [m], and mass and stiffness of springs between neighbours, three translations a node."""
    nodes = 0.01 * np.array([*itertools.product(*map(range, SIZE))], float) - [0.0, 0.01, 0.01]
    K = np.zeros((3 * len(nodes),) * 2)
    for i, j in itertools.combinations(range(len(nodes)), 2):
        along = nodes[j] - nodes[i]
        if np.linalg.norm(along) < 0.0175:  # the diagonal of a cell of 10 mm has 17.3 mm
            block = 1e7 * np.outer(along, along) / (along @ along)
            for (a, b), sign in {(i, i): 1, (j, j): 1, (i, j): -1, (j, i): -1}.items():
                K[3 * a : 3 * a + 3, 3 * b : 3 * b + 3] += sign * block
    return nodes, csc_array(0.002 * np.eye(len(K))), csc_array(K)


def written(folder: Path) -> dict[str, tuple[str, str, str]]:
    """Format -> the files of mass, stiffness and nodes; of what the installed packages read."""
    nodes, M, K = lattice()
    numbers = np.arange(1, len(nodes) + 1)
    lines = [f"{k} {x:.9g} {y:.9g} {z:.9g}" for k, (x, y, z) in zip(numbers, nodes, strict=True)]
    (folder / "nodes.txt").write_text("\n".join(lines) + "\n")
    of_abaqus = "\n".join(line.replace(" ", ", ") for line in lines)
    (folder / "nodes.inp").write_text(f"*NODE\n{of_abaqus}\n*END STEP\n")
    for name, part in (("start", nodes[:, 0] == 0.0), ("end", nodes[:, 0] == nodes[:, 0].max())):
        (folder / f"{name}.txt").write_text("\n".join(map(str, numbers[part])))
    for name, matrix in (("mass", M), ("stiffness", K)):
        mmwrite(folder / f"{name}.mtx", matrix, symmetry="symmetric")
        of = coo_array(matrix)
        node, axis = np.divmod(np.stack([of.row, of.col]), 3)
        entries = [*zip(node[0] + 1, axis[0] + 1, node[1] + 1, axis[1] + 1, of.data.tolist(), strict=True)]
        (folder / f"{name}-by-node.mtx").write_text("".join(f"{a},{b}, {c},{d}, {x!r}\n" for a, b, c, d, x in entries))
        (folder / f"{name}-by-row.mtx").write_text(
            "".join(f"{r + 1} {c + 1} {x!r}\n" for r, c, x in zip(of.row, of.col, of.data.tolist(), strict=True))
        )
        if find_spec("pyyeti"):
            _punched(folder / f"{name}.pch", "mk"[name == "stiffness"], matrix, numbers)
    found = {
        "market": ("mass.mtx", "stiffness.mtx", "nodes.txt"),
        "abaqus": ("mass-by-node.mtx", "stiffness-by-node.mtx", "nodes.inp"),
        "coordinate": ("mass-by-row.mtx", "stiffness-by-row.mtx", "nodes.txt"),
    }
    if find_spec("pyyeti"):
        found["punch"] = ("mass.pch", "stiffness.pch", "nodes.txt")
    return found


def _punched(file: Path, name: str, matrix: csc_array, numbers: np.ndarray) -> None:
    import pandas as pd
    from pyyeti import nastran

    index = pd.MultiIndex.from_product([numbers, [1, 2, 3]], names=["id", "dof"])
    nastran.wtdmig(str(file), {f"{name}aax": pd.DataFrame(matrix.toarray(), index=index, columns=index)})


def _changed(text: str, pick: random.Random) -> bytes:
    """The text with one number, one line or a few bytes changed."""
    if pick.random() < 0.3:
        return broken_text(text, pick)
    lines = text.splitlines()
    at, other = pick.randrange(len(lines)), pick.randrange(len(lines))
    match pick.randrange(5):
        case 0:
            del lines[at]
        case 1:
            lines.insert(at, lines[other])
        case 2:
            lines[at], lines[other] = lines[other], lines[at]
        case _:
            words = lines[at].replace(",", " , ").split(" ")
            places = [k for k, word in enumerate(words) if word.strip("+-.").isalnum()] or [0]
            words[pick.choice(places)] = pick.choice(STRANGE)
            lines[at] = " ".join(words)
    return ("\n".join(lines) + "\n").encode()


class Mutants:
    """Arguments of an import by seed; the files of all formats stand in one folder, one of them changed."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.formats = folder, written(folder)
        named = {name for files in self.formats.values() for name in files} | {"start.txt", "end.txt"}
        self.texts = {name: (folder / name).read_text() for name in sorted(named)}
        self.changed = ""

    def write(self, seed: int) -> tuple[str, tuple[str, ...], bool, bool]:
        """Format, files, whether in space, and whether ends are rigid."""
        pick = random.Random(seed)
        if self.changed:
            (self.folder / self.changed).write_text(self.texts[self.changed])
        form = pick.choice([*self.formats])
        files = self.formats[form]
        self.changed = pick.choice([*files, *files, "start.txt", "end.txt"])
        (self.folder / self.changed).write_bytes(_changed(self.texts[self.changed], pick))
        rigid = pick.random() < 0.5
        return form, tuple(str(self.folder / name) for name in files), pick.random() < 0.3, rigid


def examine(given: tuple[str, tuple[str, ...], bool, bool]) -> object:
    """The modal data of an import, or its refusal."""
    _, files, spatial, rigid = given
    folder = Path(files[0]).parent
    points = {name: str(folder / f"{name}.txt") for name in ("start", "end")}
    try:
        link = read_elements(*files, points, spatial=spatial)
        data: Any = imported_data(link, 2, rigid)
    except Fault as fault:
        assert fault.reason and fault.cure and len(str(fault)) < 2000
        return fault
    for name, array in data.arrays.items():
        assert np.isfinite(array).all(), name
    return data


def main() -> None:
    count, first = (int(number) for number in (*sys.argv[1:], "500", "0")[:2])
    started = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        found = broken(Mutants(Path(folder)), range(first, first + count), limit=60.0, examine=examine)
    print(*found, f"{count} mutated imports in {time.monotonic() - started:.0f} s: {len(found)} broken", sep="\n")
    sys.exit(bool(found))


if __name__ == "__main__":
    main()
