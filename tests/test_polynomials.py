"""What sensors read as sums of products: traced once with unknowns, it gives what is measured of a run."""

import numpy as np
import pytest
from runs import run

import kaneflex
from kaneflex.response.least_squares import normal_equations
from kaneflex.response.polynomials import Polynomial, sensor_readings


def value(polynomial: Polynomial, values: list[np.ndarray]) -> np.ndarray:
    """At all instants; (n_times,)."""
    products = ((np.prod([values[k] for k in product], axis=0), by) for product, by in polynomial.terms.items())
    return sum((by * product for product, by in products), np.zeros_like(values[0]))


# Rod forces of an elastic slider crank; three links and masses; a slot; loops that are closed by Newton's method.
@pytest.mark.parametrize(
    "name, unread",
    [
        ("engine", set()), ("four-bar", {"rocker_angle"}), ("v-engine", set()), ("quick-return", {"lever_angle"}),
        ("pulsating-strut", set()), ("six-bar", {"platform_angle", "rocker_angle"}),
    ],
)  # fmt: skip
def test_what_sensors_read_is_traced(name, unread):
    assert left_out(run(name)) == unread


def test_places_of_points_of_turned_bodies_are_traced():
    """Where a machine's tip goes is what other programs ask for; a coupler's point is no less a sum of products."""
    points = {
        f"{component}_{axes}": {"position": "coupler.mid", "component": component, "axes": axes}
        for component in ("x", "y") for axes in ("global", "body")
    }  # fmt: skip
    tables = {"schema": 1, "like": "four-bar", "sensors": points}
    assert left_out(kaneflex.simulate(kaneflex.load(kaneflex.scene_of(tables)))) == {"rocker_angle"}


def left_out(solution: kaneflex.Solution) -> set[str]:
    """Sensors that are no sums of products; that all others are what the run has is checked."""
    bound, found = solution.model, solution.trajectory
    readings = sensor_readings(bound)
    instants = np.linspace(0, len(found.times) - 1, 23).astype(int)
    moved = [column for part in (found.z, found.v, found.a) for column in part[instants].T]
    values = [*bound.motion.at(found.times[instants]).values.T, *moved]
    for matrix, right in readings.systems:
        A = np.array([[value(entry, values) for entry in row] for row in matrix]).transpose(2, 0, 1)
        b = np.array([value(entry, values) for entry in right]).T
        square = A.shape[1] == A.shape[2]
        values += [*(np.linalg.solve(A, b[..., None])[..., 0] if square else normal_equations(A, b)).T]
    for sensor, polynomial in readings.sensors.items():
        series = solution[sensor].values
        np.testing.assert_allclose(
            value(polynomial, values), series[instants], rtol=0.0, atol=1e-12 * abs(series).max(), err_msg=sensor
        )
    return {*bound.scene.sensors} - {*readings.sensors}
