"""The command line: words in, folders out; nothing is computed here."""

from kaneflex.cli.commands import main

__all__ = ["main"]
