"""Modal data of bodies in space: links as such data beside the links, and what a file and a scene must be."""

import re
from dataclasses import replace

import numpy as np
import pytest
from command_line import cli, refused
from places import DOCS
from runs import solved

import kaneflex
from kaneflex import SceneError, read_scene, scene_of
from kaneflex.fem.spatial_links import link_of_scene
from kaneflex.multibody.model.held_shapes import held_shapes
from kaneflex.multibody.model.inertia_integrals import link_data
from kaneflex.multibody.model.shape_bases import spatial_shapes
from kaneflex.scene.modal_data import SPATIAL_ARRAYS, SPATIAL_POINT_ARRAYS, read_modal_data

PAGE = (DOCS / "modal-data.md").read_text(encoding="utf-8")
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
def exported(tmp_path_factory):
    """A folder with a driven rod of a beam and its modal data."""
    folder = tmp_path_factory.mktemp("space")
    result = cli("modes", str(written(folder, BEAM, damping=DAMPED)), "--export", str(folder / "data"))
    assert result.exit_code == 0, result.output
    return folder


@pytest.mark.parametrize("how", HELD)
def test_data_fed_back_give_the_same_motion(tmp_path, how):
    """But for the error of the steps, which don't end alike: damped and with twist that couples bending."""
    beam = written(tmp_path, BEAM, how, DAMPED)
    assert cli("modes", str(beam), "--export", str(tmp_path / "data")).exit_code == 0
    there, here = (solved(read_scene(path)).series for path in (beam, written(tmp_path, DATA, how)))
    assert abs(there["z"].values).max() > 1e-4
    for name, series in there.items():
        assert abs(here[name].values - series.values).max() <= 2e-5 * abs(series.values).max(), name


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


def test_data_fed_back_have_the_same_poles(exported):
    beam, data = (read_scene(path) for path in (exported / "beam.toml", written(exported, DATA)))
    there, here = (kaneflex.linearise(kaneflex.load(scene), t=0.02).poles for scene in (beam, data))
    assert here[:6] == pytest.approx(there[:6], rel=1e-6)


@pytest.mark.parametrize("plane", ["v", "w"])
@pytest.mark.parametrize("held", [0.5, 1.0])
def test_other_axes_are_those_of_the_same_motion(exported, plane, held):
    """Data in axes that go along with the rod's start, held elsewhere: as its shapes are there from the beginning."""
    link = link_of_scene(read_scene(exported / "beam.toml"), "rod", 4)
    whole = spatial_shapes(read_scene(exported / "beam.toml"), link, 3, (0.0, 0.0, 0.0))
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


def test_a_free_axis_through_a_point_has_no_angular_momentum_of_shapes(exported):
    """About it; about the others the shapes of a free rod have some, but do not turn the section held there."""
    data = read_modal_data(str(exported / "data" / "rod.npz"))
    name, middle = next((name, r) for name, r in zip(data.points, data.arrays["r"], strict=True) if 0.4 < r[0] < 0.6)
    found = held_shapes(data, tuple(middle), "z")
    about = found.moments.r_N - np.einsum("a,bj->abj", middle, found.moments.N)
    momentum = about - about.transpose(1, 0, 2)
    scale = float(data.arrays["mass"]) * data.length
    assert abs(momentum[0, 1]).max() < 1e-12 * scale < 1e-3 * scale < abs(momentum[0, 2]).max()
    turns = abs(found.rows[data.points.index(name), 3:]).max(axis=1)
    assert max(turns[:2]) < 1e-12 < 1e-3 < turns[2]


def test_free_axes_have_no_momentum_of_shapes(exported):
    data = read_modal_data(str(exported / "data" / "rod.npz"))
    found, mass = held_shapes(data, None).moments, float(data.arrays["mass"])
    scale = mass * data.length
    for moved in (found.N, found.G, *(found.r_N - found.r_N.transpose(1, 0, 2))):
        assert abs(moved).max() < 1e-12 * scale
    kinetic = np.einsum("aajk->jk", found.N_N)
    own = np.einsum("aajk->jk", data.arrays["mass_N_N"])
    assert (np.linalg.eigvalsh(own - kinetic) > -1e-12 * mass).all()  # the whole body's motion is taken off


def test_beams_and_data_in_one_scene(exported):
    """A beam welded to the data's end sways with it, and a mass there weighs on both."""
    text = (exported / "beam.toml").read_text().replace(DAMPED, "") + f"""
bodies.tip = {{{BEAM.replace("1 m", "0.2 m")}}}
joints.weld = {{weld = ["rod.end", "tip.start"]}}
masses.lump = {{at = "rod.mid", mass = "50 g"}}
"""
    found = []
    for of in (BEAM, DATA):
        found.append(solved(scene_of(text.replace(BEAM, of, 1), exported)).series)
    for name in ("y", "z"):
        away = abs(found[1][name].values - found[0][name].values).max() / abs(found[0][name].values).max()
        assert away < 2e-2, name  # the data were exported without a shape for what the weld turns


