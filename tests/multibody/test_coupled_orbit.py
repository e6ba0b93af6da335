"""Periodic motions under preset coupled, planar and in space: how their start is sought, what waiting leads to."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import tomlkit
from lifting import lifted
from machines import ABSORBER, machine
from runs import alike, names_of, shapes_of, solved, starts_of

import kaneflex
from kaneflex import SceneError, read_scene, scene_of, with_settings
from kaneflex.integrate.system import Outcome
from kaneflex.multibody.time.error_bounds import Method
from kaneflex.multibody.time.linearisation import Equations, prepare
from kaneflex.multibody.time.shooting import Cycles
from kaneflex.solve import coupled


def periodic(monkeypatch, name, *settings):
    """Solution of a periodic start, and how many cycles were integrated for it."""
    cycles, run = [], Cycles.run

    def counted(self, start):
        cycles.append(run(self, start))
        return cycles[-1]

    monkeypatch.setattr(Cycles, "run", counted)
    scene = kaneflex.with_settings(
        kaneflex.read_scene(name), ["solve.preset=coupled", "solve.start=periodic", *settings]
    )
    solution = solved(scene)
    return solution, len(cycles)


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("name, settings", [
    ("engine", []),
    ("engine", ["damping=none"]),
    ("quick-return", ["damping=none"]),
    ("four-bar", ["damping=none"]),  # whose links bend by 2 % of their length near a resonance
    ("engine", ["damping=none", "loads.gas.interpolation=linear"]),  # whose load has a kink every degree
])  # fmt: skip
def test_a_few_cycles_do_whether_or_not_anything_dies_away(monkeypatch, name, settings):
    solution, cycles = periodic(monkeypatch, name, *settings)
    q = solution.trajectory.q
    system = solution.model.coupled
    modal = [k for body in starts_of(system) for k in range(*shapes_of(system, body).indices(len(names_of(system))))]
    assert solution.outcome is Outcome.COMPLETED
    assert ("not known" in solution.message) == (settings != [])  # without damping nothing dies away, nor grows
    assert abs(q[-1] - q[0])[modal].max() <= 1e-5 * abs(q[:, modal]).max()
    assert cycles <= 2


def test_waiting_leads_to_the_same_motion(monkeypatch):
    """Where damping lets a transient die, cycle after cycle ends where the harmonics begin."""
    found, _ = periodic(monkeypatch, "four-bar")
    monkeypatch.setattr(coupled, "orbit_start", lambda *_: None)
    waited, cycles = periodic(monkeypatch, "four-bar")
    assert cycles > 2
    alike(found, waited, 3e-5)


def test_a_cycle_whose_disturbances_grow_says_so(monkeypatch):
    """In the first tongue of its pulsating force a strut would leave its motion for one of twice the period."""
    unstable, stable = "drives.clock.speed=2517 rpm", "drives.clock.speed=1800 rpm"
    found, _ = periodic(monkeypatch, "pulsating-strut", "solve.modes=1", unstable)
    assert found.outcome is Outcome.UNSTABLE and "unstable periodic motion" in found.message
    # by the linear equations, whose strut has no mode along it
    linear = kaneflex.load(kaneflex.with_settings(kaneflex.read_scene("pulsating-strut"), [unstable]))
    expected = kaneflex.solve.simulation.solve(linear).multipliers[0]
    assert found.multipliers[0] == pytest.approx(expected, rel=1e-3)
    # and by the nonlinear ones: a cycle beside it, in the direction that grows
    run = found.trajectory
    equations, start = prepare(found.model.coupled, run.curve(float(run.times[0])))
    cycles = Cycles(equations, run.times, coupled.method_of(found.model))
    values, directions = np.linalg.eig(cycles.monodromy(run))
    away = 1e-4 * directions[:, abs(values).argmax()].real / abs(directions).max()
    beside = cycles.run(cycles.moved(start, away))
    (ended,) = cycles.apart(*(cycles.end(each) for each in (run, beside)))
    assert ended == pytest.approx(expected * away, rel=0, abs=2e-3 * abs(away).max())

    found, _ = periodic(monkeypatch, "pulsating-strut", "solve.modes=1", stable)
    assert found.outcome is Outcome.COMPLETED and found.message == "completed"


def test_a_free_joint_repeats_too(monkeypatch, tmp_path):
    """By Newton's method in a few cycles where 60 lead when they are waited for."""
    path = tmp_path / "absorber.toml"
    path.write_text(ABSORBER, encoding="utf-8")
    found, cycles = periodic(monkeypatch, path)
    assert found.outcome is Outcome.COMPLETED and cycles <= 5
    waiting = kaneflex.with_settings(
        kaneflex.read_scene(path), ["solve.start=zero", "solve.duration=12 s", "solve.steps=21600"]
    )
    waited = solved(waiting)
    for name, series in found.series.items():
        expected = waited.series[name].values[-361:]
        np.testing.assert_allclose(series.values, expected, rtol=0, atol=2e-5 * abs(expected).max())


