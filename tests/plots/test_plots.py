"""Pictures: which ones a scene gets, what stands on them, and the numbers behind them."""

import io
import math
import re
import subprocess
import sys
from dataclasses import replace
from functools import cache

import matplotlib
import numpy as np
import pytest
from matplotlib.collections import LineCollection
from PIL import Image

from kaneflex import Solution, draw_all, figures, load, read_scene, with_settings
from kaneflex.integrate.system import Outcome
from kaneflex.multibody.model.building import reference_modes
from kaneflex.plots import animation, modes, style
from kaneflex.plots import enlarged as enlarged_module
from kaneflex.plots.deformed import LinkColours, stress_field
from kaneflex.plots.deformed import figures as figures_of_worst
from kaneflex.plots.drawing import ticks
from kaneflex.plots.enlarged import caption_at, enlarged, times
from kaneflex.plots.mechanism import outline, rigid_outline, rigid_scenery, scenery
from kaneflex.plots.outlines import ALONG_LINK, VIEW, Outline
from kaneflex.plots.sensors import reversals
from kaneflex.plots.spectra import spectrum
from kaneflex.plots.style import readable, round_down, save, styled
from kaneflex.plots.view import FRAMES, View, view
from kaneflex.solve.simulation import solve

SETTINGS = {
    "engine": ("solve.steps=720",),
    "engine-3": ("solve.steps=144",),
    "engine-elastic-crank": ("solve.steps=144",),
    "engine-transient": ("solve.duration=0.01 s", "solve.steps=360"),
    "engine-rig": ("solve.steps=2160",),
    "rigid": ("solve.steps=144", "solve.preset=rigid"),
}
ALL = tuple(SETTINGS)
CYCLE = {"mechanism", "loads", "motion", "paths", "modes", "nodal_displacements", "mid_rod", "surfaces_rod", "sensors"}
OF_ROD = {"mid_rod", "surfaces_rod"}
EXPECTED = {
    "engine": CYCLE | {"orders"},
    "engine-elastic-crank": CYCLE | {"orders", "mid_crank", "surfaces_crank"},
    "engine-3": CYCLE - OF_ROD | {"orders"} | {f"{picture}_{k}" for picture in OF_ROD for k in (1, 2, 3)},
    "engine-transient": CYCLE | {"spectra"},
    "engine-rig": CYCLE - {"loads"} | {"spectra"},
    "rigid": {"mechanism", "loads", "motion", "paths", "sensors", "orders"},
}  # fmt: skip


@cache
def solved(name: str) -> Solution:
    scene = read_scene("engine" if name == "rigid" else name)
    return solve(load(with_settings(scene, SETTINGS[name])))


@cache
def drawn(name: str) -> dict:
    return dict(figures(solved(name)))


def panels(name: str):
    return [(picture, axes) for picture, figure in drawn(name).items() for axes in figure.axes]


def titles(figure) -> list[str]:
    return [axes.get_title(loc="left") or axes.get_title() for axes in figure.axes]


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("name", ALL)
def test_a_scene_gets_the_pictures_that_apply_to_it(name):
    assert set(drawn(name)) == EXPECTED[name]


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("name", ALL)
def test_every_panel_has_a_title_and_units_on_its_axes(name):
    for picture, figure in drawn(name).items():
        assert figure.get_suptitle(), picture
        for axes, title in zip(figure.axes, titles(figure), strict=True):
            assert title, picture
            bottom = any(label.get_visible() for label in axes.get_xticklabels())
            labels = [axes.get_ylabel()] if picture != "modes" or axes.get_subplotspec().is_first_col() else []
            labels += [axes.get_xlabel()] if bottom and axes.get_xlabel() else []
            for label in labels:
                assert re.search(r"\[.+\]$", label), (picture, title, label)
        assert any(re.search(r"\[.+\]$", axes.get_xlabel()) for axes in figure.axes), picture


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("name", ALL)
def test_panels_with_several_curves_have_a_legend_that_names_each(name):
    for picture, axes in panels(name):
        names = axes.get_legend_handles_labels()[1]
        if picture not in ("modes", "paths", "spectra") and len(names) > 1:
            assert [text.get_text() for text in axes.get_legend().get_texts()] == names, (picture, axes.get_title())
            assert len(set(names)) == len(names)


