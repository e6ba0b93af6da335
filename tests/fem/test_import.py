"""Links from finite elements of another program: against that program's own modes, closed forms and a beam."""

import json
import re
import tracemalloc
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from command_line import cli, refused
from imported_rod import AREA, ENDS, FILES, HEIGHT, I_Z, NU, PAGE, RHO, E, L, arguments, printed_by, welded
from machines import slider_crank
from runs import alike, solved
from scipy.io import mmread, mmwrite
from scipy.linalg import eigh, null_space
from scipy.sparse.linalg import eigsh

import kaneflex
from kaneflex.fem.imported.craig_bampton import reduced
from kaneflex.fem.imported.files import read_elements
from kaneflex.scene.modal_data import read_modal_data
from kaneflex.support.errors import Fault


@pytest.fixture(scope="module", autouse=True)
def printed(tmp_path_factory, peer):
    """What the page's command prints, in a folder with the files that its script writes."""
    peer("skfem")
    with printed_by(command(), tmp_path_factory.mktemp("finite-elements")) as output:
        yield output


def command(**changed):
    """The page's arguments, some of them changed."""
    return arguments(r"import rod-mass.mtx rod-stiff(?!.*--(?:space|stress)).*", **changed)


def recovering(**changed):
    """Those of the page's command that recovers stresses."""
    return arguments(r"import rod-mass.mtx .*--stress .*", **changed)


def test_the_page_shows_what_is_printed(printed):
    (shown,) = re.findall(r"^    (137 mm from .* from the start, .*)$", PAGE, re.MULTILINE)
    assert shown in printed.splitlines()


def test_import_mesh_gives_what_the_command_writes():
    words = command()
    given = list(pairwise(words[4:]))
    points = dict(text.split("=") for option, text in given if option == "--point")
    assert {option for option, _ in given if option.startswith("-")} == {"--point", "--modes", "--damping", "-o"}
    modes, damping = int(dict(given)["--modes"]), float(dict(given)["--damping"])
    data = kaneflex.import_mesh(*words[1:4], points, modes, damping=damping, units="m-kg")
    expected = read_modal_data("rod.npz")
    for name, array in expected.arrays.items():
        np.testing.assert_array_equal(data.arrays[name], array, err_msg=name)
    with pytest.raises(kaneflex.SceneError, match=r"import: 'inch' are no units. Known: m-kg, mm-kg, mm-t"):
        kaneflex.import_mesh(*words[1:4], points, units="inch")


def test_moments_of_the_bar():
    data = read_modal_data("rod.npz")
    mass, centre, inertia = data.rigid
    assert mass == pytest.approx(RHO * AREA * L, rel=1e-9)
    assert centre == pytest.approx((L / 2, 0.0), rel=1e-9)
    assert inertia == pytest.approx(mass * (L**2 + HEIGHT**2) / 12, rel=1e-9)
    assert float(data.arrays["inertia"]) == pytest.approx(mass * HEIGHT**2 / 12, rel=1e-9)


def test_modes_of_the_free_mesh():
    """Many shapes of either kind with the rigid motions come near the whole mesh: its modes by SciPy on all unknowns.

    What differs: twelve modes with the points held instead of all. Averaged coupling holds nothing rigid.
    """
    link = read_elements(*FILES, ENDS)
    K, M = (mmread(name).tocsc() for name in (FILES[1], FILES[0]))
    squares, modes = eigsh(K, 16, M, sigma=-1e6, v0=np.ones(K.shape[0]))
    for motion, rigid, wanted in (
        ("transverse", (link.field(0.0, 1.0), link.field(-link.nodes[:, 1], link.nodes[:, 0])), 3),
        ("axial", (link.field(1.0, 0.0),), 1),
    ):
        own = link.basis(motion, rigid=False)
        alike = np.linalg.norm(own.T @ modes, axis=0) > 0.99 * np.linalg.norm(modes, axis=0)
        expected = np.sqrt(np.sort(squares[alike & (squares > 1e6)]))[:wanted]
        whole = np.column_stack([reduced(link, motion, 12, rigid=False).shapes, *rigid])
        small = [whole.T @ A @ whole for A in (link.K, link.M)]
        found = np.sqrt(eigh(*small, eigvals_only=True)[len(rigid) : len(rigid) + wanted])
        assert len(expected) == wanted
        assert (found > (1.0 - 1e-9) * expected).all()  # a mean of the mesh is stiffer than the mesh (Ritz 1909)
        np.testing.assert_allclose(found, expected, rtol=2e-3)


