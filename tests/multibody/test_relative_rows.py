"""Rows of contacts and of their friction between two bodies that move at random, in the plane and in space."""

import numpy as np
import pytest
from lifting import lifted
from test_spatial_contacts import BACKLASH

from kaneflex import load, scene_of
from kaneflex.multibody.model import layout as at
from kaneflex.solve.coupled import beginning

SCENE = """
schema = 1
description = "Two bodies and a contact"
bodies.one = {length = 0.3, mass = 1, inertia = INERTIA, free = {at = ORIGIN}}
bodies.two = {length = 0.3, mass = 1, inertia = INERTIA, free = {at = START}}
CONTACT
sensors.push = {contact_force = "NAME"}
solve = {preset = "coupled", duration = "1 ms", steps = 2, start = "zero"}
"""
LAW = 'contact = {law = "hertz", stiffness = "7e4 N/m", exponent = 1}, friction = {mu = 0.3}'
REACH, RADIUS = {"face": 0.21, "point": 0.0} | dict.fromkeys(("on", "rod", "in", "pipe", "pin"), 0.35), 0.21
INSIDE, AXIAL = ("in", "pipe", "pin"), ("rod", "pipe", "pin")
"""Kinds of circles of which the second is in the first, and of cylinders."""
KINDS = {
    ("face", 3): 'contacts.face = {point_on_line = ["two.end", "one.end"], normal = NORMAL, radius = 0.21, LAW}',
    ("face", 6): 'contacts.face = {point_on_plane = ["two.end", "one.end"], normal = NORMAL, radius = 0.21, LAW}',
    ("point", 6): 'contacts.face = {point_on_plane = ["two.end", "one.end"], normal = NORMAL, LAW}',
    ("on", 3): 'contacts.face = {circle_on_circle = ["two.end", "one.end"], radii = [0.21, 0.14], LAW}',
    ("in", 3): 'contacts.face = {circle_in_circle = ["two.end", "one.end"], radii = [0.21, 0.56], LAW}',
    ("on", 6): 'contacts.face = {circle_on_circle = ["two.end", "one.end"], radii = [0.21, 0.14], LAW}',
    ("pipe", 6): 'contacts.face = {circle_in_circle = ["two.end", "one.end"], radii = [0.21, 0.56], axis = NORMAL, '
    'LAW}',
    ("rod", 6): 'contacts.face = {circle_on_circle = ["two.end", "one.end"], radii = [0.21, 0.14], axis = NORMAL, LAW}',
    ("pin", 6): 'joints.face = {cylindrical = ["one.end", "two.end"], axis = NORMAL, '
    'clearance = {radial = 0.35, radius = 0.21, length = 0.1, LAW}}',
    ("in", 6): 'joints.face = {spherical = ["one.end", "two.end"], clearance = {radial = 0.35, radius = 0.21, LAW}}',
}
NORMAL = {3: (0.6, -0.8), 6: (0.48, -0.64, 0.6)}
STEP = 1e-5


