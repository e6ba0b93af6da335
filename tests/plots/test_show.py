"""Showing a scene: places without the derived equations, the count of freedoms, and the drawing."""

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from command_line import cli, refused
from machines import machine
from PIL import Image
from places import DOCS
from runs import model, run, shipped, short

from kaneflex import SceneError, read_scene, scene_of, show, with_settings
from kaneflex.fem.freedom import count_freedom, elastic_coordinates
from kaneflex.mechanism.joints import Constraints
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.position_analysis import closures, drive_rates, place
from kaneflex.plots.mechanism import deformed_lines, rigid_outline, rigid_scenery, used_points
from kaneflex.plots.scheme import branches, scheme
from kaneflex.plots.style import picture, styled
from kaneflex.report.presentation import parts
from kaneflex.solve.loading import integrated

pytestmark = pytest.mark.usefixtures("empty_folder")
SCENES = tuple(name for name, scene in shipped().items() if not scene.is_spatial)  # those have tests of their own

QUICK_RETURN = machine(
    ground=dict(low=[0, "-100 mm"]),
    bodies=dict(crank='length = "40 mm", mass = "0.2 kg"', block='mass = "0.1 kg"',
                arm='length = "200 mm", mass = "0.5 kg"'),
    joints=dict(main="revolute ground crank.start", pin="revolute crank.end block",
                foot="revolute ground.low arm.start",
                slot='prismatic arm block, direction = [1, 0], branch = "BRANCH"'),
    drives=dict(main='speed = "60 rpm", cycle = "360 deg"'), solve='preset = "rigid"',
)
WELDED = machine(
    bodies=dict(arm='length = "1 m", mass = "1 kg"', knee='length = "1 m", mass = "1 kg"'),
    joints=dict(root="revolute ground arm.start", seam='weld arm.end knee.start, relative_angle = "90 deg"'),
    drives=dict(root='law = "0.5 + 2*t"'), solve=dict(preset="rigid", duration="1 s"),
)
GALLOWS = machine(
    gravity=[0, "-9.81 m/s^2"],
    bodies=dict(post='length = "1 m", pose = {at = [0, 0], angle = "90 deg"}, '
                     'beam = {material = "steel", A = "1 cm^2", I = "1 cm^4"}',
                beam='length = "0.5 m", pose = {at = [0, 1]}, beam = {material = "steel", A = "1 cm^2", I = "1 cm^4"}'),
    joints=dict(foot="weld ground post.start", corner='weld post.end beam.start, relative_angle = "-90 deg"'),
    solve=dict(preset="linear", duration="1 s"),
)


# ---- places -------------------------------------------------------------------------------------------------------


@pytest.mark.exhaustive(share=4)
@pytest.mark.parametrize("name", SCENES)
def test_places_are_those_of_the_generated_motion(name):
    """At four configurations of the run, and on the right branch."""
    found, scene = integrated(short(name)), short(name).scene
    if scene.is_frame:
        return
    for t in np.linspace(0.0, scene.horizon, 4):
        rigid = found.motion.at(t)
        placement = place(mechanism_of(scene), {drive: float(rigid[f"{drive}.angle"][0]) for drive in scene.drives})
        for body in scene.bodies:
            for kind in "xycs":
                expected = rigid[f"{body}.{kind}"][0]
                assert placement[f"{body}.{kind}"][0] == pytest.approx(expected, abs=1e-9), (body, kind, t)


@pytest.mark.parametrize("name", SCENES)
def test_drives_start_where_the_run_starts(name):
    found = short(name)
    for name, drive in found.scene.drives.items():
        assert drive.coordinate(0.0) == pytest.approx(found.motion.at(0.0)[f"{name}.angle"][0], abs=1e-12)


@pytest.mark.parametrize("name", ["engine-3", "four-bar", "slider-crank-150"])
def test_rates_are_those_of_the_generated_motion(name):
    found, scene = model(name), read_scene(name)
    (drive, moved), *_ = scene.drives.items()
    for t in np.linspace(0.0, scene.horizon, 5):
        rigid = found.motion.at(t)
        mechanism = mechanism_of(scene)
        rates = drive_rates(mechanism, place(mechanism, {drive: float(rigid[f"{drive}.angle"][0])}))[drive]
        for body in scene.bodies:
            expected = [rigid[f"{body}.{kind}"][0] / moved.speed for kind in ("v_x", "v_y", "omega")]
            assert rates[body] == pytest.approx(expected, abs=1e-9), body