@pytest.mark.parametrize("name", ["engine", "spatial-slider-crank-elastic"])
def test_the_mechanism_is_drawn_at_its_largest_stress_and_coloured_by_it(name):
    section = ("rod.section={circle='20 mm'}", "rod.I=none", "rod.mass=none") if name == "engine" else ()
    found = solve(load(with_settings(read_scene(name), ("solve.steps=72", *section))))
    stresses = found.stresses["rod"]
    figure = figures_of_worst(found)["mechanism"]
    axes, bar = figure.axes
    worst = 1e-6 * stresses.mises.max()
    assert f"{worst:.3g} MPa, in rod" in axes.get_title() and bar.get_ylabel() == "von Mises stress [MPa]"
    instant = int(stresses.mises.max(axis=0).argmax())
    assert caption_at(view(found), instant) in axes.get_title()
    (coloured,) = [each for each in axes.collections if each.get_array() is not None]
    along = np.linspace(0.0, stresses.x[-1], 65)[1::2]
    np.testing.assert_allclose(coloured.get_array(), 1e-6 * np.interp(along, stresses.x, stresses.mises[:, instant]))


def test_panels_have_titles_in_a_callers_own_style():
    """They stand at the centre there, not at the left."""
    page, panels = style.pages(1, "Page")
    panels[0].set_title("Panel")
    style.finish(panels, "time [s]")
    assert titles(page) == ["Panel"]


def test_modes_have_a_legend_and_their_frequencies_in_the_titles():
    figure = drawn("engine")["modes"]
    frequencies = reference_modes(solved("engine").model, 6)[0] / (2 * math.pi)
    assert [float(title.split(": ")[1].removesuffix(" Hz")) for title in titles(figure)] == pytest.approx(
        frequencies, rel=1e-4
    )
    assert titles(figure)[0] == "Mode 1: 3038.9 Hz"
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "mode shape", "half a period later", "undeformed",
    ]


def test_modes_are_drawn_straight_and_all_as_large():
    """With the displacements' second order in them, mass-normalised shapes would be metres of foreshortening."""
    solution = solved("engine")
    shapes = reference_modes(solution.model, 6)[1]
    fixed = scenery(solution)
    rigid = solution.model.motion.at(np.zeros(6))
    still = rigid_outline(solution.model.scene, rigid, fixed)
    moved = modes._deflected(solution.model, rigid, fixed, shapes, still)
    shift = moved.links["rod"] - still.links["rod"]
    assert np.hypot(shift[..., 0], shift[..., 1]).max(axis=1) == pytest.approx(0.09 * fixed.size, rel=1e-6)
    bending = np.abs(shift[..., 1]).max(axis=1) > np.abs(shift[..., 0]).max(axis=1)
    assert bending.tolist() == [True, False, True, False, True, False]
    assert np.abs(shift[bending, :, 0]).max() < 1e-6 * fixed.size  # crank angle 0: bending is along Y alone


def test_modes_of_a_link_of_a_few_are_drawn_without_what_loads_do_to_it():
    """Enlarged as the shapes are, the sag by its weight would be hundreds of kilometres."""
    model = load(with_settings(read_scene("pulsating-strut"), ["solve.modes=1"]))
    rigid = model.motion.at(np.zeros(2))
    fixed = rigid_scenery(model.scene, rigid)
    still = rigid_outline(model.scene, rigid, fixed)
    moved = modes._deflected(model, rigid, fixed, reference_modes(model, 2)[1], still).links["strut"]
    shift, x = abs(moved - still.links["strut"]), np.linspace(0.0, 1.0, 33)
    bent, slid = 0.09 * fixed.size * np.array([np.sin(np.pi * x), x])
    assert shift[0] == pytest.approx(np.column_stack([np.zeros(33), bent]), abs=1e-3)
    assert shift[1] == pytest.approx(np.column_stack([slid, np.zeros(33)]), abs=1e-3)


