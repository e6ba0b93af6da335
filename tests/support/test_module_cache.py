"""Derived modules are code, and are not run unseen; kernels are cached where the usual folders can't be written."""

import ast
import keyword
import os
import re
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

import kaneflex
from kaneflex import SceneError, scene_of
from kaneflex.derive.generate import generate
from kaneflex.generated import rows
from kaneflex.multibody.model.module_loading import find_module
from kaneflex.scene.structure import structure_hash
from kaneflex.support import module_cache

PENDULUM = """
schema = 1
name = 'NAME'
gravity = [0, -9.81]
bodies.rod = {length = "LENGTH", mass = 2, inertia = 0.1, points = {"POINT" = [0.3, 0.1]}}
joints.main = {revolute = ["ground", "rod"]}
drives.main = {speed = 3, cycle = "360 deg"}
loads.push = {force_on = "rod.POINT", direction = [1, 0], law = "LAW"}
solve.preset = "rigid"
"""


def pendulum(**words: str):
    text = PENDULUM
    for word, value in ({"NAME": "plain", "LENGTH": "1 m", "POINT": "eye", "LAW": "2 * t"} | words).items():
        text = text.replace(word, value)
    return scene_of(text)


# ---- what a scene says stays data -----------------------------------------------------------------------------------

INJECTED = 'x"; import os; os.system("echo run"); y="'


@pytest.mark.parametrize("name", [INJECTED, 'Motor "A"', "rod 5\" long", '"""', "\\", "{title}"])
def test_a_modules_text_does_not_hang_on_what_its_scene_is_called(name):
    assert generate(pendulum(NAME=name)) == generate(pendulum())


nasty = st.sampled_from([INJECTED, '"""', "{}", "__import__('os').system('true')", "p[0]", "x = 1", "\\N{BULLET}", "#"])
names = st.one_of(
    st.from_regex(r"[A-Za-zµφﬁ_][A-Za-z0-9µφﬁ_]{0,12}", fullmatch=True), st.sampled_from(keyword.kwlist), nasty,
)
laws = st.recursive(
    st.sampled_from(["t", "main", "main_speed", "pi", "2.5", "1e3"]),
    lambda inner: st.builds("({} {} {})".format, inner, st.sampled_from("+-*"), inner)
    | st.builds("{}({})".format, st.sampled_from(["sin", "cos", "tanh"]), inner),
    max_leaves=5,
)


def without_rows(value):
    """A table with the arguments of calls of ``rows`` in their places."""

    class Arguments(ast.NodeTransformer):
        def visit_Call(self, node):
            assert isinstance(node.func, ast.Attribute) and node.func.value.id == "rows"
            return ast.Tuple([*node.args, *(named.value for named in node.keywords)], ast.Load())

        def visit_Starred(self, node):
            return self.visit(node.value)

        def visit_Dict(self, node):
            return ast.Tuple([self.visit(part) for part in (*node.keys, *node.values) if part], ast.Load())

    return Arguments().visit(value)


