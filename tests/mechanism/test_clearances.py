"""Joints with a clearance: where pins and blocks stand in them, pictures of that, and the paper's rig as it slaps."""

import math

import matplotlib
import numpy as np
import pytest
from machines import machine
from runs import run

from kaneflex.integrate.system import Outcome
from kaneflex.plots import clearances, sensors, spectra
from kaneflex.plots.sensors import impact_zones
from kaneflex.plots.spectra import spectrum
from kaneflex.plots.style import styled
from kaneflex.plots.view import view
from kaneflex.scene.contact_check import CONTACT_RESULTS, FRICTION_RESULTS
from kaneflex.solve.touching import friction_summaries

LOOSE = machine(
    like="slider-crank-clearance",
    sensors=dict(own_x='position wrist, axes = "body"', own_y='position wrist y, axes = "body"',
                 swing="position wrist angle", rod_end_x="position rod.end x", rod_end_y="position rod.end y",
                 rod_end_angle="position rod.end angle"),
    solve=dict(duration="8 ms", errors="none"),
)
RUBS = """
schema = 1
description = "A slider-crank with room in a pin and in its bore, where both rub"
gravity = [0, "-9.81 m/s^2"]
bodies.crank = {length = "50 mm", mass = "0.3 kg"}
bodies.rod = {length = "120 mm", mass = "0.1 kg"}
bodies.piston = {mass = "0.14 kg", inertia = "1e-4 kg m^2", free = {at = ["170 mm", 0]}}
joints.main = {revolute = ["ground", "crank"]}
joints.wrist.revolute = ["rod.end", "piston"]
joints.pin.revolute = ["crank.end", "rod"]
joints.pin.clearance.radial = "50 um"
joints.pin.clearance.width = "20 mm"
joints.pin.clearance.contact = {materials = ["steel", "steel"], load = "1 kN", restitution = 0.8}
joints.pin.clearance.friction = {mu = 0.05}
joints.bore.prismatic = ["ground", "piston"]
joints.bore.direction = [1, 0]
joints.bore.clearance.gap = "80 um"
joints.bore.clearance.length = "60 mm"
joints.bore.clearance.contact = {stiffness = 1e10, restitution = 0.6}
joints.bore.clearance.friction = {mu = 0.1}
drives.main = {speed = "600 rpm"}
drives.wrist = {free = true, initial_speed = "250 rpm"}
sensors.knock = {contact_force = "pin"}
solve = {preset = "coupled", duration = "6 ms", steps = 120}
"""
RIG = ("engine-rig-clearance", "solve.duration=1.5 s", "solve.steps=15000")
TURN = 60 / 42.36
HARD = 'contact = {law = "newton", restitution = 0.7}'
SMOOTH = "bore.clearance.friction=none"
READ = "Acceleration, body axes, as an accelerometer reads"


@pytest.fixture(scope="module")
def loose(tmp_path_factory):
    path = tmp_path_factory.mktemp("loose") / "scene.toml"
    path.write_text(LOOSE)
    return run(str(path))


@pytest.fixture(scope="module")
def rig():
    return run(*RIG)


def values(solution, *names):
    return [solution.series[name].values for name in names]


def test_a_pin_is_where_its_bodies_have_it(loose):
    x, y, slide = values(loose, "pin_x", "pin_y", "slide")
    end_x, end_y, angle = values(loose, "rod_end_x", "rod_end_y", "rod_end_angle")
    assert x == pytest.approx(slide - end_x, abs=1e-15)
    assert y == pytest.approx(-end_y, abs=1e-15)
    assert np.hypot(x, y) == pytest.approx(2e-4 - loose.trajectory.contacts.gap[:, 0], abs=1e-15)
    own_x, own_y, swing = values(loose, "own_x", "own_y", "swing")
    assert swing == pytest.approx(-angle, abs=1e-12)
    assert own_x + 1j * own_y == pytest.approx((x + 1j * y) * np.exp(-1j * angle), abs=1e-15)
    assert np.abs(np.sin(angle)).max() > 0.4  # so that the axes are not the same


