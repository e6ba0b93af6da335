"""The rod of docs/finite-elements.md: its numbers, the files that the page's scripts write, the commands it shows."""

import re
import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from command_line import cli

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
    """What a command prints, in a folder with the files, where one is meanwhile."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        exec("".join(re.findall(r"^```python\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)), {})
        result = cli(*command)
        assert result.exit_code == 0, result.output
        yield result.output
