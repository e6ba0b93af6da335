"""Stresses of links by their section forces: numbers, picture and summary, beside closed forms."""

import math

import numpy as np
import pytest
from machines import cantilever, machine

import kaneflex
from kaneflex.plots.stress import figures
from kaneflex.report.presentation import modelled
from kaneflex.report.summary import summarise
from kaneflex.report.tables import stress_table
from kaneflex.response.stresses import link_stresses, section_at
from kaneflex.solve.simulation import solve

L, WIDTH, HEIGHTS, FORCE, PULL = 0.8, 12e-3, (30e-3, 20e-3), 90.0, 5e3
CANTILEVER = cantilever(
    f'length = {L}, beam = {{material = "steel", theory = "timoshenko", yield_strength = "250 MPa", '
    "elements = 8, SECTION}", "arm", gravity=[0, 0], sensors=dict(tip="displacement arm.end y"),
    loads=dict(down=f'force_on = "arm.end", direction = [0, -1], law = "{FORCE} * (1 - cos(10 * t)) / 2"',
               pull=f'force_on = "arm.end", direction = [1, 0], value = {PULL}'),
    solve=dict(preset="quasistatic", duration="0.6283185307179586 s", steps=20, terms=dict(geometric=False)),
)  # fmt: skip
SHAPED = f'section = {{rectangle = [{HEIGHTS[0]}, {WIDTH}]}}, taper = {{rectangle = [{HEIGHTS[1]}, {WIDTH}]}}'


def solved(section: str):
    return solve(kaneflex.load(kaneflex.scene_of(CANTILEVER.replace("SECTION", section))))


PIVOTED = machine(
    gravity=[0, 0], joints=dict(pivot="revolute ground bar.p"), drives=dict(pivot='law = "0 * t"'),
    bodies=dict(bar='length = "1 m", points = {p = ["505 mm", 0], q = ["535 mm", 0]}, '
                    'beam = {material = "steel", section = {rectangle = ["20 mm", "20 mm"]}}'),
    loads=dict(push='force_on = "bar.q", direction = [0, 1], value = "10 kN"'),
    solve=dict(preset="quasistatic", duration="1 s", steps=2),
)
STEPPED = cantilever(
    'length = "1 m", beam = {material = "steel", segments = {root = {to = "510 mm", section = {circle = "40 mm"}}, '
    'tip = {section = {circle = "20 mm"}}}}', "shaft", "wall", gravity=[0, 0],
    loads='push = {force_on = "shaft.end", direction = [0, 1], value = "200 N"}',
    solve={"preset": "quasistatic", "duration": "1 s", "steps": 2},
)


@pytest.mark.parametrize(
    ("text", "name", "place", "bent"),
    [(PIVOTED, "bar", 0.505, 300.0 / (0.02**3 / 6.0)), (STEPPED, "shaft", 0.51, 98.0 / (math.pi * 0.01**3 / 4.0))],
    ids=["beside a joint", "beside a step"],
)  # fmt: skip
def test_the_largest_stress_is_found_where_stresses_jump(text, name, place, bent):
    """No evenly spaced station is near: M h / (2 I) on the side that bears more, 10 kN by 30 mm, 200 N by 490 mm."""
    found = solve(kaneflex.load(kaneflex.scene_of(text)))
    stresses = link_stresses(found.motion, name)
    station, instant = stresses.largest
    assert stresses.x[station] == pytest.approx(place)
    assert stresses.upper[station, instant] == pytest.approx(-bent, rel=1e-3)
    assert sorted(stresses.x) == list(stresses.x)


def test_a_cantilever_with_a_force_at_its_tip():
    """N / A +- F (L - x) h / (2 I), half-way through, where the force is largest; the upper edge is drawn out.

    Of the undeformed arm, without what the pull takes off the moment.
    """
    solution = solved(SHAPED)
    edges = link_stresses(solution.motion, "arm")
    h = np.interp(edges.x, (0.0, L), HEIGHTS)
    bent, pulled = 6.0 * FORCE * (L - edges.x) / (WIDTH * h**2), PULL / (WIDTH * h)
    assert edges.upper[:, 10] == pytest.approx(pulled + bent, rel=1e-6)
    assert edges.lower[:, 10] == pytest.approx(pulled - bent, rel=1e-6)
    assert edges.upper[:, 0] == pytest.approx(pulled, rel=1e-6)

    (panel,) = figures(solution)["stress"].axes
    expected = (pulled + bent).max()
    assert panel.get_title() == (
        f"arm: {1e-6 * expected:.3g} MPa at 0 mm, time 0.3142 s, {expected / 250e4:.3g} % of 250 MPa"
    )
    told = summarise(solution).stresses["arm"]
    assert (told.largest, told.x_m, told.utilisation) == pytest.approx((expected, 0.0, expected / 250e6), rel=1e-6)
    assert told.at.time_s == pytest.approx(0.31415926535897931)
    drawn = [line.get_ydata() for line in panel.lines[:4]]
    assert drawn[1] == pytest.approx(1e-6 * (pulled + bent), rel=1e-6)
    assert drawn[2] == pytest.approx(1e-6 * (pulled - bent), rel=1e-6)


