"""Modal data of links and of bodies in space: what is written and read instead of beams, and what it must be."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from command_line import cli, refused, unrendered
from machines import slider_crank
from places import DOCS
from runs import alike, solved

import kaneflex
from kaneflex import SceneError, read_scene, scene_of, shipped_scenes, with_settings
from kaneflex.fem.links import make_link
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.multibody.model.body_parameters import link_data
from kaneflex.multibody.model.held_shapes import held_shapes
from kaneflex.multibody.model.shape_bases import spatial_shapes
from kaneflex.scene.modal_data import ARRAYS, POINT_ARRAYS, SPATIAL_ARRAYS, SPATIAL_POINT_ARRAYS, read_modal_data
from kaneflex.solve.coupled_linearisation import modes_at_rest

PAGE = (DOCS / "modal-data.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def model():
    return kaneflex.load(read_scene("slider-crank-150-coupled"))


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    folder = tmp_path_factory.mktemp("modal")
    result = cli("modes", "slider-crank-150-coupled", "--export", str(folder / "data"))
    assert result.exit_code == 0, result.output
    return folder


def test_the_arrays_are_those_of_the_link(model, exported):
    data = dict(np.load(exported / "data" / "rod.npz"))
    rod = model.scene.bodies["rod"]
    assert float(data["mass"]) == pytest.approx(rod.mass, rel=1e-12)
    assert float(data["mass_X"]) == pytest.approx(rod.mass * rod.length / 2, rel=1e-12)
    assert float(data["mass_X_X"]) == pytest.approx(rod.mass * rod.length**2 / 3, rel=1e-12)
    omega = np.sqrt(data["stiffness"][-3:] / np.diag(data["mass_w_w"]))
    exact = (np.arange(1, 4) * np.pi / rod.length) ** 2 * np.sqrt(rod.E_I / rod.rho_A)
    assert omega == pytest.approx(exact, rel=3e-3)
    assert data["points"].tolist() == ["start", "mid", "end"]
    # int w'^2 of a sine of height 1: pi^2 / (2 L) over the length, half of that to the middle, where the mean is.
    quarter = np.pi**2 / (4 * rod.length)
    assert data["H"][:, 0, 0] == pytest.approx(np.array([-1, 0, 1]) * quarter, rel=1e-3, abs=1e-9)


def test_what_is_read_is_what_was_written(model, tmp_path):
    data = link_data(model.coupled.shapes["rod"])
    np.savez(tmp_path / "rod.npz", **data.file)
    read = read_modal_data(str(tmp_path / "rod.npz"))
    assert (read.length, read.points) == (data.length, data.points) and set(read.arrays) == set(data.arrays)
    assert all((read.arrays[name] == array).all() for name, array in data.arrays.items())


def test_what_the_export_refuses(exported):
    again = cli("modes", "slider-crank-150-coupled", "--export", exported / "data")
    assert again.exit_code == 2 and "the file exists" in again.output
    rigid = cli("modes", "double-pendulum", "--export", exported / "data")
    assert rigid.exit_code == 2 and "no body has a beam" in rigid.output


SENSORS = """
[sensors]
end_speed = {velocity = "rod.end", component = "x"}
mid_kick = {acceleration = "rod.mid", component = "y", axes = "global"}
mid_angle = {displacement = "rod.mid", component = "angle"}
mid_place = {position = "rod.mid", component = "y"}
slider_kick = {acceleration = "slider", component = "x"}
wrist_force = {joint_force = "wrist", component = "x"}
"""
WITH_BEAM = 'schema = 1\nlike = "slider-crank-150-coupled"\n' + SENSORS
WITH_DATA = slider_crank(
    'length = "150 mm"', 'modal_data = "data/rod.npz"', 'mass = "33.378 g"', 'speed = "150 rad/s"', "slider", "guide",
    more={"guide": 'branch = "+"'},
    solve={"preset": "coupled", "start": "zero", "duration": "53.333333333333336 ms", "steps": 4000},
) + SENSORS + """
mid_transverse = {displacement = "rod.mid", relative_to = "chord", component = "y"}
slider_position = {position = "slider", component = "x"}
crank_torque = {drive_torque = "main"}
"""


@pytest.fixture(scope="module")
def fed_back(exported):
    path = exported / "fed-back.toml"
    path.write_text(WITH_DATA)
    return path


def test_data_fed_back_give_the_same_motion(exported, fed_back):
    beam = exported / "with-beam.toml"
    beam.write_text(WITH_BEAM)
    there, here = (solved(read_scene(path)) for path in (beam, fed_back))
    assert set(here.series) == set(there.series) - {"rod_force", "rod_force_rigid"}
    alike(here, there, 1e-10, here.series)
    assert abs(here.series["mid_transverse"].values).max() > 4e-3
    assert here.trajectory.energy.drift < 1e-6


def test_several_links_with_lumped_masses(tmp_path):
    """The four-bar's three links, damped, from equilibrium, off and on again."""
    result = cli("modes", "four-bar", "--export", str(tmp_path))
    assert result.exit_code == 0, result.output
    links = "\n".join(f'[bodies.{name}]\nmodal_data = "{name}.npz"' for name in ("crank", "coupler", "follower"))
    text = shipped_scenes()["four-bar"].read_text().replace('coupler_force = {axial_force = "coupler.mid"}\n', "")
    head, rest = text.split("[bodies.crank]")
    damping = '[damping]\nrayleigh = {ratio = 0.02, at = ["46 Hz", "75 Hz"]}\n'
    assert damping in rest
    joints = rest[rest.index("[joints]") :].replace(damping, "")
    (tmp_path / "scene.toml").write_text(head + links + "\n" + joints)
    settings = ["solve.preset=coupled", "solve.start=quasistatic"]
    there, here = (solved(read_scene(scene), *settings).series for scene in ("four-bar", tmp_path / "scene.toml"))
    alike(here, there, 1e-10, here)