@pytest.mark.parametrize("rigid", [True, False])
def test_bending_of_a_pinned_bar(rigid):
    """Timoshenko's frequencies on pins (1922), which leave out how the section warps: 1 %, with stiff ends 2.5 %."""
    found = reduced(read_elements(*FILES, ENDS), "transverse", 3, rigid)
    omega = np.sqrt(found.stiffness / found.mass)[:3]
    k, G = np.arange(1, 4) * np.pi / L, E / (2 * (1 + NU))
    kappa = 10 * (1 + NU) / (12 + 11 * NU)  # Cowper 1966
    c2, s2, r2 = E / RHO, kappa * G / RHO, I_Z / AREA
    b = k**2 * (c2 + s2) + s2 / r2
    expected = np.sqrt((b - np.sqrt(b**2 - 4 * c2 * s2 * k**4)) / 2)
    np.testing.assert_allclose(omega, expected, rtol=2.5e-2 if rigid else 1e-2)


@pytest.mark.parametrize("rigid", [True, False])
def test_a_welded_end_in_the_plane(rigid):
    """Held in its turn too, beside the mesh with springs there: few modes do, as moments on the ends have shapes."""
    link = read_elements(*FILES, ENDS)
    basis = link.basis("transverse", rigid)
    rows = np.array(link.means("start"))[1:]
    expected = welded(basis.T @ link.K @ basis, basis.T @ link.M @ basis, rows @ basis, 2)
    whole = (link.field(0.0, 1.0), link.field(-link.nodes[:, 1], link.nodes[:, 0]))
    shapes = np.column_stack([reduced(link, "transverse", 3, rigid).shapes, *whole])
    free = shapes @ null_space(rows @ shapes, rcond=1e-9)
    found = np.sqrt(eigh(free.T @ link.K @ free, free.T @ link.M @ free, eigvals_only=True)[:2]) / (2.0 * np.pi)
    np.testing.assert_allclose(found, expected, rtol=1e-4)


SENSORS = """
bow = {displacement = "rod.mid", relative_to = "chord", component = "y"}
stretch = {displacement = "rod.end", relative_to = "start", component = "x"}
side_force = {joint_force = "bore", component = "y"}
torque = {drive_torque = "main"}
"""
BEAM = (
    'length = "137 mm", beam = {material = "steel", section = {rectangle = ["20 mm", "12 mm"]}, theory = "timoshenko"}'
)


def engine(rod, sensors=()):
    """Series of the engine's cycle, a beam with 3 modes and 2 % damping of each."""
    solve, damped = {"preset": "coupled", "start": "periodic"}, {}
    if "beam" in rod:
        solve, damped = solve | {"modes": 3}, {"damping": "modal = {ratio = 0.02}"}
    return solved(kaneflex.scene_of(slider_crank(
        'length = "40 mm", mass = "0.952 kg"', rod, 'mass = "0.214 kg"', 'speed = "6000 rpm", cycle = "360 deg"',
        more={"bore": 'branch = "+"'}, sensors=SENSORS + "\n".join(sensors), solve=solve, **damped,
    ))).series  # fmt: skip


def test_the_engine_with_it_and_with_a_beam():
    """The rod of finite elements beside one of Timoshenko elements: bow and stretch to 2 % of the peaks, forces 0.1 %.

    What differs: plane sections and a shear factor there; ends that are stiffened here, where the nodes of each move as
    one, and 2 % damping of each shape instead of each mode.
    """
    beam, imported = engine(BEAM), engine('modal_data = "rod.npz"')
    alike(imported, beam, {"bow": 2e-2, "stretch": 2e-2, "side_force": 1e-3, "torque": 1e-3})


@pytest.fixture(scope="module")
def recovered():
    """The rod with its stresses, by the page's command, and the page's scene of it."""
    assert cli(*recovering()).exit_code == 0
    (text,) = re.findall(r"^```toml\n(# imported\.toml\n.*?)^```", PAGE, re.DOTALL | re.MULTILINE)
    return text


