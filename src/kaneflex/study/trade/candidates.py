"""Candidate models of a scene, by preset and in the order of their work."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from kaneflex.scene import Scene, with_settings
from kaneflex.scene.bodies import Body
from kaneflex.scene.options import UNUSED_TERMS, has_term, modes_of, resolve_options, tolerance_of
from kaneflex.scene.parts import TERM_NAMES
from kaneflex.scene.start import Start
from kaneflex.solve.variants import Variant
from kaneflex.study.differences import check_sensors
from kaneflex.support.errors import SceneError, refuse

_ELEMENTS = (1, 2, 4)
_MODES = (2, 4, 6)
_COARSER, _FINER = (2, 4), (2, 4)
"""Divisors of the scene's steps, and factors on them."""
_COUPLED_MODES = (1, 2)
_LOOSE = (1e-6, 1e-4)
"""Tolerances of a step under preset coupled."""
_CHOICES = ("preset", "integrator", "modes", "reduction", "terms")
"""Entries of the scene's ``solve`` that select a model; candidates replace them."""
_OF_A_STEP, _OF_MODES = 10.0, 2
"""Work of the sensors at an instant, in multiples of that of a coordinate; work to find modes, as a number of them."""

RIGID, STIFFENED, COUPLED = (Variant(name, (f"solve.preset={name}",)) for name in ("rigid", "stiffened", "coupled"))


@dataclass(frozen=True)
class Family:
    """Models of one preset.

    Attributes
    ----------
    plain : Variant
        With the scene's elements and steps.
    cheaper, finer : tuple of Variant
        With less and with more work, each by ascending work.
    """

    plain: Variant
    cheaper: tuple[Variant, ...] = ()
    finer: tuple[Variant, ...] = ()


def neutral_settings(raw: Mapping[str, Any]) -> tuple[str, ...]:
    """Settings that remove the scene's own choice of a model; start and duration are kept."""
    return tuple(f"solve.{key}=none" for key in _CHOICES[1:] if key in raw.get("solve", {}))


def neutral(scene: Scene, check: Callable[[Scene], object] = resolve_options) -> Scene:
    """The scene with its ``neutral_settings`` and preset ``stiffened``, or ``coupled`` if ``check`` rejects that; with
    error estimates on request, however long they take."""
    laid = (*neutral_settings(scene.raw), "solve.errors=total")
    found = with_settings(scene, [*laid, *STIFFENED.settings])
    try:
        check(found)
    except SceneError:
        found = with_settings(scene, [*laid, *COUPLED.settings])
        check(found)  # raises the errors that do not depend on the preset
    return found


def own_model(scene: Scene) -> Variant:
    """The scene's own model, as a variant of the neutral scene."""
    solve, settings = scene.raw.get("solve", {}), [f"solve.preset={scene.solve.preset}"]
    for key in _CHOICES[1:]:
        value = solve.get(key, {} if key == "terms" else None)
        if isinstance(value, Mapping):
            settings += [f"solve.terms.{name}={str(on).lower()}" for name, on in value.items()]
        elif value is not None:
            settings.append(f"solve.{key}={value}")
    return Variant("the scene's own", tuple(settings))


def elements_of(bodies: Mapping[str, Body]) -> dict[str, int]:
    """Elastic link -> its number of elements."""
    return {name: body.beam.elements for name, body in bodies.items() if body.elastic}


def elements_set(counts: Mapping[str, int]) -> tuple[str, ...]:
    """Settings that give elastic links these numbers of elements."""
    return tuple(f"bodies.{name}.beam.elements={count}" for name, count in counts.items())


def is_driven(scene: Scene) -> bool:
    """True for a neutral scene of rigid bodies that drives move: preset ``rigid`` has rounding errors only."""
    return scene.solve.preset != "coupled" and not (scene.is_elastic or scene.free_joints or scene.floating)


def terms_of(scene: Scene, dynamics: str) -> tuple[str, ...]:
    """Term groups that have an effect in the scene with this kind of dynamics."""
    none = set(UNUSED_TERMS[dynamics])
    none |= set() if scene.is_elastic else {"spin", "gyroscopic", "euler", "geometric", "damping"}
    none |= set() if scene.drives or scene.floating else {"spin", "gyroscopic", "euler"}
    none |= {"damping"} if scene.damping is None else set()
    return tuple(name for name in TERM_NAMES if name not in none and has_term(scene, name))


def families(scene: Scene, stored: int = 0) -> tuple[Family, ...]:
    """Models of a neutral scene by preset, the cheapest preset first; ``stored``: stored steps of coupled models, by
    default the scene's."""
    if is_driven(scene):
        return (_storing(RIGID, (RIGID,), resolve_options(scene).steps, stored),)
    coupled = _coupled(scene, stored)
    if scene.solve.preset == "coupled":
        return (coupled,)
    rigid = () if scene.is_frame else (Family(RIGID),)
    elastic = ("quasistatic", "linear", "stiffened") if scene.is_elastic else ()
    return (*rigid, *(_one_way(scene, preset) for preset in elastic), coupled)


