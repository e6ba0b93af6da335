"""Beams whose section or material varies, and axially rigid ones: frequencies, tension, deflections, section forces."""

import math

import numpy as np
import pytest
from machines import cantilever, pendulum
from runs import derived_on_the_fly
from sympy import Matrix

from kaneflex import SceneError, scene_of
from kaneflex.derive.elements.shapes import PARAMETERS, beam_section, beam_shape, beta_s, phi_s, x
from kaneflex.fem.links import Link
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.building import reference_modes
from kaneflex.solve.simulation import solve

CANTILEVER = cantilever(
    'length = "1 m", beam = {material = "steel", section = {rectangle = [0.02, 0.01]}, '
    'taper = {rectangle = [0.012, 0.01]}, elements = 8}',
    "beam", "clamp", loads='tip = {force_on = "beam.end", direction = [0, 1], value = "10 N"}',
    sensors='tip = {displacement = "beam.end", component = "y"}\nmid_moment = {bending_moment = "beam.mid"}',
    solve={"preset": "quasistatic", "duration": "0.1 s"},
)
SPINNING = pendulum(
    'length = "1 m", beam = {material = "steel", section = {rectangle = [0.02, 0.01]}, taper = {rectangle = [0.01, '
    '0.01]}, elements = 16}, points = {quarter = ["250 mm", 0]}', 'speed = "100 rad/s", cycle = "360 deg"', "beam",
    "hub",
    sensors="""
quarter = {axial_force = "beam.quarter"}
pull = {joint_force = "hub", component = "x"}
strain = {strain = "beam.mid", fibre = 0}
stretch = {displacement = "beam.end", component = "x"}""",
    solve={"preset": "quasistatic"},
)
RHO, E = 7850.0, 2.1e11


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("tapered")


def unit(model: Model) -> float:
    """sqrt(E I/(rho A))/L^2 at the root."""
    root = model.scene.bodies["beam"].profile.at(0.0)
    return np.sqrt(root.E_I_z / root.rho_A)


# Frequencies times L^2 sqrt(rho A/(E I)) of cantilevers whose height falls to 1 - c of the root's, the width to 1 - b:
# Ozdemir and Kaya (2006), Meccanica 41, 661-670, by the differential transform.
PUBLISHED = {
    (0.4, 0.0): (3.73708, 19.1138, 50.3537),
    (0.4, 0.4): (4.31878, 20.0500, 51.3346),
    (0.2, 0.0): (3.60828, 20.6210, 56.1923),
}


def test_a_link_deforms_between_its_nodes_as_the_element_of_its_matrices():
    """Timoshenko's element whose E I grows by half over its length."""
    of = {"length": 0.3, "phi_s": 0.7, "E_I": 40.0, "E_I_rise": 20.0}
    element = beam_shape(beam_section(varying=True), shear=True)
    rows = Matrix.vstack(element.displacement, element.rotation, element.slope).subs(beta_s, 1 / (1 + phi_s))
    for at in (0.0, 0.07, 0.15, 0.24, 0.3):
        expected = rows.subs({x: at} | {PARAMETERS[name]: value for name, value in of.items()})
        assert Link.functions(at, of) == pytest.approx(np.array(expected, dtype=float), abs=1e-14)


@pytest.mark.parametrize("taper", PUBLISHED)
def test_tapered_cantilevers(folder, taper):
    """Three frequencies to 1e-5 with 32 elements."""
    c, b = taper
    tip = [0.02 * (1 - c), 0.01 * (1 - b)]
    model = derived_on_the_fly(CANTILEVER, folder, f"beam.taper.rectangle={tip}", "beam.elements=32")
    found = reference_modes(model, 3)[0] / unit(model)
    assert found == pytest.approx(PUBLISHED[taper], rel=1e-5)