def test_results_have_where_pins_and_blocks_are(loose, rig):
    found = loose.dataset
    assert found.clearance.values.tolist() == ["wrist"]
    ratio = np.hypot(*values(loose, "pin_x", "pin_y")) / 2e-4
    assert found.eccentricity.values[:, 0] == pytest.approx(ratio, abs=1e-11)
    assert found.eccentricity.max() > 1.0 > found.eccentricity[0, 0] == pytest.approx(0.0, abs=1e-9)
    assert found.clearance_y.values[:, 0] == pytest.approx(values(loose, "pin_y")[0], abs=0)
    block = rig.dataset
    across, tilt, place = values(rig, "piston_across", "piston_tilt", "piston_position")
    assert block.clearance_angle.values[:, 0] == pytest.approx(tilt, abs=0)
    assert block.clearance_x.values[:, 0] == pytest.approx(place - 0.005 * np.cos(tilt), abs=1e-12)  # of its middle
    results = {*CONTACT_RESULTS, *FRICTION_RESULTS}
    assert set(block.variables) - set(rig.series) - set(block.coords) < results > set(block.coords) - {
        "time", "drive_angle_main", "drive_angle_pin", "drive_angle_wrist",
    }  # fmt: skip
    for k, (side, end) in enumerate([(-1, -1), (-1, 1), (1, -1), (1, 1)]):  # of a rectangle of 60 by 72 mm
        corner = across + end * 0.03 * np.sin(tilt) + side * 0.036 * np.cos(tilt)
        assert block.contact_gap.values[:, k] == pytest.approx(0.036 + 5e-5 - side * corner, abs=1e-14)
    assert block.eccentricity.values[:, 0] == pytest.approx(1 - block.contact_gap.values.min(axis=1) / 5e-5, abs=1e-9)
    assert np.abs(tilt).max() > 1e-4


def test_the_rig_knocks_after_each_dead_centre_as_long_as_a_free_piston_takes_across():
    """m x'' = F' t across 2 x 50 um, F' = (m_p + m_r/2)(g + a) omega_rod, m = m_p + m_r/3: the rod turns on its pin."""
    settings = ("bodies.piston.centre=[1e-9, 0]", "bodies.piston.points.middle=[1e-9, 0]", "solve.duration=1.48 s")
    found = run("engine-rig-clearance", *settings, SMOOTH, "solve.steps=1480", "solve.tolerance=1e-8")
    omega, r, l = 2 * math.pi / TURN, 0.04, 0.137
    assert np.abs(found.series["piston_tilt"].values).max() < 1e-8  # everything acts at its middle
    for k, (begin, end) in enumerate(impact_zones(found)[1:]):
        accelerated = -r * omega**2 * (1 + r / l) if k else r * omega**2 * (1 - r / l)  # of the piston, upwards
        rate = (0.214 + 0.153 / 2) * (9.81 + accelerated) * omega * r / l
        across = (6 * (0.214 + 0.153 / 3) * 1e-4 / rate) ** (1 / 3)
        assert begin - (k + 1) * TURN / 2 == pytest.approx(across, rel=0.04)
        assert end - begin < 0.04


def test_the_rig_reads_two_zones_of_impacts_in_a_turn(rig):
    """The rest is the sinusoid of a tight rig: gravity across the rod that swings."""
    times, zones = rig.times, impact_zones(rig)
    assert [360 * begin / TURN for begin, _ in zones] == pytest.approx([7.0, 188.4, 368.9], abs=0.1)
    assert [360 * end / TURN for _, end in zones] == pytest.approx([12.1, 195.8, 376.1], abs=0.1)
    (read,) = values(rig, "rod_mid_acceleration_y")
    inside = np.any([(times >= begin) & (times < end + 0.015) for begin, end in zones], axis=0)
    quiet = ~inside & (times > 0.05)
    tight = run("engine-rig", "solve.preset=rigid", "solve.duration=1.5 s", "solve.steps=15000")
    (tight,) = values(tight, "rod_mid_acceleration_y")
    flying = np.any([(times >= k * TURN / 2) & (times < begin) for k, (begin, _) in enumerate(zones)], axis=0)
    assert np.abs(read - tight)[quiet & ~flying].max() < 0.02 < 0.2 < np.abs(read - tight)[flying].max()
    assert np.abs(read)[quiet].max() == pytest.approx(2.5, abs=0.1)
    assert np.abs(read).max() == pytest.approx(16.6, abs=0.2)
    frequencies, amplitudes = spectrum(times, read)
    ringing = (frequencies > 2500) & (frequencies < 4000)
    assert frequencies[ringing][amplitudes[ringing].argmax()] == pytest.approx(3236, rel=0.03)


