"""What a person sees while waiting, on stderr, and only where waiting lasts."""

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
"""Seconds that a stage may take before anything is shown of it."""


def echo(text: str = "", err: bool = False, nl: bool = True) -> None:
    """Print a text, by which no terminal is told what to do, in letters that it has. No command prints otherwise."""
    import click

    Waiting.wipe()
    stream = sys.stderr if err else sys.stdout
    click.echo(terminal(text, getattr(stream, "encoding", None)), err=err, nl=nl)


def log_warning(text: str) -> None:
    """Warn of the machine's state, like a folder that can't be written, by the logger "kaneflex".

    Python's `warnings` are for what the calling code can change, and would show a line of ours. Where nobody has
    configured logging, what stands on stderr is this line alone, as the commands' other warnings.
    """
    Waiting.wipe()
    LOG.warning("Warning: %s", text)


def silent(stage: object) -> None:
    """Progress that nobody asked for."""


def share_of(progress: Callable[[str], None], name: str) -> Callable[[float], None]:
    """Begin a stage; what then takes its finished share, 0 to 1, where ``progress`` is one to tell, as Waiting is."""
    progress(name)
    return progress.share_of(name) if isinstance(progress, Waiting) else lambda done: None


def block(title: str, entries: Mapping[str, str]) -> str:
    """Names and what is said of them, indented under a bold title; nothing where there are none."""
    if not entries:
        return ""
    import click

    width = max(map(len, entries))
    further = "\n" + " " * (width + 4)
    lines = [f"  {name:<{width}}  " + text.replace("\n", further) for name, text in entries.items()]
    return "\n".join([click.style(title, bold=True), *lines])


class Waiting:
    """Names the stage that is under way, once it has lasted a second.

    A terminal shows one line, which says the finished share and vanishes at the end; anything else gets a line a stage.
    Where the logger "kaneflex" is to tell (level INFO), it says of every finished stage how long it took, and nothing
    else is shown; where its own level is higher, nothing is. To be used in a ``with`` statement.
    """

    _line = ""  # what stands on the terminal's last line, of whichever Waiting is under way
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
        self.stage(name)

    def stage(self, name: str) -> None:
        """The stage before, if any, is over; ``name`` begins."""
        self._finish_stage()
        self._name, self._began = name, time.perf_counter()
        if LOG.level:
            return
        self._timer = threading.Timer(_PATIENCE, self._show)
        self._timer.daemon = True
        self._timer.start()

    def share_of(self, name: str) -> Callable[[float], None]:
        """What takes the finished share of a stage, 0 to 1; its first call begins the stage ``name``."""

        def share(done: float) -> None:
            if self._name != name:
                self.stage(name)
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
        """Take the line off the terminal, so that something else can be written there."""
        with cls._lock:
            if cls._line:
                cls._draw("")

    @classmethod
    def _draw(cls, text: str) -> None:
        """Write a text over the terminal's last line, with spaces over what is left of the longer one before."""
        text = terminal(text, sys.stderr.encoding)[: shutil.get_terminal_size().columns - 1]
        if text != cls._line:
            end = "" if text else "\r"
            print(f"\r{text:<{len(cls._line)}}{end}", end="", file=sys.stderr, flush=True)
            cls._line = text
