"""The kernels of joints and springs along motions of their two sections, differentiated by steps in time."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from kaneflex.generated import joints
from kaneflex.mechanism import springs
from kaneflex.mechanism.joints import Constraints, coordinate, residuals
from kaneflex.mechanism.parts import ROWS, Joint, Spring
from kaneflex.mechanism.planar import BodyPoint, Pose

FIRST, SECOND = BodyPoint("a", "start", (0, 0)), BodyPoint("b", "start", (0, 0))
DIRECTION, ANGLE = (0.6, -0.8), 0.7
SEEDS = range(3)
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


def law(kind, places):
    """The rows by the one law, at real or complex places of the two sections."""
    first, second = (Pose(x, y, np.cos(theta), np.sin(theta), theta) for x, y, theta in places)
    if kind in ROWS:
        return np.array(residuals(Joint("j", kind, FIRST, SECOND, DIRECTION, angle=ANGLE), first, second))
    joint = Joint("j", "prismatic" if kind == "slide" else "revolute", FIRST, SECOND, DIRECTION)
    return np.array([coordinate(joint, first, second)])


def rows(kind, sec):
    """What the kernel stores, behind numbers that it must leave alone and over some that it must not add to."""
    out = np.full(5 + 9 * joints.ROWS[kind], 3.5)
    getattr(joints, kind)(sec, 1, 3, *DIRECTION, ANGLE, out, 5)
    assert (out[:5] == 3.5).all()
    return out[5:].reshape(-1, 9)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("kind", joints.ROWS)
def test_rows_are_the_law_and_its_rates_along_a_motion(kind, seed):
    """g and g' to the last digits by an imaginary step in time, g'' by Richardson's extrapolation of that."""
    motion, t = Motion(seed), 0.37

    def rate(t):
        return law(kind, motion.level(t + 1j * TINY, 0)).imag / TINY

    def slope(h):
        return (rate(t + h) - rate(t - h)) / (2 * h)

    found = rows(kind, motion.sections(t))
    assert found[:, 0] == pytest.approx(law(kind, motion.level(t, 0)), abs=1e-14)
    assert found[:, 1] == pytest.approx(rate(t), abs=1e-13)
    h = 1e-2
    second = (64 * slope(h / 4) - 20 * slope(h / 2) + slope(h)) / 45
    assert found[:, 2] == pytest.approx(second, abs=1e-9 * (1 + abs(second).max()))


@pytest.mark.parametrize("kind", joints.ROWS)
def test_the_jacobian_is_the_derivative_by_the_places_and_gives_the_rate(kind):
    motion, t = Motion(7), 1.9
    places, found = motion.level(t, 0), rows(kind, motion.sections(t))
    for column in range(6):
        nudged = places.astype(complex)
        nudged.ravel()[column] += 1j * TINY
        assert found[:, 3 + column] == pytest.approx(law(kind, nudged).imag / TINY, abs=1e-14)
    assert found[:, 3:] @ motion.level(t, 1).ravel() == pytest.approx(found[:, 1], abs=1e-13)


@pytest.mark.parametrize("kind", joints.ROWS)
def test_reactions_of_a_joint_are_in_balance(kind):
    """J_1^T lambda and J_2^T lambda are forces on the two sections: together they move and turn nothing."""
    motion, t = Motion(3), 0.8
    (x_1, y_1, _), (x_2, y_2, _) = motion.level(t, 0)
    found = rows(kind, motion.sections(t))
    if kind in ("revolute", "weld"):  # whose points are one: there alone it is a balance
        x_1, y_1 = x_2, y_2
    (f_1, g_1, m_1), (f_2, g_2, m_2) = found[:, 3:6].T, found[:, 6:].T
    assert f_1 + f_2 == pytest.approx(0.0, abs=1e-14) and g_1 + g_2 == pytest.approx(0.0, abs=1e-14)
    assert m_1 + x_1 * g_1 - y_1 * f_1 + m_2 + x_2 * g_2 - y_2 * f_2 == pytest.approx(0.0, abs=1e-13)


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
        constraints = Constraints(SimpleNamespace(joints={"j": joint}), given)
        poses = dict(zip("ab", bodies, strict=True))
        found = np.column_stack([constraints.residuals(poses, ["j"]), constraints.jacobian(poses, ["a", "b"], ["j"])])
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
