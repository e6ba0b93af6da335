"""Periodic motions under preset coupled in space: planar ones lifted and turned, what waiting leads to, multipliers."""

from dataclasses import replace

import numpy as np
import pytest
import tomlkit
from lifting import lifted
from runs import alike, solved

import kaneflex
from kaneflex import SceneError, read_scene, scene_of, with_settings
from kaneflex.integrate.outcome import Outcome
from kaneflex.multibody.time.cycles import SpatialCycles
from kaneflex.multibody.time.linearisation import Equations
from kaneflex.solve import coupled


@pytest.fixture
def count(monkeypatch):
    """Cycles that are integrated, and by which."""
    cycles, run = [], SpatialCycles.run

    def counted(self, start):
        cycles.append((self, run(self, start)))
        return cycles[-1][1]

    monkeypatch.setattr(SpatialCycles, "run", counted)
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
    flat, deep = _lifted("four-bar", "drives.main.speed=200 rpm", "solve.modes=1")
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


@pytest.mark.exhaustive(group="cycles", share=2)
def test_what_nothing_damps_is_found_and_not_called_unstable(count):
    plane, space = map(solved, _lifted("rotating-cantilever", "solve.modes=2", "damping=none"))
    assert space.outcome is Outcome.COMPLETED and "multiplier is 1 within" in space.message and len(count) == 1
    expected = plane.series["tip_transverse"].values
    assert abs(space.series["tip_transverse"].values - expected).max() < 1e-5 * abs(expected).max()


@pytest.mark.exhaustive(group="cycles", share=2)
def test_a_cycle_whose_disturbances_grow_says_so():
    """In the first tongue of its pulsating force a strut would leave its motion, by the planar multiplier."""
    flat, deep = _lifted("pulsating-strut", "solve.modes=1", "drives.clock.speed=2517 rpm")
    plane, space = solved(flat), solved(deep)
    assert space.outcome is Outcome.UNSTABLE and "unstable periodic motion" in space.message
    assert space.multipliers[0] == pytest.approx(plane.multipliers[0], rel=1e-3)


PENDULUM = """
schema = 1
gravity = [0, 0, "-9.81 m/s^2"]
bodies.rod.length = "0.5 m"
bodies.rod.rotation = {x = [0.1, 0.05, -1]}
bodies.rod.beam = {material = "aluminium", section = {rectangle = ["10 mm", "6 mm"]}, elements = 3}
bodies.wheel = {length = "0.1 m", mass = "1 kg"}
masses.bob = {at = "rod.end", mass = "1 kg", inertia = [2e-3, 1e-3, 1e-3]}
joints.top = {spherical = ["ground", "rod.start"]}
joints.clock = {revolute = ["ground", "wheel.start"], axis = [0, 0, 1]}
drives.top = {free = true}
drives.clock = {speed = "6 rad/s", cycle = "360 deg"}
springs.soft.bushing = ["ground", "rod.start"]
springs.soft.stiffness = [0, 0, 0, 0.5, 0.5, 0.5]
springs.soft.damping = [0, 0, 0, 0.5, 0.5, 0.5]
loads.push = {force_on = "rod.end", direction = [1, 0.3, 0], law = "1.5 * cos(clock)"}
damping.rayleigh = {ratio = 0.02, at = ["30 Hz", "3000 Hz"]}
sensors.x = {position = "rod.end", component = "x"}
sensors.y = {position = "rod.end", component = "y"}
sensors.bend = {displacement = "rod.end", component = "y"}
solve = {preset = "coupled", start = "periodic", modes = 1}
"""


def _pendulum(text=PENDULUM):
    return scene_of(text)


@pytest.mark.exhaustive(group="cycles", share=2)
def test_waiting_leads_to_the_same_motion(monkeypatch, count):
    """A pendulum on a ball that is pushed around: Newton's method has its cycle, and so has cycle after cycle."""
    found = solved(_pendulum())
    assert found.outcome is Outcome.COMPLETED and len(count) <= 5

    def unknown(*_):
        raise ArithmeticError

    monkeypatch.setattr(SpatialCycles, "monodromy", unknown)
    count.clear()
    waited = solved(_pendulum())
    assert len(count) > 8
    for name in ("x", "y", "bend"):
        expected = waited.series[name].values
        assert abs(found.series[name].values - expected).max() < 1e-4 * np.ptp(expected), name


def test_richer_models_continue_the_cycle(count):
    """The estimates of a lifted blade are those of the plane; a ball's cycle is continued, not sought from rest."""
    plane, space = (solved(scene).errors[0] for scene in _lifted("rotating-cantilever", "solve.modes=2"))
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
        return SpatialCycles(Equations(system, flung.choice), np.linspace(0.0, duration, 3), method)

    before, cycles = over(0.5), over(0.1)
    own = cycles.run(before.end(before.run(flung)))
    which = flung.choice.independent
    x = np.zeros((2, len(which)))
    x[:, :3] = [2e-3, -1e-3, 3e-3], [1e-2, 2e-2, -1e-2]
    beside = [cycles.run(cycles.moved(own.start, sign * x.ravel())) for sign in (1.0, -1.0)]
    end, *ends = (run(float(run.ends[-1])) for run in (own, *beside))
    ahead, behind = cycles.apart(end, *ends)
    y, rate = (0.5 * (ahead - behind)).reshape(2, -1)
    found = (cycles.monodromy(own, 100) @ x.ravel()).reshape(2, -1)
    assert abs(end.du[:3]).max() > 3.0 and abs(own.start.du[:3]).max() > 3.0
    for part, expected in zip(found, (y, rate), strict=True):
        assert part[:3] == pytest.approx(expected[:3], abs=1e-3 * abs(expected[:3]).max())


def test_what_does_not_repeat_is_named():
    text = PENDULUM.replace("1.5 * cos(clock)", "1.5 * cos(clock) + 0.1 * t")
    with pytest.raises(SceneError, match=r"solve\.start = 'periodic': push is 1.5 at first and 1.60472 a cycle later"):
        solved(_pendulum(text))
