"""Floquet multipliers and frequencies against the speed of the first drive, and unstable speed ranges."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from kaneflex.multibody.model.bound_model import Model
from kaneflex.response.whirl import Whirl, turns, whirl
from kaneflex.scene import Scene
from kaneflex.scene.drives import Drive
from kaneflex.solve.loading import uncoupled
from kaneflex.solve.variants import Variants
from kaneflex.study.stability.floquet import Multipliers, floquet_multipliers
from kaneflex.study.stability.frozen import FEW_INSTANTS, freeze
from kaneflex.support.errors import SceneError

_EDGE = 2e-5
"""Tolerance of a band's edge as a share of the sweep's width."""

ORDERS = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
"""Engine orders: multiples of the drive's rotation frequency that are compared with the frequencies."""

FORWARD = "forward whirl"


class Crossing(NamedTuple):
    """Speed [rad/s] at which an engine order meets a frequency; modes count from 1."""

    order: float
    mode: int
    speed: float


@dataclass(frozen=True, eq=False)
class Sweep:
    """Results of a sweep over speeds.

    Attributes
    ----------
    drive : str
    speeds : ndarray (n_speeds,)
        In rad/s, or m/s of a guide.
    radii : ndarray (n_speeds,)
        Largest modulus of the Floquet multipliers.
    growth_rates : ndarray (n_speeds,)
        log(radius) / period [1/s].
    converged : ndarray (n_speeds,)
        Whether the radius is converged.
    lowest, mean, highest : ndarray (n_speeds, count)
        Extremes and mean of each natural frequency over the cycle [Hz]: rotors' in fixed axes, else frozen ones in the
        links' axes.
    bands : tuple of (float, float)
        Unstable speed ranges, limited to the sweep.
    orders : tuple of float
        Engine orders.
    modes : tuple of str
        Name of each frequency: "mode 1", of rotors "forward whirl 1", "backward whirl 1", "torsion or axial 1".
    axes : str
        "fixed", or "link" if the axes of an elastic link turn.
    """

    drive: str
    speeds: np.ndarray
    radii: np.ndarray
    growth_rates: np.ndarray
    converged: np.ndarray
    lowest: np.ndarray
    mean: np.ndarray
    highest: np.ndarray
    bands: tuple[tuple[float, float], ...]
    orders: tuple[float, ...]
    modes: tuple[str, ...]
    axes: str

    @property
    def critical(self) -> list[Crossing]:
        """Critical speeds of a rotor: crossings of order 1 with a forward whirl, which unbalance excites;
        interpolated."""
        met = _crossings(self.speeds, self.mean, (1.0,))
        whirls = [each for each in met if self.modes[each.mode - 1].startswith(FORWARD)]
        return sorted(whirls, key=lambda each: each.speed)

    def crossings(self) -> list[Crossing]:
        """Crossings of the orders with the mean frequencies, interpolated linearly."""
        return _crossings(self.speeds, self.mean, self.orders)

    @property
    def widest_gap(self) -> float:
        """Largest distance of two neighbouring speeds; narrower unstable bands between them may be missed."""
        return float(np.diff(self.speeds).max())


def _crossings(
    speeds: np.ndarray, frequencies: np.ndarray, orders: Sequence[float], share: float = 1.0
) -> list[Crossing]:
    """Speeds at which a multiple of the rotation frequency is ``share`` times a frequency, (n_speeds, count) in Hz."""
    found = []
    for mode, own in enumerate(frequencies.T):
        for order in orders:
            gap = share * own - order * speeds / (2.0 * np.pi)
            for k in np.flatnonzero((gap[:-1] < 0.0) != (gap[1:] < 0.0)):
                part = gap[k] / (gap[k] - gap[k + 1])
                found.append(Crossing(order, mode + 1, float(speeds[k] + part * (speeds[k + 1] - speeds[k]))))
    return found


def _resonances(speeds: np.ndarray, mean: np.ndarray) -> list[float]:
    """Speeds of parametric resonances for vanishing excitation, widest first: 2 f / k turns (Bolotin 1964, ch. 2).

    At most as many as there are speeds, and none of these.
    """
    width = _EDGE * (speeds[-1] - speeds[0])
    found: list[float] = []
    for crossing in sorted(_crossings(speeds, mean, ORDERS, share=2.0)):
        if min(abs(np.array([*speeds, *found]) - crossing.speed)) > width:
            found.append(crossing.speed)
    return found[: len(speeds)]


def speeds_between(low: float, high: float, points: int) -> np.ndarray:
    """Evenly spaced speeds from low to high; zero speed, which has no period, is left out."""
    return np.linspace(low, high, points) if low > 0.0 else np.linspace(0.0, high, points + 1)[1:]


