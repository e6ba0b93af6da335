"""Friction where rigid sides meet, Newton's law: impulses along a face and in joints, sliding and sticking at rest."""

import itertools
import math

import numpy as np
import pytest
from machines import changed, machine
from runs import names_of
from scipy.integrate import solve_ivp
from test_friction import CRANK, FALLING, ROD, solved

from kaneflex import SceneError
from kaneflex.integrate.system import Outcome
from kaneflex.multibody.model.layout import BENDING, OPEN

G = 9.81
DISC = machine(
    gravity=[0, "-9.81 m/s^2"],
    bodies=dict(disc='mass = "2 kg", inertia = "0.01 kg m^2", centre = [0, 0], '
                     'free = {at = [0, "0.6 m"], velocity = [2, 0]}'),
    contacts=dict(floor='point_on_line = ["disc", "ground"], normal = [0, 1], radius = "0.1 m", '
                        'contact = {law = "newton", restitution = 0.5}, friction = {mu = 0.1}'),
    sensors=dict(x="position disc x"), solve=dict(preset="coupled", duration="0.4 s", steps=40),
)


@pytest.mark.parametrize("mu", [0.01, 0.1, 0.28, 0.29, 0.35, 2.0])
@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_a_disc_that_bounces_is_spun_by_its_floor(mu, e):
    """mu (1 + e) v_n while it slips, else what ends the slip: v_t/(1/m + R^2/J) (Brach 1991, Mechanical Impact
    Dynamics, ch. 2).
    """
    found = solved(DISC, f"floor.friction.mu={mu}", f"floor.contact.restitution={e}")
    (fallen, *_), v_n = found.impacts, math.sqrt(G)
    assert fallen.impulse - 2 * G * (0.4 - fallen.begin) * (e == 0) == pytest.approx(2 * (1 + e) * v_n, rel=1e-10)
    drag = min(mu * 2 * (1 + e) * v_n, 2 / (1 / 2 + 0.1**2 / 0.01))
    after = np.searchsorted(found.times, fallen.begin + 1e-9)
    slides = e == 0 and drag < 1.33  # what doesn't bounce goes on sliding
    more = mu * 2 * G * (found.times[after] - fallen.begin) if slides else 0.0
    vx, _, omega = found.trajectory.v[after]
    assert vx == pytest.approx(2 - (drag + more) / 2, rel=1e-9)
    assert omega == pytest.approx(-(drag + more) * 0.1 / 0.01, rel=1e-9)
    assert found.trajectory.frictions.lost[after, 0] == pytest.approx(
        drag * (2 + 2 - drag * 1.5) / 2, rel=1e-9 if not slides else 0.2
    )


@pytest.mark.parametrize("law", ['law = "newton"', "stiffness = STIFF"])
def test_a_disc_bounces_alike_in_any_unit_of_length(law):
    """Bodies without lengths counted as 1 m long: in millimetres there were 16 bounces, in kilometres 26, of 21."""
    found = []
    for unit in (1.0, 1e-3, 1e3):
        text = DISC.replace('law = "newton"', law.replace("STIFF", repr(1e5 / math.sqrt(unit))))
        for old, new in (('"-9.81 m/s^2"', -G), ('"0.6 m"', 0.6), ('"0.1 m"', 0.1), ("[2, 0]", [2 * unit, 0.0])):
            text = text.replace(old, repr(new if isinstance(new, list) else new * unit))
        text = text.replace('"0.01 kg m^2"', repr(0.01 * unit**2))
        run = solved(text, "solve.duration=1.5 s")
        found.append([len(run.impacts), run.trajectory.steps, run.series["x"].values[-1] / unit])
    assert found[0] == pytest.approx(found[1], rel=1e-9) and found[0] == pytest.approx(found[2], rel=1e-9)


BLOCK = changed(
    FALLING, ("initial_speed = 3", "initial_speed = 2"), (', position = "50 mm"', ""),
    ("stiffness = 1e8, restitution = 0.6", 'law = "newton", restitution = 0.4'),
    ("mu = 0.2, mu_static = 0.3", "mu = 0.3"), ('"1 s", steps = 400', '"2 s", steps = 100'),
    ("", 'sensors.push = {contact_force = "floor"}'),
)  # fmt: skip


