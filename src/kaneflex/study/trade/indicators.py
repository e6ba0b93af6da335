"""Effect of each group of terms along the quasi-static solution, before any model is run."""

from __future__ import annotations

import numpy as np

from kaneflex.fem.assembly import spin_or_euler
from kaneflex.mechanism.affine import Affine
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.building import has_modes, reference_modes
from kaneflex.response.frozen import buckling
from kaneflex.scene import Scene, with_settings
from kaneflex.solve.free_motion import integrated
from kaneflex.solve.loading import load
from kaneflex.solve.quasistatic import answers, quasistatic

_SAMPLES = 360
"""Instants over the cycle or run."""
_BUCKLING_SAMPLES = 24


def indicators(scene: Scene) -> dict[str, float | None]:
    """First-order changes of the quasi-static displacements by group of terms, and two ratios.

    Leaving a term A(t) z out of K z = F changes the solution by K^-1 A z to first order, where z is the quasi-static
    solution with every term. The change is relative to the largest displacement of its kind (axial, transverse,
    rotation, ...); the largest value counts. For "dynamics" the term is M z'' + C z', which quasi-statics neglects.

    Parameters
    ----------
    scene : Scene
        Neutral scene, see :func:`kaneflex.study.trade.candidates.neutral`.

    Returns
    -------
    mapping of str to float or None
        "spin", "euler", "geometric", "gyroscopic", "damping", "dynamics"; "speed_ratio", the fastest turning drive's
        speed over the lowest natural frequency, and "buckling_ratio", the reciprocal of the least load factor of
        :func:`kaneflex.response.frozen.buckling`; None if not defined.

    Raises
    ------
    SceneError
        If the scene can't be loaded.
    """
    model = integrated(load(with_settings(scene, [f"solve.steps={_SAMPLES}"])))
    speeds = [abs(drive.speed or 0.0) for name, drive in model.scene.drives.items() if not model.scene.slides(name)]
    lowest = float(reference_modes(model, 1)[0][0]) if has_modes(model) else 0.0
    margin = buckling(model, np.linspace(0.0, model.options.duration, _BUCKLING_SAMPLES))
    ratios = {"speed_ratio": max(speeds, default=0.0) / lowest if lowest > 0 else None,
              "buckling_ratio": None if margin is None else 1.0 / margin.margin}  # fmt: skip
    times = model.step * np.arange(_SAMPLES + 1)
    try:
        z, v, a = quasistatic(model, times, periodic=model.options.cycles)
        changes = {name: _change(model, times, z, term) for name, term in _terms(model, times, z, v, a).items()}
    except np.linalg.LinAlgError:  # K is singular at some instant: the mechanism is not restrained
        changes = dict.fromkeys(("spin", "euler", "geometric", "gyroscopic", "damping", "dynamics"))
    return changes | ratios


def _terms(
    model: Model, times: np.ndarray, z: np.ndarray, v: np.ndarray, a: np.ndarray
) -> dict[str, np.ndarray]:
    """Forces of each group of terms along z, (n_times, n)."""
    equations, rigid = model.reduced, model.motion.at(times)

    def force(affine: Affine, along: np.ndarray) -> np.ndarray:
        return rigid.apply(affine, along.T).T

    damping = force(equations.C_s, v) + force(equations.K_c, z)
    gyroscopic = force(equations.C_d, v)
    return {
        "spin": force(equations.K_d.only(lambda monomial: spin_or_euler(monomial) != "euler"), z),
        "euler": force(equations.K_d.only(lambda monomial: spin_or_euler(monomial) == "euler"), z),
        "geometric": force(equations.K_g, z),
        "gyroscopic": gyroscopic,
        "damping": damping,
        "dynamics": force(equations.M, a) + gyroscopic + damping,
    }


def _change(model: Model, times: np.ndarray, z: np.ndarray, term: np.ndarray) -> float:
    """Ratio max|K^-1 term| / max|z| within one kind of coordinates; the largest over all kinds."""
    if not term.any():
        return 0.0
    change = abs(answers(model, times, term)).max(axis=0)
    peaks = abs(z).max(axis=0)
    kinds = np.array([name.rpartition(".")[2] for name in model.reduced.coordinates])
    largest = ((change[kinds == kind].max(), peaks[kinds == kind].max()) for kind in np.unique(kinds))
    return max((float(change / peak) for change, peak in largest if peak > 0), default=0.0)
