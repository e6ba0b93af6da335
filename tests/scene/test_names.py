"""Scenes under other names, and models that take their equations from a similar one, have the same numbers."""

import ast
import json
from dataclasses import fields

import numpy as np
import pytest
import renaming
from runs import run, solved, tables

from kaneflex import load, read_scene, shipped_scenes, with_settings
from kaneflex.derive.generate import generate
from kaneflex.derive.ir.names import numbered
from kaneflex.fem.assembly import ElasticEquations
from kaneflex.multibody.model.module_loading import find_laws_module, find_module
from kaneflex.scene.structure import structure_hash, structure_of
from kaneflex.solve.simulation import solve

SCENES = {
    "engine": (), "quick-return": (), "two-link-arm": (), "stick-slip": (), "bouncing-bar": (),
    "four-bar-motor": ("solve.duration=0.2 s",), "six-bar": ("solve.steps=90",), "spatial-slider-crank-elastic": (),
    "engine-torque": ("solve.duration=20 ms",), "engine-rig-clearance": ("solve.duration=0.1 s", "solve.steps=1000"),
    "spatial-slider-crank": (), "free-frame": ("solve.steps=90",), "rotating-blade": (),
}  # fmt: skip
"""Every table that has names, every preset's engine, and what names another part: loops, laws, stops, springs."""


def quiet(stage):
    pass


@pytest.mark.parametrize("name", sorted(shipped_scenes()))
def test_what_is_derived_knows_no_names(name):
    """The equations are those of the numbered structure; it is the same under any names, laws beside."""
    scene = read_scene(name)
    for seed in range(3):
        new = renaming.drawn(scene, seed)
        plain, other = structure_of(scene), structure_of(renaming.renamed(scene, new))
        for table in ("loads", "drives"):
            laws = [entry.pop("law", "") for entry in other[table].values()]
            assert laws == [new.law(entry.pop("law", "")) for entry in plain[table].values()]
        assert json.dumps(numbered(other)[0]) == json.dumps(numbered(plain)[0])
        assert other != plain


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", SCENES)
def test_a_renamed_scene_has_the_same_numbers_to_the_bit(name, monkeypatch):
    scene, plain = with_settings(read_scene(name), SCENES[name]), run(name, *SCENES[name])
    new = renaming.drawn(scene, 4)
    other = renaming.renamed(scene, new)
    laws = renaming.under_new_names(find_laws_module(scene, quiet)[0], new)
    monkeypatch.setattr("kaneflex.multibody.model.assembly.find_laws_module", lambda scene, progress: (laws, 0.0))
    if not scene.is_spatial:
        rigid = renaming.under_new_names(find_module(scene, quiet)[0], new)
        monkeypatch.setattr("kaneflex.solve.loading.find_module", lambda scene, progress: (rigid, 0.0))
    found = solved(other)
    for sensor, series in plain.series.items():
        base = sensor.removesuffix("_rigid")
        again = found.series[new.of["sensors"][base] + sensor.removeprefix(base)]
        assert np.array_equal(again.values, series.values, equal_nan=True), sensor


@pytest.mark.parametrize("seed", range(2))
def test_a_renamed_module_is_the_same_but_for_names(seed):
    """Tables by their new names; kernels with one identifier for each of the shipped one's, no two alike."""
    scene = read_scene("engine")
    new = renaming.drawn(scene, seed)
    shipped = find_module(scene, quiet)[0]
    with open(shipped.__file__, encoding="utf-8") as file:
        plain = ast.parse(file.read())
    other = ast.parse(generate(renaming.renamed(scene, new)))
    found = tables(other)
    expected = renaming.under_new_names(shipped, new)
    for table in ("PARAMETERS", "TABLES", "CONSTANTS", "LINKS"):
        assert found[table] == getattr(expected, table), table
    assert [row[0] for row in found["SCALARS"]] == [row[0] for row in expected.SCALARS]
    there, back = {}, {}
    for one, two in zip(functions(plain), functions(other), strict=True):
        for a, b in zip(ast.walk(one), ast.walk(two), strict=True):
            assert type(a) is type(b)
            if isinstance(a, ast.Name):
                assert there.setdefault(a.id, b.id) == b.id and back.setdefault(b.id, a.id) == a.id
            elif isinstance(a, ast.Constant):
                assert a.value == b.value
    assert there != dict(zip(there, there, strict=True))


def functions(tree: ast.Module) -> list[ast.FunctionDef]:
    return [node for node in tree.body if isinstance(node, ast.FunctionDef)]


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
