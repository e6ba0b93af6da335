"""Candidate models of a scene."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from kaneflex.scene import Scene, with_settings
from kaneflex.scene.options import PAPER_DURATION, UNUSED_TERMS, has_term, resolve_options, tolerance_of
from kaneflex.scene.parts import TERM_NAMES
from kaneflex.solve.variants import Variant

_ONE_WAY = ("quasistatic", "linear", "stiffened")
_ELEMENTS = (1, 2, 4)
_MODES = (2, 4, 6)
_COARSER = (2, 4)
"""Divisors of the scene's steps."""
_LOOSE = (1e-6, 1e-4)
"""Tolerances of a step under preset coupled."""
_CHOICES = ("integrator", "modes", "reduction", "terms")
"""Entries of the scene's ``solve`` that select a model; candidates replace them."""


def neutral_settings(scene: Scene) -> tuple[str, ...]:
    """Settings that remove the scene's own choice of a model; start and duration are kept."""
    return tuple(f"solve.{key}=none" for key in _CHOICES if key in scene.raw.get("solve", {}))


def neutral(scene: Scene) -> Scene:
    """The scene with its ``neutral_settings`` and preset ``stiffened``."""
    return with_settings(scene, [*neutral_settings(scene), "solve.preset=stiffened"])


COUPLED = Variant("coupled", ("solve.preset=coupled",))
STIFFENED = Variant("stiffened", ("solve.preset=stiffened",))


def repeated_cycle(scene: Scene) -> float | None:
    """Cycle [s] that runs of the scene repeat; None if they are not periodic."""
    options = resolve_options(scene)
    return scene.period if options.cycles and options.start == "periodic" else None


def elements_of(scene: Scene) -> dict[str, int]:
    """Elastic link -> its number of elements."""
    return {name: body.beam.elements for name, body in scene.bodies.items() if body.elastic}


def elements_set(counts: Mapping[str, int]) -> tuple[str, ...]:
    """Settings that give elastic links these numbers of elements."""
    return tuple(f"bodies.{name}.beam.elements={count}" for name, count in counts.items())


def terms_of(scene: Scene, dynamics: str) -> tuple[str, ...]:
    """Term groups that occur in the scene with this kind of dynamics."""
    own = (name for name in TERM_NAMES if name not in UNUSED_TERMS[dynamics] and has_term(scene, name))
    return tuple(name for name in own if name != "damping" or scene.damping is not None)


def candidates_of(scene: Scene) -> tuple[Variant, ...]:
    """Candidates for a neutral scene: presets, then fewer elements, modes and steps, other integrators, fewer terms."""
    return tuple(dict.fromkeys((*_presets(scene), *_coarser(scene), *_INTEGRATORS, *_without_terms(scene))))


def _presets(scene: Scene) -> Iterator[Variant]:
    for preset in _ONE_WAY if scene.is_frame else ("rigid", *_ONE_WAY):
        yield Variant(preset, (f"solve.preset={preset}",))
    period = scene.period if scene.solve.duration is None else None
    cycles = None if period is None else max(1, math.ceil(PAPER_DURATION / period - 1e-9))
    whole = () if period is None else (f"solve.duration={cycles * period!r}",)
    yield Variant("paper", ("solve.preset=paper", *whole))
    yield COUPLED
    for loose in _LOOSE:
        if loose > tolerance_of(scene):
            settings = ("solve.preset=coupled", f"solve.tolerance={loose!r}")
            yield Variant(f"coupled, tolerance {loose:.0e}", settings)


def _coarser(scene: Scene) -> Iterator[Variant]:
    own = set(elements_of(scene).values())
    steps = resolve_options(scene).steps
    for preset in ("quasistatic", "stiffened"):
        meshes = {n: dict.fromkeys(elements_of(scene), n) for n in _ELEMENTS if own != {n}}
        kinds = {preset: ()} | {f"{preset}, {_count(n, 'element')}": elements_set(each) for n, each in meshes.items()}
        if preset == "stiffened":
            kinds |= {f"{preset}, {n} modes": (f"solve.modes={n}",) for n in _MODES}
        for name, settings in kinds.items():
            if settings:
                yield Variant(name, (f"solve.preset={preset}", *settings))
            for part in _COARSER:
                fewer = max(1, steps // part)
                coarse = (f"solve.preset={preset}", *settings, f"solve.steps={fewer}")
                yield Variant(f"{name}, {_count(fewer, 'step')}", coarse)


_INTEGRATORS = [
    Variant(f"stiffened, {integrator}", ("solve.preset=stiffened", f"solve.integrator={integrator}"))
    for integrator in ("newmark", "generalised-alpha")
]


def _without_terms(scene: Scene) -> Iterator[Variant]:
    for preset, dynamics in (("quasistatic", "quasistatic"), ("stiffened", "dynamic")):
        for term in terms_of(scene, dynamics):
            # without K_g this is preset linear plus foreshortening
            yield Variant(f"{preset} without {term}", (f"solve.preset={preset}", f"solve.terms.{term}=false"))


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}" + ("" if number == 1 else "s")