@pytest.mark.parametrize("integrator", ["radau", "gauss"])
def test_a_block_that_is_thrown_on_a_table_stops(integrator):
    """A mass of 3 that a weight of 2 g brakes: v^2/(2 mu g 2/3), and there it stays."""
    found = solved(BLOCK, f"solve.integrator={integrator}")
    slower = 0.3 * G * 2 / 3
    t = np.minimum(found.times, 2 / slower)
    assert found.series["x"].values == pytest.approx(2 * t - slower * t**2 / 2, abs=1e-12)
    assert found.series["x"].values[-1] == pytest.approx(4 / (2 * slower), rel=1e-12)
    assert found.trajectory.frictions.lost[-1, 0] == pytest.approx(6.0, rel=1e-12)
    # on the block, along the normal turned by 90 degrees: against x
    assert found.series["drag"].values[1:] == pytest.approx(np.where(found.times < 2 / slower, 0.6 * G, 0.0)[1:])
    assert found.series["push"].values[1:] == pytest.approx(2 * G, rel=1e-12)


def test_between_stored_instants_a_block_stops_when_it_stops():
    """A quintic across the stop was off by millimetres, and an event near it late."""
    found = solved(BLOCK, "solve.steps=5")
    slower, t = 0.3 * G * 2 / 3, np.linspace(0.0, 2.0, 201)
    moving, between = np.minimum(t, 2 / slower), found.at(t)
    assert between.series["x"].values == pytest.approx(2 * moving - slower * moving**2 / 2, abs=1e-12)
    lost = np.where(t < 2 / slower, 0.6 * G * between.series["x"].values, 6.0)
    assert between.energy.dissipated == pytest.approx(lost, rel=1e-9, abs=1e-12)


STOPPED = machine(
    description="A weight pulls a block over a pulley; the block stops at the pulley", gravity=[0, "-9.81 m/s^2"],
    ground=dict(top=[0, "1 m"]), bodies=dict(block='mass = "1 kg"', weight='mass = "1 kg"'),
    joints=dict(table="prismatic ground.top block, direction = [1, 0]",
                fall="prismatic ground.top weight, direction = [0, -1]"),
    drives=dict(table='free = true, position = "-0.5 m"', fall='free = true, position = "0.5 m"'),
    loads=dict(rope_block='force_on = "block", direction = [1, 0], law = "ROPE"',
               rope_weight='force_on = "weight", direction = [0, 1], law = "ROPE"'),
    contacts=dict(stop='point_on_line = ["block", "ground.top"], normal = [-1, 0], '
                       'contact = {law = "newton", restitution = 0}'),
    sensors=dict(x="position table x"), events=dict(arrive='sensor = "x", value = -1e-9, direction = "up"'),
    solve=dict(preset="coupled", duration="0.6 s", steps=300),
).replace("ROPE", "max(0, 1e6*(fall - table - 1) + 300*(fall_speed - table_speed))")


def test_an_event_just_before_an_impact_is_when_that_is():
    """It was found at 0.451992 s, on a curve across the kink of the impact at 0.451525 s."""
    found = solved(STOPPED)
    first = found.impacts[0]
    assert found.events["arrive"] == pytest.approx([first.begin - 1e-9 / first.approach], abs=1e-12)
    # half of g pulls two equal masses, but for what the rope gives
    assert first.begin == pytest.approx(math.sqrt(2 * 0.5 / (G / 2)), rel=1e-4)


def test_a_block_that_falls_as_it_slides_stops_by_all_its_impulses():
    """Bounces or not: while it slides friction has mu times the impulse of the floor."""
    found = solved(BLOCK, "fall.position=50 mm", "floor.contact.restitution=0.6")
    names = names_of(found.model.coupled)
    x, y = (found.trajectory.v[:, names.index(name)] for name in ("carriage.x", "block.y"))
    sliding = x > 1e-9
    assert 3 * (x - 2)[sliding] == pytest.approx(-0.3 * 2 * (G * found.times + y)[sliding], abs=1e-9)
    assert (found.series["x"].values[~sliding] == found.series["x"].values[-1]).all() and len(found.impacts) > 10


