"""The C of a scene: compiled with every warning an error, against the numba kernels and the runs of Python."""

import ctypes
import itertools
import math
import re
import subprocess
import types
from dataclasses import replace
from importlib.util import module_from_spec, spec_from_file_location
from inspect import signature
from pathlib import Path

import numpy as np
import pytest
import sympy as sm
from command_line import cli, refused
from interpreted import interpreted
from numba.types import float64, int64
from runs import model

from kaneflex import SceneError, read_scene, scene_of, with_settings
from kaneflex.derive.equations.law_expression import law_expression
from kaneflex.derive.printers import numba_printer
from kaneflex.derive.printers.c_module import prefix_of
from kaneflex.derive.printers.c_printer import Printer
from kaneflex.derive.printers.c_types import ReadOnly
from kaneflex.derive.printers.functions_text import LAW_FUNCTIONS, TABLE_LOOKUPS
from kaneflex.derive.printers.numba_printer import print_kernel
from kaneflex.export.c_model import CModel, c_model, method_in_c
from kaneflex.generated import laws, tables
from kaneflex.integrate.run import integrate
from kaneflex.response.elastic_motion import ElasticMotion
from kaneflex.response.sensors import measure
from kaneflex.solve.loading import integrated
from kaneflex.solve.one_way_run import run_of
from kaneflex.solve.simulation import solve
from kaneflex.support.contract import ELEMENT_KERNELS

STRICT = ("-std=c11", "-pedantic", "-Wall", "-Wextra", "-Werror")
SHARED = ("-shared", "-fPIC")
HEADS = "".join(f"#include <{each}.h>\n" for each in ("complex", "math", "stdbool", "stdint", "stdlib"))


def built(texts: dict[str, str], folder: Path, compiler: str, *options: str, level: str = "-O0") -> Path:
    """The library of a scene's C, or the program with it where it has one and no options say otherwise.

    Compiled as fast as can be; by -O2, as users do it, it takes four times as long, and warns of more.
    """
    folder.mkdir(exist_ok=True)
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    sources = sorted(name for name in texts if name.endswith(".c") and not (options and name.endswith("_run.c")))
    subprocess.run([compiler, *STRICT, level, *options, *sources, "-o", "built", "-lm"], cwd=folder, check=True)
    return folder / "built"


def called(library: ctypes.CDLL, name: str, *arguments: float | np.ndarray) -> None:
    """A kernel in C with numbers and arrays."""
    given = [ctypes.c_double(a) if isinstance(a, float) else a.ctypes.data_as(ctypes.c_void_p) for a in arguments]
    getattr(library, name)(*given)


def distance(one: np.ndarray, other: np.ndarray, scale: np.ndarray) -> float:
    """In units of the last place of a scale."""
    return float((abs(one - other) / np.spacing(scale)).max())


# A table, loops that Newton's method closes, free joints with their courses and inverse dynamics.
@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("name", ["engine", "six-bar", "double-pendulum"])
def test_kernels_are_those_that_numba_compiles(name, compiler, tmp_path):
    bound = integrated(model(name))
    module, p = bound.module, bound.motion.parameters
    level = "-O2" if name == "engine" else "-O0"
    library = ctypes.CDLL(str(built(c_model(bound.scene).texts, tmp_path, compiler, *SHARED, level=level)))
    prefix = name.replace("-", "_")
    times = np.linspace(0.0, bound.options.duration, 33)
    expected = bound.motion.table(times)
    found = np.zeros_like(expected)
    for t, row in zip(times, found, strict=True):
        called(library, f"{prefix}_motion", float(t), p, row)
    # numba may add up in another order, and what cancels is then off by units of what it is the difference of. As the
    # kernels are written, operation by operation, nothing differs.
    as_written = interpreted(module).motion
    written = np.zeros_like(expected)
    for t, row in zip(times, written, strict=True):
        as_written(float(t), p, row)
    assert (found == written).all()
    if name == "engine":
        assert distance(found, expected, abs(expected).max(axis=0)) <= 4.0
    held = np.ctypeslib.as_array((ctypes.c_double * len(p)).in_dll(library, f"{prefix}_p"))
    assert (held == p).all()
    if not module.LINKS:
        return
    element = np.random.default_rng(2).uniform(0.5, 2.0, len(module.ELEMENT_PARAMETERS))
    scalars = np.random.default_rng(3).uniform(0.5, 2.0, len(module.LINK_SCALARS))
    for kernel in ELEMENT_KERNELS:
        shape = 6 if kernel == "F" else (6, 6)
        numba, in_c = np.zeros(shape), np.zeros(shape)
        given = (element, scalars) if kernel not in ("M", "K_s") else (element,)
        getattr(module, kernel)(*given, numba)
        called(library, f"{prefix}_{kernel}", *given, in_c)
        assert distance(in_c, numba, np.full(1, abs(numba).max())) <= 4.0, kernel


