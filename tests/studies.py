"""Studies of sweeps as tests write them, and what their folders hold."""

from pathlib import Path

import xarray

from kaneflex import sweep
from kaneflex.study.plan import Plan, make_plan


def plan_of(folder: Path, text: str) -> Plan:
    """The plan of a study with this text, whose file then is in the folder."""
    (folder / "study.toml").write_text(text)
    return make_plan(folder / "study.toml")


def dataset(folder: Path) -> xarray.Dataset:
    with xarray.open_dataset(folder / "sweep.nc", engine="scipy") as found:
        return found.load()


def swept_in(folder: Path, text: str) -> tuple[Plan, xarray.Dataset]:
    plan = plan_of(folder, text)
    sweep(plan, folder / "out")
    return plan, dataset(folder / "out")