class Pair:
    """Two bodies, apart, at states near that of the scene."""

    def __init__(self, kind, d, seed=0):
        there = (2.0, -2.5, 0.3) if kind not in INSIDE else (0.1, -0.15, 0.1) if kind == "in" else (0.15, 0.2, -0.1)
        axes = d // 3 + 1
        name = "face_2" if kind == "pin" else "face"
        given = {"CONTACT": KINDS[kind, d], "NAME": name, "LAW": LAW, "NORMAL": list(NORMAL[d]), "ORIGIN": [0] * axes,
                 "START": list(there[:axes]), "INERTIA": 0.01 if d == 3 else [0.01, 0.02, 0.03]}  # fmt: skip
        text = SCENE
        for key, value in given.items():
            text = text.replace(key, str(value))
        model = load(scene_of(text))
        self.system, self.start, self.random = model.coupled_system, beginning(model), np.random.default_rng(seed)
        self.engine = self.system.engine
        self.engine.set(self.start)
        self.engine.choose(0.0)
        contact, first = self.engine.count(at.CONTACTS), self.engine.count(at.CUT_ROWS)
        self.numbers = [first, first - 1, first - 2]  # of the contact, of its friction along and across the slip
        if kind == "pin":  # its front end; the rear one has the rows in between
            contact, self.numbers = contact + 1, [first + 1, first - 1, first - 3]
        self.act = self.engine.tables.acts[contact]
        self.sides = self.act[[at.AT, at.ON]]
        self.rate = self.random.normal(size=self.engine.size)
        (self.q,) = self.engine.advanced(self.start.q, 0.02 * self.random.normal(size=(1, self.engine.size)))

    def rows(self, q, u):
        """Rows of the contact and its frictions, and numbers of both sections."""
        state = self.system.project(0.0, q, u, self.engine.choice)
        return self.engine.work.rows[self.numbers].copy(), self.engine.work.sections[self.sides].copy(), state.du


def pairs():
    return pytest.mark.parametrize(("kind", "d"), KINDS)


def velocity(section, place):
    """Velocity of a section's body at a place."""
    if len(section) == 9:
        return section[3:5] + section[5] * (place - section[:2])[::-1] * [-1, 1]
    return section[3:6] + np.cross(section[6:9], place - section[:3])


@pairs()
def test_a_row_has_its_gap_its_normal_and_its_speeds(kind, d):
    """In closed form; the rate of what slides is that of both bodies' material at the touched place."""
    pair = Pair(kind, d)
    rows, (one, two), _ = pair.rows(pair.q, pair.rate)
    axes = d // 3 + 1
    between, normal = (two - one)[:axes], rows[0, 3 + d : 3 + d + axes]
    if kind in AXIAL:
        axis = pair.engine.work.axes[int(pair.engine.tables.w[pair.act[at.NUMBERS_AT] + at.AXIS_AT])]
        between = between - axis @ between * axis
    length, way = np.linalg.norm(between), -1.0 if kind in INSIDE else 1.0
    flat = kind in ("face", "point")
    gap = normal @ between - REACH[kind] if flat else way * (length - REACH[kind])
    assert rows[0, 0] == pytest.approx(gap, abs=1e-14) and gap > 0.0
    if not flat:
        assert normal == pytest.approx(way * between / length, abs=1e-14)
    elif d == 3:
        c, s, (x, y) = np.cos(one[2]), np.sin(one[2]), NORMAL[3]
        assert normal == pytest.approx([c * x - s * y, s * x + c * y], abs=1e-14)
    # friction of a point or at a cylinder acts at the surface of the first body
    touched = two[:axes] - (gap if kind == "point" else RADIUS + gap * (kind in AXIAL)) * normal
    slide = velocity(two, touched) - velocity(one, touched)
    directions = [row[3 + d : 3 + d + axes] for row in rows[: axes]]
    assert np.array(directions) @ np.transpose(directions) == pytest.approx(np.eye(axes), abs=1e-14)
    assert [row[1] for row in rows[:axes]] == pytest.approx(np.array(directions) @ slide, abs=1e-13)
    if d == 3:
        assert directions[1] == pytest.approx([-normal[1], normal[0]], abs=1e-15)