def test_so_are_modes_in_space():
    """Flap and lag of the blade of 1.5 m on a hub of 100 mm, by 9 % of 1.6 m."""
    scene = with_settings(read_scene("rotating-blade"), ["solve.modes=2", "solve.steps=20"])
    (figure,) = modes.figures(solve(load(scene))).values()
    for axes in figure.axes:
        ghost, *_, blade = (line for line in axes.lines if len(line.get_xdata()) == ALONG_LINK)
        still, moved = (line.get_xydata()[-1] for line in (ghost, blade))
        lag_and_flap = np.linalg.solve(VIEW[:, 1:], moved - still)
        assert np.hypot(*lag_and_flap) == pytest.approx(144.0, abs=0.5)
        assert not axes.get_xticks().size  # a triad and a scale stand for the axes


@pytest.mark.parametrize("factor", [0.0, 500.0])
def test_the_drawn_mechanism_holds_together(factor):
    solution = solved("engine")
    shown = view(solution)
    fixed = scenery(solution)
    drawn_at = outline(shown.motion, fixed, factor)
    rod = drawn_at.links["rod"]
    assert drawn_at.pins["pin"] == pytest.approx(rod[:, 0], abs=1e-12)
    assert drawn_at.pins["wrist"] == pytest.approx(rod[:, -1], abs=1e-12)
    assert drawn_at.bars["crank"][:, 1] == pytest.approx(rod[:, 0], abs=1e-12)
    box = drawn_at.boxes["bore"][:, :4].mean(axis=1)
    assert box == pytest.approx(rod[:, -1], abs=3e-8 * (1 + factor))  # but for the foreshortening
    along = np.stack([shown.rigid["rod.c"], shown.rigid["rod.s"]], axis=-1)
    stretched = np.sum((rod[:, -1] - rod[:, 0]) * along, axis=1) - 0.137
    assert stretched == pytest.approx(factor * solution.series["tip_axial"].values, abs=1e-12)


def test_guides_span_the_stroke_and_pivots_stand_on_the_ground():
    fixed = scenery(solved("engine"))
    (start, end) = fixed.guides["bore"]
    assert start[0] < 0.097 < 0.177 < end[0] and start[1] == end[1] == 0
    assert fixed.pivots == pytest.approx(np.zeros((1, 2)))
    assert len(scenery(solved("engine-3")).guides) == 3


def test_nodal_displacements_are_numbered_as_in_the_paper_and_held_ones_left_out():
    def numbers(name):
        found = titles(drawn(name)["nodal_displacements"])  # row by row, they go on column by column
        return sorted(int(re.search(r"q_\{(\d+)\}", title)[1]) for title in found)

    assert numbers("engine") == [6, 7, 9]
    assert numbers("engine-elastic-crank") == [4, 5, 6, 7, 9]
    q_7 = drawn("engine")["nodal_displacements"].axes[1]
    assert q_7.get_ylabel() == "displacement [mm]"
    assert q_7.lines[0].get_ydata().min() == pytest.approx(-0.146, abs=0.002)


def test_gas_pressure_and_force_peak_where_the_table_does():
    pressure, force = drawn("engine")["loads"].axes
    assert pressure.get_ylabel() == "pressure [bar]" and force.get_ylabel() == "force [kN]"
    x, bar = pressure.lines[0].get_data()
    assert x[np.argmax(bar)] == pytest.approx(373.5, abs=0.5) and bar.max() == pytest.approx(92.3, abs=0.05)
    assert force.lines[0].get_ydata().max() == pytest.approx(37.2, abs=0.05)
    peaks = [axes.lines[k].get_data() for axes in [drawn("engine-3")["loads"].axes[1]] for k in range(0, 3)]
    first, *_ = tops = [x[np.argmax(y)] for x, y in peaks]
    assert first == pytest.approx(373.5, abs=2.5)
    assert sorted((top - first) % 720 for top in tops) == pytest.approx([0, 240, 480])