@pytest.fixture(scope="module")
def drawn(loose, rig):
    with styled():
        return {**clearances.figures(loose), **clearances.figures(rig), **sensors.figures(rig), **spectra.figures(rig)}


def panels(figure):
    return {axes.get_title(loc="left"): axes for axes in figure.axes}


def lines(axes):
    return {line.get_label(): line for line in axes.lines}


def test_the_journal_is_drawn_in_its_circle(loose, drawn):
    assert drawn["clearance_wrist"].get_suptitle() == "Clearance of wrist: 0.2 mm in radius"
    axes = panels(drawn["clearance_wrist"])
    path = axes["Path in the bearing, global axes"]
    assert path.patches[0].radius == pytest.approx(0.2)
    drawn_path, touching = (np.array(lines(path)[key].get_data()) for key in ("path of the pin's middle", "in contact"))
    assert drawn_path == pytest.approx(1e3 * np.array(values(loose, "pin_x", "pin_y"))[:, view(loose).instants])
    closed = loose.trajectory.contacts.gap[view(loose).instants, 0] < 0
    assert (np.isfinite(touching[0]) == closed).mean() > 0.99  # one that has let go may be in its bearing still
    begins = np.hypot(*lines(path)[f"impacts ({len(loose.impacts)})"].get_data())
    assert begins == pytest.approx(np.full(len(loose.impacts), 0.2), abs=2e-3)
    force = lines(axes["Contact forces"])
    peak = max(impact.peak for impact in loose.impacts)
    markers = [line for line in axes["Contact forces"].lines if line.get_marker() == "v"]
    assert 1e3 * max(markers[0].get_ydata()) == pytest.approx(peak) and "force" in force


def test_a_block_is_drawn_between_its_faces(rig, drawn):
    axes = panels(drawn["clearance_bore"])
    path = axes["Position across the guide over the tilt"]
    rhombus = path.patches[0].get_xy()
    assert np.abs(rhombus).max(axis=0) == pytest.approx([1e3 * 5e-5 / 0.03, 0.05])
    tilt, place = lines(path)["path of the block"].get_data()
    inside = np.abs(tilt) / np.abs(rhombus).max(axis=0)[0] + np.abs(place) / 0.05
    assert 1.0 < inside.max() < 1.06  # but for how deep it is in its bore
    ratio = lines(axes["Eccentricity over the clearance"])["eccentricity"].get_ydata()
    assert 1.0 < ratio.max() < 1.06 and ratio.min() < 0.1


def test_sensors_of_a_bench_shade_the_zones_of_impacts(rig, drawn):
    axes = panels(drawn["sensors"])
    assert READ in axes and "Position in a clearance" in axes
    for panel in axes.values():
        names = [text.get_text() for text in panel.get_legend().get_texts()]
        assert names[-1] == "impact zones (3)"
        assert isinstance(panel.patches[0], matplotlib.patches.Rectangle)
        begins = [patch.get_x() for patch in panel.patches]
        assert begins == pytest.approx([zone[0] for zone in impact_zones(rig)], abs=1e-3)
    # thinned instants keep the peaks of impacts
    (read,) = values(rig, "rod_mid_acceleration_y")
    assert np.abs(lines(axes[READ])["rod_mid_acceleration_y"].get_ydata()).max() == np.abs(read).max()


