"""Output on the terminal, and progress on stderr of stages that take long."""

from __future__ import annotations

import logging
import shutil
import sys
import threading
import time
from collections.abc import Callable, Mapping
from types import TracebackType

from kaneflex.support.escaping import terminal

LOG = logging.getLogger("kaneflex")

_PATIENCE = 1.0
"""Time after which a stage is shown [s]."""


def echo(text: str = "", err: bool = False, nl: bool = True) -> None:
    """Print a text without control sequences, in letters of the terminal's encoding. All commands print with it."""
    import click

    Waiting.wipe()
    stream = sys.stderr if err else sys.stdout
    click.echo(terminal(text, getattr(stream, "encoding", None)), err=err, nl=nl)


def log_warning(text: str) -> None:
    """Warn about the machine's state, like a folder that can't be written, through the logger "kaneflex".

    Python's `warnings` are for faults of the calling code and would show a source line of kaneflex. Without
    configured logging, stderr shows this line only, like the commands' other warnings.
    """
    Waiting.wipe()
    LOG.warning("Warning: %s", text)


def silent(stage: object) -> None:
    """Ignore the progress."""


def share_of(progress: Callable[[str], None], name: str) -> Callable[[float], None]:
    """Begin a stage; return the function to report its finished share (0 to 1) to, if ``progress`` is a Waiting."""
    progress(name)
    return progress.share_of(name) if isinstance(progress, Waiting) else lambda done: None


def compiled_by(progress: Callable[[str], None], *compile: Callable[[], object]) -> float:
    """Seconds that compilation takes, by making these calls."""
    progress("compiling, first time only")
    started = time.perf_counter()
    for call in compile:
        call()
    return time.perf_counter() - started


def block(title: str, entries: Mapping[str, str]) -> str:
    """Names and their texts, indented under a bold title; empty without names."""
    if not entries:
        return ""
    import click

    width = max(map(len, entries))
    further = "\n" + " " * (width + 4)
    lines = [f"  {name:<{width}}  " + text.replace("\n", further) for name, text in entries.items()]
    return "\n".join([click.style(title, bold=True), *lines])


class Waiting:
    """Show the current stage on stderr after it has lasted a second; a context manager.

    A terminal shows one line with the finished share, which is removed at the end; other outputs get one line per
    stage. With the logger "kaneflex" at level INFO, the duration of every finished stage is logged and nothing else
    is shown; at a higher level of its own, nothing is shown.
    """

    _line = ""  # text on the terminal's last line, shared by all Waiting
    _lock = threading.RLock()

    def __init__(self) -> None:
        self._timer: threading.Timer | None = None
        self._name, self._began = "", 0.0

    def __enter__(self) -> Waiting:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._finish_stage()

    def __call__(self, name: str) -> None:
        """End the previous stage, if any, and begin stage ``name``."""
        self._finish_stage()
        self._name, self._began = name, time.perf_counter()
        if LOG.level:
            return
        self._timer = threading.Timer(_PATIENCE, self._show)
        self._timer.daemon = True
        self._timer.start()

    def share_of(self, name: str) -> Callable[[float], None]:
        """Function to report the finished share (0 to 1) of a stage to; its first call begins the stage ``name``."""

        def share(done: float) -> None:
            if self._name != name:
                self(name)
            with self._lock:
                if self._line:
                    self._draw(f"{name} ... {done:.0%}")

        return share

    def _finish_stage(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        if self._name:
            LOG.info("%s: %.3f s", self._name, time.perf_counter() - self._began)
            self._name = ""
        with self._lock:
            self._timer = None
            self.wipe()

    def _show(self) -> None:
        with self._lock:
            if self._timer is not threading.current_thread():
                return  # cancelled while it waited for the lock
            text = f"{self._name} ..."
            if sys.stderr.isatty():
                self._draw(text)
            else:
                print(terminal(text, sys.stderr.encoding), file=sys.stderr, flush=True)

    @classmethod
    def wipe(cls) -> None:
        """Clear the line on the terminal, so that other text can be written."""
        with cls._lock:
            if cls._line:
                cls._draw("")

    @classmethod
    def _draw(cls, text: str) -> None:
        """Overwrite the terminal's last line, with spaces over the rest of a longer text."""
        text = terminal(text, sys.stderr.encoding)[: shutil.get_terminal_size().columns - 1]
        if text != cls._line:
            end = "" if text else "\r"
            print(f"\r{text:<{len(cls._line)}}{end}", end="", file=sys.stderr, flush=True)
            cls._line = text
