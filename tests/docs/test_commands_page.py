"""docs/commands.md and docs/export.md: commands run, Python prints what it says, tables have the files' names."""

import re
from pathlib import Path
from textwrap import dedent

import numpy as np
import pytest
from command_line import cli, unrendered
from pages import check_printed, commands, page

from kaneflex.solve.validity import FEWEST_STEPS

TEXT = page("commands.md", "export.md")
COMMANDS = commands(TEXT)


@pytest.fixture(scope="module", autouse=True)
def folder(tmp_path_factory, derived_once):
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("page"))
        unrendered(patch)
        yield


@pytest.fixture(scope="module")
def outputs(folder) -> dict[str, str]:
    """What each command of the page prints, on stderr too, run one after the other in one folder."""
    found = {}
    for command in COMMANDS:
        result = cli(*command)
        assert result.exit_code == 0, (command, result.output)
        found[" ".join(command)] = result.output
    return found


def test_every_command_runs_and_writes_its_files(outputs):
    files = {path.name for path in Path().iterdir()}
    pictures = {"press.png", "engine.svg", "ways.png", "explored.png", "engine-bode.png"}
    of_engine = {f"engine{end}" for end in (".npz", ".mat", ".tex", "-c", ".fmu")}
    assert files == pictures | of_engine | {"press.toml", "modal", "motor-c", "moved", "engine_model.py"}
    used = {"new", "show", "check", "explore", "linearise", "equations", "derive", "export", "modes", "run"}
    assert {command for command, *_ in COMMANDS} == used


def test_the_motion_for_paraview_has_the_arrays_of_the_table(outputs, peer):
    meshio = peer("meshio")
    section = TEXT[TEXT.index("## run: a motion for ParaView") : TEXT.index("## modes: natural frequencies")]
    files = sorted(Path("moved/vtk").glob("*.vtu"))
    assert len(files) == 100 and files[0].name in section and Path("moved/vtk/motion.pvd").is_file()
    found = meshio.read(files[50])
    assert {*found.point_data, *found.cell_data} == set(re.findall(r"^\| `(\w+)` \|", section, flags=re.MULTILINE))
    rod = next(block.data for block in found.cells if block.type == "line")
    assert len(rod) == 1 + 32 and abs(found.point_data["displacement"]).max() > 1e-4


def test_the_count_is_printed_as_the_page_shows_it(outputs):
    shown = re.search(r"    degrees of freedom\n(?:      .*\n)+", TEXT)[0]
    expected = [line.removeprefix("    ") for line in shown.splitlines()]
    printed = outputs["show press.toml --at main=30deg"].splitlines()
    first = printed.index(expected[0])
    assert printed[first : first + len(expected)] == expected
    assert printed[first + len(expected)] == "as shown"  # the joints' places follow, as the page says


def test_export_says_what_the_page_shows(outputs):
    section = TEXT[TEXT.index("## export: an FMU") :]
    (shown,) = re.findall(r"^    (FMI .*)$", section, flags=re.MULTILINE)
    (said,) = (said for command, said in outputs.items() if command.startswith("export "))
    assert shown in said.splitlines()


def test_check_says_what_the_page_shows(outputs):
    section = TEXT[TEXT.index("## check: doubtful numbers") : TEXT.index("## explore: sliders")]
    shown = re.findall(r"^    (.*)$", section, flags=re.MULTILINE)
    (said,) = (said for command, said in outputs.items() if command.startswith("check "))
    assert len(shown) == 3 and {*shown} <= {*said.splitlines()}
    limits = re.findall(r"^\| (\w+): .* \| .* \|$", section, flags=re.MULTILINE)
    assert (limits.count("Warning"), limits.count("Note")) == (7, 2) and f"fewer than {FEWEST_STEPS:g}" in section


def test_the_model_in_one_file_is_as_the_page_says(outputs, capsys):
    section = TEXT[TEXT.index("## derive: a model in one file") : TEXT.index("## derive: C code\n")]
    (program,) = (dedent(block) for block in re.findall(r"\n\n((?:    .*\n|\n)+)(?=\n?\S)", section))
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(".")
        exec(compile(program, "commands.md", "exec"), {})
    assert float(capsys.readouterr().out) == pytest.approx(0.0, abs=1e-6)  # the crank stands at its dead centre


def test_the_file_has_the_names_of_the_table(outputs):
    state_space = TEXT[TEXT.index("## linearise: a state space") : TEXT.index("## equations: LaTeX")]
    table = re.findall(r"^\| (`.*?) \| ", state_space, flags=re.MULTILINE)
    names = {name for cell in table for name in re.findall(r"`(\w+)`", cell)}
    with np.load("engine.npz") as found:
        assert set(found) == names


def test_the_python_prints_what_its_comment_says(capsys):
    assert check_printed(TEXT, capsys)["response"].shape == (1, 2)


def test_help_names_the_commands():
    shown = cli("--help").stdout
    for command in {command for command, *_ in COMMANDS}:
        assert re.search(rf"^  {command} ", shown, flags=re.MULTILINE)
