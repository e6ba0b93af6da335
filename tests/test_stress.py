"""The picture of stresses at the edges of links."""

import numpy as np
import pytest

import kaneflex
from kaneflex.plots.stress import edge_stresses, figures
from kaneflex.plots.view import view

L, WIDTH, HEIGHTS, FORCE, PULL = 0.8, 12e-3, (30e-3, 20e-3), 90.0, 5e3
CANTILEVER = f"""
schema = 1
gravity = [0, 0]
[bodies]
arm = {{length = {L}, beam = {{material = "steel", theory = "timoshenko", yield_strength = "250 MPa", elements = 8, \
SECTION}}}}
[joints]
root = {{weld = ["ground", "arm.start"]}}
[loads]
down = {{force_on = "arm.end", direction = [0, -1], law = "{FORCE} * (1 - cos(10 * t)) / 2"}}
pull = {{force_on = "arm.end", direction = [1, 0], value = {PULL}}}
[sensors]
tip = {{displacement = "arm.end", component = "y"}}
[solve]
preset = "quasistatic"
duration = "0.6283185307179586 s"
steps = 20
terms = {{geometric = false}}
"""
SHAPED = f'section = {{rectangle = [{HEIGHTS[0]}, {WIDTH}]}}, taper = {{rectangle = [{HEIGHTS[1]}, {WIDTH}]}}'


def solved(section: str):
    text = CANTILEVER.replace("\\\n", "").replace("SECTION", section)
    return kaneflex.simulate(kaneflex.load(kaneflex.scene_of(text)))


def test_a_cantilever_with_a_force_at_its_tip():
    """N / A +- F (L - x) h / (2 I), half-way through, where the force is largest; the upper edge is drawn out.

    Of the undeformed arm, without what the pull takes off the moment.
    """
    solution = solved(SHAPED)
    edges = edge_stresses(view(solution), "arm")
    h = np.interp(edges.x, (0.0, L), HEIGHTS)
    bent, pulled = 6.0 * FORCE * (L - edges.x) / (WIDTH * h**2), PULL / (WIDTH * h)
    assert edges.upper[:, 10] == pytest.approx(pulled + bent, rel=1e-6)
    assert edges.lower[:, 10] == pytest.approx(pulled - bent, rel=1e-6)
    assert edges.upper[:, 0] == pytest.approx(pulled, rel=1e-6)

    (panel,) = figures(solution)["stress"].axes
    expected = (pulled + bent).max()
    assert panel.get_title() == (
        f"arm: {1e-6 * expected:.3g} MPa at 0 mm, time 0.3142 s, {expected / 250e4:.3g} % of 250 MPa"
    )
    drawn = [line.get_ydata() for line in panel.lines[:4]]
    assert drawn[1] == pytest.approx(1e-6 * (pulled + bent), rel=1e-6)
    assert drawn[2] == pytest.approx(1e-6 * (pulled - bent), rel=1e-6)


def test_sections_without_a_shape_have_no_edges():
    assert figures(solved('A = "300 mm^2", I = "1e4 mm^4", kappa = 0.85')) == {}