@pytest.mark.parametrize("table, entry, said", [
    ("loads", {"push": {"force_on": "follower.mid", "direction": [0, 1], "law": "cos(main) + 0.1 * t"}},
     "push is 1 at an instant and 1.02 a cycle later"),
    ("drives", {"main": {"law": "10 * pi * t + t**2", "period": "0.2 s"}},
     "main is 31.4159 at an instant and 31.8159 a cycle"),
    ("loads", {"push": {"force_on": "follower.mid", "direction": [0, 1], "law": "sin(main / 2) * sin(main)"}},
     "push is "),
    ("loads", {"coil": {"torque_at": "first", "law": "-0.1 * first"}}, "coil is "),
    ("springs", {"coil": {"torsional_at": "first", "stiffness": "0.1 N m/rad"}}, "coil is "),
    ("springs", {"coil": {"torsional_at": "main", "stiffness": "0.1 N m/rad"}},
     "coil is 6.28319e-07 at an instant and 0.628"),
])  # fmt: skip
def test_what_does_not_repeat_is_named(table, entry, said):
    """As in space: the harmonics took a load that grows for one that jumps back every cycle; a load of twice the period
    was the same at the cycle's ends, and coils at pins that turn were wound up without a word."""
    raw = kaneflex.read_scene("four-bar").raw | {table: entry, "solve": {"preset": "coupled", "start": "periodic"}}
    with pytest.raises(SceneError, match=rf"solve\.start = 'periodic': {said}"):
        solved(kaneflex.scene_of(raw))


def test_none_where_more_than_shapes_is_free():
    """A mechanism that its motor turns has no motion of its own to be given; nor have contacts, which remember."""
    model = kaneflex.load(kaneflex.read_scene("four-bar-motor"))
    equations, start = prepare(model.coupled, coupled.beginning(model))
    assert coupled.orbit_start(equations, lambda times: [start], 0.0, 1.0, 1e-6) is None


def test_the_end_of_a_cycle_is_a_start_without_the_turns_of_its_joints():
    """The crank's pin turns back once a cycle, against the coupler."""
    model = kaneflex.load(kaneflex.with_settings(kaneflex.read_scene("four-bar"), ["solve.preset=coupled"]))
    equations, start = prepare(model.coupled, coupled.beginning(model))
    cycles = Cycles(equations, model.step * np.arange(model.options.steps + 1), coupled.method_of(model))
    run = cycles.run(start)
    turned = run.rows[-1, model.coupled.engine.columns["q"]] - start.q
    assert abs(turned).max() > 6.0 and abs(cycles.end(run).q - start.q).max() < 0.1