def test_the_rigid_preset_takes_mass_centre_and_inertia(fed_back):
    rod = read_scene(fed_back).bodies["rod"]
    beam = read_scene("slider-crank-150").bodies["rod"]
    assert (rod.mass, rod.length, rod.inertia) == pytest.approx((beam.mass, beam.length, beam.inertia), rel=1e-12)
    assert rod.centre == pytest.approx(beam.centre, rel=1e-12)
    scenes = [with_settings(read_scene(scene), ["solve.preset=rigid"]) for scene in (fed_back, "slider-crank-150")]
    here, there = (solved(scene).series["crank_torque"].values for scene in scenes)
    assert here == pytest.approx(there, rel=1e-9, abs=1e-9)


def test_a_run_writes_its_results(fed_back, tmp_path, monkeypatch):
    unrendered(monkeypatch)
    result = cli("run", fed_back, "--steps", 200, "--frames", 2, "-o", tmp_path / "results")
    assert result.exit_code == 0, result.output
    summary = json.loads((tmp_path / "results" / "summary.json").read_text())
    assert (summary["degrees_of_freedom"], summary["modes_kept"]) == (5, 5)
    assert "preset coupled: 5 degrees of freedom, 5 coordinates solved for" in result.output
    assert kaneflex.load(read_scene(fed_back)).in_short.endswith("coupled, 5 degrees of freedom")


def test_the_shapes_are_counted_where_the_mechanism_is_shown(fed_back, tmp_path):
    result = cli("show", str(fed_back), "-o", str(tmp_path / "fed-back.png"))
    assert result.exit_code == 0, result.output
    assert re.search(r"^  elastic +5  ", result.output, flags=re.MULTILINE)


def test_modes_and_state_space_are_those_of_the_beam(fed_back):
    """Frozen and at rest, and about the steady deformation."""
    there, here = (kaneflex.load(scene) for scene in (read_scene("slider-crank-150-coupled"), read_scene(fed_back)))
    (_, expected, _), (_, omega, _) = (modes_at_rest(model) for model in (there, here))
    assert omega == pytest.approx(expected, rel=1e-9)
    exact, found = (kaneflex.linearise(model, t=7e-3) for model in (there, here))
    rates, expected = (np.sort_complex(np.linalg.eigvals(np.array(each.A))) for each in (found, exact))
    assert rates == pytest.approx(expected, rel=1e-6, abs=1e-6 * abs(expected).max())


def test_a_scene_like_another_takes_its_modal_data_away(exported):
    (exported / "with_data.toml").write_text(WITH_DATA)
    other = """
    schema = 1
    like = "with_data.toml"
    bodies.rod = {modal_data = "none", length = 0.3, beam = {material = "steel", A = "1 cm^2", I = "1 cm^4"}}
    """
    rod = scene_of(other, exported).bodies["rod"]
    assert rod.modal is None and rod.elastic


