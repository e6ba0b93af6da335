"""Modal data of links as arrays: what `kaneflex modes --export` writes."""

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import kaneflex
from kaneflex.cli import main
from kaneflex.coupled.modal_data import ARRAYS, POINT_ARRAYS, modal_data, unpacked
from kaneflex.coupled.moments import link_numbers
from kaneflex.scene import read_scene

PAGE = (Path(__file__).parent.parent / "docs" / "commands.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def model():
    return kaneflex.load(read_scene("slider-crank-150-coupled"))


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    folder = tmp_path_factory.mktemp("modal")
    result = CliRunner().invoke(main, ["modes", "slider-crank-150-coupled", "--export", str(folder / "data")])
    assert result.exit_code == 0, result.output
    return folder / "data"


def test_the_arrays_are_those_of_the_link(model, exported):
    data = dict(np.load(exported / "rod.npz"))
    rod = model.scene.bodies["rod"]
    assert float(data["mass"]) == pytest.approx(rod.mass, rel=1e-12)
    assert float(data["mass_X"]) == pytest.approx(rod.mass * rod.length / 2, rel=1e-12)
    assert float(data["mass_X_X"]) == pytest.approx(rod.mass * rod.length**2 / 3, rel=1e-12)
    omega = np.sqrt(data["stiffness"][-3:] / np.diag(data["mass_w_w"]))
    exact = (np.arange(1, 4) * np.pi / rod.length) ** 2 * np.sqrt(rod.E_I / rod.rho_A)
    assert omega == pytest.approx(exact, rel=3e-3)
    assert data["points"].tolist() == ["start", "mid", "end"]
    # int w'^2 of a sine of height 1: pi^2 / (2 L) over the length, half of that to the middle.
    assert data["H"][:, 0, 0] == pytest.approx(np.array([0, 0.5, 1]) * np.pi**2 / (2 * rod.length), rel=1e-3)


def test_arrays_hold_every_number_of_the_link(model):
    link = model.coupled.links["rod"]
    numbers = link_numbers(model.scene, link, model.coupled.shapes["rod"])
    assert unpacked(modal_data(model.scene, link, model.coupled)) == pytest.approx(numbers, rel=1e-15)


def test_the_page_names_every_array(exported):
    table = re.search(r"^\| array \|.*\n\|[ -|]*\|\n((?:\|.*\n)+)", PAGE, flags=re.MULTILINE)[1]
    named = [name for line in table.splitlines() for name in re.findall(r"`(\w+)`", line.split("|")[1])]
    assert named == list(dict.fromkeys(named))
    assert set(named) == set(np.load(exported / "rod.npz")) == {"format", "length", "points", *ARRAYS, *POINT_ARRAYS}


def test_what_the_export_refuses(exported):
    again = CliRunner().invoke(main, ["modes", "slider-crank-150-coupled", "--export", str(exported)])
    assert again.exit_code == 2 and "the file exists" in again.output
    rigid = CliRunner().invoke(main, ["modes", "double-pendulum", "--export", str(exported)])
    assert rigid.exit_code == 2 and "no body has a beam" in rigid.output
