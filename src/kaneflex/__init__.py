"""Mechanisms with flexible links, from a scene file to numba kernels, by Kane's equations.

>>> import kaneflex
>>> scene = kaneflex.read_scene("engine")
>>> model = kaneflex.load(scene)
>>> solution = kaneflex.simulate(model)
>>> solution["mid_transverse"]  # a labelled array over time
"""

import re
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from kaneflex.support.numba_cache import ensure_cache_folder

ensure_cache_folder()  # before any jitted module can be imported

if TYPE_CHECKING:  # for checkers and editors, what __getattr__ brings at run time
    from kaneflex.export.code import derive_code as derive_code
    from kaneflex.export.code import equations as equations
    from kaneflex.export.fmu import export_fmu as export_fmu
    from kaneflex.fem.imported.import_mesh import import_mesh as import_mesh
    from kaneflex.multibody.model.bound_model import Model as Model
    from kaneflex.plots import draw_all as draw_all
    from kaneflex.plots import explore as explore
    from kaneflex.plots import figures as figures
    from kaneflex.plots import show as show
    from kaneflex.report.page import write_report as write_report
    from kaneflex.scene import Scene as Scene
    from kaneflex.scene import read_scene as read_scene
    from kaneflex.scene import scene_of as scene_of
    from kaneflex.scene import shipped_scenes as shipped_scenes
    from kaneflex.scene import with_settings as with_settings
    from kaneflex.solve.initial import read_state as read_state
    from kaneflex.solve.linearisation import linearise as linearise
    from kaneflex.solve.loading import load as load
    from kaneflex.solve.modes import Modes as Modes
    from kaneflex.solve.modes import modes as modes
    from kaneflex.solve.simulation import simulate as simulate
    from kaneflex.solve.solution import Solution as Solution
    from kaneflex.solve.statespace import StateSpace as StateSpace
    from kaneflex.study.comparison import Comparison as Comparison
    from kaneflex.study.comparison import compare as compare
    from kaneflex.study.sensitivity.report import Sensitivities as Sensitivities
    from kaneflex.study.sensitivity.report import sensitivities as sensitivities
    from kaneflex.study.stability.report import Stability as Stability
    from kaneflex.study.stability.report import stability as stability
    from kaneflex.study.sweep import sweep as sweep
    from kaneflex.study.trade.terms import Terms as Terms
    from kaneflex.study.trade.terms import terms as terms
    from kaneflex.study.trade.trials import Trade as Trade
    from kaneflex.study.trade.trials import trade as trade
    from kaneflex.study.workers import in_processes as in_processes
    from kaneflex.support.checking import checked as checked
    from kaneflex.support.errors import OutputError as OutputError
    from kaneflex.support.errors import SceneError as SceneError
    from kaneflex.support.errors import UserError as UserError
    from kaneflex.support.errors import ValidityWarning as ValidityWarning

__version__ = "0.1.0"
_HOMES = {name: home for home, name in re.findall(r"from (\S+) import (\w+) as", Path(__file__).read_text("utf-8"))}
"""Public name -> its module, as the imports above say."""
__all__ = sorted(_HOMES)


def __getattr__(name: str) -> object:
    """Public names on first use: `import kaneflex` alone loads neither numba nor the scene's checks."""
    if name not in _HOMES:
        raise AttributeError(f"module 'kaneflex' has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