def test_spectra_of_all_accelerations_know_a_loose_mechanisms_frequencies(drawn):
    axes = panels(drawn["spectra"])
    assert list(axes)[:4] == ["rod_mid_acceleration_x", "rod_mid_acceleration_y", "piston_acceleration", "piston_knock"]
    last = drawn["spectra"].axes[-1]
    assert last.get_xscale() == "log" and last.get_xlabel() == "frequency [Hz]"
    marked = [line.get_xdata()[0] for line in axes["piston_knock"].lines[1:]]
    assert marked == pytest.approx([0.706, 3235.9, 4550.1], rel=1e-3)


def test_the_largest_force_of_a_contact_is_that_of_its_impacts(loose):
    from kaneflex.report.summary import sensor_summaries

    coarse = run("slider-crank-clearance", "solve.duration=8 ms", "solve.steps=80", "solve.errors=none")
    for found in (loose, coarse):
        force, summary = found.series["pin_force"].values, sensor_summaries(found)["pin_force"]
        assert summary.max == max(impact.peak for impact in found.impacts) >= force.max()
        assert summary.rms == pytest.approx(np.sqrt(np.trapezoid(force**2, found.times) / found.times[-1]))
    hardest = max(coarse.impacts, key=lambda impact: impact.peak)
    assert coarse.series["pin_force"].values.max() < 0.99 * hardest.peak
    assert hardest.begin <= sensor_summaries(coarse)["pin_force"].at_max.time_s <= hardest.end


def test_the_largest_force_of_a_lasting_contact_is_that_of_its_greatest_load(tmp_path):
    # at 150 Hz, far below the contact's frequency, the force is the load
    (tmp_path / "block.toml").write_text(machine(
        bodies=dict(block="mass = 1, inertia = 1e-3, free = {at = [0, 0]}"),
        contacts=dict(floor='point_on_line = ["block", "ground"], normal = [0, 1], contact = {law = "kelvin-voigt", '
                      'stiffness = 1e8, exponent = 1, damping = 5000}'),
        loads=dict(press='force_on = "block", direction = [0, -1], law = "100 - 60 * cos(2 * pi * 150 * t)"'),
        sensors=dict(force="contact_force floor"), solve=dict(preset="coupled", duration="5 ms", steps=20),
    ))  # fmt: skip
    solution = run(str(tmp_path / "block.toml"))
    found = solution.statistics("force")
    assert len(solution.impacts) == 1 and found.max == pytest.approx(160.0, rel=5e-3)
    assert solution.times[found.at_max] == pytest.approx(1.0 / 300.0, abs=0.25e-3)
    mark = lines(sensors.figures(solution)["sensors"].axes[0])["force: peaks of impacts"]
    assert mark.get_xdata() == [1e3 * solution.times[found.at_max]] and mark.get_ydata() == [found.max]


def test_a_rig_with_friction_in_its_bore_knocks_where_one_without_does_and_knows_its_rods_forces():
    end = ("solve.duration=0.1 s", "solve.steps=1000")
    smooth, rubs = run("engine-rig-clearance", *end, SMOOTH), run("engine-rig-clearance", *end)
    assert rubs.impacts[0].begin == pytest.approx(smooth.impacts[0].begin, rel=1e-3)
    (plain,), (rubbed,) = (values(solution, "rod_force_piston") for solution in (smooth, rubs))
    pressed = rubs.dataset.friction_force.values.sum(axis=1)
    late = rubs.times > 0.08  # it lies on, goes down, and friction bears a part of its weight
    assert rubbed[late] - plain[late] == pytest.approx(-pressed[late], rel=0.02) and pressed[late].max() < -0.02


