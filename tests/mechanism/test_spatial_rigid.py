"""Rigid mechanisms in space: kernels, joints, and motions against closed forms, a peer and published numbers."""

import json
import math

import numpy as np
import pytest
from machines import changed, machine
from places import DATA
from runs import solved

from kaneflex import SceneError, load, read_scene, scene_of, simulate, with_settings
from kaneflex.generated import spatial as kernels
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.multibody.model.assembly import rigid_system
from kaneflex.multibody.model.body_parameters import SpatialBlocks
from kaneflex.multibody.model.layout import WHAT
from kaneflex.multibody.model.module_loading import bind_parameters, find_laws_module
from kaneflex.multibody.model.topology import build_tables
from kaneflex.multibody.model.tree_layout import ANGLES, RIGID
from kaneflex.multibody.time import curves
from kaneflex.solve.loading import integrated

SEED = 20261122


def system_of(scene):
    module, _ = find_laws_module(scene, lambda stage: None)
    return rigid_system(mechanism_of(scene), module, bind_parameters(scene, module))


def test_a_body_asks_for_what_newton_and_euler_say():
    """F = m a_centre; M about the origin = J e + w x J w + c x F (Euler 1750), written by hand."""
    rng = np.random.default_rng(SEED)
    for _ in range(5):
        m, c = rng.uniform(0.5, 2.0), rng.normal(size=3)
        root = rng.normal(size=(3, 3))
        J, w, a, e = root @ root.T, *rng.normal(size=(3, 3))
        p = np.array([m, *c, J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[1, 2], J[2, 0]])
        found, mass = np.zeros(6), np.zeros(36)
        kernels.demand(p, 0, np.array([*w, *a, *e]), 0, found, 0)
        force = m * (a + np.cross(e, c) + np.cross(w, np.cross(w, c)))
        moment = J @ e + np.cross(w, J @ w) + np.cross(c, force)
        assert found == pytest.approx(np.concatenate([force, moment]), rel=1e-12, abs=1e-12)
        kernels.inertia(p, 0, mass, 0)
        still = np.zeros(6)
        kernels.demand(p, 0, np.zeros(9), 0, still, 0)
        columns = []
        for k in range(6):
            unit = np.zeros(9)
            unit[3 + k] = 1.0
            column = np.zeros(6)
            kernels.demand(p, 0, unit, 0, column, 0)
            columns.append(column - still)
        assert mass.reshape(6, 6) == pytest.approx(np.array(columns).T, rel=1e-12, abs=1e-12)


