"""Models that take their equations from a similar one: the same numbers, and only where nothing else differs."""

from dataclasses import fields

import numpy as np
import pytest

from kaneflex import load, read_scene, with_settings
from kaneflex.fem.assembly import ElasticEquations
from kaneflex.scene.structure import structure_hash
from kaneflex.solve.simulation import solve

CASES = [("engine",), ("engine", "solve.preset=linear"), ("engine", "solve.modes=2"), ("engine-elastic-crank",)]
CASES += [("v-engine", "solve.modes=2"), ("spin-up",), ("quick-return",)]


def loaded(name: str, *settings: str, like=None):
    return load(with_settings(read_scene(name), settings), like=like)


def faster(name: str) -> str:
    drive = next(iter(read_scene(name).drives))
    return f"drives.{drive}.speed='40 rad/s'"


@pytest.mark.parametrize("case", CASES, ids=" ".join)
def test_of_another_speed_the_equations_are_those_before_and_what_loading_alone_makes(case):
    name, *settings = case
    before = loaded(name, *settings)
    found, alone = loaded(name, *settings, faster(name), like=before), loaded(name, *settings, faster(name))
    assert found.reduced is before.reduced and found.scene == alone.scene and found.options == alone.options
    assert found.reference_time == alone.reference_time and found.warnings == alone.warnings
    assert found.coordinates == alone.coordinates
    assert structure_hash(found.given) == structure_hash(found.given.model_copy())  # of the other, and computed
    np.testing.assert_array_equal(found.motion.parameters, alone.motion.parameters)
    for field in fields(ElasticEquations)[1:]:
        got, wanted = (getattr(model.reduced, field.name).terms for model in (found, alone))
        assert got.keys() == wanted.keys()
        assert all(np.array_equal(got[monomial], wanted[monomial]) for monomial in got)


@pytest.mark.parametrize("case", CASES[:4], ids=" ".join)
def test_of_another_speed_the_same_system_is_integrated_and_sensors_are_those_of_a_run_alone(case):
    name, *settings = case
    before = loaded(name, *settings, "solve.steps=72")
    system = before.system
    found = loaded(name, *settings, "solve.steps=72", faster(name), like=before).sharing(before)
    assert found.system is system and found.monomials == before.monomials
    assert solve(before).series  # what its links keep is not to reach into the next run
    alone = solve(loaded(name, *settings, "solve.steps=72", faster(name))).series
    for sensor, series in solve(found).series.items():
        np.testing.assert_array_equal(series.values, alone[sensor].values)


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("setting", [
    "rod.length='150 mm'", "rod.E='100 GPa'", "rod.elements=3", "gravity=[1, 2]", "solve.preset=linear",
    "solve.modes=2", "solve.terms.geometric=false", "damping.rayleigh.ratio=0.05", "bodies.piston.mass='1 kg'",
    "drives.main.rotation=free",
])  # fmt: skip
def test_whatever_else_differs_the_equations_are_made_anew(setting):
    before = loaded("engine")
    found = loaded("engine", setting, like=before)
    assert found.reduced is not before.reduced and found.links["rod"] is not before.links["rod"]


@pytest.mark.parametrize("settings", [("solve.preset=paper",), ("solve.reduction=modal", "solve.modes=2")])
def test_equations_of_one_instant_are_made_anew_for_every_speed(settings):
    before = loaded("engine", *settings)
    assert loaded("engine", *settings, faster("engine"), like=before).reduced is not before.reduced
