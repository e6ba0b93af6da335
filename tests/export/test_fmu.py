"""Exported FMUs in the hands of FMPy: its checks of the description, and its simulations beside runs.

FMPy reads them by the standard's schemas, calls the library by their signatures, and brings CVode for model exchange.
What differs in co-simulation: rounding. In model exchange: CVode's steps and tolerances.
"""

import io
import subprocess
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import cli, refused
from hostile_names import NAME
from machines import machine
from places import DOCS, ROOT
from runs import solved

from kaneflex import SceneError, export_fmu, read_scene, scene_of, with_settings

RPM = 2 * np.pi / 60


@pytest.fixture(scope="module", autouse=True)
def fmpy(peer, compiler):
    return peer("fmpy")


@pytest.fixture(scope="module")
def engine(tmp_path_factory, compiler):
    """The engine under radau: by the command, and by another name; and what the command prints."""
    folder = tmp_path_factory.mktemp("fmu")
    scene = with_settings(read_scene("engine"), ["solve.integrator=radau"])
    shown = cli("export", "engine", "--set", "solve.integrator=radau", "-o", folder / "plain.fmu")
    assert shown.exit_code == 0, shown.output
    export_fmu(scene.model_copy(update={"name": NAME, "description": NAME})).save(folder / "hostile.fmu")
    return scene, folder, shown.stdout


@pytest.fixture(scope="module")
def series(engine):
    return solved(engine[0]).series


@pytest.fixture
def uncompiled(monkeypatch):
    """FMUs of sources alone, where no library of theirs is called."""
    monkeypatch.setattr("shutil.which", lambda name: None)


def worst(found, series):
    """Largest error of a sensor, of its own peak."""
    names = [name for name in found.dtype.names if name in series]
    assert names
    peaks = {name: abs(series[name].values).max() for name in names}
    return max(abs(np.asarray(found[name]) - series[name].values).max() / peaks[name] for name in names)


def simulated(fmpy, path, kind, **more):
    experiment = fmpy.read_model_description(str(path)).defaultExperiment
    step, stop = float(experiment.stepSize), float(experiment.stopTime)
    return fmpy.simulate_fmu(str(path), fmi_type=kind, stop_time=stop, output_interval=step, **more)


@pytest.mark.parametrize("name", ["plain", "hostile"])
def test_the_description_is_valid_and_names_every_sensor(name, engine, fmpy):
    from fmpy.validation import validate_fmu

    scene, folder, printed = engine
    assert validate_fmu(str(folder / f"{name}.fmu")) == []
    found = fmpy.read_model_description(str(folder / f"{name}.fmu")).modelVariables
    outputs = {each.name: each.unit for each in found if each.causality == "output"}
    assert outputs == {name: sensor.unit for name, sensor in scene.sensors.items()}
    definitions = fmpy.read_model_description(str(folder / f"{name}.fmu")).unitDefinitions
    units = {each.name: each.baseUnit for each in definitions}
    assert (units["m/s^2"].m, units["m/s^2"].s, units["N"].kg, units["N"].m, units["N"].s) == (1, -2, 1, 1, -2)
    assert f"FMI 2.0, {len(outputs)} outputs; can be set: nothing" in printed
    assert not [each.name for each in found if each.causality == "parameter"]


@pytest.mark.parametrize("name", ["plain", "hostile"])
def test_co_simulation_is_the_run(name, engine, series, fmpy):
    assert worst(simulated(fmpy, engine[1] / f"{name}.fmu", "CoSimulation"), series) < 1e-9


def test_model_exchange_comes_near_the_run(engine, series, fmpy):
    found = simulated(fmpy, engine[1] / "plain.fmu", "ModelExchange", relative_tolerance=1e-10)
    assert worst(found, series) < 1e-4  # the run's own steps err by that in accelerations


def test_a_scene_in_space_is_an_fmu_too(fmpy, tmp_path):
    scene = with_settings(read_scene("spatial-slider-crank-elastic"), ["solve.integrator=radau"])
    made = export_fmu(scene)
    (tmp_path / "space.fmu").write_bytes(made.content)
    assert made.inputs == () and {*made.outputs} == {*scene.sensors}
    expected = solved(scene).series
    assert worst(simulated(fmpy, tmp_path / "space.fmu", "CoSimulation"), expected) < 1e-9
    found = simulated(fmpy, tmp_path / "space.fmu", "ModelExchange", relative_tolerance=1e-10)
    assert worst(found, expected) < 1e-4  # the run's own steps err by that


