"""Warnings from the linear equations of a run: lost stiffness, and resonance.

Near resonance the peak depends strongly on the distance of excitation and mode. Each mode of the reference
configuration is an oscillator with its mean stiffness and damping over the run, excited by its share of the load and of
the rigid motion's inertia. Its amplitude for a harmonic of frequency Omega,

    a = |f| / sqrt((omega^2 - Omega^2)^2 + (c Omega)^2),

gives the change of the peak with omega (Craig and Kurdila 2006, section 3.2).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.building import has_modes, keep_terms, reference_modes
from kaneflex.solve.run_result import RunResult

_MODES, _INSTANTS = 10, 64
"""Number of modes checked, and instants over which their stiffness and damping are averaged."""
_CHANGE, _MOST = 0.01, 0.05
"""Relative change of a mode's frequency, and the resulting change of the largest displacement that is
accepted."""
_COUNTS = 3.0
"""Amplification above which a coupled run's harmonic is attributed to the nearest mode."""
_NEAR, _FINE = 0.1, 4
"""Without a period: relative distance from a mode within which a spectral line is searched, and lines per 1 /
duration."""


class _Resonance(NamedTuple):
    """Relative ``change`` of the largest displacement by _CHANGE of a mode's frequency [Hz]."""

    change: float
    mode: int
    frequency: float
    driven: float
    amplified: float


_ROUNDING = 1e-9
"""Reduction of the stiffness by K_g, as a share, below which it counts as rounding."""

_FREE = 1e-12
"""Remaining share of a diagonal stiffness, others eliminated, below which the mechanism counts as unrestrained."""
_CHECKED = 36
"""Instants of a run that are checked."""
_NO_FREQUENCY = 1e-13
"""Share of the highest squared frequency below which one counts as zero."""
_LARGEST = 200
"""Coordinates up to which the check costs little compared with a run; for more use `kaneflex stability`."""


def near_resonance(solution: RunResult) -> list[str]:
    """Warning if a harmonic of the excitation is so close to a mode that the peak depends on their distance."""
    model, span = solution.model, float(np.ptp(solution.times)) if len(solution.times) else 0.0
    moves = model.options.dynamics == "dynamic" or (model.coupled is not None and model.scene.period is not None)
    if not moves or len(solution.times) < 2 * _INSTANTS or model.module.FREE or not has_modes(model):
        return []
    found = max(_resonances(solution, span), default=None)  # by change
    if found is None or found.change < _MOST:
        return []
    return [
        f"{_named(model, found.driven)} is near mode {found.mode}, {found.frequency:.4g} Hz, which amplifies it "
        f"{found.amplified:.2g} times: a change of either frequency by {_CHANGE:.0%} changes the largest displacement "
        f"by about {found.change:.0%}, which the error estimates do not include; separate the frequencies, add "
        "damping, or check stiffness and mass"
    ]


def _named(model: Model, frequency: float) -> str:
    """Name of an excitation of a frequency [Hz]: order of the drive or of the cycle."""
    scene = model.scene
    for name, drive in scene.drives.items():
        if drive.period is not None and drive.speed and not scene.slides(name):
            return f"order {2.0 * math.pi * frequency / abs(drive.speed):.4g} of {name}, {frequency:.4g} Hz,"
    if scene.period is None:
        return f"the load at {frequency:.4g} Hz"
    return f"order {frequency * scene.period:.4g} of the cycle, {frequency:.4g} Hz,"


def _resonances(solution: RunResult, span: float) -> Iterator[_Resonance]:
    """Resonances of each mode with the nearest harmonics."""
    model, rigid = solution.model, solution.motion.rigid
    omega, shapes = reference_modes(model, min(model.equations.size, _MODES))
    kept, coupled = keep_terms(model.equations, model.options), model.coupled is not None
    few = model.motion.at(model.reference_time) if coupled else rigid.taken(
        np.linspace(0, len(rigid.times) - 1, _INSTANTS).astype(int)
    )  # fmt: skip
    stiffness, damping = (
        np.nanmean(few.matrices(part.congruent(shapes)), axis=0).diagonal()
        for part in ((model.equations.K_s, model.equations.C_s) if coupled else (kept["K"], kept["C"]))
    )
    # a resonance that starts with the run is limited by its duration
    damping = damping + (0.0 if model.options.start == "periodic" else 2.0 / span)
    moved = max((_translations(link.dofs, solution.motion.nodes(name)) for name, link in model.links.items()),
                key=lambda nodes: abs(nodes).max())  # fmt: skip
    largest = abs(moved).max()
    force = None if coupled else rigid.column_of(kept["F"].projected(shapes))
    for k in np.flatnonzero((omega > 0.0) & (stiffness > 0.0)).tolist():
        own = math.sqrt(stiffness[k])
        series = moved[abs(moved).max(axis=1).argmax()] if force is None else force[k]
        for driven, part in _harmonics(solution, series, own / (2.0 * math.pi), span):
            near, turning = own * np.array([1.0 - _CHANGE, 1.0, 1.0 + _CHANGE]), 2.0 * math.pi * driven
            answers = 1.0 / np.hypot(near**2 - turning**2, damping[k] * turning)  # of unit mass to a unit force
            change, amplified = abs(answers / answers[1] - 1.0).max(), own**2 * answers[1]
            if force is not None:
                part *= _moved(model, shapes[:, k]) * answers[1]
            elif amplified < _COUNTS:
                continue
            share = min(1.0, part / max(largest, 1e-300))
            yield _Resonance(float(change * share), k + 1, own / (2.0 * math.pi), driven, float(amplified))


