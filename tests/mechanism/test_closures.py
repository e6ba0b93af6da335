"""Mechanisms of every kind that closes in closed form, and random linkages: they close, move and balance."""

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from machines import machine
from newton_euler import imbalance, motion_of, place, turned, widest_gap
from scipy.linalg import eigvalsh

from kaneflex import Model, Scene, SceneError, load, scene_of
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.position_analysis import place as placed
from kaneflex.mechanism.rigid_motion import RigidKinematics, RigidMotion
from kaneflex.multibody.model.module_loading import bind_parameters, find_module
from kaneflex.scene.quantities import Address

# Offset, tilted guide, mass centres off their axes, loads by law and by value in body axes, gravity.
SLIDER = """
gravity = [3.0, -9.0]
ground.line = ["20 mm", "12 mm"]
bodies.crank = {length = "40 mm", mass = "0.952 kg"}
bodies.rod = {length = "137 mm", mass = "0.2 kg", centre = ["50 mm", "6 mm"], inertia = "3e-4 kg m^2"}
bodies.piston.mass = "0.3 kg"
bodies.piston.centre = ["9 mm", "-4 mm"]
bodies.piston.inertia = "1e-4 kg m^2"
bodies.piston.points = {eye = ["5 mm", "3 mm"], skirt = ["-7 mm", "2 mm"]}
joints.main = {revolute = ["ground", "crank.start"]}
joints.pin = {revolute = ["crank.end", "rod.start"]}
joints.wrist = {revolute = ["rod.end", "piston.eye"]}
joints.bore = {prismatic = ["ground.line", "piston.skirt"], direction = [0.8, 0.6], branch = "+"}
loads.push = {force_on = "rod.mid", direction = [0.6, 0.8], axes = "body", law = "100 * sin(3 * main) + main_speed"}
loads.brake = {force_on = "crank.end", direction = [0, 1], value = "-250 N"}
"""

# The coupler is joined at points off its axis.
FOUR_BAR = """
gravity = [0.0, -9.81]
ground.pivot = ["200 mm", "30 mm"]
bodies.crank = {length = "60 mm", mass = "0.5 kg"}
bodies.rocker = {length = "150 mm", mass = "0.8 kg", centre = ["70 mm", "10 mm"]}
bodies.coupler.mass = "0.7 kg"
bodies.coupler.centre = ["90 mm", "20 mm"]
bodies.coupler.inertia = "2e-3 kg m^2"
bodies.coupler.points = {near = ["-10 mm", "5 mm"], far = ["170 mm", "15 mm"]}
joints.main = {revolute = ["ground", "crank.start"]}
joints.pin = {revolute = ["crank.end", "coupler.near"]}
joints.knee = {revolute = ["coupler.far", "rocker.end"]}
joints.foot = {revolute = ["rocker.start", "ground.pivot"], branch = "+"}
loads.pull = {force_on = "rocker.mid", direction = [0, 1], axes = "body", value = "40 N"}
"""

# A block on the crank's pin slides along a lever whose slot misses its pivot.
LEVER = """
gravity = [0.0, -9.81]
ground.pivot = ["-30 mm", "-150 mm"]
bodies.crank = {length = "60 mm", mass = "0.5 kg"}
bodies.block = {mass = "0.2 kg", inertia = "1e-5 kg m^2", centre = ["2 mm", "1 mm"]}
bodies.lever.mass = "1.1 kg"
bodies.lever.centre = ["120 mm", "5 mm"]
bodies.lever.inertia = "5e-3 kg m^2"
bodies.lever.points = {slot = ["0 mm", "20 mm"]}
joints.main = {revolute = ["ground", "crank.start"]}
joints.pin = {revolute = ["crank.end", "block"]}
joints.foot = {revolute = ["ground.pivot", "lever.start"]}
joints.slide = {prismatic = ["lever.slot", "block"], direction = [0.96, 0.28], branch = "+"}
"""

