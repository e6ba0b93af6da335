"""Modal data of links as arrays: what `kaneflex modes --export` writes, and what a scene takes instead of beams."""

import json
import re

import numpy as np
import pytest
from click.testing import CliRunner
from command_line import cli, unrendered
from machines import slider_crank
from places import DOCS
from runs import solved

import kaneflex
from kaneflex import SceneError, read_scene, scene_of, shipped_scenes, with_settings
from kaneflex.cli import main
from kaneflex.multibody.model.inertia_integrals import link_data
from kaneflex.scene.modal_data import ARRAYS, POINT_ARRAYS, read_modal_data
from kaneflex.solve.coupled_linearisation import modes_at_rest

PAGE = (DOCS / "modal-data.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def model():
    return kaneflex.load(read_scene("slider-crank-150-coupled"))


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    folder = tmp_path_factory.mktemp("modal")
    result = CliRunner().invoke(main, ["modes", "slider-crank-150-coupled", "--export", str(folder / "data")])
    assert result.exit_code == 0, result.output
    return folder / "data"


def test_the_arrays_are_those_of_the_link(model, exported):
    data = dict(np.load(exported / "rod.npz"))
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


def test_the_page_names_every_array(exported):
    table = re.search(r"^\| array \|.*\n\|[ -|]*\|\n((?:\|.*\n)+)", PAGE, flags=re.MULTILINE)[1]
    named = [name for line in table.splitlines() for name in re.findall(r"`(\w+)`", line.split("|")[1])]
    assert named == list(dict.fromkeys(named))
    table = re.search(r"^\| optional \|.*\n\|[ -|]*\|\n((?:\|.*\n)+)", PAGE, flags=re.MULTILINE)[1]
    optional = [name for line in table.splitlines() for name in re.findall(r"`(\w+)`", line.split("|")[1])]
    assert optional == ["stress_points", "stress", "sections", "section_forces"]
    assert set(named) == {"format", "length", "points", *ARRAYS, *POINT_ARRAYS}
    assert set(np.load(exported / "rod.npz")) == {*named, "sections", "section_forces"}  # its section has no shape


def test_what_the_export_refuses(exported):
    again = CliRunner().invoke(main, ["modes", "slider-crank-150-coupled", "--export", str(exported)])
    assert again.exit_code == 2 and "the file exists" in again.output
    rigid = CliRunner().invoke(main, ["modes", "double-pendulum", "--export", str(exported)])
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
    path = exported.parent / "fed-back.toml"
    path.write_text(WITH_DATA)
    return path


def test_data_fed_back_give_the_same_motion(exported, fed_back):
    beam = exported.parent / "with-beam.toml"
    beam.write_text(WITH_BEAM)
    there, here = (solved(read_scene(path)) for path in (beam, fed_back))
    assert set(here.series) == set(there.series) - {"rod_force", "rod_force_rigid"}
    for name, series in here.series.items():
        gap = abs(series.values - there.series[name].values).max()
        assert gap <= 1e-10 * abs(there.series[name].values).max(), name
    assert abs(here.series["mid_transverse"].values).max() > 4e-3
    assert here.trajectory.energy.drift < 1e-6


def test_several_links_with_lumped_masses(tmp_path):
    """The four-bar's three links, damped, from equilibrium, off and on again."""
    result = CliRunner().invoke(main, ["modes", "four-bar", "--export", str(tmp_path)])
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
    for name, series in here.items():
        gap = abs(series.values - there[name].values).max()
        assert gap <= 1e-10 * abs(there[name].values).max(), name


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
    result = CliRunner().invoke(main, ["show", str(fed_back), "-o", str(tmp_path / "fed-back.png")])
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


def test_check_says_where_the_shapes_come_from(fed_back):
    result = CliRunner().invoke(main, ["check", str(fed_back)])
    assert result.exit_code == 0, result.output
    assert "elastic by modal data, 300 mm" in result.output and "those of the modal data" in result.output
    assert re.search(r"degrees of freedom +5\n +coordinates +rod\.axial_0 rod\.axial_1 rod\.", result.output)


def asymmetric(data):
    data["mass_w_w"][0, 1] += 1e-3


def not_finite(data):
    data["psi"][1, 0] = np.nan


def without_mass(data):
    data["mass_w_w"][:] *= 1e-3


def unstable(data):
    data["stiffness"][1] *= -1


@pytest.mark.parametrize(("change", "message"), [
    (lambda data: data.pop("mass_H"), "the file has no array mass_H"),
    (lambda data: data.update(psi=data["psi"][:, :2]), "psi has the shape (3, 2), not (3, 3)"),
    (lambda data: data.update(format=np.array(2)), "format = 2: this version reads format 1"),
    (asymmetric, "mass_w_w[0, 1] = 0.001 is not symmetric to"),
    (not_finite, "psi contains numbers that are not finite. Give it in 1/m."),
    (without_mass, "mass_w_w with the body's mass and first moments is not positive definite"),
    (unstable, "is not above zero"),
    (lambda data: data["damping"].__setitem__((0, -1), 1.0), "damping[0, 4] = 1 is not symmetric to 0"),
])  # fmt: skip
def test_what_a_file_must_be(exported, tmp_path, change, message):
    data = dict(np.load(exported / "rod.npz"))
    change(data)
    (tmp_path / "data").mkdir()
    np.savez(tmp_path / "data" / "rod.npz", **data)
    with pytest.raises(SceneError) as error:
        scene_of(WITH_DATA, tmp_path)
    assert str(error.value).startswith("bodies.rod.modal_data = ") and message in str(error.value)


@pytest.mark.parametrize(("before", "after", "message"), [
    ('"data/rod.npz"', '"data/none.npz"', "cannot be read"),
    ('"data/rod.npz"', '"data/rod.npz", mass = "1 kg"', "rod.mass = '1 kg': cannot be combined with modal_data"),
    ('"data/rod.npz"', '"data/rod.npz", length = "1 m"', "modal_data is of a link of 0.3 m"),
    ('"150 mm"}', '"150 mm", beam = {material = "steel", A = "1 cm^2", I = "1 cm^4"}}',
     "rod has modal data: this version cannot combine modal data with beams"),
    ('"data/rod.npz"', '"data/rod.npz", points = {mark = ["0.1 m", 0]}', None),
    ('{displacement = "rod.mid", component = "angle"}', '{strain = "rod.mid", fibre = 0}',
     "modal data do not contain area and second moment of a section. Measure a stress, or the section's"),
    ('["ground", "slider.start"]', '["ground", "rod"]', "rod has modal data: a guide cannot hold a deforming body"),
    ("[sensors]", "damping.viscous = {mu = 0.1}\n[sensors]", "the file of modal data gives the damping"),
])  # fmt: skip
def test_what_a_scene_must_not_ask(exported, before, after, message):
    path = exported.parent / "bad.toml"
    path.write_text(WITH_DATA.replace(before, after, 1))
    if message is None:
        assert read_scene(path).bodies["rod"].points_all["mark"] == (0.1, 0.0)
        path.write_text(path.read_text().replace('"rod.mid", component = "angle"', '"rod.mark", component = "angle"'))
        message = "sensors.mid_angle.displacement = 'rod.mark': rod.npz does not have this point; its points"
    with pytest.raises(SceneError) as error:
        read_scene(path)
    assert message in str(error.value)


def test_a_scene_like_another_takes_its_modal_data_away(exported):
    (exported.parent / "with_data.toml").write_text(WITH_DATA)
    other = """
    schema = 1
    like = "with_data.toml"
    bodies.rod = {modal_data = "none", length = 0.3, beam = {material = "steel", A = "1 cm^2", I = "1 cm^4"}}
    """
    rod = scene_of(other, exported.parent).bodies["rod"]
    assert rod.modal is None and rod.elastic


def test_presets_that_need_elements_refuse(fed_back):
    with pytest.raises(SceneError) as error:
        kaneflex.load(with_settings(read_scene(fed_back), ["solve.preset=stiffened"]))
    assert str(error.value) == (
        "bodies.rod.modal_data = 'rod.npz': preset stiffened needs a link's finite elements, not modal data. "
        "Use preset coupled or rigid, or give the body a beam."
    )