def test_a_cycle_after_another_run_keeps_the_turns_of_its_joints():
    """The crank's pin, which that run began a turn further; its links hardly bend."""
    scene = with_settings(read_scene("four-bar"), ["sensors={pin={position='first', component='angle'}}"])
    solve = {"preset": "coupled", "modes": 1}
    short = solve | {"start": "zero", "duration": "0.05 s", "steps": 5}
    own = solved(scene_of(scene.raw | {"solve": short}))
    state = own.state(0)
    state["displacements"]["first.angle"] += 2.0 * np.pi
    before = solved(scene_of(scene.raw | {"solve": short | {"start": state}}))
    cycle = kaneflex.load(scene_of(scene.raw | {"solve": solve | {"start": "periodic"}}))
    found = kaneflex.solve.simulation.solve(cycle, after=before)
    assert before["pin"].values - own["pin"].values == pytest.approx(2.0 * np.pi)
    assert found["pin"].values[0] == pytest.approx(before["pin"].values[-1], abs=0.05)


@pytest.fixture
def count(monkeypatch):
    """Cycles that are integrated in space, and by which."""
    cycles, run = [], Cycles.run

    def counted(self, start):
        found = run(self, start)
        if self.equations.engine.in_space:
            cycles.append((self, found))
        return found

    monkeypatch.setattr(Cycles, "run", counted)
    return cycles


def _lifted(name, *settings):
    """A planar scene under preset coupled, and the same in space, turned by any rotation."""
    flat = with_settings(read_scene(name), ["solve.preset=coupled", *settings])
    return flat, scene_of(tomlkit.dumps(lifted(flat) | {"solve": flat.raw["solve"]}))


@pytest.mark.exhaustive(group="cycles", share=2)
def test_a_planar_cycle_lifted_and_turned_is_the_same(count):
    """A blade that a force pushes once a turn: every sensor, and its multipliers among those of space."""
    plane, space = map(solved, _lifted("rotating-cantilever", "solve.modes=3"))
    assert space.outcome is Outcome.COMPLETED and space.message == "completed" and len(count) == 1
    alike(space, plane, 1e-5, space.series)
    for multiplier in plane.multipliers[:4]:
        assert abs(space.multipliers - multiplier).min() < 2e-5


def test_harmonics_begin_on_the_cycle(monkeypatch, count):
    """A four-bar, where joints and shapes that are independent at one position are dependent at another: its cycle is
    that of the plane, but for terms of the third order."""
    flat, deep = _lifted("four-bar", "drives.main.speed=200 rpm", "solve.modes=1", "solve.steps=60")
    plane, found = solved(flat), solved(deep)
    (cycles, first), *more = count
    by_harmonics = abs(cycles.missed(first) / cycles.sizes(first)).max()
    assert found.message == "completed" and len(more) < 2
    alike(found, plane, 2e-4, ("coupler_mid", "follower_mid", "crank_tip", "coupler_force", "crank_torque"))

    monkeypatch.setattr(coupled, "orbit_start", lambda *_: None)
    count.clear()
    shot = solved(deep)
    assert shot.message == "completed" and len(count) > 3
    assert abs(cycles.missed(count[0][1]) / cycles.sizes(count[0][1])).max() > 300.0 * by_harmonics
    alike(shot, found, 1e-4, shot.series)


PENDULUM = machine(
    gravity=[0, 0, "-9.81 m/s^2"],
    bodies=dict(rod='length = "0.5 m", rotation = {x = [0.1, 0.05, -1]}, '
                    'beam = {material = "aluminium", section = {rectangle = ["10 mm", "6 mm"]}, elements = 3}',
                wheel='length = "0.1 m", mass = "1 kg"'),
    masses=dict(bob='at = "rod.end", mass = "1 kg", inertia = [2e-3, 1e-3, 1e-3]'),
    joints=dict(top="spherical ground rod.start", clock="revolute ground wheel.start, axis = [0, 0, 1]"),
    drives=dict(top="free = true", clock='speed = "6 rad/s", cycle = "360 deg"'),
    springs=dict(soft='bushing = ["ground", "rod.start"], stiffness = [0, 0, 0, 0.5, 0.5, 0.5], '
                      'damping = [0, 0, 0, 0.5, 0.5, 0.5]'),
    loads=dict(push='force_on = "rod.end", direction = [1, 0.3, 0], law = "1.5 * cos(clock)"'),
    damping=dict(rayleigh=dict(ratio=0.02, at=["30 Hz", "3000 Hz"])),
    sensors=dict(x="position rod.end x", y="position rod.end y", bend="displacement rod.end y"),
    solve=dict(preset="coupled", start="periodic", modes=1),
)