def _harmonics(solution: RunResult, force: np.ndarray, near: float, span: float) -> list[tuple[float, float]]:
    """Frequency [Hz] and amplitude of a force's (n_times,) harmonics next to a frequency."""
    times, period = solution.times, solution.model.scene.period
    if period is None:  # largest nearby line of a windowed spectrum
        window = np.hanning(len(times))
        lines = 2.0 * abs(np.fft.rfft(window * force, _FINE * len(times))) / window.sum()
        frequencies = np.arange(len(lines)) / (_FINE * span)
        around = np.flatnonzero(abs(frequencies - near) < _NEAR * near)
        best = around[lines[around].argmax()] if len(around) else 0
        return [(float(frequencies[best]), float(lines[best]))] if best else []
    cycles, order = math.floor(span / period + 1e-6), math.floor(near * period)
    rows = times > times[-1] - cycles * period * (1.0 - 1e-9)
    frequencies = np.array([k for k in (order, order + 1) if k > 0 and cycles]) / period
    turns = np.exp(-2j * np.pi * np.outer(frequencies, times[rows]))
    return list(zip(frequencies.tolist(), (2.0 * abs(turns @ force[rows]) / max(1, rows.sum())).tolist(), strict=True))


def _moved(model: Model, shape: np.ndarray) -> float:
    """Largest displacement of a node in a mode's shape (n,)."""
    assert model.frame is not None  # exists if there are modes
    rigid, sizes = model.motion.at(model.reference_time), [0.0]
    for name, link in model.links.items():
        own = rigid.apply(model.frame.maps[name], shape[:, None])
        own = model.bases[name] @ own if name in model.bases else own
        sizes.append(float(abs(_translations(link.dofs, link.at_nodes(own))).max()))
    return max(sizes)


def _translations(dofs: int, nodes: np.ndarray) -> np.ndarray:
    """Axial and transverse displacements of a link's nodes (dofs nodes, n_times), without rotations."""
    return nodes.reshape(-1, dofs, nodes.shape[1])[:, : 2 if dofs == 3 else 3].reshape(-1, nodes.shape[1])


def load_factors(stiffness: np.ndarray, more: np.ndarray) -> np.ndarray | None:
    """Smallest lambda > 0 at which stiffness + lambda more is singular, for stacks (n_times, n, n): (n_times,).

    Only the symmetric part of ``more`` counts. None if a stiffness is not positive definite.
    """
    try:
        lower = np.linalg.cholesky(stiffness)
    except np.linalg.LinAlgError:
        return None
    if (np.einsum("kii->ki", lower) ** 2 < _FREE * np.einsum("kii->ki", stiffness)).any():
        return None
    half = np.linalg.solve(lower, 0.5 * (more + more.swapaxes(1, 2)))
    unit = np.linalg.solve(lower, half.swapaxes(1, 2))
    # stiffness + lambda more = L (1 + lambda U) L^T is singular if 1 / lambda is minus an eigenvalue of U
    inverse = -np.linalg.eigvalsh(unit)[:, 0]
    factors = np.full(len(stiffness), np.inf)
    pushed = inverse > _ROUNDING
    factors[pushed] = 1.0 / inverse[pushed]
    return factors


def lost_stiffness(model: Model, times: np.ndarray) -> list[str]:
    """Warnings if K_s + K_g, or K_s + K_d without K_g, is not positive definite at some of ``times`` [s]."""
    options, size = model.options, model.equations.size
    if options.dynamics == "frozen":
        squares = model.kept["K"].value({}).diagonal()
        if not squares.min(initial=0.0) < -_NO_FREQUENCY * abs(squares).max(initial=0.0):
            return []
        rate = float(np.sqrt(-squares.min()))
        return [
            f"the frozen stiffness is not positive definite because of the spin: a mode grows as exp({rate:.4g} t); "
            "preset stiffened keeps K_g, the stiffening by axial forces"
        ]
    if options.dynamics not in ("dynamic", "quasistatic") or not 0 < size <= _LARGEST:
        return []
    if not options.geometric and not options.spin:
        return []
    rigid = model.motion.at(times[:: max(1, len(times) // _CHECKED)])
    equations = model.equations
    more = equations.K_g if options.geometric else equations.K_d
    factors = load_factors(rigid.matrices(equations.K_s), rigid.matrices(more))
    if factors is None or not factors.min() < 1.0:
        return []
    at = f"t = {rigid.times[int(factors.argmin())]:.4g} s"
    if options.geometric:
        return [
            f"the axial forces exceed a buckling load at {at}, with a load factor of {factors.min():.3g}; check with "
            f"kaneflex stability whether the motion is stable"
        ]
    return [
        f"the stiffness is not positive definite at {at} because of the spin, and K_g, the stiffening by axial forces, "
        "is left out; use preset stiffened"
    ]