BLOCK = "mass = 1, inertia = [1, 1, 1]"
KINDS = {
    "revolute": ("axis = [1, 2, 2]", 5),
    "prismatic": ("direction = [1, 2, 2]", 5),
    "cylindrical": ("axis = [2, -1, 2]", 4),
    "universal": ("axes = [[1, 2, 2], [2, -2, 1]]", 4),
    "spherical": ("", 3),
    "weld": ("", 6),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("turned", [False, True])
def test_what_a_joint_holds_as_a_cut_is_what_it_leaves_free_in_the_tree(kind, turned):
    """The same joint twice: the second one, a cut, holds nothing more, wherever the first lets the body go.

    Both hang on a body whose axes are turned against those of the ground.
    """
    given, held = KINDS[kind]
    sides = "block.corner base.away" if turned else "base.away block.corner"
    joint = ", ".join(filter(None, (f"{kind} {sides}", given)))
    scene = scene_of(machine(
        gravity=[0, 0, -9.81],
        bodies=dict(base=f"{BLOCK}, rotation = {{axis = [0.5, -1, 2], angle = 0.9}}, points.away = [0.3, -0.2, 0.1]",
                    block=f"{BLOCK}, rotation = {{axis = [1, 1, 0.5], angle = 0.7}}, points.corner = [0.1, 0.2, 0.3]"),
        joints=dict(held="weld ground base.start", first=joint, second=joint),
        drives={} if kind == "weld" else dict(first="free = true"), solve=dict(duration=1),
    ))  # fmt: skip
    mechanism = mechanism_of(scene)
    built = build_tables(SpatialBlocks(mechanism, RIGID))
    cuts = built.acts[: built.ranges[1], WHAT]
    assert sum(len(ANGLES[what]) for what in cuts) == held == 6 - mechanism.joints["first"].freedoms
    system = system_of(scene)
    rng = np.random.default_rng(SEED)
    for _ in range(4):
        q = rng.normal(size=len(system.engine.layout.positions))
        system.place(q)
        assert abs(system.work.rows[:, 0]).max() < 1e-13
        assert abs(system.work.J).max(initial=0.0) < 1e-13
        by_twist = system.work.rows[:, 9:] if not turned else system.work.rows[:, 3:9]
        assert np.linalg.matrix_rank(by_twist, 1e-6) == held


# ---- joints written by hand ---------------------------------------------------------------------------------------


GUIDED = machine(
    ground=dict(o=[0.3, -0.2, 0.1]),
    bodies=dict(base=f"{BLOCK}, points.pin = [0.2, -0.4, 0.7]", once=BLOCK, twice=BLOCK, thrice=BLOCK,
                block=f"{BLOCK}, points.corner = [0.5, 0.3, -0.6]"),
    joints=dict(hub="revolute ground.o base, axis = [1, 2, 2]", along_y="prismatic base once, direction = [0, 1, 0]",
                along_z="prismatic once twice, direction = [0, 0, 1]",
                on_x="cylindrical twice thrice, axis = [1, 0, 0]",
                cardan="universal thrice block, axes = [[0, 1, 0], [0, 0, 1]]",
                tested="KIND base.pin block.corner, AXES"),
    drives=dict.fromkeys(("hub", "along_y", "along_z", "on_x", "cardan"), "free = true"), solve=dict(duration=1),
)
AXES = {
    "revolute": ", axis = [0, 0, 1]", "cylindrical": ", axis = [0, 0, 1]", "prismatic": ", direction = [0, 0, 1]",
    "universal": ", axes = [[1, 0, 0], [0, 1, 0]]", "spherical": "", "weld": "",
}  # fmt: skip


def joint_by_hand(kind, q):
    """Rows of a joint between a base and a block that stands at x, y, z and R_x(alpha) R_y(beta) R_z(gamma) in it,
    with their derivatives by q = (theta, y, z, x, alpha, beta, gamma) and by the twists of both sections.

    By hand, in the base's axes, which the hub turns by theta about n = (1, 2, 2)/3 (Rodrigues). The axes across z are
    y and -x.
    """
    theta, y, z, x, *angles = q
    (sa, sb, sg), (ca, cb, cg) = np.sin(angles), np.cos(angles)
    i = np.array([cb * cg, sa * sb * cg + ca * sg, sa * sg - ca * sb * cg])
    j = np.array([-cb * sg, ca * cg - sa * sb * sg, sa * cg + ca * sb * sg])
    k = np.array([sb, -sa * cb, ca * cb])
    arm = 0.5 * i + 0.3 * j - 0.6 * k
    gap = np.array([x - 0.2, y + 0.4, z - 0.7]) + arm
    n, none, (e_x, e_y, e_z) = np.array([1, 2, 2]) / 3, np.zeros(3), np.eye(3)
    of_gap = np.array([e_y, e_z, e_x, np.cross(e_x, arm), np.cross([0, ca, sa], arm), np.cross(k, arm)])
    c, s = np.cos(theta), np.sin(theta)
    turned = np.array([v * c + np.cross(n, v) * s + n * (n @ v) * (1 - c) for v in np.eye(3)])
    meets, by_q = gap @ turned, np.vstack([np.cross(n, gap @ turned), of_gap @ turned]).T
    meeting = [(meets[r], by_q[r], [-np.eye(3)[r], none, np.eye(3)[r], none]) for r in range(3)]

    def across(axis, of_turn):
        return axis @ gap, [0, *of_gap @ axis], [-axis @ turned, np.array(of_turn) @ turned, axis @ turned, none]

    sliding = [across(e_y, [gap[2], 0, -gap[0]]), across(-e_x, [0, gap[2], -gap[1]])]

    def square(value, of_angles, of_turn):
        """An angle that stays right: the second body's turn does what the first one's undoes."""
        return value, [0, 0, 0, 0, *of_angles], [none, -np.array(of_turn) @ turned, none, np.array(of_turn) @ turned]

    y_k = square(-sa * cb, [-ca * cb, sa * sb, 0], [-ca * cb, 0, sb])
    x_k = square(-sb, [0, -cb, 0], [0, -ca * cb, -sa * cb])
    x_j = square(-cb * sg, [0, sb * sg, -cb * cg], [0, sa * cg + ca * sb * sg, sa * sb * sg - ca * cg])
    z_i = square(
        sa * sg - ca * sb * cg, [ca * sg + sa * sb * cg, -ca * cb * cg, sa * cg + ca * sb * sg],
        [sa * sb * cg + ca * sg, -cb * cg, 0],
    )  # fmt: skip
    rows = {
        "revolute": [*meeting, y_k, x_k], "cylindrical": [*sliding, y_k, x_k], "prismatic": [*sliding, x_j, y_k, z_i],
        "universal": [*meeting, x_j], "spherical": meeting, "weld": [*meeting, x_j, y_k, z_i],
    }[kind]  # fmt: skip
    return np.array([[value, *by_q, *np.concatenate(by_twists)] for value, by_q, by_twists in rows])


@pytest.mark.parametrize("kind", AXES)
def test_rows_of_joints_by_hand(kind):
    """Residuals and both Jacobians at poses drawn by lot, where no joint closes; a thousandth in one entry is seen."""
    scene = scene_of(changed(GUIDED, ("KIND", kind), (", AXES", AXES[kind])))
    system = system_of(scene)
    assert len(system.engine.layout.positions) == 7 and list(system.layout.cuts) == ["tested"]
    for q in np.random.default_rng(SEED).uniform(-1.4, 1.4, (3, 7)):
        system.place(q)
        found = np.column_stack([system.work.rows[:, 0], system.work.J, system.work.rows[:, 3:]])
        expected = joint_by_hand(kind, q)
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-13)
        for entry in zip(*np.nonzero(expected), strict=True):
            wrong = found.copy()
            wrong[entry] *= 1.001
            assert not np.allclose(wrong, expected, rtol=1e-11, atol=1e-13)