def _pendulum(text=PENDULUM):
    return scene_of(text)


def test_richer_models_continue_the_cycle(count):
    """The estimates of a lifted blade are those of the plane; a ball's cycle is continued, not sought from rest."""
    settings = "solve.modes=2", "solve.errors=all"
    plane, space = (solved(scene).errors[0] for scene in _lifted("rotating-cantilever", *settings))
    for name, found in space.items():
        parts = (plane[name].modes, plane[name].elements)
        assert (found.modes, found.elements) == pytest.approx(parts, rel=1e-5), name
    pendulum = solved(with_settings(_pendulum(), ["solve.errors=all"]))
    count.clear()
    assert set(pendulum.errors[0]) == {"x", "y", "bend"} and len(count) < 15  # 18 from rest


def test_a_cycle_is_found_after_another_run(count):
    """From the end of a run at 0.2 s, the cycle there: that of the scene, as its force depends on the angle alone."""
    scene = _pendulum()
    before = solved(with_settings(scene, ["solve.start=zero", "solve.duration=2 s", "solve.steps=4"]))
    count.clear()
    found = kaneflex.solve.simulation.solve(kaneflex.load(scene), after=before)
    assert found.outcome is Outcome.COMPLETED and len(count) < 8 and found.times[0] == pytest.approx(2.0)
    start, end = (np.array([found.series[name].values[k] for name in ("x", "y", "bend")]) for k in (0, -1))
    assert end == pytest.approx(start, abs=1e-7)
    own, turns = solved(scene), found.times[0] * 6.0 / (2.0 * np.pi)
    late = np.interp(turns % 1.0 * own.times[-1], own.times, own.series["x"].values)
    assert start[0] == pytest.approx(late, abs=1e-3 * np.ptp(own.series["x"].values))


def test_the_monodromy_matrix_is_what_a_stretch_makes_of_another_start():
    """Of a ball's turns as of all else, about a motion that turns it about changing axes, and doesn't repeat: half a
    second after the pendulum was flung, when the rod rings no more."""
    text = PENDULUM.replace("top = {free = true}", "top = {free = true, angular_velocity = [2, 1, -3]}")
    text = text.replace(', cycle = "360 deg"', "").replace('start = "periodic"', 'duration = "10 ms", steps = 2')
    model = kaneflex.load(_pendulum(text))
    system, flung = model.motion.module.system, model.motion.curve.start

    def over(duration):
        method = replace(coupled.method_of(model), tolerance=1e-7)
        return Cycles(Equations(system, flung.choice), np.linspace(0.0, duration, 3), method)

    before, cycles = over(0.5), over(0.1)
    own = cycles.run(before.end(before.run(flung)))
    which = flung.choice.independent
    x = np.zeros((2, len(which)))
    x[:, :3] = [2e-3, -1e-3, 3e-3], [1e-2, 2e-2, -1e-2]
    begin = own.curve.start
    beside = [cycles.run(cycles.moved(begin, sign * x.ravel())) for sign in (1.0, -1.0)]
    end, *ends = (run.curve(float(run.times[-1])) for run in (own, *beside))
    ahead, behind = cycles.apart(end, *ends)
    y, rate = (0.5 * (ahead - behind)).reshape(2, -1)
    found = (cycles.monodromy(own, 100) @ x.ravel()).reshape(2, -1)
    assert abs(end.du[:3]).max() > 3.0 and abs(begin.du[:3]).max() > 3.0
    for part, expected in zip(found, (y, rate), strict=True):
        assert part[:3] == pytest.approx(expected[:3], abs=1e-3 * abs(expected[:3]).max())