def test_torque_panel_states_the_mean():
    axes = drawn("engine-3")["motion"].axes[-1]
    assert axes.get_title(loc="left") == "Torque of the drives"
    assert axes.get_legend_handles_labels()[1][1] == "main, mean \u2212138.4 N m"


def test_rigid_values_stand_dashed_beside_the_elastic_ones():
    force = next(axes for axes in drawn("engine")["sensors"].axes if axes.get_title(loc="left").startswith("Axial"))
    solid, dashed = force.lines[:2]
    assert (solid.get_linestyle(), dashed.get_linestyle()) == ("-", "--")
    assert solid.get_ydata().min() == pytest.approx(-33.27, abs=0.05)
    assert dashed.get_ydata().min() == pytest.approx(-33.08, abs=0.05)
    assert force.get_legend_handles_labels()[1][-1] == "dashed: rigid mechanism"


def test_a_band_shows_an_estimated_error_that_is_wider_than_a_line():
    """What the rigid engine leaves out is worth 4 % of its piston's acceleration, and nothing beside its stroke."""
    panels = {axes.get_title(loc="left"): axes for axes in drawn("rigid")["sensors"].axes}
    wide, narrow = panels["Acceleration, global axes"], panels["Position"]
    (band, _), off = wide.collections, solved("rigid").errors[0]["piston_acceleration"]
    higher = np.ptp(band.get_paths()[0].vertices[:, 1]) - np.ptp(wide.lines[0].get_ydata())
    assert higher == pytest.approx(2e-3 * off.total, rel=1e-6)
    assert wide.get_legend_handles_labels()[1][-1] == "band: estimated error"
    assert not narrow.collections


def test_a_coupled_run_has_bands_too():
    scene = read_scene("elastic-pendulum")
    soft = solve(load(with_settings(scene, ["solve.duration=0.5 s", "solve.steps=100", "solve.modes=1"])))
    assert any(axes.collections for axes in figures(soft)["sensors"].axes)


def test_a_long_run_is_drawn_by_its_last_turns_and_says_so():
    shown = view(solved("engine-rig"))
    turn = 2 * math.pi / solved("engine-rig").model.scene.drives["main"].speed
    assert np.ptp(shown.times) == pytest.approx(3 * turn, rel=0.02)
    assert drawn("engine-rig")["sensors"].get_suptitle() == "Sensors (last 3 turns)"
    assert view(solved("engine-transient")).note == ""


def test_reversals_of_a_known_force():
    times = np.linspace(0, 2, 2001)
    assert reversals(times, np.cos(2 * np.pi * times)) == pytest.approx([0.25, 0.75, 1.25, 1.75], abs=1e-6)
    assert reversals(times, 1 + np.cos(2 * np.pi * times)).size == 0  # touches zero
    assert reversals(times, np.full(2001, -2.0)).size == 0
    assert reversals(np.arange(5.0), np.array([1.0, 0, 0, 0, -1])) == pytest.approx([2.0])
    assert reversals(np.arange(4.0), np.array([1.0, 0, 0, 1])).size == 0
    assert reversals(np.arange(2.0), np.array([3.0, -1.0])) == pytest.approx([0.75])


def test_reversals_are_marked_and_counted():
    marks = {line.get_label(): line for axes in drawn("engine-rig")["sensors"].axes for line in axes.lines}
    assert "rod_mid_force: reversals (0)" in marks  # the piston's weight exceeds its inertia force
    marks = marks["piston_side_force: reversals (6)"]
    assert len(marks.get_xdata()) == 6
    piston = solved("engine-rig").series["piston_position"].values
    at = np.interp(marks.get_xdata(), solved("engine-rig").times, piston)
    assert np.minimum(at - 0.097, 0.177 - at) == pytest.approx(np.zeros(6), abs=1e-4)  # at the dead centres