def test_statics_of_a_rotating_tapered_beam(folder):
    """N(X) = omega^2 int_X^1 rho A X dX with A = A_0 (1 - X/2), its strain and the stretch of the tip."""
    model = derived_on_the_fly(SPINNING, folder)
    series = solve(model).series
    pull = RHO * 2e-4 * 1e4

    def tension(X):
        return pull * ((1 - X**2) / 2 - (1 - X**3) / 6)

    angle = np.linspace(0, 2 * np.pi, len(series["pull"].values))
    for name in ("pull", "pull_rigid"):
        assert series[name].values == pytest.approx(-tension(0) * np.cos(angle), abs=1e-4 * pull)
    assert series["quarter_rigid"].values == pytest.approx(tension(0.25), rel=1e-9)
    assert series["quarter"].values == pytest.approx(tension(0.25), rel=2e-4)  # the stretched beam pulls more
    assert series["strain"].values == pytest.approx(tension(0.5) / (E * 2e-4 * 0.75), rel=2e-4)
    X = (np.arange(1000) + 0.5) / 1000
    stretch = np.mean(tension(X) / (E * 2e-4 * (1 - X / 2)))
    assert series["stretch"].values == pytest.approx(stretch, rel=1e-3)


def test_statics_of_a_stepped_beam(folder):
    """Two segments: P/(3 E) ((L^3 - b^3)/I_1 + b^3/I_2) with b beyond the step, exact for cubic elements."""
    root, tip = "{rectangle = [0.02, 0.01]}", "{rectangle = [0.01, 0.01]}"
    tapered = f"section = {root}, taper = {{rectangle = [0.012, 0.01]}}"
    assert tapered in CANTILEVER
    stepped = f"segments = {{root = {{to = 0.3, section = {root}}}, tip = {{section = {tip}}}}}"
    model = derived_on_the_fly(CANTILEVER.replace(tapered, stepped), folder, "beam.elements=4")
    assert 0.3 in model.links["beam"].nodes.round(12)
    assert len(model.links["beam"].nodes) == 5
    I_1, I_2 = 0.01 * 0.02**3 / 12, 0.01 * 0.01**3 / 12
    expected = 10 / (3 * E) * ((1 - 0.7**3) / I_1 + 0.7**3 / I_2)
    series = solve(model).series
    assert series["tip"].values == pytest.approx(expected, rel=1e-8)
    assert np.abs(series["mid_moment"].values) == pytest.approx(5.0, rel=1e-8)
    inertia = model.scene.bodies["beam"].profile.inertia(1.0)
    assert inertia.mass == pytest.approx(RHO * (0.3 * 2e-4 + 0.7 * 1e-4), rel=1e-12)


# ---- axially rigid ------------------------------------------------------------------------------------------------

WHIRLING = pendulum(
    'length = "1 m", beam = {material = "steel", A = "400 mm^2", I = "13333 mm^4", elements = 8, '
    'axially_rigid = true}', 'speed = "60 rad/s", cycle = "360 deg"', "beam", "hub", gravity=[0, -9.81],
    masses='tip = {at = "beam.end", mass = 1.5, inertia = 0.01}',
    loads='push = {force_on = "beam.end", direction = [1, 0.5], law = "100*sin(hub)"}',
    sensors="""
tip = {displacement = "beam.end", component = "y"}
hub_x = {joint_force = "hub", component = "x"}
hub_y = {joint_force = "hub", component = "y"}
torque = {drive_torque = "hub"}
mid_tension = {axial_force = "beam.mid"}
end_tension = {axial_force = "beam.end"}
mid_moment = {bending_moment = "beam.mid"}""",
    solve={"preset": "stiffened", "start": "periodic"},
)


def test_an_axially_rigid_beam_is_the_stiff_limit(folder):
    """Without the stiff modes the rest stays: bending, reactions, and the tension that no strain carries."""
    models = (derived_on_the_fly(WHIRLING, folder, f"beam.axially_rigid={word}") for word in ("true", "false"))
    found, elastic = (solve(model).series for model in models)
    for name, series in elastic.items():
        spread = np.abs(series.values).max()
        assert found[name].values == pytest.approx(series.values, abs=4e-3 * spread), name