ROUND = {"position": "crank.start", "component": "angle"}
"""The angle of a body that turns all round, which C doesn't read."""


# The four-bar's sensors read loops closed about its foreshortened links, and the angle that its rocker swings by.
@pytest.mark.parametrize(
    "name, integrator",
    [("engine", "radau"), ("engine", "gauss"), ("engine", "newmark"), ("engine", "generalised-alpha"),
     ("four-bar", "radau")],
)  # fmt: skip
def test_a_program_without_python_takes_the_steps_of_a_run(name, integrator, compiler, tmp_path):
    scene = scene_of({"schema": 1, "like": name, "sensors": {"round": ROUND}})
    scene = with_settings(scene, [f"solve.integrator={integrator}"])
    made = c_model(scene)
    assert {*scene.sensors} - {*made.readings.sensors} == {"round"}
    assert "Not round." in made.texts[f"{made.name}_data.h"]
    level = "-O2" if (name, integrator) == ("engine", "radau") else "-O0"
    assert off_the_run(made, ran(made, tmp_path, compiler, level)) < 1e-9


# A loop closed about links that bend both ways, from rest over more than a cycle; one that is held once too often,
# whose smallest sensor is 1e-5 of the others; a blade.
@pytest.mark.exhaustive
@pytest.mark.parametrize("name, settings", [
    ("spatial-slider-crank-elastic", ["solve.start=zero", "solve.duration=0.17 s", "solve.integrator=gauss"]),
    ("spatial-slider-crank-elastic", []),
    ("four-bar-misaligned", ["solve.integrator=newmark"]),
    ("rotating-blade", ["solve.start=quasistatic"]),
])  # fmt: skip
def test_in_space_too(name, settings, compiler, tmp_path):
    scene = with_settings(read_scene(name), settings)
    made = c_model(scene)
    assert {*made.readings.sensors} == {*scene.sensors}
    assert off_the_run(made, ran(made, tmp_path, compiler)) < 1e-9


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("like", ["slider-crank-150", "spatial-slider-crank-elastic"])
def test_springs_between_points_are_read(like, compiler, tmp_path):
    raw = read_scene(like).raw
    post = ["0.3 m", "0.2 m", "0.1 m"][: 3 if "spatial" in like else 2]
    band = {"between": ["ground.post", "rod.mid"], "stiffness": "400 N/m"}
    springs = {"band": band, "strut": {**band, "length": "90 mm", "damping": "2 N s/m"}}
    raw = {**raw, "ground": {**raw.get("ground", {}), "post": post}, "springs": springs}
    raw["sensors"] = {**raw["sensors"], **{name: {"spring_force": name} for name in springs}}
    made = c_model(with_settings(scene_of(raw), ["solve.integrator=radau"]))
    assert {*made.readings.sensors} == {*raw["sensors"]}
    assert off_the_run(made, ran(made, tmp_path, compiler)) < 1e-9


