"""Script of a user: it checks clean under mypy --strict (see tests/check_types.py)."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import kaneflex

scene: kaneflex.Scene = kaneflex.with_settings(kaneflex.read_scene("engine"), ["drives.main.speed=1000rpm"])
model: kaneflex.Model = kaneflex.load(scene)
mass: np.ndarray = model.M(0.0)
solution: kaneflex.Solution = kaneflex.simulate(model)
peak = float(abs(solution.series["piston_side_force"].values).max())
verdict: kaneflex.Stability = kaneflex.stability("engine")
frequencies: np.ndarray = kaneflex.modes(solution, 2).frequencies
drawn: dict[str, Figure] = solution.plot("sensors")
files: list[Path] = solution.plot("sensors", folder="pictures")
page: Path = solution.report("pictures")
module: str = kaneflex.derive_code(model)
sources: dict[str, str] = kaneflex.derive_code("engine", "c")
kaneflex.export_fmu(Path("engine.toml")).save("engine.fmu")
settings: list[str] = kaneflex.explore(scene, ["main.speed=2000:6000rpm"])
window: Figure = kaneflex.explore(scene, ["main.speed=2000:6000rpm"], window=False)
points = {"start": "a.txt", "end": "b.txt"}
kaneflex.import_mesh("m.mtx", "k.mtx", "nodes.txt", points, units="mm-t").save(Path("rod.npz"))
print(f"{peak:.1f} N", solution.warnings, verdict.findings["motion"], kaneflex.compare(scene).differences[0].error)