def test_spectrum_of_known_lines():
    times = np.linspace(0, 4, 2001)
    record = 7.0 + 3.0 * np.sin(2 * np.pi * 10 * times) + 0.01 * np.cos(2 * np.pi * 40.5 * times)
    frequencies, amplitudes = spectrum(times, record)
    assert np.diff(frequencies) == pytest.approx(0.25)
    assert frequencies[np.argmax(amplitudes)] == 10.0
    assert amplitudes[[40, 162]] == pytest.approx([3.0, 0.01], rel=1e-6)
    assert spectrum(times, 7.0 + np.sin(2 * np.pi * 10.1 * times))[1][0] < 1e-12  # nothing of the mean
    assert spectrum(times, (-1.0) ** np.arange(2001))[1][-1] == pytest.approx(1.0)  # at half the sampling rate
    times[-1] -= 1e-3  # a run that an event ends half a step later
    assert spectrum(times, record)[0] == pytest.approx(frequencies, rel=1e-12)


def test_spectra_state_their_resolution_and_mark_natural_frequencies():
    assert "1/T = 100 Hz" in drawn("engine-transient")["spectra"].get_suptitle()
    assert "1/T = 0.0333 Hz" in drawn("engine-rig")["spectra"].get_suptitle()
    axes = drawn("engine-transient")["spectra"].axes[0]
    assert axes.get_ylabel() == "amplitude [km/s²]"
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["drive", "natural, at the reference angle"]
    marked = [line.get_xdata()[0] for line in axes.lines[1:]]
    assert marked[:2] == pytest.approx([0.1, 3.0389], rel=1e-4)


def test_the_enlargement_is_a_round_number_and_stated():
    shown = view(solved("engine"))
    found = enlarged(shown)
    factor, largest = found.factor, np.abs(solved("engine").series["tip_axial"].values).max()
    size = scenery(solved("engine")).size
    assert 0.04 * size < factor * largest <= 0.1 * size
    assert factor == 100
    assert found.title == "deformation enlarged 100 times"
    assert times(2e6) == "enlarged 2 \u00d7 10$^{6}$ times" and times(1.0) == "in true size"
    assert found._replace(factor=None).title == "rigid mechanism"
    assert "no visible deformation" in found._replace(largest=1e-12).title
    assert found._replace(largest=0.0).title == "no deformation"


@pytest.mark.parametrize(("value", "expected"), [(1.0, 1), (1.99, 1), (2.0, 2), (49.9, 20), (0.7, 0.5), (0.0, 1)])
def test_round_down(value, expected):
    assert round_down(value) == pytest.approx(expected)


@pytest.mark.parametrize(("unit", "largest", "expected"), [
    ("m", 1.46e-4, "mm"),
    ("m", 3e-6, "µm"),
    ("m", 1e-9, "nm"),
    ("N", 33e3, "kN"),
    ("N", 2.3, "N"),
    ("rad", 0.3, "deg"),
    ("m/s^2", 0.0, "m/s²"),
])  # fmt: skip
def test_units_are_those_that_people_read(unit, largest, expected):
    assert readable(unit, np.array([0.0, -largest]))[1] == expected


def test_the_folder_holds_png_svg_and_a_small_gif(tmp_path, monkeypatch):
    monkeypatch.setitem(style._STYLE, "savefig.dpi", 50)
    written = draw_all(solved("rigid"), tmp_path / "pictures", progress=(shares := []).append, frames=6)
    expected = {f"{name}.{kind}" for name in EXPECTED["rigid"] for kind in ("png", "svg")} | {"animation.gif"}
    assert {path.name for path in written} == {path.name for path in (tmp_path / "pictures").iterdir()} == expected
    assert shares == sorted(shares) and shares[-1] == 1.0
    for path in written:
        text = path.read_bytes()
        assert b"<dc:date>" not in text and b"tIME" not in text and b"Creation Time" not in text, path.name
    with Image.open(tmp_path / "pictures" / "animation.gif") as gif:
        assert gif.n_frames == 6


