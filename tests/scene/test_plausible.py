"""Numbers that no machine has are warned of, those of the shipped scenes are not."""

import math
from importlib.resources import files
from pathlib import Path

import pytest

from kaneflex.scene import Scene, read_scene, scene_of, with_settings
from kaneflex.scene.plausible import implausible, stubby_links

SCENES = [Path(entry.name) for entry in files("kaneflex.scenes").iterdir()]
SHIPPED = sorted(path.stem for path in SCENES if path.suffix == ".toml")
STUBBY = {"engine-elastic-crank", "engine-paper"}
"""Of the paper's own choice: its crank is 40 mm long, and its section has a radius of gyration of 16 mm."""


@pytest.mark.parametrize(("name", "settings", "told"), [
    ("engine", ["rod.length=136 m"], "bodies.rod.length is 3400 times bodies.crank.length, 136 m and 0.04 m"),
    ("engine", ["main.speed=1e9 rpm"], "drives.main.speed = 1e+09 rpm moves crank at 4.189e+06 m/s"),
    ("stick-slip", ["way.speed=1e4 m/s"], "guides of machines stay far below 2000 m/s; a plain number is in m/s"),
    ("four-bar", ["coupler.E=71"], "bodies.coupler.beam.E = 71 Pa is outside the range of materials"),
    ("four-bar", ["coupler.rho=0.05"], "bodies.coupler.beam.rho = 0.05 kg/m^3 is outside the range of materials"),
    ("four-bar", ["coupler.rho=2.7"], "rho = 2.7 kg/m^3 give a speed of sound of 1.62e+05 m/s"),
    ("engine", ["rod.I=7008"],
     "bodies.rod.beam.I = 7008 m^4 means a section 9.15 m wide, but the link is only 0.137 m long"),
    ("engine", ["rod.I=1", "rod.mass=none", "rod.A=1.4e-4"], "bodies.rod.beam.I = 1 m^4 with A = 0.00014 m^2 "
     "means a radius of gyration of 84.5 m, but the link is only 0.137 m long: a plain number is in m^4"),
    ("engine", ["rod.I=7e-4"],
     "bodies.rod.beam.I = 0.0007 m^4 with A = 0.0001423 m^2 means a radius of gyration of 2.22 m"),
    ("spatial-slider-crank-elastic", ["rod.beam.section=none", "rod.beam.A=28 mm^2", "rod.beam.I_y=64 mm^4",
     "rod.beam.I_z=64e-6", "rod.beam.J=100 mm^4"], "bodies.rod.beam.I_z = 6.4e-05 m^4 with A = 2.8e-05 m^2"),
    ("engine", ["rod.beam.I=none", "rod.mass=none", 'rod.beam.section={rectangle = ["20 mm", "8 mm"]}',
     "rod_mid_strain.fibre=11 mm"], "sensors.rod_mid_strain.fibre: 0.011 m from the axis is outside of the section at"),
    ("engine", ["gravity=[0, -9810]"], "gravity is 9810 m/s^2, where the earth's is 9.81"),
    ("engine", ["crank.inertia=300.0"], "bodies.crank.inertia = 300 kg m^2 of 0.952 kg"),
    ("engine", ["piston.mass=none"], "bodies.piston has no mass: it adds no inertia force and no weight"),
    ("spatial-slider-crank", ["rod.inertia=[1.0, 4000.0, 4000.0]"], "bodies.rod.inertia = 4000 kg m^2"),
    ("engine", ["damping.rayleigh.ratio=2"], "damping.rayleigh.ratio = 2 is 200% of the critical damping"),
    ("engine", ["damping.rayleigh=none", "damping.modal.ratio=[0.02, 3]"], "damping.modal.ratio = 3 is 300% of"),
    ("spatial-slider-crank-elastic", ["rod.length=300"], "bodies.rod.length"),
    ("spatial-slider-crank-elastic", ["rod.beam.section=none", "rod.beam.A=28 mm^2", "rod.beam.I_y=64 mm^4",
     "rod.beam.I_z=64 mm^4", "rod.beam.J=1280 mm^4"], "bodies.rod.beam.J = 1.28e-09 m^4 is more than I_y + I_z"),
])  # fmt: skip
def test_what_is_hardly_meant_is_warned_of(name, settings, told):
    (warning,) = implausible(with_settings(read_scene(name), settings))
    assert told in warning


def test_what_may_be_meant_is_not():
    """Rubber and lead, the moon's gravity and a centrifuge's, a watch and a crane, a turbine's rim at 600 m/s."""
    for name, settings in (
        ("four-bar", ["coupler.E=1 MPa", "coupler.rho=1100 kg/m^3"]),
        ("four-bar", ["coupler.E=16 GPa", "coupler.rho=11340 kg/m^3"]),
        ("engine", ["gravity=[0, -1.62]"]),
        ("engine", ["main.speed=1.4e5 rpm"]),
        ("four-bar", ["coupler.A=35.7 mm^2", "coupler.I=36000 mm^4"]),  # a tube of 100 mm, its wall 0.114 mm thick
        ("engine", ["crank.length=0.4 mm", "rod.length=1.37 mm"]),
    ):
        assert not implausible(with_settings(read_scene(name), settings)), settings


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scenes_are_plausible(name):
    scene = read_scene(name)
    assert not implausible(scene)
    assert bool([*stubby_links(scene.bodies, scene.is_spatial)]) == (name in STUBBY)


def test_beams_that_are_none_are_noted():
    """A square section's radius of gyration is its side over sqrt(12); shear adds 3 E I / (kappa G A l^2) to a tip."""

    def noted(length: float, *theory: str) -> list[str]:
        settings = [f"coupler.length={length} mm", "coupler.A=100 mm^2", "coupler.I=833.333333 mm^4", *theory]
        return [*stubby_links(with_settings(read_scene("four-bar"), settings).bodies, False)]

    gyration = 10.0 / math.sqrt(12.0)
    (note,) = noted(5.0 * gyration)
    share = 3.0 * 2.0 * 1.3 / (5.0 / 6.0) / 5.0**2
    assert "bodies.coupler.length is only 5 radii of gyration" in note and f"some {share:.0%} to its bending" in note
    shear = ("coupler.theory=timoshenko", "coupler.nu=0.3", "coupler.kappa=0.83")
    assert not noted(5.0 * gyration, *shear) and not noted(10.1 * gyration)
    (note,) = noted(2.5 * gyration, *shear)
    assert "too short for any beam theory" in note
    (note,) = stubby_links(bar([0.01, 0.5]).bodies, True)  # bends easily one way, and the other way hardly
    assert "bodies.bar.length is only 6.9 radii of gyration" in note


def bar(rectangle: list[float], **sensors: object) -> Scene:
    """A bar in space, 1 m long."""
    return scene_of({
        "schema": 1,
        "bodies": {"bar": {"length": 1, "beam": {"material": "steel", "section": {"rectangle": rectangle}}}},
        "joints": {"root": {"revolute": ["ground", "bar.start"], "axis": [0, 0, 1]}},
        "drives": {"root": {"speed": 1}}, "sensors": sensors, "solve": {"duration": 1},
    })  # fmt: skip


@pytest.mark.parametrize(("fibre", "told"), [([0.0, 0.05], "is 0.01 m wide"), ([0.05, 0.0], "is 0.03 m high")])
def test_a_gauge_beside_its_section_is_warned_of_in_space(fibre, told):
    (warning,) = implausible(bar([0.03, 0.01], gauge={"strain": "bar.mid", "fibre": fibre}))
    assert told in warning
