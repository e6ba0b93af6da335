"""The scene robot-arm against the PUMA 560 as the literature has it: published gravity loads, and Newton and Euler's
recursion written here from the table of Denavit and Hartenberg."""

import math

import numpy as np
import pytest
from runs import run

from kaneflex import load, read_scene, scene_of

# Link by link: d, a [m], alpha; mass [kg]; centre [m] and principal moments [kg m^2] in the link's own frame, which
# stands at the link's far end (Corke's mdl_puma560, after Armstrong, Khatib & Burdick 1986).
LINKS = [
    (0.0, 0.0, math.pi / 2, 0.0, (0.0, 0.0, 0.0), (0.0, 0.35, 0.0)),
    (0.0, 0.4318, 0.0, 17.4, (-0.3638, 0.006, 0.2275), (0.13, 0.524, 0.539)),
    (0.15005, 0.0203, -math.pi / 2, 4.8, (-0.0203, -0.0141, 0.070), (0.066, 0.086, 0.0125)),
    (0.4318, 0.0, math.pi / 2, 0.82, (0.0, 0.019, 0.0), (1.8e-3, 1.3e-3, 1.8e-3)),
    (0.0, 0.0, -math.pi / 2, 0.34, (0.0, 0.0, 0.0), (0.3e-3, 0.4e-3, 0.3e-3)),
    (0.0, 0.0, 0.0, 0.09, (0.0, 0.0, 0.032), (0.15e-3, 0.15e-3, 0.04e-3)),
]
MEASURED = LINKS[2][5]
TAKEN = (0.066, 0.0785, 0.0125)  # of the forearm, in the scene: the nearest that a body can have
FACE, EDGE, CUBE, TURNING = 0.05625, 0.0683, 2.5, 1.944e-3
SHOULDER, GRAVITY = 26.45 * 0.0254, 9.81
NOMINAL = [0.0, math.pi / 4, math.pi, 0.0, math.pi / 4, 0.0]


def frames(q):
    """Axes and origins of all links' frames and of the ground's, whose origin is at the shoulder: standard convention,
    a turn about z, d along it, a along x, a turn about x."""
    found = [(np.eye(3), np.zeros(3))]
    for angle, (d, a, alpha, *_) in zip(q, LINKS, strict=True):
        (c, s), (ca, sa) = (math.cos(angle), math.sin(angle)), (math.cos(alpha), math.sin(alpha))
        R, o = found[-1]
        found.append((R @ [[c, -s * ca, s * sa], [s, c * ca, -c * sa], [0.0, sa, ca]], o + R @ [a * c, a * s, d]))
    return found


def moments(q, rates, accels, forearm=TAKEN, loaded=True):
    """What the drives exert: all link accelerations outwards, all forces back (Luh, Walker & Paul 1980), global."""
    at = frames(q)
    w, e, a = np.zeros(3), np.zeros(3), np.array([0.0, 0.0, GRAVITY])
    pushes = []
    for k, (_, _, _, mass, centre, inertia) in enumerate(LINKS):
        axis, (R, o) = at[k][0][:, 2], at[k + 1]
        e = e + axis * accels[k] + np.cross(w, axis * rates[k])
        w = w + axis * rates[k]
        arm = o - at[k][1]
        a = a + np.cross(e, arm) + np.cross(w, np.cross(w, arm))
        lumps = [(mass, centre, forearm if k == 2 else inertia)]
        if k == 5 and loaded:
            lumps.append((CUBE, (0.0, 0.0, FACE + EDGE / 2), (TURNING,) * 3))
        for m, c, J in lumps:
            arm, tensor = R @ c, R @ np.diag(J) @ R.T
            force = m * (a + np.cross(e, arm) + np.cross(w, np.cross(w, arm)))
            pushes.append((k, o + arm, force, tensor @ e + np.cross(w, tensor @ w)))
    found = np.zeros(6)
    for k in range(6):
        axis, o = at[k][0][:, 2], at[k][1]
        found[k] = sum(axis @ (moment + np.cross(point - o, force)) for i, point, force, moment in pushes if i >= k)
    return found