@pytest.fixture(scope="module")
def odd_files():
    """Of nodes, matrices and stresses: what can be wrong with them."""
    numbers = np.loadtxt("rod-nodes.txt")
    np.savetxt("all.txt", np.loadtxt("small-eye.txt"))
    np.savetxt("strange.txt", [4711.0])
    np.savetxt("corner.txt", numbers[[0], 0])
    mmwrite("short.mtx", np.eye(6))
    Path("empty.txt").write_text("")
    np.savetxt("ninth.txt", [[1, 1, 1, 1, 1.0], [1, 9, 1, 9, 1.0]], fmt="%g")
    doubled = numbers.copy()
    doubled[1, 0] = 3.0
    np.savetxt("twice-numbered.txt", doubled, fmt="%.9g")
    Path("torn.mtx").write_text("%%MatrixMarket matrix coordinate real symmetric\n3675 3675 9\n1 1 1.0\n")
    K = mmread("rod-stiffness.mtx").tolil()
    K[0, 7] += 1e9
    mmwrite("lopsided.mtx", K.tocsr(), symmetry="general")
    mmwrite("turned-round.mtx", -mmread("rod-stiffness.mtx"))
    np.savetxt("upper.txt", numbers[(numbers[:, 1] == L) & (numbers[:, 2] > 0.0), 0])
    for name, text in (("three", "a\nb\nc"), ("twice", "top\ntop"), ("dotted", "rod.top\nb")):
        Path(f"{name}.txt").write_text(text)
    S = mmread("rod-stress.mtx").tolil()
    S[0, 0] += 1e12
    mmwrite("other.mtx", S.tocsr())


READ = [("axial_force", 5e-4), ("shear_force", 2e-2), ("bending_moment", 2e-3)]
"""Kinds of section forces, and by how much of the largest along the rod finite elements may differ from the beam."""


def test_section_forces_and_stresses_beside_a_beam():
    """Those of the beam by balance, here by the shapes' own stiffness; stresses beside E times its strains.

    A shear force differs by N times the slope: it is across the deflected line here, across the chord there.
    """
    assert cli(*recovering(**{"rod-stress.npz": "eye.npz"}), "--section", "eye=0.02").exit_code == 0
    sensors = [f'{kind}_{at} = {{{kind} = "rod.{at}"}}' for kind, _ in READ for at in ("eye", "waist", "mid")]
    strains = [f'{name} = {{strain = "rod.waist", fibre = "{y} mm"}}' for name, y in (("top", 10), ("bottom", -10))]
    stresses = [f'{name} = {{stress = "rod.{name}", component = "xx"}}' for name in ("top", "bottom")]
    rod = f'points = {{waist = ["66 mm", 0], eye = ["20 mm", 0]}}, {BEAM}'
    beam, found = engine(rod, sensors + strains), engine('modal_data = "eye.npz"', sensors + stresses)
    for kind, bound in READ:
        names = [f"{kind}_{at}" for at in ("eye", "waist", "mid")]
        largest = max(abs(beam[name].values).max() for name in names)
        for name in names:
            assert abs(found[name].values - beam[name].values).max() < bound * largest, name
    for name in ("top", "bottom"):
        expected = E * beam[name].values
        assert abs(found[name].values - expected).max() < 4e-2 * abs(expected).max(), name