def _one_way(scene: Scene, preset: str) -> Family:
    """Other meshes, modes of the mechanism, each with fewer steps; more steps with the scene's mesh."""
    steps, own, plain = resolve_options(scene).steps, elements_of(scene.bodies), (f"solve.preset={preset}",)
    meshes = {n: dict.fromkeys(own, n) for n in _ELEMENTS if set(own.values()) != {n}}
    kinds: dict[str, tuple[tuple[str, ...], float]] = {preset: ((), sum(own.values()))}
    kinds |= {f"{preset}, {_count(n, 'element')}": (elements_set(mesh), n * len(own)) for n, mesh in meshes.items()}
    if preset != "quasistatic":
        kinds |= {f"{preset}, {n} modes": ((f"solve.modes={n}",), (n + _OF_MODES) / 3) for n in _MODES}
    work: dict[Variant, float] = {}
    for name, (settings, elements) in kinds.items():
        counts = [max(1, steps // part) for part in _COARSER] + [steps * more for more in _FINER if not settings]
        model, each = Variant(name, (*plain, *settings)), _OF_A_STEP + 3 * elements
        work |= {with_stored(model, steps, count): count * each for count in (steps, *counts)}
    whole, ascending = Variant(preset, plain), sorted(work, key=work.__getitem__)
    number = ascending.index(whole)
    return Family(whole, tuple(ascending[:number]), tuple(ascending[number + 1 :]))


def _coupled(scene: Scene, stored: int) -> Family:
    """Fewer modes of each link, each with looser tolerances of a step, by a number of stored steps."""
    modes, tolerance, work = modes_of(scene.solve), tolerance_of(scene.solve), dict[Variant, float]()
    for count in (modes, *(fewer for fewer in _COUPLED_MODES if scene.is_elastic and fewer < modes)):
        for limit in (tolerance, *(loose for loose in _LOOSE if loose > tolerance)):
            name = "coupled" if count == modes else f"coupled, {_count(count, 'mode')} a link"
            settings = () if count == modes else (f"solve.modes={count}",)
            if limit != tolerance:
                name, settings = f"{name}, tolerance {limit:.0e}", (*settings, f"solve.tolerance={limit!r}")
            work[Variant(name, (*COUPLED.settings, *settings))] = -math.log10(limit) * (3 + count)
    return _storing(COUPLED, sorted(work, key=work.__getitem__), resolve_options(scene).steps, stored)


def _storing(plain: Variant, ascending: Sequence[Variant], steps: int, stored: int) -> Family:
    """Models by ascending work with so many stored steps instead of the scene's, and the plain one."""
    models = (with_stored(each, steps, stored or steps) for each in ascending)
    others = tuple(each for each in models if each != plain)
    return Family(plain, finer=others) if stored > steps else Family(plain, others)


def with_stored(model: Variant, steps: int, stored: int) -> Variant:
    """A model of so many steps with another number of stored ones, which hardly change what it computes."""
    own = tuple(setting for setting in model.settings if not setting.startswith("solve.steps="))
    name = f"{model.name}, {_count(stored, 'step')}"
    return model if stored == steps else Variant(name, (*own, f"solve.steps={stored}"))


def candidates_of(scene: Scene, stored: int = 0) -> tuple[Variant, ...]:
    """Candidates of a neutral scene: plain presets, then other fineness; ``stored`` as of :func:`families`.

    With free joints those of ``coupled`` come first: others move as if nothing deformed, and hardly faster.
    """
    found = families(scene, stored)[:: -1 if scene.free_joints else 1]
    others = (each for family in found for each in (*family.cheaper, *family.finer))
    return (*(family.plain for family in found), *others)


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}" + ("" if number == 1 else "s")


def check_request(scene: Scene, tolerance: float, budget: float, sensors: Sequence[str] | None) -> tuple[str, ...]:
    """Names of the compared sensors; raises SceneError for an invalid request before anything is computed."""
    refuse(
        (not 0 < tolerance < 1, "--tolerance", tolerance, "not a share of each sensor's peak",
         "Give a value between 0 and 100 %"),
        (not budget > 0, "--budget", budget, "not a positive time", "Write for example 60s"),
    )  # fmt: skip
    check_sensors(scene.sensors, sensors)
    modal = next((name for name, body in scene.bodies.items() if body.modal is not None), None)
    refuse(
        (isinstance(scene.solve.start, Start), "solve.start", "a table of a state",
         "the compared models have different coordinates", "Start from zero, quasistatic or periodic"),
        (modal is not None, f"bodies.{modal}.modal_data", modal and Path(str(scene.bodies[modal].modal_data)).name,
         "only preset coupled accepts modal data, so there is nothing to compare", "Give the body a beam"),
    )  # fmt: skip
    return tuple(sensors or scene.sensors)
