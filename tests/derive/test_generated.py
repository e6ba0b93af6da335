"""The generated modules: what is committed is what is derived, and the compiled kernels compute the equations."""

import ast
import hashlib
import importlib
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import closed_forms as by_hand
import numpy as np
import pytest
import sympy as sm
from interpreted import every_kernel, interpreted
from numba import njit
from runs import model, shipped, short, solved

import kaneflex.generated
from kaneflex.derive import __main__ as derive_all
from kaneflex.derive.elements.parameters import BEAMS, ELEMENT_PARAMETERS, LINK_SCALARS, SPATIAL_BEAMS
from kaneflex.derive.generate import generate
from kaneflex.generated.engine import C, F, K_d, K_g, K_s, M, motion, tabulate
from kaneflex.multibody.model.module_loading import find_laws_module, find_module
from kaneflex.scene import read_scene, shipped_scenes, with_settings
from kaneflex.scene.structure import laws_hash, structure_hash
from kaneflex.support.contract import ELEMENT_KERNELS, FORMAT, LAWS_ATTRIBUTES, REQUIRED_ATTRIBUTES
from kaneflex.support.module_cache import cache_folder

FOLDER = Path(kaneflex.generated.__file__).parent
LAWS = sorted(name for name in kaneflex.generated.STRUCTURES.values() if name.endswith("_laws"))
SCENES = shipped()
MOVING = {structure_hash(scene): name.replace("-", "_") for name, scene in reversed(SCENES.items())
          if not (scene.is_spatial or scene.solve.preset == "coupled")}  # fmt: skip
"""The first scene of each structure that has a rigid motion."""
NAMES = sorted(MOVING.values())
EVERY = [*NAMES, *LAWS]
ELEMENTS = *BEAMS, *SPATIAL_BEAMS
KERNELS = {"M": M, "K_s": K_s, "K_d": K_d, "K_g": K_g, "C": C, "F": F}

# Operations of one call on the engine. Fewer is welcome: then lower the number here.
MOST_OPERATIONS = {"motion": 88, "M": 14, "K_s": 12, "K_d": 24, "K_g": 95, "C": 8, "F": 38}


def module(name: str):
    """A module by its name, or that of a scene."""
    if name in NAMES:
        return find_module(SCENES[name.replace("_", "-")], lambda stage: None)[0]
    return importlib.import_module(f"kaneflex.generated.{name}")


def text_of(name: str) -> str:
    return Path(module(name).__file__).read_text(encoding="utf-8")


# ---- what is committed ------------------------------------------------------------------------------------------


_COSTLY = ("element_texts", "spatial_element_texts", "shapes_text", "spatial_shapes_text")


def test_committed_texts_are_the_derived_ones(monkeypatch, exhaustive):
    """Of every fourth scene, beside what all scenes share; CI leaves it to `make check-derived`, which derives all.

    Elements and bodies take most of the time: those that are committed are proved in test_elements and test_bodies.

    In one test, so that one process derives them; and once for the sources that they are derived by and of: what was
    compared is kept by the digest of the generator's sources and of `generated/` (`cache_folder`), with that of the
    scenes and SymPy's version.
    """
    if os.environ.get("CI"):
        pytest.skip("make check-derived compares all")
    scenes = dict(list(sorted(shipped_scenes().items()))[:: 1 if exhaustive else 4])
    texts = "".join(f"{name}\0{path.read_text(encoding='utf-8')}\0" for name, path in scenes.items())
    made_of = hashlib.sha256(f"{sm.__version__}\0{sys.version}\0{texts}".encode()).hexdigest()
    compared = cache_folder() / f"compared-{made_of}"
    if compared.exists():
        return
    monkeypatch.setattr(derive_all, "shipped_scenes", lambda: scenes)
    for costly in () if exhaustive else _COSTLY:
        monkeypatch.setattr(derive_all, costly, dict)
    derived = derive_all.modules()
    committed = {path.name: path.read_text(encoding="utf-8") for path in FOLDER.glob("*.py")}
    index = derived.pop("__init__.py")
    assert not exhaustive or (index == committed["__init__.py"] and {*committed} == {*derived, "__init__.py"})
    for name, text in derived.items():
        assert not text or committed[name] == text, name
    compared.touch()


