"""Elastic-consistent reactions: they balance the whole mechanism, and act where the joints are."""

from collections.abc import Callable

import numpy as np
import pytest
from runs import run, solved

from kaneflex import Solution, scene_of
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.response.deformation import Deformation, deform
from kaneflex.response.reactions import least_squares

R, SPEED, PISTON = 0.040, 2 * np.pi * 100, 0.214


def test_unknowns_that_stand_alone_change_no_least_squares():
    random, instants = np.random.default_rng(3), 5
    rows = [
        {0: 1.0, 1: random.normal(size=instants)},  # 0 is constant here, and nowhere else
        {1: 2.0, 2: -1.0},
        {1: random.normal(size=instants), 2: 0.5, 3: random.normal(size=instants)},  # 3 is alone, but varies
        {2: 1.0},
        {4: -2.0, 2: random.normal(size=instants)},
        {},
    ]
    right = random.normal(size=(len(rows), instants))
    found = least_squares(rows, right)
    for t in range(instants):
        matrix = np.zeros((len(rows), 5))
        for row, coefficients in enumerate(rows):
            for unknown, value in coefficients.items():
                matrix[row, unknown] = np.broadcast_to(value, instants)[t]
        expected = np.linalg.lstsq(matrix, right[:, t], rcond=None)[0]
        assert [found[k][t] for k in range(5)] == pytest.approx(expected, rel=1e-12)


class Balance:
    """What joints and gas must do to the whole mechanism: the momentum of its elastic motion, by quadrature."""

    def __init__(self, solution: Solution):
        self.solution, self.rigid = solution, solution.rigid
        self.rod = deform(solution.model, self.rigid, solution.coordinates, "rod")

    def momentum_rate(self) -> np.ndarray:
        """Sum of mass times acceleration of crank, rod and piston, global components (2, n_times)."""
        rigid, phi = self.rigid, self.rigid["main.angle"]
        total = -0.952 * (R / 2) * SPEED**2 * np.array([np.cos(phi), np.sin(phi)])
        total += rod_momentum_rate(self.rod, rigid)
        slide = self.solution.model.coordinates.index("piston.slide")
        total[0] += PISTON * (rigid["piston.a_x"] + self.solution.trajectory.a[:, slide])
        return total

    def forces(self) -> np.ndarray:
        series = self.solution.series
        bearing = np.array([series[f"main_bearing_force_{axis}"].values for axis in "xy"])
        return bearing + np.array([-self.rigid["gas"], series["piston_side_force"].values])


def rod_momentum_rate(rod: Deformation, rigid: RigidMotion) -> np.ndarray:
    """rho A times the acceleration of every point of the bent rod, integrated by Gauss's rule."""
    w, e = (rigid[f"rod.{name}"] for name in ("omega", "epsilon"))

    def acceleration(X: float) -> np.ndarray:
        d, d_rate, d_accel = rod.at(X)
        a_x = rigid["rod.link.a_x"] - e * d[1] - w**2 * (X + d[0]) - 2 * w * d_rate[1] + d_accel[0]
        a_y = rigid["rod.link.a_y"] + e * (X + d[0]) - w**2 * d[1] + 2 * w * d_rate[0] + d_accel[1]
        return np.array([a_x, a_y])

    return along_rod(rod, rigid, acceleration)


def along_rod(rod: Deformation, rigid: RigidMotion, vector: Callable[[float], np.ndarray]) -> np.ndarray:
    """int rho A vector(X) dX of a vector in the rod's axes, global components (2, n_times)."""
    total = np.zeros((2, len(rigid.times)))
    c, s = rigid["rod.c"], rigid["rod.s"]
    for near, far in zip(rod.link.nodes[:-1], rod.link.nodes[1:], strict=True):
        for point, weight in zip(*np.polynomial.legendre.leggauss(4), strict=True):
            x, y = vector((near + far) / 2 + (far - near) / 2 * point)
            dm = weight * (far - near) / 2 * rod.link.parameters["rho_A"][0]
            total += dm * np.array([c * x - s * y, s * x + c * y])
    return total


def test_elastic_reactions_balance_the_whole_mechanism():
    """Undamped: bearing, guide and gas together are the rate of momentum of crank, bent rod and piston."""
    balance = Balance(run("engine", "solve.preset=linear", "damping=none", "solve.start=zero"))
    forces, momentum = balance.forces(), balance.momentum_rate()
    assert forces == pytest.approx(momentum, abs=1e-12 * np.abs(balance.rigid["gas"]).max())
    # From rest the rod rings, so the elastic part is not small.
    rigid = balance.solution.series["main_bearing_force_x_rigid"].values
    assert np.abs(balance.solution.series["main_bearing_force_x"].values - rigid).max() > 100


def test_damping_is_a_force_on_the_whole_mechanism_of_its_mass_part_alone():
    """Of alpha M + beta K_s only alpha M pulls from outside, at every point by alpha times how fast it deforms."""
    balance = Balance(run("engine", "solve.preset=linear", "solve.integrator=radau"))
    model, rigid, trajectory = balance.solution.model, balance.rigid, balance.solution.trajectory
    alpha, beta = model.rayleigh
    slide = model.coordinates.index("piston.slide")
    drag = along_rod(balance.rod, rigid, lambda X: balance.rod.at(X)[1][:2])
    drag[0] += PISTON * trajectory.v[:, slide]
    outside, gas = balance.forces() - balance.momentum_rate(), np.abs(rigid["gas"]).max()
    assert outside == pytest.approx(alpha * drag, abs=1e-12 * gas)
    # With 2 % it is a thousandth of the gas force.
    assert 1e-5 < np.abs(outside).max() / gas < 2e-3 and beta > 0


SWINGING = """
schema = 1
ground.pivot = ["100 mm", "40 mm"]
bodies.arm = {length = "200 mm", mass = "1 kg"}
bodies.block = {mass = "0.3 kg", inertia = "1e-4 kg m^2"}
bodies.rod = {length = "250 mm", beam = {material = "steel", A = "100 mm^2", I = "2000 mm^4", elements = 1}}
joints.main = {revolute = ["ground", "arm.start"]}
joints.wrist = {revolute = ["rod.end", "block"]}
joints.foot = {revolute = ["ground.pivot", "rod.start"]}
joints.slot = {prismatic = ["arm.start", "block"], direction = [1, 0], branch = "+"}
drives.main = {speed = "20 rad/s", cycle = "360 deg"}
sensors.torque = {drive_torque = "main"}
sensors.bearing = {joint_force = "main", component = "x"}
sensors.slot = {joint_force = "slot", component = "y"}
sensors.slot_x = {joint_force = "slot", component = "x"}
sensors.foot = {joint_force = "foot", component = "y"}
solve.preset = "quasistatic"
"""


def test_a_guide_on_a_moving_body_is_pushed_where_the_slider_is():
    """A block that slides along a driven arm: its push has a lever about the arm's bearing."""
    solution = solved(scene_of(SWINGING))
    for name in ("torque", "bearing", "slot", "foot"):
        rigid = solution.series[f"{name}_rigid"].values
        # At 20 rad/s the rod is as good as rigid.
        assert solution.series[name].values == pytest.approx(rigid, abs=1e-4 * np.abs(rigid).max()), name
    assert np.abs(solution.series["torque_rigid"].values).max() > 1
    along = solution.rigid["arm.c"] * solution.series["slot_x"].values
    along += solution.rigid["arm.s"] * solution.series["slot"].values
    assert np.abs(along).max() < 1e-12 * np.abs(solution.series["slot"].values).max()  # nothing along the guide
