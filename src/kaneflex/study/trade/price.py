"""Effect of clearances and friction on a scene's sensors: runs with and without them.

Motion with impacts may be chaotic: neighbouring runs diverge, so that differences at an instant say nothing. Therefore
statistics over the run are compared, the largest absolute value and the rms, each with its change under a ten times
smaller tolerance of a step.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import combinations, product

from kaneflex.fem.mobility import check_determined
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.position_analysis import place
from kaneflex.mechanism.tight_start import tight_start
from kaneflex.scene import Scene, with_settings
from kaneflex.scene.contacts import ClearanceContact
from kaneflex.scene.options import tolerance_of
from kaneflex.scene.quantities import Address
from kaneflex.scene.sensors import CONTACT_KINDS, DRIVE_KINDS, FRICTION_KINDS, Sensor
from kaneflex.solve.curves import Curves
from kaneflex.solve.loading import Progress
from kaneflex.solve.variants import Variant
from kaneflex.study.differences import check_sensors
from kaneflex.study.runs import Runs
from kaneflex.support.errors import SceneError, failed

_FINER = 0.1
"""Factor on the tolerance of a step for the second run."""
_FINEST = 1e-13
_ALIKE = 0.2
"""Angle [rad] up to which bodies of the tight mechanism count as in the same position as with clearances."""


@dataclass(frozen=True)
class Change:
    """Effect of a part of the scene on a sensor, in SI.

    Attributes
    ----------
    peak, rms : tuple of float
        Largest absolute value, and root of the mean square over time, with the part and without.
    doubt : tuple of float
        Change of peak and rms with the part under a ten times smaller tolerance; NaN if that run fails.
    """

    sensor: str
    unit: str
    peak: tuple[float, float]
    rms: tuple[float, float]
    doubt: tuple[float, float]

    @property
    def shares(self) -> tuple[float, float]:
        """Changes of peak and rms relative to the values without the part; NaN if these are zero."""
        return _share(self.peak[0] - self.peak[1], self.peak[1]), _share(self.rms[0] - self.rms[1], self.rms[1])

    @property
    def doubts(self) -> tuple[float, float]:
        """Uncertainties of peak and rms, relative to the values without the part."""
        return _share(self.doubt[0], self.peak[1]), _share(self.doubt[1], self.rms[1])

    def matters(self, tolerance: float) -> bool:
        """True if peak or rms change by more than a share, less their uncertainty."""
        return any(abs(one - other) - (0.0 if math.isnan(doubt) else doubt) > tolerance * other
                   for (one, other), doubt in zip((self.peak, self.rms), self.doubt, strict=True))  # fmt: skip


def _share(part: float, whole: float) -> float:
    return part / whole if whole else math.nan


@dataclass(frozen=True)
class Price:
    """Effect of a part of the scene: name, settings that remove it, sensors that are removed with it, changes by
    sensor."""

    part: str
    settings: tuple[str, ...]
    gone: tuple[str, ...]
    changes: tuple[Change, ...]


@dataclass(frozen=True, eq=False)
class Prices:
    """Effects of all parts, and reasons of those left out. Made by :func:`price`."""

    scene: Scene
    tolerance: float
    prices: tuple[Price, ...]
    left_out: dict[str, str]


def has_price(scene: Scene) -> bool:
    """True if a scene has joints with clearance, or friction."""
    return bool(_loose(scene) or _rubbing(scene))


def price(
    scene: Scene,
    tolerance: float = 0.01,
    budget: float = 60.0,
    sensors: Sequence[str] | None = None,
    progress: Progress = lambda stage: None,
) -> Prices:
    """Run a scene with and without each of its clearances and frictions, and without all of a kind.

    Parameters
    ----------
    scene, sensors, progress
        As :func:`kaneflex.study.trade.ranking.trade` takes them; the scene is run as it is.
    tolerance : float
        Relative change of a statistic that counts.
    budget : float
        Seconds after which no further part is run.

    Raises
    ------
    SceneError
        If a sensor does not exist, or the scene can't be run, or not without any of its parts.
    """
    check_sensors(scene, sensors)
    runs, deadline = Runs(scene, progress), time.perf_counter() + budget
    whole, finer = runs.run(Variant("as it is", ())).curves, None
    if tolerance_of(scene) * _FINER >= _FINEST:
        with suppress(SceneError):  # the uncertainty is then unknown
            finer = runs.run(Variant("finer", (f"solve.tolerance={tolerance_of(scene) * _FINER!r}",))).curves
    prices: list[Price] = []
    left_out: dict[str, str] = {}
    for kind, names in _parts(scene):
        part = f"{kind} of {' and '.join(names)}"
        try:
            if prices and time.perf_counter() > deadline:
                left_out[part] = "no time left within the budget"
                continue
            settings, gone = (tightened if kind == "clearance" else smooth)(scene, names)
            without = runs.run(Variant(f"without the {part}", settings)).curves
            counted = [name for name in sensors or scene.sensors if name not in gone]
            if not counted:
                reason = f"no requested sensor exists without the {part}"
                raise SceneError("sensors", None, reason, "Choose a sensor that does not belong to it")
            changes = tuple(_change(scene, name, whole, without, finer) for name in counted)
            prices.append(Price(part, settings, gone, changes))
        except SceneError as error:
            left_out[part] = str(error)
    if not prices:
        raise SceneError.gather([failed(part, reason) for part, reason in left_out.items()])
    return Prices(scene, tolerance, tuple(prices), left_out)


def _loose(scene: Scene) -> tuple[str, ...]:
    """Joints with a clearance, backlash included."""
    made = (contact for contact in scene.contacts.values() if isinstance(contact, ClearanceContact))
    return tuple(dict.fromkeys(contact.of for contact in made))


def _rubbing(scene: Scene) -> dict[str, str]:
    """Joints and contacts with friction -> path of its entry."""
    found = {}
    for table in ("joints", "contacts"):
        for name, entry in scene.raw.get(table, {}).items():
            for path, owner in (("friction", entry), ("clearance.friction", entry.get("clearance"))):
                if isinstance(owner, dict) and owner.get("friction") is not None:
                    found[name] = f"{table}.{name}.{path}"
    return found


def _parts(scene: Scene) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Each joint with a clearance, each joint or contact with friction, and all of a kind together."""
    for kind, names in (("clearance", _loose(scene)), ("friction", tuple(_rubbing(scene)))):
        yield from ((kind, (name,)) for name in names)
        if len(names) > 1:
            yield kind, names