def test_presets_that_need_elements_refuse(fed_back):
    with pytest.raises(SceneError) as error:
        kaneflex.load(with_settings(read_scene(fed_back), ["solve.preset=stiffened"]))
    assert str(error.value) == (
        "bodies.rod.modal_data = 'rod.npz': preset stiffened needs a link's finite elements, not modal data. "
        "Use preset coupled or rigid, or give the body a beam."
    )


SCENE = """
schema = 1
gravity = [0, -9.81, 0]
bodies.rod = {{{of}{free}}}
loads.push = {{{push}}}
sensors.y = {{displacement = "rod.end", component = "y"}}
sensors.z = {{displacement = "rod.end", component = "z"}}
sensors.turn = {{displacement = "rod.mid", component = "angle_z"}}
sensors.height = {{position = "rod.end", component = "y"}}
sensors.kick = {{acceleration = "rod.mid", component = "z"}}
solve = {{preset = "coupled", duration = "0.02 s", steps = 10}}
"""
PUSH = 'force_on = "rod.end", direction = [0.1, 0.6, 0.8], value = "2 N"'
BEAM = (
    'length = "1 m", beam = {material = "aluminium", section = {rectangle = ["14 mm", "10 mm"]}, elements = 4, '
    'theory = "timoshenko"}'
)
DATA = 'modal_data = "data/rod.npz"'
PIN = 'joints.pin = {revolute = ["ground", "rod.start"], axis = %s}'
FORCE = 'sensors.force = {joint_force = "pin", component = "y"}'
DAMPED = 'damping.rayleigh = {ratio = 0.01, at = ["20 Hz", "80 Hz"]}'
HELD = {
    "driven": ("", PIN % [0, 0.6, 0.8], 'drives.pin = {speed = "8 rad/s", spin_up = "0.05 s"}', FORCE),
    "pinned": ("", PIN % [0, 0, 1], 'drives.pin = {free = true, angle = "-30 deg"}', FORCE),
    "free": (", free = {at = [0, 0, 0], angular_velocity = [3, 20, 15]}", "", "", ""),
}
"""How the body's axes are held: with the section, but about the pin in the mean, all in the mean."""


def written(folder, of, how="driven", damping="", more=""):
    free, *held = HELD[how]
    path = folder / f"{'data' if of == DATA else 'beam'}.toml"
    path.write_text(SCENE.format(of=of, push=PUSH, free=free) + "\n".join([*held, damping, more]))
    return path


@pytest.fixture(scope="module")
def in_space(tmp_path_factory):
    """A folder with a driven rod of a beam and its modal data."""
    folder = tmp_path_factory.mktemp("space")
    result = cli("modes", str(written(folder, BEAM, damping=DAMPED)), "--export", str(folder / "data"))
    assert result.exit_code == 0, result.output
    return folder


@pytest.mark.parametrize("how", HELD)
def test_data_fed_back_give_the_same_motion_in_space(tmp_path, how):
    """But for the error of the steps, which don't end alike: damped and with twist that couples bending."""
    beam = written(tmp_path, BEAM, how, DAMPED)
    assert cli("modes", str(beam), "--export", str(tmp_path / "data")).exit_code == 0
    there, here = (solved(read_scene(path)).series for path in (beam, written(tmp_path, DATA, how)))
    assert abs(there["z"].values).max() > 1e-4
    alike(here, there, 2e-5)


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize(("elements", "moment", "shear"), [(4, (8e-3, 2.5e-2), 0.12), (16, (0.0, 5e-3), 5e-2)])
def test_section_forces_of_data_are_as_good_as_the_mesh(tmp_path, elements, moment, shear):
    """Beside the beam's own, by balance; more modes with few elements change little."""
    kinds = [(kind, component) for kind in ("bending_moment", "shear_force") for component in "yz"]
    more = [f'sensors.{kind}_{c}_{at} = {{{kind} = "rod.{at}", component = "{c}"}}'
            for kind, c in kinds for at in ("start", "mid")]  # fmt: skip
    finer = BEAM.replace("elements = 4", f"elements = {elements}")
    beam = written(tmp_path, finer, more="\n".join(more))
    beam.write_text(beam.read_text().replace("steps = 10", "steps = 10, modes = 4"))
    assert cli("modes", str(beam), "--export", str(tmp_path / "data")).exit_code == 0
    data = written(tmp_path, DATA, more="\n".join(more))
    there, here = (solved(read_scene(path)).series for path in (beam, data))
    worst = dict.fromkeys(kinds, 0.0)
    for kind, c in kinds:
        names = [f"{kind}_{c}_{at}" for at in ("start", "mid")]
        largest = max(abs(there[name].values).max() for name in names)
        worst[kind, c] = max(abs(here[name].values - there[name].values).max() for name in names) / largest
    least, most = moment
    for c in "yz":
        assert least < worst["bending_moment", c] < most, c
        assert worst["shear_force", c] < shear, c


