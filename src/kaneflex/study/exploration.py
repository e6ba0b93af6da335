"""A scene with a few numbers that vary between two ends: the sliders of the explorer."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from kaneflex.integrate.system import Outcome
from kaneflex.scene import Scene, with_settings
from kaneflex.scene.scene import given_value
from kaneflex.scene.settings import demand_once, resolved
from kaneflex.solve.simulation import solve
from kaneflex.solve.solution import Solution
from kaneflex.solve.variants import Variants
from kaneflex.study.differences import check_names
from kaneflex.study.plan import setting
from kaneflex.study.study import number_and_unit
from kaneflex.support.errors import SceneError, StoppedEarly


@dataclass(frozen=True)
class Varied:
    """A number of the scene that varies.

    Attributes
    ----------
    path : str
        Path of the entry, as in `kaneflex run --set`.
    unit : str
        Unit of low, high and start; empty: SI.
    low, high : float
        Ends of the range.
    start : float
        The scene's own number, limited to the range; the middle if the scene has none in that unit.
    whole : bool
        Whether only whole numbers are allowed: elements, modes, steps.
    """

    path: str
    unit: str
    low: float
    high: float
    start: float
    whole: bool

    def setting(self, value: float) -> str:
        """Setting path=value for a value."""
        number = round(value) if self.whole else float(value)
        return setting(self.path, f"{number!r} {self.unit}" if self.unit else number)


def ends_of(text: str, example: str = "main.speed=2000:6000rpm") -> Varied:
    """Parse "path=low:high"; the unit of `high` applies to a `low` without unit, and the start is the middle.

    Raises
    ------
    SceneError
        If the ends are not two ascending numbers with one unit.
    """
    path, equals, ends = (part.strip() for part in text.partition("="))
    first, colon, last = (part.strip() for part in ends.partition(":"))
    cure = f"Write it like {example}"
    low, high = number_and_unit(first), number_and_unit(last)
    if not (equals and colon) or low is None or high is None:
        raise SceneError("--vary", text, "not of the form PATH=LOW:HIGH with two numbers", cure)
    unit = high[1]
    if low[1] not in ("", unit):
        raise SceneError("--vary", text, f"{low[1]!r} and {unit!r} are different units", "Give both ends the same unit")
    if not (math.isfinite(low[0]) and math.isfinite(high[0]) and low[0] < high[0]):
        raise SceneError("--vary", text, "the second number is not greater than the first", cure)
    whole = not unit and all(end.lstrip("+-").isdecimal() for end in (first, last))
    return Varied(path, unit, low[0], high[0], 0.5 * (low[0] + high[0]), whole)


def varied(scene: Scene, text: str) -> Varied:
    """Parse "path=low:high": main.speed=2000:6000rpm, rod.elements=1:8.

    Ends without decimal point and unit are whole numbers.

    Raises
    ------
    SceneError
        As :func:`ends_of`, if the path does not exist, or if the scene does not allow the start value.
    """
    found = ends_of(text, "main.speed=2000:6000rpm or rod.elements=1:8")
    known = number_and_unit(given_value(scene.raw, resolved(scene.raw, found.path)))
    if known is not None and known[1] == found.unit:
        found = replace(found, start=min(max(known[0], found.low), found.high))
    try:
        with_settings(scene, [found.setting(found.start)])
    except SceneError as error:
        reason = f"the start value {found.start:.6g} {found.unit}".rstrip() + f" is not allowed: {error.reason}"
        raise SceneError("--vary", text, reason, error.cure) from None
    return found


@dataclass(frozen=True, eq=False)
class Exploration:
    """A scene and its varied numbers.

    Attributes
    ----------
    scene : Scene
    open : tuple of Varied
    sensors : tuple of str
        Displayed sensors; empty: all.

    Raises
    ------
    SceneError
        If nothing varies, a number varies twice, or a sensor does not exist.
    """

    scene: Scene
    open: tuple[Varied, ...]
    sensors: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.open:
            raise SceneError("--vary", None, "nothing varies", "Give a range: --vary main.speed=2000:6000rpm")
        demand_once(("--vary", each.path, tuple(resolved(self.scene.raw, each.path))) for each in self.open)
        if not self.scene.sensors:
            raise SceneError("sensors", None, "the scene has no sensors", "Add a sensor, see docs/scene/sensors.md")
        check_names(self.scene.sensors, self.sensors)

    @cached_property
    def _variants(self) -> Variants:
        return Variants(self.scene)

    def settings(self, values: Sequence[float]) -> list[str]:
        """Settings path=value for these values."""
        return [each.setting(value) for each, value in zip(self.open, values, strict=True)]

    def at(self, values: Sequence[float]) -> Scene:
        """The scene with these values."""
        return with_settings(self.scene, self.settings(values))

    def solve(self, values: Sequence[float] | None = None) -> Solution:
        """Run the scene at these values, or as it is if None, like `kaneflex run`.

        Raises
        ------
        SceneError
            If the scene can't be run at these values, or the run stops early.
        """
        solution = solve(self._variants.load([] if values is None else self.settings(values)))
        if solution.outcome is not Outcome.COMPLETED:
            raise StoppedEarly("the run", None, solution.message, "Move on")
        return solution
