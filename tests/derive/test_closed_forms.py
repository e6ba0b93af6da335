"""Closed forms that other tests lean on, checked by another road: power, derivatives, Kane's method."""

import closed_forms as by_hand
import numpy as np
import pytest


def test_closed_slider_crank_keeps_the_power_balance_and_its_own_derivatives():
    """Torque x omega = d/dt kinetic energy + gas force x piston speed, with rates by the complex step."""
    r, L, w, e, m_p, F = 0.04, 0.137, 628.0, 900.0, 0.214, 5000.0
    crank, rod = (0.952, 0.013, 3e-4), (0.153, 0.05, 2.6e-4)
    (m1, d1, J1), (m2, d2, J2) = crank, rod

    def motion(t):
        phi, speed = 0.7 + w * t + e * t**2 / 2, w + e * t
        closed = by_hand.slider_crank(r, L, phi, speed, e)
        vx = -r * speed * np.sin(phi) - d2 * closed["omega2"] * np.sin(closed["phi2"])
        vy = r * speed * np.cos(phi) + d2 * closed["omega2"] * np.cos(closed["phi2"])
        moving = (J1 + m1 * d1**2) * speed**2 + m2 * (vx**2 + vy**2) + J2 * closed["omega2"] ** 2
        return closed | {"energy": (moving + m_p * closed["piston_velocity"] ** 2) / 2}

    step = 1e-30
    now = motion(0.0)
    rate = {name: value.imag / step for name, value in motion(step * 1j).items()}
    forces = by_hand.slider_crank_forces(r, L, crank, rod, m_p, 0.7, w, F, e)
    assert forces["crank_torque"] * w == pytest.approx(rate["energy"] + F * now["piston_velocity"], rel=1e-12)
    assert now["omega2"] == pytest.approx(rate["phi2"], rel=1e-12)
    assert now["epsilon2"] == pytest.approx(rate["omega2"], rel=1e-12)
    assert now["piston_velocity"] == pytest.approx(rate["piston_position"], rel=1e-12)
    assert now["piston_acceleration"] == pytest.approx(rate["piston_velocity"], rel=1e-12)