def test_an_axially_rigid_beam_has_no_stiff_modes(folder):
    rigid, elastic = (
        derived_on_the_fly(WHIRLING, folder, f"beam.axially_rigid={word}", "masses.tip=none", "loads.push=none")
        for word in ("true", "false")
    )
    assert not [name for name in rigid.coordinates if name.endswith("u")]
    assert rigid.equations.size == 16 and elastic.equations.size == 24
    bending, all_of_them = reference_modes(rigid, 16)[0], reference_modes(elastic, 24)[0]
    nearest = np.abs(all_of_them[:, None] / bending - 1).min(axis=0)
    assert nearest.max() < 1e-9


def test_a_reduced_axially_rigid_beam(folder):
    """Craig-Bampton on top: six modes give the same peaks to half a hundredth."""
    full, reduced = (
        solve(derived_on_the_fly(WHIRLING, folder, *settings)).series for settings in ((), ("solve.modes=6",))
    )
    for name in ("tip", "mid_tension", "mid_moment"):
        peak = np.abs(full[name].values).max()
        assert np.abs(reduced[name].values).max() == pytest.approx(peak, rel=5e-3), name


def loaded(beam, more=""):
    """A cantilever of this beam under a force at its tip."""
    return cantilever(
        f'length = "1 m", {more}beam = {{{beam}, elements = 24}}', "arm", "clamp",
        loads='tip = {force_on = "arm.end", direction = [0, 1], value = "10 N"}',
        sensors="""
tip = {displacement = "arm.end", component = "y"}
mid = {displacement = "arm.mid", component = "y"}""",
        solve={"preset": "quasistatic", "duration": "0.1 s"},
    )


STEP = 0.4
E_OF, RHO_OF = (2.1e11, 7.0e10), (7850.0, 2700.0)
A, I = 2e-4, 0.01 * 0.02**3 / 12
SHAFT = (
    'material = "steel", segments = {root = {to = 0.4, section = {rectangle = [0.02, 0.01]}}, '
    'tip = {material = "aluminium", section = {rectangle = [0.02, 0.01]}}}'
)


def arm(beam):
    return scene_of(loaded(beam)).bodies["arm"]


@pytest.fixture(scope="module")
def shaft(tmp_path_factory):
    return derived_on_the_fly(loaded(SHAFT), tmp_path_factory.mktemp("shaft"))


def test_mass_and_inertia_are_the_sums_of_both_materials(shaft):
    body = shaft.scene.bodies["arm"]
    moments = [A * (RHO_OF[0] * STEP**k + RHO_OF[1] * (1 - STEP**k)) / k for k in (1, 2, 3)]  # int rho A x^(k - 1) dx
    found = body.profile.inertia(1.0)
    assert (found.mass, found.first, found.second) == pytest.approx(moments, rel=1e-12)
    assert body.mass == pytest.approx(moments[0], rel=1e-12)
    assert body.profile.at(0.7).E_I_z == pytest.approx(E_OF[1] * I, rel=1e-12)


CONSTANTS = {
    "all the beam's": ("", (2.1e11, 7850.0, 2.1e11 / 2.6)),
    "another material": ('material = "aluminium", ', (7.0e10, 2700.0, 7.0e10 / 2.66)),
    "its own modulus": ("E = 1e11, ", (1e11, 7850.0, 1e11 / 2.6)),
    "its own shear modulus": ("G = 5e10, rho = 1000, ", (2.1e11, 1000.0, 5e10)),
    "its own Poisson's ratio": ("nu = 0.2, ", (2.1e11, 7850.0, 2.1e11 / 2.4)),
    "a material but for the density": ('material = "aluminium", rho = 3000, ', (7.0e10, 3000.0, 7.0e10 / 2.66)),
}


def planar(body, x):
    here = body.profile.at(x)
    return here.rho_A, here.E_A, here.E_I_z, here.rho_I_z, here.G_A_y


@pytest.mark.parametrize("case", CONSTANTS)
def test_a_segment_takes_from_the_beam_what_it_does_not_say(case):
    own, (E_1, rho, G) = CONSTANTS[case]
    section = "section = {rectangle = [0.02, 0.01]}, kappa = 0.8"
    segments = f"segments = {{a = {{to = 0.4, {section}}}, b = {{{own}{section}}}}}"
    body = arm(f'material = "steel", theory = "timoshenko", {segments}')
    assert planar(body, 0.2)[:3] == pytest.approx((7850 * A, 2.1e11 * A, 2.1e11 * I), rel=1e-12)
    expected = (rho * A, E_1 * A, E_1 * I, rho * I, 0.8 * G * A)
    assert planar(body, 0.7) == pytest.approx(expected, rel=1e-12)


