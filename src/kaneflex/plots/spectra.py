"""Spectra of a test bench's accelerations and axial forces, paper Figs. 30, 31; orders of periodic runs."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, NullLocator

from kaneflex.multibody.model.building import has_modes, reference_modes
from kaneflex.plots.sensors import accelerations, grouped, quantity_of
from kaneflex.plots.style import GREY, PALETTE, finish, legend_above, legend_beside, new_figure, pages, readable
from kaneflex.plots.view import view
from kaneflex.solve.coupled_linearisation import modes_at_rest
from kaneflex.support.errors import SceneError

if TYPE_CHECKING:
    from kaneflex.multibody.model.bound_model import Model
    from kaneflex.solve.solution import Solution

_FLOOR = 1e-4
"""A spectrum is drawn up to the last frequency whose amplitude exceeds this share of the largest."""
_RANGE = 1e-6
"""Amplitudes below this share of the largest are left out."""
_STIFF = 1e-6
"""Share of the highest natural frequency below which one is rounding's."""
_DECADES = 3000
"""A spectrum of more lines has a logarithmic axis of frequencies."""
_NATURAL = 6
_LOWEST = 1e-4
"""Share of a panel's largest amplitude below which none is drawn."""
_SEEN = 1e-3
"""Share of it that an amplitude must reach for the axis to go as far."""
_CLOSED = 1e-3
"""Share of what a sensor spans by which it may miss its first value at the end of the cycle."""
_SAME = 1e-9
"""Share of the largest value of its unit up to which what a sensor spans is taken for rounding."""