def test_sections_without_a_shape_have_no_edges():
    solution = solved('A = "300 mm^2", I = "1e4 mm^4", kappa = 0.85')
    assert figures(solution) == {}
    assert summarise(solution).stresses == {}


def test_without_a_strength_there_is_no_share_of_it():
    text = CANTILEVER.replace("\\\n", "").replace("SECTION", SHAPED).replace('yield_strength = "250 MPa", ', "")
    told = summarise(solve(kaneflex.load(kaneflex.scene_of(text))))
    assert told.stresses["arm"].utilisation is None
    assert "% of" not in stress_table(told)


def test_at_the_neutral_axis_a_short_arm_is_sheared():
    """3 V / (2 A) half-way up, sqrt(3) times that of von Mises, where the arm ends and nothing bends it any more."""
    solution = solved(SHAPED)
    last = link_stresses(solution.motion, "arm").mises[-1, 10]
    area = WIDTH * HEIGHTS[1]
    assert last == pytest.approx(math.hypot(PULL / area, math.sqrt(3.0) * 1.5 * FORCE / area), rel=1e-6)


def shaft_scene(section: str, lever: float, pull: float, down: float, side: float):
    beam = 'material = "steel", theory = "timoshenko", elements = 2, yield_strength = "300 MPa"'
    size = math.hypot(pull, down, side)
    return kaneflex.scene_of(machine(
        bodies=dict(shaft="length = 0.5, rotation = {x = [1, 0, 0], y = [0, 1, 0]}, "
                          f"beam = {{{beam}, section = {{{section}}}}}",
                    lever=f"mass = 0.1, inertia = [1e-4, 1e-4, 1e-4], points = {{tip = [0, {lever}, 0]}}"),
        joints=dict(held="weld shaft.end lever", root="weld ground shaft"),
        sensors=dict(tip="displacement shaft.end y"),
        loads=dict(push=f'force_on = "lever.tip", direction = [{pull}, {down}, {side}], value = {size}'),
        solve=dict(preset="quasistatic", duration="0.1 s", steps=4, terms=dict(geometric=False)),
    ))  # fmt: skip


def shaft(*given, **more):
    return solve(kaneflex.load(shaft_scene(*given, **more)))


def test_a_shaft_bent_and_twisted():
    """16/(pi d^3) sqrt(4 M^2 + 3 T^2) at the root of a shaft (Shigley, Mechanical Engineering Design, eq. 6-55, its
    factors 1), M askew: what the outline's points and the shear of the force add is below 0.1 %.

    Where the force enters nothing is bent: T's shear and the force's 4 V/(3 A) together.
    """
    d, F = 0.04, 1000.0
    solution = shaft(f"circle = {d}", lever=0.4, pull=0.0, down=1.2 * F, side=1.6 * F)
    stresses = link_stresses(solution.motion, "shaft")
    M, T = 2.0 * F * 0.5, 1.6 * F * 0.4
    expected = 16.0 / (math.pi * d**3) * math.sqrt(4.0 * M**2 + 3.0 * T**2)
    assert stresses.mises[0, 0] == pytest.approx(expected, rel=1e-3)
    assert (stresses.upper[0, 0], stresses.lower[0, 0]) == pytest.approx(
        (32.0 * M / (math.pi * d**3), -32.0 * M / (math.pi * d**3)), rel=1.5e-3
    )
    shear = 16.0 * T / (math.pi * d**3) + 4.0 / 3.0 * 2.0 * F / (math.pi * d**2 / 4.0)
    assert stresses.mises[-1, 0] == pytest.approx(math.sqrt(3.0) * shear, rel=1e-3)

    told = summarise(solution)
    assert told.stresses["shaft"].utilisation == pytest.approx(expected / 300e6, rel=1e-3)
    assert stress_table(told).splitlines()[1].split() == [
        "shaft", f"{1e-6 * stresses.mises.max():.4g}", "0", "0", f"{stresses.mises.max() / 300e4:.3g}"
    ]
    (panel,) = figures(solution)["stress"].axes
    assert panel.get_title().startswith(f"shaft: {1e-6 * expected:.3g} MPa at 0 mm")


def test_a_rod_in_space_that_acts_back_is_stressed_as_one_that_does_not():
    """Preset coupled, whose bodies are no links of the linear equations, beside stiffened: 1e-3 apart."""
    largest = []
    for preset in ("stiffened", "coupled"):
        scene = kaneflex.scene.with_settings(kaneflex.read_scene("spatial-slider-crank-elastic"),
                                             [f"solve.preset={preset}", "solve.steps=250"])  # fmt: skip
        model = kaneflex.load(scene)
        found = solve(model).stresses["rod"]
        assert found.x[found.largest[0]] == pytest.approx(0.125, abs=0.02)
        largest.append(found.mises.max())
        assert modelled(model)["options"]["elements"] == "rod 6"
    assert largest[1] == pytest.approx(largest[0], rel=1e-3)