@pytest.mark.parametrize("own", [True, False])
def test_modules_that_no_scene_has_any_more_are_removed_from_generated_alone(tmp_path, monkeypatch, own):
    """Of its own folder it removes them; of a folder that the user names it takes nothing away."""
    monkeypatch.setattr(derive_all, "modules", lambda: {"__init__.py": "", "kept.py": "new = 1\n"})
    monkeypatch.setattr(derive_all, "find_spec", lambda name: SimpleNamespace(origin=str(tmp_path / "__init__.py")))
    folder = tmp_path if own else tmp_path / "other"
    folder.mkdir(exist_ok=True)
    for name in ("kept.py", "gone.py", "note.txt"):
        (folder / name).write_text("old = 1\n")
    monkeypatch.setattr(sys, "argv", ["derive", *([] if own else ["-o", str(folder)])])
    derive_all.main()
    left = {path.name for path in folder.iterdir()}
    assert left == {"__init__.py", "kept.py", "note.txt", *([] if own else ["gone.py"])}
    assert (folder / "kept.py").read_text() == "new = 1\n"


def test_modules_are_found_by_the_structure_of_their_scenes():
    """Those of the scenes that the documentation runs are there, others are derived."""
    for name, scene in SCENES.items():
        laws = scene.is_spatial or scene.solve.preset == "coupled"
        structure = (laws_hash if laws else structure_hash)(scene)
        if name in derive_all.SCENES:
            found = kaneflex.generated.STRUCTURES[structure]
            assert importlib.import_module(f"kaneflex.generated.{found}").STRUCTURE == structure
        else:
            assert (find_laws_module if laws else find_module)(scene, lambda stage: None)[0].STRUCTURE == structure


@pytest.mark.parametrize("name", NAMES)
def test_contract(name):
    found = module(name)
    assert [attribute for attribute in REQUIRED_ATTRIBUTES if not hasattr(found, attribute)] == []
    assert found.FORMAT == FORMAT
    elastic = (LINK_SCALARS, ELEMENT_PARAMETERS) if found.LINKS else ((), ())
    assert (found.LINK_SCALARS, found.ELEMENT_PARAMETERS) == elastic
    names = [entry for entry, *_ in found.SCALARS]
    assert len(set(names)) == len(names)
    # a link's scalar that is zero by structure keeps its place, which the element kernels read
    both = set(names) & set(found.CONSTANTS)
    assert all(".link." in name and found.CONSTANTS[name] == 0.0 for name in both)
    for link, first in found.LINKS.items():
        block = [f"{link}.link.{entry}" for entry, *_ in LINK_SCALARS]
        assert names[first : first + len(block)] == block


@pytest.mark.parametrize("name", LAWS)
def test_contract_of_drives_and_loads(name):
    found = module(name)
    assert [attribute for attribute in LAWS_ATTRIBUTES if not hasattr(found, attribute)] == []
    assert found.FORMAT == FORMAT


def test_bytes_do_not_hang_on_the_hash_seed():
    """Not on this process' seed, by which all are derived above, nor on 0, by which none is drawn."""
    code = "import sys; from kaneflex.derive.generate import generate; from kaneflex.scene import read_scene\n"
    code += "sys.stdout.reconfigure(newline=''); sys.stdout.write(generate(read_scene('engine')))"
    environment = os.environ | {"PYTHONHASHSEED": "0", "PYTHONUTF8": "1"}
    written = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, check=True).stdout
    assert written == (FOLDER / "engine.py").read_bytes()


def test_numbers_do_not_enter_the_text():
    """Lengths, masses, speeds, elements and damping are run-time: the same structure gives the same text."""
    other = with_settings(
        read_scene("engine"),
        ["rod.length=150 mm", "rod.elements=9", "main.speed=300 rad/s", "crank.mass=2 kg", "solve.preset=linear"],
    )
    assert generate(other) == (FOLDER / "engine.py").read_text(encoding="utf-8")


