"""The slider-crank with a wide guide of Flores, Leine & Glocker 2010 against nonsmooth dynamics by time stepping.

tests/data/slider_clearance.json has the trajectory that the package Siconos publishes: steps of 0.1 ms, friction 0.01.
A time stepping written here from the paper's model alone stands between: with this step and the mass matrix at a step's
end, as Siconos has it, it gives the published numbers; with shorter steps and the mass matrix in their middle it comes
to what the engine says, with friction and without. The published crank is 1e-4 revolutions off that by the first
impact, and 1.8e-3 after 18 ms, by its step. Later on statistics are compared: which corner knocks first, and how often
it knocks before it rests, is a matter of steps.
"""

import json
import math

import numpy as np
import pytest
from places import DATA
from runs import solved
from test_contact_motion import SLIDING

from kaneflex.scene import scene_of

PUBLISHED = json.loads((DATA / "slider_clearance.json").read_text())
MODEL, POINTS = PUBLISHED["model"], PUBLISHED["values"]
L_1, L_2, A, B, C = (MODEL[key] for key in ("l_crank_m", "l_rod_m", "a_m", "b_m", "c_m"))
(M_1, M_2, M_3), (J_1, J_2, J_3), E = MODEL["mass_kg"], MODEL["inertia_kg_m2"], MODEL["e_normal"]
G = MODEL["gravity_m_s2"]
OFF = (M_2 / 2 + M_3) * L_1 * L_2


def inverse_mass(q):
    both = OFF * math.cos(q[0] - q[1])
    first, second = J_1 + M_1 * L_1**2 / 4 + (M_2 + M_3) * L_1**2, J_2 + M_2 * L_2**2 / 4 + M_3 * L_2**2
    return np.linalg.inv([[first, both, 0], [both, second, 0], [0, 0, J_3]])


def forces(q, v):
    turning = OFF * math.sin(q[0] - q[1])
    return np.array([
        -turning * v[1] ** 2 - G * L_1 * math.cos(q[0]) * (M_1 / 2 + M_2 + M_3),
        turning * v[0] ** 2 - G * L_2 * math.cos(q[1]) * (M_2 / 2 + M_3), 0.0,
    ])  # fmt: skip


def height(q):
    return L_1 * math.sin(q[0]) + L_2 * math.sin(q[1])


def corners(q):
    """Gap of every corner, and the derivatives by q of it and of its slide."""
    c, s = math.cos(q[2]), math.sin(q[2])
    for along, up in ((1, 1), (-1, 1), (1, -1), (-1, -1)):
        x, y = c * along * A - s * up * B, s * along * A + c * up * B
        by_y = np.array([L_1 * math.cos(q[0]), L_2 * math.cos(q[1]), x])
        yield B + C - up * (height(q) + y), -up * by_y, np.array([-L_1 * math.sin(q[0]), -L_2 * math.sin(q[1]), -y])


def energy(q, v):
    weight = G * (L_1 * math.sin(q[0]) * (M_1 / 2 + M_2 + M_3) + L_2 * math.sin(q[1]) * (M_2 / 2 + M_3))
    return v @ np.linalg.solve(inverse_mass(q), v) / 2 + weight


def stepped(h, mu, at_end, until=0.0, approaches=None):
    """Moreau's time stepping: states at the published instants, and when contacts first exert something.

    To ``approaches`` it adds the speeds at which corners come to push, at last the energy and the crank's angle.
    """
    q, v, states, touches, pushed = np.zeros(3), np.array([150.0, -75.0, 0.0]), {}, [], False
    wanted, pushing = {round(point["t_s"] / h) for point in POINTS}, np.zeros(4, bool)
    for step in range(1, max(*wanted, round(until / h)) + 1):
        near = list(corners(q))
        active = [k for k, (gap, by, _) in enumerate(near) if gap + h / 2 * (by @ v) <= 0]
        p, after, end = np.zeros((4, 2)), v, q + h * v
        for _ in range(30 if at_end else 6):
            there = end if at_end else (q + end) / 2
            inverse, rows, before = inverse_mass(there), list(corners(there)), after
            after = v + h * inverse @ (forces(q, v) + forces(end, after)) / 2
            for k in active:
                after = after + inverse @ (rows[k][1] * p[k, 0] + rows[k][2] * p[k, 1])
            answers = {k: [(row, row @ inverse, row @ inverse @ row) for row in rows[k][1:]] for k in active}
            for _ in range(200 if active else 0):
                changed = 0.0
                for k, ((normal, by_push, least), (along, by_drag, easy)) in answers.items():
                    push = max(0.0, p[k, 0] - (normal @ after + E * (near[k][1] @ v)) / least)
                    after, changed = after + by_push * (push - p[k, 0]), max(changed, abs(push - p[k, 0]))
                    p[k, 0], most = push, mu * push
                    drag = min(max(p[k, 1] - (along @ after) / easy, -most), most)
                    after, p[k, 1] = after + by_drag * (drag - p[k, 1]), drag
                if changed < 1e-13:
                    break
            end = q + h / 2 * (v + after)
            if abs(after - before).max() < 1e-11:
                break
        if p.max() > 0 and not pushed:
            touches.append(step * h)
        if approaches is not None:
            approaches += [-by @ v for k, (_, by, _) in enumerate(near) if p[k, 0] > 0 and not pushing[k]]
            pushing = p[:, 0] > 0
        q, v, pushed = end, after, p.max() > 0
        if step in wanted:
            states[step] = (q[0] / (2 * math.pi), q[1], height(q) / C)
    if approaches is not None:
        approaches += [energy(q, v), q[0]]
    return np.array(list(states.values())), touches