@pytest.mark.parametrize(("mu", "static"), [(0.49, 0.49), (0.51, 0.51), (0.4, 0.6)])
def test_a_block_rests_on_an_incline_without_a_creep_or_slides_down(mu, static):
    """On a slope of 0.5, but for its carriage: it holds to mu_static, moves by mu."""
    text = BLOCK.replace('[0, "-9.81 m/s^2"]', f"[{G / 3}, {-G}]")
    text = text.replace("mu = 0.3", f"mu = {mu}, mu_static = {static}")
    found = solved(text, "way.initial_speed=0 m/s")
    if static >= 0.5:
        assert abs(found.series["x"].values).max() < 1e-15 and (found.trajectory.frictions.mode[1:] == 2).all()
        assert found.series["drag"].values[1:] == pytest.approx(G, rel=1e-12)  # to the left
    else:
        down = (G - mu * 2 * G) / 3
        assert found.series["x"].values == pytest.approx(down * found.times**2 / 2, rel=1e-9)


STRUCK = machine(
    bodies=dict(block='mass = "2 kg"',
                ball='mass = "1 kg", inertia = "0.001 kg m^2", '
                     'free = {at = ["-0.24 m", "-0.18 m"], velocity = [4, 3]}'),
    joints=dict(guide="prismatic ground block, direction = [1, 0], friction = {mu = 0.5}"),
    drives=dict(guide="free = true"),
    contacts=dict(hit='circle_on_circle = ["ball", "block"], radii = ["0.1 m", "0.1 m"], '
                      'contact = {law = "newton", restitution = 0.6}'),
    sensors=dict(x="position guide"), solve=dict(preset="coupled", duration="0.1 s", steps=10),
)


@pytest.mark.parametrize("mu", [0.0001, 0.5, 1.2, 1.4, 2.0])
def test_a_guide_that_is_hit_rubs_by_its_own_impulse_or_jams(mu):
    """Along 0.8, 0.6: p (c (c - mu s)/M + 1/m) = (1 + e) v; above c/s the block doesn't move."""
    found = solved(STRUCK, f"guide.friction.mu={mu}")
    along = max(0.8 - mu * 0.6, 0.0)
    p = 1.6 * 5 / (0.8 * along / 2 + 1)
    (impact,) = found.impacts
    assert (impact.begin, impact.impulse) == (pytest.approx(0.02, rel=1e-9), pytest.approx(p, rel=1e-11))
    slides = found.times[found.times > 0.02] - impact.begin
    assert found.series["x"].values[found.times > 0.02] == pytest.approx(p * along / 2 * slides, abs=1e-10)
    lost = found.trajectory.frictions.lost[-1, 0]
    assert lost == pytest.approx(mu * p * 0.6 * p * along / 4 if along else 0.0, rel=1e-9)


def test_a_pin_that_is_hit_rubs_by_its_own_impulse():
    """The rod turns by I w = p a - mu r |L|, L = M (l/2) w - p is what the pin has."""
    text = STRUCK[: STRUCK.index("joints.")].replace(
        'block = {mass = "2 kg"}', 'rod = {length = "1 m", mass = "3 kg", inertia = "0.25 kg m^2", centre = [0.5, 0]}'
    ).replace('at = ["-0.24 m", "-0.18 m"], velocity = [4, 3]', 'at = ["0.4 m", "-0.1 m"], velocity = [0, 5]')
    text += """
joints.pin = {revolute = ["ground", "rod"], friction = {mu = 0.5, radius = "0.2 m"}}
drives.pin = {free = true}
contacts.hit = {point_on_line = ["ball", "rod"], normal = [0, -1], contact = {law = "newton", restitution = 0.6}}
sensors.turn = {position = "pin", component = "angle"}
""" + STRUCK[STRUCK.index("solve =") :]
    found = solved(text)
    torque, a, inertia, moment = 0.5 * 0.2, 0.4, 1.0, 3 * 0.5
    per_p = (a - torque) / (inertia - torque * moment)
    p = 1.6 * 5 / (a * per_p + 1)
    impact = found.impacts[0]
    assert (impact.begin, impact.impulse) == (pytest.approx(0.02, rel=1e-9), pytest.approx(p, rel=1e-10))
    omega = per_p * p
    share = torque * moment / inertia
    slower = share / math.sqrt(1 - share**2)  # w' = -mu r |L|/I, L = M (l/2) (w^2, w')
    since = found.times - impact.begin
    turned = np.where(since > 0, np.log1p(np.maximum(slower * omega * since, 0)) / slower, 0.0)
    before = since < 0
    assert found.series["turn"].values[before] == pytest.approx(0.0, abs=1e-15)
    assert found.series["turn"].values[~before] == pytest.approx(turned[~before], rel=1e-7)