@pairs()
def test_a_row_has_its_rates_and_its_jacobian(kind, d):
    """Rates are differences along a motion; the Jacobian times both twists is the first one, whatever the twists."""
    pair, axes = Pair(kind, d, 1), d // 3 + 1
    rows, _, du = pair.rows(pair.q, pair.rate)
    for _ in range(3):
        moved, sections, _ = pair.rows(pair.q, pair.random.normal(size=pair.engine.size))
        assert moved[:axes, 3:] == pytest.approx(rows[:axes, 3:], abs=1e-12)
        twists = np.concatenate(sections[:, 3 : 3 + d]) if d == 3 else np.concatenate(sections[:, 3:9])
        assert moved[:axes, 3:] @ twists == pytest.approx(moved[:axes, 1], abs=1e-12)
    steps = np.outer((STEP, -STEP), pair.rate) + 0.5 * STEP**2 * du
    near = [pair.rows(q, pair.rate + h * du)[0]
            for h, q in zip((STEP, -STEP), pair.engine.advanced(pair.q, steps), strict=True)]  # fmt: skip
    change = (near[0] - near[1])[:axes] / (2 * STEP)
    assert rows[0, 1] == pytest.approx(change[0, 0], rel=1e-7, abs=1e-8)
    # friction of spheres and pins has the rate of directions that do not spin
    exact = 1 if d == 6 and kind not in ("face", "point") else axes
    assert rows[:exact, 2] == pytest.approx(change[:exact, 1], rel=1e-7, abs=1e-7)
    if kind == "face" and d == 3:  # a way that slides
        assert rows[1, 1] == pytest.approx(change[1, 0], rel=1e-7, abs=1e-8)


@pytest.mark.parametrize(("kind", "d"), [("in", 3), ("in", 6)])
def test_circles_about_one_centre_have_no_normal_and_no_nan(kind, d):
    pair, axes = Pair(kind, d), d // 3 + 1
    (q,) = pair.engine.advanced(pair.start.q, np.zeros((1, pair.engine.size)))
    names = [name for name, _ in pair.engine.layout.positions]
    for axis in "xyz"[:axes]:
        q[names.index(f"two.{axis}")] = q[names.index(f"one.{axis}")]
    rows, _, _ = pair.rows(q, pair.rate)
    assert rows[0, 0] == pytest.approx(REACH[kind])
    assert (rows[0, [1, *range(3, 3 + 2 * d)]] == 0.0).all() and np.isfinite(rows[0]).all()


@pytest.mark.parametrize("d", [3, 6])
def test_a_gap_of_a_nanometre_is_told_in_a_bearing_of_a_decimetre(d):
    pair = Pair("in", d)
    names, q = [name for name, _ in pair.engine.layout.positions], pair.start.q.copy()
    for axis in "xyz"[: d // 3 + 1]:
        q[names.index(f"two.{axis}")] = q[names.index(f"one.{axis}")] = 0.0
    q[names.index("two.x")] = 1e-9
    pair.engine.tables.w[pair.engine.tables.acts[pair.engine.count(at.CONTACTS), at.NUMBERS_AT] + 2] = 3e-9
    rows, _, _ = pair.rows(q, 0.0 * pair.rate)
    assert rows[0, 0] == pytest.approx(2e-9, rel=1e-7)  # both points are 0.3 m from their bodies' origins


@pytest.mark.parametrize("space", [False, True])
def test_flanks_know_angles_alone(space):
    scene = scene_of(BACKLASH.replace("CONTACT", '{law = "hertz", stiffness = 1e5, exponent = 1}'))
    lift = lifted(scene) | {"solve": {"preset": "coupled", "duration": 0.01, "steps": 2}}
    engine = load(scene_of(lift) if space else scene).coupled_system.engine
    engine.choose(0.0)
    y, u, *_ = engine.motion
    y[:], u[:] = (0.3, 0.002), (1.0, -3.0)
    engine.project(0.0)
    acts, w = engine.tables.acts[engine.count(at.CONTACTS) :][:2], engine.tables.w
    for row, act in zip(engine.work.rows[engine.count(at.CUT_ROWS) :], acts, strict=True):
        way, _, reach = w[act[at.NUMBERS_AT] :][:3]
        assert row[:2] == pytest.approx([way * 0.002 - reach, -3.0 * way], abs=1e-14)
        forces, (first, second) = np.split(row[3:].reshape(2, -1), [3 if space else 2], axis=1)
        assert (forces == 0.0).all() and (first == -second).all()
        assert np.linalg.norm(second) == pytest.approx(1.0) and (space or second == [way])