def test_a_rectangular_bar_bent_askew_is_pulled_most_at_a_corner():
    h, b, F = 0.05, 0.02, 1000.0
    stresses = link_stresses(shaft(f"rectangle = [{h}, {b}]", 0.0, 3.0 * F, -F, 0.5 * F).motion, "shaft")
    bent = F * 0.5 / (b * h**2 / 6.0) + 0.5 * F * 0.5 / (h * b**2 / 6.0)
    pulled = 3.0 * F / (b * h)
    assert (stresses.upper[0, 0], stresses.lower[0, 0]) == pytest.approx((pulled + bent, pulled - bent), rel=1e-9)
    assert stresses.mises[0, 0] == pytest.approx(pulled + bent, rel=1e-9)


def outline_of(section: str):
    return section_at(shaft_scene(section, 0.1, 0, 1, 0).bodies["shaft"], 0.2)


@pytest.mark.parametrize(("ratio", "c"), [(1.0, 0.208), (1.5, 0.231), (2.0, 0.246), (3.0, 0.267), (4.0, 0.282),
                                          (6.0, 0.299), (10.0, 0.312)])  # fmt: skip
def test_a_rectangle_in_torsion(ratio, c):
    """T/(c a b^2) at the middle of its long side: c by Saint-Venant (Timoshenko & Goodier, Theory of Elasticity, table
    of art. 109: k_2)."""
    for height, width in ((0.01 * ratio, 0.01), (0.01, 0.01 * ratio)):
        outline, _ = outline_of(f"rectangle = [{height}, {width}]")
        assert abs(outline.shear[:, 2]).max() == pytest.approx(1.0 / (c * 0.01 * ratio * 0.01**2), rel=3e-3)
        arm = np.concatenate([outline.y[:34], -outline.z[34:]])  # the sides at +y and -y are first
        assert (arm * outline.shear[:, 2] >= 0.0).all()  # it turns from y to z
        corner = np.isclose(abs(outline.y), height / 2) & np.isclose(abs(outline.z), width / 2)
        assert corner.sum() == 8
        assert abs(outline.shear[corner, 2]).max() < 2e-3 * abs(outline.shear[:, 2]).max()


def test_shear_of_a_thin_tube():
    """T/(2 pi r^2 t), and twice the mean of a shear force."""
    outline, numbers = outline_of("tube = [0.1, 0.001]")
    r, t = 0.0495, 0.001
    assert outline.shear[:, 2] == pytest.approx(1.0 / (2.0 * math.pi * r**2 * t), rel=0.02)
    assert abs(outline.shear[:, :2]).max(axis=0) == pytest.approx([2.0 / numbers.A] * 2, rel=1e-3)
    assert outline.shear[outline.y.argmax()] == pytest.approx([0.0, 2.0 / numbers.A, outline.shear[0, 2]], rel=1e-3)


def test_shear_of_a_thick_tube():
    """V Q/(I b) at the middle, by the first moment Q of half the ring over both walls."""
    outline, _ = outline_of("tube = [0.1, 0.03]")
    R, r = 0.05, 0.02
    first, second = 2.0 / 3.0 * (R**3 - r**3), math.pi / 4.0 * (R**4 - r**4)
    assert abs(outline.shear[:, :2]).max(axis=0) == pytest.approx([first / (second * 2.0 * (R - r))] * 2, rel=1e-3)


def test_shear_of_an_i_section_carries_the_forces():
    """The web's shear, and the flanges', times their thicknesses add up to the force that they are of.

    That along the height the web carries but for what the flanges' thickness adds, a few per cent; torsion is T t/J.
    """
    h, b, f, w = 0.2, 0.1, 0.006, 0.004
    outline, numbers = outline_of(f"I = [{h}, {b}, {f}, {w}]")
    web = np.isclose(outline.z, w / 2) & (abs(outline.y) < h / 2 - f + 1e-9)
    y, shear = outline.y[web], outline.shear[web, 0]
    first = b * f * (h - f) / 2 + w * ((h / 2 - f) ** 2 - y**2) / 2
    assert shear == pytest.approx(first / (numbers.I_z * w), rel=1e-9)
    assert w * np.trapezoid(shear, y) == pytest.approx(1.0, rel=0.04)
    flange = np.isclose(outline.y, h / 2)
    z, along = outline.z[flange], outline.shear[flange]
    assert 2.0 * f * np.trapezoid(along[:, 1], z) == pytest.approx(1.0, rel=0.02)
    assert along[:, 0] == pytest.approx(np.sign(z) * (b / 2 - abs(z)) * (h - f) / (2.0 * numbers.I_z), abs=1e-12)
    assert abs(outline.shear[flange, 2]) == pytest.approx(f / numbers.J)
    assert abs(outline.shear[web, 2]) == pytest.approx(w / numbers.J)
    # Torsion turns from y to z: along z on the outer side of the upper flange, against y on the web's side at +z.
    assert (along[:, 2] > 0.0).all() and (outline.shear[web, 2] < 0.0).all()
