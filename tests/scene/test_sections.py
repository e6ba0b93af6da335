"""Sections by shape, materials, tapers and segments: numbers against handbook values, and every error's message."""

import json
import math

import pytest
from scipy.integrate import quad

from kaneflex import SceneError, scene_of
from kaneflex.scene.shapes import Shape, torsion_constant

SCENE = """
schema = 1
bodies.arm = {{length = "1 m", beam = {{{beam}}}}}
joints.clamp = {{weld = ["ground", "arm.start"]}}
solve.duration = "1 s"
"""


@pytest.fixture
def arm():
    """The body of a scene with one beam, whose keys are given as TOML."""

    def read(beam: str):
        return scene_of(SCENE.format(beam=beam)).bodies["arm"]

    return read


STEEL = 'material = "steel", '
# Area, second moments I_y, I_z and J [mm], Cowper's shear coefficients along y and z at nu = 0.3, worked out by hand.
SHAPES = {
    "rectangle": (["20 mm", "10 mm"], 200, 20 * 10**3 / 12, 10 * 20**3 / 12, 0.228682 * 20 * 10**3, *[13 / 15.3] * 2),
    "circle": ("6 mm", math.pi * 9, *[math.pi * 6**4 / 64] * 2, math.pi * 6**4 / 32, *[7.8 / 8.8] * 2),
    "tube": (["30 mm", "2 mm"], math.pi * (15**2 - 13**2), *[math.pi / 4 * (15**4 - 13**4)] * 2,
        math.pi / 2 * (15**4 - 13**4), *[0.534950] * 2),
    "I": (["20 mm", "13 mm", "3.5 mm", "3.94 mm"],
        2 * 13 * 3.5 + 13 * 3.94,
        (2 * 3.5 * 13**3 + 13 * 3.94**3) / 12,
        (13 * 20**3 - 9.06 * 13**3) / 12,
        (2 * 13 * 3.5**3 + 16.5 * 3.94**3) / 3,
        0.378957,
        13 / 15.3 * 2 * 13 * 3.5 / (2 * 13 * 3.5 + 13 * 3.94)),
}


@pytest.mark.parametrize("kind", SHAPES)
def test_shapes(arm, kind):
    written, A, I_y, I_z, J, k_y, k_z = SHAPES[kind]
    A, I_y, I_z, J = 1e-6 * A, 1e-12 * I_y, 1e-12 * I_z, 1e-12 * J
    body = arm(STEEL + f'section = {{{kind} = {json.dumps(written)}}}, theory = "timoshenko"')
    here = body.profile.at(0.3)
    assert body.mass == pytest.approx(7850 * A, rel=1e-12)
    assert (here.rho_A, here.E_A, here.E_I_z) == pytest.approx((7850 * A, 2.1e11 * A, 2.1e11 * I_z), rel=1e-12)
    assert here.rho_I_z == pytest.approx(7850 * I_z, rel=1e-12)
    assert here.G_A_y == pytest.approx(k_y * 2.1e11 / 2.6 * A, rel=2e-5)
    shape = Shape.model_validate({kind: written})
    found, unknown = (shape.numbers_of(shape.dimensions, nu) for nu in (0.3, None))
    assert (found.I_y, found.I_z) == pytest.approx((I_y, I_z), rel=1e-12)
    assert pytest.approx(J, rel=2e-6) == found.J == unknown.J and unknown.k_y is None and unknown.k_z is None
    assert found.k_z == pytest.approx(k_z, rel=2e-5)


@pytest.mark.parametrize("nu", [0.0, 0.3])
def test_shear_coefficients_in_their_limits(nu):
    """A thin tube has 2 (1 + nu)/(4 + 3 nu) (Cowper 1966); without flanges an I is a rectangle."""
    thin = Shape(tube=[1.0, 1e-6]).numbers_of((1.0, 1e-6), nu)
    assert thin.k_y == pytest.approx(2 * (1 + nu) / (4 + 3 * nu), rel=1e-5)
    web = Shape(I=[1.0, 0.1, 1e-9, 0.1]).numbers_of((1.0, 0.1, 1e-9, 0.1), nu)
    assert web.k_y == pytest.approx(10 * (1 + nu) / (12 + 11 * nu), rel=1e-6)
    solid = Shape(tube=[1.0, 0.4999999]).numbers_of((1.0, 0.4999999), nu)
    assert solid == pytest.approx(Shape(circle=1.0).numbers_of((1.0,), nu), rel=1e-5)


