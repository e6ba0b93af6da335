"""Commands of the command line, each imported when it runs, so that ``--help`` is quick."""

from __future__ import annotations

import errno
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module

import click

from kaneflex.cli.scene import INTERRUPTED, USER_ERROR
from kaneflex.support.errors import UserError, nearest
from kaneflex.support.terminal import echo

GROUPS = {
    "Inspect": {
        "list": ("looking.list_", "Scenes, presets and integrators"),
        "new": ("mechanism.new", "Start a scene of your own"),
        "check": ("looking.check", "Check a scene without solving it"),
        "show": ("mechanism.show", "Draw a mechanism, count degrees of freedom"),
        "modes": ("looking.modes", "Natural frequencies and mode shapes"),
        "equations": ("mechanism.equations", "Print the equations as LaTeX"),
    },
    "Run": {
        "run": ("running.run", "Solve a scene"),
        "plot": ("running.plot", "Draw more pictures of a finished run"),
    },
    "Study": {
        "compare": ("compare.compare", "Compare models, or with another program"),
        "sweep": ("sweep.sweep", "Run a scene over ranges of parameters"),
        "explore": ("sweep.explore", "Change numbers with sliders"),
        "stability": ("stability.stability", "Floquet, buckling, Campbell diagram"),
        "trade": ("trade.trade", "Rank models by error and run time"),
        "terms": ("trade.terms", "Error and cost of each group of terms"),
    },
    "Export": {
        "derive": ("mechanism.derive", "Write the equations as Python or C"),
        "export": ("mechanism.export", "Write an FMU (FMI 2)"),
        "linearise": ("mechanism.linearise", "Write a state space at one instant"),
        "import": ("importing.import_link", "Finite elements to modal data"),
    },
}
"""Groups of commands: module and function of each, and its line in ``kaneflex --help``."""
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class _Refusal(click.ClickException):
    exit_code = USER_ERROR

    def show(self, file: object = None) -> None:
        for line in self.message.splitlines():
            echo(f"{'' if line.startswith(' ') else 'Error: '}{line}", err=True)


@contextmanager
def _ended_like_interrupted() -> Iterator[None]:
    """Clean up on SIGTERM (sent by batch systems and at shutdown) as on Ctrl-C."""

    def interrupt(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


class _Commands(click.Group):
    """Group of commands that turns user errors, Ctrl-C and SIGTERM into a message and an exit code."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return [name for group in GROUPS.values() for name in group]

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        """Command of this name; imports its module only."""
        places = {each: place for group in GROUPS.values() for each, (place, _) in group.items()}
        if name not in places:
            if not ctx.resilient_parsing:  # as of a shell that completes words
                ctx.fail(f"No such command {name!r}. {nearest(name, places)}.")
            return None
        module, _, attribute = places[name].partition(".")
        return getattr(import_module(f"kaneflex.cli.{module}"), attribute)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        for title, group in GROUPS.items():
            with formatter.section(title):
                formatter.write_dl([(name, short) for name, (_, short) in group.items()])

    def invoke(self, ctx: click.Context) -> object:
        try:
            with _ended_like_interrupted():
                return super().invoke(ctx)
        except click.BadOptionUsage as error:  # "requires 3 arguments", also where these are joined by commas
            more = " Separate them by spaces." * error.message.endswith(" arguments.")
            raise click.BadOptionUsage(error.option_name, error.message + more, error.ctx) from None
        except UserError as error:
            raise _Refusal(str(error)) from error
        except OSError as error:
            if error.errno not in _FULL:
                raise
            raise _Refusal(_disk_full(error)) from error
        except KeyboardInterrupt:
            echo("Interrupted; nothing was left behind.", err=True)
            ctx.exit(INTERRUPTED)


def _disk_full(error: OSError) -> str:
    """Message for a full disk; numba's cache of compiled kernels names no file."""
    file = f"{error.filename}: " if error.filename else ""
    caches = "set NUMBA_CACHE_DIR for compiled kernels, XDG_CACHE_HOME for derived equations"
    return f"{file}{error.strerror}. Free some space, or move the caches: {caches}."


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="kaneflex")
def main() -> None:
    """Simulate mechanisms with flexible links: motion, deformation, stresses and joint forces.

    SCENE is the name of a shipped scene (see `kaneflex list`) or the path of a TOML file. Quantities may have units:
    "137 mm", "6000 rpm", 90deg. Commas separate the items of lists: --sensors torque,strain. A colon separates the ends
    of a range: main.speed=2000:6000rpm. --set PATH=VALUE changes an entry of the scene. Exit codes: 0 done, 2 wrong
    input, 3 the run stopped early, 130 interrupted.

    \b
    First steps:
      kaneflex run engine                        results, summary and pictures in engine-results
      kaneflex run engine --set rod.elements=1   change one number
      kaneflex new press                         a commented scene of your own, press.toml
    """