def test_scalars_in_space_are_those_of_the_motion_at_any_time(compiler, tmp_path):
    angle = {"turned": {"position": "shaft", "component": "angle"}}  # more with every turn
    made = c_model(scene_of({"schema": 1, "like": "spatial-slider-crank-elastic", "sensors": angle}))
    motion, header = made.model.motion, made.texts[f"{made.name}.h"]
    read = re.findall(r"_S_\w+, /\* (.*) \[.*\]: .*(?<!not computed) \*/", header)
    library = ctypes.CDLL(str(built(made.texts, tmp_path, compiler, *SHARED)))
    times = np.random.default_rng(5).uniform(0.0, 3.0 * made.model.options.duration, 40)
    expected, found = motion.table(times), np.zeros((len(times), len(motion.column)))
    for t, row in zip(times, found, strict=True):
        called(library, f"{made.name}_motion", float(t), motion.parameters, row)
    columns = [motion.column[name] for name in read]
    assert len(columns) > 30 and "shaft.angle" in read
    scale = np.maximum(abs(expected).max(axis=0), 1e-9)
    assert (abs(found - expected) / scale)[:, columns].max() < 1e-10


def ran(made: CModel, folder: Path, compiler: str, level: str = "-O0") -> dict[str, np.ndarray]:
    """Columns of the CSV that the program of a scene writes, by their names."""
    program = built(made.texts, folder, compiler, level=level)
    out = subprocess.run([program], capture_output=True, text=True, check=True).stdout
    head, *lines = out.splitlines()
    names = ["time", *made.model.reduced.coordinates, *made.readings.sensors]
    assert head == ",".join([names[0], *(f'"{name}"' for name in names[1:])])
    return dict(zip(names, np.array([line.split(",") for line in lines], dtype=float).T, strict=True))


def off_the_run(made: CModel, found: dict[str, np.ndarray]) -> float:
    """Largest difference of a coordinate or sensor in C from the same steps in Python, of its peak."""
    bound = made.model
    begun = solve(bound).trajectory
    run = replace(run_of(bound), start=(begun.z[0], begun.v[0]), method=method_in_c(bound).name)
    expected = integrate(run)
    np.testing.assert_allclose(found["time"], expected.times, rtol=1e-14, atol=0.0)
    motion = ElasticMotion(bound, bound.motion.at(expected.times), (expected.z.T, expected.v.T, expected.a.T))
    measured = measure(motion)
    series = dict(zip(bound.reduced.coordinates, expected.z.T, strict=True))
    least = 1e-6 * abs(expected.z).max()  # across the plane of a mechanism in one there is rounding alone
    series |= {sensor: measured[sensor].values for sensor in made.readings.sensors}
    peaks = {name: max(abs(values).max(), least * (name not in measured)) for name, values in series.items()}
    return max(abs(found[name] - values).max() / peaks[name] for name, values in series.items())


def test_its_run_is_that_of_the_harmonics(compiler, tmp_path):
    bound = model("engine")
    assert bound.options.integrator == "spectral"
    found = ran(c_model(bound.scene), tmp_path, compiler)
    found = np.column_stack([found[name] for name in bound.reduced.coordinates])
    z = solve(bound).trajectory.z
    assert (abs(found - z).max(axis=0) / abs(z).max(axis=0)).max() < 1e-4


def test_the_command_writes_a_folder_that_cmake_knows(tmp_path):
    folder = tmp_path / "c"
    arguments = "derive", "engine", "--language", "c", "--set", "rod.elements=1", "-o", folder
    assert cli(*arguments).exit_code == 0
    named = re.search(r"add_library\(engine STATIC (.*)\)", (folder / "CMakeLists.txt").read_text())[1].split()
    assert {*named, "engine_run.c"} == {path.name for path in folder.glob("*.c")}
    refused(cli(*arguments), "--force")
    refused(cli("derive", "bricard", "--language", "c", "-o", tmp_path / "other"), "--language")
    refused(cli("derive", "engine", "--language", "c", "-o", tmp_path / "engine.c"), "several files. Give")


LAWS = [getattr(laws, name) for name in LAW_FUNCTIONS]
LOOKUPS = [getattr(tables, name) for name in TABLE_LOOKUPS]