def test_data_fed_back_have_the_same_poles(in_space):
    beam, data = (read_scene(path) for path in (in_space / "beam.toml", written(in_space, DATA)))
    there, here = (kaneflex.linearise(kaneflex.load(scene), t=0.02).poles for scene in (beam, data))
    assert here[:6] == pytest.approx(there[:6], rel=1e-6)


@pytest.mark.parametrize("plane", ["v", "w"])
@pytest.mark.parametrize("held", [0.5, 1.0])
def test_other_axes_are_those_of_the_same_motion(in_space, plane, held):
    """Data in axes that go along with the rod's start, held elsewhere: as its shapes are there from the beginning."""
    link = make_link(mechanism_of(read_scene(in_space / "beam.toml")), "rod", 4)
    whole = spatial_shapes(link, 3, (0.0, 0.0, 0.0))
    bent = abs(whole.basis[{"v": 1, "w": 2}[plane] :: 6]).max(axis=0) > 0.0
    data = link_data(replace(whole, basis=whole.basis[:, bent]))
    expected_basis = data_less_rigid(whole.basis[:, bent], link, held)
    expected = replace(whole, basis=expected_basis, held=held)
    found = held_shapes(data, (held, 0.0, 0.0))
    for name in ("N", "r_N", "N_N", "G", "r_G"):
        one, other = getattr(found.moments, name), getattr(expected.moments, name)
        np.testing.assert_allclose(one, other, atol=1e-12 * abs(other).max(), rtol=1e-9)
    for place in ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)):
        for one, other in zip(found.at(place), expected.at(place), strict=True):
            np.testing.assert_allclose(one, other, atol=1e-12 * abs(found.G).max())


def data_less_rigid(basis, link, held):
    """Shapes at a link's nodes less the motion of the whole link that its section at a distance has."""
    node, left = link.node_at(held), basis.copy()
    moved, turned = basis[6 * node : 6 * node + 3], basis[6 * node + 3 : 6 * node + 6]
    for k, x in enumerate(link.nodes - held):
        left[6 * k : 6 * k + 3] -= moved + np.cross(turned.T, [x, 0.0, 0.0]).T
        left[6 * k + 3 : 6 * k + 6] -= turned
    return left


def test_a_free_axis_through_a_point_has_no_angular_momentum_of_shapes(in_space):
    """About it; about the others the shapes of a free rod have some, but do not turn the section held there."""
    data = read_modal_data(str(in_space / "data" / "rod.npz"))
    name, middle = next((name, r) for name, r in zip(data.points, data.arrays["r"], strict=True) if 0.4 < r[0] < 0.6)
    found = held_shapes(data, tuple(middle), "z")
    about = found.moments.r_N - np.einsum("a,bj->abj", middle, found.moments.N)
    momentum = about - about.transpose(1, 0, 2)
    scale = float(data.arrays["mass"]) * data.length
    assert abs(momentum[0, 1]).max() < 1e-12 * scale < 1e-3 * scale < abs(momentum[0, 2]).max()
    turns = abs(found.rows[data.points.index(name), 3:]).max(axis=1)
    assert max(turns[:2]) < 1e-12 < 1e-3 < turns[2]


def test_free_axes_have_no_momentum_of_shapes(in_space):
    data = read_modal_data(str(in_space / "data" / "rod.npz"))
    found, mass = held_shapes(data, None).moments, float(data.arrays["mass"])
    scale = mass * data.length
    for moved in (found.N, found.G, *(found.r_N - found.r_N.transpose(1, 0, 2))):
        assert abs(moved).max() < 1e-12 * scale
    kinetic = np.einsum("aajk->jk", found.N_N)
    own = np.einsum("aajk->jk", data.arrays["mass_N_N"])
    assert (np.linalg.eigvalsh(own - kinetic) > -1e-12 * mass).all()  # the whole body's motion is taken off