def on_floor(points, mu, restitution):
    """Contacts of points of a body with the ground."""
    rubs = f", friction = {{mu = {mu}}}" if mu else ""
    law = f'normal = [0, 1], contact = {{law = "newton", restitution = {restitution}}}{rubs}'
    return {point.rpartition(".")[2]: f'point_on_line = ["{point}", "ground"], {law}' for point in points}


BOX = machine(
    gravity=[0, "-9.81 m/s^2"],
    bodies=dict(box='mass = "1 kg", inertia = "0.02 kg m^2", centre = [0, 0], '
                    "points = {a = [-0.2, -0.1], b = [0.2, -0.1], c = [0.2, 0.1], d = [-0.2, 0.1]}, "
                    'free = {at = [0, "0.5 m"], angle = "20 deg", velocity = [2, 0], angular_speed = 3}'),
    contacts=on_floor([f"box.{corner}" for corner in "abcd"], 0.5, 0.5), sensors=dict(x="position box x"),
    solve=dict(preset="coupled", duration="3 s", steps=300),
)


def test_a_box_tumbles_to_rest_whatever_its_friction_and_restitution():
    """Two corners land, rock and rest; the books are closed, and nothing that doesn't bounce for ever moves at last."""
    for mu, e in itertools.product((0.001, 0.3, 1.0, 2.0), (0.0, 0.3, 0.7, 1.0)):
        keys = f"contact.restitution={e}", f"friction.mu={mu}"
        found = solved(BOX, *(f"contacts.{corner}.{key}" for corner in "abcd" for key in keys))
        v, record = found.trajectory.v, found.trajectory.frictions
        assert np.isfinite(v).all() and found.trajectory.contacts.gap.min() > -1e-12
        assert (abs(record.force) <= mu * record.pressed * (1 + 1e-9) + 1e-12).all()
        assert e > 0 or np.diff(found.trajectory.energy.dissipated).min() > -1e-12
        if e < 1 and mu > 0.1:
            assert abs(v[-1]).max() < 1e-12 and (record.mode[-1] == 2).sum() == 2


def test_a_box_stays_where_its_corners_stick():
    """Impulses found anew let a corner slip and stick again: it returned to a place 1 m away, without a speed."""
    rng = np.random.default_rng(5)
    for mu, e in itertools.product((1.0, 2.0), (0.3, 0.6)):
        for _ in range(6):
            begun = f"free.angle={rng.uniform(0, 360)} deg", f"free.angular_speed={rng.uniform(-5, 5)}"
            keys = f"contact.restitution={e}", f"friction.mu={mu}"
            corners = (f"contacts.{corner}.{key}" for corner in "abcd" for key in keys)
            found = solved(BOX, *(f"bodies.box.{key}" for key in begun), *corners)
            times, v, moved = found.times, abs(found.trajectory.v[:, 0]), abs(np.diff(found.trajectory.q[:, 0]))
            fastest = max(v.max(), 0.25 * abs(found.trajectory.v[:, 2]).max())  # corners are 0.22 m from the centre
            assert (moved < 2 * fastest * np.diff(times) + 1e-9).all()
            rests = (found.trajectory.frictions.mode[:-1] == 2).sum(axis=1) == 2
            assert moved[rests].max(initial=0.0) < 1e-12


@pytest.mark.parametrize(("points", "mu"), [(3, 0.8), (5, 0.8), (8, 0.8), (12, 0.8), (12, 0.0)])
def test_a_rod_comes_to_rest_on_more_points_than_it_needs(points, mu):
    """Two would do: loads shared by all of them pull at some, which then part and close without end."""
    rng = np.random.default_rng(points)
    for angle in (0.0, *rng.uniform(-0.3, 0.3, 5)):
        places = np.linspace(-0.5, 0.5, points) + rng.uniform(-0.02, 0.02, points)
        named = ", ".join(f"p{k} = [{x}, 0]" for k, x in enumerate(places))
        height = 0.021 + 0.5 * abs(math.sin(angle))
        begun = f"at = [0, {height}], angle = {angle}, angular_speed = {rng.uniform(-2, 2)}, velocity = [0.5, 0]"
        text = machine(
            gravity=[0, -G], contacts=on_floor([f"rod.p{k}" for k in range(points)], mu, 0.3),
            bodies=dict(rod=f"mass = 1, inertia = 0.08, centre = [0, 0], points = {{{named}}}, free = {{{begun}}}"),
            sensors=dict(x="position rod x"), solve=dict(preset="coupled", duration="1 s", steps=40),
        )
        record = solved(text).trajectory
        assert record.contacts.gap.min() > -1e-12 and record.contacts.force.min() >= 0.0
        assert record.contacts.force[-1].sum() == pytest.approx(G, rel=1e-9)
        assert abs(record.v[-1][1:]).max() < 1e-12


