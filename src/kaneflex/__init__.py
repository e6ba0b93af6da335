"""Mechanisms with flexible links, from a scene file to numba kernels, by Kane's equations.

>>> import kaneflex
>>> scene = kaneflex.read_scene("engine")
>>> model = kaneflex.load(scene)
>>> solution = kaneflex.simulate(model)
>>> solution["mid_transverse"]  # a labelled array over time
"""

from importlib import import_module
from typing import TYPE_CHECKING

from kaneflex.support.numba_cache import ensure_cache_folder

ensure_cache_folder()  # before any jitted module can be imported

if TYPE_CHECKING:  # for checkers and editors, what __getattr__ brings at run time
    from kaneflex.multibody.model import Model as Model
    from kaneflex.scene import Scene as Scene
    from kaneflex.scene import read_scene as read_scene
    from kaneflex.scene import with_settings as with_settings
    from kaneflex.solve.coupled_state import read_state as read_state
    from kaneflex.solve.loading import load as load
    from kaneflex.solve.simulation import simulate as simulate
    from kaneflex.solve.solution import Solution as Solution
    from kaneflex.solve.statespace import StateSpace as StateSpace
    from kaneflex.solve.statespace import linearise as linearise
    from kaneflex.stability.report import Stability as Stability
    from kaneflex.stability.report import judge as judge
    from kaneflex.study.comparison import Comparison as Comparison
    from kaneflex.study.comparison import compare as compare
    from kaneflex.study.sensitivity.report import Sensitivities as Sensitivities
    from kaneflex.study.sensitivity.report import sensitivities as sensitivities
    from kaneflex.support.checking import checked as checked
    from kaneflex.support.errors import OutputError as OutputError
    from kaneflex.support.errors import SceneError as SceneError
    from kaneflex.support.errors import UserError as UserError
    from kaneflex.support.errors import ValidityWarning as ValidityWarning

_HOMES = {
    "Comparison": "kaneflex.study.comparison",
    "Model": "kaneflex.multibody.model",
    "OutputError": "kaneflex.support.errors",
    "Scene": "kaneflex.scene",
    "SceneError": "kaneflex.support.errors",
    "Sensitivities": "kaneflex.study.sensitivity.report",
    "Solution": "kaneflex.solve.solution",
    "Stability": "kaneflex.stability.report",
    "StateSpace": "kaneflex.solve.statespace",
    "UserError": "kaneflex.support.errors",
    "ValidityWarning": "kaneflex.support.errors",
    "checked": "kaneflex.support.checking",
    "compare": "kaneflex.study.comparison",
    "judge": "kaneflex.stability.report",
    "linearise": "kaneflex.solve.statespace",
    "load": "kaneflex.solve.loading",
    "read_scene": "kaneflex.scene",
    "read_state": "kaneflex.solve.coupled_state",
    "sensitivities": "kaneflex.study.sensitivity.report",
    "simulate": "kaneflex.solve.simulation",
    "with_settings": "kaneflex.scene",
}
__all__ = sorted(_HOMES)


def __getattr__(name: str) -> object:
    """Public names on first use: `import kaneflex` alone loads neither numba nor the scene's checks."""
    if name == "__version__":
        from importlib.metadata import version

        return version("kaneflex")
    if name not in _HOMES:
        raise AttributeError(f"module 'kaneflex' has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
