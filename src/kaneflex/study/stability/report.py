"""Stability report of a scene, with one sentence for each finding."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.multibody.model.bound_model import Model
from kaneflex.response.whirl import turns, whirl
from kaneflex.scene.read import SceneLike, scene_from
from kaneflex.solve.loading import load, uncoupled
from kaneflex.study.stability.floquet import Multipliers, StepLimit, floquet_multipliers, recommended, step_limits
from kaneflex.study.stability.frozen import INSTANTS, Buckling, Frozen, buckling, freeze
from kaneflex.study.stability.sweep import FORWARD, ORDERS, Sweep, check_sweep, sweep
from kaneflex.support.arguments import takes
from kaneflex.support.errors import counted
from kaneflex.support.terminal import share_of, silent

FREQUENCIES = 6
"""Number of lowest frequencies that are reported."""


@dataclass(frozen=True, eq=False)
class Stability:
    """Results of :func:`stability` in SI.

    Attributes
    ----------
    model : Model
    multipliers : Multipliers
    frozen : Frozen
    buckling : Buckling or None
        None if the mechanism is not fully restrained.
    limits : tuple of StepLimit
    recommended : StepLimit or None
    sweep : Sweep or None
        If speeds were requested.
    """

    model: Model
    multipliers: Multipliers
    frozen: Frozen
    buckling: Buckling | None
    limits: tuple[StepLimit, ...]
    recommended: StepLimit | None
    sweep: Sweep | None

    def __repr__(self) -> str:
        return f"Stability({self.model.in_short}: {self.findings['motion']})"

    @property
    def findings(self) -> dict[str, str]:
        """One sentence on each subject."""
        return findings(self)

    def as_data(self) -> dict[str, object]:
        """All results as plain data; numbers that are not finite become None."""
        m, frozen, limit = self.multipliers, self.frozen, self.recommended
        data: dict[str, object] = {
            "scene": self.model.scene.name,
            "preset": self.model.options.preset,
            "findings": self.findings,
            "period": m.period,
            "spectral_radius": m.radius,
            "unstable": m.unstable,
            "multipliers": [[value.real, value.imag] for value in m.values.tolist()],
            "steps_of_multipliers": m.steps,
            "settled": m.converged,
            "frozen_growth": frozen.growth.max(),
            "condition_M": frozen.condition_M.max(),
            "condition_K": frozen.condition_K.max(),
            "buckling_margin": None if self.buckling is None else self.buckling.margin,
            "step_limits": [vars(each) for each in self.limits],
            "recommended": None if limit is None else vars(limit),
        }
        if self.sweep is not None:
            data["drive"], data["unstable_bands"] = self.sweep.drive, [list(band) for band in self.sweep.bands]
            data["widest_gap"] = self.sweep.widest_gap
            data["axes"], data["modes"] = self.sweep.axes, list(self.sweep.modes)
            data["crossings"] = [crossing._asdict() for crossing in self.sweep.crossings()]
            data["critical_speeds"] = [crossing.speed for crossing in self.sweep.critical]
        return _plain(data)


@takes(scene="scene", speeds="numbers", progress="function", orders="numbers")
def stability(
    scene: SceneLike, speeds: np.ndarray | None = None, progress: Callable[[str], None] | None = None,
    orders: Sequence[float] = ORDERS,
) -> Stability:  # fmt: skip
    """Stability of a scene's periodic equations.

    Parameters
    ----------
    scene : Scene, Model, Solution or path
    speeds : ndarray, optional
        Ascending speeds of the first drive for a sweep [rad/s, or m/s of a guide].
    progress : callable, optional
        Called with the name of each stage.
    orders : sequence of float
        Multiples of that drive's rotation frequency that are compared with the frequencies of a sweep.

    Raises
    ------
    SceneError
        If the model has no periodic elastic equations, or speeds are given and the first drive has no constant speed.
    """
    scene = scene_from(scene)
    if speeds is not None:
        check_sweep(scene.drives)
    stage = progress or silent
    model = uncoupled(load(scene, stage))
    stage("multipliers")
    multipliers = floquet_multipliers(model)
    frozen = freeze(model, FREQUENCIES, INSTANTS)
    stage("stable steps")
    limits = step_limits(model, multipliers)
    swept = None
    if speeds is not None:
        swept = sweep(scene, speeds, FREQUENCIES, share_of(stage, "speeds"), orders)
    highest = frozen.frequencies.max(axis=0)
    lowest = float(highest[highest > 0.0].min(initial=np.inf)) if highest.any() else 0.0
    best = recommended(limits, lowest)
    return Stability(model, multipliers, frozen, buckling(model, frozen.times), limits, best, swept)


def _plain(value: object) -> object:
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return value


_ILL = 1e12
"""Condition number above which the matrices count as nearly singular."""


def findings(found: Stability) -> dict[str, str]:
    """Subject -> sentence."""
    sentences = {
        "motion": _of_multipliers(found),
        "frozen": _of_frozen(found),
        "buckling": _of_buckling(found),
        "steps": _of_steps(found),
        "recommended": _of_recommended(found),
        "conditioning": _of_condition(found),
    }
    if (swept := found.sweep) is not None:
        sentences["speeds"] = _of_speeds(found, swept)
        sentences["orders"] = _of_orders(found, swept)
        if any(mode.startswith(FORWARD) for mode in swept.modes):
            sentences["critical"] = _of_critical(found, swept)
    return sentences


def _of_multipliers(found: Stability) -> str:
    m = found.multipliers
    open_share = "" if m.converged else f"; it is converged only to {m.change:.1g}"
    if m.unstable:
        cause = "" if found.model.options.geometric else "; K_g is left out: compare preset stiffened"
        return f"unstable: a disturbance grows {m.radius:.5g}-fold in a period of {m.period:.5g} s{open_share}{cause}"
    if abs(m.radius - 1.0) <= max(1e-5, m.change):
        return f"neutrally stable: disturbances neither grow nor decay (largest multiplier {m.radius:.9g}){open_share}"
    return f"stable: a disturbance decays to {m.radius:.4g} of its size in a period of {m.period:.5g} s{open_share}"


def _of_frozen(found: Stability) -> str:
    frozen = found.frozen
    low, high = frozen.frequencies[:, 0].min(), frozen.frequencies[:, 0].max()
    text = f"lowest frequency {low:.5g} to {high:.5g} Hz over the cycle" if high else "the lowest frequency is unknown"
    text += ", in axes that turn with the links" if turns(found.model) else ""
    if (seen := whirl(found.model)) is not None:
        lowest = (("forward", seen.of(1)[:2]), ("backward", seen.of(-1)[:2]))
        whirls = [f"{way} {', '.join(f'{each:.5g}' for each in values)}" for way, values in lowest if len(values)]
        text += f"; whirl in fixed axes: {' and '.join(whirls)} Hz" if whirls else ""
    worst = int(frozen.growth.argmax())
    if frozen.growth[worst] <= 1e-6 * max(1.0, abs(frozen.growth).max()):
        return text
    return f"{text}; frozen at {_at(found, worst)}, a disturbance grows at a rate of {frozen.growth[worst]:.4g} 1/s"


def _at(found: Stability, instant: int) -> str:
    """Coordinate of the first drive at a frozen instant."""
    scene = found.model.scene
    return mechanism_of(scene).written({next(iter(scene.drives)): found.frozen.coordinates[instant]})


def _of_buckling(found: Stability) -> str:
    if found.buckling is None:
        return "no buckling load: the mechanism is not fully restrained, or axial forces are statically indeterminate"
    margin = found.buckling.margin
    if math.isinf(margin):
        return "no link is in compression"
    at = f"at {_at(found, int(found.buckling.factors.argmin()))} (worst of {len(found.buckling.times)} instants)"
    words = "beyond the buckling load: the load factor is" if margin < 1.0 else "the load factor for buckling is"
    return f"{words} {margin:.4g} {at}"


def _of_steps(found: Stability) -> str:
    limited = {each.integrator: each for each in found.limits if each.limited}
    ranges = [f"{name} {'at no step tried' if each.steps is None else _up_to(each)}" for name, each in limited.items()]
    free = [each for each in found.limits if not each.limited]
    if free:
        ranges.insert(0, f"{', '.join(each.integrator for each in free)} at every step tried, {_up_to(free[0])}")
    unstable = "the motion itself is unstable; integrators that add no growth"
    return f"{unstable if found.multipliers.unstable else 'stable integrators'}: {'; '.join(ranges)}"


def _up_to(limit: StepLimit) -> str:
    return f"up to {limit.step:.4g} s ({limit.steps} in a period)"


def _of_recommended(found: Stability) -> str:
    limit = found.recommended
    if limit is None:
        return "no integrator is stable"
    options = found.model.options
    own = next((each for each in found.limits if each.integrator == options.integrator), None)
    text = f"{limit.integrator} with {counted(limit.steps, 'step')} in a period or more"
    if own is not None and own.limited and (own.steps is None or options.steps < own.steps):
        return f"{text}: more than the scene's {counted(options.steps, 'step')} with {options.integrator}"
    return text


def _of_condition(found: Stability) -> str:
    M, K = found.frozen.condition_M.max(), found.frozen.condition_K.max()
    text = f"M {M:.2g}, K {K:.2g}, after scaling the diagonals to one"
    return f"{text}: nearly singular, results lose accuracy" if max(M, K) > _ILL else text


def _of_speeds(found: Stability, swept: Sweep) -> str:
    scene = found.model.scene
    drive = swept.drive

    def written(speed: float) -> str:
        return scene.written_speed(drive, float(speed), 5)

    ends, gap = [written(swept.speeds[k]) for k in (0, -1)], written(swept.widest_gap)
    missed = f"bands narrower than {gap} may be missed, except at 2 f / k turns of a frozen frequency f"
    if (scene.drives[drive].speed or 0.0) < 0.0:
        ends[1] += " backwards"
    if not swept.bands:
        return f"stable at all {len(swept.speeds)} speeds from {ends[0]} to {ends[1]}; {missed}"
    bands = [" to ".join(map(written, band)) for band in swept.bands]
    return f"from {ends[0]} to {ends[1]}, unstable from {', from '.join(bands)}; {missed}"


def _of_orders(found: Stability, swept: Sweep) -> str:
    """Speeds at which engine orders meet frequencies, by order."""
    scene = found.model.scene
    where = {"fixed": "fixed axes", "link": "axes that turn with the links"}[swept.axes]
    met: dict[float, list[str]] = {}
    for order, mode, speed in sorted(swept.crossings(), key=lambda each: (each.order, each.speed)):
        at = scene.written_speed(swept.drive, speed, 4)
        met.setdefault(order, []).append(f"{swept.modes[mode - 1]} at {at}")
    if not met:
        return f"none of {', '.join(f'{order:g}' for order in swept.orders)} meets a frequency in {where}"
    return "; ".join(f"{order:g} meets {', '.join(each)}" for order, each in met.items()) + f" (frequencies in {where})"


def _of_critical(found: Stability, swept: Sweep) -> str:
    """Critical speeds of a rotor."""
    scene = found.model.scene
    met = [(scene.written_speed(swept.drive, speed, 4), swept.modes[mode - 1]) for _, mode, speed in swept.critical]
    speeds = [f"{at} ({mode})" for at, mode in met]
    return ", ".join(speeds) if speeds else "no critical speed among these"