def test_the_sixty_frames_of_an_animation_take_at_most_a_megabyte(tmp_path):
    path = tmp_path / "a.gif"
    with styled():
        animation.animate(solved("engine"), path, 10)
    with Image.open(path) as gif:
        assert gif.n_frames == 10
    assert FRAMES == 60 and path.stat().st_size < 1e6 * 10 / FRAMES


def test_an_animation_colours_links_by_their_stress_at_each_instant(monkeypatch, tmp_path):
    """Colours are the solution's own stresses at the drawn instants; links without a section stay blue."""
    solution = solve(load(read_scene("six-bar")))
    axes, instants = style.new_figure(3.0, 2.0, "").subplots(), np.array([10, 200])
    ends = np.zeros((2, 5, 2))
    field = stress_field(solution, instants, 5)
    lines = LinkColours(axes, Outline({"rod": ends, "right_rocker": ends}, {}, {}, {}), field)
    for k, instant in enumerate(instants):
        lines.move(k)
        expected = [np.interp(np.linspace(0, each.x[-1], 9)[1::2], each.x, each.mises[:, instant])
                    for each in (solution.stresses["rod"], solution.stresses["right_rocker"])]  # fmt: skip
        np.testing.assert_allclose(lines.artist.get_array(), 1e-6 * np.concatenate(expected))
        assert lines.artist.get_clim()[1] >= lines.artist.get_array().max()
    taken = []
    recorded = animation.recorded

    def noted(axes, moving, *rest):
        taken.append(moving)
        return recorded(axes, moving, *rest)

    monkeypatch.setattr(animation, "recorded", noted)
    for moved in (solution, solved("engine")):
        animation.animate(moved, tmp_path / "a.gif", 2)
    assert [any(isinstance(artist, LineCollection) for artist in artists) for artists in taken] == [True, False]


def test_a_frame_shows_what_moves_before_what_stands_still():
    with styled():
        figure = style.new_figure(3.0, 2.0, "Figure")
        axes = figure.subplots()
        axes.plot([0, 1], [1, 0])
        (front,) = axes.plot([], [], zorder=4)
        (line,) = axes.plot([], [], linewidth=9.0, zorder=3)
        caption, whole = axes.set_title("0"), []

        def show(k):
            front.set_data([0, 0.5], [k / 2, 0.5])
            line.set_data([0, 1], [0, k / 2])
            caption.set_text(f"frame {k}")

        frames = [*animation.recorded(axes, [front, line, caption], show, 3)]
        for artist in (front, line, caption):
            artist.set_animated(False)
        for k in range(3):
            show(k)
            figure.canvas.draw()
            whole.append(np.asarray(figure.canvas.buffer_rgba())[..., :3].astype(int))
    for frame, expected in zip(frames, whole, strict=True):
        assert abs(np.asarray(frame.convert("RGB")) - expected).max() < 40, "fewer shades of edges, no other lines"


def test_a_png_holds_the_pixels_and_the_resolution_of_its_figure():
    with styled():
        figure = style.new_figure(3.0, 2.0, "Figure")
        figure.subplots().plot([0, 1], [1, 0])
        read = Image.open(io.BytesIO(style.picture(lambda: figure, "png")))
        drawn = np.asarray(figure.canvas.buffer_rgba())[..., :3]
    np.testing.assert_array_equal(np.asarray(read), drawn)
    assert read.mode == "RGB" and read.size == (450, 300) and read.info["dpi"] == pytest.approx((150, 150), rel=1e-3)


def test_an_animation_has_the_length_that_is_asked_for(tmp_path):
    for solution, count in ((solved("engine"), 8), (solve(load(read_scene("bricard"))), 4)):
        with styled():
            animation.animate(solution, tmp_path / "a.gif", count, 2.0)
        with Image.open(tmp_path / "a.gif") as gif:
            assert gif.n_frames == count and gif.info["duration"] == pytest.approx(2000 / count, abs=10)
            assert min(gif.size) > 200