def courses(scene, t):
    """Angles, rates and accelerations of all joints: cycloids from rest to rest, of which the test reads no text."""
    begin, by = np.array(NOMINAL), np.array([1 / 2, -1 / 12, -1 / 4, 1 / 2, 1 / 6, -1]) * math.pi
    T = scene.solve.duration
    s = 2 * math.pi * t / T
    gone, rate, accel = (s - math.sin(s)) / (2 * math.pi), (1 - math.cos(s)) / T, 2 * math.pi * math.sin(s) / T**2
    return begin + by * gone, by * rate, by * accel


def test_the_table_stands_as_the_arm_does():
    """Frames in the zero pose: the upper arm level, the forearm upright; the scene's bodies have their axes."""
    at = frames(np.zeros(6))
    origins = [(0.4318, 0, 0), (0.4521, -0.15005, 0), *[(0.4521, -0.15005, 0.4318)] * 3]
    axes = [(0, -1, 0), (0, -1, 0), (0, 0, 1), (0, -1, 0), (0, 0, 1), (0, 0, 1)]
    assert np.array([o for _, o in at[2:]]) == pytest.approx(np.array(origins), abs=1e-15)
    assert np.array([R[:, 2] for R, _ in at[1:]]) == pytest.approx(np.array(axes, float), abs=1e-15)
    assert all(R[:, 0] == pytest.approx([1, 0, 0]) for R, _ in at)
    bodies = read_scene("robot-arm").bodies
    for body, (R, _) in zip(("upper_arm", "forearm", "wrist", "hand", "flange"), at[2:], strict=True):
        rotation = bodies[body].rotation
        assert (np.eye(3) if rotation is None else rotation.matrix) == pytest.approx(R, abs=1e-15)


def test_gravity_load_in_the_nominal_pose():
    """Published for the arm without payload (Robotics Toolbox for Scilab, gravload; Corke, Robotics, Vision and
    Control): at the start everything is at rest, and drives hold the weight alone."""
    published = [0.0, 31.63988, 6.035138, 0.0, 0.0282528, 0.0]
    assert moments(NOMINAL, np.zeros(6), np.zeros(6), loaded=False) == pytest.approx(published, rel=1e-6, abs=1e-9)
    sensors = {f"tool_{a}{b}": "none" for a in "xyz" for b in ("", "_acceleration")}
    empty = {"bodies": {"payload": "none"}, "joints": {"grip": "none"}, "sensors": sensors}
    start = load(scene_of({"schema": 1, "like": "robot-arm", **empty})).motion.at(0.0)
    found = [float(start[f"joint_{k}.drive"][0]) for k in range(1, 7)]
    assert found == pytest.approx(published, rel=1e-6, abs=1e-9)


def test_drive_moments_and_tool_over_the_motion():
    solution = run("robot-arm")
    scene = solution.model.scene
    some = solution.times[::20]
    wanted = np.array([moments(*courses(scene, t)) for t in some])
    found = np.array([solution[f"torque_{k}"].values[::20] for k in range(1, 7)]).T
    assert found == pytest.approx(wanted, abs=1e-10 * abs(wanted).max())
    last = (frames(courses(scene, t)[0])[-1] for t in some)
    tool = np.array([R @ [0, 0, FACE + EDGE] + o for R, o in last])
    found = np.array([solution[f"tool_{axis}"].values[::20] for axis in "xyz"]).T
    assert found - tool == pytest.approx(np.tile([0, 0, SHOULDER], (len(tool), 1)), abs=1e-12)
    velocity = np.cumsum([solution[f"tool_{axis}_acceleration"].values for axis in "xyz"], axis=1) * solution.model.step
    assert abs(velocity[:, -1]).max() < 1e-5 * abs(velocity).max()  # from rest to rest


def test_what_the_measured_moments_of_the_forearm_would_change():
    """They belong to no body: the largest exceeds the two others together by 9 %. The scene lowers it to their sum."""
    assert MEASURED[1] > MEASURED[0] + MEASURED[2] == pytest.approx(TAKEN[1])
    scene = read_scene("robot-arm")
    assert scene.bodies["forearm"].inertia == TAKEN
    assert pytest.approx(CUBE * EDGE**2 / 6, rel=2e-4) == TURNING
    apart = [moments(*courses(scene, t)) - moments(*courses(scene, t), forearm=MEASURED)
             for t in np.linspace(0.0, scene.solve.duration, 101)]  # fmt: skip
    assert abs(np.array(apart)).max() < 0.008  # of 48 N m
