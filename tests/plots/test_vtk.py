"""`kaneflex run --vtk`: what ParaView opens holds the motion that the sensors read."""

import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
import xarray
from command_line import cli, refused

FRAMES = 5
SCENES = {  # how many points and cells, and a setting
    "engine": (2 + 33 + 1, 1 + 32 + 1, "rod.elements=1"),
    "slider-crank-150-coupled": (2 + 33 + 1, 1 + 32 + 1, "solve.steps=300"),
    "robot-arm": (6 * 2 + 1, 6 + 1, "solve.steps=200"),
    "bricard": (5 * 2, 5, "solve.steps=50"),
}


@pytest.fixture(scope="module")
def read(tmp_path_factory, peer):
    """`read("engine")`: times, meshes and results of a run with that many frames."""
    meshio = peer("meshio")

    def reading(name):
        folder = tmp_path_factory.mktemp("vtk") / name
        done = cli("run", name, "--vtk", "--frames", FRAMES, "--no-plots", "-o", folder, "--set", SCENES[name][2])
        assert done.exit_code == 0, done.output
        sets = ET.parse(folder / "vtk" / "motion.pvd").findall("./Collection/DataSet")
        files = [entry.get("file") for entry in sets]
        assert {path.name for path in (folder / "vtk").iterdir()} == {"motion.pvd", *files}
        times = np.array([float(entry.get("timestep")) for entry in sets])
        with xarray.open_dataset(folder / "results.nc", engine="scipy") as found:
            results = found.load()
        return times, [meshio.read(folder / "vtk" / file) for file in files], results

    kept = {}
    return lambda name: kept[name] if name in kept else kept.setdefault(name, reading(name))


def of_body(mesh, number):
    """Points of a body, in their order."""
    found = [block.data[of == number].ravel() for block, of in zip(mesh.cells, mesh.cell_data["body"], strict=True)]
    return np.unique(np.concatenate(found))


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("name", SCENES)
def test_every_frame_is_a_mechanism_at_its_time(read, name):
    times, meshes, results = read(name)
    assert len(times) == len(meshes) == FRAMES and times[0] == results.time[0]
    end = results.time[-1].item()
    assert times[-1] == pytest.approx(0.8 * end if name == "engine" else end)  # the end of a cycle is its start
    for mesh in meshes:
        assert (len(mesh.points), sum(len(block.data) for block in mesh.cells)) == SCENES[name][:2]
        assert set(mesh.point_data) == {"displacement", "velocity", "acceleration"}
        assert all(np.isfinite(part).all() for part in (mesh.points, *mesh.point_data.values()))


def test_the_engines_rod_is_deformed_and_its_piston_moves(read):
    times, meshes, results = read("engine")
    rows = results.sel(time=times)
    for k, mesh in enumerate(meshes):
        rod, (piston,) = of_body(mesh, 1), of_body(mesh, 2)
        middle = mesh.point_data["displacement"][rod[len(rod) // 2]]
        assert middle == pytest.approx([rows.mid_global_x[k].item(), rows.mid_global_y[k].item(), 0.0], abs=1e-15)
        assert mesh.points[piston, 0] == pytest.approx(rows.piston_position[k].item(), abs=1e-12)
        acceleration = mesh.point_data["acceleration"][piston, 0]
        assert acceleration == pytest.approx(rows.piston_acceleration[k].item(), rel=1e-12)
        axis = mesh.points[rod] - mesh.point_data["displacement"][rod]
        assert np.linalg.norm(np.diff(axis, axis=0), axis=1) == pytest.approx(np.full(32, 0.137 / 32), abs=1e-12)
        assert mesh.points[rod[-1]] == pytest.approx(mesh.points[piston], abs=1e-12)
        assert mesh.points[of_body(mesh, 0)[-1]] == pytest.approx(mesh.points[rod[0]], abs=1e-12)
    assert max(abs(mesh.point_data["displacement"]).max() for mesh in meshes) > 1e-5


def test_a_coupled_rod_stays_between_its_pins(read):
    _, meshes, _ = read("slider-crank-150-coupled")
    for mesh in meshes:
        crank, rod, slider = (of_body(mesh, number) for number in range(3))
        assert mesh.points[rod[0]] == pytest.approx(mesh.points[crank[-1]], abs=1e-9)
        assert mesh.points[rod[-1]] == pytest.approx(mesh.points[slider[0]], abs=1e-9)
        assert (mesh.points[:, 2] == 0).all()


def test_the_arms_tool_is_where_its_sensors_have_it(read):
    times, meshes, results = read("robot-arm")
    rows = results.sel(time=times)
    for k, mesh in enumerate(meshes):
        tool = of_body(mesh, 6)[-1]
        place = [rows[f"tool_{axis}"][k].item() for axis in "xyz"]
        accel = [rows[f"tool_{axis}_acceleration"][k].item() for axis in "xyz"]
        assert mesh.points[tool] == pytest.approx(place, abs=1e-12)
        assert mesh.point_data["acceleration"][tool] == pytest.approx(accel, abs=1e-12)
        assert (mesh.point_data["displacement"] == 0).all()


def test_velocities_are_the_rates_of_places(tmp_path, peer):
    """Of all points, by central differences between neighbouring frames."""
    meshio = peer("meshio")
    asked = "--vtk", "--frames", 401, "--no-plots", "--steps", 400
    done = cli("run", "robot-arm", *asked, "-o", tmp_path / "r")
    assert done.exit_code == 0, done.output
    first, here, last = (meshio.read(tmp_path / "r" / "vtk" / f"motion_{k:04d}.vtu") for k in (199, 200, 201))
    rate = (last.points - first.points) / (2 * 2.5 / 400)
    assert here.point_data["velocity"] == pytest.approx(rate, abs=1e-4)
    rate = (last.point_data["velocity"] - first.point_data["velocity"]) / (2 * 2.5 / 400)
    assert here.point_data["acceleration"] == pytest.approx(rate, abs=2e-4)


def test_meshio_that_is_missing_is_said_before_anything_runs(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "meshio", None)
    monkeypatch.chdir(tmp_path)
    refused(cli("run", "engine", "--vtk", "-o", "r"), "meshio", 'pip install "kaneflex[vtk]"')
    assert not Path("r").exists()