def test_files_in_other_axes_tell_the_same_stresses(recovered):
    """Those of z, x, y here are their X, Y, Z."""
    axes, nodes = [2, 0, 1], np.loadtxt("rod-nodes.txt")
    np.savetxt("turned-nodes.txt", np.column_stack([nodes[:, 0], nodes[:, 1:][:, axes]]), fmt="%.12g")
    order = (3 * np.arange(len(nodes))[:, None] + axes).ravel()
    for name in ("mass", "stiffness"):
        mmwrite(f"turned-{name}.mtx", mmread(f"rod-{name}.mtx").tocsr()[order][:, order])
    rows = [6 * k + at for k in range(2) for at in (2, 0, 1, 5, 3, 4)]  # zz, xx, yy, zx, xy, yz here
    mmwrite("turned-stress.mtx", mmread("rod-stress.mtx").tocsr()[rows][:, order])
    turned = {f"rod-{name}": f"turned-{name}" for name in ("mass.mtx", "stiffness.mtx", "nodes.txt", "stress.mtx")}
    assert cli(*recovering(**turned, **{"rod-stress.npz": "turned.npz"}), "--normal", "1", "0", "0").exit_code == 0
    here, there = (read_modal_data(name) for name in ("rod-stress.npz", "turned.npz"))
    for one, other in ((here.stresses, there.stresses), (here.sections, there.sections)):
        assert one.places == other.places
        np.testing.assert_allclose(abs(other.rows), abs(one.rows), rtol=1e-5, atol=1e-6 * abs(one.rows).max())


@pytest.mark.parametrize(("changed", "message"), [
    ({"rod-stress.txt": "three.txt"}, "(12, 3675), with 3 names in three.txt not (18, 3675)"),
    ({"rod-stress.txt": "twice.txt"}, "twice.txt: top occurs twice"),
    ({"rod-stress.txt": "dotted.txt"}, "dotted.txt: 'rod.top' is not a name"),
    ({"rod-stress.txt": "none.txt"}, "none.txt cannot be read: No such file"),
    ({"rod-stress.mtx": "other.mtx"}, "a rigid motion along its axis gives a stress at top"),
    ({"rod-stress.mtx": "rod-nodes.txt"}, "rod-nodes.txt is not a Matrix Market file"),
    ({"waist=0.066": "waist=66"}, "section waist at 66 is not between the start and the end, at 0.137"),
    ({"waist=0.066": "waist=half"}, "section waist = 'half' is not a distance from the start"),
    ({"waist=0.066": "end=0.066"}, "a point given by nodes has the name end"),
    ({"waist=0.066": "mid=0.066"}, "section mid at 0.066 is not half-way"),
    ({"waist=0.066": "2x=0.066"}, "'2x' is not a name"),
    ({"waist=0.066": "waist"}, "--section 'waist' is not of the form NAME=VALUE"),
    ({"waist=0.066": "waist="}, "--section 'waist=' is not of the form NAME=VALUE"),
])  # fmt: skip
def test_what_is_refused_of_sections_and_stresses(odd_files, changed, message):
    refused(cli(*recovering(**({"rod-stress.npz": "never.npz"} | changed))), message)
    assert not Path("never.npz").exists()


@pytest.mark.parametrize("changed, message", [
    ({"start=big-eye.txt": "start=all.txt"}, "start and end have node 1201 in common"),
    ({"start=big-eye.txt": "start=none.txt"}, "none.txt cannot be read: No such file"),
    ({"start=big-eye.txt": "start=strange.txt"}, "strange.txt: there is no node 4711"),
    ({"start=big-eye.txt": "begin=big-eye.txt"}, "no point start"),
    ({"start=big-eye.txt": "start=corner.txt"}, "the line from start to end is off the plane of motion by"),
    ({"rod-mass.mtx": "short.mtx"}, "short.mtx has the shape (6, 6), with 1225 nodes"),
    ({"rod-mass.mtx": "rod-nodes.txt"}, "rod-nodes.txt has 4 columns"),
    ({"rod-mass.mtx": "ninth.txt"}, "ninth.txt contains a direction outside 1 to 6 of node 1"),
    ({"rod-mass.mtx": "torn.mtx"}, "torn.mtx is not a Matrix Market file"),
    ({"rod-stiffness.mtx": "lopsided.mtx"}, "lopsided.mtx is not symmetric"),
    ({"rod-stiffness.mtx": "rod-mass.mtx"}, "rod-mass.mtx resists a rigid motion along its axis by"),
    ({"rod-mass.mtx": "rod-stiffness.mtx"}, "kg. Give the mass first, then the stiffness"),
    ({"end=small-eye.txt": "end=big-eye.txt"}, "start and end have node 1 in common"),
    ({"rod-stiffness.mtx": "turned-round.mtx"}, "turned-round.mtx does not resist a stretch of the link"),
    ({"rod-nodes.txt": "twice-numbered.txt"}, "twice-numbered.txt: node 3 occurs twice"),
    ({"rod-nodes.txt": "empty.txt"}, "empty.txt contains no finite numbers"),
    ({"rod-nodes.txt": "."}, ". cannot be read: it is a folder"),
    ({"end=small-eye.txt": "end=upper.txt"}, "not symmetric about its axis"),
    ({"rod.npz": "rod.txt"}, "not the name of a file of arrays"),
])  # fmt: skip
def test_what_is_refused(odd_files, changed, message):
    """By name and with a cure, and nothing is written."""
    arguments = command(**({"rod.npz": "other.npz"} | changed))
    refused(cli(*arguments), message)
    assert not Path("other.npz").exists() and not Path("rod.txt").exists()


