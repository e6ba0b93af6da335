"""C compiler of the machine, for kernels and FMUs."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

_SHARED = ("-std=c11", "-shared", "-fPIC")


class CompilerError(Exception):
    """The C compiler failed; the text is its first message."""


def c_compiler() -> list[str]:
    """Command of the C compiler: the environment variable CC, else cc, gcc or clang; empty if there is none."""
    named = shlex.split(os.environ.get("CC", ""))
    found = next(filter(None, map(shutil.which, named[:1] or ("cc", "gcc", "clang"))), None)
    return [found, *named[1:]] if found else []


def shared_library(command: Sequence[str], texts: Mapping[str, str], flags: Sequence[str] = ()) -> bytes:
    """Content of the shared library of C files by name: those that end with ``.c``, which include the others.

    Raises
    ------
    CompilerError
        If the compiler fails.
    """
    with tempfile.TemporaryDirectory() as folder:
        for name, text in texts.items():
            Path(folder, name).write_text(text, encoding="utf-8", newline="\n")
        sources = [name for name in texts if name.endswith(".c")]
        called = [*command, *_SHARED, *flags, *sources, "-o", "library", "-lm"]
        try:
            done = subprocess.run(called, cwd=folder, capture_output=True, text=True, check=False)
        except OSError as error:
            raise CompilerError(str(error)) from error
        if done.returncode:
            raise CompilerError((done.stderr.strip().splitlines() or ["no message"])[0])
        return Path(folder, "library").read_bytes()
