"""STUDY.toml: scene, varied entries, and the resulting points in a fixed order.

The last parameter varies fastest, samples faster than lists.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, StrictBool, StrictFloat, StrictInt, StrictStr, ValidationError
from pydantic import model_validator as validated_by

from kaneflex.scene import Scene
from kaneflex.scene.quantities import WholeNumber
from kaneflex.scene.read import problem_in, tables_of
from kaneflex.scene.table import SceneTable, the_one_given
from kaneflex.support.errors import Fault, SceneError, counted, nearest
from kaneflex.support.units import NUMBER_WITH_UNIT


def _one_value(value: object) -> object:
    if not isinstance(value, bool | int | float | str):
        raise Fault("not a single value", "Give numbers, texts, true or false; set vectors by settings, one study each")
    return value


Value = Annotated[StrictBool | StrictInt | StrictFloat | StrictStr, BeforeValidator(_one_value)]
"""Value of an entry of a scene."""


_UNIT = re.compile(r"((1/|[^\W\d_]|[%°])[\w%°^*/().·\s-]*)?")
"""Text that may be a unit; 2 * cos(t) and 5 - t are laws."""


def number_and_unit(value: object) -> tuple[float, str] | None:
    """Number and unit of 6000 or "6000 rpm"; None for other values."""
    if isinstance(value, bool):
        return None
    if isinstance(value, int | float):
        return float(value), ""
    match = NUMBER_WITH_UNIT.match(value) if isinstance(value, str) else None
    return (float(match[1]), match[2]) if match and _UNIT.fullmatch(match[2]) else None


class Axis(SceneTable):
    """Values of one varied entry: a list, `count` numbers from `from` to `to`, or samples."""

    values: tuple[Value, ...] | None = Field(default=None, description="list, also written without this table")
    from_: Value | None = Field(default=None, alias="from", description="first of equally spaced numbers")
    to: Value | None = Field(default=None, description="last of them")
    count: WholeNumber | None = Field(default=None, description="number of them")
    low: Value | None = Field(default=None, description="lower end of samples")
    high: Value | None = Field(default=None, description="upper end of samples")
    scale: Literal["linear", "log"] = Field(default="linear", description="`log`: equal ratios instead of differences")

    @validated_by(mode="after")
    def _complete(self) -> Axis:
        kind = the_one_given(self, ("values", "from_", "low"))
        if kind == "values" and (not self.values or len(set(map(repr, self.values))) < len(self.values)):
            raise Fault("empty, or a value is listed twice", "Give each value once")
        wanted = {"values": (), "from_": ("to", "count"), "low": ("high",)}[kind]
        for name in ("to", "count", "high"):
            if (getattr(self, name) is None) == (name in wanted):
                verb = "missing" if name in wanted else "not allowed here"
                raise Fault(f"{name} is {verb}", "Write {from = 1, to = 2, count = 5} or {low = 1, high = 2}")
        if kind != "values":
            _check_ends(*self.ends, self.scale)
        return self

    @property
    def sampled(self) -> bool:
        """True if its values come from `sample`."""
        return self.low is not None

    @property
    def ends(self) -> tuple[Value, Value]:
        """Ends of the range."""
        return (self.low, self.high) if self.sampled else (self.from_, self.to)


def _check_ends(first: Value, last: Value, scale: str) -> None:
    ends = [number_and_unit(value) for value in (first, last)]
    if None in ends or ends[0][1] != ends[1][1]:
        raise Fault("not two numbers with the same unit", "Write {from = '2000 rpm', to = '6000 rpm', count = 5}")
    (a, _), (b, _) = ends
    if not (math.isfinite(a) and math.isfinite(b)) or a == b:
        raise Fault("the ends are equal or not finite", "Give two different numbers")
    if scale == "log" and not (a > 0 and b > 0):
        raise Fault("a logarithmic scale needs positive numbers", "Use scale = 'linear'")


def _as_axis(value: object) -> object:
    if isinstance(value, list):
        return {"values": value}
    if not isinstance(value, dict | Axis):
        raise Fault("neither a list nor a table", "Write [1, 2, 4] or {from = 1, to = 4, count = 7}; fixed values "
                    "belong to settings")  # fmt: skip
    return value


class Sample(SceneTable):
    """Sampling of all entries with `low` and `high` together."""

    method: Literal["random", "latin-hypercube", "sobol"] = Field(
        default="sobol", description="`sobol`: scrambled, its count a power of two"
    )
    count: WholeNumber = Field(description="number of samples")
    seed: Annotated[int, Field(ge=0)] = Field(default=0, description="the same seed gives the same samples")

    @validated_by(mode="after")
    def _balanced(self) -> Sample:
        if self.method == "sobol" and self.count & (self.count - 1):
            power = 2 ** round(math.log2(self.count))
            raise Fault("a Sobol sequence needs a power of two", f"Use {power}", "count")
        return self


class Poincare(SceneTable):
    """Sensors sampled once per period of a drive: its law's period, else one turn.

    A run lasts `periods` periods; the first `discard` are left out as transient.
    """

    drive: str = Field(description="drive whose period is used")
    periods: WholeNumber = Field(description="periods of a run")
    discard: Annotated[int, Field(ge=0)] = Field(default=0, description="periods left out at the start")

    def settings(self, scene: Scene) -> list[str]:
        """Settings of the run's duration and of its steps, `solve.steps` of the scene per period.

        Raises
        ------
        SceneError
            If the drive has no period, or steps are not given.
        """
        if self.discard >= self.periods:
            reason = f"a run has only {counted(self.periods, 'period')}"
            raise SceneError("poincare.discard", self.discard, reason, "Discard fewer, or increase periods")
        duration = self.periods * self.period(scene)
        return [f"solve.duration={duration!r}", f"solve.steps={self.periods * self.steps(scene)}"]

    def period(self, scene: Scene) -> float:
        """Period of the drive [s]."""
        drive = scene.drives.get(self.drive)
        if drive is None:
            raise SceneError("poincare.drive", self.drive, "no drive of that name", nearest(self.drive, scene.drives))
        period = drive.period or (2 * math.pi / abs(drive.speed) if drive.speed else None)
        if period is None or (drive.period is None and scene.slides(self.drive)):
            cure = "Choose a drive with a speed, or give its law a period"
            raise SceneError("poincare.drive", self.drive, "its motion has no period", cure)
        return period

    def steps(self, scene: Scene) -> int:
        """Stored instants per period."""
        if scene.solve.steps is None:
            raise SceneError("poincare", None, "the number of stored instants per period is not given",
                             'Give settings = ["solve.steps=200"]')  # fmt: skip
        return scene.solve.steps

    def instants(self, times: int) -> slice:
        """Slice of a run's ``times`` stored instants that form the section; each ends a period."""
        each = (times - 1) // self.periods
        return slice((self.discard + 1) * each, None, each)