def check_sweep(drives: Mapping[str, Drive]) -> str:
    """Name of the first drive. Raises SceneError if it has no constant speed."""
    name, drive = next(iter(drives.items()), (None, None))
    if drive is None or drive.kind != "constant speed":
        reason = "the first drive has no constant speed to vary"
        raise SceneError("--vary", None, reason, "Leave --vary out, or give that drive a speed and a cycle")
    return name


def sweep(
    scene: Scene, speeds: np.ndarray, count: int, progress: Callable[[float], None] = lambda share: None,
    orders: Sequence[float] = ORDERS,
) -> Sweep:  # fmt: skip
    """Multipliers and the ``count`` lowest frozen frequencies of a scene at ascending speeds [rad/s or m/s].

    The drive keeps its direction. Speeds of parametric resonances are added, since unstable bands around them may be
    narrower than the distance of two speeds.

    Raises
    ------
    SceneError
        If the first drive has no constant speed, or the multipliers can't be computed at one of them.
    """
    drive, variants = check_sweep(scene.drives), Variants(scene)
    way = math.copysign(1.0, scene.drives[drive].speed or 1.0)

    def at(speed: float) -> tuple[Model, Multipliers]:
        model = uncoupled(variants.load([f"drives.{drive}.speed={way * float(speed)!r}"]))
        return model, floquet_multipliers(model)

    found: dict[float, tuple[Multipliers, np.ndarray, Whirl | None, bool]] = {}

    def look(speed: float, done: float) -> None:
        model, multipliers = at(speed)
        frequencies = freeze(model, count, FEW_INSTANTS).frequencies
        found[float(speed)] = multipliers, frequencies, whirl(model), turns(model)
        progress(done)

    for k, speed in enumerate(speeds):
        look(speed, 0.5 * (k + 1) / len(speeds))
    beside = _resonances(speeds, np.array([frequencies.mean(axis=0) for _, frequencies, *_ in found.values()]))
    for k, speed in enumerate(beside):
        look(speed, 0.5 + 0.5 * (k + 1) / len(beside))
    speeds = np.array(sorted(found))
    found, frozen, whirls, turning = zip(*(found[speed] for speed in speeds), strict=True)
    bands = _bands(speeds, [one.unstable for one in found], lambda speed: at(speed)[1].unstable)
    keys = ("radius", "growth_rate", "converged")
    radii, rates, converged = (np.array([getattr(one, key) for one in found]) for key in keys)
    if None in whirls:
        ranges = [np.array([pick(each, axis=0) for each in frozen]) for pick in (np.min, np.mean, np.max)]
        modes, axes = tuple(f"mode {k + 1}" for k in range(ranges[0].shape[1])), "link" if any(turning) else "fixed"
    else:
        modes, frequencies = _followed(whirls, count)
        ranges, axes = [frequencies] * 3, "fixed"
    lowest, mean, highest = ranges
    return Sweep(drive, speeds, radii, rates, converged, lowest, mean, highest, bands, tuple(orders), modes, axes)


def _followed(whirls: Sequence[Whirl], count: int) -> tuple[tuple[str, ...], np.ndarray]:
    """Names and frequencies (n_speeds, count) [Hz] of a rotor's lowest modes, by whirl direction and number."""
    curves = list[tuple[str, np.ndarray]]()
    for way, name in ((1, FORWARD), (-1, "backward whirl"), (0, "torsion or axial")):
        own = [each.of(way) for each in whirls]
        curves += [(f"{name} {k + 1}", np.array([each[k] for each in own])) for k in range(min(map(len, own)))]
    names, frequencies = zip(*sorted(curves, key=lambda curve: curve[1].mean())[:count], strict=True)
    return names, np.transpose(frequencies)


def _bands(
    speeds: np.ndarray, unstable: list[bool], judge: Callable[[float], bool]
) -> tuple[tuple[float, float], ...]:
    """Ranges of unstable speeds; edges are refined by bisection."""
    edges = [float(speeds[0])] if unstable[0] else []
    width = _EDGE * (speeds[-1] - speeds[0])
    for k in np.flatnonzero(np.diff(np.array(unstable, dtype=int))):
        low, high = float(speeds[k]), float(speeds[k + 1])
        while high - low > width:
            middle = 0.5 * (low + high)
            low, high = (middle, high) if judge(middle) == unstable[k] else (low, middle)
        edges.append(0.5 * (low + high))
    if unstable[-1]:
        edges.append(float(speeds[-1]))
    return tuple(zip(edges[::2], edges[1::2], strict=True))
