"""Command line: reads arguments and writes folders; the computation is elsewhere."""

import os
import sys

os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # else it looks through all installed packages for them

try:
    from kaneflex.cli.commands import main
except KeyboardInterrupt:  # while the program starts
    print("Interrupted; nothing was left behind.", file=sys.stderr)
    sys.exit(130)

__all__ = ["main"]
