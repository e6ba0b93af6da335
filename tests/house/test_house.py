"""Rules of the house: who imports whom, what is packed, and that nothing of one machine is in the tree."""

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from importlib import metadata
from pathlib import Path

import conftest
import pytest
from places import ROOT

from kaneflex.multibody.compile.entries import sources

PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
SETUPTOOLS = PYPROJECT["tool"]["setuptools"]
FOLDERS = {
    "kaneflex": ROOT / "src/kaneflex", "kaneflex.derive": ROOT / "derive", "kaneflex.generated": ROOT / "generated",
}
# What `import kaneflex` must not pay for: 0.3 to 0.7 s each.
HEAVY = ("sympy", "matplotlib", "xarray", "pint", "scipy.integrate", "scipy.interpolate", "kaneflex.derive")


def modules(package: str) -> list[Path]:
    return sorted(path for path in FOLDERS[package].rglob("*.py") if "__pycache__" not in path.parts)


def imports(path: Path, at_import_only: bool = False) -> tuple[str, ...]:
    """Absolute dotted names that `path` imports; `at_import_only`: less those inside functions."""
    return _imports(path)[at_import_only]


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def _imports(path: Path) -> tuple[tuple[str, ...], tuple[str, ...]]:
    return tuple(imported(tree_of(path), False)), tuple(imported(tree_of(path), True))


def imported(tree: ast.AST, at_import_only: bool) -> Iterator[str]:
    nodes = [tree]
    while nodes:
        node = nodes.pop()
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield "." * node.level + (node.module or "")
            yield from (f"{'.' * node.level}{node.module or ''}.{alias.name}" for alias in node.names)
        elif at_import_only and isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            continue
        nodes.extend(ast.iter_child_nodes(node))


def within(name: str, *packages: str) -> bool:
    return any(name == package or name.startswith(package + ".") for package in packages)