# The guide turns with the driven arm.
SWINGING = """
gravity = [0.0, -9.81]
ground.pivot = ["100 mm", "40 mm"]
bodies.arm = {length = "200 mm", mass = "1 kg", points = {slot = ["10 mm", "15 mm"]}}
bodies.block = {mass = "0.3 kg", inertia = "1e-4 kg m^2", points = {edge = ["5 mm", "-3 mm"]}}
bodies.rod = {length = "250 mm", mass = "0.4 kg"}
joints.main = {revolute = ["ground", "arm.start"]}
joints.wrist = {revolute = ["rod.end", "block"]}
joints.foot = {revolute = ["ground.pivot", "rod.start"]}
joints.slot = {prismatic = ["arm.slot", "block.edge"], direction = [0.8, -0.6], branch = "+"}
"""

MECHANISMS = {
    "slider": (SLIDER, 'branch = "+"'),
    "slider, other branch": (SLIDER, 'branch = "-"'),
    "four-bar": (FOUR_BAR, 'branch = "+"'),
    "four-bar, other branch": (FOUR_BAR, 'branch = "-"'),
    "lever": (LEVER, 'branch = "+"'),
    "lever, guide on the block": (LEVER.replace('["lever.slot", "block"]', '["block", "lever.slot"]'), 'branch = "+"'),
    "lever, other branch": (LEVER, 'branch = "-"'),
    "swinging guide": (SWINGING, 'branch = "+"'),
}


@pytest.fixture(scope="module", params=MECHANISMS)
def mechanism(request) -> tuple[Scene, RigidMotion]:
    text, branch = MECHANISMS[request.param]
    drive = 'drives.main = {speed = "60 rad/s", cycle = "360 deg"}\n'
    scene = scene_of("schema = 1\n" + text.replace('branch = "+"', branch) + drive)
    return scene, motion_of(scene)


def rate(y: np.ndarray, h: float) -> np.ndarray:
    """Derivative of a periodic series over its first turn, by differences of order six."""
    y = y[:180]
    differences = (np.roll(y, -k) - np.roll(y, k) for k in (1, 2, 3))
    return sum(w * d for w, d in zip((45, -9, 1), differences, strict=True)) / (60 * h)


@pytest.mark.exhaustive
def test_joints_stay_closed(mechanism):
    scene, rigid = mechanism
    assert widest_gap(scene, rigid) < 1e-15
    for carrier, slider in (joint.addresses for joint in scene.joints.values() if joint.kind == "prismatic"):
        c, s = turned(rigid, carrier.body, (1.0, 0.0))
        assert rigid[f"{slider.body}.c"] == pytest.approx(c, abs=1e-14)
        assert rigid[f"{slider.body}.s"] == pytest.approx(s, abs=1e-14)


@pytest.mark.exhaustive
def test_rates_are_derivatives(mechanism):
    scene, rigid = mechanism
    h = rigid.times[1] - rigid.times[0]

    def agree(found: np.ndarray, expected: np.ndarray) -> bool:
        return bool(np.abs(found[:180] - expected).max() <= 1e-5 * max(np.abs(expected).max(), 1e-6))

    for body in scene.bodies:
        for axis in "xy":
            assert agree(rigid[f"{body}.v_{axis}"], rate(rigid[f"{body}.{axis}"], h)), body
            assert agree(rigid[f"{body}.a_{axis}"], rate(rigid[f"{body}.v_{axis}"], h)), body
        c, s, omega = (rigid[f"{body}.{name}"] for name in ("c", "s", "omega"))
        assert c**2 + s**2 == pytest.approx(1.0, abs=1e-13)
        assert agree(omega, c[:180] * rate(s, h) - s[:180] * rate(c, h)), body
        assert agree(rigid[f"{body}.epsilon"], rate(omega, h)), body


@pytest.mark.exhaustive
def test_every_body_balances(mechanism):
    scene, rigid = mechanism
    assert imbalance(scene, rigid) < 1e-10