def test_a_constant_load_in_space_can_be_set(fmpy, tmp_path):
    """Rigid reactions, which sensors read, are linear in it."""
    push = {"push": {"force_on": "slider", "direction": [1, 0, 0], "value": 5.0}}
    scene = scene_of({"schema": 1, "like": "spatial-slider-crank-elastic", "loads": push})
    scene = with_settings(scene, ["solve.integrator=radau", "solve.start=zero", "solve.steps=360"])
    made = export_fmu(scene)
    assert made.inputs == ("loads.push.value",)
    (tmp_path / "load.fmu").write_bytes(made.content)
    expected, before = (solved(scene, *changed).series for changed in (["loads.push.value=-40 N"], []))
    found = simulated(fmpy, tmp_path / "load.fmu", "CoSimulation", start_values={"loads.push.value": -40.0})
    assert worst(found, expected) < 1e-9
    assert worst(found, before) > 0.1
    assert worst(simulated(fmpy, tmp_path / "load.fmu", "CoSimulation"), before) < 1e-9


def test_a_load_whose_reactions_do_not_vary_over_the_cycle_can_be_set():
    made = export_fmu(scene_of(machine(
        bodies=dict(shaft='length = 0.4, beam = {material = "steel", section = {circle = 0.02}, elements = 1}'),
        joints=dict(main="revolute ground shaft.start, axis = [1, 0, 0]"),
        drives=dict(main='speed = "600 rpm", cycle = "360 deg"'),
        loads=dict(brake='torque_at = "main", value = -5'), sensors=dict(torque="drive_torque main"),
        solve=dict(preset="linear", steps=72),
    )))  # fmt: skip
    assert made.inputs == ("loads.brake.value",)


@pytest.mark.exhaustive
@pytest.mark.parametrize("name, base, changed, values", [
    ("engine-transient", ["solve.integrator=radau"], ["drives.main.speed=3000 rpm", "solve.steps=2880"],
     {"drives.main.speed": 3000 * RPM}),
    ("engine-transient", ["solve.integrator=newmark"], ["drives.main.angle=30 deg", "loads.gas.offset=100 deg"],
     {"drives.main.angle": np.radians(30), "loads.gas.offset": np.radians(100)}),
    ("pulsating-strut", ["solve.integrator=gauss", "solve.start=zero"], ["loads.mean.value=-150 N"],
     {"loads.mean.value": -150.0}),
])  # fmt: skip
def test_what_can_be_set_is_what_the_scene_would_have(name, base, changed, values, fmpy, tmp_path):
    """The same steps: under another speed a cycle has more of them."""
    scene = with_settings(read_scene(name), base)
    export_fmu(scene).save(tmp_path / "any.fmu")
    found = simulated(fmpy, tmp_path / "any.fmu", "CoSimulation", start_values=values)
    assert worst(found, solved(scene, *changed).series) < 1e-9


def test_steps_of_another_program_and_states_to_go_back_to(engine, fmpy):
    """Communication points between its own steps differ little from those at them; a state that was kept repeats."""
    path = str(engine[1] / "plain.fmu")
    description = fmpy.read_model_description(path)
    own = float(description.defaultExperiment.stepSize)
    (output,) = (each for each in description.modelVariables if each.name == "mid_transverse")
    from fmpy.fmi2 import FMU2Slave

    def at_last(steps):
        slave = FMU2Slave(
            guid=description.guid, unzipDirectory=place, modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="one",
        )  # fmt: skip
        slave.instantiate()
        slave.setupExperiment()
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        time, read = 0.0, []
        for step in steps:
            state = slave.getFMUstate()
            for _ in range(2):  # there, back and there again
                slave.setFMUstate(state)
                slave.doStep(currentCommunicationPoint=time, communicationStepSize=step)
                read.append(slave.getReal([output.valueReference])[0])
            slave.freeFMUstate(state)
            time += step
            assert read[-1] == read[-2]
        slave.terminate()
        slave.freeInstance()
        return read[-1]

    place = fmpy.extract(path)
    whole, parts = at_last([own] * 30), at_last([0.7 * own] * 40 + [2 * own])
    assert parts == pytest.approx(whole, rel=1e-9)