def python(code: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", code], cwd=cwd, capture_output=True, text=True, timeout=300)


def foreign(package: str, *allowed: str) -> list[tuple[str, str]]:
    """File and name of what a package imports besides Python's own and these."""
    found = ((path.name, name) for path in modules(package) for name in imports(path))
    return [
        (file, name) for file, name in found
        if not within(name, *allowed) and name.split(".")[0] not in sys.stdlib_module_names
    ]  # fmt: skip


def test_generated_imports_only_python_numpy_numba_with_its_llvm_and_its_siblings():
    """And, where kaneflex is there, its decorator: a copy without it takes numba's."""
    decorator = "kaneflex.support.late_numba"
    assert foreign("kaneflex.generated", "numpy", "numba", "llvmlite", "kaneflex.generated", decorator) == []
    assert {path.name for path in modules("kaneflex.generated") if decorator in imports(path)} == {"compiling.py"}


def test_derive_imports_sympy_the_scene_and_the_contract():
    """And numba for the types of arguments in C."""
    ours = (f"kaneflex.{name}" for name in ("derive", "mechanism", "scene", "support"))
    found = foreign("kaneflex.derive", "sympy", "numba", *ours)
    assert [(file, name) for file, name in found if name != "kaneflex"] == []  # `from kaneflex import x` yields it too
    in_c = {path.name for path in modules("kaneflex.derive") if any(within(name, "numba") for name in imports(path))}
    assert in_c == {"c_module.py", "c_printer.py", "c_expressions.py", "c_types.py"}


def test_runtime_never_imports_sympy_and_derive_only_inside_functions():
    for path in modules("kaneflex"):
        assert [name for name in imports(path) if within(name, "sympy")] == [], path
        assert [name for name in imports(path, at_import_only=True) if within(name, "kaneflex.derive")] == [], path


@pytest.mark.parametrize("package", FOLDERS)
def test_imports_are_absolute_and_by_installed_name(package):
    found = [(path.name, name) for path in modules(package) for name in imports(path)]
    assert [(file, name) for file, name in found if name[0] == "." or within(name, "derive", "generated")] == []


def test_every_dependency_is_declared_and_every_declared_one_is_imported():
    used = {name.split(".")[0] for package in FOLDERS for path in modules(package) for name in imports(path)}
    used -= {*sys.stdlib_module_names, "kaneflex"}
    extras = PYPROJECT["project"]["optional-dependencies"]
    entries = [*PYPROJECT["project"]["dependencies"]]
    imported = ("tables", "vtk", "nastran")
    entries += [entry for extra in imported for entry in extras[extra]]
    declared = {re.split(r"[^\w-]", entry)[0].replace("-", "_") for entry in entries}
    brought = {"PIL": "pillow", "mpl_toolkits": "matplotlib", "pydantic_core": "pydantic"}
    assert {brought.get(name, name) for name in used} == declared


def test_import_kaneflex_is_light(tmp_path):
    code = f"import sys, kaneflex; print([name for name in {HEAVY} if name in sys.modules])"
    result = python(code, tmp_path)
    assert (result.returncode, result.stdout.strip()) == (0, "[]"), result.stderr


def test_a_run_pays_for_nothing_that_it_does_not_need(tmp_path):
    """A run of the engine, results written, leaves out what other scenes, commands and files need."""
    scipy = [f"scipy.{name}" for name in ("io", "linalg", "optimize", "sparse", "special", "stats")]
    others = ("pandas", "exudyn", "meshio")
    others += ("kaneflex.multibody.time.collocation", "kaneflex.plots", "kaneflex.study.plan", "kaneflex.study.records")
    code = f"""
import sys
from kaneflex.cli import main
main(["run", "engine", "--no-plots", "-o", "results"], standalone_mode=False)
print([name for name in {(*HEAVY, *scipy, *others)} if name in sys.modules])
"""
    result = python(code, tmp_path)
    assert (result.returncode, result.stdout.splitlines()[-1]) == (0, "[]"), result.stderr
    assert (tmp_path / "results" / "results.nc").exists()


def test_c_of_a_shipped_scene_needs_no_sympy(tmp_path):
    """Its kernels are printed from its module, and the engine from its own text."""
    code = """
import sys
from kaneflex.cli import main
for scene in ("engine", "four-bar-motor", "spatial-slider-crank-elastic"):
    main(["derive", scene, "--language", "c", "--quiet", "-o", scene], standalone_mode=False)
print([name for name in ("sympy", "matplotlib") if name in sys.modules])
"""
    result = python(code, tmp_path)
    assert (result.returncode, result.stdout.splitlines()[-1]) == (0, "[]"), result.stderr
    assert (tmp_path / "four-bar-motor" / "four_bar_motor.c").exists()


def test_importing_compiles_nothing(tmp_path):
    """After every module has been imported, no jitted function of ours has a compiled signature."""
    code = """
import gc, importlib, pkgutil, kaneflex, kaneflex.derive, kaneflex.generated
from numba.core.dispatcher import Dispatcher
for package in (kaneflex, kaneflex.derive, kaneflex.generated):
    for found in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        if not found.name.endswith("__main__"):
            importlib.import_module(found.name)
jitted = [f for f in gc.get_objects() if isinstance(f, Dispatcher)]
ours = [f for f in jitted if f.py_func.__module__.startswith("kaneflex")]
assert ours, "no jitted function found: the test would pass for the wrong reason"
print([f"{f.py_func.__module__}.{f.__name__}" for f in ours if f.signatures])
"""
    result = python(code, tmp_path)
    assert (result.returncode, result.stdout.strip()) == (0, "[]"), result.stderr


def test_no_kernel_is_interpreted():
    """A run computes with what is compiled, which is what users import and what is measured."""
    assert [path.name for path in modules("kaneflex") if re.search(r"\.py_func\(", path.read_text())] == []


def test_derive_under_its_bare_name_is_refused(tmp_path):
    """From the repository's root `import derive` would be a second copy of kaneflex.derive."""
    result = python("import derive", ROOT)
    assert result.returncode != 0
    assert "ImportError" in result.stderr and "kaneflex.derive" in result.stderr


def test_packages_listed_are_the_packages_there_are():
    found = set()
    for name, folder in FOLDERS.items():
        for path in modules(name):
            inner = path.parent.relative_to(folder).parts
            found.add(".".join((name, *inner)))
    assert set(SETUPTOOLS["packages"]) == found
    for package in found:
        top = max((name for name in FOLDERS if within(package, name)), key=len)
        folder = FOLDERS[top].joinpath(*package.removeprefix(top).split("."))
        assert (folder / "__init__.py").is_file(), f"{package} has modules but no __init__.py"


def test_package_dir_maps_each_top_folder():
    mapped = {name: ROOT / folder for name, folder in SETUPTOOLS["package-dir"].items()}
    assert mapped == FOLDERS


def test_every_data_file_is_packed():
    for name, folder in FOLDERS.items():
        for path in folder.rglob("*"):
            if path.is_dir() or path.suffix == ".py" or "__pycache__" in path.parts:
                continue
            package = ".".join((name, *path.parent.relative_to(folder).parts))
            patterns = SETUPTOOLS["package-data"].get(package, [])
            packed = any(path.match(pattern) for pattern in patterns)
            assert packed, f"{path.relative_to(ROOT)} is not in the wheel"


def test_the_version_is_that_of_the_project():
    import kaneflex

    assert kaneflex.__version__ == metadata.version("kaneflex") == PYPROJECT["project"]["version"]


def tracked() -> list[Path]:
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True)
    paths = [ROOT / name for name in listed.stdout.split("\0") if name]
    return [path for path in paths if path.is_file() and path.suffix not in {".png", ".gif", ".nc"}]


def test_the_root_has_the_folders_of_the_project_and_no_results_of_runs():
    assert {path.relative_to(ROOT).parts[0] for path in tracked() if path.parent != ROOT} == {
        ".ci", "derive", "docs", "generated", "src", "tests",
    }  # fmt: skip