class Study(SceneTable):
    """A sweep: all combinations of the lists and ranges, each with all listed points and samples."""

    scene: str = Field(description="name of a shipped scene, or of a file relative to this one")
    settings: tuple[str, ...] = Field(default=(), description='other changes of the scene, as `"path=value"`')
    parameters: dict[str, Annotated[Axis, BeforeValidator(_as_axis)]] = Field(
        default={}, description="by path of the entry: a list, `{from, to, count, scale}` or `{low, high, scale}`"
    )
    points: tuple[dict[str, Value], ...] = Field(default=(), description="listed points: `{path = value}`, same paths")
    sample: Sample | None = Field(default=None, description="see below")
    series: StrictBool = Field(default=False, description="keep every sensor over time")
    sensitivities: tuple[str, ...] = Field(default=(), description="paths of numbers to differentiate sensors by")
    basis: Literal["frozen", "recomputed"] = Field(default="frozen", description="modal bases in the derivatives")
    poincare: Poincare | None = Field(default=None, description="every sensor once a period of a drive, see below")

    @validated_by(mode="after")
    def _consistent(self) -> Study:
        sampled = [path for path, axis in self.parameters.items() if axis.sampled]
        if sampled and self.sample is None:
            raise Fault(f"{sampled[0]} needs a sample table", "Give sample = {method = 'sobol', count = 16}", "sample")
        if self.sample is not None and not sampled:
            raise Fault("no parameter is sampled", "Give a parameter {low = 1, high = 2}", "sample")
        if not self.parameters and not self.points:
            raise Fault("nothing varies", "Give [parameters] or points", "parameters")
        if self.poincare is not None and (self.series or self.sensitivities):
            raise Fault("it can't be combined with series or sensitivities", "Leave these out", "poincare")
        listed = set(self.points[0]) if self.points else set()
        if any(set(point) != listed for point in self.points) or (self.points and not listed):
            raise Fault("the points set different entries", "Give every point the same paths", "points")
        return self