@pytest.mark.parametrize("name", ["engine", "four-bar"])
def test_the_other_branch_is_the_other_way_to_close(name):
    scene = read_scene(name)
    joint = scene.loop_joints()[0]
    flipped = with_settings(scene, [f"joints.{joint}.branch=-"])
    found = model(name, f"joints.{joint}.branch=-")
    at = {"main": 0.7}
    time = 0.7 / scene.drives["main"].speed
    for body in scene.bodies:
        expected = [found.motion.at(time)[f"{body}.{kind}"][0] for kind in "xycs"]
        there = place(mechanism_of(flipped), at)
        assert [there[f"{body}.{kind}"][0] for kind in "xycs"] == pytest.approx(expected, abs=1e-9)
    last = list(scene.bodies)[-1]
    assert not np.allclose(place(mechanism_of(flipped), at).poses[last], place(mechanism_of(scene), at).poses[last])


@pytest.mark.parametrize("branch", ["+", "-"])
def test_a_lever_points_at_its_slider_or_away(branch):
    scene = scene_of(QUICK_RETURN.replace("BRANCH", branch))
    placement = place(mechanism_of(scene), {"main": 0.3})
    pin = 0.04 * np.array([math.cos(0.3), math.sin(0.3)])
    along = np.array([placement["arm.c"][0], placement["arm.s"][0]])
    towards = (pin - [0.0, -0.1]) / np.hypot(*(pin - [0.0, -0.1]))
    assert along == pytest.approx(towards if branch == "+" else -towards, abs=1e-9)
    assert [placement["block.x"][0], placement["block.y"][0]] == pytest.approx(pin, abs=1e-12)


def test_welds_laws_and_structures_stand_where_they_should():
    knee = place(mechanism_of(scene_of(WELDED))).poses["knee"]
    assert knee == pytest.approx([math.cos(0.5), math.sin(0.5), 0.5 + math.pi / 2], abs=1e-12)
    gallows = place(mechanism_of(scene_of(GALLOWS)))
    assert gallows.poses["beam"] == pytest.approx([0.0, 1.0, 0.0]) and gallows.drives == {}


def test_residuals_have_the_derivatives_that_newtons_method_is_given():
    """Guides on the ground and on a body that turns, pins, a weld, driven turns and driven slides."""
    random = np.random.default_rng(1)
    for text, drives in ((QUICK_RETURN.replace("BRANCH", "+"), ("main", "slot")), (WELDED, ("root",))):
        scene = scene_of(text)
        rows = Constraints(mechanism_of(scene), dict.fromkeys(drives, 0.1))
        x = random.normal(size=3 * len(scene.bodies))

        def residuals(x, rows=rows):
            poses = {"ground": np.zeros(3), **rows.split(x)}
            return rows.residuals(poses), rows.jacobian(poses)

        steps = 1e-6 * np.eye(len(x))
        slopes = [(residuals(x + step)[0] - residuals(x - step)[0]) / 2e-6 for step in steps]
        assert residuals(x)[1] == pytest.approx(np.array(slopes).T, abs=1e-8)
        assert len(residuals(x)[0]) == 2 * len(scene.joints) + (text is WELDED) + len(drives)


def test_a_linkage_that_can_not_close_or_is_left_open_is_named():
    engine = with_settings(read_scene("engine"), ["rod.length=30 mm"])
    said = r"joints\.bore\.branch = '\+': the loop cannot close at main = 90 deg: rod, piston"
    with pytest.raises(SceneError, match=said):
        place(mechanism_of(engine), {"main": math.pi / 2})
    assert place(mechanism_of(engine), {"main": 0.0}).poses["rod"] == pytest.approx([0.04, 0.0, 0.0], abs=1e-9)
    open_chain = scene_of(WELDED.replace("seam = {weld", "seam = {revolute").replace(
        ', relative_angle = "90 deg"', ""))  # fmt: skip
    with pytest.raises(SceneError, match="the position of knee is not determined"):
        place(mechanism_of(open_chain))


# ---- freedoms -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SCENES)
def test_elastic_coordinates_are_those_of_the_model(name):
    assert sorted(elastic_coordinates(read_scene(name))) == sorted(short(name).coordinates)


