"""Slopes of the coupled equations: the emitted kernels against differences of the equations' own."""

import numpy as np
import pytest
from command_line import cli
from runs import model

from kaneflex.mechanism.floating_frames import shape_counts
from kaneflex.multibody.binding import coupled_tangent_text, find_coupled_tangent_module
from kaneflex.multibody.linearisation import kernels
from kaneflex.scene import read_scene

STEP = 1e-4


@pytest.mark.parametrize(
    ("scene", "settings"),
    [
        ("four-bar-motor", ()),
        ("engine", ("solve.preset=coupled", "solve.modes=1")),  # its gas is a table, its bore a guide
    ],
)
def test_slopes_are_differences_of_the_residuals(scene, settings):
    found = model(scene, *settings)
    system = found.coupled
    slopes, _ = find_coupled_tangent_module(found.scene, shape_counts(found.scene), lambda stage: None)
    n, m, rng = system.size, len(system.constraints), np.random.default_rng(5)
    q, v, a, multipliers = (rng.uniform(-1.0, 1.0, size) for size in (n, n, n, m))
    p = system.parameters
    places = [k for k, (path, _) in enumerate(system.module.PARAMETERS) if not path.endswith((".table", ".branch"))]
    blocks = np.arange(len(system.module.PARAMETERS), len(p))
    p_slope, t, t_slope = np.zeros(len(p)), 0.31, 0.17
    p_slope[places] = rng.uniform(-1.0, 1.0, len(places)) * p[places]
    for name in system.module.TABLES:  # values move, breakpoints and the number of intervals stay
        first = int(p[[path for path, _ in system.module.PARAMETERS].index(f"{name}.table")])
        values = np.arange(first + 3 + int(p[first]), first + 3 + 5 * int(p[first]))
        p_slope[values] = 0.1 * p[values]
        assert set(values) <= set(blocks)

    def residuals(step):
        moved = type(system)(system.module, p + step * p_slope, system.links, system.shapes)
        at = kernels(moved, t + step * t_slope, q, v, a, multipliers)
        return np.concatenate([at.M @ a - at.f - at.G.T @ multipliers, at.G @ a + at.gamma, at.g, at.g_t + at.G @ v])

    R, g, rate = np.zeros(n + m), np.zeros(m), np.zeros(m)
    slopes.residual_slope(t, t_slope, q, v, a, multipliers, p, p_slope, R)
    slopes.closing_slope(t, t_slope, q, v, p, p_slope, g, rate)
    expected = sum(
        weight * residuals(share * STEP) for share, weight in ((-2, 1.0), (-1, -8.0), (1, 8.0), (2, -1.0))
    ) / (12 * STEP)
    for part in (slice(0, n), slice(n, None)):
        size = abs(expected[part]).max()
        assert size > 0
        whole = np.concatenate([R, g, rate])
        np.testing.assert_allclose(whole[part], expected[part], rtol=0, atol=1e-8 * size)


def test_the_module_can_be_written(tmp_path):
    path = tmp_path / "slopes.py"
    assert cli("derive", "elastic-pendulum", "--coupled", "--slopes", "-o", path).exit_code == 0
    scene = read_scene("elastic-pendulum")
    assert path.read_text() == coupled_tangent_text(scene, shape_counts(scene))
    assert "Made by: kaneflex derive SCENE --coupled --slopes -o FILE.py" in path.read_text()
