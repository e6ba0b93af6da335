"""What stands behind the numbers of a judgement, in a sentence each."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from kaneflex.stability.report import Stability

_ILL = 1e12
"""Condition number above which solutions lose more than the twelve digits that nobody misses."""


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
    if found.sweep is not None:
        sentences["speeds"] = _of_speeds(found)
    return sentences


def _of_multipliers(found: Stability) -> str:
    m = found.multipliers
    open_share = "" if m.converged else f"; the steps leave {m.change:.1g} of it open"
    if m.unstable:
        cause = "" if found.model.options.geometric else "; K_g is left out, which may be why: compare preset stiffened"
        return f"unstable: a disturbance grows {m.radius:.5g}-fold in a period of {m.period:.5g} s{open_share}{cause}"
    if abs(m.radius - 1.0) <= max(1e-5, m.change):
        return f"neutrally stable: a disturbance neither grows nor dies (largest multiplier {m.radius:.9g}){open_share}"
    return f"stable: a disturbance shrinks to {m.radius:.4g} of itself in a period of {m.period:.5g} s{open_share}"


def _of_frozen(found: Stability) -> str:
    frozen, scene = found.frozen, found.model.scene
    low, high = frozen.frequencies[:, 0].min(), frozen.frequencies[:, 0].max()
    text = f"lowest frequency {low:.5g} to {high:.5g} Hz over the cycle" if high else "the lowest frequency is lost"
    worst = int(frozen.growth.argmax())
    if frozen.growth[worst] <= 1e-6 * max(1.0, abs(frozen.growth).max()):
        return text
    drive = next(iter(scene.drives))
    at = scene.written_coordinate(drive, float(frozen.coordinates[worst]))
    return f"{text}; frozen at {drive} = {at}, they would grow by {frozen.growth[worst]:.4g} 1/s"


def _of_buckling(found: Stability) -> str:
    if found.buckling is None:
        return "no load to buckle under: something is held by nothing"
    margin = found.buckling.margin
    if math.isinf(margin):
        return "nothing is pushed along its axis"
    times, scene = found.buckling.times, found.model.scene
    drive = next(iter(scene.drives))
    coordinate = found.frozen.coordinates[int(found.buckling.factors.argmin())]
    at = f"at {drive} = {scene.written_coordinate(drive, float(coordinate))} (of {len(times)} instants)"
    if margin < 1.0:
        return f"beyond the buckling load: {margin:.4g} of the axial forces would do, {at}"
    return f"the axial forces could be {margin:.4g} times as large, {at}"


def _of_steps(found: Stability) -> str:
    ranges = []
    free = [limit for limit in found.limits if limit.steps is not None and not limit.limited]
    if free:
        names = ", ".join(limit.integrator for limit in free)
        ranges.append(f"{names} at every step tried, up to {free[0].step:.4g} s ({free[0].steps} in a period)")
    for limit in found.limits:
        if limit.steps is None:
            ranges.append(f"{limit.integrator} at no step tried")
        elif limit.limited:
            ranges.append(f"{limit.integrator} up to {limit.step:.4g} s ({limit.steps} in a period)")
    return f"stable are {'; '.join(ranges)}"


def _of_recommended(found: Stability) -> str:
    limit = found.recommended
    if limit is None:
        return "no integrator is stable"
    options = found.model.options
    own = next((each for each in found.limits if each.integrator == options.integrator), None)
    text = f"{limit.integrator} with {limit.steps} steps in a period or more"
    if own is not None and own.limited and (own.steps is None or options.steps < own.steps):
        return f"{text}: the scene's {options.steps} steps with {options.integrator} are too few"
    return text


def _of_condition(found: Stability) -> str:
    M, K = found.frozen.condition_M.max(), found.frozen.condition_K.max()
    text = f"M {M:.2g}, K {K:.2g}, with diagonals scaled to one"
    return f"{text}: nearly singular, digits are lost" if max(M, K) > _ILL else text


def _of_speeds(found: Stability) -> str:
    swept = found.sweep

    def written(speed: float) -> str:
        return found.model.scene.written_speed(swept.drive, float(speed), 5)

    ends, gap = [written(swept.speeds[k]) for k in (0, -1)], written(swept.widest_gap)
    missed = f"a band narrower than {gap} may be missed but at 2 f / k turns of a frozen frequency f"
    if not swept.bands:
        return f"stable at all {len(swept.speeds)} speeds from {ends[0]} to {ends[1]}; {missed}"
    bands = [" to ".join(map(written, band)) for band in swept.bands]
    return f"from {ends[0]} to {ends[1]}, unstable from {', from '.join(bands)}; {missed}"
