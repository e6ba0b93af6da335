"""Periodic motions under preset coupled begin on their harmonics, and integrate into themselves."""

import numpy as np
import pytest
from machines import ABSORBER
from runs import solved

import kaneflex
from kaneflex.integrate.outcome import Outcome
from kaneflex.multibody.time.cycles import PlanarCycles
from kaneflex.multibody.time.linearisation import prepare
from kaneflex.solve import coupled
from kaneflex.support.errors import SceneError


def periodic(monkeypatch, name, *settings):
    """Solution of a periodic start, and how many cycles were integrated for it."""
    cycles, run = [], PlanarCycles.run

    def counted(self, start):
        cycles.append(run(self, start))
        return cycles[-1]

    monkeypatch.setattr(PlanarCycles, "run", counted)
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
    modal = [k for body in system.start for k in range(*system.modal(body).indices(system.size))]
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
    for name, series in waited.series.items():
        expected = series.values
        np.testing.assert_allclose(found.series[name].values, expected, rtol=0, atol=3e-5 * abs(expected).max())


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
    engine = found.model.coupled.engine
    equations, start = prepare(found.model.coupled, next(engine.states_of(run.rows[:1], engine.choice)))
    cycles = PlanarCycles(equations, run.times, coupled.method_of(found.model))
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
     "push is 1 at first and 1.02 a cycle later"),
    ("drives", {"main": {"law": "10 * pi * t + t**2", "period": "0.2 s"}},
     "main is 31.4159 at first and 31.8159 a cycle"),
])  # fmt: skip
def test_what_does_not_repeat_is_named(table, entry, said):
    """As in space: the harmonics took a load that grows for one that jumps back every cycle."""
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
    cycles = PlanarCycles(equations, model.step * np.arange(model.options.steps + 1), coupled.method_of(model))
    run = cycles.run(start)
    turned = run.rows[-1, model.coupled.engine.columns["q"]] - start.q
    assert abs(turned).max() > 6.0 and abs(cycles.end(run).q - start.q).max() < 0.1
