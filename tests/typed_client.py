"""Ten lines of a user's own: they check clean under mypy --strict (see tests/check_types.py)."""

import numpy as np

import kaneflex

scene: kaneflex.Scene = kaneflex.with_settings(kaneflex.read_scene("engine"), ["drives.main.speed=1000rpm"])
model: kaneflex.Model = kaneflex.load(scene)
mass: np.ndarray = model.M(0.0)
solution: kaneflex.Solution = kaneflex.simulate(model)
peak = float(abs(solution.series["piston_side_force"].values).max())
verdict: kaneflex.Stability = kaneflex.stability(scene)
print(f"{peak:.1f} N", solution.warnings, verdict.findings["motion"], kaneflex.compare(scene).differences[0].peak_share)