@pytest.mark.exhaustive
def test_loads_have_the_size_that_the_scene_gives(mechanism):
    scene, rigid = mechanism
    for name, each in scene.loads.items():
        expected = each.value if each.kind == "value" else 100 * np.sin(3 * rigid["main.angle"]) + 60
        assert rigid[name] == pytest.approx(expected * np.ones(len(rigid.times)), rel=1e-12), name


@pytest.mark.exhaustive
def test_branch_chooses_the_side(mechanism):
    """Four-bar: the knee is left of the line between its pivots for +. Slider crank: the rod points along the guide.

    Position analysis chooses the same assembly, of these and of levers.
    """
    scene, rigid = mechanism
    for body in scene.bodies:
        for key in ("x", "y", "c", "s"):
            own = placed(mechanism_of(scene))
            assert own[f"{body}.{key}"] == pytest.approx(rigid[f"{body}.{key}"][0], abs=1e-9), body

    def point(*address: str) -> np.ndarray:
        return place(scene, rigid, Address(*address))

    closing, side = next(reversed(scene.joints.values())), None
    if "knee" in scene.joints:
        near = point("coupler", "near")
        d, v = point("rocker", "start") - near, point("coupler", "far") - near
        side = d[0] * v[1] - d[1] * v[0]
    elif "bore" in scene.joints:
        side = np.array(closing.direction) @ (point("rod", "end") - point("rod", "start"))
    assert side is None or (np.sign(side) == (1 if closing.branch == "+" else -1)).all()


def test_a_cylinder_whose_ends_keep_their_distance_is_named():
    """Both turn about the same pivot: the eyes of the cylinder stay 0.5 m apart wherever the lever stands."""
    with pytest.raises(SceneError, match=r"barrel, rod, lever can still move together.*cylinder") as refusal:
        placed(mechanism_of(scene_of(machine(
            bodies=dict(barrel='length = "0.3 m", mass = "5 kg"', rod='length = "0.4 m", mass = "5 kg"',
                        lever='length = "1 m", mass = "20 kg"'),
            joints=dict(foot="revolute ground lever.start", base="revolute ground barrel.start",
                        cylinder="prismatic barrel.start rod.start, direction = [1, 0]",
                        eye='revolute rod.end lever.mid, near = {lever = "60 deg"}'),
            drives=dict(cylinder='law = "0.1"'), solve=dict(preset="rigid", duration="1 s"),
        ))))
    assert refusal.value.key == "joints.eye"


# Without shrinking: a first failure already names its numbers, and to shrink would mean to solve hundreds more.
some = settings(
    max_examples=8, deadline=None, derandomize=True, phases=[Phase.generate], suppress_health_check=list(HealthCheck)
)

FOUR_BARS = {
    "bodies": ["crank", "coupler", "rocker"],
    "joints": {
        "main": 'revolute = ["ground", "crank.start"]',
        "pin": 'revolute = ["crank.end", "coupler.start"]',
        "knee": 'revolute = ["coupler.end", "rocker.end"]',
        "foot": 'revolute = ["ground.pivot", "rocker.start"], branch = "{branch}"',
    },
}
SLIDER_CRANK = {
    "bodies": ["crank", "rod", "piston"],
    "joints": {
        "main": 'revolute = ["ground", "crank.start"]',
        "pin": 'revolute = ["crank.end", "rod.start"]',
        "wrist": 'revolute = ["rod.end", "piston"]',
        "bore": 'prismatic = ["ground.pivot", "piston"], direction = [{c!r}, {s!r}], branch = "{branch}"',
    },
}
LEVERS = {
    "bodies": ["crank", "block", "lever"],
    "joints": {
        "main": 'revolute = ["ground", "crank.start"]',
        "pin": 'revolute = ["crank.end", "block"]',
        "foot": 'revolute = ["ground.pivot", "lever.start"]',
        "slide": 'prismatic = ["lever.start", "block"], direction = [{c!r}, {s!r}], branch = "{branch}"',
    },
}
CHAIN = {
    "bodies": ["crank", "arm", "hand"],
    "joints": {
        "main": 'revolute = ["ground", "crank.start"]', "elbow": 'revolute = ["crank.end", "arm.start"]',
        "wrist": 'revolute = ["arm.end", "hand.start"]',
    },
}