@pytest.mark.parametrize(("mu", "e"), [*itertools.product((0.05, 0.3, 2.0), (0.0, 0.5))])
def test_a_disc_jams_between_two_steep_walls(mu, e):
    """Above mu = 0.3 no impulses give what restitution asks for; nothing bounces then, all is held."""
    wall = DISC[DISC.index("contacts.") : DISC.index("sensors.")]
    sides = ("left", 1), ("right", -1)
    walls = [wall.replace("floor", name).replace("[0, 1]", f"[{way}, 0.3]") for name, way in sides]
    text = DISC.replace(wall, "".join(walls)).replace("[2, 0]}", "[0.3, 0], angular_speed = 5}")
    keys = f"friction.mu={mu}", f"contact.restitution={e}"
    settings = [f"contacts.{name}.{key}" for name in ("left", "right") for key in keys]
    found = solved(text, "solve.duration=2 s", *settings)
    assert abs(found.trajectory.v[-1]).max() < 1e-12 and (found.trajectory.frictions.mode[-1] == 2).all()
    push, drag = found.trajectory.contacts.force[-1], found.trajectory.frictions.force[-1]
    up = 2 * 0.3 / math.hypot(1, 0.3) * push.mean() + (drag[0] - drag[1]) / math.hypot(1, 0.3)
    assert up == pytest.approx(2 * G, rel=1e-9) and push.min() > 0


KNOCKED = CRANK + """
bodies.ball.mass = "1 kg"
joints.lane = {prismatic = ["ground", "ball"], direction = [1, 0]}
drives.lane = {free = true, position = "0.42 m", initial_speed = -1}
contacts.hit.circle_on_circle = ["ball", "piston"]
contacts.hit.radii = ["10 mm", "10 mm"]
contacts.hit.contact = {law = "newton", restitution = 0.6}
"""


def test_a_mechanism_whose_joints_rub_is_hit_until_it_stands():
    """A ball in a lane knocks on the piston, which has no inertia of its own, without end of one, or by jamming."""
    for mu in (0.1, 1.0):
        found = solved(KNOCKED, "solve.duration=1 s", f"wrist.friction.mu={mu}", f"bore.friction.mu={mu}")
        record = found.trajectory.frictions
        assert len(found.impacts) > 1 and (np.diff(record.lost, axis=0) > -1e-9).all()
        assert (record.force * record.speed <= 1e-9).all()


RIGID_ROD = ROD.replace("stiffness = 1e7, restitution = 0.5", 'law = "newton", restitution = 0.5')


@pytest.mark.parametrize("angle", [60, 120])
def test_painleves_rod_is_stopped_by_its_first_impact_or_slides(angle):
    """Pushed before its centre of mass, above mu = 4/3, the least impact has as much impulse as stops its end."""
    impulses = []
    for mu in (0.3, 1.0, 1.5, 2.0):
        found = solved(RIGID_ROD, f"floor.friction.mu={mu}", f"rod.free.angle={angle} deg")
        assert np.isfinite(found.trajectory.q).all()
        impulses.append(found.impacts[0].impulse)
    assert (impulses[2] > 20 * impulses[1]) == (angle == 60)


def test_friction_at_a_rigid_contact_is_checked_as_at_any():
    with pytest.raises(SceneError, match=r"floor.*friction\.radius.*does not apply to a contact"):
        solved(DISC.replace("mu = 0.1", "mu = 0.1, radius = 0.1"))


def bristly(mu, damping):
    return f'law = "lugre", mu = {mu}, bristle_stiffness = "1e5 N/m", bristle_damping = "{damping} N s/m"'