def test_the_reference_engines_rod_is_an_i_section(arm):
    """142.3 mm^2 and 7008 mm^4 are the exact numbers of its shape, 20 x 13 mm with 3.5 and 3.94 mm."""
    body = arm(STEEL + 'section = {I = ["20 mm", "13 mm", "3.5 mm", "3.94 mm"]}')
    assert body.mass / 7850 == pytest.approx(142.2e-6, rel=1e-3)
    assert body.E_I / 2.1e11 == pytest.approx(7008e-12, rel=1e-3)


@pytest.mark.parametrize(("given", "E_over_G"), [
    ('material = "aluminium", ', 2.66),
    ("E = 7e10, rho = 2700, G = 2.8e10, ", 2.5),
    ("E = 1, rho = 1, nu = 0.2, ", 2.4),
])  # fmt: skip
def test_shear_modulus(arm, given, E_over_G):
    here = arm(given + 'section = {circle = 0.01}, kappa = 0.9, theory = "timoshenko"').profile.at(0.0)
    assert here.E_A * 0.9 / here.G_A_y == pytest.approx(E_over_G, rel=1e-12)


def test_theories_hold_what_they_know(arm):
    """Euler-Bernoulli: no rotary inertia, stiff in shear; Rayleigh: no shear."""
    found = {
        theory: arm(STEEL + f'section = {{rectangle = [0.2, 0.1]}}, theory = "{theory}"')
        for theory in ("euler-bernoulli", "rayleigh", "timoshenko")
    }
    rho_I = 7850 * 0.1 * 0.2**3 / 12
    rotary = {theory: body.profile.element(0.0, 0.5)["rho_I"] for theory, body in found.items()}
    assert rotary == pytest.approx({"euler-bernoulli": 0.0, "rayleigh": rho_I, "timoshenko": rho_I})
    flexible = {theory: body.profile.element(0.0, 0.5)["phi_s"] for theory, body in found.items()}
    assert flexible["euler-bernoulli"] == flexible["rayleigh"] == 0.0
    kappa = 13 / 15.3
    assert flexible["timoshenko"] == pytest.approx(12 * 2.6 * (0.2**2 / 12) / (kappa * 0.25), rel=1e-12)
    slender = 7850 * 0.02 / 12
    inertia = {theory: body.inertia for theory, body in found.items()}
    assert inertia == pytest.approx(
        {"euler-bernoulli": slender, "rayleigh": slender + rho_I, "timoshenko": slender + rho_I}
    )


TAPER = STEEL + 'section = {rectangle = [0.04, 0.02]}, taper = {rectangle = [0.02, 0.01]}, theory = "rayleigh"'


def taper(x: float) -> tuple[float, float]:
    """A and I of the tapered rectangle at x of 1 m."""
    s = 1 - x / 2
    return 0.04 * 0.02 * s**2, 0.02 * 0.04**3 / 12 * s**4


def test_taper(arm):
    """Mass, centre and inertia are the integrals of the tapered section."""
    body = arm(TAPER)
    assert body.profile.at(0.6).E_I_z == pytest.approx(2.1e11 * taper(0.6)[1], rel=1e-12)
    moments = [7850 * quad(lambda x, k=k: x**k * taper(x)[0], 0, 1)[0] for k in range(3)]
    turned = 7850 * quad(lambda x: taper(x)[1], 0, 1)[0]
    assert body.mass == pytest.approx(moments[0], rel=1e-12)
    assert body.centre == pytest.approx((moments[1] / moments[0], 0.0), rel=1e-12)
    assert body.inertia == pytest.approx(moments[2] - moments[1] ** 2 / moments[0] + turned, rel=1e-12)