def test_counts_and_verdicts():
    engine = count_freedom(mechanism_of(read_scene("engine")))
    assert (engine.mobility, engine.left, engine.prescribed) == (1, 0, ("main",))
    assert engine.constraints == {"main": 2, "pin": 2, "wrist": 2, "bore": 2}
    pendulum = count_freedom(mechanism_of(read_scene("double-pendulum")))
    assert (pendulum.mobility, pendulum.left, pendulum.free) == (2, 0, ("pivot", "elbow"))
    assert pendulum.verdict == "forces drive the free joints"
    bare = ["drives=none", "loads=none", "sensors=none", "solve.duration=1 s", "solve.start=zero"]
    undriven = count_freedom(mechanism_of(with_settings(read_scene("engine"), bare)))
    assert undriven.left == 1 and undriven.verdict.startswith("1 too many")
    driven_weld = ["joints.hub.revolute=none", 'joints.hub.weld=["ground", "beam.start"]', "sensors=none"]
    welded = count_freedom(mechanism_of(with_settings(read_scene("spin-up"), [*driven_weld, "drives=none"])))
    assert welded.left == 0 and welded.mobility == 0
    gallows = count_freedom(mechanism_of(scene_of(GALLOWS)))
    assert gallows.still and "structure" in gallows.verdict


# ---- the drawing --------------------------------------------------------------------------------------------------


def texts(scene) -> list[str]:
    with styled():
        figure = scheme(scene, place(mechanism_of(scene)))
    return [text.get_text() for text in [*figure.texts, *figure.axes[0].texts, figure.axes[0].title]]


@pytest.mark.exhaustive(share=4)
@pytest.mark.parametrize("name", SCENES)
def test_everything_is_named_in_the_drawing(name):
    scene = read_scene(name)
    shown = "\n".join(texts(scene))
    plain = " ".join(shown.split())
    for thing in (*scene.bodies, *scene.joints, *scene.masses, *scene.loads, *scene.contacts, *scene.sensors):
        assert thing in plain, thing
    for drive in scene.drives.values():
        assert drive.kind != "constant speed" or "rpm" in plain or "m/s" in plain
        assert drive.kind != "free" or "free" in plain


def test_events_say_which_of_them_end_the_run():
    met = {"sensor": "mid_transverse", "value": "0.1 mm", "direction": "up"}
    events = {"seen": met, "met": {**met, "stop": True}}
    told = parts(scene_of({"schema": 1, "like": "engine", "events": events}))["events"]
    assert told == {"seen": "mid_transverse passes 0.0001 m upwards",
                    "met": "mid_transverse passes 0.0001 m upwards, which ends the run"}  # fmt: skip


def test_lumped_masses_are_printed_with_their_inertia():
    """The flywheel of `engine-torque` was printed as 0 kg."""
    assert parts(read_scene("engine-torque"))["masses"] == {"flywheel": "0 kg, 0.1 kg m^2 at crank.start"}
    assert parts(read_scene("four-bar"))["masses"]["at_first"] == "0.042 kg at crank.end"


def test_links_in_space_are_drawn_where_their_points_are():
    """Enlarged once, the rod's end is where its position sensor has it; three times, three displacements away."""
    motion = run("spatial-slider-crank-elastic", "solve.steps=90").motion
    frame, (d, *_) = motion.rigid.frame("rod"), motion.displacement("rod", (0.05, 0.0, 0.0))
    at = np.linspace(0.0, motion.model.links["rod"].length, len(deformed_lines(motion, 1.0)["rod"]))
    moved = [[np.interp(0.05, at, line[:, i, 7]) for i in range(3)] for line in
             (deformed_lines(motion, factor)["rod"] for factor in (0.0, 1.0, 3.0))]  # fmt: skip
    exact = frame.to_global(d[:3])[:, 7]
    assert abs(exact).max() > 1e-6
    assert np.subtract(moved[1], moved[0]) == pytest.approx(exact, abs=0.02 * abs(exact).max())
    assert np.subtract(moved[2], moved[0]) == pytest.approx(3.0 * exact, abs=0.06 * abs(exact).max())