@pytest.mark.parametrize("damping", [0, 300])
def test_bristles_give_way_in_an_impact(damping):
    """Their force has a size by itself: a guide that is hit jumps as one that doesn't rub, and keeps its speed where
    nothing presses.
    """
    found = solved(STRUCK.replace("mu = 0.5", bristly(0.5, damping)))
    (impact,) = found.impacts
    p = 1.6 * 5 / (0.8**2 / 2 + 1)
    assert impact.impulse == pytest.approx(p, rel=1e-12)
    assert found.series["x"].values[-1] == pytest.approx(p * 0.8 / 2 * (0.1 - impact.begin), rel=1e-9)
    assert abs(found.trajectory.frictions.lost).max() < 1e-12


@pytest.mark.parametrize("integrator", ["radau", "gauss"])
def test_a_disc_that_is_thrown_on_a_floor_of_bristles_comes_to_roll(integrator):
    """Its own equations, by another integrator, from where it has fallen on."""
    settings = ["floor.contact.restitution=0", "solve.duration=1 s", f"solve.integrator={integrator}"]
    found = solved(DISC.replace("mu = 0.1", bristly(0.1, 300)), *settings)
    (fallen,), record = found.impacts, found.trajectory.frictions

    def rates(t, y):
        slip, dry = y[0] + 0.1 * y[1], 0.1 * 2 * G
        bends = slip - 1e5 * abs(slip) * y[2] / dry
        drag = 1e5 * y[2] + 300 * bends
        return [-drag / 2, -drag * 0.1 / 0.01, bends]

    after = found.times > fallen.begin
    own = solve_ivp(
        rates, (fallen.begin, 1), [2, 0, 0], method="Radau", rtol=1e-10, atol=1e-14, t_eval=found.times[after]
    )
    assert found.trajectory.v[after, 0] == pytest.approx(own.y[0], abs=1e-7)
    assert found.trajectory.v[after, 2] == pytest.approx(own.y[1], abs=1e-6)
    assert record.bristles[after, 0] == pytest.approx(-own.y[2], abs=1e-10)  # along the normal turned by 90 deg
    assert (record.mode[after] == BENDING).all() and (record.mode[~after] == OPEN).all()


def test_a_disc_that_bounces_on_bristles_keeps_its_spin_until_it_rests():
    found = solved(DISC.replace("mu = 0.1", bristly(0.1, 0)), "solve.duration=1 s")
    rests = next(impact for impact in found.impacts if impact.lasts)
    before = found.times < rests.begin
    assert (found.trajectory.v[before][:, [0, 2]] == [2, 0]).all() and len(found.impacts) > 10
    slowed = 0.1 * G * (found.times[-1] - rests.begin)
    assert found.trajectory.v[-1, 0] == pytest.approx(2 - slowed, rel=1e-4)


def test_a_block_on_its_corners_hangs_on_its_bristles():
    """Pulled by half of what makes it slide, it stays within its bristles' reach, its weight on two corners."""
    corner = 'contacts.NAME.point_on_line = ["block.NAME", "ground"]\ncontacts.NAME.normal = [0, 1]\n'
    corner += 'contacts.NAME.contact = {law = "newton", restitution = 0}\n'
    corner += f"contacts.NAME.friction = {{{bristly(0.5, 600)}}}\n"
    text = DISC[: DISC.index("bodies.")] + """
bodies.block.mass = "2 kg"
bodies.block.inertia = "0.01 kg m^2"
bodies.block.centre = [0, 0]
bodies.block.points = {left = [-0.1, -0.05], right = [0.1, -0.05]}
bodies.block.free = {at = [0, "0.05 m"]}
loads.pull = {force_on = "block", direction = [1, 0], law = "0.25 * 2 * 9.81"}
""" + corner.replace("NAME", "left") + corner.replace("NAME", "right") + DISC[DISC.index("sensors.") :].replace(
        'position = "disc"', 'position = "block"'
    )
    found = solved(text, "solve.duration=1 s")
    push, drag = found.trajectory.contacts.force[-1], found.trajectory.frictions.force[-1]
    assert drag.sum() == pytest.approx(0.25 * 2 * G, rel=1e-6)
    assert push == pytest.approx([G - 0.25 * 2 * G * 0.25, G + 0.25 * 2 * G * 0.25], rel=1e-6)  # arms 0.05 over 0.2
    most = 0.5 * push / 1e5  # z' = x' (1 - z/most) while both go up
    assert (1e5 * most * (1 - np.exp(-found.series["x"].values[-1] / most))).sum() == pytest.approx(
        drag.sum(), rel=2e-2
    )
    assert abs(found.trajectory.v[-1]).max() < 1e-9