def smooth(scene: Scene, names: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Settings that remove the friction of joints and contacts, and the sensors removed with it."""
    paths = _rubbing(scene)
    owners = {name: contact.joint for name, contact in scene.contacts.items()}
    gone = tuple(
        name for name, sensor in scene.sensors.items()
        if sensor.kind in FRICTION_KINDS and (str(sensor.target) in names or owners.get(str(sensor.target)) in names)
    )  # fmt: skip
    return (*(f"{paths[name]}=none" for name in names), *_left_out(scene, gone)), gone


def _left_out(scene: Scene, sensors: Sequence[str]) -> Iterator[str]:
    """Settings that remove sensors, and the events that use them."""
    yield from (f"sensors.{sensor}=none" for sensor in sensors)
    yield from (f"events.{name}=none" for name, event in scene.events.items() if event.sensor in sensors)


def tightened(scene: Scene, names: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Settings that remove the clearances of joints, and the sensors removed with them.

    A tight joint removes freedoms: as many free drives are removed, the last ones first, such that the mechanism is
    statically determinate. Loops of tight pins close near the initial position; flanks without play are welds.
    """
    poses, settings = place(tight_start(scene)).poses, list[str]()
    held, welded = 0, list[str]()
    for name in names:
        made = next(c for c in scene.contacts.values() if isinstance(c, ClearanceContact) and c.of == name)
        settings.append(f"joints.{name}.clearance=none")
        if not made.flank:
            held += 2
            continue
        addresses = ", ".join(f"'{address}'" for address in scene.joints[name].addresses)
        angle = made.clearance.middle
        settings += [f"joints.{name}={{weld=[{addresses}], relative_angle={angle!r}, revolute='none'}}"]
        settings += [f"drives.{name}=none"] * (name in scene.drives)
        held += name not in scene.drives
        welded.append(name)
    gone = _without_their_joint(scene, names, welded)
    settings += _left_out(scene, gone)
    free = [name for name in reversed(scene.drives) if scene.drives[name].free and name not in welded]
    reason = "the scene has too few free drives that could be left out"
    closed = [name for name in names if name not in welded]
    for dropped, ways in product(combinations(free, held), _ways(scene, closed)):
        found = (*settings, *ways, *(f"drives.{name}=none" for name in dropped))
        try:
            tight = with_settings(scene, found)
            check_determined(mechanism_of(tight), twice=True)
            turned = max(abs(math.remainder(pose[2] - poses[k][2], math.tau)) for k, pose in place(tight).poses.items())
            if turned < _ALIKE:
                return found, gone
            reason = "its loops close in another position"
        except SceneError as error:
            reason = str(error)
    raise SceneError("joints", ", ".join(names), f"without clearance: {reason}", "Write a scene without the clearance")


def _ways(scene: Scene, names: Sequence[str]) -> Iterator[tuple[str, ...]]:
    """Settings that close the loops of tight joints near the initial position, if they close any."""
    angles = {body: f"{body}={float(pose[2])!r}" for body, pose in place(tight_start(scene)).poses.items()}
    sides = {name: [side.body for side in scene.loose[name].sides if side.body in angles] for name in names}
    for bodies in ({name: list(angles) for name in names}, sides):
        yield tuple(f"joints.{name}.near={{{', '.join(angles[body] for body in bodies[name])}}}" for name in names)
    yield ()


def _without_their_joint(scene: Scene, names: Sequence[str], welded: Sequence[str]) -> tuple[str, ...]:
    """Sensors that don't exist without the clearances: of their contacts, of places in them, of welded joints."""

    def is_gone(sensor: Sensor) -> bool:
        target, contact = sensor.target, scene.contacts.get(str(sensor.target))
        joint = target.body if isinstance(target, Address) else target
        if sensor.kind in (*CONTACT_KINDS, *FRICTION_KINDS):
            return isinstance(contact, ClearanceContact) and contact.of in names
        return (sensor.kind == "position" and joint in names) or (sensor.kind in DRIVE_KINDS and joint in welded)

    return tuple(name for name, sensor in scene.sensors.items() if is_gone(sensor))


def _change(scene: Scene, sensor: str, whole: Curves, without: Curves, finer: Curves | None) -> Change:
    peak, rms = zip(*(curves.peak_and_rms(sensor) for curves in (whole, without)), strict=True)
    doubt = (math.nan, math.nan)
    if finer is not None:
        again = finer.peak_and_rms(sensor)
        doubt = abs(again[0] - peak[0]), abs(again[1] - rms[0])
    return Change(sensor, scene.sensors[sensor].unit, peak, rms, doubt)