def test_element_parameters_of_a_taper(arm):
    """Means are exact; mean and growth are the nearest linear function: the rest is orthogonal to 1 and x."""
    found = arm(TAPER).profile.element(0.3, 0.2)
    for name, factor, k in (("rho_A", 7850, 0), ("E_A", 2.1e11, 0), ("E_I", 2.1e11, 1), ("rho_I", 7850, 1)):

        def left(x: float, power: int, name=name, factor=factor, k=k) -> float:
            linear = found[name] + found[name + "_rise"] * ((x - 0.3) / 0.2 - 0.5)
            return (factor * taper(x)[k] - linear) * (x - 0.4) ** power

        scale = found[name] * 0.2
        assert found[name + "_rise"] < 0
        for power in (0, 1):
            assert quad(left, 0.3, 0.5, args=(power,))[0] == pytest.approx(0, abs=1e-12 * scale)
    before = [7850 * quad(lambda x, k=k: x**k * taper(x)[0], 0, 0.3)[0] for k in range(2)]
    assert (found["m_0"], found["S_0"]) == pytest.approx(before, rel=1e-12)


ROOT = "root = {to = 0.4, section = {circle = 0.02}}"
TIP = "tip = {section = {circle = 0.02}, taper = {circle = 0.01}}"
SEGMENTS = STEEL + f"segments = {{{ROOT}, {TIP}}}"


def test_segments(arm):
    body = arm(SEGMENTS)
    profile = body.profile
    assert profile.borders == (0.4,)
    root = math.pi * 1e-4 * 7850
    assert profile.at(0.1).rho_A == profile.at(0.4).rho_A == pytest.approx(root, rel=1e-12)
    assert profile.at(0.7).rho_A == pytest.approx(root * 0.75**2, rel=1e-12)
    tip = 0.6 * (1 + 0.5 + 0.25) / 3  # a frustum
    assert body.mass == pytest.approx(root * (0.4 + tip), rel=1e-12)
    assert profile.inertia(1.0).mass == pytest.approx(body.mass, rel=1e-14)
    inside = profile.element(0.1, 0.2)
    assert inside["rho_A"] == pytest.approx(root, rel=1e-12)
    assert inside["E_I_rise"] == pytest.approx(0, abs=1e-10 * inside["E_I"])
    assert inside["S_0"] == pytest.approx(root * 0.1**2 / 2, rel=1e-12)


def test_equal_segments_are_the_uniform_beam(arm):
    uniform = arm(STEEL + "section = {circle = 0.02}")
    pieces = arm(STEEL + "segments = {a = {to = 0.3, section = {circle = 0.02}}, b = {section = {circle = 0.02}}}")
    expected = uniform.profile.element(0.2, 0.35)
    found = pieces.profile.element(0.2, 0.35)
    scale = {name.removesuffix("_rise"): value for name, value in expected.items()}
    for name, value in expected.items():
        size = abs(scale.get(name.removesuffix("_rise"), value)) or 1.0
        assert found[name] == pytest.approx(value, abs=1e-11 * max(size, abs(expected[name.removesuffix("_rise")]))), (
            name
        )
    assert pieces.inertia == pytest.approx(uniform.inertia, rel=1e-12)


def test_a_given_mass_is_the_beams_mass_exactly(arm):
    """Within the tolerance of mass against area the mass wins, so that both stages agree."""
    text = SCENE.format(beam=STEEL + "A = 2e-4, I = 1e-9").replace('"1 m"', '"1 m", mass = 1.5700005')
    body = scene_of(text).bodies["arm"]
    assert body.profile.inertia(1.0).mass == pytest.approx(1.5700005, rel=1e-15)


