"""Stresses at the points of modal data that recover them: a cantilever's, and what a file and a sensor must be."""

import numpy as np
import pytest
from command_line import cli
from machines import pendulum
from runs import solved

import kaneflex
from kaneflex import SceneError, read_scene
from kaneflex.fem.imported.recovery import section_forces
from kaneflex.multibody.model.body_parameters import link_data
from kaneflex.response.stresses import link_stresses
from kaneflex.scene.modal_data import ModalData, read_modal_data
from kaneflex.scene.recovery import Recovery

E, LENGTH, HEIGHT, WIDTH, FORCE = 210e9, 0.5, 20e-3, 10e-3, 40.0
I_Z = WIDTH * HEIGHT**3 / 12


def pushed(of, sensors):
    """A bar that hardly turns, under a skew force."""
    return pendulum(
        of, 'speed = "1e-3 rad/s"', hinge="root", sensors=sensors,
        loads='push = {force_on = "bar.end", direction = [0.6, 0.8], value = "40 N"}',
        solve={"preset": "coupled", "start": "quasistatic", "duration": "10 ms", "steps": 20},
    )


SENSORS = """
above = {stress = "bar.above", component = "xx"}
below = {stress = "bar.below", component = "xx"}
mises = {stress = "bar.below"}
"""
BEAM = 'length = "0.5 m", beam = {E = "210 GPa", rho = "7850 kg/m^3", section = {rectangle = ["20 mm", "10 mm"]}}'


def edge_stresses(link, shapes):
    """Stresses xx, yy, xy of unit shapes at the root's edges, E (u' - y v''), by the first element's own cubic."""
    l = link.nodes[1]
    u_0, v_0, t_0, u_1, v_1, t_1 = shapes.basis[:6]
    stretch, bend = (u_1 - u_0) / l, (6 * (v_1 - v_0) / l - 4 * t_0 - 2 * t_1) / l
    rows = np.array([E * (stretch - y * bend) for y in (HEIGHT / 2, -HEIGHT / 2)])
    return np.stack([rows, 0 * rows, 0 * rows], axis=1)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """With the data of a bar, whose root's edges have stresses."""
    folder = tmp_path_factory.mktemp("stress")
    path = folder / "beam.toml"
    path.write_text(pushed(BEAM, 'tip = {position = "bar.end", component = "y"}'))
    model = kaneflex.load(read_scene(path))
    link, shapes = model.coupled.links["bar"], model.coupled.shapes["bar"]
    data = link_data(shapes)
    stresses = Recovery(("above", "below"), edge_stresses(link, shapes))
    recovering = ModalData(data.length, data.points, data.arrays, stresses)
    recovering.save(folder / "bar.npz")
    return folder


def scene_of(folder, sensors=SENSORS, data="bar.npz"):
    path = folder / "data.toml"
    path.write_text(pushed(f'modal_data = "{data}"', sensors))
    return path


def test_a_cantilever_under_a_skew_force(folder):
    """N/A -+ M h/(2 I) at the root, M that of a beam-column in tension (Timoshenko & Gere, Elastic Stability, 1961)."""
    series = solved(read_scene(scene_of(folder))).series
    slenderness = np.sqrt(0.6 * FORCE / (E * I_Z))
    moment = 0.8 * FORCE * np.tanh(slenderness * LENGTH) / slenderness
    axial, bending = 0.6 * FORCE / (HEIGHT * WIDTH), moment * HEIGHT / 2 / I_Z
    assert series["above"].unit == "Pa"
    assert series["above"].values == pytest.approx(axial - bending, rel=1e-4)
    assert series["below"].values == pytest.approx(axial + bending, rel=1e-4)
    assert series["mises"].values == pytest.approx(series["below"].values, rel=1e-12)


def test_an_exported_beam_recovers_its_edges_stresses(folder, tmp_path):
    """The same cantilever, whose export writes the stresses; its free end has the load's tension alone."""
    assert cli("modes", str(folder / "beam.toml"), "--export", str(tmp_path)).exit_code == 0
    sensors = "\n".join(f'{point}_{edge} = {{stress = "bar.{point}_{edge}", component = "xx"}}'
                        for point in ("start", "end") for edge in ("upper", "lower"))  # fmt: skip
    series = solved(read_scene(scene_of(tmp_path, sensors))).series
    slenderness = np.sqrt(0.6 * FORCE / (E * I_Z))
    moment = 0.8 * FORCE * np.tanh(slenderness * LENGTH) / slenderness
    axial, bending = 0.6 * FORCE / (HEIGHT * WIDTH), moment * HEIGHT / 2 / I_Z
    assert series["start_upper"].values == pytest.approx(axial - bending, rel=1e-4)
    assert series["start_lower"].values == pytest.approx(axial + bending, rel=1e-4)
    assert series["end_upper"].values == pytest.approx(axial, abs=1e-5 * bending)
    assert series["end_lower"].values == pytest.approx(axial, abs=1e-5 * bending)
    beam = solved(read_scene(folder / "beam.toml"))
    own = link_stresses(beam.motion, "bar")
    assert series["start_upper"].values == pytest.approx(own.upper[0], rel=1e-4)
    assert series["start_lower"].values == pytest.approx(own.lower[0], rel=1e-4)


