"""The rod of docs/finite-elements.md: its numbers, the files that the page's scripts write, the commands it shows."""

import re
import shlex
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from command_line import cli
from scipy.sparse import csc_array
from scipy.sparse.linalg import eigsh

from kaneflex.fem.imported import matrices

PAGE = (Path(__file__).parent.parent / "docs" / "finite-elements.md").read_text(encoding="utf-8")
L, HEIGHT, WIDTH, E, RHO, NU = 0.137, 20e-3, 12e-3, 210e9, 7850.0, 0.3
AREA, I_Z, I_Y = HEIGHT * WIDTH, WIDTH * HEIGHT**3 / 12, HEIGHT * WIDTH**3 / 12
FILES = ("rod-mass.mtx", "rod-stiffness.mtx", "rod-nodes.txt")
ENDS = {"start": "big-eye.txt", "end": "small-eye.txt"}


def arguments(line: str, **changed: str) -> list[str]:
    """Of the one command of the page that a pattern finds, some of them changed."""
    (found,) = re.findall(rf"^kaneflex ({line})$", PAGE, re.MULTILINE)
    return [changed.get(word, word) for word in shlex.split(found)]


@contextmanager
def printed_by(command: list[str], folder: Path) -> Iterator[str]:
    """What a command prints, in a folder with the files, where one is meanwhile; each state of a file is read once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(matrices, "read_market", once_a_state(matrices.read_market))
        exec("".join(re.findall(r"^```python\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)), {})
        result = cli(*command)
        assert result.exit_code == 0, result.output
        yield result.output


def once_a_state(read: Callable[..., csc_array]) -> Callable[..., csc_array]:
    """A reader of a file that reads it again only if it has changed: 300,000 lines take half a second."""
    known: dict[tuple, csc_array] = {}

    def found(path: str, *arguments: object) -> csc_array:
        file = Path(path).stat() if Path(path).is_file() else None
        if file is None:
            return read(path, *arguments)
        state = (path, file.st_ino, file.st_mtime_ns, file.st_size, str(arguments))
        if state not in known:
            known[state] = read(path, *arguments)
        return known[state].copy()

    return found


def welded(K, M, rows: np.ndarray, count: int = 1) -> np.ndarray:
    """Lowest frequencies [Hz] of a mesh whose motions ``rows`` (m, n) stiff springs hold, by all of its unknowns."""
    held = csc_array(rows / np.linalg.norm(rows, axis=1)[:, None])
    squares = eigsh(csc_array(K) + 1e3 * abs(K).max() * (held.T @ held), count, csc_array(M), sigma=0.0)[0]
    return np.sqrt(np.sort(squares)) / (2.0 * np.pi)