def test_the_published_trajectory_is_that_of_its_step():
    found, touches = stepped(1e-4, MODEL["mu"], at_end=True)
    published = np.array([[point[key] for key in ("crank_rev", "phi2_rad", "y_slider_c")] for point in POINTS])
    assert found[:, 0] == pytest.approx(published[:, 0], abs=PUBLISHED["difference_of_two_variants"]["crank_rev"])
    assert found[:, 2] == pytest.approx(published[:, 2], abs=PUBLISHED["difference_of_two_variants"]["y_slider_c"])
    assert touches[0] == pytest.approx(PUBLISHED["first_touches_of_the_upper_face_s"][0], abs=1e-12)


@pytest.mark.parametrize("mu", [0.0, MODEL["mu"]])
def test_newtons_law_is_the_limit_of_shorter_steps(mu):
    """Its first impacts, too, to a published step; the first one is a step and 7 us before the published touch."""
    text = SLIDING.replace("stiffness = 1e13", 'law = "newton"').replace("steps = 90", "steps = 180")
    text = text.replace("clearance.gap", f"clearance.friction.mu = {mu}, clearance.gap") if mu else text
    text += 'sensors.crank = {position = "main", component = "angle"}\n'
    solution = solved(scene_of(text + 'sensors.rod = {position = "rod", component = "angle"}'))
    rows = [int(np.argmin(abs(solution.times - point["t_s"]))) for point in POINTS]
    assert solution.times[rows] == pytest.approx([point["t_s"] for point in POINTS], abs=1e-12)
    crank, rod, y = (solution.series[name].values[rows] for name in ("crank", "rod", "y"))
    found, touches = stepped(1e-5, mu, at_end=False)
    assert crank / (2 * math.pi) == pytest.approx(found[:, 0], abs=1e-5)
    assert rod == pytest.approx(found[:, 1], abs=1e-4)
    assert y / C == pytest.approx(found[:, 2], abs=0.02)
    begun = sorted({impact.begin for impact in solution.impacts})
    assert begun[:2] == pytest.approx(touches[:2], abs=1e-4)
    assert begun[0] == pytest.approx(PUBLISHED["first_touches_of_the_upper_face_s"][0] - 1e-4, abs=1e-5)
    assert abs(y / C).max() <= 1 + 1e-12
    published = np.array([point["crank_rev"] for point in POINTS])
    assert crank[:2] / (2 * math.pi) == pytest.approx(published[:2], abs=1e-4)
    assert crank / (2 * math.pi) == pytest.approx(published, abs=2e-3)


def test_later_impacts_are_as_many_as_hard_and_as_costly_as_those_of_time_stepping():
    """To 0.1 s, a turn and a half: energy left, impacts a turn and the distribution of their speeds of approach.

    Slow ones, of corners that come to rest, are as many as steps resolve, and left out; of two knocks in one step time
    stepping knows one.
    """
    stepping: list[float] = []
    stepped(1e-4, MODEL["mu"], at_end=False, until=0.1, approaches=stepping)
    *speeds, left, angle = stepping
    text = SLIDING.replace("stiffness = 1e13", 'law = "newton"').replace("steps = 90", "steps = 200")
    text = text.replace("18 ms", "100 ms").replace("clearance.gap", "clearance.friction.mu = 0.01, clearance.gap")
    solution = solved(scene_of(text + 'sensors.crank = {position = "main", component = "angle"}'))
    first, turned = energy(np.zeros(3), np.array([150.0, -75.0, 0.0])), solution.series["crank"].values[-1]
    assert turned == pytest.approx(angle, rel=2e-3)
    assert solution.trajectory.energy.dissipated[-1] / turned == pytest.approx((first - left) / angle, rel=0.05)
    fast = [impact.approach for impact in solution.impacts if impact.approach > 0.2]
    known = [speed for speed in speeds if speed > 0.2]
    assert len(fast) / turned == pytest.approx(len(known) / angle, rel=0.25)
    rms, other = (math.sqrt(np.mean(np.square(each))) for each in (fast, known))
    assert rms == pytest.approx(other, rel=0.1) and max(fast) == pytest.approx(max(known), rel=0.05)
    assert np.percentile(fast, [25, 75]) == pytest.approx(np.percentile(known, [25, 75]), rel=0.2)