def rates_by_hand(gap, angles):
    """g, g', g'' of the constraints across y and across -x, then of y at right angles to k, -x to k and x to j.

    By hand: the gap and the angles of R_x(alpha) R_y(beta) R_z(gamma), with their rates, are against the first section.
    """
    ((sa, sb, sg), (ca, cb, cg)), (a_1, b_1, g_1), (a_2, b_2, g_2) = (np.sin(angles[0]), np.cos(angles[0])), *angles[1:]
    y_k = (
        -sa * cb, sa * sb * b_1 - ca * cb * a_1,
        sa * sb * b_2 - ca * cb * a_2 + sa * cb * (a_1**2 + b_1**2) + 2 * ca * sb * a_1 * b_1,
    )  # fmt: skip
    x_k = -sb, -cb * b_1, sb * b_1**2 - cb * b_2
    x_j = (
        -cb * sg, sb * sg * b_1 - cb * cg * g_1,
        sb * sg * b_2 - cb * cg * g_2 + cb * sg * (b_1**2 + g_1**2) + 2 * sb * cg * b_1 * g_1,
    )  # fmt: skip
    return np.array([gap[:, 1], -gap[:, 0], y_k, x_k, x_j])


def turning_by_hand(angles):
    """j, k, angular velocity and acceleration of R_x(alpha) R_y(beta) R_z(gamma), all in the axes it starts from."""
    ((sa, sb, sg), (ca, cb, cg)), (a_1, b_1, g_1), (a_2, b_2, g_2) = (np.sin(angles[0]), np.cos(angles[0])), *angles[1:]
    omega = [a_1 + sb * g_1, ca * b_1 - sa * cb * g_1, sa * b_1 + ca * cb * g_1]
    epsilon = [
        a_2 + sb * g_2 + cb * b_1 * g_1,
        ca * b_2 - sa * cb * g_2 - sa * a_1 * b_1 - (ca * cb * a_1 - sa * sb * b_1) * g_1,
        sa * b_2 + ca * cb * g_2 + ca * a_1 * b_1 - (sa * cb * a_1 + ca * sb * b_1) * g_1,
    ]
    return np.array([
        [-cb * sg, ca * cg - sa * sb * sg, sa * cg + ca * sb * sg], [sb, -sa * cb, ca * cb], omega, epsilon,
    ])  # fmt: skip


