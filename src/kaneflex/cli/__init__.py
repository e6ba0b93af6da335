"""The command line: words in, folders out; nothing is computed here."""

import sys

try:
    from kaneflex.cli.commands import main
except KeyboardInterrupt:  # while the program starts
    print("Interrupted; nothing was left behind.", file=sys.stderr)
    sys.exit(130)

__all__ = ["main"]