def test_the_same_solution_gives_the_same_bytes(tmp_path):
    bytes_of = []
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        with styled():
            figure = dict(figures(solved("rigid")))["loads"]
            bytes_of.append([path.read_bytes() for path in save(figure, tmp_path / folder / "loads")])
    assert bytes_of[0] == bytes_of[1]


def cut(solution: Solution, instants: int) -> Solution:
    names = ("times", "z", "v", "a")
    parts = {name: getattr(solution.trajectory, name)[:instants] for name in names}
    return replace(solution, trajectory=replace(solution.trajectory, **parts, outcome=Outcome.UNSTABLE))


def test_a_run_that_broke_off_is_drawn_up_to_there(tmp_path):
    broken = cut(solved("engine-transient"), 200)
    assert len(view(broken).times) == 200
    assert set(dict(figures(broken))) == EXPECTED["engine-transient"]
    with styled():
        animation.animate(broken, tmp_path / "a.gif", 3)
    with Image.open(tmp_path / "a.gif") as gif:
        assert gif.n_frames == 3


def test_without_an_instant_there_are_the_pictures_that_need_none(tmp_path):
    written = draw_all(cut(solved("engine"), 0), tmp_path)
    assert {path.stem for path in written} == {"modes"}


def test_pictures_leave_the_callers_matplotlib_alone():
    before = dict(matplotlib.rcParams)
    dict(figures(solved("rigid")))
    assert dict(matplotlib.rcParams) == before
    code = "import sys, kaneflex.plots; print('matplotlib' in sys.modules)\n"
    code += "import kaneflex.plots.animation, kaneflex.plots.spectra; print('matplotlib.pyplot' in sys.modules)"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert shown.stdout.split() == ["False", "False"]


# ---- the first picture -------------------------------------------------------------------------------------------