def test_second_rates_of_constraints_by_hand():
    """Two sections that move in any way: g, g', g'' of every elementary constraint; a thousandth in one is seen."""
    rng, cross, (x, y, _) = np.random.default_rng(SEED), np.cross, np.eye(3)
    for _ in range(4):
        turned = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turned *= np.linalg.det(turned)
        (r, v, a), (omega, epsilon), gap, angles = (rng.uniform(-1.4, 1.4, (n, 3)) for n in (3, 2, 3, 3))
        j, k, w, w_1 = turning_by_hand(angles) @ turned.T
        rho, rho_1, rho_2 = gap @ turned.T
        r_2, v_2 = r + rho, v + rho_1 + cross(omega, rho)
        a_2 = a + rho_2 + 2 * cross(omega, rho_1) + cross(epsilon, rho) + cross(omega, cross(omega, rho))
        second = r_2, v_2, omega + w, a_2, epsilon + w_1 + cross(omega, w)
        sec = np.concatenate([r, v, omega, a, epsilon, *second])
        axes, found = np.concatenate([turned @ y, -turned @ x, turned @ x, j, k]), np.zeros((8, 15))
        out = found.ravel()
        kernels.on_plane(sec, 0, 1, axes, 0, out, 0)
        kernels.on_plane(sec, 0, 1, axes, 1, out, 15)
        for row, (one, other) in enumerate(((0, 4), (1, 4), (2, 3)), start=2):
            kernels.perpendicular(sec, 0, 1, axes, one, other, out, 15 * row)
        kernels.coincide(sec, 0, 1, out, 75)
        expected = np.vstack([rates_by_hand(gap, angles), np.array([r_2 - r, v_2 - v, a_2 - a]).T])
        np.testing.assert_allclose(found[:, :3], expected, rtol=1e-11, atol=1e-13)
        for entry in np.ndindex(expected.shape):
            wrong = found[:, :3].copy()
            wrong[entry] *= 1.001
            assert not np.allclose(wrong, expected, rtol=1e-11, atol=1e-13)


def test_bricard_against_the_reference():
    """IFToMM A04, solved by Exudyn with a step of 5e-4 s, whose own step error may be 1e-4: both agree to 1e-6."""
    solution = solved(read_scene("bricard"))
    t, *corner = json.loads((DATA / "bricard.json").read_text())["values"]["P3 is the point that starts at (1,-1,1)"][0]
    found = [float(solution[f"corner_{axis}"].interp(time=t)) for axis in "xyz"]
    assert found == pytest.approx(corner, abs=1e-6)
    assert solution.energy.drift < 1e-8


def test_bricards_shared_forces_are_not_numbers():
    scene = machine(like="bricard", sensors=dict(shared="joint_force second x"))
    with pytest.raises(Exception, match=r"sensors.shared.joint_force.*second.force_x is statically indeterminate"):
        load(scene_of(scene))
    model = load(read_scene("bricard"))
    assert np.isnan(model.motion.at(0.0)["second.force_x"]).all()


def test_the_slider_crank_moves_as_the_reference():
    """IFToMM's spatial slider-crank by Exudyn, whose steps are extrapolated to the digits that are given: all of them.

    The bodies are set off at 6 rad/s, the rod with 0.48 rad/s about z, which its universal joint (y in the slider, the
    guide's direction in the rod) does not let it have. Position constraints stop that within the first step, which is
    an impact: of the momenta remains what has power on the one motion that the joints allow.
    """
    rod = np.array([2.0, -1.0, -2.0]) / 3.0
    turning = 4e-3 * np.eye(3) + (4e-4 - 4e-3) * np.outer(rod, rod)
    others = (1e-4 + 0.12 * 0.04**2) + 0.5 * (0.02**2 + 0.04**2) + 2.0 * 0.04**2  # crank, rod's centre, slider
    given, allowed = np.array([0.32, -0.16, 0.08]), np.array([0.4, -0.2, 0.0])  # of the rod, for a crank at 1 rad/s
    after = 6.0 * (others + allowed @ turning @ given) / (others + allowed @ turning @ allowed)
    scene = read_scene("spatial-slider-crank")
    assert scene.drives["shaft"].initial_speed == pytest.approx(after, rel=1e-12)
    solution = solved(scene)
    for t, *there in json.loads((DATA / "spatial_slider_crank.json").read_text())["values"]:
        found = [float(solution[name].sel(time=t)) for name in ("slider_x", "crank_angle", "crank_speed")]
        assert found == pytest.approx(there, abs=1e-6)
    assert solution.energy.drift < 1e-7