@settings(
    max_examples=10, deadline=None, derandomize=True, phases=[Phase.generate], suppress_health_check=list(HealthCheck)
)
@given(point=names, law=laws | nasty, length=st.sampled_from(["700 mm", "1 m"]) | nasty)
def test_whatever_a_scene_says_its_module_holds_tables_and_kernels_alone(point, law, length):
    try:
        scene = pendulum(POINT=point, LAW=law, LENGTH=length)
    except SceneError:
        return
    text = generate(scene)
    assert text.isascii() or ast.literal_eval(repr(point)) in text  # names beyond ASCII are literals
    tree = ast.parse(text)
    about, *nodes = tree.body
    assert isinstance(about.value, ast.Constant)
    for node in nodes:
        assert isinstance(node, (ast.Import, ast.ImportFrom, ast.Assign, ast.FunctionDef))
        if isinstance(node, ast.Assign):
            ast.literal_eval(without_rows(node.value))
    imports = [ast.unparse(node) for node in nodes if isinstance(node, (ast.Import, ast.ImportFrom))]
    siblings = ["from kaneflex.generated import rows", "from kaneflex.generated.compiling import njit"]
    assert imports == ["import math", *siblings]
    called = {ast.unparse(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    called -= {f"rows.{name}" for name, value in vars(rows).items() if callable(value)}
    assert called <= {"math.sin", "math.cos", "math.tanh", "njit", "motion", "range"}
    read = {name.id for name in ast.walk(tree) if isinstance(name, ast.Name) and isinstance(name.ctx, ast.Load)}
    assert not read & {"os", "__import__", "exec", "eval", "open"}


# ---- what is kept ---------------------------------------------------------------------------------------------------


@pytest.fixture
def found(tmp_path, monkeypatch):
    """A function that finds the pendulum's module as a new process would, and says what it was told."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    scene = pendulum()
    name = f"kaneflex_{structure_hash(scene)}"

    def find():
        sys.modules.pop(name, None)
        told = []
        module = find_module(scene, told.append)[0]
        return Path(module.__file__), told

    yield find
    sys.modules.pop(name, None)


def test_what_is_kept_is_the_users_alone_and_is_found_again(found):
    path, told = found()
    assert told[0] == "deriving the equations, first time only"
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(path.parent.stat().st_mode) == stat.S_IMODE(path.parent.parent.stat().st_mode) == 0o700
    before = path.read_bytes()
    assert found() == (path, []) and path.read_bytes() == before


@pytest.mark.parametrize("spoil", [
    lambda path: path.write_bytes(path.read_bytes().replace(b"rod_mass", b"2.0*rod_mass", 3)),
    lambda path: path.write_bytes(path.read_bytes()[:700]),
    lambda path: path.write_bytes(path.read_bytes() + b"import os\n"), lambda path: path.write_bytes(b"\xff\x00"),
    lambda path: path.write_bytes(b""), lambda path: path.chmod(0o666),
], ids=["a coefficient", "cut off", "longer", "no text", "empty", "others may write"])  # fmt: skip
def test_what_is_not_as_it_was_derived_is_derived_anew(found, spoil):
    path, _ = found()
    before = path.read_bytes()
    spoil(path)
    again, told = found()
    assert again == path and path.read_bytes() == before and stat.S_IMODE(path.stat().st_mode) == 0o600
    assert told[0] == "deriving the equations again: the cached file is damaged"


def test_a_folder_that_others_may_write_is_closed(found):
    path, _ = found()
    path.parent.chmod(0o777)
    assert found() == (path, []) and stat.S_IMODE(path.parent.stat().st_mode) == 0o700


@pytest.fixture
def no_temporary():
    module_cache._temporary.cache_clear()
    yield
    module_cache._temporary.cache_clear()


def test_another_users_folder_is_left_alone(found, monkeypatch, no_temporary, caplog):
    path, _ = found()
    before = path.read_bytes()
    path.write_bytes(b"raise SystemExit\n")
    monkeypatch.setattr(os, "getuid", lambda: path.stat().st_uid + 1, raising=False)  # some systems have none
    again, _ = found()
    (said,) = caplog.messages
    assert re.fullmatch(r"Warning: .*another user\), so every run derives them again.*set XDG_CACHE_HOME.*", said)
    assert not again.is_relative_to(path.parents[1]) and again.read_bytes() == before


def test_where_nothing_can_be_kept_a_run_goes_on_and_says_so(tmp_path, found, monkeypatch, no_temporary, caplog):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file" / "below"))
    path, _ = found()
    assert re.search("can't be kept in .* set XDG_CACHE_HOME to a writable folder of your own", caplog.messages[0])
    assert path.exists() and not path.is_relative_to(tmp_path)


# ---- which kaneflex -------------------------------------------------------------------------------------------------


def test_every_source_counts(tmp_path, monkeypatch):
    package = tmp_path / "some_package"
    (package / "inner").mkdir(parents=True)
    (package / "__init__.py").touch()
    (package / "inner" / "summary.py").write_text("FACTOR = 1.0\n")
    monkeypatch.syspath_prepend(tmp_path)
    before = module_cache._digest("some_package")
    assert module_cache._digest("some_package") == before
    (package / "inner" / "summary.py").write_text("FACTOR = 2.0\n")
    assert module_cache._digest("some_package") != before


def test_another_state_of_the_sources_makes_another_study(tmp_path, monkeypatch):
    from kaneflex.study.plan import make_plan

    (tmp_path / "study.toml").write_text('scene = "engine"\n[parameters]\n"rod.length" = ["137 mm"]\n')
    before = make_plan(tmp_path / "study.toml").digest
    monkeypatch.setattr("kaneflex.study.plan.sources_digest", lambda: "another")
    assert make_plan(tmp_path / "study.toml").digest != before


KERNEL = "import numba\n\n\n@numba.njit(cache=True)\ndef double(x):\n    return 2.0 * x\n"


def run_copy(folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Import a copy of kaneflex from `folder`, then compile a cached kernel that lies beside it."""
    code = "import kaneflex, kernel, numba; print(kernel.double(21.0)); print(numba.config.CACHE_DIR)"
    inherited = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    inherited |= {"PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-c", code]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300, env=inherited | environment)


def copy_with_blocked_pycache(folder: Path) -> None:
    """A file where each `__pycache__` should be: nothing can be cached there, whoever runs the test."""
    package = folder / "kaneflex"
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(Path(kaneflex.__file__).parent, package, ignore=ignored)
    (folder / "kernel.py").write_text(KERNEL)
    for place in (folder, package, *(path for path in package.rglob("*") if path.is_dir())):
        (place / "__pycache__").touch()


def test_no_writable_folder_warns_and_works(tmp_path):
    copy_with_blocked_pycache(tmp_path)
    nowhere = str(tmp_path / "kernel.py" / "below-a-file")
    result = run_copy(tmp_path, XDG_CACHE_HOME=nowhere, HOME=nowhere)
    assert result.returncode == 0, result.stderr
    value, cache_folder = result.stdout.split()
    assert value == "42.0"
    (line,) = result.stderr.splitlines()  # as the commands warn: no file and line of ours
    assert line.startswith("Warning: no folder for compiled kernels can be written") and "set NUMBA_CACHE_DIR" in line
    assert "kaneflex-numba-" in cache_folder and not Path(cache_folder).exists()  # removed at exit


def test_a_writable_folder_is_left_to_numba(tmp_path):
    copy_with_blocked_pycache(tmp_path)
    result = run_copy(tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "cache"))
    assert result.returncode == 0, result.stderr
    assert "NUMBA_CACHE_DIR" not in result.stderr
    assert list((tmp_path / "cache").rglob("kernel.double*.nbi"))