def test_signatures_are_those_of_the_standard(fmpy, compiler):
    headers, given = Path(fmpy.__file__).parent / "c-code", '-DKANEFLEX_FMI_HEADER="fmi2Functions.h"'
    options = ("-std=c11", "-pedantic", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", "-I", headers, given)
    subprocess.run([compiler, *options, ROOT / "src/kaneflex/export/kaneflex_fmi2.c"], check=True)


def test_without_a_compiler_the_sources_are_there(uncompiled, engine):
    made = export_fmu(engine[0])
    assert made.compiled_for is None
    names = zipfile.ZipFile(io.BytesIO(made.content)).namelist()
    assert "sources/kaneflex_fmi2.c" in names and not any(name.startswith("binaries") for name in names)
    assert export_fmu(engine[0]).content == made.content


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["slider-crank-150-coupled", "spin-up-torque", "elastic-pendulum"])
def test_what_a_refusal_advises_helps(uncompiled, name):
    """Of scenes that are driven, turned by a torque, and free."""
    scene = read_scene(name)
    with pytest.raises(SceneError, match="for example --preset stiffened"):
        export_fmu(scene)
    assert export_fmu(with_settings(scene, ["solve.preset=stiffened"])).outputs


@pytest.mark.parametrize("start", ["zero", "quasistatic", "periodic"])
def test_numbers_on_which_the_initial_state_depends_are_no_parameters(start, uncompiled):
    """With another speed the elastic coordinates would start from the state of the scene's own speed."""
    made = export_fmu(with_settings(read_scene("engine"), [f"solve.start={start}", "solve.integrator=radau"]))
    names = "drives.main.speed", "drives.main.angle", "loads.gas.offset"
    assert (made.inputs, made.fixed) == ((names, ()) if start == "zero" else ((), names))
    warned = f"the initial state depends on them (--set solve.start=zero offers them): {', '.join(names)}"
    assert any(warned in warning for warning in made.warnings) == (start != "zero")


def test_frozen_matrices_and_modes_let_no_speed_be_changed(uncompiled):
    undamped = export_fmu(with_settings(read_scene("slider-crank-150"), ["solve.steps=10"]))
    assert undamped.inputs == ("drives.main.speed", "drives.main.angle")
    assert export_fmu(read_scene("engine-paper")).inputs == ()
    reduced = export_fmu(with_settings(read_scene("engine"), ["solve.reduction=modal"]))
    assert reduced.inputs == () and replace(reduced, content=b"").outputs


def test_no_preset_is_advised_that_a_cylinder_on_an_elastic_boom_has_no_use_for():
    """The boom of the page on scenes: the barrel goes along with what it pushes."""
    page = (DOCS / "scene/drives.md").read_text(encoding="utf-8")
    text = page.partition("# boom.toml\n")[2].partition("```")[0]
    with pytest.raises(SceneError, match=r"No linear preset .*: joints\.cylinder: the guide is on a body") as refusal:
        export_fmu(scene_of(text))
    assert "preset stiffened" not in str(refusal.value)


def test_what_is_refused(tmp_path):
    for arguments, said in (
        (["bricard", "-o", "a.fmu"], "first is free"),
        (["engine", "--preset", "rigid", "-o", "a.fmu"], "for example --preset stiffened"),
        (["double-pendulum", "-o", "a.fmu"], "Give a body a beam"),
        (["slider-crank-150-coupled", "-o", "a.fmu"], "another preset, for example --preset stiffened"),
        (["bouncing-bar", "-o", "a.fmu"], "contacts.stop: preset stiffened does not support a contact"),
        (["robot-arm-elastic", "--preset", "coupled", "-o", "a.fmu"], "none of its drives has a cycle"),
        (["engine", "-o", "a.zip"], ".fmu"),
    ):
        refused(cli("export", *arguments[:-1], tmp_path / arguments[-1]), said)
    assert not [*tmp_path.iterdir()]
