"""Rotary inertia, shear and gravity, switched off at run time: the scene without them, by the same module."""

import numpy as np
import pytest
from machines import on_supports
from runs import derived_on_the_fly

from kaneflex.multibody.model.building import reference_modes
from kaneflex.scene.structure import structure_hash
from kaneflex.solve.simulation import solve
from kaneflex.support.errors import SceneError

SWINGING = """
schema = 1
gravity = [0, -9.81]
bodies.arm.length = "0.5 m"
bodies.arm.beam = {material = "steel", section = {rectangle = ["100 mm", "20 mm"]}, theory = "timoshenko", elements = 3}
bodies.bob.mass = "2 kg"
joints.hub = {revolute = ["ground", "arm.start"]}
joints.tip = {weld = ["arm.end", "bob"]}
drives.hub = {law = "1.2*sin(20*t)", period = "0.3141592653589793 s"}
sensors.torque = {drive_torque = "hub"}
sensors.hub_x = {joint_force = "hub", component = "x"}
sensors.end = {displacement = "arm.end", component = "y"}
sensors.mid_moment = {bending_moment = "arm.mid"}
sensors.mid_tension = {axial_force = "arm.mid"}
sensors.feels = {acceleration = "arm.end", component = "y"}
solve = {preset = "stiffened", steps = 400}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("switched")


def off(*terms: str) -> tuple[str, ...]:
    return tuple(f"solve.terms.{term}=false" for term in terms)


# What is switched off, and the scene that has it not.
PAIRS = {
    "rotary and shear": (off("rotary", "shear"), ("arm.beam.theory=euler-bernoulli",)),
    "shear": (off("shear"), ("arm.beam.theory=rayleigh",)),
    "rotary": (off("rotary"), ("arm.beam.theory=shear",)),
    "gravity": (off("gravity"), ("gravity=[0,0]",)),
    "all": (off("rotary", "shear", "gravity"), ("arm.beam.theory=euler-bernoulli", "gravity=[0,0]")),
}


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("case", PAIRS)
def test_a_scene_without_the_terms(folder, case):
    """Both stages alike: matrices, torque and reactions with their rigid values, section forces, accelerometer."""
    switched, plain = (derived_on_the_fly(SWINGING, folder, *settings) for settings in PAIRS[case])
    for name, matrix in (("M", plain.M(0.1)), ("K_s", plain.K_s(0.1)), ("K_g", plain.K_g(0.1))):
        assert getattr(switched, name)(0.1) == pytest.approx(matrix, rel=1e-11, abs=1e-11 * np.abs(matrix).max())
    found, expected = solve(switched).series, solve(plain).series
    assert set(found) == set(expected) and "torque_rigid" in found
    for name, series in expected.items():
        spread = np.abs(series.values).max()
        assert found[name].values == pytest.approx(series.values, abs=1e-8 * spread), name


@pytest.mark.parametrize(("term", "name"), [("rotary", "torque_rigid"), ("shear", "end"), ("gravity", "torque_rigid")])
def test_every_term_matters_here_and_the_module_stays(folder, term, name):
    whole, part = (derived_on_the_fly(SWINGING, folder, *settings) for settings in ((), off(term)))
    assert part.motion.module.STRUCTURE == whole.motion.module.STRUCTURE == structure_hash(whole.scene)
    found, expected = (solve(model).series[name].values for model in (part, whole))
    assert np.abs(found - expected).max() > 1e-3 * np.abs(expected).max()
    assert not part.warnings


def test_a_scene_that_has_none_is_told_so(folder):
    settings = ("arm.beam.theory=shear", "gravity=[0,0]", *off("rotary", "shear", "gravity", "spin"))
    expected = "solve.terms.rotary, solve.terms.gravity has no effect: the scene has no such terms"
    assert derived_on_the_fly(SWINGING, folder, *settings).warnings == (expected,)


def test_a_preset_without_deformation_has_no_shear(folder):
    model = derived_on_the_fly(SWINGING, folder, "solve.preset=rigid", "solve.terms.shear=true")
    assert model.warnings == ("solve.terms.shear has no effect under preset rigid",)
    still = derived_on_the_fly(SWINGING, folder, "solve.preset=rigid", *off("gravity"))
    assert (still.scene.gravity, model.scene.gravity) == ((0.0, 0.0), (0.0, -9.81))


def test_coupled_is_one_whole(folder):
    with pytest.raises(SceneError, match="preset coupled cannot leave terms out"):
        derived_on_the_fly(SWINGING, folder, "solve.preset=coupled", *off("gravity"))


PINNED = on_supports(
    'length = "1 m", beam = {E = 1e9, rho = 1000, nu = 0.3, section = {rectangle = [0.2, 0.1]}, theory = "shear", '
    'elements = 24}', solve={"preset": "quasistatic", "duration": "0.1 s"},
)


def test_the_shear_beam_on_two_supports(folder):
    """omega^2 = E I k^4/(rho A)/(1 + E I k^2/(kappa G A)), k = n pi/L: Han, Benaroya & Wei (1999), section 4."""
    found = reference_modes(derived_on_the_fly(PINNED, folder), 8)[0]
    kappa = 10 * 1.3 / (12 + 11 * 0.3)
    k = np.pi * np.arange(1, 4)
    exact = k**2 * np.sqrt(1e6 * 0.2**2 / 12 / (1 + 2.6 * 0.2**2 / 12 * k**2 / kappa))
    assert [np.abs(found / omega - 1).min() for omega in exact] == pytest.approx([0, 0, 0], abs=1e-4)