DEAD_CENTRE = machine(
    gravity=[0, -9.81, 0],
    bodies=dict(
        crank='length = "1 m", mass = "2 kg", inertia = [0.01, 0.2, 0.2], rotation = {axis = [0, 0, 1], angle = 0.958}',
        rod='length = "2 m", mass = "3 kg", inertia = [0.01, 1.0, 1.0], rotation = {axis = [0, 0, 1], angle = -0.421}',
        piston='mass = "1 kg"'),
    joints=dict(shaft="revolute ground crank, axis = [0, 0, 1]", pin="revolute crank.end rod, axis = [0, 0, 1]",
                wrist="revolute rod.end piston, axis = [0, 0, 1]",
                slide="prismatic ground piston, direction = [1, 0, 0]"),
    drives=dict(slide='law = "2.4 + 0.5985*sin(2*pi*t)"'), solve=dict(duration=1),
)


def test_a_loop_is_followed_close_to_where_its_speeds_grow(monkeypatch):
    """A piston drives its crank to 0.05 rad from the dead centre: speeds are chosen anew there. Rows at instants in any
    order, and one by one, are by the cosine law."""
    anew, choose_anew = [], curves.choose_anew
    monkeypatch.setattr(curves, "choose_anew", lambda *given: anew.append(given) or choose_anew(*given))
    motion = load(scene_of(DEAD_CENTRE)).motion
    times = np.random.default_rng(SEED).permutation(np.linspace(0.0, 1.0, 301))
    together, alone = motion.at(times), np.vstack([motion.table(times[k : k + 1]) for k in range(40)])
    x = 2.4 + 0.5985 * np.sin(2.0 * np.pi * times)
    assert together["shaft.angle"] == pytest.approx(np.arccos((x**2 - 3.0) / (2.0 * x)) - 0.958, abs=1e-10)
    assert len(anew) > 0
    known = np.isfinite(alone).all(axis=0)
    alone, together = alone[:, known], together.values[:, known]
    assert abs((alone - together[:40]) / np.maximum(abs(together).max(axis=0), 1e-3)).max() < 1e-8


def test_a_loop_that_does_not_close_is_named():
    beyond = DEAD_CENTRE.replace("0.5985", "0.7")
    with pytest.raises(SceneError, match=r"joints = '.+': a loop does not close.*at t = 0\.1.*limit the drives"):
        load(scene_of(beyond)).motion.at(np.linspace(0.0, 1.0, 11))


def test_a_drive_of_a_loop_whose_law_has_a_pole_is_named():
    turned = DEAD_CENTRE.replace('slide = {law = "2.4 + 0.5985*sin(2*pi*t)"}', 'shaft = {law = "tan(2 * t)"}')
    with pytest.raises(SceneError, match=r"drives\.shaft\.law = 'tan.*: it grows without bound at t = 0\.785398 s"):
        load(scene_of(turned)).motion.at(np.linspace(0.0, 1.0, 11))


PARALLELOGRAM = machine(
    ground=dict(d=["300 mm", 0, 0]),
    bodies=dict(crank='length = "100 mm", mass = 0.1, rotation = {axis = [0, 0, 1], angle = "60 deg"}',
                coupler='length = "300 mm", mass = 0.1',
                rocker='length = "100 mm", mass = 0.1, rotation = {axis = [0, 0, 1], angle = "60 deg"}'),
    joints=dict(a="revolute ground crank, axis = [0, 0, 1]", d="revolute ground.d rocker, axis = [0, 0, 1]",
                b="universal crank.end coupler, axes = [[0, 0, 1], [0, 1, 0]]", c="spherical coupler.end rocker.end"),
    drives=dict(a='speed = "10 rad/s"'), sensors=dict(y="position rocker.end y"),
    solve=dict(preset="rigid", duration="0.3 s", steps=30),
)


