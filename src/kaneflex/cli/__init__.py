"""Command line: reads arguments and writes folders; the computation is elsewhere."""

import os
import sys
from types import ModuleType

# Before numpy is imported. Matrices are small: further threads of BLAS only wait, which takes processor time.
for _name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

# Else pydantic imports thirty modules, those of email included, and looks through all installed packages for plugins.
_no_plugins = ModuleType("pydantic.plugin._loader")
vars(_no_plugins)["get_plugins"] = tuple
sys.modules.setdefault(_no_plugins.__name__, _no_plugins)

try:
    from kaneflex.cli.commands import main
except KeyboardInterrupt:  # while the program starts
    print("Interrupted; nothing was left behind.", file=sys.stderr)
    sys.exit(130)

__all__ = ["main"]
