"""The coupled equations against hand-written forms, their limits and finite differences."""

import json
import re

import numpy as np
import pytest
from places import DATA
from runs import gaps, model, moments, names_of, shapes_of, starts_of

import kaneflex
from kaneflex import read_scene, scene_of, with_settings
from kaneflex.fem.element_terms import shape_functions
from kaneflex.generated import joints, shapes
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.multibody.model.body_parameters import Blocks
from kaneflex.multibody.model.building import reference_modes
from kaneflex.multibody.time.linearisation import prepare
from kaneflex.multibody.time.trajectory import by_themselves
from kaneflex.solve.coupled import simulate_coupled
from kaneflex.solve.coupled_linearisation import modes_at_rest


@pytest.fixture(scope="module")
def engine():
    settings = ["solve.preset=coupled", "solve.start=zero", "solve.steps=40"]
    return kaneflex.load(with_settings(read_scene("engine"), settings))


@pytest.fixture(scope="module")
def moved(engine):
    """A state of the engine under way, with what its equations say there: t, q, v, a, multipliers."""
    found = simulate_coupled(engine).trajectory
    k = slice(13, 14)
    state = by_themselves(engine.coupled, found.rows[k], engine.coupled.nearby(found.rows[k]))
    return found.times[13], state.q[0], state.v[0], state.a[0], state.multipliers[0]


def inertia_forces(model, q, v, a):
    """M a - f of every body by itself, what holds, damps and weighs it included, by the body's kernel."""
    system, found = model.coupled, np.zeros(len(names_of(model.coupled)))
    blocks = Blocks(mechanism_of(model.scene), {})
    for name, k in starts_of(system).items():
        c, s, omega = np.cos(q[k + 2]), np.sin(q[k + 2]), v[k + 2]
        x, y, epsilon = a[k : k + 3] - [*model.scene.gravity, 0.0]
        p, motion = blocks.body(name, system.shapes.get(name)), (omega, c * x + s * y, c * y - s * x, epsilon)
        joints.demand.py_func(p, 0, motion, 0, found, k)
        if name in system.shapes:
            count, own = system.shapes[name].count, len(joints.BODY)
            shapes.shaped_demand.py_func(p, own, count, motion, 0, q, v, a, k + 3, found, k, found)
        found[k : k + 2] = c * found[k] - s * found[k + 1], s * found[k] + c * found[k + 1]
    return found


def opened(system, t, q):
    found = gaps(system, t, q)
    return np.array([found[name] for name in system.constraints])


def test_the_state_satisfies_balance_and_constraints(engine, moved):
    """Of every body's speeds: what its motion takes is what joints and gas exert, by virtual work."""
    t, q, v, a, multipliers = moved
    system, n, h = engine.coupled, len(names_of(engine.coupled)), 1e-6
    G = np.array([opened(system, t, q + step) - opened(system, t, q - step) for step in h * np.eye(n)]).T / (2 * h)
    given = np.zeros(n)
    gas, k = engine.motion.at(t)["gas"][0], starts_of(system)["piston"]
    given[k : k + 2] = gas * np.array(engine.scene.loads["gas"].direction)
    left = inertia_forces(engine, q, v, a)
    assert abs(left - given - G.T @ multipliers).max() < 1e-8 * abs(left).max()
    assert abs(gas) > 1.0 and abs(left[shapes_of(system, "rod")]).max() > 1.0
    assert abs(opened(system, t, q)).max() < 1e-12
    # The loops stay closed along the motion, to the second order in time.
    for h, order, largest in ((1e-7, 1, abs(v).max()), (1e-5, 2, abs(a).max())):
        after, before = (opened(system, t + s, q + s * v + s * s / 2 * a) for s in (h, -h))
        rate = (after - before) / (2 * h) if order == 1 else (after + before - 2 * opened(system, t, q)) / h**2
        assert abs(rate).max() < 1e-5 * largest, order


def test_moments_are_the_integrals_that_their_names_say(engine):
    """Against quadrature of the shape functions along the rod, the foreshortening integrated point by point."""
    system = engine.coupled
    link, shapes = system.links["rod"], system.shapes["rod"]
    rho_A = engine.scene.bodies["rod"].profile.at(0.0).rho_A
    points, weights = np.polynomial.legendre.leggauss(6)
    number = moments(engine, "rod")
    names = ("mass_s_0", "mass_w_1", "mass_X_w_0", "mass_s_0_w_0", "mass_w_0_w_0", "mass_H_0_1", "mass_X_H_0_1")
    sums = dict.fromkeys(names, 0.0)
    reached = 0.0  # H_01 up to the element
    for e, (x_0, x_1) in enumerate(zip(link.nodes[:-1], link.nodes[1:], strict=True)):
        rows, h = slice(3 * e, 3 * e + 6), x_1 - x_0

        def at(x, rows=rows, h=h, x_0=x_0):
            N = shape_functions(x - x_0, h)
            return N[0] @ shapes.axial[rows], N[1] @ shapes.transverse[rows], N[3] @ shapes.transverse[rows]

        def slopes(a, b, at=at):
            xs = (a + b) / 2 + (b - a) / 2 * points
            return (b - a) / 2 * sum(weight * at(x)[2][0] * at(x)[2][1] for x, weight in zip(xs, weights, strict=True))

        for point, weight in zip(points, weights, strict=True):
            x = (x_0 + x_1) / 2 + h / 2 * point
            s, w, _ = at(x)
            H = reached + slopes(x_0, x)
            values = {
                "mass_s_0": s[0], "mass_w_1": w[1], "mass_X_w_0": x * w[0], "mass_s_0_w_0": s[0] * w[0],
                "mass_w_0_w_0": w[0] ** 2, "mass_H_0_1": H, "mass_X_H_0_1": x * H,
            }  # fmt: skip
            for name, value in values.items():
                sums[name] += rho_A * h / 2 * weight * value
        reached += slopes(x_0, x_1)
    # The rod hangs between two pins: its frame leaves its mass in place along the chord in the mean.
    sums["mass_X_H_0_1"] -= sums["mass_H_0_1"] * number["mass_X"] / number["mass"]
    sums["mass_H_0_1"] = 0.0
    largest = rho_A * link.length
    for name, value in sums.items():
        array = re.sub(r"_\d", "", name)
        found = number[array][tuple(map(int, re.findall(r"\d", name)))]
        assert found == pytest.approx(value, rel=1e-9, abs=1e-10 * largest), name


