"""Pictures keep the extremes of vibrations that are faster than what they can show, or say that they don't."""

import json
import xml.etree.ElementTree as ET
from functools import cache

import numpy as np
import pytest
from runs import model, solved

from kaneflex import Solution, scene_of
from kaneflex.integrate.system import Outcome, Trajectory
from kaneflex.plots import animation, displacements
from kaneflex.plots.mechanism import scenery
from kaneflex.plots.style import styled
from kaneflex.plots.view import FRAMES, frames_of, view
from kaneflex.plots.vtk import write_vtk
from kaneflex.report.page import _as_json, _data
from kaneflex.report.summary import summarise
from kaneflex.response.time_statistics import envelope, frames, missed, thinned

COUNT = 20_001
SINE = {60: 60.05, 181: 181.05, 1500: 1500.1}
"""Samples -> periods of a sine over the run that so few evenly spaced samples show as a slow wave."""


def sine(periods, count=COUNT):
    return np.sin(2 * np.pi * periods * np.linspace(0.0, 1.0, count))


@cache
def vibrating(periods, count=COUNT):
    """The engine's rod, all coordinates of which swing as a sine."""
    found = model("engine")
    times = np.linspace(0.0, found.options.duration, count)
    z = 1e-5 * sine(periods, count)[:, None] * np.ones(len(found.coordinates))
    zero = np.zeros_like(z)
    return Solution(found, Trajectory(times, z, zero, zero, Outcome.COMPLETED, "", None, 0.0), 0.0)


