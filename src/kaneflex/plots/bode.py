"""Bode plots of a state space: response of outputs to harmonic inputs over the frequency (Bode 1945)."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from kaneflex.plots.style import PALETTE, legend_beside, new_figure
from kaneflex.solve.statespace import StateSpace
from kaneflex.support.errors import SceneError

_POLES = 6
"""Number of vibrating poles that the frequency axis includes."""
_POINTS = 600


def figure(system: StateSpace, title: str = "Frequency response") -> Figure:
    """Magnitude and phase of each output, a curve for each input. Raises SceneError where there is none of either."""
    for names, what, cure in ((system.inputs, "input", "Give the scene a load"),
                              (system.outputs, "output", "Give the scene a sensor")):  # fmt: skip
        if not names:
            raise SceneError("--bode", None, f"the state space has no {what}", cure)
    hertz, rows = frequencies(system), len(system.outputs)
    response = system.frequency_response(hertz)
    page = new_figure(12.0, 0.9 + 2.1 * rows, title)
    panels = page.subplots(rows, 2, sharex=True, squeeze=False)
    for k, (size, phase) in enumerate(panels):
        for j, (name, unit) in enumerate(zip(system.inputs, system.input_units, strict=True)):
            values, style = response[:, k, j], {"color": PALETTE[j % len(PALETTE)], "ls": ("-", "--")[j // 7 % 2]}
            if not values.any():
                continue
            size.loglog(hertz, abs(values), **style)
            label = f"{name} [{system.output_units[k]} by {unit}]"
            phase.semilogx(hertz, np.degrees(np.unwrap(np.angle(values))), label=label, **style)
        size.set(title=f"{system.outputs[k]}: magnitude", ylabel="output by input [SI]")
        phase.set(title=f"{system.outputs[k]}: phase", ylabel="phase [deg]")
        phase.yaxis.set_major_locator(MaxNLocator(6, steps=(1.8, 3.0, 4.5, 9.0, 10.0)))  # 45, 90, 180 ..
        if phase.get_lines():
            legend_beside(phase)
    for axes in panels[-1]:
        axes.set(xlabel="frequency [Hz]", xlim=(hertz[0], hertz[-1]))
    return page


def frequencies(system: StateSpace) -> np.ndarray:
    """Frequencies [Hz] about the lowest vibrations of a state space, evenly on a logarithmic axis and at the poles."""
    poles = system.poles[system.poles.imag > 1e-6 * abs(system.poles).max()]
    own = (abs(poles.imag) if len(poles) else np.array([2.0 * math.pi]))[:_POLES] / (2.0 * math.pi)
    even = np.geomspace(0.1 * own.min(), 2.0 * own.max(), _POINTS)
    return np.unique(np.concatenate([even, own]))