def test_a_normal_is_three_numbers_apart():
    refused(cli(*command(), "--normal", "0,0,1"), "'--normal' requires 3 arguments. Separate them by spaces.")


def test_the_page_has_a_scene_of_it(recovered):
    """Which runs, and whose forces act where the file has its points, also if the scene doesn't name them."""
    text = recovered
    Path("imported.toml").write_text(text)
    assert cli("check", "imported.toml").exit_code == 0
    push = '[loads]\npush = {force_on = "rod.waist", direction = [0, 1], value = "1 kN"}\n'
    pushed = text.replace("[sensors]", f"{push}[sensors]")
    shorter = text.replace('"rod.end", "piston"', '"rod.waist", "piston"')
    named = '"rod-stress.npz", points = {waist = ["66 mm", 0]}}'
    for one in (text, pushed, shorter):
        other = None if one is text else one.replace('"rod-stress.npz"}', named)
        Path("imported.toml").write_text(one)
        found = solved(kaneflex.read_scene("imported.toml")).series
        assert abs(found["waist"].values).max() > 1.0
        if other is not None:
            Path("imported.toml").write_text(other)
            same = solved(kaneflex.read_scene("imported.toml")).series
            for name in found:
                np.testing.assert_array_equal(found[name].values, same[name].values)


@pytest.mark.parametrize(("before", "after", "message"), [
    ('start = "periodic"', "modes = 2", "solve.modes = 2: the file of modal data gives the shapes"),
    ('preset = "coupled"\nstart = "periodic"', 'preset = "rigid"', "under rigid modal data give no section forces"),
    ('"rod.waist"', '"rod.end"', "has no section forces there: it has those at mid, waist. Name a section"),
])  # fmt: skip
def test_what_a_scene_of_it_must_not_ask(recovered, before, after, message):
    Path("imported.toml").write_text(recovered.replace(before, after))
    refused(cli("check", "imported.toml"), message)


def test_stresses_are_told_in_megapascal(recovered):
    Path("imported.toml").write_text(recovered)
    result = cli("run", "imported.toml", "--no-plots", "-o", "imported", "--force")
    (row,) = re.findall(r"^top +MPa +(\S+)", result.stdout, re.MULTILINE)
    assert -100.0 < float(row) < -10.0


INPUT = """*HEADING
 A bar. *NODE is what comes next.
** *NODE
*Part, name=bar
*NODE, NSET=ALL
{}
*NSET, NSET=EYE
 1, 2, 3
*ELEMENT, TYPE=C3D20
 1, 1, 2, 3
*NODE PRINT, NSET=ALL
U
"""


def written_input(name="job.inp", more="", keep=slice(None)):
    """The nodes in an input of Abaqus."""
    rows = [", ".join(f"{x:.9g}" for x in row).rstrip("0, ") if row[3] == 0 else ", ".join(f"{x:.9g}" for x in row)
            for row in np.loadtxt("rod-nodes.txt")[keep]]  # fmt: skip
    Path(name).write_text(more + INPUT.format("\n".join(rows)))


def test_the_table_is_also_json():
    result = cli(*command(**{"rod.npz": "json.npz"}), "--json")
    assert result.exit_code == 0 and result.stderr.endswith("Written to json.npz\n")
    found = json.loads(result.stdout)
    assert found["length"] == pytest.approx(L) and min(found["frequencies_hz"].values()) > 0.0


