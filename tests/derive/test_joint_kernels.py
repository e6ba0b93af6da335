"""The kernels of joints and springs along motions of their two sections, against rows and rates by hand."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from kaneflex.generated import joints
from kaneflex.mechanism import springs
from kaneflex.mechanism.joints import Constraints
from kaneflex.mechanism.parts import Joint
from kaneflex.mechanism.planar import BodyPoint
from kaneflex.mechanism.springs import Spring

FIRST, SECOND = BodyPoint("a", "start", (0, 0)), BodyPoint("b", "start", (0, 0))
DIRECTION, ANGLE = (0.6, -0.8), 0.7
TINY = 1e-30


class Motion:
    """Two sections whose x, y, theta are sums of two harmonics each; of real or complex times."""

    def __init__(self, seed):
        self.amplitude, self.omega, self.phase = np.random.default_rng(seed).uniform(0.3, 2.0, (3, 2, 3, 2))

    def level(self, t, rates):
        """The sections' places (2, 3), or their first or second rates."""
        shifted = self.omega * t + self.phase + rates * math.pi / 2
        return (self.amplitude * self.omega**rates * np.sin(shifted)).sum(axis=-1)

    def sections(self, t):
        """sec with another section before and between: they stand at 1 and 3."""
        found = np.full((4, 9), np.nan)
        found[1::2] = np.hstack([self.level(t, rates) for rates in range(3)])
        return found.ravel()


def rows(kind, sec):
    """What the kernel stores, behind numbers that it must leave alone and over some that it must not add to."""
    out = np.full(5 + 9 * joints.ROWS[kind], 3.5)
    getattr(joints, kind)(sec, 1, 3, *DIRECTION, ANGLE, out, 5)
    assert (out[:5] == 3.5).all()
    return out[5:].reshape(-1, 9)


def pulled(sec, k, c, free):
    out = np.full(8, 3.5)
    joints.pull(sec, 1, 3, k, c, free, out, 2)
    assert (out[:2] == 3.5).all()
    return out[2:]


@pytest.mark.parametrize(("c", "free"), [(0.0, 0.0), (0.0, 0.4), (9.0, 0.0), (9.0, 0.4)])
def test_a_spring_pulls_by_the_one_law(c, free):
    motion, t, k = Motion(5), 0.6, 70.0
    spring = Spring("s", FIRST, SECOND, None, k, c, free)

    def gap(t):
        return np.subtract(*motion.level(t, 0)[::-1])[:2]

    def length(t):
        return np.sqrt((gap(t) ** 2).sum())

    rate = length(t + 1j * TINY).imag / TINY
    tension = springs.tension(spring, length(t), rate)
    expected = [
        length(t), tension, *springs.force(spring, gap(t), tension, length(t)),
        springs.potential(spring, length(t)), c * rate**2,
    ]  # fmt: skip
    found = pulled(motion.sections(t), k, c, free)
    assert found == pytest.approx(expected, rel=1e-13)
    velocity = np.subtract(*motion.level(t, 1)[::-1])[:2]  # what the force does at the second point, less at the first
    stored = springs.potential(spring, length(t + 1j * TINY)).imag / TINY
    assert found[2:4] @ velocity == pytest.approx(-stored - found[5], rel=1e-12)


def test_a_spring_without_free_length_and_damper_is_regular_where_its_points_meet():
    """The others have no direction there, and say so by no number."""
    sec = np.zeros(36)
    assert pulled(sec, 70.0, 0.0, 0.0).tolist() == [0.0] * 6
    assert np.isnan(pulled(sec, 70.0, 0.0, 0.4)[2:4]).all() and np.isnan(pulled(sec, 70.0, 9.0, 0.0)[2:4]).all()


def test_a_torsional_spring_turns_both_sections_back():
    motion, t, k, c, free = Motion(6), 0.6, 70.0, 9.0, 0.4
    (_, _, first), (_, _, second) = motion.level(t, 0)
    rate = np.subtract(*motion.level(t, 1)[::-1])[2]
    out = np.full(8, 3.5)
    joints.twist(motion.sections(t), 1, 3, k, c, free, out, 2)
    angle = second - first
    expected = [angle, k * (angle - free) + c * rate, 0.0, 0.0, 0.5 * k * (angle - free) ** 2, c * rate**2]
    assert out == pytest.approx([3.5, 3.5, *expected], rel=1e-13)


# ---- written by hand ----------------------------------------------------------------------------------------------


