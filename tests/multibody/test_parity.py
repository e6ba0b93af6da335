"""Planar scenes lifted into space and turned by any rotation: where both engines agree, and where they do not yet."""

import pytest
from lifting import lifted
from parity import PRESETS, RejectedInPlane, compared, planar, planar_scenes, random_turn
from runs import solved

from kaneflex import SceneError, load, scene_of, with_settings
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