@pytest.mark.parametrize("samples", SINE)
def test_chosen_instants_keep_the_extremes_of_every_part_of_a_run(samples):
    curve = sine(SINE[samples])[None]
    even = np.linspace(0, COUNT - 1, samples).round().astype(int)
    for part in np.array_split(np.arange(COUNT), 10):
        assert np.ptp(curve[0, np.intersect1d(even, part)]) < 1.2  # evenly spaced, each tenth of the run would be wrong
    at, parts = thinned(curve, samples)
    assert parts and len(at) <= samples + 2 and {0, COUNT - 1} <= {*at}
    for part in np.array_split(np.arange(COUNT), 10):
        assert np.ptp(curve[0, np.intersect1d(at, part)]) == pytest.approx(np.ptp(curve[0, part]), abs=2e-3)
    _, lower, upper = envelope(curve, samples // 3)
    assert (lower < -0.98).all() and (upper > 0.98).all()


def test_what_evenly_spaced_instants_show_stays_evenly_spaced():
    slow, still = np.sin(np.linspace(0.0, 20.0, COUNT)), np.full(COUNT, 3.0)
    still[::2] += 1e-15  # rounding is no vibration
    at, parts = thinned(np.array([slow, still]), 300)
    assert parts == 0
    even = np.linspace(0, COUNT - 1, 300).round().astype(int)
    assert {*even} <= {*at} and len(at) <= 304
    assert {slow.argmin(), slow.argmax()} <= {*at}
    assert (frames(slow[None], 60, periodic=True) == np.linspace(0, COUNT - 1, 60, endpoint=False).round()).all()


def test_missing_values_hide_no_extreme():
    curve = sine(181.05)
    curve[5000:5100] = np.nan
    at, _ = thinned(curve[None], 181)
    assert np.nanmax(curve[at]) == np.nanmax(curve) and np.nanmin(curve[at]) == np.nanmin(curve)


def test_surfaces_show_the_envelopes_of_what_is_too_fast_for_them():
    """Data that were drawn: facets' corners [um], and the title says which surfaces these are."""
    solution = vibrating(SINE[181], 4001)
    rod = np.array([solution.motion.displacement("rod", (x, 0.0))[0][:2] for x in np.linspace(0.0, 0.137, 33)])
    with styled():
        figure = displacements.surfaces(solution)["surfaces_rod"]
    for axes, field in zip(figure.axes[:2], rod.swapaxes(0, 1), strict=True):
        assert "lower and upper envelope, 90 intervals" in axes.get_title("center")
        factor = {"mm": 1e-3, "µm": 1e-6}[axes.get_zlabel().split("[")[1][:-1]]
        lower, upper = (factor * surface._faces[..., 2] for surface in axes.collections)
        assert lower.min() == pytest.approx(field.min(), rel=1e-12)
        assert upper.max() == pytest.approx(field.max(), rel=1e-12)
        assert (lower[:, :] <= upper[:, :]).all()
    resolved = displacements.surfaces(vibrating(8.0, 4001))["surfaces_rod"]
    assert all(len(axes.collections) == 1 and "envelope" not in axes.get_title("center") for axes in resolved.axes)


def test_curves_are_drawn_over_all_instants():
    solution = vibrating(SINE[1500])
    assert len(view(solution).instants) == COUNT
    with styled():
        middle = displacements.figures(solution)["mid_rod"].axes[0].get_lines()[0]
    own = solution.motion.displacement("rod", (0.0685, 0.0))[0][0]
    assert 1e-3 * middle.get_ydata() == pytest.approx(own, rel=1e-9)


def test_the_page_of_a_run_keeps_the_extremes_of_its_curves():
    solution = vibrating(SINE[1500])
    drawn = json.loads(_as_json(_data(solution, summarise(solution), ())))
    values = 1e-3 * np.array(drawn["sensors"]["tip_axial"]["values"])
    times, whole = np.array(drawn["axes"][0]["values"]), solution.series["tip_axial"].values
    assert drawn["sensors"]["tip_axial"]["unit"] == "mm" and len(values) < 1600
    for part in np.split(np.arange(COUNT - 1), 10):
        inside = (times >= solution.times[part[0]]) & (times <= solution.times[part[-1]])
        assert values[inside].max() == pytest.approx(whole[part].max(), rel=1e-3)
        assert values[inside].min() == pytest.approx(whole[part].min(), rel=1e-3)


def test_films_keep_the_extremes_and_say_what_they_leave_out(tmp_path, peer):
    solution = vibrating(SINE[FRAMES])
    shown = frames_of(view(solution), FRAMES)
    assert shown.note == f" ({FRAMES} of {COUNT} instants, some motion is too fast for them)"
    whole, film = (
        np.array([motion.displacement("rod", (x, 0.0))[0][:2] for x in solution.model.links["rod"].nodes])
        for motion in (solution.motion, shown.motion)
    )
    assert (film.min(), film.max()) == pytest.approx((whole.min(), whole.max()), rel=1e-4)
    even = np.linspace(0, COUNT - 1, FRAMES, endpoint=False).round()
    assert (shown.instants != even).sum() == 2  # those of the extremes
    assert abs(shown.instants - even).max() <= COUNT / FRAMES
    assert frames_of(view(vibrating(4.0)), FRAMES).note == ""
    meshio = peer("meshio")
    index = write_vtk(solution, tmp_path)
    assert f"{FRAMES} of {COUNT} instants, some motion is too fast for them" in index.read_text()
    files = [each.get("file") for each in ET.parse(index).iter("DataSet")]
    largest = max(abs(meshio.read(tmp_path / file).point_data["displacement"]).max() for file in files)
    assert largest >= 0.999 * abs(whole).max()


def test_a_film_states_it_in_its_title(tmp_path, monkeypatch):
    titles, recorded = [], animation.recorded

    def noting(axes, *given):
        titles.append(axes.figure.get_suptitle())
        return recorded(axes, *given)

    monkeypatch.setattr(animation, "recorded", noting)
    with styled():
        animation.animate(vibrating(SINE[FRAMES]), tmp_path / "film.gif", frames=6)
    assert titles[0].replace("\n", " ").endswith(f"(6 of {COUNT} instants, some motion is too fast for them)")


def test_the_frame_of_a_picture_holds_what_turns_as_often_as_it_is_looked_at():
    """After 180 turns, 180 evenly spaced instants all show the crank at its first angle."""
    turning = {"schema": 1, "like": "four-bar", "drives": {"main": {"cycle": "none"}}}
    solve = {"preset": "rigid", "start": "zero", "duration": "36 s", "steps": 18_000}  # 180 turns at 300 rpm
    found = solved(scene_of({**turning, "solve": solve}))
    own, once = scenery(found), scenery(solved("four-bar", "solve.preset=rigid"))
    assert own.lower == pytest.approx(once.lower, abs=2e-3 * once.size)
    assert own.upper == pytest.approx(once.upper, abs=2e-3 * once.size)


def test_missed_is_a_share_of_what_a_curve_spans():
    """Of a sine, N samples a period miss up to half of 1 - cos(pi / N) of its span."""
    curve = np.cos(np.linspace(0.0, 2 * np.pi, 8001) + np.pi / 8)[None]
    assert missed(curve, np.arange(0, 8001, 1000)) == pytest.approx(0.5 * (1 - np.cos(np.pi / 8)), rel=1e-6)


def test_no_curves_and_no_instants_are_no_error():
    assert thinned(np.zeros((0, 5000)), 100)[1] == 0
    assert len(thinned(np.zeros((3, 0)), 100)[0]) == 0