@pytest.mark.parametrize("deep", [False, True])
def test_a_shaft_wears_its_bearing_where_it_lies(tmp_path, deep):
    """A journal that turns leftwards climbs to the left until gravity balances friction, at the angle atan(mu)."""
    spin = "angular_velocity = [0, 0, 200]" if deep else "angular_speed = 200"
    inertia = "[2e-6, 2e-6, 2e-6]" if deep else "2e-6"
    rubs, law = '{mu = 0.3, wear = "1e-6 mm^3/(N m)"}', "{stiffness = 1e7, exponent = 1, restitution = 0.1}"
    shape = f'radial = "50 um", radius = "10 mm", friction = {rubs}, contact = {law}'
    shape += ', length = "40 mm", axial = "1 mm"' * deep
    (tmp_path / "journal.toml").write_text(machine(
        gravity=[0, -9.81, 0][: 2 + deep],
        bodies=dict(shaft=f"mass = 0.1, inertia = {inertia}, free = {{at = {[0, -5e-5, 0][:2 + deep]}, {spin}}}"),
        joints=dict(main=f"revolute ground shaft{', axis = [0, 0, 1]' * deep}, clearance = {{{shape}}}"),
        solve=dict(preset="coupled", duration="20 ms", steps=400),
    ))  # fmt: skip
    solution = run(str(tmp_path / "journal.toml"))
    total = sum(each.worn for each in friction_summaries(solution).values())
    turned = 200 * 0.01 * 0.02 - 0.5 * 0.3 * 9.81 * 0.1 * 1e-4 / 2e-6 * 0.02**2  # while its friction slows it down
    assert total == pytest.approx(1e-15 * 0.981 * turned, rel=0.1)
    with styled():
        rose = clearances.figures(solution)["wear_main"].axes[0]
    heights = np.array([bar.get_height() for bar in rose.patches])
    middles = np.array([bar.get_x() + 0.5 * bar.get_width() for bar in rose.patches])
    lies = np.angle(np.sum(heights * np.exp(1j * middles)))
    side = 1 if deep else -1  # pictures in space look along the axis
    assert lies == pytest.approx(-np.pi / 2 + side * np.arctan(0.3), abs=0.05)
    assert heights.sum() == pytest.approx(1e18 * total, rel=1e-9)


def test_what_slips_with_hardly_any_acceleration_keeps_its_speed_and_jams_nothing(tmp_path):
    """Its pin lets slip at 5.46 ms, as slowly as rounding: nothing is to stop it at once, which would cost 3 uJ."""
    path = tmp_path / "scene.toml"
    path.write_text(RUBS)
    solution = run(str(path))
    frictions = solution.trajectory.frictions
    assert {impact.contact for impact in solution.impacts} == {"pin", "bore_3", "bore_4"}
    for impact in solution.impacts:
        turned = 20 * np.pi * impact.begin
        if impact.contact == "pin":
            across = impact.x - 0.05 * np.cos(turned), impact.y - 0.05 * np.sin(turned)
            assert np.hypot(*across) == pytest.approx(50e-6, rel=1e-6)
        else:
            assert impact.y == pytest.approx(80e-6, rel=1e-9)
    assert solution.trajectory.energy.drift < 1e-9
    assert np.isnan(frictions.jams).all() and not solution.warnings
    assert (frictions.mode[:, 0] == 2).any() and abs(frictions.speed[-1, 0]) > 1e-3


def test_rigid_sides_rest_by_the_reactions_of_joints_that_rub(tmp_path):
    """A piston with room knocks from side to side and its pin rubs: what rests bears what that friction leaves."""
    text = RUBS + 'joints.wrist.friction = {mu = 0.05, radius = "8 mm"}\n'
    text = text.replace('contact = {materials = ["steel", "steel"], load = "1 kN", restitution = 0.8}', HARD)
    text = text.replace('joints.pin.clearance.width = "20 mm"\n', "").replace('"50 um"', '"1 um"')
    soft = "contact = {stiffness = 1e10, restitution = 0.6}\njoints.bore.clearance.friction = {mu = 0.1}"
    text = text.replace(soft, HARD.replace("0.7", "0"))
    text = text.replace('"80 um"', '"1 mm"')
    path = tmp_path / "scene.toml"
    path.write_text(text)
    solution = run(str(path), "solve.duration=0.05 s", "solve.steps=250")
    assert solution.outcome is Outcome.COMPLETED and len(solution.impacts) > 20
    assert solution.trajectory.energy.drift < 1e-6
    assert solution.trajectory.contacts.force.min() > -1e-6