def number(low: float, high: float):
    """Never zero: numbers that are exactly zero make a structure of their own, which would be derived anew."""
    return st.floats(low, high, allow_subnormal=False).filter(lambda x: abs(x) > 1e-9)


@st.composite
def linkage(draw, kind: dict) -> dict:
    """Numbers of a linkage that turns through: lengths by Grashof's rule, or long enough."""
    r = draw(number(0.02, 0.08))
    numbers = {"lengths": {}, "pivot": (0.0, 0.0), "branch": draw(st.sampled_from("+-"))}
    angle = draw(number(-1.0, 1.0))
    numbers |= {"c": float(np.cos(angle)), "s": float(np.sin(angle))}
    if kind is FOUR_BARS:  # shortest + longest < the other two
        l, q = draw(number(2.0, 3.0)) * r, draw(number(2.0, 3.0)) * r
        d = draw(number(abs(l - q) / r + 1.2, (l + q) / r - 1.2)) * r
        numbers |= {"lengths": {"crank": r, "coupler": l, "rocker": q}, "pivot": (0.8 * d, 0.6 * d)}
    elif kind is SLIDER_CRANK:
        offset = draw(number(-0.5, 0.5)) * r
        numbers["lengths"] = {"crank": r, "rod": draw(number(1.8, 5.0)) * r}
        numbers["pivot"] = (-numbers["s"] * offset, numbers["c"] * offset)
    elif kind is LEVERS:
        d = draw(number(1.3, 4.0)) * r
        numbers |= {"lengths": {"crank": r, "lever": 2 * r}, "pivot": (0.6 * d, -0.8 * d)}
    else:
        numbers["lengths"] = {name: r * draw(number(0.5, 3.0)) for name in kind["bodies"]}
        numbers["relative"] = {name: draw(number(-30.0, 30.0)) for name in ("elbow", "wrist")}
    numbers["bodies"] = {
        name: {
            "mass": draw(number(0.1, 3.0)), "inertia": draw(number(1e-6, 1e-3)),
            "centre": (draw(number(-0.05, 0.1)), draw(number(-0.03, 0.03))),
        }
        for name in kind["bodies"]
    }
    numbers["speed"] = draw(number(1.0, 60.0)) * draw(st.sampled_from([-1, 1]))
    numbers["gravity"] = (draw(number(-10.0, 10.0)), draw(number(-10.0, 10.0)))
    numbers["force"] = draw(number(-500.0, 500.0))
    return numbers


def written(kind: dict, numbers: dict) -> str:
    """Text of the scene."""
    gravity, (x, y) = list(numbers["gravity"]), numbers["pivot"]
    lines = ["schema = 1", f"gravity = {gravity}", f"ground = {{pivot = [{x!r}, {y!r}]}}"]
    for name in kind["bodies"]:
        body = numbers["bodies"][name]
        lines += [f"[bodies.{name}]", f"mass = {body['mass']!r}", f"inertia = {body['inertia']!r}"]
        lines += [f"centre = [{body['centre'][0]!r}, {body['centre'][1]!r}]"]
        if name in numbers["lengths"]:
            lines += [f"length = {numbers['lengths'][name]!r}"]
    joints = {name: text.format(**numbers) for name, text in kind["joints"].items()}
    lines += ["[joints]", *(f"{name} = {{{joint}}}" for name, joint in joints.items())]
    lines += ["[drives]", f"main = {{speed = {numbers['speed']!r}}}"]
    lines += [f"{name} = {{speed = {speed!r}}}" for name, speed in numbers.get("relative", {}).items()]
    last, force = kind["bodies"][-1], numbers["force"]
    lines += ["[loads]", f'push = {{force_on = "{last}", direction = [0.6, 0.8], value = {force!r}}}']
    lines += ["[solve]", 'preset = "rigid"', 'duration = "1 s"']
    return "\n".join(lines) + "\n"


