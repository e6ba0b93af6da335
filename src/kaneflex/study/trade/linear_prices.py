"""Curves of a periodic scene's linear models by corrections of one motion, without a run of each.

The one-way equations M z'' + C z' + K z = F are linear. The residual that a model leaves for the reference motion, K_g
z if K_g is dropped, drives a linear solve on the same harmonics. Its effect on a sensor is the price of the dropped
group: to first order by the first correction, then by further ones until the residual is negligible.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from kaneflex.integrate.run import dies_away, monodromy
from kaneflex.integrate.spectral import Grid, Orbit, improved, periodic_orbit
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.building import build_model
from kaneflex.response.elastic_motion import ElasticMotion
from kaneflex.response.sensors import measure
from kaneflex.response.time_statistics import between_steps
from kaneflex.scene import Scene
from kaneflex.scene.options import Options, resolve_options
from kaneflex.solve.curves import Curves
from kaneflex.solve.loading import load
from kaneflex.solve.one_way_corrections import embedded
from kaneflex.solve.one_way_run import not_repeated
from kaneflex.solve.quasistatic import mechanism_modes, quasistatic
from kaneflex.solve.variants import Variant
from kaneflex.study.differences import Difference
from kaneflex.study.trade.candidates import elements_of

_SHARE = 1e-3
"""Residual at which corrections end, as a share of the first one."""
DOUBT, _LEAST = 0.02, 1e-3
"""Relative uncertainty of an error that was found by a price, and the least error for it; measured:
docs/accuracy.md."""
_CONVERGED = ("spectral", "radau", "none")
"""Integrators whose discretisation error is below the models' differences."""
_SETTING = re.compile(
    r"solve\.(preset|integrator|steps|modes|terms\.(spin|gyroscopic|euler|geometric|damping))=|.*\.beam\.elements="
)
"""Settings that leave the rigid motion and its loads unchanged."""


@dataclass(frozen=True, eq=False)
class LinearPrices:
    """Curves of a scene's linear models, from one periodic motion. Made by :meth:`of`.

    Attributes
    ----------
    scene : Scene
        The neutral scene.
    model : Model
        Its model with preset ``stiffened``.
    orbit : Orbit
        Its periodic motion.
    sensors : tuple of str
        Compared sensors.
    """

    scene: Scene
    model: Model
    orbit: Orbit
    sensors: tuple[str, ...]
    _meshes: dict[tuple[int, ...], Model] = field(default_factory=dict)
    _orbits: dict[tuple[Options, tuple[int, ...]], tuple[Model, Orbit] | None] = field(default_factory=dict)
    _undersampled: dict[int, tuple[str, ...]] = field(default_factory=dict)

    @classmethod
    def of(cls, scene: Scene, sensors: Sequence[str]) -> LinearPrices | None:
        """Prices of a neutral scene; None unless it has a clearly stable periodic solution that corrections find.

        Raises SceneError if the scene can't be loaded.
        """
        options = resolve_options(scene)
        stops = any(event.stop for event in scene.events.values())
        if options.integrator != "spectral" or not options.cycles or scene.is_spatial or stops:
            return None
        model = load(scene)
        if model.module.FREE or not_repeated(model):
            return None
        orbit = periodic_orbit(model.system, model.scalars, 0.0, model.options.duration, model.options.tolerance)
        if orbit.reason or not dies_away(monodromy(orbit.grid)) or mechanism_modes(model, 0.0):
            return None
        found = cls(scene, model, orbit, tuple(sensors))
        found._meshes[_mesh(scene)] = model
        found._orbits[_equations(model.options), _mesh(scene)] = model, orbit
        return found

    def curves(self, variant: Variant, every: bool = False) -> Curves | None:
        """Sensors of a variant at its own steps; None unless it is a linear model of this rigid motion.

        ``every``: include all sensors of the scene. Raises SceneError if the scene does not allow the settings.
        """
        if not all(map(_SETTING.match, variant.settings)):
            return None
        scene = variant.of(self.scene)
        options = resolve_options(scene)
        one_way = options.dynamics in ("dynamic", "quasistatic")
        if not one_way or options.reduction != "none" or options.integrator not in _CONVERGED:
            return None
        times = options.duration / options.steps * np.arange(options.steps + 1)
        if options.dynamics == "quasistatic":
            model = replace(self._on_mesh(scene), options=options)
            z, v, a = (part.T for part in quasistatic(model, times, periodic=True))
        else:
            found = self._orbit(scene, options)
            if found is None:
                return None
            model, orbit = found
            z, v, a = orbit.at(options.steps).take(np.arange(options.steps + 1), axis=2, mode="wrap")
        motion = ElasticMotion(model, model.motion.at(times), (z, v, a))
        read = measure(motion, None if every else self.sensors)
        if options.steps not in self._undersampled:
            self._undersampled[options.steps] = tuple(between_steps(model))
        values = {name: series.values for name, series in read.items() if name in scene.sensors}
        return Curves(times, values, {}, model.warnings, 0.0, self._undersampled[options.steps])

    def model_of(self, variant: Variant) -> Model:
        """The model of a variant that has curves."""
        scene = variant.of(self.scene)
        return replace(self._on_mesh(scene), options=resolve_options(scene))

    def _on_mesh(self, scene: Scene) -> Model:
        mesh = _mesh(scene)
        if mesh not in self._meshes:
            seen = self.model.scene.seen(bodies=scene.bodies)
            self._meshes[mesh] = build_model(seen, self.model.options, self.model.motion)
        return self._meshes[mesh]

    def _orbit(self, scene: Scene, options: Options) -> tuple[Model, Orbit] | None:
        key = _equations(options), _mesh(scene)
        if key not in self._orbits:
            self._orbits[key] = self._corrected(replace(self._on_mesh(scene), options=options))
        return self._orbits[key]

    def _corrected(self, model: Model) -> tuple[Model, Orbit] | None:
        """Periodic motion of another model, corrected from this one's; None if not found or not clearly stable."""
        z, grid = self.orbit.z, self.orbit.grid
        same = model.reduced is self.model.reduced
        if not same:
            times = 2.0 * np.pi / grid.omega / grid.instants * np.arange(grid.instants)
            rates = grid.rates(z)
            motion = ElasticMotion(self.model, self.model.motion.at(times), (z, *rates))
            z = embedded(model, motion)
        period = 2.0 * np.pi / grid.omega
        own = Grid.of(model.system, model.scalars, 0.0, period, grid.instants, grid if same else None)
        found = improved(own, z, _SHARE)
        return None if found is None or not dies_away(monodromy(own)) else (model, found)


def decided(
    found: Sequence[Difference], tolerance: float, doubt: Callable[[str], float] = lambda sensor: 0.0
) -> bool:
    """True if errors by prices, with their uncertainty and the reference's, are certainly within or certainly beyond a
    tolerance."""

    errors = {each.sensor: each.peak_share or 0.0 for each in found}

    def within(more: float) -> bool:
        return all(
            error + more * max(error, _LEAST) + doubt(sensor) <= tolerance for sensor, error in errors.items()
        )

    return within(DOUBT) == within(-DOUBT)


def _mesh(scene: Scene) -> tuple[int, ...]:
    return tuple(elements_of(scene).values())


def _equations(options: Options) -> Options:
    """Options that determine the equations, without those of the solution method."""
    return replace(options, preset="", steps=1, integrator="", start="", tolerance=0.0)