def test_a_module_needs_nothing_of_kaneflex_but_its_siblings(tmp_path):
    """Copied elsewhere with those that it imports, kaneflex and SymPy out of reach, it computes the same."""
    folder = tmp_path / "kaneflex" / "generated"
    folder.mkdir(parents=True)
    for name in ("engine", "beam_euler_bernoulli", "compiling", "rows", "tables"):
        (folder / f"{name}.py").write_text((FOLDER / f"{name}.py").read_text(encoding="utf-8"), encoding="utf-8")
    code = """
import pathlib, sys
sys.path = ["", *(path for path in sys.path if not (pathlib.Path(path) / "kaneflex").is_dir())]
sys.meta_path = [finder for finder in sys.meta_path if "editable" not in str(finder)]
sys.modules |= {"sympy": None, "scipy": None}
import kaneflex.generated.engine as alone, numpy
out = numpy.zeros((6, 6))
alone.M(numpy.array([1.1, 3e7, 1500.0, 0.03, 0.06]), out)
print("kaneflex.support.errors" in sys.modules, alone.__file__.startswith(sys.argv[1]), repr(float(out.sum())))
"""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    result = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)],
        cwd=tmp_path, env=environment, capture_output=True, text=True, check=True,
    )  # fmt: skip
    *where, total = result.stdout.split()
    assert where == ["False", "True"]
    assert float(total) == pytest.approx(by_hand.mass(1.1, 0.03).sum(), rel=1e-13)


def functions(name: str) -> dict[str, ast.FunctionDef]:
    """The functions that a module of this name defines."""
    tree = ast.parse(text_of(name))
    return {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}


@pytest.mark.parametrize("name", [*EVERY, *ELEMENTS, "contact", "joints", "shapes", "tables"])
def test_a_kernel_that_is_called_from_another_file_leaves_its_digest_there(name):
    """numba keeps what it compiled until the caller's own file changes: so it has to change with the callee's."""
    text = text_of(name)
    nodes = [node for function in functions(name).values() for node in ast.walk(function)]
    called = {node.func.id for node in nodes if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)}
    called -= {"njit"}
    for node in ast.parse(text).body:
        if isinstance(node, ast.ImportFrom) and node.module.startswith("kaneflex.generated."):
            other = (FOLDER / f"{node.module.rpartition('.')[2]}.py").read_bytes()
            if called & {alias.name for alias in node.names}:
                line = text.splitlines()[node.end_lineno - 1]
                assert line.endswith(f"  # digest {hashlib.sha256(other).hexdigest()[:16]}"), line


def test_every_kernel_is_printed_once():
    """No two modules have one of an element or a table in common."""
    where: dict[str, str] = {}
    for name in [*EVERY, *ELEMENTS, "contact", "joints", "shapes", "tables"]:
        for kernel, node in functions(name).items():
            if kernel in ELEMENT_KERNELS or kernel.startswith("table"):
                assert where.setdefault(ast.unparse(node), name) == name, f"{kernel} of {name}"


def test_no_number_has_two_names():
    """What kernels share is neither another symbol nor its negative, and no name of theory stands for one of it."""
    for path in {*FOLDER.glob("*.py"), *(Path(module(name).__file__) for name in NAMES)}:
        for line in path.read_text(encoding="utf-8").splitlines():
            assert not re.fullmatch(r" +(w\d+ = (.* = )?-?[^\W\d]\w*|[^\W\d]\w* = (.* = )?w\d+)", line), (path, line)


# ---- only what the scene requires -------------------------------------------------------------------------------


@pytest.mark.parametrize("kernel", MOST_OPERATIONS)
def test_operations_are_held_down(kernel):
    written_out, shared = module("engine").OPERATIONS[kernel]
    assert shared <= MOST_OPERATIONS[kernel]
    assert shared < written_out