class Halving(Cycles):
    """P(x) = 1 + x / 2, which repeats at 2; ``tangent`` stands for dP/dx, and no cycle from beyond ``goes_on`` ends."""

    def __init__(self, tangent, goes_on=np.inf):
        engine = SimpleNamespace(contacts=(), frictions=())
        equations = SimpleNamespace(measure=np.ones(1), shapes=np.zeros(1, bool), engine=engine)
        super().__init__(equations, np.array([0.0, 1.0]), Method("radau", 0.0, 1.0))
        self.tangent, self.goes_on = tangent, goes_on

    def run(self, start):
        return start, 1.0 + start / 2.0

    def completed(self, cycle):
        return cycle[0] <= self.goes_on

    def states(self, cycle, count):
        return cycle

    def apart(self, start, *others):
        return np.array([[other - start] for other in others])

    def repeats(self, cycle, left):
        return abs(cycle[1] - cycle[0]) < 1e-6

    def monodromy(self, cycle, pieces):
        if isinstance(self.tangent, Exception):
            raise self.tangent
        return np.array([[self.tangent]])

    def moved(self, start, x):
        return start + x[0]

    def end(self, cycle):
        return cycle[1]

    at = None


def test_newtons_method_needs_two_cycles_and_no_words():
    (start, _), verdict = Halving(0.5).repeated(0.0)
    assert start == pytest.approx(2.0, rel=0, abs=1e-12)
    assert verdict.message == "completed"


def test_where_the_equations_beside_it_have_no_solution_cycles_are_waited_for():
    # 1 / 2^k < 1e-6 after 20 cycles
    (start, _), verdict = Halving(np.linalg.LinAlgError("singular matrix")).repeated(0.0)
    assert start == pytest.approx(2.0, rel=0, abs=2e-6) and verdict.outcome is Outcome.COMPLETED
    assert "found by continuing for 20 cycles; Newton's method fails: singular matrix" in verdict.message


def test_where_a_start_leads_where_nothing_goes_on_the_last_cycle_is_waited_from():
    (start, _), verdict = Halving(0.9, goes_on=3.0).repeated(0.0)  # such a slope leads to 10
    assert start == pytest.approx(2.0, rel=0, abs=2e-6)
    assert "found by continuing for 20 cycles; Newton's method leads to a state without motion" in verdict.message


def test_a_motion_that_does_not_repeat_says_what_was_tried():
    class Turning(Halving):
        def run(self, start):
            return start, start + 1.0

    _, verdict = Turning(1.0).repeated(0.0)
    assert verdict.outcome is Outcome.NO_PERIODIC_STATE
    assert "still changes after 100 cycles; Newton's method fails: Singular matrix; add damping" in verdict.message


def test_a_neighbour_repeats_as_well_as_the_errors_of_its_steps_allow():
    """Of a cycle beside a known one more is asked, but not what steps with an error of 1e-7 can't give."""

    class Noisy(Halving):
        def __init__(self):
            super().__init__(0.5)
            self.judges, self.left, self.error = False, 1e-8, itertools.cycle([1e-7, -1e-7])

        def run(self, start):
            return start, 1.0 + start / 2.0 + next(self.error)

        def repeats(self, cycle, left):
            return abs(cycle[1] - cycle[0]) < left

    (start, _), verdict = Noisy().repeated(0.0)
    assert verdict.outcome is Outcome.COMPLETED and start == pytest.approx(2.0, rel=0, abs=1e-6)


def test_waiting_ends_where_no_motion_goes_on():
    cycle, verdict = Halving(np.linalg.LinAlgError("singular matrix"), goes_on=1.2).repeated(0.0)
    assert verdict is None and cycle[0] == pytest.approx(1.5)  # after 0 and 1