def test_beams_and_data_in_one_scene(in_space):
    """A beam welded to the data's end sways with it, and a mass there weighs on both."""
    text = (in_space / "beam.toml").read_text().replace(DAMPED, "") + f"""
bodies.tip = {{{BEAM.replace("1 m", "0.2 m")}}}
joints.weld = {{weld = ["rod.end", "tip.start"]}}
masses.lump = {{at = "rod.mid", mass = "50 g"}}
"""
    beam, data = (solved(scene_of(text.replace(BEAM, of, 1), in_space)) for of in (BEAM, DATA))
    alike(data, beam, 2e-2, "yz")  # the data were written without a shape for what the weld turns


def test_modes_are_those_of_the_beam(in_space):
    beam, data = (kaneflex.modes(read_scene(written(in_space, of))).frequencies for of in (BEAM, DATA))
    assert data == pytest.approx(beam, rel=1e-9)


def test_planar_and_spatial_data_are_told_apart(in_space, tmp_path):
    planar = cli("modes", "slider-crank-150-coupled", "--export", str(tmp_path / "data"))
    assert planar.exit_code == 0
    refused(cli("check", str(written(tmp_path, DATA))), "the file describes a planar link")
    flat = f'schema = 1\nbodies.rod = {{{DATA}}}\njoints.pin = {{revolute = ["ground", "rod.start"]}}\n'
    (in_space / "flat.toml").write_text(flat + 'drives.pin = {speed = "1 rad/s"}\nsolve.preset = "coupled"\n')
    refused(cli("check", str(in_space / "flat.toml")), "the file describes a body in space. Give vectors three")


@pytest.fixture(scope="module")
def exports(exported, in_space):
    """Folders by the dimension of their scenes."""
    return {2: exported, 3: in_space}


def first_column(heading, table=0):
    """Names of arrays in one of the page's tables with a heading."""
    tables = re.findall(rf"^\| {heading} \|.*\n\|[ -|]*\|\n((?:\|.*\n)+)", PAGE, flags=re.MULTILINE)
    return [name for line in tables[table].splitlines() for name in re.findall(r"`(\w+)`", line.split("|")[1])]


@pytest.mark.parametrize(("dimension", "names"), [
    (2, {*ARRAYS, *POINT_ARRAYS}), (3, {"dimension", *SPATIAL_ARRAYS, *SPATIAL_POINT_ARRAYS}),
])  # fmt: skip
def test_the_page_names_every_array(exports, dimension, names):
    named = first_column("array", dimension - 2)
    assert named == list(dict.fromkeys(named)) and set(named) == {"format", "length", "points", *names}
    assert first_column("optional") == ["stress_points", "stress", "sections", "section_forces"]
    # The section has no shape.
    assert set(np.load(exports[dimension] / "data" / "rod.npz")) == {*named, "sections", "section_forces"}


def test_check_says_where_the_shapes_come_from(fed_back, in_space):
    result = cli("check", fed_back)
    assert result.exit_code == 0, result.output
    assert "elastic by modal data, 300 mm" in result.output and "those of the modal data" in result.output
    assert re.search(r"degrees of freedom +5\n +coordinates +rod\.axial_0 rod\.axial_1 rod\.", result.output)
    result = cli("check", written(in_space, DATA))
    assert result.exit_code == 0 and "elastic by modal data, 1000 mm" in result.output, result.output


