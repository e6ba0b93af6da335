"""What holds a mechanism is decided by its supports, never by how stiff its links are."""

import pytest
from runs import derived_on_the_fly, model

from kaneflex import load, simulate, with_settings
from kaneflex.solve.quasistatic import mechanism_modes

WELDED = """
schema = 1
bodies.base = {length = "1 m", pose = {at = [0, 0], angle = 0}, beam = {E = 2.1e11, rho = 7850, A = 1e-3, I = 1e-8}}
bodies.tip = {length = "1 m", pose = {at = [1, 0], angle = 0}, beam = {E = 2.1e11, rho = 7850, A = 1e-3, I = 1e-8}}
joints.wall = {weld = ["ground", "base.start"]}
joints.seam = {weld = ["base.end", "tip.start"]}
loads.push = {force_on = "tip.end", direction = [0, 1], value = "1e-3 N"}
sensors.end = {displacement = "tip.end", component = "y"}
sensors.wall_y = {joint_force = "wall", component = "y"}
solve = {preset = "quasistatic", duration = "1 s", steps = 4}
"""


def test_a_clamped_structure_is_not_free_flying_however_stiff_a_link_is(tmp_path):
    """Two welded beams: tip by F (b^3 / (3 E I_b) + (a^3 / 3 + a^2 b + a b^2) / (E I_a)), wall by equilibrium."""
    found = derived_on_the_fly(WELDED, tmp_path)
    for ratio, elements in ((1e6, 64), (1e9, 16)):
        settings = [f"bodies.tip.beam.I={1e-8 * ratio!r}", f"base.elements={elements}", f"tip.elements={elements}"]
        stiff = load(with_settings(found.scene, settings))
        assert mechanism_modes(stiff, 0.0) == 0
        with pytest.warns(match="the stiffness matrix is ill-conditioned"):
            series = simulate(stiff).series
        # as well as such a condition allows: rounding differs from processor to processor
        assert series["end"].values == pytest.approx(1e-3 * (7 / 3 + 1 / 3 / ratio) / 2.1e3, rel=0.1)
        assert abs(series["wall_y"].values) == pytest.approx(1e-3, rel=0.1)


@pytest.mark.parametrize(("scene", "settings", "free"), [
    ("free-frame", (), 3),
    ("engine-elastic-crank", ("drives.main.rotation=free",), 1),
    ("engine-elastic-crank", (), 0),
    ("pin-ended-cross", (), 0),
    ("four-bar", (), 0),
])  # fmt: skip
def test_motions_that_deform_nothing_are_counted_by_geometry(scene, settings, free):
    found = model(scene, *settings)
    assert mechanism_modes(found, 0.3 * found.options.duration) == free