def test_stiffness_at_speed_is_that_of_the_stiffened_model():
    """spin-up at full speed: derivatives of what the shapes ask for are Phi^T (K_s + K_d + K_g) Phi of stiffened."""
    settings = ["solve.preset=coupled", "beam.axially_rigid=true"]
    model = kaneflex.load(with_settings(read_scene("spin-up"), settings))
    system, t = model.coupled, 20.0
    equations, state = prepare(system, *model.motion.states(system, np.array([t])))
    still = np.zeros(len(equations.names))
    K = equations.linear(equations.deformed(state, still, still, still)).K
    plain = kaneflex.load(read_scene("spin-up"))
    free = [row for row in range(27) if row not in (0, 1, 2)]
    Phi = system.shapes["beam"].transverse[free]
    order = [plain.coordinates.index(f"beam.{row // 3}.{('u', 'v', 'theta')[row % 3]}") for row in free]
    total = (plain.K_s(t) + plain.K_d(t) + plain.K_g(t))[np.ix_(order, order)]
    expected = Phi.T @ total @ Phi
    assert abs(K - expected).max() < 1e-10 * abs(expected).max()


def test_adams_damps_each_shape_of_a_link_by_its_own_frequency():
    """The strip's axial shape (1296 Hz) is damped critically, those of bending (5.5, 17.8 and 37.2 Hz) by 1 %."""
    settings = ['damping.modal={ratio="adams"}']
    number = moments(kaneflex.load(with_settings(read_scene("elastic-pendulum"), settings)), "strip")
    for k, (hertz, ratio) in enumerate([(1295.9, 1.0), (5.496, 0.01), (17.82, 0.01), (37.22, 0.01)]):
        expected = 2 * ratio * number["stiffness"][k] / (2 * np.pi * hertz)  # c = 2 zeta k / omega
        assert number["damping"][k, k] == pytest.approx(expected, rel=1e-3)


HINGED = """
schema = 1
description = "A beam on a hub that turns freely"
bodies.beam = {{length = "1 m", beam = {{material = "steel", A = "100 mm^2", I = "1000 mm^4", elements = 16}}}}
joints.hinge = {{revolute = ["ground", "beam.start"]}}
masses.hub = {{at = "beam.start", inertia = {inertia}}}
drives.hinge = {{free = true}}
solve = {{preset = "coupled", modes = 5, duration = "1 s"}}
"""


@pytest.mark.parametrize("ratio", ["0.01", "0.1", "0.5"])
def test_a_free_hub_lets_the_beam_vibrate_as_hinged(ratio):
    """Hinged-free beam with hub inertia eta rho A L^3 (tests/data/beam_frequency_factors.json); one way clamps it."""
    table = json.loads((DATA / "beam_frequency_factors.json").read_text())["hub_pinned_free"]["table"][ratio]
    model = kaneflex.load(scene_of(HINGED.format(inertia=float(ratio) * 0.785)))
    system = kaneflex.linearise(model)
    squares = np.sort(np.linalg.eigvals(np.linalg.solve(system.M, system.K)).real)
    unit = np.sqrt(2.1e11 * 1e-9 / 0.785)
    assert abs(squares[0]) < 1e-6 * squares[1]  # the turn of the whole
    at_rest = modes_at_rest(model)[1]
    for found, shown, row in zip(np.sqrt(squares[1:4]) / unit, at_rest[1:4] / unit, table, strict=False):
        assert found == pytest.approx(float(row["lam_sq"]), rel=1e-4)
        assert shown == pytest.approx(float(row["lam_sq"]), rel=1e-4)
    clamped = reference_modes(model, 1)[0][0] / unit
    assert clamped == pytest.approx(3.5160, rel=1e-4)


@pytest.mark.parametrize("scene", ["four-bar-motor", "quick-return", "six-bar"])
def test_rows_of_cuts_have_the_unit_of_what_they_push(scene):
    """A row whose unit reaction is a force is a length, in measures of the mechanism's size; a moment's is an angle."""
    system = model(scene, "solve.preset=coupled").coupled
    system.engine.openings(0.0)
    work, size = system.engine.work, system.mechanism.size
    rows = work.rows[: len(work.row_measure), 3:9].reshape(-1, 2, 3)
    assert len(rows) and size != 1.0
    assert work.row_measure.tolist() == np.where(rows[:, :, :2].any(axis=(1, 2)), size, 1.0).tolist()
