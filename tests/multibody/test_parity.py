"""Planar scenes lifted into space and turned by any rotation: where both engines agree, and where they do not yet."""

import pytest
from lifting import lifted
from parity import PRESETS, RejectedInPlane, compared, planar, planar_scenes, random_turn
from runs import solved

from kaneflex import SceneError, load, read_scene, scene_of, with_settings
from kaneflex.scene.sensors import SECTION_KINDS

LEFT_OUT = {
    "engine-rig-clearance": "clearances", "slider-crank-clearance": "clearances", "free-frame": "poses",
    "free-rod": "poses", "pin-ended-cross": "poses", "mathieu": "it stays straight: its deflection is rounding",
}  # fmt: skip
"""Scenes with what is modelled in the plane alone, or without a number to compare."""


def rejected_in_space(sensor, preset):
    """True if space has no number for a sensor of the plane: the torque of a free joint, or a reaction of rigid bodies
    with redundant constraints."""
    return sensor.kind in ("joint_force", "drive_torque") or (preset == "rigid" and sensor.kind in SECTION_KINDS)


@pytest.mark.exhaustive(share=12)
@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("name", [name for name in planar_scenes() if name not in LEFT_OUT])
def test_a_lifted_scene_gives_the_planar_numbers(name, preset):
    """Within the errors that both runs estimate for themselves."""
    flat = planar(name, preset)
    try:
        found = compared(flat, random_turn(name))
    except RejectedInPlane as rejected:
        error = rejected.args[0]
        pytest.skip(f"rejected in the plane: {error.key}")
    assert all(rejected_in_space(flat.sensors[sensor.partition("_in_")[0]], preset) for sensor in found.rejected)
    assert [each for each in found.sensors if not each.agrees] == []


@pytest.mark.parametrize("preset", ["linear", "stiffened", "quasistatic"])
def test_a_body_without_joints_deforms_in_space_as_in_the_plane(preset):
    """Its rigid motion is part of its displacements in the plane: without damping they are the only difference."""
    flat = with_settings(planar("free-rod", preset), ["solve.duration=0.5 ms", "solve.steps=500"])
    flat = scene_of({key: table for key, table in flat.raw.items() if key != "damping"})
    deep = solved(scene_of(lifted(flat, random_turn("free-rod")) | {"solve": flat.raw["solve"]}))
    for name in ("bow", "mid_moment", "mid_acceleration"):
        wanted = solved(flat)[name].values
        assert abs(deep[name].values - wanted).max() < 1e-5 * abs(wanted).max()


def test_inertia_relief_in_closed_form():
    """A slow blow F in the middle of a free beam of mass m: acceleration F / m, bending moment F l / 8."""
    law = "loads.blow.law=1000 * exp(-((t - 0.025) / 2e-3)**2)"
    found = solved(with_settings(read_scene("free-rod"), ["solve.preset=quasistatic", "solve.duration=50 ms", law]))
    assert found["mid_acceleration"].values.max() == pytest.approx(1000 / 0.153, rel=1e-3)
    assert found["mid_moment"].values.min() == pytest.approx(-1000 * 0.137 / 8, rel=1e-6)


def test_inertia_relief_of_a_model_of_few_modes():
    """A strut that stays straight, of one mode, has no load in it."""
    found = solved(with_settings(read_scene("mathieu"), ["solve.preset=quasistatic"]))
    assert abs(found["mid_transverse"].values).max() < 1e-6


def test_a_lumped_mass_on_a_link_that_shortens_keeps_its_own_inertia():
    """Links bend by a sixtieth of their length: what shortens them moves the masses at their ends, too."""
    settings = ["masses.at_first.mass=96 g", "masses.at_second.mass=96 g", "solve.start=zero"]
    flat = with_settings(planar("four-bar", "coupled"), settings)
    found = compared(flat, random_turn("four-bar"))
    assert max(each.peak for each in found.sensors if each.name == "coupler_mid") > 4e-3
    assert [each for each in found.sensors if not each.agrees] == []


def test_a_drive_with_a_free_elastic_rotation_prescribes_the_motion_of_a_rigid_body():
    """A rigid crank has no elastic rotation to leave free: in space it turned by itself, and the run was unstable."""
    flat = with_settings(planar("engine", "stiffened"), ["drives.main.rotation=free"])
    found = compared(flat, random_turn("engine"))
    assert not found.rejected and [each for each in found.sensors if not each.agrees] == []
    assert next(each.peak for each in found.sensors if each.name == "crank_torque") > 500.0


@pytest.mark.parametrize("preset", ["linear", "stiffened"])
def test_a_motion_that_does_not_repeat_is_refused_for_the_same_reason(preset):
    """The block of the engine starts off its cycle, and repeats its motion to 1e-4."""
    flat, said = planar("engine-block", preset), []
    message = r"^solve\.start = 'periodic': up moves freely, and does not return after a cycle\. "
    for scene in (flat, scene_of(lifted(flat, random_turn("engine-block")) | {"solve": flat.raw["solve"]})):
        with pytest.raises(SceneError, match=message) as error:
            solved(scene)
        said.append(error.value)
    assert said[0].cure == said[1].cure


def test_sections_of_statically_indeterminate_rigid_links_are_refused():
    flat = planar("four-bar", "rigid")
    given = lifted(flat, random_turn("four-bar")) | {"solve": flat.raw["solve"]}
    said = r"coupler_force\.axial_force.*: first, .* have redundant constraints: first\..* is statically indeterminate"
    with pytest.raises(SceneError, match=said):
        load(scene_of(given))


def test_a_drive_with_a_free_elastic_rotation_exerts_no_torque_on_an_elastic_link():
    flat = with_settings(planar("engine-elastic-crank", "quasistatic"), ["drives.main.rotation=free"])
    given = lifted(flat, random_turn("engine-elastic-crank")) | {"solve": flat.raw["solve"]}
    assert not solved(scene_of(given))["crank_torque"].values.any()