@pytest.mark.parametrize("name", NAMES)
def test_operations_stated_are_those_printed(name):
    """Counted anew in the text: operators and calls; a sign and a store are free, a lookup in a table is one call."""
    defined = functions(name)
    if module(name).LINKS:
        defined |= functions(module(name).M.__module__.rpartition(".")[2])
    for kernel, (_, stated) in module(name).OPERATIONS.items():
        nodes = list(ast.walk(defined[kernel]))
        calls = [node for node in nodes if isinstance(node, ast.Call)]
        calls = [node for node in calls if getattr(node.func, "id", "") != "int"]
        printed = sum(isinstance(node, ast.BinOp) for node in nodes) + len(calls) - 1  # the decorator's call
        assert printed == stated, kernel


def test_what_the_engine_does_not_have_is_not_there():
    engine, rig, elastic = (module(name) for name in ("engine", "engine_rig", "engine_elastic_crank"))
    text = {name: text_of(name) for name in ("engine", "engine_rig")}
    assert "gravity.x" not in text["engine"] and "*gravity_x" in text["engine_rig"]
    assert "gas" not in text["engine_rig"] and rig.TABLES == ()
    # The crank turns at constant speed about a fixed pivot: no acceleration of its own is computed.
    assert "epsilon_crank" not in text["engine"] and engine.CONSTANTS["crank.epsilon"] == 0
    assert all(engine.CONSTANTS[f"crank.{entry}"] == 0 for entry in ("x", "y", "v_x", "v_y", "a_x", "a_y"))
    # A rigid crank has no element, an undamped or Rayleigh-damped rod no viscous term.
    assert set(engine.LINKS) == {"rod"} and set(elastic.LINKS) == {"crank", "rod"}
    assert not [path for path, _ in engine.PARAMETERS if path.startswith("bodies.crank.element")]
    assert not [name for name, *_ in engine.TERMS if name == "viscous"]
    # The piston can't turn, so its inertia is no parameter.
    assert "bodies.piston.inertia" not in dict(engine.PARAMETERS)


# ---- compiled kernels against the equations ---------------------------------------------------------------------