def spectrum(times: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One-sided amplitude spectrum of a record, Hann window with its gain corrected (Harris 1978).

    The mean is removed as the window weighs it, so that nothing of it leaks into the lowest lines.

    Parameters
    ----------
    times : ndarray (n + 1,)
        Equally spaced instants [s]; the last sample, which may be nearer, only ends the record of T = n steps.
    values : ndarray (n + 1,)

    Returns
    -------
    ndarray, ndarray
        Frequencies [Hz], their distance 1/T, and amplitudes in the unit of ``values``; both (n // 2 + 1,).
    """
    n = len(times) - 1
    window = 0.5 - 0.5 * np.cos(2 * math.pi * np.arange(n) / n)
    record = values[:-1] - np.average(values[:-1], weights=window)
    amplitudes = 2.0 / window.sum() * np.abs(np.fft.rfft(window * record))
    amplitudes[-1] /= 2 - n % 2  # half the sampling rate has no negative counterpart
    return np.arange(len(amplitudes)) / (n * (times[1] - times[0])), amplitudes


def figures(solution: Solution) -> dict[str, Figure]:
    """``orders`` of a periodic run; for other runs ``spectra`` of accelerations, accelerometers first, and axial
    forces."""
    if solution.model.options.cycles:
        return orders(solution)
    times, sensors = solution.times, solution.model.scene.sensors
    names = sorted(accelerations(solution), key=lambda name: sensors[name].reading)
    if len(times) < 16 or not names:
        return {}
    names += [name for name, sensor in sensors.items() if sensor.kind == "axial_force"]
    resolution = 1.0 / (times[-1] - times[0])
    spectra = {name: spectrum(times, solution.series[name].values) for name in names}
    title = f"Amplitude spectra, resolution 1/T = {resolution:.3g} Hz (Hann window)"
    figure = new_figure(7.4, 0.7 + 1.8 * len(names), title)
    panels = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
    reach = max(_last_above(*spectra[name]) for name in names)
    over_decades = reach > _DECADES * resolution  # slow motion and quick vibrations in one picture
    scale, unit = (1.0, "Hz") if over_decades else readable("Hz", np.array([reach]))
    lines = marked(solution, reach)
    for axes, name in zip(panels, names, strict=True):
        frequencies, amplitudes = spectra[name]
        factor, label = readable(solution.series[name].unit, amplitudes)
        axes.semilogy(scale * frequencies[1:], factor * amplitudes[1:], linewidth=0.9)
        for value, style, what in lines:
            axes.axvline(scale * value, color=GREY, linestyle=style, linewidth=0.8, label=what, zorder=1)
        top = factor * amplitudes.max() or 1.0
        axes.set(title=name, ylabel=f"amplitude [{label}]", ylim=(_RANGE * top, 3 * top))
    if lines:
        legend_above(panels[0])
    if over_decades:
        panels[-1].set_xscale("log")
        panels[-1].set_xlim(scale * resolution, scale * reach)
    else:
        panels[-1].set_xlim(0, scale * reach)
    panels[-1].set_xlabel(f"frequency [{unit}]")
    return {"spectra": figure}


def marked(solution: Solution, reach: float) -> list[tuple[float, str, str | None]]:
    """Frequencies [Hz] to compare with, below ``reach``: drives', natural ones; the first of a kind has a label."""
    model = solution.model
    scene = model.scene
    speeds = {abs(drive.speed or 0.0) for drive in scene.drives.values()} - {0.0}
    natural = _natural(model)[:_NATURAL] / (2 * math.pi)
    sampling = (len(solution.times) - 1) / np.ptp(solution.times)
    # What is above half the sampling rate shows folded back; only exact modes keep their frequency there.
    high = natural[natural > 0.5 * sampling] if model.options.dynamics == "frozen" else np.zeros(0)
    kinds = (
        (np.array(sorted(speeds)) / (2 * math.pi), ":", "drive"),
        (natural, "--", "natural, where nothing touches" if scene.contacts else "natural, at the reference angle"),
        (np.abs(high - np.round(high / sampling) * sampling), "-.", "natural, aliased by the sampling"),
    )
    marked = []
    for values, style, what in kinds:
        marked += [(value, style, what if k == 0 else None) for k, value in enumerate(values[values <= reach])]
    return marked


def _natural(model: Model) -> np.ndarray:
    """Natural frequencies [rad/s] but those of joints that turn freely."""
    if model.coupled is not None and model.module.FREE:
        try:
            found = modes_at_rest(model)[1]
        except SceneError:  # of a dead centre, which the model warns of
            return np.zeros(0)
        return found[found > _STIFF * found.max(initial=0.0)]
    shown = model.frame is not None and has_modes(model)
    return np.array(reference_modes(model, min(_NATURAL, model.equations.size))[0] if shown else [])


def _last_above(frequencies: np.ndarray, amplitudes: np.ndarray) -> float:
    """Upper limit [Hz] of a spectrum's axis: a tenth above the last visible amplitude."""
    visible = np.flatnonzero(amplitudes > _FLOOR * amplitudes.max())
    last = visible[-1] if len(visible) else len(frequencies) - 1
    return float(min(1.1 * frequencies[last], frequencies[-1])) or float(frequencies[-1])


def orders(solution: Solution) -> dict[str, Figure]:
    """``orders``: of every sensor that repeats itself over the cycle, beside the lowest natural frequencies."""
    found, scene = harmonics(solution), solution.model.scene
    if not found:
        return {}
    groups, base = grouped(scene, found), 1.0 / float(np.ptp(solution.times))
    drive = view(solution).drive
    speed = scene.drives[drive].speed if drive is not None else None
    one = abs(speed) / (2.0 * math.pi) if speed else 1.0  # Hz on the axis' 1
    last = max(np.flatnonzero(found[name] >= _SEEN * found[name].max())[-1] for name in found) + 2
    last = min(last, len(next(iter(found.values()))) - 1)
    x = base / one * np.arange(1, last + 1)
    natural = [(frequency, what) for frequency, style, what in marked(solution, x[-1] * one) if style == "--"]
    page, panels = pages(len(groups), "Amplitudes of the sensors' harmonics, means left out")
    for axes, (title, names) in zip(panels, groups.items(), strict=True):
        factor, unit = readable(scene.sensors[names[0]].unit, *(found[name] for name in names))
        top = factor * max(found[name].max() for name in names)
        for k, (name, colour) in enumerate(zip(names, PALETTE, strict=False)):
            at, height = x + x[0] * 0.7 * ((k + 0.5) / len(names) - 0.5), factor * found[name][1 : last + 1]
            axes.vlines(at, _LOWEST * top, np.maximum(height, _LOWEST * top), color=colour, linewidth=1.1)
            axes.plot(at, height, "o", color=colour, markersize=2.5, label=name)
        for frequency, what in natural:
            label = what if axes is panels[0] else None
            axes.axvline(frequency / one, color=GREY, linestyle="--", linewidth=0.8, label=label, zorder=1)
        axes.set(title=title, ylabel=f"{quantity_of(scene.sensors[names[0]])} [{unit}]")
        axes.set(yscale="log", ylim=(_LOWEST * top, 3.0 * top), xlim=(0.0, x[-1] + x[0]))
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.yaxis.set_minor_locator(NullLocator())  # half of the time to draw
        legend_beside(axes)
    finish(panels, f"order of {drive} [1 = {one:.4g} Hz]" if speed else "frequency [Hz]")
    return {"orders": page}


def harmonics(solution: Solution) -> dict[str, np.ndarray]:
    """Amplitudes of a periodic run's sensors at multiples 0, 1, 2 .. of the cycle's frequency, about their means.

    Sensors that go on from cycle to cycle, as the angle of what turns, and those that never change have none.
    """
    steps = np.diff(solution.times)
    if len(steps) < 16 or np.ptp(steps) > 1e-6 * steps[0]:
        return {}
    series, found = {name: solution.series[name] for name in solution.model.scene.sensors}, {}
    for name, each in series.items():
        values, reach = each.values, float(np.ptp(each.values))
        beside = max(np.nan_to_num(abs(other.values)).max() for other in series.values() if other.unit == each.unit)
        if reach > _SAME * beside and abs(values[-1] - values[0]) <= _CLOSED * reach:
            found[name] = 2.0 / len(steps) * abs(np.fft.rfft(values[:-1] - values[:-1].mean()))[: len(steps) // 2]
    return found
