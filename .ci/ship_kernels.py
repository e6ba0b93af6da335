"""Add kernels compiled for this platform to a wheel: python .ci/ship_kernels.py WHEEL [SCENE ...]

The wheel is installed into an environment of its own, which runs the scenes with a cache of its own; where none is
named all that it brings, and the engine under every preset. What numba and the C compiler compile of the package
meanwhile goes into the wheel: see kaneflex.support.shipped_kernels and kaneflex.multibody.compile.c_library.
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
from pathlib import Path

from kaneflex import shipped_scenes
from kaneflex.cli import main
from kaneflex.integrate.methods import METHODS
from kaneflex.support.shipped_kernels import archive_name, recording

STEPS = [[f"solve.integrator={name}", f"solve.start={start}"]
         for name in METHODS if name not in ("spectral", "exact-modal", "scipy") for start in ("zero", "periodic")]
VARIANTS = {"engine": [[f"solve.preset={name}"] for name in ("rigid", "quasistatic", "linear", "coupled")] + STEPS}
folder, *scenes = sys.argv[1:]
with recording(Path(folder) / archive_name()):
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
        (here / "kernels").mkdir()
        environment = os.environ | {"NUMBA_CACHE_DIR": str(here / "cache"), "XDG_CACHE_HOME": str(here / "derived")}
        command = [python, "-I", "-W", "ignore", "-c", RECORD, here / "kernels", *scenes]
        subprocess.run(command, cwd=here, env=environment, check=True)
        (archive,) = (here / "kernels").iterdir()
        with_kernels = here / wheel.name
        with WheelFile(wheel) as old, WheelFile(with_kernels, "w") as new:
            for each in old.infolist():
                if not each.filename.endswith("/RECORD"):
                    new.writestr(each, old.read(each))
            for each in (archive, *(here / "cache").glob("engine-*.so")):
                new.write(each, f"kaneflex/support/{each.name}")
        os.replace(with_kernels, wheel)


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve(), sys.argv[2:])
