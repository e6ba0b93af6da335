"""Periodic motions under preset coupled begin on their harmonics, and integrate into themselves."""

import numpy as np
import pytest

import kaneflex
from kaneflex.solve import coupled


def periodic(monkeypatch, name, *settings):
    """Solution of a periodic start, and how many cycles were integrated for it."""
    cycles, integrate = [], coupled.integrate

    def counted(*arguments, **named):
        cycles.append(integrate(*arguments, **named))
        return cycles[-1]

    monkeypatch.setattr(coupled, "integrate", counted)
    scene = kaneflex.with_settings(
        kaneflex.read_scene(name), ["solve.preset=coupled", "solve.start=periodic", *settings]
    )
    solution = kaneflex.simulate(kaneflex.load(scene))
    return solution, len(cycles)


@pytest.mark.parametrize(
    "name, settings",
    [
        ("engine", []),
        ("engine", ["damping=none"]),
        ("quick-return", ["damping=none"]),
        ("four-bar", ["damping=none"]),  # whose links bend by 2 % of their length near a resonance
        ("engine", ["damping=none", "loads.gas.interpolation=linear"]),  # whose load has a kink every degree
    ],
)
def test_a_few_cycles_do_whether_or_not_anything_dies_away(monkeypatch, name, settings):
    solution, cycles = periodic(monkeypatch, name, *settings)
    q = solution.trajectory.q
    system = solution.model.coupled
    modal = [k for body in system.start for k in range(*system.modal(body).indices(system.size))]
    assert solution.trajectory.outcome.value == "completed"
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


def test_none_where_more_than_shapes_is_free():
    """A mechanism that its motor turns has no motion of its own to be given; nor have contacts, which remember."""
    model = kaneflex.load(kaneflex.read_scene("four-bar-motor"))
    q, v = coupled.beginning(model)
    assert coupled.orbit_start(model.coupled, lambda times: (q[None], v[None]), 0.0, 1.0, 1e-6) is None