LOOP = """
from numba import njit
from kaneflex.integrate import conventions
from kaneflex.integrate.conventions import FASTMATH, UNBOUNDED
from kaneflex.support.fingerprint import made_of

@njit(cache=True, error_model="numpy", fastmath=FASTMATH)
@made_of(conventions.__file__)
def doubled(x):
    return UNBOUNDED * x
"""
CALL = "import loop; print(loop.doubled(1.0))"


def test_what_a_cached_loop_is_made_of_is_compiled_anew_after_an_edit(tmp_path):
    """numba looks at the loop's own file only; its parts are in others, all of which test_house finds stamped."""
    package = tmp_path / "kaneflex"
    shutil.copytree(Path(kaneflex.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "loop.py").write_text(LOOP)
    environment = os.environ | {
        "PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONDONTWRITEBYTECODE": "",
    }  # fmt: skip

    def called() -> float:
        command = [sys.executable, "-c", CALL]
        done = subprocess.run(command, capture_output=True, text=True, timeout=300, env=environment, check=True)
        return float(done.stdout)

    assert called() == called() == 2.0
    part = package / "integrate" / "conventions.py"
    text, named = part.read_text(), "SINGULAR, UNBOUNDED"
    assert text.count(named) == 1
    part.write_text(text.replace(named, "UNBOUNDED, SINGULAR"))
    assert called() == 1.0


def test_a_first_run_compiles_nothing(tmp_path):
    command = [sys.executable, "-m", "kaneflex", "run", "engine", "--no-plots", "-o", str(tmp_path / "results")]
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    result = subprocess.run(command, capture_output=True, text=True, timeout=300, env=environment)
    assert result.returncode == 0, result.stderr
    assert not [*tmp_path.rglob("*.nbc")]