def read_study(path: Path | str) -> Study:
    """Read a study from a TOML file.

    Raises
    ------
    SceneError
        If the file is not a valid study; names every problem.
    """
    path = Path(path)
    raw = tables_of(path, "study")
    if "bodies" in raw and "parameters" not in raw:
        cure = f"Write another file with scene = {path.name!r} and a table of parameters"
        raise SceneError("study", path.name, "it is a scene, not a study", cure)
    return study_of(raw)


def study_of(raw: dict[str, Any]) -> Study:
    """Study from the tables of its file. Raises SceneError, which names every problem."""
    try:
        return Study.model_validate(raw)
    except ValidationError as error:
        raise SceneError.gather(problem_in(dict(item), raw, Study) for item in error.errors()) from None


Point = dict[str, Value]
"""Path of an entry of the scene -> its value."""
_ROUNDING = 1e-9
"""Rounding error of equally spaced whole numbers."""


def points_of(study: Study) -> list[Point]:
    """All points of a study: combinations of its lists and ranges, with the listed points and the samples.

    Samples are drawn in the unit cube of all sampled parameters at once (scipy.stats.qmc), then scaled.
    """
    axes = [[{path: value} for value in _values(axis)] for path, axis in study.parameters.items() if not axis.sampled]
    axes += [[*study.points]] if study.points else []
    if study.sample is not None:
        axes.append(_samples({path: axis for path, axis in study.parameters.items() if axis.sampled}, study.sample))
    order = [*study.parameters, *(study.points[0] if study.points else ())]
    points = ({path: value for part in parts for path, value in part.items()} for parts in itertools.product(*axes))
    return [{path: point[path] for path in order} for point in points]


def size_of(study: Study) -> int:
    """Number of points that :func:`points_of` makes."""
    counts = [axis.count or len(axis.values or ()) for axis in study.parameters.values() if not axis.sampled]
    return math.prod(counts) * (len(study.points) or 1) * (1 if study.sample is None else study.sample.count)


def _values(axis: Axis) -> Sequence[Value]:
    return _between(axis, np.linspace(0.0, 1.0, axis.count)) if axis.values is None else axis.values


def _samples(axes: dict[str, Axis], sample: Sample) -> list[Point]:
    from scipy.stats import qmc

    if sample.method == "random":
        cube = np.random.default_rng(sample.seed).random((sample.count, len(axes)))
    else:
        sampler = {"sobol": qmc.Sobol, "latin-hypercube": qmc.LatinHypercube}[sample.method]
        cube = sampler(len(axes), rng=sample.seed).random(sample.count)
    columns = {path: _between(axis, cube[:, k]) for k, (path, axis) in enumerate(axes.items())}
    return [{path: column[k] for path, column in columns.items()} for k in range(sample.count)]


def _between(axis: Axis, share: np.ndarray) -> list[Value]:
    """Values at shares of the way from one end to the other, in the ends' unit; the ends are exact.

    Numbers stay whole if both ends and all values are whole, as numbers of elements must be.
    """
    first, last = axis.ends
    (a, unit), (b, _) = number_and_unit(first), number_and_unit(last)
    if axis.scale == "log":
        numbers = np.exp(np.log(a) * (1.0 - share) + np.log(b) * share)
    else:
        numbers = a * (1.0 - share) + b * share
    numbers = np.where(share == 0.0, a, np.where(share == 1.0, b, numbers)).tolist()
    if unit:
        return [f"{number!r} {unit}" for number in numbers]
    whole = [round(number) for number in numbers]
    near = all(abs(number - near) < _ROUNDING for number, near in zip(numbers, whole, strict=True))
    return whole if isinstance(first, int) and isinstance(last, int) and near else numbers