def test_no_machine_paths_and_no_residue_in_the_tree():
    # in brackets, or this file would find itself
    wrong = re.compile(r"[/](?:work|tmp|root|home)/|TOD[O]|FIXM[E]")
    found = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()}"
        for path in tracked()
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1)
        if wrong.search(line)
    ]
    assert found == []


def test_make_alone_lists_every_target():
    targets = re.search(r"^\.PHONY: (.*)$", (ROOT / "Makefile").read_text(), re.MULTILINE)[1].split()
    shown = subprocess.run(["make"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert re.findall(r"^  make ([a-z-]+)  ", shown, re.MULTILINE) == targets


@pytest.mark.parametrize(("required", "outcome"), [(False, pytest.skip.Exception), (True, pytest.fail.Exception)])
def test_a_missing_peer_skips_and_in_ci_fails(monkeypatch, peer, required, outcome):
    monkeypatch.setattr(conftest, "REQUIRED", required)
    with pytest.raises(outcome, match="no_such_program"):
        peer("no_such_program")


LONG = {
    "integrate/steppers.py": {"collocation", "exact_modal", "newmark"},
    "multibody/time/collocation.py": {"_iterate", "integrate"},
}
"""Compiled functions of more than 60 lines or 8 parameters; a comment in their file says why. The list only falls.

In multibody what Python calls takes every array by itself.
"""
COMPILES = {"njit", "_compiled", "inlined", "_cached"}


def test_long_functions_are_compiled_loops_that_say_why():
    found, folder = {}, FOLDERS["kaneflex"]
    for path in modules("kaneflex"):
        for node in ast.walk(tree_of(path)):
            if not isinstance(node, ast.FunctionDef):
                continue
            given = node.args
            parameters = len(given.posonlyargs) + len(given.args) + len(given.kwonlyargs)
            if node.end_lineno - node.lineno >= 60 or parameters > 8:
                words = (word for each in node.decorator_list for word in ast.walk(each) if isinstance(word, ast.Name))
                decorators = {word.id for word in words}
                found.setdefault(path.relative_to(folder).as_posix(), {})[node.name] = bool(decorators & COMPILES)
    python = {file: {name for name, compiled in names.items() if not compiled} for file, names in found.items()}
    assert {file: names for file, names in python.items() if names} == {}
    compiled = {file: {name for name, compiled in names.items() if compiled} for file, names in found.items()}
    assert {file: names for file, names in compiled.items() if names} == LONG
    for file in LONG:
        assert re.search(r'^(# |""")Compiled', (folder / file).read_text(encoding="utf-8"), re.MULTILINE), file


def test_cached_loops_are_stamped_with_every_compiled_part_they_import():
    """Else an edit of that part would leave the old one in the cache: see kaneflex.support.fingerprint."""
    trees = {
        f"{package}." + ".".join(path.relative_to(FOLDERS[package]).with_suffix("").parts): path
        for package in ("kaneflex", "kaneflex.generated")
        for path in modules(package)
    }
    texts = {name: path.read_text(encoding="utf-8") for name, path in trees.items()}
    compiled = {name for name, text in texts.items() if re.search(r"\bnjit\(|@intrinsic|@njit", text)}
    compiled -= {"kaneflex.support.late_numba", "kaneflex.support.inner"}  # the decorator, and how numba compiles
    cached = [name for name in compiled if "cache=True" in texts[name] and not within(name, "kaneflex.generated")]
    assert len(cached) >= 2
    for name in cached:
        parts = compiled & set(imports(trees[name])) - {name}
        if name in LIBRARIES:
            assert {str(trees[part]) for part in parts} <= {*map(str, sources())}, name
            continue
        assert parts <= stamps(tree_of(trees[name])), name


LIBRARIES = ["kaneflex.multibody.compile.library"]
"""Libraries of the engine's functions."""


def test_libraries_are_stamped_with_every_compiled_part_that_they_reach():
    stamped = {file.name for file in sources()}
    assert {"inner.py", "layout.py", "algebra.py", "collocation.py", "loop_closure.py", "tree.py"} <= stamped
    assert {"impact.py", "codes.py", "arrays.py", "coefficients.py", "entries.py"} <= stamped
    assert "run.py" not in stamped, "not compiled: an edit of it keeps the library"


def stamps(tree: ast.Module) -> set[str]:
    """Modules that a file hands over to ``made_of``, by their names."""
    aliases = {
        alias.asname or alias.name: f"{node.module}.{alias.name}"
        for node in tree.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    calls = (node for node in ast.walk(tree) if isinstance(node, ast.Call))
    calls = (call for call in calls if getattr(call.func, "id", "") == "made_of")
    return {aliases.get(node.id, "") for call in calls for node in ast.walk(call) if isinstance(node, ast.Name)}