@pytest.mark.parametrize(("beam", "entry"), [
    ("section = {circle = 0.01}", {}),
    ('section = {circle = 0.01}, theory = "rayleigh"', {"theory": "rayleigh"}),
    ('section = {circle = 0.01}, theory = "timoshenko"', {"theory": "timoshenko"}),
    ("section = {circle = 0.01}, taper = {circle = 0.005}", {"varying": True}),
    ("section = {circle = 0.01}, axially_rigid = true, elements = 9", {}),
])  # fmt: skip
def test_structure_holds_what_the_equations_depend_on(arm, beam, entry):
    """A uniform Euler-Bernoulli beam adds nothing, whatever its shape."""
    assert arm(STEEL + beam).beam.structure() == entry


BAD = {
    "two shapes": ("section = {circle = 0.01, rectangle = [1, 1]}",
        "bodies.arm.beam.section: rectangle and circle exclude each other. "
        "Give exactly one of rectangle, circle, tube, I."),
    "no shape": ("section = {}",
        "bodies.arm.beam.section: none of rectangle, circle, tube, I is given. "
        "Give exactly one of rectangle, circle, tube, I."),
    "one length of two": ('section = {rectangle = ["20 mm"]}',
        "bodies.arm.beam.section.rectangle = ['20 mm']: not the 2 lengths of this shape. Write [height, width]."),
    "a length of nothing": ("section = {rectangle = [0.02, 0]}",
        "bodies.arm.beam.section.rectangle = [0.02, 0]: a length must be above zero. Write [height, width]."),
    "thick wall": ('section = {tube = ["30 mm", "15 mm"]}',
        "bodies.arm.beam.section.tube = ['30 mm', '15 mm']: the wall fills the tube. "
        "Give less than half the diameter, or a circle."),
    "flanges that meet": ("section = {I = [0.02, 0.013, 0.01, 0.004]}",
        "bodies.arm.beam.section.I = [0.02, 0.013, 0.01, 0.004]: flanges or web don't fit. "
        "Write [height, width, flange, web]."),
    "shape and I": ("section = {circle = 0.01}, I = 1e-9",
        "bodies.arm.beam.I = 1e-09: the section's shape gives it already. Leave I out."),
    "taper of nothing": ("A = 1e-4, I = 1e-9, taper = {circle = 0.01}",
        "bodies.arm.beam.taper: section is missing. Give section, too, with the same shape."),
    "taper to another shape": ("section = {circle = 0.01}, taper = {rectangle = [0.01, 0.01]}",
        "bodies.arm.beam.taper: the taper from circle to rectangle changes the shape. Give both ends the same shape."),
    "kappa above one": ("section = {circle = 0.01}, kappa = 1.2",
        "bodies.arm.beam.kappa = 1.2: a shear coefficient is above 0 and at most 1. Write one like 0.85."),
    "nu and G": ("section = {circle = 0.01}, nu = 0.3, G = 8e10",
        "bodies.arm.beam.G = 80000000000.0: nu and G exclude each other. Give one of them."),
    "nu above one half": ("section = {circle = 0.01}, nu = 0.6",
        "bodies.arm.beam.nu = 0.6: no solid has a Poisson's ratio above 0.5. Write one like 0.3."),
    "unknown theory": ('section = {circle = 0.01}, theory = "euler"',
        "bodies.arm.beam.theory = 'euler': must be 'euler-bernoulli', 'rayleigh', 'shear' or 'timoshenko'. "
        "Write one of these."),
    "shear without kappa": ('A = 1e-4, I = 1e-9, theory = "timoshenko"',
        "bodies.arm.beam.theory = 'timoshenko': a Timoshenko beam needs a shear coefficient. "
        "Give kappa, or a section by its shape."),
    "segments beside a section": ("section = {circle = 0.01}, segments = {a = {section = {circle = 0.01}}}",
        "bodies.arm.beam.section: every segment gives its own. Leave section out, or the segments."),
    "segment without section": (
        "segments = {a = {A = 1e-4}}", "bodies.arm.beam.segments.a: no section. Give section, or both A and I.",
    ),
    "segments in disorder": (
        "segments = {a = {to = 0.5, A = 1, I = 1}, b = {to = 0.4, A = 1, I = 1}, c = {A = 1, I = 1}}",
        "bodies.arm.beam.segments.b.to = 0.4: a segment must end beyond the previous one. "
        "Give the distance from the body's start.",
    ),
    "segment beyond the end": ("segments = {a = {to = 1.5, A = 1, I = 1}, b = {A = 1, I = 1}}",
        "bodies.arm.beam.segments.a.to = 1.5: the segment reaches the body's end. Leave out `to` and later segments."),
    "last segment with an end": ("segments = {a = {to = 0.5, A = 1, I = 1}}",
        "bodies.arm.beam.segments.a.to = 0.5: the last segment ends at the body's end. Leave out `to`."),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_beams(arm, case):
    beam, message = BAD[case]
    with pytest.raises(SceneError) as caught:
        arm(STEEL + beam)
    assert str(caught.value) == message


def test_shear_without_a_modulus(arm):
    with pytest.raises(SceneError, match="a Timoshenko beam needs a shear modulus"):
        arm('E = 1, rho = 1, section = {circle = 0.01}, theory = "timoshenko"')


def test_an_axially_rigid_beam_between_two_joints():
    text = SCENE.format(beam=STEEL + "section = {circle = 0.01}, axially_rigid = true")
    with pytest.raises(SceneError) as caught:
        scene_of(text + 'joints.hold = {revolute = ["ground", "arm.end"]}')
    assert str(caught.value) == (
        "bodies.arm.beam.axially_rigid = True: the fixed length of arm would couple the displacements of the joints at "
        "end, start. Leave axially_rigid out, or join the beam at one point only."
    )


# ---- in space ---------------------------------------------------------------------------------------------------


# J / (a b^3) of a rectangle a x b: Timoshenko & Goodier, Theory of Elasticity, section 109, the table's k_1.
TORSION = {1.0: 0.1406, 1.2: 0.166, 1.5: 0.196, 2.0: 0.229, 2.5: 0.249, 3.0: 0.263, 4.0: 0.281, 5.0: 0.291, 10.0: 0.312}


@pytest.mark.parametrize("ratio", TORSION)
def test_torsion_constant_of_a_rectangle(ratio):
    J = torsion_constant(2e-3 * ratio, 2e-3)
    assert J == torsion_constant(2e-3, 2e-3 * ratio)
    assert J / (ratio * 2e-3**4) == pytest.approx(TORSION[ratio], abs=6e-4)


def test_torsion_constant_by_the_membrane():
    """J = 4 int phi dA of Prandtl's function in a square, -laplace phi = 1, as a double sine series."""
    odd = range(1, 4001, 2)
    total = sum(1 / (m**2 * n**2 * (m**2 + n**2)) for m in odd for n in odd if m * n < 4001)
    assert torsion_constant(1.0, 1.0) == pytest.approx(4 * 64 / math.pi**6 * total, rel=1e-6)


def test_torsion_constant_of_a_strip():
    """Long strips have a b^3/3 less the ends' 0.630 b^4/3; that of 25 x 1.6 mm is far below I_p."""
    assert torsion_constant(1.0, 1e-6) == pytest.approx(1e-18 / 3 * (1 - 0.63025e-6), rel=1e-11)
    found = Shape.model_validate({"rectangle": ["25 mm", "1.6 mm"]})
    strip = found.numbers_of(found.dimensions, 0.3)
    assert 60 < (strip.I_y + strip.I_z) / strip.J < 70


def test_the_weak_axis_of_a_shape_is_the_strong_one_of_the_shape_turned():
    upright, flat = (Shape.model_validate({"rectangle": sides}) for sides in ([0.02, 0.01], [0.01, 0.02]))
    one, other = (shape.numbers_of(shape.dimensions, 0.3) for shape in (upright, flat))
    assert (one.I_y, one.I_z, one.J) == pytest.approx((other.I_z, other.I_y, other.J), rel=1e-15)