def test_labels_cover_neither_each_other_nor_leave_the_picture():
    scene = read_scene("engine")
    with styled():
        figure = scheme(scene, place(mechanism_of(scene), {"main": 1.0}))
        figure.canvas.draw()
        axes = figure.axes[0]
        frame = axes.get_window_extent()
        boxes = [text.get_window_extent() for text in axes.texts if text.get_text()]
    assert len(boxes) > 10
    for k, box in enumerate(boxes):
        assert frame.x0 <= box.x0 and box.x1 <= frame.x1 and frame.y0 <= box.y0 and box.y1 <= frame.y1
        assert not any(box.overlaps(other) for other in boxes[k + 1 :])


def test_the_same_scene_gives_the_same_bytes():
    scene = read_scene("four-bar")
    for kind in ("png", "svg", "pdf"):
        one, other = (picture(lambda: scheme(scene, place(mechanism_of(scene))), kind) for _ in range(2))
        assert one == other


def test_a_structure_with_gravity_is_drawn():
    assert {"g", "post (4 el.)", "foot", "corner"} <= set(texts(scene_of(GALLOWS)))


# ---- command line -------------------------------------------------------------------------------------------------


def test_show_draws_and_counts():
    shown = cli("show", "engine", "-o", "engine.png", "--at", "main=30deg")
    assert shown.exit_code == 0, shown.output
    for words in ("rod     elastic, 4 elements", "joints     -8  main 2, pin 2, wrist 2, bore 2", "left        0",
                  "elastic    12", "Written to engine.png"):  # fmt: skip
        assert words in shown.stdout
    assert Image.open("engine.png").width > 1000
    refused(cli("show", "engine", "-o", "engine.png"), "the file exists", "--force")
    assert cli("show", "engine", "-o", "engine.png", "--force").exit_code == 0
    assert cli("show", "double-pendulum", "--at", "pivot=90deg", "--at", "elbow=-1").exit_code == 0
    assert sorted(path.name for path in Path().iterdir()) == ["double-pendulum.png", "engine.png"]


@pytest.mark.parametrize("arguments, lines", {
    ("stick-slip",): ["way  0 mm", "rub  0 mm"],
    ("engine", "--at", "main=180deg"): ["pin                 -180 deg", "wrist               0 deg"],
    ("engine", "--set", "main.speed=0", "--set", "drives.main.cycle=none", "--set", "loads.gas=none",
     "--set", "solve.start=zero", "--set", "solve.duration=1"): ["main                0 deg", "a stroke of 0 mm"],
}.items(), ids=("guides", "angles", "stroke"))  # fmt: skip
def test_rounding_errors_of_coordinates_are_shown_as_zero(arguments, lines):
    shown = cli("show", *arguments)
    assert shown.exit_code == 0, shown.output
    assert all(line in shown.stdout for line in lines), shown.stdout


BAD = {
    ("engine", "-o", "engine.gif"): ("engine.gif", "not a kind of picture", ".svg"),
    ("engine", "--at", "pin=3"): ("--at = 'pin=3'", "main"),
    ("engine", "--at", "main"): ("--at = 'main'", "DRIVE=ANGLE"),
    ("engine", "--set", "rod.length=30 mm", "--at", "main=90deg"): ("joints.bore.branch = '+'", "main = 90 deg"),
    ("engin",): ("scene = 'engin'", "'engine'"),
}


@pytest.mark.parametrize("arguments", BAD, ids=" ".join)
def test_bad_input_is_named_and_nothing_is_written(arguments):
    refused(cli("show", *arguments), *BAD[arguments])
    assert list(Path().iterdir()) == []


def test_a_scene_that_can_not_be_run_is_shown_with_a_warning():
    Path("lever.toml").write_text(QUICK_RETURN.replace("BRANCH", "+").replace(
        'arm = {length = "200 mm", mass = "0.5 kg"}',
        'arm = {length = "200 mm", beam = {material = "steel", A = "1 cm^2", I = "1 cm^4"}}',
    ).replace('preset = "rigid"', 'preset = "linear"'))  # fmt: skip
    shown = cli("show", "lever.toml")
    assert shown.exit_code == 0, shown.output
    assert "the elastic equations can't be set up" in shown.stderr and "elastic body on a guide" in shown.stderr
    assert "elastic   " not in shown.stdout.split("degrees of freedom")[1]
    assert Path("lever.png").is_file()