def turning(text: str) -> tuple[Scene, RigidMotion]:
    """A turn of the first drive in steps of 3 degrees."""
    scene = scene_of(text)
    module, _ = find_module(scene, lambda stage: None)
    times = np.radians(np.arange(0, 360, 3)) / abs(next(iter(scene.drives.values())).speed)
    return scene, RigidKinematics(module, bind_parameters(scene, module)).at(times)


KINDS = {"four-bar": FOUR_BARS, "slider-crank": SLIDER_CRANK, "lever": LEVERS, "chain": CHAIN}


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_random_linkages_close_and_balance(kind):
    @some
    @given(linkage(kind))
    def check(numbers: dict) -> None:
        scene, rigid = turning(written(kind, numbers))
        assert np.isfinite(rigid.values).all()
        size = max(np.abs(rigid[f"{body}.{axis}"]).max() for body in scene.bodies for axis in "xy")
        size = max(size, *(body.length or 0.0 for body in scene.bodies.values()))
        assert widest_gap(scene, rigid) < 1e-12 * size
        assert imbalance(scene, rigid) < 1e-10

    check()


# ---- elastic links -----------------------------------------------------------------------------------------------


@st.composite
def sections(draw) -> tuple[float, float, float, int]:
    """Length [m], A [m^2], I [m^4] and number of elements of a steel link."""
    length, height = draw(number(0.1, 2.0)), draw(number(0.005, 0.05))
    width = draw(number(0.005, 0.05))
    return length, width * height, width * height**3 / 12, draw(st.integers(1, 8))


def arm(section: tuple[float, float, float, int], speed: float) -> Model:
    """A turning steel link with a load at its end; another one hangs from it."""
    length, A, I, elements = section
    beam = f'length = {length!r}, beam = {{material = "steel", A = {A!r}, I = {I!r}, elements = {elements}}}'
    return load(scene_of(f"""
schema = 1
bodies = {{upper = {{{beam}}}, lower = {{like = 'upper'}}}}
joints = {{main = {{revolute = ['ground', 'upper.start']}}, elbow = {{revolute = ['upper.end', 'lower.start']}}}}
drives = {{main = {{speed = {speed!r}}}, elbow = {{law = '0.5 * sin(3 * t)'}}}}
masses.load = {{at = 'lower.end', mass = 0.3}}
solve.duration = 1
"""))


@some
@given(section=sections(), speed=number(-50.0, 50.0), t=number(0.0, 10.0))
def test_matrices_of_random_elastic_arms(section, speed, t):
    """M and K_s positive definite; in a link's own axes C_d is skew, and a rigid displacement costs nothing."""
    found = arm(section, speed)
    M, K = found.M(t), found.K_s(t)
    assert np.abs(M - M.T).max() <= 1e-13 * np.abs(M).max() and np.abs(K - K.T).max() <= 1e-13 * np.abs(K).max()
    scale = 1 / np.sqrt(np.diag(M))
    assert eigvalsh(M * scale[:, None] * scale).min() > 1e-9
    assert eigvalsh(K, M)[0] > 0
    scalars = {name: found.motion.at(t)[name][0] for name in found.motion.column}
    for link in found.links.values():
        matrices = {key: link.part.matrices[key].value(scalars) for key in ("C_d", "K_s", "M")}
        C = matrices["C_d"]
        assert np.abs(C).max() > 0 or scalars[f"{link.name}.omega"] == 0
        assert np.abs(C + C.T).max() <= 1e-13 * np.abs(C).max()
        assert eigvalsh(matrices["M"])[0] > 0
        shift = np.zeros((link.part.size, 3))
        for k, x in enumerate(link.nodes):
            shift[3 * k : 3 * k + 3] = [[1, 0, 0], [0, 1, x], [0, 0, 1]]
        K_s = matrices["K_s"]
        size = np.abs(K_s) @ np.abs(shift)
        assert (np.abs(K_s @ shift) <= 1e-12 * size.max(axis=0)).all()
