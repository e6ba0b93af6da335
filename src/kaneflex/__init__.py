"""Mechanisms with flexible links, from a scene file to numba kernels, by Kane's equations.

>>> import kaneflex
>>> scene = kaneflex.read_scene("engine")
>>> model = kaneflex.load(scene)
>>> solution = kaneflex.simulate(model)
>>> solution["mid_transverse"]  # a labelled array over time
"""

from importlib import import_module

from kaneflex.support.numba_cache import ensure_cache_folder

ensure_cache_folder()  # before any jitted module can be imported

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