def test_no_equations_are_derived_to_show_a_scene():
    code = """
import sys
from kaneflex.cli import main
try:
    main(["show", "engine"])
except SystemExit as stop:
    assert not stop.code
print([name for name in ("sympy", "kaneflex.derive.generate", "kaneflex.generated.engine") if name in sys.modules])
"""
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert shown.stdout.splitlines()[-1] == "[]", shown.stderr


def test_a_barrel_is_drawn_no_longer_than_it_is():
    """A rail that a body carries ends where the body does, as far as its rider leaves it there."""
    page = (DOCS / "scene/drives.md").read_text(encoding="utf-8")
    scene = scene_of(page.partition("# boom.toml\n")[2].partition("```")[0])
    placement = place(mechanism_of(scene))
    fixed = rigid_scenery(scene, placement)
    np.testing.assert_allclose(fixed.guides["cylinder"], [[0.0, 0.0], [1.5, 0.0]], atol=1e-12)
    (bar,) = rigid_outline(scene, placement, fixed).bars["barrel"]
    reach = np.linalg.norm(bar - scene.ground["base"], axis=1)
    assert reach.max() == pytest.approx(1.5)
    apart = (bar[1:] - bar[0]) @ (bar[reach.argmax()] - bar[0])
    assert apart.min() >= -1e-12  # nothing behind its foot


def test_a_mechanism_in_space_is_drawn_with_all_that_one_in_the_plane_has():
    scene = read_scene("crankshaft-torsion")
    with styled():
        figure = show(scene)
        figure.draw_without_rendering()
    axes, *flat = figure.axes
    told = " ".join(text.get_text() for text in [*figure.texts, *axes.texts])
    for thing in (*scene.bodies, *scene.joints, *scene.loads, *scene.sensors, "3000 rpm", "x", "y", "z", "100 mm"):
        assert thing in told, thing
    elastic = [text for text in axes.texts if text.get_text() == "journal_1 (2 el.)"]
    rigid = [text for text in axes.texts if text.get_text() == "throw_1"]
    assert elastic[0].get_color() != rigid[0].get_color() == "black"
    assert [each.get_title(loc="left") for each in flat] == ["along z", "along y", "along x"]
    assert "g" in [text.get_text() for text in show(read_scene("spinning-top")).axes[0].texts]


@pytest.mark.parametrize(("name", "count", "entry"), [
    ("four-bar", 2, "joints.rocker.branch=-"), ("engine", 2, "joints.bore.branch=-"),
    ("six-bar", 6, "right_knee.near.rod="), ("elastic-pendulum", 1, ""),
])  # fmt: skip
def test_all_closures_of_the_loops_are_found_and_drawn(name, count, entry):
    """A Stephenson III closes in six ways at most (Primrose, Freudenstein and Roth 1967): here in all six."""
    scene = read_scene(name)
    at = {"main": math.pi / 3} if name == "six-bar" else {}
    ways = closures(mechanism_of(scene), at)
    assert len(ways) == count and entry in " ".join(told for told, _ in ways)
    own = place(mechanism_of(scene), at)
    assert all(ways[0][1].poses[body] == pytest.approx(own.poses[body], abs=1e-6) for body in scene.bodies)
    for told, placed in ways[1:]:
        if "branch" in told:
            there = place(mechanism_of(with_settings(scene, told.split())), at)
            for body in scene.bodies:
                assert np.cos(there.poses[body][2]) == pytest.approx(np.cos(placed.poses[body][2]))
    with styled():
        assert len(branches(scene, ways).axes) == count


def test_show_draws_all_branches():
    assert cli("show", "four-bar", "--branches", "-o", "ways.png").exit_code == 0
    refused = cli("show", "bricard", "--branches", "-o", "other.png")
    assert refused.exit_code == 2 and "--branches draws mechanisms in the plane" in refused.output
    assert [path.name for path in Path().iterdir()] == ["ways.png"]


def test_a_body_on_a_bushing_is_drawn_from_its_foot_to_its_centre_of_mass():
    page = (DOCS / "scene/space.md").read_text(encoding="utf-8")
    scene = scene_of(page.partition("# mount.toml\n")[2].partition("```")[0])
    assert used_points(scene, "engine") == [(0.1, 0.0, -0.2), (0.0, 0.0, 0.0)]
    with styled():
        axes = show(scene).axes[0]
    assert any(len(line.get_xdata()) == 16 and np.ptp(line.get_xdata()) > 10.0 for line in axes.lines)  # its zigzag