def test_points_between_nodes_are_exported(tmp_path):
    """What the beam reads at a point within an element its data do, too; bending shortens it as a cantilever's does."""
    sensors = """
u = {displacement = "bar.mark", component = "x"}
v = {displacement = "bar.mark", component = "y"}
angle = {displacement = "bar.mark", component = "angle"}
N = {axial_force = "bar.mark"}
M = {bending_moment = "bar.mark"}"""
    marked = BEAM.replace("{E", "{elements = 4, E").replace("length", 'points = {mark = ["0.2 m", 0]}, length', 1)
    (tmp_path / "beam.toml").write_text(pushed(marked, sensors))
    assert cli("modes", str(tmp_path / "beam.toml"), "--export", str(tmp_path)).exit_code == 0
    own = solved(read_scene(scene_of(tmp_path, sensors))).series
    other = solved(read_scene(tmp_path / "beam.toml")).series
    x, slope = 0.2, 0.8 * FORCE / (E * I_Z)  # v' = slope (L x - x^2/2)
    shortened = 0.5 * slope**2 * (LENGTH**2 * x**3 / 3 - LENGTH * x**4 / 4 + x**5 / 20)
    stretched = 0.6 * FORCE * x / (E * HEIGHT * WIDTH)  # which straightens it by 0.3 %
    assert other["u"].values == pytest.approx(stretched - shortened, abs=5e-3 * shortened)
    for name, bound in (("u", 1e-9), ("v", 1e-9), ("angle", 1e-9), ("N", 1e-3), ("M", 1e-3)):
        largest = abs(other[name].values).max()
        np.testing.assert_allclose(own[name].values, other[name].values, atol=bound * largest, err_msg=name)


def in_space(of, sensors, speed=8, axis=(0, 0, 1), push='direction = [0.1, 0.6, 0.8], value = "1 N"'):
    """A bar that is spun up and pushed."""
    return pendulum(
        of, f'speed = "{speed} rad/s", spin_up = "20 ms"', hinge="root", more={"root": f"axis = {[*axis]}"},
        loads=f'push = {{force_on = "bar.end", {push}}}',
        sensors=f"""
y = {{displacement = "bar.end", component = "y"}}
z = {{displacement = "bar.end", component = "z"}}
{sensors}""",
        solve={"preset": "coupled", "duration": "20 ms", "steps": 20},
    )


def test_shapes_in_space_are_in_their_order(tmp_path):
    """A matrix that recovers no stress but the end's displacement, which another sensor reads, too."""
    beam = 'length = "1 m", beam = {material = "aluminium", section = {rectangle = ["14 mm", "10 mm"]}, elements = 4}'
    (tmp_path / "beam.toml").write_text(in_space(beam, ""))
    assert cli("modes", str(tmp_path / "beam.toml"), "--export", str(tmp_path)).exit_code == 0
    data = dict(np.load(tmp_path / "bar.npz"))
    end = data["N"][data["points"].tolist().index("end")]
    np.savez(tmp_path / "bar.npz", **data, stress_points=np.array(["end"]), stress=np.concatenate([end, 0 * end])[None])
    sensors = "\n".join(f'{name} = {{stress = "bar.end", component = "{name}"}}' for name in ("yy", "zz"))
    (tmp_path / "data.toml").write_text(in_space('modal_data = "bar.npz"', sensors))
    series = solved(read_scene(tmp_path / "data.toml")).series
    for stress, moved in (("yy", "y"), ("zz", "z")):
        expected = series[moved].values
        assert abs(expected).max() > 1e-4
        assert series[stress].values == pytest.approx(expected, abs=1e-3 * abs(expected).max())


def test_section_forces_in_space_are_those_of_the_beam(tmp_path):
    """All of them half-way, by the shapes here and by balance there: to 1 % of the largest of each kind.

    What differs: the beam has them along its axes at the pin, the shapes along its deflected line. That grows
    with the square of the speed: axial forces differ by 0.2 %, at 8 rad/s by 1.1 %, with any number of modes. Two
    shapes of twist store a torque that grows linearly to 15 %.
    """
    kinds = {
        "N": '{axial_force = "bar.mid"}', "T": '{torsional_moment = "bar.mid"}',
        "V_y": '{shear_force = "bar.mid", component = "y"}', "V_z": '{shear_force = "bar.mid", component = "z"}',
        "M_y": '{bending_moment = "bar.mid", component = "y"}', "M_z": '{bending_moment = "bar.mid", component = "z"}',
    }  # fmt: skip
    sensors = "\n".join(f"{name} = {sensor}" for name, sensor in kinds.items())
    more = sensors, 4, (0.98, 0, 0.199), 'direction = [1, 0.3, 0.4], law = "4e5*t**2"'
    beam = 'length = "1 m", beam = {material = "aluminium", section = {rectangle = ["42 mm", "30 mm"]}, elements = 8}'
    (tmp_path / "beam.toml").write_text(in_space(beam, *more))
    assert cli("modes", str(tmp_path / "beam.toml"), "--export", str(tmp_path)).exit_code == 0
    (tmp_path / "data.toml").write_text(in_space('modal_data = "bar.npz"', *more))
    own, other = (solved(read_scene(tmp_path / f"{name}.toml")).series for name in ("data", "beam"))
    for alike, bound in ((("N",), 1e-2), (("V_y", "V_z"), 1e-2), (("M_y", "M_z"), 1e-2), (("T",), 0.15)):
        largest = max(abs(other[name].values).max() for name in alike)
        for name in alike:
            assert abs(own[name].values - other[name].values).max() < bound * largest, name