def by_hand(kind, bodies, ends, drive):
    """Rows of a joint and of the coordinate that its drive knows, with their derivatives by x, y, phi of both bodies.

    By hand, in the first body's axes: the gap there is (xi, eta) = R_1^T (r_2 - r_1) + R(psi) p_2 - p_1, whose
    derivatives are those of sines and cosines. d is the guide's direction.
    """
    (x_1, y_1, phi_1), (x_2, y_2, phi_2) = bodies
    (a_1, b_1), (a_2, b_2) = ends
    psi, X, Y = phi_2 - phi_1, x_2 - x_1, y_2 - y_1
    c_1, s_1, c_2, s_2 = math.cos(phi_1), math.sin(phi_1), math.cos(phi_2), math.sin(phi_2)
    turned = psi - ANGLE, [0, 0, -1, 0, 0, 1]
    if kind in ("revolute", "weld"):
        gap_x = X + a_2 * c_2 - b_2 * s_2 - a_1 * c_1 + b_1 * s_1
        gap_y = Y + a_2 * s_2 + b_2 * c_2 - a_1 * s_1 - b_1 * c_1
        rows = [
            (gap_x, [-1, 0, a_1 * s_1 + b_1 * c_1, 1, 0, -a_2 * s_2 - b_2 * c_2]),
            (gap_y, [0, -1, -a_1 * c_1 + b_1 * s_1, 0, 1, a_2 * c_2 - b_2 * s_2]),
        ]
        return [*rows, turned if kind == "weld" else (psi - drive, turned[1])]
    d_x, d_y = DIRECTION
    c, s = math.cos(psi), math.sin(psi)
    xi, eta = X * c_1 + Y * s_1 + a_2 * c - b_2 * s - a_1, -X * s_1 + Y * c_1 + a_2 * s + b_2 * c - b_1
    of_xi = np.array([-c_1, -s_1, eta + b_1, c_1, s_1, -a_2 * s - b_2 * c])
    of_eta = np.array([s_1, -c_1, -xi - a_1, -s_1, c_1, a_2 * c - b_2 * s])
    along, across = d_x * xi + d_y * eta - drive, d_x * eta - d_y * xi
    return [(across, d_x * of_eta - d_y * of_xi), turned, (along, d_x * of_xi + d_y * of_eta)]


def each_off_by_a_thousandth(found):
    for entry in zip(*np.nonzero(found), strict=True):
        wrong = found.copy()
        wrong[entry] *= 1.001
        yield wrong


@pytest.mark.parametrize("kind", ["revolute", "weld", "prismatic"])
def test_constraints_of_rigid_bodies_by_hand(kind):
    """Residuals and Jacobian at poses drawn by lot, driven where the joint moves; a thousandth in one entry is seen."""
    rng = np.random.default_rng(48)
    for _ in range(4):
        bodies, ends, drive = rng.uniform(-2, 2, (2, 3)), rng.uniform(-1, 1, (2, 2)), rng.uniform(-1, 1)
        sides = [BodyPoint(name, "pin", tuple(end)) for name, end in zip("ab", ends, strict=True)]
        joint = Joint("j", kind, *sides, DIRECTION, angle=ANGLE)
        given = {} if kind == "weld" else {"j": drive}
        constraints = Constraints(SimpleNamespace(joints={"j": joint}), given, ["a", "b"])
        poses = dict(zip("ab", bodies, strict=True))
        found = np.column_stack([constraints.residuals(poses), constraints.jacobian(poses)])
        expected = np.array([[row, *derivatives] for row, derivatives in by_hand(kind, bodies, ends, drive)])
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-14)
        assert not any(np.allclose(wrong, expected, 1e-12, 1e-14) for wrong in each_off_by_a_thousandth(found))


@pytest.mark.parametrize("kind", joints.ROWS)
def test_rows_of_kernels_by_hand(kind):
    """The same of sections, with g'' by the theorem of relative acceleration in the first section's turning axes."""
    motion, t = Motion(11), 0.9
    places, rates, seconds = (motion.level(t, order) for order in range(3))
    of = {"turn": "revolute", "slide": "prismatic"}.get(kind, kind)
    chosen = {"revolute": [0, 1], "weld": [0, 1, 2], "prismatic": [0, 1]}.get(kind, [2])
    expected = [by_hand(of, places, np.zeros((2, 2)), 0.0)[row] for row in chosen]
    c, s, omega, epsilon = math.cos(places[0, 2]), math.sin(places[0, 2]), rates[0, 2], seconds[0, 2]
    to_first, quarter = np.array([[c, s], [-s, c]]), np.array([[0, -1], [1, 0]])
    gap, velocity, acceleration = ((level[1] - level[0]) for level in (places, rates, seconds))
    rho = to_first @ gap[:2]
    rho_1 = to_first @ velocity[:2] - omega * quarter @ rho
    rho_2 = to_first @ acceleration[:2] - 2 * omega * quarter @ rho_1 - epsilon * quarter @ rho + omega**2 * rho
    d_x, d_y = DIRECTION
    second = {
        "revolute": acceleration[:2], "weld": acceleration, "turn": acceleration[2:],
        "prismatic": [d_x * rho_2[1] - d_y * rho_2[0], acceleration[2]], "slide": [d_x * rho_2[0] + d_y * rho_2[1]],
    }[kind]  # fmt: skip
    expected = np.array([
        [row, derivatives @ rates.ravel(), twice, *derivatives]
        for (row, derivatives), twice in zip(expected, second, strict=True)
    ])  # fmt: skip
    found = rows(kind, motion.sections(t))
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-13)
    assert not any(np.allclose(wrong, expected, 1e-12, 1e-13) for wrong in each_off_by_a_thousandth(found))