def test_a_prescribed_loop_that_would_leave_its_branch_is_refused():
    """At 120 deg from its start the bars are in line. Without notice it went on as an antiparallelogram."""
    with pytest.raises(SceneError, match=r"singular, at t = 0\.21.*, where a = 12[0-3]\.\d* deg"):
        load(scene_of(PARALLELOGRAM)).motion.at(np.linspace(0.0, 0.3, 31))
    shorter = solved(scene_of(PARALLELOGRAM.replace("0.3 s", "0.2 s")))
    expected = 0.1 * np.sin(np.pi / 3.0 + 10.0 * shorter.times)
    assert shorter.series["y"].values == pytest.approx(expected, abs=1e-9)


def test_the_tolerance_of_coupled_bounds_rigid_bodies_in_space():
    """It did nothing, without a word."""
    scene = with_settings(read_scene("spatial-slider-crank"), ["solve.preset=coupled", "solve.steps=20"])
    models = [integrated(load(with_settings(scene, [f"solve.tolerance={each}"]))) for each in ("1e-5", "1e-12")]
    evaluations = [model.motion.curve.evaluations for model in models]
    assert evaluations[0] < 0.5 * evaluations[1]
    loose, tight = (simulate(model).energy.drift for model in models)
    assert 1e-8 < loose < 1e-3 and tight < 1e-10


def test_the_top_nutates_between_its_two_angles():
    """Lagrange's top (Goldstein 1980, sec. 5-7): u = cos(theta) moves between the roots of
    u'^2 = (1 - u^2) (alpha - beta u) - (b - a u)^2, here from rest, and takes the integral's time for it."""
    from scipy.integrate import quad

    scene = read_scene("spinning-top")
    solution = solved(scene)
    body = scene.bodies["top"]
    l, (J_3, J_c, _), m = body.centre[0], body.inertia, body.mass
    J_1, omega = J_c + m * l**2, scene.drives["tip"].angular_velocity[0]
    u_0, a, beta = math.cos(math.radians(30.0)), J_3 * omega / J_1, 2 * m * 9.81 * l / J_1
    # from rest b = a u_0 and alpha = beta u_0: u'^2 = (u_0 - u) [beta (1 - u^2) - a^2 (u_0 - u)]
    roots = np.roots([-beta, a**2, beta - a**2 * u_0])
    u_1 = float(next(root.real for root in roots if -1 < root.real < 1))
    height = solution["height"].values / body.length
    assert height.max() == pytest.approx(u_0, abs=1e-9)
    assert height.min() == pytest.approx(u_1, abs=1e-5)  # instants lie 1 ms apart
    rest = float(next(root.real for root in roots if not -1 < root.real < 1))
    middle, half = (u_0 + u_1) / 2, (u_0 - u_1) / 2
    time, _ = quad(lambda s: 1 / math.sqrt(beta * (rest - (middle + half * math.sin(s)))), -math.pi / 2, math.pi / 2)
    below = height < middle
    begun = solution.times[1:][below[1:] & ~below[:-1]]
    assert np.diff(begun).mean() == pytest.approx(2 * time, rel=2e-3)
    exact = solution.model.motion.at(time)["top.axes_zx"]
    assert exact == pytest.approx(u_1, abs=1e-8)


def test_a_free_body_flips_and_keeps_its_momentum():
    """Dzhanibekov's flip: about its middle principal axis a rotation is unstable; energy and momentum stay."""
    scene = scene_of(machine(
        gravity=[0, 0, 0],
        bodies=dict(nut="mass = 1, inertia = [3, 2, 1.2], "
                        "free = {at = [1, 2, 3], velocity = [0.1, 0.2, 0.3], angular_velocity = [0.001, 5, 0.002]}"),
        sensors=dict(spin="velocity nut angle_y"), solve="duration = 30",
    ))
    solution = solved(scene)
    rigid = solution.motion.rigid
    frame = rigid.frame("nut")
    momentum = frame.to_global(np.array([[3.0], [2.0], [1.2]]) * frame.to_body(frame.omega))
    spin = solution["spin"].values
    assert spin.max() > 4.9 and spin.min() < -4.9  # it has turned over
    assert abs(momentum - momentum[:, :1]).max() < 1e-7 * np.linalg.norm(momentum[:, 0])
    assert solution.energy.drift == 0.0 or np.ptp(solution.energy.kinetic) < 1e-7
    there = np.array([[1.0], [2.0], [3.0]]) + np.array([[0.1], [0.2], [0.3]]) * solution.times
    assert frame.place([0, 0, 0]) == pytest.approx(there, abs=1e-9)