def test_bodies_that_deform_under_coupled_in_space_are_drawn_in_true_size():
    settings = ["solve.preset=coupled", "solve.steps=40", "solve.tolerance=1e-4"]
    solution = solve(load(with_settings(read_scene("spatial-slider-crank-elastic"), settings)))
    shown = View(solution, np.arange(5, 41, 5))
    found, frame = enlarged(shown), shown.rigid.frame("rod")
    moved = frame.to_global(shown.motion.displacement("rod", (0.15, 0.0, 0.0))[0][:3])
    assert found.title == "deformation in true size" and found.largest > 1e-6
    middle = (each.links["rod"][:, ALONG_LINK // 2] for each in (found.moved, found.still))
    assert np.subtract(*middle) == pytest.approx((VIEW @ moved).T, abs=0.01 * found.largest)


def test_what_does_not_deform_is_not_enlarged():
    """Rounding of a beam that stays straight was drawn 5e12 times as large."""
    solution = solve(load(with_settings(read_scene("mathieu"), ["solve.steps=200"])))
    with styled():
        figure = figures_of_worst(solution)["mechanism"]
    assert "no visible deformation (at most" in figure.get_suptitle()
    assert len(figure.axes) == 1, "no colours of rounding"
    link = next(line for line in figure.axes[0].get_lines() if len(line.get_xdata()) == ALONG_LINK)
    assert np.ptp(link.get_ydata()) == 0.0


def test_an_enlargement_opens_no_joint_and_lets_no_body_pass_another():
    """A rod's end stays within 2 % of the mechanism of the pin that it knocks against; bars that never cross do not."""
    knocking = solve(load(with_settings(read_scene("slider-crank-clearance"), ["solve.duration=3 ms"])))
    worst = knocking.stresses["rod"].largest[1]
    found = enlarged(View(knocking, np.array([worst])))
    gap = found.moved.links["rod"][0, -1] - found.moved.boxes["bore"][0, :4].mean(axis=0)
    assert 1.0 < found.factor and np.hypot(*gap) < 0.03 * found.fixed.size
    straight, bent = np.array([[[0.0, 0.0], [1.0, 0.0]]]), np.array([[[0.0, 0.1], [0.5, -0.3], [1.0, 0.1]]])
    assert enlarged_module._cross([straight], [bent]) and not enlarged_module._cross([straight], [straight + 0.1])
    assert not enlarged_module._cross([straight], [straight])
    assert enlarged(view(solved("engine-3"))).factor == 100.0  # cranks and rods of three cylinders cross anyhow


def test_paths_of_a_flat_mechanism_leave_no_white_space():
    """The page of the engine, three times as long as high, was five inches high."""
    assert drawn("rigid")["paths"].get_size_inches()[1] < 3.5


def test_ticks_across_a_link_are_across_it():
    line = np.outer(np.linspace(0.0, 1.0, ALONG_LINK), [3.0, 4.0])
    strokes = ticks(line).reshape(-1, 3, 2)[:, :2]
    assert np.diff(strokes, axis=1)[:, 0] @ [3.0, 4.0] == pytest.approx(np.zeros(9), abs=1e-12)
    assert np.hypot(*np.diff(strokes, axis=1)[:, 0].T) == pytest.approx(0.3)


def test_a_rigid_mechanism_is_drawn_at_its_largest_joint_force():
    figure = drawn("rigid")["mechanism"]
    forces = [np.hypot(*(solved("rigid").series[f"{name}_{axis}"].values for axis in "xy"))
              for name in ("crank_pin_force", "main_bearing_force")]  # fmt: skip
    title = figure.axes[0].get_title(loc="left")
    assert figure.get_suptitle() == "engine: rigid mechanism" and "largest joint force of the run" in title
    assert float(re.search(r"([\d.]+) kN", title)[1]) >= round(1e-3 * max(map(np.max, forces)), 1)


def test_a_mechanism_of_indeterminate_joint_forces_is_drawn_at_its_largest_speed():
    """Bricard's loop falls from rest: no joint is slower than the measured corner."""
    solution = solve(load(with_settings(read_scene("bricard"), ["solve.steps=100"])))
    with styled():
        title = figures_of_worst(solution)["mechanism"].axes[0].get_title(loc="left")
    corner = [np.gradient(solution.series[f"corner_{axis}"].values, solution.times) for axis in "xyz"]
    told = re.search(r"t = 1.00 s\nlargest joint speed of the run, ([\d.]+) m/s", title)
    assert told is not None and float(told[1]) >= 0.99 * np.linalg.norm(corner, axis=0).max() > 1.0


@pytest.mark.parametrize("name", ["engine", "spatial-slider-crank-elastic"])
def test_the_first_picture_fits_its_mechanism_and_its_texts_do_not_overlap(name):
    solution = solved(name) if name in SETTINGS else solve(load(with_settings(read_scene(name), ["solve.steps=72"])))
    with styled():
        figure = figures_of_worst(solution)["mechanism"]
        figure.draw_without_rendering()
    axes = figure.axes[0]
    drawn_at = np.concatenate([line.get_xydata() for line in axes.get_lines() if len(line.get_xdata()) > 1])
    low, high = np.nanmin(drawn_at, axis=0), np.nanmax(drawn_at, axis=0)
    shown_x, shown_y = np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim())
    assert max((high - low)[0] / shown_x, (high - low)[1] / shown_y) > 0.6
    texts = [text for text in (figure._suptitle, axes.title, axes._left_title, axes.xaxis.label, *axes.texts,
             *figure.axes[1].get_yticklabels(), figure.axes[1].yaxis.label) if text.get_text()]  # fmt: skip
    boxes = [text.get_window_extent() for text in texts]
    clashes = [(texts[k].get_text(), texts[j].get_text()) for k in range(len(boxes)) for j in range(k)
               if boxes[k].overlaps(boxes[j])]  # fmt: skip
    assert not clashes
    assert all(box.x0 >= 0 and box.x1 <= figure.bbox.x1 + 1 and box.y1 <= figure.bbox.y1 + 1 for box in boxes)
