"""Runs near resonance: where what drives a mechanism meets a mode, the peak changes by far more than either does.

Each mode of the reference configuration is taken as an oscillator with its mean stiffness and damping over the run,
driven by its share of the load, the inertia of the rigid motion included. Its answer to a harmonic of frequency Omega,

    a = |f| / sqrt((omega^2 - Omega^2)^2 + (c Omega)^2),

says by how much the peak changes where omega does (Craig and Kurdila 2006, section 3.2).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from kaneflex.multibody.building import has_modes, keep_terms, reference_modes
from kaneflex.multibody.model import Model
from kaneflex.solve.solution import Solution

_MODES, _INSTANTS = 10, 64
"""Modes that are looked at, and instants over which their stiffness and damping are averaged."""
_CHANGE, _MOST = 0.01, 0.05
"""Change of a mode's frequency, and how much the largest displacement may change with it without a word."""
_COUNTS = 3.0
"""Amplification from which all of a coupled run's harmonic is taken as that of the mode near by."""
_NEAR, _FINE = 0.1, 4
"""Without a period: how far from a mode a line is looked for, as a share, and how many lines there are in 1 / duration.
"""


class _Resonance(NamedTuple):
    """``change`` of the largest displacement, as a share of it, by _CHANGE of a mode's frequency [Hz]."""

    change: float
    mode: int
    frequency: float
    driven: float
    amplified: float


def near_resonance(solution: Solution) -> list[str]:
    """A warning where a harmonic of what drives a run is so near to a mode that the peak depends on their distance."""
    model, span = solution.model, float(np.ptp(solution.times)) if len(solution.times) else 0.0
    moves = model.options.dynamics == "dynamic" or (model.coupled is not None and model.scene.period is not None)
    if not moves or len(solution.times) < 2 * _INSTANTS or model.module.FREE or not has_modes(model):
        return []
    found = max(_resonances(solution, span), default=None)  # by what it changes
    if found is None or found.change < _MOST:
        return []
    return [
        f"{_named(model, found.driven)} is near mode {found.mode}, {found.frequency:.4g} Hz, which amplifies it "
        f"{found.amplified:.2g} times: a change of either frequency by {_CHANGE:.0%} changes the largest displacement "
        f"by some {found.change:.0%}, of which the estimated errors know nothing; move one away from the other, damp "
        "the mode, or be sure of stiffness and mass"
    ]


def _named(model: Model, frequency: float) -> str:
    """What drives at a frequency [Hz]: an order of the drive that turns, or a harmonic of the cycle."""
    scene = model.scene
    for name, drive in scene.drives.items():
        if drive.period is not None and drive.speed and not scene.slides(name):
            return f"order {2.0 * math.pi * frequency / abs(drive.speed):.4g} of {name}, {frequency:.4g} Hz,"
    if scene.period is None:
        return f"the load at {frequency:.4g} Hz"
    return f"order {frequency * scene.period:.4g} of the cycle, {frequency:.4g} Hz,"


def _resonances(solution: Solution, span: float) -> Iterator[_Resonance]:
    """By mode, for the harmonics next to it."""
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
    # what starts with a run has not built up more of a resonance than its duration allows
    damping = damping + (0.0 if model.options.start == "periodic" else 2.0 / span)
    moved = max((_translations(link.dofs, solution.motion.nodes(name)) for name, link in model.links.items()),
                key=lambda nodes: abs(nodes).max())  # fmt: skip
    largest = abs(moved).max()
    force = None if coupled else rigid.column_of(kept["F"].projected(shapes))
    for k in np.flatnonzero((omega > 0.0) & (stiffness > 0.0)).tolist():
        own = math.sqrt(stiffness[k])
        series = moved[abs(moved).max(axis=1).argmax()] if force is None else force[k]
        for driven, part in _harmonics(solution, series, own / (2.0 * math.pi), span):
            answers = _answers(own * np.array([1.0 - _CHANGE, 1.0, 1.0 + _CHANGE]), damping[k], 2.0 * math.pi * driven)
            change, amplified = abs(answers / answers[1] - 1.0).max(), own**2 * answers[1]
            if force is not None:
                part *= _moved(model, shapes[:, k]) * answers[1]
            elif amplified < _COUNTS:
                continue
            share = min(1.0, part / max(largest, 1e-300))
            yield _Resonance(float(change * share), k + 1, own / (2.0 * math.pi), driven, float(amplified))


def _answers(own: np.ndarray, damping: float, turning: float) -> np.ndarray:
    """Displacements of oscillators of unit mass by a unit force of an angular frequency."""
    return 1.0 / np.hypot(own**2 - turning**2, damping * turning)


def _harmonics(solution: Solution, force: np.ndarray, near: float, span: float) -> list[tuple[float, float]]:
    """Frequency [Hz] and amplitude of the parts of a force (n_times,) next to a frequency."""
    times, period = solution.times, solution.model.scene.period
    if period is None:  # the largest line near by of a spectrum whose window leaves little of those that are far
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
    """The largest displacement of a node in a mode's shape (n,)."""
    assert model.frame is not None  # where there are modes
    rigid, sizes = model.motion.at(model.reference_time), [0.0]
    for name, link in model.links.items():
        own = rigid.apply(model.frame.maps[name], shape[:, None])
        own = model.bases[name] @ own if name in model.bases else own
        sizes.append(float(abs(_translations(link.dofs, link.at_nodes(own))).max()))
    return max(sizes)


def _translations(dofs: int, nodes: np.ndarray) -> np.ndarray:
    """Displacements along and across a link of its nodes (dofs nodes, n_times), without the rotations."""
    return nodes.reshape(-1, dofs, nodes.shape[1])[:, : 2 if dofs == 3 else 3].reshape(-1, nodes.shape[1])
