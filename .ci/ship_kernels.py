"""Add kernels compiled for this platform to a wheel: python .ci/ship_kernels.py WHEEL [SCENE ...]

The wheel is installed into an environment of its own, which runs the scenes with a cache of its own; where none is
named all that it brings, and the engine under every preset. The libraries that the C compiler makes meanwhile go into
the wheel: see kaneflex.support.c_library.
"""

import os
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

from wheel.wheelfile import WheelFile

RECORD = """
import sys

from kaneflex import shipped_scenes
from kaneflex.cli import main
from kaneflex.integrate.methods import METHODS

STEPS = [[f"solve.integrator={name}", f"solve.start={start}"]
         for name in METHODS if name not in ("spectral", "exact-modal", "scipy") for start in ("zero", "periodic")]
VARIANTS = {"engine": [[f"solve.preset={name}"] for name in ("rigid", "quasistatic", "linear", "coupled")] + STEPS}
scenes = sys.argv[1:]
for name in scenes or shipped_scenes():
    for settings in ([], *(VARIANTS.get(name, ()) if not scenes else ())):
        print(name, *settings, flush=True)
        words = [word for each in settings for word in ("--set", each)]
        main(["run", name, *words, "--no-plots", "--quiet", "--force", "-o", "results"], standalone_mode=False)
"""


def main(wheel: Path, scenes: list[str]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        here = Path(folder)
        venv.create(here / "venv", with_pip=True)
        python = here / "venv" / ("Scripts" if os.name == "nt" else "bin") / "python"
        subprocess.run([python, "-m", "pip", "install", "--quiet", wheel], check=True)
        environment = os.environ | {"NUMBA_CACHE_DIR": str(here / "cache"), "XDG_CACHE_HOME": str(here / "derived")}
        command = [python, "-I", "-W", "ignore", "-c", RECORD, *scenes]
        subprocess.run(command, cwd=here, env=environment, check=True)
        with_kernels = here / wheel.name
        with WheelFile(wheel) as old, WheelFile(with_kernels, "w") as new:
            for each in old.infolist():
                if not each.filename.endswith("/RECORD"):
                    new.writestr(each, old.read(each))
            for each in (here / "cache").glob("*.so"):
                new.write(each, f"kaneflex/support/{each.name}")
        os.replace(with_kernels, wheel)


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve(), sys.argv[2:])