def test_the_page_names_every_array(exported):
    tables = re.findall(r"^\| array \|.*\n\|[ -|]*\|\n((?:\|.*\n)+)", PAGE, flags=re.MULTILINE)
    named = [name for line in tables[1].splitlines() for name in re.findall(r"`(\w+)`", line.split("|")[1])]
    assert named == list(dict.fromkeys(named))
    assert set(named) == {"format", "dimension", "length", "points", *SPATIAL_ARRAYS, *SPATIAL_POINT_ARRAYS}
    assert set(np.load(exported / "data" / "rod.npz")) == {*named, "sections", "section_forces"}


def test_modes_are_those_of_the_beam(exported):
    beam, data = (kaneflex.modes(read_scene(written(exported, of))).frequencies for of in (BEAM, DATA))
    assert data == pytest.approx(beam, rel=1e-9)


def test_check_says_where_the_shapes_come_from(exported):
    result = cli("check", str(written(exported, DATA)))
    assert result.exit_code == 0, result.output
    assert "elastic by modal data, 1000 mm" in result.output


@pytest.mark.parametrize(("change", "message"), [
    (lambda data: data.pop("mass_r_G"), "the file has no array mass_r_G"),
    (lambda data: data.update(N=data["N"][:, :2]), "N has the shape (3, 2, "),
    (lambda data: data["mass_G"].__setitem__((0, 0, 1), 1.0), "mass_G[0, 0, 1] = 1 is not symmetric to"),
    (lambda data: data["mass_N_N"].__setitem__((0, 1, 0, 1), 1.0), "mass_N_N[0, 1, 0, 1] = 1 is not symmetric to"),
    (lambda data: data["cubic"].__setitem__((0, 1, 2), 1e9), "is not symmetric to"),
    (lambda data: data["mass_N_N"].__imul__(1e-3), "mass_N_N with the body's mass and first moments is not"),
    (lambda data: data["stiffness"].__imul__(-1.0), "is not above zero"),
    (lambda data: data["damping"].__imul__(-1.0), "damping has the eigenvalue -"),
])  # fmt: skip
def test_what_a_file_must_be(exported, tmp_path, change, message):
    data = dict(np.load(exported / "data" / "rod.npz"))
    change(data)
    (tmp_path / "data").mkdir()
    np.savez(tmp_path / "data" / "rod.npz", **data)
    with pytest.raises(SceneError) as error:
        read_scene(written(tmp_path, DATA))
    assert str(error.value).startswith("bodies.rod.modal_data = ") and message in str(error.value)


@pytest.mark.parametrize(("before", "after", "message"), [
    ('displacement = "rod.mid"', 'displacement = "rod.mark"', "does not have this point; its points are start"),
    ('{acceleration = "rod.mid", component = "z"}', '{strain = "rod.mid", fibre = [0, 0]}', "do not contain area"),
    ("solve =", "damping.viscous = {mu = 0.1}\nsolve =", "the file of modal data gives the damping"),
    (PUSH, 'spread_on = "rod", direction = [0, 0, 1], value = "2 N/m"', "contain only its points"),
    ('preset = "coupled"', 'preset = "stiffened"', "finite elements, not modal data"),
])  # fmt: skip
def test_what_a_scene_must_not_ask(exported, before, after, message):
    marked = f'{DATA}, points = {{mark = ["0.1 m", 0, 0]}}'
    text = written(exported, marked).read_text()
    assert before in text
    with pytest.raises(SceneError) as error:
        kaneflex.load(scene_of(text.replace(before, after, 1), exported))
    assert message in str(error.value)


def test_planar_and_spatial_data_are_told_apart(exported, tmp_path):
    planar = cli("modes", "slider-crank-150-coupled", "--export", str(tmp_path / "data"))
    assert planar.exit_code == 0
    refused(cli("check", str(written(tmp_path, DATA))), "the file describes a planar link")
    flat = f'schema = 1\nbodies.rod = {{{DATA}}}\njoints.pin = {{revolute = ["ground", "rod.start"]}}\n'
    (exported / "flat.toml").write_text(flat + 'drives.pin = {speed = "1 rad/s"}\nsolve.preset = "coupled"\n')
    refused(cli("check", str(exported / "flat.toml")), "the file describes a body in space. Give vectors three")