def random_point(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """p and s of the element kernels, of the orders of magnitude of a real rod."""
    rng = np.random.default_rng(seed)
    p = np.array([1.1, 3e7, 1.5e3, 0.03, 0.06]) * rng.uniform(0.3, 3.0, 5)
    s = np.array([600.0, 1e5, 2e4, 2e4, 3e4]) * rng.uniform(-1.0, 1.0, 5)
    return p, s


def computed(name: str, p: np.ndarray, s: np.ndarray) -> np.ndarray:
    out = np.zeros(6) if name == "F" else np.zeros((6, 6))
    KERNELS[name](*((p, out) if name in ("M", "K_s") else (p, s, out)))
    return out


def assert_equal(found: np.ndarray, expected: np.ndarray) -> None:
    """To 1e-12 of each entry's largest possible neighbour: the largest entry with the same units."""
    scale = np.abs(expected).max()
    assert np.abs(found - expected).max() <= 1e-12 * scale


def test_kernels_are_sums_of_their_terms():
    """With each scalar at 1 in its turn they give the matrices that weigh the monomials of TERMS."""
    p, s = random_point(0)
    scalar = {name: (k, value) for k, ((name, *_), value) in enumerate(zip(LINK_SCALARS, s, strict=True), start=1)}
    units = [every_kernel(module("engine"), p, unit) for unit in np.eye(6, 5, -1)]
    totals = {name: np.zeros(6) if name == "F" else np.zeros((6, 6)) for name in KERNELS}
    for _, _, kernel, factors in module("engine").TERMS:
        row = scalar[factors[0]][0] if factors else 0
        totals[kernel] += np.prod([scalar[factor][1] for factor in factors]) * units[row][kernel]
    for name, total in totals.items():
        assert_equal(computed(name, p, s), total)


def test_structural_zeros_are_never_stored():
    """Outputs are zeroed by the caller; what a kernel leaves alone is zero by structure."""
    p, s = random_point(7)
    out = np.full((6, 6), np.nan)
    M(p, out)
    assert (by_hand.mass(p[0], p[3])[np.isnan(out)] == 0).all() and np.isnan(out).any()
    out = np.full((6, 6), np.nan)
    K_g(p, s, out)
    assert np.isnan(out[[0, 3]]).all() and np.isnan(out[:, [0, 3]]).all()


def test_tabulate_is_motion():
    found = model("engine").motion
    p, times = found.parameters, np.linspace(0.0, 0.02, 37)
    table = np.zeros((len(times), len(found.module.SCALARS)))
    tabulate(times, p, table)
    for t, row in zip(times, table, strict=True):
        s = np.zeros(len(row))
        motion(t, p, s)
        assert (s == row).all()


def interpreted_element(wrong: str = "") -> SimpleNamespace:
    """The engine's element as Python runs it, one of its kernels twice as large as it ought to be."""
    found = interpreted(module("beam_euler_bernoulli"))
    if wrong:
        right = getattr(found, wrong)

        def doubled(*arguments):
            right(*arguments)
            arguments[-1][:] *= 2.0

        setattr(found, wrong, doubled)
    return found


@pytest.mark.parametrize("kernel", ["", *ELEMENT_KERNELS])
def test_a_run_computes_with_the_kernels_that_are_imported(monkeypatch, kernel):
    """A wrong one makes the run go wrong."""
    scene = with_settings(read_scene("engine"), ["solve.steps=240", "rod.elements=2"])
    right = solved(scene).series["mid_transverse"].values
    for each in ELEMENT_KERNELS:
        monkeypatch.setattr(module("engine"), each, getattr(interpreted_element(kernel), each))
    found = solved(scene).series["mid_transverse"].values
    error = abs(found - right).max() / abs(right).max()
    assert error > 1e-5 if kernel else error < 1e-12


def test_kernels_in_a_loop_of_the_users_own():
    """Every kernel called from one jitted function that is not ours."""

    @njit
    def energy(times, p, element, q, v):
        s, matrix, load = np.zeros(33), np.zeros((6, 6)), np.zeros(6)
        total = 0.0
        for t in times:
            motion(t, p, s)
            matrix[:] = 0.0
            M(element, matrix)
            total += 0.5 * v @ (matrix @ v)
            for part in (1, 2, 3, 4):
                matrix[:] = 0.0
                if part == 1:
                    K_s(element, matrix)
                elif part == 2:
                    K_d(element, s, matrix)
                elif part == 3:
                    K_g(element, s, matrix)
                else:
                    C(element, s, matrix)
                total += 0.5 * q @ (matrix @ (v if part == 4 else q))
            load[:] = 0.0
            F(element, s, load)
            total -= load @ q
        return total

    found = model("engine").motion
    assert len(found.module.SCALARS) <= 33
    rng = np.random.default_rng(1)
    q, v = 1e-5 * rng.standard_normal(6), 1e-2 * rng.standard_normal(6)
    element, times = random_point(3)[0], np.linspace(0.0, 0.02, 5)
    expected = 0.0
    for t in times:
        s = np.ascontiguousarray(found.table(t)[0])
        K = sum(computed(name, element, s) for name in ("K_s", "K_d", "K_g"))
        expected += 0.5 * v @ computed("M", element, s) @ v + 0.5 * q @ K @ q
        expected += 0.5 * q @ computed("C", element, s) @ v - computed("F", element, s) @ q
    assert energy(times, found.parameters, element, q, v) == pytest.approx(expected, rel=1e-12)


PLANAR = [name for name, scene in SCENES.items() if not scene.is_spatial]


@pytest.mark.exhaustive(share=4)
@pytest.mark.parametrize("name", PLANAR)  # in space what joints share is no number
def test_motion_is_finite_at_every_angle(name):
    """0.1 degree steps over four turns, dead centres included; over the run with free joints or varying speeds."""
    scene = short(name).scene
    free = any(drive.kind == "free" for drive in scene.drives.values())
    found = (solved(scene).model if free else short(name)).motion
    speeds = [drive.speed for drive in scene.drives.values() if drive.kind == "constant speed"]
    turns = np.radians(np.arange(0, 14400) / 10)
    times = turns / speeds[0] if speeds and not free else np.linspace(0, scene.horizon, 14400)
    assert np.isfinite(found.table(times)).all()