def test_nodes_of_an_input_of_abaqus_or_calculix():
    written_input()
    result = cli(*command(**{"rod-nodes.txt": "job.inp", "rod.npz": "input.npz"}))
    assert result.exit_code == 0, result.output
    here, there = (read_modal_data(name) for name in ("rod.npz", "input.npz"))
    for name, array in here.arrays.items():
        np.testing.assert_array_equal(there.arrays[name], array)


@pytest.mark.parametrize(("more", "message"), [
    ("*NODE\n7, 0.1, 0.2\n", "job.inp: node 7 occurs twice. Give each node a different number"),
    ("*NODE, SYSTEM=C\n7, 0.1, 0.2\n", "job.inp: nodes given by *NODE, SYSTEM=C are not read"),
    ("*Ngen, nset=all\n1, 9\n", "job.inp: nodes given by *Ngen, nset=all are not read"),
    ("*INSTANCE, PART=bar\n 0.1, 0., 0.\n", "job.inp moves an instance by 0.1, 0., 0."),
    ("*NODE\nseven, 0.1\n", "job.inp: seven, 0.1 is not a node"),
])  # fmt: skip
def test_what_is_refused_of_an_input(more, message):
    written_input(more=more)
    refused(cli(*command(**{"rod-nodes.txt": "job.inp", "rod.npz": "other.npz"})), message)
    Path("job.inp").write_text("*ELEMENT\n1, 2, 3\n")
    refused(cli(*command(**{"rod-nodes.txt": "job.inp", "rod.npz": "other.npz"})), "job.inp has no nodes below *NODE")


def test_nodes_in_one_place_have_no_mirror_image():
    link = read_elements(*FILES, ENDS)
    flat = replace(link, nodes=np.column_stack([link.nodes[:, :2], np.zeros(len(link.nodes))]))
    with pytest.raises(Fault, match=r"several nodes are at \(0, -10, 0\) mm: their mirror images are ambiguous"):
        flat.basis("axial", rigid=False)


def test_no_full_matrix_is_made_of_a_sparse_one():
    """A square array of the bar's 3675 unknowns alone is 108 MB; of 100,000 unknowns it would be 80 GB."""
    link = read_elements(*FILES, ENDS)
    tracemalloc.start()
    try:
        reduced(link, "transverse", 3, rigid=True)
        assert tracemalloc.get_traced_memory()[1] < 3e7
    finally:
        tracemalloc.stop()


def test_a_point_that_is_called_mid_is_no_section():
    numbers = np.loadtxt("rod-nodes.txt")
    np.savetxt("middle.txt", numbers[np.isclose(numbers[:, 1], L / 2), 0], fmt="%d")
    assert cli(*command(**{"rod.npz": "middle.npz"}), "--point", "mid=middle.txt").exit_code == 0
    data = read_modal_data("middle.npz")
    assert data.points == ("start", "end", "mid") and data.sections.places == ()


def test_units_of_other_programs():
    """Millimetres, tonnes and newtons are the same link."""
    for name, factor in (("rod-mass.mtx", 1e-3), ("rod-stiffness.mtx", 1e-3)):
        mmwrite(f"mm-{name}", factor * mmread(name))
    table = np.loadtxt("rod-nodes.txt")
    table[:, 1:] *= 1e3
    np.savetxt("mm-rod-nodes.txt", table, fmt="%.12g")
    names = {name: f"mm-{name}" for name in FILES} | {"rod.npz": "mm.npz"}
    wrong = cli(*command(**names), "--force")
    assert "Warning: the speed of sound would be 6e+06 m/s, outside the range of materials." in wrong.stderr
    assert "Warning: the density would be" not in wrong.stderr
    right = cli(*command(**names), "--units", "mm-t", "--force")
    assert right.exit_code == 0 and "Warning" not in right.stderr
    assert "density would be at least 7.85e+15 kg/m^3" in cli(*command(), "--units", "mm-t", "--force").stderr
    assert cli(*command(), "--force").stderr == ""
    metric, other = (read_modal_data(name) for name in ("rod.npz", "mm.npz"))
    for name, array in metric.arrays.items():
        np.testing.assert_allclose(abs(other.arrays[name]), abs(array), rtol=1e-6, atol=1e-7 * abs(array).max())