def test_the_shear_coefficient_of_a_shape_takes_the_segments_own_ratio():
    """kappa G A of a rectangle, Cowper (1966): 10 (1 + nu)/(12 + 11 nu)."""
    section = "section = {rectangle = [0.02, 0.01]}"
    segments = f"segments = {{a = {{to = 0.4, {section}}}, b = {{nu = 0.2, {section}}}}}"
    body = arm(f'material = "steel", theory = "timoshenko", {segments}')
    assert body.profile.at(0.7).G_A_y == pytest.approx(12 / 14.2 * 2.1e11 / 2.4 * A, rel=1e-12)


def test_a_given_mass_keeps_the_ratio_of_the_densities():
    mass = A * (RHO_OF[0] * STEP + RHO_OF[1] * (1 - STEP))
    profile = scene_of(loaded(SHAFT, f"mass = {mass * (1 + 5e-7)!r}, ")).bodies["arm"].profile
    assert profile.inertia(1.0).mass == pytest.approx(mass * (1 + 5e-7), rel=1e-14)
    assert profile.at(0.1).rho_A / profile.at(0.9).rho_A == pytest.approx(RHO_OF[0] / RHO_OF[1], rel=1e-12)


# ---- A and I that change linearly ---------------------------------------------------------------------------------


def test_linear_section_numbers():
    body = arm('material = "steel", theory = "rayleigh", A = 4e-4, I = 9e-9, A_end = 1e-4')
    assert planar(body, 0.5) == pytest.approx((7850 * 2.5e-4, 2.1e11 * 2.5e-4, 2.1e11 * 9e-9, 7850 * 9e-9, math.inf))
    assert body.mass == pytest.approx(7850 * 2.5e-4, rel=1e-12)
    moments = (7850 * (4e-4 / k - 3e-4 / (k + 1)) for k in (1, 2, 3))
    assert body.profile.inertia(1.0)[:3] == pytest.approx(tuple(moments), rel=1e-12)
    assert body.beam.structure() == {"theory": "rayleigh", "varying": True}


BAD = {
    "an end without a start": ('material = "steel", I = 1e-9, I_end = 1e-9, A_end = 1e-4',
        "bodies.arm.beam.A_end = 0.0001: A is missing. Give A, too."),
    "an end of a shape": ('material = "steel", section = {circle = 0.01}, I_end = 1e-9',
        "bodies.arm.beam.I_end = 1e-09: the section's shape gives it already. Leave I_end out."),
    "an end beside segments": (
        'material = "steel", A = 1e-4, A_end = 1e-5, segments = {a = {section = {circle = 0.01}}}',
        "bodies.arm.beam.A = 0.0001: every segment gives its own. Leave A out, or the segments.",
    ),
    "a segment of nothing": (
        'segments = {a = {to = 0.5, material = "steel", section = {circle = 0.01}}, b = {section = {circle = 0.01}}}',
        "bodies.arm.beam.segments.b: neither a material nor both E and rho. "
        "Give material, one of steel, aluminium, titanium.",
    ),
    "a segment of an unknown material": (
        'material = "steel", segments = {a = {material = "stel", section = {circle = 0.01}}}',
        "bodies.arm.beam.segments.a.material = 'stel': unknown material. The nearest known one is 'steel'.",
    ),
    "a segment without shear modulus": (
        'theory = "timoshenko", segments = {a = {E = 1e11, rho = 1000, section = {circle = 0.01}}}',
        "bodies.arm.beam.theory = 'timoshenko': a Timoshenko beam needs a shear modulus. Give nu or G.",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_beams(case):
    beam, message = BAD[case]
    with pytest.raises(SceneError) as caught:
        arm(beam)
    assert str(caught.value).splitlines()[0] == message