@pytest.mark.parametrize("mu", [0.1, 1.0])
def test_a_mechanism_of_bristles_is_hit(mu):
    text = KNOCKED.replace("mu = 0.15", bristly(mu, 0))
    text = text.replace("{mu = 0.1,", f"{{{bristly(mu, 0).replace('N/m', 'N m/rad').replace('N s/m', 'N m s/rad')},")
    found = solved(text, "solve.duration=0.5 s")
    assert found.impacts and np.isfinite(found.trajectory.q).all() and found.trajectory.contacts.gap.min() > -1e-12


LANDS = """
schema = 1
gravity = GRAVITY
bodies.bar.length = 0.5
bodies.bar.beam = {material = "steel", section = {rectangle = ["10 mm", "20 mm"]}}
bodies.bar.free = {at = AT, angle = ANGLE, angular_speed = 5}
""" + "".join(f"""
contacts.at_{end}.point_on_line = ["bar.{end}", "ground"]
contacts.at_{end}.normal = UP
contacts.at_{end}.contact = {{law = "newton", restitution = 0}}
contacts.at_{end}.friction = {{mu = 2}}
""" for end in ("start", "end")) + """
damping.rayleigh = {ratio = "5 %", at = ["300 Hz", "3000 Hz"]}
sensors.x = {position = "bar.start", component = "x"}
sensors.y = {position = "bar.start", component = "y"}
solve = {preset = "coupled", duration = "0.11 s", steps = 20}
"""


@pytest.mark.exhaustive
def test_an_elastic_bar_lands_alike_in_any_direction(exhaustive):
    """Where its foot was about to part the run ended as Painleve's paradox, at instants that rounding chose."""
    found = []
    for angle in [0.0, *np.random.default_rng(1).uniform(0.0, math.tau, 7 if exhaustive else 2)]:
        c, s = math.cos(angle), math.sin(angle)
        vectors = {"GRAVITY": [s * G, -c * G], "AT": [-0.05 * s, 0.05 * c], "UP": [-s, c], "ANGLE": angle}
        text = LANDS
        for name, value in vectors.items():
            text = text.replace(name, str(np.asarray(value).tolist()))
        run = solved(text)
        x, y = (run.series[name].values[-1] for name in "xy")
        found.append([c * x + s * y, c * y - s * x])
    assert np.array(found) == pytest.approx(np.tile(found[0], (len(found), 1)), abs=1e-8)


@pytest.mark.parametrize("friction", ["mu = 0.05", 'preload = "0.4905 N"'])
@pytest.mark.parametrize("start", [-0.01, 0.004])
def test_a_block_whose_guide_rubs_rests_at_a_stop_until_it_is_pulled_off(friction, start):
    """Sticking in the guide holds what the stop holds, too: by closed forms of the way up to the stop and off it."""
    found = solved(f"""
schema = 1
gravity = [0, "-9.81 m/s^2"]
ground = {{stop = ["4 mm", 0]}}
bodies.block = {{mass = "1 kg"}}
joints.slide.prismatic = ["ground", "block"]
joints.slide.direction = [1, 0]
joints.slide.friction = {{{friction}}}
drives.slide = {{free = true, position = {start}}}
contacts.stop.point_on_line = ["block", "ground.stop"]
contacts.stop.normal = [-1, 0]
contacts.stop.contact = {{law = "newton", restitution = 0}}
loads.push = {{force_on = "block", direction = [1, 0], law = "4 - 20 * t"}}
sensors.x = {{position = "slide"}}
sensors.stop = {{contact_force = "stop"}}
sensors.rub = {{friction_force = "slide"}}
solve = {{preset = "coupled", duration = "0.5 s", steps = 100}}
""")
    t, x = found.times, found.series["x"].values
    on, off = t, np.maximum(t - (4 + 0.4905) / 20, 0)
    expected = np.minimum(start + (4 - 0.4905) * on**2 / 2 - 20 * on**3 / 6, 0.004)
    expected = np.where(t < 0.15, expected, 0.004 - 20 * off**3 / 6)
    rests = (0.12 < t) & (off == 0)
    assert found.outcome is Outcome.COMPLETED, found.message
    assert x == pytest.approx(expected, abs=1e-9)
    held = (found.series["stop"].values - found.series["rub"].values)[rests]
    assert held == pytest.approx((4 - 20 * t)[rests], abs=1e-9)