@pytest.mark.parametrize(("x", "tension"), [(0.0, 2.0), (0.25, 2.0), (0.5, 1.5), (0.75, 1.0), (1.0, 1.0)])
def test_a_section_through_a_loaded_node_has_the_mean_of_both_sides(x, tension):
    """A bar pulled by 2 N at its start, by 1 N at its middle and by 1 N at its end; about its axis nothing turns."""
    nodes, forces = np.array([[0.0, 0, 0], [0.5, 0, 0], [1.0, 0, 0]]), np.zeros((3, 3, 1))
    forces[:, 0, 0] = -2.0, 1.0, 1.0
    assert section_forces(nodes, forces, x)[:, 0] == pytest.approx([tension, 0, 0, 0, 0, 0], abs=1e-15)


@pytest.mark.parametrize(
    ("stress", "mises"),
    [([7, 0, 0, 0, 0, 0], 7), ([5, 5, 5, 0, 0, 0], 0), ([3, 0, 0, 2, 0, 0], 21**0.5), ([0, 0, 0, 0, 2, 1], 15**0.5),
     ([4, -4, 0, 0, 0, 0], 48**0.5)],
)  # fmt: skip
def test_von_mises(stress, mises):
    """Of tension, pressure from all sides, tension with shear sqrt(s^2 + 3 t^2), shears, pure shear by 45 deg."""
    data = Recovery(("at",), np.array(stress, float).reshape(1, 6, 1))
    assert data.stresses_at("at", np.array([[-2.0]]))["mises"] == pytest.approx(2 * mises, abs=1e-12)


def test_what_is_read_is_what_was_written(folder):
    data = read_modal_data(str(folder / "bar.npz"))
    assert data.stresses.places == ("above", "below")
    assert data.stresses.rows.shape == (2, 3, len(data.arrays["stiffness"]))


@pytest.mark.parametrize(("change", "message"), [
    (lambda data: data.pop("stress_points"), "the file has no array stress_points. Give stress and stress_points"),
    (lambda data: data.update(stress_points=np.array(["a", "a"])), "stress_points = a, a has a name twice"),
    (lambda data: data.update(stress=data["stress"][:, :2]), "stress has the shape (2, 2, "),
    (lambda data: data["stress"].__setitem__((0, 0, 0), np.nan), "stress contains numbers that are not finite"),
    (lambda data: data.update(sections=np.array(["at"]), section_forces=0.0), "sections: there is no point at"),
    (lambda data: data.update(sections=np.array(["end"])), "the file has no array section_forces. Give"),
])  # fmt: skip
def test_what_a_file_must_be(folder, change, message):
    data = dict(np.load(folder / "bar.npz"))
    change(data)
    np.savez(folder / "bad.npz", **data)
    with pytest.raises(SceneError) as error:
        read_scene(scene_of(folder, data="bad.npz"))
    assert message in str(error.value)


@pytest.mark.parametrize(("sensor", "message"), [
    ('{stress = "bar.end"}', "bar.npz has no such stress point: its stress points are above, below"),
    ('{stress = "bar.above", component = "zz"}', "component = 'zz': the file has xx, yy, xy"),
    ('{stress = "bar.above", component = "x"}', "component = 'x': not a component of a stress"),
    ('{velocity = "bar.end", component = "xx"}', "component = 'xx': not a component of a velocity"),
    ('{stress = "rod.above"}', "there is no such body"),
    ('{axial_force = "bar.end"}', "bar.npz has no section forces there or anywhere. Name a section"),
    ('{strain = "bar.end", fibre = "1 mm"}', "modal data do not contain area and second moment"),
])  # fmt: skip
def test_what_a_sensor_must_be(folder, sensor, message):
    with pytest.raises(SceneError) as error:
        read_scene(scene_of(folder, f"s = {sensor}"))
    assert message in str(error.value)


def test_rigid_bodies_have_none(folder):
    path = scene_of(folder)
    path.write_text(path.read_text().replace('"coupled"\nsolve.start = "quasistatic"', '"rigid"'))
    with pytest.raises(SceneError) as error:
        read_scene(path)
    assert "rigid bodies have no stresses" in str(error.value)