@pytest.mark.parametrize(("dimension", "change", "message"), [
    (2, lambda data: data.pop("mass_H"), "the file has no array mass_H"),
    (2, lambda data: data.update(psi=data["psi"][:, :2]), "psi has the shape (3, 2), not (3, 3)"),
    (2, lambda data: data.update(format=np.array(2)), "format = 2: this version reads format 1"),
    (2, lambda data: data["mass_w_w"].__setitem__((0, 1), 1e-3), "mass_w_w[0, 1] = 0.001 is not symmetric to"),
    (2, lambda data: data["psi"].__setitem__((1, 0), np.nan),
     "psi contains numbers that are not finite. Give it in 1/m."),
    (2, lambda data: data["mass_w_w"].__imul__(1e-3),
     "mass_w_w with the body's mass and first moments is not positive definite"),
    (2, lambda data: data["stiffness"].__setitem__(1, -data["stiffness"][1]), "is not above zero"),
    (2, lambda data: data["damping"].__setitem__((0, -1), 1.0), "damping[0, 4] = 1 is not symmetric to 0"),
    (3, lambda data: data.pop("mass_r_G"), "the file has no array mass_r_G"),
    (3, lambda data: data.update(N=data["N"][:, :2]), "N has the shape (3, 2, "),
    (3, lambda data: data["mass_G"].__setitem__((0, 0, 1), 1.0), "mass_G[0, 0, 1] = 1 is not symmetric to"),
    (3, lambda data: data["mass_N_N"].__setitem__((0, 1, 0, 1), 1.0), "mass_N_N[0, 1, 0, 1] = 1 is not symmetric to"),
    (3, lambda data: data["cubic"].__setitem__((0, 1, 2), 1e9), "is not symmetric to"),
    (3, lambda data: data["mass_N_N"].__imul__(1e-3), "mass_N_N with the body's mass and first moments is not"),
    (3, lambda data: data["stiffness"].__imul__(-1.0), "is not above zero"),
    (3, lambda data: data["damping"].__imul__(-1.0), "damping has the eigenvalue -"),
])  # fmt: skip
def test_what_a_file_must_be(exports, tmp_path, dimension, change, message):
    data = dict(np.load(exports[dimension] / "data" / "rod.npz"))
    change(data)
    (tmp_path / "data").mkdir()
    np.savez(tmp_path / "data" / "rod.npz", **data)
    with pytest.raises(SceneError) as error:
        scene_of(WITH_DATA if dimension == 2 else written(tmp_path, DATA).read_text(), tmp_path)
    assert str(error.value).startswith("bodies.rod.modal_data = ") and message in str(error.value)


@pytest.mark.parametrize(("dimension", "before", "after", "message"), [
    (2, '"data/rod.npz"', '"data/none.npz"', "cannot be read"),
    (2, '"data/rod.npz"', '"data/rod.npz", mass = "1 kg"', "rod.mass = '1 kg': cannot be combined with modal_data"),
    (2, '"data/rod.npz"', '"data/rod.npz", length = "1 m"', "modal_data is of a link of 0.3 m"),
    (2, '"150 mm"}', '"150 mm", beam = {material = "steel", A = "1 cm^2", I = "1 cm^4"}}',
     "rod has modal data: this version cannot combine modal data with beams"),
    (2, '"data/rod.npz"', '"data/rod.npz", points = {mark = ["0.1 m", 0]}', None),
    (2, '{displacement = "rod.mid", component = "angle"}', '{strain = "rod.mid", fibre = 0}',
     "modal data do not contain area and second moment of a section. Measure a stress, or the section's"),
    (2, '["ground", "slider.start"]', '["ground", "rod"]', "rod has modal data: a guide cannot hold a deforming body"),
    (2, "[sensors]", "damping.viscous = {mu = 0.1}\n[sensors]", "the file of modal data gives the damping"),
    (3, 'displacement = "rod.mid"', 'displacement = "rod.mark"', "does not have this point; its points are start"),
    (3, '{acceleration = "rod.mid", component = "z"}', '{strain = "rod.mid", fibre = [0, 0]}', "do not contain area"),
    (3, "solve =", "damping.viscous = {mu = 0.1}\nsolve =", "the file of modal data gives the damping"),
    (3, PUSH, 'spread_on = "rod", direction = [0, 0, 1], value = "2 N/m"', "contain only its points"),
    (3, 'preset = "coupled"', 'preset = "stiffened"', "finite elements, not modal data"),
])  # fmt: skip
def test_what_a_scene_must_not_ask(exports, dimension, before, after, message):
    marked = f'{DATA}, points = {{mark = ["0.1 m", 0, 0]}}'
    text = WITH_DATA if dimension == 2 else written(exports[3], marked).read_text()
    assert before in text
    text = text.replace(before, after, 1)
    if message is None:
        assert scene_of(text, exports[2]).bodies["rod"].points_all["mark"] == (0.1, 0.0)
        text = text.replace('"rod.mid", component = "angle"', '"rod.mark", component = "angle"')
        message = "sensors.mid_angle.displacement = 'rod.mark': rod.npz does not have this point; its points"
    with pytest.raises(SceneError) as error:
        scene = scene_of(text, exports[dimension])
        if dimension == 3:
            kaneflex.load(scene)
    assert message in str(error.value)