def test_lookups_and_laws_are_those_of_numba(compiler, tmp_path):
    printer, D = Printer(), float64
    for law in LAWS:
        printer.function(law, [D] * len(signature(law.py_func).parameters), "", law.__name__)
    for lookup in LOOKUPS:
        printer.function(lookup, [D, ReadOnly(D), int64], "", lookup.__name__)
    library = ctypes.CDLL(str(built({"lookups.c": HEADS + printer.text()}, tmp_path, compiler, *SHARED)))
    values = (-3.5, -0.0, 0.3, 1.0, 2.5, float("nan"))
    for law in LAWS:
        in_c, count = getattr(library, law.__name__), len(signature(law.py_func).parameters)
        in_c.restype, in_c.argtypes = ctypes.c_double, [ctypes.c_double] * count
        for some in itertools.product(values, repeat=count):
            np.testing.assert_allclose(in_c(*some), law(*some), rtol=1e-15, err_msg=f"{law.__name__}{some}")
    block = np.array([0.0, 3.0, 2.0, 0.5, 1.0, 2.0, 2.5, *np.random.default_rng(4).normal(size=12)])
    for period in (2.0, 0.0):
        block[2] = period
        for lookup in LOOKUPS:
            in_c = getattr(library, lookup.__name__)
            in_c.restype, in_c.argtypes = ctypes.c_double, [ctypes.c_double, ctypes.c_void_p, ctypes.c_int64]
            for x in (-7.3, 0.4, 0.5, 0.999, 1.0, 2.4, 2.5, 11.2):
                assert in_c(x, block.ctypes.data, 1) == lookup.py_func(x, block, 1)


def imported(path: Path) -> types.ModuleType:
    specification = spec_from_file_location(path.stem, path)
    module = module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


def test_inverse_functions_and_powers_of_laws_are_those_of_c(compiler, tmp_path):
    """A law and its rate, as numba has them, printed in C."""
    t = sm.Symbol("t")
    law = law_expression("asin(t) - 2*acos(t) + atan(3*t) + atan2(t, 2 - t) + (1 + t)**0.3", {"t": t})
    values = {"value": law, "rate": law.diff(t)}
    kernels = [numba_printer.kernel(name, ["t"], (), [of], "A law.")[0] for name, of in values.items()]
    path = tmp_path / "printed_law.py"
    path.write_text("\n".join(["import math\nfrom numba import njit\nOPTIONS = {}", *map(print_kernel, kernels)]))
    printed = imported(path)
    printer = Printer()
    for function in (printed.value, printed.rate):
        printer.function(function, [float64], "", function.__name__)
    library = ctypes.CDLL(str(built({"inverse.c": HEADS + printer.text()}, tmp_path, compiler, *SHARED)))
    for function in (library.value, library.rate):
        function.restype, function.argtypes = ctypes.c_double, [ctypes.c_double]
    x = 0.37
    value = math.asin(x) - 2 * math.acos(x) + math.atan(3 * x) + math.atan2(x, 2 - x) + (1 + x) ** 0.3
    rate = 3 / math.sqrt(1 - x * x) + 3 / (1 + 9 * x * x) + 2 / (x * x + (2 - x) ** 2)
    rate += 0.3 * (1 + x) ** -0.7
    assert (library.value(x), library.rate(x)) == pytest.approx((value, rate), rel=1e-14)


def test_what_a_scene_is_called_can_be_a_name_in_c():
    assert [prefix_of(name) for name in ("six-bar", "9 bars", "double", "kaneflex_linear")] == [
        "six_bar", "scene_9_bars", "scene_double", "scene_kaneflex_linear",
    ]  # fmt: skip


def test_what_is_not_printed_in_c_is_refused():
    with pytest.raises(SceneError, match=r"No linear preset .*: joints.rub.friction: .* does not support friction"):
        c_model(read_scene("stick-slip"))
    sudden = "loads.push.value=none", "loads.push.law=1 / (1.0001 - cos(shaft))"
    for name, settings, said in (
        ("bricard", (), "first is free"), ("robot-arm-elastic", (), "none of its drives has a cycle"),
        ("rotating-blade", sudden, "too suddenly for a Fourier series of 512 harmonics"),
    ):  # fmt: skip
        with pytest.raises(SceneError, match=f"--language.*{said}"):
            c_model(with_settings(read_scene(name), settings))
