"""What every test may ask for: the outside tools that only some tests compare with, and a cache of derived modules."""

import gc
import importlib
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import matplotlib
import pytest

REQUIRED = os.environ.get("KANEFLEX_REQUIRE_PEERS") == "1"
EXTRAS = {"exudyn": "peer", "meshio": "vtk", "playwright": "browser",
          "skfem": "test", "pyyeti": "nastran", "pymoca": "test",
          "fmpy": "test"}  # fmt: skip
"""Which extra of the package brings what some tests need."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--exhaustive", action="store_true", help="run every case of the tests marked exhaustive")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Run a third of the cases of tests marked exhaustive, always the same ones; `make extremes` runs all of them.

    `share=4` runs a quarter. Tests of a file with one `group` count as cases of one test.
    """
    if config.getoption("exhaustive") or any("[" in argument for argument in config.args):
        return
    seen: dict[tuple[Path, str], int] = {}
    left_out = []
    for item in items:
        if (marker := item.get_closest_marker("exhaustive")) is not None:
            test, share = (item.path, marker.kwargs.get("group", item.originalname)), marker.kwargs.get("share", 3)
            seen[test] = seen.get(test, -1) + 1
            if (seen[test] + seen[test] // share) % share:  # another one of each row, as cases often come in rows
                left_out.append(item)
    if left_out:
        config.hook.pytest_deselected(items=left_out)
        gone = {*left_out}
        items[:] = [item for item in items if item not in gone]


def pytest_configure(config: pytest.Config) -> None:
    """What is derived in tests is kept beside what numba compiles of it, for later sessions, too.

    It is kept by the digest of the generator's sources; never for a user, nor from one. What a session chose by its own
    runs (`kaneflex run --tolerance`) the next one chooses anew.
    """
    config.addinivalue_line("markers", "exhaustive: one law in many cases; `make test` runs a third, or one in `share`")
    if hasattr(config, "workerinput"):
        return
    os.environ.setdefault("MPLCONFIGDIR", matplotlib.get_cachedir())  # its list of fonts takes seconds to make
    folder = Path(__file__).parents[1] / ".build" / "derived-in-tests"
    for choices in folder.glob("kaneflex/*/choices"):
        shutil.rmtree(choices)
    os.environ["XDG_CACHE_HOME"] = str(folder)


@pytest.fixture(scope="module", autouse=True)
def settled(request: pytest.FixtureRequest) -> Iterator[None]:
    """Collect garbage once a file, and release the solutions that the file cached at its end.

    What was imported before is gone through no more: again and again it took 15 s of 74 in three files.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 10, 10)
    yield
    for each in vars(request.module).values():
        own = hasattr(each, "cache_clear") and each.__module__ in (request.module.__name__, "runs")
        if own and each.__name__ not in ("model", "shipped"):  # the last scenes that were loaded serve other files
            each.cache_clear()


@pytest.fixture
def empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in a folder of the test's own."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="session")
def derived_once() -> Iterator[None]:
    """The equations that are printed in LaTeX: those of a structure are derived once a process."""
    from kaneflex.derive import latex
    from kaneflex.derive.generate import Equations, derive_equations

    known: dict[str, Equations] = {}

    def equations(structure: dict[str, Any]) -> Equations:
        key = repr(structure)
        if key not in known:
            known[key] = derive_equations(structure)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(latex, "derive_equations", equations)
        yield


@pytest.fixture(scope="session")
def exhaustive(request: pytest.FixtureRequest) -> bool:
    """Whether tests run the slow half of what they compare, too: `make extremes` does."""
    return bool(request.config.getoption("exhaustive"))


def absent(what: str, cure: str) -> None:
    """Skip for want of `what`, or fail where KANEFLEX_REQUIRE_PEERS=1 promises that it is there (CI)."""
    if REQUIRED:
        pytest.fail(f"{what} is missing though KANEFLEX_REQUIRE_PEERS=1; {cure}")
    pytest.skip(f"{what} is not installed; {cure}")


@pytest.fixture(scope="session")
def peer() -> Callable[[str], ModuleType]:
    """`peer("exudyn")`: the imported package of another program to compare with."""

    def imported(name: str) -> ModuleType:
        try:
            return importlib.import_module(name)
        except ModuleNotFoundError as error:
            if error.name != name:
                raise
            absent(name, f"pip install 'kaneflex[{EXTRAS.get(name, name)}]'")

    return imported


@pytest.fixture(scope="session")
def pdflatex() -> str:
    """The path of pdflatex. Not demanded in CI: what a document says is read back without typesetting it."""
    found = shutil.which("pdflatex")
    if found is None:
        pytest.skip("pdflatex is not installed; the documents are read back, but not typeset")
    return found


@pytest.fixture(scope="session")
def compiler() -> str:
    """The path of a C compiler."""
    from kaneflex.support.c_compiler import c_compiler

    if not (found := c_compiler()):
        absent("a C compiler", "install gcc or clang, or name one in CC")
    return found[0]
